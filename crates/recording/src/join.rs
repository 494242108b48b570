//! Joins the chunks of a run into records and sorts the records by time.
//!
//! A line may deliver byte by byte, and one record per byte would cost more than the run itself.
//! Chunks that arrive back to back become one record, which stores their lengths
//! ([`Record::pieces`](super::Record)). A record is therefore finished some time after its first
//! byte. Later records wait for it, so that the file stays in order of time.

use core::mem::take;

use crate::record::{Kind, Packet};
use engine::rig::line::Direction;
use engine::rig::{Link, Rig};
use protocols::{Instant, LineConfig, LineEvent};

/// Maximum number of bytes of one record; also limits how long other records wait.
const JOINED_MAX: usize = 512;
/// Number of finished records that are sorted in one batch.
const BATCH: usize = 64;
/// Maximum length of a chunk that is joined; no line has a longer one.
const PIECE_MAX: usize = 64;
/// Maximum number of waiting records and bytes; beyond it, records are written without waiting.
const WAITING_MAX: usize = 512;
const ARENA_MAX: usize = 64 << 10;

/// Joiner of the chunks of all lines of a rig. Times are in nanoseconds.
#[derive(Debug)]
pub(super) struct Joiner {
    /// Two lines for each link, numbered by [`line_of`].
    lines: Vec<Open>,
    /// Before this time, no open record ends by silence.
    stale_at: u64,
    waiting: Vec<Waiting>,
    /// Bytes of the waiting records.
    arena: Vec<u8>,
    sequence: u64,
    /// Offset that is added to all times.
    epoch: u64,
}

/// Number of a line among the lines of all links.
pub(super) const fn line_of(link: usize, direction: Direction) -> usize {
    2 * link + direction as usize
}

/// A record that may continue; without bytes, there is no open record.
#[derive(Debug)]
struct Open {
    bytes: Vec<u8>,
    /// Lengths of its chunks, as pairs of length and count.
    runs: Vec<u8>,
    /// Time at which its last byte arrived.
    at: u64,
    delay: u64,
    /// Time on the wire of 0 to `PIECE_MAX` bytes.
    times: [u64; PIECE_MAX + 1],
}

impl Open {
    fn new(line: LineConfig) -> Self {
        let time = |len: usize| {
            let time = line.bytes_time(len as u64).as_nanos();
            u64::try_from(time).expect("64 bytes take no centuries")
        };
        Self {
            times: core::array::from_fn(time),
            bytes: Vec::with_capacity(JOINED_MAX),
            runs: Vec::new(),
            at: 0,
            delay: 0,
        }
    }

    /// Time after which no chunk, not even the longest, can follow back to back.
    fn ends(&self) -> Option<u64> {
        (!self.bytes.is_empty()).then(|| self.at.saturating_add(self.times[PIECE_MAX]))
    }

    /// Appends a chunk if it follows back to back; returns whether it did.
    fn joins(&mut self, at: u64, piece: &[u8], delay: u64) -> bool {
        let joins = !self.bytes.is_empty()
            && self.bytes.len() + piece.len() <= JOINED_MAX
            && self.at + self.times[piece.len()] == at
            && self.delay == delay;
        if joins {
            self.put(at, piece);
        }
        joins
    }

    fn put(&mut self, at: u64, piece: &[u8]) {
        self.bytes.extend_from_slice(piece);
        self.at = at;
        let len = u8::try_from(piece.len()).expect("at most PIECE_MAX");
        match self.runs.last_chunk_mut() {
            Some([last, count]) if *last == len && *count < u8::MAX => *count += 1,
            _ => self.runs.extend_from_slice(&[len, 1]),
        }
    }
}

/// A finished record that waits for earlier records.
#[derive(Debug)]
struct Waiting {
    at: u64,
    delay: u64,
    /// Start of its bytes in the arena; its runs follow the bytes.
    start: usize,
    lens: [usize; 2],
    line: u32,
    kind: Kind,
    extra: Option<Box<Extra>>,
}

/// Fields that few records have.
#[derive(Debug)]
pub(super) struct Extra {
    pub(super) sent: Option<(Instant, Vec<u8>)>,
    pub(super) comment: String,
}

const NEVER: u64 = u64::MAX;

