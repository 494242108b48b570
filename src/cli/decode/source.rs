//! What is decoded: a capture, or raw bytes as if they were one.

use std::path::Path;

use protocols::{Instant, LineEvent};

use super::CliError;
use crate::capture::{Capture, Interface, Kind, Record};
use crate::rig::line::Direction;

/// How a capture begins.
pub(in crate::cli) const PCAPNG: [u8; 4] = [0x0A, 0x0D, 0x0D, 0x0A];

/// A file, read as far as it could be.
pub(in crate::cli) struct Source {
    pub(in crate::cli) capture: Capture,
    /// When its times begin; none if it has no times.
    pub(in crate::cli) start: Option<Instant>,
}

impl Source {
    pub(in crate::cli) fn read(path: &Path) -> Result<Self, CliError> {
        let name = path.display();
        let bytes = crate::cli::read(path)?;
        if !bytes.starts_with(&PCAPNG) {
            return Ok(Self::raw(bytes));
        }
        let capture = Capture::of(&bytes);
        if let Some(error) = capture.broken {
            eprintln!("{name} is broken {error}; what is before it follows");
        } else if capture.cut > 0 {
            let cut = capture.cut;
            eprintln!("{name} was cut: {cut} bytes at its end are no whole block");
        }
        let start = capture.sections.first().map(|section| section.start());
        let start = start.or(Some(Instant::ZERO));
        Ok(Self { capture, start })
    }

    /// Bytes without time, as a capture of one link.
    fn raw(bytes: Vec<u8>) -> Self {
        Self {
            capture: Capture {
                links: vec![raw_link()],
                records: vec![raw_record(bytes)],
                ..Capture::default()
            },
            start: None,
        }
    }

    /// An error if there is no link of that name.
    pub(in crate::cli) fn check_link(
        &self,
        wanted: Option<&str>,
        path: &Path,
    ) -> Result<(), CliError> {
        let Some(wanted) = wanted else { return Ok(()) };
        let names: Vec<&str> = self.capture.links.iter().map(|link| &*link.name).collect();
        if names.contains(&wanted) {
            return Ok(());
        }
        let (path, names) = (path.display(), names.join(", "));
        Err(CliError::Usage(format!(
            "--link {wanted}: {path} has no such link, only: {names}"
        )))
    }
}

pub(in crate::cli) fn raw_link() -> Interface {
    Interface::new("raw", 0)
}

pub(in crate::cli) fn raw_record(bytes: Vec<u8>) -> Record {
    Record {
        link: 0,
        sequence: None,
        at: Instant::ZERO,
        direction: Direction::ToMaster,
        kind: Kind::Data,
        bytes: bytes.into(),
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    }
}

/// One direction of a link, as a whole.
pub(in crate::cli) struct Lane {
    link: usize,
    direction: Direction,
    pub(in crate::cli) name: String,
    pub(in crate::cli) bytes: Vec<u8>,
    pub(in crate::cli) framing_errors: u64,
}

impl Lane {
    pub(in crate::cli) fn is_opposite(&self, other: &Self) -> bool {
        self.link == other.link && self.direction != other.direction
    }
}

/// All lanes that carried anything, of links whose name is `wanted`.
pub(in crate::cli) fn lanes(capture: &Capture, wanted: impl Fn(&str) -> bool) -> Vec<Lane> {
    let mut lanes: Vec<Lane> = Vec::new();
    for (link, interface) in capture.links.iter().enumerate() {
        if !wanted(&interface.name) {
            continue;
        }
        for direction in [Direction::ToMaster, Direction::ToDevice] {
            lanes.push(Lane {
                link,
                direction,
                name: format!("{} {}", interface.name, direction.name()),
                bytes: Vec::new(),
                framing_errors: 0,
            });
        }
    }
    for record in &capture.records {
        let is_own =
            |lane: &&mut Lane| (lane.link, lane.direction) == (record.link, record.direction);
        let Some(lane) = lanes.iter_mut().find(is_own) else {
            continue;
        };
        match record.kind {
            Kind::Data => lane.bytes.extend_from_slice(&record.bytes),
            Kind::Line(LineEvent::FramingError) => {
                // One record may stand for several characters, and says for how many.
                let count = record.comment.split(' ').next();
                let count = count.and_then(|count| count.parse().ok());
                lane.framing_errors += count.unwrap_or(1_u64).min(1 << 16);
            }
            _ => {}
        }
    }
    lanes.retain(|lane| !lane.bytes.is_empty() || lane.framing_errors > 0);
    lanes
}
