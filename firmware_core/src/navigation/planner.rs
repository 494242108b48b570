//! Ways around what is in the way: a wave from the goal through the free cells of a coarse map.
//!
//! A cell is three by three cells of the map, as in the seed's navigation map (100 x 100), and
//! takes four bits: blocked, or the direction in which the goal lies. Cells that nobody has seen
//! count as free; if they are not, the next plan knows better.

use crate::grid::Grid;
use crate::pose::{Point, Pose};

use super::{Body, Surroundings};

/// Map cells along the edge of a planner's cell.
const COARSE: usize = 3;
/// Cells along an edge.
const EDGE: u8 = 100;
const SIDE: usize = EDGE as usize;
const _: () = assert!(SIDE == crate::grid::SIDE / COARSE);
/// Map value from which a cell counts as an obstacle. A beam's end is drawn as a ramp; this much of
/// it lies within 25 mm of the end.
const OBSTACLE_FROM: u8 = 215;
/// What is blocked only because it is near something is opened this far around start and goal.
const OPENED_MM: f32 = 120.0;
/// The robot steers for a cell of its way at most so far ahead.
const AHEAD_CELLS: usize = 20;
/// The robot finds back to its way from so far beside it.
const STRAY_CELLS: i8 = 4;
/// A wave front cannot be longer than the map's rim.
const FRONT_MAX: usize = 4 * SIDE + 112;

/// Not reached by the wave.
const UNREACHED: u8 = 0;
/// The wave came from this neighbour: number in [`NEIGHBOURS`] plus one, 1 to 8.
const NEIGHBOURS: [(i8, i8); 8] = [
    (1, 0),
    (0, 1),
    (-1, 0),
    (0, -1),
    (1, 1),
    (-1, 1),
    (-1, -1),
    (1, -1),
];
const GOAL: u8 = 9;
/// Too near to an obstacle.
const NEAR: u8 = 10;
const OBSTACLE: u8 = 11;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Cell {
    x: u8,
    y: u8,
}

/// The newest plan.
#[derive(Clone, Debug)]
pub(super) struct Planner {
    /// Two cells a byte.
    cells: [[u8; SIDE / 2]; SIDE],
    cell_mm: f32,
}

impl Planner {
    pub(super) const fn new() -> Self {
        Self {
            cells: [[0; SIDE / 2]; SIDE],
            cell_mm: 1.0,
        }
    }

    /// Plans all ways to `goal`, from what the map holds and what is seen right now.
    pub(super) fn plan(
        &mut self,
        map: &Grid,
        body: &Body,
        pose: Pose,
        goal: Point,
        around: &Surroundings,
    ) {
        self.cell_mm = map.resolution_mm() * COARSE as f32;
        self.cells = [[UNREACHED * 0x11; SIDE / 2]; SIDE];
        self.mark_obstacles(map, pose, around);
        self.block_near(body.keep_mm() - 25.0);
        self.open_around(pose.position());
        self.open_around(goal);
        if let Some(goal) = self.cell_of(goal) {
            self.spread(goal);
        }
    }

    /// The point to steer for from `from`: the farthest one of the way that can be seen from there.
    /// `None` if no way leads to the goal, or if it has been reached.
    pub(super) fn way_from(&self, from: Point) -> Option<Point> {
        let start = self.nearest_reached(self.cell_of(from)?)?;
        let (mut here, mut best) = (start, None);
        for _ in 0..AHEAD_CELLS {
            match self.get(here) {
                GOAL => break,
                direction @ 1..=8 => here = neighbour(here, usize::from(direction) - 1)?,
                _ => return None,
            }
            if !self.sees(start, here) {
                break;
            }
            best = Some(here);
        }
        best.map(|cell| self.middle(cell))
    }

    /// The nearest cell that the wave has reached: a robot that drives along the rim of what is
    /// free is now and then a cell beside it.
    fn nearest_reached(&self, cell: Cell) -> Option<Cell> {
        let is_reached = |cell: &Cell| (1..=GOAL).contains(&self.get(*cell));
        (0..=STRAY_CELLS).find_map(|apart| {
            (-apart..=apart)
                .flat_map(|dy| (-apart..=apart).map(move |dx| (dx, dy)))
                .filter_map(|(dx, dy)| moved(cell, dx, dy))
                .find(is_reached)
        })
    }

    fn mark_obstacles(&mut self, map: &Grid, pose: Pose, around: &Surroundings) {
        for (y, rows) in (0..).zip(map.rows().chunks_exact(COARSE)) {
            for row in rows {
                for (x, cells) in (0..).zip(row.chunks_exact(COARSE)) {
                    if cells.iter().any(|value| *value >= OBSTACLE_FROM) {
                        self.set(Cell { x, y }, OBSTACLE);
                    }
                }
            }
        }
        for (point, _) in around.points() {
            if let Some(cell) = self.cell_of(pose.to_world(point)) {
                self.set(cell, OBSTACLE);
            }
        }
    }

