//! The probable cause of a run that failed: one sentence with what was observed and what to change.
//!
//! Each rule looks at the evidence by itself and may propose a cause with a weight; the heaviest is
//! told. A cause that explains others (a wrong baud rate explains bad checksums) weighs more. If no
//! rule proposes one, what was observed is told instead.

mod devices;
mod end;
mod motion;
mod port;
mod trigger;

use protocols::Instant;

use super::ports::Ports;
use crate::process::{Ended, waits::Wait};
use engine::run::Outcome;
use engine::run::check::Status;

pub(crate) use devices::misunderstood;

/// What is known of a run in the end.
pub(crate) struct Evidence<'a> {
    /// What was seen at the ports.
    pub(crate) ports: &'a Ports,
    /// What the program's threads waited for in the end.
    pub(crate) waits: &'a [Wait],
    /// How the program ended by itself, and when.
    pub(crate) ended: Option<(Ended, Instant)>,
    /// The end of its output.
    pub(crate) said: &'a str,
    /// The judged run.
    pub(crate) outcome: &'a Outcome,
}

/// A cause that is proposed.
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

/// Weights, the heaviest first: what explains other findings comes before them.
mod weight {
    pub(super) const RATE: u32 = 100;
    pub(super) const NOT_OPENED: u32 = 95;
    pub(super) const SETTING: u32 = 90;
    pub(super) const BUSY: u32 = 88;
    pub(super) const KILLED: u32 = 85;
    pub(super) const FORMAT: u32 = 80;
    pub(super) const UNREAD: u32 = 76;
    pub(super) const BLOCKED: u32 = 74;
    pub(super) const AFTER_FAULT: u32 = 72;
    pub(super) const NOTHING_SENT: u32 = 70;
    pub(super) const ADDRESS: u32 = 66;
    pub(super) const SILENT: u32 = 64;
    pub(super) const WATCHDOG: u32 = 60;
    pub(super) const LOST: u32 = 58;
    pub(super) const ORDER: u32 = 55;
    pub(super) const ENDED: u32 = 50;
    pub(super) const MOTORS: u32 = 48;
    pub(super) const MOTION: u32 = 45;
    pub(super) const COLLISION: u32 = 35;
}

/// The probable cause of what failed; `None` if nothing did.
pub(crate) fn probable(evidence: &Evidence<'_>) -> Option<String> {
    let mut checks = evidence.outcome.checks.iter();
    if !checks.any(|check| check.status == Status::Fail) {
        return None;
    }
    let mut causes = port::causes(evidence);
    causes.extend(end::causes(evidence));
    causes.extend(devices::causes(evidence));
    causes.extend(motion::causes(evidence.outcome));
    // Of two that weigh the same, the one that was found first.
    causes.sort_by_key(|cause| core::cmp::Reverse(cause.weight));
    let mut causes = causes.into_iter();
    let Some(first) = causes.next() else {
        return Some(unknown(evidence));
    };
    // One that weighs nearly as much may be the one that counts. What damages bytes explains the
    // rest, so only its like is told beside it.
    let least = match first.weight {
        weight::SETTING.. => weight::SETTING,
        // A program that ends and leaves motors on has two defects.
        weight::ENDED => weight::MOTORS,
        other => weight::ORDER.max(other - 20),
    };
    let next = causes.find(|next| next.weight >= least && next.text != first.text);
    Some(match next {
        Some(next) => format!("{}. Also: {}", first.text, next.text),
        None => first.text,
    })
}

/// What was observed, when nothing of it explains the failure.
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
    format!(
        "not known; line settings, rates and frames are as they should be ({})",
        observed.join("; ")
    )
}
