//! Checks of the values that conditions compare.

use crate::codec::Codec;
use crate::near;
use crate::scenario::{Flaw, FrameCondition, Operand, RegisterCondition};

/// Checks that frames of `codec` can have the wanted value and words.
pub(super) fn check_frame(frame: &FrameCondition, codec: &Codec) -> Result<(), Flaw> {
    if let (Some(field), Some(value)) = (&frame.field, &frame.value) {
        check_name(value, codec.names_of_field(field))?;
    }
    let names = codec.field_names(frame.direction.into());
    if let (Some(field), Some(names)) = (&frame.field, &names)
        && !names.contains(&field.as_str())
    {
        return Err(Flaw::new("field", near::expected(field, names)));
    }
    let Some(known) = codec.vocabulary(frame.direction.into(), false) else {
        return Ok(());
    };
    let is_part = |c: char| c.is_alphanumeric() || "_-".contains(c);
    let is_number = |word: &str| word.chars().all(|c| c.is_ascii_hexdigit() || c == '-');
    let single: Vec<&str> = known
        .iter()
        .flat_map(|one| one.split(|c| !is_part(c)))
        .collect();
    // The wanted text may begin within its first word and end within its last one.
    let (mut words, mut place) = (frame.contains.split(|c| !is_part(c)).peekable(), 0);
    let unprinted = loop {
        let Some(word) = words.next() else {
            return Ok(());
        };
        let is_printed = |one: &&str| match (place == 0, words.peek().is_none()) {
            (true, true) => one.contains(word),
            (true, false) => one.ends_with(word),
            (false, true) => one.starts_with(word),
            (false, false) => *one == word,
        };
        if !is_number(word) && !single.iter().any(is_printed) {
            break word;
        }
        place += 1;
    };
    let word = unprinted;
    let link = &frame.link;
    let message = match near::meant(word, &known) {
        Some(meant) => format!("has \"{word}\", did you mean \"{meant}\"?"),
        None => format!("has \"{word}\", which no frame of {link} contains: see \"hilrig decode\""),
    };
    Err(Flaw::new("contains", message))
}

/// Checks that a bit is compared with a number that it can have.
pub(super) fn check_bit(found: &Operand, wanted: &RegisterCondition) -> Result<(), Flaw> {
    let (Operand::Flag(_), Operand::Number(number)) = (found, &wanted.value) else {
        return Ok(());
    };
    let op = wanted.op;
    if op.holds(&0.0, number) != op.holds(&1.0, number) {
        return Ok(());
    }
    let word = if op.holds(&0.0, number) {
        "always"
    } else {
        "never"
    };
    let name = wanted.name.as_deref().unwrap_or("the register");
    let message = format!(
        "is {number}, but {name} of {} is a bit, so \"{op} {number}\" is {word} true: expected \
         true or false, or 1 or 0",
        wanted.device
    );
    Err(Flaw::new("value", message))
}

/// Checks a wanted text if a value has only `names`.
pub(super) fn check_name(wanted: &Operand, names: Option<Vec<&str>>) -> Result<(), Flaw> {
    match (wanted, names) {
        (Operand::Text(text), Some(names)) if !names.contains(&text.as_str()) => {
            Err(Flaw::new("value", near::expected(text, &names)))
        }
        (Operand::Number(number), Some(names)) => {
            let names = names.join(", ");
            let message = format!("is {number}, but the value has names: expected one of {names}");
            Err(Flaw::new("value", message))
        }
        _ => Ok(()),
    }
}
