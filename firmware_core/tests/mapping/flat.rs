//! The furnished flat of the demo: two rooms inside 3 m x 3 m, eight way-points, 40 s.

use core::f64::consts::FRAC_PI_2;

use firmware_core::slam::{Keyframes, Settings};

use crate::measure::{Run, overlap};
use crate::world::{FLAT_TOUR, World, flat};

fn toured(seed: u64, settings: Settings) -> Run {
    let world = World::new(flat(), [1000.0, 1000.0, FRAC_PI_2], seed);
    let mut run: Run = Run::new(world, Settings { seed, ..settings });
    run.tour(&FLAT_TOUR);
    run
}

/// Acceptance A2 requires 30 mm and 2 deg as a median. The core must keep one cell and 0.6 deg in
/// every run, with one odometry reading per turn, as on the rescue robot.
#[test]
fn the_flat_is_mapped_to_a_cell_in_every_run() {
    for seed in 1..=5 {
        let run = toured(seed, Settings::default());
        let (right, found) = overlap(run.mapper.grid(), &run.world.walls, &FLAT_TOUR);
        let errors = run.errors;
        assert!(
            errors.rms_mm() <= 10.0 && errors.rms_deg() <= 0.6,
            "seed {seed}: {errors:?}"
        );
        assert!(
            right >= 0.95 && found >= 0.75,
            "seed {seed}: {right} {found}"
        );
    }
}

/// The document's own search and constants, without defects: within the limits of A2.
#[test]
fn the_documents_constants_map_the_flat_within_30_mm() {
    for seed in 1..=3 {
        let errors = toured(seed, Settings::document()).errors;
        assert!(
            errors.rms_mm() <= 30.0 && errors.rms_deg() <= 2.0,
            "seed {seed}: {errors:?}"
        );
    }
}

#[test]
fn equal_runs_draw_equal_maps_and_other_seeds_others() {
    let cells = |seed| *toured(seed, Settings::default()).mapper.grid().rows();
    let first = cells(1);
    assert!(first == cells(1));
    assert!(first != cells(2));
}

/// The flat's tour at a tenth of the speed: 4 mm of path per scan.
fn crawled(keyframes: Keyframes) -> Run {
    let settings = Settings {
        keyframes,
        ..Settings::default()
    };
    let world = World::new(flat(), [1000.0, 1000.0, FRAC_PI_2], 1);
    let mut run: Run = Run::new(world, settings);
    run.steps(10);
    for point in FLAT_TOUR {
        while !run.world.steer_to(point) {
            run.world.command = run.world.command.map(|ticks| ticks * 0.1);
            run.step();
        }
    }
    run
}

/// Small errors of 2000 scans add up, unless only scans with new information are drawn. Measured:
/// an error of 15.4 mm and walls twice as thick if all scans are drawn, and 5.6 mm otherwise.
#[test]
fn many_scans_of_the_same_do_not_smear_the_map() {
    let sparse = crawled(Keyframes::SPARSE);
    assert!(sparse.errors.rms_mm() <= 8.0, "{:?}", sparse.errors);
    let (right, found) = overlap(sparse.mapper.grid(), &sparse.world.walls, &FLAT_TOUR);
    assert!(right >= 0.98 && found >= 0.85, "{right} {found}");
    let all = crawled(Keyframes::ALL);
    assert!(all.errors.rms_mm() > 12.0, "{:?}", all.errors);
}

/// A resting robot draws every fourth scan and keeps its pose.
#[test]
fn a_robot_that_stands_for_minutes_draws_few_scans_and_stays() {
    let world = World::new(flat(), [1000.0, 1000.0, FRAC_PI_2], 3);
    let mut run: Run = Run::new(world, Settings::default());
    run.steps(1000);
    let off = run.world.truth().change_to(run.pose());
    assert!(off.distance_mm() < 5.0 && off.turn.abs() < 0.005, "{off:?}");
    assert!(run.mapper.scans() < 300, "{}", run.mapper.scans());
}
