//! Properties of every description: decoding an encoded message gives the same values, chunk
//! boundaries do not matter, and damage to a frame loses at most that frame.
//!
//! Descriptions are generated: framing, checksums, byte orders, fields. Tests with damaged frames
//! use only checksums of 32 bits and more, because a shorter checksum sometimes matches by chance.

use std::sync::Arc;

use description::{Description, From, Record, Value};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocols::{Decode as _, FrameError};

/// A field, without its name.
fn field() -> impl Strategy<Value = String> {
    let number = select(vec![
        "u8", "i8", "u16", "u16le", "u16be", "i16", "u24", "i24be", "u32", "i32le", "u64", "i64",
        "f32", "f64le",
    ]);
    let numbers = (
        number,
        select(vec!["", ", words = \"little\"", ", words = \"big\""]),
    );
    let numbers = numbers.prop_map(|(kind, words)| match kind {
        "u24" | "i24be" | "u8" | "i8" => format!("type = \"{kind}\""),
        kind => format!("type = \"{kind}\"{words}"),
    });
    let scaled = (
        select(vec!["u16", "i16", "u32", "i32"]),
        select(vec!["0.1", "0.01", "0.5", "1e-7"]),
    );
    let scaled = scaled.prop_map(|(kind, scale)| {
        format!("type = \"{kind}\", scale = {scale}, offset = -40, unit = \"C\"")
    });
    let sized = (
        select(vec!["bcd", "bcdle", "decimal", "hex", "str", "bytes"]),
        1..6_u8,
    );
    let sized = sized.prop_map(|(kind, size)| format!("type = \"{kind}\", size = {size}"));
    let others = select(vec![
        "type = \"strz\"",
        "type = \"str\", prefix = \"u8\"",
        "type = \"bytes\", prefix = \"u16\"",
        "type = \"u16\", repeat = 3",
        "type = \"u8\", flags = [\"a\", \"\", \"c\"]",
        "type = \"u8\", enum = \"modes\"",
        "type = \"group\", fields = [{ name = \"x\", type = \"i8\" }, { name = \"y\", type = \"b3\" }, \
            { name = \"z\", type = \"b13\" }]",
        "type = \"group\", repeat = 2, fields = [{ name = \"x\", type = \"u16\" }]",
    ]);
    prop_oneof![numbers, scaled, sized, others.prop_map(str::to_owned)]
}

/// The last field of a message, which may take all remaining bytes.
fn last() -> impl Strategy<Value = &'static str> {
    select(vec![
        "",
        "{ name = \"n\", type = \"u8\" }, { name = \"data\", type = \"bytes\", size = \"n\" }",
        "{ name = \"n\", type = \"u16\" }, { name = \"list\", type = \"i16\", repeat = \"n\" }",
        "{ name = \"rest\", type = \"bytes\", size = \"rest\" }",
        "{ name = \"tail\", type = \"u8\", optional = true }",
        "{ name = \"low\", type = \"b4le\" }, { name = \"high\", type = \"b12le\" }",
        "{ name = \"kind\", type = \"u8\", enum = \"modes\" }, { type = \"switch\", on = \"kind\", \
            cases = { \"0\" = [{ name = \"p\", type = \"u16\" }], _ = [{ name = \"q\", type = \"f32\" \
            }] } }",
        "{ name = \"has\", type = \"u8\", enum = \"modes\" }, { name = \"it\", type = \"u32\", \
            if = \"has == modes::run\" }",
        "{ name = \"said\", type = \"str\", size = \"rest\" }",
        "{ name = \"n\", type = \"u8\" }, { name = \"all\", type = \"group\", repeat = \"n\", fields = [{ \
            name = \"x\", type = \"i16\", scale = 0.1 }, { name = \"y\", type = \"strz\" }] }",
        "{ type = \"pad\", size = 3 }, { name = \"behind\", type = \"u24be\" }",
    ])
}

