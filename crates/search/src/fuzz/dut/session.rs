//! A running case: the rig, its ports, and the program.

use core::time::Duration;
use std::collections::BTreeMap;
use std::path::Path;

use protocols::Instant;

use super::case::{Case, Known, WARM_UP};
use super::constants::Constants;
use super::coverage::Reached;
use super::harness::{Harness, HarnessError};
use super::player::{Halt, Player};
use super::replies::Held;
use super::wiring;
use capture::{self, Limits, Recording};
use engine::rig::PortRate;
use engine::run::Run;
use realtime::clock::utc;
use realtime::guest::TrialMoment;

/// Time without a newly opened port after which all ports of a program count as opened.
const OPENED: Duration = Duration::from_millis(300);
/// Silence after which a request counts as complete.
pub(super) const WHOLE: Duration = Duration::from_millis(3);
/// Silence that ends an answer.
const QUIET: Duration = Duration::from_millis(8);
/// Pause in a stream: longer than the idle times of most programs.
const PAUSE: Duration = Duration::from_millis(20);
/// Maximum number of queued bytes on the raw link.
const BACKLOG_MAX: usize = 1024;
/// Interval between two checks of the ports in virtual time, unless the result is needed.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Number of bytes that a program in virtual time receives at once on a raw link, like the FIFO of
/// a 16550: waking the program costs more than its computation.
const FIFO: usize = 16;
/// Maximum number of bytes in the capture of a case; further bytes are left out.
const CAPTURE_MAX: u64 = 64 << 20;

/// A running case.
pub(super) struct Session<'a> {
    player: Player,
    raw: Option<usize>,
    heard: Vec<u8>,
    /// Time at which the last byte was sent on the raw link.
    said_at: Instant,
    /// Time of the last check of the ports.
    looked_at: Instant,
    names: Vec<String>,
    ports: BTreeMap<String, PortActivity>,
    goes_on: &'a dyn Fn() -> bool,
    /// The activity of the program between two reads of its counters.
    reached: Vec<Reached>,
    /// Numbers of the played turns.
    pub(super) played: Vec<usize>,
    /// The conversation so far.
    pub(super) held: Held,
    /// Whether an intact device sends other data in the conversation: data were altered, or a
    /// request did not get its own reply.
    pub(super) is_altered: bool,
}

/// A session at one moment.
pub(super) struct SessionMoment {
    program: TrialMoment,
    heard: Vec<u8>,
}

/// The observed activity on a port.
#[derive(Clone, Copy, Debug, Default)]
struct PortActivity {
    was_opened: bool,
    is_open: bool,
    spoken: u64,
    spoke_at: Option<Instant>,
    drained_at: Option<Instant>,
    reads: Option<u64>,
}

impl<'a> Session<'a> {
    /// Sets up `case` and starts the program. Returns after the program has opened its ports, has
    /// ended, or has taken too long.
    pub(super) fn begin(
        harness: &Harness<'a>,
        case: &Case,
        recording: &Path,
    ) -> Result<(Self, Result<(), Halt>), HarnessError> {
        let link = case.told.raw.as_ref().map(|raw| raw.link.as_str());
        let (mut run, mut ends, raw) = wiring::wire(&harness.source, &case.scenario, link)?;
        if harness.is_any_rate {
            for end in &mut ends {
                end.rate = PortRate::Any { usual: end.line };
            }
        }
        run.go_on_until(Instant::ZERO + WARM_UP);
        if let Some(link) = link.and_then(|link| run.rig.link_mut(link))
            && harness.supervision.is_some()
        {
            link.lines.iter_mut().for_each(|line| line.piece = FIFO);
        }
        record(&mut run, recording, harness.supervision.is_some())?;
        let (dir, ports) = harness.ports(&ends, &case.scenario)?;
        let names = ports.iter().map(|(end, _)| end.name.clone()).collect();
        let player = Player::start(harness, run, dir, ports, &case.told.known)?;
        let mut live = Self {
            player,
            raw,
            heard: Vec::new(),
            said_at: Instant::ZERO,
            looked_at: Instant::ZERO,
            names,
            ports: BTreeMap::new(),
            goes_on: harness.goes_on,
            reached: Vec::new(),
            played: Vec::new(),
            held: Held::default(),
            is_altered: false,
        };
        let opened = live.wait_for_ports(harness, &case.told.known);
        if opened.is_ok() && harness.constants.get().is_none() {
            let constants = Constants::of_processes(live.player.processes().into_iter());
            let _ = harness.constants.set(constants);
        }
        Ok((live, opened))
    }

