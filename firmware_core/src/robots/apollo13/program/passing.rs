//! Drives through gates, one after the other.

use super::Apollo13;
use crate::ackermann::CarPose;
use crate::robots::apollo13::gates::Passage;
use crate::robots::apollo13::pilot::GoalState;

/// How near the car must be to its place before a gate, metres and radians: half a heading of the
/// lattice, and what following adds.
const BEFORE_GATE: [f64; 2] = [0.15, 0.30];
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
        if !is_done {
            return;
        }
        let at = self.pilot.goal();
        match self.passage {
            Some(passage) if at == Some(passage.before) => self.pilot.follow(through(passage)),
            _ => {
                let costs = self.floor.costs(self.now);
                let is_free = |pose| costs.is_none_or(|costs| self.pilot.is_free(costs, pose));
                self.passage = self.gates.next(pose, is_free);
                let before = self.passage.map(|passage| passage.before);
                self.pilot.set_exact_goal(before, BEFORE_GATE);
            }
        }
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
