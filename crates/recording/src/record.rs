//! Sections, links and records of a capture, and their blocks.
//!
//! A packet is a header of twelve bytes as Wireshark's `rtacser` reads it, then the payload:
//!
//! ```text
//! | seconds 4 | microseconds 4 | event 1 | control lines 1 | 0 0 | payload |   (big-endian)
//! ```

use bytes::Bytes;
use protocols::{Instant, LineConfig, LineEvent};

use crate::pcapng::{self, Block, Order};
use engine::rig::line::Direction;

/// Link type "RTAC serial".
pub(crate) const LINK_TYPE: u16 = 250;
/// Enterprise number of private options; RFC 5612 reserves this one for examples.
pub(super) const ENTERPRISE: u32 = 32_473;
/// Mark of the private option with the sequence number.
const SEQUENCE: &[u8; 4] = b"hseq";
const SEQUENCE_HEAD: [u8; 12] = [0xAD, 0x0B, 16, 0, 0xD9, 0x7E, 0, 0, b'h', b's', b'e', b'q'];
/// Mark of the private option with the bytes as sent.
const SENT: &[u8; 4] = b"hsnt";
/// Mark of the private option with the lengths of joined chunks.
const PIECES: &[u8; 4] = b"hpcs";
/// Mark of the private option with the scenario.
const SCENARIO: &[u8; 4] = b"hscn";
/// Maximum length of a part of a long option value: an option holds less than 64 KiB.
const OPTION_PIECE: usize = 60_000;
/// Length of the header before the payload of a packet.
const HEADER_LEN: usize = 12;

/// Description of a capture, from its section header.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Section {
    /// Tool and version.
    pub tool: String,
    /// Facts as `key=value`, e.g. `seed=1`; one a line.
    pub about: String,
    /// The scenario of the run as TOML, from which a replay knows the robot; empty without
    /// scenario.
    pub scenario: String,
}

impl Section {
    /// Returns the value of the fact `key`.
    pub fn fact(&self, key: &str) -> Option<&str> {
        let mut facts = self.about.lines().filter_map(|line| line.split_once('='));
        facts.find(|(name, _)| *name == key).map(|(_, value)| value)
    }

    /// Appends the section header block.
    pub fn write(&self, out: &mut Vec<u8>) {
        pcapng::write_block(out, pcapng::SECTION, |out| {
            pcapng::write_section_head(out);
            pcapng::write_option(out, pcapng::COMMENT, self.about.as_bytes());
            pcapng::write_option(out, USER_APPLICATION, self.tool.as_bytes());
            for piece in self.scenario.as_bytes().chunks(OPTION_PIECE) {
                write_private(out, SCENARIO, [piece, &[]]);
            }
            pcapng::write_options_end(out);
        });
    }

    /// Whether the recorded client ran inside this process. Imported logs may have its clock, too.
    pub fn is_of_own_program(&self) -> bool {
        self.fact("clock") == Some("virtual") && matches!(self.fact("imported"), None | Some("csv"))
    }

    /// Time of the beginning of the run: zero in virtual time; UTC since 1970 in real time.
    pub fn start(&self) -> Instant {
        let nanos = self.fact("start_ns").and_then(|nanos| nanos.parse().ok());
        Instant::from_nanos(nanos.unwrap_or(0))
    }

    pub(super) fn read(block: &Block) -> Self {
        let mut section = Self::default();
        let options = block.body.get(16..).unwrap_or_default();
        let mut scenario = Vec::new();
        for (code, value) in pcapng::options(block.order, options) {
            match code {
                pcapng::COMMENT => section.about = text(value),
                USER_APPLICATION => section.tool = text(value),
                pcapng::CUSTOM if is_private(block.order, value, SCENARIO) => {
                    scenario.extend_from_slice(&value[8..]);
                }
                _ => {}
            }
        }
        section.scenario = text(&scenario);
        section
    }
}

const USER_APPLICATION: u16 = 4;
const NAME: u16 = 2;
const SPEED: u16 = 8;
const RESOLUTION: u16 = 9;
const FLAGS: u16 = 2;

/// One link of a capture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Name of the link.
    pub name: String,
    /// Bits per second; zero if the file has no rate.
    pub baud: u32,
    pub(super) link_type: u16,
    pub(super) resolution: u8,
}

impl Interface {
    /// A link of this tool.
    pub fn new(name: &str, baud: u32) -> Self {
        Self {
            name: name.to_owned(),
            baud,
            link_type: LINK_TYPE,
            resolution: 9,
        }
    }

