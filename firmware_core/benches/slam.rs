//! What does a scan cost the mapper? One evaluation, one search, one map update, in both modes, on
//! a scan of the furnished flat after its tour. Figures to beat: the seed's own code 520 ns for 36
//! points and 61.9 us for 360 rays; another tinySLAM 123 to 203 ns and 140 us (x86-64).

#![expect(
    clippy::cast_possible_truncation,
    reason = "the figures of a small world are small"
)]

use core::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use firmware_core::scan::Scan;
use firmware_core::slam::{Budget, Mapper, Search, Settings};

use measure::Run;
use world::{FLAT_TOUR, World, flat};

#[expect(dead_code, reason = "shared with the stories")]
#[path = "../tests/mapping/measure.rs"]
mod measure;
#[path = "../tests/mapping/world.rs"]
mod world;

/// A mapper that has seen the flat, and one more scan from where it stands.
fn toured(settings: Settings) -> (Box<Mapper>, Scan) {
    let start = [1000.0, 1000.0, core::f64::consts::FRAC_PI_2];
    let mut run: Run = Run::new(World::new(flat(), start, 1), settings);
    run.tour(&FLAT_TOUR);
    run.stop();
    run.world.turn();
    let scan = run.world.scan();
    (run.mapper, scan)
}

fn document(criterion: &mut Criterion) {
    // The time of a search is linear in its tries, so that of 1001 is a thousand evaluations.
    let budget = Budget {
        start: 1000,
        ..Budget::DOCUMENT
    };
    for points in [36, 360] {
        let search = Search {
            points,
            ..Settings::document().search
        };
        let (mapper, scan) = toured(Settings {
            budget,
            search,
            ..Settings::document()
        });
        let mut mapper = with_tries(*mapper);
        criterion.bench_function(
            &format!("document: 1000 tries of {points} points"),
            |bench| {
                let pose = mapper.pose();
                bench.iter(|| {
                    mapper.set_pose(pose);
                    black_box(mapper.locate(black_box(&scan)))
                });
            },
        );
    }
    let (mut mapper, scan) = toured(Settings::document());
    criterion.bench_function("document: map update of a scan", |bench| {
        bench.iter(|| mapper.draw(black_box(&scan), [0, 0]));
    });
}

/// The regulator brought to 1000 tries.
fn with_tries(mut mapper: Mapper) -> Mapper {
    while mapper.tries() < 1000 {
        mapper.search_time(core::time::Duration::ZERO);
    }
    mapper
}

fn core_mode(criterion: &mut Criterion) {
    let (mut mapper, scan) = toured(Settings::default());
    let pose = mapper.pose();
    let poses = mapper.locate(&scan).poses;
    criterion.bench_function(
        &format!("core: search of {poses} poses and refinement"),
        |bench| {
            bench.iter(|| {
                mapper.set_pose(pose);
                black_box(mapper.locate(black_box(&scan)))
            });
        },
    );
    criterion.bench_function("core: map update of a scan", |bench| {
        bench.iter(|| mapper.draw(black_box(&scan), [0, 0]));
    });
}

/// The widest search that a window holds, as a robot asks for whose wheels were silent: 180 points,
/// 12 cells of 35 mm and 12 degrees to each side, 30,625 poses; goal 0.25 ms. The elements of the
/// throughput are look-ups, of which one may take 0.04 ns; refinement and the choice of the best
/// are in these figures.
fn exhaustive(criterion: &mut Criterion) {
    let search = Search {
        points: 180,
        ..Settings::default().search
    };
    let (mut mapper, scan) = toured(Settings {
        search,
        resolution_mm: 35.0,
        ..Settings::core(35.0)
    });
    let pose = mapper.pose();
    let mut look = || {
        mapper.set_pose(pose);
        mapper.doubt(120.0, 4.5_f32.to_radians());
        black_box(mapper.locate(black_box(&scan)))
    };
    let poses = look().poses;
    let mut group = criterion.benchmark_group("core");
    group.throughput(Throughput::Elements(u64::from(poses) * 180));
    group.bench_function(
        format!("exhaustive search of {poses} poses, 180 points (goal 0.25 ms for 26000)"),
        |bench| bench.iter(&mut look),
    );
    group.finish();
}

criterion_group!(benches, document, core_mode, exhaustive);
criterion_main!(benches);
