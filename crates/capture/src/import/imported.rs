//! Result and options of an import.

use bytes::Bytes;
use protocols::{Instant, LineConfig};

use crate::{Interface, Kind, Record, Section};
use engine::TOOL;
use engine::rig::line::Direction;

/// Information that a dump does not contain.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Name of the link.
    pub link: String,
    /// Bits per second, if known.
    pub baud: Option<u32>,
    /// Samples per second of a logic analyzer, if known.
    pub sample_rate: Option<u64>,
    /// Direction of the bytes that the tool names first: left to right, or received.
    pub direction: Direction,
    /// Channels or analyzers to read; if empty, all that carry serial bytes.
    pub channels: Vec<String>,
    /// Data bits, parity and stop bits of levels, if known; its baud rate is not used.
    pub coding: Option<LineConfig>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            link: "line".to_owned(),
            baud: None,
            sample_rate: None,
            direction: Direction::ToMaster,
            channels: Vec::new(),
            coding: None,
        }
    }
}

/// Baud rate for bytes without times, if none is given, bit/s.
const ASSUMED_BAUD: u32 = 115_200;

impl Options {
    /// Duration of `count` characters, if the rate is known.
    pub(super) fn byte_nanos(&self, count: usize) -> u64 {
        let line = self.baud.map(|baud| LineConfig {
            baud,
            ..self.coding.unwrap_or(LineConfig::new_8n1(baud))
        });
        let took = line.map_or(0, |line| line.bytes_time(count as u64).as_nanos());
        u64::try_from(took).unwrap_or(u64::MAX)
    }

    /// Direction of the bytes that the host received or sent.
    pub(super) fn way(&self, is_received: bool) -> Direction {
        match is_received {
            true => self.direction,
            false => opposite(self.direction),
        }
    }
}

/// The other direction.
pub(super) const fn opposite(direction: Direction) -> Direction {
    match direction {
        Direction::ToMaster => Direction::ToDevice,
        Direction::ToDevice => Direction::ToMaster,
    }
}

/// Error of a dump that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImportError {
    /// Line, from 1; 0 if the file has no lines.
    pub line: usize,
    /// Offset of that line, in bytes from the start of the file.
    pub offset: usize,
    /// The error, and the expected text.
    pub message: String,
}

impl ImportError {
    /// An error of the file as a whole.
    pub(super) fn of_file(message: impl Into<String>) -> Self {
        Self::at_byte(0, message)
    }

    /// An error of a file without lines.
    pub(super) fn at_byte(offset: usize, message: impl Into<String>) -> Self {
        let message = message.into();
        Self {
            line: 0,
            offset,
            message,
        }
    }
}

impl core::fmt::Display for ImportError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let (line, offset, message) = (self.line, self.offset, &self.message);
        match (line, offset) {
            (0, 0) => f.write_str(message),
            (0, _) => write!(f, "byte {offset}: {message}"),
            _ => write!(f, "line {line} (byte {offset}): {message}"),
        }
    }
}

impl core::error::Error for ImportError {}

/// A dump as a capture.
#[derive(Clone, Debug)]
pub struct Imported {
    links: Vec<Interface>,
    pub(super) records: Vec<Record>,
    /// Notes for the reader, e.g. that times are local.
    pub notes: Vec<String>,
    pub(super) clock: &'static str,
    is_untimed: bool,
    /// Line of the next record, from 1; 0 if the file has no lines.
    pub(super) line: usize,
    /// Records whose time is before that of the previous record of their link.
    backwards: Vec<Place>,
}

/// Place of a record in its file.
#[derive(Clone, Copy, Debug)]
struct Place {
    line: usize,
    record: usize,
}

impl Imported {
    pub(super) const fn new() -> Self {
        Self {
            links: Vec::new(),
            records: Vec::new(),
            notes: Vec::new(),
            clock: "utc",
            is_untimed: false,
            line: 0,
            backwards: Vec::new(),
        }
    }

    /// Whether the file has times; without them, bytes follow back to back.
    pub const fn is_timed(&self) -> bool {
        !self.is_untimed
    }

    /// The links.
    pub fn links(&self) -> &[Interface] {
        &self.links
    }

    /// All records in the order of the file.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// The capture as a file.
    pub fn to_pcapng(&self, format: super::Format) -> Vec<u8> {
        let mut out = Vec::new();
        let section = Section {
            tool: format!("{TOOL} {}", env!("CARGO_PKG_VERSION")),
            about: format!("imported={}\nclock={}", format.name(), self.clock),
            scenario: String::new(),
        };
        section.write(&mut out);
        self.links.iter().for_each(|link| link.write(&mut out));
        for record in &self.records {
            let link = u32::try_from(record.link).expect("few links");
            record.write(link, &mut out);
        }
        out
    }

