//! Descriptions learned from captured bytes: right for most of the shipped devices, never sure of
//! what is wrong, silent on bytes without a form.

use std::sync::Arc;

use core::time::Duration;

use hilrig::capture::{Capture, Interface, Kind, Record, Section};
use hilrig::description::conform::emulated;
use hilrig::description::peer::Peer as _;
use hilrig::description::{self, Description, From};
use hilrig::rig::line::Direction;
use hilrig::search::learn::{Confidence, Proposal};
use protocols::{Decode as _, Instant};

/// A device with stuffing, one with two formats of frames, and Modbus.
const DEVICES: [&str; 3] = ["cobs-sensor", "gps", "modbus-meter"];

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

/// A capture under way.
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

/// A conversation of a driver with the emulated device; only listening if it speaks by itself.
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
                let values = message.example(dice);
                of.frame(message, &values).expect("an example fits")
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

/// Frames in `bytes` that come in one go, ended by a silence.
fn frames(of: &Description, bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut cutter = of.cutter();
    let mut found: Vec<_> = cutter.push(bytes).flatten().collect();
    cutter.idle();
    found.extend(cutter.push(&[]).flatten());
    found.into_iter().map(|frame| frame.bytes).collect()
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

/// Whether the draft cuts fresh frames as the device's description does, and whether it sees damage
/// as that does.
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
        // Damage that the device itself does not see is none.
        (frames(of, &damaged) != [damaged.clone()]).then_some(damaged)
    });
    let damaged: Vec<_> = damaged.collect();
    let unseen = damaged
        .iter()
        .filter(|bytes| frames(&learned, bytes) == [bytes.to_vec()]);
    let is_summed = unseen.count() * 20 <= damaged.len();
    (is_cut, is_summed)
}

#[test]
fn devices_are_learned_and_nothing_wrong_is_sure() {
    let (mut right, mut missed) = (0, Vec::new());
    for name in DEVICES {
        let of = parse(description::shipped::text(name).expect("shipped"));
        let learned = conversation(&of).learned();
        let Some(draft) = &learned.draft else {
            missed.push(format!("{name}: nothing"));
            continue;
        };
        let (is_cut, is_summed) = is_right(&of, draft);
        for claim in learned
            .claims
            .iter()
            .filter(|claim| claim.confidence == Confidence::Sure)
        {
            // Fresh frames of a device with several formats are not all of the learned one.
            let is_wrong =
                matches!(claim.topic, "framing" | "checksum") && !is_cut && of.formats() == 1;
            assert!(!is_wrong, "{name}: {claim}\n{draft}");
        }
        match is_cut && is_summed {
            true => right += 1,
            false => missed.push(format!(
                "{name}: cut {is_cut}, summed {is_summed}: {:?}",
                learned.claims
            )),
        }
    }
    // One line of the GPS has two formats, of which a draft can have one.
    assert!(right + 1 >= DEVICES.len(), "{right} right, not {missed:#?}");
}

/// Random chunks of many lengths, and prose in lines.
#[test]
fn nothing_is_claimed_of_random_bytes_and_of_prose() {
    for seed in 1..6 {
        let dice = &mut dice(seed);
        let mut tape = Tape::new(115_200);
        for number in 0..80 {
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
    let page = include_str!("../../docs/own-device.md");
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
