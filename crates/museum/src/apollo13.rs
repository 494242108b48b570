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
        "the terminal makes LF of CR: 13 cm are read as 10",
        program::af_01,
    ),
    Bug::mutant(
        "AF-02",
        HOST,
        "a zero before the sync costs the frame",
        program::af_02,
    ),
    Bug::mutant(
        "AF-03",
        HOST,
        "sums are compared exactly: in a curve no line of the odometer is believed",
        program::af_03,
    ),
    Bug::mutant(
        "AF-04",
        HOST,
        "both command bytes go out each millisecond: a sixth of the line",
        program::af_04,
    ),
    Bug::mutant(
        "AF-05",
        HOST,
        "the way to the side has the wrong sign: in a turn the pose runs off",
        program::af_05,
    ),
    Bug::mutant(
        "AF-06",
        PHONE,
        "both modes at once have no branch: the last command goes on for ever",
        program::af_06,
    ),
    Bug::mutant(
        "AF-07",
        PHONE,
        "the phone is gone, the car drives on",
        program::af_07,
    ),
    Bug::mutant(
        "AF-08",
        HOST,
        "a gate of 35 cm is driven at by a car that is 33 cm wide",
        program::af_08,
    ),
    Bug::new(
        "AF-09",
        HOST,
        "a byte that a short read loses: what follows is taken for a frame, a battery of 28 mV",
        "the fielded parser",
        program::af_09,
    ),
    Bug::new(
        "AF-10",
        HOST,
        "40 cm ahead and 15 cm to the right hold a sync: begun in the middle, never right again",
        "the fielded parser",
        program::af_10,
    ),
    Bug::new(
        "AF-11",
        ODOMETER,
        "pins without interrupts, one look a loop: at 0.45 m/s half of the edges, at 0.9 backwards",
        "a look each 10 ms instead of each edge",
        boards::af_11,
    ),
    Bug::new(
        "AF-12",
        ODOMETER,
        "the turn rate is told 4.88 times too small",
        "the sketch of March 2016",
        boards::af_12,
    ),
    Bug::new(
        "AF-13",
        ODOMETER,
        "a loop that takes 12 ms waits for -2 ms, which is 49 days",
        "the sketch of March 2016",
        boards::af_13,
    ),
    Bug::new(
        "AF-14",
        BOARD,
        "the host falls silent, the board drives on",
        "the board without a dead-man time",
        boards::af_14,
    ),
    Bug::new(
        "AF-15",
        HOST,
        "without a plan steering value 0 is sent, which is 6 degrees to the left",
        "value 0 for straight ahead",
        boards::af_15,
    ),
    Bug {
        id: "AF-16",
        place: HOST,
        sees: "a line of fewer than five figures is read beyond the end of its list",
        live: Live::Not(
            "the list is the host's memory, which is not modelled; the line is refused",
        ),
    },
    Bug::new(
        "AF-17",
        HOST,
        "an angle becomes the next steering value to the right, not the nearest",
        "the fielded search of the table",
        laws::af_17,
    ),
    Bug::new(
        "AF-18",
        HOST,
        "a sign of the report: what is steered to get somewhere leads elsewhere",
        "equation (V) as printed",
        laws::af_18,
    ),
    Bug::new(
        "AF-19",
        HOST,
        "a gate behind the car is as good as one ahead",
        "the fielded choice of gates",
        laws::af_19,
    ),
    Bug::new(
        "AF-20",
        HOST,
        "a gate is driven at with the heading that the car happens to have",
        "the fielded goal",
        laws::af_20,
    ),
    Bug::new(
        "AF-21",
        HOST,
        "a marker stays where it was seen first",
        "the fielded list of markers",
        laws::af_21,
    ),
    Bug {
        id: "AF-22",
        place: PHONE,
        sees: "the layout's button for autonomous driving says what no node listens to",
        live: Live::Not("both names are heard: the layout is a file that the phone brings along"),
    },
    Bug {
        id: "AF-23",
        place: HOST,
        sees: "opening the odometer's port resets it: the way begins at 0 and the car jumps back",
        live: Live::Not("what the fielded host did then is not published; ours begins anew"),
    },
    Bug {
        id: "AF-24",
        place: HOST,
        sees: "a turn rate is taken for a steering angle",
        live: Live::Not("it steers as a gain of 3 would: a unit, and nothing to be seen"),
    },
    Bug {
        id: "AF-25",
        place: HOST,
        sees: "12 of 80 motions are there twice, and plans lead through what is unknown",
        live: Live::Not("the planner is a library's; ours drops what is there twice when it reads"),
    },
];
