//! The operator's script: the steps of a mission as wishes to its station.

use protocols::Instant;

use crate::scenario::{Action, Mission, ScenarioError, Source, Step};

/// Wishes in order of time.
#[derive(Clone, Debug)]
pub(super) struct Script<W> {
    steps: Vec<(Instant, W)>,
    next: usize,
}

impl<W: Clone> Script<W> {
    /// A script with the wishes `first`, then the steps of `mission`, which `wish` converts.
    ///
    /// # Errors
    /// If the robot does not support a step.
    pub(super) fn of(
        mission: &Mission,
        source: &Source,
        first: Vec<(Instant, W)>,
        wish: impl Fn(&Action) -> Result<W, String>,
    ) -> Result<Self, ScenarioError> {
        let orders = mission.step.iter().enumerate();
        for (index, step) in orders.filter(|(_, step)| !step.action.is_of_the_rig()) {
            wish(&step.action).map_err(|message| {
                let span = source.find_in_list("mission.step", index, "do");
                source.invalid(span, format!("mission.step[{index}].do"), message)
            })?;
        }
        let mut steps = first;
        // Steps with a condition are added when the condition holds.
        let timed = mission.step.iter().filter(|it| it.at.is_some());
        let timed = timed.filter(|step| !step.action.is_of_the_rig());
        let mut timed: Vec<&Step> = timed.collect();
        timed.sort_by_key(|step| step.at);
        let timed = timed
            .into_iter()
            .filter_map(|step| Some((time(step), wish(&step.action).ok()?)));
        steps.extend(timed);
        Ok(Self { steps, next: 0 })
    }

    /// Inserts `step`, converted to `wish`, at `index` among the `mission` steps of the scenario,
    /// but behind executed steps.
    pub(super) fn insert(&mut self, mission: usize, index: usize, step: &Step, wish: W) {
        let others = self.steps.len().saturating_sub(mission);
        let index = (others + index).clamp(self.next, self.steps.len());
        self.steps.insert(index, (time(step), wish));
    }

    /// Inserts `wish` behind all steps up to the last one that is due by `at`.
    pub(super) fn put(&mut self, at: Instant, wish: W) {
        let due = self.steps.iter().rposition(|(time, _)| *time <= at);
        let index = due.map_or(0, |last| last + 1).max(self.next);
        self.steps.insert(index, (at, wish));
    }

    /// Time of the next step.
    pub(super) fn due(&self) -> Option<Instant> {
        // A step does not overtake its predecessor.
        self.steps.get(self.next).map(|(at, _)| *at)
    }

    /// The next step that is due by `now`.
    pub(super) fn take(&mut self, now: Instant) -> Option<W> {
        let (at, wish) = self.steps.get(self.next)?;
        if *at > now {
            return None;
        }
        self.next += 1;
        Some(wish.clone())
    }
}

fn time(step: &Step) -> Instant {
    step.at.unwrap_or_default().instant()
}
