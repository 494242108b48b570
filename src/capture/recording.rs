//! Writes the capture of a run while it goes on.

use core::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use core::time::Duration;

use protocols::{Instant, LineEvent};

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
    path: PathBuf,
    file: Option<File>,
    error: Option<io::Error>,
    limits: Limits,
    head: Vec<u8>,
    buf: Vec<u8>,
    written: u64,
    set_aside: u64,
    joiner: Joiner,
    flushed_at: Instant,
}

/// Bytes gathered before they are written.
const BUFFER: usize = 256 << 10;
/// Time of the run after which what was gathered is written at the latest: what a killed process
/// may lose.
const FLUSH_EVERY: Duration = Duration::from_millis(500);

impl Recording {
    /// Begins the capture of `rig` in the file `path`; `section` as from [`about`].
    pub fn create(path: &Path, rig: &Rig, section: Section, limits: Limits) -> io::Result<Self> {
        let mut head = Vec::new();
        section.write(&mut head);
        for link in rig.links() {
            let [sender, _] = rig.line_configs(link.line(Direction::ToMaster));
            Interface::new(&link.name, sender.baud).write(&mut head);
        }
        let mut file = File::create(path)?;
        file.write_all(&head)?;
        Ok(Self {
            path: path.to_owned(),
            file: Some(file),
            error: None,
            limits,
            written: head.len() as u64,
            head,
            buf: Vec::with_capacity(BUFFER + 1024),
            set_aside: 0,
            joiner: Joiner::new(rig, section.start()),
            flushed_at: Instant::ZERO,
        })
    }

    /// Writes what was gathered, if that is much.
    fn relieve(&mut self) {
        if self.buf.len() >= BUFFER {
            self.flush();
        }
    }

    fn flush(&mut self) {
        if let Err(error) = self.try_flush() {
            self.file = None;
            self.error = Some(error);
        }
    }

    fn try_flush(&mut self) -> io::Result<()> {
        let Some(file) = &mut self.file else {
            return Ok(());
        };
        if let Err(error) = file.write_all(&self.buf) {
            // A piece of a block may have come through before the disk was full.
            let _ = file.set_len(self.written);
            return Err(error);
        }
        self.written += self.buf.len() as u64;
        self.buf.clear();
        if self.written >= self.limits.file_bytes {
            self.rotate()?;
        }
        Ok(())
    }

    /// The newest file always has the plain name; `capture.1.pcapng` is the first put aside.
    fn rotate(&mut self) -> io::Result<()> {
        self.set_aside += 1;
        fs::rename(&self.path, self.aside(self.set_aside))?;
        if let Some(old) = self.set_aside.checked_sub(self.limits.files)
            && old > 0
        {
            fs::remove_file(self.aside(old))?;
        }
        let mut file = File::create(&self.path)?;
        file.write_all(&self.head)?;
        self.written = self.head.len() as u64;
        self.file = Some(file);
        Ok(())
    }

    fn aside(&self, number: u64) -> PathBuf {
        self.path.with_extension(format!("{number}.pcapng"))
    }
}

impl Tap for Recording {
    /// All that is written comes from [`arrived`](Tap::arrived), which knows both sides.
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        if self.file.is_none() {
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
        if self.file.is_none() {
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
        if self.file.is_some() && now - self.flushed_at >= FLUSH_EVERY {
            self.flushed_at = now;
            self.joiner.reached(now);
            self.joiner.emit(&mut self.buf);
            self.flush();
        }
    }

    fn finish(&mut self) -> io::Result<()> {
        self.joiner.finish(&mut self.buf);
        self.flush();
        self.error.take().map_or(Ok(()), Err)
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        self.joiner.finish(&mut self.buf);
        self.flush();
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
