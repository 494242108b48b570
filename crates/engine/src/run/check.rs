//! Checkers that observe the whole run, with their verdicts and the verdicts of the scenario's
//! expectations.

use firmware_core::memory::StrayWrites;
use protocols::Instant;

use crate::rig::Rig;
use crate::robots::{Axis, Instruments};

mod accepted;
mod at_work;
mod collision;
mod goes_on;
#[cfg(feature = "described")]
mod masters;
#[cfg(feature = "programs")]
mod node_programs;
pub(crate) mod safety;
mod silence;
mod violations;

pub use accepted::SetPointsAsAccepted;
pub use at_work::AtWorkAgain;
pub use collision::NoCollisionAtSpeed;
pub(super) use collision::{COLLISION, HARMLESS_M_S};
#[cfg(feature = "programs")]
pub(crate) use goes_on::node::{GoesOn, Rest};
pub use goes_on::{
    GOES_ON, NOT_UNDERSTOOD, PAUSES_MAX, SILENT_MAX, STREAM, astray, is_done, is_misunderstood,
    misunderstood, unheard,
};
#[cfg(feature = "described")]
pub use masters::{REQUESTS_ANSWERED, must_answer};
#[cfg(feature = "described")]
pub(crate) use masters::{requests_answered, unanswered};
#[cfg(feature = "programs")]
pub use node_programs::NODE_PROGRAMS;
#[cfg(feature = "programs")]
pub(crate) use node_programs::node_programs;
#[cfg(feature = "programs")]
pub use nodes::last_words;
pub use safety::{
    AliveAtTheEnd, AsksAgain, Calm, ComplaintsTrue, CountsTrue, DoesAsOrdered, DriveFed, LinesTrue,
    MotionTrue, MovesOnSoundOrders, NoticesSilence, PoseBelieved, RestsAfterSilence, SendsInTime,
    SendsOn, SendsSoundFrames, TelemetryTrue, TurnsShort,
};
pub use silence::MotorsStopAfterSilence;
pub(crate) use silence::fired;
pub use silence::{STOPS, WATCHDOG};
pub use violations::ViolationsLater;
pub(crate) use violations::violations;

pub use crate::robots::checker::{Check, Checker, Look, Status};

/// The checkers of every run. `instruments` provides data only for some of them. Some observe
/// `rig`. Contacts are judged until `contacts_until`, if it is given.
pub fn standard(
    rig: &mut Rig,
    instruments: &dyn Instruments,
    contacts_until: Option<Instant>,
) -> Vec<Box<dyn Checker>> {
    let mut checkers: Vec<Box<dyn Checker>> = Vec::new();
    if instruments.has_body() {
        checkers.push(Box::new(SetPointsInRange::default()));
    }
    let stops = instruments.stops();
    if !stops.is_empty() {
        checkers.push(Box::new(MotorsStopAfterSilence::watching(stops)));
    }
    if instruments.has_body() {
        let collision = NoCollisionAtSpeed::judging_until(contacts_until);
        let dialect = instruments.dialect(rig);
        checkers.push(Box::new(collision.commanded_in(rig, dialect)));
    }
    checkers.push(Box::new(BytesConserved::default()));
    checkers.push(Box::new(MemoryIntact::default()));
    checkers.push(Box::new(ProgramAlive::default()));
    if let Some(dialect) = instruments.dialect(rig) {
        let accepted = SetPointsAsAccepted::listening(rig, dialect);
        checkers.extend(accepted.map(|checker| Box::new(checker) as Box<dyn Checker>));
    }
    checkers.extend(instruments.checkers(rig));
    checkers
}

/// The set-points of some axes as text.
fn set_points(axes: &[Axis]) -> String {
    let points: Vec<String> = axes.iter().map(|axis| axis.set_point.to_string()).collect();
    points.join(", ")
}

/// No accepted set-point exceeds the limits of its axis.
#[derive(Clone, Debug, Default)]
pub struct SetPointsInRange {
    looks: u64,
    worst: Option<(Instant, Vec<Axis>)>,
}

