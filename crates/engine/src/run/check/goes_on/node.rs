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

#[cfg(test)]
mod tests {
    use nodes::NodeSpec;
    use protocols::{Parity, Port};

    use super::*;
    use crate::rig::bare::linked;
    use crate::rig::line::End;
    use crate::robots::checker::Status::{self, Fail, NotObserved, Pass};

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn spec(role: Role) -> NodeSpec {
        NodeSpec {
            role,
            ..NodeSpec::new("prog", "true")
        }
    }

    /// A run of 40 s with a program that has not been started: what was observed of it is in
    /// `goes_on`. It sent its last bytes half a second before the end.
    struct Bench {
        rig: Rig,
        goes_on: GoesOn,
        checks: Vec<Check>,
        misunderstood: u64,
        astray: Option<String>,
    }

    fn bench_of(spec: NodeSpec) -> Bench {
        let (mut rig, [[_, master]]) = linked(["meter"], 1_000_000);
        rig.run_until(at(40_000));
        rig.add_device("prog", NodeDevice::new(spec));
        Bench {
            rig,
            goes_on: GoesOn {
                name: "prog".to_owned(),
                node: master.node,
                counts: [100, 50, 0],
                last: [Some(at(39_500)), Some(at(39_500)), None],
                longest_pause: Duration::ZERO,
                times: 30,
            },
            checks: Vec::new(),
            misunderstood: 0,
            astray: None,
        }
    }

    fn bench() -> Bench {
        bench_of(spec(Role::Program))
    }

    impl Bench {
        fn told_at(&self, is_over: bool) -> (Status, String) {
            let rest = Rest {
                is_over,
                checks: &self.checks,
                misunderstood: self.misunderstood,
                astray: self.astray.clone(),
            };
            let check = self.goes_on.verdict(&self.rig, &rest);
            (check.status, check.detail)
        }

        fn told(&self) -> (Status, String) {
            self.told_at(true)
        }

        #[track_caller]
        fn is(&self, status: Status, words: &str) {
            assert_eq!(self.told(), (status, words.to_owned()));
        }

        #[track_caller]
        fn begins(&self, status: Status, words: &str) {
            let (found, told) = self.told();
            assert!(
                found == status && told.starts_with(words),
                "{found:?} {told}"
            );
        }

        fn log(&mut self, source: &str, kind: EventKind, rule: &'static str, second: u64) {
            let event = Event {
                at: Instant::from_secs(second),
                kind,
                rule,
                detail: "so".to_owned(),
                bytes: Vec::new(),
            };
            self.rig.log(source, event);
        }
    }

    const SENT: &str = "sent 100 B, 50 B arrived for it";

    #[test]
    fn a_program_that_works_to_the_end_passes() {
        let mut it = bench();
        it.is(Pass, SENT);
        let early = "the run was ended before its time".to_owned();
        assert_eq!(it.told_at(false), (NotObserved, early));
        it.goes_on.counts[2] = 5;
        it.is(
            Pass,
            "sent 100 B, showed 5 values and notes, 50 B arrived for it",
        );
        it.goes_on.counts = [0; 3];
        it.is(
            Fail,
            "no byte passed in either direction: nothing was observed",
        );
        it.goes_on.name = "other".to_owned();
        it.is(NotObserved, "the program failed, see node-programs");
    }

    /// Bytes that no device received prove nothing, unless a rule of the scenario has passed.
    #[test]
    fn a_program_without_a_listening_device_is_not_observed() {
        let mut it = bench();
        it.goes_on.counts = [5, 0, 0];
        it.begins(
            Fail,
            "sent 5 B, 0 B arrived for it; no device received a byte",
        );
        it.checks = vec![Check::new("rule-answers", true, "")];
        it.is(Pass, "sent 5 B, 0 B arrived for it");
        // A program that shows values and sends nothing needs no device.
        let mut shows = bench();
        (shows.goes_on.counts, shows.goes_on.last[2]) = ([0, 0, 5], Some(at(39_500)));
        shows.is(
            Pass,
            "sent 0 B, showed 5 values and notes, 0 B arrived for it",
        );
    }

