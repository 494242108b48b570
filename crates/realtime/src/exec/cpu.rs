//! The price of computing for a program in virtual time.

use core::fmt;
use core::str::FromStr;

/// Virtual time that a program's computing takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cpu {
    /// Measured processor time, multiplied by this factor in thousandths.
    Scale(u32),
    /// The virtual time that the scenario's table `[computing]` records.
    OfCase,
}

/// Thousandths of one.
const ONE: u32 = 1_000;
/// Greatest factor.
const SCALE_MAX: f64 = 10_000.0;

impl Cpu {
    /// The factor as a number.
    pub fn scale(self) -> Option<f64> {
        match self {
            Self::Scale(thousandths) => Some(f64::from(thousandths) / f64::from(ONE)),
            Self::OfCase => None,
        }
    }
}

impl FromStr for Cpu {
    type Err = String;

    /// Reads a factor, or `case` for the times that a saved case records.
    fn from_str(text: &str) -> Result<Self, String> {
        if text == "case" {
            return Ok(Self::OfCase);
        }
        let scale: Option<f64> = text.parse().ok();
        let scale = scale.filter(|scale| (0.001..=SCALE_MAX).contains(scale));
        #[expect(
            clippy::cast_possible_truncation,
            reason = "at most 10 million, and above 0"
        )]
        let thousandths = scale.map(|scale| (scale * f64::from(ONE)).round() as u32);
        thousandths.map(Self::Scale).ok_or_else(|| {
            "expected a factor from 0.001 to 10000, or \"case\" for the times of a saved case"
                .to_owned()
        })
    }
}

impl fmt::Display for Cpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.scale() {
            Some(scale) => write!(f, "{scale}"),
            None => f.write_str("case"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_numbers_above_zero() {
        for (text, expected) in [
            ("20", Cpu::Scale(20_000)),
            ("0.5", Cpu::Scale(500)),
            ("case", Cpu::OfCase),
        ] {
            assert_eq!(text.parse(), Ok(expected));
            assert_eq!(expected.to_string(), text);
        }
        for text in ["0", "-1", "nan", "inf", "10001", "", "seed"] {
            assert!(text.parse::<Cpu>().is_err(), "{text}");
        }
    }
}
