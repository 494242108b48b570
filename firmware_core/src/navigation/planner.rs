//! Paths around obstacles: a wave from the goal through the free cells of a coarse map.
//!
//! A cell is three by three cells of the map, as in the seed's navigation map (100 x 100), and
//! takes four bits: the direction in which the goal lies. Unseen cells count as free; if they are
//! not, the next plan corrects this.
//!
//! The planner keeps a chosen path until an obstacle blocks it, and remembers that obstacle as long
//! as another path exists. The reason: the robot sees more of an area while it is there than the
//! map shows later. Without this memory it would turn back half way along the next path.

use crate::grid::Grid;
use crate::pose::{Point, Pose};

use super::cells::{Cell, Cells, SIDE, neighbour};
use super::raster::{Front, OPENED_MM, Raster};
use super::{Body, Surroundings};

/// Maximum distance along the path, in cells, of the cell that the robot steers for.
const AHEAD_CELLS: usize = 20;
/// Maximum distance beside the path, in cells, from which the robot returns to it.
const STRAY_CELLS: i8 = 4;
/// Maximum number of remembered cells that blocked a path.
const REFUSED_MAX: usize = 8;

/// Not reached by the wave.
const UNREACHED: u8 = 0;
/// A byte of two cells that the wave has not reached.
const NOWHERE: u8 = UNREACHED * 0x11;
/// The goal itself; other cells hold the direction from which the wave came: number in
/// [`NEIGHBOURS`] plus one, 1 to 8.
const GOAL: u8 = 9;

/// The newest plan.
#[derive(Clone, Debug)]
pub(super) struct Planner {
    /// Two cells per byte.
    field: [[u8; SIDE.div_ceil(2)]; SIDE],
    /// Cells too near to an obstacle.
    near: Cells,
    raster: Raster,
    /// Goal of the paths, if they may be kept.
    kept: Option<Cell>,
    /// Cells that blocked paths to the goal, the newest at `refusals` - 1.
    refused: [Cell; REFUSED_MAX],
    refusals: usize,
}

impl Planner {
    pub(super) const fn new() -> Self {
        Self {
            field: [[NOWHERE; SIDE.div_ceil(2)]; SIDE],
            near: Cells::NONE,
            raster: Raster::NONE,
            kept: None,
            refused: [Cell { x: 0, y: 0 }; REFUSED_MAX],
            refusals: 0,
        }
    }

    /// Discards the chosen path and the remembered obstacles.
    pub(super) const fn forget(&mut self) {
        self.kept = None;
        self.refusals = 0;
    }

    /// Plans all paths to `goal`, from the map and the current scan; for `body`, or, if no path
    /// leads there, for a body that keeps only `thin_mm`. Returns whether every path on the map was
    /// found blocked; the planner then tries them again.
    pub(super) fn plan(
        &mut self,
        map: &Grid,
        (body, thin_mm): (&Body, f32),
        pose: Pose,
        goal: Point,
        around: &Surroundings,
    ) -> bool {
        self.raster = Raster::of(map);
        let obstacles = self.raster.obstacles(map, pose, around);
        let ends = [pose.position(), goal];
        let reach = self.raster.reach(body.keep_mm() - 25.0);
        let Some(goal) = self.raster.cell_of(goal) else {
            self.field.as_flattened_mut().fill(NOWHERE);
            return false;
        };
        if self.kept == Some(goal) {
            // An obstacle with one free cell of margin at planning may now be drawn a cell nearer.
            let tight = self.raster.blocked(&obstacles, reach - 1, ends);
            match self.stretch_on_way(pose.position(), &tight) {
                Some(None) => {
                    self.near = self.raster.blocked(&obstacles, reach, ends);
                    return false;
                }
                Some(Some(cell)) => self.refuse(self.in_the_way(cell, &obstacles, reach)),
                None => {}
            }
        } else {
            self.refusals = 0;
        }
        self.kept = Some(goal);
        let mut every_way_was_blocked = false;
        if self.refusals > 0 {
            let mut refused = obstacles.clone();
            for &place in &self.refused[..self.refusals.min(REFUSED_MAX)] {
                refused.set(place);
            }
            if self.reaches(&refused, reach, ends, goal) {
                return false;
            }
            self.refusals = 0;
            every_way_was_blocked = true;
        }
        if !self.reaches(&obstacles, reach, ends, goal) {
            // A narrow path is the last resort, and used only while there is no other.
            self.kept = None;
            let reach = self.raster.reach(thin_mm - 25.0);
            self.reaches(&obstacles, reach, ends, goal);
        }
        every_way_was_blocked
    }