impl Joiner {
    /// A joiner for the lines of `rig`, whose run begins at `epoch`.
    pub(super) fn new(rig: &Rig, epoch: Instant) -> Self {
        // The rate in the file, used for both directions: a reader knows no other rate.
        let of_link = |link: &Link| {
            let [line, _] = rig.line_configs(link.line(Direction::ToMaster));
            [Open::new(line), Open::new(line)]
        };
        Self {
            lines: rig.links().iter().flat_map(of_link).collect(),
            stale_at: NEVER,
            waiting: Vec::new(),
            arena: Vec::new(),
            sequence: 0,
            epoch: epoch.as_nanos(),
        }
    }

    /// Adds bytes that arrived unchanged at `at`, `delay` nanoseconds after their last bit was
    /// sent.
    pub(super) fn bytes(
        &mut self,
        line: usize,
        at: Instant,
        bytes: &[u8],
        delay: u64,
        out: &mut Vec<u8>,
    ) {
        let at = at.as_nanos();
        let short = bytes.len() <= PIECE_MAX;
        if short && self.lines[line].joins(at, bytes, delay) {
            return;
        }
        self.close(line);
        if short {
            let open = &mut self.lines[line];
            open.put(at, bytes);
            open.delay = delay;
            self.stale_at = self.stale_at.min(at.saturating_add(open.times[PIECE_MAX]));
        } else {
            self.wait(at, line, Kind::Data, [bytes, &[]], delay, None);
        }
        if self.stale_at < at {
            self.close_stale(at);
        }
        if self.waiting.len() >= BATCH {
            self.emit(out);
        }
    }

    /// Adds an item that is never merged with others.
    pub(super) fn single(
        &mut self,
        line: usize,
        at: Instant,
        kind: Kind,
        bytes: &[u8],
        extra: Extra,
        out: &mut Vec<u8>,
    ) {
        self.close(line);
        let extra = Some(Box::new(extra));
        self.wait(at.as_nanos(), line, kind, [bytes, &[]], 0, extra);
        if self.waiting.len() >= BATCH {
            self.emit(out);
        }
    }

    /// Advances the time to `now`; everything due earlier has already arrived.
    pub(super) fn reached(&mut self, now: Instant) {
        if self.stale_at < now.as_nanos() {
            self.close_stale(now.as_nanos());
        }
    }

    /// Finishes all open records at the end of the run.
    pub(super) fn finish(&mut self, out: &mut Vec<u8>) {
        (0..self.lines.len()).for_each(|line| self.close(line));
        self.emit(out);
    }

    /// Ends all records whose next chunk was due before `now`.
    fn close_stale(&mut self, now: u64) {
        self.stale_at = NEVER;
        for line in 0..self.lines.len() {
            match self.lines[line].ends() {
                Some(end) if end < now => self.close(line),
                Some(end) => self.stale_at = self.stale_at.min(end),
                None => {}
            }
        }
    }

    fn close(&mut self, line: usize) {
        let open = &mut self.lines[line];
        if open.bytes.is_empty() {
            return;
        }
        let (mut bytes, mut runs) = (take(&mut open.bytes), take(&mut open.runs));
        let (at, delay) = (open.at, open.delay);
        // One chunk needs no list of lengths.
        let several = if runs.len() == 2 && runs[1] == 1 {
            &[]
        } else {
            &runs[..]
        };
        self.wait(at, line, Kind::Data, [&bytes, several], delay, None);
        bytes.clear();
        runs.clear();
        (self.lines[line].bytes, self.lines[line].runs) = (bytes, runs);
    }

    fn wait(
        &mut self,
        at: u64,
        line: usize,
        kind: Kind,
        parts: [&[u8]; 2],
        delay: u64,
        extra: Option<Box<Extra>>,
    ) {
        let start = self.arena.len();
        parts
            .iter()
            .for_each(|part| self.arena.extend_from_slice(part));
        let record = Waiting {
            at,
            delay,
            start,
            lens: [parts[0].len(), parts[1].len()],
            line: u32::try_from(line).expect("few links"),
            kind,
            extra,
        };
        let later = self.waiting.iter().rev();
        let later = later.take_while(|other| other.at > at).count();
        self.waiting.insert(self.waiting.len() - later, record);
    }

