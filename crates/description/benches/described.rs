//! How fast is a described device compared with a built-in one? Two measurements: the decoder of an
//! XV-11, and a slave with registers that is read repeatedly; it prints both ratios. And: how long
//! does it take to load a description?
//!
//! Input: ten turns of a lidar from our encoder, of which frames are cut and their checksums
//! verified; a request for ten bytes of registers, 1000 times. Before the measurement both sides
//! must give the same bytes.
//! Units: decimal MB/s of wire bytes, requests per second, milliseconds per file.

use core::hint::black_box;
use core::time::Duration;
use std::sync::Arc;

use criterion::measurement::{Measurement as _, WallTime};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use description::{Described, Description, Place, shipped};
use emulators::board::BoardConfig;
use emulators::device::{Device, next_poll};
use emulators::quantity::{ValueSource, Variable};
use emulators::registers::{Access, Register, Registers, RegistersConfig, Width};
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::avr::ChecksumOrder;
use protocols::xv11::{self, RawReading, Reading, SpeedWord};
use protocols::{Decode, Instant, LineConfig, Port};

/// Number of bytes per call: a usual delivery of a link.
const PIECE: usize = 64;
/// Requests of one measurement.
const REQUESTS: u64 = 1_000;
/// Runs of each side of a ratio.
const ROUNDS: usize = 200;

const XV11: &str = r#"
name = "xv11"
about = "Lidar of a robot vacuum cleaner"
endian = "little"
line = { baud = 115200 }
frame = { sync = [0xFA], size = 22, checksum = "xv11" }
every = [{ period = "2.2ms", send = "packet" }]
message = [{ name = "packet", from = "device", fields = [
  { name = "index", type = "u8" },
  { name = "speed", type = "u16", scale = 0.015625, unit = "rpm" },
  { name = "readings", type = "group", repeat = 4, fields = [
    { name = "distance", type = "u16", unit = "mm" },
    { name = "strength", type = "u16" },
  ] },
] }]
"#;

const SLAVE: &str = r#"
name = "slave"
about = "Registers on the bus of an AVR base"
endian = "little"
latency = "200us"
line = { baud = 115200 }
registers = { bytes = [
  { at = 0, name = "uptime", type = "u32", source = { counter = "1ms" } },
  { at = 4, name = "left", type = "i16", access = "write" },
  { at = 6, name = "right", type = "i16", access = "write" },
  { at = 8, name = "more", type = "u16", initial = 513 },
] }

[frame]
sync = [0xAB]
head = 3
size = "5 + (b2 & 0x80 ? b2 & 0x7f : 0)"
checksum = "sum16"

[[message]]
name = "read"
from = "host"
fields = [{ name = "start", type = "u8" }, { type = "b1", value = 0 }, { name = "count", type = "b7" }]

[[message]]
name = "data"
from = "device"
fields = [{ name = "start", type = "u8" }, { type = "b1", value = 1 }, { name = "count", type = "b7" }, { name = "bytes", type = "bytes", size = "count" }]

[[on]]
message = "read"
reply = "data"
with = { bytes = "registers(start, count)" }
"#;

/// A register of the same slave, built in.
fn register(address: u8, name: &str, width: Width, source: ValueSource, initial: i64) -> Register {
    Register {
        address,
        width,
        access: match source {
            ValueSource::Stored => Access::Write,
            _ => Access::Read,
        },
        variable: Variable {
            name: name.to_owned(),
            initial,
            limits: width.limits(),
            safe: None,
            source,
            drives: None,
        },
    }
}

/// The same slave, built in.
fn built_in() -> Registers {
    let uptime = ValueSource::Counter {
        period: Duration::from_millis(1),
    };
    Registers::new(RegistersConfig {
        line: LineConfig::new_8n1(115_200),
        order: ChecksumOrder::LowFirst,
        latency: Duration::from_micros(200),
        idle_gap: Duration::from_millis(2),
        watchdog: None,
        registers: vec![
            register(0, "uptime", Width::U32, uptime, 0),
            register(4, "left", Width::I16, ValueSource::Stored, 0),
            register(6, "right", Width::I16, ValueSource::Stored, 0),
            register(8, "more", Width::U16, ValueSource::Stored, 513),
        ],
        board: BoardConfig::default(),
    })
    .expect("sound")
}

fn parse(text: &str) -> Arc<Description> {
    let nothing = |_: &str| Err(String::new());
    Description::parse("bench", text, &nothing).unwrap_or_else(|error| panic!("{error}"))
}

fn packets() -> Vec<u8> {
    let frames = (0..10).flat_map(|turn| {
        (0..90_u8).map(move |index| {
            let reading = Reading::Range {
                distance_mm: 1000 + 10 * turn + u16::from(index),
                strength: 100,
                weak: false,
            };
            xv11::Frame::new(index, SpeedWord(300 * 64), [RawReading::from(reading); 4])
        })
    });
    frames.flat_map(|frame| *frame.as_bytes()).collect()
}

