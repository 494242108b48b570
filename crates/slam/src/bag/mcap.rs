//! MCAP files: records of a length each, many of them in chunks, which may be compressed.
//!
//! ```text
//! | magic | opcode u8, length u64, body | .. | footer | magic |           little-endian
//! chunk: | start u64 | end u64 | size u64 | crc u32 | compression | length u64 | records |
//! ```
//!
//! The frames are ours, so that of a file that is cut or damaged all else is read; the library
//! reads what is in them.

mod lengths;

use core::panic::AssertUnwindSafe;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::panic::catch_unwind;

use ::mcap::parse_record;
use ::mcap::records::Record;
use crc::{CRC_32_ISO_HDLC, Crc, Table};
use protocols::Instant;

use super::unpack::{self, BYTES_MAX, Unpacked};
use super::{Contents, Meaning};
use crate::finding::Kind;
use capture::replay::Passage;
use engine::rig::line::Direction;

/// With this every file begins and ends.
pub const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Opcodes of records that are more than their content.
const FOOTER: u8 = 0x02;
const CHUNK: u8 = 0x06;

static CRC_32: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

/// Reads a file, as far as it is sound.
pub fn read(bytes: &[u8]) -> Contents {
    let mut contents = Contents::default();
    read_into(&mut contents, bytes);
    contents.sort();
    contents
}

/// Adds what a file holds.
pub fn read_into(contents: &mut Contents, bytes: &[u8]) {
    let mut reader = Reader {
        contents,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
    };
    // The library computes with lengths that a damaged file names, and may run over.
    if catch_unwind(AssertUnwindSafe(|| reader.file(bytes))).is_err() {
        let what = format_args!("lengths that make no sense");
        let place = format_args!("the rest");
        reader.contents.findings.add(Kind::Unreadable, place, what);
    }
}

impl Contents {
    /// The link whose bytes towards the master a topic of ours has.
    fn link(&mut self, topic: &str, baud: Option<&String>) -> Option<usize> {
        let (link, direction) = topic.strip_prefix('/')?.rsplit_once('/')?;
        if direction != Direction::ToMaster.name() {
            return None;
        }
        let links = &mut self.recorded.links;
        let known = links.iter().position(|one| one.link == link);
        Some(known.unwrap_or_else(|| {
            links.push(Passage {
                link: link.to_owned(),
                baud: baud.and_then(|baud| baud.parse().ok()).unwrap_or(0),
                ..Passage::default()
            });
            links.len() - 1
        }))
    }
}

/// What is known so far of a file.
struct Reader<'a> {
    contents: &'a mut Contents,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, (String, Meaning)>,
}

/// Where records stand; there is no chunk in a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    File,
    Chunk,
}

/// How a row of records ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// Behind its last record.
    Whole,
    /// With the footer.
    Footer,
    /// In the middle of a record.
    Cut,
    /// In a damaged part, which is told.
    Told,
}

