//! The dissector of described devices, judged by tshark: for frames of every shipped description
//! its text equals that of `hilrig decode`, and each field has the value from the description.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use description::{Description, From, Message, Value};
use engine::rig::line::Direction;
use hilrig_capture::wireshark::dissector_of;
use hilrig_capture::{Interface, Kind, Record, Section};
use protocols::{Decode as _, Instant};

/// Number of frames per description, unless the variable `HILRIG_FRAMES` is set.
const FRAMES: usize = 100;
/// Number of frames per description for the whole suite, `HILRIG_TESTS=all`.
const FRAMES_ALL: usize = 10_000;
/// Separates several values of a packet; no example contains it.
const AGGREGATOR: char = '~';

/// Checksums of which only some bits are sent.
const LOW_BITS: (&str, &str) = (
    "low-bits",
    r#"
name = "low-bits"
about = "Four checksums of some bits"
endian = "big"
line = { baud = 9600 }
frame = { sync = [0xA5], size = 12, checksum = [
  { algorithm = "sum8", bits = 6, plus = 0x20 }, "sum15", "xor7", "twos-complement7",
] }
message = [{ name = "told", from = "device", fields = [
  { name = "load", type = "u32" }, { name = "tag", type = "u16" },
] }]
every = [{ period = "1s", send = "told" }]
"#,
);

/// Frames with DLE stuffing; the contents hold many of the bytes that are sent twice.
const DLE: (&str, &str) = (
    "dle",
    r#"
name = "dle"
about = "Each 10 is sent twice"
endian = "big"
line = { baud = 9600 }
frame = { stuffing = "dle", start = [0x10], checksum = "sum8" }
message = [{ name = "told", from = "device", fields = [
  { type = "u8", value = 0x8F }, { name = "load", type = "u16" }, { type = "u24", value = 0x101003 },
  { name = "tag", type = "u32" },
] }]
every = [{ period = "1s", send = "told" }]
"#,
);

fn parse(name: &str, text: &str) -> Arc<Description> {
    let nothing = |_: &str| Err("no file".to_owned());
    Description::parse(name, text, &nothing).unwrap_or_else(|error| panic!("{error}"))
}

/// A small random generator: the same frames in each run.
fn dice(mut state: u64) -> impl FnMut(u64) -> u64 {
    move |below| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) % below.max(1)
    }
}

/// A frame and its sender.
type Sent = (From, Vec<u8>);

/// A frame of the description.
fn frame(of: &Description, number: usize, dice: &mut dyn FnMut(u64) -> u64) -> Sent {
    let messages = of.messages();
    if messages.is_empty() {
        return (From::Device, modbus(of, number, dice));
    }
    let message: &Message = &messages[number % messages.len()];
    let values = message.example(dice);
    let from = match message.from() {
        From::Host => From::Host,
        From::Device | From::Both => From::Device,
    };
    (from, of.frame(message, &values).expect("an example fits"))
}

/// Requests, responses and refusals of Modbus in turn, after the tables of its specification.
fn modbus(of: &Description, number: usize, dice: &mut dyn FnMut(u64) -> u64) -> Vec<u8> {
    let mut byte = |below: u64| u8::try_from(dice(below)).expect("a byte");
    let (address, is_request) = (1 + byte(3), number.is_multiple_of(2));
    let mut body = vec![address];
    match (number / 2 % 8, is_request) {
        (0, true) => body.extend([3, byte(256), byte(256), 0, 1 + byte(100)]),
        (0, false) => body.extend([3, 4, byte(256), byte(256), byte(256), byte(256)]),
        (1, true) => body.extend([4, byte(256), byte(256), 0, 1 + byte(100)]),
        (1, false) => body.extend([4, 2, byte(256), byte(256)]),
        (2, true) => body.extend([1, 0, byte(16), 0, 1 + byte(8)]),
        (2, false) => body.extend([1, 1, byte(256)]),
        (3, _) => body.extend([6, byte(256), byte(256), byte(256), byte(256)]),
        (4, true) => body.extend([16, 0, byte(256), 0, 2, 4, byte(256), 2, byte(256), 4]),
        (4, false) => body.extend([16, 0, byte(256), 0, 2]),
        (5, true) => body.extend([15, 0, byte(256), 0, 9, 2, byte(256), 1]),
        (5, false) => body.extend([15, 0, byte(256), 0, 9]),
        (6, _) => body.extend([5, 0, byte(256), 0xFF, 0]),
        (_, true) => body.extend([22, 0, byte(256), byte(256), 0xF2, 0, byte(256)]),
        (_, false) => body.extend([0x80 | 3, 1 + byte(6)]),
    }
    of.frame_of(0, &body).expect("it fits")
}

