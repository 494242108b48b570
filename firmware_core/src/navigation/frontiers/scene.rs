//! Parts of the map that a search uses: floor, unknown cells, walls; and the ends of rays over it.

use crate::grid::{Grid, UNKNOWN};
use crate::navigation::cells::{COARSE, Cell, Cells, EDGE, neighbour};
use crate::navigation::raster::OBSTACLE_FROM;
use crate::pose::sin_cos;

use super::{Frontiers, Outlook, Sought};

/// Majority of the nine map cells of a cell.
const MOST: u8 = 5;
/// Number of solid map cells that make a cell a wall, even if the rest is free. A thin board may
/// lie between two cells, and the map draws a flank behind it that looks like floor.
const SOLID: u8 = 2;
/// Rays of a view.
const RAYS: usize = 48;
/// Range of a ray in cells, 1.8 m: a nearer view shows a farther corridor better.
const REACH: i16 = 60;
/// Maximum number of unknown cells that a ray counts: 0.3 m. The space behind them is unknown.
const UNKNOWN_MAX: u16 = 10;
/// Minimum number of cells of an edge; fewer are a crack between two boards.
const EDGE_CELLS_MIN: u8 = 3;
/// Range in cells at which heat is felt well enough: 0.42 m.
const FEEL_CELLS: i16 = 14;
/// Distance from which doubted edges count, 0.42 m: farther than the robot keeps off a corner.
pub(super) const NEAR_CELLS: i16 = 14;
/// Minimum number of rays on a board's face: 0.2 m from 0.3 m away.
const FACE_MIN: u16 = 5;

/// The map in three kinds of cells; a cell of no kind is a wall's soft flank.
pub(super) struct Scene {
    pub(super) free: Cells,
    pub(super) unknown: Cells,
    /// Free cells beside unknown ones.
    edges: Cells,
    /// Edges that only count from near by.
    doubted: Cells,
    /// Walls to feel; felt or given-up walls; and, if faces are distinguished, the floor before the
    /// felt faces.
    pub(super) walls: Cells,
    felt: Cells,
    passed: Option<Cells>,
}

/// A wall near enough to be felt, and the last floor cell before it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wall {
    pub(super) at: Cell,
    pub(super) before: Cell,
}

/// End of a ray.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct End {
    unknown: u16,
    /// The edge, and the number of the ray's step behind it.
    pub(super) edge: Option<(Cell, i16)>,
    pub(super) wall: Option<Wall>,
}

impl Scene {
    pub(super) fn of(map: &Grid, frontiers: &Frontiers) -> Self {
        let mut scene = Self {
            free: Cells::NONE,
            unknown: Cells::NONE,
            edges: Cells::NONE,
            doubted: frontiers.doubted.clone(),
            walls: Cells::NONE,
            felt: frontiers.given_up.clone(),
            passed: frontiers.has_faces.then(|| frontiers.passed.clone()),
        };
        if !frontiers.has_faces {
            scene.felt.add(&frontiers.felt);
        }
        let is_to_be_felt = frontiers.sought == Sought::FloorAndHeat;
        for (y, rows) in (0..).zip(map.rows().chunks_exact(COARSE)) {
            for x in 0..EDGE {
                let first = usize::from(x) * COARSE;
                let cells = rows.iter().flat_map(|row| &row[first..first + COARSE]);
                let (mut free, mut unknown, mut solid) = (0, 0, 0);
                for &value in cells {
                    free += u8::from(value < UNKNOWN);
                    unknown += u8::from(value == UNKNOWN);
                    solid += u8::from(value >= OBSTACLE_FROM);
                }
                let cell = Cell { x, y };
                if free >= MOST && solid < SOLID {
                    scene.free.set(cell);
                } else if unknown >= MOST && solid < SOLID {
                    scene.unknown.set(cell);
                } else if is_to_be_felt {
                    scene.walls.set(cell);
                }
            }
        }
        scene.find_edges(&frontiers.given_up, &frontiers.within);
        scene
    }

