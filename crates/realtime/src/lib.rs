//! The rig at the pace of the wall clock, with some of its link ends on transports.
//!
//! ```text
//!   client <--> transport <--> outside end | line | device ...  rig, virtual time
//!                         turn by turn, never ahead of the clock
//! ```
//!
//! The rig is the same as in virtual time; only the source of its clock differs. Each turn runs it
//! up to the present, carries bytes and events across, and waits for the rig's next event or for a
//! client. After a short delay the rig catches up in small slices, so that no virtual time is
//! skipped and a client can read and answer in between. A delay of more than 20 ms stops rig time,
//! where the clock can stop: clients get no burst of data, and rules that they break because of it
//! are excused. Nothing here is exact to better than a few hundred microseconds, and the lateness
//! is measured: verdicts come from virtual time.

mod adapter;
pub mod bridge;
pub mod clock;
pub mod control;
pub mod exec;
mod garbled;
pub mod guest;
pub mod held;
pub mod inputs;
mod lateness;
mod losses;
mod place;
pub mod playback;
mod plug;
mod port;
mod port_report;
pub mod process;
mod spread;
pub mod standalone;
pub mod tap;
pub mod transport;

use core::time::Duration;
use std::os::fd::OwnedFd;
use std::sync::Arc;

use emulators::{Event, EventKind};
use protocols::{Instant, LineEvent};

use crate::clock::{Clock, WallClock};
use crate::transport::{Special, Transport, TransportError, stirred, wait};
use engine::rig::{Paced, PortRate, Rig, Rigs};
use engine::robots::OpenEnd;
use engine::scenario::Scenario;

use adapter::Adapter;
use garbled::Garbled;
use inputs::Inputs;
pub use lateness::LATE;
pub use lateness::Lateness;
use losses::Losses;
pub(crate) use place::Openings;
pub use place::{Place, Sign, Traffic};
pub use port_report::PortReport;
use spread::Spread;

/// Maximum virtual time of one turn. A rig that is later than this takes several turns, so that
/// clients can read and answer in between.
const SLICE: Duration = Duration::from_millis(5);
/// Minimum time between two turns while no client sends. Single bytes at 1 Mbaud are 10 us apart;
/// waking up for each would take a whole processor, and no client could tell the difference.
const GRAIN: Duration = Duration::from_micros(200);
/// Minimum time between two turns while catching up, so that clients can run.
const BREATH: Duration = Duration::from_millis(1);
/// Maximum wait, because some ports cannot wake this thread.
const WAIT_MAX: Duration = Duration::from_millis(5);
/// Time after a late turn, in addition to the lateness itself, until rules count again.
const SETTLES: Duration = Duration::from_millis(100);
/// Rig time between two notes about a late rig: a rig that is always late must not fill the log.
const NOTES_EVERY: Duration = Duration::from_secs(1);
/// Maximum number of a client's bytes that wait for the line; then the rig reads no more, as a
/// UART's driver.
const BACKLOG_MAX: usize = 4096;

/// Runs a rig at the pace of a clock.
pub struct Realtime<C> {
    clock: C,
    ports: Vec<Port>,
    lateness: Lateness,
    /// Number of times that rig time stopped because the rig was late, and the length of the last
    /// stop.
    stalls: (u64, Duration),
    /// Time of the last note about lateness.
    noted_at: Option<Instant>,
    is_prompt: bool,
}

/// An end of a link, and its transport.
struct Port {
    end: OpenEnd,
    transport: Box<dyn Transport>,
    traffic: Traffic,
    is_open: bool,
    openings: u64,
    baud: u32,
    /// Rates of client and other end, as last logged, if they do not understand each other.
    wrong_rate: Option<(u32, u32)>,
    garbled: Garbled,
    special: [Special; 2],
    adapter: Option<Adapter>,
    spread: Spread,
    losses: Losses,
    is_unplugged: bool,
    /// Modem lines for which the client may have to wait.
    inputs: Option<Inputs>,
}

impl<C: Clock> Realtime<C> {
    /// Paced by `clock`, whose zero is the rig's zero.
    pub fn new(clock: C) -> Self {
        Self {
            clock,
            ports: Vec::new(),
            lateness: Lateness::default(),
            stalls: (0, Duration::ZERO),
            noted_at: None,
            is_prompt: false,
        }
    }

