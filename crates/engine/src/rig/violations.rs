//! Rules that masters broke: their number, and those that do not count.

use emulators::BrokenRules;
use protocols::Instant;

use super::Rig;

/// No frame was among the bytes that a device received.
pub const NO_FRAME: &str = "no-frame";
/// Number of received bytes that count as a frame.
const FRAME: u64 = 16;

impl Rig {
    /// Whether anything could break a rule of a device: a program runs in the rig, or a device has
    /// [received](Self::was_heard) a byte.
    pub fn was_asked(&self) -> bool {
        self.program().is_some() || self.was_heard
    }

    /// Whether a device has received a byte. A device that is switched off or unplugged receives
    /// none.
    pub const fn was_heard(&self) -> bool {
        self.was_heard
    }

    /// Number of rules that masters broke: each break counts, also if several breaks share one
    /// entry of the log. [Excused](Self::excused) breaks do not count.
    pub fn violations(&self) -> u64 {
        let counted = self.broken_rules().map(|(.., count)| count);
        self.violations + counted.sum::<u64>() - self.excused_counts
    }

    /// The rules that masters broke, as the devices count them: device, rule and number.
    pub fn broken_rules(&self) -> impl Iterator<Item = (&str, &'static str, u64)> {
        self.nodes.iter().flat_map(|node| {
            let broken = node.broken_rules().into_iter().flat_map(BrokenRules::iter);
            broken.map(|(rule, count)| (node.name.as_str(), rule, count))
        })
    }

    /// The rules that masters broke, for all devices: for a device that does not count them, the
    /// number of its log entries.
    pub fn all_broken_rules(&self) -> Vec<(String, &'static str, u64)> {
        let counted = self.broken_rules();
        let mut broken: Vec<_> = counted
            .map(|(device, rule, count)| (device.to_owned(), rule, count))
            .collect();
        let own: Vec<String> = broken.iter().map(|(device, ..)| device.clone()).collect();
        let events = self.events().iter();
        for logged in events.filter(|logged| logged.is_violation()) {
            let (source, rule) = (&logged.source, logged.event.rule);
            if own.contains(source) {
                continue;
            }
            match broken
                .iter_mut()
                .find(|(device, known, _)| device == source && *known == rule)
            {
                Some((.., count)) => *count += 1,
                None => broken.push((source.clone(), rule, 1)),
            }
        }
        broken
    }

    /// The broken rules, and [`NO_FRAME`] for each device that found no frame among the received
    /// bytes: once for each 16 bytes. This is no violation: a device may ignore such bytes.
    pub fn mistakes(&self) -> Vec<(String, &'static str, u64)> {
        let mut mistakes = self.all_broken_rules();
        for node in &self.nodes {
            let count = node.unframed().div_ceil(FRAME);
            if count > 0 {
                mistakes.push((node.name.clone(), NO_FRAME, count));
            }
        }
        mistakes
    }

    /// Number of broken rules that did not count, see [`excuse_until`](Self::excuse_until).
    pub const fn excused(&self) -> u64 {
        self.excused
    }

    /// Violations of masters before `until` are logged but do not count: the rig was late, and the
    /// bytes of the masters arrive in a burst.
    pub fn excuse_until(&mut self, until: Instant) {
        if self.excused_until <= self.now {
            for node in &mut self.nodes {
                node.note_breaks();
            }
        }
        self.excused_until = self.excused_until.max(until);
    }
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use emulators::world::World;
    use emulators::{Device, Event, EventKind};
    use protocols::{LineConfig, Port};

    use super::*;
    use crate::rig::bare;
    use crate::rig::line::End;

    /// A device for which each byte is a violation. One that counts keeps their number itself.
    #[derive(Clone, Default)]
    struct Strict {
        counts: Option<BrokenRules>,
        events: Vec<Event>,
        /// Bytes outside of frames.
        stray: u64,
    }

    impl Device for Strict {
        fn receive(&mut self, _: Port, now: Instant, bytes: &[u8]) {
            for _ in bytes {
                if let Some(counts) = &mut self.counts {
                    counts.count(now, "too-soon");
                }
                self.events.push(Event {
                    at: now,
                    kind: EventKind::Violation,
                    rule: "too-soon",
                    detail: String::new(),
                    bytes: Vec::new(),
                });
            }
        }

        fn poll(&mut self, _: Instant, _: &mut World) {}

        fn transmit(&mut self, _: Port, _: &mut [u8]) -> usize {
            0
        }

        fn poll_at(&self) -> Option<Instant> {
            None
        }

        fn line_config(&self, _: Port) -> LineConfig {
            LineConfig::new_8n1(9600)
        }

        fn take_events(&mut self) -> Vec<Event> {
            core::mem::take(&mut self.events)
        }

        fn broken_rules(&self) -> Option<&BrokenRules> {
            self.counts.as_ref()
        }

        fn unframed(&self) -> u64 {
            self.stray
        }
    }

    /// A rig with these devices, each with a link of its own, and the nodes of their masters.
    fn strict<const N: usize>(devices: [(&str, Strict); N]) -> (Rig, [usize; N]) {
        let mut rig = bare::rig();
        let masters = devices.map(|(name, device)| {
            let ends = [
                rig.add_device(name, device),
                rig.add_outside("master", LineConfig::new_8n1(9600)),
            ]
            .map(|node| End {
                node,
                port: Port(0),
            });
            rig.connect(name, ends[0], ends[1], 1);
            ends[1].node
        });
        (rig, masters)
    }

