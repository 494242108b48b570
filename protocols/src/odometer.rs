//! Text lines of a microcontroller that counts a wheel's encoder and integrates a gyroscope.
//!
//! ```text
//! Seed      distance m * rate rad/s * yaw deg * time s  * sum *
//! AsCoded   distance m * rate rad/s * yaw rad * time ms * sum, rate scaled a second time *
//! Fixed     distance mm * rate mrad/s * yaw mrad * time ms * CRC-16, four digits *
//! Raw       # distance * three rates * three accelerations * three fields *        no sum
//! ```
//!
//! Lines end in CR LF, fields in `*`. Figures of `Seed`, `AsCoded` and `Raw` are printed with two
//! decimals like the Arduino's, see [`print_float`]. The last digit of a sum need not be the sum of
//! last digits, and from 131 s on a 32-bit float of milliseconds has not even hundredths. So a host
//! that compares sums exactly discards most lines of a curve. [`Dialect::read`] allows for the
//! rounding.
//!
//! Sources: report (`Seed`), sketch of March 2016 (`AsCoded`), later sketch (`Raw`; its units are
//! not documented). `Fixed` is the rig's own.

mod exact;
mod float;
mod reading;
#[cfg(test)]
mod tests;
mod text;

pub use exact::passes_exact_sum;
pub use float::print_float;
pub use reading::{LineError, Raw, Reading};
pub use text::{Decoder, LINE_MAX, Text, TextFormat};

use core::fmt::Write as _;

/// Rate of the line, 8N1; a USB port of the board, so nothing depends on it.
pub const BAUD: u32 = 115_200;

/// Factor by which the sketch scales the raw rate: 25 degrees a second for 2000 counts. The
/// sensor's range of 2000 degrees a second has 0.061 degrees a count, 4.88 times as much.
const RATE_SCALE: [f32; 2] = [25.0, 2000.0];

/// Meaning of the numbers, and their protection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dialect {
    /// Format of the report.
    Seed,
    /// Format of the sketch of March 2016.
    #[default]
    AsCoded,
    /// Whole numbers and a CRC-16 (CCITT, first value FFFF) over all before it.
    Fixed,
}

/// State of the microcontroller when it prints a line. 32-bit floats, because it has no others.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measurement {
    /// Distance since the start, metres; backwards counts down.
    pub distance_m: f32,
    /// The printed turn rate, rad/s, counter-clockwise.
    pub rate_rad_s: f32,
    /// Heading since the start, radians, counter-clockwise.
    pub yaw_rad: f32,
    /// Since the start; wraps after 49 days.
    pub time_ms: u32,
}

impl Dialect {
    /// The line, with its end.
    pub fn line(self, measured: &Measurement) -> Text {
        let Measurement {
            distance_m,
            rate_rad_s,
            yaw_rad,
            time_ms,
        } = *measured;
        let mut line = Text::default();
        match self {
            Self::Seed => {
                let (yaw, time) = (yaw_rad.to_degrees(), seconds(time_ms));
                let sum = distance_m + rate_rad_s + yaw + time;
                for figure in [distance_m, rate_rad_s, yaw, time, sum] {
                    line.field(figure);
                }
            }
            Self::AsCoded => {
                for figure in [distance_m, rate_rad_s, yaw_rad] {
                    line.field(figure);
                }
                let _ = write!(line, "{time_ms}*");
                line.field(coded_sum([distance_m, rate_rad_s, yaw_rad, float(time_ms)]));
            }
            Self::Fixed => {
                let [distance, rate, yaw] = [distance_m, rate_rad_s, yaw_rad].map(thousandths);
                let _ = write!(line, "{distance}*{rate}*{yaw}*{time_ms}*");
                let crc = crc16(line.as_bytes());
                let _ = write!(line, "{crc:04X}*");
            }
        }
        let _ = line.write_str("\r\n");
        line
    }
}

/// The sum as the sketch has it: in this order, the rate scaled once more.
fn coded_sum([distance, rate, yaw, time]: [f32; 4]) -> f32 {
    let [factor, divisor] = RATE_SCALE;
    distance + rate * factor / divisor + yaw + time
}

#[expect(clippy::cast_precision_loss, reason = "as the microcontroller does it")]
const fn float(time_ms: u32) -> f32 {
    time_ms as f32
}

fn seconds(time_ms: u32) -> f32 {
    float(time_ms) / 1000.0
}

/// Rounded, halves away from zero.
fn thousandths(value: f32) -> i32 {
    let value = f64::from(value) * 1000.0;
    #[expect(clippy::cast_possible_truncation, reason = "saturates, which is meant")]
    let whole = (value + 0.5_f64.copysign(value)) as i32;
    whole
}

/// CRC-16 of CCITT with first value FFFF: polynomial 1021, highest bit first.
fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc, _| {
            let carry = crc & 0x8000 != 0;
            crc << 1 ^ if carry { 0x1021 } else { 0 }
        })
    })
}