    /// Blocks what lies within `keep_mm` of an obstacle.
    fn block_near(&mut self, keep_mm: f32) {
        let reach = self.reach(keep_mm);
        for y in 0..EDGE {
            for x in 0..EDGE {
                if self.get(Cell { x, y }) == OBSTACLE {
                    self.change_disc(Cell { x, y }, reach, UNREACHED, NEAR);
                }
            }
        }
    }

    fn open_around(&mut self, point: Point) {
        if let Some(cell) = self.cell_of(point) {
            let reach = self.reach(OPENED_MM);
            self.change_disc(cell, reach, NEAR, UNREACHED);
        }
    }

    fn change_disc(&mut self, middle: Cell, reach: i8, from: u8, to: u8) {
        let limit = i16::from(reach) * i16::from(reach);
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let apart = i16::from(dx) * i16::from(dx) + i16::from(dy) * i16::from(dy);
                if apart <= limit
                    && let Some(cell) = moved(middle, dx, dy)
                    && self.get(cell) == from
                {
                    self.set(cell, to);
                }
            }
        }
    }

    /// The wave, breadth first.
    fn spread(&mut self, goal: Cell) {
        let mut front = Front::new();
        self.set(goal, GOAL);
        front.push(goal);
        while let Some(cell) = front.pop() {
            for (index, back) in (0..).zip([2, 3, 0, 1, 6, 7, 4, 5]) {
                if let Some(next) = neighbour(cell, index)
                    && self.get(next) == UNREACHED
                {
                    self.set(next, back + 1);
                    front.push(next);
                }
            }
        }
    }

    /// Whether the straight line between two cells is free.
    fn sees(&self, from: Cell, to: Cell) -> bool {
        let (dx, dy) = (
            i16::from(to.x) - i16::from(from.x),
            i16::from(to.y) - i16::from(from.y),
        );
        let steps = (dx.abs().max(dy.abs()) * 2).max(1);
        (0..=steps).all(|step| {
            let along = |from: u8, delta: i16| {
                let cell = (i16::from(from) * steps * 2 + delta * step * 2 + steps) / (steps * 2);
                u8::try_from(cell).expect("between two cells")
            };
            let cell = Cell {
                x: along(from.x, dx),
                y: along(from.y, dy),
            };
            self.get(cell) < NEAR
        })
    }

    fn reach(&self, mm: f32) -> i8 {
        super::ticks((mm / self.cell_mm).min(20.0))
    }

    fn cell_of(&self, point: Point) -> Option<Cell> {
        let index = |mm: f32| {
            let cell = libm::floorf(mm / self.cell_mm);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "range checked"
            )]
            (cell >= 0.0 && cell < f32::from(EDGE)).then_some(cell as u8)
        };
        Some(Cell {
            x: index(point.x_mm)?,
            y: index(point.y_mm)?,
        })
    }

    fn middle(&self, cell: Cell) -> Point {
        let middle = |index: u8| (f32::from(index) + 0.5) * self.cell_mm;
        Point::new(middle(cell.x), middle(cell.y))
    }

    fn get(&self, cell: Cell) -> u8 {
        let pair = self.cells[usize::from(cell.y)][usize::from(cell.x) / 2];
        if cell.x.is_multiple_of(2) {
            pair & 0x0F
        } else {
            pair >> 4
        }
    }

    fn set(&mut self, cell: Cell, value: u8) {
        let pair = &mut self.cells[usize::from(cell.y)][usize::from(cell.x) / 2];
        *pair = if cell.x.is_multiple_of(2) {
            (*pair & 0xF0) | value
        } else {
            (*pair & 0x0F) | value << 4
        };
    }
}

fn neighbour(cell: Cell, index: usize) -> Option<Cell> {
    let (dx, dy) = NEIGHBOURS[index];
    moved(cell, dx, dy)
}

fn moved(cell: Cell, dx: i8, dy: i8) -> Option<Cell> {
    let inside = |index: &u8| *index < EDGE;
    Some(Cell {
        x: cell.x.checked_add_signed(dx).filter(inside)?,
        y: cell.y.checked_add_signed(dy).filter(inside)?,
    })
}

/// Cells that the wave has reached but not yet left.
struct Front {
    cells: [Cell; FRONT_MAX],
    head: usize,
    len: usize,
}

impl Front {
    const fn new() -> Self {
        Self {
            cells: [Cell { x: 0, y: 0 }; FRONT_MAX],
            head: 0,
            len: 0,
        }
    }

    /// A front that is full loses the cell: the way may then lead around it.
    const fn push(&mut self, cell: Cell) {
        if self.len < FRONT_MAX {
            self.cells[(self.head + self.len) % FRONT_MAX] = cell;
            self.len += 1;
        }
    }