    pub(super) fn note(&mut self, note: impl Into<String>) {
        let note = note.into();
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    pub(super) fn link(&mut self, name: &str, options: &Options) -> usize {
        self.link_at(name, options.baud.unwrap_or(0))
    }

    /// Index of the link `name`, which gets the rate `baud` if it is new.
    pub(super) fn link_at(&mut self, name: &str, baud: u32) -> usize {
        if let Some(known) = self.links.iter().position(|link| link.name == name) {
            return known;
        }
        self.links.push(Interface::new(name, baud));
        self.links.len() - 1
    }

    pub(super) fn push(
        &mut self,
        link: usize,
        nanos: u64,
        direction: Direction,
        kind: Kind,
        bytes: &[u8],
    ) {
        let number = self.records.len() as u64;
        let last = self.records.iter().rfind(|record| record.link == link);
        if last.is_some_and(|last| nanos < last.at.as_nanos()) {
            self.backwards.push(Place {
                line: self.line,
                record: self.records.len() + 1,
            });
        }
        self.records.push(Record {
            link,
            sequence: Some(number),
            at: Instant::from_nanos(nanos),
            direction,
            kind,
            bytes: Bytes::copy_from_slice(bytes),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        });
    }

    /// Notes the records whose time is before that of the previous record.
    pub(super) fn note_backwards(&mut self) {
        let Some(first) = self.backwards.first() else {
            return;
        };
        let place = match first.line {
            0 => format!("record {}", first.record),
            line => format!("line {line}"),
        };
        let more = match self.backwards.len() {
            1 => String::new(),
            count => format!(", and at {} more places", count - 1),
        };
        self.note(format!(
            "the times go backwards at {place}{more}: the order of the file and its times are kept"
        ));
    }

    /// Sorts the records by time and numbers them. Several lines may follow each other in the file;
    /// one line whose times go backwards is noted.
    pub(super) fn sort(&mut self) {
        self.backwards.clear();
        let mut latest: Vec<(usize, Direction, Instant)> = Vec::new();
        let mut is_late = |record: &Record| {
            let mut lines = latest.iter_mut();
            let line = lines.find(|line| (line.0, line.1) == (record.link, record.direction));
            match line {
                Some((.., last)) if record.at < *last => return true,
                Some((.., last)) => *last = record.at,
                None => latest.push((record.link, record.direction, record.at)),
            }
            false
        };
        let late = self.records.iter().filter(|record| is_late(record)).count();
        if late > 0 {
            self.note(format!(
                "the times of a line go backwards, {late} records come too late in the file: they \
                 are sorted by time"
            ));
        }
        self.records.sort_by_key(|record| record.at);
        for (number, record) in (0..).zip(&mut self.records) {
            record.sequence = Some(number);
        }
    }
}

/// Assigns times to bytes without times: back to back at the line's rate.
pub(super) struct Untimed {
    options: Options,
    link: usize,
    characters: usize,
}

/// Silence between two messages without times, in characters.
const SILENCE: usize = 4;
/// Bytes per record if the file does not separate them.
const PIECE: usize = 16;

impl Untimed {
    /// Starts with the link that the options name. Without a rate in the options, a rate is assumed
    /// and noted.
    pub(super) fn new(options: &Options, out: &mut Imported) -> Self {
        out.clock = "virtual";
        out.is_untimed = true;
        let mut options = options.clone();
        if options.baud.is_none() {
            options.baud = Some(ASSUMED_BAUD);
            out.note(format!(
                "no times are known of the file: bytes follow each other at an assumed {ASSUMED_BAUD} baud; \
                 --baud N sets another rate"
            ));
        }
        let link = out.link(&options.link, &options);
        Self {
            options,
            link,
            characters: 0,
        }
    }

    /// Adds the bytes of one message as one record.
    pub(super) fn push(&mut self, direction: Direction, bytes: &[u8], out: &mut Imported) {
        self.characters += bytes.len();
        let nanos = self.options.byte_nanos(self.characters);
        out.push(self.link, nanos, direction, Kind::Data, bytes);
    }

    /// Adds bytes without separators as records of a few bytes.
    pub(super) fn stream(&mut self, direction: Direction, bytes: &[u8], out: &mut Imported) {
        let pieces = bytes.chunks(PIECE);
        pieces.for_each(|piece| self.push(direction, piece, out));
    }

