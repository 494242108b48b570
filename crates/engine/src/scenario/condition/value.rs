//! Values that conditions compare, and how they compare.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};

/// A value that a condition compares with, or that a run has shown.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a number, a text, true or false")]
pub enum Operand {
    /// True or false; a number is true if it is not 0.
    Flag(bool),
    /// A number.
    Number(f64),
    /// A text, e.g. the name of a state.
    Text(String),
}

impl Operand {
    /// A value as `decode` prints it: a number, decimal or hexadecimal, otherwise a text.
    pub fn from_words(words: &str) -> Self {
        let plain = words.trim().trim_matches('"');
        let hex = plain
            .strip_prefix("0x")
            .map(|hex| u32::from_str_radix(hex, 16));
        if let Some(Ok(number)) = hex {
            return Self::Number(number.into());
        }
        match plain.parse::<f64>() {
            Ok(number) if number.is_finite() => Self::Number(number),
            _ => Self::Text(plain.to_owned()),
        }
    }

    /// The value as a whole number.
    pub(crate) fn whole(&self) -> Result<i64, String> {
        let number = self
            .number()
            .and_then(|number| crate::scenario::SetPoint(number).whole());
        number.ok_or_else(|| format!("is {self}, expected a whole number"))
    }

    fn number(&self) -> Option<f64> {
        match self {
            Self::Flag(is) => Some(f64::from(u8::from(*is))),
            Self::Number(number) => Some(*number),
            Self::Text(_) => None,
        }
    }

    fn flag(&self) -> Option<bool> {
        match self {
            Self::Flag(is) => Some(*is),
            Self::Number(number) => Some(*number != 0.0),
            Self::Text(text) => match text.as_str() {
                "true" | "yes" | "on" => Some(true),
                "false" | "no" | "off" => Some(false),
                _ => None,
            },
        }
    }
}

impl From<f64> for Operand {
    fn from(number: f64) -> Self {
        Self::Number(number)
    }
}

impl fmt::Display for Operand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Flag(is) => write!(f, "{is}"),
            // Six digits are enough for any figure of a device; further digits are rounding noise.
            Self::Number(number) => write!(f, "{}", (number * 1e6).round() / 1e6),
            Self::Text(text) => write!(f, "\"{text}\""),
        }
    }
}

impl Serialize for Operand {
    /// Whole numbers are written without a fraction.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Flag(is) => serializer.serialize_bool(*is),
            Self::Number(number) => crate::scenario::SetPoint(*number).serialize(serializer),
            Self::Text(text) => serializer.serialize_str(text),
        }
    }
}

/// How two values compare.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Op {
    /// Equal.
    #[default]
    #[serde(rename = "==")]
    Equal,
    /// Not equal.
    #[serde(rename = "!=")]
    Unequal,
    /// Less.
    #[serde(rename = "<")]
    Less,
    /// Less or equal.
    #[serde(rename = "<=")]
    AtMost,
    /// Greater.
    #[serde(rename = ">")]
    Greater,
    /// Greater or equal.
    #[serde(rename = ">=")]
    AtLeast,
}

impl Op {
    /// Whether the comparison of `left` with `right` is true.
    pub fn holds<T: PartialOrd>(self, left: &T, right: &T) -> bool {
        match self {
            Self::Equal => left == right,
            Self::Unequal => left != right,
            Self::Less => left < right,
            Self::AtMost => left <= right,
            Self::Greater => left > right,
            Self::AtLeast => left >= right,
        }
    }

    /// Compares values of any type. `None` if they cannot be compared, because their types differ
    /// or one of them is NaN.
    pub fn compares(self, found: &Operand, wanted: &Operand) -> Option<bool> {
        if let Operand::Flag(wanted) = wanted {
            return found.flag().map(|found| self.holds(&found, wanted));
        }
        match (found.number(), wanted.number(), found, wanted) {
            (Some(found), Some(wanted), ..) if found.is_nan() || wanted.is_nan() => None,
            (Some(found), Some(wanted), ..) => Some(self.holds(&found, &wanted)),
            (.., Operand::Text(found), Operand::Text(wanted)) => Some(self.holds(found, wanted)),
            _ => None,
        }
    }

    /// Whether the operator compares the order and not equality.
    pub const fn is_of_order(self) -> bool {
        !matches!(self, Self::Equal | Self::Unequal)
    }

    const fn sign(self) -> &'static str {
        match self {
            Self::Equal => "==",
            Self::Unequal => "!=",
            Self::Less => "<",
            Self::AtMost => "<=",
            Self::Greater => ">",
            Self::AtLeast => ">=",
        }
    }
}

impl fmt::Display for Op {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.sign())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers compare as numbers, texts as texts. A text and a number do not compare, nor does
    /// NaN.
    #[test]
    fn values_of_any_type_compare() {
        let number = |value: f64| Operand::Number(value);
        let text = |words: &str| Operand::Text(words.to_owned());
        let rows = [
            (Op::Greater, number(3.0), number(2.5), Some(true)),
            (Op::Equal, text("idle"), text("idle"), Some(true)),
            (Op::Equal, text("idle"), text("busy"), Some(false)),
            (Op::Unequal, text("idle"), number(1.0), None),
            (Op::AtLeast, text("idle"), number(1.0), None),
            (Op::Equal, number(2.0), Operand::Flag(true), Some(true)),
            (Op::Equal, text("off"), Operand::Flag(false), Some(true)),
            (Op::Equal, text("idle"), Operand::Flag(true), None),
            (Op::Unequal, text("idle"), Operand::Flag(true), None),
            (Op::Unequal, number(f64::NAN), number(1.0), None),
            (Op::Less, number(f64::NAN), number(1.0), None),
        ];
        for (op, found, wanted, holds) in rows {
            assert_eq!(op.compares(&found, &wanted), holds, "{found} {op} {wanted}");
        }
    }

    #[test]
    fn words_become_numbers_where_they_are_numbers() {
        let rows = [
            ("12.5", Operand::Number(12.5)),
            ("0x1F", Operand::Number(31.0)),
            ("\"on\"", Operand::Text("on".to_owned())),
            ("nan", Operand::Text("nan".to_owned())),
        ];
        for (words, value) in rows {
            assert_eq!(Operand::from_words(words), value, "{words}");
        }
    }
}
