//! How many cases a second does one core try, without a sanitizer? A case is judged, not only
//! decoded: every law of the wire, or every checker of a run.
//!
//! Criterion prints the rate in "elements": cases per second. One thread.

use core::hint::black_box;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use hilrig::fuzz::wire::{Avr, Pcui, Xv11};
use hilrig::fuzz::wire::{LowFirst, Stream, Target, Wire};
use hilrig::run::Run;
use hilrig::scenario::{Scenario, Span};

/// What a fuzzer gives: the same numbers every time.
fn numbers(count: usize) -> Vec<u8> {
    let mut rng = emulators::rng::Rng::stream(1, "bench");
    let words = (0..count.div_ceil(8)).flat_map(|_| rng.next_u64().to_le_bytes());
    words.take(count).collect()
}

fn target(name: &str) -> &'static Target {
    Target::named(name).expect("listed")
}

/// One packet, valid or with one bit wrong.
fn packets(criterion: &mut Criterion) {
    let data = numbers(20);
    let valid = [&[0, 0][..], &data[..18]].concat();
    let damaged = [&valid[..], &[13, 5, 3]].concat();
    let target = target("xv11");
    let mut group = criterion.benchmark_group("fuzz");
    group.throughput(Throughput::Elements(1));
    for (name, data) in [
        ("one xv11 packet", valid),
        ("one damaged xv11 packet", damaged),
    ] {
        group.bench_function(name, |bencher| {
            bencher.iter(|| target.fuzz(black_box(&data)));
        });
    }
    group.finish();
}

/// 64 frames, each followed by nothing, so that all of them are there.
fn sessions(criterion: &mut Criterion) {
    fn session<W: Wire>(frame: usize) -> Vec<u8> {
        let numbers = numbers(64 * frame);
        let mut data = vec![0];
        for choices in numbers.chunks(frame) {
            data.push(0);
            data.extend(choices);
        }
        let frames = Stream::session::<W>(&data);
        assert!(frames.bytes().len() >= 64 * 5, "{}", frames.bytes().len());
        data
    }
    let mut group = criterion.benchmark_group("fuzz");
    group.throughput(Throughput::Elements(1));
    for (name, data) in [
        ("xv11", session::<Xv11>(19)),
        ("avr-low-first", session::<Avr<LowFirst>>(12)),
        ("pcui", session::<Pcui>(20)),
    ] {
        let target = target(name);
        group.bench_function(format!("64 frames of {name}"), |bencher| {
            bencher.iter(|| target.fuzz(black_box(&data)));
        });
    }
    group.finish();
}

/// Five seconds of the whole rescue robot in the empty room: world, lidar, base, radio, PC,
/// mapping, all checkers.
fn scenarios(criterion: &mut Criterion) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/empty-room.toml");
    let (mut scenario, source) = Scenario::read(&path).expect("shipped");
    scenario.duration = Span::from_millis(5000);
    let mut group = criterion.benchmark_group("fuzz");
    group.throughput(Throughput::Elements(1));
    group.sample_size(10);
    group.bench_function("5 seconds of a scenario", |bencher| {
        bencher.iter(|| {
            let run = Run::new(scenario.clone(), &source, None).expect("can be wired");
            black_box(run.finish().violations)
        });
    });
    group.finish();
}

criterion_group!(benches, packets, sessions, scenarios);
criterion_main!(benches);
