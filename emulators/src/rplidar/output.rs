//! The transmitter: packets go to the line as they are, unless a fault damages them.

use std::collections::VecDeque;

use super::Fault;
use super::fault::Faults;
use crate::device::take;
use crate::rng::Rng;

/// Bytes handed out but not taken by the line. The line takes them as fast as they are sent, so
/// more than this means that nothing is connected.
const UNTAKEN_MAX: usize = 4_096;

/// Transmitter state.
#[derive(Clone, Debug)]
pub(super) struct Output {
    queue: VecDeque<u8>,
    dropped: u64,
    /// Selection of lost bytes.
    loss: Rng,
    /// Bytes of a burst that are still to be lost.
    burst: u64,
    /// Random numbers for the damage in a packet: its position and kind.
    garbage: Rng,
    /// The last node or capsule.
    last: Vec<u8>,
}

impl Output {
    pub(super) const fn new(loss: Rng, garbage: Rng) -> Self {
        Self {
            queue: VecDeque::new(),
            dropped: 0,
            loss,
            burst: 0,
            garbage,
            last: Vec::new(),
        }
    }

    /// Sends a packet of a stream.
    pub(super) fn stream(&mut self, packet: &[u8], faults: &mut Faults) {
        self.last.clear();
        self.last.extend(packet);
        self.send(packet, faults);
    }

    /// Sends a packet, or drops it as a whole if the line takes none.
    pub(super) fn send(&mut self, packet: &[u8], faults: &mut Faults) {
        if let Some(bytes) = faults.take(Fault::Burst) {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a cast of a float saturates"
            )]
            let bytes = bytes as u64;
            self.burst = bytes;
        }
        let damaged = self.garbage.below(packet.len().max(1) as u64);
        let flip = u8::try_from(1 + self.garbage.below(255)).expect("1 to 255");
        if self.queue.len() + packet.len() > UNTAKEN_MAX {
            self.dropped += 1;
            return;
        }
        let loss = faults.figure(Fault::ByteLoss);
        let share = loss.map_or(0.0, |one_in| 1.0 / one_in.max(1.0));
        for (index, &byte) in (0..).zip(packet) {
            let is_damaged = index == damaged && faults.has(Fault::Garbage);
            let byte = if is_damaged { byte ^ flip } else { byte };
            if self.loss.chance(share) {
                continue;
            }
            if self.burst > 0 {
                self.burst -= 1;
                continue;
            }
            self.queue.push_back(byte);
        }
    }

    /// Ends a burst; its remaining bytes arrive.
    pub(super) const fn end_burst(&mut self) {
        self.burst = 0;
    }

    /// The last packet of a stream.
    pub(super) fn last(&self) -> &[u8] {
        &self.last
    }

    /// Whether bytes wait for the line.
    pub(super) fn has_bytes(&self) -> bool {
        !self.queue.is_empty()
    }

    pub(super) fn transmit(&mut self, buf: &mut [u8]) -> usize {
        take(&mut self.queue, buf)
    }

    /// Discards bytes that are not yet taken.
    pub(super) fn clear(&mut self) {
        self.queue.clear();
    }

    pub(super) const fn dropped(&self) -> u64 {
        self.dropped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn output() -> Output {
        Output::new(Rng::stream(1, "loss"), Rng::stream(1, "garbage"))
    }

    /// 4096 bytes wait for a line that takes none; a packet that does not fit whole is dropped.
    #[test]
    fn what_does_not_fit_whole_is_dropped() {
        let (mut output, mut faults) = (output(), Faults::default());
        assert!(!output.has_bytes());
        output.send(&[1; UNTAKEN_MAX - 5], &mut faults);
        output.send(&[2; 6], &mut faults);
        assert_eq!((output.dropped(), output.queue.len()), (1, UNTAKEN_MAX - 5));
        output.stream(&[3; 5], &mut faults);
        assert_eq!((output.dropped(), output.queue.len()), (1, UNTAKEN_MAX));
        output.send(&[4], &mut faults);
        assert_eq!((output.dropped(), output.last()), (2, &[3; 5][..]));
        let mut buf = [0; UNTAKEN_MAX];
        assert!(output.has_bytes() && output.transmit(&mut buf) == UNTAKEN_MAX);
        assert!(buf[UNTAKEN_MAX - 5..] == [3; 5] && !output.has_bytes());
        output.send(&[5], &mut faults);
        output.clear();
        assert!(!output.has_bytes());
    }
}
