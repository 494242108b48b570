//! What one look shows: the map of the lines that a robot sees from where it stands. For the part
//! of a robot's program that runs on a PC; feature `host`.

use alloc::vec::Vec;

use crate::cell_map::{Cell, CellMap};
use crate::grid::{FREE, OBSTACLE, UNKNOWN};
use crate::growing_map::NotWritten;
use crate::pose::{Point, Pose};

/// A straight piece of wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// One end.
    pub start: Point,
    /// The other.
    pub end: Point,
}

impl Segment {
    /// The piece between these ends.
    pub const fn new(start: Point, end: Point) -> Self {
        Self { start, end }
    }

    /// From one end to the other, mm.
    pub fn length_mm(self) -> f32 {
        self.start.distance_mm(self.end)
    }

    /// The piece of wall in the world, that a robot at `robot` sees so.
    pub fn to_world(self, robot: Pose) -> Self {
        Self::new(robot.to_world(self.start), robot.to_world(self.end))
    }

    /// Points along it, at most `step_mm` apart, with both ends.
    pub fn points(self, step_mm: f32) -> impl Iterator<Item = Point> {
        let steps = libm::ceilf(self.length_mm() / step_mm).clamp(1.0, 10_000.0);
        #[expect(clippy::cast_possible_truncation, reason = "at most 10,000")]
        #[expect(clippy::cast_sign_loss, reason = "at least 1")]
        let count = steps as u16;
        (0..=count).map(move |at| {
            let part = f32::from(at) / steps;
            let between = |start: f32, end: f32| start + part * (end - start);
            Point::new(
                between(self.start.x_mm, self.end.x_mm),
                between(self.start.y_mm, self.end.y_mm),
            )
        })
    }
}

/// Edge of a cell, mm: the task sheet of the course.
pub const CELL_MM: f32 = 100.0;
/// Cells around what is seen, as in the fielded program.
const MARGIN: u8 = 5;
/// 51.2 m square: ten times as far as lidars of this kind see.
const CELLS_MAX: usize = 512 * 512;
/// A gap that is narrower is none: line ends lie up to their tolerance from the corner that they
/// meet in, and no robot fits through.
const GAP_MM: f32 = 150.0;
/// Rays end this close to each other on a wall, so that no cell on the way is missed.
const RAY_STEP_MM: f32 = 25.0;

/// The map of what a robot at `robot` sees as these `lines`, which are in its own frame; the map is
/// in the frame of `robot`.
///
/// # Errors
/// If an end of a line is no place, or farther than any lidar sees.
pub fn local_map(robot: Pose, lines: &[Segment]) -> Result<CellMap, NotWritten> {
    let mut map = CellMap::new(CELL_MM, MARGIN, CELLS_MAX);
    let mut walls: Vec<Segment> = lines.iter().map(|line| line.to_world(robot)).collect();
    close_gaps(&mut walls);
    for wall in &walls {
        draw(&mut map, *wall)?;
    }
    let eye = robot.position();
    for wall in &walls {
        for target in wall.points(RAY_STEP_MM) {
            free(&mut map, eye, target)?;
        }
    }
    remove_islands(&mut map)?;
    Ok(map)
}

/// Adds what joins ends that are near each other.
fn close_gaps(walls: &mut Vec<Segment>) {
    let ends: Vec<(usize, Point)> = walls
        .iter()
        .enumerate()
        .flat_map(|(index, wall)| [(index, wall.start), (index, wall.end)])
        .collect();
    for (at, (one, from)) in ends.iter().enumerate() {
        for (other, to) in &ends[at + 1..] {
            if one != other && from.distance_mm(*to) < GAP_MM {
                walls.push(Segment::new(*from, *to));
            }
        }
    }
}

fn draw(map: &mut CellMap, wall: Segment) -> Result<(), NotWritten> {
    let mut cells = Vec::new();
    map.walk(wall.start, wall.end, |cell| {
        cells.push(cell);
        cells.len() < CELLS_MAX
    })?;
    cells
        .into_iter()
        .try_for_each(|cell| map.set(cell, OBSTACLE))
}

/// Frees what lies before the first obstacle on the way from `eye` to `target`. The fielded program
/// goes the other way and on to the end, and so frees cells behind walls.
fn free(map: &mut CellMap, eye: Point, target: Point) -> Result<(), NotWritten> {
    let mut cells = Vec::new();
    map.walk(eye, target, |cell| {
        let is_open = map.get(cell) != OBSTACLE;
        if is_open {
            cells.push(cell);
        }
        is_open
    })?;
    cells.into_iter().try_for_each(|cell| map.set(cell, FREE))
}

/// Free cells beside which nothing is free were seen through a crack.
fn remove_islands(map: &mut CellMap) -> Result<(), NotWritten> {
    let is_island = |cell: Cell| !cell.edge_neighbours().iter().any(|near| map.is_free(*near));
    let islands: Vec<Cell> = map
        .iter()
        .filter(|(cell, value)| *value == FREE && is_island(*cell))
        .map(|(cell, _)| cell)
        .collect();
    islands
        .into_iter()
        .try_for_each(|cell| map.set(cell, UNKNOWN))
}
