//! Steps of the mission that the rig itself executes: it puts bytes on lines and sets values.

use protocols::Instant;

use super::Run;
use crate::rig::Rig;
use crate::scenario::{Action, Flaw, InjectSpec, Mission, Scenario, SetSpec};

/// Future steps, the next one first.
#[derive(Clone, Debug, Default)]
pub(super) struct Deeds(Vec<Deed>);

/// A step: time, number in the mission from 1, action.
type Deed = (Instant, usize, Action);

impl Deeds {
    /// The steps of `mission` with a time.
    pub(super) fn of(mission: &Mission) -> Self {
        let steps = (1..).zip(&mission.step);
        let steps = steps.filter(|(_, step)| step.action.is_of_the_rig());
        let timed = steps
            .filter_map(|(number, step)| Some((step.at?.instant(), number, step.action.clone())));
        let mut deeds: Vec<Deed> = timed.collect();
        deeds.sort_by_key(|(at, ..)| *at);
        Self(deeds)
    }

    /// Adds a step after those with the same time.
    pub(super) fn add(&mut self, at: Instant, number: usize, action: Action) {
        let index = self.0.partition_point(|(other, ..)| *other <= at);
        self.0.insert(index, (at, number, action));
    }

    /// Time of the next step.
    pub(super) fn due(&self) -> Option<Instant> {
        self.0.first().map(|(at, ..)| *at)
    }
}

impl Run {
    /// Executes the steps that are due now. A step that cannot be executed is a failure of the
    /// mission.
    pub(super) fn do_deeds(&mut self) {
        let now = self.rig.now();
        while self.deeds.due().is_some_and(|at| at <= now) {
            let (_, number, action) = self.deeds.0.remove(0);
            let done = match &action {
                Action::Inject(inject) => put(&mut self.rig, inject),
                Action::Set(one) => set(&self.scenario, &mut self.rig, one),
                _ => Ok(()),
            };
            match (done, action) {
                (Err(flaw), _) => self.steps.fail_now(number, now, &flaw),
                (
                    Ok(()),
                    Action::Set(SetSpec {
                        device,
                        name,
                        value,
                    }),
                ) => {
                    self.note("value-set", format!("{device} {name} = {value}"));
                }
                (Ok(()), Action::Inject(InjectSpec { link, hex, .. })) => {
                    self.note("bytes-injected", format!("{hex} on {link}"));
                }
                (Ok(()), _) => {}
            }
        }
    }

    /// Whether the rig can execute a step. It is tried on a copy, so that a refused one changes
    /// nothing.
    pub(super) fn try_deed(&self, action: &Action) -> Result<(), Flaw> {
        self.moment().check_action(action)?;
        match action {
            Action::Inject(inject) => inject.bytes().map(drop),
            Action::Set(one) => {
                let copy = self.rig.fork();
                copy.map_or(Ok(()), |mut copy| set(&self.scenario, &mut copy, one))
            }
            _ => Ok(()),
        }
    }
}

/// Sets a value of a device.
fn set(scenario: &Scenario, rig: &mut Rig, one: &SetSpec) -> Result<(), Flaw> {
    let spec = scenario.device.get(&one.device);
    let spec = spec.ok_or_else(|| Flaw::new("device", "is no device of the scenario"))?;
    let done = spec.set(rig, &one.device, &one.name, &one.value);
    done.map_err(|message| Flaw::new("name", message))
}

/// Puts bytes on a line, at its rate.
fn put(rig: &mut Rig, inject: &InjectSpec) -> Result<(), Flaw> {
    let bytes = inject.bytes()?;
    let now = rig.now();
    let link = rig.links().iter().position(|link| link.name == inject.link);
    let link = link.ok_or_else(|| Flaw::new("link", "is no link of the robot"))?;
    let direction = crate::rig::line::Direction::from(inject.direction);
    let [sender, _] = rig.line_configs(rig.links()[link].line(direction));
    let lines = rig.lines_mut(link);
    let lines = lines.ok_or_else(|| Flaw::new("link", "has no lines"))?;
    let takes = sender.bytes_time(bytes.len() as u64);
    lines[direction as usize].play(now + takes, &bytes, 0);
    Ok(())
}