    /// Writes all records that no unfinished record can precede.
    pub(super) fn emit(&mut self, out: &mut Vec<u8>) {
        if self.waiting.len() >= WAITING_MAX || self.arena.len() >= ARENA_MAX {
            (0..self.lines.len()).for_each(|line| self.close(line));
        }
        let open = self.lines.iter().filter(|open| !open.bytes.is_empty());
        let until = open.map(|open| open.at).min().unwrap_or(NEVER);
        let ready = self.waiting.partition_point(|record| record.at <= until);
        for record in self.waiting.drain(..ready) {
            let [len, runs] = record.lens;
            let (bytes, behind) = self.arena[record.start..].split_at(len);
            let extra = record.extra.as_deref();
            let sent = extra.and_then(|extra| extra.sent.as_ref());
            let sent = sent.map(|(at, bytes)| (self.epoch + at.as_nanos(), &bytes[..]));
            let at = self.epoch + record.at;
            let sent = sent.or_else(|| (record.delay > 0).then(|| (at - record.delay, bytes)));
            let packet = Packet {
                interface: record.line / 2,
                at: Instant::from_nanos(at),
                direction: [Direction::ToMaster, Direction::ToDevice][record.line as usize % 2],
                kind: record.kind,
                bytes,
                sequence: Some(self.sequence),
                sent: sent.map(|(at, bytes)| (Instant::from_nanos(at), bytes)),
                pieces: &behind[..runs],
                comment: extra.map_or("", |extra| &extra.comment),
            };
            packet.write(out);
            self.sequence += 1;
        }
        if self.waiting.is_empty() {
            self.arena.clear();
        }
    }
}

