//! Faults of devices, observed in the devices' bytes. No program is at the other end: the rig turns
//! the head of the lidar, and the base and the radio get the same requests at the same times,
//! whatever they answer.

use core::time::Duration;
use std::path::Path;

use hilrig::Shared;
use hilrig::rig::line::{Delivery, Direction};
use hilrig::rig::trace::{Side, Tap};
use hilrig::robots::{self, Dut, PcEnd};
use hilrig::run::Run;
use hilrig::scenario::{FaultKind, FaultPlace, Scenario};
use protocols::avr::{self, ChecksumOrder, registers};
use protocols::xv11::{self, Frame, Reading};
use protocols::{Decode, Instant};

use crate::in_a_room;

/// Bytes that one link delivered to the master, with their times.
type Stream = Vec<(Instant, Vec<u8>)>;

/// Bytes sent by all devices.
#[derive(Clone, Debug, Default, PartialEq)]
struct Seen {
    /// Links in this order: lidar, motor, base, radio, pc.
    links: [Stream; 5],
    case: Option<Scenario>,
}

const LIDAR: usize = 0;
const BASE: usize = 2;
const RADIO: usize = 3;

impl Seen {
    /// The bytes that arrived on `link` from `from` until `until`, ms.
    fn bytes(&self, link: usize, from: u64, until: u64) -> Vec<u8> {
        let window = Instant::from_millis(from)..Instant::from_millis(until);
        let inside = self.links[link]
            .iter()
            .filter(|(at, _)| window.contains(at));
        inside.flat_map(|(_, bytes)| bytes.clone()).collect()
    }

    fn is_silent(&self, link: usize, from: u64, until: u64) -> bool {
        self.bytes(link, from, until).is_empty()
    }

    /// Packets of the lidar, and the number of bytes outside all packets.
    fn packets(&self, from: u64, until: u64) -> (Vec<Frame>, u64) {
        let mut decoder = xv11::Decoder::default();
        let bytes = self.bytes(LIDAR, from, until);
        let frames = decoder.push(&bytes).filter_map(Result::ok).collect();
        (frames, decoder.discarded())
    }

    /// Answers of the base.
    fn answers(&self, from: u64, until: u64) -> Vec<avr::Frame> {
        let mut decoder = avr::Decoder::new(ChecksumOrder::HighFirst);
        let bytes = self.bytes(BASE, from, until);
        decoder.push(&bytes).filter_map(Result::ok).collect()
    }

    /// The left encoder's last count from the base before `until`, ms.
    fn left_count(&self, until: u64) -> i32 {
        let answers = self.answers(0, until);
        let count = answers
            .iter()
            .rfind(|a| a.register() == registers::ENCODER_LEFT);
        let data = count.expect("it answers").data();
        i32::from_le_bytes(*data.first_chunk().expect("four bytes"))
    }

    /// The last battery value from the base before `until`: the fielded firmware reports only the
    /// high byte of the millivolts.
    fn battery(&self, until: u64) -> u8 {
        let answers = self.answers(0, until);
        let told = answers
            .iter()
            .rfind(|a| a.register() == registers::BATTERY_MV);
        told.expect("it answers").data()[0]
    }
}

struct Pen(Shared<Seen>);

impl Tap for Pen {
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        if direction == Direction::ToMaster && !delivery.bytes.is_empty() {
            let stream = &mut self.0.lock().links[link];
            stream.push((delivery.at, delivery.bytes.clone()));
        }
    }
}

