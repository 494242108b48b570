//! The place at which a run fails: the time from which a check stays failed, and the call before
//! it.

use std::collections::{BTreeMap, BTreeSet};

use protocols::Instant;

use super::{Event, Session};
use crate::guest::GuestError;
use crate::guest::place::Moment;
use crate::guest::supervisor::{PortWrite, Stop};
use engine::run::check::{Check, Status};
use engine::run::{LOOK_EVERY, Outcome, is_of_the_end};

/// The place at which to stop for a failure.
#[derive(Clone, Debug)]
pub(super) enum Spot {
    /// At the beginning of a call.
    Call(Moment),
    /// At the signal of this number, counted from the start.
    Signal(u64),
    /// At a time of the rig.
    Time(Instant),
}

/// A failure and its place.
#[derive(Clone, Debug)]
pub(super) struct Failure {
    pub(super) spot: Spot,
    /// Message for the user: the check, its time and the reason.
    pub(super) what: String,
}

/// Observations during a run that are needed to find the place of its failure.
#[derive(Debug, Default)]
pub(super) struct Watch {
    next: Instant,
    /// For each failed check, the time since which it has failed.
    failing: BTreeMap<String, Instant>,
    signals: u64,
    /// The signal that ended the process: its number, counted from the start, and its time.
    died: Option<(u64, Instant)>,
}

impl Watch {
    fn look(&mut self, now: Instant, checks: Vec<Check>) {
        let failed = checks.into_iter();
        let failed = failed.filter(|check| check.status == Status::Fail);
        let names: Vec<String> = failed.map(|check| check.name).collect();
        self.failing.retain(|name, _| names.contains(name));
        for name in names {
            self.failing.entry(name).or_insert(now);
        }
        self.next = now + LOOK_EVERY;
    }

    /// The earliest failure of a run that has been judged; `None` if it passed.
    fn failure(&self, outcome: &Outcome, ended: Option<Instant>, log: &Log) -> Option<Failure> {
        let failed = outcome.checks.iter();
        let failed = failed.filter(|check| check.status == Status::Fail);
        let end = Instant::ZERO + outcome.ran;
        let when = |check: &Check| {
            let since = self.failing.get(&check.name).copied();
            let since = since.filter(|_| !is_of_the_end(&check.name));
            match check.name.as_str() {
                "program-alive" => ended.unwrap_or(end),
                _ => since.unwrap_or(end),
            }
        };
        let mut failed: Vec<(Instant, &Check)> = failed.map(|it| (when(it), it)).collect();
        failed.sort_by_key(|&(at, _)| at);
        let &(at, check) = failed.first()?;
        let spot = self.spot(at, check, outcome, log);
        let what = format!("{} fails at {at} s: {}", check.name, check.detail);
        Some(Failure { spot, what })
    }

    fn spot(&self, at: Instant, check: &Check, outcome: &Outcome, log: &Log) -> Spot {
        if check.name == "program-alive" {
            return self
                .died
                .map_or(Spot::Call(log.last), |(number, _)| Spot::Signal(number));
        }
        // A device logs the exact time; a check only notices the failure at its next look.
        let looked = at - Instant::ZERO;
        let from = Instant::ZERO + looked.saturating_sub(2 * LOOK_EVERY);
        let mut events = outcome.events.iter().filter(|it| it.is_violation());
        let event = events.find(|it| it.event.at >= from && it.event.at <= at);
        let at = event.map_or(at, |it| it.event.at);
        match log.write_before(at, event.map(|it| it.source.as_str())) {
            Some(moment) => Spot::Call(moment),
            None => Spot::Time(at),
        }
    }
}

/// The writes and calls of the program in a run.
#[derive(Debug, Default)]
struct Log {
    writes: Vec<PortWrite>,
    /// Names of the nodes that received the writes.
    names: BTreeMap<usize, String>,
    /// Start of the program's last call.
    last: Moment,
}

