//! Whole runs of Yellow.

use engine::robots::Panel;
use engine::run::Outcome;
use engine::scenario::Scenario;
use firmware_core::Master as _;
use firmware_core::grid::UNKNOWN;
use firmware_core::robots::yellow::Yellow;
use protocols::telemetry::message::{Reactive, Telecommand};
use protocols::{Instant, telemetry};

use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_case, by_seed, mission};
use crate::experiment::runs::{Spread, start};

const MAP_TEXT: &str = include_str!("../../../../../scenarios/yellow-map.toml");
const LOST_TEXT: &str = include_str!("../../../../../scenarios/yellow-lost-commands.toml");
const REACTIVE_TEXT: &str = include_str!("../../../../../scenarios/yellow-reactive.toml");

/// Wheels that count a tenth too much.
const COUNTS: &str = "\n[[fault]]\nkind = \"device\"\ndevice = \"board\"\n\
    fault = \"wrong\"\nfactor = 1.1\n";

/// A figure of the PC's panel.
pub(super) fn of_pc(panels: &[Panel], name: &str) -> f64 {
    let rows = panels.iter().filter(|panel| panel.name == "pc");
    let mut rows = rows.flat_map(|panel| &panel.rows);
    let row = rows.find(|row| row.name == name);
    row.and_then(|row| row.value.parse().ok())
        .unwrap_or(f64::NAN)
}

/// Time of an event, seconds.
fn came_at(outcome: &Outcome, rule: &str) -> f64 {
    let event = outcome.events.iter().find(|event| event.event.rule == rule);
    event.map_or(f64::NAN, |event| {
        (event.event.at - Instant::ZERO).as_secs_f64()
    })
}

/// The frame of a telecommand.
pub(super) fn frame(command: &Telecommand) -> Vec<u8> {
    let (mut payload, mut bytes) = ([0; 256], [0; telemetry::FRAME_MAX]);
    let len = command.encode(&mut payload).expect("every field fits");
    let len = telemetry::encode(&payload[..len], &mut bytes).expect("at most 3200 bytes");
    bytes[..len].to_vec()
}

pub(super) fn with_defect(scenario: &mut Scenario, id: &str) {
    let id = toml::Spanned::new(0..0, id.to_owned());
    scenario.program.defects.push(id);
}

/// Page 4: the global map.
pub(in super::super) const GLOBAL_MAP: Measure = Measure {
    name: "yellow-global-map",
    planted: "wheels that count a tenth too much, and no correction by known walls",
    perform: global,
};