/// The capture of frames, each in its own record.
fn capture(frames: &[Sent]) -> Vec<u8> {
    let mut out = Vec::new();
    Section::default().write(&mut out);
    Interface::new("device", 115_200).write(&mut out);
    for (number, (from, bytes)) in frames.iter().enumerate() {
        // The distance is longer than any pause that ends a frame.
        let at = Instant::from_millis(3_000 * (number as u64 + 1));
        let record = Record {
            link: 0,
            sequence: None,
            at,
            direction: match from {
                From::Host => Direction::ToDevice,
                From::Device | From::Both => Direction::ToMaster,
            },
            kind: Kind::Data,
            bytes: bytes.clone().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        record.write(0, &mut out);
    }
    out
}

/// Text of a frame, and values by the paths of their fields.
type Told = (String, Vec<(String, Value)>);

/// The frame decoded with the description.
fn told(of: &Description, (from, bytes): &Sent) -> Option<Told> {
    let mut cutter = of.cutter_for(*from);
    let mut found: Vec<_> = cutter.push(bytes).flatten().collect();
    cutter.idle();
    found.extend(cutter.push(&[]).flatten());
    let [frame] = &found[..] else {
        return None;
    };
    let mut values = Vec::new();
    let own = of.message(frame, *from);
    if let Some((_, record)) = own.or_else(|| of.message(frame, From::Both)) {
        flatten("", &Value::Record(record), &mut values);
    }
    Some((of.words_for(frame, *from), values))
}

fn flatten(path: &str, value: &Value, out: &mut Vec<(String, Value)>) {
    match value {
        Value::Record(record) => {
            for (name, value) in &record.0 {
                let dot = if path.is_empty() { "" } else { "." };
                flatten(&format!("{path}{dot}{name}"), value, out);
            }
        }
        Value::List(list) => list.iter().for_each(|value| flatten(path, value, out)),
        value => out.push((path.to_ascii_lowercase(), value.clone())),
    }
}

/// Whether tshark shows `value` as `shown`.
fn is_same(value: &Value, shown: &str) -> bool {
    match (value, shown.parse::<f64>()) {
        (Value::Float(wanted), Ok(found)) => {
            (wanted - found).abs() <= 1e-9 * wanted.abs() || wanted.is_nan() && found.is_nan()
        }
        (Value::Int(wanted), _) if wanted.to_string() == shown => true,
        // Fields that contain fractions in other messages.
        (Value::Int(_), Ok(found)) => value.as_f64().is_some_and(|wanted| wanted == found),
        (Value::Text(wanted), _) => wanted == shown,
        (value, _) => value.to_string() == shown,
    }
}

/// The output of tshark for `fields`, a line per packet.
fn tshark(folder: &Path, fields: &[String]) -> Option<Vec<Vec<String>>> {
    let mut tshark = Command::new("tshark");
    tshark.current_dir(folder);
    tshark.args([
        "-n",
        "-X",
        "lua_script:d.lua",
        "-r",
        "c.pcapng",
        "-T",
        "fields",
    ]);
    tshark.args([
        "-E",
        "separator=|",
        "-E",
        &format!("aggregator={AGGREGATOR}"),
    ]);
    tshark.args(fields.iter().flat_map(|field| ["-e", field.as_str()]));
    match tshark.output() {
        Ok(output) => {
            let errors = String::from_utf8_lossy(&output.stderr);
            let is_sound = output.status.success() && !errors.contains("Lua");
            assert!(is_sound, "{errors}");
            let shown = String::from_utf8(output.stdout).expect("text");
            let rows = shown.lines().map(|line| {
                let cells = line.split('|').map(str::to_owned);
                cells.collect()
            });
            Some(rows.collect())
        }
        Err(error) if std::env::var_os("CI").is_none() => {
            eprintln!("SKIPPED: the dissector is not judged: no tshark: {error}");
            None
        }
        Err(error) => panic!("tshark: {error}"),
    }
}

/// Wrong output of the dissector for frames of `name`.
fn differences(name: &str, text: &str) -> Option<Vec<String>> {
    let of = parse(name, text);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("dissected-{name}"));
    fs::create_dir_all(&folder).expect("a folder");
    let dice = &mut dice(7);
    let count = std::env::var("HILRIG_FRAMES")
        .ok()
        .and_then(|count| count.parse().ok());
    let is_whole = std::env::var("HILRIG_TESTS").is_ok_and(|tests| tests == "all");
    let count: usize = count.unwrap_or(if is_whole { FRAMES_ALL } else { FRAMES });
    let frames: Vec<_> = (0..count).map(|number| frame(&of, number, dice)).collect();
    fs::write(folder.join("c.pcapng"), capture(&frames)).expect("writable");
    fs::write(
        folder.join("d.lua"),
        dissector_of(core::slice::from_ref(&of)),
    )
    .expect("writable");
    let known = of.lua(of.name()).fields;
    let mut fields = vec!["hilrig.words".to_owned()];
    fields.extend(known.iter().map(|field| field.filter.clone()));
    let rows = tshark(&folder, &fields)?;
    let told: Vec<_> = frames.iter().map(|sent| told(&of, sent)).collect();
    let mut wrong = Vec::new();
    for ((from, bytes), _) in frames.iter().zip(&told).filter(|(_, told)| told.is_none()) {
        wrong.push(format!(
            "no frame of the {from:?}: {}",
            bytes.escape_ascii()
        ));
    }
    // A frame that ends only by silence is shown with the next packet of its direction.
    for from in [From::Host, From::Device] {
        let own = |index: &usize| frames[*index].0 == from;
        let own: Vec<usize> = (0..count).filter(own).collect();
        let shown: Vec<&[String]> = own.iter().map(|index| &rows[*index][..]).collect();
        let told = own.iter().filter_map(|index| told[*index].as_ref());
        wrong.extend(of_one_end(&of, &shown, &told.collect::<Vec<_>>()));
    }
    let wrong = wrong.into_iter().map(|one| format!("{name}: {one}"));
    Some(wrong.collect())
}

