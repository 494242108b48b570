//! One direction of a link, split into frames and other bytes.
//!
//! ```
//! use hilrig_engine::codec::{BUS_HIGH_FIRST, What};
//!
//! // A stray byte, then the golden read of ten registers from 36 (field firmware b77a6df).
//! let bytes = [0x55, 0xAB, 0x24, 0x0A, 0x00, 0xD9];
//! let found = BUS_HIGH_FIRST.found(&bytes);
//! assert_eq!(found[0].bytes, 0..1);
//! assert!(matches!(&found[1].what, What::Frame(words) if words.contains("36")));
//! ```

use core::ops::Range;

use protocols::FrameError;

use super::any_decoder::AnyDecoder;
use super::row::Codec;
use crate::rig::direction::Direction;

/// A stretch of a stream with its meaning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// Range of bytes, counted from the start of the stream.
    pub bytes: Range<u64>,
    /// The meaning.
    pub what: What,
}

/// The meaning of bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum What {
    /// A valid frame as text.
    Frame(String),
    /// Bytes outside all frames, with the errors of the candidates among them, if any.
    Bad(Vec<FrameError>),
}

impl Stretch {
    /// Whether the stretch is a frame.
    pub const fn is_frame(&self) -> bool {
        matches!(self.what, What::Frame(_))
    }
}

/// The decoder of one direction of a link. It counts its position.
#[derive(Clone)]
pub struct Stream {
    decoder: Box<dyn AnyDecoder>,
    place: Progress,
    /// Whether the format is a value instead of a type.
    is_own: bool,
}

#[derive(Clone, Default)]
struct Progress {
    fed: u64,
    /// Position up to which everything has been reported.
    told: u64,
    /// Reasons of rejected candidates, with the position of the lost byte.
    errors: Vec<(u64, FrameError)>,
}

/// Maximum number of bad bytes that are reported as one stretch.
pub const BAD_MAX: u64 = 256;
/// Maximum number of errors kept for one stretch of bad bytes.
const ERRORS_MAX: usize = 8;

impl Codec {
    /// All frames and bad stretches of `bytes`, which are followed by a pause.
    pub fn found(&'static self, bytes: &[u8]) -> Vec<Stretch> {
        Stream::new(self).all(bytes)
    }

    /// As [`found`](Self::found), for bytes in this direction.
    pub fn found_towards(&'static self, bytes: &[u8], direction: Direction) -> Vec<Stretch> {
        Stream::towards(self, direction).all(bytes)
    }
}

impl Stream {
    /// A stream without bytes.
    pub fn new(codec: &Codec) -> Self {
        Self::of(codec, codec.decoder())
    }

    /// A stream of bytes in this direction, without bytes yet.
    pub fn towards(codec: &Codec, direction: Direction) -> Self {
        Self::of(codec, codec.decoder_towards(direction))
    }

    fn of(codec: &Codec, decoder: Box<dyn AnyDecoder>) -> Self {
        Self {
            decoder,
            place: Progress::default(),
            is_own: codec.is_own(),
        }
    }

    fn all(mut self, bytes: &[u8]) -> Vec<Stretch> {
        let mut found = self.push(bytes);
        found.extend(self.idle());
        found
    }

    /// Takes more bytes and returns the stretches known by now.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<Stretch> {
        self.place.fed += bytes.len() as u64;
        self.settle(bytes)
    }

    /// Handles a silence of the line: a partial frame will not be completed.
    pub fn idle(&mut self) -> Vec<Stretch> {
        let known = self.place.errors.len();
        self.decoder.idle();
        let mut found = self.settle(&[]);
        if self.is_own {
            self.place.keep_first_checksum(known);
        }
        self.place.report_bad(self.place.fed, &mut found);
        found
    }

    /// Takes bytes that passed in the other direction before the next ones of this stream.
    pub fn beside(&mut self, bytes: &[u8]) {
        self.decoder.beside(bytes);
    }

    /// Number of bytes that may belong to a frame whose end is missing.
    pub fn pending(&self) -> usize {
        self.decoder.pending()
    }

    fn settle(&mut self, mut bytes: &[u8]) -> Vec<Stretch> {
        let Self { decoder, place, .. } = self;
        let mut found = Vec::new();
        while let Some(outcome) = decoder.step(&mut bytes) {
            let end = place.fed - (bytes.len() + decoder.pending()) as u64;
            match outcome {
                Ok(len) => {
                    let start = end - len as u64;
                    place.report_bad(start, &mut found);
                    place.told = end;
                    let (bytes, what) = (start..end, What::Frame(decoder.words()));
                    found.push(Stretch { bytes, what });
                }
                Err(error) => {
                    place.errors.push((end - 1, error));
                    place.report_whole(end, &mut found);
                }
            }
        }
        let settled = place.fed - decoder.pending() as u64;
        place.report_whole(settled, &mut found);
        found
    }
}

impl Progress {
    /// Keeps the first checksum error behind the first `known` errors. A silence ended a frame with
    /// a wrong checksum; the decoder then also tries each part of it, which proves nothing.
    fn keep_first_checksum(&mut self, known: usize) {
        let mut behind = self.errors.split_off(known.min(self.errors.len()));
        let mut is_first = true;
        behind.retain(|(_, error)| {
            !matches!(error, FrameError::Checksum { .. }) || core::mem::take(&mut is_first)
        });
        self.errors.append(&mut behind);
    }

