//! How fast is a described device compared with a built-in one? Two measurements: the decoder of an
//! XV-11, and a slave with registers that is read repeatedly. And: how long does it take to load a
//! description?
//!
//! Input: ten turns of a lidar from our encoder; a request for ten bytes of registers, 1000 times.
//! Units: decimal MB/s of wire bytes, requests per second, milliseconds per file.

use core::hint::black_box;
use core::time::Duration;
use std::path::Path;
use std::sync::Arc;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use emulators::device::{Device, next_poll};
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use hilrig::description::{Described, Description, Place, shipped};
use hilrig::scenario::Scenario;
use protocols::xv11::{self, RawReading, Reading, SpeedWord};
use protocols::{Decode, Instant, Port};

/// Number of bytes per call: a usual delivery of a link.
const PIECE: usize = 64;
/// Requests of one measurement.
const REQUESTS: u64 = 1_000;

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

/// The same slave, built in.
const BUILT_IN: &str = r#"
schema = 1
name = "slave"
robot = "none"
duration = "60s"

[device.slave.registers]
baud = 115200
register = [
  { address = 0, name = "uptime", width = "u32", source = { counter = "1ms" } },
  { address = 4, name = "left", width = "i16", access = "write" },
  { address = 6, name = "right", width = "i16", access = "write" },
  { address = 8, name = "more", width = "u16", initial = 513 },
]
"#;

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

fn decoders(c: &mut Criterion) {
    let stream = packets();
    let described = parse(XV11);
    assert_eq!(count(described.cutter(), &stream), 900);
    let mut group = c.benchmark_group("xv11 decoder");
    group.throughput(Throughput::Bytes(stream.len() as u64));
    group.bench_function("built-in", |b| {
        b.iter(|| count(xv11::Decoder::default(), black_box(&stream)));
    });
    group.bench_function("described", |b| {
        b.iter(|| count(described.cutter(), black_box(&stream)));
    });
    group.finish();
}

/// Sends requests to a slave and takes its replies; returns the number of received bytes.
fn asked(device: &mut dyn Device, world: &mut World) -> usize {
    let request = [0xAB, 0, 10, 0xB5, 0];
    let (mut now, mut bytes) = (Instant::ZERO, 0);
    for _ in 0..REQUESTS {
        now += Duration::from_millis(2);
        device.receive(Port(0), now, &request);
        let end = now + Duration::from_millis(1);
        while now < end {
            now = next_poll(device, now, end);
            device.poll(now, world);
            let mut buf = [0; 64];
            bytes += device.transmit(Port(0), &mut buf);
        }
    }
    bytes
}

fn slaves(c: &mut Criterion) {
    let scene = Scene::new::<Shape>([], vec![]).expect("nothing");
    let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free");
    let (scenario, source) =
        Scenario::parse(Path::new("bench"), BUILT_IN.to_owned()).expect("sound");
    let built_in = || {
        scenario.device["slave"]
            .build("slave", 1, &source)
            .expect("sound")
            .device
    };
    let place = Place {
        name: "slave".to_owned(),
        seed: 1,
        address: None,
        is_alone: true,
    };
    let described = parse(SLAVE);
    let described = || Described::new(described.clone(), place.clone());
    let bytes = 15 * usize::try_from(REQUESTS).expect("few");
    assert_eq!(asked(&mut *built_in(), &mut world.clone()), bytes);
    assert_eq!(asked(&mut described(), &mut world.clone()), bytes);
    let mut group = c.benchmark_group("register slave");
    group.throughput(Throughput::Elements(REQUESTS));
    group.bench_function("built-in", |b| {
        b.iter(|| asked(&mut *built_in(), &mut world.clone()));
    });
    group.bench_function("described", |b| {
        b.iter(|| asked(&mut described(), &mut world.clone()));
    });
    group.finish();
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
