//! The search for a plan: anytime repairing A* (ARA*, Likhachev, Gordon and Thrun 2003).
//!
//! The first pass multiplies the estimate of the remaining path by a factor and is quick; further
//! passes improve its result with smaller factors. The cost of a pass is at most its factor times
//! the least cost. Each pass keeps the costs of the one before: OPEN continues, and states that
//! became cheaper after they were closed (INCONS) join it.

use core::cmp::Reverse;

use alloc::collections::BinaryHeap;
use alloc::vec::Vec;

use super::sweep::Lattice;
use crate::ackermann::CarPose;
use crate::costmap::{Costmap, INSCRIBED};

/// Nominal cost of a metre: milliseconds at 0.4 m/s.
const COST_PER_M: f64 = 2_500.0;
const UNKNOWN: u32 = u32::MAX;

/// Limits of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Factor of the first pass, at least 1.
    pub first_bound: f64,
    /// Decrease of the factor from pass to pass.
    pub bound_step: f64,
    /// Maximum number of expanded poses in all passes together; the best plan by then counts.
    pub expansions_max: usize,
    /// Maximum number of expanded poses while a plan is improved.
    pub improving_max: usize,
}

impl Limits {
    /// Limits for a robot that waits for its plan: a good plan at once, instead of the best one
    /// later. The fielded planner had five seconds.
    pub const PROMPT: Self = Self {
        first_bound: 5.0,
        bound_step: 0.2,
        expansions_max: 2_000_000,
        improving_max: 30_000,
    };
}

impl Default for Limits {
    /// The limits of the car of seed 003: from 5 by 0.2 down to 1.
    fn default() -> Self {
        Self {
            first_bound: 5.0,
            bound_step: 0.2,
            expansions_max: 2_000_000,
            improving_max: 2_000_000,
        }
    }
}

/// The goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// The pose, rounded to the nearest cell and heading.
    pub pose: CarPose,
    /// Whether the heading there matters.
    pub with_heading: bool,
}

/// A path that the robot can drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Poses of the reference point, from the start's cell to the goal's.
    pub poses: Vec<CarPose>,
    /// Primitives in their order, as indices in the set.
    pub primitives: Vec<usize>,
    /// Cost of the path.
    pub cost: u32,
    /// Maximum ratio of the cost to the least one.
    pub bound: f64,
    /// Factor and cost of each pass.
    pub passes: Vec<(f64, u32)>,
    /// Number of expanded poses.
    pub expansions: usize,
}

/// Reason why there is no plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum NoPlan {
    /// The map's cell size differs from that of the primitives.
    Resolution,
    /// The start is off the map, or in an obstacle.
    Start,
    /// The goal is off the map, or in an obstacle.
    Goal,
    /// There is no path.
    NoWay,
    /// No path was found within the limits.
    Limit,
}

impl core::fmt::Display for NoPlan {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Resolution => "the map's cell size differs from that of the primitives",
            Self::Start => "the start is off the map or too near an obstacle",
            Self::Goal => "the goal is off the map or too near an obstacle",
            Self::NoWay => "there is no path",
            Self::Limit => "no path was found within the limits",
        })
    }
}

impl core::error::Error for NoPlan {}

impl Lattice {
    /// Plans from `start` to `goal`.
    ///
    /// # Errors
    /// If there is none.
    pub fn plan(
        &self,
        map: &Costmap,
        start: CarPose,
        goal: Goal,
        limits: Limits,
    ) -> Result<Plan, NoPlan> {
        let resolution_m = self.set().resolution_m();
        if (map.cell_m() - resolution_m).abs() > 1e-6 * resolution_m {
            return Err(NoPlan::Resolution);
        }
        let place = |pose: CarPose| {
            let cell = map.cell([pose.x_m, pose.y_m])?;
            pose.heading_rad
                .is_finite()
                .then(|| (cell, self.set().angle(pose.heading_rad)))
        };
        let (start, start_angle) = place(start).ok_or(NoPlan::Start)?;
        let (goal_cell, goal_angle) = place(goal.pose).ok_or(NoPlan::Goal)?;
        let angles = self.set().angles();
        let mut goals = match goal.with_heading {
            true => goal_angle..goal_angle + 1,
            false => 0..angles,
        };
        if !self.is_free(map, start, start_angle) {
            return Err(NoPlan::Start);
        }
        if !goals.any(|angle| self.is_free(map, goal_cell, angle)) {
            return Err(NoPlan::Goal);
        }
        let mut search = Search::new(self, map, goal_cell);
        let begin = search.state(start, start_angle).ok_or(NoPlan::Start)?;
        if search.left(begin) == UNKNOWN {
            return Err(NoPlan::NoWay);
        }
        let target = goal.with_heading.then_some(goal_angle);
        search.run(begin, (goal_cell, target), limits)
    }
}

