//! Touch panel on a serial line: drawing commands to its display controller, pen reports back.
//!
//! ```text
//! | 7E | op | length u16 | payload | CRC-16 u16 |      big-endian, CRC-16/XMODEM from op to payload
//!
//! to the panel    29  display on     nothing
//!                 28  display off    nothing
//!                 2C  write memory   window 8, then a pixel u16 for each place in it
//!                 E0  write runs     window 8, then runs (count u8, pixel u16) that fill it
//! from the panel  54  pen            down u8, x u16, y u16
//!
//! window: x0, y0, x1, y1 as u16, both corners inside; rows from the top, x first
//! pixel:  RGB565
//! ```
//!
//! The seed report names no display controller. The numbers of commands, window and pixel are those
//! of the common ones (SSD1963, ILI9341); pen coordinates are 12-bit readings like those of an
//! ADS7843. Start byte, length, checksum and the runs are the rig's own. Each frame contains its
//! window, so a damaged one costs only its own pixels.

use core::ops::RangeInclusive;

use crate::{Candidate, Format, FrameError};

/// First byte of every frame.
pub const START: u8 = 0x7E;
/// Bytes before the payload.
pub const HEADER_LEN: usize = 4;
/// Bytes of the window at the beginning of a drawing command.
pub const WINDOW_LEN: usize = 8;
/// Most payload bytes: a window and a row of 480 pixels.
pub const PAYLOAD_MAX: usize = WINDOW_LEN + 2 * 480;
/// The longest frame.
pub const FRAME_MAX: usize = HEADER_LEN + PAYLOAD_MAX + 2;
/// Rate of the line.
pub const BAUD: u32 = 1_000_000;
/// Largest reading of the pen's position.
pub const READING_MAX: u16 = 4095;

/// Number of "display on".
pub const ON: u8 = 0x29;
/// Number of "display off".
pub const OFF: u8 = 0x28;
/// Number of "write memory".
pub const WRITE: u8 = 0x2C;
/// Number of "write runs".
pub const RUNS: u8 = 0xE0;
/// Number of a pen report.
pub const PEN: u8 = 0x54;

/// A rectangle of pixels, both corners inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Leftmost and rightmost column.
    pub columns: [u16; 2],
    /// Top and bottom row.
    pub rows: [u16; 2],
}

impl Window {
    /// Pixels inside, at most [`u32::MAX`]; 0 if the corners are exchanged.
    pub const fn area(self) -> u32 {
        let [x0, x1] = self.columns;
        let [y0, y1] = self.rows;
        if x0 > x1 || y0 > y1 {
            return 0;
        }
        ((x1 - x0) as u32 + 1).saturating_mul((y1 - y0) as u32 + 1)
    }

    fn to_bytes(self) -> [u8; WINDOW_LEN] {
        let ([x0, x1], [y0, y1]) = (self.columns, self.rows);
        let mut bytes = [0; WINDOW_LEN];
        for (slot, value) in bytes.chunks_exact_mut(2).zip([x0, y0, x1, y1]) {
            slot.copy_from_slice(&value.to_be_bytes());
        }
        bytes
    }
}

/// Request of a frame to the panel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command<'a> {
    /// Show the content of the memory.
    On,
    /// Show nothing.
    Off,
    /// Pixels of a window, two bytes each.
    Write(Window, &'a [u8]),
    /// Runs that fill a window, three bytes each.
    Runs(Window, &'a [u8]),
}

/// Position of the pen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pen {
    /// Whether the pen touches the panel.
    pub contact: Contact,
    /// Readings along x and y, 0 to 4095.
    pub reading: [u16; 2],
}

/// Whether the pen touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contact {
    /// The pen touches the panel.
    Down,
    /// The pen was lifted here.
    Up,
}

/// A frame whose start, length and checksum were verified.
#[derive(Clone, PartialEq, Eq)]
pub struct Frame<const N: usize = FRAME_MAX> {
    bytes: [u8; N],
    len: usize,
}

