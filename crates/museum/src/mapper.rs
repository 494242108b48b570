//! The fielded mapper: its search, its drawing, its odometry. Both variants map with the method of
//! the seed report; only the defect differs.

mod drawing;
pub(super) mod search;
mod way;

use firmware_core::pose::{Point, Pose};
use firmware_core::scan::Scan;
use firmware_core::slam::{Defects, Mapper, Settings};
use protocols::Instant;

use super::robot::config;
use super::{Bug, Variant};

const MAPPER: &str = "robot's program, mapper";
const ODOMETRY: &str = "robot's program, odometry";

pub(super) const ROWS: [Bug; 15] = [
    Bug::mutant(
        "SL-01",
        MAPPER,
        "after seven improvements the search computes a remainder by zero: candidates are a million metres away",
        search::sl_01,
    ),
    Bug::mutant(
        "SL-02",
        MAPPER,
        "after four improvements the search tries headings of the whole circle",
        search::sl_02,
    ),
    Bug::mutant(
        "SL-03",
        MAPPER,
        "after 17 overruns the budget of tries wraps to 65486: a scan takes ten seconds",
        search::sl_03,
    ),
    Bug::mutant(
        "SL-04",
        MAPPER,
        "minutes without a valid beam increase the budget: the next scans take seconds",
        search::sl_04,
    ),
    Bug::mutant(
        "SL-05",
        MAPPER,
        "while the robot turns fast, updates can only erase the map",
        drawing::sl_05,
    ),
    Bug::mutant(
        "SL-06",
        MAPPER,
        "the weight of an update limits the value of a cell: no wall becomes black",
        drawing::sl_06,
    ),
    Bug::mutant(
        "SL-07",
        ODOMETRY,
        "driving backwards moves the pose forwards",
        way::sl_07,
    ),
    Bug::mutant(
        "SL-08",
        ODOMETRY,
        "after two turns a nearly straight path counts as no motion",
        way::sl_08,
    ),
    Bug::mutant(
        "SL-09",
        ODOMETRY,
        "a curve bends to the wrong side, twice as far",
        way::sl_09,
    ),
    Bug::mutant(
        "SL-10",
        MAPPER,
        "at the map's edge one point on a wall scores higher than a full match",
        search::sl_10,
    ),
    Bug::mutant(
        "SL-11",
        MAPPER,
        "the quality of a good match is reported as a negative number",
        search::sl_11,
    ),
    Bug::mutant(
        "SL-12",
        MAPPER,
        "with a hole of less than two cells no wall is drawn at all",
        drawing::sl_12,
    ),
    Bug::mutant(
        "SL-13",
        ODOMETRY,
        "after 91 turns the heading that the PC receives is negative",
        way::sl_13,
    ),
    Bug::mutant(
        "SL-14",
        MAPPER,
        "mapping is enabled after a drive without it: the pose jumps by the whole path",
        way::sl_14,
    ),
    Bug::mutant(
        "H-SL-1",
        MAPPER,
        "the search never narrows its range: it ends farther from the best pose",
        search::h_sl_1,
    ),
];

/// The mapper's settings for `variant`.
pub(super) fn settings(variant: Variant, id: &str) -> Settings {
    let with = config(Variant::Defective, id).mapping;
    let defects = match variant {
        Variant::Defective => with.defects,
        Variant::Sound => Defects::NONE,
    };
    Settings {
        start: Pose::new(1500.0, 1500.0, 0.0),
        defects,
        ..with
    }
}

fn mapper(settings: Settings) -> Box<Mapper> {
    Box::new(Mapper::new(settings))
}

fn scan_of(points: &[Point]) -> Scan {
    Scan::from_points(points, Instant::ZERO, Instant::ZERO)
}

/// The four walls of a room, at distances `half`, millimetres, seen from its middle.
fn room([half_x, half_y]: [f32; 2]) -> Scan {
    let beam = |degree: u16| {
        let (sin, cos) = firmware_core::pose::sin_cos(f32::from(degree).to_radians());
        let distance = (half_x / cos.abs()).min(half_y / sin.abs());
        Point::new(distance * cos, distance * sin)
    };
    scan_of(&(0..360).map(beam).collect::<Vec<_>>())
}
