//! The model car's report: what its measurements come to in the rig, with the car's own program and
//! phone.

mod circle;
mod hall;
mod levels;
mod wall;

use core::time::Duration;

use emulators::world::Pose;
use protocols::Instant;

use super::Experiment;
use super::runs::start;
use crate::run::Run;

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

/// How often the car is looked at.
const EVERY: Duration = Duration::from_millis(100);
/// When the phone begins to drive.
const BEGIN: Duration = Duration::from_secs(1);

/// A car in the middle of an empty hall of this size, metres, whose phone tells it this motor level
/// and steering value.
fn told(size_m: [f64; 2], drive: [i8; 2], seed: u64) -> Run {
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

/// Where the car is from `from` to `until`.
fn way(run: &mut Run, from: Duration, until: Duration) -> Vec<Pose> {
    let mut at = Instant::ZERO + from;
    let mut poses = Vec::new();
    while at <= Instant::ZERO + until {
        run.go_on_until(at);
        poses.push(run.rig.world.pose());
        at += EVERY;
    }
    poses
}

/// A name and a seed, for all names and seeds.
fn jobs<T: Copy>(of: &[T], seeds: u64) -> Vec<(T, u64)> {
    let each = of.iter();
    each.flat_map(|one| (1..=seeds).map(move |seed| (*one, seed)))
        .collect()
}