    /// Waits until the program has opened its ports, then starts virtual time.
    fn wait_for_ports(&mut self, harness: &Harness<'_>, known: &Known) -> Result<(), Halt> {
        if self.player.is_started() {
            let (mut count, mut since) = (0, Duration::ZERO);
            while self.player.waited() < harness.start && !self.player.has_begun() {
                self.turn()?;
                let waited = self.player.waited();
                let open = self.opened();
                if open.len() != count {
                    (count, since) = (open.len(), waited);
                }
                let is_all = match known.opens.is_empty() {
                    true => count == self.ports.len() || waited - since > OPENED,
                    false => known.opens.iter().all(|name| open.contains(&name.as_str())),
                };
                if count > 0 && is_all {
                    break;
                }
            }
        }
        self.player.let_go();
        Ok(())
    }

    /// Whether the program has sent any byte.
    pub(super) fn has_spoken(&self) -> bool {
        self.ports.values().any(|port| port.spoke_at.is_some())
    }

    /// The ports that are open.
    pub(super) fn opened(&self) -> Vec<&str> {
        let open = self.ports.iter().filter(|(_, port)| port.is_open);
        open.map(|(name, _)| name.as_str()).collect()
    }

    /// The names of all ports.
    pub(super) fn port_names(&self) -> Vec<&str> {
        self.names.iter().map(String::as_str).collect()
    }

    /// The program's location when a signal such as SIGSEGV came.
    pub(super) fn fault(&self) -> Option<String> {
        self.player.fault().map(ToOwned::to_owned)
    }

    /// The standard error output of the program so far.
    pub(super) fn said_so_far(&self) -> String {
        self.player.said()
    }

    /// The virtual time.
    pub(super) fn now(&self) -> Instant {
        self.player.now()
    }

    /// The maximum lateness of the rig.
    pub(super) fn late(&self) -> Duration {
        self.player.late()
    }

    /// Ends the case if the user interrupts the search.
    pub(super) fn go_on(&self) -> Result<(), Halt> {
        match (self.goes_on)() {
            true => Ok(()),
            false => Err(Halt::Interrupted),
        }
    }

    /// Advances the rig and checks the program.
    pub(super) fn turn(&mut self) -> Result<(), Halt> {
        self.go_on()?;
        // The turn that starts the clock has opened a port, and the program may end soon.
        let had_begun = self.player.has_begun();
        self.player.turn()?;
        if let Some(node) = self.raw {
            self.heard.extend(self.player.rig().take_output(node));
        }
        // Each check costs system calls; in virtual time one turn may be a single step of a thread.
        let is_soon = self.player.now() < self.looked_at + LOOK_EVERY;
        if is_soon && had_begun && self.ended().is_ok() {
            return Ok(());
        }
        self.looked_at = self.player.now();
        let (now, is_started) = (self.player.now(), self.player.is_started());
        self.player.look(|sign| {
            let port = match self.ports.get_mut(sign.name) {
                Some(port) => port,
                None => self.ports.entry(sign.name.to_owned()).or_default(),
            };
            if sign.from_client != port.spoken {
                (port.spoken, port.spoke_at) = (sign.from_client, Some(now));
            }
            // A program that reads in small pieces never empties a port that is filled
            // continuously.
            if sign.is_drained || sign.reads != port.reads {
                port.drained_at = Some(now);
            }
            port.reads = sign.reads;
            port.is_open = sign.is_open || !is_started;
            port.was_opened |= port.is_open;
        });
        self.ended()
    }

    fn ended(&mut self) -> Result<(), Halt> {
        match self.player.ended() {
            Some(ended) => Err(Halt::Ended(ended)),
            None => Ok(()),
        }
    }

    /// Advances the rig and checks the ports.
    pub(super) fn look(&mut self) -> Result<(), Halt> {
        self.looked_at = Instant::ZERO;
        self.turn()
    }

    /// Lets `time` pass.
    pub(super) fn pass(&mut self, time: Duration) -> Result<(), Halt> {
        let until = self.now() + time;
        while self.now() < until {
            self.turn()?;
        }
        Ok(())
    }

    /// Sends `bytes` on the raw link at the rate of its line.
    pub(super) fn say(&mut self, bytes: &[u8]) -> Result<(), Halt> {
        let Some(node) = self.raw else { return Ok(()) };
        for piece in bytes.chunks(BACKLOG_MAX) {
            while self.player.rig().backlog(node) + piece.len() > BACKLOG_MAX {
                self.turn()?;
            }
            self.player.rig().inject(node, piece);
            self.said_at = self.now();
        }
        Ok(())
    }

    /// Waits until all bytes have been sent.
    pub(super) fn flush(&mut self) -> Result<(), Halt> {
        let Some(node) = self.raw else { return Ok(()) };
        while self.player.rig().backlog(node) > 0 {
            self.turn()?;
            self.said_at = self.now();
        }
        Ok(())
    }

