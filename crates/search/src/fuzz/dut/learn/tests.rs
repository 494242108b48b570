//! Mutants of frames whose format was learned.

use std::collections::BTreeSet;

use super::*;
use crate::learn::tests::sensor_frames;
use crate::learn::{FrameFormat, Spoken};

/// Half of the mutants have a correct checksum and another content, some have a wrong checksum,
/// some are intact and come in chunks.
#[test]
fn mutants_are_sound_frames_damage_and_other_deliveries() {
    let frames = sensor_frames(6);
    let mut gathered = Gathered::default();
    frames
        .iter()
        .for_each(|frame| gathered.unasked(frame.clone()));
    let Seeds {
        format, contents, ..
    } = gathered.learned(None);
    let material = Material {
        format: &*format,
        contents: &contents,
        constants: &Constants::default(),
    };
    let is_sound = |frame: &[u8]| {
        let content = format.content(frame);
        content.is_some_and(|content| format.frame(&content, 0) == frame)
    };
    let rng = &mut Rng::stream(1, "test");
    let mut kinds = BTreeSet::new();
    let [mut other, mut wrong, mut delivered] = [0; 3];
    for _ in 0..1000 {
        let mutant = mutate::mutant(&material, &frames[0], rng);
        let whole = mutant.pieces.concat();
        kinds.insert(mutant.kind);
        match is_sound(&whole) {
            true if whole != frames[0] => other += 1,
            false => wrong += 1,
            true => {}
        }
        if !mutant.is_altered {
            assert_eq!(whole, frames[0], "{}", mutant.kind);
            delivered += 1;
        }
    }
    assert!(
        other > 500 && wrong > 100 && delivered > 20,
        "{other} {wrong} {delivered}"
    );
    for kind in [
        "wrong-length",
        "short",
        "limit-of-16-bits",
        "wrong-checksum",
        "twice",
        "bytewise",
    ] {
        assert!(kinds.contains(kind), "{kind}");
    }
}

/// Shipped devices with binary frames: a changed field stays in a frame with correct checksums, a
/// length may be wrong, and a value lies at a limit of its field or beyond.
#[test]
fn mutants_of_a_described_format_have_fields_at_their_limits() {
    use protocols::Decode as _;
    for name in ["cobs-sensor", "gps"] {
        let text = description::shipped::text(name).expect("shipped");
        let nothing = |_: &str| Err(String::new());
        let of = Description::parse(name, text, &nothing).expect("sound");
        let format = DescribedFormat::of(&of);
        let frames = format.examples();
        let Seeds {
            format, contents, ..
        } = Gathered::default().learned(Some(format));
        let material = Material {
            format: &*format,
            contents: &contents,
            constants: &Constants::default(),
        };
        let rng = &mut Rng::stream(1, "described");
        let (mut limits, mut sound) = (0, 0);
        for at in 0..600 {
            let frame = &frames[at % frames.len()];
            let mutant = mutate::mutant(&material, frame, rng);
            if mutant.kind != "field-at-limit" {
                continue;
            }
            limits += 1;
            let mut cutter = of.cutter();
            let whole = mutant.pieces.concat();
            sound += usize::from(cutter.push(&whole).flatten().count() == 1);
        }
        assert!(limits > 30, "{name}: {limits}");
        assert_eq!(sound, limits, "{name}: each is a sound frame");
    }
}

/// Splitting a frame into its content and assembling it again gives the same frame, for each
/// format.
#[test]
fn described_frames_are_taken_apart_and_put_together() {
    for (name, text) in description::shipped::ALL {
        let nothing = |_: &str| Err(String::new());
        let of = Description::parse(name, text, &nothing).expect("sound");
        let format = DescribedFormat::of(&of);
        // Line ends and prompts around a content come from the description.
        for frame in format.examples() {
            let content = FrameFormat::content(&format, &frame).expect("a frame");
            let again = FrameFormat::frame(&format, &content, 0);
            assert_eq!(
                FrameFormat::content(&format, &again),
                Some(content),
                "{name}"
            );
        }
    }
}

