//! Input and output of a line in one step.

use protocols::{Instant, LineEvent};

use crate::rig::fault::Strike;

/// Largest piece.
pub const PIECE_MAX: usize = 64;

/// Bytes that a receiver gets at once.
#[derive(Clone, Debug)]
pub struct Delivery {
    /// Time at which the last byte was complete.
    pub at: Instant,
    /// The bytes after all faults; may be empty.
    pub bytes: Vec<u8>,
    /// Further events.
    pub event: Option<LineEvent>,
    /// Characters without a valid stop bit among the sent ones.
    pub framing_errors: u32,
    /// Characters that arrived damaged, in order. A receiver that checks them gets no byte; one
    /// that does not check reads them nevertheless.
    pub marks: Vec<Mark>,
    /// The sent bytes, if the line changed or delayed them.
    pub original: Option<Box<Original>>,
}

/// A damaged character that the receiver detects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark {
    /// Index, among the bytes that arrived with it, of the byte after the character.
    pub before: usize,
    /// The byte that the receiver read.
    pub value: u8,
    /// The error.
    pub damage: MarkDamage,
}

/// Error of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarkDamage {
    /// The parity bit is wrong.
    Parity,
    /// The stop bit is missing.
    Framing,
    /// The line was low from its start bit to its stop bit.
    Break,
}

impl Mark {
    /// Removes the marks before byte `to` from `marks` and returns them. Bytes are counted from
    /// `from` on.
    pub(super) fn split(marks: &mut Vec<Self>, from: usize, to: usize) -> Vec<Self> {
        let place = marks.partition_point(|mark| mark.before < to);
        let mut taken: Vec<Self> = marks.drain(..place).collect();
        for mark in &mut taken {
            mark.before -= from.min(mark.before);
        }
        taken
    }
}

/// Characters of a chunk that give no byte.
#[derive(Clone, Debug, Default)]
pub(super) struct Errors {
    pub(super) framing: u32,
    pub(super) parity: u32,
    pub(super) marks: Vec<Mark>,
}

impl Errors {
    pub(super) const fn framing(count: u32, marks: Vec<Mark>) -> Self {
        Self {
            framing: count,
            parity: 0,
            marks,
        }
    }
}

/// The sent bytes, and the line's changes to them.
#[derive(Clone, Debug)]
pub struct Original {
    /// End of the last byte on the wire.
    pub at: Instant,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// The damage, byte by byte.
    pub strikes: Vec<Strike>,
    /// The active faults of the line, as text.
    pub effects: Vec<&'static str>,
    /// The rates of sender and receiver, if they differ.
    pub bauds: Option<[u32; 2]>,
}

impl Original {
    /// Whether `arrived` equals the sent bytes, apart from delay.
    pub fn is_only_late(&self, arrived: &[u8]) -> bool {
        self.strikes.is_empty()
            && self.effects.is_empty()
            && self.bauds.is_none()
            && self.bytes == arrived
    }
}
