//! Diagrams of frames and bodies.

use core::time::Duration;

use super::number_name;
use super::render::{Block, Page};
use crate::description::{Description, Protocol};
use crate::field::{Field, Kind, Size};
use crate::framing::{Check, Cut, Framing};
use crate::schema::wire::Stuffing;

/// A part of a frame: its name and its length.
pub(super) type Part = (String, String);

pub(super) fn frames(of: &Description, page: &mut Page) {
    for framing in of.frames.0.iter() {
        if of.frames.0.len() > 1 {
            page.heading_below(&framing.name);
        }
        page.text(end_of(of, framing));
        page.add(Block::Diagram(parts(framing)));
        for check in &framing.checks {
            page.text(checksum(framing, check));
        }
        let size = match framing.cut {
            Cut::Fixed(_) => String::new(),
            _ => format!("A frame has {} bytes at most. ", framing.max),
        };
        page.text(format!(
            "{size}A pause of {} discards a partial frame.",
            span::Span(rounded(framing.idle))
        ));
    }
}

/// A time rounded for display, to a thousandth of its unit.
fn rounded(time: Duration) -> Duration {
    let step = match time.as_micros() {
        0..10_000 => Duration::from_micros(1),
        _ => Duration::from_millis(1),
    };
    let steps = time.as_nanos().div_ceil(step.as_nanos());
    step * u32::try_from(steps).unwrap_or(u32::MAX)
}

pub(super) fn hex(bytes: &[u8]) -> String {
    let pairs: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    pairs.join(" ")
}

fn end_of(of: &Description, framing: &Framing) -> String {
    let digits = if framing.is_hex {
        " Its bytes are written as two hexadecimal digits each."
    } else {
        ""
    };
    let text = match &framing.cut {
        Cut::Marked {
            start,
            end,
            stuffing,
            tail,
        } => {
            let coding = match stuffing {
                Stuffing::None => String::new(),
                Stuffing::Slip => ", with SLIP escapes".to_owned(),
                Stuffing::Hdlc => ", with HDLC escapes".to_owned(),
                Stuffing::Cobs => ", coded with COBS".to_owned(),
                Stuffing::Dle => ", with each 10 within it sent twice".to_owned(),
            };
            let begins = match start.is_empty() {
                true => String::new(),
                false => format!("begins with {} and ", hex(start)),
            };
            let behind = match tail {
                0 => String::new(),
                1 => " and the byte behind it".to_owned(),
                tail => format!(" and the {tail} bytes behind it"),
            };
            format!("A frame {begins}ends with {}{behind}{coding}.", hex(end))
        }
        Cut::Length(length) => {
            let unit = match length.unit {
                1 => String::new(),
                unit => format!(" times {unit}"),
            };
            let base = match length.base {
                0 => String::new(),
                base => format!(" {} {}", if base < 0 { '-' } else { '+' }, base.abs()),
            };
            format!(
                "The number at byte {} ({}) says how long a frame is: its value{unit}{base} bytes.",
                length.at,
                number_name(length.number)
            )
        }
        Cut::Fixed(size) => format!("Every frame has {size} bytes."),
        Cut::Sized { head, size } => format!(
            "The first {head} bytes say how long a frame is: {} bytes.",
            size.source()
        ),
        Cut::Table { at, sizes } => {
            let known = sizes.iter().enumerate().filter(|(_, size)| **size > 0);
            let known: Vec<_> = known
                .map(|(byte, size)| format!("{byte:02X}: {size}"))
                .collect();
            format!(
                "Byte {at} says how many bytes a frame has: {}.",
                known.join(", ")
            )
        }
        Cut::Silence { .. } => match of.protocol {
            Some(Protocol::ModbusRtu) => "A silence of 3.5 characters ends a frame.".to_owned(),
            _ => format!("A silence of {} ends a frame.", span::Span(framing.idle)),
        },
    };
    text + digits
}

