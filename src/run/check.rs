//! Whole-run checkers: invariants watched from the first to the last moment, and the verdicts that
//! they and the scenario's expectations come to.

use core::time::Duration;

use emulators::world::Contact;
use firmware_core::memory::StrayWrites;
use protocols::Instant;
use serde::Serialize;

use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::robots::Actuators;

mod accepted;
mod at_work;

pub use accepted::SetPointsAsAccepted;
pub use at_work::AtWorkAgain;

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// What was demanded held.
    Pass,
    /// It did not.
    Fail,
}

/// One verdict.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Check {
    /// Stable name in kebab case.
    pub name: String,
    /// How it ended.
    pub status: Status,
    /// A sentence with the figures.
    pub detail: String,
}

impl Check {
    /// A verdict: `pass` or not.
    pub fn new(name: &str, pass: bool, detail: impl Into<String>) -> Self {
        let status = if pass { Status::Pass } else { Status::Fail };
        Self {
            name: name.to_owned(),
            status,
            detail: detail.into(),
        }
    }
}

/// What a checker sees at one moment.
#[derive(Clone, Copy)]
pub struct Look<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// What the base was told to do, if it is emulated.
    pub actuators: Option<Actuators>,
    /// Contacts since the last look.
    pub contacts: &'a [Contact],
}

/// An invariant that is watched during the run.
pub trait Checker {
    /// Looks at the rig; called every few milliseconds of virtual time.
    fn observe(&mut self, look: &Look<'_>);

    /// The verdict so far.
    fn verdict(&self) -> Check;
}

/// The checkers of every run.
pub fn standard(command_link: &str, silence_max: Duration) -> Vec<Box<dyn Checker>> {
    vec![
        Box::new(SetPointsInRange::default()),
        Box::new(MotorsStopAfterSilence::new(command_link, silence_max)),
        Box::new(NoCollisionAtSpeed::default()),
        Box::new(BytesConserved::default()),
        Box::new(MemoryIntact::default()),
        Box::new(ProgramAlive::default()),
    ]
}

/// No set-point that the base acts on is ever beyond what the wheels can do.
#[derive(Clone, Debug, Default)]
pub struct SetPointsInRange {
    looks: u64,
    worst: Option<(Instant, Actuators)>,
}

impl Checker for SetPointsInRange {
    fn observe(&mut self, look: &Look<'_>) {
        let Some(actuators) = look.actuators else {
            return;
        };
        self.looks += 1;
        let beyond = actuators
            .set_points
            .iter()
            .any(|point| point.abs() > actuators.limit);
        if beyond && self.worst.is_none() {
            self.worst = Some((look.rig.now(), actuators));
        }
    }

    fn verdict(&self) -> Check {
        let detail = match self.worst {
            None => format!("in range at all of {} looks", self.looks),
            Some((
                at,
                Actuators {
                    set_points: [left, right],
                    limit,
                    ..
                },
            )) => {
                format!("{left}, {right} at {at} s, limit +-{limit}")
            }
        };
        Check::new("set-points-in-range", self.worst.is_none(), detail)
    }
}

/// The motors come to rest when nothing reaches the base any more.
#[derive(Clone, Debug)]
pub struct MotorsStopAfterSilence {
    link: String,
    silence_max: Duration,
    delivered: u64,
    heard_at: Instant,
    longest_drive: Duration,
    broken: Option<(Instant, Duration)>,
}

impl MotorsStopAfterSilence {
    /// Watches the line towards the base of `link`; set-points must be zero once it was silent for
    /// longer than `silence_max`.
    pub fn new(link: &str, silence_max: Duration) -> Self {
        Self {
            link: link.to_owned(),
            silence_max,
            delivered: 0,
            heard_at: Instant::ZERO,
            longest_drive: Duration::ZERO,
            broken: None,
        }
    }
}

impl Checker for MotorsStopAfterSilence {
    fn observe(&mut self, look: &Look<'_>) {
        let rig = look.rig;
        let Some(link) = rig.link(&self.link) else {
            return;
        };
        let delivered = link.line(Direction::ToDevice).traffic().delivered;
        if delivered != self.delivered {
            self.delivered = delivered;
            self.heard_at = rig.now();
        }
        let silence = rig.now() - self.heard_at;
        let driving = look
            .actuators
            .is_some_and(|actuators| actuators.set_points != [0, 0]);
        if driving {
            self.longest_drive = self.longest_drive.max(silence);
            if silence > self.silence_max && self.broken.is_none() {
                self.broken = Some((rig.now(), silence));
            }
        }
    }

