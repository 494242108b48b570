//! A port as others see it: name, path, and the activity of its client.

use std::path::Path;

use super::transport::{Counters, Modes, Special};

/// Name and address of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place<'a> {
    /// The port's name.
    pub name: &'a str,
    /// Its path.
    pub path: &'a Path,
    /// Its rate, bit/s.
    pub baud: u32,
    /// Its node in the rig.
    pub node: usize,
}

/// Number of bytes that passed a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Bytes that clients sent.
    pub from_client: u64,
    /// Bytes that clients could read.
    pub to_client: u64,
}

/// Observations of the client of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sign<'a> {
    /// The port's name.
    pub name: &'a str,
    /// Whether a client has it open.
    pub is_open: bool,
    /// Number of openings. Only this number shows a client that closed and reopened the port
    /// between two polls.
    pub openings: u64,
    /// Bytes that clients sent so far.
    pub from_client: u64,
    /// Bytes that clients could read so far.
    pub to_client: u64,
    /// Bytes for the client that were lost.
    pub lost: Counters,
    /// Bytes that line settings may change: to the client, from the client.
    pub special: [Special; 2],
    /// Rates of the client and of the other end, bit/s, if they do not understand each other.
    pub wrong_rate: Option<(u32, u32)>,
    /// Line settings of the client, if they are visible.
    pub settings: Option<Modes>,
    /// Whether the client has read since the last write, see
    /// [`super::transport::Transport::is_drained`].
    pub is_drained: bool,
    /// Number of times that the client took bytes, see [`super::transport::Transport::reads`].
    pub reads: Option<u64>,
}
