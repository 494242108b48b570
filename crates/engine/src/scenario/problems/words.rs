//! The reader's words in those of a file: no name of a type of this program.

use toml::de::DeValue;

use crate::near;

/// The error for a key that a table does not have.
pub(super) fn unknown_key(name: &str, known: &[&str]) -> String {
    let all = known.join(", ");
    match near::meant(name, known) {
        Some(meant) => {
            format!("is an unknown key, did you mean \"{meant}\"? Expected one of {all}")
        }
        None if known.is_empty() => "is an unknown key; the table has none".to_owned(),
        None => format!("is an unknown key, expected one of {all}"),
    }
}

/// The error for a value that should be a name, or a table with one key: `keys` of a table, the
/// value `found`, and the `expected` names.
pub(super) fn no_name(
    keys: Option<usize>,
    found: Option<&DeValue<'_>>,
    expected: Option<String>,
) -> String {
    let found = match (keys, found) {
        (Some(0), _) => "is a table without a key".to_owned(),
        (Some(_), _) => "is a table with several keys, expected exactly one".to_owned(),
        (None, Some(DeValue::Integer(number))) => format!("is {}", number.as_str()),
        (None, Some(DeValue::Float(number))) => format!("is {}", number.as_str()),
        (None, Some(DeValue::Boolean(is_true))) => format!("is {is_true}"),
        (None, Some(DeValue::Array(_))) => "is a list".to_owned(),
        (None, _) => "has a wrong value".to_owned(),
    };
    match (keys, expected) {
        (Some(1..), _) => found,
        (_, Some(expected)) => format!("{found}, expected {expected}"),
        (_, None) => format!("{found}, expected a name"),
    }
}

/// The value that the reader expects, in a message that says so.
pub(super) fn expected(message: &str) -> Option<String> {
    let (_, expected) = message.trim().rsplit_once("expected ")?;
    Some(expected_value(expected))
}

/// A message of the reader without the names of types.
pub(super) fn plain(message: &str) -> String {
    let message = message.trim().replace('\n', "; ");
    for start in ["invalid type: ", "invalid value: "] {
        let Some(rest) = message.strip_prefix(start) else {
            continue;
        };
        // The text may contain the same words; the expected value comes last.
        if let Some((found, expected)) = rest.rsplit_once(", expected ") {
            return format!(
                "is {}, expected {}",
                found_value(found),
                expected_value(expected)
            );
        }
    }
    if let Some(rest) = message.strip_prefix("invalid length ")
        && let Some((len, expected)) = rest.split_once(", expected ")
    {
        return format!("is a list of {len}, expected {}", expected_value(expected));
    }
    match message.strip_prefix("wanted ") {
        Some(wanted) => format!("has a wrong value, expected {}", expected_value(wanted)),
        None => message.replace('`', "\""),
    }
}

/// A value of the file, as serde names it.
fn found_value(found: &str) -> String {
    let kind = found.split(' ').next().unwrap_or_default();
    let quoted = found.split('`').nth(1);
    match (kind, quoted) {
        ("map", _) => "a table".to_owned(),
        ("sequence", _) => "a list".to_owned(),
        ("unit", _) => "nothing".to_owned(),
        ("string", _) => found.trim_start_matches("string ").to_owned(),
        (_, Some(quoted)) => quoted.to_owned(),
        _ => found.to_owned(),
    }
}

/// An expected value, as serde names it.
fn expected_value(expected: &str) -> String {
    let whole = |low: i128, high: u128| format!("a whole number from {low} to {high}");
    match expected {
        "i8" => whole(i8::MIN.into(), 127),
        "i16" => whole(i16::MIN.into(), 32_767),
        "i32" => whole(i32::MIN.into(), 2_147_483_647),
        "u8" => whole(0, u8::MAX.into()),
        "u16" => whole(0, u16::MAX.into()),
        "u32" => whole(0, u32::MAX.into()),
        "u64" | "u128" | "usize" => "a whole number, at least 0".to_owned(),
        "i64" | "i128" | "isize" => "a whole number".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a string" | "string" | "path string" | "a borrowed string" | "a character" => {
            "a text".to_owned()
        }
        "a map" | "map" | "table" => "a table".to_owned(),
        "a sequence" | "array" => "a list".to_owned(),
        "variant identifier" | "a string or map" => "a name".to_owned(),
        _ => expected_by_form(expected),
    }
}

fn expected_by_form(expected: &str) -> String {
    for (start, words) in [
        ("struct ", "a table"),
        ("enum ", "a name or a table with one key"),
    ] {
        if expected.starts_with(start) {
            return words.to_owned();
        }
    }
    for start in ["an array of length ", "a tuple of size ", "a list of "] {
        let Some(len) = expected.strip_prefix(start) else {
            continue;
        };
        return format!("a list of {len} values");
    }
    match expected.strip_prefix("tuple ") {
        Some(rest) => {
            let len = rest.rsplit(' ').nth(1).unwrap_or_default();
            format!("a list of {len} values")
        }
        None => expected.replace('`', "\""),
    }
}
