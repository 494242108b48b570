//! Choice of the next view, and the end of the search: no reachable area is unknown any more.
//!
//! ```text
//! map -> free, unknown, solid cells -> wave from the robot -> views -> the best one
//! ```
//!
//! A view is a position that the robot can reach over known floor. Its worth is the number of
//! unknown cells that its rays meet behind an edge of the known floor, minus a cost for the path.
//! For a robot with heat sensors, walls that the sensors have not passed yet count as well. An edge
//! that stays unknown after a view is doubted: then only a view from near by counts. If that shows
//! nothing either, the edge is given up. The search therefore ends: each view either shows new
//! cells or removes an edge from the list.

mod scene;

use crate::grid::Grid;
use crate::pose::{Point, Pose};

use super::cells::{Cell, Cells, EDGE, NEIGHBOURS, neighbour};
use super::raster::{Front, Raster};
use super::{Body, Surroundings};
use scene::{NEAR_CELLS, Rays, Scene, Wall, direction};

/// Spacing of views in cells.
const VIEW_CELLS: u16 = 3;
/// Radius around a position that showed nothing, in which other views are skipped.
const STALE_CELLS: i8 = 4;
/// Maximum distance of an edge from the reachable area of the robot's middle, 15 cm. The reason:
/// cracks between boards lead to the flank that the map draws behind them, which looks like floor.
const WITHIN_CELLS: i8 = 5;
/// Cost of a cell of the path, in unknown cells.
const WAY_WEIGHT: i32 = 3;
/// For each this many cells of its path, a view must show one more unknown cell; but never more
/// cells than lie behind any door.
const CRUMB_CELLS: u16 = 4;
/// Worth of a ray to an unfelt wall, in unknown cells, and the minimum number of such rays. A wall
/// narrower than a plate of 10 cm was felt together with the walls beside it.
const FEEL_WEIGHT: u16 = 4;
const UNFELT_MIN: u16 = 3;
/// Cells around the end of a ray that count as felt with it.
const FELT_AROUND: i8 = 1;
/// Cells of floor around the last one of a ray that count as passed with it.
const PASSED_AROUND: i8 = 1;
/// Clearance of a path of last resort.
const THIN_MM: f32 = 15.0;
/// Maximum distance of the robot from the floor that its body may reach, in cells.
const STRAY_CELLS: i8 = 5;
/// Steps of rays with the same cost as a point of a candidate pose, 580 cycles of the STM32F4: a
/// step takes 18.
const STEPS_PER_POINT: u32 = 32;
/// Cells of the planner's map.
const CELLS: u32 = EDGE as u32 * EDGE as u32;
/// Cost of sorting the map's cells, in steps, at 4 cycles each; nine map cells are a planner's
/// cell.
const SCENE_STEPS: u32 = 2 * CELLS;
/// Maximum cost, in steps, of a wave over a free map and of growing the reached area by a disc.
const WAVE_STEPS: u32 = 3 * CELLS;

/// Target of the robot's search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sought {
    /// Floor that the lidar has not seen.
    Floor,
    /// Also walls that the heat sensors have not passed.
    FloorAndHeat,
}

/// A position to look from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Position of the robot.
    pub place: Point,
    /// Cells of the planner along the path to the view.
    pub way_cells: u16,
}

/// Content of the view from a position, as counted by rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outlook {
    /// Unknown cells behind edges of the known floor.
    pub unknown: u16,
    /// Rays that end nearby on an unfelt wall.
    pub unfelt: u16,
}

impl Outlook {
    /// Minimum number of unknown cells that justify a path: a corridor seen along its wall shows
    /// few at first.
    pub const SMALL: u16 = 6;
    /// Unknown cells of three full rays.
    pub const LARGE: u16 = 30;
    /// A limit above any view: only heat counts.
    pub const NEVER: u16 = u16::MAX;

    /// Number of unknown cells that justify a path of `way` cells.
    fn worth_a_way_of(way: u16) -> u16 {
        (Self::SMALL + way / CRUMB_CELLS).min(Self::LARGE)
    }

    /// Whether the view justifies a path.
    pub const fn is_worth_a_way(self) -> bool {
        self.gain(Self::SMALL).is_some()
    }

    /// Whether enough of the walls is unfelt to hide a victim.
    pub const fn is_to_be_felt(self) -> bool {
        self.unfelt >= UNFELT_MIN
    }

