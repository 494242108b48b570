//! Files of other tools, as attached to reports: imported with the right bytes, directions and
//! times, or refused with the next step.
//!
//! The files of `made` are made by the tools themselves where they are installed. Those of `known`
//! are written here, a few lines each, after the tools' documentation or their users' reports.

mod known;
mod made;
mod refused;

use std::path::Path;

use engine::rig::line::Direction;
use hilrig_capture::Kind;
use hilrig_capture::import::{self, Format, Options};

/// A read of two registers by Modbus RTU, and its answer; CRCs from an independent implementation.
pub(crate) const ASK: [u8; 8] = [0x01, 0x03, 0x00, 0x00, 0x00, 0x02, 0xC4, 0x0B];
pub(crate) const ANSWER: [u8; 9] = [0x01, 0x03, 0x04, 0x00, 0x06, 0x00, 0x05, 0xDA, 0x31];

/// A conversation: the bytes, and whether the host sent them; neighbours of one direction are
/// joined.
pub(crate) type Told = Vec<(bool, Vec<u8>)>;

/// An import: its format, conversation, times and rate.
#[derive(Debug)]
pub(crate) struct Import {
    pub(crate) format: Format,
    pub(crate) told: Told,
    /// Time of each record, nanoseconds.
    pub(crate) times: Vec<u64>,
    pub(crate) bauds: Vec<u32>,
}

/// Imports a file as the command does.
pub(crate) fn imported(bytes: &[u8], name: &str, options: &Options) -> Result<Import, String> {
    let opened = import::open(bytes, Path::new(name)).map_err(|error| error.to_string())?;
    let format = opened
        .format
        .ok_or_else(|| import::looked_for(&opened.bytes))?;
    let found = import::read(&opened.bytes, format, options).map_err(|error| error.to_string())?;
    let mut told: Told = Vec::new();
    let data = || found.records().iter().filter(|one| one.kind == Kind::Data);
    for one in data() {
        let is_sent = one.direction == Direction::ToDevice;
        match told.last_mut().filter(|last| last.0 == is_sent) {
            Some(last) => last.1.extend_from_slice(&one.bytes),
            None => told.push((is_sent, one.bytes.to_vec())),
        }
    }
    Ok(Import {
        format,
        told,
        times: data().map(|one| one.at.as_nanos()).collect(),
        bauds: found.links().iter().map(|link| link.baud).collect(),
    })
}

/// Both messages with their directions.
pub(crate) fn conversation() -> Told {
    vec![(true, ASK.to_vec()), (false, ANSWER.to_vec())]
}

/// Bytes from the device alone.
pub(crate) fn received(bytes: &[u8]) -> Told {
    vec![(false, bytes.to_vec())]
}
