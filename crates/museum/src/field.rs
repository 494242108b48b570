//! Incidents that the seed report describes in prose, each as a run in a simulated world, in
//! virtual time.
//!
//! Long incidents are shortened if the same mechanism appears in less time; `sees` says so.

mod lab;
mod map;
mod place;
mod stack;

use super::{Bug, Live, Observation, Variant};

const MAPPING: &str = "field report, mapping";
const PC_LINK: &str = "field report, PC link";

const fn told(
    id: &'static str,
    place: &'static str,
    sees: &'static str,
    by: &'static str,
    show: fn(Variant) -> Observation,
) -> Bug {
    Bug::new(id, place, sees, by, show)
}

pub(super) const ROWS: [Bug; 13] = [
    told(
        "F-01",
        MAPPING,
        "after 20 minutes of rounds the map has rotated (here after 5 minutes: half of it)",
        "a mapper not synchronised with the lidar, constant weight, the fielded defects",
        map::f_01,
    ),
    told(
        "F-02",
        MAPPING,
        "a turning robot does not map: a robot that spins in an unknown room draws no wall",
        "the fielded weight of an update, down to 1",
        map::f_02,
    ),
    told(
        "F-03",
        MAPPING,
        "in a long corridor the search shifts the pose along it, although the odometry is right",
        "the seed report's search",
        place::f_03,
    ),
    told(
        "F-04",
        MAPPING,
        "among furniture the pose is inaccurate, and four times the tries do not improve it",
        "the seed report's search",
        place::f_04,
    ),
    told(
        "F-05",
        PC_LINK,
        "sometimes a row of the map is missing, because its checksum is wrong",
        "the program with PU-06: poses are written into rows",
        stack::f_05,
    ),
    told(
        "F-06",
        MAPPING,
        "the map is mirrored: the beams are counted in the wrong direction",
        "a lidar that turns clockwise",
        stack::f_06,
    ),
    told(
        "F-07",
        MAPPING,
        "the robot moves 60 mm during a scan: walls get thick",
        "scans without compensation of motion",
        map::f_07,
    ),
    told(
        "F-08",
        MAPPING,
        "the robot is pushed by 400 mm at rest, and keeps its old pose",
        "a mapper that never searches",
        place::f_08,
    ),
    told(
        "F-09",
        "field report, processor",
        "the program becomes slow: the search exceeds its time",
        "the program with SL-04: the budget of tries without bounds",
        stack::f_09,
    ),
    told(
        "F-10",
        "field report, navigation",
        "a robot that follows the walls never reaches an obstacle in the middle of the room",
        "exploration that no list of waypoints ends",
        stack::f_10,
    ),
    told(
        "F-11",
        MAPPING,
        "on debris a wheel slips and still counts: the believed pose leaves the true one",
        "a mapper that never searches",
        place::f_11,
    ),
    told(
        "F-12",
        PC_LINK,
        "after an outage of the radio the PC program must be restarted",
        "the fielded PC program, which opens its port once",
        stack::f_12,
    ),
    Bug {
        id: "F-13",
        place: "field report, memory",
        sees: "the processor's memory is nearly full with a map of 300 x 300",
        live: Live::Not(
            "a limit, not a fault: the compiler limits the whole program to 128 of 192 KiB",
        ),
    },
];
