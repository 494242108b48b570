//! Whether a program under test works until the end: the limits for processes at ports and for
//! node programs, and the evidence of devices and of the mission.

use core::time::Duration;

use protocols::Instant;

use super::{Check, Status};
use crate::rig::NO_FRAME;
use crate::run::OwnBreaks;

#[cfg(feature = "programs")]
pub(crate) mod node;

/// Name of the check.
pub const GOES_ON: &str = "program-goes-on";
/// Rig time for which any program may be silent.
pub const SILENT_MAX: Duration = Duration::from_secs(2);
/// A program may be silent for this many times its longest pause so far.
pub const PAUSES_MAX: u32 = 3;
/// A device that sends this long after its last request sends without requests.
pub const STREAM: Duration = Duration::from_secs(1);
/// Minimum number of frames that a device does not understand until they count as an error, and
/// maximum number of sent bytes per such frame.
const FEW: u64 = 3;
const FRAME: u64 = 16;

/// Rules that mean: the device does not understand its input.
pub const NOT_UNDERSTOOD: [&str; 17] = [
    NO_FRAME,
    "bad-checksum",
    "stray-bytes",
    "frame-cut-off",
    "framing-error",
    "bad-frame",
    "bad-length",
    "bad-message",
    "bad-row",
    "request-damaged",
    "request-cut",
    "request-unknown",
    "unknown-request",
    "unknown-command",
    "line-too-long",
    "gap-in-frame",
    "missing-pause",
];

/// Rules that mean: the device understands the request, but has no answer to it.
const UNANSWERABLE: [&str; 5] = [
    "wrong-address",
    "unknown-register",
    "unknown-function",
    "unknown-message",
    "bad-request",
];

/// Number of times that devices did not understand or refused a request that no fault damaged.
pub fn misunderstood(broken: &[OwnBreaks]) -> u64 {
    let is_wrong = |rule: &str| NOT_UNDERSTOOD.contains(&rule) || UNANSWERABLE.contains(&rule);
    let format = broken.iter().filter(|broken| is_wrong(broken.rule));
    format.map(|broken| broken.count).sum()
}

/// Requests that are repeated to the end of a run, at `end`, and that no device can answer, because
/// none has their address. A search for devices at the start is no mistake.
pub fn astray(broken: &[OwnBreaks], end: Instant) -> Option<String> {
    let mut broken = broken.iter().filter(|broken| {
        let lasts = |last: Instant| last.as_nanos() >= end.as_nanos() / 4 * 3;
        broken.rule == "wrong-address" && broken.count >= FEW && broken.last.is_some_and(lasts)
    });
    let found = broken.next()?;
    let (device, count) = (&found.device, found.count);
    let detail = found.first.as_ref().map(|(_, detail)| detail.as_str());
    let detail = detail.unwrap_or("asked an address that no device of the link has");
    Some(format!("{count} times it {detail}, on {device}"))
}

/// Whether frames that devices did not understand are an error: there are some, and nothing arrived
/// for the program, or they are a large part of the `sent` bytes.
pub const fn is_misunderstood(times: u64, sent: u64, arrived: u64) -> bool {
    (arrived == 0 && times > 0) || (times >= FEW && times * FRAME >= sent)
}

/// The reason why nothing was observed of a program: no device received its bytes, and no rule of
/// the scenario observed it.
pub fn unheard(checks: &[Check]) -> Option<&'static str> {
    let is_observed = |check: &Check| {
        let is_own = ["rule-", "mission-step-"]
            .iter()
            .any(|own| check.name.starts_with(own));
        is_own && check.status == Status::Pass
    };
    let why = "no device received a byte, because each was off, unplugged or cut off to the end: \
               nothing was observed; let the fault end earlier, or add a rule that observes the \
               program";
    (!checks.iter().any(is_observed)).then_some(why)
}

/// Whether the checks of the mission show that the program's work is done: then it may rest.
pub fn is_done(checks: &[Check]) -> bool {
    let says = |check: &Check| {
        let names = ["waypoints-visited", "returned", "home", "at-work-again"];
        names.contains(&&*check.name) || check.name.starts_with("mission-step-")
    };
    let mut of_work = checks.iter().filter(|check| says(check)).peekable();
    of_work.peek().is_some() && of_work.all(|check| check.status == Status::Pass)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn broken(rule: &'static str, count: u64, last_s: u64) -> OwnBreaks {
        OwnBreaks {
            device: "meter".to_owned(),
            rule,
            count,
            explained: 0,
            first: Some((Instant::ZERO, "asked address 7".to_owned())),
            last: Some(Instant::from_secs(last_s)),
        }
    }

    /// With nothing in return, one frame that was not understood is enough. Otherwise there have to
    /// be three, and one for each 16 sent bytes.
    #[test]
    fn frames_that_were_not_understood_are_an_error_if_they_are_many() {
        assert!(!is_misunderstood(0, 9, 0) && is_misunderstood(1, 900, 0));
        assert!(!is_misunderstood(2, 9, 5) && is_misunderstood(3, 48, 5));
        assert!(!is_misunderstood(3, 49, 5) && is_misunderstood(4, 64, 5));
    }

    #[test]
    fn requests_that_a_device_refused_are_counted() {
        let all = [
            broken("bad-checksum", 2, 0),
            broken("too-soon", 9, 0),
            broken("unknown-register", 3, 0),
        ];
        assert_eq!((misunderstood(&all), misunderstood(&[])), (5, 0));
    }

    /// Three requests to a wrong address, the last of them in the last quarter of the run.
    #[test]
    fn requests_to_nobody_are_told_if_they_last() {
        let at = |rule, count, last| astray(&[broken(rule, count, last)], Instant::from_secs(40));
        let words = "3 times it asked address 7, on meter";
        assert_eq!(at("wrong-address", 3, 30).as_deref(), Some(words));
        assert_eq!(at("wrong-address", 3, 29), None);
        assert_eq!(
            (at("wrong-address", 2, 40), at("bad-checksum", 9, 40)),
            (None, None)
        );
    }

    #[test]
    fn work_is_done_if_all_its_checks_have_passed() {
        let check = |name: &str, passed| Check::new(name, passed, "");
        let done = |list: &[(&str, bool)]| {
            let checks: Vec<Check> = list
                .iter()
                .map(|&(name, passed)| check(name, passed))
                .collect();
            is_done(&checks)
        };
        assert!(done(&[("waypoints-visited", true), ("other", false)]));
        assert!(done(&[
            ("mission-step-2", true),
            ("returned", true),
            ("home", true)
        ]));
        assert!(!done(&[("other", true)]) && !done(&[]));
        assert!(!done(&[("at-work-again", false), ("home", true)]));
    }

    /// A rule or a step of the scenario that passed has observed the program.
    #[test]
    fn a_program_that_no_device_hears_is_observed_by_rules() {
        let check = |name: &str, passed| [Check::new(name, passed, "")];
        assert!(unheard(&check("rule-answers", true)).is_none());
        assert!(unheard(&check("mission-step-1", true)).is_none());
        assert!(unheard(&check("rule-answers", false)).is_some());
        assert!(unheard(&check("other", true)).is_some() && unheard(&[]).is_some());
    }
}
