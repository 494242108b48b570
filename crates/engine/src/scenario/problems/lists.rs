//! Lists of a file that are longer than the reader reads.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::MENDED_MAX;
use crate::scenario::{ScenarioError, Source};

/// The lists of numbers that have more values than were read: `kept` is the content as a file. The
/// reader of a list of two numbers ignores a third one.
pub(in crate::scenario) fn too_long(source: &Source, kept: &str) -> Vec<ScenarioError> {
    let mut problems = Vec::new();
    if source.text.len() > MENDED_MAX {
        return problems;
    }
    let [found, kept] = [&source.text, kept].map(|text| DeTable::parse_recoverable(text).0);
    let mut note = |span, key: &str, len: usize, most: usize| {
        let message = format!("is a list of {len}, expected a list of {most} values");
        problems.push(source.invalid(Some(span), key, message));
    };
    compare_tables(found.get_ref(), kept.get_ref(), "", &mut note);
    problems
}

/// Receives the position, the key and the lengths of a list.
type Note<'a> = &'a mut dyn FnMut(core::ops::Range<usize>, &str, usize, usize);

fn compare_tables(found: &DeTable<'_>, kept: &DeTable<'_>, key: &str, note: Note<'_>) {
    for (name, value) in found {
        let name: &str = name.get_ref();
        let dot = if key.is_empty() { "" } else { "." };
        if let Some(kept) = kept.get(name) {
            compare(value, kept.get_ref(), &format!("{key}{dot}{name}"), note);
        }
    }
}

fn compare(found: &Spanned<DeValue<'_>>, kept: &DeValue<'_>, key: &str, note: Note<'_>) {
    let is_number = |value: &Spanned<DeValue<'_>>| {
        matches!(value.get_ref(), DeValue::Integer(_) | DeValue::Float(_))
    };
    match (found.get_ref(), kept) {
        (DeValue::Table(found), DeValue::Table(kept)) => compare_tables(found, kept, key, note),
        (DeValue::Array(list), DeValue::Array(kept)) if list.len() == kept.len() => {
            for (index, (value, kept)) in list.iter().zip(kept.iter()).enumerate() {
                compare(value, kept.get_ref(), &format!("{key}[{index}]"), note);
            }
        }
        (DeValue::Array(list), DeValue::Array(kept))
            if list.len() > kept.len() && !kept.is_empty() && kept.iter().all(is_number) =>
        {
            note(found.span(), key, list.len(), kept.len());
        }
        _ => {}
    }
}
