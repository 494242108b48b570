//! Blocks and options of pcapng, written little-endian and read in both byte orders.
//!
//! ```text
//! | type 4 | length 4 | body, a multiple of 4 bytes | length again 4 |
//! option: | code 2 | length 2 | value, padded to 4 |, closed by code 0
//! ```
//!
//! The project has its own reader for two reasons. A capture must be readable up to the byte at
//! which a machine failed, and an error must give the offset of the damage.

use std::io::{self, Write};

use bytes::{Bytes, BytesMut};

/// Block type of a section header; its bytes are the same in both byte orders.
pub const SECTION: u32 = 0x0A0D_0D0A;
/// Block type of an interface description.
pub const INTERFACE: u32 = 1;
/// Block type of a packet.
pub const PACKET: u32 = 6;
/// Block type of a custom block, which only one tool understands.
pub const CUSTOM_BLOCK: u32 = 0x0BAD;
/// Byte-order magic of a section.
const MAGIC: u32 = 0x1A2B_3C4D;
/// Maximum accepted length of a block. Blocks of this project stay below 1 KiB.
const BLOCK_MAX: u32 = 16 << 20;
/// Option code of a comment for the reader.
pub const COMMENT: u16 = 1;
/// Option code of private bytes, which other tools copy.
pub const CUSTOM: u16 = 2989;

/// Writes `blocks`, all of them whole.
///
/// # Errors
/// If the disk is full or the file cannot be written: the number of written bytes that are whole
/// blocks, and the error. A part of the next block may follow them.
pub fn write_whole(out: &mut impl Write, blocks: &[u8]) -> Result<(), (usize, io::Error)> {
    let mut done = 0;
    while done < blocks.len() {
        match out.write(&blocks[done..]) {
            Ok(0) => return Err((whole(&blocks[..done]), io::ErrorKind::WriteZero.into())),
            Ok(len) => done += len,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err((whole(&blocks[..done]), error)),
        }
    }
    Ok(())
}

/// The length of the whole blocks at the beginning of `bytes`, which are little-endian.
fn whole(bytes: &[u8]) -> usize {
    let mut end = 0;
    while let Some(length) = bytes.get(end + 4..end + 8) {
        let length = u32::from_le_bytes(length.try_into().expect("four bytes"));
        match usize::try_from(length) {
            Ok(length) if length >= 12 && length <= bytes.len() - end => end += length,
            _ => break,
        }
    }
    end
}

/// Byte order of a section.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Least significant byte first; the order of the writer.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

impl Order {
    /// Converts two bytes to a number.
    pub const fn u16(self, bytes: [u8; 2]) -> u16 {
        match self {
            Self::Little => u16::from_le_bytes(bytes),
            Self::Big => u16::from_be_bytes(bytes),
        }
    }

    /// Converts four bytes to a number.
    pub const fn u32(self, bytes: [u8; 4]) -> u32 {
        match self {
            Self::Little => u32::from_le_bytes(bytes),
            Self::Big => u32::from_be_bytes(bytes),
        }
    }

    /// Converts eight bytes to a number.
    pub const fn u64(self, bytes: [u8; 8]) -> u64 {
        match self {
            Self::Little => u64::from_le_bytes(bytes),
            Self::Big => u64::from_be_bytes(bytes),
        }
    }

    /// The number at offset `at` of `bytes`; `None` if `bytes` ends before it.
    pub fn u32_at(self, bytes: &[u8], at: usize) -> Option<u32> {
        let bytes = bytes.get(at..at.checked_add(4)?)?;
        Some(self.u32(bytes.try_into().ok()?))
    }

    /// The number at offset `at` of `bytes`; `None` if `bytes` ends before it.
    pub fn u16_at(self, bytes: &[u8], at: usize) -> Option<u16> {
        let bytes = bytes.get(at..at.checked_add(2)?)?;
        Some(self.u16(bytes.try_into().ok()?))
    }
}

