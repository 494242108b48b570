//! Frames and texts in words, one line each.

use core::fmt::Write as _;

use protocols::avr::{self, ERROR_REGISTER, registers};
use protocols::hc06::{Command, LineCommand};
use protocols::panel;
use protocols::pcui::{self, Message};
use protocols::rle;
use protocols::xv11::{self, Reading};

const TAKES_ALL: &str = "a string takes everything";

/// A lidar's packet: speed and four readings; `?` marks a strength warning, brackets a code.
pub(crate) fn packet(frame: &xv11::Frame) -> String {
    let degree = u32::from(frame.index()) * 4;
    let mut out = format!("{:.2} rpm, from {degree} deg:", frame.speed_rpm());
    for reading in frame.readings() {
        match reading {
            Reading::Range {
                distance_mm, weak, ..
            } => {
                let mark = if weak { "?" } else { "" };
                write!(out, " {distance_mm}{mark}")
            }
            Reading::Invalid { code, .. } => write!(out, " ({code:02X})"),
        }
        .expect(TAKES_ALL);
    }
    out + " mm"
}

/// A turn of the old firmware, its readings counted.
pub(crate) fn turn(frame: &xv11::turn::Frame) -> String {
    let (mut ok, mut weak, mut invalid) = (0, 0, 0);
    for degree in 0..360 {
        match frame.reading(degree) {
            Reading::Range { weak: false, .. } => ok += 1,
            Reading::Range { weak: true, .. } => weak += 1,
            Reading::Invalid { .. } => invalid += 1,
        }
    }
    let period = frame.period();
    format!("turn, period word {period:#06x}, {ok} ok, {weak} weak, {invalid} invalid")
}

/// A frame of the register bus, by the names of its registers.
pub(crate) fn bus(frame: &avr::Frame) -> String {
    let (register, count) = (frame.register(), frame.count());
    if frame.is_write() {
        return format!("{register}:{}", values(register, frame.data()));
    }
    if count == 0 && register == ERROR_REGISTER {
        return "error".to_owned();
    }
    if count == 0 {
        return format!("acknowledge {register}{}", names(register, 1));
    }
    format!("read {count} from {register}:{}", names(register, count))
}

/// Names of the values that begin or end among `count` registers from `first` on.
fn names(first: u8, count: u8) -> String {
    let last = u16::from(first) + u16::from(count);
    let (mut out, mut at) = (String::new(), u16::from(first));
    while at < last {
        let Some(register) = u8::try_from(at).ok().and_then(registers::at) else {
            return out;
        };
        write!(out, " {}", register.name).expect(TAKES_ALL);
        at = u16::from(register.address) + u16::from(register.width.bytes());
    }
    out
}

/// `data` as the values of the registers from `first` on; what is no whole value as bytes.
fn values(first: u8, mut data: &[u8]) -> String {
    use registers::Width;
    let (mut out, mut at) = (String::new(), first);
    while let [byte, rest @ ..] = data {
        let known = registers::at(at).filter(|register| register.address == at);
        let len = known.map_or(1, |register| usize::from(register.width.bytes()));
        let (Some(register), true) = (known, len <= data.len()) else {
            write!(out, " {byte:02X}").expect(TAKES_ALL);
            (data, at) = (rest, at.wrapping_add(1));
            continue;
        };
        let value = match register.width {
            Width::U8 => i64::from(*byte),
            Width::I8 => i64::from(byte.cast_signed()),
            Width::I16 => i64::from(i16::from_le_bytes([data[0], data[1]])),
            Width::I32 => i64::from(i32::from_le_bytes([data[0], data[1], data[2], data[3]])),
        };
        let gap = if register.unit.is_empty() { "" } else { " " };
        write!(out, " {}={value}{gap}{}", register.name, register.unit).expect(TAKES_ALL);
        data = &data[len..];
        at = at.wrapping_add(register.width.bytes());
    }
    out
}

/// A message between robot and PC.
pub(crate) fn message(frame: &pcui::Frame) -> String {
    let id = frame.id();
    let id = id.escape_ascii();
    match frame.message() {
        Err(error) => format!("{id}: {error}"),
        Ok(Message::Map(map)) => {
            let [x, y] = map.position_mm;
            let [width, height] = map.size_mm;
            let (cell, psi) = (map.resolution_mm, map.psi_deg);
            format!("{id} map {width} x {height} mm of {cell} mm, robot at {x},{y} mm {psi} deg")
        }
        Ok(Message::Row(row)) => {
            let (layer, y, len) = (row.layer, row.y, row.data.len());
            format!("{id} layer {layer} row {y}, {len} pixels")
        }
        Ok(Message::CodedRow(row)) => {
            let (layer, y, len) = (row.layer, row.y, row.data.len());
            let pixels = rle::decode(row.data, &mut [0; 0x10000]);
            let pixels = pixels.map_or_else(|e| e.to_string(), |n| format!("{n} pixels"));
            format!("{id} layer {layer} row {y}, {pixels} in {len} bytes")
        }
        Ok(Message::Waypoints(list)) => {
            let mut out = format!("{id} {} waypoints", list.len());
            for point in list.iter() {
                let [x, y] = point.position_mm;
                write!(out, " {}:{x},{y}", point.id).expect(TAKES_ALL);
            }
            out
        }
        Ok(Message::Order(order)) => {
            let [left, right] = order.set_point;
            format!("{id} order {:?}, set-points {left} {right}", order.mode)
        }
        Ok(Message::State(state)) => {
            let ([left, right], [l, r]) = (state.speed_mm_s, state.set_point);
            let mode = state.mode;
            format!("{id} state {mode:?}, speed {left} {right} mm/s, set-points {l} {r}")
        }
    }
}

