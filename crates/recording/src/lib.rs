//! Captures: every byte of a run with its time in nanoseconds, its link and its damage, in a file
//! that Wireshark opens.
//!
//! The format is pcapng with link type 250 and one interface per link. Each record is one chunk as
//! it *reached its receiver*, or several chunks that arrived back to back. If the line changed or
//! delayed the bytes, the record also holds the bytes as sent, and a comment describes the damage.
//! A capture therefore needs no other file to be understood. Bytes still in flight at the end of
//! the run were not received and are not in the file.

mod conclusion;
mod files;
mod join;
mod live;
pub mod pcapng;
pub mod record;
mod writer_thread;

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

pub use conclusion::Conclusion;
pub use files::{Existing, Limits};
pub use join::event_words;
pub use live::{Recording, about, about_live};
pub use pcapng::write_whole;
use pcapng::{Block, BlockError, Blocks};
pub use record::{Interface, Kind, Record, Section, Sent};

/// One item of a capture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Item {
    /// Start of a section.
    Section(Section),
    /// Description of a link; links are numbered in the order of their descriptions.
    Interface(Interface),
    /// An event with its time.
    Record(Record),
}

/// Reader of a capture, which accepts bytes in pieces of any size.
#[derive(Clone, Debug, Default)]
pub struct Reader {
    blocks: Blocks,
    links: Vec<Interface>,
    /// Index of the section's first link among all links of the file.
    first: usize,
    skipped: u64,
    senseless: u64,
    conclusion: Option<Conclusion>,
}

/// Maximum number of links of one section; the reader counts further ones as senseless.
const LINKS_MAX: usize = 1024;

impl Reader {
    /// Reads more of the file.
    pub fn push(&mut self, bytes: &[u8]) {
        self.blocks.push(bytes);
    }

    /// The next item. `None` if more bytes are needed, or after an error, which ends the reading.
    pub fn next_item(&mut self) -> Option<Result<Item, BlockError>> {
        loop {
            match self.blocks.next_block()? {
                Err(error) => return Some(Err(error)),
                Ok(block) => {
                    if let Some(item) = self.item(&block) {
                        return Some(Ok(item));
                    }
                }
            }
        }
    }

    fn item(&mut self, block: &Block) -> Option<Item> {
        let item = match block.kind {
            pcapng::SECTION => {
                self.first += self.links.len();
                self.links.clear();
                Some(Item::Section(Section::read(block)))
            }
            pcapng::INTERFACE if self.links.len() < LINKS_MAX => {
                let interface = Interface::read(block);
                self.links.extend(interface.clone());
                interface.map(Item::Interface)
            }
            pcapng::PACKET => Record::read(block, &self.links, self.first).map(Item::Record),
            kind => {
                match Conclusion::read(block).filter(|_| kind == pcapng::CUSTOM_BLOCK) {
                    None => self.skipped += 1,
                    read => self.conclusion = read,
                }
                return None;
            }
        };
        self.senseless += u64::from(item.is_none());
        item
    }

    /// The conclusion of the run, if the reader has reached it.
    pub const fn conclusion(&self) -> Option<&Conclusion> {
        self.conclusion.as_ref()
    }

    /// Number of bytes of an incomplete block at the end.
    pub fn pending(&self) -> usize {
        self.blocks.pending()
    }

    /// Number of blocks of unknown kinds.
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Number of invalid blocks of known kinds: too short, of an unknown link, or of another link
    /// type.
    pub const fn senseless(&self) -> u64 {
        self.senseless
    }
}

/// A capture in memory.
#[derive(Clone, Debug, Default)]
pub struct Capture {
    /// Its sections; one, unless files were joined.
    pub sections: Vec<Section>,
    /// Its links.
    pub links: Vec<Interface>,
    /// All records in the order of the file.
    pub records: Vec<Record>,
    /// The error that stopped the reading before the end, if any.
    pub broken: Option<BlockError>,
    /// Number of bytes of an incomplete block at the end, where the file was cut.
    pub cut: usize,
    /// Number of skipped blocks: unknown or invalid.
    pub skipped: u64,
    /// The conclusion, if the capture is of a judged run.
    pub conclusion: Option<Conclusion>,
}

