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

    /// The rules that masters broke, as the devices count them: device, rule, how often.
    pub fn broken_rules(&self) -> impl Iterator<Item = (&str, &'static str, u64)> {
        self.nodes.iter().flat_map(|node| {
            let broken = node.broken_rules().into_iter().flat_map(BrokenRules::iter);
            broken.map(|(rule, count)| (node.name.as_str(), rule, count))
        })
    }

    /// The rules that masters broke, with those of devices that do not count them: their entries in
    /// the log.
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