/// An error after which the rest of the file cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("at byte {offset}: {why}")]
pub struct BlockError {
    /// Offset of the unreadable block, in bytes from the start of the file.
    pub offset: u64,
    /// The error.
    pub why: BlockFault,
}

/// Kinds of damage to a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BlockFault {
    /// The file does not begin with a section header.
    #[error("no pcapng section header")]
    NotPcapng,
    /// The byte-order magic of a section matches neither byte order.
    #[error("byte-order magic is {found:#010x}")]
    Magic {
        /// The value in the file.
        found: u32,
    },
    /// The length is not a multiple of 4, shorter than an empty block, or above the maximum.
    #[error("block length {found} is impossible")]
    Length {
        /// The length in the file.
        found: u32,
    },
    /// The length at the end of the block differs from the length at its beginning.
    #[error("block ends with length {found}, expected {expected}")]
    Lengths {
        /// Length at the beginning.
        expected: u32,
        /// Length at the end.
        found: u32,
    },
}

/// One whole block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// Offset of the block in the file.
    pub offset: u64,
    /// Type of the block.
    pub kind: u32,
    /// Byte order of the numbers in the block.
    pub order: Order,
    /// Bytes between the two lengths.
    pub body: Bytes,
}

/// Splitter of a byte stream, fed in pieces of any size, into blocks.
#[derive(Clone, Debug, Default)]
pub struct Blocks {
    buf: BytesMut,
    pub(crate) offset: u64,
    order: Option<Order>,
    broken: bool,
}

impl Blocks {
    /// Reads more of the file.
    pub fn push(&mut self, bytes: &[u8]) {
        if self.broken {
            return;
        }
        self.buf.extend_from_slice(bytes);
    }

    /// Number of bytes of an incomplete block.
    pub fn pending(&self) -> usize {
        self.buf.len()
    }
    /// The next whole block. `None` if more bytes are needed, or after an error.
    pub fn next_block(&mut self) -> Option<Result<Block, BlockError>> {
        if self.broken {
            return None;
        }
        match self.cut() {
            Ok(block) => block.map(Ok),
            Err(why) => {
                self.broken = true;
                let offset = self.offset;
                Some(Err(BlockError { offset, why }))
            }
        }
    }

    fn cut(&mut self) -> Result<Option<Block>, BlockFault> {
        let bytes = &self.buf[..];
        let Some(head) = bytes.first_chunk::<8>() else {
            return Ok(None);
        };
        let kind = [head[0], head[1], head[2], head[3]];
        let length = [head[4], head[5], head[6], head[7]];
        let order = if u32::from_le_bytes(kind) == SECTION {
            let Some(magic) = Order::Little.u32_at(bytes, 8) else {
                return Ok(None);
            };
            match magic {
                MAGIC => Order::Little,
                swapped if swapped.swap_bytes() == MAGIC => Order::Big,
                found => return Err(BlockFault::Magic { found }),
            }
        } else {
            self.order.ok_or(BlockFault::NotPcapng)?
        };
        let length = order.u32(length);
        let shortest = if order.u32(kind) == SECTION { 28 } else { 12 };
        if length < shortest || !length.is_multiple_of(4) || length > BLOCK_MAX {
            return Err(BlockFault::Length { found: length });
        }
        let len = length as usize;
        let Some(found) = order.u32_at(bytes, len - 4) else {
            return Ok(None);
        };
        if found != length {
            let expected = length;
            return Err(BlockFault::Lengths { expected, found });
        }
        let block = Block {
            offset: self.offset,
            kind: order.u32(kind),
            order,
            body: self.buf.split_to(len).freeze().slice(8..len - 4),
        };
        self.order = Some(order);
        self.offset += u64::from(length);
        Ok(Some(block))
    }
}

/// The options in `bytes`, up to the end mark, the end of `bytes`, or the first incomplete option.
pub fn options(order: Order, mut bytes: &[u8]) -> impl Iterator<Item = (u16, &[u8])> {
    core::iter::from_fn(move || {
        let (code, len) = (order.u16_at(bytes, 0)?, order.u16_at(bytes, 2)?);
        let value = bytes.get(4..4 + usize::from(len))?;
        if code == 0 {
            return None;
        }
        bytes = bytes.get(4 + padded(value.len())..).unwrap_or_default();
        Some((code, value))
    })
}