struct Search<'a> {
    lattice: &'a Lattice,
    map: &'a Costmap,
    /// Cells of the map along x and y.
    size: [u32; 2],
    angles: u32,
    /// Minimum cost of the path from each cell to the goal's.
    left: Vec<u32>,
    cost: Vec<u32>,
    /// State and action from which each state was reached.
    from: Vec<(u32, u8)>,
    /// The pass in which each state was closed.
    closed: Vec<u16>,
    open: BinaryHeap<Reverse<(u64, u32)>>,
    inconsistent: Vec<u32>,
    expansions: usize,
}

impl<'a> Search<'a> {
    fn new(lattice: &'a Lattice, map: &'a Costmap, goal: [i32; 2]) -> Self {
        let angles = lattice.set().angles();
        let states = map.costs().len() * angles as usize;
        Self {
            lattice,
            map,
            size: [map.width(), map.height()].map(|cells| u32::try_from(cells).unwrap_or(0)),
            angles,
            left: ways_to(map, goal, lattice.detour()),
            cost: alloc::vec![UNKNOWN; states],
            from: alloc::vec![(UNKNOWN, 0); states],
            closed: alloc::vec![0; states],
            open: BinaryHeap::new(),
            inconsistent: Vec::new(),
            expansions: 0,
        }
    }

    fn state(&self, [x, y]: [i32; 2], angle: u32) -> Option<u32> {
        // A negative coordinate becomes larger than any map.
        let (x, y) = (x.cast_unsigned(), y.cast_unsigned());
        let [width, height] = self.size;
        (x < width && y < height).then(|| (y * width + x) * self.angles + angle)
    }

    fn cell(&self, state: u32) -> [i32; 2] {
        let (cell, [width, _]) = (state / self.angles, self.size);
        [cell % width, cell / width].map(u32::cast_signed)
    }

    fn left(&self, state: u32) -> u32 {
        self.left[(state / self.angles) as usize]
    }

    /// Sort key of a pass: the cost so far, and the estimated rest multiplied by the factor, in
    /// 1000ths.
    fn key(&self, state: u32, factor: u64) -> u64 {
        u64::from(self.cost[state as usize]) * 1_000 + u64::from(self.left(state)) * factor
    }

    fn run(
        &mut self,
        begin: u32,
        (goal, angle): ([i32; 2], Option<u32>),
        limits: Limits,
    ) -> Result<Plan, NoPlan> {
        self.cost[begin as usize] = 0;
        self.inconsistent.push(begin);
        let mut bound = match limits.first_bound.is_finite() {
            true => limits.first_bound.clamp(1.0, 1_000.0),
            false => 1_000.0,
        };
        let step = limits.bound_step.max(0.01);
        let mut passes = Vec::new();
        let mut found: Option<(u32, u32, f64, Vec<usize>)> = None;
        for pass in 1..=u16::MAX {
            let most = match found.is_some() {
                true => limits.improving_max.min(limits.expansions_max),
                false => limits.expansions_max,
            };
            let is_whole = self.pass(pass, bound, (goal, angle), most);
            let end = self.goal(goal, angle);
            let cost = end.map(|end| self.cost[end as usize]);
            if let (true, Some(end), Some(cost)) = (is_whole, end, cost) {
                passes.push((bound, cost));
                found = Some((end, cost, bound, self.way(begin, end)));
            }
            if !is_whole && found.is_none() {
                // A path without a known bound is better than none.
                let (end, cost) = end.zip(cost).ok_or(NoPlan::Limit)?;
                found = Some((end, cost, f64::INFINITY, self.way(begin, end)));
            }
            if !is_whole || bound <= 1.0 || end.is_none() {
                break;
            }
            bound = (bound - step).max(1.0);
        }
        let (_, cost, bound, primitives) = found.ok_or(NoPlan::NoWay)?;
        Ok(Plan {
            poses: self.poses(begin, &primitives),
            primitives,
            cost,
            bound,
            passes,
            expansions: self.expansions,
        })
    }