    fn counting() -> Strict {
        Strict {
            counts: Some(BrokenRules::default()),
            ..Strict::default()
        }
    }

    fn send(rig: &mut Rig, master: usize, len: usize) {
        rig.inject(master, &vec![0; len]);
        rig.run_for(Duration::from_millis(10));
    }

    /// Violations before 20 ms and after 40 ms count, those in between do not: two, three and four
    /// violations, of a device that counts and of one that does not.
    #[test]
    fn violations_while_the_rig_was_late_do_not_count() {
        for device in [counting(), Strict::default()] {
            let (mut rig, [master]) = strict([("board", device)]);
            send(&mut rig, master, 2);
            assert_eq!((rig.violations(), rig.excused()), (2, 0));
            rig.run_until(Instant::from_millis(20));
            rig.excuse_until(Instant::from_millis(30));
            send(&mut rig, master, 2);
            rig.excuse_until(Instant::from_millis(40));
            send(&mut rig, master, 1);
            assert_eq!((rig.violations(), rig.excused()), (2, 3));
            rig.run_until(Instant::from_millis(50));
            send(&mut rig, master, 4);
            assert_eq!((rig.violations(), rig.excused()), (6, 3));
        }
    }

    /// Both devices log the same rule; one counts, and its entries are not counted once more. 17
    /// bytes without a frame are two mistakes, but no violation.
    #[test]
    fn each_violation_is_counted_once() {
        let lost = Strict {
            stray: 17,
            ..Strict::default()
        };
        let devices = [
            ("one", counting()),
            ("two", Strict::default()),
            ("lost", lost),
        ];
        let (mut rig, masters) = strict(devices);
        assert!(!rig.was_asked());
        send(&mut rig, masters[0], 3);
        send(&mut rig, masters[1], 2);
        assert!(rig.was_asked());
        assert_eq!(rig.violations(), 5);
        let two =
            [("one", 3), ("two", 2)].map(|(name, count)| (name.to_owned(), "too-soon", count));
        assert_eq!(rig.all_broken_rules(), two);
        let mistakes = rig.mistakes();
        assert_eq!(mistakes[..2], two);
        assert_eq!(mistakes[2..], [("lost".to_owned(), NO_FRAME, 2)]);
    }

    /// Two breaks came before the rig was late for the first time, at its start; only the third one
    /// is excused. A shorter excuse does not end a longer one.
    #[test]
    fn breaks_from_before_an_excuse_count() {
        let mut board = counting();
        let counts = board.counts.as_mut().expect("it counts");
        counts.count(Instant::ZERO, "too-soon");
        counts.count(Instant::ZERO, "too-soon");
        let (mut rig, [master]) = strict([("board", board)]);
        rig.excuse_until(Instant::from_millis(20));
        rig.excuse_until(Instant::from_millis(5));
        send(&mut rig, master, 1);
        assert_eq!((rig.violations(), rig.excused()), (2, 1));
    }

    /// Bytes 1 to 16 without a frame are one mistake, byte 17 begins another one.
    #[test]
    fn each_16_bytes_without_a_frame_are_a_mistake() {
        let mistakes = |stray| {
            let lost = Strict {
                stray,
                ..Strict::default()
            };
            let (rig, _) = strict([("lost", lost)]);
            rig.mistakes().iter().map(|(.., count)| *count).sum::<u64>()
        };
        assert_eq!([0, 1, 16, 17, 32, 33].map(mistakes), [0, 1, 1, 2, 2, 3]);
    }

    /// A program in the rig may break a rule before a device has heard anything.
    #[test]
    fn a_rig_with_a_program_was_asked() {
        use crate::rig::tests::pair;
        use crate::rig::tests::probe::Probe;
        let rig = pair(Probe::default(), Probe::default());
        assert!(rig.was_asked() && !rig.was_heard());
        assert!(!strict([("board", counting())]).0.was_asked());
    }

    /// A device logs three breaks of two rules, and does not count them.
    #[test]
    fn breaks_of_one_rule_are_added_up() {
        let event = |rule| Event {
            at: Instant::ZERO,
            kind: EventKind::Violation,
            rule,
            detail: String::new(),
            bytes: Vec::new(),
        };
        let board = Strict {
            events: ["late", "early", "late"].map(event).into(),
            ..Strict::default()
        };
        let (mut rig, _) = strict([("board", board)]);
        rig.run_for(Duration::from_millis(1));
        let expected = [("late", 2), ("early", 1)];
        let expected = expected.map(|(rule, count)| ("board".to_owned(), rule, count));
        assert_eq!(rig.all_broken_rules(), expected);
    }

    /// A byte of 9600 baud ends after 1,041,666 ns. It is excused if the excuse lasts longer.
    #[test]
    fn an_excuse_ends_before_its_last_instant() {
        for device in [counting(), Strict::default()] {
            for (nanos, expected) in [(1_041_666, (1, 0)), (1_041_667, (0, 1))] {
                let (mut rig, [master]) = strict([("board", device.clone())]);
                rig.excuse_until(Instant::from_nanos(nanos));
                send(&mut rig, master, 1);
                assert_eq!((rig.violations(), rig.excused()), expected, "{nanos}");
            }
        }
    }
}
