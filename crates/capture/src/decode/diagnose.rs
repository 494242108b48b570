//! Damage of a whole stream. Causes: a host's terminal in text mode, a wrong rate, a line of seven
//! bits. Further causes: an echo, doubled or swapped bytes, a checksum in the other byte order.
//!
//! A diagnosis needs proof in the bytes. A stream of nearly only valid frames gets no diagnosis,
//! whatever it contains; only an echo consists of valid frames.

mod evidence;
mod undone;

use engine::codec::{self, Codec};
use engine::rig::line::Direction;
use evidence::{Counts, doubled, echoed, other_order, slow_sender, swapped};

pub use undone::Change;

/// One direction of a link, as a whole.
#[derive(Clone, Copy, Debug, Default)]
pub struct Line<'a> {
    /// All bytes that arrived.
    pub bytes: &'a [u8],
    /// All bytes of the other direction, if known.
    pub opposite: &'a [u8],
    /// The expected protocol of the line, if known.
    pub codec: Option<&'static Codec>,
    /// Its direction, if known.
    pub direction: Option<Direction>,
    /// Number of characters without a stop bit, if the capture records them.
    pub framing_errors: u64,
    /// Bytes in valid frames by the times of the capture, if it has times: only a silence shows the
    /// end of some frames.
    pub framed: Option<u64>,
    /// The messages between silences, if known.
    pub messages: &'a [Vec<u8>],
}

/// Damage of all bytes of a line, with the evidence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// Each byte comes twice.
    Doubled {
        /// Pairs of equal bytes.
        equal: u64,
        /// Pairs in all.
        pairs: u64,
    },
    /// The two bytes of each pair are swapped.
    Swapped {
        /// Bytes in valid frames after the swap is undone.
        framed: u64,
        /// Bytes in all.
        bytes: u64,
    },
    /// The bytes of the checksum are swapped.
    ChecksumOrder {
        /// Frames whose checksum is correct in the other order.
        other: u64,
        /// Frames whose checksum is correct in the expected order.
        expected: u64,
    },
    /// Sent bytes return as an echo.
    Echo {
        /// Sent frames that were also received, in the order sent.
        back: u64,
        /// Frames sent.
        sent: u64,
    },
    /// The rates of sender and receiver differ, which causes characters without a stop bit.
    FramingErrors {
        /// Characters without a stop bit.
        errors: u64,
        /// Bytes in all.
        bytes: u64,
    },
    /// The receiver is faster than the sender by a whole factor.
    SlowSender {
        /// The factor.
        factor: u32,
        /// Bytes that consist of stretched bits.
        stretched: u64,
        /// Bytes in all.
        bytes: u64,
    },
    /// No byte has its highest bit set.
    SevenBits {
        /// Bytes in all.
        bytes: u64,
    },
    /// 0x00 is missing.
    NulStripped {
        /// Expected count if all values were equally frequent.
        expected: u64,
    },
    /// 0x0D is missing and 0x0A is too frequent.
    CrToLf {
        /// Count of 0x0A.
        found: u64,
        /// Counts of its neighbours.
        expected: u64,
    },
    /// 0x11 and 0x13 are missing.
    FlowControl {
        /// Counts of their neighbours.
        expected: u64,
    },
    /// Bytes that are in no frame become valid frames if this change is undone.
    Undone {
        /// The change.
        change: Change,
        /// Bytes in valid frames after the change is undone.
        framed: u64,
        /// Bytes in all that were examined.
        bytes: u64,
    },
}

