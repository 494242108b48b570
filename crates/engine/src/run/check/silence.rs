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

#[cfg(test)]
mod tests {
    use emulators::Event;

    use super::*;
    use crate::rig::bare;
    use crate::robots::checker::Status;

    fn event(millis: u64, kind: EventKind, rule: &'static str) -> Event {
        Event {
            at: Instant::from_millis(millis),
            kind,
            rule,
            detail: String::new(),
            bytes: Vec::new(),
        }
    }

    /// Two stops of the base and one of the arm; other notes, and violations, are no stops.
    #[test]
    fn devices_that_stopped_by_themselves_are_told() {
        let mut rig = bare::rig();
        assert_eq!(fired(rig.events()), None);
        use EventKind::{Note, Violation};
        for (source, millis, kind, rule) in [
            ("base", 500, Violation, "watchdog"),
            ("base", 600, Note, "motors-stopped"),
            ("base", 1_000, Note, "watchdog"),
            ("arm", 2_000, Note, "made-safe"),
            ("base", 3_000, Note, "dead-man"),
        ] {
            rig.log(source, event(millis, kind, rule));
        }
        let check = fired(rig.events()).expect("two of them");
        assert_eq!(
            (check.name.as_str(), check.status),
            ("watchdog", Status::Pass)
        );
        let words = "base stopped by itself 2 times, first at 1.000000 s; arm stopped by itself \
                     once, at 2.000000 s: nothing reached it for longer than it allows";
        assert_eq!(check.detail, words);
    }

    /// The base stops its left and right wheel after 500 ms; the arm has no watchdog. Each device
    /// is judged by its own axes and its own line.
    #[test]
    fn each_device_stops_its_own_axes() {
        let axis = |name: &'static str, set_point: f64| Axis {
            name: name.into(),
            unit: "",
            set_point,
            limit: None,
            actual: None,
        };
        let stops = |link: &str, millis: Option<u64>, axes: &[&str]| Stops {
            link: link.to_owned(),
            silence_max: millis.map(Duration::from_millis),
            axes: axes.iter().map(|&name| name.to_owned()).collect(),
        };
        let judged = |left: f64, grip: f64, devices: Vec<Stops>| {
            let (mut rig, [base, _]) = bare::linked(["base", "arm"], 1_000_000);
            let mut checker = MotorsStopAfterSilence::watching(devices);
            rig.inject(base[1].node, &[1]);
            for millis in [100, 700] {
                rig.run_until(Instant::from_millis(millis));
                checker.observe(&Look {
                    rig: &rig,
                    axes: &[axis("left", left), axis("grip", grip)],
                    contacts: &[],
                });
            }
            let mut copy = rig.fork().expect("plain");
            let copied = checker.fork(&mut copy).map(|copy| copy.verdict());
            let check = checker.verdict();
            assert_eq!(copied, Some(check.clone()));
            (check.status, check.detail)
        };
        let both = || {
            vec![
                stops("base", Some(500), &["left", "right"]),
                stops("arm", None, &["grip"]),
            ]
        };
        let words = "base: set-points still on at 0.700000 s after 600 ms of silence, limit 500 ms; \
                     arm: longest silence with set-points on 700 ms, no watchdog";
        assert_eq!(judged(1.0, 1.0, both()), (Status::Fail, words.to_owned()));
        let words = "base: longest silence with set-points on 0 ms, limit 500 ms; arm: longest \
                     silence with set-points on 700 ms, no watchdog";
        assert_eq!(
            judged(0.0, 1.0, both()),
            (Status::NotObserved, words.to_owned())
        );
        let arm = vec![stops("arm", None, &[])];
        let words = "longest silence with set-points on 700 ms, no watchdog".to_owned();
        assert_eq!(judged(1.0, 0.0, arm), (Status::NotObserved, words));
        let gone = vec![stops("gone", Some(1), &[])];
        assert_eq!(judged(1.0, 1.0, gone).0, Status::NotObserved);
        assert_eq!(
            judged(1.0, 1.0, vec![stops("base", Some(600), &[])]).0,
            Status::Pass
        );
    }
}