impl<const N: usize> Frame<N> {
    /// Number of the command or report.
    pub const fn op(&self) -> u8 {
        self.bytes[1]
    }

    /// Its payload.
    pub fn payload(&self) -> &[u8] {
        &self.bytes[HEADER_LEN..self.len - 2]
    }

    /// The frame as on the wire.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }

    /// Its request to the panel; `None` for invalid numbers and lengths.
    pub fn command(&self) -> Option<Command<'_>> {
        let payload = self.payload();
        match (self.op(), payload.split_first_chunk()) {
            (ON, None) if payload.is_empty() => Some(Command::On),
            (OFF, None) if payload.is_empty() => Some(Command::Off),
            (WRITE, Some((window, rest))) if rest.len().is_multiple_of(2) => {
                Some(Command::Write(window_of(window), rest))
            }
            (RUNS, Some((window, rest))) if rest.len().is_multiple_of(3) => {
                Some(Command::Runs(window_of(window), rest))
            }
            _ => None,
        }
    }

    /// The reported pen position; `None` if it is another message.
    pub fn pen(&self) -> Option<Pen> {
        let (PEN, &[contact, x1, x0, y1, y0]) = (self.op(), self.payload()) else {
            return None;
        };
        let contact = match contact {
            0 => Contact::Up,
            1 => Contact::Down,
            _ => return None,
        };
        let reading = [u16::from_be_bytes([x1, x0]), u16::from_be_bytes([y1, y0])];
        let is_legal = reading.iter().all(|&value| value <= READING_MAX);
        is_legal.then_some(Pen { contact, reading })
    }
}

impl<const N: usize> core::fmt::Debug for Frame<N> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "panel::Frame({:02X}, {:02X?})",
            self.op(),
            self.payload()
        )
    }
}

const fn window_of(bytes: &[u8; WINDOW_LEN]) -> Window {
    let [a, b, c, d, e, f, g, h] = *bytes;
    Window {
        columns: [u16::from_be_bytes([a, b]), u16::from_be_bytes([e, f])],
        rows: [u16::from_be_bytes([c, d]), u16::from_be_bytes([g, h])],
    }
}

/// CRC-16/XMODEM: polynomial 1021, from 0, four bits at a time.
pub fn checksum(bytes: &[u8]) -> u16 {
    const TABLE: [u16; 16] = [
        0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7, 0x8108, 0x9129, 0xA14A,
        0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF,
    ];
    bytes.iter().fold(0, |crc, &byte| {
        let crc = (crc << 4) ^ TABLE[usize::from((crc >> 12) ^ u16::from(byte >> 4))];
        (crc << 4) ^ TABLE[usize::from((crc >> 12) ^ u16::from(byte & 0x0F))]
    })
}

/// Puts start, number, length and checksum around a payload that already lies in `frame[4..]`.
/// Returns the length of the whole frame; `None` if it is too long, or longer than `frame`.
pub fn seal(frame: &mut [u8], op: u8, payload_len: usize) -> Option<usize> {
    if payload_len > PAYLOAD_MAX {
        return None;
    }
    let end = HEADER_LEN + payload_len;
    let length = u16::try_from(payload_len).expect("at most 968");
    frame.get(..end + 2)?;
    frame[0] = START;
    frame[1] = op;
    frame[2..HEADER_LEN].copy_from_slice(&length.to_be_bytes());
    let sum = checksum(&frame[1..end]);
    frame[end..end + 2].copy_from_slice(&sum.to_be_bytes());
    Some(end + 2)
}

