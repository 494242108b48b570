//! Causes that devices report: frames that they do not understand, unknown addresses, early
//! requests, a watchdog that fires, a device's program that fails.

use protocols::Instant;

use super::late::LATE;
use super::trigger::{Trigger, after, explains};
use super::{Cause, Evidence, MANY, weight};
use engine::rig::{Logged, NO_FRAME};
use engine::run::check::{NODE_PROGRAMS, NOT_UNDERSTOOD, Status, VIOLATIONS, WATCHDOG};
use engine::run::{Outcome, OwnBreaks};

/// Rules that mean: the frame is valid, but its request is unknown or not allowed.
const ADDRESS: [&str; 11] = [
    "unknown-register",
    "write-read-only",
    "value-cut",
    "out-of-range",
    "set-point-out-of-range",
    "open-channel",
    "window-outside",
    "mode-not-supported",
    "request-not-supported",
    "unknown-message",
    "count-too-large",
];
/// Those of them that mean: the value is beyond its limits.
const VALUES: [&str; 3] = ["value-cut", "out-of-range", "set-point-out-of-range"];
/// The rule that means: no device of the link has the address of the request.
const ASTRAY: &str = "wrong-address";
/// Rules that mean: the program did not wait for the device.
const ORDER: [&str; 8] = [
    "request-before-reply",
    "queue-full",
    "bytes-while-busy",
    "bytes-while-starting",
    "request-while-busy",
    "host-port-closed",
    "not-ready",
    "too-fast",
];

pub(super) fn causes(evidence: &Evidence<'_>) -> Vec<Cause> {
    let outcome = evidence.outcome;
    let mut causes = Vec::new();
    for device in devices(outcome) {
        let own = outcome.own_breaks.iter();
        let own: Vec<&OwnBreaks> = own
            .filter(|broken| broken.device == device && broken.count > 0)
            .filter(|broken| !is_missed(evidence, broken))
            .collect();
        let of = |is_of: &dyn Fn(&str) -> bool| -> Vec<&OwnBreaks> {
            let those = own.iter().filter(|broken| is_of(broken.rule));
            those.copied().collect()
        };
        let known = [
            &NOT_UNDERSTOOD[..],
            &ADDRESS,
            &ORDER,
            &WATCHDOG,
            &[ASTRAY],
            &LATE,
        ]
        .concat();
        causes.extend(astray(&device, &of(&|rule| rule == ASTRAY)));
        causes.extend(format(&device, &of(&|rule| NOT_UNDERSTOOD.contains(&rule))));
        causes.extend(address(
            evidence,
            &device,
            &of(&|rule| ADDRESS.contains(&rule)),
        ));
        causes.extend(order(evidence, &device, &of(&|rule| ORDER.contains(&rule))));
        causes.extend(other(
            evidence,
            &device,
            &of(&|rule| !known.contains(&rule)),
        ));
        causes.extend(damaged(evidence, &device));
    }
    causes.extend(watchdog(evidence));
    causes.extend(node_program(outcome));
    causes.extend(failed_expression(outcome));
    causes
}

/// A program in place of a device that failed: the program under test talks to nothing.
fn node_program(outcome: &Outcome) -> Option<Cause> {
    let mut checks = outcome.checks.iter();
    let failed =
        checks.find(|check| check.name == NODE_PROGRAMS && check.status == Status::Fail)?;
    let detail = &failed.detail;
    let text = format!(
        "the program that plays a device failed, not the program under test: {detail}; repair it \
         first (hilrig node check tests it alone)"
    );
    Some(Cause::new(weight::DEVICE, text))
}

/// An expression of a description that cannot be computed: the device does not do its work.
fn failed_expression(outcome: &Outcome) -> Option<Cause> {
    let mut events = outcome.events.iter();
    let first = events.find(|logged| logged.event.rule == "expression-failed")?;
    let (device, detail, at) = (&first.source, &first.event.detail, first.event.at);
    let text = format!(
        "an expression in the description of {device} fails, first at {at} s: {detail}; repair \
         the description first"
    );
    Some(Cause::new(weight::DEVICE, text))
}

/// Requests for an address that no device of the link has.
fn astray(device: &str, rules: &[&OwnBreaks]) -> Option<Cause> {
    let broken = rules.first()?;
    let count = broken.count;
    let first = broken.first.as_ref();
    let (at, detail) = first.map(|(at, detail)| (*at, detail.as_str()))?;
    let text = format!(
        "the program {detail}, {count} times on {device}, first at {at} s: no device answers it; \
         ask an address of the list, or add the device to the scenario"
    );
    Some(Cause::new(weight::ADDRESS, text))
}

