//! One line of a transcript, and the lanes that it is about.

use protocols::{FrameError, Instant};

use engine::codec::{Codec, RegisterNames};
use engine::hex;
use engine::rig::line::Direction;

/// One line of a transcript.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Time of its last byte, or of the event.
    pub at: Instant,
    /// Index of the link.
    pub link: usize,
    /// Direction.
    pub direction: Direction,
    /// Offset of its first byte on its line.
    pub place: u64,
    /// Its content.
    pub said: Said,
}

/// Content of a line of a transcript.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Said {
    /// A valid frame, in words.
    Frame(String),
    /// Printable bytes outside of frames, as text.
    Text(String),
    /// Bytes that are neither, and the errors of those that looked like a frame.
    Bad(Vec<u8>, Vec<FrameError>),
    /// Bytes of a line with an unknown protocol, one message.
    Data(Vec<u8>),
    /// An event of the line besides bytes, or a fault, as text.
    Event(String),
}

impl core::fmt::Display for Said {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Frame(words) | Self::Text(words) => f.write_str(words),
            Self::Event(words) => write!(f, "EVENT {words}"),
            Self::Data(bytes) => {
                let shown = hex::pairs(&bytes[..bytes.len().min(32)]);
                let more = if bytes.len() > 32 { " .." } else { "" };
                write!(f, "DATA {} bytes {shown}{more}", bytes.len())
            }
            Self::Bad(bytes, errors) => {
                let shown = bytes[..bytes.len().min(32)].escape_ascii();
                let more = if bytes.len() > 32 { ".." } else { "" };
                write!(f, "BAD {} bytes \"{shown}{more}\"", bytes.len())?;
                errors.iter().try_for_each(|error| write!(f, "; {error}"))
            }
        }
    }
}

/// Knowledge about one direction of a link before its bytes are read.
#[derive(Clone, Debug)]
pub struct Known {
    /// Name of the link.
    pub link: String,
    /// Direction.
    pub direction: Direction,
    /// The expected protocol, if the direction has frames of it.
    pub codec: Option<&'static Codec>,
    /// Names of its registers, if the link is a register bus.
    pub names: Option<RegisterNames>,
}

/// Totals of one lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sum {
    /// Index of the link.
    pub link: usize,
    /// Direction.
    pub direction: Direction,
    /// The recognised protocol, if any frame was found.
    pub codec: Option<&'static Codec>,
    /// Bytes in all.
    pub bytes: u64,
    /// Bytes in valid frames.
    pub framed: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of many bytes, 32 are shown.
    #[test]
    fn data_is_shown_up_to_a_limit() {
        let shown = |len: usize| Said::Data(vec![0xAB; len]).to_string();
        let pairs = vec!["AB"; 32].join(" ");
        assert_eq!(shown(32), format!("DATA 32 bytes {pairs}"));
        assert_eq!(shown(33), format!("DATA 33 bytes {pairs} .."));
        let error = FrameError::Truncated { found: 4 };
        let bad = Said::Bad(b"x".to_vec(), vec![error, error]).to_string();
        let quiet = "line went quiet after 4 bytes";
        assert_eq!(bad, format!("BAD 1 bytes \"x\"; {quiet}; {quiet}"));
    }
}
