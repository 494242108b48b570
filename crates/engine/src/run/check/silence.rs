//! Checks that a device stops its actuators when its line is silent, and lists devices that stopped
//! by their watchdog.

use core::time::Duration;

use emulators::EventKind;
use protocols::Instant;

use super::{Check, Checker, Look};
use crate::rig::line::Direction;
use crate::rig::{Logged, Rig};
use crate::robots::{Axis, Silence, Stops};

/// Name of the check.
pub const STOPS: &str = "motors-stop-after-silence";
/// Log entries of devices that stop because their master is silent.
pub const WATCHDOG: [&str; 3] = ["made-safe", "watchdog", "dead-man"];

/// The motors stop after their device receives no more bytes.
#[derive(Clone, Debug)]
pub struct MotorsStopAfterSilence {
    watched: Vec<Watched>,
}

/// A device and its actuators.
#[derive(Clone, Debug)]
struct Watched {
    stops: Stops,
    delivered: u64,
    heard_at: Instant,
    drives: u64,
    longest_drive: Duration,
    broken: Option<(Instant, Duration)>,
}

impl MotorsStopAfterSilence {
    /// Observes the line to the device that `silence` names.
    pub fn new(silence: Silence) -> Self {
        Self::watching([Stops::from(silence)])
    }

    /// The same for several devices.
    pub fn watching(devices: impl IntoIterator<Item = Stops>) -> Self {
        let watched = devices.into_iter().map(|stops| Watched {
            stops,
            delivered: 0,
            heard_at: Instant::ZERO,
            drives: 0,
            longest_drive: Duration::ZERO,
            broken: None,
        });
        Self {
            watched: watched.collect(),
        }
    }
}

impl Watched {
    fn observe(&mut self, look: &Look<'_>) {
        let rig = look.rig;
        let Some(link) = rig.link(&self.stops.link) else {
            return;
        };
        let delivered = link.line(Direction::ToDevice).traffic().delivered;
        if delivered != self.delivered {
            self.delivered = delivered;
            self.heard_at = rig.now();
        }
        let silence = rig.now() - self.heard_at;
        let is_own = |axis: &&Axis| {
            let names = &self.stops.axes;
            names.is_empty() || names.iter().any(|name| *name == axis.name)
        };
        let mut own = look.drives().filter(is_own);
        if !own.any(|axis| axis.set_point != 0.0) {
            return;
        }
        self.drives += 1;
        self.longest_drive = self.longest_drive.max(silence);
        let is_late = self.stops.silence_max.is_some_and(|most| silence > most);
        if is_late && self.broken.is_none() {
            self.broken = Some((rig.now(), silence));
        }
    }

    fn told(&self) -> String {
        let longest = self.longest_drive.as_millis();
        let Some(limit) = self.stops.silence_max else {
            return format!("longest silence with set-points on {longest} ms, no watchdog");
        };
        let limit = limit.as_millis();
        match self.broken {
            None => format!("longest silence with set-points on {longest} ms, limit {limit} ms"),
            Some((at, silence)) => format!(
                "set-points still on at {at} s after {} ms of silence, limit {limit} ms",
                silence.as_millis()
            ),
        }
    }
}

impl Checker for MotorsStopAfterSilence {
    fn observe(&mut self, look: &Look<'_>) {
        self.watched.iter_mut().for_each(|one| one.observe(look));
    }

    fn verdict(&self) -> Check {
        let told = |one: &Watched| match self.watched.len() {
            1 => one.told(),
            _ => format!("{}: {}", one.stops.link, one.told()),
        };
        let told: Vec<String> = self.watched.iter().map(told).collect();
        let holds = self.watched.iter().all(|one| one.broken.is_none());
        let is_judged = |one: &Watched| one.drives > 0 && one.stops.silence_max.is_some();
        let check = Check::new(STOPS, holds, told.join("; "));
        check.if_observed(self.watched.iter().any(is_judged))
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

/// Devices that stopped by their watchdog, with counts; `None` if none did. This is no failure.
pub(crate) fn fired(events: &[Logged]) -> Option<Check> {
    let is_stop = |logged: &&Logged| {
        logged.event.kind == EventKind::Note && WATCHDOG.contains(&logged.event.rule)
    };
    let mut fired: Vec<(&str, u64, Instant)> = Vec::new();
    for logged in events.iter().filter(is_stop) {
        match fired
            .iter_mut()
            .find(|(source, ..)| *source == logged.source)
        {
            Some((_, count, _)) => *count += 1,
            None => fired.push((&logged.source, 1, logged.event.at)),
        }
    }
    let told = fired.iter().map(|(source, count, first)| match count {
        1 => format!("{source} stopped by itself once, at {first} s"),
        _ => format!("{source} stopped by itself {count} times, first at {first} s"),
    });
    let told: Vec<String> = told.collect();
    let detail = format!(
        "{}: nothing reached it for longer than it allows",
        told.join("; ")
    );
    (!told.is_empty()).then(|| Check::new("watchdog", true, detail))
}
