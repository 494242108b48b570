//! Recently received bytes and their frames, for the frame inspector of the page, and for the
//! requests and replies of a run without a robot.

mod exchange;

use std::collections::VecDeque;

use protocols::Instant;
use serde::Serialize;

use crate::Shared;
use crate::codec::{Codec, IDLE, Stream, Stretch, What, words};
use crate::hex::digits;
use crate::rig::Rig;
use crate::rig::line::{Delivery, Direction, Original};
use crate::rig::trace::{Side, Tap};
use crate::robots::Instruments;
pub use exchange::{Exchange, ReplyTimes, Talk, exchanges, reply_times, talks};

/// Maximum number of stored bytes per direction of a link: some six minutes of a lidar.
const BYTES_MAX: usize = 4 << 20;
/// The same for the report of a run.
const REPORT_BYTES_MAX: usize = 1 << 18;
/// Maximum number of stored chunks per direction.
const PIECES_MAX: usize = 1 << 19;
/// Number of bytes searched for frames: per lane if all lanes are requested, and for a single lane.
const LOOK_BACK: [usize; 2] = [6_000, 40_000];
/// Maximum number of frames in one answer.
const FRAMES_MAX: usize = 400;

/// All recently received bytes.
#[derive(Clone, Debug)]
pub struct WireLog {
    lanes: Vec<LoggedLane>,
    bytes_max: usize,
}

impl Default for WireLog {
    fn default() -> Self {
        Self {
            lanes: Vec::new(),
            bytes_max: BYTES_MAX,
        }
    }
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
pub struct Frame {
    /// Time of the last byte, nanoseconds.
    pub at_ns: u64,
    /// Name of the link.
    pub link: String,
    /// Name of the direction.
    pub way: &'static str,
    /// The frame in words; for invalid bytes, the reason.
    pub words: String,
    /// Bytes as hexadecimal digits.
    pub bytes: String,
    /// Whether the bytes are not a frame of the link's protocol.
    pub is_bad: bool,
    /// Whether a fault hit these bytes, or lost the bytes before them.
    pub is_hit: bool,
}

impl WireLog {
    /// An empty log for a report, which shows fewer bytes than a page.
    pub(super) fn for_report<'a>(
        lanes: impl Iterator<Item = (&'a str, Direction, Option<&'static Codec>)>,
    ) -> Self {
        let mut log = Self {
            bytes_max: REPORT_BYTES_MAX,
            ..Self::default()
        };
        log.begin(lanes);
        log
    }

    /// Clears the log; `lanes` are link, direction and format of each lane.
    pub fn begin<'a>(
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
    pub fn hit(&mut self, lane: usize) {
        if let Some(lane) = self.lanes.get_mut(lane) {
            lane.is_hit = true;
        }
    }

    /// Adds bytes that arrived at `at`.
    pub fn push(&mut self, lane: usize, at: Instant, bytes: &[u8]) {
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
        while lane.bytes.len() > self.bytes_max || lane.pieces.len() > PIECES_MAX {
            let first = lane.end - lane.bytes.len() as u64;
            let gone = lane.pieces.pop_front().map_or(first, |piece| piece.end);
            drop(lane.bytes.drain(..as_index(gone - first)));
        }
    }

