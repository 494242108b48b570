//! Bytes in words: frames with their place and meaning, and what is wrong with the bytes between.

pub(crate) mod words;

use core::ops::Range;

use protocols::avr::{self, ChecksumOrder};
use protocols::xv11::{self, turn};
use protocols::{Decode, FrameError, panel, pcui};

/// A wire format that can be told from its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum Protocol {
    /// XV-11 lidar, frames of four readings
    Xv11,
    /// XV-11 lidar with the old firmware, a turn a frame
    Xv11Turn,
    /// Register bus, checksum low byte first
    Bus,
    /// Register bus, checksum high byte first
    BusHighFirst,
    /// Messages between robot and PC
    Pcui,
    /// Touch panel: drawing commands and pen reports
    Panel,
}

impl Protocol {
    /// All of them; where two fit equally well, the first is taken.
    pub const ALL: [Self; 6] = [
        Self::Xv11,
        Self::Xv11Turn,
        Self::Bus,
        Self::BusHighFirst,
        Self::Pcui,
        Self::Panel,
    ];

    /// Name as on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Xv11 => "xv11",
            Self::Xv11Turn => "xv11-turn",
            Self::Bus => "bus",
            Self::BusHighFirst => "bus-high-first",
            Self::Pcui => "pcui",
            Self::Panel => "panel",
        }
    }

    /// The protocol with the most bytes of `bytes` in sound frames, if any has a frame.
    pub fn guess(bytes: &[u8]) -> Option<Self> {
        Self::best(bytes).map(|(protocol, _)| protocol)
    }

    /// The same, with how many bytes those are.
    pub fn best(bytes: &[u8]) -> Option<(Self, u64)> {
        let mut best = None;
        for protocol in Self::ALL {
            let score = protocol.framed(bytes);
            if score > best.map_or(0, |(_, best)| best) {
                best = Some((protocol, score));
            }
        }
        best
    }

    /// Bytes of `bytes` that are in sound frames.
    pub fn framed(self, bytes: &[u8]) -> u64 {
        let frames = self.frames(bytes);
        frames.iter().map(|one| one.end - one.start).sum()
    }

    /// Places of the sound frames in `bytes`.
    pub fn frames(self, bytes: &[u8]) -> Vec<Range<u64>> {
        let mut stream = Stream::new(self);
        let mut found = stream.push(bytes);
        found.extend(stream.idle());
        let frames = found.into_iter().filter(Found::is_frame);
        frames.map(|one| one.bytes).collect()
    }
}

/// What some bytes of a stream are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// Which bytes, counted from the start of the stream.
    pub bytes: Range<u64>,
    /// What they are.
    pub what: What,
}

/// What bytes are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum What {
    /// A sound frame, in words.
    Frame(String),
    /// No part of a frame; why the candidates among them, if any, were none.
    Bad(Vec<FrameError>),
}

impl Found {
    /// Whether it is a frame.
    pub const fn is_frame(&self) -> bool {
        matches!(self.what, What::Frame(_))
    }
}

/// The decoder of one direction of a link that keeps count of where it is.
pub struct Stream {
    spotter: Box<dyn Spot>,
    place: Place,
}

#[derive(Default)]
struct Place {
    fed: u64,
    /// Up to here everything has been told.
    told: u64,
    /// Why candidates were none, with the place of the byte that it cost.
    errors: Vec<(u64, FrameError)>,
}

/// Most bad bytes that are told as one stretch.
pub const BAD_MAX: u64 = 256;
/// Errors kept of one stretch of bad bytes.
const ERRORS_MAX: usize = 8;

impl Stream {
    /// Nothing fed yet.
    pub fn new(protocol: Protocol) -> Self {
        let spotter: Box<dyn Spot> = match protocol {
            Protocol::Xv11 => spotter(xv11::Decoder::default(), |frame| {
                (frame.as_bytes().len(), words::packet(frame))
            }),
            Protocol::Xv11Turn => spotter(turn::Decoder::default(), |frame| {
                (frame.as_bytes().len(), words::turn(frame))
            }),
            Protocol::Bus => bus(ChecksumOrder::LowFirst),
            Protocol::BusHighFirst => bus(ChecksumOrder::HighFirst),
            Protocol::Pcui => spotter(pcui::Decoder::default(), |frame| {
                (frame.as_bytes().len(), words::message(frame))
            }),
            Protocol::Panel => spotter(panel::Decoder::default(), |frame| {
                (frame.as_bytes().len(), words::panel(frame))
            }),
        };
        let place = Place::default();
        Self { spotter, place }
    }

