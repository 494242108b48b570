//! Causes that lie in how the program ended.

use super::{Cause, Evidence, weight};
use crate::process::Ended;
use engine::run::check::Status;

pub(super) fn causes(evidence: &Evidence<'_>) -> Vec<Cause> {
    own(evidence)
        .into_iter()
        .chain(left_behind(evidence))
        .collect()
}

/// What the program started and did not end.
fn left_behind(evidence: &Evidence<'_>) -> Option<Cause> {
    let mut checks = evidence.outcome.checks.iter();
    let left = checks.find(|check| check.name == "no-children-left")?;
    (left.status == Status::Fail).then(|| {
        let detail = &left.detail;
        Cause::new(
            weight::COLLISION,
            format!("processes that the program started outlive it ({detail}); let it end them"),
        )
    })
}

/// The program's own end.
fn own(evidence: &Evidence<'_>) -> Option<Cause> {
    let (ended, at) = evidence.ended?;
    let checks = &evidence.outcome.checks;
    let mut alive = checks.iter().filter(|check| check.name == "program-alive");
    if alive.all(|check| check.status != Status::Fail) {
        return None;
    }
    let last = evidence.said.lines().rev().map(str::trim);
    let last = last.clone().find(|line| !line.is_empty());
    let words = last.map_or_else(String::new, |line| format!("; its last words: {line}"));
    let after = after_fault(evidence, at);
    Some(match ended {
        Ended::Signal(_) => Cause::new(
            weight::KILLED,
            format!("the program was killed by {ended} at {at} s{after}{words}"),
        ),
        Ended::Code(0) => Cause::new(
            weight::ENDED,
            format!(
                "the program ended with exit code 0 at {at} s, before the run was over; if that is \
                 right, allow it with --exec-may-end"
            ),
        ),
        Ended::Code(_) => Cause::new(
            weight::ENDED,
            format!("the program gave up with {ended} at {at} s{after}{words}"),
        ),
    })
}

/// The fault that began last before `at`, if that was not long ago.
fn after_fault(evidence: &Evidence<'_>, at: protocols::Instant) -> String {
    let mut begun = evidence.outcome.events.iter().filter(|logged| {
        let event = &logged.event;
        event.rule.starts_with("fault-") && event.at <= at && at - event.at <= SOON
    });
    begun.next_back().map_or_else(String::new, |logged| {
        format!(", after {} at {} s", logged.event.detail, logged.event.at)
    })
}

/// What a fault does shows within this time.
const SOON: core::time::Duration = core::time::Duration::from_secs(5);
