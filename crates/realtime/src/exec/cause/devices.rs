//! Causes that devices tell: frames that they do not understand, addresses that they do not have,
//! requests that come too early, a watchdog that fires.

use super::{Cause, Evidence, weight};
use engine::run::Outcome;
use engine::run::check::WATCHDOG;
use engine::scenario::{DirectionSpec, FaultSpec};

/// Rules that say: the device does not understand what it is sent.
const FORMAT: [&str; 14] = [
    "bad-checksum",
    "stray-bytes",
    "frame-cut-off",
    "framing-error",
    "bad-frame",
    "bad-message",
    "bad-row",
    "request-damaged",
    "request-cut",
    "request-unknown",
    "unknown-request",
    "unknown-command",
    "line-too-long",
    "gap-in-frame",
];
/// Rules that say: the frame is sound, and what it asks for is not there or not allowed.
const ADDRESS: [&str; 10] = [
    "unknown-register",
    "write-read-only",
    "value-cut",
    "out-of-range",
    "set-point-out-of-range",
    "open-channel",
    "window-outside",
    "mode-not-supported",
    "request-not-supported",
    "count-too-large",
];
/// Rules that say: it was not waited for.
const ORDER: [&str; 6] = [
    "request-before-reply",
    "queue-full",
    "bytes-while-busy",
    "bytes-while-starting",
    "request-while-busy",
    "host-port-closed",
];

/// How often devices did not understand what they were sent.
pub(crate) fn misunderstood(outcome: &Outcome) -> u64 {
    let broken = outcome.broken_rules.iter();
    let format =
        broken.filter(|(device, rule, _)| FORMAT.contains(rule) && !is_struck(outcome, device));
    format.map(|(.., count)| count).sum()
}

/// Whether a fault damages what `device` is sent.
fn is_struck(outcome: &Outcome, device: &str) -> bool {
    let damages = |fault: &FaultSpec| {
        fault.place().starts_with(device) && fault.direction != Some(DirectionSpec::ToMaster)
    };
    outcome.case.fault.iter().any(damages)
}

pub(super) fn causes(evidence: &Evidence<'_>) -> Vec<Cause> {
    let outcome = evidence.outcome;
    let mut causes = Vec::new();
    for device in devices(outcome) {
        let of = |rules: &[&str]| {
            let broken = outcome.broken_rules.iter();
            let those = broken.filter(|(name, rule, _)| *name == device && rules.contains(rule));
            those
                .map(|(_, rule, count)| (*rule, *count))
                .collect::<Vec<_>>()
        };
        causes.extend(format(outcome, &device, &of(&FORMAT)));
        causes.extend(told(outcome, &device, &of(&ADDRESS)).map(|told| {
            let text = format!(
                "the program asks {device} for what it does not have or allow: {told}; compare \
                 addresses, widths and limits with its table"
            );
            Cause::new(weight::ADDRESS, text)
        }));
        causes.extend(told(outcome, &device, &of(&ORDER)).map(|told| {
            let text = format!(
                "the program does not wait for {device}: {told}; send the next request when the \
                 reply has come, or after a timeout"
            );
            Cause::new(weight::ORDER, text)
        }));
    }
    causes.extend(watchdog(evidence));
    causes
}

/// The devices of which a rule was broken, each once.
fn devices(outcome: &Outcome) -> Vec<String> {
    let mut devices: Vec<String> = Vec::new();
    for (device, ..) in &outcome.broken_rules {
        if !devices.contains(device) {
            devices.push(device.clone());
        }
    }
    devices
}

/// Rules with their counts, and what the first break was; `None` if there is none.
fn told(outcome: &Outcome, device: &str, rules: &[(&str, u64)]) -> Option<String> {
    let mut rules = rules.to_vec();
    rules.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
    let (worst, _) = *rules.first()?;
    let counts: Vec<String> = rules
        .iter()
        .map(|(rule, count)| format!("{count} times {rule}"))
        .collect();
    let mut events = outcome.events.iter();
    let first = events.find(|logged| logged.source == device && logged.event.rule == worst);
    let first = first.map_or_else(String::new, |logged| {
        format!(
            " (the first at {} s: {})",
            logged.event.at, logged.event.detail
        )
    });
    Some(counts.join(", ") + &first)
}

/// Frames of another format. A fault that damages what the device is sent may be why, and then that
/// weighs little.
fn format(outcome: &Outcome, device: &str, rules: &[(&str, u64)]) -> Option<Cause> {
    let told = told(outcome, device, rules)?;
    let count: u64 = rules.iter().map(|(_, count)| count).sum();
    let struck = is_struck(outcome, device);
    let weight = match (struck, count) {
        (true, _) => weight::COLLISION,
        (false, 1 | 2) => weight::ORDER,
        (false, _) => weight::FORMAT,
    };
    let sums = rules.iter().any(|(rule, _)| *rule == "bad-checksum");
    let fix = match sums {
        true => "compare the checksum (which bytes it covers, its width and byte order)",
        false => "compare header, length and end of its frames",
    };
    let text = format!("{device} does not understand what it is sent: {told}; {fix}");
    Some(Cause::new(weight, text))
}

/// Devices that stopped by themselves while the program was still there.
fn watchdog(evidence: &Evidence<'_>) -> Option<Cause> {
    let until = evidence.ended.map(|(_, at)| at);
    let fired = evidence.outcome.events.iter().filter(|logged| {
        let event = &logged.event;
        WATCHDOG.contains(&event.rule) && until.is_none_or(|until| event.at < until)
    });
    let fired: Vec<_> = fired.collect();
    let first = fired.first()?;
    let (device, at, times) = (&first.source, first.event.at, fired.len());
    let times = match times {
        1 => "once".to_owned(),
        times => format!("{times} times"),
    };
    Some(Cause::new(
        weight::WATCHDOG,
        format!(
            "the watchdog of {device} fired {times}, first at {at} s: the program pauses longer \
             than it allows; repeat the command more often"
        ),
    ))
}
