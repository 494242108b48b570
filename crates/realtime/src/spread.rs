//! Bytes that a client sent while rig time stood. They are sent over the time in which the client
//! sent them: all at once they would reach a device at the line's full rate, faster than any client
//! sends, and overflow its buffers. They are sent in bursts: byte by byte a request would be split,
//! and a device that waits some milliseconds for the rest of a frame would discard it. A short
//! burst is sent at once.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::Instant;

/// Size of a burst, bytes: more than the longest request of a small bus.
const BURST: u128 = 64;

/// Bytes that are sent over a time, see the module's documentation.
#[derive(Debug, Default)]
pub(super) struct Spread {
    bytes: VecDeque<u8>,
    /// Number of bytes at the last begin, its time, and the duration of the sending.
    total: usize,
    from: Instant,
    over: Duration,
}

impl Spread {
    /// Adds `bytes`, which were sent within `over` while rig time stood at `from`. Bytes that are
    /// left from an earlier stop are sent with them.
    pub(super) fn begin(&mut self, bytes: &[u8], from: Instant, over: Duration) {
        self.bytes.extend(bytes);
        (self.total, self.from, self.over) = (self.bytes.len(), from, over);
    }

    /// Whether no bytes are left.
    pub(super) fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Takes the bytes that are due at `now`.
    pub(super) fn due(&mut self, now: Instant) -> Vec<u8> {
        let (since, over) = ((now - self.from).as_nanos(), self.over.as_nanos());
        let sent = self.total - self.bytes.len();
        let due = if since >= over {
            self.bytes.len()
        } else {
            let bursts = self.total as u128 * since / over / BURST + 1;
            let due = usize::try_from(bursts * BURST).unwrap_or(self.total);
            due.saturating_sub(sent).min(self.bytes.len())
        };
        self.bytes.drain(..due).collect()
    }

    /// Takes all bytes that are left.
    pub(super) fn rest(&mut self) -> Vec<u8> {
        self.bytes.drain(..).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_go_over_the_time_in_which_they_came() {
        let mut spread = Spread::default();
        assert!(spread.due(Instant::from_secs(9)).is_empty());
        let at = Instant::from_millis;
        spread.begin(&[7; 256], at(10), Duration::from_millis(8));
        assert_eq!(spread.due(at(10)).len(), 64);
        assert_eq!(spread.due(at(11)).len(), 0);
        assert_eq!(spread.due(at(12)).len(), 64);
        // A second stop: the bytes that are left are sent with the new ones.
        spread.begin(&[5; 64], at(13), Duration::from_millis(4));
        assert_eq!(spread.due(at(13)).len(), 64);
        assert_eq!(spread.due(at(99)), [[7; 64], [5; 64]].concat());
        assert!(spread.is_empty());
    }

    /// A request of five bytes, sent while the rig stood for 135 ms, stays whole.
    #[test]
    fn a_short_request_does_not_come_apart() {
        let mut spread = Spread::default();
        let at = Instant::from_millis(10);
        spread.begin(&[1, 2, 3, 4, 5], at, Duration::from_millis(135));
        assert_eq!(spread.due(at), [1, 2, 3, 4, 5]);
    }
}