/// Requests for unknown or forbidden addresses and values.
fn address(evidence: &Evidence<'_>, device: &str, rules: &[&OwnBreaks]) -> Option<Cause> {
    let told = told(rules)?;
    let text =
        format!("the program sends {device} a request that it does not support or allow: {told}");
    let at = first_break(rules).unwrap_or_default();
    let is_of_values = rules.iter().all(|broken| VALUES.contains(&broken.rule));
    let trigger = Trigger::from_device(evidence, at, device);
    let trigger = trigger.or_else(|| Trigger::of_values(evidence, at).filter(|_| is_of_values));
    let remedy = trigger.as_ref().and_then(Trigger::remedy);
    Some(match (trigger, remedy) {
        (Some(trigger), Some(remedy)) => {
            let words = trigger.words(at);
            Cause::new(weight::AFTER_FAULT, format!("{text}{words}; {remedy}"))
        }
        _ => {
            let swapped = first(rules).and_then(|(_, detail)| swapped(detail));
            let swapped = swapped.map_or_else(String::new, |swapped| {
                format!(" (with its bytes swapped it is {swapped}: compare the byte order as well)")
            });
            let text =
                format!("{text}{swapped}; compare addresses, widths and limits with its table");
            Cause::new(weight::ADDRESS, text)
        }
    })
}

/// Requests before the reply to the previous one.
fn order(evidence: &Evidence<'_>, device: &str, rules: &[&OwnBreaks]) -> Option<Cause> {
    let told = told(rules)?;
    let at = first_break(rules);
    let after = at.map_or_else(String::new, |at| after(evidence, at));
    let text = format!(
        "the program does not wait for {device}: {told}{after}; send the next request after the \
         reply or a timeout, and discard what was received until then: a late reply is not the \
         reply to the next request"
    );
    Some(Cause::new(weight::ORDER, text))
}

/// Rules of the device's own, e.g. `violation` in a description.
fn other(evidence: &Evidence<'_>, device: &str, rules: &[&OwnBreaks]) -> Option<Cause> {
    let told = told(rules)?;
    let after = first_break(rules).map(|at| after(evidence, at));
    let mut failed = evidence.outcome.checks.iter();
    let is_failed = failed.any(|check| check.name == VIOLATIONS && check.status == Status::Fail);
    let count: u64 = rules.iter().map(|broken| broken.count).sum();
    let weight = match is_failed || count >= MANY {
        true => weight::RULE,
        false => weight::COLLISION,
    };
    let text = format!("the program breaks a rule of {device}: {told}");
    Some(Cause::new(weight, text + &after.unwrap_or_default()))
}

/// The rules of `device` that are broken only because a fault damaged or delayed its frames. This
/// is the cause if there is no other.
fn damaged(evidence: &Evidence<'_>, device: &str) -> Option<Cause> {
    let broken = evidence.outcome.own_breaks.iter();
    let broken = broken.filter(|broken| broken.device == device && broken.explained > 0);
    let counts: Vec<String> = broken
        .map(|broken| format!("{} times {}", broken.explained, broken.rule))
        .collect();
    if counts.is_empty() {
        return None;
    }
    let counts = counts.join(", ");
    let text = format!(
        "faults damage or delay what {device} receives: {counts}; these are no mistakes of the \
         program, so judge violations after the faults (violations_from) or without these faults"
    );
    Some(Cause::new(weight::FAULTED, text))
}

/// Time and words of the first break of one of `rules`.
fn first<'a>(rules: &[&'a OwnBreaks]) -> Option<(Instant, &'a str)> {
    let all = rules.iter().filter_map(|broken| broken.first.as_ref());
    let first = all.min_by_key(|(at, _)| *at);
    first.map(|(at, detail)| (*at, &**detail))
}

/// The value in `speed = 10240, expected 0 to 1000` with its bytes swapped, if it is in range.
fn swapped(detail: &str) -> Option<i64> {
    let (_, rest) = detail.split_once(" = ")?;
    let (value, range) = rest.split_once(", expected ")?;
    let (least, most) = range.split_once(" to ")?;
    let [value, least, most] = [value, least, most].map(|text| text.trim().parse::<i64>().ok());
    let (value, least, most) = (value?, least?, most?);
    let narrow = i16::try_from(value).map(|value| value.swap_bytes().into());
    let wide = u16::try_from(value).map(|value| value.swap_bytes().into());
    let long = i32::try_from(value).map(|value| value.swap_bytes().into());
    let all: [Option<i64>; 3] = [wide.ok(), narrow.ok(), long.ok()];
    let in_range = |swapped: &i64| (least..=most).contains(swapped) && *swapped != 0;
    all.into_iter().flatten().find(in_range)
}

/// Time of the first break of one of `rules`.
fn first_break(rules: &[&OwnBreaks]) -> Option<Instant> {
    first(rules).map(|(at, _)| at)
}

/// Whether the device missed something only after the program had ended: that does not explain the
/// end.
fn is_missed(evidence: &Evidence<'_>, broken: &OwnBreaks) -> bool {
    let first = broken.first.as_ref().map(|(at, _)| *at);
    let ended = evidence.ended.as_ref().map(|(_, at)| *at);
    first
        .zip(ended)
        .is_some_and(|(first, ended)| first >= ended)
}

