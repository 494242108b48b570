//! Counts in a stream as evidence for or against damage.

use std::collections::BTreeSet;

use super::Damage;
use engine::codec::{self, Codec, OtherOrder};

/// Count of each value.
pub(super) struct Counts([u64; 256]);

impl Counts {
    pub(super) fn of(bytes: &[u8]) -> Self {
        let mut counts = [0; 256];
        bytes
            .iter()
            .for_each(|&byte| counts[usize::from(byte)] += 1);
        Self(counts)
    }

    pub(super) fn len(&self) -> u64 {
        self.0.iter().sum()
    }

    pub(super) const fn of_value(&self, value: u8) -> u64 {
        self.0[value as usize]
    }

    /// Number of bytes with bit 7 set.
    pub(super) fn high(&self) -> u64 {
        self.0[0x80..].iter().sum()
    }

    /// Whether nearly all bytes are text, which may lack any value.
    pub(super) fn is_text(&self) -> bool {
        let controls: u64 = [b'\t', b'\n', b'\r']
            .map(|byte| self.of_value(byte))
            .iter()
            .sum();
        let printable: u64 = self.0[0x20..0x7F].iter().sum();
        (printable + controls) * 20 >= self.len() * 19
    }

    /// Mean count of the values on both sides of `a` and `b`.
    pub(super) fn around(&self, a: u8, b: u8) -> u64 {
        let sides = [a - 1, a + 1, b - 1, b + 1].map(|value| self.of_value(value));
        sides.iter().sum::<u64>() / 4
    }
}

/// Number of different values in `bytes`: a stream of one value is no evidence.
fn variety(bytes: &[u8]) -> usize {
    bytes.iter().collect::<BTreeSet<_>>().len()
}

pub(super) fn doubled(bytes: &[u8]) -> Option<Damage> {
    (0..2).find_map(|start| {
        let (pairs, _) = bytes.get(start..)?.as_chunks::<2>();
        let equal = pairs.iter().filter(|[a, b]| a == b).count() as u64;
        let pairs = pairs.len() as u64;
        let is = variety(bytes) >= 4 && equal * 100 >= pairs * 95;
        is.then_some(Damage::Doubled { equal, pairs })
    })
}

/// Detects swapped pairs: whether the stream becomes valid when the bytes of each pair are swapped.
/// `framed` bytes are in valid frames without the swap.
pub(super) fn swapped(bytes: &[u8], framed: u64) -> Option<Damage> {
    let len = bytes.len() as u64;
    (0..2).find_map(|start| {
        let mut right = bytes.to_vec();
        let (pairs, _) = right.get_mut(start..)?.as_chunks_mut::<2>();
        pairs.iter_mut().for_each(|pair| pair.swap(0, 1));
        let (_, better) = codec::best(&right)?;
        let is = better * 10 >= len * 8 && framed * 10 <= len * 2;
        is.then_some(Damage::Swapped {
            framed: better,
            bytes: len,
        })
    })
}

/// Detects a swapped checksum. A protocol that exists in both orders is diagnosed only if one of
/// them is expected.
pub(super) fn other_order(bytes: &[u8], expected: Option<&Codec>) -> Option<Damage> {
    let candidate = |codec: &Codec| match codec.other_order()? {
        OtherOrder::Wrong(count) => Some(count(bytes)),
        OtherOrder::Row(other) if expected == Some(codec) => {
            Some([other, codec].map(|row| row.frames(bytes).len() as u64))
        }
        OtherOrder::Row(_) => None,
    };
    let [other, expected] = match expected {
        Some(codec) => candidate(codec),
        None => codec::all().into_iter().filter_map(candidate).max(),
    }?;
    let is = other >= 8 && other > expected * 10;
    is.then_some(Damage::ChecksumOrder { other, expected })
}

/// Detects an echo: whether the sent frames are also among the received ones, in the same order.
/// Some replies equal their requests, so nearly all frames must come back, and more than a few.
pub(super) fn echoed(bytes: &[u8], opposite: &[u8]) -> Option<Damage> {
    let opposite = &opposite[..opposite.len().min(bytes.len())];
    let codec = codec::guess(opposite)?;
    let frames = |bytes: &[u8]| -> Vec<Vec<u8>> {
        let place = |at: u64| usize::try_from(at).expect("within a slice");
        let frames = codec.frames(bytes).into_iter();
        frames
            .map(|one| bytes[place(one.start)..place(one.end)].to_vec())
            .collect()
    };
    let (sent, received) = (frames(opposite), frames(bytes));
    let (mut back, mut at) = (0_u64, 0);
    for frame in &sent {
        let behind = received.get(at..).unwrap_or_default();
        if let Some(offset) = behind.iter().take(16).position(|one| one == frame) {
            at += offset + 1;
            back += 1;
        }
    }
    let sent = sent.len() as u64;
    (back >= 8 && back * 10 >= sent * 9).then_some(Damage::Echo { back, sent })
}

/// Detects a slower sender: whether the equal-bit runs of nearly every byte, with start and stop
/// bit, are multiples of one factor.
pub(super) fn slow_sender(bytes: &[u8]) -> Option<Damage> {
    if variety(bytes) < 2 {
        return None;
    }
    let len = bytes.len() as u64;
    [8, 6, 4, 3, 2].into_iter().find_map(|factor| {
        let stretched = bytes.iter().filter(|&&byte| is_stretched(byte, factor));
        let stretched = stretched.count() as u64;
        let is = stretched * 100 >= len * 95;
        is.then_some(Damage::SlowSender {
            factor,
            stretched,
            bytes: len,
        })
    })
}

/// Whether all runs of equal bits that start and end inside the character are multiples of `factor`
/// long. The last run continues after the stop bit.
fn is_stretched(byte: u8, factor: u32) -> bool {
    // Start bit, data from the lowest bit, stop bit.
    let bits = u16::from(byte) << 1 | 0x200;
    let (mut run, mut level) = (0, 0);
    for at in 0..10 {
        let bit = bits >> at & 1;
        if bit != level {
            if run % factor != 0 {
                return false;
            }
            (run, level) = (0, bit);
        }
        run += 1;
    }
    true
}
