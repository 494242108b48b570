//! Result of a request.

use protocols::Instant;
use serde::Serialize;
use serde_json::{Map, Value};

use engine::rig::fault::FaultId;
use engine::run::FaultReport;
use engine::scenario::{Flaw, Span};

/// Result of a request.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Answer {
    /// Whether the request was granted.
    pub ok: bool,
    /// The fault that was added or ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub id: Option<FaultId>,
    /// Time of the rig's clock when the request was read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub asked: Option<Span>,
    /// The virtual time of the change.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub applied: Option<Span>,
    /// List of all faults.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub faults: Option<Vec<FaultReport>>,
    /// Error of a refused request.
    #[serde(flatten)]
    pub refusal: Option<Refusal>,
    /// Further keys of this kind of answer.
    #[serde(flatten)]
    pub more: Map<String, Value>,
}

/// Reason for a refusal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Refusal {
    /// The key with the error.
    pub key: String,
    /// The error, and the expected value.
    pub message: String,
}

impl Refusal {
    /// The refusal `message` of `key`.
    pub fn new(key: impl Into<String>, message: impl Into<String>) -> Self {
        let (key, message) = (key.into(), message.into());
        Self { key, message }
    }
}

impl From<Flaw> for Refusal {
    fn from(flaw: Flaw) -> Self {
        Self::new(flaw.key, flaw.message)
    }
}

impl From<Refusal> for Answer {
    fn from(refusal: Refusal) -> Self {
        Self {
            refusal: Some(refusal),
            ..Self::default()
        }
    }
}

impl Answer {
    /// Granted, with the keys of the JSON object `more`.
    pub(super) fn granted(more: Value) -> Self {
        let more = match more {
            Value::Object(more) => more,
            _ => Map::new(),
        };
        Self {
            ok: true,
            more,
            ..Self::default()
        }
    }

    /// The answer with the virtual time `at`, as text and in nanoseconds.
    #[must_use]
    pub(super) fn at(mut self, at: Instant) -> Self {
        let span = Span(at - Instant::ZERO).to_string();
        self.more.insert("at".to_owned(), span.into());
        self.more.insert("at_ns".to_owned(), at.as_nanos().into());
        self
    }

    /// The answer as a line.
    pub fn line(&self) -> String {
        let mut text = serde_json::to_string(self).expect("plain data with string keys");
        text.push('\n');
        text
    }
}