    /// Takes more bytes; what can be told by now.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<Found> {
        self.place.fed += bytes.len() as u64;
        self.spotter.spot(bytes, &mut self.place)
    }

    /// The line went quiet: what is pending will not be finished.
    pub fn idle(&mut self) -> Vec<Found> {
        self.spotter.idle();
        let mut found = self.spotter.spot(&[], &mut self.place);
        self.place.tell_bad(self.place.fed, &mut found);
        found
    }
}

impl Place {
    /// What lies before `until` and was not told is bad; in stretches that do not depend on how the
    /// bytes came.
    fn tell_bad(&mut self, until: u64, found: &mut Vec<Found>) {
        while self.told < until {
            let end = until.min(self.told + BAD_MAX);
            let own = self.errors.partition_point(|&(at, _)| at < end);
            let errors = self.errors.drain(..own).map(|(_, error)| error);
            let what = What::Bad(errors.take(ERRORS_MAX).collect());
            let bytes = self.told..end;
            self.told = end;
            found.push(Found { bytes, what });
        }
    }

    /// Tells whole stretches of bad bytes before `until`.
    fn tell_whole(&mut self, until: u64, found: &mut Vec<Found>) {
        let whole = (until - self.told) / BAD_MAX * BAD_MAX;
        self.tell_bad(self.told + whole, found);
    }
}

/// A decoder of any protocol.
trait Spot {
    fn spot(&mut self, bytes: &[u8], place: &mut Place) -> Vec<Found>;
    fn idle(&mut self);
}

struct Spotter<D, W> {
    decoder: D,
    words: W,
}

fn spotter<D, W>(decoder: D, words: W) -> Box<dyn Spot>
where
    D: Decode + 'static,
    W: Fn(&D::Frame) -> (usize, String) + 'static,
{
    Box::new(Spotter { decoder, words })
}

impl<D: Decode, W: Fn(&D::Frame) -> (usize, String)> Spot for Spotter<D, W> {
    fn spot(&mut self, mut bytes: &[u8], place: &mut Place) -> Vec<Found> {
        let mut found = Vec::new();
        while let Some(outcome) = self.decoder.step(&mut bytes) {
            let end = place.fed - (bytes.len() + self.decoder.pending()) as u64;
            match outcome {
                Ok(frame) => {
                    let (len, words) = (self.words)(&frame);
                    let start = end - len as u64;
                    place.tell_bad(start, &mut found);
                    place.told = end;
                    let (bytes, what) = (start..end, What::Frame(words));
                    found.push(Found { bytes, what });
                }
                Err(error) => {
                    place.errors.push((end - 1, error));
                    place.tell_whole(end, &mut found);
                }
            }
        }
        let settled = place.fed - self.decoder.pending() as u64;
        place.tell_whole(settled, &mut found);
        found
    }

    fn idle(&mut self) {
        self.decoder.idle();
    }
}

fn bus(order: ChecksumOrder) -> Box<dyn Spot> {
    spotter(avr::Decoder::new(order), |frame| {
        (frame.as_bytes().len(), words::bus(frame))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The register read of the seed's bus chapter and noise around it.
    #[test]
    fn frames_and_bad_bytes_cover_the_stream() {
        let frame = avr::Frame::read(36, 10, ChecksumOrder::LowFirst);
        let bytes = [b"AT", frame.as_bytes(), frame.as_bytes(), &[0xAB, 1]].concat();
        for size in 1..bytes.len() {
            let mut stream = Stream::new(Protocol::Bus);
            let mut found: Vec<Found> = bytes.chunks(size).flat_map(|b| stream.push(b)).collect();
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
        assert_eq!(Protocol::guess(&bytes), Some(Protocol::Bus));
        assert_eq!(Protocol::guess(b"nothing of ours"), None);
    }
}
