//! Bytes of the other direction of a link: requests, which can give replies names.

use std::collections::VecDeque;

use engine::codec::Stream;

/// Number of bytes that are kept for a direction whose first bytes follow: more than a request has.
const RECENT_MAX: usize = 512;
/// Number of chunks that are kept until the protocol of a direction is known.
const WAITING_MAX: usize = 1_024;

/// Bytes that one direction of a link stores: its own for the other direction, and chunks of the
/// other one.
#[derive(Default)]
pub(super) struct Beside {
    /// The last bytes of this direction.
    recent: VecDeque<u8>,
    /// Chunks of the other direction, with the number of bytes of this one before them.
    waiting: VecDeque<(u64, Vec<u8>)>,
}

impl Beside {
    /// The state of a direction that begins after bytes of the `other` one.
    pub(super) fn after(other: Option<&Self>, stream: Option<&mut Stream>) -> Self {
        let mut own = Self::default();
        if let Some(other) = other {
            let bytes: Vec<u8> = other.recent.iter().copied().collect();
            own.hear(0, &bytes, stream);
        }
        own
    }

    /// Takes bytes of this direction.
    pub(super) fn send(&mut self, bytes: &[u8]) {
        self.recent.extend(bytes);
        let surplus = self.recent.len().saturating_sub(RECENT_MAX);
        self.recent.drain(..surplus);
    }

    /// Takes bytes of the other direction, which pass after `place` bytes of this one.
    pub(super) fn hear(&mut self, place: u64, bytes: &[u8], stream: Option<&mut Stream>) {
        if let Some(stream) = stream {
            return stream.beside(bytes);
        }
        if self.waiting.len() == WAITING_MAX {
            self.waiting.pop_front();
        }
        self.waiting.push_back((place, bytes.to_vec()));
    }

    /// Gives the chunks that passed before the byte at `place` to a stream.
    pub(super) fn give(&mut self, place: u64, stream: &mut Stream) {
        while let Some((_, bytes)) = self.waiting.pop_front_if(|(at, _)| *at <= place) {
            stream.beside(&bytes);
        }
    }
}
