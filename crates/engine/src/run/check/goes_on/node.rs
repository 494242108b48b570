//! Whether a node program under test, or firmware, works until the end: it sends or shows values,
//! does not fall silent, and is not reset by its watchdog.
//!
//! A program that waits forever breaks no rule of a device and answers the rig, so no other check
//! would fail. Unlike the ports of a process, a node program shows no reads: the rig delivers the
//! bytes. So only its own bytes, outputs and notes count as work, and a program that only listens
//! must at least print.

use core::time::Duration;

use emulators::device::{Event, EventKind};
use nodes::{NodeDevice, RECEIVER_OFF, Role, SLEEPS_ON, WATCHDOG_RESET, format_of};
use protocols::{Instant, LineConfig};

use super::super::Check;
use super::{GOES_ON, PAUSES_MAX, SILENT_MAX, STREAM, is_done, is_misunderstood, unheard};
use crate::rig::Rig;
use crate::rig::line::Line;

/// Options that allow silence.
const ALLOW_IT: &str = "allow it with --node-may-idle (firmware: --firmware-may-idle)";
/// Minimum number of moments at which a program sent, from which it counts as sending regularly,
/// also to a device that sends without requests.
const REGULAR: u64 = 20;

/// Observations of a node program under test.
#[derive(Clone, Debug)]
pub(crate) struct GoesOn {
    /// Name and index of its node.
    name: String,
    node: usize,
    /// Bytes that it sent, bytes that arrived for it, and its outputs and notes.
    counts: [u64; 3],
    /// Time of the last change of each count.
    last: [Option<Instant>; 3],
    longest_pause: Duration,
    /// Number of observations in which it sent.
    times: u64,
}

/// Observations of the run besides the program.
pub(crate) struct Rest<'a> {
    /// Whether the run was observed to its end.
    pub is_over: bool,
    /// The other checks of the run.
    pub checks: &'a [Check],
    /// See [`misunderstood`].
    pub misunderstood: u64,
    /// See [`astray`](super::astray).
    pub astray: Option<String>,
}

impl GoesOn {
    /// The observer of the program under test of `rig`; `None` if that is no node program.
    pub(crate) fn of(rig: &Rig) -> Option<Self> {
        let mut programs = rig.node_programs();
        let (name, _) = programs.find(|(_, node)| node.spec().role == Role::Program)?;
        let ends = rig.links().iter().flat_map(|link| &link.lines);
        let mut ends = ends.flat_map(|line| [line.from.node, line.to.node]);
        Some(Self {
            name: name.to_owned(),
            node: ends.find(|node| rig.node_name(*node) == name)?,
            counts: [0; 3],
            last: [None; 3],
            longest_pause: Duration::ZERO,
            times: 0,
        })
    }