    /// Whether the packets of this interface use the serial format of this tool.
    pub fn is_serial(&self) -> bool {
        self.link_type == LINK_TYPE
    }

    /// Appends the interface description block.
    pub fn write(&self, out: &mut Vec<u8>) {
        pcapng::write_block(out, pcapng::INTERFACE, |out| {
            out.extend_from_slice(&LINK_TYPE.to_le_bytes());
            out.extend_from_slice(&[0; 6]);
            pcapng::write_option(out, NAME, self.name.as_bytes());
            pcapng::write_option(out, SPEED, &u64::from(self.baud).to_le_bytes());
            pcapng::write_option(out, RESOLUTION, &[9]);
            pcapng::write_options_end(out);
        });
    }

    pub(super) fn read(block: &Block) -> Option<Self> {
        let mut interface = Self {
            name: String::new(),
            baud: 0,
            link_type: block.order.u16_at(&block.body, 0)?,
            resolution: 6,
        };
        for (code, value) in pcapng::options(block.order, block.body.get(8..)?) {
            match (code, value) {
                (NAME, name) => interface.name = text(name),
                (SPEED, &[a, b, c, d, e, f, g, h]) => {
                    let speed = block.order.u64([a, b, c, d, e, f, g, h]);
                    interface.baud = u32::try_from(speed).unwrap_or(u32::MAX);
                }
                (RESOLUTION, &[resolution]) => interface.resolution = resolution,
                _ => {}
            }
        }
        Some(interface)
    }

    /// Converts a time in units of this interface; returns the maximum time on overflow.
    fn instant(&self, units: u64) -> Instant {
        let exponent = u32::from(self.resolution & 0x7F);
        let base: u128 = if self.resolution & 0x80 == 0 { 10 } else { 2 };
        let per_second = base.checked_pow(exponent).unwrap_or(u128::MAX);
        let nanos = u128::from(units).saturating_mul(1_000_000_000) / per_second;
        Instant::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
    }
}

/// Kind of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Bytes arrived, or were lost on the line.
    Data,
    /// The line reported an event besides bytes.
    Line(LineEvent),
    /// An event number that the lines of this tool do not have.
    Other(u8),
}

impl Kind {
    fn number(self, direction: Direction) -> u8 {
        match self {
            Self::Data if direction == Direction::ToDevice => 1,
            Self::Data => 2,
            Self::Line(LineEvent::Opened | LineEvent::Closed) => 0,
            Self::Line(LineEvent::FramingError) => 7,
            Self::Line(LineEvent::ParityError) => 8,
            Self::Line(LineEvent::Break) => 9,
            Self::Line(LineEvent::Overrun) => 10,
            Self::Other(number) => number,
        }
    }

    /// Control lines of a record: only an open port raises one, data terminal ready (DTR).
    const fn control_lines(self) -> u8 {
        match self {
            Self::Line(LineEvent::Closed) => 0,
            _ => 0x10,
        }
    }

    const fn read(number: u8, control_lines: u8) -> Self {
        match number {
            1..=4 => Self::Data,
            0 if control_lines & 0x10 == 0 => Self::Line(LineEvent::Closed),
            0 => Self::Line(LineEvent::Opened),
            7 => Self::Line(LineEvent::FramingError),
            8 => Self::Line(LineEvent::ParityError),
            9 => Self::Line(LineEvent::Break),
            10 => Self::Line(LineEvent::Overrun),
            other => Self::Other(other),
        }
    }
}

/// Bytes as they left the sender, if the line changed or delayed them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sent {
    /// Time at which the last bit was sent.
    pub at: Instant,
    /// The bytes.
    pub bytes: Bytes,
}

/// One event on one direction of one link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// Index of the link among all links of the file.
    pub link: usize,
    /// Number of the record in the whole run, if the file contains it.
    pub sequence: Option<u64>,
    /// Time of arrival at the receiver.
    pub at: Instant,
    /// Direction.
    pub direction: Direction,
    /// Its kind.
    pub kind: Kind,
    /// The bytes as received.
    pub bytes: Bytes,
    /// The bytes as sent, if they differ from the received ones or left earlier.
    pub sent: Option<Sent>,
    /// Lengths of the chunks in which the bytes reached the receiver; empty for one chunk. The
    /// chunks arrived back to back, the last complete at [`at`](Self::at). With the baud rate,
    /// these lengths give the arrival time of each chunk to the nanosecond, which a replay needs.
    pub pieces: Vec<u8>,
    /// Comments on the record, e.g. which fault struck.
    pub comment: String,
}

