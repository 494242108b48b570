//! Recently received bytes and their frames, for the frame inspector.

use std::collections::VecDeque;

use protocols::Instant;
use serde::Serialize;

use engine::codec::{Codec, Stream, Stretch, What, words};
use engine::hex::digits;
use engine::rig::line::Direction;

/// Maximum number of stored bytes per direction of a link: some six minutes of a lidar.
const BYTES_MAX: usize = 4 << 20;
/// Maximum number of stored chunks per direction.
const PIECES_MAX: usize = 1 << 19;
/// Number of bytes searched for frames: per lane if all lanes are requested, and for a single lane.
const LOOK_BACK: [usize; 2] = [6_000, 40_000];
/// Maximum number of frames in one answer.
const FRAMES_MAX: usize = 400;

/// All recently received bytes.
#[derive(Debug, Default)]
pub(super) struct WireLog {
    lanes: Vec<LoggedLane>,
}

/// One direction of a link.
#[derive(Clone, Debug)]
struct LoggedLane {
    link: String,
    way: Direction,
    codec: Option<&'static Codec>,
    bytes: VecDeque<u8>,
    /// Offset behind the last byte, counted from the first byte ever received.
    end: u64,
    pieces: VecDeque<Piece>,
    is_hit: bool,
}

/// A chunk.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// Offset behind its last byte.
    end: u64,
    /// Time of its last byte.
    at: Instant,
    /// Whether a fault hit the chunk, or lost the chunk before it.
    is_hit: bool,
}

/// A frame, or bytes outside frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Frame {
    /// Time of the last byte, nanoseconds.
    at_ns: u64,
    link: String,
    way: &'static str,
    /// The frame in words; for invalid bytes, the reason.
    words: String,
    /// Bytes as hexadecimal digits.
    bytes: String,
    is_bad: bool,
    is_hit: bool,
}

impl WireLog {
    /// Clears the log; `lanes` are link, direction and format of each lane.
    pub(super) fn begin<'a>(
        &mut self,
        lanes: impl Iterator<Item = (&'a str, Direction, Option<&'static Codec>)>,
    ) {
        let lane = |(link, way, codec): (&str, _, _)| LoggedLane {
            link: link.to_owned(),
            way,
            codec,
            bytes: VecDeque::new(),
            end: 0,
            pieces: VecDeque::new(),
            is_hit: false,
        };
        self.lanes = lanes.map(lane).collect();
    }

    /// Marks the next bytes of a lane as hit.
    pub(super) fn hit(&mut self, lane: usize) {
        if let Some(lane) = self.lanes.get_mut(lane) {
            lane.is_hit = true;
        }
    }

    /// Adds bytes that arrived at `at`.
    pub(super) fn push(&mut self, lane: usize, at: Instant, bytes: &[u8]) {
        let Some(lane) = self.lanes.get_mut(lane).filter(|_| !bytes.is_empty()) else {
            return;
        };
        lane.end += bytes.len() as u64;
        lane.bytes.extend(bytes);
        lane.pieces.push_back(Piece {
            end: lane.end,
            at,
            is_hit: core::mem::take(&mut lane.is_hit),
        });
        while lane.bytes.len() > BYTES_MAX || lane.pieces.len() > PIECES_MAX {
            let first = lane.end - lane.bytes.len() as u64;
            let gone = lane.pieces.pop_front().map_or(first, |piece| piece.end);
            drop(lane.bytes.drain(..as_index(gone - first)));
        }
    }

    /// Removes bytes after `until`: the run branches there.
    pub(super) fn cut(&mut self, until: Instant) {
        for lane in &mut self.lanes {
            let kept = lane.pieces.partition_point(|piece| piece.at <= until);
            let first = lane.end - lane.bytes.len() as u64;
            let end = kept
                .checked_sub(1)
                .map_or(first, |last| lane.pieces[last].end);
            lane.pieces.truncate(kept);
            lane.bytes.truncate(as_index(end - first));
            lane.end = end;
            lane.is_hit = false;
        }
    }

    /// The last bytes of a lane, to synchronise a decoder.
    pub(super) fn last_bytes(&self, lane: usize, most: usize) -> Vec<u8> {
        let bytes = self.lanes.get(lane).map(|lane| &lane.bytes);
        let skipped = bytes.map_or(0, |bytes| bytes.len().saturating_sub(most));
        bytes.into_iter().flatten().skip(skipped).copied().collect()
    }

    /// The bytes before `until`, of one lane or of all lanes, to be searched.
    pub(super) fn tails(&self, until: Instant, lane: Option<usize>) -> Vec<Tail> {
        let most = LOOK_BACK[usize::from(lane.is_some())];
        let lanes = self.lanes.iter().enumerate();
        let lanes = lanes.filter(|(index, _)| lane.is_none_or(|lane| lane == *index));
        lanes.map(|(_, lane)| lane.tail(until, most)).collect()
    }
}