    /// Reports the remaining bytes before `until` as bad. The stretches do not depend on the
    /// chunking.
    fn report_bad(&mut self, until: u64, found: &mut Vec<Stretch>) {
        while self.told < until {
            let end = until.min(self.told + BAD_MAX);
            let own = self.errors.partition_point(|&(at, _)| at < end);
            let errors = self.errors.drain(..own).map(|(_, error)| error);
            let what = What::Bad(errors.take(ERRORS_MAX).collect());
            let bytes = self.told..end;
            self.told = end;
            found.push(Stretch { bytes, what });
        }
    }

    /// Reports whole stretches of bad bytes before `until`.
    fn report_whole(&mut self, until: u64, found: &mut Vec<Stretch>) {
        let whole = (until - self.told) / BAD_MAX * BAD_MAX;
        self.report_bad(self.told + whole, found);
    }
}

/// Counts of one direction of a link, without the text of frames.
#[derive(Clone)]
pub struct Counter {
    decoder: Box<dyn AnyDecoder>,
}

/// Counts of a [`Counter`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    /// Valid frames.
    pub frames: u64,
    /// Bytes in these frames.
    pub bytes: u64,
    /// Rejected candidates for a frame.
    pub errors: u64,
}

impl Counter {
    /// A counter without bytes.
    pub fn new(codec: &Codec) -> Self {
        let decoder = codec.decoder();
        Self { decoder }
    }

    /// A counter of the frames of this direction, without bytes so far.
    pub fn towards(codec: &Codec, direction: Direction) -> Self {
        let decoder = codec.decoder_towards(direction);
        Self { decoder }
    }

    /// Takes more bytes and returns the counts that they add.
    pub fn push(&mut self, mut bytes: &[u8]) -> Count {
        let mut count = Count::default();
        while let Some(outcome) = self.decoder.step(&mut bytes) {
            match outcome {
                Ok(len) => {
                    count.frames += 1;
                    count.bytes += len as u64;
                }
                Err(_) => count.errors += 1,
            }
        }
        count
    }

    /// Number of bytes that may belong to a frame whose end is missing.
    pub fn pending(&self) -> usize {
        self.decoder.pending()
    }

    /// Handles a silence of the line: a partial frame will not be completed.
    pub fn idle(&mut self) -> Count {
        self.decoder.idle();
        self.push(&[])
    }
}

/// The valid frames of one direction of a link, with their bytes.
#[derive(Clone)]
pub struct FrameBytes {
    decoder: Box<dyn AnyDecoder>,
    /// Bytes that may belong to a frame whose end is missing.
    tail: Vec<u8>,
}

impl FrameBytes {
    /// The frames of this direction, without bytes so far.
    pub fn towards(codec: &Codec, direction: Direction) -> Self {
        Self {
            decoder: codec.decoder_towards(direction),
            tail: Vec::new(),
        }
    }

    /// Takes more bytes; calls `visit` with each frame that they complete.
    pub fn push(&mut self, bytes: &[u8], visit: &mut dyn FnMut(&[u8])) {
        self.tail.extend_from_slice(bytes);
        let mut rest = bytes;
        while let Some(outcome) = self.decoder.step(&mut rest) {
            let behind = rest.len() + self.decoder.pending();
            if let Ok(len) = outcome {
                let end = self.tail.len() - behind;
                visit(&self.tail[end - len..end]);
            }
        }
        let settled = self.tail.len() - self.decoder.pending();
        self.tail.drain(..settled);
    }

    /// Handles a silence of the line: a partial frame will not be completed.
    pub fn idle(&mut self, visit: &mut dyn FnMut(&[u8])) {
        self.decoder.idle();
        self.push(&[], visit);
    }
}

#[cfg(test)]
mod tests {
    use protocols::avr::{self, ChecksumOrder};

    use super::super::BUS;
    use super::*;

    /// The register read of the seed's bus chapter and noise around it.
    #[test]
    fn frames_and_bad_bytes_cover_the_stream() {
        let frame = avr::Frame::read(36, 10, ChecksumOrder::LowFirst);
        let bytes = [b"AT", frame.as_bytes(), frame.as_bytes(), &[0xAB, 1]].concat();
        for size in 1..bytes.len() {
            let mut stream = Stream::new(&BUS);
            let mut found: Vec<Stretch> = bytes.chunks(size).flat_map(|b| stream.push(b)).collect();
            found.extend(stream.idle());
            let places: Vec<_> = found
                .iter()
                .map(|f| (f.bytes.clone(), f.is_frame()))
                .collect();
            let expected = [(0..2, false), (2..7, true), (7..12, true), (12..14, false)];
            assert_eq!(places, expected);
            let What::Bad(errors) = &found[3].what else {
                panic!("{found:?}")
            };
            assert_eq!(errors, &[FrameError::Truncated { found: 2 }]);
        }
    }

    /// The same bytes in chunks of each size: the two frames, and nothing else.
    #[test]
    fn frames_come_with_their_bytes() {
        let frames =
            [36, 40].map(|register| avr::Frame::read(register, 10, ChecksumOrder::LowFirst));
        let [first, second] = frames.map(|frame| frame.as_bytes().to_vec());
        let bytes = [b"AT", &first[..], &second, &[0xAB, 1]].concat();
        for size in 1..bytes.len() {
            let mut frames = FrameBytes::towards(&BUS, Direction::ToDevice);
            let mut found = Vec::new();
            let mut visit = |frame: &[u8]| found.push(frame.to_vec());
            for chunk in bytes.chunks(size) {
                frames.push(chunk, &mut visit);
            }
            frames.idle(&mut visit);
            assert_eq!(found, [first.clone(), second.clone()], "{size}");
        }
    }
}