/// On a wire with devices of different formats, each frame is taken apart by the description that
/// knows it.
#[test]
fn frames_of_several_devices_are_taken_apart() {
    let parse = |name: &str| {
        let text = description::shipped::text(name).expect("shipped");
        Description::parse(name, text, &|_| Err(String::new())).expect("sound")
    };
    let all = ["tfmini", "pms5003", "gps"].map(parse);
    let format = DescribedFormat::of_wire(&all, From::Device).expect("devices");
    assert_eq!(
        FrameFormat::in_words(&format),
        "as tfmini and pms5003 and gps are described"
    );
    for of in &all {
        let own = DescribedFormat::of(of);
        for frame in own.examples() {
            assert_eq!(FrameFormat::split(&format, &frame), [&frame[..]], "{of:?}");
            let content = FrameFormat::content(&format, &frame).expect("a frame");
            assert_eq!(FrameFormat::frame(&format, &content, 0), frame);
            let plain = FrameFormat::content(&own, &frame).expect("a frame");
            let fields = [&format, &own].map(|one| one as &dyn FrameFormat);
            let [found, expected] = fields.map(|one| {
                let content = one.content(&frame).expect("a frame");
                one.fields(&content).len()
            });
            assert_eq!(found, expected, "{}: {plain:02X?}", of.name());
        }
    }
}

/// A defect: its name, and whether a frame reaches it.
type Defect = (&'static str, fn(&[u8]) -> bool);

/// Number of mutants in which each defect must be reached: some seconds of a search.
const MUTANTS: usize = 60_000;

/// The defects that none of [`MUTANTS`] intact mutants of `frames` reaches.
fn missed(frames: &[Vec<u8>], constants: &Constants, defects: &[Defect]) -> Vec<&'static str> {
    let mut gathered = Gathered::default();
    frames
        .iter()
        .for_each(|frame| gathered.unasked(frame.clone()));
    let Seeds {
        format, contents, ..
    } = gathered.learned(None);
    let material = Material {
        format: &*format,
        contents: &contents,
        constants,
    };
    let rng = &mut Rng::stream(1, "defects");
    let mut missed: Vec<&Defect> = defects.iter().collect();
    for at in 0..MUTANTS {
        let mutant = mutate::mutant(&material, &frames[at % frames.len()], rng);
        let whole = mutant.pieces.concat();
        let is_sound = || {
            let content = format.content(&whole);
            content.is_some_and(|content| format.frame(&content, 0) == whole)
        };
        missed.retain(|(_, reaches)| !(reaches(&whole) && is_sound()));
    }
    missed.iter().map(|(name, _)| *name).collect()
}

/// Lines of the manual of a GPS receiver (NMEA 0183); each defect needs fields that are unusual
/// together, joined, empty or too many, in a line with the right checksum.
#[test]
fn mutants_of_lines_reach_defects_that_need_structure() {
    fn fields<'a>(line: &'a [u8], kind: &str) -> Vec<&'a str> {
        let text = core::str::from_utf8(line).unwrap_or_default();
        let body = text.split('*').next().unwrap_or_default();
        match body.strip_prefix('$') {
            Some(body) if body.starts_with(kind) => body.split(',').collect(),
            _ => Vec::new(),
        }
    }
    fn number(fields: &[&str], at: usize) -> u32 {
        let field = fields.get(at).copied().unwrap_or_default();
        field.parse().unwrap_or_default()
    }
    let nmea = |body: &str| {
        let sum = body.bytes().fold(0, |sum, byte| sum ^ byte);
        format!("${body}*{sum:02X}\r\n").into_bytes()
    };
    let lines = [
        "GPRMC,081836,A,3751.65,S,14507.36,E,000.0,360.0,130998,011.3,E",
        "GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,",
        "GPGSA,A,3,04,05,,09,12,,,24,,,,,2.5,1.3,2.1",
        "GPGSV,3,1,11,03,03,111,00,04,15,270,00,06,01,010,00,13,06,292,00",
        "GPVTG,054.7,T,034.4,M,005.5,N,010.2,K",
    ];
    let defects: [Defect; 7] = [
        ("month", |line| {
            let date = fields(line, "GPRMC").get(9).copied().unwrap_or_default();
            date.len() == 6 && date.get(2..4).is_some_and(|month| month > "12")
        }),
        ("parts", |line| {
            let of = fields(line, "GPGSV");
            number(&of, 2) > number(&of, 1) && number(&of, 3) > 99
        }),
        ("gap", |line| {
            let of = fields(line, "GPGSV");
            let is_empty = of.get(12).is_some_and(|field| field.is_empty());
            is_empty && number(&of, 16) > 0
        }),
        ("joined", |line| {
            let of = fields(line, "GPRMC");
            of.get(9).is_some_and(|date| date.starts_with("130998011"))
        }),
        ("many", |line| fields(line, "GPGSA").len() > 40),
        ("long", |line| {
            let of = fields(line, "GPGGA");
            of.get(2).is_some_and(|latitude| latitude.len() > 100)
        }),
        ("constant", |line| number(&fields(line, "GPGGA"), 7) == 4711),
    ];
    let mut constants = Constants::default();
    constants.add_script(b"if satellites == 4711: pass");
    assert_eq!(missed(&lines.map(nmea), &constants, &defects), [""; 0]);
}