    /// Records the coverage since the last call.
    pub(super) fn note_reached(&mut self, harness: &Harness<'_>) {
        if let Some(counters) = &harness.counters {
            self.reached.push(counters.take());
        }
    }

    /// Returns the recorded coverage.
    pub(super) fn take_reached(&mut self) -> Vec<Reached> {
        core::mem::take(&mut self.reached)
    }

    /// Waits until all bytes have been sent, then keeps silent for a pause.
    pub(super) fn pause(&mut self) -> Result<(), Halt> {
        self.flush()?;
        while self.now() < self.said_at + PAUSE {
            self.turn()?;
        }
        Ok(())
    }

    /// Sends `bytes`; returns the bytes received on the raw link within `window`, or less if the
    /// case ends.
    pub(super) fn ask(&mut self, bytes: &[u8], window: Duration) -> Result<Vec<u8>, Halt> {
        self.pause()?;
        self.heard.clear();
        self.say(bytes)?;
        self.flush()?;
        let until = self.now() + window;
        let (mut len, mut since) = (self.heard.len(), self.now());
        while self.now() < until && (len == 0 || self.now() - since < QUIET) {
            self.turn()?;
            if self.heard.len() != len {
                (len, since) = (self.heard.len(), self.now());
            }
        }
        Ok(core::mem::take(&mut self.heard))
    }

    /// The next bytes of the program on the raw link: until `is_whole` accepts them, until a
    /// silence of `quiet`, or until `most` is over, for a program that sends without a pause.
    /// `None` if the program sends nothing within `most`.
    pub(super) fn hear(
        &mut self,
        most: Duration,
        quiet: Duration,
        is_whole: &dyn Fn(&[u8]) -> bool,
    ) -> Result<Option<Vec<u8>>, Halt> {
        let until = self.now() + most;
        let (mut len, mut since) = (self.heard.len(), self.now());
        loop {
            let (is_quiet, is_over) = (self.now() - since >= quiet, self.now() >= until);
            if is_whole(&self.heard) || (len > 0 && (is_quiet || is_over)) {
                return Ok(Some(core::mem::take(&mut self.heard)));
            }
            if is_over {
                return Ok(None);
            }
            self.turn()?;
            if self.heard.len() != len {
                (len, since) = (self.heard.len(), self.now());
            }
        }
    }

    /// Returns received bytes to the buffer.
    pub(super) fn unhear(&mut self, heard: &[u8]) {
        self.heard.splice(0..0, heard.iter().copied());
    }

    /// The bytes received on the raw link since the last request.
    pub(super) fn take_heard(&mut self) -> Vec<u8> {
        core::mem::take(&mut self.heard)
    }

    /// The program and its bytes so far, if it can be put back to this moment.
    pub(super) fn moment(&mut self) -> Option<SessionMoment> {
        Some(SessionMoment {
            program: self.player.moment()?,
            heard: self.heard.clone(),
        })
    }

    /// Puts the program back to `moment`; returns whether this was possible. The rig continues.
    pub(super) fn put_back(&mut self, moment: &SessionMoment) -> bool {
        self.heard.clone_from(&moment.heard);
        self.played.clear();
        self.held = Held::default();
        self.is_altered = false;
        self.player.put_back(&moment.program)
    }

    /// The ports that the program opened, and those that it has read empty or written since `from`.
    pub(super) fn known(&self, from: Instant) -> Known {
        let those = |is: &dyn Fn(&PortActivity) -> bool| {
            let ports = self.ports.iter().filter(|(_, port)| is(port));
            ports.map(|(name, _)| name.clone()).collect()
        };
        Known {
            opens: those(&|port| port.was_opened),
            reads: those(&|port| port.is_open && port.drained_at >= Some(from)),
            speaks: those(&|port| port.spoke_at >= Some(from)),
            ends: false,
        }
    }

    /// Ends the program; returns its standard error output and the run.
    pub(super) fn end(self, harness: &Harness<'_>) -> (String, Run) {
        self.player.end(harness)
    }
}

/// Starts a capture; in virtual time equal cases give equal captures.
fn record(run: &mut Run, path: &Path, is_virtual: bool) -> Result<(), HarnessError> {
    let about = match is_virtual {
        true => capture::about(run.scenario()),
        false => capture::about_live(run.scenario(), utc()),
    };
    let limits = Limits {
        file_bytes: CAPTURE_MAX,
        files: 1,
        ..Limits::default()
    };
    let recording = Recording::create(path, &run.rig, about, limits);
    let recording = recording.map_err(|source| HarnessError::File(path.to_owned(), source))?;
    run.rig.add_tap(Box::new(recording));
    Ok(())
}
