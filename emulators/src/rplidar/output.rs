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
    loss: Spared,
    /// Bytes of a burst that are still to be lost.
    burst: u64,
    /// Random numbers for the damage in a packet: its position and kind.
    garbage: Spared,
    /// The last node or capsule.
    last: Vec<u8>,
}

impl Output {
    pub(super) const fn new(loss: Rng, garbage: Rng) -> Self {
        Self {
            queue: VecDeque::new(),
            dropped: 0,
            loss: Spared::new(loss),
            burst: 0,
            garbage: Spared::new(garbage),
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
        let mut damage = None;
        if faults.has(Fault::Garbage) {
            let random = self.garbage.rng();
            let damaged = random.below(packet.len().max(1) as u64);
            let flip = u8::try_from(1 + random.below(255)).expect("1 to 255");
            damage = Some((damaged, flip));
        } else {
            self.garbage.skip(2);
        }
        if self.queue.len() + packet.len() > UNTAKEN_MAX {
            self.dropped += 1;
            return;
        }
        let loss = faults.figure(Fault::ByteLoss);
        if damage.is_none() && loss.is_none() && self.burst == 0 {
            self.loss.skip(packet.len() as u64);
            self.queue.extend(packet);
            return;
        }
        let share = loss.map_or(0.0, |one_in| 1.0 / one_in.max(1.0));
        let lost = self.loss.rng();
        for (index, &byte) in (0..).zip(packet) {
            let flip = damage.filter(|(damaged, _)| index == *damaged);
            let byte = flip.map_or(byte, |(_, flip)| byte ^ flip);
            if lost.chance(share) {
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

/// A stream whose unused draws are postponed: each packet draws, but few need the numbers.
#[derive(Clone, Debug)]
struct Spared {
    rng: Rng,
    postponed: u64,
}

impl Spared {
    const fn new(rng: Rng) -> Self {
        Self { rng, postponed: 0 }
    }

    /// Draws `draws` numbers that are not needed.
    const fn skip(&mut self, draws: u64) {
        self.postponed += draws;
    }

    /// The stream after all draws so far.
    fn rng(&mut self) -> &mut Rng {
        for _ in 0..core::mem::take(&mut self.postponed) {
            self.rng.next_u64();
        }
        &mut self.rng
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::{any, prop_assert_eq, proptest};

    use super::*;

    fn output() -> Output {
        Output::new(Rng::stream(1, "loss"), Rng::stream(1, "garbage"))
    }

    /// The plain form: each packet draws all of its numbers at once.
    fn plain(
        rngs: &mut [Rng; 2],
        packet: &[u8],
        (one_in, garbage): (Option<f64>, bool),
    ) -> Vec<u8> {
        let [loss, random] = rngs;
        let damaged = random.below(packet.len() as u64);
        let flip = u8::try_from(1 + random.below(255)).unwrap();
        let share = one_in.map_or(0.0, |one_in| 1.0 / one_in.max(1.0));
        let bytes = (0..).zip(packet).map(|(index, &byte)| {
            let byte = if index == damaged && garbage {
                byte ^ flip
            } else {
                byte
            };
            (!loss.chance(share)).then_some(byte)
        });
        bytes.flatten().collect()
    }

    proptest! {
        /// Faults begin and end between packets; the postponed draws change no byte.
        #[test]
        fn postponed_draws_change_no_byte(
            packets in proptest::collection::vec((1_usize..9, any::<bool>(), any::<bool>()), 1..60),
        ) {
            let (mut output, mut faults) = (output(), Faults::default());
            let mut rngs = ["loss", "garbage"].map(|name| Rng::stream(1, name));
            for (len, loses, garbage) in packets {
                faults.clear(Fault::ByteLoss);
                faults.clear(Fault::Garbage);
                if loses {
                    faults.set(Fault::ByteLoss, Some(3.0));
                }
                if garbage {
                    faults.set(Fault::Garbage, None);
                }
                let packet = [7, 6, 5, 4, 3, 2, 1, 0][..len].to_vec();
                output.send(&packet, &mut faults);
                let mut sent = [0; 16];
                let count = output.transmit(&mut sent);
                let expected = plain(&mut rngs, &packet, (loses.then_some(3.0), garbage));
                prop_assert_eq!(&sent[..count], &expected[..]);
            }
        }
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
