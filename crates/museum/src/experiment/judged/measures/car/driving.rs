//! Speeds, steering angles, and the drive along a wall.

use core::time::Duration;

use emulators::world::Pose;
use engine::run::Run;

use crate::experiment::Plan;
use crate::experiment::car::circle::angle_deg;
use crate::experiment::car::wall::{distances_m, settled};
use crate::experiment::car::{told, way};
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_case, by_seed};
use crate::experiment::runs::{Spread, start};

/// Chapter 3: speeds of the motor's levels.
pub(in super::super) const LEVELS: Measure = Measure {
    name: "car-levels",
    planted: "a tenth of the speed is lost to slip",
    perform: levels,
};

/// Steering value closest to straight ahead.
pub(super) const STRAIGHT: i8 = 8;
const LEVELS_ALL: [i8; 7] = [-4, -3, -2, 0, 1, 2, 3];

/// A car as [`told`], with more lines in its scenario.
fn told_with(size_m: [f64; 2], drive: [i8; 2], seed: u64, more: &str) -> Run {
    if more.is_empty() {
        return told(size_m, drive, seed);
    }
    let text = told(size_m, drive, seed).scenario().to_toml();
    start(&format!("{text}\n{more}"), seed, |_| {})
}

fn levels(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let slip = model.pick("", "[chassis.ackermann]\nslip = 0.1\n");
    let (from, until) = (Duration::from_secs(4), Duration::from_secs(7));
    let speeds = by_case(plan, tell, &LEVELS_ALL, |level, seed| {
        let mut run = told_with([22.0, 8.0], [level, STRAIGHT], seed, slip);
        let way = way(&mut run, from, until);
        let ahead = way.windows(2).map(|pair| {
            let (sin, cos) = libm::sincos(pair[0].theta);
            (pair[1].x - pair[0].x) * cos + (pair[1].y - pair[0].y) * sin
        });
        100.0 * ahead.sum::<f64>() / (until - from).as_secs_f64()
    });
    let mut measured = Measured::default();
    let of = |level: i8| {
        let index = LEVELS_ALL.iter().position(|one| *one == level);
        speeds[index.unwrap_or(0)].clone()
    };
    measured.value("speed of level 2 (cm/s)", of(2));
    measured.value("speed of level -3 (cm/s)", of(-3));
    measured.value("speed of level 0 (cm/s)", of(0));
    measured.value("speed of level -2 (cm/s)", of(-2));
    let medians = LEVELS_ALL.iter().zip(&speeds);
    let medians = medians
        .map(|(level, speeds)| [f64::from(*level), Spread::of(speeds.iter().copied()).median]);
    measured.curve("speed", medians);
    measured
}

/// Chapter 3: the table of steering angles.
pub(in super::super) const STEERING: Measure = Measure {
    name: "car-steering",
    planted: "a wheelbase a tenth longer",
    perform: steering,
};

const VALUES: [i8; 11] = [-50, -40, -30, -20, -10, 0, 10, 20, 30, 40, 50];

fn steering(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let longer = model.pick("", "[chassis.ackermann]\nwheelbase_m = 0.2838\n");
    let (from, until) = (Duration::from_secs(3), Duration::from_secs(20));
    let angles = by_case(plan, tell, &VALUES, |value, seed| {
        let mut run = told_with([16.0, 16.0], [2, value], seed, longer);
        let way: Vec<Pose> = way(&mut run, from, until);
        angle_deg(&way)
    });
    let medians: Vec<[f64; 2]> = VALUES
        .iter()
        .zip(&angles)
        .map(|(value, angles)| [f64::from(*value), Spread::of(angles.iter().copied()).median])
        .collect();
    let mut measured = Measured::default();
    measured.value("angle at value 0 (deg to the left)", angles[5].clone());
    measured.value("angle at value -50 (deg to the left)", angles[0].clone());
    measured.value("angle at value 50 (deg to the left)", angles[10].clone());
    measured.curve("angle of the wheels", medians);
    measured
}

/// Mission I: along a wall, without an integral part and with one.
pub(in super::super) const WALL: Measure = Measure {
    name: "car-wall",
    planted: "an integral part fifty times as large",
    perform: wall,
};

/// Gain on the integral of the distance error, rad/(m s); the report has no figure.
const INTEGRAL: f64 = 0.01;
/// The wanted distance, metres.
const WANTED_M: f64 = 0.40;

fn wall(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let gain = model.pick(INTEGRAL, 50.0 * INTEGRAL);
    let ways = by_seed(plan, tell, |seed| {
        [0.0, gain].map(|integral| distances_m(integral, seed))
    });
    let rms_mm = |errors: &mut dyn Iterator<Item = f64>| {
        let (count, squares) = errors.fold((0.0, 0.0), |(count, squares), error| {
            (count + 1.0, squares + error * error)
        });
        1e3 * f64::sqrt(squares / f64::max(count, 1.0))
    };
    // Two drives of one controller differ by the noise of the sensor alone, and any change of the
    // controller gives another noise. The mean over the seeds has the effect of the change.
    let looks = ways.first().map_or(0, |[without, _]| without.len());
    let mean = |look: usize| {
        let sum: f64 = ways
            .iter()
            .map(|[without, with]| with[look] - without[look])
            .sum();
        sum / ways.len() as f64
    };
    let effect = rms_mm(&mut (0..looks).map(mean));
    let off = |[without, _]: &[Vec<f64>; 2]| {
        rms_mm(&mut without[settled()..].iter().map(|it| it - WANTED_M))
    };
    let mut measured = Measured::default();
    measured.value("difference by the integral part, rms (mm)", [effect]);
    measured.value(
        "distance off 0.40 m once settled, rms (mm)",
        ways.iter().map(off),
    );
    measured
}
