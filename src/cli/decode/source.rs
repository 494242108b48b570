//! The input of `decode`: a capture, or raw bytes in the form of a capture.

use std::path::Path;

use protocols::{Instant, LineEvent};

use super::CliError;
use crate::capture::decode::transcript::Known;
use crate::capture::import::{self, Format, Imported, Options};
use crate::capture::{Capture, Interface, Kind, Record, replay};
use crate::codec::RegisterNames;
use crate::rig::line::Direction;
use crate::run::Run;
use crate::scenario::Scenario;

/// The first bytes of a capture.
pub(in crate::cli) const PCAPNG: [u8; 4] = [0x0A, 0x0D, 0x0D, 0x0A];

/// A file, read up to its end or to the first damage.
pub(in crate::cli) struct Source {
    pub(in crate::cli) capture: Capture,
    /// Start of its times; none if it has no times.
    pub(in crate::cli) start: Option<Instant>,
}

impl Source {
    /// Reads a capture, a file of another tool, or raw bytes; `format` forces one of the forms of
    /// `hilrig import`.
    pub(in crate::cli) fn read(path: &Path, format: Option<Format>) -> Result<Self, CliError> {
        let name = path.display();
        let bytes = crate::cli::read(path)?;
        if format == Some(Format::Raw) {
            return Ok(Self::raw(bytes));
        }
        if !bytes.starts_with(&PCAPNG) || format.is_some_and(|format| format != Format::Pcap) {
            return Self::of_dump(bytes, path, format);
        }
        let capture = Capture::of(&bytes);
        // Packets with the link type of another tool are imported, or rejected with a message.
        if capture.links.iter().any(|link| !link.is_serial()) {
            return Self::of_dump(bytes, path, Some(Format::Pcap));
        }
        if let Some(error) = capture.broken {
            eprintln!("{name} is broken {error}; the part before the error follows");
        } else if capture.cut > 0 {
            let cut = capture.cut;
            eprintln!("{name} was cut: {cut} bytes at its end are not a complete block");
        }
        let start = Some(capture.zero());
        Ok(Self { capture, start })
    }

    /// Reads a file of another tool like `hilrig import`; raw bytes if no format is recognised.
    fn of_dump(bytes: Vec<u8>, path: &Path, format: Option<Format>) -> Result<Self, CliError> {
        let wrong = |error: import::ImportError| {
            let raw = "if these are the bytes of the line themselves: --format raw";
            CliError::content(path, format!("{error}\n{raw}"))
        };
        let opened = match format {
            Some(_) => import::unpacked(&bytes).map_err(wrong)?,
            None => import::open(&bytes, path).map_err(wrong)?,
        };
        let certain = opened.format.filter(|_| opened.is_certain);
        let Some(format) = format.or(certain) else {
            // The bytes of the line are kept unchanged, even if they look like encoded text.
            let content = match opened.notes.is_empty() {
                true => bytes.clone(),
                false => opened.bytes.into_owned(),
            };
            return Ok(Self::raw(content));
        };
        let imported = import::read(&opened.bytes, format, &Options::default()).map_err(wrong)?;
        let (path, form) = (path.display(), format.name());
        eprintln!("{path} is read as {form}; --format raw reads its bytes as they are");
        let notes = opened.notes.iter().chain(&imported.notes);
        notes.for_each(|note| eprintln!("{note}"));
        Ok(Self::imported(&imported, format))
    }

    fn imported(imported: &Imported, format: Format) -> Self {
        let capture = Capture::of(&imported.to_pcapng(format));
        Self {
            start: imported.is_timed().then(|| capture.zero()),
            capture,
        }
    }

    /// Formats and register names of the links, from the scenario in the capture. Empty without a
    /// scenario, or if it cannot be set up any more.
    pub(in crate::cli) fn known(&self, path: &Path) -> Vec<Known> {
        let Ok(Some((scenario, source))) = replay::scenario_of(&self.capture, path) else {
            return Vec::new();
        };
        let names: Vec<(String, RegisterNames)> = registers(&scenario);
        let run = Run::new(scenario, &source, None).ok();
        let mut known = Vec::new();
        for link in &self.capture.links {
            for direction in [Direction::ToMaster, Direction::ToDevice] {
                let codec = run.as_ref().and_then(|run| {
                    let instruments = run.instruments();
                    instruments.codec_towards(&run.rig, &link.name, direction)
                });
                let own = names.iter().find(|(name, _)| *name == link.name);
                known.push(Known {
                    link: link.name.clone(),
                    direction,
                    codec,
                    names: own.map(|(_, names)| names.clone()),
                });
            }
        }
        known
    }

    /// Bytes without times, as a capture of one link.
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

/// The registers of a scenario's described slaves, by link name.
fn registers(scenario: &Scenario) -> Vec<(String, RegisterNames)> {
    let own = scenario.device.iter();
    let own = own.filter_map(|(name, spec)| Some((name.clone(), spec.register_names()?)));
    own.collect()
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

/// One direction of a link, with all its bytes.
pub(in crate::cli) struct Lane {
    pub(in crate::cli) link: usize,
    pub(in crate::cli) direction: Direction,
    link_name: String,
    pub(in crate::cli) name: String,
    pub(in crate::cli) bytes: Vec<u8>,
    pub(in crate::cli) framing_errors: u64,
}

impl Lane {
    /// Whether this is the named direction of the named link.
    pub(in crate::cli) fn is_of(&self, link: &str, direction: Direction) -> bool {
        self.link_name == link && self.direction == direction
    }

    pub(in crate::cli) fn is_opposite(&self, other: &Self) -> bool {
        self.link == other.link && self.direction != other.direction
    }
}

/// All directions with bytes, of links called `wanted`.
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
                link_name: interface.name.clone(),
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
                // One record may represent several characters; its comment contains their number.
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
