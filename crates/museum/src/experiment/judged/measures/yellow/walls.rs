//! Lines of a scan, the average over five scans, and regions of few points.

use emulators::rng::Rng;
use engine::run::Run;
use firmware_core::Inspect as _;
use firmware_core::lines::{Defects, Lines, Settings};
use firmware_core::pose::Point;
use firmware_core::robots::yellow::Yellow;
use protocols::Instant;

use super::missions::with_defect;
use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_case, by_seed};
use crate::experiment::runs::{Spread, start};

/// Pages 3 and 4: lines of a scan.
pub(in super::super) const LINES: Measure = Measure {
    name: "yellow-lines",
    planted: "the merge of the published program: everything below 80 degrees is one line",
    perform: lines_found,
};

/// Time at which five turns of the lidar are complete.
const SCANNED: Instant = Instant::from_secs(4);
/// Distance of the walls from the robot, metres.
const WALL_M: f64 = 1.0;
/// Direction of a wall, degrees. The walls are not aligned with the beams, as in any room.
const FRONT_DEG: f64 = 40.0;
/// Rooms: names of their values, and directions of the corners in degrees.
const ROOMS: [&str; 5] = [
    "lines of a square room",
    "lines of a room of eight walls",
    "lines of a room of six walls",
    "lines of a square room with a corner of 169 degrees",
    "lines of a square room with a corner of 171 degrees",
];

fn lines_found(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let settings = Settings {
        defects: Defects {
            merges_below_80_deg: model == Model::Planted,
            ..Defects::NONE
        },
        ..Settings::DEFAULT
    };
    let rooms = [
        equal_walls(4),
        equal_walls(8),
        equal_walls(6),
        bent_wall(169.0),
        bent_wall(171.0),
    ];
    let cases: [usize; 5] = core::array::from_fn(|index| index);
    let found = by_case(plan, tell, &cases, |room, seed| {
        let mut run = start(&room_text(&rooms[room]), seed, |_| {});
        run.go_on_until(SCANNED);
        let lines = Lines::find(&scan(&run), &settings);
        lines.as_slice().len() as f64
    });
    let mut measured = Measured::default();
    for (name, counts) in ROOMS.into_iter().zip(found) {
        measured.value(name, counts);
    }
    measured
}

/// The program's average over five turns, as points in the robot's frame, millimetres.
fn scan(run: &Run) -> Vec<Point> {
    let program = run.rig.program_as::<Yellow>();
    program.map_or_else(Vec::new, |program| program.scan().to_vec())
}

/// Directions, radians, and distances, metres, of this number of equal walls around the robot.
fn equal_walls(count: u32) -> Vec<[f64; 2]> {
    let step = core::f64::consts::TAU / f64::from(count);
    let wall = |index: u32| [FRONT_DEG.to_radians() + step * f64::from(index), WALL_M];
    (0..count).map(wall).collect()
}

/// The walls of a square room, one of which has a corner of this angle in its middle.
fn bent_wall(corner_deg: f64) -> Vec<[f64; 2]> {
    let half = (180.0 - corner_deg).to_radians() / 2.0;
    let front = FRONT_DEG.to_radians();
    let bent = [front - half, front + half].map(|towards| [towards, WALL_M * libm::cos(half)]);
    let quarter = core::f64::consts::FRAC_PI_2;
    let straight = (1..4).map(|side| [front + quarter * f64::from(side), WALL_M]);
    bent.into_iter().chain(straight).collect()
}

/// A scenario in which the robot rests in the middle of these walls.
fn room_text(walls: &[[f64; 2]]) -> String {
    let next = walls.iter().cycle().skip(1);
    let mut corners: Vec<[f64; 2]> = walls
        .iter()
        .zip(next)
        .map(|([one, far_one], [other, far_other])| {
            // The point whose distances along both directions are those of the walls.
            let (sin, cos) = libm::sincos(*one);
            let (sin_other, cos_other) = libm::sincos(*other);
            let area = cos * sin_other - sin * cos_other;
            [
                (far_one * sin_other - far_other * sin) / area,
                (far_other * cos - far_one * cos_other) / area,
            ]
        })
        .collect();
    corners.extend(corners.first().copied());
    let path: Vec<String> = corners
        .iter()
        .map(|[x, y]| format!("[{:.6}, {:.6}]", x + 3.0, y + 3.0))
        .collect();
    format!(
        "schema = 1\nname = \"walls\"\nrobot = \"yellow\"\nduration = \"60s\"\n\
         [mission]\nto_the_end = true\n\
         [world]\nstart = {{ x_m = 3, y_m = 3, heading_deg = 0 }}\n[[world.wall]]\n\
         path_m = [{}]\n",
        path.join(", ")
    )
}

