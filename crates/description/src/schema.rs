//! A description as a file has it: TOML with these keys and tables, and no others.

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
    /// What it is, in a line.
    pub about: String,
    /// Documents that it was written from.
    #[serde(default)]
    pub documents: Vec<String>,
    /// A protocol that the tool knows: frames, messages and behaviour come with it.
    #[serde(default)]
    pub protocol: Option<ProtocolSpec>,
    /// Order of the bytes of numbers that do not say otherwise.
    #[serde(default)]
    pub endian: Option<Endian>,
    /// Time from a request to its reply; 1 ms if not given.
    #[serde(default)]
    pub latency: Option<Span>,
    /// Most that a latency is longer by chance.
    #[serde(default)]
    pub jitter: Option<Span>,
    /// Silence of the driver after which values become safe; never if not given.
    #[serde(default)]
    pub watchdog: Option<Span>,
    /// Time after a start in which the device receives nothing; none if not given.
    #[serde(default)]
    pub boot: Option<Span>,
    /// The serial line.
    pub line: LineSpec,
    /// How frames are cut out of bytes; several if several formats share the line.
    #[serde(default)]
    pub frame: Many<FrameSpec>,
    /// Names of values: a table each, with the value as key.
    #[serde(default)]
    pub enums: BTreeMap<String, BTreeMap<String, String>>,
    /// What frames hold.
    #[serde(default)]
    pub message: Vec<MessageSpec>,
    /// Variables of the device.
    #[serde(default)]
    pub state: BTreeMap<String, Short<StateSpec>>,
    /// Registers.
    #[serde(default)]
    pub registers: Option<RegistersSpec>,
    /// What it does when something happens.
    #[serde(default)]
    pub on: Vec<OnSpec>,
    /// What it does again and again.
    #[serde(default)]
    pub every: Vec<EverySpec>,
    /// What it does some time after something.
    #[serde(default)]
    pub after: Vec<AfterSpec>,
    /// What can go wrong with it, by name.
    #[serde(default)]
    pub faults: BTreeMap<String, FaultSpec>,
    /// A program of one's own that is the device.
    #[serde(default)]
    pub program: Option<ProgramSpec>,
}

/// Protocols that the tool knows.
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
