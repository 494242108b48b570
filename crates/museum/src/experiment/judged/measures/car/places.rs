//! Localisation, mapping, goals and gates.

use engine::run::Outcome;
use engine::run::score::PosePair;
use firmware_core::ackermann::CarPose;
use firmware_core::robots::apollo13::Apollo13;
use protocols::Instant;

use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{
    Measure, Model, Told, by_case, by_seed, mission, passed,
};
use crate::experiment::runs::{Spread, start};

const GOAL_TEXT: &str = include_str!("../../../../../scenarios/apollo13-goal.toml");
const GATES_TEXT: &str = include_str!("../../../../../scenarios/apollo13-gates.toml");
const MAP_TEXT: &str = include_str!("../../../../../scenarios/apollo13-map.toml");

/// A camera that sees nothing.
const BLIND: &str = "\n[[fault]]\nkind = \"device\"\ndevice = \"camera\"\n\
    fault = \"blind\"\nfactor = 1\nfrom = \"2s\"\n";

/// Mission III: a wrong pose estimate is made good while the car drives.
pub(in super::super) const LOCALISED: Measure = Measure {
    name: "car-localised",
    planted: "a camera that sees nothing",
    perform: localised,
};

/// Errors of the first estimate, metres.
const OFF_M: [f64; 2] = [0.3, 1.0];
/// Time of the wrong estimate, and length of the examined time in seconds.
const TOLD_S: u64 = 3;
const SECONDS: u64 = 20;
/// Time at which the error is judged. After the phone has repeated its goal, 13 s later than the
/// wrong pose, cars without sight are near the truth as well.
const JUDGED_S: usize = 10;

fn localised(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let errors = by_case(plan, tell, &OFF_M, |off_m, seed| {
        let text = format!("{GOAL_TEXT}{}", model.pick("", BLIND));
        let mut run = start(&text, seed, |scenario| {
            scenario.mission.to_the_end = true;
        });
        run.go_on_until(Instant::from_secs(TOLD_S));
        if let Some(car) = run.rig.program_as_mut::<Apollo13>() {
            let at = car.pose();
            car.set_pose(CarPose {
                x_m: at.x_m - off_m,
                ..at
            });
        }
        let looks = (1..=SECONDS * 2).map(|look| {
            run.go_on_until(Instant::from_millis(1_000 * TOLD_S + 500 * look));
            run.estimate().map_or(f64::NAN, |(at, estimate)| {
                let truth = run.rig.world.pose_at(at);
                PosePair {
                    at,
                    truth,
                    estimate,
                }
                .error_mm()
            })
        });
        looks.collect::<Vec<f64>>()
    });
    let mut measured = Measured::default();
    let end = |run: &Vec<f64>| run.get(2 * JUDGED_S - 1).copied().unwrap_or(f64::NAN);
    measured.value("error after 10 s, of 0.3 m (mm)", errors[0].iter().map(end));
    measured.value("error after 10 s, of 1.0 m (mm)", errors[1].iter().map(end));
    for (name, runs) in [("0.3 m off", &errors[0]), ("1.0 m off", &errors[1])] {
        let median = |look: usize| {
            let values = runs.iter().map(|run| run[look]);
            [0.5 * (look as f64 + 1.0), Spread::of(values).median]
        };
        measured.curve(name, (0..40).map(median));
    }
    measured
}

/// Pages 14, 15 and 23: to a goal, round an obstacle that is on no map.
pub(in super::super) const GOAL: Measure = Measure {
    name: "car-goal",
    planted: "a camera that sees nothing",
    perform: goal,
};

fn goal(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let text = format!("{GOAL_TEXT}{}", model.pick("", BLIND));
    let ends = by_seed(plan, tell, |seed| {
        let (outcome, untouched) = driven(&text, seed);
        [passed(&outcome), untouched]
    });
    let mut measured = Measured::default();
    measured.value(
        "drives that reach their goals (share)",
        ends.iter().map(|end| end[0]),
    );
    measured.value(
        "drives without a contact (share)",
        ends.iter().map(|end| end[1]),
    );
    measured
}

/// The end of a drive, and 1 if the car touched nothing.
fn driven(text: &str, seed: u64) -> (Outcome, f64) {
    let mut run = start(text, seed, |_| {});
    while !run.is_over() {
        run.step();
    }
    let untouched = f64::from(u8::from(run.contacts().count() == 0));
    (run.judge(), untouched)
}

