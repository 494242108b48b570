//! Register bus of the rescue robot's AVR base: short requests and replies, 1 Mbaud.
//!
//! ```text
//! | AB | register u8 | W(7) count(6..0) | count data bytes, only if W | checksum u16 |
//! ```
//!
//! A request with W writes, a request without W reads `count` registers. The slave answers a read
//! with a frame that has W set, and a write with the empty frame of the same register. It answers a
//! frame that it cannot accept with the one of [`ERROR_REGISTER`]. So an acknowledgement has the
//! same bytes as a request to read nothing, and no field gives a frame's direction or order.
//!
//! Sources: seed report 2015, chapter on the slave protocol; field firmware b77a6df, whose bytes
//! are the golden vectors of this file's tests.

pub mod registers;

use crate::{Candidate, Format, FrameError};

/// First byte of every frame.
pub const START: u8 = 0xAB;
/// Most data bytes in a frame: seven bits of count.
pub const DATA_MAX: usize = 127;
/// Bytes around the data.
pub const OVERHEAD: usize = 5;
/// The longest frame.
pub const FRAME_MAX: usize = DATA_MAX + OVERHEAD;
/// Line rate of the bus.
pub const BAUD: u32 = 1_000_000;

/// Register of the slave's answer to a frame with a bad checksum: the acknowledgement of register
/// 255, in the byte order of the fielded firmware (`AB FF 00 01 AA`).
pub const ERROR_REGISTER: u8 = 0xFF;

const WRITE: u8 = 0x80;

/// Byte order of the checksum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ChecksumOrder {
    /// Order of the seed report.
    #[default]
    LowFirst,
    /// Order of the fielded firmware.
    HighFirst,
}

/// A frame whose start and checksum were verified.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    bytes: [u8; FRAME_MAX],
    len: usize,
}

impl Frame {
    /// A request to read `count` (at most 127) registers from `register` on; also, with a count of
    /// zero, the acknowledgement of a write.
    pub fn read(register: u8, count: u8, order: ChecksumOrder) -> Self {
        Self::build(register, count & !WRITE, &[], order)
    }

    /// A request to write `data` to the registers from `register` on; also the reply to a read.
    /// Data beyond 127 bytes does not fit the format and is left out.
    pub fn write(register: u8, data: &[u8], order: ChecksumOrder) -> Self {
        let data = &data[..data.len().min(DATA_MAX)];
        let count = u8::try_from(data.len()).expect("at most 127");
        Self::build(register, count | WRITE, data, order)
    }

    fn build(register: u8, control: u8, data: &[u8], order: ChecksumOrder) -> Self {
        let mut bytes = [0; FRAME_MAX];
        bytes[..3].copy_from_slice(&[START, register, control]);
        bytes[3..3 + data.len()].copy_from_slice(data);
        let end = 3 + data.len();
        let sum = checksum(&bytes[..end]);
        let sum = match order {
            ChecksumOrder::LowFirst => sum.to_le_bytes(),
            ChecksumOrder::HighFirst => sum.to_be_bytes(),
        };
        bytes[end..end + 2].copy_from_slice(&sum);
        Self {
            bytes,
            len: end + 2,
        }
    }

    /// The first register in question.
    pub const fn register(&self) -> u8 {
        self.bytes[1]
    }

    /// Whether the frame carries data: a write request or the reply to a read.
    pub const fn is_write(&self) -> bool {
        self.bytes[2] & WRITE != 0
    }

    /// Number of registers in question.
    pub const fn count(&self) -> u8 {
        self.bytes[2] & !WRITE
    }

    /// The data; empty unless [`is_write`](Self::is_write).
    pub fn data(&self) -> &[u8] {
        &self.bytes[3..self.len - 2]
    }

    /// The frame as on the wire.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

impl core::fmt::Debug for Frame {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "avr::Frame({:02X?})", self.as_bytes())
    }
}

/// Sum of all bytes before the checksum, start byte included, modulo 65536.
pub fn checksum(bytes: &[u8]) -> u16 {
    bytes
        .iter()
        .fold(0, |sum, &byte| sum.wrapping_add(u16::from(byte)))
}

/// Length of the frame with this byte of count and direction, checksum included.
pub const fn frame_len(control: u8) -> usize {
    let data = if control & WRITE == 0 {
        0
    } else {
        control & !WRITE
    };
    3 + data as usize + 2
}

/// The frame format, for [`crate::Decoder`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Bus {
    /// Byte order of the checksum.
    pub order: ChecksumOrder,
}

/// Finds frames in the byte stream. Its owner must report an idle line: otherwise a damaged count
/// swallows up to 127 following bytes.
pub type Decoder = crate::Decoder<Bus, FRAME_MAX>;

impl Decoder {
    /// A decoder for frames of the given checksum order.
    pub const fn new(order: ChecksumOrder) -> Self {
        Self::with_format(Bus { order })
    }
}