/// Requests of Modbus: a mask at a limit, and a number of registers with as many bytes behind it.
#[test]
fn mutants_of_frames_reach_defects_that_need_structure() {
    let modbus = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS);
    let request = |body: &[u8]| [body, &modbus.checksum(body).to_le_bytes()].concat();
    let frames = [
        request(&[1, 3, 0, 0, 0, 10]),
        request(&[1, 6, 0, 1, 0, 3]),
        request(&[1, 16, 0, 0, 0, 2, 4, 0, 1, 0, 2]),
        request(&[1, 22, 0, 4, 0, 0, 0xFF, 0xFF]),
        request(&[1, 23, 0, 0, 0, 2, 0, 4, 0, 2, 4, 0, 10, 1, 2]),
    ];
    let defects: [Defect; 3] = [
        ("mask", |frame| {
            let limits = [[0x80, 0], [0x7F, 0xFF], [0x80, 1], [0xFF, 0xFE]];
            frame.len() == 10 && frame[1] == 22 && limits.contains(&[frame[6], frame[7]])
        }),
        ("registers", |frame| {
            let is_long = frame.len() > 100 && frame[1] == 16;
            let bytes = frame.get(6).copied().map_or(0, usize::from);
            is_long && bytes == 2 * usize::from(frame[5]) && bytes == frame.len() - 9
        }),
        ("constant", |frame| {
            frame.len() == 8 && frame[1] == 6 && frame[4..6] == [0x12, 0x67]
        }),
    ];
    let mut constants = Constants::default();
    constants.add_script(b"if value == 0x1267: pass");
    assert_eq!(missed(&frames, &constants, &defects), [""; 0]);
}

/// A reply of one request is also sent to another one.
#[test]
fn replies_are_used_for_other_requests() {
    let spoken = |is_program, at, bytes: &[u8]| Spoken {
        is_program,
        at,
        bytes: bytes.to_vec(),
    };
    let mut gathered = Gathered::default();
    gathered.conversation(&[
        spoken(true, 0, b"A?\n"),
        spoken(false, 10_000_000, b"a=1\n"),
        spoken(true, 20_000_000, b"B?\n"),
        spoken(false, 30_000_000, b"b=2\n"),
    ]);
    let lesson = Lesson::with(gathered.learned(None), Vec::new(), Constants::default());
    let rng = &mut Rng::stream(1, "others");
    let turns = lesson.turns(400, &BTreeSet::new(), rng);
    let mut others = turns
        .iter()
        .filter(|turn| turn.kind == "reply-of-another-request");
    let first = others.next().expect("one in some dozens");
    let to = first.to.clone().expect("it answers a request");
    let expected: &[u8] = if to.0 == b"A?\n" { b"b=2\n" } else { b"a=1\n" };
    assert_eq!(first.say, [Hex(expected.to_vec())]);
}