/// Page 24: gates of two markers.
pub(in super::super) const GATES: Measure = Measure {
    name: "car-gates",
    planted: "a camera turned by ten degrees, which the program does not know",
    perform: gates,
};

fn gates(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let ends = by_seed(plan, tell, |seed| {
        let text = match model {
            Model::Sound => GATES_TEXT.to_owned(),
            Model::Planted => GATES_TEXT.replace(
                "[device.camera.camera]\n",
                "[device.camera.camera]\nmount = { heading_deg = 10 }\n",
            ),
        };
        let (outcome, untouched) = driven(&text, seed);
        let [visited, demanded] = outcome.waypoints;
        let share = visited as f64 / demanded.max(1) as f64;
        [share, untouched]
    });
    let mut measured = Measured::default();
    measured.value(
        "gates passed within 10 cm of the middle (share)",
        ends.iter().map(|end| end[0]),
    );
    measured.value(
        "drives without a contact (share)",
        ends.iter().map(|end| end[1]),
    );
    measured
}

/// Page 14: each marker is recognised once.
pub(in super::super) const MARKERS: Measure = Measure {
    name: "car-markers",
    planted: "a camera that sees nothing",
    perform: markers,
};

/// Maximum distance between two markers of the list that are the same one, metres: half of a marker
/// of 18 cm.
const SAME_M: f64 = 0.09;

fn markers(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let text = format!("{GATES_TEXT}{}", model.pick("", BLIND));
    let ends = by_seed(plan, tell, |seed| {
        let mut run = start(&text, seed, |_| {});
        while !run.is_over() {
            run.step();
        }
        let program = run.rig.program_as::<Apollo13>();
        let found = program.map_or_else(Vec::new, |car| car.gates().markers().collect());
        let twice = found.iter().enumerate().filter(|(index, (_, at))| {
            let earlier = found[..*index].iter();
            let is_same =
                |(_, [x, y]): &(u32, [f64; 2])| libm::hypot(x - at[0], y - at[1]) < SAME_M;
            earlier.into_iter().any(is_same)
        });
        [found.len() as f64, twice.count() as f64]
    });
    let mut measured = Measured::default();
    measured.value("recognised markers", ends.iter().map(|end| end[0]));
    measured.value("markers in the list twice", ends.iter().map(|end| end[1]));
    measured
}

/// Page 24: a gate that is blocked.
pub(in super::super) const BLOCKED: Measure = Measure {
    name: "car-blocked-gate",
    planted: "a board of 5 cm, lower than the sensors see",
    perform: blocked,
};

/// A board in the first gate, up to the height that follows.
const BOARD: &str = "\n[[world.polygon]]\n\
    corners_m = [[2.9, 1.85], [3.1, 1.85], [3.1, 2.15], [2.9, 2.15]]\n\
    unmapped = true\nheight_m = ";

fn blocked(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let height = model.pick("0.5", "0.05");
    let longer = GATES_TEXT.replace("duration = \"120s\"", "duration = \"300s\"");
    let text = format!("{longer}{BOARD}{height}\n");
    let ends = by_seed(plan, tell, |seed| driven(&text, seed).1);
    let mut measured = Measured::default();
    measured.value("drives without a contact (share)", ends);
    measured
}

/// Pages 15 and 16: the mapping drive.
pub(in super::super) const MAPPING: Measure = Measure {
    name: "car-mapping",
    planted: "wheels a tenth larger, which the program does not know",
    perform: mapping,
};

fn mapping(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let larger = model.pick("", "\n[chassis.ackermann]\nwheel_radius_m = 0.0352\n");
    let text = format!("{MAP_TEXT}{larger}");
    let ends = by_seed(plan, tell, |seed| {
        let outcome = mission(&text, seed, |_| {});
        let walls = outcome.wall_overlap;
        let rms = outcome.pose_error.map_or(f64::NAN, |error| error.rms_mm);
        [
            passed(&outcome),
            walls.map_or(0.0, |walls| walls.found),
            walls.map_or(0.0, |walls| walls.right),
            rms,
        ]
    });
    let mut measured = Measured::default();
    measured.value(
        "drives that end by themselves (share)",
        ends.iter().map(|end| end[0]),
    );
    measured.value(
        "walls that are in the map (share)",
        ends.iter().map(|end| end[1]),
    );
    measured.value(
        "walls of the map that are true (share)",
        ends.iter().map(|end| end[2]),
    );
    measured.value(
        "error of the position, rms (mm)",
        ends.iter().map(|end| end[3]),
    );
    measured
}