impl Reader<'_> {
    fn file(&mut self, bytes: &[u8]) {
        let rest = bytes.strip_prefix(MAGIC).unwrap_or_default();
        let end = self.records(rest, bytes.len() - rest.len(), Level::File);
        if matches!(end, End::Whole | End::Cut) {
            let place = format_args!("byte {}", bytes.len());
            let what = format_args!("the file ended in the middle, without a footer");
            self.contents.findings.add(Kind::Cut, place, what);
        }
    }

    /// Takes record after record; the first begins at byte `at` of the file.
    fn records(&mut self, mut rest: &[u8], mut at: usize, level: Level) -> End {
        loop {
            let Some((&[opcode, ref length @ ..], body)) = rest.split_first_chunk::<9>() else {
                return if rest.is_empty() {
                    End::Whole
                } else {
                    End::Cut
                };
            };
            let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
            let is_whole = length <= body.len();
            let (body, behind) = body.split_at(length.min(body.len()));
            if opcode == CHUNK && level == Level::File {
                let end = self.chunk(body, at, is_whole);
                if !is_whole {
                    return end;
                }
            } else if !is_whole {
                return End::Cut;
            } else if opcode == 0 {
                self.unreadable(at, "no record begins with 0");
                return End::Told;
            } else if !lengths::fit(opcode, body) {
                self.unreadable(at, "a length in it is beyond its end");
            } else {
                match parse_record(opcode, body) {
                    Ok(record) => self.take(record),
                    Err(error) => self.unreadable(at, &error.to_string()),
                }
            }
            if opcode == FOOTER {
                return End::Footer;
            }
            at += 9 + length;
            rest = behind;
        }
    }

    fn unreadable(&mut self, at: usize, what: &str) {
        let place = format_args!("record at byte {at}");
        let findings = &mut self.contents.findings;
        findings.add(Kind::Unreadable, place, format_args!("{what}"));
    }

    /// Takes the records of a chunk, which begins at byte `at` and is whole unless the file ends
    /// in it.
    fn chunk(&mut self, body: &[u8], at: usize, is_whole: bool) -> End {
        let Some(chunk) = Chunk::of(body) else {
            if is_whole {
                self.damaged(at, "ends in its header");
            }
            return End::Cut;
        };
        let records = match chunk.unpacked() {
            Ok(records) => records,
            Err(what) => {
                self.damaged(at, &what);
                return End::Told;
            }
        };
        let mut end = End::Whole;
        if let Some(what) = records.error.filter(|_| is_whole) {
            self.damaged(at, &what);
            end = End::Told;
        } else if is_whole && chunk.crc != 0 && chunk.crc != CRC_32.checksum(&records.bytes) {
            self.damaged(at, "its checksum is another");
            // In a compressed one a wrong bit spoils everything behind it.
            if !chunk.compression.is_empty() {
                return End::Told;
            }
            end = End::Told;
        }
        match self.records(&records.bytes, at, Level::Chunk) {
            End::Cut if is_whole && end == End::Whole => {
                self.damaged(at, "ends in the middle of a record");
                End::Told
            }
            End::Whole => end,
            other => other,
        }
    }

    fn damaged(&mut self, at: usize, what: &str) {
        let place = format_args!("chunk at byte {at}");
        let findings = &mut self.contents.findings;
        findings.add(Kind::Part, place, format_args!("{what}"));
    }

    fn take(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                if let Some(meaning) = self.meaning(&channel) {
                    self.channels.insert(channel.id, (channel.topic, meaning));
                }
            }
            Record::Message { header, data } => {
                if let Some((topic, meaning)) = self.channels.get(&header.channel_id) {
                    let logged = Instant::from_nanos(header.log_time);
                    self.contents.message(topic, *meaning, logged, &data);
                }
            }
            Record::Attachment { header, data, .. } if header.name == "scenario.toml" => {
                self.contents.scenario = String::from_utf8(data.into_owned()).ok();
            }
            _ => {}
        }
    }

    fn meaning(&mut self, channel: &::mcap::records::Channel) -> Option<Meaning> {
        if channel.message_encoding == "application/octet-stream" {
            let baud = channel.metadata.get("baud");
            return self.contents.link(&channel.topic, baud).map(Meaning::Bytes);
        }
        let schema = self.schemas.get(&channel.schema_id);
        Meaning::of(&channel.message_encoding, schema.map_or("", |name| name))
    }
}

/// A chunk as it is in the file, perhaps cut.
struct Chunk<'a> {
    /// Length of the records, unpacked, and their checksum, 0 if there is none.
    size: u64,
    crc: u32,
    compression: Cow<'a, str>,
    records: &'a [u8],
}

impl<'a> Chunk<'a> {
    fn of(body: &'a [u8]) -> Option<Self> {
        let (_, rest) = body.split_first_chunk::<16>()?;
        let (size, rest) = rest.split_first_chunk::<8>()?;
        let (crc, rest) = rest.split_first_chunk::<4>()?;
        let (name, rest) = rest.split_first_chunk::<4>()?;
        let name = usize::try_from(u32::from_le_bytes(*name)).ok()?;
        let (name, rest) = rest.split_at_checked(name)?;
        let (length, records) = rest.split_first_chunk::<8>()?;
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        Some(Self {
            size: u64::from_le_bytes(*size),
            crc: u32::from_le_bytes(*crc),
            compression: String::from_utf8_lossy(name),
            records: records.get(..length).unwrap_or(records),
        })
    }

    /// The records, as far as they can be unpacked.
    fn unpacked(&self) -> Result<Packed<'a>, String> {
        let size = self.size;
        if size > BYTES_MAX {
            return Err(format!("names {size} bytes, expected at most {BYTES_MAX}"));
        }
        let Unpacked { bytes, error } = match &*self.compression {
            "" => {
                return Ok(Packed {
                    bytes: Cow::Borrowed(self.records),
                    error: None,
                });
            }
            "zstd" => unpack::zstd(self.records, size),
            "lz4" => unpack::lz4(self.records, size),
            name => {
                let name: String = name.chars().take(20).collect();
                let name = name.escape_debug();
                return Err(format!(
                    "is compressed by {name}, expected zstd, lz4 or none: convert it with \
                     `mcap compress --compression zstd`"
                ));
            }
        };
        Ok(Packed {
            bytes: Cow::Owned(bytes),
            error,
        })
    }
}

/// Records, and why there are not more.
struct Packed<'a> {
    bytes: Cow<'a, [u8]>,
    error: Option<String>,
}
