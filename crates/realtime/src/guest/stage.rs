//! The rig of a foreign program in virtual time: its clock and its ports.
//!
//! The times of program and rig run together, but rig time begins when the program has opened its
//! ports.

mod ahead;
mod rewind;
mod terminals;

use core::time::Duration;
use std::collections::BTreeSet;
use std::os::unix::fs::MetadataExt as _;

use protocols::{Instant, LineEvent};

use crate::clock::SimClock;
use crate::exec::{Ports, Readiness};
use crate::inputs::INPUTS;
use crate::transport::TransportError;
use crate::{BACKLOG_MAX, Openings, Realtime};
use ahead::Foreseen;
use engine::rig::{Paced as _, Rigs as _};
use engine::run::Run;
pub(super) use rewind::StageMoment;

/// Interval between two observations of the program at its ports, and maximum step of time.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// Bits of modem lines, as TIOCMGET has them.
const DTR: u32 = 0x002;
const RTS: u32 = 0x004;
const OUTPUTS: u32 = DTR | RTS;

/// A port as its client sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slot {
    /// The device's number.
    device: u64,
    /// Number of ports that have existed at this place so far.
    made: u64,
    /// Number of bytes delivered to its client at the last look, and the time of the last delivery.
    brought: u64,
    heard: Instant,
    openings: Openings,
    /// Whether bytes have arrived since the last query.
    has_arrived: bool,
    /// Whether the client may send.
    may_send: bool,
    /// Whether the client uses the port exclusively (TIOCEXCL).
    pub(super) is_exclusive: bool,
    /// Flags that a client has set with TIOCSSERIAL.
    pub(super) serial_flags: u32,
    /// Bits of DTR and RTS, as the client has set them.
    outputs: u32,
    /// The ports of the pins through which DTR and RTS reach a device, one byte per level.
    pins: [Option<usize>; 2],
    /// Bits of the lines that the client sees, and the number of changes of each: CTS, DSR, RI,
    /// DCD.
    inputs: u32,
    changes: [u32; 4],
}

impl Slot {
    /// Stores the input lines and counts their changes. For RI only a falling level counts, as in a
    /// 16550 and its driver.
    fn note_inputs(&mut self, inputs: u32) {
        let changed = core::mem::replace(&mut self.inputs, inputs) ^ inputs;
        for (count, input) in self.changes.iter_mut().zip(INPUTS) {
            let is_end = input.name != "ri" || inputs & input.bit == 0;
            if changed & input.bit != 0 && is_end {
                *count += 1;
            }
        }
    }
}

/// The rig, its ports and the time.
pub(super) struct Stage {
    pub(super) run: Run,
    pub(super) realtime: Realtime<SimClock>,
    pub(super) ports: Ports,
    readiness: Readiness,
    now: Instant,
    /// The program's time at which rig time began, and rig time at that moment.
    begun: Option<Instant>,
    zero: Instant,
    /// Whether the run continues after its mission is over.
    pub(super) is_endless: bool,
    /// Whether rig time stands because the run is over.
    pub(super) is_frozen: bool,
    slots: Vec<Slot>,
    /// Numbers of devices that have hung up.
    gone: BTreeSet<u64>,
    /// Number of consecutive calls at such a device that did not wait.
    fruitless: u32,
    /// The message about these calls.
    pub(super) busy: Option<String>,
    has_delivered: bool,
    /// Whether the program may have acted on a port, other than by sending.
    is_touched: bool,
    /// Whether the program may have sent to, opened or closed a port.
    is_stirred: bool,
    next_look: Instant,
    foreseen: Option<Foreseen>,
    /// Rig time of the last observation of the ports.
    observed_at: Instant,
    /// The pipe for the program's output: device and number.
    pub(super) mouth: (u64, u64),
}

