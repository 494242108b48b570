//! Captures: every byte of a run with its nanosecond, its link and what befell it, in a file that
//! Wireshark opens.
//!
//! The form is pcapng with link type 250, one interface a link. Each record is one chunk as it
//! *reached its receiver*, or several that came back to back; where the line changed or delayed it,
//! the record also holds the bytes as sent, and a comment says in words what was done to them, so
//! that a capture explains itself.
//! Bytes on their way when the run ends were not received and are not in the file.

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
use pcapng::{Block, BlockError, Blocks};
pub use record::{Interface, Kind, Record, Section, Sent};

/// What comes next in a capture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Item {
    /// A section begins.
    Section(Section),
    /// A link is introduced; links are numbered in the order of these.
    Interface(Interface),
    /// Something happened.
    Record(Record),
}

/// Reads a capture from bytes fed in any pieces.
#[derive(Clone, Debug, Default)]
pub struct Reader {
    blocks: Blocks,
    links: Vec<Interface>,
    /// Index of the section's first link in all links of the file.
    first: usize,
    skipped: u64,
    senseless: u64,
    conclusion: Option<Conclusion>,
}

/// Maximum number of links of one section; further ones make no sense.
const LINKS_MAX: usize = 1024;

impl Reader {
    /// Reads more of the file.
    pub fn push(&mut self, bytes: &[u8]) {
        self.blocks.push(bytes);
    }

    /// The next item. `None` if more bytes are needed, or after an error, behind which nothing can
    /// be read.
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

    /// How the run ended, as far as it was read.
    pub const fn conclusion(&self) -> Option<&Conclusion> {
        self.conclusion.as_ref()
    }

    /// Bytes at the end that are no whole block.
    pub fn pending(&self) -> usize {
        self.blocks.pending()
    }

    /// Blocks of kinds that captures of ours do not have.
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Blocks of known kinds that made no sense: too short, of an unknown link, of another link
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
    /// Why reading stopped before the end, if it did.
    pub broken: Option<BlockError>,
    /// Bytes at the end that are no whole block: the file was cut there.
    pub cut: usize,
    /// Blocks that were skipped, because unknown or senseless.
    pub skipped: u64,
    /// How the run ended, if it is the capture of one that was judged.
    pub conclusion: Option<Conclusion>,
}

impl Capture {
    /// All that can be read of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        let (mut capture, mut reader) = (Self::default(), Reader::default());
        capture.feed(&mut reader, bytes);
        capture.end(&reader);
        capture
    }

    /// All that can be read of a file.
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

    /// All that can be read of the recording that a file is of: with what it put aside before this
    /// file and wrote after it, as the numbers of its records tell. Returns how many files those
    /// are, too.
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

    /// Whether `next` is what the same recording wrote next.
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
