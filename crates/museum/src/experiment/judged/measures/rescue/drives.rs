//! Drives of the report's mapper: straight ahead, and in a winding room.

use engine::scenario::tuning::{FadingSpec, WallsSpec};
use engine::scenario::{CpuSpec, TuningSpec};
use firmware_core::Inspect as _;
use firmware_core::robots::rescue::Rescue;
use protocols::Instant;

use super::mapping::{ROOM, turn_of};
use super::search::{of_medians, twice};
use super::{WEIGHT, as_reported};
use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_case, by_seed};
use crate::experiment::runs::start;

/// Page 15: the map does not turn while the robot drives straight.
pub(in super::super) const STRAIGHT: Measure = Measure {
    name: "straight",
    planted: "the wall follower, which circles in one direction",
    perform: straight,
};

/// Duration of the drive, minutes, and of a part in one direction, seconds: 1.6 m at 0.226 m/s.
const MINUTES: u64 = 20;
const LEG_S: u64 = 7;
/// Set-point of both wheels, ticks in 40 ms.
const AHEAD: i8 = 20;

/// The room of figure 7, in which the robot drives to and fro without a turn.
fn to_and_fro() -> String {
    let head = "schema = 1\nname = \"straight\"\nrobot = \"rescue\"\nduration = \"1300s\"\n\
        [mission]\nto_the_end = true\n";
    let legs = (0..60 * MINUTES / LEG_S).map(|leg| {
        let ticks = if leg % 2 == 0 { AHEAD } else { -AHEAD };
        let at = 5 + LEG_S * leg;
        format!("[[mission.step]]\nat = \"{at}s\"\ndo = {{ drive = [{ticks}, {ticks}] }}\n")
    });
    let world = "[world]\nstart = { x_m = 1.5, y_m = 0.7, heading_deg = 90 }\n[[world.wall]]\n\
        path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n";
    format!("{head}{}{world}", legs.collect::<String>())
}

fn straight(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let text = model.pick(to_and_fro(), ROOM.to_owned());
    let turned = by_seed(plan, tell, |seed| {
        let mut run = start(&text, seed, |scenario| {
            let tuning = TuningSpec {
                walls: Some(WallsSpec::Beam),
                smear: true,
                weight: Some(WEIGHT),
                fading: Some(FadingSpec::None),
                ..TuningSpec::default()
            };
            as_reported(scenario, tuning);
        });
        run.go_on_until(Instant::from_secs(60 * MINUTES));
        let program = run.rig.program_as::<Rescue>();
        program.and_then(Rescue::map).map_or(f64::NAN, turn_of)
    });
    let mut measured = Measured::default();
    measured.value("turn of the map after 20 minutes straight (deg)", turned);
    measured
}

/// Page 22: winding rooms cost accuracy.
pub(in super::super) const WINDING: Measure = Measure {
    name: "winding",
    planted: "the room without its inner walls",
    perform: winding,
};

/// A drive through a room and back.
const DRIVE: &str = "schema = 1\nname = \"winding\"\nrobot = \"rescue\"\nduration = \"120s\"\n\
    [mission]\nwaypoints_m = [[0.7, 2.3], [1.5, 2.3], [1.5, 0.7], [2.3, 0.7], [2.3, 2.3], \
    [2.3, 0.7], [1.5, 0.7], [1.5, 2.3], [0.7, 2.3], [0.7, 0.7]]\n\
    [world]\nstart = { x_m = 0.7, y_m = 0.7, heading_deg = 90 }\n[[world.wall]]\n\
    path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n";
/// Inner walls that leave a winding corridor of 0.8 m.
const INNER: &str = "[[world.wall]]\npath_m = [[1.1, 0.3], [1.1, 1.9]]\n\
    [[world.wall]]\npath_m = [[1.9, 2.7], [1.9, 1.1]]\n";

fn winding(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let walls = model.pick(INNER, "");
    let errors = by_case(&twice(plan), tell, &[true, false], |is_winding, seed| {
        let text = format!("{DRIVE}{}", if is_winding { walls } else { "" });
        let run = start(&text, seed, |scenario| {
            scenario.program.cpu = CpuSpec::Stm32f4;
            as_reported(scenario, TuningSpec::default());
        });
        let error = run.finish().pose_error;
        error.map_or(f64::NAN, |error| error.rms_mm)
    });
    let mut measured = Measured::default();
    measured.value(
        "error in the winding room against the empty one",
        [of_medians(&errors[0], &errors[1])],
    );
    measured
}
