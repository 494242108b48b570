//! A wire format for the table, and its test: any bytes become a stream, and every decoder must
//! keep its laws on this stream.
//!
//! The same functions serve `hilrig fuzz`, the coverage-guided targets of the folder `fuzz`, the
//! bench, and the replay of the corpus in the tests. These functions and the table need only the
//! wire formats, so an instrumented build of them is small.

mod choices;
mod laws;
mod marks;
mod stream;
mod texts;

pub use choices::Choices;
pub use laws::keeps_the_laws;
pub use marks::Mark;
pub use stream::{Piece, Stream, StreamError};

use core::fmt;

use protocols::{Decode, FrameError};

use crate::hex;

/// A wire format.
pub trait Wire {
    /// Its decoder. A copy continues as the original would.
    type Decoder: Decode<Frame: Clone + Send> + Clone + Send;

    /// Name of the format, as on the command line.
    const NAME: &'static str;

    /// A fresh decoder.
    fn decoder() -> Self::Decoder;

    /// A frame's bytes.
    fn bytes(frame: &<Self::Decoder as Decode>::Frame) -> &[u8];

    /// Meaning of a frame, on one line.
    fn words(frame: &<Self::Decoder as Decode>::Frame) -> String {
        hex::pairs(Self::bytes(frame))
    }

    /// Appends a valid frame to `out`.
    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>);

    /// Corrects lengths and checksum of the damaged `frame`, if it still has room for them.
    fn repair(frame: &mut [u8]);

    /// Length of the frame at the start of `bytes`, from a slow and simple reference implementation
    /// that does not use the tested code.
    fn frame_at(bytes: &[u8]) -> Option<usize>;

    /// The length of the frame at the start of `bytes`, if it is a frame regardless of the bytes
    /// before it. A decoder never discards such a frame. By default every frame qualifies. Override
    /// this for formats in which only another frame distinguishes a frame from noise.
    fn unmistakable_at(bytes: &[u8]) -> Option<usize> {
        Self::frame_at(bytes)
    }

    /// Whether encoding the decoded parts gives the same frame.
    ///
    /// # Errors
    /// The broken law, if the frames differ.
    fn means_itself(frame: &<Self::Decoder as Decode>::Frame) -> Result<(), Broken> {
        let _ = frame;
        Ok(())
    }

    /// Whether the values of a valid frame are possible: impossible values are no evidence for this
    /// format.
    fn is_plausible(frame: &<Self::Decoder as Decode>::Frame) -> bool {
        let _ = frame;
        true
    }

    /// The kind of the frame, below 2^32: a fuzzer treats frames of one kind as equal.
    fn kind(frame: &<Self::Decoder as Decode>::Frame) -> u64 {
        Self::bytes(frame).len() as u64
    }
}

/// A law that was broken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Broken {
    /// Name of the law in kebab case; the same cause has the same name.
    pub law: &'static str,
    /// A sentence with the figures.
    pub detail: String,
}

impl Broken {
    /// A violation of the law `law`.
    pub fn new(law: &'static str, detail: impl Into<String>) -> Self {
        let detail = detail.into();
        Self { law, detail }
    }
}

impl fmt::Display for Broken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.law, self.detail)
    }
}

impl core::error::Error for Broken {}

/// A decoder that accepts any bytes.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Its name, as on the command line and of its folder in the corpus.
    pub name: &'static str,
    /// Makes a stream from a fuzzer's bytes.
    pub stream: fn(&[u8]) -> Stream,
    /// Whether the laws hold on a stream.
    pub check: fn(&Stream) -> Result<(), Broken>,
    /// The decoder's reactions to a stream, as numbers.
    pub marks: fn(&Stream, Mark<'_>),
    /// Generator of its streams.
    pub holds: Holds,
    /// Number of cases that a fuzzer tries in one round; smaller for long cases.
    pub round: u64,
}

/// Default number of cases in one round.
const ROUND: u64 = 4096;

/// Generator of a target's streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holds {
    /// Sessions of frames, damage and pauses.
    Frames,
    /// Bytes as they are.
    Bytes,
}

impl Target {
    /// Formats without frames: coded rows of a map, and the radio's commands.
    pub const TEXTS: [Self; 2] = [
        Self {
            name: "rle",
            stream: Stream::raw,
            check: texts::rows_survive_their_code,
            marks: marks::of_row,
            holds: Holds::Bytes,
            round: ROUND,
        },
        Self {
            name: "hc06",
            stream: Stream::raw,
            check: texts::commands_are_said_as_heard,
            marks: marks::of_command,
            holds: Holds::Bytes,
            round: ROUND,
        },
    ];

    /// The decoder of `W`.
    pub const fn of<W: Wire>() -> Self {
        Self {
            name: W::NAME,
            stream: Stream::session::<W>,
            check: keeps_the_laws::<W>,
            marks: marks::of_session::<W>,
            holds: Holds::Frames,
            round: ROUND,
        }
    }

    /// A target whose streams are plain bytes, without known laws.
    pub const fn bytes(name: &'static str) -> Self {
        Self {
            name,
            stream: Stream::raw,
            check: |_| Ok(()),
            marks: |_, _| {},
            holds: Holds::Bytes,
            round: ROUND,
        }
    }

    /// Data from which [`stream`](Self::stream) makes `stream`.
    pub fn data_of(&self, stream: &Stream) -> Vec<u8> {
        match self.holds {
            Holds::Frames => stream.to_data(),
            Holds::Bytes => stream.bytes().to_vec(),
        }
    }

    /// Entry point for a coverage-guided fuzzer, with any bytes.
    ///
    /// # Panics
    /// If a law is broken: a fuzzer detects failures by panics.
    pub fn fuzz(&self, data: &[u8]) {
        let stream = (self.stream)(data);
        if let Err(broken) = (self.check)(&stream) {
            panic!("{broken}\n{}", stream.to_text());
        }
    }
}

/// The law that a frame rebuilt from its parts is the same.
pub(super) fn made_again(found: &[u8], made: &[u8]) -> Result<(), Broken> {
    if found == made {
        return Ok(());
    }
    let detail = format!("{found:02X?} built again from its parts is {made:02X?}");
    Err(Broken::new("frame-means-itself", detail))
}

/// Key of an error, without its figures.
const fn kind_of(error: FrameError) -> u8 {
    match error {
        FrameError::Checksum { .. } => 1,
        FrameError::Length { .. } => 2,
        FrameError::Truncated { .. } => 3,
        _ => 4,
    }
}
