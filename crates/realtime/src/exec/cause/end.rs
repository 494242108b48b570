//! Causes at the end of a program.

use super::super::verdict::CRASHED;
use super::trigger::after;
use super::{Cause, Evidence, weight};
use crate::process::Ended;
use engine::run::Outcome;
use engine::run::check::{Check, GOES_ON, STOPS, Status, last_words};

pub(super) fn causes(evidence: &Evidence<'_>) -> Vec<Cause> {
    own(evidence)
        .into_iter()
        .chain(crashed(evidence))
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

/// A crash after SIGTERM.
fn crashed(evidence: &Evidence<'_>) -> Option<Cause> {
    let detail = &failed(evidence, "program-alive")?.detail;
    let (before, how) = detail.split_once(CRASHED)?;
    let how = how.split(';').next().unwrap_or_default();
    let program = in_words(name_before(before, " to the end; "));
    let words = last_words(evidence.said);
    let words = words.map_or_else(String::new, |line| format!("; its last words: {line}"));
    Some(Cause::new(
        weight::MOTORS,
        format!("{program} crashed while it ended, after SIGTERM:{how}{words}"),
    ))
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
    let failed = alive.find(|check| check.status == Status::Fail)?;
    // Several programs have names, and one log.
    let end = format!(" ended with {ended} at {at} s");
    let before = failed
        .detail
        .find(&end)
        .map(|place| &failed.detail[..place + end.len()]);
    let name = before.and_then(|before| name_before(before, &end));
    let program = in_words(name);
    let words = match name {
        None => last_words(evidence.said),
        Some(_) => failure(evidence.said),
    };
    let words = words.map_or_else(String::new, |line| format!("; its last words: {line}"));
    let after = after(evidence, at);
    Some(match ended {
        Ended::Signal(_) => Cause::new(
            weight::KILLED,
            format!("{program} was killed by {ended} at {at} s{after}{words}"),
        ),
        Ended::Code(0) => Cause::new(
            weight::ENDED,
            format!(
                "{program} ended with exit code 0 at {at} s{after}, before the run was over; if that \
                 is right, allow it with --exec-may-end, or in a file with may_end of its exec table"
            ),
        ),
        Ended::Code(_) => Cause::new(
            weight::ENDED,
            format!("{program} gave up with {ended} at {at} s{after}{words}"),
        ),
    })
}

/// The name of the program whose words end with `end`: the verdict on several programs has the name
/// of each before its words, and `;` between them.
fn name_before<'a>(words: &'a str, end: &str) -> Option<&'a str> {
    let name = words.strip_suffix(end)?.rsplit("; ").next()?;
    (!name.is_empty()).then_some(name)
}

fn in_words(name: Option<&str>) -> String {
    name.map_or("the program".to_owned(), |name| {
        format!("the program {name}")
    })
}

/// Firmware or a node program that does not continue: its check has the reason.
pub(super) fn stopped(outcome: &Outcome) -> Option<Cause> {
    let mut checks = outcome.checks.iter();
    let failed = |check: &&Check| check.name == GOES_ON && check.status == Status::Fail;
    let detail = &checks.find(failed)?.detail;
    let has = |words: &str| detail.contains(words);
    let (weight, remedy) = match detail {
        _ if has("both sides read garbage") => (
            weight::RATE,
            "; set its UART to the rate of the device, by the clock of the board",
        ),
        _ if has("the firmware crashed") => (
            weight::KILLED,
            "; find the instruction of this address in the ELF file (addr2line), e.g. an array \
             that is written behind its end, or a wrong pointer",
        ),
        _ if has("its watchdog reset it") => (
            weight::KILLED,
            "; find where it hangs, e.g. with --gdb PORT",
        ),
        _ if has("its last sign of life") => (
            weight::SILENT,
            "; it hangs, sleeps, or waits for bytes that do not come: give each wait a timeout",
        ),
        _ => return None,
    };
    Some(Cause::new(
        weight,
        format!("the program does not go on: {detail}{remedy}"),
    ))
}

/// The last line that tells of a failure.
fn failure(said: &str) -> Option<&str> {
    let tells = |line: &&str| {
        let words = ["Error", "Exception", "error", "panicked"];
        words.iter().any(|word| line.contains(word))
    };
    said.lines().rev().map(str::trim).find(tells)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The name of the program that ended is that of its own words, wherever it is in the list.
    #[test]
    fn of_several_programs_the_ended_one_is_named() {
        let end = " ended with exit code 3 at 1.5 s";
        for (words, name) in [
            ("planner ended with exit code 3 at 1.5 s", Some("planner")),
            (
                "driver to the end; planner ended with exit code 3 at 1.5 s",
                Some("planner"),
            ),
            (
                "driver to the end; exit code 1 after SIGTERM; wheel/arm ended with exit code 3 at \
                 1.5 s",
                Some("wheel/arm"),
            ),
            ("ended with exit code 3 at 1.5 s", None),
        ] {
            assert_eq!(name_before(words, end), name, "{words}");
        }
        let crashed = "a to the end; b to the end; ";
        assert_eq!(name_before(crashed, " to the end; "), Some("b"));
        assert_eq!(name_before("to the end; ", " to the end; "), None);
    }
}
