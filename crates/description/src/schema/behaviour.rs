//! `[[on]]`, `[[every]]`, `[[after]]`, `[faults]` and `[program]`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Deserialize;

use super::message::Names;
use super::short::Plain;
use span::Span;

/// A reaction to a message or event; the first entry that fits is executed.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OnSpec {
    /// The message that arrives; `*` is any message that no earlier entry accepts.
    #[serde(default)]
    pub message: Option<String>,
    /// An event other than a message.
    #[serde(default)]
    pub event: Option<EventSpec>,
    /// A condition: an expression over the message's fields and the state.
    #[serde(default)]
    pub when: Option<String>,
    /// Variables to change, in alphabetical order, each with an expression.
    #[serde(default)]
    pub set: BTreeMap<String, Plain>,
    /// Bytes to write to the register table.
    #[serde(default)]
    pub write: Option<WriteSpec>,
    /// Messages to send.
    #[serde(default)]
    pub reply: Names,
    /// Fields of the reply, each with an expression. Other fields take the value of the variable or
    /// request field with the same name, or 0.
    #[serde(default)]
    pub with: BTreeMap<String, Plain>,
    /// Time to the reply; overrides the device's latency.
    #[serde(default)]
    pub latency: Option<Span>,
    /// Maximum random addition to the latency.
    #[serde(default)]
    pub jitter: Option<Span>,
    /// Time for which the device ignores further messages.
    #[serde(default)]
    pub busy: Option<Span>,
    /// Marks an error of the driver: the name of the broken rule, for the log.
    #[serde(default)]
    pub violation: Option<String>,
    /// Restarts the device.
    #[serde(default)]
    pub restart: bool,
}

/// Bytes for the register table.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WriteSpec {
    /// Address of the first byte, an expression.
    pub at: Plain,
    /// The bytes, an expression.
    pub data: String,
}

/// Events other than messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum EventSpec {
    /// A frame with a wrong checksum, or a partial frame.
    BadFrame,
    /// A valid frame without a matching message.
    Unknown,
    /// The device has started.
    Start,
    /// The driver was silent for the watchdog time.
    Watchdog,
    /// A break on the line arrives.
    Break,
    /// The driver read or wrote outside the registers, or wrote a read-only register.
    Refused,
}

/// A periodic action.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EverySpec {
    /// Time between two repetitions.
    pub period: Span,
    /// Time of the first repetition after the start; one period if not given.
    #[serde(default)]
    pub first: Option<Span>,
    /// A condition: an expression over the state.
    #[serde(default)]
    pub when: Option<String>,
    /// Messages to send.
    #[serde(default)]
    pub send: Names,
    /// Fields of the messages, each with an expression.
    #[serde(default)]
    pub with: BTreeMap<String, Plain>,
    /// Variables to change, each with an expression.
    #[serde(default)]
    pub set: BTreeMap<String, Plain>,
    /// Maximum random delay of a repetition.
    #[serde(default)]
    pub jitter: Option<Span>,
}

/// A delayed action.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterSpec {
    /// Delay after the message or event.
    pub delay: Span,
    /// The message that starts the delay.
    #[serde(default)]
    pub message: Option<String>,
    /// The event that starts the delay; the start of the device if neither is given.
    #[serde(default)]
    pub event: Option<EventSpec>,
    /// A condition, evaluated at the end of the delay.
    #[serde(default)]
    pub when: Option<String>,
    /// Messages to send.
    #[serde(default)]
    pub send: Names,
    /// Fields of the messages, each with an expression.
    #[serde(default)]
    pub with: BTreeMap<String, Plain>,
    /// Variables to change, each with an expression.
    #[serde(default)]
    pub set: BTreeMap<String, Plain>,
}

/// A fault of the device.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FaultSpec {
    /// A description of the fault in one line.
    #[serde(default)]
    pub about: String,
    /// Variables and registers that the fault changes, each with an expression; `factor` is the
    /// figure of the scenario, `self` the value without the fault.
    #[serde(default)]
    pub set: BTreeMap<String, Plain>,
    /// Variables and registers that keep their value.
    #[serde(default)]
    pub freeze: Vec<String>,
    /// Additional delay of replies.
    #[serde(default)]
    pub late: Option<Span>,
    /// The device sends nothing.
    #[serde(default)]
    pub mute: bool,
    /// The device sends wrong checksums.
    #[serde(default)]
    pub bad_checksum: bool,
    /// Messages and their replacements.
    #[serde(default)]
    pub replace: BTreeMap<String, String>,
    /// Number of random bytes that the device sends when it restarts.
    #[serde(default)]
    pub garbage: Option<u16>,
    /// The device restarts when the fault begins.
    #[serde(default)]
    pub restart: bool,
}

/// An external program that implements the device; the rest of the file describes it.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProgramSpec {
    /// The command line of the program.
    pub exec: String,
}