impl Stage {
    /// A stage for `run`. `ports` holds the observations of the ports that `realtime` serves.
    pub(super) fn new(
        run: Run,
        mut realtime: Realtime<SimClock>,
        ports: Ports,
        wait: Duration,
        mouth: (u64, u64),
    ) -> Self {
        realtime.model_terminals();
        let names: Vec<String> = realtime.names().map(str::to_owned).collect();
        let pin = |name: &str, pin| {
            let wanted = format!("{name}-{pin}");
            names.iter().position(|other| *other == wanted)
        };
        let slots = realtime.places().map(|place| Slot {
            pins: [pin(place.name, "dtr"), pin(place.name, "rts")],
            device: std::fs::metadata(place.path).map_or(0, |data| data.rdev()),
            made: 1,
            brought: 0,
            heard: Instant::ZERO,
            openings: Openings::default(),
            has_arrived: false,
            may_send: true,
            is_exclusive: false,
            serial_flags: 0,
            outputs: 0,
            inputs: 0,
            changes: [0; 4],
        });
        let mut slots: Vec<Slot> = slots.collect();
        for (port, slot) in slots.iter_mut().enumerate() {
            slot.inputs = realtime.input_lines(port, &run);
        }
        Self {
            slots,
            zero: run.rig.now(),
            is_endless: false,
            run,
            realtime,
            ports,
            readiness: Readiness::new(wait),
            now: Instant::ZERO,
            begun: None,
            gone: BTreeSet::new(),
            fruitless: 0,
            busy: None,
            is_frozen: false,
            has_delivered: false,
            is_touched: false,
            is_stirred: false,
            next_look: Instant::ZERO,
            foreseen: None,
            observed_at: Instant::ZERO,
            mouth,
        }
    }

    /// The program's time.
    pub(super) const fn now(&self) -> Instant {
        self.now
    }

    /// Whether the rig's time runs.
    pub(super) const fn has_begun(&self) -> bool {
        self.begun.is_some()
    }

    /// Rig time at the program's time `at`; `None` while rig time stands.
    fn rig_time(&self, at: Instant) -> Option<Instant> {
        let begun = self.begun.filter(|_| !self.is_frozen)?;
        Some(self.zero + (at - begun))
    }

    /// Starts rig time, if it has not started yet.
    pub(super) fn begin(&mut self) {
        self.begun.get_or_insert(self.now);
    }

    /// Whether the run is over.
    pub(super) fn is_over(&self) -> bool {
        !self.is_endless && self.run.is_over()
    }

    fn advance(&mut self, deadline: Instant) {
        match self.is_endless {
            true => self.run.go_on_until(deadline),
            false => self.run.run_until(deadline),
        }
    }

    /// Time of the rig's next event, in the program's time: until then reading a clock has no
    /// effect on other threads. `None`: there is no such event.
    pub(super) fn quiet_until(&self) -> Option<Instant> {
        if self.is_touched {
            return Some(self.now);
        }
        let rig_now = self.rig_time(self.now)?;
        let next = self.run.next_event()?;
        Some(self.now + (next - rig_now))
    }

    /// Sets the program's time to `now`, which its own clocks have reached without an event.
    pub(super) fn has_counted(&mut self, now: Instant) {
        self.now = self.now.max(now);
    }

    /// Advances time by `cost`, the virtual time of a call.
    pub(super) fn pass(&mut self, cost: Duration) -> Result<(), TransportError> {
        self.now += cost;
        let Some(rig_now) = self.rig_time(self.now) else {
            return Ok(());
        };
        if self.run.next_event().is_some_and(|at| at <= rig_now) {
            self.advance(rig_now);
            if self.realtime.has_output(&self.run) {
                return self.carry();
            }
        }
        Ok(())
    }

    /// Lets time pass while no thread can run: until the next event at a port, at most until
    /// `deadline`, and only for a short time. `watches`: free room in the line counts as an event
    /// as well.
    pub(super) fn leap(
        &mut self,
        deadline: Option<Instant>,
        watches: bool,
    ) -> Result<(), TransportError> {
        let most = self.now + LOOK_EVERY;
        let limit = deadline.map_or(most, |at| at.min(most)).max(self.now);
        loop {
            let Some(rig_now) = self.rig_time(self.now) else {
                self.now = limit;
                break;
            };
            let ahead = |at: Instant| self.now + (at - rig_now);
            let next = self.run.next_event().into_iter();
            let next = next.chain(self.realtime.next_expiry()).map(ahead).min();
            self.now = next.map_or(limit, |at| at.clamp(self.now, limit));
            if let Some(target) = self.rig_time(self.now) {
                self.advance(target);
            }
            let is_something = self.realtime.has_output(&self.run) || watches;
            if is_something || self.now >= limit || self.is_over() {
                break;
            }
        }
        self.carry()
    }

