//! What is to be done to a rig at certain times of a run: disturbances that begin and end.

use protocols::Instant;

use crate::rig::fault::{Activity, FaultId};
use crate::rig::{Disturbance, Rig};

/// Disturbances with their times.
#[derive(Clone, Debug, Default)]
pub(crate) struct Agenda(Vec<Item>);

#[derive(Clone, Debug)]
struct Item {
    id: FaultId,
    activity: Activity,
    disturbances: Vec<Disturbance>,
    /// The spell that is going on, or comes next.
    spell: u128,
    is_on: bool,
}

impl Item {
    /// When something is next to be done.
    fn due(&self) -> Option<Instant> {
        let spell = self.activity.spell(self.spell)?;
        Some(if self.is_on { spell.until } else { spell.from })
    }
}

impl Agenda {
    /// Adds what is to be done when a fault begins and ends.
    pub(crate) fn add(&mut self, id: FaultId, activity: Activity, what: Vec<Disturbance>) {
        if !what.is_empty() {
            self.0.push(Item {
                id,
                activity,
                disturbances: what,
                spell: 0,
                is_on: false,
            });
        }
    }

    /// When something is next to be done, if ever.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.0.iter().filter_map(Item::due).min()
    }

    /// Does what is due at the rig's time.
    pub(crate) fn perform(&mut self, rig: &mut Rig) {
        let now = rig.now();
        for item in &mut self.0 {
            while item.due().is_some_and(|at| at <= now) {
                item.is_on = !item.is_on;
                item.spell += u128::from(!item.is_on);
                for what in &item.disturbances {
                    rig.disturb(what, item.is_on);
                }
            }
        }
        self.0.retain(|item| item.due().is_some());
    }

    /// Leaves out a fault that has not begun.
    pub(super) fn leave_out(&mut self, id: FaultId) {
        self.0.retain(|item| item.id != id);
    }

    /// Gives the faults other numbers.
    pub(super) fn renumber(&mut self, to: impl Fn(FaultId) -> FaultId) {
        self.0.iter_mut().for_each(|item| item.id = to(item.id));
    }

    /// Ends a fault at `at`.
    pub(super) fn end(&mut self, id: FaultId, at: Instant) {
        for item in self.0.iter_mut().filter(|item| item.id == id) {
            item.activity.end(at);
        }
        self.0.retain(|item| item.is_on || item.due().is_some());
    }
}
