//! A device's log that cannot be flooded: a rule broken a thousand times a second makes a few
//! entries with counts, not a thousand entries.

use core::time::Duration;

use protocols::Instant;

use crate::device::{BrokenRules, Event, EventKind, earliest};

/// Maximum number of entries kept until they are taken; further ones are only counted.
const EVENTS_MAX: usize = 1024;
/// First pause between two entries about the same rule; doubles while the rule is being broken.
const PAUSE_MIN: Duration = Duration::from_secs(1);
/// Longest pause between two entries about the same rule.
const PAUSE_MAX: Duration = Duration::from_secs(64);

/// Entries not yet taken, and rules whose repetitions are counted.
#[derive(Clone, Debug, Default)]
pub struct EventLog {
    events: Vec<Event>,
    dropped: u64,
    broken: BrokenRules,
    repeats: Vec<Repeat>,
}

#[derive(Clone, Debug)]
struct Repeat {
    kind: EventKind,
    rule: &'static str,
    pause: Duration,
    report_at: Instant,
    count: u64,
    last: Instant,
}

impl EventLog {
    /// Logs an event.
    pub fn note(&mut self, at: Instant, rule: &'static str, detail: String) {
        self.broken.note(at, rule);
        self.push(at, EventKind::Note, rule, detail, &[]);
    }

    /// Logs a broken rule that the master cannot break often.
    pub fn violation(&mut self, at: Instant, rule: &'static str, detail: String, bytes: &[u8]) {
        self.broken.count(at, rule);
        self.push(at, EventKind::Violation, rule, detail, bytes);
    }

    /// Logs an event that may occur at any rate: the first occurrence makes an entry, later ones
    /// are counted and make an entry after a pause.
    pub fn repeated(
        &mut self,
        at: Instant,
        kind: EventKind,
        rule: &'static str,
        detail: impl FnOnce() -> String,
    ) {
        match kind {
            EventKind::Violation => self.broken.count(at, rule),
            EventKind::Note => self.broken.note(at, rule),
        }
        if let Some(repeat) = self.repeats.iter_mut().find(|repeat| repeat.rule == rule) {
            repeat.count += 1;
            repeat.last = at;
            return;
        }
        self.repeats.push(Repeat {
            kind,
            rule,
            pause: PAUSE_MIN,
            report_at: at + PAUSE_MIN,
            count: 0,
            last: at,
        });
        self.push(at, kind, rule, detail(), &[]);
    }

    /// Number of violations of each rule so far, including those without a log entry.
    pub const fn broken(&self) -> &BrokenRules {
        &self.broken
    }

    /// Writes the counts that are due; rules that were not broken meanwhile are forgotten.
    pub fn poll(&mut self, now: Instant) {
        if self.repeats.iter().all(|repeat| repeat.report_at > now) {
            return;
        }
        let mut repeats = core::mem::take(&mut self.repeats);
        repeats.retain_mut(|repeat| {
            if repeat.report_at > now {
                return true;
            }
            if repeat.count == 0 {
                return false;
            }
            let detail = format!("{} more times until {} s", repeat.count, repeat.last);
            self.push(now, repeat.kind, repeat.rule, detail, &[]);
            repeat.count = 0;
            repeat.pause = (repeat.pause * 2).min(PAUSE_MAX);
            repeat.report_at = now + repeat.pause;
            true
        });
        self.repeats = repeats;
    }

    /// Time at which a count of repetitions is due.
    pub fn poll_at(&self) -> Option<Instant> {
        earliest(self.repeats.iter().map(|repeat| Some(repeat.report_at)))
    }

    /// The entries since the last call, oldest first.
    pub fn take(&mut self) -> Vec<Event> {
        let mut events = core::mem::take(&mut self.events);
        let dropped = core::mem::take(&mut self.dropped);
        if let (Some(last), 1..) = (events.last(), dropped) {
            let at = last.at;
            events.push(Event {
                at,
                kind: EventKind::Note,
                rule: "events-dropped",
                detail: format!("{dropped} later entries did not fit the log"),
                bytes: Vec::new(),
            });
        }
        events
    }

