//! How many simulated seconds does one second of computing give? The whole loop of the demo: lidar,
//! base, radio and PC, faults off, checkers on, the robot's program with its mapping; and what does
//! writing the capture add?
//!
//! Criterion prints the rate in "elements": simulated milliseconds per second; divide by 1000 for
//! the factor over real time. One thread.

use std::path::Path;

use core::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use hilrig::capture::{Limits, Recording, about};
use hilrig::run::Run;
use hilrig::scenario::Scenario;

fn flat() -> Run {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/rescue-flat.toml");
    let (scenario, source) = Scenario::read(&path).expect("shipped");
    Run::new(scenario, &source, None).expect("can be wired")
}

fn captured() -> Run {
    let mut run = flat();
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bench.pcapng");
    let about = about(run.scenario());
    let recording = Recording::create(&path, &run.rig, about, Limits::default());
    run.rig
        .add_tap(Box::new(recording.expect("can be written")));
    run
}

fn whole_loop(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("rig");
    let sim = flat().finish().ran;
    group.throughput(Throughput::Elements(
        u64::try_from(sim.as_millis()).expect("a minute"),
    ));
    group.sample_size(10);
    group.measurement_time(Duration::from_secs(5));
    group.bench_function("whole mission", |bencher| bencher.iter(|| flat().finish()));
    group.bench_function("whole mission, captured", |bencher| {
        bencher.iter(|| captured().finish());
    });
    group.finish();
}

criterion_group!(benches, whole_loop);
criterion_main!(benches);
