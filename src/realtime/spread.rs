//! What a client sent while rig time stood: it goes on its way over as long a time as it was sent
//! in. All at once it would reach a device at the line's full rate, faster than any client sends,
//! and overflow buffers that hold what comes at its usual rate.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::Instant;

/// See the module.
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
        let left = if since >= over {
            0
        } else {
            // At least one part in `over` is left, so this is at most `total`.
            usize::try_from(self.total as u128 * (over - since) / over).unwrap_or(self.total)
        };
        let due = self.bytes.len().saturating_sub(left);
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
        spread.begin(&[1, 2, 3, 4], at(10), Duration::from_millis(8));
        assert!(spread.due(at(10)).is_empty());
        assert_eq!(spread.due(at(12)), [1]);
        // Late once more: what is left goes with what came.
        spread.begin(&[5], at(13), Duration::from_millis(4));
        assert_eq!(spread.due(at(15)), [2, 3]);
        assert_eq!(spread.due(at(99)), [4, 5]);
        assert!(spread.is_empty());
    }
}
