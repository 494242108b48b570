//! The source text of a scenario, and errors in it.

use std::path::{Path, PathBuf};

use crate::near;

/// An error in a scenario.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("cannot read scenario {}: {source}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The file is no text.
    #[error(
        "{} {} (expected a scenario or a case)", .path.display(),
        match is_capture {
            true => "is a capture; `hilrig case from` makes a case of it",
            false => "is no text",
        }
    )]
    NoText {
        /// The file.
        path: PathBuf,
        /// Whether it is a capture.
        is_capture: bool,
    },
    /// Several errors of a file, in order of lines, one per line of the message.
    #[error("{}", lines(.0))]
    Several(Vec<Self>),
    /// A description in the scenario is wrong.
    #[cfg(feature = "described")]
    #[error(transparent)]
    Description(#[from] ::description::DescriptionError),
    /// The scenario has an impossible value.
    #[error("{}{}: {key}: {message}", .path.display(), at(*line))]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Line, from 1, if known.
        line: Option<usize>,
        /// Key in question, e.g. `world.wall[3]`.
        key: String,
        /// The error, and the expected value.
        message: String,
    },
}

/// First bytes of a pcapng capture, and of pcap captures in both byte orders and resolutions.
const CAPTURES: [[u8; 4]; 5] = [
    [0x0A, 0x0D, 0x0D, 0x0A],
    [0xA1, 0xB2, 0xC3, 0xD4],
    [0xD4, 0xC3, 0xB2, 0xA1],
    [0xA1, 0xB2, 0x3C, 0x4D],
    [0x4D, 0x3C, 0xB2, 0xA1],
];

/// The text of a scenario or a case.
///
/// # Errors
/// If the file cannot be read, or is no text: a capture is named as such.
pub fn text_of(path: &Path) -> Result<String, ScenarioError> {
    let bytes = std::fs::read(path).map_err(|source| ScenarioError::Read {
        path: path.to_owned(),
        source,
    })?;
    String::from_utf8(bytes).map_err(|error| ScenarioError::NoText {
        path: path.to_owned(),
        is_capture: CAPTURES
            .iter()
            .any(|first| error.as_bytes().starts_with(first)),
    })
}

/// Whether a text between these two is a key, or a part of one.
fn is_key(before: &str, after: &str) -> bool {
    let begins = before.is_empty() || before.ends_with([' ', '.', '{', '[', ',', '"', '\t']);
    let after = after.trim_start_matches('"');
    let ends = after.trim_start().starts_with('=') || after.starts_with(['.', ']']);
    begins && ends
}

/// Words of messages about registers and variables, and the keys that they are about.
const NAMED: [(&str, &str); 6] = [
    ("limits", "limits"),
    ("address", "address"),
    ("actuator", "drives.actuator"),
    ("encoder", "source.encoder"),
    ("initial", "initial"),
    ("safe", "safe"),
];

/// Maximum number of errors that are shown for one file.
const ERRORS_MAX: usize = 10;

/// Errors, one per line.
fn lines(errors: &[ScenarioError]) -> String {
    let lines: Vec<String> = errors.iter().map(ScenarioError::to_string).collect();
    lines.join("\n")
}

impl ScenarioError {
    /// The errors of a file, at least one, as one: in order of lines, at most ten.
    pub fn all(errors: Vec<Self>) -> Self {
        let mut all = Vec::new();
        for error in errors {
            match error {
                Self::Several(errors) => all.extend(errors),
                error => all.push(error),
            }
        }
        all.sort_by_key(Self::line);
        // Two parts of the wiring may find the same mistake.
        all.dedup_by_key(|error| error.to_string());
        all.truncate(ERRORS_MAX);
        match all.len() {
            1 => all.remove(0),
            _ => Self::Several(all),
        }
    }

    /// `Ok` without errors, else all of them as one.
    pub(crate) fn none_of(errors: Vec<Self>) -> Result<(), Self> {
        match errors.is_empty() {
            true => Ok(()),
            false => Err(Self::all(errors)),
        }
    }

    /// The line, if known.
    pub(crate) const fn line(&self) -> Option<usize> {
        match self {
            Self::Invalid { line, .. } => *line,
            _ => None,
        }
    }

