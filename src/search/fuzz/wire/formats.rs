//! The wire formats as a fuzzer sees them: how frames are built of choices, and, once more and
//! slowly, what a frame is.

use core::marker::PhantomData;

use protocols::avr::{self, ChecksumOrder};
use protocols::pcui::message::MapRow;
use protocols::pcui::{self, Message};
use protocols::xv11::{self, RawReading, SpeedWord, turn};
use protocols::{Decode, FrameError, rle};

use super::{Broken, Choices};

/// A wire format.
pub trait Wire {
    /// Its decoder.
    type Decoder: Decode;

    /// Name of the target.
    const NAME: &'static str;

    /// A fresh decoder.
    fn decoder() -> Self::Decoder;

    /// A frame's bytes.
    fn bytes(frame: &<Self::Decoder as Decode>::Frame) -> &[u8];

    /// Appends a valid frame to `out`.
    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>);

    /// Makes lengths and checksum fit the damaged `frame` again, if it still has room for them.
    fn repair(frame: &mut [u8]);

    /// The length of the frame that `bytes` begins with: the format read slowly and obviously,
    /// without the code on trial.
    fn frame_at(bytes: &[u8]) -> Option<usize>;

    /// Whether a frame means what its parts say: made again of them, it is the same.
    fn means_itself(frame: &<Self::Decoder as Decode>::Frame) -> Result<(), Broken>;

    /// Which kind of frame it is, below 2^32: frames of a kind are alike to a fuzzer.
    fn kind(frame: &<Self::Decoder as Decode>::Frame) -> u64 {
        Self::bytes(frame).len() as u64
    }
}

pub(super) fn made_again(found: &[u8], made: &[u8]) -> Result<(), Broken> {
    if found == made {
        return Ok(());
    }
    let detail = format!("{found:02X?} made again of its parts is {made:02X?}");
    Err(Broken::new("frame-means-itself", detail))
}

/// XV-11 packets.
#[derive(Clone, Copy, Debug)]
pub struct Xv11;

impl Wire for Xv11 {
    type Decoder = xv11::Decoder;
    const NAME: &'static str = "xv11";

    fn decoder() -> xv11::Decoder {
        xv11::Decoder::default()
    }

    fn bytes(frame: &xv11::Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let (index, speed) = (choices.byte(), choices.word());
        let readings = [(); 4].map(|()| RawReading([(); 4].map(|()| choices.byte())));
        out.extend(xv11::Frame::new(index, SpeedWord(speed), readings).as_bytes());
    }

    fn repair(frame: &mut [u8]) {
        if let Some(frame) = frame.first_chunk_mut() {
            let sum = xv11::checksum(frame);
            frame[20..].copy_from_slice(&sum.to_le_bytes());
        }
    }

    /// The sum as the public description has it, one byte after the other.
    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let frame = bytes.get(..22)?;
        if frame[0] != 0xFA || !(0xA0..=0xF9).contains(&frame[1]) {
            return None;
        }
        let mut sum = 0_u32;
        for word in 0..10 {
            sum = sum * 2 + u32::from(frame[2 * word]) + 256 * u32::from(frame[2 * word + 1]);
        }
        let folded = ((sum % 32_768) + sum / 32_768) % 32_768;
        (folded == u32::from(frame[20]) + 256 * u32::from(frame[21])).then_some(22)
    }

    fn kind(frame: &xv11::Frame) -> u64 {
        let valid = frame.readings().map(|reading| match reading {
            xv11::Reading::Range { weak: false, .. } => 0,
            xv11::Reading::Range { .. } => 1,
            _ => 2,
        });
        valid.iter().fold(0, |kind, reading| kind * 3 + reading)
    }

    fn means_itself(frame: &xv11::Frame) -> Result<(), Broken> {
        let made = xv11::Frame::new(frame.index(), frame.speed(), frame.raw_readings());
        made_again(frame.as_bytes(), made.as_bytes())?;
        for raw in frame.raw_readings() {
            let reading = xv11::Reading::from(raw);
            let again = xv11::Reading::from(RawReading::from(reading));
            if again != reading {
                let detail = format!("{reading:?} said and heard is {again:?}");
                return Err(Broken::new("reading-means-itself", detail));
            }
        }
        Ok(())
    }
}

/// XV-11 turns of firmware 2.1.
#[derive(Clone, Copy, Debug)]
pub struct Xv11Turns;

impl Wire for Xv11Turns {
    type Decoder = turn::Decoder;
    const NAME: &'static str = "xv11-turns";

    fn decoder() -> turn::Decoder {
        turn::Decoder::default()
    }

    fn bytes(frame: &turn::Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let period = choices.word();
        let reading = RawReading([(); 4].map(|()| choices.byte()));
        out.extend(turn::Frame::new(period, &[reading; 360]).as_bytes());
    }

