//! The specification of a node program.

use core::time::Duration;
use std::path::PathBuf;
use std::sync::Arc;

use description::Description;
use emulators::quantity::{Sink, ValueSource};
use protocols::{LineConfig, Parity};
use serde_json::{Map, Value};

/// The role of a node program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Role {
    /// A device.
    #[default]
    Device,
    /// The program under test.
    Program,
}

impl Role {
    /// The name of the role in the greeting.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Device => "device",
            Self::Program => "program",
        }
    }
}

/// A port of a node program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodePort {
    /// Name of the port, e.g. `uart`.
    pub name: String,
    /// Coding of its line.
    pub line: LineConfig,
    /// Whether the link carries whole messages: each item of bytes is then one message.
    pub carries_messages: bool,
}

impl NodePort {
    /// A serial port.
    pub fn uart(name: &str, line: LineConfig) -> Self {
        Self {
            name: name.to_owned(),
            line,
            carries_messages: false,
        }
    }
}

/// A value that the rig provides to a node program.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// Name of the value.
    pub name: String,
    /// Source of the value.
    pub source: ValueSource,
}

/// An actuator that follows an output of a node program.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// Name of the output.
    pub output: String,
    /// The actuator.
    pub sink: Sink,
}

/// A node program: its command and the content of its greeting.
#[derive(Clone, Debug)]
pub struct NodeSpec {
    /// Name of the node.
    pub name: String,
    /// The shell command.
    pub command: String,
    /// The working directory; `None`: that of the rig.
    pub folder: Option<PathBuf>,
    /// Additional environment variables.
    pub env: Vec<(String, String)>,
    /// The role of the program.
    pub role: Role,
    /// Seed of the run.
    pub seed: u64,
    /// The ports; the index in the list is the number of the port.
    pub ports: Vec<NodePort>,
    /// Values that the rig provides.
    pub quantities: Vec<Quantity>,
    /// Actuators that follow its outputs.
    pub drives: Vec<Drive>,
    /// Settings from the scenario.
    pub settings: Map<String, Value>,
    /// The protocol of its first port; the program may then use messages instead of bytes.
    pub description: Option<Arc<Description>>,
    /// Timeout for an answer, wall time.
    pub patience: Duration,
    /// Whether a program under test may send and show nothing, or fall silent.
    pub may_idle: bool,
    /// Whether the watchdog of its board may reset a program under test.
    pub may_reset: bool,
}

/// Maximum number of quantities, and of outputs: an item has one byte for the number.
pub const NUMBERS_MAX: usize = 256;

/// Default timeout for an answer, wall time.
pub const PATIENCE: Duration = Duration::from_secs(10);

impl NodeSpec {
    /// A device without ports.
    pub fn new(name: &str, command: &str) -> Self {
        Self {
            name: name.to_owned(),
            command: command.to_owned(),
            folder: None,
            env: Vec::new(),
            role: Role::Device,
            seed: 0,
            ports: Vec::new(),
            quantities: Vec::new(),
            drives: Vec::new(),
            settings: Map::new(),
            description: None,
            patience: PATIENCE,
            may_idle: false,
            may_reset: false,
        }
    }
}

/// The format such as `8N1` of a line coding.
pub fn format_of(line: LineConfig) -> String {
    let parity = match line.parity {
        Parity::None => 'N',
        Parity::Even => 'E',
        Parity::Odd => 'O',
    };
    format!("{}{parity}{}", line.data_bits, line.stop_bits)
}

/// The line coding with this rate and a format such as `8N1`; `None` if it is invalid.
pub fn line_of(rate: u32, format: &str) -> Option<LineConfig> {
    let &[data @ b'5'..=b'8', parity, stop @ (b'1' | b'2')] = format.as_bytes() else {
        return None;
    };
    let parity = match parity.to_ascii_uppercase() {
        b'N' => Parity::None,
        b'E' => Parity::Even,
        b'O' => Parity::Odd,
        _ => return None,
    };
    (rate > 0).then_some(LineConfig {
        baud: rate,
        data_bits: data - b'0',
        parity,
        stop_bits: stop - b'0',
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coding_is_read_as_it_is_written() {
        for format in ["8N1", "7E1", "5O2"] {
            let line = line_of(9_600, format).expect(format);
            assert_eq!((line.baud, format_of(line)), (9_600, format.to_owned()));
        }
        for wrong in ["", "8N", "9N1", "8X1", "8N3", "8N11"] {
            assert_eq!(line_of(9_600, wrong), None, "{wrong}");
        }
        assert_eq!(line_of(0, "8N1"), None);
    }
}