/// A frame to or from a touch panel.
pub(crate) fn panel(frame: &panel::Frame) -> String {
    use panel::{Command, Contact};
    let window = |window: panel::Window| {
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

/// Somebody's comment, on one line whatever it holds.
pub(crate) fn one_line(comment: &str) -> String {
    let plain = |c: char| if c.is_control() { ' ' } else { c };
    comment.chars().map(plain).collect()
}

/// Text on a line; what an HC-06 would take for a command is named.
pub(crate) fn text(bytes: &[u8]) -> String {
    let shown = bytes.escape_ascii();
    match at_command(bytes) {
        Some(words) => format!("AT command \"{shown}\": {words}"),
        None => format!("text \"{shown}\""),
    }
}

fn at_command(bytes: &[u8]) -> Option<String> {
    if let Some(line) = bytes.strip_suffix(b"\r\n") {
        return LineCommand::parse(line).map(|command| match command {
            LineCommand::Name(name) => format!("name is \"{}\"", name.escape_ascii()),
            LineCommand::Pin(pin) => format!("PIN is {}", pin.escape_ascii()),
            LineCommand::Uart(line) => format!("rate is {} baud", line.baud),
            other => format!("{other:?}"),
        });
    }
    Command::parse(bytes).map(|command| match command {
        Command::Name(name) => format!("name is \"{}\"", name.escape_ascii()),
        Command::Pin(pin) => format!("PIN is {}", pin.escape_ascii()),
        Command::Baud(rate) => format!("rate is {rate} baud"),
        other => format!("{other:?}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocols::Decode as _;

    fn of_bus(bytes: &[u8]) -> String {
        let mut decoder = avr::Decoder::new(avr::ChecksumOrder::HighFirst);
        let frame = decoder.push(bytes).find_map(Result::ok);
        bus(&frame.expect("sound"))
    }

    /// Vectors of the fielded firmware, register names of its map.
    #[test]
    fn the_bus_is_told_by_the_names_of_its_registers() {
        let read = of_bus(&[0xAB, 0x24, 0x0A, 0x00, 0xD9]);
        let names = "encoder_left encoder_right speed_left_is speed_right_is";
        assert_eq!(read, format!("read 10 from 36: {names}"));
        let write = of_bus(&[0xAB, 0x2E, 0x83, 0x14, 0xEC, 0x00, 0x02, 0x5C]);
        let values = "speed_left_to=20 ticks/40 ms speed_right_to=-20 ticks/40 ms motor_standby=0";
        assert_eq!(write, format!("46: {values}"));
        let ack = of_bus(&[0xAB, 0x2E, 0x00, 0x00, 0xD9]);
        assert_eq!(ack, "acknowledge 46 speed_left_to");
        assert_eq!(of_bus(&[0xAB, 0xFF, 0x00, 0x01, 0xAA]), "error");
    }

    /// The fielded robot's row of unknown cells: 255 + 44 of 300.
    #[test]
    fn a_coded_row_is_told_by_its_pixels() {
        let bytes = b"PCUI_MSG\x07\x00\x29\x02\x00\x00MAR\x00\x00\x00\xFF\x7F\x2C\x7F";
        let mut decoder = pcui::Decoder::default();
        let frame = decoder.push(bytes).find_map(Result::ok).expect("sound");
        assert_eq!(message(&frame), "MAR layer 0 row 0, 299 pixels in 4 bytes");
    }

    /// Checksums by an independent CRC-16/XMODEM.
    #[test]
    fn frames_of_the_panel_are_told_by_their_place_and_pixels() {
        let told = |bytes: &[u8]| {
            let mut decoder = panel::Decoder::default();
            panel(&decoder.push(bytes).find_map(Result::ok).expect("sound"))
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

    #[test]
    fn commands_of_the_radio_are_named() {
        assert_eq!(
            text(b"AT+BAUDA"),
            "AT command \"AT+BAUDA\": rate is 460800 baud"
        );
        assert_eq!(text(b"OKsetname"), "text \"OKsetname\"");
        let v3 = text(b"AT+NAME=rescue\r\n");
        assert_eq!(
            v3,
            "AT command \"AT+NAME=rescue\\r\\n\": name is \"rescue\""
        );
    }
}
