//! Mapping: the map that turns, corridors, moving persons, and the whole mission.

use engine::run::score::PosePair;
use engine::scenario::TuningSpec;
use engine::scenario::tuning::{FadingSpec, WallsSpec};
use firmware_core::Inspect as _;
use firmware_core::map_view::MapView;
use firmware_core::robots::rescue::Rescue;
use protocols::Instant;

use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::rescue::{WEIGHT, as_reported};
use crate::experiment::judged::measures::{
    Measure, Model, Told, by_case, by_seed, check_passed, mission,
};
use crate::experiment::runs::{FLAT, Spread, start};

/// Page 22: a corridor along which the mapper cannot determine its position.
pub(in super::super) const CORRIDOR: Measure = Measure {
    name: "corridor",
    planted: "a room in place of the corridor",
    perform: corridor,
};

/// A corridor that leaves the map on both sides, and a drive along it.
const LONG: &str = "schema = 1\nname = \"corridor\"\nrobot = \"rescue\"\nduration = \"60s\"\n\
    [mission]\nwaypoints_m = [[2.2, 1.5], [0.8, 1.5], [2.2, 1.5], [0.8, 1.5]]\n\
    to_the_end = true\n\
    [world]\nstart = { x_m = 0.8, y_m = 1.5, heading_deg = 0 }\n[[world.wall]]\n";

fn corridor(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let walls = model.pick(
        "path_m = [[-6, 1.05], [9, 1.05], [9, 1.95], [-6, 1.95], [-6, 1.05]]\n",
        "path_m = [[0.3, 1.05], [2.7, 1.05], [2.7, 1.95], [0.3, 1.95], [0.3, 1.05]]\n",
    );
    let text = format!("{LONG}{walls}");
    let errors = by_seed(plan, tell, |seed| {
        let outcome = mission(&text, seed, |scenario| {
            as_reported(scenario, TuningSpec::default());
        });
        let rms = |axis: usize| {
            let square = |pair: &PosePair| {
                let off = [
                    pair.truth.x - pair.estimate.x,
                    pair.truth.y - pair.estimate.y,
                ];
                off[axis] * off[axis]
            };
            let sum: f64 = outcome.pairs.iter().map(square).sum();
            1_000.0 * (sum / outcome.pairs.len() as f64).sqrt()
        };
        [rms(0), rms(1)]
    });
    let mut measured = Measured::default();
    let ratios = errors.iter().map(|[along, across]| along / across);
    measured.value("error along the corridor against across", ratios);
    measured.value(
        "error along the corridor (mm)",
        errors.iter().map(|error| error[0]),
    );
    measured
}

/// Page 22: moving persons do no harm.
pub(in super::super) const PEOPLE: Measure = Measure {
    name: "people",
    planted: "a lidar whose distances are a tenth too long while the person walks",
    perform: people,
};

/// A room in which the robot drives, and a person walks.
const PERSON: &str = include_str!("../../../../../scenarios/moving-obstacle.toml");
/// A lidar whose distances are a tenth too long from then on.
const WRONG: &str = "\n[[fault]]\nkind = \"wrong\"\ndevice = \"lidar\"\nfactor = 1.1\n\
    from = \"10s\"\nuntil = \"80s\"\n";

fn people(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let errors = by_case(plan, tell, &[true, false], |has_person, seed| {
        let more = if has_person {
            model.pick("", WRONG)
        } else {
            ""
        };
        let outcome = mission(&format!("{PERSON}{more}"), seed, |scenario| {
            as_reported(scenario, TuningSpec::default());
            if !has_person {
                scenario.world.moving.clear();
            }
        });
        outcome.pose_error.map_or(f64::NAN, |error| error.rms_mm)
    });
    let mut measured = Measured::default();
    let pairs = errors[0].iter().zip(&errors[1]);
    measured.value(
        "error with a person against without",
        pairs.map(|(with, without)| with / without),
    );
    measured
}

/// Pages 4 and 18: the robot visits a list of waypoints, draws the map, and returns.
pub(in super::super) const MISSION: Measure = Measure {
    name: "mission",
    planted: "a radio that loses the list of waypoints",
    perform: whole,
};

