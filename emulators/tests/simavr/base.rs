//! Random sequences of requests to the emulated AVR base and to the fielded firmware in simavr.
//!
//! `tests/avr_base/run.sh` builds firmware and harness, and passes their folder. `HILRIG_SEQUENCES`
//! is the number of sequences, `HILRIG_SEED` chooses them. Chip and emulation begin each sequence
//! in the state after one second at rest. A sequence is alike if both send the same bytes, whatever
//! their times.
//!
//! While the processor is busy, a shift of some microseconds decides which bytes it takes. Such
//! sequences are compared with the chip's own: the same bytes, 5 to 18 us later.

use core::fmt::Write as _;
use core::time::Duration;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use emulators::avr_base::{AvrBase, AvrBaseConfig, BatteryConfig, Profile, StartCause};
use emulators::device::Device as _;
use emulators::rng::Rng;
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::Instant;
use protocols::avr::{ChecksumOrder, Frame};

/// Clock cycles of the chip in a microsecond.
const CYCLES_PER_US: u64 = 16;
/// Cycles of a byte at 1 Mbaud.
const BYTE: u64 = 10 * CYCLES_PER_US;
/// All sequences begin behind the first second, within a cycle of all tasks (200.8 ms).
const FIRST: u64 = 1_000_000 * CYCLES_PER_US;
const CYCLE: u64 = 200_800 * CYCLES_PER_US;
/// Time for the last answer.
const SETTLE: u64 = 8_000 * CYCLES_PER_US;
/// First interrupt of the timer after the chip's start: at 4,090.9 us in build b77a6df, at 4,093.5
/// us in build 5f54f4d, after the first readings of the converter.
const START: Instant = Instant::from_micros(4_091);

/// Kinds of sequences, with the required share of alike ones in percent. `None`: the chip's share
/// with itself, less three.
const KINDS: [(&str, Option<f64>); 13] = [
    ("clean", Some(99.5)),
    ("wrong checksum", Some(99.5)),
    ("bit flips", Some(99.0)),
    ("extra start bytes", Some(98.5)),
    ("garbage", None),
    ("partial frames", None),
    ("gaps between bytes", None),
    ("registers that the base feeds", None),
    ("reads behind the map", Some(99.5)),
    ("writes behind the map", None),
    ("write of 127", Some(99.0)),
    ("pipelined", None),
    ("back to back", None),
];

/// A byte whose stop bit ends at this cycle.
type Timed = (u64, u8);

struct Sequence {
    kind: usize,
    begin: u64,
    end: u64,
    bytes: Vec<Timed>,
}

/// Writes frames to a wire.
struct Wire {
    at: u64,
    bytes: Vec<Timed>,
}

impl Wire {
    fn send(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.at += BYTE;
            self.bytes.push((self.at, byte));
        }
    }

    fn wait_us(&mut self, us: u64) {
        self.at += us * CYCLES_PER_US;
    }
}

fn read(register: u8, count: u8) -> Vec<u8> {
    let frame = Frame::read(register, count, ChecksumOrder::HighFirst);
    frame.as_bytes().to_vec()
}

fn write(register: u8, data: &[u8]) -> Vec<u8> {
    let frame = Frame::write(register, data, ChecksumOrder::HighFirst);
    frame.as_bytes().to_vec()
}

fn byte(rng: &mut Rng) -> u8 {
    rng.next_u64().to_le_bytes()[7]
}

fn below(rng: &mut Rng, n: u8) -> u8 {
    u8::try_from(rng.below(u64::from(n))).expect("below a byte")
}

fn data(rng: &mut Rng, len: u8) -> Vec<u8> {
    (0..len).map(|_| byte(rng)).collect()
}

/// A valid request within the map that leaves speeds and registers of the base alone, or sets them.
fn request(rng: &mut Rng) -> Vec<u8> {
    if rng.below(2) == 0 {
        let register = below(rng, 53);
        let count = below(rng, 54 - register);
        return read(register, count);
    }
    let register = 46 + below(rng, 7);
    let len = below(rng, 54 - register);
    let data = data(rng, len);
    write(register, &data)
}

