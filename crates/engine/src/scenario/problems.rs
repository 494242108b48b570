//! All errors of a file at once, in the words of the file.
//!
//! The reader of TOML stops at the first error. Here the place of an error is mended, by another
//! name or another value, and the file is read again until no error is left.

mod finite;
mod lists;
mod place;
mod words;

use std::collections::VecDeque;

use toml::Spanned;
use toml::de::{DeTable, Error};

use super::{ScenarioError, Source};
use crate::near;
pub(super) use finite::not_finite;
pub(super) use lists::too_long;
use place::{MADE, Place, Repair, Step, Value, apply, value_at};

/// Maximum number of errors that are reported for one file.
const PROBLEMS_MAX: usize = 10;
/// Maximum number of repairs of one file.
const ROUNDS_MAX: u32 = 40;
/// Maximum length of a key in the error of a file that is no TOML: its line may have no key.
const KEY_MAX: usize = 60;
/// Maximum length of a file that is read again after its first error, bytes.
const MENDED_MAX: usize = 256 << 10;

/// A parsed file.
pub type Document<'a> = Spanned<DeTable<'a>>;

/// A file that was read.
pub(super) struct Read<T> {
    /// Its content, with every error mended; `None` if that is impossible.
    pub(super) value: Option<T>,
    /// Its errors.
    pub(super) problems: Vec<ScenarioError>,
}

/// Reads a file by `read`.
///
/// # Errors
/// All errors of the file, at most ten; each names file, line, key and the expected value.
pub fn read_whole<'a, T>(
    source: &'a Source,
    read: impl Fn(Document<'a>) -> Result<T, Error>,
) -> Result<T, ScenarioError> {
    let found = read_mended(source, read);
    match (found.value, found.problems.is_empty()) {
        (Some(value), true) => Ok(value),
        _ => Err(ScenarioError::all(found.problems)),
    }
}

/// Reads a file by `read`, also if it has errors.
pub(super) fn read_mended<'a, T>(
    source: &'a Source,
    read: impl Fn(Document<'a>) -> Result<T, Error>,
) -> Read<T> {
    let (document, wrong) = DeTable::parse_recoverable(&source.text);
    let mut problems = no_toml(source, &wrong);
    if !problems.is_empty() {
        let value = None;
        return Read { value, problems };
    }
    let mut error = match read(document) {
        Ok(value) => {
            let value = Some(value);
            return Read { value, problems };
        }
        Err(error) => error,
    };
    let (document, _) = DeTable::parse_recoverable(&source.text);
    let mut reading = Reading {
        source,
        document,
        read,
        removed: Vec::new(),
    };
    for round in 1.. {
        if !reading.has_removed(&error) {
            problems.push(reading.problem(&error));
        }
        let is_enough = problems.len() == PROBLEMS_MAX || round == ROUNDS_MAX;
        let mended = match source.text.len() > MENDED_MAX || is_enough {
            true => Mended::Not,
            false => reading.mend(&error),
        };
        let value = match mended {
            Mended::Next(next) => {
                error = next;
                continue;
            }
            Mended::Sound(value) => Some(value),
            Mended::Not => None,
        };
        return Read { value, problems };
    }
    let value = None;
    Read { value, problems }
}

/// The errors of a file that is no TOML.
fn no_toml(source: &Source, wrong: &[Error]) -> Vec<ScenarioError> {
    let problems = wrong.iter().take(PROBLEMS_MAX).map(|error| {
        let at = error
            .span()
            .map_or(0, |span| span.start)
            .min(source.text.len());
        let begin = source.text[..at].rfind('\n').map_or(0, |end| end + 1);
        let line = source.text[begin..].lines().next().unwrap_or_default();
        let name = line.split('=').next().unwrap_or_default();
        let name = name.trim_matches(|c: char| c.is_whitespace() || "[]{},".contains(c));
        let is_key = !name.is_empty() && !name.starts_with('#') && error.span().is_some();
        let key = match is_key {
            true => name
                .chars()
                .take(KEY_MAX)
                .collect::<String>()
                .escape_debug()
                .to_string(),
            false => "file".to_owned(),
        };
        let message = format!("is no TOML: {}", words::plain(error.message()));
        source.invalid(error.span(), key, message)
    });
    problems.collect()
}

/// A file, its content so far, and its reader.
struct Reading<'a, 'b, F> {
    source: &'a Source,
    document: Document<'b>,
    read: F,
    /// Keys that repairs removed.
    removed: Vec<Vec<Step>>,
}

