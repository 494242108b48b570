//! The rescue robot's program in a closed loop: small stories, each with what is at stake.
#![expect(
    clippy::cast_possible_truncation,
    reason = "the figures of a small world are small"
)]

mod bench;
mod driving;
mod faults;
mod radio;
mod total;
