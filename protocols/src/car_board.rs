//! The board that drives a model car: one byte a command, one frame for all its sensors.
//!
//! ```text
//! motor     1 | level + 10 u7          80 to 94 are levels -10 to 10, 8A stops
//! steering  0 | value + 50 u7          00 to 64 are -50 (left) to 50 (right)
//! frame     00 0F | front u16 | right u16 | left u16 | line u8 | hall u16 | battery u16
//! ```
//!
//! Words are little-endian, ultrasonic ranges centimetres. There is no checksum, and `00 0F` may
//! occur inside a frame: a front range below 256 cm before 15 cm to the right. So the [`Decoder`]
//! requires plausible sensor values, and behind each frame the sync of the next one or a pause.
//! [`FieldedDecoder`] is the method of the car's own program.
//!
//! Source: the car's program (Fujitsu MB96300 board on a Tamiya TT-01, TU Darmstadt 2016).
//! Assumptions without a source: the hall word counts pulses since the start, the battery word is
//! in millivolts, and frames come at 15 Hz, a round of the ultrasonic sensors.

mod command;
mod fielded;
mod frame;
#[cfg(test)]
mod tests;

use core::time::Duration;

pub use command::{Command, CommandError, Level, Steering};
pub use fielded::FieldedDecoder;
pub use frame::{
    BATTERY_MV, Decoder, FRAME_LEN, Frame, FrameFormat, Readings, SYNC, ULTRASONIC_MAX_CM,
};

/// Rate of the line, 8N1.
pub const BAUD: u32 = 115_200;
/// Silence that means a pause between two frames: a frame takes 1.1 ms, the pause behind it 65 ms.
/// Report it to the [`Decoder`] by `idle`; then no frame waits for the next one.
pub const IDLE_GAP: Duration = Duration::from_millis(5);