    /// Removes bytes after `until`: the run branches there.
    pub fn cut(&mut self, until: Instant) {
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
    pub fn last_bytes(&self, lane: usize, most: usize) -> Vec<u8> {
        let bytes = self.lanes.get(lane).map(|lane| &lane.bytes);
        let skipped = bytes.map_or(0, |bytes| bytes.len().saturating_sub(most));
        bytes.into_iter().flatten().skip(skipped).copied().collect()
    }

    /// The bytes before `until`, of one lane or of all lanes, to be searched.
    pub fn tails(&self, until: Instant, lane: Option<usize>) -> Vec<Tail> {
        let most = LOOK_BACK[usize::from(lane.is_some())];
        let indices = 0..self.lanes.len();
        let indices = indices.filter(|index| lane.is_none_or(|lane| lane == *index));
        indices.map(|index| self.tail(index, until, most)).collect()
    }

    /// The last bytes before `until` of all lanes, `most` bytes in total.
    pub fn last_tails(&self, until: Instant, most: usize) -> Vec<Tail> {
        let each = (most / self.lanes.len().max(1)).max(LOOK_BACK[0] / 3);
        let indices = 0..self.lanes.len();
        indices.map(|index| self.tail(index, until, each)).collect()
    }

    fn tail(&self, index: usize, until: Instant, most: usize) -> Tail {
        let mut tail = self.lanes[index].tail(until, most);
        // Both directions of a link are neighbours.
        if tail.codec.is_none()
            && let Some(other) = self.lanes.get(index ^ 1)
        {
            tail.pause_where(&other.pieces);
        }
        tail
    }

    /// Number of all bytes that each link received until `until`, to the master first, with the
    /// link's name.
    pub fn totals(&self, until: Instant) -> Vec<(String, [u64; 2])> {
        let links = self.lanes.as_chunks::<2>().0.iter();
        let total = |lane: &LoggedLane| {
            let last = lane.pieces.partition_point(|piece| piece.at <= until);
            let first = lane.end - lane.bytes.len() as u64;
            last.checked_sub(1)
                .map_or(first, |last| lane.pieces[last].end)
        };
        let totals = links.map(|both| (both[0].link.clone(), both.each_ref().map(total)));
        totals.collect()
    }
}

/// Writes the traffic of a rig to a log.
pub(super) struct Logging(Shared<WireLog>);

impl Logging {
    /// Starts the log of a rig without a robot, for its report; `None` with a robot.
    pub(super) fn begin(rig: &mut Rig, instruments: &dyn Instruments) -> Option<Shared<WireLog>> {
        if instruments.has_body() {
            return None;
        }
        let lane = |name: &str, way| instruments.codec_towards(rig, name, way);
        let lanes = rig.links().iter().flat_map(|link| {
            let ways = [Direction::ToMaster, Direction::ToDevice];
            ways.map(|way| (&*link.name, way, lane(&link.name, way)))
        });
        let log = Shared::new(WireLog::for_report(lanes));
        rig.add_tap(Box::new(Self(log.clone())));
        Some(log)
    }

    /// Starts a log of a copy of the rig, which continues `log`.
    pub(super) fn go_on(rig: &mut Rig, log: &Shared<WireLog>) -> Shared<WireLog> {
        let log = Shared::new(log.lock().clone());
        rig.add_tap(Box::new(Self(log.clone())));
        log
    }
}

impl Tap for Logging {
    fn record(&mut self, link: usize, to: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if side == Side::Received {
            self.0.lock().push(2 * link + to as usize, at, bytes);
        }
    }

    fn arrived(&mut self, link: usize, to: Direction, delivery: &Delivery) {
        let is_hit =
            |original: &Original| !original.strikes.is_empty() || !original.effects.is_empty();
        if delivery.original.as_deref().is_some_and(is_hit) {
            self.0.lock().hit(2 * link + to as usize);
        }
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
            pauses: Vec::new(),
        }
    }
}

/// A section of a lane.
#[derive(Clone, Debug)]
pub struct Tail {
    link: String,
    way: Direction,
    codec: Option<&'static Codec>,
    /// Whether the section begins with the first byte ever received.
    is_whole: bool,
    from: u64,
    bytes: Vec<u8>,
    pieces: Vec<Piece>,
    /// Times at which the other direction was busy, where the protocol is unknown.
    pauses: Vec<Instant>,
}

impl Tail {
    /// Splits bytes of an unknown protocol where the other direction carried bytes.
    fn pause_where(&mut self, others: &VecDeque<Piece>) {
        let Some((first, last)) = self.pieces.first().zip(self.pieces.last()) else {
            return;
        };
        let from = others.partition_point(|piece| piece.at < first.at);
        let until = others.partition_point(|piece| piece.at <= last.at);
        self.pauses = others.range(from..until).map(|piece| piece.at).collect();
    }

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