    /// Notes of the program's own board count, not those of other devices, and no violations.
    #[test]
    fn crashes_and_resets_of_the_program_are_told() {
        use EventKind::{Note, Violation};
        let mut it = bench();
        it.log("other", Note, "crash", 2);
        it.log("other", Note, WATCHDOG_RESET, 2);
        it.log("prog", Violation, WATCHDOG_RESET, 2);
        it.is(Pass, SENT);
        it.log("prog", Note, WATCHDOG_RESET, 3);
        it.begins(
            Fail,
            "its watchdog reset it once, at 3.000000 s: it was too late",
        );
        it.log("prog", Note, WATCHDOG_RESET, 4);
        it.begins(Fail, "its watchdog reset it 2 times, first at 3.000000 s: ");
        it.log("prog", Violation, "crash", 5);
        it.is(Fail, &format!("so at 5.000000 s; {SENT}"));
        let mut may = bench_of(NodeSpec {
            may_reset: true,
            ..spec(Role::Program)
        });
        may.log("prog", Note, WATCHDOG_RESET, 3);
        may.is(Pass, SENT);
    }

    fn idle() -> Bench {
        bench_of(NodeSpec {
            may_idle: true,
            ..spec(Role::Program)
        })
    }

    /// A port without a receiver, and a program that shows no use of its bytes.
    #[test]
    fn bytes_that_the_program_does_not_use_are_told() {
        let use_of = |mut it: Bench, rule: &'static str| {
            it.log("prog", EventKind::Note, rule, 3);
            it
        };
        use_of(bench(), RECEIVER_OFF).is(Fail, &format!("{SENT}; so: check --wire"));
        use_of(idle(), RECEIVER_OFF).is(Pass, SENT);
        let mute = |mut it: Bench| {
            it.goes_on.counts = [0, 50, 0];
            (it.goes_on.last, it.goes_on.times) = ([None, Some(at(39_500)), None], 0);
            it
        };
        let words = "sent 0 B, 50 B arrived for it; it sent, showed and printed nothing";
        mute(bench()).begins(
            Fail,
            &format!("{words}: its use of the bytes was not observed"),
        );
        use_of(mute(bench()), SLEEPS_ON).is(Fail, &format!("{words}; so"));
        mute(idle()).is(Pass, "sent 0 B, 50 B arrived for it");
        // Values that it showed are a use.
        let mut shows = mute(bench());
        (shows.goes_on.counts[2], shows.goes_on.last[2]) = (1, Some(at(39_000)));
        assert_eq!(shows.told().0, Pass);
    }

    #[test]
    fn requests_that_devices_did_not_understand_are_told() {
        let mut it = bench();
        (it.goes_on.counts[0], it.misunderstood) = (49, 3);
        assert_eq!(it.told().0, Pass);
        it.goes_on.counts[0] = 48;
        let words = "sent 48 B, 50 B arrived for it: 3 times a device did not understand it, or \
                     refused it";
        it.is(Fail, words);
        let mut it = bench();
        it.astray = Some("4 times it asked address 7".to_owned());
        it.is(Fail, &format!("{SENT}: 4 times it asked address 7"));
    }

    /// Two seconds of silence are allowed, or three times the longest pause so far.
    #[test]
    fn a_program_that_falls_silent_is_told() {
        let silent = |mut it: Bench, since: u64, pause: u64| {
            it.goes_on.last[0] = Some(at(since));
            it.goes_on.longest_pause = Duration::from_millis(pause);
            it
        };
        silent(bench(), 38_000, 0).is(Pass, SENT);
        let words =
            format!("{SENT}; its last sign of life was at 37.900000 s, 2.1 s before the end");
        silent(bench(), 37_900, 0).is(Fail, &format!("{words}; {ALLOW_IT}"));
        assert_eq!(silent(bench(), 37_000, 1_000).told().0, Pass);
        assert_eq!(silent(bench(), 36_999, 1_000).told().0, Fail);
        silent(idle(), 37_900, 0).is(Pass, &words);
        let mut sleeps = silent(bench(), 37_900, 0);
        sleeps.log("prog", EventKind::Note, SLEEPS_ON, 3);
        sleeps.is(Fail, &format!("{words}; so; {ALLOW_IT}"));
        let mut done = silent(bench(), 30_000, 0);
        done.goes_on.last[1] = None;
        assert_eq!(done.told().0, Fail);
        done.checks = vec![Check::new("home", true, "")];
        assert_eq!(done.told().0, Pass);
        let mut shows = silent(bench(), 30_000, 0);
        shows.goes_on.last[2] = Some(at(38_000));
        assert_eq!(shows.told().0, Pass);
    }

    /// A device that sends for more than a second behind the last request sends by itself. A
    /// program that has sent 20 times is no listener.
    #[test]
    fn a_program_may_only_listen_to_a_stream() {
        let judged = |heard: u64, times: u64| {
            let mut it = bench();
            it.goes_on.last = [Some(at(30_000)), Some(at(heard)), None];
            it.goes_on.times = times;
            it.told().0
        };
        assert_eq!(
            [31_000, 31_001].map(|heard| judged(heard, 19)),
            [Fail, Pass]
        );
        assert_eq!(judged(39_000, 20), Fail);
        let mut it = bench();
        it.goes_on.last = [None, Some(at(1_000)), None];
        assert!(!it.goes_on.is_streamed());
        it.goes_on.last[1] = Some(at(1_001));
        assert!(it.goes_on.is_streamed());
        it.goes_on.last[1] = None;
        assert!(!it.goes_on.is_streamed());
    }

    /// The program sends at 1, 3 and 4 s; bytes arrive for it at 2 s.
    #[test]
    fn pauses_are_those_between_its_own_bytes() {
        let (mut rig, [[meter, master]]) = linked(["meter"], 1_000_000);
        let mut goes_on = bench().goes_on;
        goes_on.node = master.node;
        (goes_on.counts, goes_on.last, goes_on.times) = ([0; 3], [None; 3], 0);
        for second in 1..=5 {
            let node = match second {
                1 | 3 | 4 => master.node,
                _ => meter.node,
            };
            if second < 5 {
                rig.inject(node, &[1, 2]);
            }
            rig.run_until(at(1_000 * second));
            goes_on.observe(&rig);
        }
        assert_eq!(goes_on.counts, [6, 2, 0]);
        assert_eq!(goes_on.last, [Some(at(4_000)), Some(at(2_000)), None]);
        assert_eq!(
            (goes_on.longest_pause, goes_on.times),
            (Duration::from_secs(2), 3)
        );
    }

    /// A program under test at the other end of the meter's wire; a device is none.
    #[test]
    fn the_program_under_test_is_a_node_of_this_role() {
        let rig = |role| {
            let mut rig = crate::rig::bare::rig();
            let own = rig.add_device("prog", NodeDevice::new(spec(role)));
            let [meter, pin] =
                ["meter", "pin"].map(|name| rig.add_outside(name, LineConfig::new_8n1(9600)));
            let end = |node| End {
                node,
                port: Port(0),
            };
            rig.connect("meter", end(meter), end(own), 1);
            rig.connect("pin", end(meter), end(pin), 1);
            rig
        };
        assert!(GoesOn::of(&rig(Role::Device)).is_none());
        let rig = rig(Role::Program);
        let goes_on = GoesOn::of(&rig).expect("a program");
        assert_eq!(
            (goes_on.name.as_str(), rig.node_name(goes_on.node)),
            ("prog", "prog")
        );
        assert!(goes_on.is_at(&rig, "meter") && goes_on.is_at(&rig, "prog"));
        assert!(!goes_on.is_at(&rig, "pin"));
    }

    /// The meter reads at half of the rate, or in another format.
    #[test]
    fn a_line_of_two_formats_is_garbage() {
        let garbled = |change: fn(&mut LineConfig), sends: bool| {
            let (mut rig, [[meter, master]]) = linked(["meter"], 1_000_000);
            let mut config = LineConfig::new_8n1(1_000_000);
            change(&mut config);
            rig.set_line_config(meter.node, config);
            let node = if sends { master.node } else { meter.node };
            rig.inject(node, &[0; 40]);
            rig.run_until(at(1_000));
            let mut goes_on = bench().goes_on;
            goes_on.node = master.node;
            goes_on.garbled(&rig)
        };
        assert_eq!(garbled(|_| {}, true), None);
        let half = "meter: program at 1000000 baud, expected 500000 baud: both sides read garbage";
        assert_eq!(
            garbled(|line| line.baud = 500_000, true).as_deref(),
            Some(half)
        );
        assert_eq!(garbled(|line| line.baud = 500_000, false), None);
        let format = "meter: program at 1000000 baud 8N1, expected 500000 baud 8E1: both sides \
                      read garbage";
        let even = |line: &mut LineConfig| (line.baud, line.parity) = (500_000, Parity::Even);
        assert_eq!(garbled(even, true).as_deref(), Some(format));
    }
}
