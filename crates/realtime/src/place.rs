//! A port as others see it: name, path, and the activity of its client.

use std::path::Path;

use super::garbled::Garbled;
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

/// Openings of a port by its clients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Openings {
    /// Number of openings so far.
    pub(crate) count: u64,
    /// Whether a client has the port open.
    pub(crate) is_open: bool,
}

impl Openings {
    /// The changes from this state to `later`, each as "is open now". Several openings between two
    /// looks count as one: the port was closed for a moment.
    pub(crate) fn steps_to(self, later: Self) -> impl Iterator<Item = bool> {
        let is_new = later.count != self.count;
        let closes = (is_new && self.is_open).then_some(false);
        let opens = is_new.then_some(true);
        let stays_closed = (!later.is_open && (is_new || self.is_open)).then_some(false);
        [closes, opens, stays_closed].into_iter().flatten()
    }
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
    /// Bytes that passed at different rates.
    pub garbled: Garbled,
    /// Line settings of the client, if they are visible.
    pub settings: Option<Modes>,
    /// Whether the client has read since the last write, see
    /// [`super::transport::Transport::is_drained`].
    pub is_drained: bool,
    /// Number of times that the client took bytes, see [`super::transport::Transport::reads`].
    pub reads: Option<u64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_that_was_reopened_between_two_looks_was_closed_for_a_moment() {
        let (on, off) = (true, false);
        let at = |count, is_open| Openings { count, is_open };
        for (before, after, steps) in [
            (at(0, off), at(1, on), &[on] as &[bool]),
            (at(1, on), at(1, off), &[off]),
            (at(1, on), at(2, on), &[off, on]),
            (at(1, on), at(4, on), &[off, on]),
            (at(1, on), at(2, off), &[off, on, off]),
            (at(1, off), at(2, off), &[on, off]),
            (at(1, on), at(1, on), &[]),
        ] {
            let found: Vec<bool> = before.steps_to(after).collect();
            assert_eq!(found, steps, "{before:?} {after:?}");
        }
    }
}