impl Log {
    /// The last write of which bytes had arrived at `at`: the last one to `device`, or else to any
    /// node.
    fn write_before(&self, at: Instant, device: Option<&str>) -> Option<Moment> {
        let mut before = self.writes.iter().rev().filter(|it| it.arrives <= at);
        let is_for = |it: &&PortWrite| {
            let name = it.to.and_then(|node| self.names.get(&node));
            name.is_some_and(|name| Some(name.as_str()) == device)
        };
        let found = before.clone().find(is_for).or_else(|| before.next());
        found.map(|it| it.moment)
    }
}

/// A first run that reached its end.
pub(super) enum First {
    Passed,
    Failed(Failure),
    /// The caller stopped the session.
    Cut,
}

impl Session<'_> {
    /// Runs the program once at full speed, to find where it fails.
    pub(super) fn find_failure(&mut self) -> Result<First, GuestError> {
        let mut watch = Watch::default();
        let (mut ended, mut last_signal) = (None, None);
        loop {
            if !(self.goes_on)() {
                return Ok(First::Cut);
            }
            let event = self.run_turn()?;
            let now = self.trial().now();
            match event {
                Some(Event::Over) => break,
                Some(Event::Stop(Stop::Signal(_, signal))) => {
                    watch.signals += 1;
                    last_signal = Some((watch.signals, signal));
                }
                Some(Event::Stop(Stop::Ended(status))) => {
                    ended = Some(now);
                    // The process was ended by a signal: take the last one that it received.
                    // SIGKILL causes no stop before the end.
                    let last = last_signal.filter(|&(_, signal)| status & 0x7F == signal);
                    watch.died = last.map(|(number, _)| (number, now));
                }
                _ => {}
            }
            if now >= watch.next && self.trial().has_begun() {
                let checks = self.trial().run().checks();
                watch.look(now, checks);
            }
        }
        let debugging = self.supervisor().debugging();
        let (writes, last) = debugging.map(|it| it.take_log()).unwrap_or_default();
        let nodes: BTreeSet<usize> = writes.iter().filter_map(|it| it.to).collect();
        let rig = &self.trial().run().rig;
        let names = nodes.into_iter();
        let names = names.map(|node| (node, rig.node_name(node).to_owned()));
        let log = Log {
            names: names.collect(),
            writes,
            last,
        };
        self.supervisor().end_debugging();
        let Some(trial) = self.trial.take() else {
            return Ok(First::Cut);
        };
        self.computing = trial.supervisor_ref().computing().cloned();
        let played = trial.end();
        let failure = watch.failure(&played.outcome, ended, &log);
        self.first = Some(Box::new(played));
        Ok(failure.map_or(First::Passed, First::Failed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A write that waits behind another one is not the cause of a device's report at the end of
    /// the first. Bytes to another device are no cause either.
    #[test]
    fn the_write_of_a_failure_is_the_last_that_had_arrived() {
        let write = |millis: u64, to, calls| PortWrite {
            arrives: Instant::from_nanos(millis * 1_000_000),
            to: Some(to),
            moment: Moment { calls, leaps: 0 },
        };
        let log = Log {
            writes: vec![write(10, 0, 1), write(21, 0, 2), write(15, 1, 3)],
            names: [(0, "base".to_owned()), (1, "sonar".to_owned())].into(),
            last: Moment::default(),
        };
        let found = |millis: u64, device| {
            let at = Instant::from_nanos(millis * 1_000_000);
            log.write_before(at, device).map(|moment| moment.calls)
        };
        assert_eq!(found(20, Some("base")), Some(1));
        assert_eq!(found(20, Some("sonar")), Some(3));
        assert_eq!(found(21, Some("base")), Some(2));
        assert_eq!(found(20, Some("rules")), Some(3));
        assert_eq!(found(9, None), None);
    }

    fn failed(name: &str) -> Check {
        Check::new(name, false, format!("detail of {name}"))
    }

    fn outcome(checks: Vec<Check>) -> Outcome {
        let (scenario, source) = engine::scenario::Scenario::from_text(
            "schema = 1\nname = \"x\"\nrobot = \"none\"\nduration = \"1s\"\n\
             device.x.text = { baud = 9600 }\n",
        )
        .expect("valid");
        let run = engine::run::Run::new(scenario, &source, None).expect("it starts");
        let mut outcome = run.judge();
        outcome.ran = core::time::Duration::from_secs(9);
        outcome.checks = checks;
        outcome.events = Vec::new();
        outcome
    }

    /// A check that fails again after a pass fails since then.
    #[test]
    fn a_check_fails_since_it_last_passed() {
        let at = Instant::from_millis;
        let mut watch = Watch::default();
        let passed = |name: &str| Check::new(name, true, String::new());
        watch.look(at(100), vec![failed("a"), failed("b"), passed("c")]);
        assert_eq!(watch.next, at(100) + LOOK_EVERY);
        watch.look(at(200), vec![passed("a"), failed("b"), failed("c")]);
        watch.look(at(300), vec![failed("a"), failed("b"), failed("c")]);
        let since: Vec<(&str, Instant)> = watch
            .failing
            .iter()
            .map(|(name, at)| (&**name, *at))
            .collect();
        assert_eq!(since, [("a", at(300)), ("b", at(100)), ("c", at(200))]);
    }

    #[test]
    fn the_earliest_failure_is_the_one() {
        let at = Instant::from_millis;
        let mut watch = Watch::default();
        watch.look(at(2_000), vec![failed("b")]);
        watch.look(at(3_000), vec![failed("a"), failed("b")]);
        let log = Log {
            last: Moment {
                calls: 77,
                leaps: 0,
            },
            ..Log::default()
        };
        let found = |checks: Vec<Check>, ended| {
            let failure = watch.failure(&outcome(checks), ended, &log)?;
            Some((failure.what, failure.spot))
        };
        assert!(found(vec![Check::new("a", true, String::new())], None).is_none());
        let (what, spot) = found(vec![failed("a"), failed("b")], None).expect("two");
        assert_eq!(what, "b fails at 2.000000 s: detail of b");
        assert!(matches!(spot, Spot::Time(since) if since == at(2_000)));
        // One that never failed before the end, and the program's own end.
        let (what, _) = found(vec![failed("z")], None).expect("one");
        assert_eq!(what, "z fails at 9.000000 s: detail of z");
        let checks = || vec![failed("a"), failed("program-alive")];
        let (what, spot) = found(checks(), Some(at(500))).expect("two");
        assert_eq!(
            what,
            "program-alive fails at 0.500000 s: detail of program-alive"
        );
        assert!(matches!(spot, Spot::Call(moment) if moment.calls == 77));
        let (what, _) = found(checks(), None).expect("two");
        assert_eq!(what, "a fails at 3.000000 s: detail of a");
        let died = Watch {
            died: Some((3, at(500))),
            ..Watch::default()
        };
        let failure = died
            .failure(&outcome(checks()), Some(at(500)), &log)
            .expect("two");
        assert!(matches!(failure.spot, Spot::Signal(3)));
    }

    /// The write before the failure is the place, if there is one.
    #[test]
    fn the_place_of_a_failure_is_the_write_before_it() {
        let at = Instant::from_millis;
        let mut watch = Watch::default();
        watch.look(at(2_000), vec![failed("a")]);
        let write = |millis, calls| PortWrite {
            arrives: at(millis),
            to: None,
            moment: Moment { calls, leaps: 0 },
        };
        let log = Log {
            writes: vec![write(1_999, 5), write(2_001, 6)],
            ..Log::default()
        };
        let failure = watch
            .failure(&outcome(vec![failed("a")]), None, &log)
            .expect("one");
        assert!(matches!(failure.spot, Spot::Call(moment) if moment.calls == 5));
    }
}