/// Encodes the `pixels` of `window` in the shorter form, as runs or one by one; returns the frame's
/// length. `None` if they do not fit one frame or their number differs from the window's area.
pub fn encode_pixels(window: Window, pixels: &[u16], frame: &mut [u8]) -> Option<usize> {
    if u32::try_from(pixels.len()) != Ok(window.area()) {
        return None;
    }
    let body = frame.get_mut(HEADER_LEN..)?;
    let (head, body) = body.split_first_chunk_mut::<WINDOW_LEN>()?;
    *head = window.to_bytes();
    let most = (2 * pixels.len())
        .min(PAYLOAD_MAX - WINDOW_LEN)
        .min(body.len());
    let mut len = 0;
    let mut rest = pixels;
    while let Some(&pixel) = rest.first() {
        let longest = &rest[..rest.len().min(255)];
        let run = longest.iter().position(|&next| next != pixel);
        let (run, behind) = rest.split_at(run.unwrap_or(longest.len()));
        let count = u8::try_from(run.len()).expect("at most 255");
        let [high, low] = pixel.to_be_bytes();
        if let Some(slot) = body[..most].get_mut(len..len + 3) {
            slot.copy_from_slice(&[count, high, low]);
        }
        len += 3;
        rest = behind;
    }
    if len <= most {
        return seal(frame, RUNS, WINDOW_LEN + len);
    }
    let plain = body.get_mut(..2 * pixels.len())?;
    for (slot, pixel) in plain.chunks_exact_mut(2).zip(pixels) {
        slot.copy_from_slice(&pixel.to_be_bytes());
    }
    seal(frame, WRITE, WINDOW_LEN + 2 * pixels.len())
}

/// A command without payload.
pub fn encode_switch(op: u8) -> [u8; HEADER_LEN + 2] {
    let mut frame = [0; HEADER_LEN + 2];
    seal(&mut frame, op, 0).expect("there is room");
    frame
}

/// Bytes of a pen report.
pub const PEN_LEN: usize = HEADER_LEN + 5 + 2;

/// A pen report.
pub fn encode_pen(pen: Pen) -> [u8; PEN_LEN] {
    let mut frame = [0; PEN_LEN];
    frame[HEADER_LEN] = u8::from(pen.contact == Contact::Down);
    for (slot, reading) in frame[HEADER_LEN + 1..].chunks_exact_mut(2).zip(pen.reading) {
        slot.copy_from_slice(&reading.min(READING_MAX).to_be_bytes());
    }
    seal(&mut frame, PEN, 5).expect("there is room");
    frame
}

/// Frames of up to `N` bytes, for [`crate::Decoder`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Framing<const N: usize = FRAME_MAX>;

/// The panel's decoder.
pub type Decoder = crate::Decoder<Framing, FRAME_MAX>;
/// The master's decoder: a panel sends only pen reports.
pub type PenDecoder = crate::Decoder<Framing<PEN_LEN>, PEN_LEN>;

impl<const N: usize> Format for Framing<N> {
    type Frame = Frame<N>;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        if bytes[0] != START {
            return Candidate::Noise;
        }
        let Some(&[_, _, high, low]) = bytes.first_chunk::<HEADER_LEN>() else {
            return Candidate::Incomplete;
        };
        let length = u16::from_be_bytes([high, low]);
        let end = HEADER_LEN + usize::from(length);
        if !POSSIBLE.contains(&usize::from(length)) || end + 2 > N {
            let max = u32::try_from(N - HEADER_LEN - 2).expect("at most 968");
            return Candidate::Rejected(FrameError::Length {
                max,
                found: u32::from(length),
            });
        }
        let Some(&[high, low]) = bytes.get(end..end + 2) else {
            return Candidate::Incomplete;
        };
        let found = u32::from(u16::from_be_bytes([high, low]));
        let expected = u32::from(checksum(&bytes[1..end]));
        if expected == found {
            Candidate::Complete(end + 2)
        } else {
            Candidate::Rejected(FrameError::Checksum { expected, found })
        }
    }

    fn frame(&self, bytes: &[u8]) -> Frame<N> {
        let mut frame = Frame {
            bytes: [0; N],
            len: bytes.len(),
        };
        frame.bytes[..bytes.len()].copy_from_slice(bytes);
        frame
    }
}

