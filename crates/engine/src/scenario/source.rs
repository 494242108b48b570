//! The source text of a scenario, and errors in it.

use std::path::PathBuf;

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
    /// The file is not a scenario; the text names line, column, key and the expected value.
    #[error("{}: {}", .path.display(), .source.to_string().trim_end())]
    Parse {
        /// The file.
        path: PathBuf,
        /// The error, with the line of the file.
        source: Box<toml::de::Error>,
    },
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
            .text
            .find(&format!(".{name}"))
            .or_else(|| self.text.find(name))?;
        Some(start..start + name.len())
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

    /// The error for a value `found` of `key` that is not among `known`.
    pub fn unknown(
        &self,
        key: &str,
        found: &toml::Spanned<String>,
        known: &[&str],
    ) -> ScenarioError {
        let known = known.join(", ");
        let message = format!("is \"{}\", expected one of {known}", found.get_ref());
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
