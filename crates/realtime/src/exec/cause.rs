//! The probable cause of a failed run: one sentence with the observation and the fix.
//!
//! Each rule examines the evidence independently and may propose a cause with a weight. The
//! heaviest cause is printed. A cause that explains others has a larger weight: a wrong baud rate
//! explains bad checksums. If no rule proposes a cause, the observations are printed.

mod devices;
mod end;
mod late;
mod motion;
mod port;
mod trigger;

use protocols::Instant;

use super::ports::Ports;
use crate::process::{Ended, waits::Wait};
use engine::run::Outcome;
use engine::run::check::Status;

/// Number of breaks of a rule from which they are a cause although no check judges them.
const MANY: u64 = 10;

/// Observations at the end of a run.
pub(crate) struct Evidence<'a> {
    /// Observations at the ports.
    pub(crate) ports: &'a Ports,
    /// Calls in which the program's threads waited at the end.
    pub(crate) waits: &'a [Wait],
    /// The program's own end and its time, if it ended by itself.
    pub(crate) ended: Option<(Ended, Instant)>,
    /// The last part of its output.
    pub(crate) said: &'a str,
    /// The judged run.
    pub(crate) outcome: &'a Outcome,
}

/// A proposed cause.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Cause {
    weight: u32,
    text: String,
}

impl Cause {
    const fn new(weight: u32, text: String) -> Self {
        Self { weight, text }
    }
}

/// Weights, the heaviest first: a cause that explains other findings comes before them.
mod weight {
    pub(super) const DEVICE: u32 = 110;
    pub(super) const RATE: u32 = 100;
    pub(super) const NOT_OPENED: u32 = 95;
    pub(super) const SETTING: u32 = 90;
    pub(super) const BUSY: u32 = 88;
    pub(super) const KILLED: u32 = 85;
    pub(super) const FORMAT: u32 = 80;
    pub(super) const HELD_UP: u32 = 78;
    pub(super) const UNREAD: u32 = 76;
    pub(super) const BLOCKED: u32 = 74;
    pub(super) const AFTER_FAULT: u32 = 72;
    pub(super) const NOTHING_SENT: u32 = 70;
    pub(super) const ADDRESS: u32 = 66;
    pub(super) const SILENT: u32 = 64;
    pub(super) const WATCHDOG: u32 = 60;
    pub(super) const LOST: u32 = 58;
    pub(super) const ORDER: u32 = 55;
    pub(super) const RULE: u32 = 52;
    pub(super) const LATE_DEVICE: u32 = 51;
    pub(super) const ENDED: u32 = 50;
    pub(super) const LATE: u32 = 49;
    pub(super) const MOTORS: u32 = 48;
    pub(super) const MOTION: u32 = 45;
    pub(super) const COLLISION: u32 = 35;
    pub(super) const FAULTED: u32 = 30;
    pub(super) const SCENARIO: u32 = 10;
}

/// The probable cause of the failure; `None` if the run passed.
pub(crate) fn probable(evidence: &Evidence<'_>) -> Option<String> {
    let mut checks = evidence.outcome.checks.iter();
    if !checks.any(|check| check.status == Status::Fail) {
        return undecided(evidence);
    }
    let mut causes = port::causes(evidence);
    causes.extend(end::causes(evidence));
    causes.extend(devices::causes(evidence));
    causes.extend(motion::causes(evidence));
    causes.extend(trigger::rules(evidence));
    causes.extend(late::causes(evidence));
    // Of two causes with equal weight, the first one stays first.
    causes.sort_by_key(|cause| core::cmp::Reverse(cause.weight));
    let mut causes = causes.into_iter();
    let Some(first) = causes.next() else {
        return Some(unknown(evidence));
    };
    // A cause with nearly the same weight may be the true one. Damage of bytes explains the other
    // findings, so only a second cause of this kind is printed beside it.
    let least = least_beside(first.weight);
    let next = causes.find(|next| next.weight >= least && next.text != first.text);
    Some(match next {
        Some(next) => format!("{}. Also: {}", first.text, next.text),
        None => first.text,
    })
}