/// Text of a line event.
pub const fn event_words(event: LineEvent) -> &'static str {
    match event {
        LineEvent::Opened => "port opened",
        LineEvent::Closed => "port closed",
        LineEvent::Break => "break",
        LineEvent::FramingError => "framing error",
        LineEvent::ParityError => "parity error",
        LineEvent::Overrun => "overrun",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Capture, Interface, Record, Section};
    use engine::rig::bare;

    const ALONE: Extra = Extra {
        sent: None,
        comment: String::new(),
    };

    /// Two links at 1 Mbaud, 10 us a byte; the run began at 5 s.
    fn joiner() -> Joiner {
        let (rig, _) = bare::linked(["one", "two"], 1_000_000);
        Joiner::new(&rig, Instant::from_secs(5))
    }

    /// Records that a reader finds in the output of `join`.
    fn read(join: impl FnOnce(&mut Joiner, &mut Vec<u8>)) -> Vec<Record> {
        let mut file = Vec::new();
        Section::default().write(&mut file);
        for name in ["one", "two"] {
            Interface::new(name, 1_000_000).write(&mut file);
        }
        let mut joiner = joiner();
        join(&mut joiner, &mut file);
        joiner.finish(&mut file);
        let capture = Capture::of(&file);
        assert_eq!((capture.broken, capture.cut, capture.skipped), (None, 0, 0));
        let numbers: Vec<_> = capture.records.iter().map(|one| one.sequence).collect();
        let expected: Vec<_> = (0..numbers.len() as u64).map(Some).collect();
        assert_eq!(numbers, expected);
        capture.records
    }

    /// Fields of each record: link, microseconds since the run began, bytes, chunk lengths.
    fn told(records: &[Record]) -> Vec<(usize, u64, Vec<u8>, Vec<u8>)> {
        let micros = |one: &Record| one.at.as_micros() - 5_000_000;
        let told = |one: &Record| {
            (
                one.link,
                micros(one),
                one.bytes.to_vec(),
                one.pieces.clone(),
            )
        };
        records.iter().map(told).collect()
    }

    const fn at(micros: u64) -> Instant {
        Instant::from_micros(micros)
    }

    /// At 10 us a byte, the next chunks are complete at 20 and 40 us; at 51 us, a chunk is 1 us
    /// late.
    #[test]
    fn what_follows_back_to_back_is_one_record() {
        let records = read(|joiner, out| {
            joiner.bytes(3, at(10), &[1], 0, out);
            joiner.bytes(3, at(20), &[2], 0, out);
            joiner.bytes(3, at(40), &[3, 4], 0, out);
            joiner.bytes(3, at(51), &[5], 0, out);
        });
        let first = (1, 40, vec![1, 2, 3, 4], vec![1, 1, 2]);
        assert_eq!(told(&records), [first, (1, 51, vec![5], vec![])]);
        assert!(
            records
                .iter()
                .all(|one| one.direction == Direction::ToDevice)
        );
        assert!(records.iter().all(|one| one.sent.is_none()));
    }

    /// A late chunk was sent earlier. Chunks with equal delay join; another delay begins a new
    /// record.
    #[test]
    fn what_is_late_says_when_it_was_sent() {
        let records = read(|joiner, out| {
            joiner.bytes(0, at(30), &[1], 7_000, out);
            joiner.bytes(0, at(40), &[2], 7_000, out);
            joiner.bytes(0, at(50), &[3], 8_000, out);
        });
        let expected = [(0, 40, vec![1, 2], vec![1, 1]), (0, 50, vec![3], vec![])];
        assert_eq!(told(&records), expected);
        let sent = records.iter().map(|one| one.sent.as_ref().expect("late"));
        let sent: Vec<_> = sent
            .map(|sent| (sent.at.as_micros() - 5_000_000, sent.bytes.to_vec()))
            .collect();
        assert_eq!(sent, [(33, vec![1, 2]), (42, vec![3])]);
    }

    /// A record is finished after its first byte. Events of other lines in between precede it.
    #[test]
    fn records_are_in_the_order_of_time() {
        let records = read(|joiner, out| {
            joiner.bytes(0, at(10), &[1], 0, out);
            let opened = Kind::Line(LineEvent::Opened);
            joiner.single(2, at(15), opened, &[], ALONE, out);
            joiner.bytes(0, at(20), &[2], 0, out);
            let said = Extra {
                sent: Some((at(16), vec![9])),
                comment: "fault".to_owned(),
            };
            joiner.single(2, at(18), Kind::Data, &[8], said, out);
        });
        let expected = [
            (1, 15, vec![], vec![]),
            (1, 18, vec![8], vec![]),
            (0, 20, vec![1, 2], vec![1, 1]),
        ];
        assert_eq!(told(&records), expected);
        let sent = records[1].sent.as_ref().expect("others were sent");
        assert_eq!(
            (sent.at, &sent.bytes[..]),
            (Instant::from_micros(5_000_016), &[9][..])
        );
        assert_eq!((&*records[1].comment, &*records[2].comment), ("fault", ""));
    }

    /// An event ends the record of its own line; later bytes begin another record.
    #[test]
    fn what_stands_alone_is_joined_with_nothing() {
        let records = read(|joiner, out| {
            joiner.bytes(0, at(10), &[1], 0, out);
            joiner.single(0, at(10), Kind::Line(LineEvent::Break), &[], ALONE, out);
            joiner.bytes(0, at(20), &[2], 0, out);
        });
        let bytes: Vec<_> = records.iter().map(|one| one.bytes.to_vec()).collect();
        assert_eq!(bytes, [vec![1], vec![], vec![2]]);
    }

    /// A record holds at most 512 bytes; a joined chunk at most 64.
    #[test]
    fn a_record_does_not_grow_for_ever() {
        let records = read(|joiner, out| {
            for byte in 1..=600 {
                joiner.bytes(0, at(10 * byte), &[7], 0, out);
            }
        });
        let lens: Vec<_> = records.iter().map(|one| one.bytes.len()).collect();
        assert_eq!(lens, [512, 88]);
        assert_eq!(records[0].pieces, [1; 512]);
        let records = read(|joiner, out| {
            joiner.bytes(0, at(640), &[1; 64], 0, out);
            joiner.bytes(0, at(1280), &[2; 64], 0, out);
            joiner.bytes(0, at(1930), &[3; 65], 0, out);
            joiner.bytes(0, at(1940), &[4], 0, out);
        });
        let lens: Vec<_> = records.iter().map(|one| one.bytes.len()).collect();
        assert_eq!(lens, [128, 65, 1]);
    }

    /// Equal chunk lengths are stored as one length and a count of at most 255: three pairs store
    /// 512 chunks.
    #[test]
    fn pieces_that_are_alike_take_no_room() {
        let written = |piece: usize| {
            let (mut joiner, mut out) = (joiner(), Vec::new());
            for end in (piece..=512).step_by(piece) {
                joiner.bytes(0, at(10 * end as u64), &vec![7; piece], 0, &mut out);
            }
            joiner.finish(&mut out);
            out.len()
        };
        let [ones, whole] = [1, 64].map(written);
        assert!(ones > whole && ones <= whole + 8, "{ones} {whole}");
    }

    /// After the time of the longest chunk, 640 us, no chunk can follow an open record. Other
    /// records then no longer wait for it.
    #[test]
    fn a_record_ends_by_silence() {
        let (mut joiner, mut out) = (joiner(), Vec::new());
        joiner.bytes(0, at(10), &[1], 0, &mut out);
        joiner.reached(at(650));
        assert!(!joiner.lines[0].bytes.is_empty());
        joiner.reached(at(651));
        assert!(joiner.lines[0].bytes.is_empty());
        assert_eq!((joiner.waiting.len(), joiner.stale_at), (1, NEVER));
        joiner.bytes(0, at(1000), &[1], 0, &mut out);
        joiner.bytes(1, at(1300), &[1], 0, &mut out);
        assert_eq!(joiner.stale_at, 1_640_000);
        joiner.bytes(2, at(1700), &[1], 0, &mut out);
        assert_eq!((joiner.waiting.len(), joiner.stale_at), (2, 1_940_000));
        assert!(out.is_empty(), "a batch is written at once");
        joiner.emit(&mut out);
        assert!(joiner.waiting.is_empty() && joiner.arena.is_empty());
    }

    /// At 650 us, the longest chunk may still follow the record that ended at 10 us. The record of
    /// the other line, which ended at 0 us, can no longer continue.
    #[test]
    fn the_longest_piece_joins_when_others_are_over() {
        let records = read(|joiner, out| {
            joiner.bytes(2, at(0), &[1], 0, out);
            joiner.bytes(0, at(10), &[2], 0, out);
            joiner.reached(at(650));
            joiner.bytes(0, at(650), &[3; 64], 0, out);
        });
        let joined = [&[2][..], &[3; 64]].concat();
        let expected = [(1, 0, vec![1], vec![]), (0, 650, joined, vec![1, 64])];
        assert_eq!(told(&records), expected);
    }

    /// Records are written in batches, both single and joined ones.
    #[test]
    fn a_full_batch_is_written() {
        let (mut joiner, mut out) = (joiner(), Vec::new());
        for number in 1..BATCH as u64 {
            joiner.single(2, at(number), Kind::Data, &[7], ALONE, &mut out);
        }
        assert!(out.is_empty() && joiner.waiting.len() == BATCH - 1);
        joiner.single(2, at(BATCH as u64), Kind::Data, &[7], ALONE, &mut out);
        assert!(!out.is_empty() && joiner.waiting.is_empty());
        out.clear();
        for number in 1..BATCH as u64 {
            joiner.bytes(2, at(10_000 + number * 1_000), &[7; 65], 0, &mut out);
        }
        assert!(out.is_empty() && joiner.waiting.len() == BATCH - 1);
        joiner.bytes(2, at(10_000 + BATCH as u64 * 1_000), &[7; 65], 0, &mut out);
        assert!(!out.is_empty() && joiner.waiting.is_empty());
    }

    /// The number and the bytes of the records that wait for an open record are limited.
    #[test]
    fn an_open_record_holds_back_so_many_others() {
        let (mut joiner, mut out) = (joiner(), Vec::new());
        joiner.bytes(0, at(10), &[1], 0, &mut out);
        for number in 1..WAITING_MAX as u64 {
            joiner.single(2, at(10 + number), Kind::Data, &[7], ALONE, &mut out);
        }
        assert!(out.is_empty() && joiner.waiting.len() == WAITING_MAX - 1);
        joiner.single(2, at(99_999_999), Kind::Data, &[7], ALONE, &mut out);
        assert!(!out.is_empty() && joiner.waiting.is_empty());
        let (mut joiner, mut out) = (self::joiner(), Vec::new());
        joiner.bytes(0, at(10), &[1], 0, &mut out);
        joiner.single(
            2,
            at(20),
            Kind::Data,
            &vec![7; ARENA_MAX - 1],
            ALONE,
            &mut out,
        );
        joiner.emit(&mut out);
        assert_eq!((out.len(), joiner.waiting.len()), (0, 1));
        joiner.single(2, at(21), Kind::Data, &[7], ALONE, &mut out);
        joiner.emit(&mut out);
        assert!(!out.is_empty() && joiner.waiting.is_empty());
    }

    /// Captures use these texts in comments, and CSV exports use them in lines.
    #[test]
    fn each_event_has_its_words() {
        let events = [
            (LineEvent::Opened, "port opened"),
            (LineEvent::Closed, "port closed"),
            (LineEvent::Break, "break"),
            (LineEvent::FramingError, "framing error"),
            (LineEvent::ParityError, "parity error"),
            (LineEvent::Overrun, "overrun"),
        ];
        for (event, words) in events {
            assert_eq!(event_words(event), words);
        }
    }
}
