//! Causes at the end of a program.

use super::trigger::after;
use super::{Cause, Evidence, weight};
use crate::process::Ended;
use engine::run::check::{Check, STOPS, Status, last_words};

pub(super) fn causes(evidence: &Evidence<'_>) -> Vec<Cause> {
    own(evidence)
        .into_iter()
        .chain(busy(evidence))
        .chain(motors(evidence))
        .chain(left_behind(evidence))
        .collect()
}

/// The failed check called `name`.
fn failed<'a>(evidence: &'a Evidence<'_>, name: &str) -> Option<&'a Check> {
    let mut checks = evidence.outcome.checks.iter();
    checks.find(|check| check.name == name && check.status == Status::Fail)
}

/// A loop that never waits.
fn busy(evidence: &Evidence<'_>) -> Option<Cause> {
    let detail = &failed(evidence, "program-yields")?.detail;
    let fix = match detail.contains("hung up") {
        true => {
            "; a read of 0 bytes or EIO there means that the device is unplugged: close the port \
             and open it again"
        }
        false => "; let it wait for its ports with a timeout, e.g. in poll, select or a read",
    };
    Some(Cause::new(
        weight::BUSY,
        format!("the program never waits: {detail}{fix}"),
    ))
}

/// Motors that keep running after the program's end.
fn motors(evidence: &Evidence<'_>) -> Option<Cause> {
    let detail = &failed(evidence, STOPS)?.detail;
    Some(Cause::new(
        weight::MOTORS,
        format!(
            "motors keep running without commands ({detail}); give the device a watchdog, or let \
             the program stop the motors when it ends"
        ),
    ))
}

/// Processes that the program started and did not end.
fn left_behind(evidence: &Evidence<'_>) -> Option<Cause> {
    let mut checks = evidence.outcome.checks.iter();
    let left = checks.find(|check| check.name == "no-children-left")?;
    (left.status == Status::Fail).then(|| {
        let detail = &left.detail;
        Cause::new(
            weight::COLLISION,
            format!("child processes outlive the program ({detail}); let the program end them"),
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
    let words = last_words(evidence.said)
        .map_or_else(String::new, |line| format!("; its last words: {line}"));
    let after = after(evidence, at);
    Some(match ended {
        Ended::Signal(_) => Cause::new(
            weight::KILLED,
            format!("the program was killed by {ended} at {at} s{after}{words}"),
        ),
        Ended::Code(0) => Cause::new(
            weight::ENDED,
            format!(
                "the program ended with exit code 0 at {at} s{after}, before the run was over; if that \
                 is right, allow it with --exec-may-end, or in a file with may_end of its exec table"
            ),
        ),
        Ended::Code(_) => Cause::new(
            weight::ENDED,
            format!("the program gave up with {ended} at {at} s{after}{words}"),
        ),
    })
}
