//! Events of a rig, with their device or link.

use std::collections::BTreeMap;

use emulators::{BrokenRules, Event, EventKind};
use protocols::Instant;

use super::Rig;

/// A device's event with the device's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Logged {
    /// Name of the device, or of the link.
    pub source: String,
    /// The event.
    pub event: Event,
    /// Whether the device's log keeps this moment, and those that it folds into other entries.
    pub is_kept: bool,
}

/// Point in the log of a rig, from which reading continues.
#[derive(Clone, Debug, Default)]
pub(crate) struct LogPoint {
    entries: usize,
    /// Moments of each log of a device, by node and number.
    moments: BTreeMap<(usize, usize), u64>,
}

/// A moment in the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LogMoment<'a> {
    pub(crate) at: Instant,
    pub(crate) source: &'a str,
    pub(crate) rule: &'a str,
}

impl Rig {
    /// The current end of the log.
    pub(crate) fn log_end(&self) -> LogPoint {
        let logs = self.logs_of_devices();
        LogPoint {
            entries: self.events.len(),
            moments: logs.map(|(key, _, log)| (key, log.seen())).collect(),
        }
    }

    /// The moments of the log after `point`, oldest first, and the number of lost moments. An entry
    /// that combines several moments gives all of them.
    pub(crate) fn log_since(&self, point: &LogPoint) -> (Vec<LogMoment<'_>>, u64) {
        let entries = self.events.get(point.entries..).unwrap_or_default();
        let entries = entries.iter().filter(|one| !one.is_kept);
        let mut all: Vec<LogMoment<'_>> = entries
            .map(|one| LogMoment {
                at: one.event.at,
                source: &one.source,
                rule: one.event.rule,
            })
            .collect();
        let mut lost = 0;
        for (key, source, log) in self.logs_of_devices() {
            let seen = point.moments.get(&key).copied().unwrap_or_default();
            let (new, gone) = log.since(seen);
            all.extend(new.map(|(at, rule)| LogMoment { at, source, rule }));
            lost += gone;
        }
        all.sort_by_key(|moment| moment.at);
        (all, lost)
    }

    fn logs_of_devices(&self) -> impl Iterator<Item = ((usize, usize), &str, &BrokenRules)> {
        self.nodes.iter().enumerate().flat_map(|(node, one)| {
            let logs = one.logs().into_iter().enumerate();
            logs.map(move |(number, log)| ((node, number), one.name.as_str(), log))
        })
    }
}

impl Logged {
    /// Whether a master broke a rule.
    pub fn is_violation(&self) -> bool {
        self.event.kind == EventKind::Violation
    }
}

impl core::fmt::Display for Logged {
    /// `12.345678 base unknown-register: ..`.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Event {
            at, rule, detail, ..
        } = &self.event;
        write!(f, "{at} {} {rule}: {detail}", self.source)
    }
}
