//! Descriptions learned from captured bytes: correct for most shipped devices, never certain of a
//! wrong claim, and without claims about random bytes.

use std::sync::Arc;

use core::time::Duration;

use capture::{Capture, Interface, Kind, Record, Section};
use description::conform::emulated;
use description::peer::Peer as _;
use description::{Description, From};
use engine::rig::line::Direction;
use hilrig_search::learn::{Claim, Confidence, Proposal};
use protocols::{Decode as _, Instant};

fn parse(text: &str) -> Arc<Description> {
    let nothing = |_: &str| Err("no file".to_owned());
    Description::parse("shipped", text, &nothing).unwrap_or_else(|error| panic!("{error}"))
}

fn dice(mut state: u64) -> impl FnMut(u64) -> u64 {
    move |below| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) % below.max(1)
    }
}

/// A capture that is being recorded.
struct Tape(Vec<u8>);

impl Tape {
    fn new(baud: u32) -> Self {
        let mut out = Vec::new();
        Section::default().write(&mut out);
        Interface::new("device", baud).write(&mut out);
        Self(out)
    }

    fn add(&mut self, at: Instant, direction: Direction, bytes: &[u8]) {
        let record = Record {
            link: 0,
            sequence: None,
            at,
            direction,
            kind: Kind::Data,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        record.write(0, &mut self.0);
    }

    fn learned(&self) -> Proposal {
        Proposal::of(&Capture::of(&self.0), None).expect("there are bytes")
    }
}

/// A conversation of a driver with the emulated device; the driver only listens if the device sends
/// unsolicited messages.
fn conversation(of: &Arc<Description>) -> Tape {
    let mut tape = Tape::new(of.line().baud);
    let mut peer = emulated(of, 5);
    let dice = &mut dice(3);
    let asked: Vec<_> = of
        .messages()
        .iter()
        .filter(|one| one.from() != From::Device)
        .collect();
    let registers = of.requests(&["read"]).unwrap_or_default();
    for number in 0..120 {
        let before = peer.now();
        let pause = Duration::from_millis(40 + dice(20));
        while let Ok(Some((at, bytes))) = peer.hear(before + pause) {
            tape.add(at, Direction::ToMaster, &bytes);
        }
        let bytes = match (&asked[..], &registers[..]) {
            ([], []) => continue,
            ([], all) => all[number % all.len()].bytes.clone(),
            (asked, _) => {
                let message = asked[number % asked.len()];
                let answered = of.answered(message, &message.example(dice));
                let values = &answered[number / asked.len() % answered.len()];
                of.frame(message, values).expect("an example fits")
            }
        };
        let at = peer.now();
        peer.send(&bytes).expect("an emulated device listens");
        tape.add(at, Direction::ToDevice, &bytes);
        let until = peer.now() + Duration::from_millis(150);
        while let Ok(Some((at, bytes))) = peer.hear(until) {
            tape.add(at, Direction::ToMaster, &bytes);
        }
    }
    tape
}

/// The frames in `bytes`, which arrive at once and end with a silence.
fn frames(of: &Description, bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut cutter = of.cutter_of(From::Device);
    let mut found: Vec<_> = cutter.push(bytes).flatten().collect();
    cutter.idle();
    found.extend(cutter.push(&[]).flatten());
    found.iter().map(|frame| frame.bytes.to_vec()).collect()
}

/// Frames of the device that the learner has not seen.
fn fresh(of: &Description) -> Vec<Vec<u8>> {
    let dice = &mut dice(99);
    let messages: Vec<_> = of
        .messages()
        .iter()
        .filter(|one| one.from() != From::Host)
        .collect();
    (0..200_usize)
        .map(
            |number| match messages.get(number % messages.len().max(1)) {
                Some(message) => {
                    let values = message.example(dice);
                    of.frame(message, &values).expect("an example fits")
                }
                None => {
                    let [a, b] =
                        [dice(256), dice(256)].map(|byte| u8::try_from(byte).expect("a byte"));
                    of.frame_of(0, &[1, 4, 4, a, b, b, a]).expect("it fits")
                }
            },
        )
        .collect()
}

/// Whether the draft splits new frames like the device's description, and whether it detects damage
/// like it.
fn is_right(of: &Description, draft: &str) -> (bool, bool) {
    let learned = parse(draft);
    let fresh = fresh(of);
    let same = fresh
        .iter()
        .filter(|bytes| frames(&learned, bytes) == [bytes.to_vec()]);
    let is_cut = same.count() * 100 >= fresh.len() * 95;
    let damaged = fresh.iter().filter_map(|bytes| {
        let mut damaged = bytes.clone();
        let at = damaged.len() / 2;
        damaged[at] ^= 1;
        // Damage that the device's own description does not detect does not count.
        (frames(of, &damaged) != [damaged.clone()]).then_some(damaged)
    });
    let damaged: Vec<_> = damaged.collect();
    let unseen = damaged
        .iter()
        .filter(|bytes| frames(&learned, bytes) == [bytes.to_vec()]);
    let is_summed = unseen.count() * 20 <= damaged.len();
    (is_cut, is_summed)
}

/// Framing and checksum of most devices are found; no certain claim is wrong. The table is printed.
#[test]
fn devices_are_learned_and_nothing_wrong_is_sure() {
    // Every sixth device at a landing, all of them with `tests/run.sh --all`.
    let is_whole = std::env::var("HILRIG_TESTS").is_ok_and(|tests| tests == "all");
    let step = if is_whole { 1 } else { 6 };
    let (mut tried, mut right, mut wrong) = (0, 0, Vec::new());
    for (name, text) in description::shipped::ALL.iter().step_by(step) {
        tried += 1;
        let of = parse(text);
        let learned = conversation(&of).learned();
        let Some(draft) = &learned.draft else {
            println!("{name:20} nothing is claimed");
            continue;
        };
        let (is_cut, is_summed) = is_right(&of, draft);
        let is_sure = |one: &&Claim| one.confidence == Confidence::Sure;
        for claim in learned.claims.iter().filter(is_sure) {
            // A device with several formats may send new frames of a format that was not learned.
            let is_frame = matches!(claim.topic, "framing" | "checksum");
            if is_frame && !is_cut && of.formats() == 1 {
                wrong.push(format!("{name}: {claim}\n{draft}"));
            }
        }
        let word = |is_right: bool| if is_right { "right" } else { "-" };
        let [covered, all] = learned.covered;
        println!(
            "{name:20} framing {:5} checksum {:5} {:3} % of the bytes",
            word(is_cut),
            word(is_summed),
            covered * 100 / all
        );
        right += usize::from(is_cut && is_summed);
    }
    assert!(wrong.is_empty(), "sure and wrong:\n{}", wrong.join("\n"));
    assert!(right * 3 >= tried * 2, "{right} of {tried} right");
}

/// Random chunks of many lengths, and prose in lines.
#[test]
fn nothing_is_claimed_of_random_bytes_and_of_prose() {
    for seed in 1..6 {
        let dice = &mut dice(seed);
        let mut tape = Tape::new(115_200);
        for number in 0..120 {
            let len = 1 + dice(40);
            let bytes: Vec<u8> = (0..len)
                .map(|_| u8::try_from(dice(256)).expect("a byte"))
                .collect();
            tape.add(
                Instant::from_millis(50 * (number + 1)),
                Direction::ToMaster,
                &bytes,
            );
        }
        let learned = tape.learned();
        assert!(
            learned.draft.is_none() && learned.claims.is_empty(),
            "{seed}: {learned:?}"
        );
    }
    let mut tape = Tape::new(115_200);
    let page = include_str!("../../../docs/own-device.md");
    let prose = page
        .lines()
        .filter(|line| line.len() > 60 && !line.contains('|'));
    for (number, line) in prose.enumerate() {
        let at = Instant::from_millis(50 * (number as u64 + 1));
        tape.add(at, Direction::ToMaster, format!("{line}\n").as_bytes());
    }
    let learned = tape.learned();
    let sure = learned
        .claims
        .iter()
        .filter(|claim| claim.confidence == Confidence::Sure);
    assert_eq!(sure.count(), 0, "{learned:?}");
}

/// A device with each sum of 7 bits: the draft names the sum, and the values of a byte with few.
#[test]
fn a_sum_of_seven_bits_and_a_choice_are_learned() {
    for sum in ["sum7", "twos-complement7", "ones-complement7", "xor7"] {
        let of = parse(&format!(
            r#"
name = "seven"
about = "Device with a checksum of 7 bits"
endian = "big"
line = {{ baud = 9600 }}
frame = {{ sync = [0xA5], size = 9, checksum = "{sum}" }}
state = {{ load = {{ source = {{ noise = {{ mean = 30000, deviation = 9000 }} }} }} }}
enums = {{ modes = {{ 0 = "off", 1 = "on", 7 = "hold" }} }}
message = [
  {{ name = "ask", from = "host", fields = [
    {{ type = "u8", value = 1 }}, {{ name = "mode", type = "u8", enum = "modes" }},
    {{ name = "tag", type = "u32" }}, {{ type = "pad", size = 1 }},
  ] }},
  {{ name = "told", from = "device", fields = [
    {{ type = "u8", value = 2 }}, {{ name = "mode", type = "u8", enum = "modes" }},
    {{ name = "load", type = "u16" }}, {{ name = "tag", type = "u24" }},
  ] }},
]
on = [{{ message = "ask", reply = "told" }}]
"#
        ));
        let draft = conversation(&of).learned().draft.expect("frames");
        assert_eq!(is_right(&of, &draft), (true, true), "{sum}: {draft}");
        assert!(draft.contains(&format!("\"{sum}\"")), "{sum}: {draft}");
        assert!(
            draft.contains("about = \"seen: 00 01 07\""),
            "{sum}: {draft}"
        );
    }
}

/// Content bytes of a frame of an own format: mostly small, as figures of devices are, with 10 and
/// 03 among them.
fn content(dice: &mut impl FnMut(u64) -> u64) -> Vec<u8> {
    let len = 3 + dice(9);
    let byte = |_| u8::try_from(dice(256)).expect("a byte");
    (0..len).map(byte).collect()
}

/// A frame of an own format.
type Own = fn(&mut dyn FnMut(u64) -> u64) -> Vec<u8>;

/// Formats with markers: STX, text, ETX and an exclusive or; the same without a checksum; DLE
/// stuffing with both usual start markers; digits behind a colon; text that a semicolon ends.
const MARKED: [(&str, Own); 6] = [
    ("stx", |dice| {
        let text = format!(
            "V{}{}",
            dice(1_000),
            "=".repeat(usize::try_from(dice(2)).expect("small"))
        );
        let mut frame = [&[2], text.as_bytes(), &[3]].concat();
        frame.push(frame[1..].iter().fold(0, |sum, byte| sum ^ byte));
        frame
    }),
    ("etx", |dice| {
        format!(
            "\x02{}{:05}\x03",
            ["A", "B"][usize::try_from(dice(2)).expect("small")],
            dice(100_000)
        )
        .into_bytes()
    }),
    ("dle", |dice| dle(&[0x10, 0x02], dice)),
    ("tsip", |dice| dle(&[0x10], dice)),
    ("hex", |dice| {
        let mut dice = dice;
        let mut body = content(&mut dice);
        let sum = body.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        body.push(sum.wrapping_neg());
        let digits: String = body.iter().map(|byte| format!("{byte:02X}")).collect();
        format!(":{digits}\r\n").into_bytes()
    }),
    ("semicolon", |dice| match dice(2) {
        0 => format!("T={};", dice(1_000)).into_bytes(),
        _ => format!("H={};", dice(100)).into_bytes(),
    }),
];

/// A frame with DLE stuffing and a sum; its first byte is a kind below 10.
fn dle(start: &[u8], dice: &mut dyn FnMut(u64) -> u64) -> Vec<u8> {
    let mut dice = dice;
    let mut body = [
        vec![u8::try_from(4 + dice(4)).expect("small")],
        content(&mut dice),
    ]
    .concat();
    body.push(body.iter().fold(0, |sum, byte| sum.wrapping_add(*byte)));
    let twice = |byte: u8| core::iter::repeat_n(byte, if byte == 0x10 { 2 } else { 1 });
    [
        start.to_vec(),
        body.into_iter().flat_map(twice).collect(),
        vec![0x10, 3],
    ]
    .concat()
}

/// Formats with markers are learned from frames with pauses between them, from frames that a pause
/// also splits, and from reads of 32 bytes without a pause. No certain claim names another rule.
#[test]
fn markers_are_learned_whatever_the_pauses() {
    for (name, own) in MARKED {
        for way in ["paced", "split", "stream"] {
            let (mut tape, dice) = (Tape::new(9_600), &mut dice(7));
            let (mut at, mut whole) = (Instant::ZERO, Vec::new());
            let mut add = |bytes: &[u8], pause: u64| {
                at += Duration::from_micros(1_042 * bytes.len() as u64 + pause);
                tape.add(at, Direction::ToMaster, bytes);
            };
            for number in 0..60 {
                let frame = own(dice);
                match way {
                    "paced" => add(&frame, 50_000),
                    "split" => {
                        let parts = frame.split_at(if number % 20 == 9 { 3 } else { 0 });
                        [parts.0, parts.1]
                            .iter()
                            .filter(|part| !part.is_empty())
                            .for_each(|part| add(part, 50_000));
                    }
                    _ => whole.extend(frame),
                }
            }
            whole.chunks(32).for_each(|read| add(read, 0));
            let learned = tape.learned();
            let wrong = learned.claims.iter().find(|claim| {
                claim.words.contains("silence") && claim.confidence == Confidence::Sure
            });
            assert_eq!(wrong, None, "{name} {way}: {:#?}", learned.claims);
            // A split frame is damage for a decoder that waits for a silence.
            if way == "split" {
                continue;
            }
            let draft = learned
                .draft
                .unwrap_or_else(|| panic!("{name} {way}: {:#?}", learned.claims));
            let (read, fresh) = (parse(&draft), (0..50).map(|_| own(dice)));
            let cut = fresh.filter(|frame| frames(&read, frame) == [frame.clone()]);
            assert_eq!(cut.count(), 50, "{name} {way}\n{draft}");
        }
    }
}

/// SLIP of RFC 1055 by hand, with a marker at both ends.
fn slip(content: &[u8]) -> Vec<u8> {
    let mut out = vec![0xC0];
    for byte in content {
        match byte {
            0xC0 => out.extend([0xDB, 0xDC]),
            0xDB => out.extend([0xDB, 0xDD]),
            byte => out.push(*byte),
        }
    }
    out.push(0xC0);
    out
}

/// Frames of SLIP without a checksum are learned by their stuffing, also from a stream without
/// pauses. Markers without any escape are a guess.
#[test]
fn stuffing_is_learned_without_a_checksum() {
    let ways = ["slip at both ends", "slip without escapes"];
    for way in ways {
        for is_stream in [false, true] {
            let (mut tape, dice) = (Tape::new(9_600), &mut dice(9));
            let (mut at, mut whole, mut all) = (Instant::ZERO, Vec::new(), Vec::new());
            for number in 0..60 {
                let mut content = vec![0x81, number];
                let specials = [0xC0, 0xDB, 0x10, 0x7E, 0x7D, 0x00, 5, 200];
                content.extend(
                    (0..3 + dice(6)).map(|_| specials[usize::try_from(dice(8)).expect("small")]),
                );
                if way == "slip without escapes" {
                    content.retain(|byte| ![0xC0, 0xDB].contains(byte));
                }
                let frame = slip(&content);
                at += Duration::from_millis(100);
                if !is_stream {
                    tape.add(at, Direction::ToMaster, &frame);
                }
                whole.extend(&frame);
                all.push(content);
            }
            for read in whole.chunks(32).filter(|_| is_stream) {
                at += Duration::from_micros(1_042 * read.len() as u64);
                tape.add(at, Direction::ToMaster, read);
            }
            let learned = tape.learned();
            let name = way.split(' ').next().expect("a word");
            let claim = &learned
                .claims
                .first()
                .unwrap_or_else(|| panic!("{way} {is_stream}"));
            let words = format!("frames coded with {}", name.to_uppercase());
            assert_eq!(
                claim.words, words,
                "{way} {is_stream}: {:#?}",
                learned.claims
            );
            let is_sure = way != "slip without escapes";
            assert_eq!(
                claim.confidence == Confidence::Sure,
                is_sure,
                "{way}: {claim}"
            );
            let draft = parse(&learned.draft.expect("a draft"));
            let found = frames(&draft, &whole);
            let bodies: Vec<Vec<u8>> = found
                .iter()
                .filter_map(|bytes| {
                    let mut cutter = draft.cutter_of(From::Device);
                    let frame = cutter.push(bytes).next()?.ok()?;
                    draft.body(&frame)
                })
                .collect();
            let share = bodies.iter().filter(|body| all.contains(body)).count();
            assert!(share * 10 >= all.len() * 9, "{way} {is_stream}: {share}");
        }
    }
}