/// The rig for 10 s with a fault from the fourth second to the sixth.
fn observe(scenario: Scenario) -> Seen {
    let (_, source) = in_a_room("10s", "");
    let wired = robots::wire(&scenario, &source, Dut::External, PcEnd::External);
    let mut wired = wired.expect("sound");
    let seen = Shared::default();
    wired.rig.add_tap(Box::new(Pen(seen.clone())));
    let node = |name: &str| {
        let end = wired.open_ends.iter().find(|end| end.name == name);
        end.expect("offered").node
    };
    let (base, radio) = (node("base"), node("radio"));

    let mut run = Run::with_rig(scenario, wired.rig, wired.instruments);
    let read = |register, count| avr::Frame::read(register, count, ChecksumOrder::HighFirst);
    let go = avr::Frame::write(
        registers::SPEED_LEFT_TO,
        &[5, 5, 0],
        ChecksumOrder::HighFirst,
    );
    for tenth in 0..100 {
        run.go_on_until(Instant::from_millis(100 * tenth));
        for frame in [
            read(registers::BATTERY_MV, 3),
            read(registers::ENCODER_LEFT, 4),
            go,
        ] {
            run.rig.inject(base, frame.as_bytes());
            let pause = Instant::from_millis(100 * tenth) + Duration::from_millis(10);
            run.go_on_until(run.rig.now().max(pause) + Duration::from_millis(10));
        }
        // The module treats bytes without a pause of a second as one command.
        if tenth % 15 == 0 {
            run.rig.inject(radio, b"AT");
        }
    }
    run.go_on_until(Instant::from_secs(10));
    let case = run.case();
    drop(run);
    Seen {
        case: Some(case),
        ..core::mem::take(&mut *seen.lock())
    }
}

fn with(text: &str) -> Seen {
    let profile = "[device.base.avr-base]\nprofile = \"rcj2015-2015\"\nphase = \"10ms\"\n";
    observe(in_a_room("10s", &format!("{profile}{text}")).0)
}

const WHEN: &str = "from = \"4s\"\nuntil = \"6s\"\n";

fn fault(kind: FaultKind, keys: &str, when: &str) -> Seen {
    let device = match kind.place() {
        FaultPlace::Devices => "",
        _ if keys.contains("device") => "",
        _ => "device = \"lidar\"\n",
    };
    let kind = kind.name();
    with(&format!(
        "[[fault]]\nkind = \"{kind}\"\n{device}{keys}{when}"
    ))
}

