//! Log of the base about itself and its master, with a limit on repeated entries.

use std::collections::BTreeMap;

use core::time::Duration;

use protocols::Instant;

use crate::device::BrokenRules;
use crate::{Event, EventKind};

/// Rules that a master can break, and how to keep them.
pub mod rules {
    /// Bytes that belong to no frame: none between frames.
    pub const STRAY_BYTES: &str = "stray-bytes";
    /// A frame whose checksum does not hold.
    pub const BAD_CHECKSUM: &str = "bad-checksum";
    /// A frame whose end never came.
    pub const FRAME_CUT_OFF: &str = "frame-cut-off";
    /// A pause inside a frame that may cost the frame: bytes follow each other within 1 ms.
    pub const GAP_IN_FRAME: &str = "gap-in-frame";
    /// Bytes that are lost while the base works on a request.
    pub const BYTES_WHILE_BUSY: &str = "bytes-while-busy";
    /// A frame that begins before the reply to the one before has ended.
    pub const REQUEST_BEFORE_REPLY: &str = "request-before-reply";
    /// More requests than the base queues.
    pub const QUEUE_FULL: &str = "queue-full";
    /// Registers beyond the map.
    pub const UNKNOWN_REGISTER: &str = "unknown-register";
    /// A write to a register that the base itself feeds.
    pub const WRITE_READ_ONLY: &str = "write-read-only";
    /// A request that cuts through a value of several registers.
    pub const VALUE_CUT: &str = "value-cut";
    /// A wheel speed beyond the regulator's range.
    pub const SET_POINT_OUT_OF_RANGE: &str = "set-point-out-of-range";
    /// A write of 127 bytes to a firmware that counts only to 126.
    pub const COUNT_TOO_LARGE: &str = "count-too-large";
    /// Bytes while the base starts up.
    pub const BYTES_WHILE_STARTING: &str = "bytes-while-starting";
    /// A character without stop bit: noise, or a wrong baud rate.
    pub const FRAMING_ERROR: &str = "framing-error";
    /// The line was held low.
    pub const BREAK: &str = "break";
}

/// Events kept until they are taken.
const CAPACITY: usize = 256;
/// A rule that is broken again this soon is only counted.
const REPEAT: Duration = Duration::from_millis(100);

/// Events until they are taken. Repeats of a violation are counted, not listed.
#[derive(Clone, Debug, Default)]
pub(super) struct Journal {
    events: Vec<Event>,
    lost: u64,
    broken: BrokenRules,
    repeats: BTreeMap<&'static str, Repeats>,
}

#[derive(Clone, Copy, Debug)]
struct Repeats {
    reported: Instant,
    unreported: u64,
}

impl Journal {
    /// Logs an action of the base.
    pub(super) fn note(&mut self, at: Instant, rule: &'static str, detail: String) {
        self.broken.note(at, rule);
        self.push(Event {
            at,
            kind: EventKind::Note,
            rule,
            detail,
            bytes: Vec::new(),
        });
    }

    /// Records a violation by the master. `detail` is called only if the entry is kept.
    pub(super) fn violation(
        &mut self,
        at: Instant,
        rule: &'static str,
        bytes: &[u8],
        detail: impl FnOnce() -> String,
    ) {
        self.broken.count(at, rule);
        let mut text = String::new();
        if let Some(repeats) = self.repeats.get_mut(rule) {
            if at - repeats.reported < REPEAT {
                repeats.unreported += 1;
                return;
            }
            if repeats.unreported > 0 {
                text = format!("; {} more since the last report", repeats.unreported);
            }
        }
        let fresh = Repeats {
            reported: at,
            unreported: 0,
        };
        self.repeats.insert(rule, fresh);
        self.push(Event {
            at,
            kind: EventKind::Violation,
            rule,
            detail: detail() + &text,
            bytes: bytes.to_vec(),
        });
    }

    /// Number of violations of each rule so far, including those without a log entry.
    pub(super) const fn broken(&self) -> &BrokenRules {
        &self.broken
    }

    fn push(&mut self, event: Event) {
        if self.events.len() < CAPACITY {
            self.events.push(event);
        } else {
            self.lost += 1;
        }
    }

    /// All events, oldest first. One call works in time order, but a request may be judged after a
    /// later one has arrived, so the list is sorted here.
    pub(super) fn take(&mut self) -> Vec<Event> {
        if self.lost > 0 {
            let at = self.events.iter().map(|event| event.at).max();
            self.events.push(Event {
                at: at.unwrap_or_default(),
                kind: EventKind::Note,
                rule: "events-lost",
                detail: format!("{} later events were not stored", self.lost),
                bytes: Vec::new(),
            });
            self.lost = 0;
        }
        let mut events = core::mem::take(&mut self.events);
        events.sort_by_key(|event| event.at);
        events
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn break_rule(journal: &mut Journal, millis: u64) {
        journal.violation(Instant::from_millis(millis), rules::BREAK, &[1], || {
            "low".into()
        });
    }

    #[test]
    fn repeats_are_counted_and_told_later() {
        let mut journal = Journal::default();
        for millis in [0, 1, 99, 100, 500] {
            break_rule(&mut journal, millis);
        }
        let details: Vec<_> = journal.take().into_iter().map(|e| e.detail).collect();
        assert_eq!(details, ["low", "low; 2 more since the last report", "low"]);
        assert_eq!(journal.broken().total(), 5);
        assert_eq!(journal.broken().since(0).0.count(), 5);
    }

    #[test]
    fn events_come_in_the_order_of_their_time() {
        let mut journal = Journal::default();
        journal.note(Instant::from_millis(2), "later", String::new());
        journal.note(Instant::from_millis(1), "earlier", String::new());
        let rules: Vec<_> = journal.take().into_iter().map(|e| e.rule).collect();
        assert_eq!(rules, ["earlier", "later"]);
    }

    #[test]
    fn an_unread_journal_stays_small_and_says_so() {
        let mut journal = Journal::default();
        for millis in 0..1_000 {
            break_rule(&mut journal, millis * 100);
        }
        let events = journal.take();
        assert_eq!(events.len(), CAPACITY + 1);
        assert_eq!(events[CAPACITY].detail, "744 later events were not stored");
        assert!(journal.take().is_empty());
    }
}
