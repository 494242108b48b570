//! What a client sent while rig time stood: it goes on its way over as long a time as it was sent
//! in. All at once it would reach a device at the line's full rate, faster than any client sends,
//! and overflow buffers that hold what comes at its usual rate. Byte by byte, a request would come
//! apart, and a device that waits for the rest of a frame for some milliseconds would give it up:
//! so it goes in bursts, a short one at once.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::Instant;

/// Bytes that stay together: more than the longest request of a small bus.
const BURST: u128 = 64;

/// See the module's documentation.
#[derive(Debug, Default)]
pub(super) struct Spread {
    bytes: VecDeque<u8>,
    /// Bytes when the last began, when that was, and how long they take.
    total: usize,
    from: Instant,
    over: Duration,
}

impl Spread {
    /// `bytes` were sent while rig time stood at `from`, for as long as `over`; what is left of an
    /// earlier time goes with them.
    pub(super) fn begin(&mut self, bytes: &[u8], from: Instant, over: Duration) {
        self.bytes.extend(bytes);
        (self.total, self.from, self.over) = (self.bytes.len(), from, over);
    }

    /// Whether nothing is left.
    pub(super) fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Takes what is due at `now`.
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

    /// Takes all that is left.
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
        // Late once more: what is left goes with what came.
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
