//! Everybody who watches a run: the same for a run and for a replay.

use emulators::world::Contact;

use super::check::{self, Check, Checker, Look};
use crate::rig::Rig;
use crate::robots;
use crate::scenario::{Robot, Scenario};

/// The checkers of a run, chosen by what its robot and its rig have.
pub struct Watchers {
    robot: Robot,
    checkers: Vec<Box<dyn Checker>>,
}

impl Watchers {
    /// Those who suit `scenario`, wired as `rig`.
    pub fn of(scenario: &Scenario, rig: &mut Rig) -> Self {
        let robot = scenario.robot;
        let watch = robots::watch(robot);
        let mut checkers = check::standard(watch.command_link, watch.silence_max);
        if let Some(dialect) = robots::dialect(robot, rig) {
            let link = watch.command_link;
            let checker = check::SetPointsAsAccepted::listening(rig, link, dialect);
            checkers.extend(checker.map(|checker| Box::new(checker) as Box<dyn Checker>));
        }
        if let Some(phases) = scenario.phases {
            checkers.push(Box::new(check::AtWorkAgain::new(phases.windows())));
        }
        Self { robot, checkers }
    }

    /// One more.
    pub fn add(&mut self, checker: Box<dyn Checker>) {
        self.checkers.push(checker);
    }

    /// Lets all look at the rig; what the robot touched since the last look is `contacts`.
    pub fn look(&mut self, rig: &Rig, contacts: &[Contact]) {
        let look = Look {
            rig,
            actuators: robots::actuators(self.robot, rig),
            contacts,
        };
        let checkers = self.checkers.iter_mut();
        checkers.for_each(|checker| checker.observe(&look));
    }

    /// What each has to say.
    pub fn verdicts(&self) -> Vec<Check> {
        let checkers = self.checkers.iter();
        checkers.map(|checker| checker.verdict()).collect()
    }
}
