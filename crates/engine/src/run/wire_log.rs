//! Recently received bytes and their frames, for the frame inspector of the page, and for the
//! requests and replies of a run without a robot.

mod dialogue;
mod exchange;
mod figures;
mod tail;

use std::collections::VecDeque;

use protocols::Instant;

use crate::Shared;
use crate::codec::Codec;
use crate::rig::line::{Delivery, Direction, Original};
use crate::rig::trace::{Side, Tap};
use crate::rig::{LinkKind, Rig};
use crate::robots::Instruments;
use dialogue::Marks;
pub use dialogue::{Dialogue, Heard};
pub use exchange::{Exchange, ReplyTimes, Talk};
pub use tail::{Frame, Tail};

/// Maximum number of stored bytes per direction of a link: some six minutes of a lidar.
const BYTES_MAX: usize = 4 << 20;
/// The same for the report of a run, which lists a few requests. A checkpoint has a copy.
const REPORT_BYTES_MAX: usize = 1 << 16;
/// Maximum number of stored chunks per direction, per stored byte.
const PIECES_SHARE: usize = 8;
/// Number of bytes searched for frames: per lane if all lanes are requested, and for a single lane.
const LOOK_BACK: [usize; 2] = [6_000, 40_000];
/// Maximum number of frames in one answer.
const FRAMES_MAX: usize = 400;

/// One direction of a link, to be logged.
#[derive(Clone, Copy, Debug)]
pub struct Lane<'a> {
    /// Name of the link.
    pub link: &'a str,
    /// The direction.
    pub way: Direction,
    /// Kind of the link.
    pub kind: LinkKind,
    /// Format of the bytes, if it is known.
    pub codec: Option<&'static Codec>,
}

/// All recently received bytes.
#[derive(Clone, Debug)]
pub struct WireLog {
    lanes: Vec<LoggedLane>,
    /// Counted requests and replies of each link, if the log counts them.
    marks: Vec<Marks>,
    bytes_max: usize,
}

impl Default for WireLog {
    fn default() -> Self {
        Self {
            lanes: Vec::new(),
            marks: Vec::new(),
            bytes_max: BYTES_MAX,
        }
    }
}

/// One direction of a link.
#[derive(Clone, Debug)]
struct LoggedLane {
    link: String,
    way: Direction,
    kind: LinkKind,
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

impl WireLog {
    /// An empty log for a report, which shows fewer bytes than a page.
    pub(super) fn for_report<'a>(lanes: impl Iterator<Item = Lane<'a>>) -> Self {
        let mut log = Self {
            bytes_max: REPORT_BYTES_MAX,
            ..Self::default()
        };
        log.begin(lanes);
        log.count_exchanges();
        log
    }

