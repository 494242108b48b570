//! Does a simulated second of physics cost at most 0.1 ms, on a free floor and along a wall?
//!
//! A whole rig at 1,000 times real time has 1 ms for that second.

#[path = "floor/flat.rs"]
pub mod flat;

use core::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use emulators::world::{BodyConfig, Drive, Pose, Scene, Wheel, World};
use protocols::Instant;

fn a_second_of_driving(c: &mut Criterion) {
    let mut group = c.benchmark_group("simulated second");
    for (name, start, left, right) in [
        ("resting", Pose::new(0.8, 1.6, 0.0), 0, 0),
        ("driving circles", Pose::new(0.8, 1.6, 0.0), 180, 255),
        (
            "along a wall",
            Pose::new(0.162, 2.4, -core::f64::consts::FRAC_PI_2),
            160,
            160,
        ),
        (
            "leaning on a wall",
            Pose::new(0.17, 2.2, core::f64::consts::PI),
            255,
            255,
        ),
    ] {
        let scene = Scene::new(flat::furnished_flat(), vec![]).expect("the flat is sound");
        let config = BodyConfig {
            radius_m: 0.12,
            ..BodyConfig::default()
        };
        let mut world = World::new(scene, config, start, 1).expect("the start is free");
        world.set_drive(Wheel::Left, Drive::Power(left));
        world.set_drive(Wheel::Right, Drive::Power(right));
        world.advance(Instant::from_millis(500));
        group.bench_function(name, |b| {
            b.iter_batched(
                || world.clone(),
                |mut world| {
                    world.advance(Instant::from_millis(1_500));
                    black_box(world.pose());
                    world
                },
                BatchSize::LargeInput,
            );
        });
    }
    group.finish();
}

criterion_group!(benches, a_second_of_driving);
criterion_main!(benches);