    /// Puts an end of a link on a transport.
    pub fn serve(&mut self, end: OpenEnd, transport: Box<dyn Transport>) {
        self.ports.push(Port {
            baud: end.line.baud,
            end,
            transport,
            traffic: Traffic::default(),
            is_open: false,
            openings: 0,
            wrong_rate: None,
            garbled: Garbled::default(),
            special: [Special::default(); 2],
            adapter: None,
            spread: Spread::default(),
            losses: Losses::default(),
            is_unplugged: false,
            inputs: None,
        });
    }

    /// Puts the adapters that `scenario` names between the ports served so far and their clients.
    pub fn plug_in(&mut self, scenario: &Scenario, rig: &mut Rig) {
        self.plug_in_of(0, scenario, rig);
    }

    /// As [`plug_in`](Self::plug_in), for the ports of the robot with the index `robot`.
    pub(crate) fn plug_in_of(&mut self, robot: usize, scenario: &Scenario, rig: &mut Rig) {
        for (name, spec) in &scenario.link {
            let is_meant = |end: &OpenEnd| end.robot == robot && end.link == *name;
            let ports = self.ports.iter_mut().filter(|port| is_meant(&port.end));
            for port in ports {
                port.adapter = Adapter::new(spec.adapter, name, scenario.seed, rig.now());
                // The adapter cuts between bytes, so they must arrive one by one.
                if let Some(link) = rig.link_mut(name).filter(|_| port.adapter.is_some()) {
                    link.lines.iter_mut().for_each(|line| line.piece = 1);
                }
            }
        }
        let names: Vec<String> = self.names().map(str::to_owned).collect();
        for (index, name) in names.iter().enumerate() {
            self.ports[index].inputs = Some(Inputs::of(name, self.places()));
        }
    }

    /// The clock.
    pub const fn clock(&self) -> &C {
        &self.clock
    }

    /// Lateness of all events so far.
    pub const fn lateness(&self) -> &Lateness {
        &self.lateness
    }

    /// Number of times that rig time stopped because the rig was late, and the length of the last
    /// stop.
    pub const fn stalls(&self) -> (u64, Duration) {
        self.stalls
    }

    /// Bytes that passed each port so far, and the lost ones.
    pub fn reports(&self) -> impl Iterator<Item = PortReport> {
        self.ports.iter().map(|port| PortReport {
            name: port.end.name.clone(),
            traffic: port.traffic,
            lost: port.transport.counters(),
        })
    }

