//! The emulator beside the real sensor, and the measure itself beside arithmetic.

use super::*;
use crate::xv11::Profile;

/// First whole packet of the "hand in box" capture, and one with 0x21 that carries strength 466.
const PLAIN: [u8; 22] = [
    0xFA, 0xA0, 0x4E, 0x4A, 0x27, 0x01, 0x05, 0x04, 0x27, 0x01, 0xD7, 0x03, 0x26, 0x01, 0x29, 0x04,
    0x26, 0x01, 0xF0, 0x03, 0x3C, 0x5C,
];
const SKIPPED: [u8; 22] = [
    0xFA, 0xAC, 0x2B, 0x4A, 0x8C, 0x01, 0xC4, 0x01, 0x93, 0x01, 0xD2, 0x01, 0x21, 0x80, 0xD2, 0x01,
    0xA2, 0x01, 0x93, 0x01, 0xFA, 0x35,
];

fn row(rows: &[Row], name: &str) -> f64 {
    let row = rows.iter().find(|row| row.name == name);
    row.and_then(|row| row.value)
        .unwrap_or_else(|| panic!("no figure {name}"))
}

fn captured(name: &str) -> f64 {
    let found = CAPTURED.iter().find(|(known, _)| *known == name);
    found.unwrap_or_else(|| panic!("no figure {name}")).1
}

/// Figures of the emulated run, and the allowed factor between them and the captured ones.
fn assert_near(rows: &[Row], name: &str, factor: f64) {
    let (ours, real) = (row(rows, name), captured(name));
    assert!(
        ours <= real * factor && ours >= real / factor,
        "{name}: {ours} against {real}"
    );
}

/// Required accuracy of the replica: the encoder's own codes within a quarter, noise within 30 %,
/// coast-down within 15 %, the dropped carry 3 % +-1. The codes of the optics depend on the shape
/// of a real hand, which is not recorded: within half as much again. Two codes that occur a dozen
/// times in the capture: within a factor of two.
#[test]
fn the_emulated_hand_in_box_has_the_figures_of_the_captured_one() {
    let stream = hand_in_box(Profile::Fw24, 1);
    let statistics = Statistics::of(&stream);
    let rows = statistics.rows();
    for name in [
        "code 0x21",
        "code 0x22",
        "code 0x52",
        "index steps of 45 or 46",
    ] {
        assert_near(&rows, name, 1.25);
    }
    for from in [200, 300, 400, 500] {
        assert_near(&rows, &format!("noise from {from} mm"), 1.3);
    }
    assert_near(&rows, "coast-down from 290 to 185 rpm", 1.15);
    assert_near(&rows, "coast-down from 185 to 75 rpm", 1.15);
    assert!((row(&rows, "checksums with a dropped carry") - 3.0).abs() < 1.0);
    assert_near(&rows, "strength x distance^2", 1.1);
    for name in [
        "code 0x02",
        "code 0x03",
        "code 0x35",
        "distances with warning",
    ] {
        assert_near(&rows, name, 1.5);
    }
    assert_near(&rows, "code 0x25", 2.0);
    assert_near(&rows, "code 0x50", 2.0);
    assert_near(&rows, "speed, highest", 1.05);
}

/// The restart at the end: 0.59 s of packets with the last speed (311 captured), a cut packet, and
/// the boot text byte for byte.
#[test]
fn the_emulated_hand_in_box_ends_as_the_captured_one() {
    let statistics = Statistics::of(&hand_in_box(Profile::Fw24, 1));
    assert!((305..=317).contains(&statistics.stalled_packets));
    assert!((1..22).contains(&statistics.cut_bytes.expect("cut")));
    assert_eq!(
        statistics.boot_text.as_deref(),
        Some(Profile::Fw24.banner())
    );
    assert_eq!(
        statistics.word_changes[1],
        statistics.word_changes.iter().sum::<u64>()
    );
}

