//! Lengths of time as files have them.

use core::fmt;
use core::time::Duration;
use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer};

/// A length of time: a number and its unit, such as `90s`, `1.5s`, `200ms` or `25us`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span(pub Duration);

const UNITS: [(&str, u32); 6] = [
    ("min", 60),
    ("ns", 0),
    ("us", 0),
    ("ms", 0),
    ("s", 1),
    ("h", 3_600),
];
const MAX: Duration = Duration::from_secs(7 * 86_400);

impl core::str::FromStr for Span {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "\"{text}\" is no time, expected a number with its unit such as \"90s\" or \
                 \"200ms\""
            )
        };
        let text = text.trim();
        let split = text
            .find(|c: char| c.is_ascii_alphabetic())
            .ok_or_else(wrong)?;
        let (number, unit) = text.split_at(split);
        let number = number.trim();
        let &(_, seconds) = UNITS
            .iter()
            .find(|(name, _)| *name == unit)
            .ok_or_else(wrong)?;
        let is_plain = number
            .bytes()
            .all(|byte| byte.is_ascii_digit() || byte == b'.');
        let count = number
            .parse::<f64>()
            .ok()
            .filter(|_| is_plain)
            .ok_or_else(wrong)?;
        let factor = match unit {
            "ns" => 1e-9,
            "us" => 1e-6,
            "ms" => 1e-3,
            _ => f64::from(seconds),
        };
        let total = Duration::try_from_secs_f64(count * factor).ok();
        total
            .filter(|total| *total <= MAX)
            .map(Self)
            .ok_or_else(|| format!("\"{text}\" is too long, expected a week at most"))
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let nanos = self.0.as_nanos();
        let units = [
            ("s", 1_000_000_000),
            ("ms", 1_000_000),
            ("us", 1_000),
            ("ns", 1),
        ];
        let fitting = units
            .into_iter()
            .find(|(_, size)| nanos.is_multiple_of(*size));
        let (unit, size) = fitting.unwrap_or(("ns", 1));
        write!(f, "{} {unit}", nanos / size)
    }
}

impl JsonSchema for Span {
    fn schema_name() -> Cow<'static, str> {
        "Time".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "type": "string",
            "description": "A length of time, at most a week: a number and its unit, one of `ns`, \
                `us`, `ms`, `s`, `min`, `h`.",
            "pattern": "^ *[0-9.]+ *(ns|us|ms|s|min|h) *$",
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
