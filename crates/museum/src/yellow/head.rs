//! An RPLIDAR in a scene, as bytes.

use protocols::Decode;
use protocols::rplidar::{Command, Descriptor, Health, Node, RequestDecoder, Status};

/// Nodes of a turn, one each half degree, and nodes per millisecond.
const NODES: u16 = 720;
const NODES_PER_MS: u16 = 2;

/// The lidar: replies to scan, health and reset requests.
#[derive(Default)]
pub(super) struct Head {
    /// Distance in millimetres by turn and half degree, clockwise; 0 is no return.
    scene: Option<fn(u32, u16) -> u16>,
    /// Whether the lidar was still scanning when the robot restarted.
    pub(super) streams: bool,
    /// Whether the head is in Protection Stop.
    pub(super) is_stopped: bool,
    pub(super) loses_byte: bool,
    /// Bytes before the next descriptor.
    pub(super) stray: Vec<u8>,
    turn: u32,
    node: u16,
    requests: RequestDecoder,
    pub(super) asked: Vec<Command>,
    answer: Vec<u8>,
    /// The last batch of bytes.
    pub(super) sent: Vec<u8>,
}

impl Head {
    pub(super) fn new(scene: fn(u32, u16) -> u16) -> Self {
        Self {
            scene: Some(scene),
            ..Self::default()
        }
    }

    pub(super) fn receive(&mut self, bytes: &[u8]) {
        let requests: Vec<_> = self.requests.push(bytes).flatten().collect();
        let commands = requests.iter().filter_map(|request| request.command());
        for command in commands {
            self.asked.push(command);
            match command {
                Command::Scan if !self.is_stopped => {
                    if self.streams {
                        // In flight when the request arrived: the rest of a node, and another one.
                        let rest: Vec<u8> = (0..2).flat_map(|_| self.next_node()).skip(2).collect();
                        self.answer.extend(rest);
                    }
                    self.answer.append(&mut self.stray);
                    self.answer.extend(Descriptor::nodes().as_bytes());
                    (self.streams, self.node) = (true, 0);
                }
                Command::Health => {
                    let status = match self.is_stopped {
                        true => Status::Error,
                        false => Status::Good,
                    };
                    let health = Health { status, error: 1 };
                    self.answer.extend(health.answer().as_bytes());
                }
                Command::Reset => (self.is_stopped, self.streams) = (false, false),
                _ => {}
            }
        }
    }

    /// Bytes of one millisecond.
    pub(super) fn step(&mut self) -> Vec<u8> {
        let mut bytes = core::mem::take(&mut self.answer);
        if self.streams && !self.is_stopped {
            for _ in 0..NODES_PER_MS {
                bytes.extend(self.next_node());
            }
        }
        if !bytes.is_empty() && core::mem::take(&mut self.loses_byte) {
            bytes.remove(0);
        }
        if !bytes.is_empty() {
            self.sent.clone_from(&bytes);
        }
        bytes
    }

    fn next_node(&mut self) -> [u8; 5] {
        let Some(scene) = self.scene else {
            return *Node::new(self.node == 0, 0, 0, 0).as_bytes();
        };
        let distance_mm = scene(self.turn, self.node);
        let quality = if distance_mm == 0 { 0 } else { 47 };
        let node = Node::new(self.node == 0, quality, self.node * 32, distance_mm * 4);
        self.node += 1;
        if self.node == NODES {
            (self.node, self.turn) = (0, self.turn + 1);
        }
        *node.as_bytes()
    }
}
