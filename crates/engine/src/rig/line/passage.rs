//! What goes into a line in one go, and what comes out.

use protocols::{Instant, LineEvent};

use crate::rig::fault::Strike;

/// Largest piece.
pub const PIECE_MAX: usize = 64;

/// What a receiver gets in one go.
#[derive(Clone, Debug)]
pub struct Delivery {
    /// When the last byte was complete.
    pub at: Instant,
    /// The bytes, faults applied; may be empty.
    pub bytes: Vec<u8>,
    /// What happened besides.
    pub event: Option<LineEvent>,
    /// Characters without a valid stop bit among what was sent.
    pub framing_errors: u32,
    /// What was sent, if the line changed or delayed it.
    pub original: Option<Box<Original>>,
}

/// Bytes as they left the sender, and what the line did to them.
#[derive(Clone, Debug)]
pub struct Original {
    /// When the last of them ended on the wire.
    pub at: Instant,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// The damage, byte by byte.
    pub strikes: Vec<Strike>,
    /// What was at work on the line, in words.
    pub effects: Vec<&'static str>,
    /// The rates of sender and receiver, if those do not agree.
    pub bauds: Option<[u32; 2]>,
}

impl Original {
    /// Whether `arrived` are the bytes as sent, which nothing but time befell.
    pub fn is_only_late(&self, arrived: &[u8]) -> bool {
        self.strikes.is_empty()
            && self.effects.is_empty()
            && self.bauds.is_none()
            && self.bytes == arrived
    }
}
