//! Requests of the rig, answers of a node program, and their items.

use emulators::device::{Event, EventKind};
use protocols::{Instant, LineConfig, LineEvent};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::intern::forever;

/// The form of messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Form {
    /// `HRN1`, then messages with their lengths.
    #[default]
    Binary,
    /// One readable object per line.
    Json,
}

/// A request of the rig.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// The first message.
    Hello(Hello),
    /// Virtual time has reached a moment.
    Exchange {
        /// The moment.
        now: Instant,
        /// Inputs since the last exchange.
        items: Vec<Item<Input>>,
    },
    /// The program must return its complete state.
    Save,
    /// The program must load this state.
    Load(Vec<u8>),
    /// The program must exit.
    End,
}

/// An answer of a node program.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// The answer to the first message: the text of the greeting.
    Hello(Value),
    /// The answer to an exchange.
    Exchange(Reply),
    /// The saved state.
    Saved(Vec<u8>),
    /// The state was loaded.
    Loaded,
}

/// The answer to an exchange.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reply {
    /// Time of the next requested exchange; `None`: only after input.
    pub next: Option<Instant>,
    /// The outputs of the program.
    pub items: Vec<Item<Output>>,
}

/// An input or output with its time.
#[derive(Clone, Debug, PartialEq)]
pub struct Item<T> {
    /// Index of the port, or of a quantity.
    pub port: u8,
    /// Time.
    pub at: Instant,
    /// Content.
    pub what: T,
}

/// An input from the rig.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// Bytes arrived; the last one ended at the item's time.
    Bytes(Vec<u8>),
    /// A line event other than bytes.
    Line(LineEvent),
    /// A fault begins or ends.
    Fault {
        /// Name of the fault.
        name: String,
        /// Whether the fault begins.
        begins: bool,
        /// Figure of the fault.
        figure: Option<f64>,
    },
    /// A value from the rig.
    Quantity(f64),
    /// A message of the description: its name and its fields.
    Message(Value),
}

/// An output of a node program.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Bytes to be sent, not before the item's time.
    Bytes(Vec<u8>),
    /// A line event for the other end of the line.
    Line(LineEvent),
    /// A new coding of the line.
    Coding(LineConfig),
    /// An entry of the log.
    Note(Note),
    /// An output value of the program.
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
    /// A sentence that explains the entry.
    pub detail: String,
    /// The bytes concerned.
    pub bytes: Vec<u8>,
}

/// Note of a board whose watchdog has reset the firmware.
pub const WATCHDOG_RESET: &str = "watchdog-reset";
/// Note of a board that received a byte at a port that the firmware does not use.
pub const RECEIVER_OFF: &str = "receiver-off";

/// Note of a board that a unit without a clock could not wake from sleep.
pub const SLEEPS_ON: &str = "sleeps-on";

impl Note {
    /// Whether the program itself reports its work: neither a broken rule nor a note of its board.
    pub fn is_report(&self) -> bool {
        !self.is_violation && ![WATCHDOG_RESET, RECEIVER_OFF, SLEEPS_ON].contains(&&*self.rule)
    }

    /// The entry of the log at the time `at`.
    pub fn into_event(self, at: Instant) -> Event {
        Event {
            at,
            kind: match self.is_violation {
                true => EventKind::Violation,
                false => EventKind::Note,
            },
            rule: forever(&self.rule),
            detail: self.detail,
            bytes: self.bytes,
        }
    }
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
    /// Ports of the node.
    pub ports: Vec<PortText>,
    /// Names of the quantities that the rig provides.
    pub quantities: Vec<String>,
    /// Settings from the scenario.
    pub settings: Map<String, Value>,
    /// Messages of the node's description.
    #[serde(default)]
    pub messages: Value,
}

/// A port in a greeting.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PortText {
    /// Name of the port.
    pub name: String,
    /// Bits per second.
    pub rate: u32,
    /// Format such as `8N1`.
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
    /// Whether the program can save and load its state.
    #[serde(default)]
    pub save: bool,
    /// Faults that the program supports.
    #[serde(default)]
    pub faults: Vec<String>,
    /// Names of the program's outputs.
    #[serde(default)]
    pub outputs: Vec<String>,
    /// Line codings that differ from the scenario's.
    #[serde(default)]
    pub ports: Vec<PortText>,
    /// Whether the program uses messages of its description instead of bytes.
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

/// The number of a new line coding, in the range of line events.
pub const CODING: u8 = 16;
