//! The text of a message: words and fields.
//!
//! ```text
//! SPEED {left} {right}          a number each, in plain form
//! {lat:09.4f},{fix?}            nine characters with four decimals; an optional field
//! {address:02X} {name:s}        two hexadecimal digits; text
//! ```

use crate::expr::Scope;
use crate::field::Field;
use crate::value::{Record, Value};

/// A piece of a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Piece {
    Words(String),
    Hole(Hole),
}

/// A field within a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Hole {
    /// The text in braces.
    source: String,
    pub(crate) name: String,
    pub(crate) form: Form,
    /// Minimum number of characters, padded with zeros or spaces.
    pub(crate) width: usize,
    has_zeros: bool,
    has_sign: bool,
    precision: Option<usize>,
    pub(crate) is_optional: bool,
}

/// The format of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Form {
    /// A number, with decimals if it has any.
    Plain,
    /// A whole number.
    Decimal,
    /// A number with decimals.
    Fixed,
    /// An integer in upper-case hexadecimal digits.
    Hex,
    /// An integer in lower-case hexadecimal digits.
    SmallHex,
    /// Text.
    Text,
}

/// Splits a text at its fields; `{{` is a literal brace.
///
/// # Errors
/// If a field in braces is malformed.
pub(crate) fn pieces(text: &str) -> Result<Vec<Piece>, String> {
    let mut pieces = Vec::new();
    let mut words = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(['{', '}']) {
        let (before, behind) = rest.split_at(at);
        words += before;
        if let Some(after) = behind.strip_prefix("{{") {
            words.push('{');
            rest = after;
        } else if let Some(after) = behind.strip_prefix("}}") {
            words.push('}');
            rest = after;
        } else {
            let inner = behind
                .strip_prefix('{')
                .and_then(|inner| inner.split_once('}'));
            let (hole, after) =
                inner.ok_or_else(|| format!("\"{text}\" has a brace without its partner, expected {{{{ and }}}} for literal braces"))?;
            if !words.is_empty() {
                pieces.push(Piece::Words(core::mem::take(&mut words)));
            }
            pieces.push(Piece::Hole(Hole::parse(hole)?));
            rest = after;
        }
    }
    words += rest;
    if !words.is_empty() {
        pieces.push(Piece::Words(words));
    }
    Ok(pieces)
}

impl Hole {
    fn parse(text: &str) -> Result<Self, String> {
        let (name, form) = text.split_once(':').unwrap_or((text, ""));
        let is_optional = text.ends_with('?');
        let name = name.trim_end_matches('?').trim().to_owned();
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
        if name.is_empty() || !name.chars().all(is_name) {
            return Err(format!(
                "{{{text}}}: expected a name of letters, digits and _"
            ));
        }
        let wrong = || {
            format!(
                "{{{text}}}: expected a format such as d, 05d, .2f, 08.3f, 02X or s behind the :"
            )
        };
        let form = form.trim_end_matches('?');
        let (has_sign, form) = form
            .strip_prefix('+')
            .map_or((false, form), |rest| (true, rest));
        let has_zeros = form.starts_with('0');
        let digits = form.bytes().take_while(u8::is_ascii_digit).count();
        let (width, form) = form.split_at(digits);
        let width = if width.is_empty() {
            0
        } else {
            width.parse().map_err(|_| wrong())?
        };
        let (precision, form) = match form.strip_prefix('.') {
            None => (None, form),
            Some(rest) => {
                let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
                let (precision, form) = rest.split_at(digits);
                (Some(precision.parse().map_err(|_| wrong())?), form)
            }
        };
        let form = match form {
            "" if precision.is_none() => Form::Plain,
            "d" => Form::Decimal,
            "f" | "" => Form::Fixed,
            "X" => Form::Hex,
            "x" => Form::SmallHex,
            "s" => Form::Text,
            _ => return Err(wrong()),
        };
        if width > 64 || precision.is_some_and(|precision| precision > 15) {
            return Err(wrong());
        }
        Ok(Self {
            source: text.to_owned(),
            name,
            form,
            width,
            has_zeros,
            has_sign,
            precision,
            is_optional,
        })
    }

