//! Measured computing time of a program in virtual time, a part of a saved case.

use core::fmt::{self, Write as _};
use core::str::FromStr;
use core::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Virtual time of one unit of a charge. A finer unit would make cases larger, but verdicts no
/// better: processor time differs by more than that from run to run.
pub const CHARGE_UNIT: Duration = Duration::from_micros(100);
/// Longest charge, one hour.
const UNITS_MAX: u32 = 36_000_000;

/// Computing of a program in virtual time, as `--cpu SCALE` measured it in one run; written by the
/// rig. `--cpu case` charges the same again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ComputingSpec {
    /// Scale with which the computing was measured.
    #[serde(deserialize_with = "scale")]
    pub scale: f64,
    /// Number of calls at which computing could be charged.
    pub calls: u64,
    /// Fingerprint of these calls and their threads.
    pub fingerprint: String,
    /// Files that ran, executables and scripts of interpreters: name and fingerprint of each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub programs: Vec<String>,
    /// Charges of each thread, in the order in which the threads began: `STEP:UNITS` for each, the
    /// number of calls since the charge before and the charge in units of 100 us.
    #[schemars(with = "Vec<String>")]
    pub charges: Vec<Charges>,
}

fn scale<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let scale = f64::deserialize(deserializer)?;
    match scale > 0.0 && scale.is_finite() {
        true => Ok(scale),
        false => {
            let message = format!("scale is {scale}, expected a number above 0");
            Err(serde::de::Error::custom(message))
        }
    }
}

/// Charges of one thread: number of the call, from 1, and number of units.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Charges(pub Vec<(u64, u32)>);

impl FromStr for Charges {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut call = 0_u64;
        let charges = text.split_ascii_whitespace().map(|word| {
            let read = word.split_once(':').and_then(|(step, units)| {
                let step: u32 = step.parse().ok().filter(|&step| step > 0)?;
                call += u64::from(step);
                let units = units.parse().ok()?;
                (1..=UNITS_MAX).contains(&units).then_some((call, units))
            });
            read.ok_or_else(|| {
                format!(
                    "a charge is \"{word}\", expected STEP:UNITS as in \"12:3\", a step from 1 and \
                     1 to {UNITS_MAX} units; let the rig write them with --cpu SCALE"
                )
            })
        });
        charges.collect::<Result<_, _>>().map(Self)
    }
}

impl fmt::Display for Charges {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut before = 0;
        for &(call, units) in &self.0 {
            if before > 0 {
                f.write_char(' ')?;
            }
            write!(f, "{}:{units}", call - before)?;
            before = call;
        }
        Ok(())
    }
}

impl Serialize for Charges {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Charges {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: charges at calls 3, 4 and 14.
    #[test]
    fn charges_are_steps_and_units() {
        let charges = Charges(vec![(3, 52), (4, 1), (14, 7)]);
        assert_eq!(charges.to_string(), "3:52 1:1 10:7");
        assert_eq!("3:52 1:1 10:7".parse(), Ok(charges));
        assert_eq!("".parse(), Ok(Charges::default()));
        for wrong in [
            "3",
            "0:1",
            "3:0",
            "-1:4",
            "3:36000001",
            "4294967296:1",
            "3:1,4:1",
        ] {
            let error = wrong.parse::<Charges>().expect_err(wrong);
            assert!(error.contains("expected STEP:UNITS"), "{error}");
        }
    }
}
