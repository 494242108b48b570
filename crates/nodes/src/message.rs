//! Requests of the rig, answers of a node program, and what they carry.

use protocols::{Instant, LineConfig, LineEvent};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// How messages are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Form {
    /// `HRN1`, then messages with their lengths.
    #[default]
    Binary,
    /// One object a line, to be read by people.
    Json,
}

/// What the rig asks.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// The first message.
    Hello(Hello),
    /// Time has come to a moment.
    Exchange {
        /// The moment.
        now: Instant,
        /// What has happened since the last one.
        items: Vec<Item<Input>>,
    },
    /// All state is to be given.
    Save,
    /// The state is to be what was given once.
    Load(Vec<u8>),
    /// The program is to exit.
    End,
}

/// What a node program answers.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// To the first message: the text of its greeting.
    Hello(Value),
    /// To an exchange.
    Exchange(Reply),
    /// The state.
    Saved(Vec<u8>),
    /// The state was taken over.
    Loaded,
}

/// The answer to an exchange.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reply {
    /// When to be asked again; `None`: only after input.
    pub next: Option<Instant>,
    /// What the program does.
    pub items: Vec<Item<Output>>,
}

/// Something that happens at a moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Item<T> {
    /// Port, or number of a quantity.
    pub port: u8,
    /// When.
    pub at: Instant,
    /// What.
    pub what: T,
}

/// What a rig tells.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// Bytes arrived; the last one ended at the item's time.
    Bytes(Vec<u8>),
    /// Something besides bytes happened on the line.
    Line(LineEvent),
    /// A fault begins or ends.
    Fault {
        /// Its name.
        name: String,
        /// Whether it begins.
        begins: bool,
        /// How bad it is.
        figure: Option<f64>,
    },
    /// A value that the rig gives.
    Quantity(f64),
    /// A message of the description: its name and its fields.
    Message(Value),
}

/// What a node program tells.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Bytes to be sent, not before the item's time.
    Bytes(Vec<u8>),
    /// Something that the far end of the line sees.
    Line(LineEvent),
    /// Another coding of the line.
    Coding(LineConfig),
    /// An entry of the log.
    Note(Note),
    /// A value that the program gives.
    Quantity(f64),
    /// A message of the description to be sent, not before the item's time.
    Message(Value),
}

/// An entry of the log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Note {
    /// Whether the master broke a rule.
    pub is_violation: bool,
    /// Short name in kebab case.
    pub rule: String,
    /// A sentence.
    pub detail: String,
    /// The bytes in question.
    pub bytes: Vec<u8>,
}

/// The greeting of the rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Version of the contract.
    pub hilrig_node: u64,
    /// Name of the node.
    pub name: String,
    /// `device` or `program`.
    pub role: String,
    /// Seed of the run.
    pub seed: u64,
    /// Its ports.
    pub ports: Vec<PortText>,
    /// Names of the quantities that the rig gives.
    pub quantities: Vec<String>,
    /// Whatever the scenario says to it.
    pub settings: Map<String, Value>,
    /// The messages of its description.
    #[serde(default)]
    pub messages: Value,
}

/// A port in a greeting.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PortText {
    /// Its name.
    pub name: String,
    /// Bits per second.
    pub rate: u32,
    /// `8N1` and its like.
    #[serde(default = "usual_format")]
    pub format: String,
}

fn usual_format() -> String {
    "8N1".to_owned()
}

/// The greeting of a node program.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Greeting {
    /// Version of the contract.
    pub hilrig_node: u64,
    /// Whether it can save and load its state.
    #[serde(default)]
    pub save: bool,
    /// Faults that it knows.
    #[serde(default)]
    pub faults: Vec<String>,
    /// Names of the values that it gives.
    #[serde(default)]
    pub outputs: Vec<String>,
    /// Other codings of its lines.
    #[serde(default)]
    pub ports: Vec<PortText>,
    /// Whether it wants messages of its description in place of bytes.
    #[serde(default)]
    pub messages: bool,
}

/// Line events by their numbers.
pub const LINE_EVENTS: [(u8, LineEvent, &str); 6] = [
    (0, LineEvent::Opened, "opened"),
    (1, LineEvent::Closed, "closed"),
    (2, LineEvent::Break, "break"),
    (3, LineEvent::FramingError, "framing-error"),
    (4, LineEvent::ParityError, "parity-error"),
    (5, LineEvent::Overrun, "overrun"),
];

/// Number of a new line coding among line events.
pub const CODING: u8 = 16;
