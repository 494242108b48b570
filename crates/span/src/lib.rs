//! Durations and names in files and on command lines.

pub mod near;

use core::fmt;
use core::time::Duration;
use std::borrow::Cow;

use protocols::Instant;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A length of time as written in a file or on the command line: a number and its unit, such as
/// `90s`, `1.5s`, `200ms`, `25us`, `4ns`, `20min` or `20m`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span(pub Duration);

const UNITS: [(&str, u64); 7] = [
    ("min", 60_000_000_000),
    ("m", 60_000_000_000),
    ("ns", 1),
    ("us", 1_000),
    ("ms", 1_000_000),
    ("s", 1_000_000_000),
    ("h", 3_600_000_000_000),
];

/// Longest span: a week.
const MAX: Duration = Duration::from_secs(7 * 86_400);

impl Span {
    /// A span of `millis` milliseconds.
    pub const fn from_millis(millis: u64) -> Self {
        Self(Duration::from_millis(millis))
    }

    /// The time this long after the beginning of the run.
    pub fn instant(self) -> Instant {
        Instant::ZERO + self.0
    }
}

impl core::str::FromStr for Span {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let error = || {
            format!(
                "\"{text}\" is no time, expected a number with its unit such as \"90s\" or \"200ms\""
            )
        };
        let too_long = || format!("\"{text}\" is too long, expected a week at most");
        let text = text.trim();
        let split = text
            .find(|c: char| c.is_ascii_alphabetic())
            .ok_or_else(error)?;
        let (number, unit) = text.split_at(split);
        let number = number.trim();
        let &(_, nanos) = UNITS
            .iter()
            .find(|(name, _)| *name == unit)
            .ok_or_else(error)?;
        if let Ok(whole) = number.parse::<u64>() {
            let total = whole.checked_mul(nanos).map(Duration::from_nanos);
            return total
                .filter(|&total| total <= MAX)
                .map(Self)
                .ok_or_else(too_long);
        }
        let plain = number.bytes().all(|b| b.is_ascii_digit() || b == b'.');
        let count = number.parse::<f64>().ok().filter(|_| plain);
        let seconds = count.ok_or_else(error)? * (nanos as f64 / 1e9);
        let total = Duration::try_from_secs_f64(seconds).ok();
        total
            .filter(|&total| total <= MAX)
            .map(Self)
            .ok_or_else(too_long)
    }
}

impl fmt::Display for Span {
    /// Formats in the largest unit that gives a whole number.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let nanos = self.0.as_nanos();
        let fitting = [
            ("s", 1_000_000_000),
            ("ms", 1_000_000),
            ("us", 1_000),
            ("ns", 1),
        ];
        let (unit, size) = fitting
            .into_iter()
            .find(|(_, size)| nanos.is_multiple_of(*size))
            .expect("everything is a whole number of nanoseconds");
        write!(f, "{}{unit}", nanos / size)
    }
}

impl Serialize for Span {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl JsonSchema for Span {
    fn schema_name() -> Cow<'static, str> {
        "Span".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "type": "string",
            "description": "A length of time, at most a week: a number and its unit, one of `ns`, \
                `us`, `ms`, `s`, `min` or `m`, `h`.",
            "pattern": "^ *[0-9.]+ *(ns|us|ms|s|min|m|h) *$",
            "examples": ["90s", "200ms"],
        })
    }
}

impl<'de> Deserialize<'de> for Span {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Text;
        impl Visitor<'_> for Text {
            type Value = Span;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a time with its unit such as \"90s\" or \"200ms\"")
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Span, E> {
                text.parse().map_err(E::custom)
            }
        }
        deserializer.deserialize_str(Text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_is_a_number_with_a_unit() {
        let nanos = |text: &str| text.parse::<Span>().map(|span| span.0.as_nanos());
        assert_eq!(nanos("90s"), Ok(90_000_000_000));
        assert_eq!(nanos("1.5 s"), Ok(1_500_000_000));
        assert_eq!(nanos("20min"), Ok(1_200_000_000_000));
        assert_eq!(nanos("7m"), Ok(420_000_000_000));
        assert_eq!(nanos("21701ns"), Ok(21_701));
        assert!(nanos("90").is_err());
        assert!(nanos("s").is_err());
        assert!(nanos("-1s").is_err());
        assert!(nanos("infs").is_err());
        assert!(nanos("9999999h").is_err());
        assert!(nanos("5 parsecs").is_err());
    }

    /// U10: seven days are 604,800 s. The error for a longer span names this limit; the error for a
    /// text that is no number does not.
    #[test]
    fn u10_a_span_beyond_a_week_names_its_limit() {
        let read = |text: &str| text.parse::<Span>();
        assert_eq!(read("604800s"), Ok(Span(MAX)));
        assert_eq!(read("604800.0s"), Ok(Span(MAX)));
        for text in [
            "604801s",
            "604800.1s",
            "1000000000000000000s",
            "9999999999.5h",
        ] {
            let error = read(text).expect_err(text);
            assert!(
                error.ends_with("is too long, expected a week at most"),
                "{error}"
            );
        }
        for text in ["1e18s", "90", "5 parsecs", "..s"] {
            assert!(read(text).expect_err(text).contains("is no time"), "{text}");
        }
    }

    #[test]
    fn a_span_is_written_as_it_is_read() {
        for text in ["90s", "1500ms", "21701ns", "0s"] {
            assert_eq!(text.parse::<Span>().expect("a span").to_string(), text);
        }
    }
}