/// The last field of a message in a frame of known size: it takes all remaining bytes.
fn filling() -> impl Strategy<Value = &'static str> {
    select(vec![
        "{ name = \"rest\", type = \"bytes\", size = \"rest\" }",
        "{ name = \"said\", type = \"str\", size = \"rest\" }",
        "{ name = \"list\", type = \"u8\", repeat = \"rest\" }",
    ])
}

/// Frames whose first bytes give their size, or of constant size.
fn sized(checksums: &'static [&'static str]) -> impl Strategy<Value = String> {
    let cut = select(vec![
        "size = 120",
        "sync = [0xFA]\nsize = 121",
        "sync = [0xAA, 0x55]\nend = [0x0D]\nsize = 130",
        "sizes = { 0x11 = 110, 0x22 = 120, 0x33 = 131 }",
        "sync = [0x7F]\nat = 1\nsizes = { 0x11 = 110, 0x22 = 120, 0x33 = 131 }",
        "head = 1\nsize = \"100 + b0\"",
        "sync = [0xA5]\nhead = 3\nsize = \"b1 == 0x22 ? 119 : 100 + (b2 & 0x1f)\"",
    ]);
    (cut, select(checksums)).prop_map(|(cut, algorithm)| {
        format!("[frame]\n{cut}\nchecksum = {{ algorithm = \"{algorithm}\" }}\nmax = 1500\n")
    })
}

/// A frame format with a checksum.
fn frame(checksums: &'static [&'static str]) -> impl Strategy<Value = String> {
    let cut = select(vec![
        "stuffing = \"slip\"",
        "stuffing = \"hdlc\"",
        "stuffing = \"cobs\"",
        "stuffing = \"dle\"",
        "stuffing = \"dle\"\nstart = [0x10]",
        "start = \":\"\nend = \"\\r\\n\"\nencoding = \"hex\"",
        "sync = [0xAA, 0x55]\nlength = { at = 2, type = \"u16\" }",
        "sync = [0x7E]\nlength = { at = 1, type = \"u16be\", counts = \"rest\" }",
        "sync = [0xFF, 0xFF, 0xFD]\nlength = { at = 3, type = \"u16le\", counts = \"frame\" }",
        "length = { at = 0, type = \"u16\", without = 2, counts = \"payload\" }\nsync = []",
        "sync = [0x02]\nend = [0x03]\nlength = { at = 1, type = \"u16\" }",
        "sync = [0xFA]\nlength = { at = 3, type = \"u16\" }",
        // The length counts three bytes more than the frame has.
        "sync = [0xB5]\nlength = { at = 1, type = \"u16le\", counts = \"rest\", without = -3 }",
        "sync = [0xB6]\nlength = { at = 1, type = \"u24\", counts = \"rest\" }",
        "sync = [0x68]\nlength = { at = 1, again = 3, type = \"u16\" }\nend = [0x16]",
    ]);
    // Damage outside the covered range is not detectable.
    let from = if checksums == WIDE { "" } else { ", from = 1" };
    let place = select(vec![
        "",
        from,
        ", endian = \"big\"",
        ", endian = \"little\"",
    ]);
    (cut, select(checksums), place).prop_map(|(cut, algorithm, place)| {
        format!("[frame]\n{cut}\nchecksum = {{ algorithm = \"{algorithm}\"{place} }}\nmax = 1500\n")
    })
}

const ALL: &[&str] = &[
    "CRC-16/MODBUS",
    "CRC-16/XMODEM",
    "CRC-24/OPENPGP",
    "CRC-32/ISO-HDLC",
    "CRC-64/XZ",
    "CRC-82/DARC",
    "CRC-8/SMBUS",
    "sum8",
    "lrc",
    "sum7",
    "ones-complement7",
    "sum15",
    "xor",
    "fletcher16",
    "ubx",
    "adler32",
];
/// Checksums with an initial value other than 0; one that starts with 0, like CRC-82/DARC, does not
/// detect zeros before a frame.
const WIDE: &[&str] = &[
    "CRC-32/ISO-HDLC",
    "CRC-64/XZ",
    "CRC-32/ISCSI",
    "CRC-32/MPEG-2",
];

