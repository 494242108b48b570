//! `panel`: drawing commands to a touch panel and its pen's reports.

use protocols::Decode;
use protocols::panel::{self, Command, Contact, HEADER_LEN, Window};

use super::answers::Answers;
use super::floor::Floor;
use super::lua::{Lua, LuaField, field};
use super::row::Codec;
use super::wire::{Broken, Choices, Wire, made_again};

/// Frames to and from a touch panel.
pub static PANEL: Codec = Codec::of::<Panel>("Touch panel: drawing commands and pen reports")
    .with_answers(Answers {
        // The number of a command or report.
        kind: |frame| &frame[1..2],
        head: HEADER_LEN,
        ..Answers::PLAIN
    })
    .with_floor(Floor {
        check_bits: 28,
        ..Floor::CHECKED
    })
    .with_lua(Lua {
        source: include_str!("lua/panel.lua"),
        judge: "judge_panel",
        tell: "tell_panel",
        fields: &FIELDS,
    });

const FIELDS: [LuaField; 6] = [
    field("op", "uint8", "hilrig.panel.op", "Number").shown_as(
        "base.HEX, { [0x28] = \"display off\", [0x29] = \"display on\", \
         [0x2C] = \"write memory\", [0xE0] = \"write runs\", [0x54] = \"pen\" }",
    ),
    field("window", "string", "hilrig.panel.window", "Window"),
    field("drawn", "uint32", "hilrig.panel.pixels", "Pixels"),
    field("pen_down", "bool", "hilrig.panel.pen_down", "Pen down"),
    field("pen_x", "uint16", "hilrig.panel.pen_x", "Pen reading x"),
    field("pen_y", "uint16", "hilrig.panel.pen_y", "Pen reading y"),
];

/// The touch panel.
#[derive(Clone, Copy, Debug)]
pub struct Panel;

/// Number of bytes before and after the payload.
const AROUND: usize = HEADER_LEN + 2;
/// Numbers of frames; the last is unknown.
const OPS: [u8; 8] = [
    panel::RUNS,
    panel::RUNS,
    panel::WRITE,
    panel::WRITE,
    panel::PEN,
    panel::ON,
    panel::OFF,
    0x00,
];

impl Wire for Panel {
    type Decoder = panel::Decoder;
    const NAME: &'static str = "panel";

    fn decoder() -> panel::Decoder {
        panel::Decoder::default()
    }

    fn bytes(frame: &panel::Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn words(frame: &panel::Frame) -> String {
        words(frame)
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let op = OPS[choices.below(OPS.len())];
        let len = match (op, choices.byte()) {
            (panel::RUNS, most @ 0..250) => panel::WINDOW_LEN + 3 * usize::from(most % 8),
            (panel::WRITE, most @ 0..250) => panel::WINDOW_LEN + 2 * usize::from(most % 8),
            (panel::PEN, 0..250) => 5,
            (panel::ON | panel::OFF, 0..250) => 0,
            (_, most) => usize::from(most) * 3,
        };
        let start = out.len();
        out.resize(start + HEADER_LEN, 0);
        out.extend(choices.take(len));
        out.resize(start + AROUND + len, 0);
        let sealed = panel::seal(&mut out[start..], op, len);
        debug_assert!(sealed.is_some(), "at most 765 bytes");
    }

    fn repair(frame: &mut [u8]) {
        if let Some(len) = frame.len().checked_sub(AROUND) {
            let op = frame[1];
            // A payload that has become too long stays unchanged.
            let _ = panel::seal(frame, op, len);
        }
    }

    /// The checksum bit by bit.
    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let header = bytes.get(..4)?;
        let end = 4 + usize::from(header[2]) * 256 + usize::from(header[3]);
        if header[0] != 0x7E || end - 4 > 968 {
            return None;
        }
        let mut sum = 0_u16;
        for byte in bytes.get(1..end)? {
            sum ^= u16::from(*byte) << 8;
            for _ in 0..8 {
                let carries = sum & 0x8000 != 0;
                sum <<= 1;
                sum ^= if carries { 0x1021 } else { 0 };
            }
        }
        (bytes.get(end..end + 2)? == sum.to_be_bytes()).then_some(end + 2)
    }

    fn is_plausible(frame: &panel::Frame) -> bool {
        frame.command().is_some() || frame.pen().is_some()
    }

    fn kind(frame: &panel::Frame) -> u64 {
        let size = u64::from(usize::BITS - frame.payload().len().leading_zeros());
        let is_told = frame.command().is_some() || frame.pen().is_some();
        u64::from(frame.op()) << 16 | u64::from(is_told) << 8 | size
    }