impl<'b, T, F: Fn(Document<'b>) -> Result<T, Error>> Reading<'_, 'b, F> {
    /// An error of the reader in the words of the file.
    fn problem(&self, error: &Error) -> ScenarioError {
        let span = error.span();
        let place = self.place(error);
        let mut key = place.as_ref().map(Place::key).unwrap_or_default();
        let message = match Complaint::of(error.message()) {
            Complaint::Missing(name) => {
                let dot = if key.is_empty() { "" } else { "." };
                key = format!("{key}{dot}{name}");
                let steps = place.as_ref().map_or(&[][..], |place| &place.steps);
                let insert = |probe| Repair::Insert(name.to_owned(), Value::Toml(probe));
                let expected = self.expected(steps, insert);
                format!(
                    "is missing, expected {}",
                    expected.unwrap_or("a value".to_owned())
                )
            }
            Complaint::UnknownKey(name, known) => words::unknown_key(name, &known),
            Complaint::UnknownName(name, known) => near::expected(name, &known),
            Complaint::NoName(keys) => {
                let steps = place.as_ref().map_or(&[][..], |place| &place.steps);
                let probe = match keys {
                    Some(0) => self.expected(steps, |_| {
                        Repair::Insert(PROBE.to_owned(), Value::Toml("{}"))
                    }),
                    Some(_) => None,
                    None => self.expected(steps, Repair::Replace),
                };
                let found = place
                    .as_ref()
                    .and_then(|place| value_at(&self.document, &place.steps));
                words::no_name(keys, found, probe)
            }
            Complaint::Other => {
                let message = words::plain(error.message());
                let name = key.rsplit(['.', ' ']).next().unwrap_or_default();
                let twice = message.strip_prefix(name);
                let twice = twice.and_then(|rest| rest.strip_prefix(' '));
                twice.map(str::to_owned).unwrap_or(message)
            }
        };
        // A missing key of the file itself has no line.
        let span = span.filter(|_| place.is_some());
        self.source.invalid(span, key, message)
    }

    /// Whether an error says that a key is missing which a repair removed.
    fn has_removed(&self, error: &Error) -> bool {
        let Complaint::Missing(name) = Complaint::of(error.message()) else {
            return false;
        };
        let mut steps = self.place(error).map_or_else(Vec::new, |place| place.steps);
        steps.push(Step::Key(name.to_owned()));
        self.removed.contains(&steps)
    }

    /// The part of the file that an error is about; `None` for the file itself.
    fn place(&self, error: &Error) -> Option<Place> {
        let span = error.span()?;
        match Complaint::of(error.message()) {
            Complaint::Missing(_) => Place::of_table(&self.document, &span),
            _ => Place::of(&self.document, &span),
        }
    }