/// One sequence of `kind`.
fn sequence(kind: usize, rng: &mut Rng) -> Sequence {
    let begin = FIRST + rng.below(CYCLE);
    let mut wire = Wire {
        at: begin,
        bytes: Vec::new(),
    };
    let pause = |rng: &mut Rng| 3_000 + rng.below(3_000);
    match KINDS[kind].0 {
        "clean" => {
            for _ in 0..3 {
                wire.send(&request(rng));
                wire.wait_us(pause(rng));
            }
        }
        "wrong checksum" => {
            let mut frame = request(rng);
            let at = frame.len() - 1 - usize::from(below(rng, 2));
            frame[at] = frame[at].wrapping_add(1 + below(rng, 255));
            wire.send(&frame);
            wire.wait_us(pause(rng));
            wire.send(&request(rng));
        }
        "bit flips" => {
            let mut frame = request(rng);
            let bit = usize::try_from(rng.below(8 * frame.len() as u64)).expect("short");
            frame[bit / 8] ^= 1 << (bit % 8);
            wire.send(&frame);
            wire.wait_us(30_000);
            wire.send(&request(rng));
        }
        "extra start bytes" => {
            wire.send(&vec![0xAB; 1 + usize::from(below(rng, 3))]);
            wire.send(&request(rng));
            wire.wait_us(30_000);
            wire.send(&request(rng));
        }
        "garbage" => {
            let len = 1 + below(rng, 40);
            wire.send(&data(rng, len));
            wire.wait_us(pause(rng) * 5);
            wire.send(&request(rng));
        }
        "partial frames" => {
            let frame = request(rng);
            let len = 1 + usize::from(below(rng, 4));
            wire.send(&frame[..len.min(frame.len() - 1)]);
            wire.wait_us(rng.below(30_000));
            wire.send(&request(rng));
        }
        "gaps between bytes" => {
            for one in request(rng) {
                wire.send(&[one]);
                wire.wait_us(rng.below(4_000));
            }
            wire.wait_us(pause(rng));
            wire.send(&request(rng));
        }
        "registers that the base feeds" => {
            let register = below(rng, 46);
            let len = 1 + below(rng, 8).min(52 - register);
            wire.send(&write(register, &data(rng, len)));
            wire.wait_us(pause(rng));
            wire.send(&read(register, len));
        }
        "reads behind the map" => {
            let register = 30 + below(rng, 226);
            let count = 24 + below(rng, 103);
            wire.send(&read(register, count));
            wire.wait_us(pause(rng));
            wire.send(&request(rng));
        }
        "writes behind the map" => {
            let register = 45 + below(rng, 211);
            let len = 1 + below(rng, 60);
            wire.send(&write(register, &data(rng, len)));
            wire.wait_us(pause(rng));
            wire.send(&read(register, len));
            wire.wait_us(pause(rng));
            wire.send(&request(rng));
        }
        "write of 127" => {
            wire.send(&[0xAB, byte(rng), 0xFF]);
            wire.send(&data(rng, 96));
            wire.wait_us(40_000);
            wire.send(&request(rng));
        }
        "pipelined" => {
            for _ in 0..4 {
                wire.send(&request(rng));
                wire.wait_us(rng.below(2_250));
            }
        }
        _ => {
            for _ in 0..4 {
                wire.send(&request(rng));
            }
        }
    }
    Sequence {
        kind,
        begin,
        end: wire.at + SETTLE,
        bytes: wire.bytes,
    }
}

/// `count` sequences of all kinds in turn, by their beginnings.
fn sequences(count: usize, seed: u64) -> Vec<Sequence> {
    let mut rng = Rng::stream(seed, "sequences");
    let mut all: Vec<_> = (0..count)
        .map(|n| sequence(n % KINDS.len(), &mut rng))
        .collect();
    all.sort_by_key(|sequence| sequence.begin);
    all
}