    /// Gain of the view if it is worth a path; unknown cells count from `least` on.
    const fn gain(self, least: u16) -> Option<u16> {
        let counts = least <= Self::SMALL || self.unknown >= least;
        let unknown = if counts { self.unknown } else { 0 };
        let unfelt = if self.is_to_be_felt() { self.unfelt } else { 0 };
        let gain = unknown + FEEL_WEIGHT * unfelt;
        if gain >= Self::SMALL {
            Some(gain)
        } else {
            None
        }
    }
}

/// Edges and walls that are still to be checked.
#[derive(Clone, Debug)]
pub struct Frontiers {
    sought: Sought,
    /// Edges that a view from afar did not resolve.
    doubted: Cells,
    /// Edges and walls that a view from near by did not resolve.
    given_up: Cells,
    /// Walls that the heat sensors have passed, and the floor from which they passed them.
    felt: Cells,
    passed: Cells,
    /// Whether the two faces of a board are distinguished.
    has_faces: bool,
    /// Positions that showed nothing.
    stale: Cells,
    /// Area in which edges count, as of the newest view; empty before the first one.
    within: Cells,
    steps: u32,
}

impl Frontiers {
    /// A search without any checked edges.
    pub const fn new(sought: Sought) -> Self {
        Self {
            sought,
            doubted: Cells::NONE,
            given_up: Cells::NONE,
            felt: Cells::NONE,
            passed: Cells::NONE,
            has_faces: false,
            stale: Cells::NONE,
            within: Cells::NONE,
            steps: 0,
        }
    }

    /// Gives all given-up edges another chance and from now on distinguishes the two faces of a
    /// board, even if it is only a cell thick. The unfelt rest of a face must then be wider,
    /// because strips are noise of the map.
    pub const fn forgive(&mut self) {
        self.has_faces = true;
        self.doubted = Cells::NONE;
        self.given_up = Cells::NONE;
        self.stale = Cells::NONE;
    }

    /// Notes that a view from `place`, or from the path to it, showed nothing: the search chooses
    /// no view there until [`forgive`](Self::forgive) is called.
    pub fn showed_nothing(&mut self, map: &Grid, place: Point) {
        if let Some(cell) = Raster::of(map).cell_of(place) {
            cell.each_within(STALE_CELLS, |near| self.stale.set(near));
        }
    }

    /// Computing since the last call, in points of candidate poses; see [`crate::Work`].
    pub const fn take_points(&mut self) -> u32 {
        let points = self.steps / STEPS_PER_POINT;
        self.steps %= STEPS_PER_POINT;
        points
    }

    /// The most valuable view, less the cost of its path. `None` if no area that `body` can reach
    /// is unknown, or fewer than `least` cells of it are, and no wall is left to feel. A path that
    /// the body only just fits through is the last resort.
    pub fn next_view(
        &mut self,
        map: &Grid,
        (body, least): (&Body, u16),
        pose: Pose,
        around: &Surroundings,
    ) -> Option<View> {
        let raster = Raster::of(map);
        let obstacles = raster.obstacles(map, pose, around);
        let mut scene = self.scene(map);
        let here = pose.position();
        let mut keeps = [body.keep_mm(), body.radius_mm + THIN_MM].into_iter();
        keeps.find_map(|keep_mm| {
            let near = raster.blocked(&obstacles, raster.reach(keep_mm - 25.0), [here; 2]);
            let start = open_near(&scene, &near, raster.cell_of(here)?)?;
            let mut reached = Cells::NONE;
            wave(&scene, &near, start, |cell, _| reached.set(cell));
            self.within = reached.grown(WITHIN_CELLS);
            self.steps += WAVE_STEPS;
            scene.find_edges(&self.given_up, &self.within);
            let (cell, way_cells) = self.best_view(&scene, &near, start, least)?;
            Some(View {
                place: raster.middle(cell),
                way_cells,
            })
        })
    }

    fn best_view(
        &mut self,
        scene: &Scene,
        near: &Cells,
        start: Cell,
        least: u16,
    ) -> Option<(Cell, u16)> {
        let rays = Rays::new();
        let mut best: Option<(i32, Cell, u16)> = None;
        let mut steps = 0;
        wave(scene, near, start, |cell, way| {
            steps += 8;
            let is_view = cell.x.is_multiple_of(VIEW_CELLS) && cell.y.is_multiple_of(VIEW_CELLS);
            if !is_view && way > 0 {
                return;
            }
            let outlook = scene.look(&rays, cell, &mut steps);
            let least = least.max(Outlook::worth_a_way_of(way));
            let Some(gain) = outlook.gain(least).filter(|_| !self.stale.has(cell)) else {
                return;
            };
            let worth = i32::from(gain) - WAY_WEIGHT * i32::from(way);
            if best.is_none_or(|(most, ..)| worth > most) {
                best = Some((worth, cell, way));
            }
        });
        self.steps += steps;
        best.map(|(_, cell, way)| (cell, way))
    }