/// Payload lengths that any frame may have.
const POSSIBLE: RangeInclusive<usize> = 0..=PAYLOAD_MAX;

#[cfg(test)]
mod tests {
    use super::*;

    /// The check value in the catalogue of CRC algorithms.
    #[test]
    fn the_checksum_is_crc_16_xmodem() {
        assert_eq!(checksum(b"123456789"), 0x31C3);
    }

    /// Four pixels in two rows: three of one colour, one of another. By hand: window 0001 0002 0002
    /// 0003, runs 03 F800 and 01 001F.
    #[test]
    fn equal_neighbours_become_runs() {
        let window = Window {
            columns: [1, 2],
            rows: [2, 3],
        };
        let mut frame = [0; 40];
        let pixels = [0xF800, 0xF800, 0xF800, 0x001F];
        let len = encode_pixels(window, &pixels, &mut frame).expect("fits");
        let expected = [
            0x7E, 0xE0, 0x00, 0x0E, 0, 1, 0, 2, 0, 2, 0, 3, 3, 0xF8, 0x00, 1, 0x00, 0x1F,
        ];
        assert_eq!(frame[..18], expected);
        assert_eq!(len, 20);

        let mixed = [1, 2, 3, 4];
        let len = encode_pixels(window, &mixed, &mut frame).expect("fits");
        assert_eq!((frame[1], len), (WRITE, 4 + 8 + 8 + 2));
        assert_eq!(frame[12..20], [0, 1, 0, 2, 0, 3, 0, 4]);
        assert_eq!(encode_pixels(window, &mixed[..3], &mut frame), None);
    }

    /// A frame's payload has 968 bytes at most: with the window 480 pixels, one by one.
    #[test]
    fn as_many_pixels_as_a_frame_holds_are_sent_and_no_more() {
        let mut frame = [0; 2000];
        let pixels: [u16; 481] = core::array::from_fn(|at| u16::try_from(at).expect("below 481"));
        let window = |count: u16| Window {
            columns: [0, count - 1],
            rows: [0, 0],
        };
        let sent = encode_pixels(window(480), &pixels[..480], &mut frame);
        assert_eq!(sent, Some(4 + 8 + 960 + 2));
        assert_eq!(encode_pixels(window(481), &pixels, &mut frame), None);
    }

    #[test]
    fn a_pen_report_keeps_its_place() {
        let pen = Pen {
            contact: Contact::Down,
            reading: [0x123, 0xFFF],
        };
        let bytes = encode_pen(pen);
        assert_eq!(bytes[..9], [0x7E, 0x54, 0, 5, 1, 0x01, 0x23, 0x0F, 0xFF]);
        let frame = Framing::<PEN_LEN>.frame(&bytes);
        assert_eq!(frame.pen(), Some(pen));
        assert_eq!(frame.command(), None);
    }

    /// A frame as a decoder of up to `N` bytes gives it.
    fn decoded<const N: usize>(bytes: &[u8]) -> Result<Frame<N>, FrameError> {
        let mut decoder = crate::Decoder::<Framing<N>, N>::with_format(Framing);
        crate::Decode::push(&mut decoder, bytes)
            .next()
            .expect("it is complete")
    }

    /// Finding T2: the expected checksums were worked out bit by bit with the polynomial 1021.
    #[test]
    fn on_and_off_are_told_apart() {
        let [on, off] = [ON, OFF].map(encode_switch);
        assert_eq!(on, [0x7E, 0x29, 0, 0, 0x18, 0x57]);
        assert_eq!(off, [0x7E, 0x28, 0, 0, 0x2F, 0x67]);
        let command = |bytes: &[u8]| {
            decoded::<FRAME_MAX>(bytes).map(|frame| frame.command() == Some(Command::On))
        };
        assert_eq!((command(&on), command(&off)), (Ok(true), Ok(false)));
        let frame = decoded::<FRAME_MAX>(&off).expect("sound");
        assert_eq!(frame.command(), Some(Command::Off));
    }