/// Differences of the frames of one end: a row of cells per packet, and the decoded frames.
fn of_one_end(of: &Description, rows: &[&[String]], told: &[&Told]) -> Vec<String> {
    let mut wrong = Vec::new();
    let cells = |column: usize| -> Vec<&str> {
        let cells = rows.iter().map(|row| row[column].as_str());
        cells
            .filter(|cell| !cell.is_empty())
            .flat_map(|cell| cell.split(AGGREGATOR))
            .collect()
    };
    let words = cells(0);
    let mut told = told.to_vec();
    // The last frame may still wait for silence.
    let is_late = rows.first().is_some_and(|row| row[0].is_empty());
    if is_late && words.len() + 2 >= told.len() {
        told.truncate(words.len());
    }
    for (words, (wanted, _)) in words.iter().zip(&told) {
        if words != wanted {
            wrong.push(format!("\"{words}\", decode says \"{wanted}\""));
        }
    }
    if words.len() != told.len() {
        let (shown, told) = (words.len(), told.len());
        wrong.push(format!("{shown} frames, decode has {told}"));
    }
    let values = || told.iter().flat_map(|(_, values)| values);
    let label = |path: &str| format!("{} {path}", of.name());
    let known = of.lua(of.name()).fields;
    let known: BTreeSet<_> = known
        .iter()
        .map(|field| field.label.to_ascii_lowercase())
        .collect();
    let paths: BTreeSet<_> = values().map(|(path, _)| path).collect();
    for path in paths
        .into_iter()
        .filter(|path| !known.contains(&label(path).to_ascii_lowercase()))
    {
        wrong.push(format!("{path}: the dissector has no such field"));
    }
    for (column, field) in of.lua(of.name()).fields.iter().enumerate() {
        let wanted = values().filter(|(path, _)| label(path) == field.label.to_ascii_lowercase());
        let wanted: Vec<_> = wanted.map(|(_, value)| value).collect();
        let shown = cells(column + 1);
        for (wanted, shown) in wanted.iter().zip(&shown) {
            if !is_same(wanted, shown) {
                wrong.push(format!("{}: {shown}, decode has {wanted}", field.filter));
            }
        }
        let is_empty = |value: &&&Value| ***value == Value::Text(String::new());
        let empty = wanted.iter().filter(is_empty).count();
        if wanted.len() != shown.len() && wanted.len() - empty != shown.len() {
            let (filter, shown, wanted) = (&field.filter, shown.len(), wanted.len());
            wrong.push(format!("{filter}: {shown} times, decode has {wanted}"));
        }
    }
    wrong
}

