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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::bare;
    use crate::rig::tests::probe::Probe;

    const fn at(us: u64) -> Instant {
        Instant::from_micros(us)
    }

    fn entry(kind: EventKind, us: u64) -> Event {
        Event {
            at: at(us),
            kind,
            rule: "entry",
            detail: "3 of 4".to_owned(),
            bytes: Vec::new(),
        }
    }

    /// Two devices keep their moments. After the point, the first one noted two more and the second
    /// one as many as its log keeps, 1,024, and 6 before them. An entry of a source that keeps its
    /// moments gives none.
    #[test]
    fn the_log_goes_on_from_its_point() {
        let kept = |moments: &[u64]| {
            let mut broken = BrokenRules::default();
            moments.iter().for_each(|us| broken.note(at(*us), "kept"));
            Probe {
                broken: Some(broken),
                ..Probe::default()
            }
        };
        let mut rig = bare::rig();
        rig.add_device("one", kept(&[1, 2, 3]));
        rig.add_device("none", Probe::default());
        rig.add_device("two", kept(&[4]));
        rig.log("line", entry(EventKind::Note, 5));
        let point = rig.log_end();
        assert_eq!(rig.log_since(&point), (vec![], 0));
        let all = rig.log_since(&LogPoint::default());
        let moments = |(moments, lost): (Vec<LogMoment<'_>>, u64)| {
            let moments = moments.iter();
            let moments = moments.map(|one| {
                let source = one.source.to_owned();
                (one.at.as_micros(), source, one.rule.to_owned())
            });
            (moments.collect::<Vec<_>>(), lost)
        };
        let expect = |us: u64, source: &str, rule: &str| (us, source.to_owned(), rule.to_owned());
        let expected = vec![
            expect(1, "one", "kept"),
            expect(2, "one", "kept"),
            expect(3, "one", "kept"),
            expect(4, "two", "kept"),
            expect(5, "line", "entry"),
        ];
        assert_eq!(moments(all), (expected, 0));

        rig.log("line", entry(EventKind::Note, 9));
        rig.log_from("one", entry(EventKind::Violation, 10), false, true);
        for (name, from, count) in [("one", 7, 2), ("two", 100, 1_030)] {
            let device = rig.device_mut::<Probe>(name).expect("it is there");
            let broken = device.broken.as_mut().expect("it counts");
            (from..from + count).for_each(|us| broken.note(at(us), "kept"));
        }
        let (later, lost) = moments(rig.log_since(&point));
        assert_eq!((later.len(), lost), (3 + 1_024, 6));
        let expected = [
            expect(7, "one", "kept"),
            expect(8, "one", "kept"),
            expect(9, "line", "entry"),
            expect(106, "two", "kept"),
        ];
        assert_eq!(later[..4], expected);
        assert_eq!(later.last(), Some(&expect(1_129, "two", "kept")));
    }

    #[test]
    fn an_entry_reads_as_its_time_source_rule_and_sentence() {
        let logged = |kind| Logged {
            source: "board".to_owned(),
            event: entry(kind, 12_000_034),
            is_kept: false,
        };
        let note = logged(EventKind::Note);
        assert_eq!(note.to_string(), "12.000034 board entry: 3 of 4");
        assert!(!note.is_violation() && logged(EventKind::Violation).is_violation());
    }
}
