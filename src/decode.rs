//! Bytes in words: frames with their place and meaning, and what is wrong with the bytes between.

pub mod diagnose;
pub mod summary;

use core::ops::Range;

use protocols::avr::{self, ChecksumOrder};
use protocols::xv11::{self, turn};
use protocols::{Decode, FrameError, pcui};

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
}

impl Protocol {
    /// All of them; where two fit equally well, the first is taken.
    pub const ALL: [Self; 5] = [
        Self::Xv11,
        Self::Xv11Turn,
        Self::Bus,
        Self::BusHighFirst,
        Self::Pcui,
    ];

    /// Name as on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Xv11 => "xv11",
            Self::Xv11Turn => "xv11-turn",
            Self::Bus => "bus",
            Self::BusHighFirst => "bus-high-first",
            Self::Pcui => "pcui",
        }
    }

    /// The protocol with the most bytes of `bytes` in sound frames, if any has a frame.
    pub fn guess(bytes: &[u8]) -> Option<Self> {
        let framed = |protocol: &Self| {
            let mut stream = Stream::new(*protocol);
            let mut found = stream.push(bytes);
            found.extend(stream.idle());
            let frames = found.iter().filter(|one| one.is_frame());
            frames.map(|one| one.bytes.len()).sum::<usize>()
        };
        let mut best = None;
        for protocol in Self::ALL {
            let score = framed(&protocol);
            if score > best.map_or(0, |(_, best)| best) {
                best = Some((protocol, score));
            }
        }
        best.map(|(protocol, _)| protocol)
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

impl ExactLen for Range<u64> {
    fn len(&self) -> usize {
        usize::try_from(self.end - self.start).expect("no longer than what was fed")
    }
}

/// Length of a range of places in a stream.
trait ExactLen {
    fn len(&self) -> usize;
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
    errors: Vec<FrameError>,
}

/// Errors kept of one stretch of bad bytes.
const ERRORS_MAX: usize = 8;

impl Stream {
    /// Nothing fed yet.
    pub fn new(protocol: Protocol) -> Self {
        let spotter: Box<dyn Spot> = match protocol {
            Protocol::Xv11 => spotter(xv11::Decoder::default(), |frame| {
                (frame.as_bytes().len(), packet(frame))
            }),
            Protocol::Xv11Turn => spotter(turn::Decoder::default(), |frame| {
                let words = format!("turn, period word {:#06x}", frame.period());
                (frame.as_bytes().len(), words)
            }),
            Protocol::Bus => bus(ChecksumOrder::LowFirst),
            Protocol::BusHighFirst => bus(ChecksumOrder::HighFirst),
            Protocol::Pcui => spotter(pcui::Decoder::default(), |frame| {
                let words = match frame.message() {
                    Ok(message) => format!("{message:?}"),
                    Err(error) => format!("{}: {error}", frame.id().escape_ascii()),
                };
                (frame.as_bytes().len(), words)
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
        found.extend(self.place.tell_bad(self.place.fed));
        found
    }
}

impl Place {
    fn tell_bad(&mut self, until: u64) -> Option<Found> {
        let bytes = self.told..until;
        self.told = until;
        let what = What::Bad(core::mem::take(&mut self.errors));
        (!bytes.is_empty()).then_some(Found { bytes, what })
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
            match outcome {
                Ok(frame) => {
                    let (len, words) = (self.words)(&frame);
                    let end = place.fed - (bytes.len() + self.decoder.pending()) as u64;
                    let start = end - len as u64;
                    found.extend(place.tell_bad(start));
                    place.told = end;
                    let (bytes, what) = (start..end, What::Frame(words));
                    found.push(Found { bytes, what });
                }
                Err(error) if place.errors.len() < ERRORS_MAX => place.errors.push(error),
                Err(_) => {}
            }
        }
        found
    }

    fn idle(&mut self) {
        self.decoder.idle();
    }
}

fn packet(frame: &xv11::Frame) -> String {
    use core::fmt::Write as _;
    let degree = u32::from(frame.index()) * 4;
    let mut out = format!("{:.2} rpm, from {degree} deg:", frame.speed_rpm());
    for reading in frame.readings() {
        match reading {
            xv11::Reading::Range {
                distance_mm, weak, ..
            } => {
                let mark = if weak { "?" } else { "" };
                write!(out, " {distance_mm}{mark}")
            }
            xv11::Reading::Invalid { code, .. } => write!(out, " ({code:02X})"),
        }
        .expect("a string takes everything");
    }
    out + " mm"
}

fn bus(order: ChecksumOrder) -> Box<dyn Spot> {
    spotter(avr::Decoder::new(order), |frame| {
        let (register, count) = (frame.register(), frame.count());
        let words = if frame.is_write() {
            let data = frame.data().iter().map(|byte| format!(" {byte:02X}"));
            format!("register {register} is{}", data.collect::<String>())
        } else {
            format!("read {count} from register {register}")
        };
        (frame.as_bytes().len(), words)
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