#[test]
fn tshark_agrees_with_decode_on_every_field() {
    // Every fourth device at a landing, all of them with `tests/run.sh --all`.
    let is_whole = std::env::var("HILRIG_TESTS").is_ok_and(|tests| tests == "all");
    let devices = description::shipped::ALL.iter();
    let devices = devices.step_by(if is_whole { 1 } else { 4 });
    let mut all = Vec::new();
    for (name, text) in devices.chain([&LOW_BITS, &DLE]) {
        let Some(wrong) = differences(name, text) else {
            return;
        };
        let count = wrong.len();
        all.extend(wrong.into_iter().take(5));
        all.extend((count > 5).then(|| format!("{name}: {count} differences")));
    }
    assert!(all.is_empty(), "{}", all.join("\n"));
}

/// The sum of 01 02 is 03, that of 02 alone is 02: between two frames, 40 02 02 C0 is no frame,
/// although its end has a correct sum.
#[test]
fn no_frame_begins_within_a_damaged_one() {
    let text = r#"
name = "slip"
about = "Frames between two C0"
line = { baud = 9600 }
frame = { stuffing = "slip", checksum = "sum8" }
message = [{ name = "told", from = "device", fields = [
  { name = "all", type = "bytes", size = "rest" },
] }]
every = [{ period = "1s", send = "told" }]
"#;
    let sound = [0xC0, 1, 2, 3, 0xC0];
    let bytes = [&sound[..], &[0x40, 2, 2, 0xC0], &sound].concat();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("dissected-damaged");
    fs::create_dir_all(&folder).expect("a folder");
    let of = parse("slip", text);
    fs::write(folder.join("c.pcapng"), capture(&[(From::Device, bytes)])).expect("writable");
    fs::write(folder.join("d.lua"), dissector_of(&[of])).expect("writable");
    let fields = ["hilrig.words", "hilrig.bad"].map(str::to_owned);
    if let Some(rows) = tshark(&folder, &fields) {
        assert_eq!(rows, [["told: all [01 02]~told: all [01 02]", "4"]]);
    }
}

/// The CRC of a reply that ends with 0 also holds without its last byte: the reply would be cut
/// into a request and a byte.
#[test]
fn a_modbus_reply_is_not_cut_into_a_request() {
    let text = description::shipped::text("modbus-meter").expect("shipped");
    let of = parse("modbus-meter", text);
    let frame = |body: &[u8]| of.frame_of(0, body).expect("it fits");
    let reply = frame(&[1, 4, 4, 0x43, 0x63, 0x1C, 0x29]);
    assert_eq!(reply.last(), Some(&0));
    let sent = [
        (From::Host, frame(&[1, 4, 0, 0, 0, 2])),
        (From::Device, reply),
        (From::Host, frame(&[1, 1, 3, 0, 0, 2])),
        (From::Device, frame(&[1, 1, 3, 0, 0, 2])),
    ];
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("dissected-reply");
    fs::create_dir_all(&folder).expect("a folder");
    fs::write(folder.join("c.pcapng"), capture(&sent)).expect("writable");
    fs::write(
        folder.join("d.lua"),
        dissector_of(core::slice::from_ref(&of)),
    )
    .expect("writable");
    let wanted = sent.iter().map(|one| told(&of, one).expect("a frame").0);
    let wanted: Vec<_> = wanted.map(|words| vec![words, String::new()]).collect();
    assert!(
        wanted[1][0].contains("read input registers: 17251 7209"),
        "{wanted:?}"
    );
    if let Some(rows) = tshark(&folder, &["hilrig.words", "hilrig.bad"].map(str::to_owned)) {
        assert_eq!(rows, wanted);
    }
}
