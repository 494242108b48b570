//! The frame of a draft: sync bytes, and the size as far as it follows from the fields.

use core::cell::Cell;

use super::expression::over_bytes;
use super::field::{Len, Made};

/// Maximum number of first bytes from which a size is computed.
const HEAD_MAX: usize = 64;

/// The frame of a draft.
pub(super) struct Frame {
    /// Its keys and values.
    pub(super) text: String,
    /// Index of the first field behind the sync bytes.
    pub(super) first: usize,
    /// Index of the field that is the length field of the frame, and no field of the message.
    pub(super) length: Option<usize>,
    /// Whether the end of a frame follows from the fields.
    pub(super) is_known: bool,
}

/// The frame around these fields.
pub(super) fn frame(made: &[Made]) -> Frame {
    let syncs = made.iter().take_while(|made| made.sync.is_some());
    let sync: Vec<u8> = syncs
        .filter_map(|made| made.sync.clone())
        .flatten()
        .collect();
    let count = made.iter().take_while(|made| made.sync.is_some()).count();
    // A message needs a field.
    let first = if count < made.len() { count } else { 0 };
    let mut text = String::new();
    if first > 0 {
        let bytes: Vec<String> = sync.iter().map(|byte| format!("0x{byte:02X}")).collect();
        text += &format!("sync = [{}]\n", bytes.join(", "));
    }
    let (end, length) = match length(made) {
        Some((text, index)) => (Some(text), Some(index)),
        None => (size(made), None),
    };
    let is_known = end.is_some();
    text += &end.unwrap_or_else(|| "silence = 3.5\n".to_owned());
    Frame {
        text,
        first,
        length,
        is_known,
    }
}

/// The length field of a frame with one field of computed size that has a type, and its index. No
/// other field reads it.
fn length(made: &[Made]) -> Option<(String, usize)> {
    let mut sized = made.iter().filter(|field| field.sized_by.is_some());
    let (name, more) = sized.next()?.sized_by.as_ref()?;
    let index = made.iter().position(|field| field.name == *name)?;
    let field = &made[index];
    let is_read = |field: &Made| {
        let keys = field.keys.iter().skip(1);
        { keys }.any(|key| {
            let mut words = key.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
            words.any(|word| word == name)
        })
    };
    let others = made.iter().enumerate().filter(|(at, _)| *at != index);
    if sized.next().is_some() || { others }.any(|(_, field)| is_read(field)) {
        return None;
    }
    let (mut fixed, mut at) = (0, None);
    for (place, field) in made.iter().enumerate() {
        if place == index {
            at = Some(fixed);
        }
        match field.len {
            Len::Fixed(len) => fixed += i64::try_from(len).ok()?,
            _ if field.sized_by.is_some() => {}
            _ => return None,
        }
    }
    let Len::Fixed(bytes @ (1 | 2 | 4)) = field.len else {
        return None;
    };
    let order = match (bytes, field.is_little?) {
        (1, _) => "",
        (_, true) => "le",
        (_, false) => "be",
    };
    let (kind, at, without) = (8 * bytes, at?, fixed + more);
    let text = format!(
        "length = {{ at = {at}, type = \"u{kind}{order}\", counts = \"frame\", without = {without} }}\n"
    );
    // The field in front of the length must not have a computed size.
    let is_before = made[..index]
        .iter()
        .all(|field| matches!(field.len, Len::Fixed(_)));
    is_before.then_some((text, index))
}

/// The keys for the size of a frame.
fn size(made: &[Made]) -> Option<String> {
    let (mut fixed, mut parts, mut head) = (0, Vec::new(), 0);
    for field in made {
        match &field.len {
            Len::Fixed(len) => fixed += len,
            Len::Computed(text) => {
                let end = Cell::new(0);
                let replaced = over_bytes(text, &|name| {
                    let (behind, text) = bytes_of(made, name)?;
                    end.set(end.get().max(behind));
                    Some(text)
                })?;
                head = head.max(end.get());
                parts.push(format!("({replaced})"));
            }
            Len::Open => return None,
        }
    }
    if parts.is_empty() {
        return (1..=crate::framing::FRAME_MAX)
            .contains(&fixed)
            .then(|| format!("size = {fixed}\n"));
    }
    let sum = parts.join(" + ");
    (1..=HEAD_MAX)
        .contains(&head)
        .then(|| format!("head = {head}\nsize = \"{fixed} + {sum}\"\n"))
}

/// The end of the bytes of the integer `name`, and its value as an expression over the first bytes
/// of the frame.
fn bytes_of(made: &[Made], name: &str) -> Option<(usize, String)> {
    let mut at = 0;
    for field in made {
        let Len::Fixed(len) = field.len else {
            return None;
        };
        if field.name == name {
            let is_little = field.is_little?;
            let parts = (0..len).map(|index| {
                let shift = 8 * if is_little { index } else { len - 1 - index };
                match shift {
                    0 => format!("b{}", at + index),
                    shift => format!("(b{} << {shift})", at + index),
                }
            });
            let parts: Vec<String> = parts.collect();
            return Some((at + len, format!("({})", parts.join(" | "))));
        }
        at += len;
    }
    None
}