    /// Records that the program is about to act on a port, other than by sending.
    pub(super) const fn touch(&mut self) {
        self.is_touched = true;
    }

    /// Records that the program may send to, open or close a port before the next stop.
    pub(super) const fn stir(&mut self) {
        self.is_stirred = true;
    }

    /// Transfers pending bytes in both directions if the program touched a port.
    pub(super) fn carry_touched(&mut self) -> Result<(), TransportError> {
        match self.is_touched {
            true => self.carry(),
            false => Ok(()),
        }
    }

    /// Transfers pending bytes in both directions now.
    pub(super) fn carry(&mut self) -> Result<(), TransportError> {
        let is_stirred = core::mem::take(&mut self.is_stirred);
        let is_touched = core::mem::take(&mut self.is_touched);
        let is_looked_at = is_touched || self.now >= self.next_look;
        // An action of the program happens at its own time, so the rig must advance to this time
        // first.
        if is_stirred || is_looked_at {
            self.forget_foreseen();
            if let Some(rig_now) = self.rig_time(self.now) {
                self.advance(rig_now);
            }
        }
        // Ports that no client has used need no check, so this makes no call.
        let is_quiet = !is_touched && !is_stirred && self.realtime.rests();
        match is_looked_at {
            true if !is_quiet => self.realtime.carry(&mut self.run)?,
            false if is_stirred => self.realtime.carry_stirred(&mut self.run)?,
            _ => self.realtime.carry_resting(&mut self.run)?,
        }
        let mut has_delivered = false;
        let mut turned = Vec::new();
        let now = self.now;
        for (port, slot) in self.slots.iter_mut().enumerate() {
            let (brought, openings) = self.realtime.state(port);
            if brought != slot.brought {
                slot.brought = brought;
                slot.heard = now;
                slot.has_arrived = true;
                has_delivered = true;
            }
            let inputs = self.realtime.input_lines(port, &self.run);
            if inputs != slot.inputs {
                slot.note_inputs(inputs);
                has_delivered = true;
            }
            let may_send = self
                .realtime
                .terminal(port)
                .is_none_or(|it| !it.is_stopped());
            has_delivered |= may_send && !core::mem::replace(&mut slot.may_send, may_send);
            let made = self.realtime.made(port);
            let is_there = self.realtime.terminal(port).is_some();
            if (slot.device != 0 && !is_there) || made != slot.made {
                // The plug was pulled: files that its clients have open are hung up for good.
                self.gone.extend((slot.device != 0).then_some(slot.device));
                slot.device = 0;
                has_delivered = true;
            }
            if is_there && slot.device == 0 {
                let path = self.realtime.places().nth(port).map(|place| place.path);
                let data = path.and_then(|path| std::fs::metadata(path).ok());
                slot.device = data.map_or(0, |data| data.rdev());
                slot.made = made;
                self.gone.remove(&slot.device);
            }
            let before = core::mem::replace(&mut slot.openings, openings);
            if before != openings {
                turned.push((port, before));
            }
        }
        if !turned.is_empty() {
            // A client that opens and closes between two looks still counts. Rig time starts at the
            // stop after the opening, so that the pauses between the first bytes pass at the rig.
            self.look();
        }
        // A serial port raises its lines when it is opened, and lowers them when it is closed.
        for (port, before) in turned {
            self.slots[port].is_exclusive = false;
            for is_open in before.steps_to(self.slots[port].openings) {
                self.set_modem(port, if is_open { OUTPUTS } else { 0 });
            }
        }
        self.has_delivered |= has_delivered;
        if now >= self.next_look {
            self.next_look = now + LOOK_EVERY;
            self.look();
        }
        Ok(())
    }

    /// Observes the program at its ports.
    pub(super) fn look(&mut self) {
        self.observe();
        let waited = self.now - Instant::ZERO;
        if self.begun.is_none() && self.readiness.is_ready(&self.ports, waited) {
            self.begun = Some(self.now);
        }
    }

    fn observe(&mut self) {
        let rig_now = self.run.rig.now();
        let on_time = match self.begun {
            // The time since the last observation. A port may also be observed in between, when it
            // is opened.
            Some(_) => rig_now - core::mem::replace(&mut self.observed_at, rig_now),
            None => Duration::ZERO,
        };
        for sign in self.realtime.signs() {
            self.ports.observe(rig_now, on_time, &sign);
        }
    }