    /// Clears the log. Both directions of a link are neighbours in `lanes`, to the master first.
    pub fn begin<'a>(&mut self, lanes: impl Iterator<Item = Lane<'a>>) {
        let lane = |lane: Lane<'_>| LoggedLane {
            link: lane.link.to_owned(),
            way: lane.way,
            kind: lane.kind,
            codec: lane.codec,
            bytes: VecDeque::new(),
            end: 0,
            pieces: VecDeque::new(),
            is_hit: false,
        };
        self.lanes = lanes.map(lane).collect();
        self.marks.clear();
    }

    /// Counts requests and replies from now on, also those whose bytes are dropped later.
    pub fn count_exchanges(&mut self) {
        let marks = Marks::new(self.bytes_max);
        self.marks = vec![marks; self.lanes.len() / 2];
    }

    /// Marks the next bytes of a lane as hit.
    pub fn hit(&mut self, lane: usize) {
        if let Some(lane) = self.lanes.get_mut(lane) {
            lane.is_hit = true;
        }
    }

    /// Adds bytes that arrived at `at`.
    pub fn push(&mut self, index: usize, at: Instant, bytes: &[u8]) {
        let Some(lane) = self.lanes.get_mut(index).filter(|_| !bytes.is_empty()) else {
            return;
        };
        lane.end += bytes.len() as u64;
        lane.bytes.extend(bytes);
        lane.pieces.push_back(Piece {
            end: lane.end,
            at,
            is_hit: core::mem::take(&mut lane.is_hit),
        });
        self.count(index, at);
        let (most, lane) = (self.bytes_max, &mut self.lanes[index]);
        while lane.bytes.len() > most || lane.pieces.len() > most / PIECES_SHARE {
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
        self.cut_marks(until);
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
}

/// Writes the traffic of a rig to a log.
pub(super) struct Logging(Shared<WireLog>);

impl Logging {
    /// Starts the log of a rig without a robot, for its report; `None` with a robot.
    pub(super) fn begin(rig: &mut Rig, instruments: &dyn Instruments) -> Option<Shared<WireLog>> {
        if instruments.has_body() {
            return None;
        }
        let lanes = rig.links().iter().flat_map(|link| {
            [Direction::ToMaster, Direction::ToDevice].map(|way| Lane {
                link: &link.name,
                way,
                kind: link.kind,
                codec: instruments.codec_towards(rig, &link.name, way),
            })
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
    /// Offset of the first stored byte.
    fn first(&self) -> u64 {
        self.end - self.bytes.len() as u64
    }

    /// Offset behind the last byte until `until`.
    fn end_at(&self, until: Instant) -> u64 {
        let last = self.pieces.partition_point(|piece| piece.at <= until);
        let last = last.checked_sub(1);
        last.map_or(self.first(), |last| self.pieces[last].end)
    }

    fn tail(&self, until: Instant, most: usize) -> Tail {
        let from = self.end_at(until).saturating_sub(most as u64);
        self.section(from, until)
    }

    /// The stored bytes from `from` on.
    fn section(&self, from: u64, until: Instant) -> Tail {
        let (first, end) = (self.first(), self.end_at(until));
        let from = from.clamp(first, end);
        let begin = self.pieces.partition_point(|piece| piece.end <= from);
        let last = self.pieces.partition_point(|piece| piece.at <= until);
        let pieces = self.pieces.range(begin.min(last)..last).copied();
        let bytes = self
            .bytes
            .range(as_index(from - first)..as_index(end - first));
        Tail {
            link: self.link.clone(),
            way: self.way,
            kind: self.kind,
            codec: self.codec,
            is_whole: from == 0,
            from,
            until,
            bytes: bytes.copied().collect(),
            pieces: pieces.collect(),
            primer: Vec::new(),
            pauses: Vec::new(),
        }
    }
}

/// The newest frames of all `tails` in order of time.
pub fn frames(tails: &[Tail]) -> Vec<Frame> {
    let mut all = all_frames(tails);
    all.drain(..all.len().saturating_sub(FRAMES_MAX));
    all
}

/// All frames of all `tails` in order of time.
fn all_frames(tails: &[Tail]) -> Vec<Frame> {
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

    fn lane(link: &str, way: Direction) -> Lane<'_> {
        let (kind, codec) = (LinkKind::Uart, None);
        Lane {
            link,
            way,
            kind,
            codec,
        }
    }

    /// A read of ten registers from 36, as the field firmware sends it, in two chunks; the second
    /// one was hit. Then a stray byte.
    fn log() -> WireLog {
        let mut log = WireLog::default();
        let base = lane("base", Direction::ToDevice);
        let codec = Some(&BUS_HIGH_FIRST);
        log.begin([Lane { codec, ..base }].into_iter());
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
        let lanes = [Direction::ToMaster, Direction::ToDevice].map(|way| lane("sonar", way));
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
        assert_eq!([log.lanes[0].end, log.lanes[1].end], [9, 19]);
    }

    /// Both directions of a text device that sends by itself carry bytes at the same time, and a
    /// damaged byte or binary data could make one endless frame. But lines of text stay whole; a
    /// line with one damaged byte is a line; 600 binary bytes are 256, 256 and 88.
    #[test]
    fn full_duplex_lines_stay_whole_and_binary_data_is_bounded() {
        let mut log = WireLog::default();
        let lanes = [Direction::ToMaster, Direction::ToDevice].map(|way| lane("sonar", way));
        log.begin(lanes.into_iter());
        let (up, down) = (b"mm=7\xB00\r\nmm=701\r\n", b"gain 3\r\n");
        for millis in 0..up.len() {
            log.push(0, at(2 * millis as u64), &up[millis..=millis]);
            if let Some(byte) = down.get(millis) {
                log.push(1, at(2 * millis as u64 + 1), &[*byte]);
            }
        }
        let words = |way: &str, log: &WireLog| -> Vec<String> {
            let all = frames(&log.tails(at(90_000), None));
            let own = all.iter().filter(|one| one.way == way);
            own.map(|one| one.words.clone()).collect()
        };
        assert_eq!(words("to-device", &log), ["text \"gain 3\\r\\n\""]);
        let lines = ["text \"mm=7\\xb00\\r\\n\"", "text \"mm=701\\r\\n\""];
        assert_eq!(words("to-master", &log), lines);
        for millis in 0..600 {
            log.push(1, at(10_000 + millis), &[0xFF]);
        }
        let all = frames(&log.tails(at(90_000), None));
        let sizes: Vec<_> = all.iter().skip(3).map(|one| one.bytes.len() / 2).collect();
        assert_eq!(sizes, [256, 256, 88]);
    }

    /// A log of one lane that keeps 16 bytes and two chunks; three chunks of six bytes.
    fn short() -> WireLog {
        let mut log = WireLog {
            bytes_max: 16,
            ..WireLog::default()
        };
        log.begin([lane("base", Direction::ToDevice)].into_iter());
        for byte in 1..=3 {
            log.push(0, at(u64::from(byte)), &[byte; 6]);
        }
        log
    }

    /// The first chunk is gone: bytes 6 to 18 are stored.
    #[test]
    fn whole_chunks_are_dropped() {
        let mut log = short();
        let lane = &log.lanes[0];
        assert_eq!((lane.first(), lane.end, lane.pieces.len()), (6, 18, 2));
        assert_eq!(lane.bytes, [[2; 6], [3; 6]].concat());
        assert_eq!(
            [0, 1, 2, 3, 9].map(|millis| lane.end_at(at(millis))),
            [6, 6, 12, 18, 18]
        );
        assert_eq!(log.last_bytes(0, 4), [3; 4]);
        assert_eq!(log.last_bytes(0, 8), [2, 2, 3, 3, 3, 3, 3, 3]);
        assert_eq!(
            (log.last_bytes(0, 99).len(), log.last_bytes(7, 9).len()),
            (12, 0)
        );
        // Four bytes more fit, a third chunk does not.
        log.push(0, at(4), &[4; 4]);
        assert_eq!((log.lanes[0].first(), log.lanes[0].end), (12, 22));
        log.push(0, at(5), &[]);
        log.push(9, at(5), &[5]);
        assert_eq!((log.lanes[0].pieces.len(), log.lanes[0].end), (2, 22));
        // Sixteen bytes fit, one more does not.
        let mut log = WireLog {
            bytes_max: 16,
            ..WireLog::default()
        };
        log.begin([self::lane("base", Direction::ToDevice)].into_iter());
        log.push(0, at(1), &[1; 8]);
        log.push(0, at(2), &[2; 8]);
        assert_eq!(log.lanes[0].first(), 0);
        log.push(0, at(3), &[3]);
        assert_eq!(log.lanes[0].first(), 8);
    }

    #[test]
    fn a_section_is_within_what_is_stored() {
        let log = short();
        let lane = &log.lanes[0];
        let told = |tail: Tail| (tail.from, tail.bytes, tail.pieces.len(), tail.is_whole);
        let all = [[2; 6], [3; 6]].concat();
        assert_eq!(told(lane.section(0, at(9))), (6, all.clone(), 2, false));
        assert_eq!(told(lane.section(8, at(2))), (8, vec![2; 4], 1, false));
        assert_eq!(told(lane.section(12, at(9))), (12, vec![3; 6], 1, false));
        assert_eq!(told(lane.section(99, at(9))), (18, Vec::new(), 0, false));
        assert_eq!(told(lane.section(9, at(1))), (6, Vec::new(), 0, false));
        assert_eq!(told(lane.tail(at(9), 5)), (13, vec![3; 5], 1, false));
        assert_eq!(told(lane.tail(at(9), 7)).2, 2);
        let mut fresh = WireLog::default();
        fresh.begin([self::lane("base", Direction::ToDevice)].into_iter());
        fresh.push(0, at(1), &[1, 2]);
        assert!(fresh.lanes[0].section(0, at(9)).is_whole);
        assert!(!fresh.lanes[0].section(1, at(9)).is_whole);
    }

    /// A branch at 2 ms keeps the chunk of that time; one before the stored bytes keeps none. The
    /// next bytes are not hit any more.
    #[test]
    fn a_branch_keeps_what_came_until_then() {
        let mut log = short();
        log.hit(0);
        log.cut(at(2));
        let lane = &log.lanes[0];
        assert_eq!(
            (lane.bytes.len(), lane.end, lane.pieces.len(), lane.is_hit),
            (6, 12, 1, false)
        );
        log.cut(at(1));
        let lane = &log.lanes[0];
        assert_eq!((lane.bytes.len(), lane.end, lane.pieces.len()), (0, 6, 0));
        log.hit(0);
        log.hit(7);
        log.push(0, at(5), &[1]);
        log.push(0, at(6), &[1]);
        let hits: Vec<bool> = log.lanes[0].pieces.iter().map(|one| one.is_hit).collect();
        assert_eq!(hits, [true, false]);
    }

    /// 6,000 bytes of each lane are searched, or 40,000 of a single one; 400 frames are shown.
    #[test]
    fn the_newest_bytes_and_frames_are_told() {
        let mut log = WireLog::default();
        let lanes = [Direction::ToMaster, Direction::ToDevice].map(|way| lane("sonar", way));
        log.begin(lanes.into_iter());
        for millis in 0..500 {
            log.push(1, at(1_000 * millis), &[b'a'; 100]);
        }
        log.push(0, at(9), b"up");
        let until = at(1_000_000);
        let sizes = |lane| -> Vec<usize> {
            let tails = log.tails(until, lane).into_iter();
            tails.map(|tail| tail.bytes.len()).collect()
        };
        assert_eq!(sizes(None), [2, 6_000]);
        assert_eq!([sizes(Some(0)), sizes(Some(1))], [vec![2], vec![40_000]]);
        assert_eq!(sizes(Some(2)), [0; 0]);
        // 400 chunks of 100 bytes, the first of which is left out: it may be the rest of a line.
        let found = frames(&log.tails(until, Some(1)));
        assert_eq!(found.len(), 399);
        let mut lines = WireLog::default();
        lines.begin([lane("sonar", Direction::ToMaster)].into_iter());
        for millis in 0..450 {
            lines.push(0, at(1_000 * millis), b"a\n");
        }
        let found = frames(&lines.tails(until, Some(0)));
        assert_eq!(found.len(), 400);
        assert_eq!(found[0].at_ns, 50 * 1_000_000_000);
    }

    /// A rig without a robot is logged as its bytes arrive, by link and direction.
    #[test]
    fn a_rig_without_a_robot_is_logged() {
        use crate::rig::fault::{Damage, Strike};
        struct Bench(bool);
        impl Instruments for Bench {
            fn has_body(&self) -> bool {
                self.0
            }
        }
        let (mut rig, [one, two]) = crate::rig::bare::linked(["one", "two"], 1_000_000);
        assert!(Logging::begin(&mut rig, &Bench(true)).is_none());
        let faults = &mut rig.line_mut(1, Direction::ToMaster).faults;
        let damage = Damage::Flip { bit: 0 };
        faults.add_strike(Strike { byte: 1, damage });
        let log = Logging::begin(&mut rig, &Bench(false)).expect("no robot");
        for (node, bytes) in [
            (one[0].node, &[1_u8][..]),
            (one[1].node, &[2, 2]),
            (two[0].node, &[3, 3, 3]),
            (two[1].node, &[4; 4]),
        ] {
            rig.inject(node, bytes);
        }
        rig.run_until(at(10));
        let told = |log: &Shared<WireLog>| -> Vec<(String, Direction, u64)> {
            let log = log.lock();
            let lanes = log.lanes.iter();
            lanes
                .map(|lane| (lane.link.clone(), lane.way, lane.end))
                .collect()
        };
        let (up, down) = (Direction::ToMaster, Direction::ToDevice);
        let lane = |link: &str, way, end| (link.to_owned(), way, end);
        let mut expected = vec![
            lane("one", up, 1),
            lane("one", down, 2),
            lane("two", up, 3),
            lane("two", down, 4),
        ];
        assert_eq!(told(&log), expected);
        let hits: Vec<bool> = log.lock().lanes[2]
            .pieces
            .iter()
            .map(|one| one.is_hit)
            .collect();
        assert_eq!(hits, [false, true, false]);
        assert!(log.lock().lanes[3].pieces.iter().all(|one| !one.is_hit));
        assert_eq!(log.lock().bytes_max, 65_536);
        assert_eq!(log.lock().marks.len(), 2);
        let mut copy = rig.fork().expect("plain");
        let other = Logging::go_on(&mut copy, &log);
        copy.inject(one[0].node, &[9]);
        copy.run_until(at(20));
        assert_eq!(told(&log), expected);
        expected[0].2 = 2;
        assert_eq!(told(&other), expected);
    }
}
