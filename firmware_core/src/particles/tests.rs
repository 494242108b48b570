extern crate std;

use std::vec::Vec;

use super::*;
use crate::ackermann::CarGeometry;

/// A floor of 5 m by 4.5 m with a corner cut out and a pillar, in cells of 5 cm: metres.
fn is_wall(x: f64, y: f64) -> bool {
    let is_outside = !(0.1..4.9).contains(&x) || !(0.1..4.4).contains(&y);
    let is_corner = x > 3.6 && y > 3.4;
    let is_pillar = (3.9..4.2).contains(&x) && (2.0..2.4).contains(&y);
    is_outside || is_corner || is_pillar
}

fn walls() -> Vec<bool> {
    let cells = (0..100 * 90).map(|at| (f64::from(at % 100), f64::from(at / 100)));
    cells
        .map(|(x, y)| is_wall((x + 0.5) * 0.05, (y + 0.5) * 0.05))
        .collect()
}

fn field() -> LikelihoodField {
    LikelihoodField::new(100, 0.05, [0.0; 2], &walls(), 2.0)
}

/// Scan of a scanner with a field of view of 70 degrees at `pose`, traced in steps of 1 cm,
/// independent of the map's cells.
fn scan(pose: CarPose, random: &mut Pcg32) -> Vec<Beam> {
    let bearings = (-35..=35).map(|deg| f64::from(deg).to_radians());
    let range = |bearing: f64| {
        let (sin, cos) = libm::sincos(pose.heading_rad + bearing);
        let along = |step: i32| f64::from(step) * 0.01;
        let met = (1..1_000)
            .find(|step| is_wall(pose.x_m + cos * along(*step), pose.y_m + sin * along(*step)));
        met.map_or(10.0, along)
    };
    let beams = bearings.map(|bearing_rad| Beam {
        bearing_rad,
        range_m: range(bearing_rad) + random.normal(0.02),
    });
    beams.collect()
}

/// Compares every cell of a random field with the least distance over all obstacles.
#[test]
fn distances_are_those_to_the_next_obstacle() {
    let mut random = Pcg32::new(5);
    let obstacles: Vec<bool> = (0..40 * 30).map(|_| random.below(40) == 0).collect();
    let field = LikelihoodField::new(40, 0.1, [-1.0, 3.0], &obstacles, 1.0);
    for at in 0..40 * 30 {
        let (x, y) = (f64::from(at % 40), f64::from(at / 40));
        let others = obstacles.iter().enumerate().filter(|(_, is)| **is);
        let far = |other: usize| libm::hypot((other % 40) as f64 - x, (other / 40) as f64 - y);
        let least = others.map(|(other, _)| far(other)).fold(10.0, f64::min);
        let found = field.distance_m([-1.0 + (x + 0.5) * 0.1, 3.0 + (y + 0.5) * 0.1]);
        assert!((found - least * 0.1).abs() < 1e-6, "{x} {y}: {found}");
    }
    assert_eq!(field.distance_m([3.01, 3.1]), 1.0);
    assert_eq!(field.distance_m([-1.01, 3.1]), 1.0);
    assert_eq!(field.distance_m([f64::NAN, 0.0]), 1.0);
}

/// Number of guesses, by hand: for two boxes (k = 1) it is 10 (1 - 2/9 + 0.4714 * 2.326)^3 = 10 *
/// 1.8743^3 = 65.8.
#[test]
fn more_boxes_need_more_guesses() {
    let localiser = Localiser::new(
        field(),
        Settings::default(),
        CarPose::default(),
        CarPose::default(),
        [0.0; 3],
        1,
    );
    assert_eq!(localiser.needed(1), 0);
    assert_eq!(localiser.needed(2), 66);
    // Forty boxes (k = 39) need 390 (1 - 0.0057 + 0.07549 * 2.326)^3 = 390 * 1.6011.
    assert_eq!(localiser.needed(40), 625);
}