    fn means_itself(frame: &panel::Frame) -> Result<(), Broken> {
        if let Some(pen) = frame.pen() {
            return made_again(frame.as_bytes(), &panel::encode_pen(pen));
        }
        match frame.command() {
            Some(Command::On | Command::Off) => {
                made_again(frame.as_bytes(), &panel::encode_switch(frame.op()))
            }
            Some(Command::Write(window, pixels)) => {
                let pixels = pixels.chunks_exact(2).map(|pixel| (1, pixel));
                pixels_mean_themselves(window, pixels)
            }
            Some(Command::Runs(window, runs)) => {
                let runs = runs.chunks_exact(3).map(|run| (run[0], &run[1..]));
                pixels_mean_themselves(window, runs)
            }
            None => Ok(()),
        }
    }
}

/// Compares pixels instead of bytes, because pixels have two encodings: after encoding again, the
/// pixels must be the same.
fn pixels_mean_themselves<'a>(
    window: Window,
    runs: impl Iterator<Item = (u8, &'a [u8])>,
) -> Result<(), Broken> {
    let mut pixels = [0; PIXELS_MAX];
    let Some(len) =
        spread(runs, &mut pixels).filter(|&len| u32::try_from(len) == Ok(window.area()))
    else {
        return Ok(());
    };
    let mut made = [0; panel::FRAME_MAX];
    let said = panel::encode_pixels(window, &pixels[..len], &mut made);
    let mut decoder = panel::Decoder::default();
    let frame = decoder
        .push(&made[..said.unwrap_or(0)])
        .find_map(Result::ok);
    let mut again = [0; PIXELS_MAX];
    let found = match frame.as_ref().and_then(panel::Frame::command) {
        Some(Command::Write(other, pixels)) if other == window => {
            spread(pixels.chunks_exact(2).map(|pixel| (1, pixel)), &mut again)
        }
        Some(Command::Runs(other, runs)) if other == window => {
            let runs = runs.chunks_exact(3).map(|run| (run[0], &run[1..]));
            spread(runs, &mut again)
        }
        _ => None,
    };
    if found.map(|found| &again[..found]) == Some(&pixels[..len]) {
        return Ok(());
    }
    let detail =
        format!("{len} pixels, written and read again, give {found:?} pixels or other values");
    Err(Broken::new("pixels-mean-themselves", detail))
}

/// Maximum number of pixels that fit a frame one by one.
const PIXELS_MAX: usize = 480;

/// The pixels of `runs` in a row; `None` if there are more than fit.
fn spread<'a>(
    runs: impl Iterator<Item = (u8, &'a [u8])>,
    pixels: &mut [u16; PIXELS_MAX],
) -> Option<usize> {
    let mut len = 0;
    for (count, pixel) in runs {
        let end = len + usize::from(count);
        let pixel = u16::from_be_bytes([pixel[0], pixel[1]]);
        pixels.get_mut(len..end)?.fill(pixel);
        len = end;
    }
    Some(len)
}

/// A frame to or from a touch panel.
fn words(frame: &panel::Frame) -> String {
    let window = |window: Window| {
        let ([x0, x1], [y0, y1]) = (window.columns, window.rows);
        format!("window {x0},{y0} to {x1},{y1}")
    };
    if let Some(pen) = frame.pen() {
        let [x, y] = pen.reading;
        let contact = match pen.contact {
            Contact::Down => "down",
            Contact::Up => "up",
        };
        return format!("pen {contact} at {x},{y}");
    }
    match frame.command() {
        Some(Command::On) => "display on".to_owned(),
        Some(Command::Off) => "display off".to_owned(),
        Some(Command::Write(place, pixels)) => {
            format!("{}: {} pixels", window(place), pixels.len() / 2)
        }
        Some(Command::Runs(place, runs)) => {
            let pixels: u32 = runs.iter().step_by(3).map(|&count| u32::from(count)).sum();
            format!(
                "{}: {pixels} pixels in {} runs",
                window(place),
                runs.len() / 3
            )
        }
        None => format!("number {:02X}, {} bytes", frame.op(), frame.payload().len()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checksums by an independent CRC-16/XMODEM.
    #[test]
    fn frames_of_the_panel_are_told_by_their_place_and_pixels() {
        let told = |bytes: &[u8]| {
            let mut decoder = panel::Decoder::default();
            words(&decoder.push(bytes).find_map(Result::ok).expect("sound"))
        };
        assert_eq!(told(b"\x7E\x29\x00\x00\x18\x57"), "display on");
        let pen = b"\x7E\x54\x00\x05\x01\x01\x23\x0A\xBC\x0D\xE7";
        assert_eq!(told(pen), "pen down at 291,2748");
        let runs = b"\x7E\xE0\x00\x0E\x00\x00\x00\x02\x00\x03\x00\x02\
            \x03\xF8\x00\x01\x07\xE0\x08\x26";
        assert_eq!(told(runs), "window 0,2 to 3,2: 4 pixels in 2 runs");
        let pixels = b"\x7E\x2C\x00\x0C\x00\x00\x00\x02\x00\x01\x00\x02\xF8\x00\x07\xE0\x6B\xA6";
        assert_eq!(told(pixels), "window 0,2 to 1,2: 2 pixels");
    }
}