/// A counter that replies repeat, in requests of two kinds: the reply to a later number is made of
/// a recorded one. A request that differs elsewhere has no known reply.
#[test]
fn a_counter_of_a_request_is_copied_to_its_reply() {
    let mut spoken: Vec<Spoken> = Vec::new();
    let mut said = |is_program, text: &str| {
        spoken.push(Spoken {
            is_program,
            at: 10_000_000 * (1 + spoken.len() as u64),
            bytes: text.as_bytes().to_vec(),
        });
    };
    for (request, reply) in [
        ("@01 PING\n", "@01 OK\n"),
        ("@02 GET 3\n", "@02 3 +1.5\n"),
        ("@03 PING\n", "@03 OK\n"),
        ("@04 GET 4\n", "@04 4 +2.5\n"),
    ] {
        said(true, request);
        said(false, reply);
    }
    let mut gathered = Gathered::default();
    gathered.conversation(&spoken);
    let lesson = Lesson::with(gathered.learned(None), Vec::new(), Constants::default());
    let fitted = |request: &str| {
        let reply = lesson.fitted(request.as_bytes())?;
        String::from_utf8(reply).ok()
    };
    assert_eq!(fitted("@57 PING\n").as_deref(), Some("@57 OK\n"));
    assert_eq!(fitted("@58 PONG\n"), None);
    assert_eq!(fitted("@7 PING\n"), None);
    assert!(lesson.is_like(b"@01 PING\n", b"@57 PING\n"));
    assert!(!lesson.is_like(b"@01 PING\n", b"@57 GET 3\n"));
    assert_eq!(
        lesson.changed(9, b"@57 OK\n"),
        lesson.changed(9, b"@57 OK\n")
    );
}

/// A device whose name is asked for once, at the start of the driver. Frame: 55, length, message,
/// body, sum.
const NAMED: &str = r#"
    name = "named"
    about = "x"
    line = { baud = 9600 }
    frame = { sync = [0x55], length = { at = 1, type = "u8", counts = "frame" }, checksum = "sum8" }
    message = [
      { name = "ask", from = "host", fields = [{ type = "u8", value = 1 }] },
      { name = "named", from = "device", fields = [{ type = "u8", value = 0x81 }, { name = "n", type = "strz" }] },
    ]
    on = [{ message = "ask", reply = "named" }]
    "#;

/// Defects of drivers at a text: no NUL, a buffer of 32, a buffer of 128, a character beyond ASCII,
/// no character. Each is reached by the first two turns of a conversation, in the first 25 cases.
#[test]
fn texts_at_their_limits_come_early() {
    let of = Description::parse("named", NAMED, &|_| Err(String::new())).expect("sound");
    let mut gathered = Gathered::default();
    let spoken = |is_program, at, bytes: &[u8]| Spoken {
        is_program,
        at,
        bytes: bytes.to_vec(),
    };
    // The sums by hand: 55 + 04 + 01 = 5A; 55 + 08 + 81 + 61 + 62 + 63 = 204.
    gathered.conversation(&[
        spoken(true, 0, &[0x55, 4, 1, 0x5A]),
        spoken(false, 10_000_000, b"\x55\x08\x81abc\0\x04"),
    ]);
    let seeds = gathered.learned(Some(DescribedFormat::of(&of)));
    let lesson = Lesson::with(seeds, vec![of], Constants::default());
    let text = |turn: &Turn| {
        let frame = &turn.say[0].0;
        frame[3..frame.len() - 1].to_vec()
    };
    let defects: [Defect; 5] = [
        ("nul", |text| !text.contains(&0)),
        ("32", |text| {
            text.iter().take_while(|byte| **byte != 0).count() > 31
        }),
        ("128", |text| {
            text.iter().take_while(|byte| **byte != 0).count() > 127
        }),
        ("ascii", |text| !text.is_ascii()),
        ("empty", |text| text == [0]),
    ];
    let mut missed: Vec<&str> = defects.iter().map(|(name, _)| *name).collect();
    for case in 0..25 {
        let turns = lesson.text_turns(case, &BTreeSet::new());
        assert!(
            turns
                .iter()
                .all(|turn| turn.to == Some(Hex(vec![0x55, 4, 1, 0x5A])))
        );
        for turn in turns.iter().take(2) {
            assert_eq!(
                lesson
                    .changed(turn.seed.expect("one"), b"\x55\x08\x81abc\0\x04")
                    .say,
                turn.say
            );
            missed.retain(|name| !defects.iter().any(|(of, is)| of == name && is(&text(turn))));
        }
    }
    assert_eq!(missed, [""; 0]);
    // After a finding by a text only one conversation in four begins with them.
    let avoided = BTreeSet::from(["unterminated-text".to_owned()]);
    let has_any = (0..8).filter(|case| !lesson.text_turns(*case, &avoided).is_empty());
    assert_eq!(has_any.collect::<Vec<u64>>(), [0, 4]);
}
