//! What a master asks of the base: what the receiver finds, the ticks price and the main loop
//! answers.

use protocols::Instant;

/// What a request wants, as the top bit of its count says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RequestKind {
    Read,
    Write,
}

/// A complete frame, also one with a wrong checksum: the base answers both.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Request {
    /// When its last byte ended.
    pub(super) at: Instant,
    /// All bytes, from the start byte to the checksum.
    pub(super) bytes: Vec<u8>,
    /// Whether the checksum holds.
    pub(super) valid: bool,
}

impl Request {
    pub(super) fn register(&self) -> u8 {
        self.bytes[1]
    }

    pub(super) fn kind(&self) -> RequestKind {
        if self.bytes[2] & 0x80 == 0 {
            RequestKind::Read
        } else {
            RequestKind::Write
        }
    }

    pub(super) fn count(&self) -> u8 {
        self.bytes[2] & 0x7F
    }

    /// The data of a write.
    pub(super) fn data(&self) -> &[u8] {
        &self.bytes[3..self.bytes.len() - 2]
    }

    /// Bytes of the reply that the base will give.
    pub(super) fn reply_len(&self) -> u32 {
        match self.kind() {
            RequestKind::Read if self.valid => 5 + u32::from(self.count()),
            _ => 5,
        }
    }
}
