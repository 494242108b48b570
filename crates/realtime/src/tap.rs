//! A recorder between two ports: it forwards bytes in both directions and records them with their
//! times.
//!
//! ```text
//!   device <--> port A | Recorder | port B <--> program
//!                          |
//!                       capture
//! ```
//!
//! Bytes are forwarded first and recorded afterwards, so that recording delays nothing. The time of
//! a byte is the time of its read: later than on the wire by the delay of the system and its
//! driver.

mod file;

use core::time::Duration;
use std::collections::VecDeque;

use bytes::Bytes;
use protocols::{Instant, LineEvent};

pub use file::{CaptureFile, FileError};

use crate::Lateness;
use crate::clock::Clock;
use crate::transport::{PortEvent, Transport, TransportError, wait};
use capture::{Interface, Kind, Record, Section};
use engine::TOOL;
use engine::rig::line::Direction;

/// Two connected ports.
pub struct Wire {
    /// Name of the link in the capture.
    pub name: String,
    /// Bits per second of both ends.
    pub baud: u32,
    /// The device's end, then the program's end.
    pub ends: [Box<dyn Transport>; 2],
}

/// Bytes of one direction of a wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Passed {
    /// Bytes read at one end.
    pub read: u64,
    /// Bytes among them that were lost because the other end was closed.
    pub lost: u64,
}