/// `len` rounded up to a multiple of four.
pub const fn padded(len: usize) -> usize {
    len.next_multiple_of(4)
}

/// Appends a block to `out`; `body` appends the bytes between the lengths.
pub fn write_block(out: &mut Vec<u8>, kind: u32, body: impl FnOnce(&mut Vec<u8>)) {
    let start = out.len();
    out.extend_from_slice(&kind.to_le_bytes());
    out.extend_from_slice(&[0; 4]);
    body(out);
    pad(out, start);
    let length = u32::try_from(out.len() + 4 - start).expect("blocks of ours are short");
    out[start + 4..start + 8].copy_from_slice(&length.to_le_bytes());
    out.extend_from_slice(&length.to_le_bytes());
}

/// Pads to a multiple of four bytes since `start`.
pub fn pad(out: &mut Vec<u8>, start: usize) {
    let len = padded(out.len() - start);
    out.resize(start + len, 0);
}

/// Appends the fixed part of a section header: byte order, version, unknown length.
pub fn write_section_head(out: &mut Vec<u8>) {
    out.extend_from_slice(&MAGIC.to_le_bytes());
    out.extend_from_slice(&[1, 0, 0, 0]);
    out.extend_from_slice(&[0xFF; 8]);
}

/// Appends an option; a value above the maximum length is cut.
pub fn write_option(out: &mut Vec<u8>, code: u16, value: &[u8]) {
    let value = &value[..value.len().min(usize::from(u16::MAX))];
    let len = u16::try_from(value.len()).unwrap_or(u16::MAX);
    out.extend_from_slice(&code.to_le_bytes());
    out.extend_from_slice(&len.to_le_bytes());
    let start = out.len();
    out.extend_from_slice(value);
    pad(out, start);
}