    /// The exact number of characters, if it is fixed: no delimiter is then needed.
    pub(crate) fn fixed_width(&self) -> Option<usize> {
        match self.form {
            Form::Text => self.precision,
            _ => (self.has_zeros && self.width > 0).then_some(self.width),
        }
    }

    fn write(&self, value: &Value, out: &mut String) {
        let sign = if self.has_sign && value.as_f64().is_some_and(|of| of >= 0.0) {
            "+"
        } else {
            ""
        };
        let text = match (self.form, value) {
            (Form::Text, Value::Text(text)) => text.clone(),
            (Form::Plain, Value::Text(text)) => text.clone(),
            // As in binary fields, so that it is read again.
            (Form::Plain, Value::Bool(is)) => u8::from(*is).to_string(),
            (Form::Plain | Form::Text, other) => other.to_string(),
            (Form::Fixed, other) => {
                let digits = self.precision.unwrap_or(6);
                format!("{:.digits$}", other.as_f64().unwrap_or(0.0))
            }
            (Form::Decimal, other) => other.as_int().unwrap_or(0).to_string(),
            (Form::Hex, other) => format!("{:X}", other.as_int().unwrap_or(0).max(0)),
            (Form::SmallHex, other) => format!("{:x}", other.as_int().unwrap_or(0).max(0)),
        };
        if self.form == Form::Text {
            let kept: String = match self.precision {
                Some(most) => format!("{text:most$.most$}"),
                None => text,
            };
            *out += &format!("{kept:<width$}", width = self.width);
            return;
        }
        let (minus, digits) = text
            .strip_prefix('-')
            .map_or(("", &*text), |rest| ("-", rest));
        let sign = if minus.is_empty() { sign } else { minus };
        let room = self.width.saturating_sub(sign.len() + digits.len());
        let (zeros, spaces) = if self.has_zeros { (room, 0) } else { (0, room) };
        *out += &format!("{}{sign}{}{digits}", " ".repeat(spaces), "0".repeat(zeros));
    }

    /// Parses `text` as a value of this format.
    fn read(&self, text: &str) -> Option<Value> {
        let plain = text.trim_start_matches(' ');
        let digits = plain.strip_prefix(['-', '+']).unwrap_or(plain);
        let starts_well = digits.starts_with(|c: char| c.is_ascii_digit() || c == '.');
        let int = || plain.parse().ok().filter(|_| starts_well).map(Value::Int);
        let float = || {
            let float = plain.parse::<f64>().ok().filter(|_| starts_well);
            float.filter(|float| float.is_finite()).map(Value::Float)
        };
        match self.form {
            Form::Text => Some(Value::Text(match self.width {
                0 => text.to_owned(),
                _ => text.trim_end_matches(' ').to_owned(),
            })),
            Form::Plain => int().or_else(float),
            Form::Decimal => int(),
            Form::Fixed => float(),
            Form::Hex | Form::SmallHex => {
                let digits = plain.bytes().all(|byte| byte.is_ascii_hexdigit());
                let value = i128::from_str_radix(plain, 16).ok();
                value.filter(|_| digits).map(Value::Int)
            }
        }
    }
}

/// The text with its fields in braces.
pub(crate) fn source(pieces: &[Piece]) -> String {
    let pieces = pieces.iter().map(|piece| match piece {
        Piece::Words(words) => words.replace('{', "{{").replace('}', "}}"),
        Piece::Hole(hole) => format!("{{{}}}", hole.source),
    });
    pieces.collect()
}

/// The format of the field `name`.
pub(crate) fn form(pieces: &[Piece], name: &str) -> Form {
    let mut holes = pieces.iter().filter_map(|piece| match piece {
        Piece::Hole(hole) => Some(hole),
        Piece::Words(_) => None,
    });
    holes
        .find(|hole| hole.name == name)
        .map_or(Form::Plain, |hole| hole.form)
}