    /// Known cells of the planner; felt walls count once more.
    pub fn known_cells(&mut self, map: &Grid) -> u32 {
        let mut unknown = 0;
        self.scene(map).unknown.each(|_| unknown += 1);
        let mut felt = 0;
        self.felt.each(|_| felt += 1);
        CELLS - unknown + felt
    }

    fn scene(&mut self, map: &Grid) -> Scene {
        self.steps += SCENE_STEPS;
        Scene::of(map, self)
    }

    /// The view from `place`.
    pub fn outlook(&mut self, map: &Grid, place: Point) -> Outlook {
        let scene = self.scene(map);
        let cell = Raster::of(map).cell_of(place);
        cell.map_or(Outlook::default(), |cell| {
            scene.look(&Rays::new(), cell, &mut self.steps)
        })
    }

    /// Marks `sought`, visible from `place` or beside it, as given up: the robot checked it without
    /// result, or cannot reach it.
    pub fn give_up(&mut self, map: &Grid, place: Point, sought: Sought) {
        let scene = self.scene(map);
        let Some(from) = Raster::of(map).cell_of(place) else {
            return;
        };
        let (mut far, mut near) = (Cells::NONE, Cells::NONE);
        let rays = Rays::new();
        from.each_within(1, |from| {
            for ray in rays.0 {
                let end = scene.cast(from, ray, &mut self.steps);
                match end.edge {
                    Some((edge, step)) if step <= NEAR_CELLS => near.set(edge),
                    Some((edge, _)) => far.set(edge),
                    None => {}
                }
                let wall = end.wall.filter(|_| sought == Sought::FloorAndHeat);
                if let Some(wall) = wall.filter(|wall| scene.is_unfelt(*wall)) {
                    near.set(wall.at);
                }
            }
        });
        self.doubted.add(&far.grown(1));
        self.given_up.add(&near.grown(1));
    }

    /// Notes that heat sensors at `place` have measured along `bearings` (radians, in the map's
    /// frame).
    pub fn feel(&mut self, map: &Grid, place: Point, bearings: impl Iterator<Item = f32>) {
        let raster = Raster::of(map);
        let Some(from) = raster.cell_of(place) else {
            return;
        };
        let scene = self.scene(map);
        for ray in bearings.map(direction) {
            if let Some(Wall { at, before }) = scene.cast(from, ray, &mut self.steps).wall {
                at.each_within(FELT_AROUND, |cell| self.felt.set(cell));
                before.each_within(PASSED_AROUND, |cell| self.passed.set(cell));
            }
        }
    }
}

/// The cell nearest to the robot's own from which the wave can start.
fn open_near(scene: &Scene, near: &Cells, cell: Cell) -> Option<Cell> {
    let is_open = |cell: &Cell| scene.free.has(*cell) && !near.has(*cell);
    (0..=STRAY_CELLS).find_map(|apart| {
        (-apart..=apart)
            .flat_map(|dy| (-apart..=apart).map(move |dx| (dx, dy)))
            .filter_map(|(dx, dy)| cell.moved(dx, dy))
            .find(is_open)
    })
}

/// Calls `visit` for each cell reachable over known floor, nearest first, with the length of the
/// path in cells.
fn wave(scene: &Scene, near: &Cells, start: Cell, mut visit: impl FnMut(Cell, u16)) {
    let mut reached = Cells::NONE;
    let mut front = Front::new();
    reached.set(start);
    front.push(start);
    let mut way = 0;
    while front.len() > 0 {
        for _ in 0..front.len() {
            let Some(cell) = front.pop() else {
                return;
            };
            visit(cell, way);
            for next in (0..NEIGHBOURS.len()).filter_map(|side| neighbour(cell, side)) {
                if scene.free.has(next) && !near.has(next) && !reached.has(next) {
                    reached.set(next);
                    front.push(next);
                }
            }
        }
        way = way.saturating_add(1);
    }
}

#[cfg(test)]
mod tests;
