//! The rescue robot's program in a closed loop: short scenarios, each of which guards against one
//! failure.
#![expect(
    clippy::cast_possible_truncation,
    reason = "the figures of a small world are small"
)]

mod bench;
mod driving;
mod faults;
mod radio;
mod total;