    /// The cheapest reached state of the goal.
    fn goal(&self, goal: [i32; 2], angle: Option<u32>) -> Option<u32> {
        let angles = angle.map_or(0..self.angles, |angle| angle..angle + 1);
        let states = angles.filter_map(|angle| self.state(goal, angle));
        let reached = states.filter(|state| self.cost[*state as usize] != UNKNOWN);
        reached.min_by_key(|state| self.cost[*state as usize])
    }

    /// Runs one pass; returns whether it ended within the limits.
    fn pass(
        &mut self,
        pass: u16,
        bound: f64,
        (goal, angle): ([i32; 2], Option<u32>),
        expansions_max: usize,
    ) -> bool {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "1 to 1000 times 1000"
        )]
        let factor = libm::round(bound * 1_000.0) as u64;
        let waiting = self.open.drain().map(|Reverse((_, state))| state);
        let mut waiting: Vec<u32> = waiting.chain(self.inconsistent.drain(..)).collect();
        waiting.sort_unstable();
        waiting.dedup();
        let keys = waiting
            .iter()
            .map(|state| Reverse((self.key(*state, factor), *state)));
        self.open = keys.collect();
        let least = |search: &Self| {
            let end = search.goal(goal, angle)?;
            Some(search.cost[end as usize])
        };
        let mut best = least(self);
        loop {
            let Some(&Reverse((key, state))) = self.open.peek() else {
                return true;
            };
            if best.is_some_and(|best| u64::from(best) * 1_000 <= key) {
                return true;
            }
            if self.expansions >= expansions_max {
                return false;
            }
            self.open.pop();
            // The state has become cheaper since, and the queue holds it with its new key.
            if self.closed[state as usize] == pass || key > self.key(state, factor) {
                continue;
            }
            self.closed[state as usize] = pass;
            self.expansions += 1;
            if self.expand(state, pass, factor, goal) {
                best = least(self);
            }
        }
    }

    /// Expands a state; returns whether a state in the cell `goal` has become cheaper.
    fn expand(&mut self, state: u32, pass: u16, factor: u64, goal: [i32; 2]) -> bool {
        let (cell, lattice) = (self.cell(state), self.lattice);
        let mut is_goal_cheaper = false;
        for (number, action) in (0..).zip(lattice.actions(state % self.angles)) {
            let end = [cell[0] + action.end[0], cell[1] + action.end[1]];
            let Some(next) = self.state(end, action.end_angle) else {
                continue;
            };
            let known = self.cost[next as usize];
            let so_far = self.cost[state as usize];
            if known <= so_far.saturating_add(action.base_cost) || self.left(next) == UNKNOWN {
                continue;
            }
            let Some(step) = action.cost(self.map, cell) else {
                continue;
            };
            let cost = so_far.saturating_add(step);
            if cost >= known {
                continue;
            }
            self.cost[next as usize] = cost;
            self.from[next as usize] = (state, number);
            is_goal_cheaper |= end == goal;
            match self.closed[next as usize] == pass {
                true => self.inconsistent.push(next),
                false => self.open.push(Reverse((self.key(next, factor), next))),
            }
        }
        is_goal_cheaper
    }

    /// The primitives that lead to `end`.
    fn way(&self, begin: u32, end: u32) -> Vec<usize> {
        let (mut at, mut way) = (end, Vec::new());
        while at != begin {
            let (from, number) = self.from[at as usize];
            let actions = self.lattice.actions(from % self.angles);
            way.push(actions[usize::from(number)].primitive);
            at = from;
        }
        way.reverse();
        way
    }

    fn poses(&self, begin: u32, primitives: &[usize]) -> Vec<CarPose> {
        let set = self.lattice.set();
        let mut cell = self.cell(begin);
        let [x_m, y_m] = self.map.middle_m(cell);
        let mut poses = alloc::vec![CarPose {
            x_m,
            y_m,
            heading_rad: crate::ackermann::wrapped(set.heading_rad(begin % self.angles)),
        }];
        for primitive in primitives.iter().map(|index| &set.all()[*index]) {
            let [x_m, y_m] = self.map.middle_m(cell);
            let further = primitive.poses.iter().skip(1);
            poses.extend(further.map(|[x, y, heading]| CarPose {
                x_m: x_m + x,
                y_m: y_m + y,
                heading_rad: crate::ackermann::wrapped(*heading),
            }));
            cell = [cell[0] + primitive.end.0[0], cell[1] + primitive.end.0[1]];
        }
        poses
    }
}