impl Record {
    /// The chunks that reached the receiver, each with the time of its last byte. `line` is the
    /// configuration of the link. A record without bytes has no chunks.
    pub fn chunks(&self, line: LineConfig) -> Vec<(Instant, &[u8])> {
        let mut end = self.bytes.len();
        let mut at = self.at;
        let mut chunks = Vec::new();
        for &len in self.pieces.iter().rev() {
            let start = end.saturating_sub(usize::from(len));
            if start > 0 {
                chunks.push((at, &self.bytes[start..end]));
                if line.baud > 0 {
                    at = line.byte_end(at, len.into());
                }
                end = start;
            }
        }
        if end > 0 {
            chunks.push((at, &self.bytes[..end]));
        }
        chunks.reverse();
        chunks
    }

    /// Appends the packet block; `interface` is the number of the link in the section.
    pub fn write(&self, interface: u32, out: &mut Vec<u8>) {
        let packet = Packet {
            interface,
            at: self.at,
            direction: self.direction,
            kind: self.kind,
            bytes: &self.bytes,
            sequence: self.sequence,
            sent: self.sent.as_ref().map(|sent| (sent.at, &sent.bytes[..])),
            pieces: &runs(&self.pieces),
            comment: &self.comment,
        };
        packet.write(out);
    }

    /// Reads the record of a packet block. `links` are the links of its section, `first` is the
    /// index of the first of them. `None` if the block is invalid.
    pub(super) fn read(block: &Block, links: &[Interface], first: usize) -> Option<Self> {
        let (order, body) = (block.order, &block.body);
        let index = usize::try_from(order.u32_at(body, 0)?).ok()?;
        let interface = links.get(index)?;
        let [high, low] = [order.u32_at(body, 4)?, order.u32_at(body, 8)?].map(u64::from);
        let len = usize::try_from(order.u32_at(body, 12)?).ok()?;
        let packet = body.get(20..20_usize.checked_add(len)?)?;
        if interface.link_type != LINK_TYPE || packet.len() < HEADER_LEN {
            return None;
        }
        let (header, payload) = packet.split_at(HEADER_LEN);
        let outbound = matches!(header[8], 1 | 3);
        let mut record = Self {
            link: first + index,
            sequence: None,
            at: interface.instant(high << 32 | low),
            direction: direction(outbound),
            kind: Kind::read(header[8], header[9]),
            bytes: body.slice_ref(payload),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        let options = body.get(20 + pcapng::padded(len)..).unwrap_or_default();
        pcapng::options(order, options).for_each(|option| record.read_option(block, option));
        Some(record)
    }

    fn read_option(&mut self, block: &Block, (code, value): (u16, &[u8])) {
        let order = block.order;
        match code {
            pcapng::COMMENT if self.comment.is_empty() => self.comment = text(value),
            pcapng::COMMENT => {
                self.comment.push('\n');
                self.comment.push_str(&text(value));
            }
            FLAGS => match order.u32_at(value, 0).map(|flags| flags & 3) {
                Some(1) => self.direction = direction(false),
                Some(2) => self.direction = direction(true),
                _ => {}
            },
            pcapng::CUSTOM if order.u32_at(value, 0) == Some(ENTERPRISE) => {
                let Some(mark) = value.get(4..8) else {
                    return;
                };
                if mark == PIECES {
                    self.pieces = lengths(&value[8..], self.bytes.len());
                    return;
                }
                let Some(number) = value.get(8..16) else {
                    return;
                };
                let number = u64::from_le_bytes(number.try_into().expect("eight bytes"));
                if mark == SEQUENCE {
                    self.sequence = Some(number);
                } else if mark == SENT {
                    let (at, bytes) = (
                        Instant::from_nanos(number),
                        block.body.slice_ref(&value[16..]),
                    );
                    self.sent = Some(Sent { at, bytes });
                }
            }
            _ => {}
        }
    }
}

/// A record whose bytes are stored elsewhere, so that it is written without a copy.
#[derive(Clone, Copy, Debug)]
pub(super) struct Packet<'a> {
    pub(super) interface: u32,
    pub(super) at: Instant,
    pub(super) direction: Direction,
    pub(super) kind: Kind,
    pub(super) bytes: &'a [u8],
    pub(super) sequence: Option<u64>,
    pub(super) sent: Option<(Instant, &'a [u8])>,
    /// Lengths of its chunks as pairs of length and count; empty for one chunk.
    pub(super) pieces: &'a [u8],
    pub(super) comment: &'a str,
}

impl Packet<'_> {
    /// Appends the packet block. The fixed parts are built in arrays and copied at once, because
    /// this function dominates the cost of a capture.
    pub(super) fn write(&self, out: &mut Vec<u8>) {
        let start = out.len();
        out.extend_from_slice(&self.head());
        out.extend_from_slice(self.bytes);
        pcapng::pad(out, start);
        if !self.comment.is_empty() {
            pcapng::write_option(out, pcapng::COMMENT, self.comment.as_bytes());
        }
        let flags = match self.direction {
            Direction::ToMaster => 1,
            Direction::ToDevice => 2,
        };
        let flags = [2, 0, 4, 0, flags, 0, 0, 0];
        match self.sequence {
            Some(sequence) => {
                let mut both = [0; 8 + SEQUENCE_HEAD.len() + 8];
                both[..8].copy_from_slice(&flags);
                both[8..20].copy_from_slice(&SEQUENCE_HEAD);
                both[20..].copy_from_slice(&sequence.to_le_bytes());
                out.extend_from_slice(&both);
            }
            None => out.extend_from_slice(&flags),
        }
        if !self.pieces.is_empty() {
            write_private(out, PIECES, [self.pieces, &[]]);
        }
        if let Some((at, bytes)) = self.sent {
            let at = at.as_nanos().to_le_bytes();
            write_private(out, SENT, [at.as_slice(), bytes]);
        }
        let length = u32::try_from(out.len() + 8 - start).expect("chunks are short");
        out[start + 4..start + 8].copy_from_slice(&length.to_le_bytes());
        // The end mark of the options, and the repeated length.
        let [a, b, c, d] = length.to_le_bytes();
        out.extend_from_slice(&[0, 0, 0, 0, a, b, c, d]);
    }

