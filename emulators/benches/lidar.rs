//! What does a lidar cost? A simulated second of 1800 beams in a furnished flat, with all ray
//! casts, should take at most 0.25 ms, so that the whole rig can run at a thousand times real time.

#[path = "floor/flat.rs"]
pub mod flat;

use core::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use emulators::Device;
use emulators::world::{BodyConfig, Pose, Scene, World};
use emulators::xv11::{Config, Xv11};
use protocols::Instant;

/// A turn at 300 rpm.
const TURN_NANOS: u64 = 200_000_000;

fn lidar(c: &mut Criterion) {
    let scene = Scene::new(flat::furnished_flat(), vec![]).expect("the shapes are sound");
    let body = BodyConfig {
        radius_m: 0.10,
        ..BodyConfig::default()
    };
    let mut world = World::new(scene, body, Pose::new(1.2, 1.6, 0.3), 1).expect("free");
    let mut lidar = Xv11::new("lidar", 1, Config::default());
    let mut buf = [0; 1024];
    let mut until = Instant::from_secs(2);
    let mut run = |until: Instant| {
        while let Some(at) = lidar.poll_at().filter(|&at| at < until) {
            lidar.poll(at, &mut world);
            black_box(lidar.transmit(Xv11::UART, &mut buf));
        }
    };
    run(until);
    let mut group = c.benchmark_group("xv11");
    group.throughput(Throughput::Elements(360));
    group.bench_function("one turn, 200 ms simulated", |b| {
        b.iter(|| {
            until = Instant::from_nanos(until.as_nanos() + TURN_NANOS);
            run(until);
        });
    });
    group.finish();
}

criterion_group!(benches, lidar);
criterion_main!(benches);