/// The values in `text`, if it fits the pieces.
pub(crate) fn decode(pieces: &[Piece], fields: &[Field], text: &str) -> Option<Record> {
    let mut record = Record::default();
    let mut rest = text;
    for (index, piece) in pieces.iter().enumerate() {
        let hole = match piece {
            Piece::Words(words) => {
                rest = rest.strip_prefix(words.as_str())?;
                continue;
            }
            Piece::Hole(hole) => hole,
        };
        let end = match (hole.fixed_width(), pieces.get(index + 1)) {
            // The words before a missing optional field are missing too.
            (Some(_), Some(Piece::Words(words)))
                if hole.is_optional && rest.starts_with(words.as_str()) =>
            {
                0
            }
            (Some(width), _)
                if hole.form == Form::Text
                    || pieces
                        .get(index + 1)
                        .is_some_and(|next| matches!(next, Piece::Hole(_))) =>
            {
                width
            }
            (_, Some(Piece::Words(words))) => rest.find(words.as_str())?,
            _ => rest.len(),
        };
        let value = rest.get(..end)?;
        rest = &rest[end..];
        if value.is_empty() && hole.is_optional {
            continue;
        }
        let value = hole.read(value)?;
        let field = fields.iter().find(|field| *field.name == hole.name);
        let value = match field {
            Some(field) => {
                let value = field.scaled(value);
                if field
                    .constant
                    .as_ref()
                    .is_some_and(|constant| *constant != value)
                {
                    return None;
                }
                value
            }
            None => value,
        };
        record.set(&hole.name, value);
    }
    rest.is_empty().then_some(record)
}

/// The text with the values of `scope`; a field without value becomes 0 or empty.
pub(crate) fn encode(
    pieces: &[Piece],
    fields: &[Field],
    scope: &dyn Scope,
    failed: &mut Vec<String>,
) -> String {
    let mut text = String::new();
    for piece in pieces {
        let hole = match piece {
            Piece::Words(words) => {
                text += words;
                continue;
            }
            Piece::Hole(hole) => hole,
        };
        let field = fields.iter().find(|field| *field.name == hole.name);
        let given = match field {
            Some(Field {
                constant: Some(constant),
                ..
            }) => Some(constant.clone()),
            Some(Field {
                calc: Some(calc), ..
            }) => match calc.eval(scope) {
                Ok(value) => Some(value),
                Err(error) => {
                    failed.push(format!("{}: {error}", hole.name));
                    None
                }
            },
            _ => scope.value(&hole.name),
        };
        if given.is_none() && hole.is_optional {
            continue;
        }
        let nothing = if hole.form == Form::Text {
            Value::Text(String::new())
        } else {
            Value::Int(0)
        };
        let value = given.unwrap_or(nothing);
        let value = field.map_or_else(
            || value.clone(),
            |field| field.unscaled(field.unnamed(value.clone())),
        );
        hole.write(&value, &mut text);
    }
    text
}