#[test]
fn two_captured_packets_give_their_figures() {
    let statistics = Statistics::of(&[PLAIN, SKIPPED].concat());
    assert_eq!((statistics.packets, statistics.outside), (2, 0));
    assert_eq!((statistics.plain, statistics.weak), (7, 0));
    assert_eq!(statistics.codes, BTreeMap::from([(0x21, 1)]));
    assert_eq!(statistics.carried, [1, 1]);
    assert_eq!(statistics.index_steps, BTreeMap::from([(12, 1)]));
    // The speeds are 19,022 / 64 and 18,987 / 64 rpm.
    assert!((statistics.rpm_max - 297.219).abs() < 0.001);
    assert!((statistics.rpm_min - 296.672).abs() < 0.001);
    // Strength 466 times the square of 403 mm is 0.757e8; the other six readings lie on both sides
    // of 0.85e8.
    assert!((0.7..0.95).contains(&statistics.strength_d2));
}

/// Seven bytes of a packet before the text, as in the capture.
#[test]
fn a_cut_packet_before_the_boot_text_is_measured() {
    let text = Profile::Fw24.banner();
    let stream = [&PLAIN[..], &SKIPPED[..7], text.as_bytes()].concat();
    let statistics = Statistics::of(&stream);
    assert_eq!(statistics.cut_bytes, Some(7));
    assert_eq!(statistics.boot_text.as_deref(), Some(text));
    assert_eq!(Statistics::of(&PLAIN).boot_text, None);
}

#[test]
fn whole_turns_of_firmware_2_1_are_measured_too() {
    let statistics = Statistics::of(&hand_in_box(Profile::Fw21, 1));
    assert!(
        (110..=122).contains(&statistics.turns),
        "{}",
        statistics.turns
    );
    assert_eq!(statistics.packets, 0);
    assert!(statistics.codes[&0x21] > 100);
}

#[test]
fn nothing_gives_no_figures() {
    let rows = Statistics::of(&[]).rows();
    assert!(
        rows.iter()
            .all(|row| row.value.is_none_or(|value| value == 0.0))
    );
}

/// Five bytes of noise before two turns of 1446 bytes.
#[test]
fn what_belongs_to_no_turn_is_outside() {
    let turn = turn::Frame::new(0xD194, &[RawReading([0xE8, 3, 200, 0]); 360]);
    let bytes = [&[1, 2, 3, 4, 5][..], turn.as_bytes(), turn.as_bytes()].concat();
    let statistics = Statistics::of(&bytes);
    assert_eq!((statistics.turns, statistics.outside), (2, 5));
}

/// A boot text after seven bytes of a packet behind a whole one; after whole packets only; after
/// bytes of no packet. The last text counts, up to its prompt.
#[test]
fn a_boot_text_cuts_the_packet_before_it() {
    let text = b"Hi\n\rPiccolo Laser\r\n#";
    let told = |parts: &[&[u8]]| boot(&parts.concat());
    let whole = Some("Hi\n\rPiccolo Laser\r\n#".to_owned());
    assert_eq!(told(&[&PLAIN, &PLAIN[..7], text]), (Some(7), whole.clone()));
    assert_eq!(told(&[&PLAIN[..21], text]), (Some(21), whole.clone()));
    assert_eq!(told(&[&PLAIN[..1], text, &PLAIN]), (Some(1), whole.clone()));
    assert_eq!(told(&[&PLAIN, text]), (None, whole.clone()));
    assert_eq!(
        told(&[&[0x55; 22], &PLAIN[..7], text]),
        (None, whole.clone())
    );
    assert_eq!(told(&[text, &PLAIN, &SKIPPED[..9], text]), (Some(9), whole));
    let open = Some("Hi\n\rPiccolo 2".to_owned());
    assert_eq!(told(&[&PLAIN[..3], b"Hi\n\rPiccolo 2"]), (Some(3), open));
    assert_eq!(told(&[b"\n\rPiccolo"]), (None, None));
    assert_eq!(told(&[&PLAIN]), (None, None));
}
