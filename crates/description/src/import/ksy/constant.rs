//! Types of numbers, and constant bytes.

use super::field::{Len, Made};
use super::yaml::Node;

/// A type of numbers in the words of descriptions, its bytes, and its order if the name has one.
pub(super) fn number(name: &str) -> Option<(String, usize, Option<bool>)> {
    let (plain, order) = match (name.strip_suffix("le"), name.strip_suffix("be")) {
        (Some(plain), _) => (plain, Some(true)),
        (_, Some(plain)) => (plain, Some(false)),
        _ => (name, None),
    };
    let (kind, bytes) = match plain {
        "u1" | "s1" | "u2" | "s2" | "u4" | "s4" | "u8" | "s8" | "f4" | "f8" => plain.split_at(1),
        _ => return None,
    };
    let bytes: usize = bytes.parse().ok()?;
    let kind = if kind == "s" { "i" } else { kind };
    Some((format!("{kind}{}", 8 * bytes), bytes, order))
}

/// A field of constant bytes: numbers and texts. Only one byte needs no name.
pub(super) fn constant(contents: &Node, name: &str) -> Option<Made> {
    let mut bytes = Vec::new();
    for part in contents.elements() {
        match (part.int(), part.text()) {
            (Some(int), _) => bytes.push(u8::try_from(int).ok()?),
            (None, Some(text)) => bytes.extend_from_slice(text.as_bytes()),
            (None, None) => return None,
        }
    }
    let keys = match bytes[..] {
        [] => return None,
        [one] => vec!["type = \"u8\"".to_owned(), format!("value = {one}")],
        _ => {
            let numbers = bytes.iter();
            let numbers = numbers.map(|byte| format!("{{ type = \"u8\", value = {byte} }}"));
            let numbers: Vec<String> = numbers.collect();
            vec![
                format!("name = \"{name}\""),
                "type = \"group\"".to_owned(),
                format!("fields = [{}]", numbers.join(", ")),
            ]
        }
    };
    Some(Made {
        sync: Some(bytes.clone()),
        ..Made::new("", keys, Len::Fixed(bytes.len()))
    })
}