fn count<D: Decode>(mut decoder: D, stream: &[u8]) -> usize {
    let pieces = stream.chunks(PIECE);
    pieces
        .map(|piece| decoder.push(piece).flatten().count())
        .sum()
}

/// The time of one run.
fn time(run: &mut dyn FnMut() -> usize) -> f64 {
    let clock = WallTime;
    let start = clock.start();
    black_box(run());
    clock.to_f64(&clock.end(start))
}

/// Whether a benchmark of the group `name` runs with the filter of the command line.
fn is_wanted(name: &str) -> bool {
    let mut words = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with('-'));
    words.next().is_none_or(|filter| name.contains(&filter))
}

/// Prints the speed of `described` as a share of that of `built_in`. Both run in turn, and the
/// shortest run of each counts, because other programs only make a run longer.
fn ratio(what: &str, built_in: &mut dyn FnMut() -> usize, described: &mut dyn FnMut() -> usize) {
    if !is_wanted(what) {
        return;
    }
    let mut round = |[one, other]: [f64; 2]| [one.min(time(built_in)), other.min(time(described))];
    let [built_in, described] = (0..ROUNDS).fold([f64::MAX; 2], |best, _| round(best));
    let share = 100.0 * built_in / described;
    println!("{what}: {share:.0} % of the built-in speed");
}

/// The bytes of all frames of a stream.
fn frames<D: Decode>(
    mut decoder: D,
    stream: &[u8],
    bytes: impl Fn(&D::Frame) -> Vec<u8>,
) -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    for piece in stream.chunks(PIECE) {
        frames.extend(decoder.push(piece).flatten().map(|frame| bytes(&frame)));
    }
    frames
}

fn decoders(c: &mut Criterion) {
    let stream = packets();
    let description = parse(XV11);
    let all: Vec<_> = stream.chunks(22).map(<[u8]>::to_vec).collect();
    let built_in = frames(xv11::Decoder::default(), &stream, |frame| {
        frame.as_bytes().to_vec()
    });
    assert_eq!(built_in, all);
    assert_eq!(
        frames(description.cutter(), &stream, |frame| frame.bytes.to_vec()),
        all
    );
    let mut built_in = || count(xv11::Decoder::default(), black_box(&stream));
    let mut described = || count(description.cutter(), black_box(&stream));
    let mut group = c.benchmark_group("xv11 decoder");
    group.throughput(Throughput::Bytes(stream.len() as u64));
    group.bench_function("built-in", |b| b.iter(&mut built_in));
    group.bench_function("described", |b| b.iter(&mut described));
    group.finish();
    ratio("xv11 decoder", &mut built_in, &mut described);
}

/// Sends requests to a slave and gives its replies to `take`.
fn asked(device: &mut dyn Device, world: &mut World, take: &mut dyn FnMut(&[u8])) {
    let request = [0xAB, 0, 10, 0xB5, 0];
    let mut now = Instant::ZERO;
    for _ in 0..REQUESTS {
        now += Duration::from_millis(2);
        device.receive(Port(0), now, &request);
        let end = now + Duration::from_millis(1);
        while now < end {
            now = next_poll(device, now, end);
            device.poll(now, world);
            let mut buf = [0; 64];
            let len = device.transmit(Port(0), &mut buf);
            take(&buf[..len]);
        }
    }
}

fn slaves(c: &mut Criterion) {
    let scene = Scene::new::<Shape>([], vec![]).expect("nothing");
    let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free");
    let place = Place {
        name: "slave".to_owned(),
        seed: 1,
        address: None,
        is_alone: true,
    };
    let description = parse(SLAVE);
    let replies = |device: &mut dyn Device| {
        let mut replies = Vec::new();
        asked(device, &mut world.clone(), &mut |bytes| {
            replies.extend_from_slice(bytes)
        });
        replies
    };
    let of_description = || Described::new(description.clone(), place.clone());
    let all = replies(&mut built_in());
    assert_eq!(all.len() as u64, 15 * REQUESTS);
    assert_eq!(replies(&mut of_description()), all);
    let counted = |device: &mut dyn Device| {
        let mut count = 0;
        asked(device, &mut world.clone(), &mut |bytes| {
            count += bytes.len()
        });
        count
    };
    let mut built_in = || counted(&mut built_in());
    let mut described = || counted(&mut of_description());
    let mut group = c.benchmark_group("register slave");
    group.throughput(Throughput::Elements(REQUESTS));
    group.bench_function("built-in", |b| b.iter(&mut built_in));
    group.bench_function("described", |b| b.iter(&mut described));
    group.finish();
    ratio("register slave", &mut built_in, &mut described);
}

fn loading(c: &mut Criterion) {
    let mut group = c.benchmark_group("load a description");
    for (name, text) in shipped::ALL {
        group.bench_function(*name, |b| b.iter(|| parse(black_box(text))));
    }
    group.finish();
}

criterion_group!(benches, decoders, slaves, loading);
criterion_main!(benches);