/// Without noise a guess moves exactly as the odometry says, also backwards.
#[test]
fn a_guess_moves_as_the_odometry_says() {
    let mut random = Pcg32::new(1);
    let from = CarPose {
        x_m: 1.0,
        y_m: 2.0,
        heading_rad: 3.0,
    };
    for (ahead_m, left_m, turn_rad) in [(0.5, 0.1, 0.4), (-0.5, 0.1, -0.4), (0.001, 0.0, 1.0)] {
        let motion = Motion {
            ahead_m,
            left_m,
            turn_rad,
        };
        let moved = Noise::NONE.of(motion).moved(from, &mut random);
        assert!(moved.distance_m(from.then(motion)) < 1e-9);
        assert!(wrapped(moved.heading_rad - from.then(motion).heading_rad).abs() < 1e-9);
    }
}

/// Steering angle for a circle of 1 m: tan(0.245) = 0.25 / 1.
const STEERING: f64 = 0.245;

/// One drive of 5 m round a circle of 1 m; error of the estimate at its end, in metres and in
/// degrees.
fn drive(seed: u64, weighs: bool) -> [f64; 2] {
    let car = CarGeometry {
        wheelbase_m: 0.25,
        track_m: 0.155,
    };
    let mut random = Pcg32::new(1_000 + seed);
    let mut truth = CarPose {
        x_m: 2.2,
        y_m: 1.2,
        heading_rad: 0.0,
    };
    let mut odometry = CarPose::default();
    // 0.5 m beside the truth and turned by 15 degrees, in another direction for each seed.
    let to = random.unit() * 2.0 * PI;
    let start = CarPose {
        x_m: truth.x_m + 0.5 * libm::cos(to),
        y_m: truth.y_m + 0.5 * libm::sin(to),
        heading_rad: truth.heading_rad
            + if seed.is_multiple_of(2) {
                0.262
            } else {
                -0.262
            },
    };
    let settings = Settings::default();
    let mut localiser = Localiser::new(
        field(),
        settings,
        CarPose::default(),
        start,
        [0.3, 0.3, 0.17],
        seed,
    );
    for _ in 0..100 {
        let seen = if weighs {
            scan(truth, &mut random)
        } else {
            Vec::new()
        };
        localiser.update(odometry, &seen);
        truth = truth.then(car.rear_arc(STEERING, 0.05));
        // Slip of the wheel, and a deviation of the steering angle.
        let told = car.rear_arc(
            STEERING + random.normal(0.01),
            0.05 * (1.0 + random.normal(0.02)),
        );
        odometry = odometry.then(told);
    }
    localiser.update(odometry, &scan(truth, &mut random));
    let found = localiser.estimate().pose;
    let turned = wrapped(found.heading_rad - truth.heading_rad)
        .to_degrees()
        .abs();
    [found.distance_m(truth), turned]
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// AP13: from 0.5 m and 15 degrees beside the truth to 0.15 m and 5 degrees within 5 m of driving,
/// for 19 of 20 seeds; without the scans it stays lost.
#[test]
fn ap13_the_robot_finds_its_place_within_five_metres() {
    let errors: Vec<[f64; 2]> = (0..20).map(|seed| drive(seed, true)).collect();
    let good = errors
        .iter()
        .filter(|[off, turned]| *off <= 0.15 && *turned <= 5.0);
    let good = good.count();
    let medians =
        [0, 1].map(|axis: usize| median(errors.iter().map(|error| error[axis]).collect()));
    assert!(good >= 19, "{good} of 20, medians {medians:?}: {errors:?}");
    let blind = median((0..5).map(|seed| drive(seed, false)[0]).collect());
    assert!(blind > 0.3, "{blind}");
}

fn pose(x_m: f64, y_m: f64, heading_rad: f64) -> CarPose {
    CarPose {
        x_m,
        y_m,
        heading_rad,
    }
}

/// A localiser with these guesses, in the hall.
fn guessing(guesses: &[(CarPose, f64)]) -> Localiser {
    let scanner = pose(0.2, 0.1, PI / 2.0);
    let settings = Settings {
        noise: Noise::NONE,
        ..Settings::default()
    };
    let start = CarPose::default();
    let mut localiser = Localiser::new(field(), settings, scanner, start, [0.0; 3], 1);
    let guesses = guesses.iter();
    let guesses = guesses.map(|&(pose, weight)| Particle { pose, weight });
    localiser.particles = guesses.collect();
    localiser
}

fn near(one: f64, other: f64) -> bool {
    (one - other).abs() < 1e-4
}

/// Guesses are counted in boxes of 0.5 m and 10 degrees. Positions below 0 are rounded down, and
/// the headings form a circle of 36 boxes.
#[test]
fn guesses_are_counted_in_boxes() {
    let deg = |deg: f64| deg.to_radians();
    let cases = [
        (pose(0.49, 0.51, deg(9.0)), [0, 1, 0]),
        (pose(-0.01, -0.49, deg(-1.0)), [-1, -1, -1]),
        (pose(-0.51, 1.26, deg(-11.0)), [-2, 2, -2]),
        (pose(-1.0, 1.0, deg(179.0)), [-2, 2, 17]),
    ];
    for (place, expected) in cases {
        assert_eq!(in_box(place), expected);
    }
    let cases = [
        (0, 0, 0),
        (3, 1, 2),
        (1, 3, 2),
        (17, -18, 1),
        (0, 18, 18),
        (-17, 16, 3),
    ];
    for (one, other, expected) in cases {
        assert_eq!(turned_boxes(one, other), expected, "{one} {other}");
    }
}

/// By hand: the mean of the first two guesses is (0.5 * 0.1 + 0.3 * 0.3) / 0.8, and they differ
/// from it by 0.075 and 0.125. A guess in the neighbouring box is in their cluster, one two boxes
/// away is not.
#[test]
fn the_estimate_is_the_mean_of_the_heaviest_heap() {
    let heap = [(pose(0.1, 0.1, 0.0), 0.5), (pose(0.3, 0.1, 0.1), 0.3)];
    let with = |other: CarPose| guessing(&[heap[0], heap[1], (other, 0.2)]).estimate();
    let far = with(pose(3.0, 3.0, 2.0));
    assert!(
        near(far.pose.x_m, 0.175) && near(far.pose.y_m, 0.1),
        "{far:?}"
    );
    assert!(
        near(far.pose.heading_rad, 0.0375) && near(far.share, 0.8),
        "{far:?}"
    );
    assert!(near(far.spread_m, 0.096_825), "{far:?}");
    let shares = [
        (pose(0.6, 0.1, 0.0), 1.0),
        (pose(1.1, 0.1, 0.0), 0.8),
        (pose(-0.1, -0.1, -0.1), 1.0),
        (pose(-0.6, 0.1, 0.0), 0.8),
        (pose(0.1, 1.1, 0.0), 0.8),
        (pose(0.1, 0.1, 0.4), 0.8),
    ];
    for (other, share) in shares {
        assert!(near(with(other).share, share), "{other:?}");
    }
    // Across pi: 3.09 and -3.09 lie 0.10 apart, and pi is between them.
    let turned = [(pose(1.0, 1.0, 3.09), 0.5), (pose(1.0, 1.0, -3.09), 0.5)];
    let turned = guessing(&turned).estimate();
    assert!(near(turned.pose.heading_rad.abs(), PI) && near(turned.share, 1.0));
}

/// Values slightly below and above the limits of 5 cm and 0.05 rad; the first scan always counts.
#[test]
fn a_scan_is_weighed_when_the_robot_has_moved() {
    let mut localiser = guessing(&[(pose(1.0, 1.0, 0.0), 1.0)]);
    let from = pose(2.0, 1.0, 1.0);
    assert!(localiser.is_due(from) && localiser.update(from, &[]));
    let moved = |ahead_m, left_m, turn_rad| {
        from.then(Motion {
            ahead_m,
            left_m,
            turn_rad,
        })
    };
    for is in [
        moved(0.051, 0.0, 0.0),
        moved(0.0, -0.051, 0.0),
        moved(0.0, 0.0, -0.051),
    ] {
        assert!(localiser.is_due(is), "{is:?}");
    }
    for is_not in [from, moved(0.03, -0.03, 0.049), moved(-0.049, 0.0, -0.049)] {
        assert!(
            !localiser.is_due(is_not) && !localiser.update(is_not, &[]),
            "{is_not:?}"
        );
    }
    // The guesses move as the odometry does, in their own direction.
    assert!(localiser.update(moved(0.5, 0.2, 0.3), &[]));
    for guess in localiser.particles() {
        let expected = pose(1.5, 1.2, 0.3);
        assert!(guess.pose.distance_m(expected) < 1e-9, "{guess:?}");
        assert!(near(guess.pose.heading_rad, 0.3));
    }
    localiser.place(from, [0.0; 3]);
    assert!(localiser.is_due(from));
    assert_eq!(localiser.particles().len(), 2_000);
    let even = |one: &Particle| one.pose == from && near(one.weight, 0.0005);
    assert!(localiser.particles().iter().all(even));
}

/// The scanner sits 0.2 m ahead and 0.1 m to the left and looks to the left: a point 1 m ahead of
/// it lies at 0.2, 1.1; a point 1 m to its left lies 0.8 m behind the robot. Ranges from 0.15 m to
/// 6 m are valid; of 120 beams every second is used.
#[test]
fn beams_end_where_the_scanner_sees_them() {
    let localiser = guessing(&[(CarPose::default(), 1.0)]);
    let beam = |bearing_rad, range_m| Beam {
        bearing_rad,
        range_m,
    };
    let ends = localiser.usable(&[beam(0.0, 1.0), beam(PI / 2.0, 1.0)]);
    for (end, expected) in ends.iter().zip([[0.2, 1.1], [-0.8, 0.1]]) {
        assert!(
            near(end[0], expected[0]) && near(end[1], expected[1]),
            "{ends:?}"
        );
    }
    let ranges = [0.149, 0.15, 5.99, 6.0].map(|range| beam(0.0, range));
    assert_eq!(localiser.usable(&ranges).len(), 2);
    assert_eq!(localiser.usable(&[beam(0.0, 1.0); 120]).len(), 60);
    assert_eq!(localiser.usable(&[beam(0.0, 1.0); 119]).len(), 119);
}

/// One obstacle 1 m ahead of the first guess: its weight is 1 + (1/2 + 1/12)^3 = 1.1985 against 1 +
/// (1/12)^3 = 1.0006 where the beam ends 2 m from it.
#[test]
fn the_guess_whose_beams_end_on_an_obstacle_weighs_more() {
    let obstacles: Vec<bool> = (0..100 * 90).map(|at| at == 20 * 100 + 80).collect();
    let field = LikelihoodField::new(100, 0.05, [0.0; 2], &obstacles, 2.0);
    let zero = CarPose::default();
    let mut localiser = Localiser::new(field, Settings::default(), zero, zero, [0.0; 3], 1);
    let guesses = [pose(3.025, 1.025, 0.0), pose(1.025, 1.025, 0.0)];
    localiser.particles = guesses.map(|pose| Particle { pose, weight: 0.5 }).into();
    let ahead = Beam {
        bearing_rad: 0.0,
        range_m: 1.0,
    };
    localiser.weigh(&[ahead]);
    assert!(near(localiser.particles()[0].weight, 1.198_49 / 2.199_07));
    assert!(near(localiser.particles()[1].weight, 1.000_58 / 2.199_07));
    // The fit needs ten beams; it is that of the better guess.
    assert_eq!(localiser.fit(), 1.0);
    let aside = Beam {
        bearing_rad: 1.5,
        ..ahead
    };
    let ten: Vec<Beam> = (0..10)
        .map(|at| if at < 7 { ahead } else { aside })
        .collect();
    localiser.weigh(&ten);
    assert_eq!(localiser.fit(), 0.7);
    localiser.weigh(&ten[1..]);
    assert_eq!(localiser.fit(), 1.0);
    // 0.15 m beside an obstacle fits, 0.25 m does not: cells of 5 cm, of which 20 are a metre.
    let beside = |cells: f64| [[20.0, cells]; 10];
    assert_eq!(localiser.fit_at(guesses[0], &beside(3.0)), 1.0);
    assert_eq!(localiser.fit_at(guesses[0], &beside(5.0)), 0.0);
    // The same for a robot that looks along y, from below.
    let below = pose(4.025, 0.025, PI / 2.0);
    assert_eq!(localiser.fit_at(below, &beside(0.0)), 1.0);
    assert_eq!(localiser.fit_at(below, &beside(-5.0)), 0.0);
}

/// Two guesses have a quarter and three quarters of the weight: of 500 drawn guesses 375 are the
/// second one, within four standard deviations of 9.7. The number is the minimum of the settings
/// for one box, and the maximum for guesses spread everywhere.
#[test]
fn the_heavier_guess_is_drawn_more_often() {
    let places = [pose(1.0, 1.0, 0.0), pose(1.1, 1.0, 0.0)];
    let mut localiser = guessing(&[(places[0], 0.25), (places[1], 0.75)]);
    localiser.draw_anew();
    assert_eq!(localiser.particles().len(), 500);
    let second = localiser
        .particles()
        .iter()
        .filter(|one| one.pose == places[1]);
    let second = second.count();
    assert!((336..=414).contains(&second), "{second}");
    assert!(
        localiser
            .particles()
            .iter()
            .all(|one| near(one.weight, 0.002))
    );
    let everywhere = (0..2_000).map(|at| (pose(f64::from(at), 0.0, 0.0), 0.000_5));
    let mut localiser = guessing(&everywhere.collect::<Vec<_>>());
    localiser.draw_anew();
    assert_eq!(localiser.particles().len(), 2_000);
}

/// The odometry reports 1 m ahead, another source 0.5 m: every second guess moves back.
#[test]
fn every_second_guess_believes_the_other() {
    let mut localiser = guessing(&[(pose(1.0, 2.0, 0.0), 0.25); 4]);
    let ahead = |ahead_m| Motion {
        ahead_m,
        ..Motion::default()
    };
    localiser.doubt(ahead(1.0), ahead(0.5));
    let along: Vec<f64> = localiser
        .particles()
        .iter()
        .map(|one| one.pose.x_m)
        .collect();
    assert_eq!(along, [0.5, 1.0, 0.5, 1.0]);
}

/// A third of 900 guesses is scattered around the estimate: 300, within four deviations of 14. They
/// are moved with deviations of 1 m along x, 0 along y and 0.2 rad.
#[test]
fn a_search_throws_a_part_of_the_guesses() {
    let start = pose(2.0, 1.0, 0.5);
    let mut localiser = guessing(&[(start, 1.0 / 900.0); 900]);
    localiser.search(1.0 / 3.0, [1.0, 0.0, 0.2]);
    let thrown = localiser.particles().iter().filter(|one| one.pose != start);
    let thrown: Vec<CarPose> = thrown.map(|one| one.pose).collect();
    assert!((244..=356).contains(&thrown.len()), "{}", thrown.len());
    let mean = |of: &dyn Fn(&CarPose) -> f64| thrown.iter().map(of).sum::<f64>() / 300.0;
    let (x, turn) = (
        mean(&|one| one.x_m - 2.0),
        mean(&|one| one.heading_rad - 0.5),
    );
    assert!(x.abs() < 0.25 && turn.abs() < 0.05, "{x} {turn}");
    let wide = mean(&|one| (one.x_m - 2.0) * (one.x_m - 2.0));
    assert!((0.6..1.5).contains(&wide), "{wide}");
    assert!(thrown.iter().all(|one| near(one.y_m, 1.0)));
}

/// The map's corner is at (-2, 3), its cells have 10 cm: the obstacle of cell (15, 20) lies at
/// (-0.45, 5.05). A robot at (-0.45, 4.05) that looks along y sees it 1 m ahead.
#[test]
fn a_map_may_begin_anywhere() {
    let obstacles: Vec<bool> = (0..40 * 40).map(|at| at == 20 * 40 + 15).collect();
    let field = LikelihoodField::new(40, 0.1, [-2.0, 3.0], &obstacles, 2.0);
    let zero = CarPose::default();
    let mut localiser = Localiser::new(field, Settings::default(), zero, zero, [0.0; 3], 1);
    let right = pose(-0.45, 4.05, PI / 2.0);
    let wrong = [
        pose(-0.45, 4.55, PI / 2.0),
        pose(0.05, 4.05, PI / 2.0),
        pose(-0.45, 4.05, 0.0),
    ];
    let ahead = |cells| [[cells, 0.0]; 10];
    assert_eq!(localiser.fit_at(right, &ahead(10.0)), 1.0);
    assert!(
        wrong
            .iter()
            .all(|pose| localiser.fit_at(*pose, &ahead(10.0)) == 0.0)
    );
    assert_eq!(localiser.fit_at(wrong[2], &[[0.0, 10.0]; 10]), 1.0);
    assert_eq!(localiser.fit_at(right, &ahead(10.0)[..9]), 1.0);
    assert_eq!(localiser.fit_at(right, &ahead(20.0)[..9]), 1.0);
    let guess = |pose| Particle { pose, weight: 0.5 };
    localiser.particles = [guess(right), guess(wrong[0])].into();
    let beam = Beam {
        bearing_rad: 0.0,
        range_m: 1.0,
    };
    localiser.weigh(&[beam; 10]);
    assert!(localiser.particles()[0].weight > 0.7 && localiser.fit() == 1.0);
}

/// Offsets of scattered guesses are drawn in the order x, y, heading, each to the side that the
/// draw gives.
#[test]
fn guesses_are_thrown_to_the_side_that_is_drawn() {
    let (start, sigma) = (pose(2.0, 1.0, 0.5), [0.1, 0.2, 0.3]);
    let drawn = |random: &mut Pcg32| {
        let [x, y, turn] = sigma.map(|sigma| random.normal(sigma));
        pose(2.0 + x, 1.0 + y, 0.5 + turn)
    };
    let mut localiser = guessing(&[(start, 1.0)]);
    let mut random = localiser.random.clone();
    random.unit();
    let expected = drawn(&mut random);
    localiser.search(1.0, sigma);
    let thrown = localiser.particles()[0].pose;
    assert!(thrown.distance_m(expected) < 1e-9 && near(thrown.heading_rad, expected.heading_rad));
    localiser.place(start, sigma);
    for guess in localiser.particles() {
        let expected = drawn(&mut random);
        assert!(guess.pose.distance_m(expected) < 1e-9);
        assert!(near(guess.pose.heading_rad, wrapped(expected.heading_rad)));
    }
}

/// Half of the guesses are drawn again: those with a number below a half. The first one's number is
/// exactly a half, so it stays.
#[test]
fn a_search_takes_the_part_that_was_asked_for() {
    let start = CarPose {
        x_m: 2.0,
        y_m: 1.0,
        heading_rad: 0.5,
    };
    let guesses = || {
        let settings = Settings::default();
        Localiser::new(field(), settings, CarPose::default(), start, [0.0; 3], 3)
    };
    let moved = |mut guesses: Localiser, part: f64| {
        guesses.search(part, [0.1; 3]);
        let there: Vec<bool> = guesses
            .particles
            .iter()
            .map(|it| it.pose != start)
            .collect();
        there
    };
    let first = guesses().random.unit();
    assert!(!moved(guesses(), first)[0] && moved(guesses(), first * 1.001)[0]);
    assert!(moved(guesses(), 0.0).iter().all(|it| !it));
    assert!(moved(guesses(), 1.0).iter().all(|it| *it));
    let some = moved(guesses(), 0.5);
    let part = some.iter().filter(|it| **it).count() as f64 / some.len() as f64;
    assert!((0.45..0.55).contains(&part), "{part}");
}

/// Weights with a sum that is not a number are reset, all equal.
#[test]
fn weights_that_cannot_be_added_are_even() {
    let settings = Settings::default();
    let pose = CarPose {
        x_m: 2.0,
        y_m: 1.0,
        heading_rad: 0.5,
    };
    let mut guesses = Localiser::new(field(), settings, CarPose::default(), pose, [0.1; 3], 3);
    let even = 1.0 / guesses.particles.len() as f64;
    let beams = scan(pose, &mut Pcg32::new(1));
    for weight in [f64::MAX, 0.0] {
        guesses
            .particles
            .iter_mut()
            .for_each(|it| it.weight = weight);
        guesses.weigh(&beams);
        assert!(guesses.particles.iter().all(|it| it.weight == even));
    }
    guesses.weigh(&beams);
    let whole: f64 = guesses.particles.iter().map(|it| it.weight).sum();
    assert!((whole - 1.0).abs() < 1e-9, "{whole}");
}
