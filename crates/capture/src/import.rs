//! Dumps of other tools as captures.
//!
//! Each tool's form is read strictly: what does not fit is an error with its line and byte, since
//! a dump half understood would be a test of something that never happened.

mod jpnevulator;
mod raw;
mod saleae;
mod sigrok;
mod socat;
mod text;

use bytes::Bytes;
use protocols::{Instant, LineConfig};

use crate::{Interface, Kind, Record, Section};
use engine::TOOL;
use engine::rig::line::Direction;

/// Forms that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Format {
    /// Standard error of `socat -x -v`
    Socat,
    /// `jpnevulator --read --timing-print`, with or without its options
    Jpnevulator,
    /// `sigrok-cli -P uart:.. -A uart=rx-data`, best with --protocol-decoder-samplenum
    Sigrok,
    /// Saleae Logic, export of the serial analyzer or of Logic 2's table
    Saleae,
    /// The bytes alone: `tio --log-file` without -t, `socat -r`, a dump of a port
    Raw,
}

impl Format {
    /// Name as on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Socat => "socat",
            Self::Jpnevulator => "jpnevulator",
            Self::Sigrok => "sigrok",
            Self::Saleae => "saleae",
            Self::Raw => "raw",
        }
    }

    /// The form of a file, if its beginning shows one; raw bytes show none.
    pub fn detect(bytes: &[u8]) -> Option<Self> {
        let is = |found: bool, format: Self| found.then_some(format);
        let mut head = text::lines(bytes).take(LINES_LOOKED_AT);
        head.find_map(|line| {
            is(socat::is_head(line.text), Self::Socat)
                .or(is(jpnevulator::is_head(line.text), Self::Jpnevulator))
                .or(is(sigrok::is_data(line.text), Self::Sigrok))
                .or(is(saleae::is_head(line.text), Self::Saleae))
        })
    }
}

/// Diagnostics of a tool may come before its first line of data.
const LINES_LOOKED_AT: usize = 50;

/// What a dump does not say itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Name of the link.
    pub link: String,
    /// Bits per second, if known.
    pub baud: Option<u32>,
    /// Samples per second of a logic analyzer, if known.
    pub sample_rate: Option<u64>,
    /// Which way bytes went that the tool saw first: left to right, or received.
    pub direction: Direction,
}

impl Options {
    /// Time of a character, if the rate is known.
    fn byte_nanos(&self, count: usize) -> u64 {
        let line = self.baud.map(LineConfig::new_8n1);
        let took = line.map_or(0, |line| line.bytes_time(count as u64).as_nanos());
        u64::try_from(took).unwrap_or(u64::MAX)
    }
}

/// A dump cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line} (byte {offset}): {message}")]
pub struct ImportError {
    /// Line, from 1.
    pub line: usize,
    /// Where that line begins, in bytes from the start of the file.
    pub offset: usize,
    /// What is wrong, and what was expected.
    pub message: String,
}

/// A dump as a capture.
#[derive(Clone, Debug, Default)]
pub struct Imported {
    links: Vec<Interface>,
    records: Vec<Record>,
    /// What the reader should know, e.g. that times are local.
    pub notes: Vec<&'static str>,
    clock: &'static str,
}

impl Imported {
    /// The links.
    pub fn links(&self) -> &[Interface] {
        &self.links
    }

    /// All records in the order of the file.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// The capture as a file.
    pub fn to_pcapng(&self, format: Format) -> Vec<u8> {
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

    fn link(&mut self, name: &str, options: &Options) -> usize {
        if let Some(known) = self.links.iter().position(|link| link.name == name) {
            return known;
        }
        self.links
            .push(Interface::new(name, options.baud.unwrap_or(0)));
        self.links.len() - 1
    }

    fn push(&mut self, link: usize, nanos: u64, direction: Direction, kind: Kind, bytes: &[u8]) {
        let number = self.records.len() as u64;
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
}

/// Reads a dump of `format`.
///
/// # Errors
/// At the first line that does not fit, or if nothing was in it.
pub fn read(bytes: &[u8], format: Format, options: &Options) -> Result<Imported, ImportError> {
    let mut imported = Imported {
        clock: "utc",
        ..Imported::default()
    };
    match format {
        Format::Socat => socat::read(bytes, options, &mut imported)?,
        Format::Jpnevulator => jpnevulator::read(bytes, options, &mut imported)?,
        Format::Sigrok => sigrok::read(bytes, options, &mut imported)?,
        Format::Saleae => saleae::read(bytes, options, &mut imported)?,
        Format::Raw => raw::read(bytes, options, &mut imported)?,
    }
    if imported.records.is_empty() {
        return Err(ImportError {
            line: 1,
            offset: 0,
            message: format!(
                "expected bytes in the form of {}, found none",
                format.name()
            ),
        });
    }
    Ok(imported)
}

/// The other way.
const fn opposite(direction: Direction) -> Direction {
    match direction {
        Direction::ToMaster => Direction::ToDevice,
        Direction::ToDevice => Direction::ToMaster,
    }
}

const LOCAL: &str = "the tool wrote local times; they are taken as UTC";

#[cfg(test)]
mod tests;