    /// The bytes in stretches, because the protocol is unknown: until a pause, or until the other
    /// direction carries bytes. Text is split into lines.
    fn as_text(&self) -> Vec<Frame> {
        let are_apart = |[before, after]: [Piece; 2]| {
            let busy = self.pauses.partition_point(|at| *at < before.at);
            let between = self.pauses.get(busy).is_some_and(|at| *at < after.at);
            after.at - before.at > IDLE || between
        };
        let mut from = 0;
        let stretches = self.pieces.chunk_by(|a, b| !are_apart([*a, *b]));
        let stretches = stretches.filter_map(|stretch| {
            let end = as_index(stretch.last()?.end - self.from);
            let range = core::mem::replace(&mut from, end)..end;
            Some(range)
        });
        let lines: Vec<_> = stretches.flat_map(|range| self.lines(range)).collect();
        lines
            .into_iter()
            .map(|range| {
                let words = words::text(&self.bytes[range.clone()]);
                self.told(range, words, false)
            })
            .collect()
    }

    /// The lines of `range` if it is text, else `range` itself.
    fn lines(&self, range: core::ops::Range<usize>) -> Vec<core::ops::Range<usize>> {
        let bytes = &self.bytes[range.clone()];
        let is_text = |byte: &u8| matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n');
        if !bytes.iter().all(is_text) {
            return vec![range];
        }
        let mut from = range.start;
        let ends = bytes.iter().enumerate().filter_map(|(index, byte)| {
            let next = bytes.get(index + 1);
            let is_end = match byte {
                b'\n' => true,
                b'\r' => next != Some(&b'\n'),
                _ => false,
            };
            (is_end || next.is_none()).then_some(range.start + index + 1)
        });
        ends.map(|end| core::mem::replace(&mut from, end)..end)
            .collect()
    }
}

/// The newest frames of all `tails` in order of time.
pub fn frames(tails: &[Tail]) -> Vec<Frame> {
    let mut all = all_frames(tails);
    all.drain(..all.len().saturating_sub(FRAMES_MAX));
    all
}

/// All frames of all `tails` in order of time.
pub fn all_frames(tails: &[Tail]) -> Vec<Frame> {
    let mut all: Vec<Frame> = tails.iter().flat_map(Tail::frames).collect();
    all.sort_by_key(|frame| frame.at_ns);
    all
}

/// Converts an offset within the stored bytes.
fn as_index(place: u64) -> usize {
    usize::try_from(place).expect("within what is kept")
}

#[cfg(test)]
mod tests {
    use crate::codec::BUS_HIGH_FIRST;

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

    /// A dialogue without a known protocol, in pieces of one byte. Two requests without a pause
    /// between them are two lines; bytes that are no text stay together until the answer.
    #[test]
    fn an_unknown_protocol_is_split_at_lines_and_turns() {
        let mut log = WireLog::default();
        let lanes = [Direction::ToMaster, Direction::ToDevice].map(|way| ("sonar", way, None));
        log.begin(lanes.into_iter());
        let mut now = 0;
        for (lane, bytes) in [
            (1, &b"ping\r\ngain 3\r\n"[..]),
            (0, b"mm=700\r\n"),
            (1, &[1, 0x0A, 3]),
            (0, &[9]),
            (1, &[1, 4]),
        ] {
            for byte in bytes {
                now += 1;
                log.push(lane, at(now), &[*byte]);
            }
        }
        let all = frames(&log.tails(at(now), None));
        let told: Vec<_> = all.iter().map(|one| (one.way, &*one.words)).collect();
        let expected = [
            ("to-device", "text \"ping\\r\\n\""),
            ("to-device", "text \"gain 3\\r\\n\""),
            ("to-master", "text \"mm=700\\r\\n\""),
            ("to-device", "text \"\\x01\\n\\x03\""),
            ("to-master", "text \"\\t\""),
            ("to-device", "text \"\\x01\\x04\""),
        ];
        assert_eq!(told, expected);
        assert_eq!(log.totals(at(now)), [("sonar".to_owned(), [9, 19])]);
    }
}