    /// Whether the program has opened no port within the permitted time.
    pub(super) fn gave_up(&self) -> bool {
        let waited = self.now - Instant::ZERO;
        self.begun.is_none() && self.readiness.has_given_up(&self.ports, waited)
    }

    /// Whether bytes have arrived for the program since the last call.
    pub(super) const fn take_delivered(&mut self) -> bool {
        core::mem::replace(&mut self.has_delivered, false)
    }

    /// The ports at which bytes have arrived since the last call.
    pub(super) fn take_arrived(&mut self) -> Vec<usize> {
        let slots = self.slots.iter_mut().enumerate();
        let arrived =
            slots.filter_map(|(port, slot)| core::mem::take(&mut slot.has_arrived).then_some(port));
        arrived.collect()
    }

    /// The port with this device number.
    pub(super) fn port_of(&self, device: u64) -> Option<usize> {
        self.slots
            .iter()
            .position(|slot| slot.device == device && device != 0)
    }

    /// The path of a port for the client.
    pub(super) fn path_of(&self, port: usize) -> Option<String> {
        let place = self.realtime.places().nth(port)?;
        Some(place.path.to_string_lossy().into_owned())
    }

    /// Number of bytes that the client may write now. After the run the rig takes no bytes; without
    /// a limit here, a program that waits for room could not end.
    pub(super) fn room(&mut self, port: usize) -> usize {
        if self.is_frozen {
            return BACKLOG_MAX;
        }
        if self.terminal(port).is_some_and(|it| it.is_stopped()) {
            return 0;
        }
        self.realtime.room(port, &self.run)
    }

    /// Whether bytes of the client are lost: after the run, beyond the room of the rig.
    pub(super) fn discards(&self, port: usize) -> bool {
        self.is_frozen && self.realtime.room(port, &self.run) == 0
    }

    /// Number of written bytes that the line has not taken. After the run it is 0, because the line
    /// takes none, and a program that waits for them to leave could not end.
    pub(super) fn backlog(&self, port: usize) -> usize {
        if self.is_frozen {
            return 0;
        }
        self.realtime.backlog(port, &self.run)
    }

    /// Time at which the next written byte of the client arrives, and the node of the rig that
    /// receives it.
    pub(super) fn arrival_of_next(&self, port: usize) -> (Instant, Option<usize>) {
        let rig = self.run.rig_of(self.realtime.robot(port));
        let node = self.realtime.node(port);
        let lines = rig.links().iter().flat_map(|link| &link.lines);
        let Some(line) = lines.into_iter().find(|line| line.from.node == node) else {
            return (rig.now(), None);
        };
        let [sender, _] = rig.line_configs(line);
        let before = u64::try_from(rig.backlog(node)).unwrap_or(0);
        let begins = line.free_at().max(rig.now());
        let arrives = begins + sender.bytes_time(before + 1) + line.latency;
        (arrives, Some(line.to.node))
    }

    /// Time of the last delivery of the port.
    pub(super) fn heard(&self, port: usize) -> Instant {
        self.slots[port].heard
    }

    /// The modem lines of a port, as TIOCMGET has them.
    pub(super) fn modem(&self, port: usize) -> u32 {
        self.slots[port].outputs | self.slots[port].inputs
    }

    /// Number of changes of CTS, DSR, RI and DCD of a port, as drivers count them.
    pub(super) fn line_changes(&self, port: usize) -> [u32; 4] {
        self.slots[port].changes
    }

    /// Sets the modem lines of the client.
    pub(super) fn set_modem(&mut self, port: usize, lines: u32) {
        self.forget_foreseen();
        let slot = &mut self.slots[port];
        let changed = (slot.outputs ^ lines) & OUTPUTS;
        slot.outputs = lines & OUTPUTS;
        let pins = slot.pins;
        for (pin, line) in pins.into_iter().zip([DTR, RTS]) {
            if let Some(pin) = pin.filter(|_| changed & line != 0) {
                let level = u8::from(lines & line != 0);
                self.realtime.inject(pin, &[level], &mut self.run);
            }
        }
    }

    /// Sends a break of the client.
    pub(super) fn send_break(&mut self, port: usize) {
        self.forget_foreseen();
        self.realtime
            .change_line(port, LineEvent::Break, &mut self.run);
    }
}

#[cfg(test)]
mod tests;