/// Appends the mark after the last option.
pub fn write_options_end(out: &mut Vec<u8>) {
    out.extend_from_slice(&[0; 4]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_in_both_orders_and_not_beyond_the_end() {
        let bytes = [1, 2, 3, 4, 5, 6, 7, 8, 9];
        let (little, big) = (Order::Little, Order::Big);
        assert_eq!(little.u16([1, 2]), 0x0201);
        assert_eq!(big.u16([1, 2]), 0x0102);
        assert_eq!(little.u64([1, 2, 3, 4, 5, 6, 7, 8]), 0x0807_0605_0403_0201);
        assert_eq!(big.u64([1, 2, 3, 4, 5, 6, 7, 8]), 0x0102_0304_0506_0708);
        assert_eq!(little.u32_at(&bytes, 5), Some(0x0908_0706));
        assert_eq!(big.u32_at(&bytes, 5), Some(0x0607_0809));
        assert_eq!(big.u16_at(&bytes, 7), Some(0x0809));
        assert_eq!([6, usize::MAX].map(|at| big.u32_at(&bytes, at)), [None; 2]);
        assert_eq!([8, usize::MAX].map(|at| big.u16_at(&bytes, at)), [None; 2]);
    }

    /// Each option is padded to four bytes. An option that is cut, or follows the end mark, is
    /// ignored.
    #[test]
    fn options_end_at_the_mark_or_where_one_is_cut() {
        let mut bytes = Vec::new();
        write_option(&mut bytes, 7, b"abcde");
        assert_eq!(bytes, [7, 0, 5, 0, b'a', b'b', b'c', b'd', b'e', 0, 0, 0]);
        write_option(&mut bytes, 8, b"");
        write_options_end(&mut bytes);
        write_option(&mut bytes, 9, b"x");
        let read = |bytes| options(Order::Little, bytes).collect::<Vec<_>>();
        let both: [(u16, &[u8]); 2] = [(7, b"abcde"), (8, b"")];
        assert_eq!(read(&bytes), both);
        assert_eq!(read(&bytes[..9]), both[..1]);
        assert_eq!(read(&bytes[..8]), []);
        let mut long = Vec::new();
        write_option(&mut long, 1, &[7; 70_000]);
        assert_eq!(long.len(), 4 + 65_536);
        assert_eq!(read(&long), [(1, &[7; 65_535][..])]);
        assert_eq!([0, 1, 4, 5].map(padded), [0, 4, 4, 8]);
    }

    /// A section header and one block of eight bytes of body.
    fn file() -> Vec<u8> {
        let mut out = Vec::new();
        write_block(&mut out, SECTION, write_section_head);
        write_block(&mut out, 99, |out| out.extend_from_slice(&[5; 6]));
        assert_eq!(
            out[28..],
            [
                99, 0, 0, 0, 20, 0, 0, 0, 5, 5, 5, 5, 5, 5, 0, 0, 20, 0, 0, 0
            ]
        );
        out
    }

    fn blocks(bytes: &[u8]) -> (Vec<(u64, u32, usize)>, Option<BlockError>, usize) {
        let mut blocks = Blocks::default();
        blocks.push(bytes);
        let mut whole = Vec::new();
        while let Some(block) = blocks.next_block() {
            match block {
                Ok(block) => whole.push((block.offset, block.kind, block.body.len())),
                Err(error) => {
                    let pending = blocks.pending();
                    blocks.push(&file());
                    assert_eq!((blocks.pending(), blocks.next_block()), (pending, None));
                    return (whole, Some(error), pending);
                }
            }
        }
        (whole, None, blocks.pending())
    }

    /// A disk with room for so many bytes.
    struct Disk(usize);

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            match bytes.len().min(self.0) {
                0 => Err(io::ErrorKind::StorageFull.into()),
                len => {
                    self.0 -= len;
                    Ok(len)
                }
            }
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// The blocks that fit the disk are kept, not only those of earlier writes: of 28 and 20 bytes.
    #[test]
    fn a_full_disk_keeps_the_blocks_that_fit() {
        for (room, kept) in [(0, 0), (27, 0), (28, 28), (47, 28)] {
            let (whole, error) = write_whole(&mut Disk(room), &file()).expect_err("full");
            assert_eq!(
                (whole, error.kind()),
                (kept, io::ErrorKind::StorageFull),
                "{room}"
            );
        }
        assert!(write_whole(&mut Disk(48), &file()).is_ok());
    }

    #[test]
    fn blocks_are_cut_where_they_end() {
        let file = file();
        let both = vec![(0, SECTION, 16), (28, 99, 8)];
        assert_eq!(blocks(&file), (both.clone(), None, 0));
        assert_eq!(blocks(&file[..47]), (both[..1].to_vec(), None, 19));
        assert_eq!(blocks(&file[..27]), (vec![], None, 27));
        assert_eq!(
            blocks(&file[28..]).1.map(|error| error.why),
            Some(BlockFault::NotPcapng)
        );
    }

    #[test]
    fn what_is_wrong_with_a_block_is_told_with_its_place() {
        let said = |at: usize, value: u8| {
            let mut file = file();
            file[at] = value;
            blocks(&file).1.map(|error| error.to_string())
        };
        let impossible = |offset, length| {
            Some(format!(
                "at byte {offset}: block length {length} is impossible"
            ))
        };
        assert_eq!(said(32, 8), impossible(28, 8));
        assert_eq!(said(32, 22), impossible(28, 22));
        assert_eq!(said(35, 2), impossible(28, 0x0200_0014));
        assert_eq!(said(4, 24), impossible(0, 24));
        let ends = "at byte 28: block ends with length 24, expected 20".to_owned();
        assert_eq!(said(44, 24), Some(ends));
        let magic = "at byte 0: byte-order magic is 0x1a2b3c4e".to_owned();
        assert_eq!(said(8, 0x4E), Some(magic));
        // The reader accepts a length of 16 MiB and waits for the bytes.
        assert_eq!(
            (said(35, 1), said(32, 24)),
            (impossible(28, 0x0100_0014), None)
        );
    }
}
