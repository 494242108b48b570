//! Number of bytes of a line in valid frames of a protocol, by the times of a capture: only a
//! silence shows the end of some frames.

use protocols::FrameError;

use super::pause::Pauses;
use super::transcript::{Said, Transcript};
use crate::Capture;
use engine::codec::Codec;
use engine::rig::line::Direction;

/// The bytes of one direction of a link, decoded with one protocol.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Framed {
    /// Bytes in all.
    pub bytes: u64,
    /// Bytes in valid frames.
    pub framed: u64,
    /// Number of valid frames.
    pub frames: u64,
    /// Bytes outside of frames that are not text.
    pub bad: u64,
    /// Number of bytes at which a frame seemed to begin.
    pub candidates: u64,
    /// Of these, those with a wrong checksum.
    pub sums: u64,
    /// The first of these errors: of a checksum, if there is one.
    pub first: Option<FrameError>,
}

impl Framed {
    /// Decodes the bytes in `direction` of the link with this index as frames of `codec`.
    pub fn of(codec: &'static Codec, capture: &Capture, link: usize, direction: Direction) -> Self {
        let mut transcript = Transcript::new(Some(codec)).pausing(Pauses::of(&capture.sections));
        let mut framed = Self::default();
        let mut add = |said: Said| match said {
            Said::Frame(_) => framed.frames += 1,
            Said::Bad(bytes, errors) => {
                framed.bad += bytes.len() as u64;
                errors.into_iter().for_each(|error| framed.add(error));
            }
            Said::Text(_) | Said::Data(_) | Said::Event(_) => {}
        };
        // A pause may end a frame only if the other direction sends in it.
        for record in capture.records.iter().filter(|one| one.link == link) {
            transcript.record(record, &capture.links[link]);
            let ready = transcript.ready(record.at);
            let own = ready.filter(|entry| entry.direction == direction);
            own.for_each(|entry| add(entry.said));
        }
        let rest = transcript.finish();
        let own = rest.filter(|entry| entry.direction == direction);
        own.for_each(|entry| add(entry.said));
        if let Some(sum) = transcript.sums().find(|sum| sum.direction == direction) {
            (framed.bytes, framed.framed) = (sum.bytes, sum.framed);
        }
        framed
    }

    fn add(&mut self, error: FrameError) {
        let is_sum = matches!(error, FrameError::Checksum { .. });
        if self.candidates == 0 || (is_sum && self.sums == 0) {
            self.first = Some(error);
        }
        self.candidates += 1;
        self.sums += u64::from(is_sum);
    }

    /// The reasons why most bytes are in no valid frame of `protocol`; `None` if most are. Text is
    /// no evidence against a protocol that `is_guessed` from the bytes.
    pub fn doubt(&self, protocol: &str, is_guessed: bool) -> Option<String> {
        let lost = match is_guessed {
            true => self.bad,
            false => self.bytes - self.framed,
        };
        if lost * 2 <= self.bytes {
            return None;
        }
        let (sums, candidates) = (self.sums, self.candidates);
        let reason = match self.first {
            Some(first) if sums > 0 => {
                format!("{sums} candidates have a wrong checksum, the first: {first}")
            }
            Some(first) => format!("{candidates} candidates are no frames, the first: {first}"),
            None => "nothing else in them begins a frame".to_owned(),
        };
        let (len, framed) = (self.bytes, self.framed);
        let share = match framed {
            0 => format!("none of the {len} bytes is in a valid frame"),
            _ => format!("only {framed} of the {len} bytes are in valid frames"),
        };
        Some(format!(
            "{share} of {protocol}: {reason}; check the description, the direction and the baud \
             rate"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SUM: FrameError = FrameError::Checksum {
        expected: 1,
        found: 2,
    };
    const OTHER_SUM: FrameError = FrameError::Checksum {
        expected: 1,
        found: 3,
    };
    const CUT: FrameError = FrameError::Truncated { found: 4 };

    /// The first error of a checksum is kept, or the first one of all.
    #[test]
    fn the_first_error_of_a_checksum_counts() {
        let of = |errors: &[FrameError]| {
            let mut framed = Framed::default();
            errors.iter().for_each(|error| framed.add(*error));
            (framed.candidates, framed.sums, framed.first)
        };
        assert_eq!(of(&[]), (0, 0, None));
        assert_eq!(of(&[CUT]), (1, 0, Some(CUT)));
        assert_eq!(of(&[CUT, SUM, OTHER_SUM]), (3, 2, Some(SUM)));
        assert_eq!(of(&[SUM, CUT, OTHER_SUM]), (3, 2, Some(SUM)));
        let length = FrameError::Length { max: 1, found: 2 };
        assert_eq!(of(&[CUT, length]), (2, 0, Some(CUT)));
    }

    /// More than half of the bytes are lost. Of a guessed protocol, only invalid bytes count.
    #[test]
    fn a_protocol_of_few_bytes_is_in_doubt() {
        let framed = |framed, bad| Framed {
            bytes: 100,
            framed,
            bad,
            ..Framed::default()
        };
        let is_doubted = |own: Framed, is_guessed| own.doubt("P", is_guessed).is_some();
        assert!(!is_doubted(framed(50, 50), false) && is_doubted(framed(49, 0), false));
        assert!(!is_doubted(framed(0, 50), true) && is_doubted(framed(49, 51), true));
        assert!(!is_doubted(framed(0, 0), true) && !is_doubted(Framed::default(), false));
    }

    #[test]
    fn a_doubt_tells_its_reasons() {
        let mut framed = Framed {
            bytes: 100,
            framed: 49,
            ..Framed::default()
        };
        let hint = "check the description, the direction and the baud rate";
        let of = |framed: &Framed| framed.doubt("P", false).expect("a doubt");
        assert_eq!(
            of(&framed),
            format!(
                "only 49 of the 100 bytes are in valid frames of P: nothing else in them begins a \
                 frame; {hint}"
            )
        );
        framed.framed = 0;
        framed.add(CUT);
        assert_eq!(
            of(&framed),
            format!(
                "none of the 100 bytes is in a valid frame of P: 1 candidates are no frames, the \
                 first: line went quiet after 4 bytes; {hint}"
            )
        );
        framed.add(SUM);
        assert_eq!(
            of(&framed),
            format!(
                "none of the 100 bytes is in a valid frame of P: 1 candidates have a wrong \
                 checksum, the first: checksum is 0x0002, expected 0x0001; {hint}"
            )
        );
    }
}
