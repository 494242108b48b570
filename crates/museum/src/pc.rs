//! The robot's end of the PC link.

mod orders;
mod receiver;
pub(super) mod sender;
mod switched;

use firmware_core::waypoints::Waypoints;

use super::client::{CLIENT, pu_08, pu_13};
use super::robot::config;
use super::{Bug, Live, Variant};

const PC_LINK: &str = "robot's program, PC link";

pub(super) const ROWS: [Bug; 22] = [
    Bug::mutant(
        "PU-01",
        PC_LINK,
        "a stray P before a frame costs the frame",
        receiver::pu_01,
    ),
    Bug::mutant(
        "PU-02",
        PC_LINK,
        "a checksum whose second byte is 80 or more is refused",
        receiver::pu_02,
    ),
    Bug::mutant(
        "PU-03",
        PC_LINK,
        "one header with a length of 8000: the receiver is deaf until the robot is restarted",
        receiver::pu_03,
    ),
    Bug::mutant(
        "PU-04",
        PC_LINK,
        "a frame without payload takes a byte of the next one, which is lost",
        receiver::pu_04,
    ),
    Bug::mutant(
        "PU-05",
        PC_LINK,
        "a list that says 50 and holds one waypoint yields 49 phantoms",
        receiver::pu_05,
    ),
    Bug::mutant(
        "PU-06",
        PC_LINK,
        "poses are written into map rows: both are lost",
        sender::pu_06,
    ),
    Bug::mutant(
        "PU-07",
        PC_LINK,
        "a link to an unknown waypoint is a null pointer: the program ends",
        orders::pu_07,
    ),
    Bug::new(
        "PU-08",
        PC_LINK,
        "the first of three waypoints is deleted: the list names one that is gone, the robot crashes",
        CLIENT,
        pu_08,
    ),
    Bug::mutant(
        "PU-09",
        PC_LINK,
        "two waypoints behind the same one: a link to an object that is gone",
        orders::pu_09,
    ),
    Bug::mutant(
        "PU-10",
        PC_LINK,
        "a shorter list while heading for the third waypoint: the robot drives to (-1, -1)",
        orders::pu_10,
    ),
    Bug::mutant(
        "PU-11",
        PC_LINK,
        "an empty list begins an exploration",
        orders::pu_11,
    ),
    Bug::mutant(
        "PU-12",
        PC_LINK,
        "a list of 21 waypoints overruns the receive queue of 200 bytes",
        receiver::pu_12,
    ),
    Bug::new(
        "PU-13",
        PC_LINK,
        "the 57th waypoint makes a list that the robot does not take, without an error",
        CLIENT,
        pu_13,
    ),
    Bug::mutant(
        "PU-14",
        PC_LINK,
        "one received byte is looked at per row sent: a list takes as many rows as it has bytes",
        receiver::pu_14,
    ),
    Bug::mutant(
        "PU-15",
        PC_LINK,
        "bytes received while the link was switched off are parsed later as a torn frame",
        switched::pu_15,
    ),
    Bug::mutant(
        "PU-16",
        PC_LINK,
        "a byte in the first millisecond after a restart ends the program",
        receiver::pu_16,
    ),
    Bug::mutant(
        "PU-17",
        PC_LINK,
        "once the send queue was full, every byte is sent twice for ever",
        sender::pu_17,
    ),
    Bug::mutant(
        "PU-18",
        PC_LINK,
        "debug text stands inside of frames",
        sender::pu_18,
    ),
    Bug::mutant(
        "PU-19",
        PC_LINK,
        "the last pixel of a coded row is lost",
        sender::pu_19,
    ),
    Bug::mutant(
        "PU-20",
        PC_LINK,
        "an order to drive by hand is forgotten at the next scan",
        orders::pu_20,
    ),
    Bug::mutant(
        "PU-21",
        PC_LINK,
        "the orders to drive by hand stop, the robot does not",
        orders::pu_21,
    ),
    Bug {
        id: "PU-22",
        place: PC_LINK,
        sees: "a payload of 512 bytes is refused though the buffer holds it",
        live: Live::Not(
            "a wrong figure in the document: 511 is the limit of the fielded ends, and is kept there",
        ),
    },
];

/// A waypoint list with the selected faults of the fielded program.
pub(super) fn waypoints(variant: Variant, id: &str) -> Waypoints {
    Waypoints::with_defects(config(variant, id).defects.waypoints)
}
