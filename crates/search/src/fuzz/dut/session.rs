//! A case under way: the rig, its ports, and the program on them.

use core::time::Duration;
use std::collections::BTreeMap;
use std::path::Path;

use protocols::Instant;

use super::case::{Case, Known, WARM_UP};
use super::coverage::Reached;
use super::harness::{Harness, HarnessError};
use super::player::{Halt, Player};
use super::wiring;
use capture::{self, Limits, Recording};
use engine::rig::PortRate;
use engine::run::Run;
use realtime::clock::utc;

/// Time without a further port being opened after which a program is taken to have opened all.
const OPENED: Duration = Duration::from_millis(300);
/// Silence that ends an answer.
const QUIET: Duration = Duration::from_millis(8);
/// A pause of a stream: longer than the idle rules of most programs.
const PAUSE: Duration = Duration::from_millis(20);
/// Bytes that may wait for the line of a raw link.
const BACKLOG_MAX: usize = 1024;
/// Between two looks at ports in virtual time.
const LOOK_EVERY: Duration = Duration::from_millis(1);
/// Bytes that a program in virtual time gets at once on a raw link, as by the FIFO of a 16550: each
/// time that it is woken costs more than all that it computes.
const FIFO: usize = 16;
/// A capture of a case may have so many bytes; the rest is left out.
const CAPTURE_MAX: u64 = 64 << 20;

/// A case under way.
pub(super) struct Session<'a> {
    player: Player,
    raw: Option<usize>,
    heard: Vec<u8>,
    /// When the last byte was said there.
    said_at: Instant,
    /// When the ports were checked last.
    looked_at: Instant,
    names: Vec<String>,
    ports: BTreeMap<String, PortActivity>,
    goes_on: &'a dyn Fn() -> bool,
    /// What the program did from one look to the next.
    reached: Vec<Reached>,
    /// Numbers of the played turns.
    pub(super) played: Vec<usize>,
}

/// What was seen of a port.
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
    /// Sets up `case` and starts the program. It has opened its ports when this returns, unless it
    /// took too long or ended.
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
        };
        let opened = live.wait_for_ports(harness, &case.told.known);
        Ok((live, opened))
    }

    /// Waits until the program has opened what it opens, then lets time go.
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

    /// The ports that are open now.
    pub(super) fn opened(&self) -> Vec<&str> {
        let open = self.ports.iter().filter(|(_, port)| port.is_open);
        open.map(|(name, _)| name.as_str()).collect()
    }

    /// The names of all ports.
    pub(super) fn port_names(&self) -> Vec<&str> {
        self.names.iter().map(String::as_str).collect()
    }

    /// Where the program was when a signal such as SIGSEGV came.
    pub(super) fn fault(&self) -> Option<String> {
        self.player.fault().map(ToOwned::to_owned)
    }

    /// What the program said on its standard error so far.
    pub(super) fn said_so_far(&self) -> String {
        self.player.said()
    }

    /// The time.
    pub(super) fn now(&self) -> Instant {
        self.player.now()
    }

    /// How late the rig was at most.
    pub(super) fn late(&self) -> Duration {
        self.player.late()
    }

    /// Advances the rig and checks the program.
    pub(super) fn turn(&mut self) -> Result<(), Halt> {
        if !(self.goes_on)() {
            return Err(Halt::Interrupted);
        }
        self.player.turn()?;
        if let Some(node) = self.raw {
            self.heard.extend(self.player.rig().take_output(node));
        }
        // Each look costs calls, and in virtual time a turn may be a thread's only.
        let is_soon = self.player.now() < self.looked_at + LOOK_EVERY;
        if is_soon && self.player.has_begun() {
            return self.ended();
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
            // One that takes a little at a time never empties a port that is always filled.
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

    /// Lets `time` pass.
    pub(super) fn pass(&mut self, time: Duration) -> Result<(), Halt> {
        let until = self.now() + time;
        while self.now() < until {
            self.turn()?;
        }
        Ok(())
    }

    /// Says `bytes` on the raw link, as fast as its line carries them.
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

    /// Waits until all has been said.
    pub(super) fn flush(&mut self) -> Result<(), Halt> {
        let Some(node) = self.raw else { return Ok(()) };
        while self.player.rig().backlog(node) > 0 {
            self.turn()?;
            self.said_at = self.now();
        }
        Ok(())
    }

    /// Notes what the program has reached since the last call.
    pub(super) fn note_reached(&mut self, harness: &Harness<'_>) {
        if let Some(counters) = &harness.counters {
            self.reached.push(counters.take());
        }
    }

    /// What was noted of that.
    pub(super) fn take_reached(&mut self) -> Vec<Reached> {
        core::mem::take(&mut self.reached)
    }

    /// Says nothing for a while once all has been said.
    pub(super) fn pause(&mut self) -> Result<(), Halt> {
        self.flush()?;
        while self.now() < self.said_at + PAUSE {
            self.turn()?;
        }
        Ok(())
    }

    /// Says `bytes` and returns what is said on the raw link within `window`, or until it is over.
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

    /// What the program says on the raw link next: bytes that `is_whole` knows, or as many as come
    /// before a silence of `quiet`. `None` if it says nothing for `most`.
    pub(super) fn hear(
        &mut self,
        most: Duration,
        quiet: Duration,
        is_whole: &dyn Fn(&[u8]) -> bool,
    ) -> Result<Option<Vec<u8>>, Halt> {
        let until = self.now() + most;
        let (mut len, mut since) = (self.heard.len(), self.now());
        loop {
            if is_whole(&self.heard) || (len > 0 && self.now() - since >= quiet) {
                return Ok(Some(core::mem::take(&mut self.heard)));
            }
            if len == 0 && self.now() >= until {
                return Ok(None);
            }
            self.turn()?;
            if self.heard.len() != len {
                (len, since) = (self.heard.len(), self.now());
            }
        }
    }

    /// Puts back what was received.
    pub(super) fn unhear(&mut self, heard: &[u8]) {
        self.heard.splice(0..0, heard.iter().copied());
    }

    /// What was said on the raw link since the last question.
    pub(super) fn take_heard(&mut self) -> Vec<u8> {
        core::mem::take(&mut self.heard)
    }

    /// Which ports the program opened, has read empty since `from`, and has spoken on since.
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

    /// Ends the program; what it said on its standard error, and the run.
    pub(super) fn end(self, harness: &Harness<'_>) -> (String, Run) {
        self.player.end(harness)
    }
}

/// Writes down what passes; in virtual time twice the same if it is the same.
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
