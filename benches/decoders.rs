//! How many bytes per second does each decoder process? The fastest wire, the register bus, carries
//! 0.1 MB/s, so this determines the codecs' share of a run in virtual time.
//!
//! Input: streams from our encoders, clean and with one byte in 500 damaged, and the "hand in box"
//! capture if it lies beside the repository. Units: decimal MB/s of wire bytes.

use core::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use protocols::avr::{self, ChecksumOrder};
use protocols::pcui::message::{MapProperties, encode_map_properties, encode_row};
use protocols::xv11::{self, RawReading, Reading, SpeedWord, turn};
use protocols::{Decode, pcui, rle};

#[path = "../tests/support/captures.rs"]
mod captures;

/// Number of bytes per call: a usual delivery of a link.
const PIECE: usize = 64;

/// Ten turns of a sensor in a round room.
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

/// The same from the old firmware.
fn turns() -> Vec<u8> {
    let reading = RawReading([0xE8, 0x03, 0xC8, 0x00]);
    turn::Frame::new(0xD194, &[reading; 360])
        .as_bytes()
        .repeat(10)
}

/// Traffic between the robot and its base in 1000 cycles.
fn bus() -> Vec<u8> {
    let order = ChecksumOrder::LowFirst;
    let cycle = [
        avr::Frame::read(36, 10, order),
        avr::Frame::write(36, &[4, 3, 2, 1, 0xFE, 0xFF, 0xFF, 0xFF, 20, 0xEC], order),
        avr::Frame::write(46, &[20, 0xEC, 0], order),
        avr::Frame::read(46, 0, order),
    ];
    let cycle: Vec<u8> = cycle
        .iter()
        .flat_map(|frame| frame.as_bytes().to_vec())
        .collect();
    cycle.repeat(1000)
}

/// A map of 300 rows, half of them plain, and a pose before each row.
fn map() -> Vec<u8> {
    let pose = MapProperties {
        resolution_mm: 10,
        size_mm: [3000, 3000],
        layers: 1,
        position_mm: [1000, 1000],
        layer: 0,
        psi_deg: 90,
    };
    let mut bytes = Vec::new();
    let mut frame = [0; pcui::FRAME_MAX];
    for y in 0..300_u16 {
        let len = encode_map_properties(&pose, &mut frame).expect("fits");
        bytes.extend(&frame[..len]);
        let run = if y % 2 == 0 { 1 } else { 40 };
        let pixels: [u8; 300] = core::array::from_fn(|x| if x / run % 2 == 0 { 127 } else { 0 });
        let dialect = rle::Dialect::Lossless;
        let len = encode_row(0, y, &pixels, dialect, &mut frame).expect("fits");
        bytes.extend(&frame[..len]);
    }
    bytes
}

/// One byte in 500 has a wrong bit, the same ones in each run.
fn damaged(mut bytes: Vec<u8>) -> Vec<u8> {
    for at in (250..bytes.len()).step_by(500) {
        bytes[at] ^= 1 << (at / 500 % 8);
    }
    bytes
}

fn measure<D: Decode>(criterion: &mut Criterion, name: &str, bytes: &[u8], new: impl Fn() -> D) {
    let mut group = criterion.benchmark_group("decoders");
    group.throughput(Throughput::BytesDecimal(bytes.len() as u64));
    group.bench_function(name, |bencher| {
        bencher.iter(|| {
            let mut decoder = new();
            let pieces = black_box(bytes).chunks(PIECE);
            pieces
                .map(|piece| decoder.push(piece).flatten().count())
                .sum::<usize>()
        });
    });
}

fn decoders(criterion: &mut Criterion) {
    let bus_decoder = || avr::Decoder::new(ChecksumOrder::LowFirst);
    measure(
        criterion,
        "xv11 packets",
        &packets(),
        xv11::Decoder::default,
    );
    measure(
        criterion,
        "xv11 packets, damaged",
        &damaged(packets()),
        xv11::Decoder::default,
    );
    if let Some(bytes) = captures::capture("xv11/xevel_hand_in_box_fw24.bin") {
        measure(
            criterion,
            "xv11 packets, real",
            &bytes,
            xv11::Decoder::default,
        );
    }
    measure(criterion, "xv11 turns", &turns(), turn::Decoder::default);
    measure(criterion, "avr", &bus(), bus_decoder);
    measure(criterion, "avr, damaged", &damaged(bus()), bus_decoder);
    measure(criterion, "pcui", &map(), pcui::Decoder::default);
    measure(
        criterion,
        "pcui, damaged",
        &damaged(map()),
        pcui::Decoder::default,
    );
}

/// The radio's rows, in both directions: the robot's cost of encoding its map, and the PC's cost of
/// decoding it.
fn rows(criterion: &mut Criterion) {
    let pixels: [u8; 300] = core::array::from_fn(|x| if x / 40 % 2 == 0 { 127 } else { 0 });
    let mut code = [0; 600];
    let len = rle::encode(&pixels, rle::Dialect::Lossless, &mut code).expect("fits");
    let mut group = criterion.benchmark_group("rle");
    group.throughput(Throughput::BytesDecimal(pixels.len() as u64));
    group.bench_function("encode", |bencher| {
        let mut out = [0; 600];
        bencher.iter(|| rle::encode(black_box(&pixels), rle::Dialect::Lossless, &mut out));
    });
    group.bench_function("decode", |bencher| {
        let mut row = [0; 300];
        bencher.iter(|| rle::decode(black_box(&code[..len]), &mut row));
    });
}

criterion_group!(benches, decoders, rows);
criterion_main!(benches);