    fn repair(frame: &mut [u8]) {
        if let Some(header) = frame.first_chunk_mut() {
            *header = [0x5A, 0xA5, 0x00, 0xC0];
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        (bytes.len() >= 1446 && bytes.starts_with(&[0x5A, 0xA5, 0x00, 0xC0])).then_some(1446)
    }

    fn means_itself(frame: &turn::Frame) -> Result<(), Broken> {
        let readings = core::array::from_fn(|degree| frame.raw_reading(degree));
        let made = turn::Frame::new(frame.period(), &readings);
        made_again(frame.as_bytes(), made.as_bytes())
    }
}

/// An order of the register bus's checksum.
pub trait Order {
    /// Which.
    const ORDER: ChecksumOrder;
    /// Name of the target.
    const NAME: &'static str;
}

/// As documented.
#[derive(Clone, Copy, Debug)]
pub struct LowFirst;

impl Order for LowFirst {
    const ORDER: ChecksumOrder = ChecksumOrder::LowFirst;
    const NAME: &'static str = "avr-low-first";
}

/// As fielded.
#[derive(Clone, Copy, Debug)]
pub struct HighFirst;

impl Order for HighFirst {
    const ORDER: ChecksumOrder = ChecksumOrder::HighFirst;
    const NAME: &'static str = "avr-high-first";
}

/// The register bus.
#[derive(Clone, Copy, Debug)]
pub struct Avr<O>(PhantomData<O>);

impl<O: Order> Wire for Avr<O> {
    type Decoder = avr::Decoder;
    const NAME: &'static str = O::NAME;

    fn decoder() -> avr::Decoder {
        avr::Decoder::new(O::ORDER)
    }

    fn bytes(frame: &avr::Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let (register, control) = (choices.byte(), choices.byte());
        let frame = if control & 0x80 == 0 {
            avr::Frame::read(register, control, O::ORDER)
        } else {
            let data = choices.take(usize::from(control & 0x7F));
            avr::Frame::write(register, data, O::ORDER)
        };
        out.extend(frame.as_bytes());
    }

    fn repair(frame: &mut [u8]) {
        let Some(end) = frame.len().checked_sub(2).filter(|end| *end >= 3) else {
            return;
        };
        if frame[2] & 0x80 != 0 && end - 3 <= avr::DATA_MAX {
            frame[2] = 0x80 | u8::try_from(end - 3).expect("at most 127");
        }
        let sum = avr::checksum(&frame[..end]);
        let sum = match O::ORDER {
            ChecksumOrder::LowFirst => sum.to_le_bytes(),
            ChecksumOrder::HighFirst => sum.to_be_bytes(),
        };
        frame[end..].copy_from_slice(&sum);
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let control = usize::from(*bytes.get(2)?);
        let end = 3 + control.saturating_sub(128);
        let sum: usize = bytes
            .get(..end)?
            .iter()
            .map(|&byte| usize::from(byte))
            .sum();
        let (first, second) = (*bytes.get(end)?, *bytes.get(end + 1)?);
        let (low, high) = match O::ORDER {
            ChecksumOrder::LowFirst => (first, second),
            ChecksumOrder::HighFirst => (second, first),
        };
        let holds = sum % 65_536 == usize::from(low) + 256 * usize::from(high);
        (bytes[0] == 0xAB && holds).then_some(end + 2)
    }

    fn kind(frame: &avr::Frame) -> u64 {
        let size = u64::from(u8::BITS - frame.count().leading_zeros());
        u64::from(frame.is_write()) << 16 | u64::from(frame.register() / 8) << 8 | size
    }

    fn means_itself(frame: &avr::Frame) -> Result<(), Broken> {
        let made = if frame.is_write() {
            avr::Frame::write(frame.register(), frame.data(), O::ORDER)
        } else {
            avr::Frame::read(frame.register(), frame.count(), O::ORDER)
        };
        made_again(frame.as_bytes(), made.as_bytes())
    }
}

/// The PC link.
#[derive(Clone, Copy, Debug)]
pub struct Pcui;

const IDS: [[u8; 3]; 8] = [
    *b"MPD", *b"MAP", *b"MAR", *b"LWP", *b"STA", *b"STA", *b"LWP", *b"???",
];

impl Wire for Pcui {
    type Decoder = pcui::Decoder;
    const NAME: &'static str = "pcui";

    fn decoder() -> pcui::Decoder {
        pcui::Decoder::default()
    }

