//! Content of a line, verified as far as its dialect allows.

use core::fmt;

use super::{Dialect, RATE_SCALE, crc16};

/// Maximum change of a sum of five figures when each is printed with two decimals.
const ROUNDING: f64 = 5.0 * 0.005;

/// The figures of a verified line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Distance since the start, metres; backwards counts down.
    pub distance_m: f64,
    /// Reported turn rate, rad/s, counter-clockwise. In [`Dialect::AsCoded`] 4.88 times too small.
    pub rate_rad_s: f64,
    /// Heading since the start, radians, counter-clockwise.
    pub yaw_rad: f64,
    /// Since the start, seconds.
    pub time_s: f64,
}

/// The figures of a line of the later sketch. It has no sum, so only its form is verified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Raw {
    /// Distance since the start.
    pub distance: f64,
    /// Turn rates about x, y and z, radians a second in the published sketch.
    pub rates: [f64; 3],
    /// Accelerations along x, y and z.
    pub accelerations: [f64; 3],
    /// Magnetic field along x, y and z.
    pub field: [f64; 3],
}

impl Raw {
    /// Reads the content of a line.
    ///
    /// # Errors
    /// If `content` is no such line.
    pub fn read(content: &[u8]) -> Result<Self, LineError> {
        let content = content.strip_prefix(b"#").ok_or(LineError::Text)?;
        let fields: [&[u8]; 10] = fields(content)?;
        let mut figures = [0.0; 10];
        for (index, field) in fields.into_iter().enumerate() {
            figures[index] = decimal(index, field)?;
        }
        let [distance, w0, w1, w2, a0, a1, a2, m0, m1, m2] = figures;
        Ok(Self {
            distance,
            rates: [w0, w1, w2],
            accelerations: [a0, a1, a2],
            field: [m0, m1, m2],
        })
    }
}

impl Dialect {
    /// Reads and verifies the content of a line. A sum of printed decimals may be off by the
    /// rounding of five figures and by one unit in the last place of a 32-bit time; the CRC must
    /// hold.
    ///
    /// # Errors
    /// If the content is no line of this dialect, or is damaged.
    pub fn read(self, content: &[u8]) -> Result<Reading, LineError> {
        let fields: [&[u8]; 5] = fields(content)?;
        if self == Self::Fixed {
            return read_fixed(content, fields);
        }
        let mut figures = [0.0; 5];
        for (index, field) in fields.into_iter().enumerate() {
            figures[index] = decimal(index, field)?;
        }
        let [distance, rate, yaw, time, found] = figures;
        let (scale, yaw_rad, time_s) = match self {
            Self::Seed => (1.0, yaw.to_radians(), time),
            _ => (
                f64::from(RATE_SCALE[0]) / f64::from(RATE_SCALE[1]),
                yaw,
                time / 1000.0,
            ),
        };
        let expected = distance + rate * scale + yaw + time;
        let allowed = ROUNDING + last_place(expected.abs().max(time));
        // No 32-bit float has a last place beyond its range: then the time is not valid.
        if allowed.is_nan() || (expected - found).abs() > allowed {
            return Err(LineError::Sum { expected, found });
        }
        Ok(Reading {
            distance_m: distance,
            rate_rad_s: rate,
            yaw_rad,
            time_s,
        })
    }
}

fn read_fixed(content: &[u8], fields: [&[u8]; 5]) -> Result<Reading, LineError> {
    let [distance, rate, yaw, time, digits] = fields;
    let covered = &content[..content.len() - digits.len() - 1];
    let expected = crc16(covered);
    let found = hex(digits).ok_or(LineError::Number { field: 4 })?;
    if found != expected {
        return Err(LineError::Crc { expected, found });
    }
    let whole = |field, digits| decimal(field, digits);
    Ok(Reading {
        distance_m: whole(0, distance)? / 1000.0,
        rate_rad_s: whole(1, rate)? / 1000.0,
        yaw_rad: whole(2, yaw)? / 1000.0,
        time_s: whole(3, time)? / 1000.0,
    })
}

/// The fields of a line that has `N`, each followed by `*`.
fn fields<const N: usize>(content: &[u8]) -> Result<[&[u8]; N], LineError> {
    let stars = content.iter().filter(|byte| **byte == b'*').count();
    if stars == 0 {
        return Err(LineError::Text);
    }
    let Some(content) = content.strip_suffix(b"*").filter(|_| stars == N) else {
        return Err(LineError::Fields { found: stars });
    };
    let mut fields = content.split(|byte| *byte == b'*');
    Ok(core::array::from_fn(|_| fields.next().unwrap_or_default()))
}

/// A decimal number as an Arduino prints it: no exponent, no `+`, a digit on each side of a point.
fn decimal(field: usize, text: &[u8]) -> Result<f64, LineError> {
    let digits = text.strip_prefix(b"-").unwrap_or(text);
    let is_plain = digits
        .iter()
        .all(|byte| byte.is_ascii_digit() || *byte == b'.')
        && digits.first().is_some_and(u8::is_ascii_digit)
        && digits.last().is_some_and(u8::is_ascii_digit);
    let text = str::from_utf8(text).ok().filter(|_| is_plain);
    let number = text.and_then(|text| text.parse().ok());
    number.ok_or(LineError::Number { field })
}

/// Four digits, capitals.
fn hex(text: &[u8]) -> Option<u16> {
    if text.len() != 4 || text.iter().any(u8::is_ascii_lowercase) {
        return None;
    }
    // A sign would be taken by the parser.
    let text = str::from_utf8(text)
        .ok()
        .filter(|text| !text.starts_with('+'))?;
    u16::from_str_radix(text, 16).ok()
}

/// Distance from a positive number to the next one in 32 bits.
fn last_place(number: f64) -> f64 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "to 32 bits, which is meant"
    )]
    let number = number as f32;
    f64::from(number.next_up()) - f64::from(number)
}

/// Error of an invalid line.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum LineError {
    /// Words instead of figures: the sketch found no sensor, or the line is empty.
    Text,
    /// Another number of fields, or something behind the last.
    Fields {
        /// Number of fields found.
        found: usize,
    },
    /// A field is no number.
    Number {
        /// Index of the field.
        field: usize,
    },
    /// The sum is farther off than rounding explains.
    Sum {
        /// The sum of the figures.
        expected: f64,
        /// The sum in the line.
        found: f64,
    },
    /// The CRC is wrong.
    Crc {
        /// The CRC of the line's bytes.
        expected: u16,
        /// The CRC in the line.
        found: u16,
    },
}

impl fmt::Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Text => f.write_str("line has no figures"),
            Self::Fields { found } => write!(f, "line has {found} fields"),
            Self::Number { field } => write!(f, "field {field} is no number"),
            Self::Sum { expected, found } => write!(f, "sum is {found:.2}, expected {expected:.2}"),
            Self::Crc { expected, found } => {
                write!(f, "CRC is {found:04X}, expected {expected:04X}")
            }
        }
    }
}

impl core::error::Error for LineError {}
