//! Vision messages on a robot's network: a row of depths, a scan made of it, markers.
//!
//! ```text
//! depth row  44 | count u16 | focal length u16 | depth u16 ..       tenths of pixels, mm
//! scan       53 | count u16 | first i32 | step i32 | range u16 ..   microradians, mm
//! marker     4D | id u16 | x i32 | y i32 | z i32 | normal x, z i16  mm, ten-thousandths
//! ```
//!
//! Little-endian, one message a datagram: the network has sync and checksum of its own. The first
//! depth is that of the leftmost column; a depth or range of 0 was not measured. A marker's
//! position is in camera axes: x to the right, y down, z ahead. So is its normal, without its y. In
//! the car of seed 003 these are messages of ROS between programs on its PC; this form is the rig's
//! own.

use core::fmt;

const DEPTH: u8 = b'D';
const SCAN: u8 = b'S';
const MARKER: u8 = b'M';
/// Maximum number of values of a row or scan: one Ethernet packet holds them.
pub const VALUES_MAX: usize = 700;
/// The longest message.
pub const MESSAGE_MAX: usize = 11 + 2 * VALUES_MAX;

/// A row of depths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DepthRow<'a> {
    /// Focal length, tenths of a pixel.
    pub focal_tenths: u16,
    values: &'a [u8],
}

/// Ranges at even bearings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scan<'a> {
    /// Bearing of the first range, microradians counter-clockwise from ahead.
    pub first_urad: i32,
    /// From one bearing to the next, microradians.
    pub step_urad: i32,
    values: &'a [u8],
}

/// A marker that was recognised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Marker {
    /// Its number.
    pub id: u16,
    /// Its middle as the camera sees it, millimetres: right, down, ahead.
    pub place_mm: [i32; 3],
    /// Its normal, right and ahead, in ten-thousandths.
    pub normal: [i16; 2],
}

/// One message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message<'a> {
    /// A row of depths.
    DepthRow(DepthRow<'a>),
    /// A scan.
    Scan(Scan<'a>),
    /// A marker.
    Marker(Marker),
}

/// Error of an invalid message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MessageError {
    /// No message begins like this; empty ones have no first byte.
    Kind {
        /// The first byte.
        found: Option<u8>,
    },
    /// The message's length differs from the announced one.
    Length {
        /// The expected length.
        expected: usize,
        /// The actual length.
        found: usize,
    },
}

impl fmt::Display for MessageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Kind { found: None } => write!(f, "message is empty"),
            Self::Kind { found: Some(found) } => {
                write!(
                    f,
                    "message begins with {found:#04x}, expected 0x44, 0x53 or 0x4d"
                )
            }
            Self::Length { expected, found } => {
                write!(f, "message has {found} bytes, expected {expected}")
            }
        }
    }
}

impl core::error::Error for MessageError {}

impl<'a> Message<'a> {
    /// Reads a message.
    ///
    /// # Errors
    /// If the bytes are no message, or their length differs from the announced one.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, MessageError> {
        let found = bytes.len();
        let of_length = |expected| match found == expected {
            true => Ok(()),
            false => Err(MessageError::Length { expected, found }),
        };
        let count = || usize::from(word(bytes, 1));
        match bytes.first() {
            Some(&DEPTH) => {
                of_length(5 + 2 * count())?;
                Ok(Self::DepthRow(DepthRow {
                    focal_tenths: word(bytes, 3),
                    values: &bytes[5..],
                }))
            }
            Some(&SCAN) => {
                of_length(11 + 2 * count())?;
                Ok(Self::Scan(Scan {
                    first_urad: long(bytes, 3),
                    step_urad: long(bytes, 7),
                    values: &bytes[11..],
                }))
            }
            Some(&MARKER) => {
                of_length(19)?;
                Ok(Self::Marker(Marker {
                    id: word(bytes, 1),
                    place_mm: [3, 7, 11].map(|at| long(bytes, at)),
                    normal: [15, 17].map(|at| word(bytes, at).cast_signed()),
                }))
            }
            found => Err(MessageError::Kind {
                found: found.copied(),
            }),
        }
    }
}

impl DepthRow<'_> {
    /// Depths from left to right, millimetres along the camera's axis; 0 was not measured.
    pub fn depths_mm(&self) -> impl ExactSizeIterator<Item = u16> {
        values(self.values)
    }

    /// Writes the row to the front of `out` and returns its length. Values beyond [`VALUES_MAX`] or
    /// the size of `out` are left out.
    pub fn encode(focal_tenths: u16, depths_mm: &[u16], out: &mut [u8]) -> usize {
        let [low, high] = focal_tenths.to_le_bytes();
        write(DEPTH, &[low, high], depths_mm, out)
    }
}

impl Scan<'_> {
    /// Ranges, millimetres; 0 was not measured.
    pub fn ranges_mm(&self) -> impl ExactSizeIterator<Item = u16> {
        values(self.values)
    }

    /// Writes a scan to the front of `out` and returns its length. Values beyond [`VALUES_MAX`] or
    /// the size of `out` are left out.
    pub fn encode(first_urad: i32, step_urad: i32, ranges_mm: &[u16], out: &mut [u8]) -> usize {
        let mut head = [0; 8];
        head[..4].copy_from_slice(&first_urad.to_le_bytes());
        head[4..].copy_from_slice(&step_urad.to_le_bytes());
        write(SCAN, &head, ranges_mm, out)
    }
}