    fn push(
        &mut self,
        at: Instant,
        kind: EventKind,
        rule: &'static str,
        detail: String,
        bytes: &[u8],
    ) {
        if self.events.len() == EVENTS_MAX {
            self.dropped += 1;
            return;
        }
        self.events.push(Event {
            at,
            kind,
            rule,
            detail,
            bytes: bytes.to_vec(),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten times in the first second: one entry at once, one count a second later, then silence.
    #[test]
    fn a_rule_broken_again_and_again_is_counted_not_repeated() {
        let mut log = EventLog::default();
        for at in (0..10).map(|n| Instant::from_millis(n * 10)) {
            log.repeated(at, EventKind::Violation, "too-fast", || "one".to_owned());
        }
        assert_eq!(log.poll_at(), Some(Instant::from_secs(1)));
        log.poll(Instant::from_secs(1));
        log.poll(Instant::from_secs(3));

        let events = log.take();
        assert_eq!(events.len(), 2);
        assert_eq!(events[1].detail, "9 more times until 0.090000 s");
        // Ten violations, although fewer entries report them.
        assert_eq!(log.broken().iter().collect::<Vec<_>>(), [("too-fast", 10)]);
        // Each violation has its own time; the entry that counts them adds none.
        let (moments, lost) = log.broken().since(7);
        let moments: Vec<_> = moments.map(|(at, _)| at.as_millis()).collect();
        assert_eq!((moments, lost), (vec![70, 80, 90], 0));
        assert_eq!(log.poll_at(), None);
    }

    #[test]
    fn a_log_that_nobody_takes_stays_bounded() {
        let mut log = EventLog::default();
        for _ in 0..EVENTS_MAX + 5 {
            log.note(Instant::ZERO, "again", String::new());
        }
        let events = log.take();
        assert_eq!(events.len(), EVENTS_MAX + 1);
        assert_eq!(events[EVENTS_MAX].rule, "events-dropped");
        assert!(log.take().is_empty());
    }

    /// Rules that were broken at 0 and at half a second, both twice: at 1.2 s the first count is
    /// due, and the second in 0.3 s.
    #[test]
    fn a_count_is_told_when_it_is_due() {
        let mut log = EventLog::default();
        for (millis, rule) in [(0, "one"), (500, "two"), (600, "one"), (700, "two")] {
            log.repeated(
                Instant::from_millis(millis),
                EventKind::Note,
                rule,
                String::new,
            );
        }
        assert_eq!(log.take().len(), 2);
        log.poll(Instant::from_millis(999));
        assert_eq!(log.take(), []);
        log.poll(Instant::from_millis(1_200));
        let told: Vec<_> = log
            .take()
            .into_iter()
            .map(|it| (it.rule, it.detail))
            .collect();
        assert_eq!(told, [("one", "1 more times until 0.600000 s".to_owned())]);
        assert_eq!(log.poll_at(), Some(Instant::from_millis(1_500)));
        log.poll(Instant::from_millis(1_500));
        assert_eq!(log.take().len(), 1);
        // The next report is due two seconds after the last one.
        assert_eq!(log.poll_at(), Some(Instant::from_millis(3_200)));
    }

    /// A rule that is broken all the time is reported after 1, 2, 4, 8, 16, 32, 64 and 64 seconds.
    #[test]
    fn pauses_between_counts_double_up_to_a_minute() {
        let mut log = EventLog::default();
        let mut told = Vec::new();
        for half in 0..520 {
            let now = Instant::from_millis(500 * half);
            log.poll(now);
            log.repeated(now, EventKind::Violation, "too-fast", String::new);
            told.extend(log.take().into_iter().map(|event| event.at));
        }
        assert_eq!(
            told,
            [0, 1, 3, 7, 15, 31, 63, 127, 191, 255].map(Instant::from_secs)
        );
    }
}