impl core::fmt::Display for Damage {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Doubled { equal, pairs } => {
                write!(
                    f,
                    "each byte comes twice ({equal} of {pairs} pairs are equal)"
                )
            }
            Self::Swapped { framed, bytes } => write!(
                f,
                "each two bytes are swapped (swapped back, {framed} of {bytes} are in valid frames)"
            ),
            Self::ChecksumOrder { other, expected } => write!(
                f,
                "the checksum's bytes are swapped ({other} frames hold with the other order, \
                 {expected} with the expected one)"
            ),
            Self::Echo { back, sent } => {
                write!(
                    f,
                    "sent bytes come back: echo ({back} of {sent} frames sent)"
                )
            }
            Self::FramingErrors { errors, bytes } => write!(
                f,
                "wrong baud rate ({errors} characters without a stop bit beside {bytes} bytes)"
            ),
            Self::SlowSender {
                factor,
                stretched,
                bytes,
            } => write!(
                f,
                "wrong baud rate: the receiver is {factor} times as fast as the sender \
                 ({stretched} of {bytes} bytes are made of bits {factor} long)"
            ),
            Self::SevenBits { bytes } => {
                write!(
                    f,
                    "the line carries seven bits (0 of {bytes} bytes have bit 7)"
                )
            }
            Self::NulStripped { expected } => write!(
                f,
                "NUL bytes are missing: the host strips 0x00 (0 times, some {expected} by chance)"
            ),
            Self::CrToLf { found, expected } => write!(
                f,
                "the host turns CR into LF (0 times 0x0D, {found} times 0x0A, its neighbours \
                 {expected} times)"
            ),
            Self::FlowControl { expected } => write!(
                f,
                "the host does software flow control: XON and XOFF are missing (0 times 0x11 and \
                 0x13, their neighbours {expected} times)"
            ),
            Self::Undone {
                change,
                framed,
                bytes,
            } => write!(
                f,
                "{change} (undone, {framed} of {bytes} bytes are in valid frames)"
            ),
        }
    }
}

/// Minimum expected count of a value whose absence is evidence. By chance, a value with this
/// expected count is absent from one in 4e8 streams.
const EXPECTED_MIN: u64 = 20;
/// Minimum number of bytes for a diagnosis.
const BYTES_MIN: u64 = 64;
/// Maximum number of bytes that are examined in slow tests.
const SAMPLE: usize = 128 << 10;

/// Damage of the whole `line`.
pub fn diagnose(line: &Line<'_>) -> Vec<Damage> {
    let (bytes, len) = (line.bytes, line.bytes.len() as u64);
    let sample = &bytes[..bytes.len().min(SAMPLE)];
    let mut damages: Vec<Damage> = echoed(sample, line.opposite).into_iter().collect();
    if line.framing_errors >= 8 && line.framing_errors * 50 >= len {
        let (errors, bytes) = (line.framing_errors, len);
        damages.push(Damage::FramingErrors { errors, bytes });
        return damages;
    }
    let codec = line.codec.or_else(|| codec::guess(bytes));
    let framed = codec.map_or(0, |codec| match (line.framed, line.direction) {
        (Some(framed), _) => framed,
        (None, Some(direction)) => codec.framed_towards(bytes, direction),
        (None, None) => codec.framed(bytes),
    });
    if len < BYTES_MIN || framed * 100 >= len * 98 {
        return damages;
    }
    // These change every byte or frame; other apparent damage follows from them.
    let whole = doubled(sample)
        .or_else(|| swapped(sample, framed * (sample.len() as u64) / len))
        .or_else(|| other_order(sample, line.codec))
        .or_else(|| undone::of_all(line, framed))
        .or_else(|| slow_sender(sample));
    if let Some(damage) = whole {
        damages.push(damage);
    } else {
        let missing = missing(&Counts::of(bytes));
        if missing.is_empty() {
            damages.extend(undone::of_values(line));
        }
        damages.extend(missing);
    }
    damages
}

/// Values that terminals in text mode remove or change.
fn missing(counts: &Counts) -> Vec<Damage> {
    let bytes = counts.len();
    let mut damages = Vec::new();
    if counts.is_text() {
        return damages;
    }
    if bytes >= 8 * BYTES_MIN && counts.high() == 0 {
        return vec![Damage::SevenBits { bytes }];
    }
    let expected = bytes / 256;
    if counts.of_value(0x00) == 0 && expected >= EXPECTED_MIN {
        damages.push(Damage::NulStripped { expected });
    }
    let (found, expected) = (counts.of_value(0x0A), counts.around(0x0A, 0x0D));
    if counts.of_value(0x0D) == 0 && expected >= EXPECTED_MIN && found * 2 >= expected * 3 {
        damages.push(Damage::CrToLf { found, expected });
    }
    let expected = counts.around(0x11, 0x13);
    let none = counts.of_value(0x11) + counts.of_value(0x13) == 0;
    if none && expected >= EXPECTED_MIN {
        damages.push(Damage::FlowControl { expected });
    }
    damages
}

#[cfg(test)]
mod tests;