    fn verdict(&self) -> Check {
        let limit = self.silence_max.as_millis();
        let detail = match self.broken {
            None => format!(
                "longest silence with set-points on {} ms, limit {limit} ms",
                self.longest_drive.as_millis()
            ),
            Some((at, silence)) => format!(
                "set-points still on at {at} s after {} ms of silence, limit {limit} ms",
                silence.as_millis()
            ),
        };
        Check::new("motors-stop-after-silence", self.broken.is_none(), detail)
    }
}

/// The robot does not run into anything.
#[derive(Clone, Debug, Default)]
pub struct NoCollisionAtSpeed {
    contacts: u64,
    first: Option<Instant>,
    worst_m_s: f64,
}

/// A touch slower than this does no harm, m/s.
const HARMLESS_M_S: f64 = 0.05;

impl Checker for NoCollisionAtSpeed {
    fn observe(&mut self, look: &Look<'_>) {
        for contact in look.contacts {
            self.contacts += 1;
            self.worst_m_s = self.worst_m_s.max(contact.speed_m_s);
            if contact.speed_m_s > HARMLESS_M_S && self.first.is_none() {
                self.first = Some(contact.at);
            }
        }
    }

    fn verdict(&self) -> Check {
        let contacts = self.contacts;
        let detail = match self.first {
            None => format!("{contacts} contacts, none faster than {HARMLESS_M_S} m/s"),
            Some(at) => format!(
                "{contacts} contacts, the first in earnest at {at} s, worst {:.3} m/s",
                self.worst_m_s
            ),
        };
        Check::new("no-collision-at-speed", self.first.is_none(), detail)
    }
}

/// Every byte sent was delivered, taken by a fault, garbled, or is on its way.
#[derive(Clone, Debug, Default)]
pub struct BytesConserved {
    sent: u64,
    broken: Option<(Instant, String)>,
}

impl Checker for BytesConserved {
    fn observe(&mut self, look: &Look<'_>) {
        self.sent = 0;
        for link in look.rig.links() {
            // What a capture plays into a line was not sent on it.
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
        Check::new("bytes-conserved", self.broken.is_none(), detail)
    }
}

/// The program never writes beside its buffers.
#[derive(Clone, Debug, Default)]
pub struct MemoryIntact {
    broken: Option<(Instant, &'static str, StrayWrites)>,
}

impl Checker for MemoryIntact {
    fn observe(&mut self, look: &Look<'_>) {
        let Some(program) = look.rig.program() else {
            return;
        };
        let now = look.rig.now();
        program.stray_writes(&mut |buffer, stray| {
            let at = self.broken.map_or(now, |(at, ..)| at);
            self.broken = Some((at, buffer, stray));
        });
    }

    fn verdict(&self) -> Check {
        let detail = match self.broken {
            None => "no write beside a buffer".to_owned(),
            Some((at, buffer, stray)) => format!(
                "{} writes beside the {buffer}, the first at {at} s to element {}, the last to {}",
                stray.count, stray.first, stray.last
            ),
        };
        Check::new("memory-intact", self.broken.is_none(), detail)
    }
}

/// The program does not end.
#[derive(Clone, Debug, Default)]
pub struct ProgramAlive {
    ended: Option<Instant>,
}

impl Checker for ProgramAlive {
    fn observe(&mut self, look: &Look<'_>) {
        let is_dead = look.rig.program().is_some_and(|program| program.is_dead());
        if is_dead && self.ended.is_none() {
            self.ended = Some(look.rig.now());
        }
    }

    fn verdict(&self) -> Check {
        let detail = match self.ended {
            None => "to the end".to_owned(),
            Some(at) => format!("ended at {at} s"),
        };
        Check::new("program-alive", self.ended.is_none(), detail)
    }
}
