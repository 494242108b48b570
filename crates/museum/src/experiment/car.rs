//! The model car's report: its measurements, repeated in the rig with the car's own program and
//! phone.

pub(super) mod circle;
pub(super) mod hall;
mod levels;
pub(super) mod wall;

use core::time::Duration;

use emulators::world::Pose;
use protocols::Instant;

use super::runs::start;
use super::{Experiment, Plan};
use engine::run::Run;

pub(super) const LEVELS: Experiment = Experiment {
    name: "car-levels",
    about: "speed of the car at each motor level",
    place: "model car, chapter 3",
    seeds: 1..6,
    perform: levels::perform,
};
pub(super) const CIRCLE: Experiment = Experiment {
    name: "car-circle",
    about: "circles that the car drives at steering values 0, 7 and 8: which is straight ahead",
    place: "model car, chapter 3",
    seeds: 1..11,
    perform: circle::perform,
};
pub(super) const HALL: Experiment = Experiment {
    name: "car-hall",
    about: "hall values that are usable: the fielded host, and one that reads whole frames",
    place: "model car, page 9",
    seeds: 1..21,
    perform: hall::perform,
};
pub(super) const WALL: Experiment = Experiment {
    name: "car-wall",
    about: "distance to a wall, controlled without an integral part and with one",
    place: "model car, mission I",
    seeds: 1..21,
    perform: wall::perform,
};

/// Interval between checks of the car.
const EVERY: Duration = Duration::from_millis(100);
/// Time at which the phone begins to drive.
const BEGIN: Duration = Duration::from_secs(1);

/// A car in the middle of an empty hall of this size, metres. Its phone orders this motor level and
/// steering value.
pub(super) fn told(size_m: [f64; 2], drive: [i8; 2], seed: u64) -> Run {
    let [x, y] = size_m;
    let [level, steering] = drive;
    let text = format!(
        "schema = 1\nname = \"car\"\nrobot = \"apollo13\"\nduration = \"120s\"\n\
         [mission]\nto_the_end = true\n\
         [[mission.step]]\nat = \"{}s\"\ndo = {{ drive = [{level}, {steering}] }}\n\
         [world]\nstart = {{ x_m = {}, y_m = {}, heading_deg = 0 }}\n\
         [[world.wall]]\npath_m = [[0, 0], [{x}, 0], [{x}, {y}], [0, {y}], [0, 0]]\n",
        BEGIN.as_secs(),
        x / 2.0,
        y / 2.0,
    );
    start(&text, seed, |_| {})
}

/// Poses of the car from `from` to `until`.
pub(super) fn way(run: &mut Run, from: Duration, until: Duration) -> Vec<Pose> {
    let mut at = Instant::ZERO + from;
    let mut poses = Vec::new();
    while at <= Instant::ZERO + until {
        run.go_on_until(at);
        poses.push(run.rig.world.pose());
        at += EVERY;
    }
    poses
}

/// All pairs of a name and a seed.
fn jobs<T: Copy>(of: &[T], plan: &Plan) -> Vec<(T, u64)> {
    let each = of.iter();
    each.flat_map(|one| plan.seeds().map(move |seed| (*one, seed)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The leading number of each figure of an experiment over two seeds.
    fn found(experiment: &Experiment) -> Vec<f64> {
        let plan = Plan {
            first_seed: 40,
            seeds: 2,
            jobs: 2,
        };
        let findings = (experiment.perform)(&plan, &|_, _| {});
        let number = |figure: &super::super::Figure| {
            let word = figure.ours.split(' ').next().unwrap_or_default();
            word.parse().expect("a figure comes first")
        };
        findings.figures.iter().map(number).collect()
    }

    /// The report's table of levels: +22 and -22 cm/s, within 5 %; at level -2 the car does not
    /// move.
    #[test]
    fn d1_levels_are_as_fast_as_the_report_says() {
        let [two, minus_three, minus_two, ..] = found(&LEVELS)[..] else {
            panic!("figures are missing");
        };
        assert!((two - 22.0).abs() < 1.1 && (minus_three + 22.0).abs() < 1.1);
        assert_eq!(minus_two, 0.0);
    }

    /// The report's table of angles: 6.0 degrees to the left at 0, 0.4 at 7 and 8.
    #[test]
    fn d1_steering_value_0_is_six_degrees_to_the_left() {
        let [zero, _, seven, eight] = found(&CIRCLE)[..] else {
            panic!("figures are missing");
        };
        assert!((zero - 6.0).abs() <= 0.1, "{zero}");
        assert!((seven - 0.4).abs() <= 0.1 && (eight - 0.4).abs() <= 0.1);
    }

    /// Less than one hall value a second; a sound host receives all 15.
    #[test]
    fn d1_the_fielded_host_has_less_than_one_hall_value_a_second() {
        let [fielded, _, sound, sent] = found(&HALL)[..] else {
            panic!("figures are missing");
        };
        assert!(fielded < 1.0 && sound > 14.0 && sent - sound < 0.1);
    }

    /// The integral part has no visible effect: less than 5 mm between the two paths.
    #[test]
    fn d1_the_integral_part_has_no_visible_effect() {
        let [without, with, ..] = found(&WALL)[..] else {
            panic!("figures are missing");
        };
        assert!(without < 10.0 && with < 10.0 && (without - with).abs() < 5.0);
    }
}