    /// Marks the path from `from` as blocked; the next plan takes another one, if there is one.
    pub(super) fn refuse_way_from(&mut self, from: Point) {
        let far = f32::from(self.raster.reach(OPENED_MM)) + 2.0;
        let mut ahead = self.way_from(from);
        if let Some(aim) = ahead {
            let apart = from.distance_mm(aim).max(1.0);
            let part = (far * self.raster.cell_mm() / apart).min(1.0);
            ahead = Some(Point::new(
                from.x_mm + (aim.x_mm - from.x_mm) * part,
                from.y_mm + (aim.y_mm - from.y_mm) * part,
            ));
        }
        if let Some(cell) = ahead.and_then(|place| self.raster.cell_of(place)) {
            self.refuse(cell);
            self.field.as_flattened_mut().fill(NOWHERE);
        }
    }

    /// The obstacle cell that blocks the path at `cell`. The planner stores the obstacle's own
    /// position, so that a path farther from it stays open. If the obstacle is already stored,
    /// returns `cell` itself.
    fn in_the_way(&self, cell: Cell, obstacles: &Cells, reach: i8) -> Cell {
        let known = &self.refused[..self.refusals.min(REFUSED_MAX)];
        let apart = |other: Cell| other.x.abs_diff(cell.x).pow(2) + other.y.abs_diff(cell.y).pow(2);
        let mut nearest: Option<Cell> = None;
        cell.each_within(reach, |other| {
            let is_nearer = nearest.is_none_or(|nearest| apart(other) < apart(nearest));
            if obstacles.has(other) && is_nearer {
                nearest = Some(other);
            }
        });
        nearest.filter(|at| !known.contains(at)).unwrap_or(cell)
    }

    fn refuse(&mut self, cell: Cell) {
        self.refused[self.refusals % REFUSED_MAX] = cell;
        self.refusals += 1;
    }

    /// The point to steer for from `from`: the farthest visible point of the path. `None` if no
    /// path leads to the goal, or if the goal has been reached.
    pub(super) fn way_from(&self, from: Point) -> Option<Point> {
        let start = self.nearest_reached(self.raster.cell_of(from)?)?;
        let (mut here, mut best) = (start, None);
        for _ in 0..AHEAD_CELLS {
            let Some(next) = self.next(here) else {
                break;
            };
            here = next;
            if !self.sees(start, here) {
                break;
            }
            best = Some(here);
        }
        best.map(|cell| self.raster.middle(cell))
    }

    /// Length of the path from `from` in cells, if there is one.
    pub(super) fn way_cells(&self, from: Point) -> Option<u16> {
        let start = self.nearest_reached(self.raster.cell_of(from)?)?;
        let way = core::iter::successors(Some(start), |&cell| self.next(cell));
        Some(way.skip(1).fold(0, |cells: u16, _| cells.saturating_add(1)))
    }

    /// The middle of the first stretch of the path from `from` that crosses `cells`. `None` if
    /// there is no path, `Some(None)` if the path crosses none of the cells.
    fn stretch_on_way(&self, from: Point, cells: &Cells) -> Option<Option<Cell>> {
        let mut here = self.nearest_reached(self.raster.cell_of(from)?)?;
        let (mut middle, mut length) = (None, 0_u16);
        loop {
            if cells.has(here) {
                length += 1;
                middle = match middle {
                    Some(cell) if length % 2 == 1 => self.next(cell),
                    None => Some(here),
                    _ => middle,
                };
            } else if length > 0 {
                break;
            }
            match self.next(here) {
                Some(next) => here = next,
                None => break,
            }
        }
        Some(middle)
    }

    /// The next cell behind `cell` on the path to the goal.
    fn next(&self, cell: Cell) -> Option<Cell> {
        match self.get(cell) {
            direction @ 1..=8 => neighbour(cell, usize::from(direction) - 1),
            _ => None,
        }
    }

    /// The nearest cell that the wave has reached: a robot that drives along the edge of the free
    /// area is sometimes a cell beside it.
    fn nearest_reached(&self, cell: Cell) -> Option<Cell> {
        let is_reached = |cell: &Cell| (1..=GOAL).contains(&self.get(*cell));
        (0..=STRAY_CELLS).find_map(|apart| {
            (-apart..=apart)
                .flat_map(|dy| (-apart..=apart).map(move |dx| (dx, dy)))
                .filter_map(|(dx, dy)| cell.moved(dx, dy))
                .find(is_reached)
        })
    }