fn checksum(framing: &Framing, check: &Check) -> String {
    let place = |at: i64| match at {
        0 => "the first byte".to_owned(),
        at if at < 0 => format!("{} bytes before the end", -at),
        at => format!("byte {at}"),
    };
    let to = check
        .to
        .map_or_else(|| "the checksum itself".to_owned(), place);
    let order = match (check.width, check.is_little) {
        (1, _) => "",
        (_, true) => ", low byte first",
        (_, false) => ", high byte first",
    };
    let digits = if check.is_hex {
        ", in hexadecimal digits"
    } else {
        ""
    };
    let (start, end) = match &framing.cut {
        Cut::Marked { start, end, .. } => (&start[..], &end[..]),
        _ => (&[][..], &[][..]),
    };
    let extra = match &check.extra[..] {
        [] => String::new(),
        extra if extra == end => format!(", followed by the end marker {}", hex(extra)),
        extra if extra == [start, end].concat() => {
            format!(", followed by both markers {} and {}", hex(start), hex(end))
        }
        extra => format!(", followed by the bytes {} that are not sent", hex(extra)),
    };
    let before = match &check.before[..] {
        [] => String::new(),
        before => format!("the bytes {}, then ", hex(before)),
    };
    let part = match check.algorithm.part() {
        None => String::new(),
        Some((bits, plus)) => {
            let bits = match bits {
                128 => String::new(),
                bits => format!(", its low {bits} bits"),
            };
            let plus = match plus {
                0 => String::new(),
                plus => format!(", plus {plus}"),
            };
            bits + &plus
        }
    };
    format!(
        "Checksum: {}{part}{order}{digits}, over {before}the bytes from {} up to {to}{extra}.",
        check.algorithm.name(),
        place(check.from)
    )
}

/// The parts of a frame in their order.
fn parts(framing: &Framing) -> Vec<Part> {
    let bytes = |len: usize| format!("{len}");
    let mut parts: Vec<Part> = Vec::new();
    if let Cut::Marked { start, .. } = &framing.cut
        && !start.is_empty()
    {
        parts.push((hex(start), bytes(start.len())));
    }
    let mut at = 0;
    for &(hole, len) in &framing.holes {
        if hole > at {
            parts.push(("body".to_owned(), bytes(hole - at)));
        }
        parts.push((hole_name(framing, hole, len), bytes(len)));
        at = hole + len;
    }
    let rest = match framing.cut {
        Cut::Fixed(size) => bytes(size.saturating_sub(at + framing.trailer)),
        _ => "n".to_owned(),
    };
    parts.push(("body".to_owned(), rest));
    let mut trailer: Vec<&Check> = framing.checks.iter().filter(|check| check.at < 0).collect();
    trailer.sort_by_key(|check| check.at);
    let (end, tail, closing) = match &framing.cut {
        Cut::Marked { end, tail, .. } => (end, *tail, &framing.end[..]),
        _ => (&framing.end, 0, &[][..]),
    };
    // On the wire, the last bytes of the content are behind the end marker.
    let digits = if framing.is_hex { 2 } else { 1 };
    let from_end = |check: &Check| usize::try_from(-check.at).unwrap_or(usize::MAX) * digits;
    let (before, behind): (Vec<&Check>, Vec<&Check>) = trailer
        .into_iter()
        .partition(|check| from_end(check) > tail);
    let part = |check: &&Check| (check.algorithm.name().to_owned(), bytes(check.len()));
    parts.extend(before.iter().map(part));
    if !end.is_empty() {
        parts.push((hex(end), bytes(end.len())));
    }
    let taken = match behind.first() {
        Some(first) => from_end(first),
        None => closing.len(),
    };
    if tail > taken {
        parts.push(("body".to_owned(), bytes(tail - taken)));
    }
    parts.extend(behind.iter().map(part));
    if !closing.is_empty() {
        parts.push((hex(closing), bytes(closing.len())));
    }
    parts
}

fn hole_name(framing: &Framing, hole: usize, len: usize) -> String {
    if hole == 0 && len == framing.sync.len() && !framing.sync.is_empty() {
        return hex(&framing.sync);
    }
    if let Cut::Length(length) = &framing.cut
        && (length.at == hole || length.again == Some(hole))
    {
        return "length".to_owned();
    }
    let at = |check: &&Check| usize::try_from(check.at) == Ok(hole);
    let check = framing.checks.iter().find(at);
    check
        .map_or("fixed", |check| check.algorithm.name())
        .to_owned()
}

/// The parts of a body.
pub(super) fn body(fields: &[Field]) -> Vec<Part> {
    let parts = fields.iter().map(|field| {
        let name = match (&field.constant, field.name.is_empty()) {
            (Some(constant), true) => match constant.as_int() {
                Some(int) => format!("{int:02X}"),
                None => constant.to_string(),
            },
            (None, true) => "-".to_owned(),
            (_, false) => field.name.to_string(),
        };
        let size = match bits(field) {
            Some(bits) if bits % 8 == 0 => (bits / 8).to_string(),
            Some(bits) => format!("{bits} bit"),
            None => "n".to_owned(),
        };
        (name, size)
    });
    parts.collect()
}

