use protocols::Instant;

use crate::shrink;
use capture::{Capture, Interface, Kind, Record};
use engine::rig::line::Direction;

/// The capture of a bench, if it is recorded.
#[derive(Clone, Debug, Default)]
pub(super) struct Tape {
    records: Option<Vec<Record>>,
}

impl Tape {
    /// A tape that records.
    pub(super) const fn recording() -> Self {
        Self {
            records: Some(Vec::new()),
        }
    }

    /// Records bytes on the port with this number.
    pub(super) fn note(&mut self, port: usize, at: Instant, direction: Direction, bytes: &[u8]) {
        let Some(records) = &mut self.records else {
            return;
        };
        if bytes.is_empty() {
            return;
        }
        records.push(Record {
            link: port,
            sequence: Some(records.len() as u64),
            at,
            direction,
            kind: Kind::Data,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        });
    }

    /// The bytes of a capture file.
    pub(super) fn into_capture(self, ports: &[(&str, u32)]) -> Vec<u8> {
        let links = ports.iter().map(|(name, baud)| Interface::new(name, *baud));
        shrink::to_bytes(&Capture {
            links: links.collect(),
            records: self.records.unwrap_or_default(),
            ..Capture::default()
        })
    }
}