/// Page 3: five scans are averaged.
pub(in super::super) const AVERAGING: Measure = Measure {
    name: "yellow-averaging",
    planted: "the set of the published program: five copies of one scan",
    perform: averaging,
};

/// Scans apart, seconds, whose averages have no turn in common, and their number.
const APART_S: u64 = 2;
const SCANS: u64 = 25;
/// Walls of a room that is nearly round: all distances differ by less than half a millimetre.
const ROUND: u32 = 120;

fn averaging(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    // The published set holds copies of one turn, so its noise is that of a single scan.
    let averaged = model == Model::Sound;
    let noises = by_case(plan, tell, &[false, averaged], noise_mm);
    let mut measured = Measured::default();
    let pairs = noises[0].iter().zip(&noises[1]);
    let ratios = pairs.map(|(single, five)| single / five);
    measured.value("noise of one scan against the average of five", ratios);
    measured
}

/// Noise of the distance of a degree, mm: the median over the degrees of a round room. The sensor
/// has one sample a degree and turn, so a degree is two directions of the set.
fn noise_mm(is_averaged: bool, seed: u64) -> f64 {
    let mut run = start(&room_text(&equal_walls(ROUND)), seed, |scenario| {
        if !is_averaged {
            with_defect(scenario, "YL-05");
        }
    });
    // Distances by whole degrees.
    let mut distances = vec![Vec::new(); 360];
    for look in 0..SCANS {
        run.go_on_until(SCANNED + core::time::Duration::from_secs(APART_S * look));
        let mut of_look = vec![Vec::new(); 360];
        for point in scan(&run) {
            let [x, y] = [point.x_mm, point.y_mm].map(f64::from);
            let degrees = libm::atan2(y, x).to_degrees().rem_euclid(360.0);
            // A direction of the set is half a degree wide.
            #[expect(clippy::cast_possible_truncation, reason = "at most 360")]
            #[expect(clippy::cast_sign_loss, reason = "not negative")]
            let degree = (degrees + 0.25) as usize % 360;
            of_look[degree].push(libm::hypot(x, y));
        }
        for (all, one) in distances.iter_mut().zip(of_look) {
            if !one.is_empty() {
                all.push(one.iter().sum::<f64>() / one.len() as f64);
            }
        }
    }
    let deviation = |values: &Vec<f64>| {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares = values.iter().map(|value| (value - mean) * (value - mean));
        (squares.sum::<f64>() / (count - 1.0)).sqrt()
    };
    let full = distances.iter().filter(|values| values.len() > 10);
    Spread::of(full.map(deviation)).median
}

/// Page 4: regions of fewer than three points are removed.
pub(in super::super) const REGIONS: Measure = Measure {
    name: "yellow-regions",
    planted: "the published program, which counts the last point twice",
    perform: regions,
};

/// Points of a region are this far apart, and regions are that far apart, mm.
const POINTS_MM: f64 = 50.0;
const REGIONS_MM: f64 = 500.0;

fn regions(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let settings = Settings {
        defects: Defects {
            duplicates_last: model == Model::Planted,
            ..Defects::NONE
        },
        ..Settings::DEFAULT
    };
    let found = by_seed(plan, tell, |seed| {
        let mut dice = Rng::stream(seed, "regions");
        let mut lines = |size: u32| {
            let mut at_mm = REGIONS_MM;
            let mut points = Vec::new();
            for _ in 0..3 {
                for _ in 0..size {
                    let side_mm = 1_000.0 + 2.0 * dice.gauss();
                    #[expect(clippy::cast_possible_truncation, reason = "millimetres")]
                    points.push(Point::new(at_mm as f32, side_mm as f32));
                    at_mm -= POINTS_MM;
                }
                at_mm -= REGIONS_MM;
            }
            Lines::find(&points, &settings).as_slice().len() as f64
        };
        [lines(2), lines(3)]
    });
    let mut measured = Measured::default();
    let names = [
        "lines of three regions of two points",
        "lines of three regions of three points",
    ];
    for (index, name) in names.into_iter().enumerate() {
        measured.value(name, found.iter().map(|one| one[index]));
    }
    measured
}
