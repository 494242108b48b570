//! The program of the robot yellow in a closed loop: the acceptance list of its seed, by number.
#![expect(
    clippy::cast_possible_truncation,
    reason = "the figures of a small world are small"
)]

mod bench;
mod framing;
mod lidar;
mod positions;
mod reactive;
mod scans;
mod states;
mod telemetry;
mod total;
mod walls;
mod wheels;