    /// The values that the reader expects at a place, as it names them in its error about a value
    /// that no key has.
    fn expected(&self, steps: &[Step], repair: impl Fn(&'static str) -> Repair) -> Option<String> {
        let mut found = None;
        for probe in PROBES {
            let mut trial = self.document.clone();
            if !apply(trial.get_mut(), steps, &repair(probe)) {
                return None;
            }
            // An error of another place says nothing about this one.
            let Err(error) = (self.read)(trial) else {
                break;
            };
            match Complaint::of(error.message()) {
                _ if !is_of_made(&error) && !self.is_at(&error, steps) => {}
                Complaint::UnknownName(_, known) => {
                    return Some(format!("one of {}", known.join(", ")));
                }
                Complaint::Other if found.is_none() => found = words::expected(error.message()),
                _ => {}
            }
        }
        found
    }

    /// Mends the place of `error`.
    fn mend(&mut self, error: &Error) -> Mended<T> {
        let is_missing = matches!(Complaint::of(error.message()), Complaint::Missing(_));
        let place = self.place(error);
        if place.is_none() && !is_missing {
            return Mended::Not;
        }
        let mut is_named = false;
        let mut repairs: VecDeque<_> = repairs(error.message(), place.as_ref()).into();
        while let Some((steps, repair)) = repairs.pop_front() {
            let mut trial = self.document.clone();
            if !apply(trial.get_mut(), &steps, &repair) {
                continue;
            }
            let next = match (self.read)(trial.clone()) {
                Ok(value) => return Mended::Sound(value),
                Err(next) => next,
            };
            if is_other(&next, error, &steps, &repair)
                && !is_of_renamed(&next, &trial, &steps, &repair)
            {
                self.document = trial;
                if matches!(repair, Repair::Remove) {
                    self.removed.push(steps);
                }
                return Mended::Next(next);
            }
            // Only one of some names can be inserted here: try each of them.
            if let Repair::Insert(name, Value::Toml(_)) = &repair
                && let Complaint::UnknownName(_, known) = Complaint::of(next.message())
                && is_of_made(&next)
                && !core::mem::replace(&mut is_named, true)
            {
                for known in known.into_iter().rev() {
                    let value = Value::Name(known.to_owned());
                    repairs.push_front((steps.clone(), Repair::Insert(name.clone(), value)));
                }
            }
        }
        Mended::Not
    }

    /// Whether an error is about the part at `steps`.
    fn is_at(&self, error: &Error, steps: &[Step]) -> bool {
        self.place(error).is_some_and(|place| place.steps == steps)
    }
}

/// Whether an error is about a value that a repair made.
fn is_of_made(error: &Error) -> bool {
    error.span().is_some_and(|span| span.start == MADE.start)
}

/// Whether an error is about the value of a renamed key: the file has no key of the new name.
fn is_of_renamed(next: &Error, trial: &Document<'_>, steps: &[Step], repair: &Repair) -> bool {
    let (Repair::Rename(meant), Some(span)) = (repair, next.span()) else {
        return false;
    };
    let [around @ .., _] = steps else {
        return false;
    };
    let renamed = [around, &[Step::Key(meant.clone())]].concat();
    Place::of(trial, &span).is_some_and(|place| place.steps.starts_with(&renamed))
}

/// Values and names that no key has.
const PROBES: [&str; 2] = ["1979-05-27", "\"?\""];
/// A name that no key has.
const PROBE: &str = "?";

/// An error of the reader, by its kind.
enum Complaint<'a> {
    /// A needed key is missing.
    Missing(&'a str),
    /// A key that the table does not have, and those that it has.
    UnknownKey(&'a str, Vec<&'a str>),
    /// A name that is not among the known ones.
    UnknownName(&'a str, Vec<&'a str>),
    /// A name, or a table with one key, is expected; with the number of keys if the file has a
    /// table, else `None`.
    NoName(Option<usize>),
    Other,
}

impl<'a> Complaint<'a> {
    fn of(message: &'a str) -> Self {
        match message {
            "wanted exactly 1 element, found 0 elements" => return Self::NoName(Some(0)),
            "wanted exactly 1 element, more than 1 element" => return Self::NoName(Some(2)),
            "wanted string or table" => return Self::NoName(None),
            _ => {}
        }
        let mut names = message.split('`').skip(1).step_by(2);
        let first = names.next().unwrap_or_default();
        match message.split_once(" `").map(|(kind, _)| kind) {
            Some("missing field") => Self::Missing(first),
            Some("unknown field") => Self::UnknownKey(first, names.collect()),
            Some("unknown variant") => Self::UnknownName(first, names.collect()),
            _ => Self::Other,
        }
    }
}

/// Values of each type, as TOML.
const VALUES: [&str; 10] = [
    "1",
    "\"1s\"",
    "\"none\"",
    "true",
    "[]",
    "{}",
    "[0, 1]",
    "[[0, 0], [1, 1]]",
    "\"rest\"",
    "0.5",
];

/// A file after a repair.
enum Mended<T> {
    Sound(T),
    Next(Error),
    /// No repair has an effect.
    Not,
}

/// Whether the error `next` is no consequence of a repair of `error` at `steps`.
fn is_other(next: &Error, error: &Error, steps: &[Step], repair: &Repair) -> bool {
    let removed = match (repair, steps.last()) {
        (Repair::Remove, Some(Step::Key(removed))) => Some(removed.as_str()),
        _ => None,
    };
    let is_of_made = is_of_made(next);
    let is_same = next.span() == error.span();
    match Complaint::of(next.message()) {
        Complaint::Missing(name) if removed == Some(name) => false,
        Complaint::Missing(_) if is_same && matches!(repair, Repair::Replace(_)) => false,
        // The next key of the same table that is missing.
        Complaint::Missing(_) => !is_of_made && (next.message() != error.message() || !is_same),
        Complaint::NoName(Some(0)) if removed.is_some() => false,
        _ => !is_of_made && !is_same,
    }
}

/// The changes that may mend an error, the best one first, each with its place.
fn repairs(message: &str, place: Option<&Place>) -> Vec<(Vec<Step>, Repair)> {
    let here = place.map(|place| place.steps.clone()).unwrap_or_default();
    let is_key = place.is_some_and(|place| place.is_key);
    let mut repairs = Vec::new();
    match Complaint::of(message) {
        Complaint::Missing(name) => {
            let insert = |value| Repair::Insert(name.to_owned(), Value::Toml(value));
            repairs.extend(VALUES.into_iter().map(insert));
            repairs.push(Repair::Remove);
        }
        Complaint::UnknownKey(name, known) => {
            let meant = near::meant(name, &known);
            repairs.extend(meant.map(|meant| Repair::Rename(meant.to_owned())));
            repairs.push(Repair::Remove);
        }
        Complaint::UnknownName(name, known) if is_key => {
            let meant = near::meant(name, &known);
            repairs.extend(meant.map(|meant| Repair::Rename(meant.to_owned())));
        }
        Complaint::UnknownName(_, known) => {
            let name = |name: &str| Repair::Name(name.to_owned());
            repairs.extend(known.into_iter().map(name));
            repairs.push(Repair::Remove);
        }
        Complaint::NoName(_) | Complaint::Other => {
            repairs.push(Repair::Remove);
            repairs.extend(VALUES.into_iter().map(Repair::Replace));
        }
    }
    let mut repairs: Vec<_> = repairs.into_iter().map(|it| (here.clone(), it)).collect();
    // The tables around it, as the last resort.
    for len in (1..here.len()).rev() {
        repairs.push((here[..len].to_vec(), Repair::Remove));
    }
    repairs
}