    /// The names of the ports.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.ports.iter().map(|port| port.end.name.as_str())
    }

    /// Names and addresses of the ports.
    pub fn places(&self) -> impl Iterator<Item = Place<'_>> + Clone {
        self.ports.iter().map(|port| Place {
            name: &port.end.name,
            path: port.transport.path(),
            baud: port.end.line.baud,
            node: port.end.node,
        })
    }

    /// Observations of each client, without the content of its bytes.
    pub fn signs(&mut self) -> impl Iterator<Item = Sign<'_>> {
        self.ports.iter_mut().map(|port| Sign {
            name: &port.end.name,
            is_open: port.is_open,
            openings: port.openings,
            from_client: port.traffic.from_client,
            to_client: port.traffic.to_client,
            lost: port.transport.counters(),
            special: port.all_special(),
            wrong_rate: port.wrong_rate,
            garbled: port.garbled,
            settings: port.transport.modes(),
            is_drained: port.transport.is_drained(),
            reads: port.transport.reads(),
        })
    }

    /// Carries bytes and events across in both directions, without reading the clock.
    ///
    /// # Errors
    /// If a port disappeared.
    pub fn carry(&mut self, paced: &mut impl Paced) -> Result<(), TransportError> {
        let all = vec![true; self.ports.len()];
        self.carry_from(&all, paced)
    }

    /// Carries bytes and events across, except for changed rates of clients, which are noticed with
    /// the client's next bytes. One poll of all ports finds the active ones.
    ///
    /// # Errors
    /// As [`carry`](Self::carry).
    pub(crate) fn carry_stirred(&mut self, paced: &mut impl Paced) -> Result<(), TransportError> {
        let transports = self.ports.iter().map(|port| &*port.transport);
        let stirred = stirred(transports);
        self.carry_from(&stirred, paced)
    }

    /// Carries bytes and events across while no supervised client has used its port. Reads no port.
    ///
    /// # Errors
    /// As [`carry`](Self::carry).
    pub(crate) fn carry_resting(&mut self, paced: &mut impl Paced) -> Result<(), TransportError> {
        if !self.rests() {
            return self.carry_stirred(paced);
        }
        for port in &mut self.ports {
            port.carry_plug(paced)?;
            port.carry_out(paced.rig_of_mut(port.end.robot));
            port.hold_back(paced.rig_of_mut(port.end.robot));
        }
        Ok(())
    }

    /// Whether no port has bytes or events of a client, as long as no client uses its port.
    pub(crate) fn rests(&self) -> bool {
        let mut ports = self.ports.iter();
        ports.all(|port| port.transport.rests() && port.spread.is_empty())
    }

    fn carry_from(
        &mut self,
        wanted: &[bool],
        paced: &mut impl Paced,
    ) -> Result<(), TransportError> {
        for (port, is_wanted) in self.ports.iter_mut().zip(wanted) {
            if *is_wanted || !port.spread.is_empty() {
                port.carry_in(paced)?;
            }
        }
        for port in &mut self.ports {
            port.carry_plug(paced)?;
            port.carry_out(paced.rig_of_mut(port.end.robot));
            port.hold_back(paced.rig_of_mut(port.end.robot));
        }
        Ok(())
    }

    /// Modem lines as the client of the port `index` gets them from TIOCMGET.
    pub(crate) fn input_lines(&self, index: usize, rigs: &impl Rigs) -> u32 {
        let port = &self.ports[index];
        let rig = rigs.rig_of(port.end.robot);
        port.inputs.map_or(0, |inputs| inputs.bits(rig))
    }

    /// Whether the rigs have bytes for a client now.
    pub(crate) fn has_output(&self, rigs: &impl Rigs) -> bool {
        self.ports.iter().any(|port| {
            let rig = rigs.rig_of(port.end.robot);
            let is_due = |adapter: &Adapter| adapter.expires_at() <= rig.now();
            rig.output_len(port.end.node) > 0 || port.adapter.as_ref().is_some_and(is_due)
        })
    }

    /// Time at which an adapter next delivers its bytes.
    pub(crate) fn next_expiry(&self) -> Option<Instant> {
        let adapters = self.ports.iter().filter_map(|port| port.adapter.as_ref());
        adapters.map(Adapter::expires_at).min()
    }

    /// Whether only the rig affects the ports: bytes reach each client when they arrive, no byte of
    /// a client is in flight, no CTS line holds back a client's bytes, no device changes a modem
    /// line meanwhile, and all ports belong to the first robot.
    pub(crate) fn is_plain(&self) -> bool {
        self.ports.iter().all(|port| {
            port.end.robot == 0
                && port.adapter.is_none()
                && port.spread.is_empty()
                && port.transport.rests()
                && !port.transport.has_flow_control()
                && !port.inputs.is_some_and(|inputs| inputs.are_wired())
        })
    }

    /// The outside end of the port `index`, in the rig of its robot.
    pub(crate) fn node(&self, index: usize) -> usize {
        self.ports[index].end.node
    }

    /// Index of the robot of the port `index`.
    pub(crate) fn robot(&self, index: usize) -> usize {
        self.ports[index].end.robot
    }

    /// Bytes that were brought to the client of the port `index` so far, the number of openings,
    /// and whether a client is there.
    pub(crate) fn state(&self, index: usize) -> (u64, Openings) {
        let port = &self.ports[index];
        let openings = Openings {
            count: port.openings,
            is_open: port.is_open,
        };
        (port.traffic.to_client, openings)
    }

    /// Bytes of the client of the port `index` that the line has not taken.
    pub(crate) fn backlog(&self, index: usize, rigs: &impl Rigs) -> usize {
        let end = &self.ports[index].end;
        rigs.rig_of(end.robot).backlog(end.node)
    }

    /// Number of bytes that the client of the port `index` may send now.
    pub(crate) fn room(&self, index: usize, rigs: &impl Rigs) -> usize {
        BACKLOG_MAX.saturating_sub(self.backlog(index, rigs))
    }

    /// The client's side of the port `index`, if this process can open it.
    pub(crate) fn client_side(&self, index: usize) -> Option<OwnedFd> {
        self.ports[index].transport.client_side()
    }

    /// Applies a line event of the client of the port `index`.
    pub(crate) fn change_line(&self, index: usize, event: LineEvent, paced: &mut impl Paced) {
        let end = &self.ports[index].end;
        paced.rig_of_mut(end.robot).change_line(end.node, event);
        let now = paced.rig().now();
        paced.run_until(now);
    }

    /// Passes bytes to the rig as if the client of the port `index` had sent them.
    pub(crate) fn inject(&self, index: usize, bytes: &[u8], paced: &mut impl Paced) {
        let end = &self.ports[index].end;
        paced.rig_of_mut(end.robot).inject(end.node, bytes);
        let now = paced.rig().now();
        paced.run_until(now);
    }

    /// Returns the transports in the order in which they were served.
    pub fn into_transports(self) -> Vec<Box<dyn Transport>> {
        self.ports.into_iter().map(|port| port.transport).collect()
    }

    /// Advances `paced` to the present, or by one slice; carries bytes and events across; waits for
    /// the next event.
    ///
    /// # Errors
    /// If a port disappeared. The rig has handled it and may continue without that port.
    pub fn turn(&mut self, paced: &mut impl Paced) -> Result<(), TransportError> {
        if !self.is_prompt {
            // In the first turn, not in `new`: a program that is started before the first turn
            // keeps the usual scheduling.
            self.is_prompt = true;
            clock::be_prompt();
            // The time of slow node programs: their answers make the rig late.
            let wall = WallClock::start();
            let stopwatch: engine::rig::Stopwatch = Arc::new(move || wall.now() - Instant::ZERO);
            paced.rig().measure_nodes(&stopwatch);
        }
        let mut present = self.clock.now();
        let due = paced.rig().next_event().filter(|&due| due <= present);
        if let Some(due) = due {
            let late = present - due;
            self.lateness.record(late);
            let behind = present - paced.rig().now();
            if late > LATE && self.clock.slip(behind) {
                self.lateness.stand(behind);
                self.stalls = (self.stalls.0 + 1, late);
                self.wait_for_clients(paced.rig(), late);
                for port in &mut self.ports {
                    port.carry_late(paced, late)?;
                }
                present = self.clock.now();
            }
        }
        let target = present.min(paced.rig().now() + SLICE);
        paced.run_until(target);
        self.carry(paced)?;
        self.wait(paced.rig(), target < present);
        Ok(())
    }

    /// Logs that rig time stood because the rig was late. Rules that clients break in the following
    /// burst of bytes do not count.
    fn wait_for_clients(&mut self, rig: &mut Rig, late: Duration) {
        let at = rig.now();
        rig.excuse_until(at + late + SETTLES);
        if self.noted_at.is_some_and(|noted| at - noted < NOTES_EVERY) {
            return;
        }
        self.noted_at = Some(at);
        let event = Event {
            at,
            kind: EventKind::Note,
            rule: "rig-late",
            detail: format!("by {} ms: rig time stood meanwhile", late.as_millis()),
            bytes: Vec::new(),
        };
        rig.log("rig", event);
    }

    /// Waits for the next event unless a client sends, or for a moment if the rig `is_behind` its
    /// clock.
    fn wait(&self, rig: &Rig, is_behind: bool) {
        let now = self.clock.now();
        let adapters = self.ports.iter().filter_map(|port| port.adapter.as_ref());
        let next = rig.next_event();
        let next = next
            .into_iter()
            .chain(adapters.map(Adapter::expires_at))
            .min();
        let next = next.map_or(WAIT_MAX, |next| self.clock.lasts(next - now));
        let timeout = match is_behind {
            true => BREATH,
            false => next.min(WAIT_MAX).max(GRAIN),
        };
        let mut fds = Vec::new();
        for port in &self.ports {
            // A port that is not read because its backlog is full would end the wait at once.
            if rig.backlog(port.end.node) < BACKLOG_MAX && port.spread.is_empty() {
                port.transport.readiness(&mut fds);
            }
        }
        if fds.is_empty() || wait(&fds, timeout).is_err() {
            self.clock.sleep_until(now + timeout);
        }
    }
}

#[cfg(test)]
mod tests;
