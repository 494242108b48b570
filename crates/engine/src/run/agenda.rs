//! Scheduled actions on a rig: begins and ends of disturbances.

use protocols::Instant;

use crate::rig::fault::{Activity, FaultId, Window};
use crate::rig::{Disturbance, Rig};

/// Disturbances with their times.
#[derive(Clone, Debug, Default)]
pub struct Agenda(Vec<Item>);

#[derive(Clone, Debug)]
struct Item {
    id: FaultId,
    activity: Activity,
    disturbances: Vec<Disturbance>,
    /// Number of the current active period, or of the next one.
    spell: u128,
    is_on: bool,
}

impl Item {
    /// Time of the next action.
    fn due(&self) -> Option<Instant> {
        let spell = self.activity.spell(self.spell)?;
        Some(if self.is_on { spell.until } else { spell.from })
    }
}

impl Agenda {
    /// Schedules the actions at the start and end of a fault.
    pub fn add(&mut self, id: FaultId, activity: Activity, what: Vec<Disturbance>) {
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

    /// Time of the next action, if any.
    pub fn due(&self) -> Option<Instant> {
        self.0.iter().filter_map(Item::due).min()
    }

    /// Performs the actions due at the rig's time.
    pub fn perform(&mut self, rig: &mut Rig) {
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

    /// Removes a fault that has not begun.
    pub(super) fn leave_out(&mut self, id: FaultId) {
        self.0.retain(|item| item.id != id);
    }

    /// Renumbers the faults.
    pub(super) fn renumber(&mut self, to: impl Fn(FaultId) -> FaultId) {
        self.0.iter_mut().for_each(|item| item.id = to(item.id));
    }

    /// Gives a fault another window.
    pub(super) fn move_to(&mut self, id: FaultId, window: Window) {
        for item in self.0.iter_mut().filter(|item| item.id == id) {
            item.activity.window = window;
        }
        self.0.retain(|item| item.is_on || item.due().is_some());
    }

    /// Ends a fault at `at`.
    pub(super) fn end(&mut self, id: FaultId, at: Instant) {
        for item in self.0.iter_mut().filter(|item| item.id == id) {
            item.activity.end(at);
        }
        self.0.retain(|item| item.is_on || item.due().is_some());
    }
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use super::*;
    use crate::rig::bare::rig;
    use crate::rig::fault::{Spells, Window};
    use crate::rig::line::Direction;

    /// Disturbances of links that do not exist: they have no effect.
    fn nothing() -> Vec<Disturbance> {
        vec![Disturbance::Cross {
            links: ["one".to_owned(), "other".to_owned()],
            direction: Direction::ToMaster,
        }]
    }

    /// From 10 to 20 s, every 3 s for 1 s, twice.
    fn twice() -> Activity {
        let window = Window {
            from: Instant::from_secs(10),
            until: Instant::from_secs(20),
        };
        let spells = Spells {
            every: Duration::from_secs(3),
            lasting: Duration::from_secs(1),
            count: Some(2),
            dice: None,
        };
        Activity {
            spells: Some(spells),
            ..Activity::from(window)
        }
    }

    fn due_after(agenda: &mut Agenda, rig: &mut Rig, secs: u64) -> Option<u64> {
        rig.run_until(Instant::from_secs(secs));
        agenda.perform(rig);
        agenda.due().map(|at| at.as_millis() / 1000)
    }

    #[test]
    fn each_spell_begins_and_ends_and_then_nothing_is_due() {
        let (mut agenda, mut rig) = (Agenda::default(), rig());
        agenda.add(FaultId(0), twice(), nothing());
        agenda.add(FaultId(1), twice(), Vec::new());
        assert_eq!(agenda.0.len(), 1, "a fault without effect is left out");
        let due = [0, 9, 10, 11, 12, 13].map(|secs| due_after(&mut agenda, &mut rig, secs));
        assert_eq!(due, [10, 10, 11, 13, 13, 14].map(Some));
        assert_eq!(due_after(&mut agenda, &mut rig, 14), None);
        assert!(agenda.0.is_empty());
    }

    /// If time advances without a call, each start and end is performed afterwards.
    #[test]
    fn what_was_due_meanwhile_is_made_up_for() {
        let (mut agenda, mut rig) = (Agenda::default(), rig());
        agenda.add(FaultId(0), twice(), nothing());
        assert_eq!(due_after(&mut agenda, &mut rig, 13), Some(14));
        assert_eq!((agenda.0[0].spell, agenda.0[0].is_on), (1, true));
    }

    /// The fault is ended at 10.5 s: the active period ends then, and later ones never begin.
    #[test]
    fn what_is_ended_early_ends_then_and_never_comes_again() {
        let (mut agenda, mut rig) = (Agenda::default(), rig());
        for id in [0, 1] {
            agenda.add(FaultId(id), twice(), nothing());
        }
        agenda.end(FaultId(1), Instant::from_secs(5));
        assert_eq!(agenda.0.len(), 1);
        due_after(&mut agenda, &mut rig, 10);
        agenda.end(FaultId(1), Instant::from_secs(2));
        assert_eq!(agenda.due(), Some(Instant::from_secs(11)));
        agenda.end(FaultId(0), Instant::from_millis(10_500));
        assert_eq!(agenda.due(), Some(Instant::from_millis(10_500)));
        assert_eq!(due_after(&mut agenda, &mut rig, 11), None);
    }

    /// The fault is moved to 12 s: its periods begin at 12 and 15 s. A fault without a remaining
    /// period is removed.
    #[test]
    fn what_is_moved_is_due_in_its_other_window() {
        let (mut agenda, mut rig) = (Agenda::default(), rig());
        for id in [0, 1] {
            agenda.add(FaultId(id), twice(), nothing());
        }
        let from_12 = |until| Window {
            from: Instant::from_secs(12),
            until: Instant::from_secs(until),
        };
        agenda.move_to(FaultId(0), from_12(12));
        assert_eq!((agenda.0.len(), agenda.0[0].id), (1, FaultId(1)));
        agenda.move_to(FaultId(1), from_12(20));
        let due = [0, 12, 13, 15].map(|secs| due_after(&mut agenda, &mut rig, secs));
        assert_eq!(due, [12, 13, 15, 16].map(Some));
    }

    #[test]
    fn faults_are_left_out_and_numbered_anew() {
        let mut agenda = Agenda::default();
        for id in [0, 1, 2] {
            agenda.add(FaultId(id), twice(), nothing());
        }
        agenda.leave_out(FaultId(1));
        agenda.renumber(|id| FaultId(id.0 + 5));
        let ids: Vec<_> = agenda.0.iter().map(|item| item.id.0).collect();
        assert_eq!(ids, [5, 7]);
    }
}
