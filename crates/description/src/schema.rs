//! The schema of description files: these keys and tables, no others.

pub mod behaviour;
pub mod message;
pub mod short;
pub mod state;
pub mod wire;

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Deserialize;

use behaviour::{AfterSpec, EverySpec, FaultSpec, OnSpec, ProgramSpec};
use message::MessageSpec;
use short::{Many, Short};
use span::Span;
use state::{RegistersSpec, StateSpec};
use wire::{Endian, FrameSpec, LineSpec};

/// A device: its line, frames, messages, state and behaviour.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Schema {
    /// Name: letters, digits and `-`.
    pub name: String,
    /// A description of the device in one line.
    pub about: String,
    /// Documents on which the description is based.
    #[serde(default)]
    pub documents: Vec<String>,
    /// A built-in protocol, with its frames, messages and behaviour.
    #[serde(default)]
    pub protocol: Option<ProtocolSpec>,
    /// Default byte order of numbers.
    #[serde(default)]
    pub endian: Option<Endian>,
    /// Time from a request to its reply; 1 ms if not given.
    #[serde(default)]
    pub latency: Option<Span>,
    /// Maximum random addition to a latency.
    #[serde(default)]
    pub jitter: Option<Span>,
    /// Silence of the driver after which variables take their safe values; never if not given.
    #[serde(default)]
    pub watchdog: Option<Span>,
    /// Time after a start in which the device receives nothing; none if not given.
    #[serde(default)]
    pub boot: Option<Span>,
    /// The serial line.
    pub line: LineSpec,
    /// The frame format, or several formats that share the line.
    #[serde(default)]
    pub frame: Many<FrameSpec>,
    /// Names of values: one table per set of names, with the values as keys.
    #[serde(default)]
    pub enums: BTreeMap<String, BTreeMap<String, String>>,
    /// The messages in the frames.
    #[serde(default)]
    pub message: Vec<MessageSpec>,
    /// Variables of the device.
    #[serde(default)]
    pub state: BTreeMap<String, Short<StateSpec>>,
    /// Registers.
    #[serde(default)]
    pub registers: Option<RegistersSpec>,
    /// Reactions to messages and events.
    #[serde(default)]
    pub on: Vec<OnSpec>,
    /// Periodic actions.
    #[serde(default)]
    pub every: Vec<EverySpec>,
    /// Delayed actions.
    #[serde(default)]
    pub after: Vec<AfterSpec>,
    /// Faults of the device, by name.
    #[serde(default)]
    pub faults: BTreeMap<String, FaultSpec>,
    /// An external program that implements the device.
    #[serde(default)]
    pub program: Option<ProgramSpec>,
}

/// Built-in protocols.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ProtocolSpec {
    /// Modbus RTU: frames that end with a silence, CRC-16/MODBUS.
    ModbusRtu,
    /// Modbus ASCII: lines that begin with a colon, LRC.
    ModbusAscii,
}

/// The JSON Schema of descriptions, for editors.
pub fn json_schema() -> schemars::Schema {
    schemars::schema_for!(Schema)
}