    fn program<'a>(&self, rig: &'a Rig) -> Option<&'a NodeDevice> {
        let mut programs = rig.node_programs();
        let (_, program) = programs.find(|(name, _)| *name == self.name)?;
        Some(program)
    }

    /// The lines on which the program sends.
    fn own_lines<'a>(&self, rig: &'a Rig) -> impl Iterator<Item = &'a Line> {
        let node = self.node;
        let lines = rig.links().iter().flat_map(|link| &link.lines);
        lines.filter(move |line| line.from.node == node)
    }

    /// Whether the program is at the other end of a wire of the device `name`.
    pub(crate) fn is_at(&self, rig: &Rig, name: &str) -> bool {
        let lines = rig.links().iter().flat_map(|link| &link.lines);
        let mut ends = lines.map(|line| [line.from.node, line.to.node]);
        ends.any(|ends| {
            ends.contains(&self.node) && ends.iter().any(|end| rig.node_name(*end) == name)
        })
    }

    /// Takes the counts of this moment.
    pub(crate) fn observe(&mut self, rig: &Rig) {
        let now = rig.now();
        let lines = rig.links().iter().flat_map(|link| &link.lines);
        let to = lines.filter(|line| line.to.node == self.node);
        let counts = [
            self.own_lines(rig).map(|line| line.traffic().sent).sum(),
            to.map(|line| line.traffic().delivered).sum(),
            self.program(rig).map_or(0, NodeDevice::reports),
        ];
        let active = self.active_at();
        for (index, count) in counts.into_iter().enumerate() {
            if count > self.counts[index] {
                self.last[index] = Some(now);
                self.times += u64::from(index == 0);
            }
        }
        if let (Some(before), true) = (active, self.active_at() > active) {
            self.longest_pause = self.longest_pause.max(now - before);
        }
        self.counts = counts;
    }

    /// Time of the program's last sign of life.
    fn active_at(&self) -> Option<Instant> {
        self.last[0].max(self.last[2])
    }

    /// The verdict on the program.
    pub(crate) fn verdict(&self, rig: &Rig, rest: &Rest<'_>) -> Check {
        let Some(program) = self
            .program(rig)
            .filter(|program| program.error().is_none())
        else {
            return Check::not_observed(GOES_ON, "the program failed, see node-programs");
        };
        if !rest.is_over {
            return Check::not_observed(GOES_ON, "the run was ended before its time");
        }
        let may_idle = program.spec().may_idle;
        let [sent, arrived, reports] = self.counts;
        let shown = match reports {
            0 => String::new(),
            _ => format!(", showed {reports} values and notes"),
        };
        let passed = format!("sent {sent} B{shown}, {arrived} B arrived for it");
        let fail = |detail: String| Check::new(GOES_ON, false, detail);
        if let Some(crash) = self.crash(rig) {
            return fail(format!("{} at {} s; {passed}", crash.detail, crash.at));
        }
        if let Some(resets) = self.resets(rig).filter(|_| !program.spec().may_reset) {
            return fail(format!("{resets}; {passed}"));
        }
        if sent + reports + arrived == 0 {
            let detail = "no byte passed in either direction: nothing was observed";
            return fail(detail.to_owned());
        }
        if sent > 0
            && arrived == 0
            && !rig.was_heard()
            && let Some(why) = unheard(rest.checks)
        {
            return fail(format!("{passed}; {why}"));
        }
        let unused = self.unused(rig).filter(|_| !may_idle);
        if let Some(unused) = unused {
            return fail(format!("{passed}; {unused}"));
        }
        if sent + reports == 0 && !may_idle {
            let is_mute = program.said().trim().is_empty();
            let wrong = match is_mute {
                true => "it sent, showed and printed nothing",
                false => "it sent and showed nothing, and the device sends only at its start",
            };
            if is_mute || !self.is_streamed() {
                if let Some(note) = self.notes(rig, SLEEPS_ON).next() {
                    return fail(format!("{passed}; {wrong}; {}", note.detail));
                }
                return fail(format!(
                    "{passed}; {wrong}: its use of the bytes was not observed; check the wiring, let \
                     it print its readings, or {ALLOW_IT}"
                ));
            }
        }
        if let Some(detail) = self.garbled(rig) {
            return fail(format!("{passed}; {detail}"));
        }
        let times = rest.misunderstood;
        if sent > 0 && is_misunderstood(times, sent, arrived) {
            return fail(format!(
                "{passed}: {times} times a device did not understand it, or refused it"
            ));
        }
        if let Some(astray) = &rest.astray {
            return fail(format!("{passed}: {astray}"));
        }
        let Some(active) = self.active_at() else {
            let printed = match program.said().trim().is_empty() {
                true => "",
                false => "; it printed",
            };
            return Check::new(GOES_ON, true, format!("{passed}{printed}"));
        };
        let silent_for = rig.now() - active;
        let limit = SILENT_MAX.max(self.longest_pause * PAUSES_MAX);
        if silent_for <= limit {
            return Check::new(GOES_ON, true, passed);
        }
        let seconds = silent_for.as_secs_f64();
        let sleeps = self.notes(rig, SLEEPS_ON).next();
        let sleeps = sleeps.map_or_else(String::new, |note| format!("; {}", note.detail));
        let detail = format!(
            "{passed}; its last sign of life was at {active} s, {seconds:.1} s before the end{sleeps}"
        );
        let may_rest = may_idle || self.is_listener() || is_done(rest.checks);
        match may_rest {
            true => Check::new(GOES_ON, true, detail),
            false => fail(format!("{detail}; {ALLOW_IT}")),
        }
    }

    /// Whether a device sends without requests, and the program has not sent regularly: then it may
    /// only listen.
    fn is_listener(&self) -> bool {
        self.is_streamed() && self.times < REGULAR
    }

    /// Whether bytes arrived long after the program's last ones, or after the start.
    fn is_streamed(&self) -> bool {
        let [sent, heard, _] = self.last;
        heard.is_some_and(|heard| heard > sent.unwrap_or_default() + STREAM)
    }

    /// The notes of the program's board with this rule.
    fn notes<'a>(&'a self, rig: &'a Rig, rule: &'a str) -> impl Iterator<Item = &'a Event> {
        let own = rig
            .events()
            .iter()
            .filter(|logged| logged.source == self.name);
        let events = own.map(|logged| &logged.event);
        events.filter(move |event| event.rule == rule && event.kind == EventKind::Note)
    }

    /// The crash of the firmware.
    fn crash<'a>(&'a self, rig: &'a Rig) -> Option<&'a Event> {
        let mut own = rig.events().iter().filter(|one| one.source == self.name);
        own.find(|one| one.event.rule == "crash")
            .map(|one| &one.event)
    }

    /// The resets by the board's watchdog.
    fn resets(&self, rig: &Rig) -> Option<String> {
        let mut resets = self.notes(rig, WATCHDOG_RESET);
        let first = resets.next()?.at;
        let times = match resets.count() {
            0 => format!("once, at {first} s"),
            more => format!("{} times, first at {first} s", more + 1),
        };
        Some(format!(
            "its watchdog reset it {times}: it was too late to feed the watchdog, or hung; allow it \
             with --firmware-may-reset"
        ))
    }

    /// A port with bytes that the firmware does not use.
    fn unused(&self, rig: &Rig) -> Option<String> {
        let detail = &self.notes(rig, RECEIVER_OFF).next()?.detail;
        Some(format!("{detail}: check --wire"))
    }

    /// The first line on which bytes were unreadable, because the rates or formats differ.
    fn garbled(&self, rig: &Rig) -> Option<String> {
        let link_of = |line: &Line| {
            let mut links = rig.links().iter();
            links.find(|link| link.lines.iter().any(|known| core::ptr::eq(known, line)))
        };
        self.own_lines(rig).find_map(|line| {
            let traffic = line.traffic();
            let [own, far] = rig.line_configs(line);
            let differs = own.data_bits != far.data_bits || own.parity != far.parity;
            let is_other =
                differs || u64::from(own.baud.abs_diff(far.baud)) * 20 > u64::from(far.baud);
            let unread = traffic.framing_errors + traffic.resampled.unsigned_abs();
            (is_other && traffic.sent > 0 && unread > 0).then(|| {
                let name = link_of(line).map_or("", |link| &link.name);
                let line = |line: LineConfig| match differs {
                    true => format!("{} baud {}", line.baud, format_of(line)),
                    false => format!("{} baud", line.baud),
                };
                let (own, far) = (line(own), line(far));
                format!("{name}: program at {own}, expected {far}: both sides read garbage")
            })
        })
    }
}