fn global(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let text = format!("{MAP_TEXT}{}", model.pick("", COUNTS));
    let ends = by_seed(plan, tell, |seed| {
        let outcome = mission(&text, seed, |scenario| {
            if model == Model::Planted {
                with_defect(scenario, "YP-08");
            }
        });
        let walls = outcome.wall_overlap;
        [
            came_at(&outcome, "map-done"),
            walls.map_or(0.0, |walls| walls.found),
            walls.map_or(0.0, |walls| walls.right),
        ]
    });
    let mut measured = Measured::default();
    measured.value(
        "time until the map is complete (s)",
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
    measured
}

/// Page 4: the next best view, by the report's method.
pub(in super::super) const NEXT_VIEW: Measure = Measure {
    name: "yellow-next-view",
    planted: "a lidar link that loses nine of ten bytes",
    perform: next_view,
};

/// Cells of the labyrinth with its outer walls: 3.1 m by 2.5 m.
const CELLS: f64 = 31.0 * 25.0;
/// Number of scans after which the map is examined: half of the labyrinth's 20 tiles.
const VIEWS: f64 = 10.0;

fn next_view(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let fault = "\n[[fault]]\nkind = \"drop\"\nlink = \"lidar\"\n\
        direction = \"to-master\"\nrate = 0.9\n";
    let text = format!("{MAP_TEXT}{}", model.pick("", fault));
    let ends = by_seed(plan, tell, |seed| {
        let mut run = start(&text, seed, |scenario| with_defect(scenario, "YP-09"));
        let mut known: Vec<[f64; 2]> = Vec::new();
        while !run.is_over() {
            run.step();
            let views = of_pc(&run.instruments().panels(&run.rig), "views");
            if known.last().is_none_or(|[last, _]| *last < views) {
                let map = run.instruments().map(&run.rig);
                let cells = map.map_or(0, |map| {
                    let cells = map.cells().iter();
                    cells.filter(|cell| **cell != UNKNOWN).count()
                });
                known.push([views, cells as f64]);
            }
        }
        known
    });
    let share = |known: &Vec<[f64; 2]>, views: f64| {
        // The view after this one begins when these cells are known.
        let after = known.iter().find(|[number, _]| *number > views);
        after
            .or(known.last())
            .map_or(0.0, |[_, cells]| cells / CELLS)
    };
    let walls_known = |known: &Vec<[f64; 2]>| known.last().map_or(0.0, |[_, cells]| *cells);
    let mut measured = Measured::default();
    let shares = ends.iter().map(|known| share(known, VIEWS));
    measured.value("cells known after ten views (share)", shares);
    measured.value("cells known at the end", ends.iter().map(walls_known));
    let views = |known: &Vec<[f64; 2]>| known.last().map_or(f64::NAN, |[views, _]| *views);
    measured.value("views of the drive", ends.iter().map(views));
    let median = |views: u32| {
        let views = f64::from(views);
        let shares = ends.iter().map(|known| share(known, views));
        [views, Spread::of(shares).median]
    };
    measured.curve("cells known", (1..=20).map(median));
    measured
}

/// Page 7: the map keeps a wide margin.
pub(in super::super) const MARGIN: Measure = Measure {
    name: "yellow-margin",
    planted: "a map that grows cell by cell",
    perform: margin,
};

fn margin(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let ends = by_seed(plan, tell, |seed| {
        let outcome = mission(MAP_TEXT, seed, |scenario| {
            if model == Model::Sound {
                with_defect(scenario, "YP-07");
            }
        });
        let Some(map) = &outcome.map else {
            return f64::NAN;
        };
        let map = map.view();
        let known = |row: usize| {
            let cells = map.row(row).into_iter().flatten();
            cells.into_iter().any(|cell| *cell != UNKNOWN)
        };
        let below = (0..map.height()).take_while(|row| !known(*row)).count();
        let above = (0..map.height())
            .rev()
            .take_while(|row| !known(*row))
            .count();
        (below + above) as f64 / 2.0
    });
    let mut measured = Measured::default();
    measured.value("empty rows of cells beyond the walls", ends);
    measured
}

/// Page 5: drive commands that get lost are sent again.
pub(in super::super) const LOST_COMMANDS: Measure = Measure {
    name: "yellow-lost-commands",
    planted: "a link that loses nothing",
    perform: lost,
};

fn lost(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let ends = by_seed(plan, tell, |seed| {
        let outcome = mission(LOST_TEXT, seed, |scenario| {
            if model == Model::Planted {
                scenario.fault.clear();
            }
        });
        let [visited, demanded] = outcome.waypoints;
        [
            visited as f64 / demanded.max(1) as f64,
            of_pc(&outcome.panels, "re-sends"),
        ]
    });
    let mut measured = Measured::default();
    measured.value("targets reached (share)", ends.iter().map(|end| end[0]));
    measured.value("commands sent again", ends.iter().map(|end| end[1]));
    measured
}

/// Pages 2 and 7: the reactive drive.
pub(in super::super) const REACTIVE: Measure = Measure {
    name: "yellow-reactive",
    planted: "the fastest of the speeds alone",
    perform: reactive,
};

/// Nominal speeds, m/s: steps of the PC program's slider up to the speed of the robot's other
/// drives. The report does not say which of them was set.
const SPEEDS: [f32; 5] = [0.1, 0.2, 0.3, 0.4, 0.5];
/// Time of the order with the speed: the robot has been ordered to drive, and switches on.
const ORDERED: Instant = Instant::from_millis(1_400);

fn reactive(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let speeds = model.pick(&SPEEDS[..], &SPEEDS[4..]);
    let ends = by_case(plan, tell, speeds, |speed, seed| {
        let mut run = start(REACTIVE_TEXT, seed, |scenario| {
            with_defect(scenario, "YR-01");
        });
        run.go_on_until(ORDERED);
        let now = run.rig.now();
        let command = Telecommand {
            reactive: Some(Reactive {
                speed_m_s: Some(speed),
                ..Reactive::default()
            }),
            ..Telecommand::default()
        };
        if let Some(program) = run.rig.program_as_mut::<Yellow>() {
            program.receive(Yellow::TELEMETRY, now, &frame(&command));
        }
        while !run.is_over() {
            run.step();
        }
        let untouched = run.contacts().count() == 0;
        let [visited, demanded] = run.judge().waypoints;
        let through = visited == demanded;
        [through, through && untouched].map(|is| f64::from(u8::from(is)))
    });
    let share = |ends: &[[f64; 2]], index: usize| {
        let sum: f64 = ends.iter().map(|end| end[index]).sum();
        sum / ends.len() as f64
    };
    let all: Vec<[f64; 2]> = ends.iter().flatten().copied().collect();
    let mut measured = Measured::default();
    let names = [
        "drives that come through all corners (share)",
        "drives that touch nothing on the way (share)",
    ];
    for (index, name) in names.into_iter().enumerate() {
        measured.value(name, [share(&all, index)]);
        let by_speed = speeds.iter().zip(&ends);
        let places = by_speed.map(|(speed, ends)| [f64::from(*speed), share(ends, index)]);
        measured.curve(["through", "untouched"][index], places);
    }
    measured
}

/// Page 2: a target by steps, along a straight line.
pub(in super::super) const ARRIVAL: Measure = Measure {
    name: "yellow-arrival",
    planted: "wheels that count a tenth too much, and no correction by known walls",
    perform: arrival,
};

fn arrival(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let counts = model.pick("", COUNTS);
    let found = by_seed(plan, tell, |seed| {
        let mut dice = emulators::rng::Rng::stream(seed, "target");
        let [x, y] = [dice.range(0.5, 3.5), dice.range(0.5, 3.5)];
        let heading = dice.range(-180.0, 180.0);
        let text = format!(
            "schema = 1\nname = \"by-hand\"\nrobot = \"yellow\"\nduration = \"60s\"\n\
             [mission]\nto_the_end = true\n[[mission.step]]\nat = \"1s\"\ndo = {{ mode = \"map\" }}\n\
             [[mission.step]]\nwhen = {{ event = {{ rule = \"map-done\", source = \"pc\" }} }}\n\
             do = {{ mode = \"go-to {x:.2} {y:.2} {heading:.0}\" }}\n{counts}\
             [world]\nstart = {{ x_m = 2, y_m = 2, heading_deg = 0 }}\n[[world.wall]]\n\
             path_m = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]]\n"
        );
        let outcome = mission(&text, seed, |scenario| {
            if model == Model::Planted {
                with_defect(scenario, "YP-08");
            }
        });
        let Some(pair) = outcome.pairs.last() else {
            return [f64::NAN; 2];
        };
        let at = pair.truth;
        let off_mm = 1e3 * (at.x - x).abs().max((at.y - y).abs());
        let [ax, ay] = [x - 2.0, y - 2.0];
        let far = libm::hypot(ax, ay).max(0.05);
        let beside = outcome
            .truth
            .iter()
            .map(|(_, pose)| 1e3 * ((pose.x - 2.0) * ay - (pose.y - 2.0) * ax).abs() / far);
        [off_mm, beside.fold(0.0, f64::max)]
    });
    let mut measured = Measured::default();
    measured.value(
        "distance to the target along an axis (mm)",
        found.iter().map(|one| one[0]),
    );
    measured.value(
        "farthest from the straight line (mm)",
        found.iter().map(|one| one[1]),
    );
    measured
}