    const fn pop(&mut self) -> Option<Cell> {
        if self.len == 0 {
            return None;
        }
        let cell = self.cells[self.head];
        self.head = (self.head + 1) % FRONT_MAX;
        self.len -= 1;
        Some(cell)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::boxed::Box;

    use super::*;

    const BODY: Body = Body {
        radius_mm: 160.0,
        clearance_mm: 45.0,
        tick_mm_s: 11.345,
        axle_mm: 260.0,
    };

    /// A map of 3 m x 3 m with walls drawn cell by cell: x0, y0, x1, y1 in cells.
    fn map(walls: &[[usize; 4]]) -> Box<Grid> {
        let mut map = Box::new(Grid::new(10.0));
        for &[x0, y0, x1, y1] in walls {
            for (x, y) in (x0..=x1).flat_map(|x| (y0..=y1).map(move |y| (x, y))) {
                map.set(x, y, 255);
            }
        }
        map
    }

    fn planned(map: &Grid, from: Point, goal: Point) -> Planner {
        let mut planner = Planner::new();
        let pose = Pose::new(from.x_mm, from.y_mm, 0.0);
        planner.plan(map, &BODY, pose, goal, &Surroundings::EMPTY);
        planner
    }

    /// Follows the plan in steps of 50 mm; the number of steps to the goal, if it gets there.
    fn walk(planner: &Planner, map: &Grid, mut at: Point, goal: Point) -> Option<usize> {
        for steps in 0..200 {
            if at.distance_mm(goal) < 60.0 {
                return Some(steps);
            }
            let aim = planner.way_from(at)?;
            let far = at.distance_mm(aim).max(1.0);
            at = Point::new(
                at.x_mm + 50.0 * (aim.x_mm - at.x_mm) / far,
                at.y_mm + 50.0 * (aim.y_mm - at.y_mm) / far,
            );
            let near = (0..300).flat_map(|y| (0..300).map(move |x| (x, y)));
            let touched = near
                .filter(|&(x, y)| map.get(x, y) == Some(255))
                .any(|(x, y)| map.centre_of(x, y).distance_mm(at) < 150.0);
            assert!(!touched, "{at:?}");
        }
        None
    }

    #[test]
    fn an_open_room_is_crossed_straight() {
        let map = map(&[]);
        let (from, goal) = (Point::new(500.0, 500.0), Point::new(2500.0, 1500.0));
        let planner = planned(&map, from, goal);
        let aim = planner.way_from(from).expect("a way");
        assert!(aim.x_mm > 1000.0, "{aim:?}");
        assert!(walk(&planner, &map, from, goal) < Some(55));
    }

    /// A wall right through the room with a door of 600 mm at its far end: the goal lies straight
    /// behind the wall.
    #[test]
    fn the_way_to_the_other_side_of_a_wall_leads_through_the_door() {
        let map = map(&[[150, 0, 152, 220], [150, 281, 152, 299]]);
        let (from, goal) = (Point::new(1000.0, 500.0), Point::new(2000.0, 500.0));
        let planner = planned(&map, from, goal);
        assert!(walk(&planner, &map, from, goal) > Some(75));
    }

    #[test]
    fn a_goal_that_is_walled_in_has_no_way() {
        let map = map(&[
            [200, 50, 202, 150],
            [250, 50, 252, 150],
            [200, 50, 250, 52],
            [200, 150, 250, 152],
        ]);
        let from = Point::new(1000.0, 500.0);
        let planner = planned(&map, from, Point::new(2260.0, 1000.0));
        assert_eq!(planner.way_from(from), None);
    }

    /// What is seen right now counts, even if the map does not show it yet.
    #[test]
    fn an_obstacle_that_only_the_scan_shows_is_planned_around() {
        let map = map(&[]);
        let (from, goal) = (Point::new(500.0, 1500.0), Point::new(2500.0, 1500.0));
        let wall = (-30..=30_i8).map(|n| Point::new(600.0, f32::from(n) * 10.0));
        let mut planner = Planner::new();
        planner.plan(
            &map,
            &BODY,
            Pose::new(500.0, 1500.0, 0.0),
            goal,
            &Surroundings::of(wall),
        );
        let aim = planner.way_from(from).expect("a way");
        assert!((aim.y_mm - 1500.0).abs() > 100.0, "{aim:?}");
    }

    #[test]
    fn places_off_the_map_have_no_way() {
        let map = map(&[]);
        let from = Point::new(-10.0, 500.0);
        let planner = planned(&map, from, Point::new(3001.0, 500.0));
        assert_eq!(planner.way_from(from), None);
        assert_eq!(planner.way_from(Point::new(500.0, 500.0)), None);
    }

    /// A robot that stands nearer to a wall than it should still finds its way.
    #[test]
    fn a_start_beside_a_wall_is_open() {
        let map = map(&[[0, 100, 299, 101]]);
        let (from, goal) = (Point::new(500.0, 1190.0), Point::new(2500.0, 1500.0));
        assert!(planned(&map, from, goal).way_from(from).is_some());
    }
}