/// Keys besides device and time, and the condition on the bytes with and without the fault.
type Row = (&'static str, fn(&Seen, &Seen));

/// The row of a kind; a kind without a row does not compile. `None`: the kind acts on lines, see
/// `kinds`.
fn row(kind: FaultKind) -> Option<Row> {
    use FaultKind as K;
    Some(match kind {
        K::PowerDip => (
            "devices = [\"lidar\", \"base\", \"radio\"]\n",
            all_are_silent,
        ),
        K::Off => ("", the_lidar_is_silent),
        K::Intermittent => ("every = \"1s\"\nlasting = \"200ms\"\n", silent_twice),
        K::Restart => ("", the_lidar_says_hello_once_more),
        K::Stuck => ("", the_head_stands_still),
        K::Garbage => ("", no_packet_is_whole),
        K::Wrong => ("factor = 1.5\n", distances_are_half_as_long_again),
        K::Slow => ("", the_head_is_slow),
        K::Delayed => ("by = \"50ms\"\n", all_comes_50_ms_late),
        K::Device => ("fault = \"dark\"\n", nothing_is_seen),
        _ => return None,
    })
}

/// Only bytes in flight arrive. Afterwards the lidar boots and repeats its text.
fn the_lidar_is_silent(seen: &Seen, plain: &Seen) {
    assert_eq!(seen.bytes(LIDAR, 0, 4_000), plain.bytes(LIDAR, 0, 4_000));
    assert!(plain.bytes(LIDAR, 4_010, 6_000).len() > 10_000);
    assert!(seen.is_silent(LIDAR, 4_010, 6_000));
    assert!(greets(&seen.bytes(LIDAR, 6_000, 7_000)));
    assert!(seen.packets(9_000, 10_000).0.len() > 300);
}

fn greets(bytes: &[u8]) -> bool {
    bytes.windows(7).any(|part| part == b"Piccolo")
}

/// The base answers thirty requests a second, the radio ten.
fn all_are_silent(seen: &Seen, plain: &Seen) {
    the_lidar_is_silent(seen, plain);
    for link in [BASE, RADIO] {
        assert!(!plain.is_silent(link, 4_100, 6_000));
        assert!(seen.is_silent(link, 4_100, 6_000));
        assert!(!seen.is_silent(link, 7_000, 10_000));
    }
    // After a restart, the base starts to count at 0.
    assert!(seen.left_count(7_000) < plain.left_count(7_000) / 2);
}

fn silent_twice(seen: &Seen, plain: &Seen) {
    assert_eq!(seen.bytes(LIDAR, 0, 4_000), plain.bytes(LIDAR, 0, 4_000));
    for from in [4_000, 5_000] {
        assert!(seen.is_silent(LIDAR, from + 10, from + 200));
        assert!(greets(&seen.bytes(LIDAR, from + 200, from + 1_000)));
    }
    assert!(!greets(&seen.bytes(LIDAR, 6_000, 10_000)));
}

fn the_lidar_says_hello_once_more(seen: &Seen, plain: &Seen) {
    assert!(!greets(&plain.bytes(LIDAR, 3_000, 10_000)));
    assert_eq!(seen.bytes(LIDAR, 0, 4_000), plain.bytes(LIDAR, 0, 4_000));
    assert!(greets(&seen.bytes(LIDAR, 4_000, 5_000)));
    assert!(!greets(&seen.bytes(LIDAR, 5_000, 10_000)));
}

/// The head runs down; then the sensor measures nothing.
fn the_head_stands_still(seen: &Seen, plain: &Seen) {
    let ranges = |seen: &Seen| ranges(&seen.packets(5_000, 6_000).0).len();
    assert!(ranges(plain) > 1_000);
    assert_eq!(ranges(seen), 0);
}

/// Each packet of 22 bytes has one wrong byte.
fn no_packet_is_whole(seen: &Seen, plain: &Seen) {
    let ((frames, _), (sound, _)) = (seen.packets(4_010, 6_000), plain.packets(4_010, 6_000));
    assert!(frames.is_empty(), "{}", frames.len());
    assert_eq!(
        seen.bytes(LIDAR, 4_010, 6_000).len(),
        plain.bytes(LIDAR, 4_010, 6_000).len()
    );
    assert!(sound.len() > 700);
    assert!(seen.packets(6_010, 7_000).0.len() > 300);
}

fn ranges(frames: &[Frame]) -> Vec<u16> {
    let readings = frames.iter().flat_map(Frame::readings);
    let range = |reading| match reading {
        Reading::Range { distance_mm, .. } => Some(distance_mm),
        Reading::Invalid { .. } => None,
    };
    readings.filter_map(range).collect()
}

/// Half millimetres may be rounded up or down.
fn distances_are_half_as_long_again(seen: &Seen, plain: &Seen) {
    let [wrong, right] = [seen, plain].map(|seen| ranges(&seen.packets(4_100, 5_900).0));
    assert!(right.len() > 1_000);
    assert_eq!(wrong.len(), right.len());
    let mut pairs = wrong.iter().zip(&right);
    assert!(pairs.all(|(wrong, right)| (2 * i32::from(*wrong) - 3 * i32::from(*right)).abs() <= 1));
}

/// The supply holds 300 rpm, a packet in 90ths of 200 ms.
fn the_head_is_slow(seen: &Seen, plain: &Seen) {
    let rate = |seen: &Seen| seen.packets(5_000, 6_000).0.len();
    assert!((440..=460).contains(&rate(plain)), "{}", rate(plain));
    assert!(rate(seen) < 400, "{}", rate(seen));
}

fn all_comes_50_ms_late(seen: &Seen, plain: &Seen) {
    let by = Duration::from_millis(50);
    let sent = Instant::from_secs(4)..Instant::from_millis(5_940);
    let on_time = plain.links[LIDAR]
        .iter()
        .filter(|(at, _)| sent.contains(at))
        .skip(1);
    let late: Stream = on_time
        .map(|(at, bytes)| (*at + by, bytes.clone()))
        .collect();
    assert!(late.len() > 100);
    let first = seen.links[LIDAR].iter().position(|found| *found == late[0]);
    let first = first.expect("it comes late");
    assert_eq!(seen.links[LIDAR][first..first + late.len()], late);
}

fn nothing_is_seen(seen: &Seen, plain: &Seen) {
    let count = |seen: &Seen| ranges(&seen.packets(4_300, 5_900).0).len();
    assert!(count(plain) > 1_000);
    assert_eq!(count(seen), 0);
    assert!(seen.packets(4_300, 5_900).0.len() > 600);
}

fn check(kind: FaultKind, plain: &Seen) {
    let Some((keys, holds)) = row(kind) else {
        assert_eq!(kind.place(), FaultPlace::Line, "{} has no row", kind.name());
        return;
    };
    let seen = fault(kind, keys, WHEN);
    holds(&seen, plain);
    if kind != FaultKind::PowerDip {
        assert_eq!(seen.links[1..], plain.links[1..], "{}", kind.name());
    }
    let timeless: Vec<&str> = keys.lines().filter(|key| !key.contains("\"1s\"")).collect();
    let timeless = timeless
        .into_iter()
        .filter(|key| !key.starts_with("lasting"));
    let timeless: String = timeless.map(|key| format!("{key}\n")).collect();
    let never = "every = \"1s\"\nlasting = \"1s\"\ncount = 0\n";
    assert_eq!(fault(kind, &timeless, never).links, plain.links);
    assert_eq!(fault(kind, keys, WHEN), seen, "{} twice", kind.name());
    let case = seen.case.as_ref().expect("saved").to_toml();
    let case = Scenario::parse(Path::new("case.toml"), case)
        .expect("sound")
        .0;
    let again = observe(case);
    assert_eq!(again.links, seen.links, "{} again", kind.name());
}

/// A fault of one device acts only on that device, and only in its time window.
#[test]
fn each_fault_of_a_device_is_seen_in_what_it_sends_and_in_nothing_else() {
    let plain = with("");
    FaultKind::ALL.iter().for_each(|&kind| check(kind, &plain));
}

/// Stuck encoders count nothing for two seconds, although the robot drives; with swapped wires they
/// count down. The low battery has 9900 mV, 26AC hex.
#[test]
fn the_base_believes_its_encoders_and_its_battery() {
    let gained = |seen: &Seen, from, until| seen.left_count(until) - seen.left_count(from);
    let base = |kind, keys: &str| fault(kind, &format!("device = \"base\"\n{keys}"), WHEN);
    let plain = with("");
    assert!(gained(&plain, 4_100, 6_000) > 100);
    let stuck = base(FaultKind::Stuck, "");
    assert_eq!(gained(&stuck, 4_100, 6_000), 0);
    let wrong = base(FaultKind::Wrong, "");
    assert!(gained(&wrong, 4_100, 6_000) < -100);
    assert_eq!(stuck.left_count(4_000), plain.left_count(4_000));
    assert!(gained(&stuck, 6_100, 9_000) > 100 && gained(&wrong, 6_100, 9_000) > 100);

    let low = base(FaultKind::Device, "fault = \"battery-low\"\n");
    assert_eq!(low.battery(4_000), plain.battery(4_000));
    assert_eq!(low.battery(5_900), 0x26);
    assert_eq!(low.battery(9_900), plain.battery(9_900));
}

/// The effect of two simultaneous faults on a device ends with the second: off from 4 to 6 s and
/// from 5 to 7 s is off from 4 to 7 s.
#[test]
fn a_device_is_off_until_the_last_reason_is_gone() {
    let off = "[[fault]]\nkind = \"off\"\ndevice = \"lidar\"\n";
    let seen = with(&format!("{off}{WHEN}{off}from = \"5s\"\nuntil = \"7s\"\n"));
    assert!(seen.is_silent(LIDAR, 4_010, 7_000));
    assert!(greets(&seen.bytes(LIDAR, 7_000, 8_000)));
}
