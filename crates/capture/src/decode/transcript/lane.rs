//! The bytes of one direction until they are reported.

use protocols::Instant;

use super::super::pause::Pauses;
use super::{CHUNK_MAX, Lane};
use engine::codec::{self, Codec};

impl Lane {
    /// Protocol of the first `len` unreported bytes. The bytes reported before without a protocol
    /// are included, so that repeated tries need as much evidence as one try with many bytes.
    pub(super) fn best(&mut self, len: usize) -> Option<(&'static Codec, u64)> {
        let untold = &self.untold.make_contiguous()[..len];
        if let Some(expected) = self.expected
            && let framed = expected.framed_towards(untold, self.direction)
            && framed > 0
        {
            return Some((expected, framed));
        }
        if self.unknown.is_empty() {
            return codec::best(untold);
        }
        let mut all: Vec<u8> = self.unknown.iter().copied().collect();
        all.extend(untold);
        let (codec, _) = codec::best(&all)?;
        let framed = codec.framed_towards(untold, self.direction);
        (framed > 0).then_some((codec, framed))
    }

    /// Lengths of the chunks in which the first `len` unreported bytes came.
    pub(super) fn chunks(&mut self, len: usize) -> Vec<usize> {
        let mut ends = Vec::new();
        let mut last: Option<(usize, Instant)> = None;
        for &(end, at) in &self.times {
            let end = usize::try_from(end.saturating_sub(self.told)).unwrap_or(usize::MAX);
            let end = end.min(len);
            if let Some((before, was)) = last {
                // At an unknown rate, the start of a chunk equals its end.
                let begins = match self.rate.baud {
                    1 => at,
                    _ => self.rate.byte_end(at, (end - before) as u64),
                };
                let is_turn = self.turns.contains(&(self.told + before as u64));
                if is_turn || (begins > was && begins - was > self.silence) {
                    ends.push(before);
                }
            }
            last = Some((end, at));
            if end == len {
                break;
            }
        }
        ends.push(len);
        let end = self.told + len as u64;
        self.turns.retain(|&turn| turn > end);
        let (mut chunks, mut start) = (Vec::new(), 0);
        for end in ends {
            while end > start {
                let chunk = (end - start).min(CHUNK_MAX);
                chunks.push(chunk);
                start += chunk;
            }
        }
        chunks
    }

    /// Whether the pause before `len` bytes that are complete at `now` discards a partial frame.
    pub(super) fn is_over(&self, now: Instant, len: usize) -> bool {
        let limit = self.pauses.limit(self.codec, self.is_turned);
        let pause = |&(_, last): &(u64, Instant)| Pauses::between(last, now, len, self.rate);
        self.times.back().is_some_and(|last| pause(last) > limit)
    }

    /// Number of bytes so far.
    pub(super) fn end(&self) -> u64 {
        self.told + self.untold.len() as u64
    }

    /// Time of the first unreported byte: no later entry of this lane is earlier.
    pub(super) fn first_untold(&self) -> Option<Instant> {
        let untold = self.times.iter().find(|&&(end, _)| end > self.told);
        untold.map(|&(_, at)| at)
    }

    /// Removes the first `len` unreported bytes, with the time of the last of them.
    pub(super) fn take(&mut self, len: usize) -> (Instant, Vec<u8>) {
        let bytes: Vec<u8> = self.untold.drain(..len.min(self.untold.len())).collect();
        self.told += bytes.len() as u64;
        while self.times.len() > 1 && self.times[0].0 < self.told {
            self.times.pop_front();
        }
        let at = self.times.front().map_or(Instant::ZERO, |&(_, at)| at);
        (at, bytes)
    }
}