    /// Adds a pause, so that two messages stay separate.
    pub(super) fn pause(&mut self) {
        self.characters += SILENCE;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(baud: Option<u32>) -> Options {
        Options {
            baud,
            ..Options::default()
        }
    }

    /// Ten bits at 10,000 baud are a millisecond; with two stop bits it is a tenth longer. Without
    /// a rate a character takes no time.
    #[test]
    fn characters_take_the_time_of_their_line() {
        assert_eq!(options(Some(10_000)).byte_nanos(3), 3_000_000);
        assert_eq!(options(None).byte_nanos(3), 0);
        let coding = LineConfig {
            stop_bits: 2,
            ..LineConfig::new_8n1(1)
        };
        let own = Options {
            coding: Some(coding),
            ..options(Some(10_000))
        };
        assert_eq!(own.byte_nanos(1), 1_100_000);
    }

    #[test]
    fn the_other_direction_is_that_of_the_other_end() {
        let mut own = Options::default();
        assert_eq!(
            [true, false].map(|is| own.way(is)),
            [Direction::ToMaster, Direction::ToDevice]
        );
        own.direction = opposite(own.direction);
        assert_eq!(
            [true, false].map(|is| own.way(is)),
            [Direction::ToDevice, Direction::ToMaster]
        );
    }

    #[test]
    fn an_error_names_its_place() {
        let mut error = ImportError::of_file("wrong");
        assert_eq!(error.to_string(), "wrong");
        error.offset = 7;
        assert_eq!(error.to_string(), "byte 7: wrong");
        error.line = 2;
        assert_eq!(error.to_string(), "line 2 (byte 7): wrong");
    }

    /// Records by link, milliseconds and direction.
    fn imported(records: &[(usize, u64, Direction)]) -> Imported {
        let mut out = Imported::new();
        for (line, &(link, ms, direction)) in (1..).zip(records) {
            out.line = line;
            out.push(link, ms * 1_000_000, direction, Kind::Data, b"x");
        }
        out
    }

    #[test]
    fn times_that_go_back_are_noted() {
        let (to, from) = (Direction::ToDevice, Direction::ToMaster);
        let notes = |records: &[_], has_lines: bool| {
            let mut out = imported(records);
            if !has_lines {
                out.backwards.iter_mut().for_each(|place| place.line = 0);
            }
            out.note_backwards();
            out.notes
        };
        assert!(notes(&[(0, 1, to), (0, 1, from), (1, 0, to), (0, 2, to)], true).is_empty());
        let back = [(0, 5, to), (0, 4, to), (0, 3, to), (0, 9, to)];
        let words = |place: &str| {
            format!(
                "the times go backwards at {place}: the order of the file and its times are kept"
            )
        };
        assert_eq!(notes(&back, true), [words("line 2, and at 1 more places")]);
        assert_eq!(notes(&back[..2], false), [words("record 2")]);
    }

    /// Two lines may follow each other in a file; each of them has its order.
    #[test]
    fn records_are_sorted_by_time() {
        let (to, from) = (Direction::ToDevice, Direction::ToMaster);
        let mut out = imported(&[(0, 5, to), (0, 7, to), (0, 1, from), (1, 3, to)]);
        out.sort();
        let found: Vec<_> = out
            .records
            .iter()
            .map(|one| (one.at.as_millis(), one.sequence))
            .collect();
        assert_eq!(
            found,
            [(1, Some(0)), (3, Some(1)), (5, Some(2)), (7, Some(3))]
        );
        out.note_backwards();
        assert!(out.notes.is_empty());
        let mut late = imported(&[(0, 5, to), (0, 3, to), (0, 4, to), (0, 6, to)]);
        late.sort();
        assert!(
            late.notes[0].contains(", 2 records come too late"),
            "{:?}",
            late.notes
        );
    }

    /// At 10,000 baud a byte takes a millisecond, and a pause is four of them.
    #[test]
    fn bytes_without_times_follow_each_other() {
        let mut out = Imported::new();
        let mut untimed = Untimed::new(&options(Some(10_000)), &mut out);
        untimed.push(Direction::ToMaster, b"ab", &mut out);
        untimed.pause();
        untimed.stream(Direction::ToDevice, &[7; 17], &mut out);
        let found: Vec<_> = out
            .records()
            .iter()
            .map(|one| (one.at.as_millis(), one.bytes.len()))
            .collect();
        assert_eq!(found, [(2, 2), (22, 16), (23, 1)]);
        assert!(!out.is_timed() && out.notes.is_empty() && Imported::new().is_timed());
        let mut assumed = Imported::new();
        drop(Untimed::new(&options(None), &mut assumed));
        assert!(
            assumed.notes[0].contains("115200 baud"),
            "{:?}",
            assumed.notes
        );
        assumed.note("again");
        assumed.note("again");
        assert_eq!((assumed.notes.len(), assumed.links()[0].baud), (2, 115_200));
        assert_eq!(
            (assumed.link_at("line", 9), assumed.link_at("other", 9)),
            (0, 1)
        );
    }

    /// Records of the same time are in order.
    #[test]
    fn equal_times_are_not_late() {
        let to = Direction::ToDevice;
        let mut out = imported(&[(0, 5, to), (0, 5, to), (0, 6, to)]);
        out.sort();
        assert!(out.notes.is_empty(), "{:?}", out.notes);
    }
}
