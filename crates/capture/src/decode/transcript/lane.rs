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

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use super::super::Transcript;
    use super::*;
    use crate::{Interface, Kind, Record};
    use engine::rig::line::Direction;
    use protocols::avr::{ChecksumOrder, Frame};

    /// A lane without a protocol at 10,000 baud, where a byte takes a millisecond and three of them
    /// are a silence. 100 bytes were reported; chunks of these bytes end at these milliseconds.
    fn lane(chunks: &[(u64, &[u8])]) -> Lane {
        let record = Record {
            link: 0,
            sequence: None,
            at: Instant::ZERO,
            direction: Direction::ToMaster,
            kind: Kind::Data,
            bytes: Vec::new().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        let mut transcript = Transcript::new(None);
        transcript.record(&record, &Interface::new("x", 10_000));
        let mut lane = transcript.lanes.remove(0);
        lane.told = 100;
        lane.times.clear();
        for (at, bytes) in chunks {
            lane.untold.extend(*bytes);
            let end = lane.end();
            lane.times.push_back((end, Instant::from_millis(*at)));
        }
        lane
    }

    /// A chunk that begins more than 3 ms behind the end of the chunk before it is a message of its
    /// own.
    #[test]
    fn a_longer_silence_divides_the_bytes() {
        let chunks = |times: [u64; 3]| {
            let [first, second, third] = times;
            lane(&[(first, b"ab"), (second, b"cd"), (third, b"efg")]).chunks(7)
        };
        assert_eq!(chunks([10, 15, 21]), [7]);
        assert_eq!(chunks([10, 16, 22]), [2, 5]);
        assert_eq!(chunks([10, 15, 22]), [4, 3]);
        assert_eq!(chunks([10, 16, 23]), [2, 2, 3]);
        // Chunks that a log shows at the same time overlap.
        assert_eq!(chunks([10, 10, 10]), [7]);
        // Only the first bytes count, also within a chunk.
        let mut part = lane(&[(10, b"ab"), (16, b"cd"), (30, b"efg")]);
        assert_eq!((part.chunks(2), part.chunks(3)), (vec![2], vec![2, 1]));
        assert_eq!(
            (part.chunks(4), part.chunks(5)),
            (vec![2, 2], vec![2, 2, 1])
        );
    }

    /// The other direction has sent before the byte 102, and before later ones. Those before the
    /// end of the reported bytes, and at it, are forgotten.
    #[test]
    fn bytes_of_the_other_direction_divide_the_bytes() {
        let mut lane = lane(&[(10, b"ab"), (12, b"cd"), (14, b"ef")]);
        lane.turns = [102, 104, 105, 200].into();
        assert_eq!(lane.chunks(4), [2, 2]);
        assert_eq!(lane.turns, [105, 200]);
        lane.turns = [103, 98].into();
        assert_eq!(lane.chunks(4), [4]);
    }

    #[test]
    fn a_long_message_is_reported_in_parts() {
        let bytes = vec![7; 600];
        assert_eq!(lane(&[(10, &bytes)]).chunks(600), [256, 256, 88]);
        assert_eq!(lane(&[(10, &bytes[..256])]).chunks(256), [256]);
        assert_eq!(lane(&[(10, &bytes[..257])]).chunks(257), [256, 1]);
        let mut apart = lane(&[(10, &bytes[..257]), (2_000, &bytes[..300])]);
        assert_eq!(apart.chunks(557), [256, 1, 256, 44]);
    }

    /// The time is that of the chunk in which the last taken byte came.
    #[test]
    fn taken_bytes_have_the_time_of_their_chunk() {
        let mut lane = lane(&[(10, b"ab"), (16, b"cd"), (30, b"e")]);
        let at = |millis| Some(Instant::from_millis(millis));
        assert_eq!((lane.end(), lane.first_untold()), (105, at(10)));
        let mut take = |len| {
            let (at, bytes) = lane.take(len);
            (at.as_millis(), bytes, lane.told, lane.first_untold())
        };
        assert_eq!(take(1), (10, b"a".to_vec(), 101, at(10)));
        assert_eq!(take(1), (10, b"b".to_vec(), 102, at(16)));
        assert_eq!(take(1), (16, b"c".to_vec(), 103, at(16)));
        assert_eq!(take(2), (30, b"de".to_vec(), 105, None));
        assert_eq!(take(2), (30, Vec::new(), 105, None));
        assert_eq!(lane.end(), 105);
    }

    /// Without a protocol, a pause of more than the idle time discards a partial frame. Two bytes
    /// take 2 ms of the time before them.
    #[test]
    fn a_pause_is_over_after_the_idle_time() {
        let lane = lane(&[(10, b"ab")]);
        let after = |time: Duration| Instant::from_millis(10) + time;
        let idle = codec::IDLE;
        let (two_bytes, moment) = (Duration::from_millis(2), Duration::from_nanos(1));
        assert!(!lane.is_over(after(idle + two_bytes), 2));
        assert!(lane.is_over(after(idle + two_bytes + moment), 2));
        assert!(lane.is_over(after(idle + two_bytes), 1) && !lane.is_over(after(idle), 0));
    }

    /// Bytes that were reported without a protocol are evidence for one, and only frames of the
    /// next bytes count.
    #[test]
    fn earlier_bytes_are_evidence_for_a_protocol() {
        let frame = Frame::read(36, 10, ChecksumOrder::LowFirst);
        let frame = frame.as_bytes();
        let framed = |unknown: &[u8], untold: &[u8], len: usize| {
            let mut lane = lane(&[(10, untold)]);
            lane.unknown = unknown.iter().copied().collect();
            lane.best(len).map(|(_, framed)| framed)
        };
        let frames = frame.repeat(4);
        assert_eq!(framed(&[], &frames, 20), Some(20));
        assert_eq!(framed(&frames, &frames, 10), Some(10));
        assert_eq!(framed(&frames, &[2; 20], 20), None);
        let late = [&[2; 10], frame].concat();
        assert_eq!(
            (framed(&frames, &late, 10), framed(&frames, &late, 15)),
            (None, Some(5))
        );
    }
}