impl Checker for SetPointsInRange {
    fn observe(&mut self, look: &Look<'_>) {
        let limited = |axis: &&Axis| axis.limit.is_some();
        if !look.axes.iter().any(|axis| limited(&axis)) {
            return;
        }
        self.looks += 1;
        // Not-a-number is in no range.
        let within = |axis: &Axis, limit: f64| axis.set_point.abs() <= limit;
        let beyond = |axis: &Axis| axis.limit.is_some_and(|limit| !within(axis, limit));
        if self.worst.is_none() && look.axes.iter().any(beyond) {
            self.worst = Some((look.rig.now(), look.axes.to_vec()));
        }
    }

    fn verdict(&self) -> Check {
        let detail = match &self.worst {
            None if self.looks == 0 => "no axis with a limit to watch".to_owned(),
            None => format!("in range in all {} samples", self.looks),
            Some((at, axes)) => {
                let limits = axes.iter().filter_map(|axis| axis.limit);
                let limit = limits.fold(0.0, f64::max);
                format!("{} at {at} s, limit +-{limit}", set_points(axes))
            }
        };
        Check::new("set-points-in-range", self.worst.is_none(), detail).if_observed(self.looks > 0)
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

/// Name of the check of `violations_max`.
pub const VIOLATIONS: &str = "violations";

/// Name of the check [`BytesConserved`].
pub const BYTES_CONSERVED: &str = "bytes-conserved";

/// Every sent byte was delivered, lost by a fault, garbled, or is still on the line.
#[derive(Clone, Debug, Default)]
pub struct BytesConserved {
    sent: u64,
    broken: Option<(Instant, String)>,
}

impl Checker for BytesConserved {
    fn observe(&mut self, look: &Look<'_>) {
        self.sent = 0;
        for link in look.rig.links() {
            // A line that plays a capture did not send its bytes.
            for line in link.lines.iter().filter(|line| !line.is_played) {
                self.sent += line.traffic().sent;
                if self.broken.is_none() && !line.conserves_bytes() {
                    self.broken = Some((
                        look.rig.now(),
                        format!("{}: {:?}", link.name, line.traffic()),
                    ));
                }
            }
        }
    }

    fn verdict(&self) -> Check {
        let detail = match &self.broken {
            None => format!("{} bytes accounted for", self.sent),
            Some((at, line)) => format!("at {at} s on {line}"),
        };
        let check = Check::new(BYTES_CONSERVED, self.broken.is_none(), detail);
        check.if_observed(self.sent > 0)
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

/// Result of checkers of the program if there is no program.
const NO_PROGRAM: &str = "no program in this process to watch";

/// The program never writes beside its buffers.
#[derive(Clone, Debug, Default)]
pub struct MemoryIntact {
    has_program: bool,
    broken: Option<(Instant, &'static str, StrayWrites)>,
}

impl Checker for MemoryIntact {
    fn observe(&mut self, look: &Look<'_>) {
        let Some(program) = look.rig.program() else {
            return;
        };
        self.has_program = true;
        let now = look.rig.now();
        program.stray_writes(&mut |buffer, stray| {
            let at = self.broken.map_or(now, |(at, ..)| at);
            self.broken = Some((at, buffer, stray));
        });
    }

    fn verdict(&self) -> Check {
        let detail = match self.broken {
            None if !self.has_program => NO_PROGRAM.to_owned(),
            None => "no write beside a buffer".to_owned(),
            Some((at, buffer, stray)) => format!(
                "{} writes beside the {buffer}, the first at {at} s to element {}, the last to {}",
                stray.count, stray.first, stray.last
            ),
        };
        let check = Check::new("memory-intact", self.broken.is_none(), detail);
        check.if_observed(self.has_program)
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

/// The program does not end.
#[derive(Clone, Debug, Default)]
pub struct ProgramAlive {
    has_program: bool,
    ended: Option<Instant>,
}

impl Checker for ProgramAlive {
    fn observe(&mut self, look: &Look<'_>) {
        let Some(program) = look.rig.program() else {
            return;
        };
        self.has_program = true;
        let is_dead = program.is_dead();
        if is_dead && self.ended.is_none() {
            self.ended = Some(look.rig.now());
        }
    }

    fn verdict(&self) -> Check {
        let detail = match self.ended {
            None if !self.has_program => NO_PROGRAM.to_owned(),
            None => "to the end".to_owned(),
            Some(at) => format!("ended at {at} s"),
        };
        let check = Check::new("program-alive", self.ended.is_none(), detail);
        check.if_observed(self.has_program)
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

#[cfg(test)]
mod tests;