impl LoggedLane {
    fn tail(&self, until: Instant, most: usize) -> Tail {
        let last = self.pieces.partition_point(|piece| piece.at <= until);
        let first = self.end - self.bytes.len() as u64;
        let end = last
            .checked_sub(1)
            .map_or(first, |last| self.pieces[last].end);
        let from = first.max(end.saturating_sub(most as u64));
        let begin = self.pieces.partition_point(|piece| piece.end <= from);
        let pieces = self.pieces.range(begin.min(last)..last).copied();
        let bytes = self
            .bytes
            .range(as_index(from - first)..as_index(end - first));
        Tail {
            link: self.link.clone(),
            way: self.way,
            codec: self.codec,
            is_whole: from == 0,
            from,
            bytes: bytes.copied().collect(),
            pieces: pieces.collect(),
        }
    }
}

/// A section of a lane.
#[derive(Clone, Debug)]
pub(super) struct Tail {
    link: String,
    way: Direction,
    codec: Option<&'static Codec>,
    /// Whether the section begins with the first byte ever received.
    is_whole: bool,
    from: u64,
    bytes: Vec<u8>,
    pieces: Vec<Piece>,
}

impl Tail {
    /// The frames in the section, and the bytes outside frames.
    fn frames(&self) -> Vec<Frame> {
        let Some(codec) = self.codec else {
            return self.as_text();
        };
        let (mut stream, mut found) = (Stream::towards(codec, self.way), Vec::new());
        let (mut from, mut before) = (self.from, None);
        for piece in &self.pieces {
            if before.is_some_and(|before| piece.at - before > codec.idle()) {
                found.extend(stream.idle());
            }
            let part = as_index(from - self.from)..as_index(piece.end - self.from);
            found.extend(stream.push(&self.bytes[part]));
            (from, before) = (piece.end, Some(piece.at));
        }
        // A frame that is truncated at the beginning of the section is not a line error.
        let is_cut = |one: &Stretch| !one.is_frame() && one.bytes.start == 0 && !self.is_whole;
        let found = found.iter().filter(|one| !is_cut(one));
        found.map(|one| self.frame(one)).collect()
    }

    fn frame(&self, stretch: &Stretch) -> Frame {
        let (is_bad, words) = match &stretch.what {
            What::Frame(words) => (false, words.clone()),
            What::Bad(errors) if errors.is_empty() => (true, "no frame".to_owned()),
            What::Bad(errors) => {
                let errors: Vec<String> = errors.iter().map(ToString::to_string).collect();
                (true, errors.join("; "))
            }
        };
        let range = as_index(stretch.bytes.start)..as_index(stretch.bytes.end);
        self.told(range, words, is_bad)
    }

