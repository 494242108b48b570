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
        "a stray P before a frame causes the loss of the frame",
        receiver::pu_01,
    ),
    Bug::mutant(
        "PU-02",
        PC_LINK,
        "a checksum whose second byte is 80 or more is rejected",
        receiver::pu_02,
    ),
    Bug::mutant(
        "PU-03",
        PC_LINK,
        "after a header with a length of 8000 the receiver ignores all frames until a restart",
        receiver::pu_03,
    ),
    Bug::mutant(
        "PU-04",
        PC_LINK,
        "a frame without payload consumes a byte of the next frame, which is lost",
        receiver::pu_04,
    ),
    Bug::mutant(
        "PU-05",
        PC_LINK,
        "a list with the count 50 and one waypoint yields 49 false waypoints",
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
        "the first of three waypoints is deleted: the list refers to it, and the robot crashes",
        CLIENT,
        pu_08,
    ),
    Bug::mutant(
        "PU-09",
        PC_LINK,
        "two waypoints after the same one: a link to a deleted object",
        orders::pu_09,
    ),
    Bug::mutant(
        "PU-10",
        PC_LINK,
        "a shorter list arrives on the drive to the third waypoint: the robot drives to (-1, -1)",
        orders::pu_10,
    ),
    Bug::mutant(
        "PU-11",
        PC_LINK,
        "an empty list starts an exploration",
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
        "with the 57th waypoint the robot ignores the list, without an error",
        CLIENT,
        pu_13,
    ),
    Bug::mutant(
        "PU-14",
        PC_LINK,
        "the program reads one byte per sent row: a list takes as many rows as it has bytes",
        receiver::pu_14,
    ),
    Bug::mutant(
        "PU-15",
        PC_LINK,
        "bytes received while the link is switched off are parsed later as a broken frame",
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
        "after the send queue was full, every byte is sent twice",
        sender::pu_17,
    ),
    Bug::mutant(
        "PU-18",
        PC_LINK,
        "debug text appears inside of frames",
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
        "an order to drive by hand is lost at the next scan",
        orders::pu_20,
    ),
    Bug::mutant(
        "PU-21",
        PC_LINK,
        "the orders to drive by hand end, but the robot keeps driving",
        orders::pu_21,
    ),
    Bug {
        id: "PU-22",
        place: PC_LINK,
        sees: "a payload of 512 bytes is rejected although the buffer has room",
        live: Live::Not(
            "a wrong figure in the document: both fielded programs have the limit 511 and keep it",
        ),
    },
];

/// A waypoint list with the selected faults of the fielded program.
pub(super) fn waypoints(variant: Variant, id: &str) -> Waypoints {
    Waypoints::with_defects(config(variant, id).defects.waypoints)
}