impl Section {
    /// Time from which the times of the capture are counted, if the section tells it: the start of
    /// the run. A recording, or a log of another tool, begins with its first record.
    pub fn zero(&self) -> Option<protocols::Instant> {
        let is_run = match (self.fact("clock"), self.fact("imported")) {
            (Some("virtual"), imported) => imported.is_none_or(|format| format == "csv"),
            (clock, None) => clock.is_none_or(|clock| clock == "replay"),
            _ => false,
        };
        (is_run || self.fact("start_ns").is_some()).then(|| self.start())
    }
}

impl Capture {
    /// Time from which shown and given times are counted: the start of the run, or else the first
    /// record.
    pub fn zero(&self) -> protocols::Instant {
        let first = || self.records.iter().map(|record| record.at).min();
        let own = self.sections.first().and_then(Section::zero);
        own.or_else(first).unwrap_or_default()
    }

    /// Reads `bytes` up to the first error.
    pub fn of(bytes: &[u8]) -> Self {
        let (mut capture, mut reader) = (Self::default(), Reader::default());
        capture.feed(&mut reader, bytes);
        capture.end(&reader);
        capture
    }

    /// Reads a file up to the first error.
    pub fn read(path: &Path) -> io::Result<Self> {
        let (mut capture, mut reader) = (Self::default(), Reader::default());
        let mut file = File::open(path)?;
        let mut piece = vec![0; 1 << 16];
        loop {
            let len = file.read(&mut piece)?;
            if len == 0 {
                break;
            }
            capture.feed(&mut reader, &piece[..len]);
        }
        capture.end(&reader);
        Ok(capture)
    }

    /// Reads the whole recording to which a file belongs. The numbers of the records decide which
    /// files before and after this one belong to the recording. Returns the number of these files,
    /// too.
    pub fn read_recording(path: &Path) -> io::Result<(Self, usize)> {
        let (mut whole, mut files) = (Self::read(path)?, 1);
        let (paths, place) = files::around(path);
        for path in paths[..place].iter().rev() {
            let Some(mut before) = Self::read(path).ok().filter(|one| one.leads_to(&whole)) else {
                break;
            };
            before.go_on(whole);
            (whole, files) = (before, files + 1);
        }
        for path in &paths[place + 1..] {
            let Some(after) = Self::read(path).ok().filter(|one| whole.leads_to(one)) else {
                break;
            };
            whole.go_on(after);
            files += 1;
        }
        Ok((whole, files))
    }

    /// Whether `next` is the next file of the same recording.
    fn leads_to(&self, next: &Self) -> bool {
        let last = self.records.last().and_then(|record| record.sequence);
        let first = next.records.first().and_then(|record| record.sequence);
        // A damaged file may hold any number.
        let follows = first.is_some() && first == last.and_then(|last| last.checked_add(1));
        follows && self.sections == next.sections && self.links == next.links
    }

    fn go_on(&mut self, next: Self) {
        self.records.extend(next.records);
        self.skipped += next.skipped;
        (self.broken, self.cut) = (next.broken, next.cut);
        self.conclusion = next.conclusion;
    }

    fn feed(&mut self, reader: &mut Reader, bytes: &[u8]) {
        reader.push(bytes);
        while let Some(item) = reader.next_item() {
            match item {
                Ok(Item::Section(section)) => self.sections.push(section),
                Ok(Item::Interface(interface)) => self.links.push(interface),
                Ok(Item::Record(record)) => self.records.push(record),
                Err(error) => self.broken = Some(error),
            }
        }
    }

    fn end(&mut self, reader: &Reader) {
        self.cut = reader.pending();
        self.skipped = reader.skipped() + reader.senseless();
        self.conclusion = reader.conclusion().cloned();
    }
}

#[cfg(test)]
mod tests;
