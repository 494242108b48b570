//! What a node program is started from.

use core::time::Duration;
use std::path::PathBuf;
use std::sync::Arc;

use description::Description;
use emulators::quantity::{Sink, ValueSource};
use protocols::{LineConfig, Parity};
use serde_json::{Map, Value};

/// Which part a node program plays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Role {
    /// A device.
    #[default]
    Device,
    /// The program under test.
    Program,
}

impl Role {
    /// Name as in the greeting.
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
    /// Its name, e.g. `uart`.
    pub name: String,
    /// Coding of its line.
    pub line: LineConfig,
    /// Whether its link carries whole messages: then each item of bytes is one.
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

/// A value that the rig gives to a node program.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// Its name.
    pub name: String,
    /// Where it comes from.
    pub source: ValueSource,
}

/// An actuator that follows an output of a node program.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// Name of the output.
    pub output: String,
    /// What it does.
    pub sink: Sink,
}

/// A node program: how it is started, and what it is told.
#[derive(Clone, Debug)]
pub struct NodeSpec {
    /// Name of the node.
    pub name: String,
    /// For the shell.
    pub command: String,
    /// Where it is started; `None`: where the rig is.
    pub folder: Option<PathBuf>,
    /// Variables added to its environment.
    pub env: Vec<(String, String)>,
    /// Which part it plays.
    pub role: Role,
    /// Seed of the run.
    pub seed: u64,
    /// Its ports; their numbers are their places.
    pub ports: Vec<NodePort>,
    /// Values that the rig gives.
    pub quantities: Vec<Quantity>,
    /// Actuators that follow its outputs.
    pub drives: Vec<Drive>,
    /// Whatever the scenario says to it.
    pub settings: Map<String, Value>,
    /// What is spoken on its first port; then it may have messages in place of bytes.
    pub description: Option<Arc<Description>>,
    /// Wall time for which the rig waits for an answer.
    pub patience: Duration,
}

/// Maximum number of quantities, and of outputs: an item has one byte for the number.
pub const NUMBERS_MAX: usize = 256;

/// Wall time for which the rig waits for an answer.
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
        }
    }
}

/// `8N1` of a line coding.
pub fn format_of(line: LineConfig) -> String {
    let parity = match line.parity {
        Parity::None => 'N',
        Parity::Even => 'E',
        Parity::Odd => 'O',
    };
    format!("{}{parity}{}", line.data_bits, line.stop_bits)
}

/// The line coding of a rate and `8N1` and its like; `None`: no such coding.
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