    pub(super) fn find_edges(&mut self, given_up: &Cells, within: &Cells) {
        let mut open = Cells::NONE;
        self.free.each(|cell| {
            let beside = (0..4).filter_map(|side| neighbour(cell, side));
            let counts = within.has(cell) && !given_up.has(cell);
            if counts && beside.into_iter().any(|near| self.unknown.has(near)) {
                open.set(cell);
            }
        });
        let mut edges = Cells::NONE;
        open.each(|cell| {
            let mut count = 0;
            cell.each_within(2, |near| count += u8::from(open.has(near)));
            if count >= EDGE_CELLS_MIN {
                edges.set(cell);
            }
        });
        self.edges = edges;
    }

    pub(super) fn look(&self, rays: &Rays, from: Cell, steps: &mut u32) -> Outlook {
        let mut outlook = Outlook::default();
        for ray in rays.0 {
            let end = self.cast(from, ray, steps);
            outlook.unknown += end.unknown;
            outlook.unfelt += u16::from(end.wall.is_some_and(|wall| self.is_unfelt(wall)));
        }
        if self.passed.is_some() && outlook.unfelt < FACE_MIN {
            outlook.unfelt = 0;
        }
        outlook
    }

    pub(super) fn is_unfelt(&self, Wall { at, before }: Wall) -> bool {
        let passed = self.passed.as_ref();
        !self.felt.has(at) && !passed.is_some_and(|passed| passed.has(before))
    }

    /// Whether `cell` is an edge that counts at a ray's `step`.
    const fn counts(&self, cell: Cell, step: i16) -> bool {
        self.edges.has(cell) && (step <= NEAR_CELLS || !self.doubted.has(cell))
    }

    /// Follows a ray over free cells, and over the unknown ones behind an edge.
    pub(super) fn cast(&self, from: Cell, [dx, dy]: [i16; 2], steps: &mut u32) -> End {
        let mut end = End::default();
        let mut last = from;
        for step in 1..=REACH {
            *steps += 1;
            let Some(cell) = along(from, [dx, dy], step) else {
                break;
            };
            if end.edge.is_none() && self.free.has(cell) {
                last = cell;
            } else if self.unknown.has(cell) && (end.edge.is_some() || self.counts(last, step)) {
                end.edge = Some(end.edge.unwrap_or((last, step)));
                end.unknown += 1;
                if end.unknown == UNKNOWN_MAX {
                    break;
                }
            } else {
                let is_near = end.edge.is_none() && step <= FEEL_CELLS;
                let wall = Wall {
                    at: cell,
                    before: last,
                };
                end.wall = (is_near && self.walls.has(cell)).then_some(wall);
                break;
            }
        }
        end
    }
}

/// Directions in 256ths of a cell.
pub(super) struct Rays(pub(super) [[i16; 2]; RAYS]);

impl Rays {
    pub(super) fn new() -> Self {
        let mut rays = [[0; 2]; RAYS];
        for (index, ray) in (0_u8..).zip(&mut rays) {
            // Offset by half a step from the axes, along which walls run.
            let turns = (f32::from(index) + 0.5) / RAYS as f32;
            *ray = direction(turns * core::f32::consts::TAU);
        }
        Self(rays)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "at most 256")]
pub(super) fn direction(bearing: f32) -> [i16; 2] {
    let (sin, cos) = sin_cos(bearing);
    [cos, sin].map(|part| libm::roundf(part * 256.0) as i16)
}

fn along(from: Cell, [dx, dy]: [i16; 2], step: i16) -> Option<Cell> {
    let cells = |part: i16| {
        let far = (i32::from(part) * i32::from(step) + 128) >> 8;
        i8::try_from(far).ok()
    };
    from.moved(cells(dx)?, cells(dy)?)
}
