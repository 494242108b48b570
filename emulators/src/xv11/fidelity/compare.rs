//! Comparison of two streams, with the allowed differences.

use super::{CAPTURED, Row, Statistics};
use crate::figure::{Comparison, Limit};
use crate::xv11::Profile;

/// The figures of one stream, and its boot text.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Column {
    /// The figures.
    pub rows: Vec<Row>,
    /// The text, if the stream has one.
    pub boot_text: Option<String>,
    /// Whether the sensor saw the emulated one's scenario: the same room, the same hand, and the
    /// end of the drive.
    pub is_hand_in_box: bool,
}

/// Figures of the sensor itself, whatever it saw: the only ones that are judged against a stream
/// from another room.
const OWN: [&str; 6] = [
    "speed changes at index 1 mod 6",
    "0x21 at angle 2 mod 24",
    "codes that carry the strength before",
    "warnings as strength and distance require",
    "characters of the boot text",
    SAME_TEXT,
];

impl Column {
    /// The column of a stream, packets or turns.
    pub fn of(bytes: &[u8]) -> Self {
        let statistics = Statistics::of(bytes);
        Self {
            rows: statistics.rows(),
            boot_text: statistics.boot_text,
            is_hand_in_box: false,
        }
    }

    /// Published figures of the "hand in box" capture of firmware 2.4.13386, without the capture
    /// itself.
    pub fn published() -> Self {
        let known = CAPTURED.into_iter().chain(CAPTURED_END);
        let row = |(name, value): (&str, f64)| Row {
            name: name.to_owned(),
            value: Some(value),
            unit: unit(name),
        };
        Self {
            rows: known.map(row).collect(),
            boot_text: Some(Profile::Fw24.banner().to_owned()),
            is_hand_in_box: true,
        }
    }

    /// The figure `name`, if the stream has it.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.rows.iter().find(|row| row.name == name)?.value
    }
}

/// End of the same capture: stall, cut packet, boot text.
const CAPTURED_END: [(&str, f64); 3] = [
    ("packets with the last speed", 311.0),
    ("bytes of the packet cut by the restart", 7.0),
    ("characters of the boot text", 211.0),
];

/// Allowed differences of the figures. The encoder, the checksum and the text are the sensor's own
/// and must agree. The shares of the optics' codes depend on the shape of a real hand, of which
/// only the distances are known.
const LIMITS: [(&str, Limit); 24] = [
    ("checksums with a dropped carry", Limit::Plus(1.0)),
    ("speed, median", Limit::Share(0.01)),
    ("speed, highest", Limit::Share(0.05)),
    ("speed changes at index 1 mod 6", Limit::Share(0.0)),
    ("0x21 at angle 2 mod 24", Limit::Share(0.10)),
    ("codes that carry the strength before", Limit::Share(0.0)),
    ("plain distances", Limit::Share(0.03)),
    ("distances with warning", Limit::Share(0.50)),
    ("code 0x02", Limit::Share(0.50)),
    ("code 0x03", Limit::Share(0.50)),
    ("code 0x21", Limit::Share(0.25)),
    ("code 0x22", Limit::Share(0.25)),
    ("code 0x25", Limit::Share(1.00)),
    ("code 0x35", Limit::Share(0.50)),
    ("code 0x50", Limit::Share(1.00)),
    ("code 0x52", Limit::Share(0.25)),
    ("strength x distance^2", Limit::Share(0.10)),
    (
        "warnings as strength and distance require",
        Limit::Plus(1.0),
    ),
    ("index steps of 45 or 46", Limit::Share(0.25)),
    ("coast-down from 290 to 185 rpm", Limit::Share(0.15)),
    ("coast-down from 185 to 75 rpm", Limit::Share(0.15)),
    ("packets with the last speed", Limit::Share(0.03)),
    ("characters of the boot text", Limit::Share(0.0)),
    (SAME_TEXT, Limit::Share(0.0)),
];

const SAME_TEXT: &str = "boot text, characters alike";

/// Allowed difference of a figure from that of a stream; for `is_hand_in_box` see [`Column`].
fn limit(name: &str, is_hand_in_box: bool) -> Limit {
    let is_own = OWN.contains(&name) || name.starts_with("noise from");
    if !is_hand_in_box && !is_own {
        return Limit::Free;
    }
    let found = LIMITS.iter().find(|(known, _)| *known == name);
    match found {
        Some(&(_, limit)) => limit,
        None if name.starts_with("noise from") => Limit::Share(0.30),
        None => Limit::Free,
    }
}