    #[test]
    fn a_log_shows_number_and_payload() {
        extern crate std;
        let frame = Framing::<PEN_LEN>.frame(&encode_pen(Pen {
            contact: Contact::Down,
            reading: [0x123, 0xFFF],
        }));
        let text = std::format!("{frame:?}");
        assert_eq!(text, "panel::Frame(54, [01, 01, 23, 0F, FF])");
    }

    /// Finding T2: runs are three bytes, pixels two; a switch carries nothing.
    #[test]
    fn ragged_payloads_mean_nothing() {
        let means = |op, len| {
            let mut frame = [0; 40];
            let len = seal(&mut frame, op, len).expect("fits");
            let frame = decoded::<FRAME_MAX>(&frame[..len]).expect("sound");
            frame.command().is_some()
        };
        assert_eq!([8, 11, 14].map(|len| means(RUNS, len)), [true; 3]);
        assert_eq!([7, 9, 10, 12, 13].map(|len| means(RUNS, len)), [false; 5]);
        assert_eq!([8, 10, 12].map(|len| means(WRITE, len)), [true; 3]);
        assert_eq!([7, 9, 11].map(|len| means(WRITE, len)), [false; 3]);
        assert_eq!([ON, OFF].map(|op| means(op, 0)), [true; 2]);
        assert_eq!([ON, OFF].map(|op| means(op, 1)), [false; 2]);
        assert_eq!([ON, OFF].map(|op| means(op, 8)), [false; 2]);
    }

    /// Finding T2: 4 bytes before the payload and 2 behind it. A buffer that is 1 to 3 bytes too
    /// short stays unchanged.
    #[test]
    fn a_frame_needs_all_its_room() {
        let sealed = |room: usize| seal(&mut [0; 1000][..room], ON, 5);
        assert_eq!([8, 9, 10, 11].map(sealed), [None, None, None, Some(11)]);
        let longest = |len| seal(&mut [0; 1000], WRITE, len);
        assert_eq!(
            (longest(PAYLOAD_MAX), longest(PAYLOAD_MAX + 1)),
            (Some(974), None)
        );
    }

    /// Finding T2: a row of 480 pixels is the longest that is sent pixel by pixel.
    #[test]
    fn pixels_end_with_their_frame() {
        let row: [u16; 482] = core::array::from_fn(|x| u16::from(x % 2 == 0));
        let window = |width: u16| Window {
            columns: [0, width - 1],
            rows: [0, 0],
        };
        let mut frame = [0; 1000];
        let mut encoded = |width: u16, room: usize| {
            encode_pixels(
                window(width),
                &row[..usize::from(width)],
                &mut frame[..room],
            )
        };
        assert_eq!(encoded(480, 1000), Some(4 + 8 + 960 + 2));
        assert_eq!((encoded(480, 974), encoded(480, 973)), (Some(974), None));
        assert_eq!(encoded(482, 1000), None);
        let mut counted = [0; 40];
        assert_eq!(encode_pixels(window(3), &row[..2], &mut counted), None);
        assert_eq!(encode_pixels(window(2), &row[..3], &mut counted), None);
    }

    /// Finding T2: 256 equal pixels are runs of 255 and 1. Two runs are as long as three pixels:
    /// runs.
    #[test]
    fn runs_hold_255_pixels() {
        let window = |width: u16| Window {
            columns: [1, width],
            rows: [5, 5],
        };
        let mut frame = [0; 40];
        let len = encode_pixels(window(256), &[7; 256], &mut frame).expect("fits");
        assert_eq!((len, frame[1]), (4 + 8 + 6 + 2, RUNS));
        assert_eq!(frame[12..18], [255, 0, 7, 1, 0, 7]);
        let len = encode_pixels(window(3), &[7, 7, 9], &mut frame).expect("fits");
        assert_eq!((len, frame[1]), (20, RUNS));
        // Too little room for the pixels, which 2 runs do not need.
        assert_eq!(
            encode_pixels(window(256), &[7; 256], &mut frame[..20]),
            Some(20)
        );
        assert_eq!(
            encode_pixels(window(256), &[7; 256], &mut frame[..19]),
            None
        );
    }

