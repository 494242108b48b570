//! Parts of a file: found by their position, and changed.

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use super::Document;

/// A key or a position in a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Step {
    Key(String),
    Index(usize),
}

/// A part of a file.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub(super) steps: Vec<Step>,
    /// Length of its text.
    len: usize,
    /// Whether it is a key, not its value.
    pub(super) is_key: bool,
}

impl Place {
    /// The innermost part that contains `span`; `None` for the file itself.
    pub(super) fn of(document: &Document<'_>, span: &core::ops::Range<usize>) -> Option<Self> {
        let mut best = None;
        search_table(document.get_ref(), span, &mut Vec::new(), &mut best);
        best
    }

    /// The table at `span`; `None` for the file itself.
    pub(super) fn of_table(
        document: &Document<'_>,
        span: &core::ops::Range<usize>,
    ) -> Option<Self> {
        let found = Self::of(document, span)?;
        let value = value_at(document, &found.steps);
        let is_table = value.is_some_and(DeValue::is_table);
        (is_table && found.len == span.len()).then_some(found)
    }

    pub(super) fn key(&self) -> String {
        let mut key = String::new();
        for step in &self.steps {
            match step {
                Step::Key(name) if key.is_empty() => key.clone_from(name),
                Step::Key(name) => key += &format!(".{name}"),
                Step::Index(index) => key += &format!("[{index}]"),
            }
        }
        key
    }
}

fn search_table(
    table: &DeTable<'_>,
    span: &core::ops::Range<usize>,
    steps: &mut Vec<Step>,
    best: &mut Option<Place>,
) {
    for (name, value) in table {
        steps.push(Step::Key(name.get_ref().to_string()));
        consider((&name.span(), true), span, steps, best);
        search(value, span, steps, best);
        steps.pop();
    }
}

fn search(
    value: &Spanned<DeValue<'_>>,
    span: &core::ops::Range<usize>,
    steps: &mut Vec<Step>,
    best: &mut Option<Place>,
) {
    consider((&value.span(), false), span, steps, best);
    match value.get_ref() {
        DeValue::Table(table) => search_table(table, span, steps, best),
        DeValue::Array(list) => {
            for (index, value) in list.iter().enumerate() {
                steps.push(Step::Index(index));
                search(value, span, steps, best);
                steps.pop();
            }
        }
        _ => {}
    }
}

/// Keeps the part at `found`, if it contains `span` and is smaller than the best one so far.
fn consider(
    (found, is_key): (&core::ops::Range<usize>, bool),
    span: &core::ops::Range<usize>,
    steps: &[Step],
    best: &mut Option<Place>,
) {
    let contains = found.start <= span.start && span.end <= found.end;
    let is_smaller = |best: &Place| found.len() <= best.len;
    if contains && best.as_ref().is_none_or(is_smaller) {
        *best = Some(Place {
            steps: steps.to_vec(),
            len: found.len(),
            is_key,
        });
    }
}

/// A change of a file.
pub(super) enum Repair {
    Remove,
    Rename(String),
    /// Another name as the value.
    Name(String),
    /// Another value, as TOML.
    Replace(&'static str),
    Insert(String, Value),
}

/// An inserted value.
pub(super) enum Value {
    /// As TOML.
    Toml(&'static str),
    Name(String),
}

/// Position of made keys and values, which the file does not have.
pub(super) const MADE: core::ops::Range<usize> = usize::MAX..usize::MAX;

/// The value of a part of a file.
pub(super) fn value_at<'a>(document: &'a Document<'_>, steps: &[Step]) -> Option<&'a DeValue<'a>> {
    let (first, rest) = steps.split_first()?;
    let Step::Key(name) = first else { return None };
    let mut value = document.get_ref().get(name.as_str())?.get_ref();
    for step in rest {
        value = match (step, value) {
            (Step::Key(name), DeValue::Table(table)) => table.get(name.as_str())?.get_ref(),
            (Step::Index(index), DeValue::Array(list)) => list.get(*index)?.get_ref(),
            _ => return None,
        };
    }
    Some(value)
}

/// Changes the part at `steps`; returns whether that was possible.
pub(super) fn apply(table: &mut DeTable<'_>, steps: &[Step], repair: &Repair) -> bool {
    match (steps, repair) {
        ([], Repair::Insert(name, value)) => {
            let key = Spanned::new(MADE, name.clone().into());
            let value = match value {
                Value::Toml(text) => value_of(text),
                Value::Name(name) => DeValue::String(name.clone().into()),
            };
            let value = Spanned::new(MADE, value);
            table.insert(key, value).is_none()
        }
        ([], _) => false,
        ([Step::Key(name)], Repair::Remove) => table.remove(name.as_str()).is_some(),
        ([Step::Key(name)], Repair::Rename(meant)) => {
            let is_free = table.get(meant.as_str()).is_none();
            let Some(value) = table.remove(name.as_str()).filter(|_| is_free) else {
                return false;
            };
            let key = Spanned::new(MADE, meant.clone().into());
            table.insert(key, value).is_none()
        }
        ([Step::Key(name), rest @ ..], repair) => {
            let value = table.get_mut(name.as_str());
            value.is_some_and(|value| apply_to_value(value, rest, repair))
        }
        ([Step::Index(_), ..], _) => false,
    }
}

fn apply_to_value(value: &mut Spanned<DeValue<'_>>, steps: &[Step], repair: &Repair) -> bool {
    match (value.get_mut(), steps, repair) {
        (found, [], Repair::Replace(text)) => {
            *found = value_of(text);
            true
        }
        (found, [], Repair::Name(name)) => {
            *found = DeValue::String(name.clone().into());
            true
        }
        (DeValue::Table(table), steps, repair) => apply(table, steps, repair),
        (DeValue::Array(list), [Step::Index(index), rest @ ..], repair) => {
            let value = list.get_mut(*index);
            value.is_some_and(|value| apply_to_value(value, rest, repair))
        }
        _ => false,
    }
}

/// The value of a TOML text; a text that is no TOML is a name.
fn value_of<'a>(text: &'static str) -> DeValue<'a> {
    match DeValue::parse(text) {
        Ok(value) => made(value.get_ref()),
        Err(_) => DeValue::String(text.into()),
    }
}

/// The value with a position outside of the file for each of its parts.
fn made<'a>(value: &DeValue<'a>) -> DeValue<'a> {
    let DeValue::Array(list) = value else {
        return value.clone();
    };
    let mut copy = DeArray::new();
    for part in list.iter() {
        copy.push(Spanned::new(MADE, made(part.get_ref())));
    }
    DeValue::Array(copy)
}