fn whole(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let ends = by_seed(plan, tell, |seed| {
        let lost = "\n[[fault]]\nkind = \"cut\"\nlink = \"radio\"\n\
            direction = \"to-master\"\n";
        let text = format!("{FLAT}{}", model.pick("", lost));
        let outcome = mission(&text, seed, |_| {});
        let [visited, demanded] = outcome.waypoints;
        let share = visited as f64 / demanded.max(1) as f64;
        let walls = outcome.wall_overlap.map_or(0.0, |overlap| overlap.least());
        // A robot that never left did not return.
        let back = if visited > 0 {
            check_passed(&outcome, "returned")
        } else {
            0.0
        };
        [share, back, walls]
    });
    let mut measured = Measured::default();
    measured.value("waypoints visited (share)", ends.iter().map(|end| end[0]));
    measured.value(
        "robots that came back (share)",
        ends.iter().map(|end| end[1]),
    );
    measured.value("walls of the map (share)", ends.iter().map(|end| end[2]));
    measured
}

/// Figure 7: the map turns.
pub(in super::super) const TURNING: Measure = Measure {
    name: "turning",
    planted: "a weight of 10 of 256, in place of 10 of 100",
    perform: turning,
};

/// Minutes of the drive, and between examinations of the map.
const MINUTES: u64 = 20;
const EVERY_MINUTES: u64 = 2;
/// A weight whose ten is of the program's 256, and not of the report's 100.
const LIGHTER: u16 = 10;

/// A room like that of figure 7: the wall follower drives round and round in it.
pub(super) const ROOM: &str = "schema = 1\nname = \"turning\"\nrobot = \"rescue\"\nduration = \"1300s\"\n\
    [mission]\nto_the_end = true\n[program]\nstart_mode = \"exploration\"\n\
    [world]\nstart = { x_m = 1.0, y_m = 1.0, heading_deg = 90 }\n[[world.wall]]\n\
    path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n\
    [[world.polygon]]\ncorners_m = [[2.2, 1.2], [2.7, 1.2], [2.7, 1.5], [2.2, 1.5]]\n";

fn turning(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let cases = [FadingSpec::None, FadingSpec::Linear];
    let turned = by_case(plan, tell, &cases, |fading, seed| {
        let mut run = start(ROOM, seed, |scenario| {
            let tuning = TuningSpec {
                walls: Some(WallsSpec::Beam),
                smear: true,
                weight: Some(model.pick(WEIGHT, LIGHTER)),
                fading: Some(fading),
                ..TuningSpec::default()
            };
            as_reported(scenario, tuning);
        });
        let looks = (1..=MINUTES / EVERY_MINUTES).map(|look| {
            run.go_on_until(Instant::from_secs(60 * EVERY_MINUTES * look));
            let program = run.rig.program_as::<Rescue>();
            let map = program.and_then(Rescue::map);
            map.map_or(f64::NAN, turn_of)
        });
        looks.collect::<Vec<f64>>()
    });
    let mut measured = Measured::default();
    let end = |run: &Vec<f64>| run.last().copied().unwrap_or(f64::NAN);
    measured.value(
        "turn of the map after 20 minutes (deg)",
        turned[0].iter().map(end),
    );
    measured.value("the same with the cure (deg)", turned[1].iter().map(end));
    for (name, runs) in [
        ("without the cure", &turned[0]),
        ("with the cure", &turned[1]),
    ] {
        let after = |look: usize| {
            let values = runs.iter().map(|run| run[look]);
            let minute = EVERY_MINUTES as f64 * (look as f64 + 1.0);
            [minute, Spread::of(values).median]
        };
        measured.curve(name, (0..runs.first().map_or(0, Vec::len)).map(after));
    }
    measured
}

/// Least gradient of an edge, values per cell.
const EDGE: f64 = 8.0;

/// Angle between the map's edges and its axes, degrees, 0 to 45. The picture of the report was read
/// in the same way.
pub(super) fn turn_of(map: MapView<'_>) -> f64 {
    let at = |x: usize, y: usize| f64::from(map.get(x, y).unwrap_or(127));
    let (mut sin, mut cos) = (0.0, 0.0);
    for y in 1..map.height() - 1 {
        for x in 1..map.width() - 1 {
            let along = (at(x + 1, y) - at(x - 1, y)) / 2.0;
            let up = (at(x, y + 1) - at(x, y - 1)) / 2.0;
            let edge = libm::hypot(along, up);
            if edge > EDGE {
                // Edges along both axes count alike.
                let (s, c) = libm::sincos(4.0 * libm::atan2(up, along));
                sin += edge * s;
                cos += edge * c;
            }
        }
    }
    (libm::atan2(sin, cos) / 4.0).to_degrees().abs()
}
