//! Writes the capture of a run while it continues.

use core::fmt::Write as _;
use std::io;
use std::path::Path;

use core::time::Duration;

use protocols::{Instant, LineEvent};

use crate::files::{Files, Limits};
use crate::join::{Extra, Joiner, event_words, line_of};
use crate::record::{Interface, Kind, Section};
use crate::writer_thread::WriterThread;
use engine::TOOL;
use engine::rig::Rig;
use engine::rig::line::{Delivery, Direction, Original};
use engine::rig::trace::{Side, Tap, fingerprint};
use engine::scenario::Scenario;

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

/// A tap that writes a capture. An error stops it, not the run; [`Tap::take_trouble`] tells at
/// once, [`Tap::finish`] in the end.
#[derive(Debug)]
pub struct Recording {
    writer: WriterThread,
    is_stopped: bool,
    /// Why it stopped, if not by itself.
    error: Option<io::Error>,
    is_told: bool,
    /// In a live run only: when what was gathered was last written.
    flushed_at: Option<Instant>,
}

/// Bytes of the file that are written at once; fewer if the file is to stay small.
const PIECE: u64 = 256 << 10;
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
        let piece = usize::try_from(PIECE.min(limits.file_bytes / 8)).expect("at most PIECE");
        let files = Files::create(path, head, limits)?;
        Ok(Self {
            writer: WriterThread::start(Joiner::new(rig, section.start()), files, piece)?,
            is_stopped: false,
            error: None,
            is_told: false,
            flushed_at: is_live.then_some(Instant::ZERO),
        })
    }
}

impl Recording {
    fn stop_unless(&mut self, can_go_on: bool) {
        if !can_go_on {
            self.is_stopped = true;
            self.error = self.writer.finish().err();
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
        let (line, at) = (line_of(link, direction), delivery.at);
        let (batch, bytes) = (&mut self.writer.batch, &delivery.bytes[..]);
        if delivery.framing_errors > 0 {
            let kind = Kind::Line(LineEvent::FramingError);
            let comment = format!("{} characters without a stop bit", delivery.framing_errors);
            let sent = None;
            batch.single(line, at, kind, &[], Extra { sent, comment });
        }
        match delivery.original.as_deref() {
            None if bytes.is_empty() => {}
            None => batch.bytes(line, at, bytes, 0),
            Some(original) if original.is_only_late(bytes) => {
                let delay_ns = at.as_nanos().saturating_sub(original.at.as_nanos());
                batch.bytes(line, at, bytes, delay_ns);
            }
            Some(original) => {
                let sent = Some((original.at, original.bytes.clone()));
                let comment = words(original);
                batch.single(line, at, Kind::Data, bytes, Extra { sent, comment });
            }
        }
        let can_go_on = self.writer.relieve();
        self.stop_unless(can_go_on);
    }

    fn line_event(&mut self, link: usize, direction: Direction, at: Instant, event: LineEvent) {
        if self.is_stopped {
            return;
        }
        let comment = event_words(event).to_owned();
        let (kind, sent) = (Kind::Line(event), None);
        let line = line_of(link, direction);
        let extra = Extra { sent, comment };
        self.writer.batch.single(line, at, kind, &[], extra);
        let can_go_on = self.writer.relieve();
        self.stop_unless(can_go_on);
    }

    fn reached(&mut self, now: Instant) {
        if !self.is_stopped && self.flushed_at.is_some_and(|at| now - at >= FLUSH_EVERY) {
            self.flushed_at = Some(now);
            let can_go_on = self.writer.reached(now);
            self.stop_unless(can_go_on);
        }
    }

    fn take_trouble(&mut self) -> Option<String> {
        let error = self.error.as_ref().filter(|_| !self.is_told)?;
        self.is_told = true;
        Some(format!("the capture ends here: {error}"))
    }

    fn finish(&mut self) -> io::Result<()> {
        self.is_stopped = true;
        self.error.take().map_or_else(|| self.writer.finish(), Err)
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        // Callers that need its errors have called it before.
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
        say(format_args!("byte {byte} {}", strike.damage));
    }
    for effect in &original.effects {
        say(format_args!("{effect}"));
    }
    if let Some([sender, receiver]) = original.bauds {
        say(format_args!("sent at {sender} baud, read at {receiver}"));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Capture;
    use engine::rig::bare;

    /// When a rig is dropped early, by an error or a panic, the file has everything so far.
    #[test]
    fn a_recording_that_is_dropped_is_whole() {
        let (mut rig, [ends]) = bare::linked(["one"], 9600);
        let name = format!("hilrig-dropped-{}.pcapng", std::process::id());
        let path = std::env::temp_dir().join(name);
        let section = Section::default();
        let recording = Recording::create(&path, &rig, section, Limits::default());
        rig.add_tap(Box::new(recording.expect("writable")));
        rig.inject(ends[0].node, &[7]);
        rig.run_for(Duration::from_millis(10));
        drop(rig);
        let capture = Capture::read(&path).expect("readable");
        let _ = std::fs::remove_file(&path);
        let [record] = &capture.records[..] else {
            panic!("{:?}", capture.records)
        };
        assert_eq!(record.bytes[..], [7]);
    }
}