/// Lower bound of the cost of a path of the reference point alone from each cell to `goal`; the
/// cost in the lattice is never less.
fn ways_to(map: &Costmap, goal: [i32; 2], detour: f64) -> Vec<u32> {
    let mut left = alloc::vec![UNKNOWN; map.costs().len()];
    let width = map.width();
    let index = |[x, y]: [i32; 2]| {
        let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        (x < width && y < map.height()).then_some(y * width + x)
    };
    let step = map.cell_m() * COST_PER_M / detour;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "rounded down, as an estimate must be"
    )]
    let steps = [step as u32, (step * core::f64::consts::SQRT_2) as u32];
    let mut open = BinaryHeap::new();
    if let Some(at) = index(goal) {
        left[at] = 0;
        open.push(Reverse((0, goal)));
    }
    while let Some(Reverse((cost, cell))) = open.pop() {
        if index(cell).is_none_or(|at| left[at] < cost) {
            continue;
        }
        let here = map.cost(cell);
        for dy in -1..=1 {
            for dx in -1..=1 {
                let next = [cell[0] + dx, cell[1] + dy];
                let Some(at) = index(next) else { continue };
                let there = map.costs()[at];
                if there >= INSCRIBED {
                    continue;
                }
                let length = steps[usize::from(dx != 0 && dy != 0)];
                let cost = cost.saturating_add(length * (1 + u32::from(here.min(there))));
                if cost < left[at] {
                    left[at] = cost;
                    open.push(Reverse((cost, next)));
                }
            }
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::costmap::Inflation;
    use crate::random::Pcg32;

    /// By hand: 5 cm straight ahead take 125 ms at the nominal speed, a diagonal step 176.8 ms,
    /// both rounded down. With a detour factor of 1.25 the estimates are 100 and 141.4 ms.
    #[test]
    fn on_a_free_floor_an_estimate_is_straight_and_diagonal_steps() {
        let inflation = Inflation {
            inscribed_m: 0.0,
            radius_m: 0.0,
        };
        let map = Costmap::new(7, 0.05, [0.0; 2], alloc::vec![false; 7 * 5], inflation);
        for (detour, straight, diagonal) in [(1.0, 125, 176), (1.25, 100, 141)] {
            let left = ways_to(&map, [2, 1], detour);
            for (at, found) in (0..).zip(left) {
                let (dx, dy) = (i32::abs(at % 7 - 2), i32::abs(at / 7 - 1));
                let across = dx.min(dy);
                let expected = across * diagonal + (dx.max(dy) - across) * straight;
                assert_eq!(i32::try_from(found), Ok(expected), "{at}");
            }
        }
        assert!(
            ways_to(&map, [7, 1], 1.0)
                .iter()
                .all(|left| *left == UNKNOWN)
        );
    }

    /// Random obstacles: the estimate equals the result of relaxing all steps until nothing
    /// changes. A step costs its length by the cheaper of its two cells; no step leads into a cell
    /// where the robot's middle cannot be.
    #[test]
    fn an_estimate_is_the_least_way_over_cheap_cells() {
        let (width, height) = (12, 9);
        let inflation = Inflation {
            inscribed_m: 0.04,
            radius_m: 0.16,
        };
        let mut random = Pcg32::new(3);
        for _ in 0..20 {
            let obstacles = (0..width * height).map(|_| random.below(8) == 0).collect();
            let map = Costmap::new(width, 0.05, [0.0; 2], obstacles, inflation);
            let goal = random.below(12 * 9) as usize;
            let mut expected = alloc::vec![UNKNOWN; width * height];
            expected[goal] = 0;
            for _ in 0..width * height {
                for from in (0..width * height).filter(|at| map.costs()[*at] < INSCRIBED) {
                    for to in 0..width * height {
                        let dx = (from % width).abs_diff(to % width);
                        let dy = (from / width).abs_diff(to / width);
                        let length = match (dx, dy) {
                            (1, 1) => 176,
                            (0, 1) | (1, 0) => 125,
                            _ => continue,
                        };
                        let cheaper = map.costs()[from].min(map.costs()[to]);
                        let way = expected[to].saturating_add(length * (1 + u32::from(cheaper)));
                        expected[from] = expected[from].min(way);
                    }
                }
            }
            let cell = [goal % width, goal / width].map(|at| i32::try_from(at).unwrap());
            assert_eq!(ways_to(&map, cell, 1.0), expected, "to {cell:?}");
        }
    }
}
