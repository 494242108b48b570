//! `[[on]]`, `[[every]]`, `[[after]]`, `[faults]` and `[program]`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Deserialize;

use super::message::Names;
use super::short::Plain;
use span::Span;

/// What the device does when something happens; the first that fits is done.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OnSpec {
    /// The message that arrives; `*` is any that no earlier entry took.
    #[serde(default)]
    pub message: Option<String>,
    /// Something else that happens.
    #[serde(default)]
    pub event: Option<EventSpec>,
    /// Only if this expression over the message's fields and the state is true.
    #[serde(default)]
    pub when: Option<String>,
    /// Variables that change, in this order of their names, each with an expression.
    #[serde(default)]
    pub set: BTreeMap<String, Plain>,
    /// Bytes written to the table of registers.
    #[serde(default)]
    pub write: Option<WriteSpec>,
    /// Messages that are sent.
    #[serde(default)]
    pub reply: Names,
    /// Fields of the reply, each with an expression. Others are the variable or the field of the
    /// request with their name, or 0.
    #[serde(default)]
    pub with: BTreeMap<String, Plain>,
    /// Time to the reply, in place of the device's.
    #[serde(default)]
    pub latency: Option<Span>,
    /// Most that the latency is longer by chance.
    #[serde(default)]
    pub jitter: Option<Span>,
    /// Time for which the device takes no further message.
    #[serde(default)]
    pub busy: Option<Span>,
    /// The driver did something wrong: name of the broken rule for the log.
    #[serde(default)]
    pub violation: Option<String>,
    /// The device starts again.
    #[serde(default)]
    pub restart: bool,
}

/// Bytes for the table of registers.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WriteSpec {
    /// Address of the first one, an expression.
    pub at: Plain,
    /// The bytes, an expression.
    pub data: String,
}

/// What happens besides messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum EventSpec {
    /// A frame came whose checksum is wrong, or which is cut off.
    BadFrame,
    /// A frame came that is no message.
    Unknown,
    /// The device has started.
    Start,
    /// The driver was silent for the watchdog time.
    Watchdog,
    /// A break on the line.
    Break,
    /// The driver wrote or read outside of the registers, or what it must not.
    Refused,
}

/// What the device does again and again.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EverySpec {
    /// Time between two.
    pub period: Span,
    /// Time of the first one after the start; a period if not given.
    #[serde(default)]
    pub first: Option<Span>,
    /// Only if this expression over the state is true.
    #[serde(default)]
    pub when: Option<String>,
    /// Messages that are sent.
    #[serde(default)]
    pub send: Names,
    /// Fields of the messages, each with an expression.
    #[serde(default)]
    pub with: BTreeMap<String, Plain>,
    /// Variables that change, each with an expression.
    #[serde(default)]
    pub set: BTreeMap<String, Plain>,
    /// Most that it is late by chance.
    #[serde(default)]
    pub jitter: Option<Span>,
}

/// What the device does some time after something.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterSpec {
    /// How long after it.
    pub delay: Span,
    /// The message that arrived.
    #[serde(default)]
    pub message: Option<String>,
    /// What happened otherwise; the start if neither is given.
    #[serde(default)]
    pub event: Option<EventSpec>,
    /// Only if this expression is true when the time has come.
    #[serde(default)]
    pub when: Option<String>,
    /// Messages that are sent.
    #[serde(default)]
    pub send: Names,
    /// Fields of the messages, each with an expression.
    #[serde(default)]
    pub with: BTreeMap<String, Plain>,
    /// Variables that change, each with an expression.
    #[serde(default)]
    pub set: BTreeMap<String, Plain>,
}

/// Something that can go wrong with the device.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FaultSpec {
    /// What it is, in a line.
    #[serde(default)]
    pub about: String,
    /// Variables and registers with other values while it lasts, each an expression; `factor` is
    /// the figure of the scenario, `self` what the value would be.
    #[serde(default)]
    pub set: BTreeMap<String, Plain>,
    /// Variables and registers that stay as they are.
    #[serde(default)]
    pub freeze: Vec<String>,
    /// Replies come later by this.
    #[serde(default)]
    pub late: Option<Span>,
    /// Nothing is sent.
    #[serde(default)]
    pub mute: bool,
    /// Checksums are wrong.
    #[serde(default)]
    pub bad_checksum: bool,
    /// Messages that are sent in place of others.
    #[serde(default)]
    pub replace: BTreeMap<String, String>,
    /// Random bytes sent when the device starts again.
    #[serde(default)]
    pub garbage: Option<u16>,
    /// The device starts again when it begins.
    #[serde(default)]
    pub restart: bool,
}

/// A program of one's own that is the device, described by the rest of the file.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProgramSpec {
    /// Its command line.
    pub exec: String,
}