    /// Block type, space for the length, packet header, and header of the link type.
    fn head(&self) -> [u8; 28 + HEADER_LEN] {
        let nanos = self.at.as_nanos();
        let half = |part: u64| u32::try_from(part & 0xFFFF_FFFF).expect("masked");
        let len = u32::try_from(HEADER_LEN + self.bytes.len()).expect("chunks are short");
        let mut head = [0; 28 + HEADER_LEN];
        let numbers = [
            pcapng::PACKET,
            0,
            self.interface,
            half(nanos >> 32),
            half(nanos),
            len,
            len,
        ];
        let (words, _) = head.as_chunks_mut();
        for (word, number) in words.iter_mut().zip(numbers) {
            *word = number.to_le_bytes();
        }
        words[7] = half(nanos / 1_000_000_000).to_be_bytes();
        words[8] = half(nanos / 1_000 % 1_000_000).to_be_bytes();
        head[36] = self.kind.number(self.direction);
        head[37] = self.kind.control_lines();
        head
    }
}

/// Encodes lengths as pairs of a length and its repetition count.
fn runs(lengths: &[u8]) -> Vec<u8> {
    let mut runs: Vec<u8> = Vec::new();
    for &length in lengths {
        match runs.last_chunk_mut() {
            Some([last, count]) if *last == length && *count < u8::MAX => *count += 1,
            _ => runs.extend([length, 1]),
        }
    }
    runs
}

/// Decodes `runs` if the lengths add up to `total` bytes; otherwise returns an empty list.
fn lengths(runs: &[u8], total: usize) -> Vec<u8> {
    let (pairs, _) = runs.as_chunks();
    let sum: usize = pairs
        .iter()
        .map(|&[length, count]| usize::from(length) * usize::from(count))
        .sum();
    if sum != total {
        return Vec::new();
    }
    let lengths = pairs
        .iter()
        .flat_map(|&[length, count]| core::iter::repeat_n(length, usize::from(count)));
    lengths.filter(|&length| length > 0).collect()
}

const fn direction(outbound: bool) -> Direction {
    if outbound {
        Direction::ToDevice
    } else {
        Direction::ToMaster
    }
}

/// Whether a private option belongs to this tool and has this mark.
fn is_private(order: Order, value: &[u8], mark: &[u8; 4]) -> bool {
    order.u32_at(value, 0) == Some(ENTERPRISE) && value.get(4..8) == Some(mark)
}

fn write_private(out: &mut Vec<u8>, mark: &[u8; 4], parts: [&[u8]; 2]) {
    let len = 8 + parts[0].len() + parts[1].len();
    let len = u16::try_from(len).expect("chunks are short");
    out.extend_from_slice(&pcapng::CUSTOM.to_le_bytes());
    out.extend_from_slice(&len.to_le_bytes());
    let start = out.len();
    out.extend_from_slice(&ENTERPRISE.to_le_bytes());
    out.extend_from_slice(mark);
    parts.iter().for_each(|part| out.extend_from_slice(part));
    pcapng::pad(out, start);
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[cfg(test)]
mod tests;