/// Answers of the chip; `None` if it crashed. `shift` moves the bytes of each sequence.
fn chip(
    folder: &Path,
    build: &str,
    all: &[Sequence],
    shift: impl Fn(usize) -> u64,
) -> Vec<Option<Vec<u8>>> {
    let mut child = Command::new(folder.join("chip"))
        .arg(folder.join(format!("{build}.elf")))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("tests/avr_base/run.sh has built it");
    let mut lines = String::new();
    for (n, sequence) in all.iter().enumerate() {
        write!(lines, "{} {}", sequence.begin, sequence.end).expect("a string");
        for (at, byte) in &sequence.bytes {
            write!(lines, " {} {byte}", at + shift(n)).expect("a string");
        }
        lines.push('\n');
    }
    let mut input = child.stdin.take().expect("piped");
    let writer = std::thread::spawn(move || input.write_all(lines.as_bytes()));
    let output = BufReader::new(child.stdout.take().expect("piped"));
    let answers = output
        .lines()
        .map(|line| {
            let line = line.expect("text");
            if line.ends_with('!') {
                return None;
            }
            let words = line.split_whitespace().skip(1).step_by(2);
            Some(words.map(|word| word.parse().expect("a byte")).collect())
        })
        .collect();
    writer.join().expect("it wrote").expect("the chip reads");
    assert!(child.wait().expect("started").success(), "the chip failed");
    answers
}

fn at(cycle: u64) -> Instant {
    Instant::ZERO + Duration::from_nanos(cycle * 1_000 / CYCLES_PER_US)
}

struct Bench {
    base: AvrBase,
    world: World,
    sent: Vec<u8>,
}

impl Bench {
    fn run_to(&mut self, end: Instant) {
        while let Some(due) = self.base.poll_at().filter(|due| *due <= end) {
            self.poll(due);
        }
        self.poll(end);
    }

    /// The world stands still, as the simulated chip's encoders do.
    fn poll(&mut self, now: Instant) {
        self.base.poll(now, &mut self.world);
        let mut buf = [0; 256];
        let len = self.base.transmit(AvrBase::BUS, &mut buf);
        self.sent.extend_from_slice(&buf[..len]);
    }
}

/// Answers of the emulation.
fn emulated(profile: Profile, all: &[Sequence]) -> Vec<Option<Vec<u8>>> {
    let config = AvrBaseConfig {
        profile,
        battery: BatteryConfig {
            drop_mv_per_s: 0.0,
            ..BatteryConfig::default()
        },
        ..AvrBaseConfig::default()
    };
    let scene = Scene::new::<Shape>([], vec![]).expect("empty");
    let body = BodyConfig::default().ideal();
    let world = World::new(scene, body, Pose::default(), 1).expect("free");
    let mut parent = Bench {
        base: AvrBase::new(config, 7),
        world,
        sent: Vec::new(),
    };
    parent.base.reset(START, StartCause::PowerOn);
    all.iter()
        .map(|sequence| {
            parent.run_to(at(sequence.begin));
            let mut child = Bench {
                base: parent.base.clone(),
                world: parent.world.clone(),
                sent: Vec::new(),
            };
            for &(cycle, byte) in &sequence.bytes {
                child.run_to(at(cycle));
                child.base.receive(AvrBase::BUS, at(cycle), &[byte]);
                child.poll(at(cycle));
            }
            child.run_to(at(sequence.end));
            let events = child.base.take_events();
            let is_crashed = events.iter().any(|event| event.rule == "crashed");
            (!is_crashed).then_some(child.sent)
        })
        .collect()
}

/// Whether the simulator has ended a sequence at an address outside of the chip's memory, because a
/// write has moved the pointer to the data. A real chip has no such trap: that is not judged.
fn is_trapped(sequence: &Sequence, chip: Option<&Vec<u8>>) -> bool {
    KINDS[sequence.kind].0 == "writes behind the map" && chip.is_none()
}

/// Share of alike answers of each kind, percent. `chip` and `other` have an answer for each
/// sequence.
fn alike(all: &[Sequence], chip: &[Option<Vec<u8>>], other: &[Option<Vec<u8>>]) -> Vec<f64> {
    let (a, b) = (chip, other);
    let share = |kind| {
        let rows = (0..all.len()).filter(|n| all[*n].kind == kind);
        let rows = rows.filter(|n| !is_trapped(&all[*n], chip[*n].as_ref()));
        let same = rows.clone().filter(|n| a[*n] == b[*n]).count();
        100.0 * same as f64 / rows.count().max(1) as f64
    };
    (0..KINDS.len()).map(share).collect()
}