/// The reason for an early end of a recording. The file is complete in any case.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// A port disappeared.
    #[error(transparent)]
    Port(#[from] TransportError),
    /// The capture cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Forwards and records bytes.
pub struct Recorder<C> {
    clock: C,
    /// Time of the capture at the clock's zero.
    epoch: Instant,
    wires: Vec<Wire>,
    passed: Vec<[Passed; 2]>,
    /// Bytes that were read and recorded, and not yet taken by the other end.
    waiting: Vec<[VecDeque<u8>; 2]>,
    file: CaptureFile,
    held: Lateness,
    /// Notes about rates that were not fetched yet.
    notes: Vec<String>,
}

/// Maximum wait, because some ports cannot wake this thread.
const WAIT_MAX: Duration = Duration::from_millis(5);
/// Maximum wait while the other end has no room, because no event reports new room.
const WAIT_FOR_ROOM: Duration = Duration::from_millis(1);
/// Maximum number of bytes that wait for the other end; then no more are read.
const WAITING_MAX: usize = 64 << 10;
/// Reads of one end before the others are served.
const READS_MAX: usize = 16;

impl<C: Clock> Recorder<C> {
    /// Records `wires` into `file`, whose times are the clock's plus `epoch`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn new(
        clock: C,
        epoch: Instant,
        wires: Vec<Wire>,
        file: CaptureFile,
    ) -> Result<Self, FileError> {
        let mut this = Self {
            clock,
            epoch,
            passed: vec![Default::default(); wires.len()],
            waiting: vec![Default::default(); wires.len()],
            wires,
            file,
            held: Lateness::default(),
            notes: Vec::new(),
        };
        this.begin()?;
        Ok(this)
    }

    fn begin(&mut self) -> Result<(), FileError> {
        let mut about = String::from("clock=utc");
        for Wire { name, ends, .. } in &self.wires {
            let [device, program] = ends.each_ref().map(|end| end.path().display());
            about += &format!("\ntap={name} {device} {program}");
        }
        let tool = format!("{TOOL} {}", env!("CARGO_PKG_VERSION"));
        let scenario = String::new();
        let section = Section {
            tool,
            about,
            scenario,
        };
        self.file.put(0, |out| section.write(out))?;
        for wire in &self.wires {
            let interface = Interface::new(&wire.name, wire.baud);
            self.file.put(0, |out| interface.write(out))?;
        }
        self.file.flush()
    }

    /// The clock.
    pub const fn clock(&self) -> &C {
        &self.clock
    }

    /// Time between the read and the forwarding of chunks.
    pub const fn held(&self) -> &Lateness {
        &self.held
    }

    /// Notes since the last call: a program set another rate than that of the capture.
    pub fn take_notes(&mut self) -> Vec<String> {
        core::mem::take(&mut self.notes)
    }

    /// The wires' names and traffic: towards the program, then towards the device.
    pub fn reports(&self) -> impl Iterator<Item = (&str, [Passed; 2])> {
        let names = self.wires.iter().map(|wire| &*wire.name);
        names.zip(self.passed.iter().copied())
    }

    /// Forwards available bytes, then waits until more may arrive.
    ///
    /// # Errors
    /// If a port disappeared or the file cannot be written. The file contains all bytes before the
    /// error.
    pub fn turn(&mut self) -> Result<(), RecordError> {
        for link in 0..self.wires.len() {
            for direction in [Direction::ToMaster, Direction::ToDevice] {
                if let Err(error) = self.pass(link, direction) {
                    self.file.flush()?;
                    return Err(error);
                }
            }
        }
        self.file.flush_if_due(self.clock.now())?;
        self.wait();
        Ok(())
    }

    /// Ends the file.
    ///
    /// # Errors
    /// If its last records cannot be written.
    pub fn finish(&mut self) -> Result<(), FileError> {
        self.file.flush()
    }

    fn pass(&mut self, link: usize, direction: Direction) -> Result<(), RecordError> {
        let mut buf = [0; 1024];
        self.hand_on(link, direction);
        for _ in 0..READS_MAX {
            if self.waiting[link][direction as usize].len() >= WAITING_MAX {
                break;
            }
            let read = self.wires[link].ends[direction as usize].read(&mut buf);
            let at = self.clock.now();
            let len = read.as_ref().map_or(0, |&len| len);
            self.waiting[link][direction as usize].extend(&buf[..len]);
            let lost = self.hand_on(link, direction);
            while let Some(event) = self.wires[link].ends[direction as usize].next_event() {
                self.note_event(link, direction, at, event)?;
            }
            read?;
            if len == 0 {
                break;
            }
            self.held.record(self.clock.now() - at);
            self.passed[link][direction as usize].read += len as u64;
            let comment = match lost {
                0 => String::new(),
                lost => format!("{lost} bytes lost: the other end is closed"),
            };
            self.note(link, direction, at, Kind::Data, &buf[..len], comment)?;
        }
        Ok(())
    }

    /// Writes waiting bytes to the other end as far as it has room. Returns the number of bytes
    /// that were lost because the other end is closed.
    fn hand_on(&mut self, link: usize, direction: Direction) -> u64 {
        let waiting = &mut self.waiting[link][direction as usize];
        let to = &mut self.wires[link].ends[1 - direction as usize];
        let mut lost = 0;
        while !waiting.is_empty() {
            let (piece, _) = waiting.as_slices();
            let (len, unheard) = (piece.len(), to.counters().unheard);
            let taken = to.write(piece);
            let refused = to.counters().unheard - unheard;
            lost += refused;
            if refused > 0 {
                waiting.clear();
            } else {
                waiting.drain(..taken);
                if taken < len {
                    break;
                }
            }
        }
        self.passed[link][direction as usize].lost += lost;
        lost
    }

    fn note_event(
        &mut self,
        link: usize,
        direction: Direction,
        at: Instant,
        event: PortEvent,
    ) -> Result<(), FileError> {
        let wire = &self.wires[link];
        if let PortEvent::BaudChanged(baud) = event
            && baud != wire.baud
        {
            let (name, own) = (&wire.name, wire.baud);
            let path = wire.ends[direction as usize].path().display();
            self.notes.push(format!(
                "{name}: {path} is set to {baud} baud, but the other port and the capture have {own}; \
                 --baud {name}={baud} if that is the device's rate"
            ));
        }
        let (event, comment) = match event {
            PortEvent::Opened => (LineEvent::Opened, "port opened".to_owned()),
            PortEvent::Closed => (LineEvent::Closed, "port closed".to_owned()),
            PortEvent::BaudChanged(baud) => (LineEvent::Opened, format!("port set to {baud} baud")),
        };
        self.note(link, direction, at, Kind::Line(event), &[], comment)
    }

    fn note(
        &mut self,
        link: usize,
        direction: Direction,
        at: Instant,
        kind: Kind,
        bytes: &[u8],
        comment: String,
    ) -> Result<(), FileError> {
        let record = Record {
            link,
            sequence: Some(self.file.next_sequence()),
            at: self.epoch + (at - Instant::ZERO),
            direction,
            kind,
            bytes: Bytes::copy_from_slice(bytes),
            sent: None,
            pieces: Vec::new(),
            comment,
        };
        let interface = u32::try_from(link).expect("few links");
        self.file
            .put(bytes.len(), |out| record.write(interface, out))
    }

    fn wait(&self) {
        let mut fds = Vec::new();
        for end in self.wires.iter().flat_map(|wire| &wire.ends) {
            end.readiness(&mut fds);
        }
        let mut waiting = self.waiting.iter().flatten();
        let timeout = match waiting.all(VecDeque::is_empty) {
            true => WAIT_MAX,
            false => WAIT_FOR_ROOM,
        };
        if fds.is_empty() || wait(&fds, timeout).is_err() {
            self.clock.sleep_until(self.clock.now() + timeout);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SimClock;
    use crate::transport::Memory;
    use capture::Capture;

    /// A recorder between two ports, the clients' ends of both, and its file.
    struct Bench {
        recorder: Recorder<SimClock>,
        device: Memory,
        program: Option<Memory>,
        file: std::path::PathBuf,
    }

    fn bench(name: &str) -> Bench {
        let name = format!("hilrig-tap-{name}-{}.pcapng", std::process::id());
        let path = std::env::temp_dir().join(name);
        let [(one, device), (other, program)] = ["one", "other"].map(Memory::pair);
        let wire = Wire {
            name: "base".to_owned(),
            baud: 9_600,
            ends: [Box::new(one), Box::new(other)],
        };
        let file = CaptureFile::create(&path).expect("writable");
        let epoch = Instant::from_secs(1_000);
        let recorder = Recorder::new(SimClock::default(), epoch, vec![wire], file);
        Bench {
            recorder: recorder.expect("writable"),
            device,
            program: Some(program),
            file: path,
        }
    }

    impl Bench {
        fn passed(&self) -> [Passed; 2] {
            let mut reports = self.recorder.reports();
            let (name, passed) = reports.next().expect("one wire");
            assert_eq!(name, "base");
            passed
        }

        fn program_reads(&mut self) -> Vec<u8> {
            let mut buf = vec![0; 9_000];
            let program = self.program.as_mut().expect("open");
            let len = program.read(&mut buf).expect("open");
            buf[..len].to_vec()
        }

        fn turn(&mut self) {
            self.recorder.turn().expect("both are there");
        }

        fn capture(&mut self) -> Capture {
            self.recorder.finish().expect("writable");
            let bytes = std::fs::read(&self.file).expect("written");
            let _ = std::fs::remove_file(&self.file);
            Capture::of(&bytes)
        }
    }

    /// A port holds 4096 bytes. Further bytes for a program that does not read wait in order; the
    /// file has them with their times of arrival.
    #[test]
    fn what_a_program_does_not_read_yet_waits_for_it() {
        let mut bench = bench("waits");
        let all: Vec<u8> = (0..6_000_u32).map(|n| n.to_le_bytes()[0]).collect();
        assert_eq!(bench.device.write(&all[..3_000]), 3_000);
        bench.turn();
        assert_eq!(bench.device.write(&all[3_000..]), 3_000);
        bench.turn();
        let passed = bench.passed();
        assert_eq!((passed[0].read, passed[0].lost), (6_000, 0));
        assert_eq!(bench.recorder.waiting[0][0].len(), 6_000 - 4_096);
        let mut got = bench.program_reads();
        assert_eq!(got.len(), 4_096);
        bench.turn();
        got.extend(bench.program_reads());
        assert!(got == all && bench.recorder.waiting[0][0].is_empty());
        assert_eq!(bench.passed()[1], Passed::default());
        let capture = bench.capture();
        let data = capture.records.iter().filter(|one| one.kind == Kind::Data);
        let written: Vec<u8> = data.flat_map(|one| one.bytes.to_vec()).collect();
        assert!(written == all);
        assert_eq!(
            (capture.links[0].name.as_str(), capture.links[0].baud),
            ("base", 9_600)
        );
    }

    /// Ports without an event for new bytes are polled after 5 ms, and after 1 ms while the other
    /// end has no room. The delay of each chunk is measured.
    #[test]
    fn a_turn_waits_longer_when_nothing_waits_for_room() {
        let mut bench = bench("turn");
        let now = |bench: &Bench| bench.recorder.clock().now().as_millis();
        bench.turn();
        assert_eq!((now(&bench), bench.recorder.held().count()), (5, 0));
        for len in [3_000, 2_000] {
            bench.device.write(&vec![1; len]);
            bench.turn();
        }
        assert!(!bench.recorder.waiting[0][0].is_empty());
        assert_eq!((now(&bench), bench.recorder.held().count()), (5 + 5 + 1, 5));
        bench.capture();
    }

    /// Bytes for a closed port are lost, counted, and recorded in the file.
    #[test]
    fn what_comes_for_a_closed_port_is_lost() {
        let mut bench = bench("lost");
        bench.turn();
        bench.program = None;
        bench.device.write(b"twelve bytes");
        bench.turn();
        let passed = bench.passed();
        assert_eq!((passed[0].read, passed[0].lost), (12, 12));
        assert!(bench.recorder.waiting[0][0].is_empty());
        bench.device.write(b"five!");
        bench.turn();
        let passed = bench.passed();
        assert_eq!((passed[0].read, passed[0].lost), (17, 17));
        let capture = bench.capture();
        let said: Vec<(Kind, Direction, String)> = capture
            .records
            .iter()
            .map(|one| (one.kind, one.direction, one.comment.clone()))
            .collect();
        let (in_, out) = (Direction::ToMaster, Direction::ToDevice);
        let opened = |direction| {
            let kind = Kind::Line(LineEvent::Opened);
            (kind, direction, "port opened".to_owned())
        };
        let lost = |count: u8| {
            let comment = format!("{count} bytes lost: the other end is closed");
            (Kind::Data, in_, comment)
        };
        assert_eq!(said[..3], [opened(in_), opened(out), lost(12)]);
        assert!(
            capture
                .records
                .iter()
                .all(|one| one.at >= Instant::from_secs(1_000))
        );
        let closed = (Kind::Line(LineEvent::Closed), out, "port closed".to_owned());
        assert_eq!(said[3..], [closed, lost(5)]);
    }
}
