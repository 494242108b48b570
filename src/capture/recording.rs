//! Writes the capture of a run while it goes on.

use core::fmt::Write as _;
use std::io;
use std::path::Path;

use core::time::Duration;

use protocols::{Instant, LineEvent};

use super::files::Writer;
use super::join::{Extra, Joiner, event_words};
use super::record::{Interface, Kind, Section};
use crate::fault::Damage;
use crate::folder::TOOL;
use crate::line::{Delivery, Direction, Original};
use crate::rig::Rig;
use crate::scenario::Scenario;
use crate::trace::{Side, Tap, fingerprint};

/// How much a recording may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// A file that has grown to this is put aside and a new one begun.
    pub file_bytes: u64,
    /// Files put aside that are kept; older ones are deleted.
    pub files: u64,
}

impl Default for Limits {
    /// Three quarters of an hour a file, at 6 MB a minute of the rescue robot; 2 GiB in all.
    fn default() -> Self {
        Self {
            file_bytes: 256 << 20,
            files: 7,
        }
    }
}

/// What a section says of a run of `scenario`: name, fingerprints of the whole and of its faults,
/// seed, that its clock is virtual, and the scenario itself.
pub fn about(scenario: &Scenario) -> Section {
    about_in(scenario, "virtual")
}

/// The same of a run on the wall clock that began at `start`, UTC since 1970.
pub fn about_live(scenario: &Scenario, start: Instant) -> Section {
    about_in(scenario, &format!("utc\nstart_ns={}", start.as_nanos()))
}

fn about_in(scenario: &Scenario, clock: &str) -> Section {
    let faults = serde_json::to_string(&scenario.fault).expect("plain data with string keys");
    let about = format!(
        "scenario={}\nscenario_hash={}\nseed={}\nschedule_hash={}\nclock={clock}",
        scenario.name,
        fingerprint(scenario.to_toml().as_bytes()),
        scenario.seed,
        fingerprint(faults.as_bytes()),
    );
    Section {
        tool: format!("{TOOL} {}", env!("CARGO_PKG_VERSION")),
        about,
        scenario: scenario.to_toml(),
    }
}

/// A tap that writes a capture. An error stops it, not the run; [`Tap::finish`] tells.
#[derive(Debug)]
pub struct Recording {
    writer: Writer,
    is_stopped: bool,
    joiner: Joiner,
    buf: Vec<u8>,
    /// In a live run only: when what was gathered was last written.
    flushed_at: Option<Instant>,
    /// A piece of this size is written. Also bounds the size of files that are put aside.
    piece: usize,
}

/// Bytes gathered before they are written.
const PIECE: usize = 256 << 10;
/// Time of a live run after which what was gathered is written at the latest: what a killed process
/// may lose.
const FLUSH_EVERY: Duration = Duration::from_millis(500);

impl Recording {
    /// Begins the capture of `rig` in the file `path`; `section` as from [`about`] or
    /// [`about_live`].
    pub fn create(path: &Path, rig: &Rig, section: Section, limits: Limits) -> io::Result<Self> {
        let mut head = Vec::new();
        section.write(&mut head);
        for link in rig.links() {
            let [sender, _] = rig.line_configs(link.line(Direction::ToMaster));
            Interface::new(&link.name, sender.baud).write(&mut head);
        }
        let is_live = section.start() > Instant::ZERO;
        let smallest = usize::try_from(limits.file_bytes / 8).unwrap_or(PIECE);
        let piece = smallest.min(PIECE);
        Ok(Self {
            writer: Writer::create(path, head, limits)?,
            is_stopped: false,
            joiner: Joiner::new(rig, section.start()),
            buf: Vec::with_capacity(piece + (8 << 10)),
            flushed_at: is_live.then_some(Instant::ZERO),
            piece,
        })
    }

    /// Writes what was gathered, if that is much.
    fn relieve(&mut self) {
        if self.buf.len() >= self.piece {
            self.flush();
        }
    }

    fn flush(&mut self) {
        if !self.buf.is_empty() && !self.writer.write(&mut self.buf) {
            self.is_stopped = true;
        }
    }
}

impl Tap for Recording {
    /// All that is written comes from [`arrived`](Tap::arrived), which knows both sides.
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        if self.is_stopped {
            return;
        }
        let (line, at, out) = ((link, direction), delivery.at, &mut self.buf);
        if delivery.framing_errors > 0 {
            let kind = Kind::Line(LineEvent::FramingError);
            let comment = format!("{} characters without a stop bit", delivery.framing_errors);
            let extra = Extra {
                sent: None,
                comment,
            };
            self.joiner.single(line, at, kind, &[], extra, out);
        }
        match delivery.original.as_deref() {
            None if delivery.bytes.is_empty() => {}
            None => {
                let bytes = &delivery.bytes;
                self.joiner.bytes(line, at, bytes, Duration::ZERO, out);
            }
            Some(original) if original.is_only_late(&delivery.bytes) => {
                let (bytes, delay) = (&delivery.bytes, at - original.at);
                self.joiner.bytes(line, at, bytes, delay, out);
            }
            Some(original) => {
                let extra = Extra {
                    sent: Some((original.at, original.bytes.clone())),
                    comment: words(original),
                };
                let bytes = &delivery.bytes;
                self.joiner.single(line, at, Kind::Data, bytes, extra, out);
            }
        }
        self.relieve();
    }

    fn line_event(&mut self, link: usize, direction: Direction, at: Instant, event: LineEvent) {
        if self.is_stopped {
            return;
        }
        let extra = Extra {
            sent: None,
            comment: event_words(event).to_owned(),
        };
        let (line, kind) = ((link, direction), Kind::Line(event));
        self.joiner
            .single(line, at, kind, &[], extra, &mut self.buf);
        self.relieve();
    }

    fn reached(&mut self, now: Instant) {
        if !self.is_stopped && self.flushed_at.is_some_and(|at| now - at >= FLUSH_EVERY) {
            self.flushed_at = Some(now);
            self.joiner.reached(now);
            self.joiner.emit(&mut self.buf);
            self.flush();
        }
    }

    fn finish(&mut self) -> io::Result<()> {
        self.joiner.finish(&mut self.buf);
        self.flush();
        self.is_stopped = true;
        self.writer.finish()
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        // Whoever wants to know of errors has called it before.
        let _ = self.finish();
    }
}

/// What the line did to the bytes, for a comment; nothing if it only delayed them.
fn words(original: &Original) -> String {
    let mut out = String::new();
    let mut say = |what: core::fmt::Arguments<'_>| {
        let gap = if out.is_empty() { "fault: " } else { "; " };
        write!(out, "{gap}{what}").expect("a string takes everything");
    };
    for strike in &original.strikes {
        let byte = strike.byte;
        match strike.damage {
            Damage::Flip { bit } => say(format_args!("byte {byte} flip bit {bit}")),
            Damage::Drop => say(format_args!("byte {byte} drop")),
            Damage::Insert { value } => say(format_args!("byte {byte} insert {value:#04x}")),
            Damage::Duplicate => say(format_args!("byte {byte} duplicate")),
        }
    }
    if original.is_cut {
        say(format_args!("line cut"));
    }
    if let Some([sender, receiver]) = original.bauds {
        say(format_args!("sent at {sender} baud, read at {receiver}"));
    }
    out
}