    /// Plans with cells within `reach` of obstacles blocked; returns whether a path connects the
    /// ends.
    fn reaches(&mut self, obstacles: &Cells, reach: i8, ends: [Point; 2], goal: Cell) -> bool {
        self.near = self.raster.blocked(obstacles, reach, ends);
        self.field.as_flattened_mut().fill(NOWHERE);
        self.spread(goal);
        let start = self.raster.cell_of(ends[0]);
        start.and_then(|cell| self.nearest_reached(cell)).is_some()
    }

    /// Spreads the wave, breadth first.
    fn spread(&mut self, goal: Cell) {
        let mut front = Front::new();
        self.set(goal, GOAL);
        front.push(goal);
        while let Some(cell) = front.pop() {
            for (index, back) in (0..).zip([2, 3, 0, 1, 6, 7, 4, 5]) {
                if let Some(next) = neighbour(cell, index)
                    && self.get(next) == UNREACHED
                    && !self.near.has(next)
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
            i32::from(to.x) - i32::from(from.x),
            i32::from(to.y) - i32::from(from.y),
        );
        let steps = (dx.abs().max(dy.abs()) * 2).max(1);
        (0..=steps).all(|step| {
            let along = |from: u16, delta: i32| {
                let cell = (i32::from(from) * steps * 2 + delta * step * 2 + steps) / (steps * 2);
                u16::try_from(cell).expect("between two cells")
            };
            let cell = Cell {
                x: along(from.x, dx),
                y: along(from.y, dy),
            };
            !self.near.has(cell)
        })
    }

    fn get(&self, cell: Cell) -> u8 {
        let pair = self.field[usize::from(cell.y)][usize::from(cell.x) / 2];
        if cell.x.is_multiple_of(2) {
            pair & 0x0F
        } else {
            pair >> 4
        }
    }

    fn set(&mut self, cell: Cell, value: u8) {
        let pair = &mut self.field[usize::from(cell.y)][usize::from(cell.x) / 2];
        *pair = if cell.x.is_multiple_of(2) {
            (*pair & 0xF0) | value
        } else {
            (*pair & 0x0F) | value << 4
        };
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

    const THIN_MM: f32 = 175.0;

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
        planner.plan(map, (&BODY, THIN_MM), pose, goal, &Surroundings::EMPTY);
        planner
    }

    /// Follows the plan in steps of 50 mm; the number of steps to the goal, if it is reached.
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

    /// A wall across the room with a door of 600 mm near its end: the goal lies straight behind the
    /// wall.
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

    /// The current scan counts, even where the map does not show it yet.
    #[test]
    fn an_obstacle_that_only_the_scan_shows_is_planned_around() {
        let map = map(&[]);
        let (from, goal) = (Point::new(500.0, 1500.0), Point::new(2500.0, 1500.0));
        let wall = (-30..=30_i8).map(|n| Point::new(600.0, f32::from(n) * 10.0));
        let mut planner = Planner::new();
        planner.plan(
            &map,
            (&BODY, THIN_MM),
            Pose::new(500.0, 1500.0, 0.0),
            goal,
            &Surroundings::of(wall),
        );
        let aim = planner.way_from(from).expect("a way");
        assert!((aim.y_mm - 1500.0).abs() > 100.0, "{aim:?}");
    }

    /// A wall of 60 cm across the straight path, in the scan but not on the map, nearer to the
    /// wall's left end: the path leads around that end.
    fn two_ways() -> (Planner, Box<Grid>, Pose, Point) {
        let (pose, goal) = (Pose::new(500.0, 1500.0, 0.0), Point::new(2500.0, 1500.0));
        let (mut planner, map) = (Planner::new(), map(&[]));
        planner.plan(&map, (&BODY, THIN_MM), pose, goal, &seen(-40..=20));
        (planner, map, pose, goal)
    }

    /// Points 10 mm apart 1 m ahead of the robot's start, from right to left.
    fn seen(across: core::ops::RangeInclusive<i8>) -> Surroundings {
        Surroundings::of(across.map(|n| Point::new(1000.0, f32::from(n) * 10.0)))
    }

    /// Whether the path of `planner` crosses the wall's line above the wall instead of below it.
    fn is_left(planner: &Planner, from: Pose) -> bool {
        planner.way_from(from.position()).expect("a way").y_mm > 1500.0
    }

    /// Most of the wall's right half is no longer seen.
    #[test]
    fn a_way_is_kept_while_nothing_is_in_it() {
        let (mut planner, map, pose, goal) = two_ways();
        assert!(is_left(&planner, pose));
        planner.plan(&map, (&BODY, THIN_MM), pose, goal, &seen(-10..=20));
        assert!(is_left(&planner, pose), "the right end is nearer now");
        let mut new = Planner::new();
        new.plan(&map, (&BODY, THIN_MM), pose, goal, &seen(-10..=20));
        assert!(!is_left(&new, pose), "which a new plan would take");
        planner.plan(
            &map,
            (&BODY, THIN_MM),
            pose,
            Point::new(2400.0, 1500.0),
            &seen(-10..=20),
        );
        assert!(!is_left(&planner, pose), "as one to another goal does");
    }

    /// A wall with two doors, at y = 1.0 to 1.6 m and at 2.3 to 2.9 m. An obstacle stands in the
    /// nearer one and cannot be seen from the path to the other. An obstacle on that path as well
    /// does not change the choice, because the robot can drive around it.
    #[test]
    fn what_blocked_a_way_is_remembered() {
        let map = map(&[
            [150, 0, 152, 99],
            [150, 161, 152, 229],
            [150, 291, 152, 299],
        ]);
        let (pose, goal) = (Pose::new(1000.0, 800.0, 0.0), Point::new(2000.0, 800.0));
        let mut door = Cells::NONE;
        (33..=53).for_each(|y| door.set(Cell { x: 50, y }));
        // Points 10 mm apart, seen from the robot.
        let places = || (0..=60_i8).map(|n| f32::from(n) * 10.0);
        let in_the_door = Surroundings::of(places().map(|y| Point::new(510.0, 200.0 + y)));
        let before_the_other = Surroundings::of(places().map(|x| Point::new(x - 200.0, 1000.0)));
        let mut planner = Planner::new();
        let mut is_nearer = |around: &Surroundings, is_new: bool| {
            if is_new {
                planner.forget();
            }
            planner.plan(&map, (&BODY, THIN_MM), pose, goal, around);
            let way = planner.stretch_on_way(pose.position(), &door);
            way.expect("there is a way").is_some()
        };
        assert!(is_nearer(&Surroundings::EMPTY, false));
        assert!(!is_nearer(&in_the_door, false));
        assert!(!is_nearer(&before_the_other, false));
        assert!(is_nearer(&before_the_other, true));
    }

    /// A corridor of 43 cm between a wall and a board that the map does not show, 15 cm from the
    /// path. The planner refuses the board's position, so the corridor stays open even if the robot
    /// no longer sees the board. When the board blocks again, the planner refuses the position on
    /// the path.
    #[test]
    fn a_board_beside_the_way_does_not_close_the_corridor() {
        let map = map(&[[0, 0, 299, 1]]);
        let (pose, goal) = (Pose::new(500.0, 300.0, 0.0), Point::new(2500.0, 300.0));
        let board = Surroundings::of((50..=110_i8).map(|n| Point::new(f32::from(n) * 10.0, 150.0)));
        let mut corridor = Cells::NONE;
        (0..14).for_each(|y| corridor.set(Cell { x: 43, y }));
        let mut planner = Planner::new();
        for (around, refusals) in [
            (&Surroundings::EMPTY, 0),
            (&board, 1),
            (&Surroundings::EMPTY, 1),
        ] {
            planner.plan(&map, (&BODY, THIN_MM), pose, goal, around);
            assert_eq!(planner.refusals, refusals);
            let way = planner.stretch_on_way(pose.position(), &corridor);
            assert!(way.expect("there is a way").is_some(), "{refusals}");
        }
        let obstacles = planner.raster.obstacles(&map, pose, &board);
        let [at, again] = [Cell { x: 40, y: 10 }, planner.refused[0]];
        assert_eq!(again.y, 15);
        let beside = Cell { y: 10, ..again };
        assert_eq!(planner.in_the_way(beside, &obstacles, 6), beside);
        planner.forget();
        assert_eq!(planner.in_the_way(at, &obstacles, 6), Cell { x: 40, y: 15 });
        assert_eq!(planner.in_the_way(at, &obstacles, 4), at);
    }

    /// A door of 36 cm is too narrow for 16 cm of body and 4.5 cm on each side, but not for 1.5 cm.
    #[test]
    fn a_narrow_door_is_the_last_resort() {
        let (from, goal) = (Point::new(1000.0, 500.0), Point::new(2000.0, 500.0));
        let only = map(&[[150, 0, 152, 29], [150, 66, 152, 299]]);
        assert!(planned(&only, from, goal).way_from(from).is_some());
        let closed = map(&[[150, 0, 152, 29], [150, 62, 152, 299]]);
        assert!(planned(&closed, from, goal).way_from(from).is_none());
        let other = map(&[[150, 0, 152, 29], [150, 66, 152, 219], [150, 281, 152, 299]]);
        let aim = planned(&other, from, goal).way_from(from).expect("a way");
        assert!(aim.y_mm > 600.0, "{aim:?}");
    }

    #[test]
    fn places_off_the_map_have_no_way() {
        let map = map(&[]);
        let from = Point::new(-10.0, 500.0);
        let planner = planned(&map, from, Point::new(3001.0, 500.0));
        assert_eq!(planner.way_from(from), None);
        assert_eq!(planner.way_from(Point::new(500.0, 500.0)), None);
    }

    /// A robot that stands nearer to a wall than it should still finds a path.
    #[test]
    fn a_start_beside_a_wall_is_open() {
        let map = map(&[[0, 100, 299, 101]]);
        let (from, goal) = (Point::new(500.0, 1190.0), Point::new(2500.0, 1500.0));
        assert!(planned(&map, from, goal).way_from(from).is_some());
    }

    /// Cells of 30 mm: 120 mm are four of them, and the refused cell is two more beyond, along the
    /// path.
    #[test]
    fn a_way_that_is_none_is_refused_a_little_ahead() {
        let map = map(&[]);
        let (from, goal) = (Point::new(500.0, 515.0), Point::new(2_500.0, 515.0));
        let mut planner = planned(&map, from, goal);
        let aim = planner.way_from(from).expect("a way");
        assert_eq!(aim.y_mm, 525.0);
        planner.refuse_way_from(from);
        assert_eq!(
            (planner.refusals, planner.refused[0]),
            (1, Cell { x: 22, y: 17 })
        );
        assert_eq!(planner.way_from(from), None);
        planner.refuse_way_from(from);
        assert_eq!(planner.refusals, 1);
        planner.forget();
        assert_eq!((planner.refusals, planner.kept), (0, None));
    }

    /// Neighbouring nibbles do not change each other.
    #[test]
    fn two_cells_share_a_byte() {
        let mut planner = Planner::new();
        let cell = |x| Cell { x, y: 3 };
        for (x, value) in [(4, 9), (5, 6), (7, 1), (6, 8), (4, 2)] {
            planner.set(cell(x), value);
        }
        let found = [3, 4, 5, 6, 7, 8].map(|x| planner.get(cell(x)));
        assert_eq!(found, [0, 2, 6, 8, 1, 0]);
        assert_eq!(planner.get(Cell { x: 4, y: 2 }), 0);
    }

    /// A post at (20, 12): a line through it is blocked, one beside it is free.
    #[test]
    fn what_is_near_something_is_not_seen_through() {
        let mut planner = Planner::new();
        planner.near.set(Cell { x: 20, y: 12 });
        let sees = |from: (u16, u16), to: (u16, u16)| {
            let [from, to] = [from, to].map(|(x, y)| Cell { x, y });
            let both = [planner.sees(from, to), planner.sees(to, from)];
            assert_eq!(both[0], both[1]);
            both[0]
        };
        assert!(!sees((10, 12), (30, 12)) && !sees((20, 2), (20, 40)) && !sees((10, 2), (30, 22)));
        assert!(!sees((10, 7), (30, 17)) && !sees((20, 12), (20, 12)) && !sees((25, 2), (15, 22)));
        assert!(sees((10, 11), (30, 11)) && sees((21, 2), (21, 40)) && sees((10, 3), (30, 23)));
        assert!(sees((10, 12), (19, 12)) && sees((10, 8), (30, 18)));
    }

    /// A straight path of 2 m crosses 4 marked columns of 30 mm, and 10 more farther on: the result
    /// is the middle of the first stretch.
    #[test]
    fn the_first_stretch_of_a_way_is_told() {
        let (pose, goal) = (Pose::new(500.0, 1500.0, 0.0), Point::new(2500.0, 1500.0));
        let (mut planner, map) = (Planner::new(), map(&[]));
        planner.plan(&map, (&BODY, THIN_MM), pose, goal, &Surroundings::EMPTY);
        let over = |columns: &[core::ops::Range<u16>]| {
            let mut cells = Cells::NONE;
            for x in columns.iter().cloned().flatten() {
                (0..100).for_each(|y| cells.set(Cell { x, y }));
            }
            let middle = planner
                .stretch_on_way(pose.position(), &cells)
                .expect("a way");
            middle.map(|cell| cell.x)
        };
        assert_eq!(over(&[30..34, 60..70]), Some(31));
        assert_eq!(over(&[60..62, 62..70]), Some(64));
        assert_eq!(over(&[95..97, 97..99]), None);
        let mut new = Planner::new();
        new.forget();
        assert_eq!(new.stretch_on_way(pose.position(), &Cells::NONE), None);
    }
}