/// A frame with an additional checksum of its header.
fn headed(checksums: &'static [&'static str]) -> impl Strategy<Value = String> {
    select(checksums).prop_map(|algorithm| {
        format!(
            "[frame]\nsync = [0x5A, 0xA5]\nlength = {{ at = 2, type = \"u16\", counts = \"frame\" }}\n\
             checksum = [{{ algorithm = \"CRC-8/SMBUS\", from = 2, at = 4 }}, {{ algorithm = \
             \"{algorithm}\" }}]\nmax = 1500\n"
        )
    })
}

/// A frame that a silence ends.
fn silent() -> impl Strategy<Value = String> {
    select(ALL).prop_map(|algorithm| {
        format!("[frame]\nsilence = 3.5\nchecksum = \"{algorithm}\"\nmax = 1500\n")
    })
}

/// Descriptions of frames whose bytes define their end.
fn described(checksums: &'static [&'static str]) -> impl Strategy<Value = Arc<Description>> {
    let open = prop_oneof![4 => frame(checksums).boxed(), 1 => headed(checksums).boxed()];
    prop_oneof![
        3 => of_frame(open, last()),
        1 => of_frame(sized(checksums), filling()),
    ]
}

/// The same, and frames that a silence ends.
fn any_described() -> impl Strategy<Value = Arc<Description>> {
    prop_oneof![5 => described(ALL).boxed(), 1 => of_frame(silent(), last()).boxed()]
}

fn of_frame(
    frame: impl Strategy<Value = String>,
    last: impl Strategy<Value = &'static str>,
) -> impl Strategy<Value = Arc<Description>> {
    let message = (vec(field(), 1..5), last);
    let endian = select(vec!["little", "big"]);
    (frame, vec(message, 1..4), endian).prop_map(|(frame, messages, endian)| {
        let mut text = format!(
            "name = \"generated\"\nabout = \"x\"\nendian = \"{endian}\"\nline = {{ baud = 9600 }}\n\
             enums = {{ modes = {{ 0 = \"stop\", 1 = \"run\", 7 = \"test\" }} }}\n\
             on = [{{ message = \"*\", violation = \"heard\" }}]\n{frame}"
        );
        for (number, (fields, last)) in messages.iter().enumerate() {
            text += &format!(
                "[[message]]\nname = \"m{number}\"\nfrom = \"both\"\nfields = [\n\
                 {{ type = \"u16\", value = {} }},\n",
                0x1111 * (number + 1)
            );
            for (index, field) in fields.iter().enumerate() {
                text += &format!("{{ name = \"f{index}\", {field} }},\n");
            }
            text += &format!("{last}]\n");
        }
        let parsed = Description::parse("generated.toml", &text, &|_| Err(String::new()));
        parsed.unwrap_or_else(|error| panic!("{error}\n{text}"))
    })
}

/// A piece of a line: words, then a formatted field.
fn piece() -> impl Strategy<Value = (&'static str, &'static str)> {
    let words = select(vec![",", " ", ";", "=", "/", ",,", " mm "]);
    let form = select(vec![
        "", ":d", ":05d", ":.2f", ":09.4f", ":02X", ":08x", ":s", ":.3s", "?", ":d?",
    ]);
    (words, form)
}