/// Bytes of answers to reads behind the map, and those of them that are alike: of the first answer,
/// if both have the same length.
fn memory(all: &[Sequence], a: &[Option<Vec<u8>>], b: &[Option<Vec<u8>>]) -> f64 {
    let (mut bytes, mut same) = (0_usize, 0_usize);
    for (n, sequence) in all.iter().enumerate() {
        let (Some(a), Some(b)) = (&a[n], &b[n]) else {
            continue;
        };
        if KINDS[sequence.kind].0 == "reads behind the map" && a.len() == b.len() {
            bytes += a.len();
            same += a.iter().zip(b).filter(|(a, b)| a == b).count();
        }
    }
    100.0 * same as f64 / bytes.max(1) as f64
}

/// Prints sequences of a kind that differ: where the emulation has to be mended.
fn show(all: &[Sequence], chip: &[Option<Vec<u8>>], ours: &[Option<Vec<u8>>], kind: &str) {
    let hex = |bytes: &[u8]| -> String {
        bytes.iter().fold(String::new(), |mut text, byte| {
            write!(text, "{byte:02X} ").expect("a string");
            text
        })
    };
    let differ = (0..all.len()).filter(|n| KINDS[all[*n].kind].0 == kind && chip[*n] != ours[*n]);
    let differ = differ.filter(|n| !is_trapped(&all[*n], chip[*n].as_ref()));
    for n in differ.take(12) {
        let sent: Vec<u8> = all[n].bytes.iter().map(|(_, byte)| *byte).collect();
        eprintln!("  sent {}at {}", hex(&sent), all[n].begin / CYCLES_PER_US);
        for (name, answers) in [("chip", chip), ("ours", ours)] {
            let words = answers[n].as_ref().map_or("crashed".to_owned(), |a| hex(a));
            eprintln!("  {name} {words}");
        }
    }
}

fn judge(folder: &Path, build: &str, profile: Profile, count: usize, seed: u64) -> Vec<String> {
    let all = sequences(count, seed);
    let real = chip(folder, build, &all, |_| 0);
    let mut rng = Rng::stream(seed, "shifts");
    let shifts: Vec<u64> = all
        .iter()
        .map(|_| (5 + rng.below(14)) * CYCLES_PER_US)
        .collect();
    let shifted = chip(folder, build, &all, |n| shifts[n]);
    let ours = emulated(profile, &all);
    let [alike_ours, alike_self] = [&ours, &shifted].map(|other| alike(&all, &real, other));
    let mut wrong = Vec::new();
    println!("{build}, {count} sequences: alike in percent, emulation and chip, chip and itself");
    for (n, (kind, required)) in KINDS.iter().enumerate() {
        let least = required.unwrap_or(alike_self[n] - 3.0).min(alike_self[n]);
        println!("  {kind:30} {:7.2} {:7.2}", alike_ours[n], alike_self[n]);
        if alike_ours[n] < least {
            wrong.push(format!("{build}: {kind}: {:.2} %", alike_ours[n]));
        }
    }
    let trapped = (0..all.len()).filter(|n| is_trapped(&all[*n], real[*n].as_ref()));
    println!("  not judged, outside of memory  {:7}", trapped.count());
    let bytes = memory(&all, &real, &ours);
    println!("  bytes read behind the map      {bytes:7.2}");
    if bytes < 99.5 {
        wrong.push(format!("{build}: bytes behind the map: {bytes:.2} %"));
    }
    if let Ok(kind) = std::env::var("HILRIG_SHOW") {
        show(&all, &real, &ours, &kind);
    }
    wrong
}

#[test]
fn random_sequences_are_answered_as_by_the_chip() {
    let Some(folder) = std::env::var_os("HILRIG_AVR_BASE").map(PathBuf::from) else {
        crate::skipped("no simulated base, run tests/avr_base/run.sh");
        return;
    };
    let count = std::env::var("HILRIG_SEQUENCES").ok();
    let count = count.map_or(2_600, |count| count.parse().expect("a number of sequences"));
    let seed = std::env::var("HILRIG_SEED").ok();
    let seed = seed.map_or(49, |seed| seed.parse().expect("a number"));
    let wrong = [
        judge(&folder, "b77a6df", Profile::Rcj2015, count, seed),
        judge(&folder, "5f54f4d", Profile::Rcj2014, count / 8, seed),
    ]
    .concat();
    assert!(wrong.is_empty(), "{wrong:#?}");
}
