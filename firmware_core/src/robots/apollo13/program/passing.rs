//! Drives through gates, one after the other.

use core::time::Duration;

use protocols::Instant;

use super::Apollo13;
use super::search::Search;
use crate::ackermann::{CarPose, wrapped};
use crate::robots::apollo13::floor::FloorPlan;
use crate::robots::apollo13::gates::Passage;
use crate::robots::apollo13::pilot::GoalState;

/// How near the car must be to its place before a gate, metres and radians: half a heading of the
/// lattice, and what following adds.
const BEFORE_GATE: [f64; 2] = [0.15, 0.30];
/// Without a gate to drive through for so long, the car looks for one elsewhere.
const SEARCHES_AFTER: Duration = Duration::from_secs(2);
/// How often it looks whether one has come into sight.
const LOOKS_EVERY: Duration = Duration::from_secs(1);
/// Places to look from, as parts of the map's width and height, and whichever way from each.
const LOOKOUTS: [[f64; 2]; 3] = [[0.5, 0.5], [0.25, 0.5], [0.75, 0.5]];
const HEADINGS: u32 = 4;
/// So many places without a gate are enough.
const LOOKOUTS_MAX: u32 = 3 * HEADINGS;

impl Apollo13 {
    /// Goes on to the next part of a passage, or to the next gate.
    pub(super) fn choose_gate(&mut self, pose: CarPose) {
        let is_done = match self.pilot.state() {
            GoalState::None | GoalState::Reached => true,
            GoalState::GivenUp => {
                self.passage = None;
                true
            }
            _ => false,
        };
        // A gate is worth more than a place to look from.
        let is_search = self.passage.is_none() && self.search.places > 0;
        let is_old = |looked: Instant| self.now - looked >= LOOKS_EVERY;
        let is_due = is_search && self.search.looked.is_none_or(is_old);
        if !is_done && !is_due {
            return;
        }
        let at = self.pilot.goal();
        match self.passage {
            Some(passage) if at == Some(passage.before) => self.pilot.follow(through(passage)),
            _ => {
                let costs = self.floor.costs(self.now);
                let is_free = |pose| costs.is_none_or(|costs| self.pilot.is_free(costs, pose));
                self.passage = self.gates.next(pose, is_free);
                match self.passage {
                    Some(passage) => {
                        self.search = Search {
                            is_asked: self.search.is_asked,
                            ..Search::default()
                        };
                        let before = Some(passage.before);
                        self.pilot.set_exact_goal(before, BEFORE_GATE);
                    }
                    None => self.look_elsewhere(is_done),
                }
            }
        }
    }

    /// There is no gate in sight; `is_there`: nor on the way to another place.
    fn look_elsewhere(&mut self, is_there: bool) {
        let now = self.now;
        self.search.looked = Some(now);
        let since = *self.search.since.get_or_insert(now);
        if !is_there {
            return;
        }
        self.pilot.set_goal(None);
        if !self.search.is_asked || now - since < SEARCHES_AFTER {
            return;
        }
        while self.search.places < LOOKOUTS_MAX {
            let place = lookout(self.floor.plan(), self.search.places);
            self.search.places += 1;
            let costs = self.floor.costs(now);
            if costs.is_some_and(|costs| self.pilot.is_free(costs, place)) {
                return self.pilot.set_goal(Some(place));
            }
        }
    }
}

/// The place to look from of this number.
fn lookout(plan: &FloorPlan, number: u32) -> CarPose {
    let index = usize::try_from(number / HEADINGS).unwrap_or_default();
    let [across, along] = LOOKOUTS[index % LOOKOUTS.len()];
    let height = plan.obstacles.len() / plan.width.max(1);
    let [x0, y0] = plan.origin_m;
    CarPose {
        x_m: x0 + across * plan.width as f64 * plan.cell_m,
        y_m: y0 + along * height as f64 * plan.cell_m,
        heading_rad: wrapped(f64::from(number % HEADINGS) * core::f64::consts::FRAC_PI_2),
    }
}

/// The straight way through a gate, a pose each 5 cm.
fn through(passage: Passage) -> alloc::vec::Vec<CarPose> {
    let length = passage.before.distance_m(passage.behind);
    let steps = libm::ceil(length / 0.05).clamp(1.0, 1_000.0);
    let mut path = alloc::vec::Vec::new();
    let mut step = 0.0;
    while step <= steps {
        path.push(passage.before.shifted(length * step / steps));
        step += 1.0;
    }
    path
}