/// Example values of the text; encoding and decoding them gives the same values.
pub(crate) fn example(
    pieces: &[Piece],
    fields: &[Field],
    choice: &mut dyn FnMut(u64) -> u64,
) -> Record {
    let mut record = Record::default();
    for piece in pieces {
        let Piece::Hole(hole) = piece else {
            continue;
        };
        let field = fields.iter().find(|field| *field.name == hole.name);
        if let Some(Field {
            constant: Some(constant),
            ..
        }) = field
        {
            record.set(&hole.name, constant.clone());
            continue;
        }
        if field.is_some_and(|field| field.calc.is_some()) {
            continue;
        }
        // Fewer digits than the width, so that the value does not run into the next piece.
        let width = u32::try_from(hole.width).unwrap_or(0).clamp(1, 9);
        let value = match hole.form {
            Form::Text => {
                let len = hole
                    .precision
                    .unwrap_or(1 + usize::try_from(choice(6)).unwrap_or(0));
                let letter = |_| char::from(b'a' + u8::try_from(choice(26)).unwrap_or(0));
                Value::Text((0..len).map(letter).collect())
            }
            Form::Hex | Form::SmallHex => Value::Int(choice(16_u64.pow(width.min(8))).into()),
            Form::Plain | Form::Decimal => Value::Int(choice(10_u64.pow(width)).into()),
            Form::Fixed => {
                let precision = u32::try_from(hole.precision.unwrap_or(6)).unwrap_or(6);
                let point = u32::from(hole.precision != Some(0));
                let before = width.saturating_sub(precision + point).max(1);
                let whole = choice(10_u64.pow(before));
                let part = choice(10_u64.pow(precision.min(9)));
                let text = format!("{whole}.{part:0digits$}", digits = precision as usize);
                Value::Float(text.parse().unwrap_or(0.0))
            }
        };
        let limits = field.and_then(|field| field.limits);
        let value = match (limits, &value) {
            (Some([least, greatest]), Value::Int(_)) => {
                let span = Value::Float(greatest - least).as_int().unwrap_or(0).max(0);
                let add = choice(u64::try_from(span).unwrap_or(0).saturating_add(1));
                Value::Int(Value::Float(least.ceil()).as_int().unwrap_or(0) + i128::from(add))
            }
            (Some([least, greatest]), Value::Float(float)) => {
                Value::Float(float.clamp(least, greatest))
            }
            _ => field.map_or_else(|| value.clone(), |field| field.scaled(value.clone())),
        };
        record.set(&hole.name, value);
    }
    record
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Scope for Vec<(&str, Value)> {
        fn value(&self, name: &str) -> Option<Value> {
            self.iter()
                .find(|(key, _)| *key == name)
                .map(|(_, value)| value.clone())
        }
    }

    fn written(text: &str, values: Vec<(&str, Value)>) -> String {
        let pieces = pieces(text).expect("a text");
        encode(&pieces, &[], &values, &mut Vec::new())
    }

    /// Expected texts are those of `printf`.
    #[test]
    fn values_are_written_in_their_form() {
        let values = || {
            vec![
                ("i", Value::Int(-7)),
                ("f", Value::Float(4807.0381)),
                ("t", Value::Text("ok".to_owned())),
            ]
        };
        assert_eq!(written("{i} {i:04d} {i:5d}|", values()), "-7 -007    -7|");
        assert_eq!(
            written("{f:010.4f} {f:.1f} {f:+.0f}", values()),
            "04807.0381 4807.0 +4807"
        );
        assert_eq!(written("{t:s} {t:5s}| {t:.1s}", values()), "ok ok   | o");
        assert_eq!(written("{{{x?}}} {x:02X}", values()), "{} 00");
    }

    #[test]
    fn values_are_read_again() {
        let read = |text: &str, line: &str| {
            let pieces = pieces(text).expect("a text");
            decode(&pieces, &[], line).map(|record| Value::Record(record).to_string())
        };
        let some = |text: &str| Some(text.to_owned());
        assert_eq!(read("S {a} {b:.1f}", "S -3 2.5"), some("{a -3, b 2.5}"));
        assert_eq!(
            read("{h:02d}{m:02d}{s:05.2f},", "120735.50,"),
            some("{h 12, m 7, s 35.5}")
        );
        assert_eq!(read("{a?},{b?}", ",7"), some("{b 7}"));
        assert_eq!(read("{a:x}", "fF"), some("{a 255}"));
        assert_eq!(read("{t:s}", ""), some("{t \"\"}"));
        let mut line = String::new();
        let pieces = pieces("{on} {off}").expect("a text");
        for (piece, is) in pieces.iter().zip([true, true, false]) {
            if let Piece::Hole(hole) = piece {
                hole.write(&Value::Bool(is), &mut line);
            }
        }
        assert_eq!(line, "10");
        for line in ["S", "S 1 2 3", "S x 1.0", "S 1 nan", "S 1 1e999", "S --1 2"] {
            assert_eq!(read("S {a} {b:.1f}", line), None, "{line}");
        }
    }

    #[test]
    fn a_text_that_cannot_be_is_refused() {
        for (text, expected) in [
            (
                "{a",
                "has a brace without its partner, expected {{ and }} for literal braces",
            ),
            (
                "a}",
                "has a brace without its partner, expected {{ and }} for literal braces",
            ),
            ("{}", "expected a name of letters"),
            ("{a:q}", "expected a format such as d"),
            ("{a:99999999999999999999d}", "expected a format such as d"),
        ] {
            let error = pieces(text).expect_err(text);
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
