use core::fmt::Display;

use engine::codec::{Codec, What};
use engine::hex::pairs;

/// Bytes that passed on a wire.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exchange {
    /// The sender, e.g. `master`.
    pub from: &'static str,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// Their meaning, frame by frame.
    pub words: String,
}

impl Exchange {
    /// The bytes in hexadecimal; a long sequence is shortened in the middle.
    pub fn hex(&self) -> String {
        hex(&self.bytes)
    }
}

/// An observed value under a stable name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Figure {
    /// A short description.
    pub name: &'static str,
    /// Its value with its unit.
    pub value: String,
}

/// A figure whose value differs between two observations.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Name of the figure.
    pub name: &'static str,
    /// Value with the defect.
    pub defective: String,
    /// Value of the sound variant, without the defect.
    pub sound: String,
}

/// Observations of one variant.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Observation {
    /// The decisive bytes, in order.
    pub wire: Vec<Exchange>,
    /// The figures, in order.
    pub figures: Vec<Figure>,
    /// Whether the variant behaves as the catalogue says of the defective one.
    pub has_defect: bool,
}

impl Observation {
    /// Records bytes on the wire.
    pub(super) fn bytes(&mut self, from: &'static str, codec: &'static Codec, bytes: &[u8]) {
        let words = words(codec, bytes);
        let bytes = bytes.to_vec();
        self.wire.push(Exchange { from, bytes, words });
    }

    /// Records a figure.
    pub(super) fn figure(&mut self, name: &'static str, value: impl Display) {
        let value = value.to_string();
        self.figures.push(Figure { name, value });
    }

    /// The observation with its verdict.
    #[must_use]
    pub(super) fn judged(mut self, has_defect: bool) -> Self {
        self.has_defect = has_defect;
        self
    }

    /// Value of the figure `name`.
    pub fn value(&self, name: &str) -> Option<&str> {
        let figure = self.figures.iter().find(|figure| figure.name == name)?;
        Some(&figure.value)
    }

    /// All bytes that `from` sent, in hexadecimal.
    pub fn sent_by(&self, from: &str) -> String {
        let own = self.wire.iter().filter(|exchange| exchange.from == from);
        own.map(Exchange::hex).collect::<Vec<_>>().join(" ")
    }

    pub(super) fn differences(&self, sound: &Self) -> Vec<Difference> {
        let differs = |figure: &&Figure| sound.value(figure.name) != Some(&figure.value);
        let own = self.figures.iter().filter(differs);
        own.map(|figure| Difference {
            name: figure.name,
            defective: figure.value.clone(),
            sound: sound.value(figure.name).unwrap_or("nothing").to_owned(),
        })
        .collect()
    }
}

/// Maximum number of bytes that are shown completely.
const SHOWN_MAX: usize = 40;

/// Formats bytes in hexadecimal; a long sequence is shortened in the middle.
pub(super) fn hex(bytes: &[u8]) -> String {
    if bytes.len() <= SHOWN_MAX {
        return pairs(bytes);
    }
    let (head, tail) = (&bytes[..SHOWN_MAX / 2], &bytes[bytes.len() - 6..]);
    let between = bytes.len() - head.len() - tail.len();
    format!("{} .. {between} more .. {}", pairs(head), pairs(tail))
}

/// Meaning of `bytes`, frame by frame; bytes outside of frames are marked.
fn words(codec: &'static Codec, bytes: &[u8]) -> String {
    let found = codec.found(bytes);
    let told = found.iter().map(|one| match &one.what {
        What::Frame(words) => words.clone(),
        What::Bad(errors) => {
            let len = one.bytes.end - one.bytes.start;
            let why = errors.first().map(|error| format!(": {error}"));
            format!("{len} bytes of no frame{}", why.unwrap_or_default())
        }
    });
    told.collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_rows_are_shortened_in_the_middle() {
        assert_eq!(hex(&[0xAB, 0, 0x0F]), "AB 00 0F");
        let long = hex(&[7; 100]);
        assert!(long.contains(" .. 74 more .. "), "{long}");
    }

    #[test]
    fn a_figure_that_only_one_variant_has_is_a_difference() {
        let (mut defective, mut sound) = (Observation::default(), Observation::default());
        defective.figure("same", 1);
        sound.figure("same", 1);
        defective.figure("other", 2);
        let difference = Difference {
            name: "other",
            defective: "2".into(),
            sound: "nothing".into(),
        };
        assert_eq!(defective.differences(&sound), [difference]);
    }
}
