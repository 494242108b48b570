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

#[cfg(test)]
mod tests {
    use super::*;

    /// 6 m by 4 m whose corner is -1, 2: the middle is 2, 4, the others a quarter of the width to
    /// its sides; four headings from each. After the twelfth they begin anew.
    #[test]
    fn lookouts_lie_in_the_middle_and_to_its_sides() {
        let plan = FloorPlan {
            width: 12,
            cell_m: 0.5,
            origin_m: [-1.0, 2.0],
            obstacles: alloc::vec![false; 12 * 8],
        };
        let quarter = core::f64::consts::FRAC_PI_2;
        let cases = [
            (0, 2.0, 0.0),
            (1, 2.0, quarter),
            (3, 2.0, -quarter),
            (4, 0.5, 0.0),
            (9, 3.5, quarter),
            (10, 3.5, 2.0 * quarter),
            (12, 2.0, 0.0),
        ];
        for (number, x_m, heading) in cases {
            let found = lookout(&plan, number);
            assert_eq!((found.x_m, found.y_m), (x_m, 4.0), "{number}");
            assert!((found.heading_rad - heading).abs() < 1e-9, "{number}");
        }
        let none = lookout(&FloorPlan { width: 0, ..plan }, 0);
        assert_eq!((none.x_m, none.y_m), (-1.0, 26.0));
    }

    /// 1.5 m in steps of 5 cm: 31 poses from end to end.
    #[test]
    fn the_way_through_a_gate_is_straight_and_fine() {
        let before = CarPose {
            x_m: 1.0,
            y_m: 2.0,
            heading_rad: 0.0,
        };
        let passage = Passage {
            gate: [1, 2],
            before,
            middle: before.shifted(0.9),
            behind: before.shifted(1.5),
        };
        let path = through(passage);
        assert_eq!(path.len(), 31);
        for (step, pose) in (0_u32..).zip(&path) {
            assert!(
                (pose.x_m - 1.0 - 0.05 * f64::from(step)).abs() < 1e-9,
                "{pose:?}"
            );
            assert_eq!((pose.y_m, pose.heading_rad), (2.0, 0.0));
        }
        // Places that coincide: there and there.
        let on_the_spot = Passage {
            behind: before,
            ..passage
        };
        assert_eq!(through(on_the_spot), [before, before]);
    }
}