/// A text protocol: with or without start marker and checksum; each message has its own first word.
fn speaking() -> impl Strategy<Value = Arc<Description>> {
    let frame = select(vec![
        "terminator = \"\\r\\n\"",
        "terminator = \"\\n\"",
        "start = \"$\"\nend = \"\\r\\n\"\nchecksum = \"nmea\"",
        "start = \"<\"\nend = \">\"",
        "terminator = \"\\r\"\nchecksum = { algorithm = \"CRC-8/SMBUS\", encoding = \"hex\" }",
    ]);
    (frame, vec(vec(piece(), 1..5), 1..4)).prop_map(|(frame, messages)| {
        let mut text = format!(
            "name = \"generated\"\nabout = \"x\"\nline = {{ baud = 9600 }}\n\
             on = [{{ message = \"*\", violation = \"heard\" }}]\n[frame]\n{frame}\n"
        );
        for (number, pieces) in messages.iter().enumerate() {
            let fields = pieces.iter().enumerate();
            let line = fields.map(|(at, (words, form))| format!("{words}{{f{at}{form}}}"));
            text += &format!(
                "[[message]]\nname = \"m{number}\"\nfrom = \"both\"\ntext = \"M{number}{}\"\n",
                line.collect::<String>()
            );
        }
        let parsed = Description::parse("generated.toml", &text, &|_| Err(String::new()));
        parsed.unwrap_or_else(|error| panic!("{error}\n{text}"))
    })
}

/// Frames with the values that were encoded.
fn frames(description: &Description, choices: &[u64]) -> Vec<(Vec<u8>, Record)> {
    let mut dice = choices.iter().copied().cycle();
    let mut step = 0_u64;
    let mut choose = |below: u64| {
        step = step.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let drawn = dice.next().unwrap_or(0) ^ step.rotate_left(17);
        drawn % below.max(1)
    };
    let messages = description.messages().iter();
    let made = messages.map(|message| {
        let values = message.example(&mut choose);
        let frame = description
            .frame(message, &values)
            .expect("an example fits");
        (frame, values)
    });
    made.collect()
}

/// The bodies decoded from chunks of these sizes, with a pause at the end.
fn found(
    description: &Description,
    bytes: &[u8],
    sizes: &[usize],
) -> Vec<Result<Vec<u8>, FrameError>> {
    let mut cutter = description.cutter();
    let body = |frame| description.body(&frame).expect("a frame has one");
    let (mut all, mut rest) = (Vec::new(), bytes);
    let mut sizes = sizes.iter().cycle();
    while !rest.is_empty() {
        let (piece, behind) = rest.split_at(rest.len().min(*sizes.next().unwrap_or(&1)));
        all.extend(cutter.push(piece).map(|frame| frame.map(body)));
        rest = behind;
    }
    cutter.idle();
    all.extend(cutter.push(&[]).map(|frame| frame.map(body)));
    all
}

