//! A master's request: the receiver finds it, the ticks set its duration and the main loop answers
//! it.

use protocols::Instant;

/// Kind of a request, from the top bit of its count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RequestKind {
    Read,
    Write,
}

/// A complete frame, also one with a wrong checksum: the base answers both.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Request {
    /// End of its last byte.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn request(bytes: &[u8], valid: bool) -> Request {
        Request {
            at: Instant::ZERO,
            bytes: bytes.to_vec(),
            valid,
        }
    }

    /// Start, register, count and two bytes of checksum are 5; a reply to a read has its data.
    #[test]
    fn a_request_says_how_long_its_reply_is() {
        let read = request(&[0xAB, 36, 10, 0, 0], true);
        assert_eq!(
            (read.kind(), read.register(), read.count()),
            (RequestKind::Read, 36, 10)
        );
        assert_eq!((read.reply_len(), read.data()), (15, &[][..]));
        let write = request(&[0xAB, 45, 0x82, 7, 8, 0, 0], true);
        assert_eq!((write.kind(), write.count()), (RequestKind::Write, 2));
        assert_eq!((write.reply_len(), write.data()), (5, &[7, 8][..]));
        let refused = request(&[0xAB, 36, 10, 0, 0], false);
        assert_eq!(refused.reply_len(), 5);
    }
}