    /// The key in question; empty if there is none.
    pub(crate) fn key(&self) -> &str {
        match self {
            Self::Invalid { key, .. } => key,
            _ => "",
        }
    }
}

/// A line number after the file name.
fn at(line: Option<usize>) -> String {
    line.map(|line| format!(":{line}")).unwrap_or_default()
}

/// A scenario with the path of its file, for messages and for files that it names.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file, or a name in angle brackets for a built-in scenario.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
}

impl Source {
    /// Line of the table header or key `name`, for messages.
    pub fn find(&self, name: &str) -> Option<core::ops::Range<usize>> {
        let start = self
            .find_by(name, is_key)
            .or_else(|| self.find_by(name, |_, _| true))?;
        Some(start..start + name.len())
    }

    /// Position of `text` outside of comments, where `is_it` accepts the text before it and the
    /// text after it in the line.
    fn find_by(&self, text: &str, is_it: fn(&str, &str) -> bool) -> Option<usize> {
        let mut at = 0;
        for line in self.text.split_inclusive('\n') {
            let is_comment = line.trim_start().starts_with('#');
            let found = line.match_indices(text);
            let mut found = found
                .map(|(place, _)| place)
                .filter(|&place| is_it(&line[..place], &line[place + text.len()..]));
            if let Some(place) = found.next().filter(|_| !is_comment) {
                return Some(at + place);
            }
            at += line.len();
        }
        None
    }

    /// Line of `key` in the `index`-th table of the list `list`, or the first line of that table,
    /// for messages.
    pub fn find_in_list(
        &self,
        list: &str,
        index: usize,
        key: &str,
    ) -> Option<core::ops::Range<usize>> {
        let head = format!("[[{list}]]");
        let is_key = |line: &str| {
            let rest = line.trim_start().strip_prefix(key);
            rest.is_some_and(|rest| rest.trim_start().starts_with('='))
        };
        let (mut at, mut seen, mut table) = (0, 0, None);
        for line in self.text.split_inclusive('\n') {
            let span = at..at + line.trim_end().len();
            at += line.len();
            if line.trim_start().starts_with(&head) {
                table = (seen == index).then_some(span);
                seen += 1;
                if seen > index + 1 {
                    break;
                }
            } else if line.trim_start().starts_with('[') {
                if table.is_some() {
                    break;
                }
            } else if table.is_some() && is_key(line) {
                return Some(span);
            }
        }
        table
    }

    /// The error of an entry of a list, whose position is `span`: at the key that the message
    /// names.
    pub(crate) fn invalid_entry(
        &self,
        (list, index): (&str, usize),
        span: Option<core::ops::Range<usize>>,
        message: &str,
    ) -> ScenarioError {
        let mut words = message.split(|c: char| !c.is_ascii_alphanumeric());
        let named = words.find_map(|word| {
            let of_word = |(known, _): &&(&str, &str)| *known == word;
            NAMED.iter().find(of_word).map(|(_, key)| *key)
        });
        let entry = format!("{list}[{index}]");
        let message = near::with_meant(message);
        match named {
            Some(key) => {
                let outer = key.split('.').next().unwrap_or_default();
                let span = self.find_in_list(list, index, outer).or(span);
                self.invalid(span, format!("{entry}.{key}"), message)
            }
            None => self.invalid(span, entry, message),
        }
    }

    /// The error for a value `found` of `key` that is not among `known`.
    pub fn unknown(
        &self,
        key: &str,
        found: &toml::Spanned<String>,
        known: &[&str],
    ) -> ScenarioError {
        let message = near::expected(found.get_ref(), known);
        self.invalid(Some(found.span()), key, message)
    }

    /// The error for a wrong `key`, whose value is at `span` of the text.
    pub fn invalid(
        &self,
        span: Option<core::ops::Range<usize>>,
        key: impl Into<String>,
        message: impl Into<String>,
    ) -> ScenarioError {
        let line = span
            .filter(|span| span.end > 0 && span.start <= self.text.len())
            .map(|span| {
                1 + self.text.as_bytes()[..span.start]
                    .iter()
                    .filter(|&&b| b == b'\n')
                    .count()
            });
        ScenarioError::Invalid {
            path: self.path.clone(),
            line,
            key: key.into(),
            message: message.into(),
        }
    }
}