impl Format for Bus {
    type Frame = Frame;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        if bytes[0] != START {
            return Candidate::Noise;
        }
        let Some(&control) = bytes.get(2) else {
            return Candidate::Incomplete;
        };
        let end = frame_len(control) - 2;
        let Some(&[first, second]) = bytes.get(end..end + 2) else {
            return Candidate::Incomplete;
        };
        let found = match self.order {
            ChecksumOrder::LowFirst => u16::from_le_bytes([first, second]),
            ChecksumOrder::HighFirst => u16::from_be_bytes([first, second]),
        };
        let expected = checksum(&bytes[..end]);
        if expected == found {
            Candidate::Complete(end + 2)
        } else {
            Candidate::Rejected(FrameError::Checksum {
                expected: u32::from(expected),
                found: u32::from(found),
            })
        }
    }

    fn frame(&self, bytes: &[u8]) -> Frame {
        let mut frame = Frame {
            bytes: [0; FRAME_MAX],
            len: bytes.len(),
        };
        frame.bytes[..bytes.len()].copy_from_slice(bytes);
        frame
    }
}

#[cfg(test)]
mod tests {
    use super::ChecksumOrder::{HighFirst, LowFirst};
    use super::*;
    use crate::Decode;

    /// Bytes observed on the wire of the fielded firmware (high byte first).
    #[test]
    fn frames_are_those_of_the_fielded_firmware() {
        let read = Frame::read(36, 10, HighFirst);
        assert_eq!(read.as_bytes(), [0xAB, 0x24, 0x0A, 0x00, 0xD9]);
        let write = Frame::write(46, &[20, 0xEC, 0], HighFirst);
        assert_eq!(
            write.as_bytes(),
            [0xAB, 0x2E, 0x83, 0x14, 0xEC, 0x00, 0x02, 0x5C]
        );
        let ack = Frame::read(46, 0, HighFirst);
        assert_eq!(ack.as_bytes(), [0xAB, 0x2E, 0x00, 0x00, 0xD9]);
        let error = Frame::read(ERROR_REGISTER, 0, HighFirst);
        assert_eq!(error.as_bytes(), [0xAB, 0xFF, 0x00, 0x01, 0xAA]);
    }

    #[test]
    fn the_document_sends_the_low_byte_first() {
        let read = Frame::read(36, 10, LowFirst);
        assert_eq!(read.as_bytes(), [0xAB, 0x24, 0x0A, 0xD9, 0x00]);
    }

    /// The fielded firmware answers a stray start byte with an error and loses the request.
    #[test]
    fn a_stray_start_byte_does_not_cost_the_request_behind_it() {
        let mut decoder = Decoder::new(HighFirst);
        let frame = decoder
            .push(&[0xAB, 0xAB, 0x24, 0x0A, 0x00, 0xD9])
            .find_map(Result::ok)
            .expect("found behind the stray byte");
        assert_eq!((frame.register(), frame.count()), (36, 10));
        assert_eq!(decoder.discarded(), 1);
    }

    /// A flipped count announces 127 bytes. The idle line ends the wait and frees the hidden frame.
    #[test]
    fn an_idle_line_frees_the_frame_that_a_damaged_count_hid() {
        let mut decoder = Decoder::new(HighFirst);
        assert_eq!(decoder.push(&[0xAB, 0x24, 0xFF]).count(), 0);
        assert_eq!(
            decoder
                .push(Frame::read(36, 10, HighFirst).as_bytes())
                .count(),
            0
        );
        decoder.idle();
        assert_eq!(decoder.push(&[]).filter(Result::is_ok).count(), 1);
        assert_eq!((decoder.discarded(), decoder.pending()), (3, 0));
    }

    #[test]
    fn a_log_shows_bytes() {
        extern crate std;
        let text = std::format!("{:?}", Frame::read(36, 10, HighFirst));
        assert_eq!(text, "avr::Frame([AB, 24, 0A, 00, D9])");
    }

    /// W is the highest bit of the count byte, whatever the other seven are.
    #[test]
    fn w_alone_tells_a_write_from_a_read() {
        let [read, write] = [
            Frame::read(0, 127, LowFirst),
            Frame::write(0, &[1], LowFirst),
        ];
        assert_eq!(
            (read.is_write(), read.count(), read.data().len()),
            (false, 127, 0)
        );
        assert_eq!(
            (write.is_write(), write.count(), write.data()),
            (true, 1, &[1][..])
        );
        let empty = Frame::write(0, &[], LowFirst);
        assert_eq!((empty.is_write(), empty.count()), (true, 0));
        assert!(!Frame::read(0, 0, LowFirst).is_write());
    }

    /// The fielded write of three bytes, in one piece, and a byte at a time.
    #[test]
    fn a_write_is_found_with_its_data() {
        let bytes = [0xAB, 0x2E, 0x83, 0x14, 0xEC, 0x00, 0x02, 0x5C];
        let write = Frame::write(46, &[20, 0xEC, 0], HighFirst);
        assert_eq!(Decoder::new(HighFirst).push(&bytes).next(), Some(Ok(write)));
        let mut decoder = Decoder::new(HighFirst);
        let complete = bytes.map(|byte| decoder.push(&[byte]).next().is_some());
        assert_eq!(complete, [0, 0, 0, 0, 0, 0, 0, 1].map(|found| found == 1));
    }
}
