//! Figures with names, so that two streams can be laid side by side.

use super::{Statistics, share};

/// One figure of a stream.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Stable name.
    pub name: String,
    /// The figure; `None` if the stream does not show it.
    pub value: Option<f64>,
    /// Unit, empty for a plain count.
    pub unit: &'static str,
}

const PERCENT: &str = "%";

/// Error codes that are always listed.
const CODES: [u8; 9] = [0x02, 0x03, 0x06, 0x21, 0x22, 0x25, 0x35, 0x50, 0x52];

/// Figures of [`Statistics`] for the real "hand in box" capture of firmware 2.4.13386 (Xevel/NXV11,
/// 252,146 bytes): the reference for the emulator.
pub const CAPTURED: [(&str, f64); 31] = [
    ("packets", 11_451.0),
    ("turns of 1446 bytes", 0.0),
    ("bytes outside", 224.0),
    ("checksums with a dropped carry", 3.04),
    ("speed, median", 296.9),
    ("speed, highest", 351.1),
    ("speed, lowest", 49.8),
    ("speed changes at index 1 mod 6", 100.0),
    ("0x21 at angle 2 mod 24", 91.0),
    ("codes that carry the strength before", 100.0),
    ("plain distances", 93.6),
    ("distances with warning", 0.284),
    ("code 0x02", 0.299),
    ("code 0x03", 0.175),
    ("code 0x06", 0.002),
    ("code 0x21", 0.491),
    ("code 0x22", 0.255),
    ("code 0x25", 0.026),
    ("code 0x35", 0.478),
    ("code 0x50", 0.026),
    ("code 0x52", 4.358),
    ("strength x distance^2", 0.901),
    ("farthest warning", 542.0),
    ("warnings as strength and distance require", 99.9),
    ("noise from 200 mm", 0.249),
    ("noise from 300 mm", 0.298),
    ("noise from 400 mm", 0.352),
    ("noise from 500 mm", 0.468),
    ("index steps of 45 or 46", 498.0),
    ("coast-down from 290 to 185 rpm", 0.273),
    ("coast-down from 185 to 75 rpm", 0.314),
];

impl Statistics {
    /// All figures, in a fixed order.
    pub fn rows(&self) -> Vec<Row> {
        let mut rows = Vec::new();
        let mut row = |name: &str, value: Option<f64>, unit| {
            rows.push(Row {
                name: name.to_owned(),
                value,
                unit,
            });
        };
        let packets = count(self.packets);
        row("packets", Some(packets), "");
        row("turns of 1446 bytes", Some(count(self.turns)), "");
        row("bytes outside", Some(count(self.outside)), "");
        row(
            "checksums with a dropped carry",
            part(self.carry_dropped[1], self.carry_dropped[0]),
            PERCENT,
        );
        row("speed, median", self.when_packets(self.rpm_median), "rpm");
        row("speed, highest", self.when_packets(self.rpm_max), "rpm");
        row("speed, lowest", self.when_packets(self.rpm_min), "rpm");
        let changes = self.word_changes.iter().sum();
        row(
            "speed changes at index 1 mod 6",
            part(self.word_changes[1], changes),
            PERCENT,
        );
        let skipped = self.skipped_at.iter().sum();
        row(
            "0x21 at angle 2 mod 24",
            part(self.skipped_at[2], skipped),
            PERCENT,
        );
        row(
            "codes that carry the strength before",
            part(self.carried[1], self.carried[0]),
            PERCENT,
        );
        row(
            "plain distances",
            part(self.plain, self.readings()),
            PERCENT,
        );
        row(
            "distances with warning",
            part(self.weak, self.readings()),
            PERCENT,
        );
        for code in CODES {
            let found = self.codes.get(&code).copied().unwrap_or(0);
            row(
                &format!("code 0x{code:02X}"),
                part(found, self.readings()),
                PERCENT,
            );
        }
        row("strength x distance^2", positive(self.strength_d2), "1e8");
        row("farthest warning", Some(f64::from(self.weak_max_mm)), "mm");
        row(
            "warnings as strength and distance require",
            Some(100.0 * self.weak_as_law),
            PERCENT,
        );
        for bin in &self.noise {
            row(
                &format!("noise from {} mm", bin.from_mm),
                Some(bin.sigma_mm),
                "mm",
            );
        }
        let jumps = |steps: [u8; 2]| {
            let found = steps.map(|step| self.index_steps.get(&step).copied().unwrap_or(0));
            Some(count(found[0] + found[1]))
        };
        row("index steps of 45 or 46", jumps([45, 46]), "");
        row(
            "coast-down from 290 to 185 rpm",
            self.coast_s.map(|s| s[0]),
            "s",
        );
        row(
            "coast-down from 185 to 75 rpm",
            self.coast_s.map(|s| s[1]),
            "s",
        );
        row(
            "packets with the last speed",
            Some(count(self.stalled_packets)),
            "",
        );
        row(
            "bytes of the packet cut by the restart",
            self.cut_bytes.map(count),
            "",
        );
        row(
            "characters of the boot text",
            self.boot_text.as_ref().map(|t| count(t.len() as u64)),
            "",
        );
        rows
    }

    fn when_packets(&self, value: f64) -> Option<f64> {
        (self.packets > 0).then_some(value)
    }
}

fn part(found: u64, all: u64) -> Option<f64> {
    (all > 0).then(|| 100.0 * share(found, all))
}

fn positive(value: f64) -> Option<f64> {
    (value > 0.0).then_some(value)
}

fn count(count: u64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "counts are below 2^53")]
    let count = count as f64;
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_above_zero_is_a_figure() {
        assert_eq!([-1.0, 0.0, 0.1].map(positive), [None, None, Some(0.1)]);
        assert_eq!([part(0, 0), part(1, 4)], [None, Some(25.0)]);
    }
}