/// The devices with violations, each once.
fn devices(outcome: &Outcome) -> Vec<String> {
    let mut devices: Vec<String> = Vec::new();
    for (device, ..) in &outcome.broken_rules {
        if !devices.contains(device) {
            devices.push(device.clone());
        }
    }
    devices
}

/// Broken rules with their counts, and the first break of the most frequent one; `None` without
/// one.
fn told(rules: &[&OwnBreaks]) -> Option<String> {
    let mut rules = rules.to_vec();
    rules.sort_by_key(|broken| core::cmp::Reverse(broken.count));
    let worst = *rules.first()?;
    let counts: Vec<String> = rules
        .iter()
        .map(|broken| match broken.rule {
            NO_FRAME => "no frame is among them".to_owned(),
            rule => format!("{} times {rule}", broken.count),
        })
        .collect();
    let first = worst.first.as_ref();
    let first = first.map_or_else(String::new, |(at, detail)| match detail.is_empty() {
        true => format!(" (the first at {at} s)"),
        false => format!(" (the first at {at} s: {detail})"),
    });
    Some(counts.join(", ") + &first)
}

/// Frames of another format. One or two may be the rest of another mistake.
fn format(device: &str, rules: &[&OwnBreaks]) -> Option<Cause> {
    let told = told(rules)?;
    let count: u64 = rules.iter().map(|broken| broken.count).sum();
    let weight = match count {
        1 | 2 => weight::ORDER,
        _ => weight::FORMAT,
    };
    let has = |rule: &str| rules.iter().any(|broken| broken.rule == rule);
    let fix = match has("bad-checksum") {
        _ if has("missing-pause") => {
            "wait for the reply before the next request, and leave a silence of 3.5 characters \
             before it"
        }
        true => {
            "compare the checksum (which bytes it covers, its width and byte order), and whether \
             requests follow each other without a pause"
        }
        false => "compare header, length and end of its frames",
    };
    let text = format!("{device} does not understand the received bytes: {told}; {fix}");
    Some(Cause::new(weight, text))
}

/// Devices that stopped by their watchdog while the program was running.
fn watchdog(evidence: &Evidence<'_>) -> Option<Cause> {
    let until = evidence.ended.map(|(_, at)| at);
    let fired = evidence.outcome.events.iter().filter(|logged| {
        let event = &logged.event;
        WATCHDOG.contains(&event.rule) && until.is_none_or(|until| event.at < until)
    });
    // A fault that keeps the commands away is no pause of the program.
    let kept_away =
        |logged: &&Logged| Trigger::to_device(evidence, logged.event.at, &logged.source).is_some();
    let (kept, fired): (Vec<_>, Vec<_>) = fired.partition(kept_away);
    // A stop long before the failure does not explain it.
    let is_near = |logged: &&Logged| explains(evidence.outcome, logged.event.at);
    let (near, far): (Vec<_>, Vec<_>) = fired.into_iter().partition(is_near);
    let (weight, fired) = match near.is_empty() {
        false => (weight::WATCHDOG, near),
        true => (weight::FAULTED, far),
    };
    let Some(first) = fired.first() else {
        return kept.first().map(|first| by_fault(evidence, first));
    };
    let (device, at, times) = (&first.source, first.event.at, fired.len());
    let times = match times {
        1 => "once".to_owned(),
        times => format!("{times} times"),
    };
    let trigger = Trigger::from_device(evidence, at, device);
    let remedy = trigger.as_ref().and_then(Trigger::remedy);
    let (after, fix) = match (trigger, remedy) {
        (Some(trigger), Some(remedy)) => (trigger.words(at), remedy),
        _ => (String::new(), "repeat the command more often"),
    };
    Some(Cause::new(
        weight,
        format!(
            "the watchdog of {device} fired {times}, first at {at} s{after}: the program pauses \
             longer than it allows; {fix}"
        ),
    ))
}

/// A watchdog that fired because a fault kept the commands away: the cause if there is no other.
fn by_fault(evidence: &Evidence<'_>, fired: &Logged) -> Cause {
    let (device, at) = (&fired.source, fired.event.at);
    let trigger = Trigger::to_device(evidence, at, device);
    let after = trigger.map_or_else(String::new, |trigger| trigger.words(at));
    let text = format!(
        "the watchdog of {device} fired at {at} s{after}: the fault kept the commands from it"
    );
    Cause::new(weight::FAULTED, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 40 is 0x0028; 0x2800 is 10240. -2 is 0xFFFE; 0xFEFF is -257. 7 << 24 is 117440512.
    #[test]
    fn a_value_in_the_other_byte_order_is_recognised() {
        assert_eq!(swapped("power = 10240, expected 0 to 1000"), Some(40));
        assert_eq!(swapped("left = -257, expected -30 to 30"), Some(-2));
        assert_eq!(swapped("wide = 117440512, expected 0 to 9"), Some(7));
        for other in [
            "fan = 295, expected 0 to 100",
            "there is no register 7",
            "x = , expected",
        ] {
            assert_eq!(swapped(other), None, "{other}");
        }
    }
}
