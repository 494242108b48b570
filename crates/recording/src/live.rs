//! Writer of the capture of a run while the run continues.

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

/// Description of a run of `scenario` for the section: name, fingerprints of the scenario and of
/// its faults, seed, virtual clock, and the scenario itself.
pub fn about(scenario: &Scenario) -> Section {
    about_in(scenario, "virtual")
}

/// Description of a run in real time that began at `start`, UTC since 1970.
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

/// A tap that writes a capture. An error stops the recording, not the run. [`Tap::take_trouble`]
/// returns the error at once, [`Tap::finish`] at the end.
#[derive(Debug)]
pub struct Recording {
    writer: WriterThread,
    is_stopped: bool,
    /// The error that stopped the recording, if any.
    error: Option<io::Error>,
    is_told: bool,
    /// Time of the last write of the gathered bytes; only in a live run.
    flushed_at: Option<Instant>,
}

/// Number of bytes that are written at once; fewer if the maximum file size is small.
const PIECE: u64 = 256 << 10;
/// Maximum time between writes in a live run. A killed process loses at most this much.
const FLUSH_EVERY: Duration = Duration::from_millis(500);

impl Recording {
    /// Begins the capture of `rig` in the file `path`. `section` comes from [`about`] or
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
    /// Does nothing: all written records come from [`arrived`](Tap::arrived), which knows both
    /// sides.
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
        // A caller that needs the errors of `finish` has already called it.
        let _ = self.finish();
    }
}

/// Text of a comment about damage by the line; empty if the line only delayed the bytes.
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

    /// If an error or a panic drops the rig early, the file holds all bytes up to that point.
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