/// The given values, with the computed values of count fields.
fn holds(given: &Record, read: &Record) -> bool {
    given
        .0
        .iter()
        .all(|(name, value)| match (value, read.get(name)) {
            (Value::Record(given), Some(Value::Record(read))) => holds(given, read),
            (Value::List(given), Some(Value::List(read))) if given.len() == read.len() => {
                given.iter().zip(read).all(|pair| match pair {
                    (Value::Record(given), Value::Record(read)) => holds(given, read),
                    (given, read) => given == read,
                })
            }
            (value, read) => Some(value) == read,
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn what_is_encoded_is_decoded_to_the_same(
        description in any_described(),
        choices in vec(any::<u64>(), 40),
    ) {
        let made = frames(&description, &choices);
        for (message, (frame, values)) in description.messages().iter().zip(made) {
            let mut cutter = description.cutter();
            let mut found: Vec<_> = cutter.push(&frame).collect();
            cutter.idle();
            found.extend(cutter.push(&[]));
            let [Ok(found)] = &found[..] else {
                panic!("{found:?} in {frame:02X?}");
            };
            prop_assert_eq!(&*found.bytes, &*frame);
            let (known, read) = description.message(found, From::Both).expect("a message");
            prop_assert_eq!(known.name(), message.name());
            prop_assert!(holds(&values, &read), "{:?} became {:?}", values, read);
            // And its bytes again.
            prop_assert_eq!(description.frame(known, &read), Some(frame));
        }
    }

    /// The same for lines; chunk boundaries do not matter.
    #[test]
    fn a_line_is_read_as_it_was_written(
        description in speaking(),
        choices in vec(any::<u64>(), 40),
        sizes in vec(1..30_usize, 1..6),
    ) {
        let made = frames(&description, &choices);
        let bytes: Vec<u8> = made.iter().flat_map(|(frame, _)| frame.clone()).collect();
        let whole = found(&description, &bytes, &[bytes.len()]);
        prop_assert_eq!(found(&description, &bytes, &sizes), whole);
        for (message, (frame, values)) in description.messages().iter().zip(made) {
            let mut cutter = description.cutter();
            let found: Vec<_> = cutter.push(&frame).collect();
            let [Ok(found)] = &found[..] else {
                panic!("{found:?} in {}", frame.escape_ascii());
            };
            let (known, read) = description.message(found, From::Both).expect("a message");
            prop_assert_eq!(known.name(), message.name());
            prop_assert!(holds(&values, &read), "{:?} became {:?}", values, read);
            prop_assert_eq!(description.frame(known, &read), Some(frame));
        }
    }

    #[test]
    fn pieces_make_no_difference(
        description in any_described(),
        choices in vec(any::<u64>(), 40),
        noise in vec(any::<u8>(), 0..12),
        sizes in vec(1..30_usize, 1..6),
    ) {
        let frames = frames(&description, &choices).into_iter();
        let frames: Vec<_> = frames.map(|(frame, _)| frame).collect();
        let bytes = [noise.concat_with(&frames), noise].concat();
        let whole = found(&description, &bytes, &[bytes.len().max(1)]);
        prop_assert_eq!(found(&description, &bytes, &sizes), whole.clone());
        prop_assert_eq!(found(&description, &bytes, &[1]), whole);
        for bytes in frames.iter().chain([&bytes]).filter(|bytes| !bytes.is_empty()) {
            let (last, begin) = bytes.split_last().expect("not empty");
            let mut cutter = description.cutter();
            let Some(frame) = cutter.whole(bytes) else {
                continue;
            };
            // A frame that is taken at once is the only result, and comes with its last byte.
            prop_assert!(begin.iter().all(|byte| cutter.push(&[*byte]).count() == 0));
            prop_assert!(cutter.pending() == 0 || cutter.whole(bytes).is_none());
            prop_assert_eq!(cutter.push(&[*last]).collect::<Vec<_>>(), [Ok(frame)]);
            prop_assert_eq!(cutter.pending(), 0);
        }
    }

    #[test]
    fn a_damaged_frame_costs_at_most_itself(
        description in described(WIDE),
        choices in vec(any::<u64>(), 40),
        place in any::<prop::sample::Index>(),
        damage in 0..3_u8,
        value in 1..=255_u8,
    ) {
        let frames = frames(&description, &choices).into_iter();
        let frames: Vec<_> = frames.map(|(frame, _)| frame).collect();
        let mut damaged = frames[0].clone();
        let at = place.index(damaged.len());
        match damage {
            0 => damaged[at] ^= value,
            1 => drop(damaged.remove(at)),
            _ => damaged.insert(at, value),
        }
        let last = frames.last().expect("one at least").clone();
        let bytes = [&frames[0][..], &damaged, &last].concat();
        let all = |bytes: &[u8]| -> Vec<_> {
            found(&description, bytes, &[bytes.len()]).into_iter().flatten().collect()
        };
        let found = all(&bytes);
        let (first, last) = (all(&frames[0]), all(&last));
        prop_assert_eq!(found.first(), first.first());
        prop_assert_eq!(found.last(), last.last());
        // Damage outside the covered range may leave the frame unchanged.
        prop_assert!(found.len() == 2 || (found.len() == 3 && found[1] == found[0]));
    }
}

trait ConcatWith {
    fn concat_with(&self, frames: &[Vec<u8>]) -> Vec<u8>;
}

impl ConcatWith for Vec<u8> {
    /// Concatenates the frames with noise before each.
    fn concat_with(&self, frames: &[Vec<u8>]) -> Vec<u8> {
        frames
            .iter()
            .flat_map(|frame| [&self[..], frame].concat())
            .collect()
    }
}
