//! The model car's fielded program, its boards and its sketch.
//!
//! The program itself shows its defects on a bench of bytes. An emulated device in its own world
//! shows the defects of a board or the sketch. Figures show wrong formulas.

mod boards;
mod laws;
mod program;

use super::{Bug, Live};

const BOARD: &str = "model car, board";
const HOST: &str = "model car, host";
const ODOMETER: &str = "model car, odometer";
const PHONE: &str = "model car, remote";

pub(super) const ROWS: [Bug; 25] = [
    Bug::mutant(
        "AF-01",
        HOST,
        "the terminal converts CR to LF: 13 cm are read as 10 cm",
        program::af_01,
    ),
    Bug::mutant(
        "AF-02",
        HOST,
        "a zero byte before the sync causes the loss of the frame",
        program::af_02,
    ),
    Bug::mutant(
        "AF-03",
        HOST,
        "the comparison of sums is exact: in a curve the program rejects every line of the odometer",
        program::af_03,
    ),
    Bug::mutant(
        "AF-04",
        HOST,
        "the program sends both command bytes every millisecond: a sixth of the line's capacity",
        program::af_04,
    ),
    Bug::mutant(
        "AF-05",
        HOST,
        "the sideways motion has the wrong sign: in a turn the pose drifts away",
        program::af_05,
    ),
    Bug::mutant(
        "AF-06",
        PHONE,
        "no branch handles both modes at once: the last command stays active forever",
        program::af_06,
    ),
    Bug::mutant(
        "AF-07",
        PHONE,
        "the phone disconnects, and the car keeps driving",
        program::af_07,
    ),
    Bug::mutant(
        "AF-08",
        HOST,
        "the car drives at a gate of 35 cm, although the car is 33 cm wide",
        program::af_08,
    ),
    Bug::new(
        "AF-09",
        HOST,
        "a short read loses a byte: the program takes the next bytes for a frame, a battery of 28 mV",
        "the fielded parser",
        program::af_09,
    ),
    Bug::new(
        "AF-10",
        HOST,
        "40 cm ahead and 15 cm to the right contain a sync: a reader that starts there never recovers",
        "the fielded parser",
        program::af_10,
    ),
    Bug::new(
        "AF-11",
        ODOMETER,
        "pins without interrupts, polled once per loop: half of the edges at 0.45 m/s, backwards at 0.9",
        "a look each 10 ms instead of each edge",
        boards::af_11,
    ),
    Bug::new(
        "AF-12",
        ODOMETER,
        "the reported turn rate is 4.88 times too small",
        "the sketch of March 2016",
        boards::af_12,
    ),
    Bug::new(
        "AF-13",
        ODOMETER,
        "a loop that takes 12 ms then waits for -2 ms, which is read as 49 days",
        "the sketch of March 2016",
        boards::af_13,
    ),
    Bug::new(
        "AF-14",
        BOARD,
        "the host falls silent, and the board keeps driving",
        "the board without a dead-man time",
        boards::af_14,
    ),
    Bug::new(
        "AF-15",
        HOST,
        "without a plan the program sends steering value 0, which is 6 degrees to the left",
        "value 0 for straight ahead",
        boards::af_15,
    ),
    Bug {
        id: "AF-16",
        place: HOST,
        sees: "a line of fewer than five figures is read beyond the end of its list",
        live: Live::Not(
            "the list is in the host's memory, which is not modelled; the line is rejected",
        ),
    },
    Bug::new(
        "AF-17",
        HOST,
        "an angle is rounded to the next steering value to the right, not to the nearest one",
        "the fielded search of the table",
        laws::af_17,
    ),
    Bug::new(
        "AF-18",
        HOST,
        "a wrong sign in the report: the steering leads away from the goal",
        "equation (V) as printed",
        laws::af_18,
    ),
    Bug::new(
        "AF-19",
        HOST,
        "the program accepts a gate behind the car like one ahead",
        "the fielded choice of gates",
        laws::af_19,
    ),
    Bug::new(
        "AF-20",
        HOST,
        "the car drives at a gate with its current heading",
        "the fielded goal",
        laws::af_20,
    ),
    Bug::new(
        "AF-21",
        HOST,
        "a marker keeps the position of its first sighting",
        "the fielded list of markers",
        laws::af_21,
    ),
    Bug {
        id: "AF-22",
        place: PHONE,
        sees: "no node listens to the message of the layout's button for autonomous driving",
        live: Live::Not("the rig accepts both names: the layout is a file of the phone"),
    },
    Bug {
        id: "AF-23",
        place: HOST,
        sees: "opening the odometer's port resets it: the distance begins at 0 and the car's pose jumps back",
        live: Live::Not("the reaction of the fielded host is not published; ours starts again"),
    },
    Bug {
        id: "AF-24",
        place: HOST,
        sees: "a turn rate is taken for a steering angle",
        live: Live::Not("it acts like a gain of 3: a wrong unit without a visible effect"),
    },
    Bug {
        id: "AF-25",
        place: HOST,
        sees: "12 of 80 motions exist twice, and plans lead through unknown cells",
        live: Live::Not("the planner is from a library; ours drops duplicates when it reads"),
    },
];