impl Marker {
    /// The message.
    pub fn encode(&self) -> [u8; 19] {
        let mut bytes = [MARKER; 19];
        bytes[1..3].copy_from_slice(&self.id.to_le_bytes());
        for (slot, value) in bytes[3..15].chunks_exact_mut(4).zip(self.place_mm) {
            slot.copy_from_slice(&value.to_le_bytes());
        }
        for (slot, value) in bytes[15..].chunks_exact_mut(2).zip(self.normal) {
            slot.copy_from_slice(&value.to_le_bytes());
        }
        bytes
    }
}

fn write(kind: u8, head: &[u8], values: &[u16], out: &mut [u8]) -> usize {
    let begin = 3 + head.len();
    let Some(room) = out.len().checked_sub(begin) else {
        return 0;
    };
    let count = values.len().min(VALUES_MAX).min(room / 2);
    let words = u16::try_from(count).unwrap_or(u16::MAX).to_le_bytes();
    out[0] = kind;
    out[1..3].copy_from_slice(&words);
    out[3..begin].copy_from_slice(head);
    let slots = out[begin..begin + 2 * count].chunks_exact_mut(2);
    for (slot, value) in slots.zip(values) {
        slot.copy_from_slice(&value.to_le_bytes());
    }
    begin + 2 * count
}

fn values(bytes: &[u8]) -> impl ExactSizeIterator<Item = u16> {
    let words = bytes.chunks_exact(2);
    words.map(|word| u16::from_le_bytes([word[0], word[1]]))
}

/// The word at `at`; 0 beyond the end. The caller checks the length afterwards.
fn word(bytes: &[u8], at: usize) -> u16 {
    let word = bytes.get(at..at + 2).and_then(|word| word.try_into().ok());
    word.map_or(0, u16::from_le_bytes)
}

fn long(bytes: &[u8], at: usize) -> i32 {
    let long = bytes.get(at..at + 4).and_then(|long| long.try_into().ok());
    long.map_or(0, i32::from_le_bytes)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString as _;

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn errors_tell_what_was_found_and_what_was_expected() {
        let told = |bytes: &[u8]| Message::decode(bytes).unwrap_err().to_string();
        assert_eq!(told(&[]), "message is empty");
        assert_eq!(
            told(&[1]),
            "message begins with 0x01, expected 0x44, 0x53 or 0x4d"
        );
        assert_eq!(told(&[0x4D; 20]), "message has 20 bytes, expected 19");
    }

    #[test]
    fn messages_are_laid_out_by_hand() {
        let mut out = [0xA5; 20];
        let len = DepthRow::encode(5_250, &[1_000, 0], &mut out);
        assert_eq!(out[..len], [0x44, 2, 0, 0x82, 0x14, 0xE8, 3, 0, 0]);
        let Ok(Message::DepthRow(row)) = Message::decode(&out[..len]) else {
            panic!("no row");
        };
        assert_eq!(row.focal_tenths, 5_250);
        assert!(row.depths_mm().eq([1_000, 0]));
        let len = Scan::encode(-546_288, 1_000, &[300], &mut out);
        assert_eq!(
            out[..len],
            [0x53, 1, 0, 0x10, 0xAA, 0xF7, 0xFF, 0xE8, 3, 0, 0, 0x2C, 1]
        );
        let Ok(Message::Scan(scan)) = Message::decode(&out[..len]) else {
            panic!("no scan");
        };
        assert_eq!((scan.first_urad, scan.step_urad), (-546_288, 1_000));
        assert!(scan.ranges_mm().eq([300]));
        let marker = Marker {
            id: 17,
            place_mm: [-1, 2, 1_500],
            normal: [0, -10_000],
        };
        let bytes = marker.encode();
        let expected = [
            0x4D, 17, 0, 0xFF, 0xFF, 0xFF, 0xFF, 2, 0, 0, 0, 0xDC, 5, 0, 0, 0, 0, 0xF0, 0xD8,
        ];
        assert_eq!(bytes, expected);
        assert_eq!(Message::decode(&bytes), Ok(Message::Marker(marker)));
    }

    #[test]
    fn what_is_no_message_is_refused() {
        assert_eq!(
            Message::decode(&[]),
            Err(MessageError::Kind { found: None })
        );
        assert_eq!(
            Message::decode(&[1]),
            Err(MessageError::Kind { found: Some(1) })
        );
        let lengths = |expected, found| Err(MessageError::Length { expected, found });
        assert_eq!(Message::decode(&[0x44]), lengths(5, 1));
        assert_eq!(Message::decode(&[0x44, 1, 0, 0, 0, 9]), lengths(7, 6));
        assert_eq!(Message::decode(&[0x4D; 20]), lengths(19, 20));
        let mut out = [0; 4];
        assert_eq!(DepthRow::encode(1, &[1], &mut out), 0);
        let mut out = [0; 8];
        assert_eq!(DepthRow::encode(1, &[1, 2, 3], &mut out), 7);
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_message_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
            let _ = Message::decode(&bytes);
        }

        #[test]
        fn a_scan_comes_back(values in prop::collection::vec(any::<u16>(), 0..800), first: i32) {
            let mut out = [0; MESSAGE_MAX];
            let len = Scan::encode(first, 7, &values, &mut out);
            let Ok(Message::Scan(scan)) = Message::decode(&out[..len]) else {
                panic!("no scan");
            };
            prop_assert_eq!(scan.first_urad, first);
            prop_assert!(scan.ranges_mm().eq(values.iter().copied().take(VALUES_MAX)));
        }
    }
}
