//! Where a scenario comes from, and what is wrong with it.

use std::fmt;
use std::path::PathBuf;

/// Why a scenario cannot be run.
#[derive(Debug)]
pub enum ScenarioError {
    /// The file cannot be read.
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not a scenario; the text names line, column, key and what was expected.
    Parse {
        /// Which file.
        path: PathBuf,
        /// What is wrong, with the line shown.
        source: Box<toml::de::Error>,
    },
    /// The scenario says something that cannot be.
    Invalid {
        /// Which file.
        path: PathBuf,
        /// Line, from 1, if known.
        line: Option<usize>,
        /// Key in question, e.g. `world.wall[3]`.
        key: String,
        /// What is wrong and what was expected.
        message: String,
    },
}

impl fmt::Display for ScenarioError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read { path, source } => {
                write!(f, "cannot read scenario {}: {source}", path.display())
            }
            Self::Parse { path, source } => {
                write!(f, "{}: {}", path.display(), source.to_string().trim_end())
            }
            Self::Invalid {
                path,
                line,
                key,
                message,
            } => {
                write!(f, "{}", path.display())?;
                if let Some(line) = line {
                    write!(f, ":{line}")?;
                }
                write!(f, ": {key}: {message}")
            }
        }
    }
}

impl core::error::Error for ScenarioError {}

/// A scenario with the place it was read from, for messages and for files that it names.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file, or a name in angle brackets for a built-in scenario.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
}

impl Source {
    /// Where `name` stands as a table header or key, for messages.
    pub fn find(&self, name: &str) -> Option<core::ops::Range<usize>> {
        let start = self
            .text
            .find(&format!(".{name}"))
            .or_else(|| self.text.find(name))?;
        Some(start..start + name.len())
    }

    /// The error that `key`, whose value lies at `span` of the text, is wrong.
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
