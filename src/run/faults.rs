//! The faults of a run: listed, added while it goes on, and saved as what they did.

use core::time::Duration;

use emulators::{Event, EventKind};
use protocols::Instant;
use serde::Serialize;

use super::Run;
use crate::fault::FaultId;
use crate::line::Direction;
use crate::robots;
use crate::scenario::{DirectionSpec, FaultSpec, Flaw, Origin, Scenario, Span};

/// Most faults that a run takes while it goes on.
pub const FAULTS_MAX: usize = 10_000;

/// How far a fault has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FaultState {
    /// Its time is still to come.
    Planned,
    /// It is at work.
    Active,
    /// Its time is over, or it was withdrawn.
    Over,
}

/// A fault of a run, for a list of them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultReport {
    /// Its number, see [`Run::inject`].
    pub id: FaultId,
    /// How far it has come.
    pub state: FaultState,
    /// The fault itself; times count from the start of the run.
    pub fault: FaultSpec,
}

/// The least time by which a change lies after what the rig has already done.
const NEXT: Duration = Duration::from_nanos(1);

impl Run {
    /// Adds a fault to the run as it goes on, from now on or from a later time that it names. Its
    /// times count from the start of the run, and it joins the scenario: the saved
    /// [`case`](Self::case) holds it with the time from which it was in force.
    ///
    /// # Errors
    /// If its keys do not go together, if it names a link that the robot does not have, or a byte
    /// that has passed, or if there are [`FAULTS_MAX`] faults already. Nothing changes then.
    pub fn inject(&mut self, mut fault: FaultSpec) -> Result<FaultId, Flaw> {
        if self.scenario.fault.len() >= FAULTS_MAX {
            let message = format!("the run has {FAULTS_MAX} faults already, expected no more");
            return Err(Flaw::new("kind", message));
        }
        let id = FaultId(self.scenario.fault.len());
        if let Some(byte) = fault.byte {
            let sent = self
                .rig
                .link(&fault.link)
                .map_or(0, |link| link.line(fault.direction.into()).traffic().sent);
            if byte < sent {
                let message = format!("is {byte}, expected one to come: {sent} have passed");
                return Err(Flaw::new("byte", message));
            }
        } else {
            let now = self.next_instant();
            let begins = fault.window().from.max(now);
            fault.from = Some(Span(begins - Instant::ZERO));
        }
        robots::plan_fault(&mut self.rig, &fault, id, self.seed)?;
        let words = format!("fault {id}: {} on {}", fault.kind.name(), fault.link);
        self.scenario.fault.push(fault);
        self.note_fault("fault-added", words);
        Ok(id)
    }

    /// Ends a fault now. It stays in the list, with its end.
    ///
    /// # Errors
    /// If there is no such fault, or if it is over.
    pub fn withdraw(&mut self, id: FaultId) -> Result<(), Flaw> {
        let (now, next) = (self.rig.now(), self.next_instant());
        let count = self.scenario.fault.len();
        let Some(fault) = self.scenario.fault.get(id.0).cloned() else {
            let message = format!("is {id}, expected a number below {count}");
            return Err(Flaw::new("id", message));
        };
        if self.state_of(&fault, now) == FaultState::Over {
            return Err(Flaw::new("id", format!("fault {id} is over already")));
        }
        let strike = fault.strike()?;
        let line = self
            .rig
            .link_mut(&fault.link)
            .expect("a fault that was planned names a link")
            .line_mut(fault.direction.into());
        if let Some(strike) = strike {
            line.faults.remove_strike(strike);
        } else {
            line.faults.end(id, next);
        }
        // A fault that never began has an empty window from now on.
        let fault = &mut self.scenario.fault[id.0];
        fault.until = Some(Span(next - Instant::ZERO));
        self.note_fault("fault-ended", format!("fault {id} withdrawn"));
        Ok(())
    }

    /// All faults, those of the scenario first, then those added since.
    pub fn faults(&self) -> impl Iterator<Item = FaultReport> {
        let now = self.rig.now();
        let faults = self.scenario.fault.iter().enumerate();
        faults.map(move |(index, fault)| FaultReport {
            id: FaultId(index),
            state: self.state_of(fault, now),
            fault: fault.clone(),
        })
    }

    fn state_of(&self, fault: &FaultSpec, now: Instant) -> FaultState {
        let window = fault.window();
        let passed = fault.byte.is_some_and(|byte| {
            let link = self.rig.link(&fault.link);
            link.is_some_and(|link| link.line(fault.direction.into()).traffic().sent > byte)
        });
        if passed || window.until <= now + NEXT {
            FaultState::Over
        } else if fault.byte.is_some() || window.from > now + NEXT {
            FaultState::Planned
        } else {
            FaultState::Active
        }
    }

    /// The first instant that no byte has been sent in yet.
    fn next_instant(&self) -> Instant {
        self.rig.now() + NEXT
    }

    fn note_fault(&mut self, rule: &'static str, detail: String) {
        let event = Event {
            at: self.rig.now(),
            kind: EventKind::Note,
            rule,
            detail,
            bytes: Vec::new(),
        };
        self.rig.log("rig", event);
    }

    /// The run so far as a scenario: seed and defaults written out, and random damage replaced by
    /// the bytes that it hit. A run of it has the same faults, whatever the dice of later versions
    /// would say.
    pub fn case(&self) -> Scenario {
        let mut case = self.scenario.clone();
        case.seed = self.seed;
        case.origin = Some(Origin {
            tool: concat!("hilrig ", env!("CARGO_PKG_VERSION")).to_owned(),
            trace_hash: self.rig.trace_hash(),
        });
        let ran = self.rig.now() - Instant::ZERO;
        case.duration = case.duration.max(Span(ran));
        case.fault
            .retain(|fault| fault.kind.damage().is_none() && !fault.window().is_empty());
        for link in self.rig.links() {
            for (direction, spec) in [
                (Direction::ToMaster, DirectionSpec::ToMaster),
                (Direction::ToDevice, DirectionSpec::ToDevice),
            ] {
                let faults = &link.line(direction).faults;
                let strikes = faults.struck().copied().chain(faults.to_come());
                let specs = strikes.map(|strike| FaultSpec::of_strike(&link.name, spec, strike));
                case.fault.extend(specs);
            }
        }
        case
    }
}