fn unit(name: &str) -> &'static str {
    match name {
        "strength x distance^2" => "1e8",
        "farthest warning" => "mm",
        _ if name.starts_with("noise") => "mm",
        _ if name.starts_with("coast") => "s",
        _ if name.starts_with("speed, ") => "rpm",
        _ if name.starts_with("index steps") || name.contains("bytes") => "",
        "packets" | "turns of 1446 bytes" => "",
        _ if name.starts_with("packets with") || name.starts_with("characters") => "",
        _ => "%",
    }
}

/// Lays `ours` beside `real`, figure by figure in the order of `real`, the text last.
pub fn compare(real: &Column, ours: &Column) -> Vec<Comparison> {
    let mut rows: Vec<Comparison> = real
        .rows
        .iter()
        .map(|row| Comparison {
            name: row.name.clone(),
            unit: row.unit,
            real: row.value,
            ours: ours.value(&row.name),
            limit: limit(&row.name, real.is_hand_in_box),
        })
        .collect();
    if let Some(text) = &real.boot_text {
        let alike = |other: &String| {
            let pairs = text.bytes().zip(other.bytes());
            count(pairs.take_while(|(a, b)| a == b).count())
        };
        rows.push(Comparison {
            name: SAME_TEXT.to_owned(),
            unit: "",
            real: Some(count(text.len())),
            ours: ours.boot_text.as_ref().map(alike),
            limit: limit(SAME_TEXT, real.is_hand_in_box),
        });
    }
    rows
}

fn count(count: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "texts are short")]
    let count = count as f64;
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xv11::fidelity::hand_in_box;

    /// A stream of another room: figures of the room are shown and not judged.
    #[test]
    fn f9_figures_of_the_room_are_not_judged_against_another_room() {
        let ours = Column::of(&hand_in_box(Profile::Fw24, 1));
        let elsewhere = Column {
            rows: Column::published()
                .rows
                .into_iter()
                .map(|row| Row {
                    value: row.value.map(|value| match OWN.contains(&&*row.name) {
                        true => value,
                        false if row.name.starts_with("noise") => value,
                        false => value * 5.0,
                    }),
                    ..row
                })
                .collect(),
            is_hand_in_box: false,
            ..Column::published()
        };
        let judged: Vec<_> = compare(&elsewhere, &ours)
            .into_iter()
            .filter_map(|row| Some((row.holds()?, row.name)))
            .collect();
        assert!(judged.len() >= 8, "{judged:?}");
        assert!(judged.iter().all(|(holds, _)| *holds), "{judged:?}");
    }

    #[test]
    fn every_limit_names_a_published_figure() {
        let names: Vec<String> = compare(&Column::published(), &Column::default())
            .into_iter()
            .map(|row| row.name)
            .collect();
        for (name, _) in LIMITS {
            assert!(names.iter().any(|known| known == name), "{name}");
        }
    }

    #[test]
    fn units_of_published_figures_are_those_of_measured_ones() {
        let measured = Statistics::of(&hand_in_box(Profile::Fw24, 1)).rows();
        for row in Column::published().rows {
            let known = measured.iter().find(|m| m.name == row.name);
            assert_eq!(known.map(|m| m.unit), Some(row.unit), "{}", row.name);
        }
    }

    /// The whole claim: no judged figure differs, with any noise.
    #[test]
    fn three_emulated_units_agree_with_the_published_figures() {
        for seed in [1, 2, 3] {
            let ours = Column::of(&hand_in_box(Profile::Fw24, seed));
            let rows = compare(&Column::published(), &ours);
            let off: Vec<_> = rows
                .iter()
                .filter(|row| row.holds() == Some(false))
                .collect();
            assert!(off.is_empty(), "seed {seed}: {off:#?}");
        }
    }

    #[test]
    fn another_firmware_differs() {
        let ours = Column::of(&hand_in_box(Profile::Fw21, 1));
        let rows = compare(&Column::published(), &ours);
        assert!(rows.iter().any(|row| row.holds() == Some(false)));
    }

    #[test]
    fn letters_are_counted() {
        assert_eq!([0, 1, 7].map(count), [0.0, 1.0, 7.0]);
    }
}
