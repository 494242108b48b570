//! Errors in a description: file, line, key, expected value.

use core::fmt;
use core::ops::Range;

use span::near::with_meant;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// The errors that make a file invalid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DescriptionError {
    /// The name of the file, as the caller gave it.
    pub file: String,
    /// The problems, at least one, in order of lines.
    pub problems: Vec<Problem>,
}

/// One error in a file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Problem {
    /// Line, from 1.
    pub line: usize,
    /// The key in question, e.g. `message[0].fields[2].type`; empty if the file is no TOML.
    pub key: String,
    /// The error and the expected value.
    pub message: String,
}

impl fmt::Display for DescriptionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, problem) in self.problems.iter().enumerate() {
            let Problem { line, key, message } = problem;
            let colon = if key.is_empty() { "" } else { ": " };
            let end = if index == 0 { "" } else { "\n" };
            write!(f, "{end}{}:{line}: {key}{colon}{message}", self.file)?;
        }
        Ok(())
    }
}

impl core::error::Error for DescriptionError {}

/// The parsed text of a file with the positions of its parts, and the problems found.
pub(crate) struct Places<'a> {
    text: &'a str,
    root: DeTable<'a>,
    problems: Vec<Problem>,
}

/// Maximum number of problems that are reported for one file.
const PROBLEMS_MAX: usize = 20;

impl<'a> Places<'a> {
    /// Parses `text` as far as possible.
    pub(crate) fn of(text: &'a str) -> Self {
        let (root, _) = DeTable::parse_recoverable(text);
        Self {
            text,
            root: root.into_inner(),
            problems: Vec::new(),
        }
    }

    /// The text.
    pub(crate) const fn text(&self) -> &'a str {
        self.text
    }

    /// Records an error in the value of `key`.
    pub(crate) fn wrong(&mut self, key: impl Into<String>, message: impl Into<String>) {
        let (key, message) = (key.into(), message.into());
        let line = self.line(self.find(&key).map_or(0, |span| span.start));
        self.note(Problem { line, key, message });
    }

    /// Records an error of the TOML parser.
    pub(crate) fn refused(&mut self, error: &toml::de::Error) {
        let at = error.span().map_or(0, |span| span.start);
        let mut key = String::new();
        key_at(&self.root, at, String::new(), &mut key);
        let message = error.message().trim().replace('\n', "; ");
        let message = message.replace("wanted ", "expected ");
        self.note(Problem {
            line: self.line(at),
            key,
            message,
        });
    }

    fn note(&mut self, mut problem: Problem) {
        problem.message = with_meant(&problem.message);
        if self.problems.len() < PROBLEMS_MAX && !self.problems.contains(&problem) {
            self.problems.push(problem);
        }
    }

    /// Whether no problem was found so far.
    pub(crate) fn is_sound(&self) -> bool {
        self.problems.is_empty()
    }

    /// The error of `file`.
    pub(crate) fn into_error(mut self, file: &str) -> DescriptionError {
        self.problems.sort();
        DescriptionError {
            file: file.to_owned(),
            problems: self.problems,
        }
    }

    fn line(&self, at: usize) -> usize {
        let before = &self.text.as_bytes()[..at.min(self.text.len())];
        1 + before.iter().filter(|&&byte| byte == b'\n').count()
    }

    /// The position of the value of `key`, or of the nearest enclosing table.
    fn find(&self, key: &str) -> Option<Range<usize>> {
        let mut found = None;
        let mut table = Some(&self.root);
        let mut list: Option<&[Spanned<DeValue<'_>>]> = None;
        for step in steps(key) {
            let next = match step {
                Step::Name(name) => {
                    let entry = table?.iter().find(|(known, _)| known.get_ref() == name);
                    let Some((known, value)) = entry else {
                        return found;
                    };
                    found = Some(known.span());
                    value
                }
                Step::Index(index) => match list {
                    Some(list) => {
                        let Some(value) = list.get(index) else {
                            return found;
                        };
                        found = Some(value.span());
                        value
                    }
                    // A single table instead of a list.
                    None => continue,
                },
            };
            (table, list) = match next.get_ref() {
                DeValue::Table(inner) => (Some(inner), None),
                DeValue::Array(inner) => (None, Some(&**inner)),
                _ => (None, None),
            };
            if table.is_none() && list.is_none() {
                return found;
            }
        }
        found
    }
}

enum Step<'a> {
    Name(&'a str),
    Index(usize),
}

fn steps(key: &str) -> impl Iterator<Item = Step<'_>> {
    key.split('.').flat_map(|part| {
        let (name, indices) = part.split_once('[').unwrap_or((part, ""));
        let indices = indices.split('[').filter_map(|index| {
            let number = index.strip_suffix(']')?.parse().ok()?;
            Some(Step::Index(number))
        });
        core::iter::once(Step::Name(name)).chain(indices)
    })
}

/// Finds the innermost key whose value contains the offset `at`.
fn key_at(table: &DeTable<'_>, at: usize, path: String, best: &mut String) {
    for (name, value) in table {
        let name_of: &str = name.get_ref();
        let dot = if path.is_empty() { "" } else { "." };
        let key = format!("{path}{dot}{name_of}");
        value_at(value, at, &key, best);
        if name.span().contains(&at) && key.len() > best.len() {
            best.clone_from(&key);
        }
    }
}

fn value_at(value: &Spanned<DeValue<'_>>, at: usize, key: &str, best: &mut String) {
    if value.span().contains(&at) && key.len() > best.len() {
        key.clone_into(best);
    }
    match value.get_ref() {
        DeValue::Table(inner) => key_at(inner, at, key.to_owned(), best),
        DeValue::Array(inner) => {
            for (index, value) in inner.iter().enumerate() {
                value_at(value, at, &format!("{key}[{index}]"), best);
            }
        }
        _ => {}
    }
}