/// The number of bits of a field, if it is fixed.
pub(super) fn bits(field: &Field) -> Option<usize> {
    let one = match &field.kind {
        Kind::Number(number) => 8 * usize::from(number.bytes),
        Kind::Bits { bits, .. } => usize::from(*bits),
        Kind::Bcd {
            size: Size::Fixed(size),
            ..
        }
        | Kind::Decimal(Size::Fixed(size))
        | Kind::Hex(Size::Fixed(size))
        | Kind::Str(Size::Fixed(size))
        | Kind::Bytes(Size::Fixed(size))
        | Kind::Pad(Size::Fixed(size)) => 8 * size,
        Kind::Group(fields) => fields.iter().map(bits).sum::<Option<usize>>()?,
        _ => return None,
    };
    if field.condition.is_some() || field.is_optional {
        return None;
    }
    match &field.repeat {
        None => Some(one),
        Some(Size::Fixed(count)) => Some(one * count),
        Some(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;

    fn parse(text: &str) -> std::sync::Arc<Description> {
        let nothing = |_: &str| Err(String::new());
        Description::parse("layout", text, &nothing).unwrap_or_else(|error| panic!("{error}"))
    }

    /// The parts of the first frame format, each with its length.
    fn drawn(of: &Description) -> String {
        let parts = parts(&of.frames.0[0]);
        let parts = parts.iter().map(|(name, len)| format!("{name}:{len}"));
        parts.collect::<Vec<_>>().join(" | ")
    }

    /// IEC 62056-21, section 6: STX, data, ETX, BCC over everything behind STX. VE.Direct: the
    /// checksum is the value of the last line. The telegram of DSMR: `/`, data, `!`, four digits,
    /// CR LF.
    #[test]
    fn the_bytes_behind_an_end_marker_are_drawn_behind_it() {
        let meter = parse(shipped::text("iec-62056-21").expect("shipped"));
        assert_eq!(drawn(&meter), "02:1 | body:n | 03:1 | xor:1");
        let block = &meter.frames.0[0];
        assert_eq!(
            end_of(&meter, block),
            "A frame begins with 02 and ends with 03 and the byte behind it."
        );
        assert_eq!(
            checksum(block, &block.checks[0]),
            "Checksum: xor, over the bytes from the first byte up to the checksum itself, followed \
             by the end marker 03."
        );
        let charger = parse(shipped::text("ve-direct").expect("shipped"));
        let end = "0D 0A 43 68 65 63 6B 73 75 6D 09";
        assert_eq!(
            drawn(&charger),
            format!("0D 0A:2 | body:n | {end}:11 | lrc:1")
        );
        let block = &charger.frames.0[0];
        let words = checksum(block, &block.checks[0]);
        let both = format!(", followed by both markers 0D 0A and {end}.");
        assert!(words.ends_with(&both), "{words}");
        let of = |frame: &str| {
            parse(&format!(
                "name = \"layout\"\nabout = \"x\"\nendian = \"big\"\nline = {{ baud = 9600 }}\n\
                 frame = {{ {frame} }}\n\
                 message = [{{ name = \"m\", from = \"device\", text = \"abc\" }}]\n\
                 every = [{{ period = \"1s\", send = \"m\" }}]\n"
            ))
        };
        let telegram = of(
            r#"start = "/", end = "!", tail = 6, closing = "\r\n", checksum = { algorithm = "CRC-16/ARC", encoding = "hex", before = "/", extra = "!" }"#,
        );
        let drawing = "2F:1 | body:n | 21:1 | CRC-16/ARC:4 | 0D 0A:2";
        assert_eq!(drawn(&telegram), drawing);
        // The first of two bytes behind the marker belongs to the body.
        let two = of(r#"start = "<", end = ">", tail = 2, checksum = "sum8""#);
        assert_eq!(drawn(&two), "3C:1 | body:n | 3E:1 | body:1 | sum8:1");
        let before = of(r#"start = "<", end = ">", checksum = "sum8""#);
        assert_eq!(drawn(&before), "3C:1 | body:n | sum8:1 | 3E:1");
    }
}
