//! The base's firmware. Each build is a set of quirks. The sound build is the documented base with
//! the fielded byte order of the checksum, so that both builds accept the same bytes.

mod bench;
mod frames;
mod hardware;

use super::Bug;

const BASE: &str = "base, bus";
const BUILD_2015: &str = "base firmware rcj2015-2015";
const BUILD_2014: &str = "base firmware rcj2015-2014";

/// A defect of both builds.
const fn both(
    id: &'static str,
    sees: &'static str,
    show: fn(super::Variant) -> super::Observation,
) -> Bug {
    Bug::new(id, BASE, sees, BUILD_2015, show)
}

pub(super) const ROWS: [Bug; 25] = [
    both(
        "AV-01",
        "a request with the documented order of the checksum gets the error frame",
        frames::av_01,
    ),
    both(
        "AV-02",
        "a write of registers 45 to 47 sets the speeds but arms no time-out: the robot never stops",
        frames::av_02,
    ),
    both(
        "AV-03a",
        "a read beyond register 52 is answered with the firmware's memory",
        frames::av_03a,
    ),
    both(
        "AV-03b",
        "a write behind the registers is executed, and acknowledged with the bytes of an error",
        frames::av_03b,
    ),
    both(
        "AV-03c",
        "a write behind the registers changes the parser itself and is acknowledged",
        frames::av_03c,
    ),
    both(
        "AV-04",
        "a write of 127 bytes is never answered: its counter of eight bits is signed",
        frames::av_04,
    ),
    both(
        "AV-05",
        "the battery's low byte contains its high byte: 12 V are read as 46 mV",
        hardware::av_05,
    ),
    both(
        "AV-06",
        "a pause of 1.5 ms inside a frame can cause its loss, without an error",
        frames::av_06,
    ),
    both(
        "AV-07",
        "a request immediately after another one is dropped",
        frames::av_07,
    ),
    both(
        "AV-08",
        "a request that arrives during a long reply loses its first bytes",
        frames::av_08,
    ),
    both(
        "AV-09",
        "a stray start byte causes the loss of the request after it",
        frames::av_09,
    ),
    both(
        "AV-10",
        "a stray header consumes the bytes after it",
        frames::av_10,
    ),
    both(
        "AV-11",
        "a write to a read-only register is acknowledged, and lost",
        frames::av_11,
    ),
    both(
        "AV-12",
        "an encoder read while it carries jumps by 256 ticks, 116 mm",
        hardware::av_12,
    ),
    both(
        "AV-13",
        "the speed register shows 100 while the base uses 35",
        hardware::av_13,
    ),
    both(
        "AV-14",
        "speeds of one and two ticks have no proportional part",
        hardware::av_14,
    ),
    both(
        "AV-15",
        "wheels faster than 996 edges per second lose ticks",
        hardware::av_15,
    ),
    both(
        "AV-16",
        "after a watchdog reset the first request is answered five seconds late",
        hardware::av_16,
    ),
    both(
        "AV-17",
        "with debug text enabled, replies arrive after the master's timeout",
        hardware::av_17,
    ),
    both(
        "AV-18",
        "the battery's percentage begins at 0 and never rises",
        hardware::av_18,
    ),
    both(
        "AV-19",
        "an object too near for the infrared sensor reads as negative",
        hardware::av_19,
    ),
    both(
        "AV-20",
        "the acknowledgement of a write to register 255 is the error frame",
        frames::av_20,
    ),
    both(
        "AV-21",
        "a sound frame that ends in a tick's interrupt, between load and test, is never answered",
        frames::av_21,
    ),
    Bug::new(
        "H-AV-1",
        BASE,
        "after a silence the time-out clears the set-points, but the registers restore them",
        BUILD_2014,
        hardware::h_av_1,
    ),
    Bug::new(
        "H-AV-2",
        BASE,
        "speed -20 is read as 236: full speed ahead",
        BUILD_2014,
        hardware::h_av_2,
    ),
];
