//! MCAP files: records with a length, many of them in chunks, which may be compressed.
//!
//! ```text
//! | magic | opcode u8, length u64, body | .. | footer | magic |           little-endian
//! chunk: | start u64 | end u64 | size u64 | crc u32 | compression | length u64 | records |
//! ```
//!
//! The framing of records is our own code, so that the intact part of a truncated or damaged file
//! is read. The library parses the content of records.

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

/// First and last bytes of every file.
pub const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Opcodes of records with a special meaning.
const FOOTER: u8 = 0x02;
const CHUNK: u8 = 0x06;

static CRC_32: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

/// Reads a file, skipping damaged parts.
pub fn read(bytes: &[u8]) -> Contents {
    let mut contents = Contents::default();
    read_into(&mut contents, bytes);
    contents.sort();
    contents
}

/// Adds the content of a file.
pub fn read_into(contents: &mut Contents, bytes: &[u8]) {
    let mut reader = Reader {
        contents,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
    };
    // The library computes with lengths from the file and may panic if they are damaged.
    if catch_unwind(AssertUnwindSafe(|| reader.file(bytes))).is_err() {
        let what = format_args!("invalid lengths");
        let place = format_args!("the rest");
        reader.contents.findings.add(Kind::Unreadable, place, what);
    }
}

impl Contents {
    /// The index of the link for one of our own topics, if the topic contains the bytes of the link
    /// towards the master. A link that is not known yet is added.
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

/// The state of reading a file.
struct Reader<'a> {
    contents: &'a mut Contents,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, (String, Meaning)>,
}

/// The level of records; chunks do not contain chunks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    File,
    Chunk,
}

/// The reason why a sequence of records ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// After its last record.
    Whole,
    /// At the footer.
    Footer,
    /// Within a record.
    Cut,
    /// At a damaged part, which has been reported.
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

    /// Reads consecutive records; the first one begins at byte `at` of the file.
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

    /// Reads the records of a chunk that begins at byte `at`. `is_whole` is false if the file ends
    /// within the chunk.
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
            self.damaged(at, "its checksum does not match");
            // In a compressed chunk a wrong bit damages all bytes behind it.
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

/// A chunk of the file, possibly truncated.
struct Chunk<'a> {
    /// Uncompressed length of the records, and their checksum; 0: none.
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

    /// The uncompressed records, up to the first damage.
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

/// Records, and the reason why the rest is missing.
struct Packed<'a> {
    bytes: Cow<'a, [u8]>,
    error: Option<String>,
}