    /// 50 runs of two are 150 bytes, 100 pixels one by one are 200.
    #[test]
    fn many_short_runs_are_runs_as_long_as_they_are_shorter() {
        let window = Window {
            columns: [0, 99],
            rows: [0, 0],
        };
        let pixels: [u16; 100] = core::array::from_fn(|x| u16::from(x / 2 % 2 == 0));
        let mut frame = [0; 300];
        let len = encode_pixels(window, &pixels, &mut frame);
        assert_eq!((len, frame[1]), (Some(4 + 8 + 150 + 2), RUNS));
    }

    /// Finding T2: a pen report is 11 bytes; one with a byte more is refused by a decoder of 11.
    #[test]
    fn a_frame_too_long_for_its_decoder_is_told() {
        let mut frame = [0; 40];
        let len = seal(&mut frame, PEN, 5).expect("fits");
        assert!(decoded::<PEN_LEN>(&frame[..len]).is_ok());
        let len = seal(&mut frame, PEN, 6).expect("fits");
        let error = FrameError::Length { max: 5, found: 6 };
        assert_eq!(decoded::<PEN_LEN>(&frame[..len]), Err(error));
        assert!(decoded::<FRAME_MAX>(&frame[..len]).is_ok());
        let error = FrameError::Length {
            max: 968,
            found: 969,
        };
        let too_long = [START, WRITE, 0x03, 0xC9];
        assert_eq!(decoded::<FRAME_MAX>(&too_long), Err(error));
    }

    /// 12 bits a reading; other values of the first byte are neither touch nor lift.
    #[test]
    fn a_pen_report_has_its_limits() {
        let pen = |payload: &[u8]| {
            let mut frame = [0; 40];
            frame[HEADER_LEN..HEADER_LEN + payload.len()].copy_from_slice(payload);
            let len = seal(&mut frame, PEN, payload.len()).expect("fits");
            decoded::<FRAME_MAX>(&frame[..len]).expect("sound").pen()
        };
        let lifted = Pen {
            contact: Contact::Up,
            reading: [0x0FFF, 0],
        };
        assert_eq!(pen(&[0, 0x0F, 0xFF, 0, 0]), Some(lifted));
        assert_eq!(pen(&[0, 0x10, 0x00, 0, 0]), None);
        assert_eq!(pen(&[0, 0, 0, 0x10, 0x00]), None);
        assert_eq!(pen(&[2, 0, 0, 0, 0]), None);
        assert_eq!(pen(&[1, 0, 0, 0]), None);
        let clamped = encode_pen(Pen {
            reading: [4096, 4095],
            ..lifted
        });
        assert_eq!(clamped[4..9], [0, 0x0F, 0xFF, 0x0F, 0xFF]);
    }

    /// Windows of 3 columns and 2 rows, of one place, and with exchanged corners; the area of the
    /// largest window saturates.
    #[test]
    fn the_area_is_columns_times_rows() {
        let area = |columns, rows| Window { columns, rows }.area();
        assert_eq!(area([4, 6], [1, 2]), 6);
        assert_eq!(area([9, 9], [9, 9]), 1);
        assert_eq!((area([5, 4], [0, 0]), area([0, 0], [5, 4])), (0, 0));
        assert_eq!(area([0, 0xFFFF], [0, 0xFFFF]), u32::MAX);
        assert_eq!(area([0, 0xFFFF], [0, 0xFFFE]), 0xFFFF_0000);
    }
}
