//! A robot that is pushed or carried away, and rooms with several equal positions: the mapper must
//! correct a pose that the odometry does not show.

use core::f64::consts::{FRAC_PI_2, PI};

use firmware_core::slam::{Certainty, Settings};

use crate::measure::Run;
use crate::world::{Dice, FLAT_TOUR, Wall, World, boxed, flat};

fn toured(settings: Settings) -> Run {
    let world = World::new(flat(), [1000.0, 1000.0, FRAC_PI_2], 7);
    let mut run: Run = Run::new(world, settings);
    run.tour(&FLAT_TOUR);
    run.stop();
    run
}

/// Number of scans until the pose is correct again, within 50 mm and 3 degrees.
fn scans_until_found(run: &mut Run, limit: u32) -> Option<u32> {
    (1..=limit).find(|_| {
        let pose = run.step().pose;
        let off = run.world.truth().change_to(pose);
        off.distance_mm() < 50.0 && off.turn.to_degrees().abs() < 3.0
    })
}

/// Seed figure S3: a resting robot is pushed by 400 mm within a second. With the document's search,
/// its position is correct again after 6 searches of about 1000 tries.
#[test]
fn the_documents_search_finds_a_pushed_robot_within_six_scans() {
    let mut run = toured(Settings::document());
    run.push_by([0.4, 0.0]);
    let found = scans_until_found(&mut run, 6);
    assert!(
        found.is_some(),
        "{:?}",
        run.world.truth().change_to(run.mapper.pose())
    );
    assert!(
        (600..=1300).contains(&run.mapper.tries()),
        "{}",
        run.mapper.tries()
    );
}

/// After the same push, the core follows the robot.
#[test]
fn the_core_finds_a_pushed_robot_within_two_scans() {
    let mut run = toured(Settings::default());
    run.push_by([0.4, 0.0]);
    let found = scans_until_found(&mut run, 2);
    assert!(
        found.is_some(),
        "{:?}",
        run.world.truth().change_to(run.mapper.pose())
    );
}

/// The robot is carried away by 2 m and a quarter turn into the other room. Nothing is drawn in
/// doubt.
#[test]
fn a_kidnapped_robot_is_found_within_five_scans() {
    let mut run = toured(Settings::default());
    let before = *run.mapper.grid().rows();
    let [x, y, heading] = run.world.body;
    run.world.body = [x + 2000.0, y + 200.0, heading + FRAC_PI_2];
    let first = run.step();
    assert_ne!(first.certainty, Certainty::Sure);
    assert!(*run.mapper.grid().rows() == before);
    let found = scans_until_found(&mut run, 4);
    assert!(
        found.is_some(),
        "{:?}",
        run.world.truth().change_to(run.mapper.pose())
    );
}

/// In a bare square room, four poses look equal: the robot reports that its pose is ambiguous.
#[test]
fn a_robot_that_cannot_know_its_place_says_so() {
    let room = boxed(500.0, 500.0, 2500.0, 2500.0).to_vec();
    let mut run: Run = Run::new(
        World::new(room, [900.0, 1000.0, 0.3], 5),
        Settings::default(),
    );
    run.steps(20);
    run.world.body = [1900.0, 2100.0, 0.3 + PI * 0.6];
    let outcomes: [Certainty; 5] = core::array::from_fn(|_| run.step().certainty);
    assert_eq!(outcomes[0], Certainty::Doubtful);
    assert_eq!(outcomes[1..], [Certainty::Ambiguous; 4]);
}

/// Error in millimetres two scans after a push of 400 mm in a bare room, where most beams still
/// fit. The robot has never moved: its map is a comb with gaps between the beams, and the scans
/// during the push are smeared.
fn error_after_push(push: [f64; 2], seed: u64) -> f32 {
    let walls = boxed(300.0, 300.0, 2700.0, 2700.0).to_vec();
    let world = World::new(walls, [1500.0, 1200.0, FRAC_PI_2], seed);
    let mut run: Run = Run::new(world, Settings::default());
    run.steps(50);
    run.push_by(push);
    run.steps(2);
    let truth = run.world.truth();
    truth.position().distance_mm(run.pose().position())
}

/// Pushes along two walls and diagonally. Measured: 9 mm in 79 of 80 runs, 18 mm in one.
#[test]
fn the_core_follows_a_push_in_a_bare_room_in_every_run() {
    for seed in 0..20 {
        let errors = [[0.0, 0.4], [0.3, 0.26]].map(|push| error_after_push(push, seed));
        assert!(
            errors.iter().all(|error| *error < 20.0),
            "seed {seed}: {errors:?}"
        );
    }
}

/// A pillar of 240 mm.
fn pillar(x: f64, y: f64) -> Vec<Wall> {
    let corner = |index: u32| {
        let (sin, cos) = libm::sincos(f64::from(index) * PI / 6.0);
        [x + 120.0 * cos, y + 120.0 * sin]
    };
    let side = |index: u32| {
        let ([x0, y0], [x1, y1]) = (corner(index), corner(index + 1));
        [x0, y0, x1, y1]
    };
    (0..12).map(side).collect()
}

/// Number of scans until a robot that has never moved knows its pose. It was carried to another
/// pose in a square room, whose corners two pillars distinguish.
fn scans_after_kidnap(seed: u64) -> Option<u32> {
    let mut walls = boxed(300.0, 300.0, 2700.0, 2700.0).to_vec();
    walls.extend(pillar(700.0, 600.0));
    walls.extend(pillar(1900.0, 2400.0));
    let world = World::new(walls, [1500.0, 1200.0, FRAC_PI_2], seed);
    let mut run: Run = Run::new(world, Settings::default());
    run.steps(20);
    let mut dice = Dice::new(seed + 77);
    let [x, y] = [0; 2].map(|_| 900.0 + dice.uniform() * 900.0);
    let turn = if seed.is_multiple_of(2) {
        FRAC_PI_2
    } else {
        dice.uniform() * 2.0 * PI
    };
    run.world.body = [x, y, FRAC_PI_2 + turn];
    scans_until_found(&mut run, 5)
}

/// 25 of 30 succeed; the others accept a pose that looks equal except for a pillar. Before gaps
/// between beams counted, 1 of 30 succeeded; before walls were searched along beams, 18.
#[test]
fn most_kidnaps_of_a_robot_that_never_moved_are_seen_through() {
    let found = (0..30).filter(|seed| scans_after_kidnap(*seed).is_some());
    let found = found.count();
    assert!(found >= 24, "{found} of 30");
}