    fn bytes(frame: &pcui::Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let id = IDS[choices.below(IDS.len())];
        let len = match (&id, choices.byte()) {
            (b"MPD", 0..250) => 13,
            (b"STA", most @ 0..250) => {
                if most % 2 == 0 {
                    3
                } else {
                    9
                }
            }
            (b"LWP", most @ 0..250) => 2 + 9 * usize::from(most % 8),
            (_, most) => usize::from(most) * 2,
        };
        let start = out.len();
        out.resize(start + pcui::HEADER_LEN, 0);
        out.extend(choices.take(len));
        out.resize(start + pcui::HEADER_LEN + len, 0);
        if &id == b"LWP" && len >= 2 && (len - 2).is_multiple_of(9) {
            let count = u16::try_from((len - 2) / 9).expect("at most 56");
            out[start + pcui::HEADER_LEN..][..2].copy_from_slice(&count.to_le_bytes());
        }
        let sealed = pcui::seal(&mut out[start..], id, len);
        debug_assert!(sealed.is_some(), "at most 510 bytes");
    }

    fn repair(frame: &mut [u8]) {
        if let Some(len) = frame.len().checked_sub(pcui::HEADER_LEN) {
            let id = [frame[14], frame[15], frame[16]];
            // A payload that became too long stays as it is.
            let _ = pcui::seal(frame, id, len);
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let header = bytes.get(..17)?;
        let len = usize::from(header[8]) + 256 * usize::from(header[9]);
        if !header.starts_with(b"PCUI_MSG") || len > 511 {
            return None;
        }
        let payload = bytes.get(17..17 + len)?;
        let sum: u32 = payload.iter().map(|&byte| u32::from(byte)).sum();
        (sum.to_le_bytes() == header[10..14]).then_some(17 + len)
    }

    fn kind(frame: &pcui::Frame) -> u64 {
        let len = frame.payload().len();
        let size = u64::from(usize::BITS - len.leading_zeros());
        let message = match frame.message() {
            Ok(Message::Map(_)) => 1,
            Ok(Message::Row(_)) => 2,
            Ok(Message::CodedRow(_)) => 3,
            Ok(Message::Waypoints(_)) => 4,
            Ok(Message::Order(_)) => 5,
            Ok(Message::State(_)) => 6,
            Err(_) => 7,
        };
        message << 8 | size
    }

    fn means_itself(frame: &pcui::Frame) -> Result<(), Broken> {
        use pcui::message;
        let mut made = [0; pcui::FRAME_MAX];
        let len = match frame.message() {
            Err(_) => return Ok(()),
            Ok(Message::Map(map)) => message::encode_map_properties(&map, &mut made),
            Ok(Message::Waypoints(list)) => {
                let list: Vec<_> = list.iter().collect();
                message::encode_waypoints(list.into_iter(), &mut made)
            }
            Ok(Message::Order(order)) => message::encode_order(&order, &mut made),
            Ok(Message::State(state)) => message::encode_state(&state, &mut made),
            Ok(Message::Row(row)) => return row_means_itself(&row, row.data),
            Ok(Message::CodedRow(row)) => {
                let mut pixels = [0; 300];
                return match rle::decode(row.data, &mut pixels) {
                    Ok(len) => row_means_itself(&row, &pixels[..len]),
                    Err(_) => Ok(()),
                };
            }
        };
        made_again(frame.as_bytes(), &made[..len.unwrap_or(0)])
    }
}

/// A row has several spellings: said again, it must show the same pixels at the same place.
fn row_means_itself(row: &MapRow<'_>, pixels: &[u8]) -> Result<(), Broken> {
    let mut made = [0; pcui::FRAME_MAX];
    let dialect = rle::Dialect::Lossless;
    let len = pcui::message::encode_row(row.layer, row.y, pixels, dialect, &mut made);
    let mut decoder = pcui::Decoder::default();
    let mut again = [0; pcui::PAYLOAD_MAX];
    let frame = decoder.push(&made[..len.unwrap_or(0)]).find_map(Result::ok);
    let shown = match frame.as_ref().map(|frame| frame.message()) {
        Some(Ok(Message::Row(other))) if (other.layer, other.y) == (row.layer, row.y) => {
            Some(other.data)
        }
        Some(Ok(Message::CodedRow(other))) if (other.layer, other.y) == (row.layer, row.y) => {
            rle::decode(other.data, &mut again).map_or(None, |len| Some(&again[..len]))
        }
        _ => None,
    };
    if shown == Some(pixels) {
        return Ok(());
    }
    let detail = format!("row {} of {pixels:?} said again shows {shown:?}", row.y);
    Err(Broken::new("rows-mean-themselves", detail))
}

/// How an error is told from another without its figures.
pub(super) const fn kind_of(error: FrameError) -> u8 {
    match error {
        FrameError::Checksum { .. } => 1,
        FrameError::Length { .. } => 2,
        FrameError::Truncated { .. } => 3,
        _ => 4,
    }
}
