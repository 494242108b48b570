//! Map of a single scan: the lines that a robot sees from its pose. For the part of a robot's
//! program that runs on a PC; feature `host`.

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

    /// Length, mm.
    pub fn length_mm(self) -> f32 {
        self.start.distance_mm(self.end)
    }

    /// The piece of wall in the world, as observed by a robot at `robot`.
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
/// Margin around the observed area, in cells, as in the fielded program.
const MARGIN: u8 = 5;
/// 51.2 m square: ten times the range of lidars of this kind.
const CELLS_MAX: usize = 512 * 512;
/// Narrower gaps are closed: line ends lie up to their tolerance from their common corner, and no
/// robot fits through.
const GAP_MM: f32 = 150.0;
/// Distance between the ends of rays on a wall, small enough that no cell between is missed.
const RAY_STEP_MM: f32 = 25.0;

/// The map of `lines`, observed by a robot at `robot` in its own frame; the map is in the frame of
/// the pose `robot`.
///
/// # Errors
/// If an end of a line is not finite, or farther than the range of any lidar.
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

/// Closes short gaps between wall ends.
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

/// Frees the cells before the first obstacle on the line from `eye` to `target`. The fielded
/// program goes in the other direction and on to the end, and so frees cells behind walls.
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

/// Removes free cells without a free neighbour: they were seen through a crack.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(start: (f32, f32), end: (f32, f32)) -> Segment {
        Segment::new(Point::new(start.0, start.1), Point::new(end.0, end.1))
    }

    /// In the middle of cell (0, 0), along x.
    fn eye() -> Pose {
        Pose::new(50.0, 50.0, 0.0)
    }

    /// A line of 300 mm along x and 400 mm along y is 500 mm long: in steps of 250 or 499 mm that
    /// are three points, in steps of 500 mm only the ends.
    #[test]
    fn points_are_at_most_a_step_apart() {
        let line = segment((0.0, 0.0), (300.0, 400.0));
        assert_eq!(line.length_mm(), 500.0);
        let points: Vec<Point> = line.points(250.0).collect();
        let expected = [(0.0, 0.0), (150.0, 200.0), (300.0, 400.0)];
        assert_eq!(points, expected.map(|(x, y)| Point::new(x, y)));
        assert_eq!(line.points(499.0).count(), 3);
        assert_eq!(line.points(500.0).count(), 2);
    }

    /// A wall 1 m ahead and 600 mm long lies in cells -3 to 3 of column 10. The space before it is
    /// free, the space behind it and beside the robot is unknown.
    #[test]
    fn a_wall_hides_what_is_behind_it() {
        let map = local_map(eye(), &[segment((1_000.0, -300.0), (1_000.0, 300.0))]).expect("near");
        for y in -3..=3 {
            assert_eq!(map.get(Cell::new(10, y)), OBSTACLE, "{y}");
            assert_eq!(map.get(Cell::new(11, y)), UNKNOWN, "{y}");
        }
        assert_eq!(map.get(Cell::new(10, 4)), UNKNOWN);
        assert_eq!(map.get(Cell::new(10, -4)), UNKNOWN);
        for x in 0..10 {
            assert_eq!(map.get(Cell::new(x, 0)), FREE, "{x}");
        }
        assert_eq!(map.get(Cell::new(0, 5)), UNKNOWN);
        assert_eq!(map.get(Cell::new(-1, 0)), UNKNOWN);
    }

    /// A second wall behind the first is drawn, but nothing between them is free.
    #[test]
    fn rays_end_at_the_first_wall() {
        let near = segment((1_000.0, -300.0), (1_000.0, 300.0));
        let far = segment((1_500.0, -100.0), (1_500.0, 100.0));
        let map = local_map(eye(), &[near, far]).expect("near");
        assert_eq!(map.get(Cell::new(15, 0)), OBSTACLE);
        for x in 11..15 {
            assert_eq!(map.get(Cell::new(x, 0)), UNKNOWN, "{x}");
        }
    }

    /// Ends at -70 and 70 mm are in the cells beside that of the gap, as are those at -80 and 80.
    #[test]
    fn gaps_below_150_mm_are_closed() {
        let gap = |half: f32| {
            let walls = [
                segment((1_000.0, -500.0), (1_000.0, -half)),
                segment((1_000.0, half), (1_000.0, 500.0)),
            ];
            let map = local_map(eye(), &walls).expect("near");
            assert_eq!(map.get(Cell::new(10, 1)), OBSTACLE);
            assert_eq!(map.get(Cell::new(10, -1)), OBSTACLE);
            map.get(Cell::new(10, 0))
        };
        assert_eq!(gap(70.0), OBSTACLE);
        assert_ne!(gap(80.0), OBSTACLE);
    }

    /// Two cells that touch at a corner are two islands, two that share an edge are none.
    #[test]
    fn a_free_cell_alone_was_seen_through_a_crack() {
        let mut map = CellMap::new(CELL_MM, MARGIN, CELLS_MAX);
        let cells = [(0, 0), (2, 2), (3, 3), (5, 5), (5, 6)].map(|(x, y)| Cell::new(x, y));
        for cell in cells {
            map.set(cell, FREE).expect("near");
        }
        remove_islands(&mut map).expect("near");
        let left = cells.map(|cell| map.get(cell));
        assert_eq!(left, [UNKNOWN, UNKNOWN, UNKNOWN, FREE, FREE]);
    }
}