/// The least weight of a second cause beside a first one of this weight.
fn least_beside(first: u32) -> u32 {
    match first {
        // Without its device, the program's behaviour says little.
        weight::DEVICE => u32::MAX,
        weight::SETTING.. => weight::SETTING,
        // A program that ends and leaves its motors on has two defects.
        weight::ENDED => weight::MOTORS,
        other => weight::ORDER.max(other.saturating_sub(20)),
    }
}

/// The reason why a run failed without a failed check: a rule that must be observed was not
/// observed. `None` if there is no such rule.
fn undecided(evidence: &Evidence<'_>) -> Option<String> {
    let open: Vec<String> = evidence
        .outcome
        .unobserved_rules()
        .map(|check| format!("{}: {}", check.name, check.detail))
        .collect();
    if open.is_empty() {
        return None;
    }
    let open = open.join("; ");
    Some(match &evidence.ended {
        Some((ended, at)) => format!(
            "the program ended with {ended} at {at} s, before a rule of the scenario was decided \
             ({open}): it did not do what the rule waits for, or the rule names something else"
        ),
        None => format!(
            "a rule of the scenario was not decided to the end ({open}): the program did not do \
             what the rule waits for, or the run is too short for it"
        ),
    })
}

/// The probable cause of the failure of a program that has no ports of the system: firmware on a
/// simulated board, or a node program. `None` if the run passed or no rule explains the failure.
pub fn in_lockstep(outcome: &Outcome) -> Option<String> {
    let mut checks = outcome.checks.iter();
    checks.find(|check| check.status == Status::Fail)?;
    let evidence = Evidence {
        ports: &Ports::default(),
        waits: &[],
        ended: None,
        said: "",
        outcome,
    };
    let mut causes = devices::causes(&evidence);
    causes.extend(motion::causes(&evidence));
    causes.extend(trigger::rules(&evidence));
    causes.extend(late::causes(&evidence));
    causes.extend(end::stopped(outcome));
    // The failed node program is the one under test.
    causes.retain(|cause| cause.weight != weight::DEVICE);
    causes.sort_by_key(|cause| core::cmp::Reverse(cause.weight));
    causes.into_iter().next().map(|cause| cause.text)
}

/// The observations, if no rule explains the failure.
fn unknown(evidence: &Evidence<'_>) -> String {
    let seen = evidence.ports.all.iter().filter(|port| port.was_opened);
    let traffic = seen.map(|port| {
        let (name, sent, brought) = (&port.name, port.from_client, port.to_client);
        format!("{name}: {sent} B sent, {brought} B received")
    });
    let mut observed: Vec<String> = traffic.collect();
    let failed = evidence.outcome.checks.iter();
    let failed = failed.filter(|check| check.status == Status::Fail);
    let failed: Vec<&str> = failed.map(|check| &*check.name).collect();
    observed.push(format!("failed: {}", failed.join(", ")));
    let sound = match trigger::all_in_words(evidence) {
        Some(faults) => format!(
            "faults of the scenario took effect: {faults}; line settings and rates are as they \
             should be"
        ),
        None => "line settings, rates and frames are as they should be".to_owned(),
    };
    format!("not known; {sound} ({})", observed.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A second cause is at most 20 below the first, and never below 55; the lowest weight is 10.
    #[test]
    fn a_second_cause_has_nearly_the_weight_of_the_first() {
        let weights = [
            weight::SCENARIO,
            weight::ORDER,
            weight::UNREAD,
            weight::HELD_UP,
        ];
        assert_eq!(weights.map(least_beside), [55, 55, 56, 58]);
        assert_eq!(least_beside(weight::ENDED), weight::MOTORS);
    }
}