    fn told(&self, range: core::ops::Range<usize>, words: String, is_bad: bool) -> Frame {
        let [start, end] = [range.start, range.end].map(|at| self.from + at as u64);
        let first = self.pieces.partition_point(|piece| piece.end <= start);
        let last = self.pieces.partition_point(|piece| piece.end < end);
        let own = self.pieces.get(first..=last).unwrap_or_default();
        Frame {
            at_ns: own.last().map_or(0, |piece| piece.at.as_nanos()),
            link: self.link.clone(),
            way: self.way.name(),
            words,
            bytes: digits(&self.bytes[range]),
            is_bad,
            is_hit: own.iter().any(|piece| piece.is_hit),
        }
    }

    /// The chunks as they arrived, because the protocol is unknown.
    fn as_text(&self) -> Vec<Frame> {
        let mut from = self.from;
        let piece = |piece: &Piece| {
            let range = as_index(from - self.from)..as_index(piece.end - self.from);
            from = piece.end;
            let words = words::text(&self.bytes[range.clone()]);
            self.told(range, words, false)
        };
        self.pieces.iter().map(piece).collect()
    }
}

/// The newest frames of all `tails` in order of time.
pub(super) fn frames(tails: &[Tail]) -> Vec<Frame> {
    let mut all: Vec<Frame> = tails.iter().flat_map(Tail::frames).collect();
    all.sort_by_key(|frame| frame.at_ns);
    all.drain(..all.len().saturating_sub(FRAMES_MAX));
    all
}

/// Converts an offset within the stored bytes.
fn as_index(place: u64) -> usize {
    usize::try_from(place).expect("within what is kept")
}

#[cfg(test)]
mod tests {
    use engine::codec::BUS_HIGH_FIRST;

    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    /// A read of ten registers from 36, as the field firmware sends it, in two chunks; the second
    /// one was hit. Then a stray byte.
    fn log() -> WireLog {
        let mut log = WireLog::default();
        log.begin([("base", Direction::ToDevice, Some(&BUS_HIGH_FIRST))].into_iter());
        log.push(0, at(1), &[0xAB, 0x24]);
        log.hit(0);
        log.push(0, at(2), &[0x0A, 0x00, 0xD9]);
        log.push(0, at(3), &[0x55]);
        log.push(0, at(9), &[0xAB, 0x24, 0x0A, 0x00, 0xD9]);
        log
    }

    #[test]
    fn frames_have_words_bytes_and_the_time_of_their_last_byte() {
        let all = frames(&log().tails(at(10), None));
        let told: Vec<_> = all
            .iter()
            .map(|one| (one.at_ns, one.is_bad, one.is_hit))
            .collect();
        let expected = [
            (2_000_000, false, true),
            (3_000_000, true, false),
            (9_000_000, false, false),
        ];
        assert_eq!(told, expected);
        assert_eq!(all[0].bytes, "AB240A00D9");
        assert!(all[0].words.contains("36"), "{}", all[0].words);
    }

    /// There is one frame up to 2 ms; after a branch at this time later bytes are gone.
    #[test]
    fn only_what_had_come_is_told() {
        let mut log = log();
        assert_eq!(frames(&log.tails(at(2), Some(0))).len(), 1);
        log.cut(at(2));
        assert_eq!(frames(&log.tails(at(10), None)).len(), 1);
        assert_eq!(log.last_bytes(0, 2), [0x00, 0xD9]);
        log.push(0, at(4), &[0xAB, 0x24, 0x0A, 0x00, 0xD9]);
        assert_eq!(frames(&log.tails(at(10), None)).len(), 2);
    }

    #[test]
    fn it_is_bounded() {
        let mut log = log();
        for millis in 0..5_000 {
            log.push(0, at(10 + millis), &[0x55; 1_024]);
        }
        assert!(log.lanes[0].bytes.len() <= BYTES_MAX);
        assert_eq!(log.lanes[0].end, 11 + 5_000 * 1_024);
        assert!(!frames(&log.tails(at(9_000), None)).is_empty());
    }
}
