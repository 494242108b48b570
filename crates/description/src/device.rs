//! The device that a description defines.

mod act;
mod faults;
mod hear;
mod modbus;
mod scope;
pub(crate) mod shared;

use core::time::Duration;
use std::collections::VecDeque;
use std::sync::Arc;

use emulators::device::{BrokenRules, Device, Event, EventKind, take};
use emulators::event_log::EventLog;
use emulators::rng::Rng;
use emulators::world::World;
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::addressed::AddressField;
use crate::description::{Description, Protocol};
use crate::framing::{Cutter, Overlong};
use crate::schema::behaviour::EventSpec;
use crate::schema::message::From;
use crate::state::State;
use crate::value::{Record, Value};
use act::{Doer, Timer};
use faults::Faults;
pub use hear::{MISSING_PAUSE, no_pause};
use shared::Heard;

/// Maximum number of queued replies.
const QUEUE_MAX: usize = 32;
/// Maximum number of bytes in the transmit buffer.
const OUTPUT_MAX: usize = 8_192;

/// The identity of a device in its rig, which the description cannot contain.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Name in the rig; it selects the random stream.
    pub name: String,
    /// Seed of the run.
    pub seed: u64,
    /// Address, instead of the description's.
    pub address: Option<u32>,
    /// Whether the device is alone on its wire: a request for another address is then an error of
    /// the driver.
    pub is_alone: bool,
}

/// A described device. Devices of one kind share their description.
#[derive(Clone)]
pub struct Described {
    description: Arc<Description>,
    place: Place,
    state: State,
    cutter: Cutter,
    /// Idle time after which a partial frame is discarded.
    idle: Duration,
    /// Whether a silence ends the frames that a driver sends.
    is_silence_framed: bool,
    /// Bytes received since the last poll, with the time at which the last byte ended.
    inbox: VecDeque<(Instant, Vec<u8>)>,
    /// Memory of bytes that have been processed, for the next ones.
    spare: Vec<u8>,
    /// Time at which the silence is long enough to end a frame.
    quiet_at: Option<Instant>,
    /// Bytes of a frame that a silence will end.
    silent: Vec<u8>,
    /// Number of its bytes, also of those that are not kept.
    silent_len: u64,
    overlong: Overlong,
    watchdog_at: Option<Instant>,
    /// Frames to be sent, with their times.
    pending: VecDeque<(Instant, Vec<u8>)>,
    output: VecDeque<u8>,
    /// End of the transmission.
    sending_until: Instant,
    busy_until: Instant,
    /// End of the start of the device.
    boot_until: Option<Instant>,
    /// Events that have not been processed yet.
    events: VecDeque<(Instant, EventSpec)>,
    timers: Vec<Timer>,
    faults: Faults,
    dice: Rng,
    log: EventLog,
    /// Frames that the device knows and those that it does not, on a shared wire.
    heard: Heard,
    /// Whether a frame was among the received bytes.
    has_framed: bool,
    /// The addresses of all devices of the link.
    link_addresses: Arc<[u32]>,
    /// The field of requests that holds the address; without one, and for Modbus, `None`.
    address_field: Option<Arc<AddressField>>,
}

impl Described {
    /// The serial port of the device.
    pub const UART: Port = Port(0);

    /// A device that is powered on when the run begins.
    pub fn new(description: Arc<Description>, place: Place) -> Self {
        let state = State::new(description.variables.clone(), place.seed, &place.name);
        let dice = Rng::stream(place.seed, &format!("{}.behaviour", place.name));
        let mut device = Self {
            cutter: description.cutter_of(From::Host),
            idle: description.idle(),
            is_silence_framed: matches!(description.protocol, Some(Protocol::ModbusRtu))
                || description.ends_with_silence(),
            state,
            inbox: VecDeque::new(),
            spare: Vec::new(),
            quiet_at: None,
            silent: Vec::new(),
            silent_len: 0,
            overlong: Overlong::default(),
            watchdog_at: None,
            pending: VecDeque::new(),
            output: VecDeque::new(),
            sending_until: Instant::ZERO,
            busy_until: Instant::ZERO,
            boot_until: None,
            events: VecDeque::new(),
            timers: Vec::new(),
            faults: Faults::default(),
            dice,
            log: EventLog::default(),
            heard: Heard::default(),
            has_framed: false,
            link_addresses: Arc::new([]),
            address_field: description.address_field().map(Arc::new),
            description,
            place,
        };
        device.link_addresses = Arc::new([device.address()]);
        device.begin(Instant::ZERO);
        device
    }

    /// Puts the device on a link whose devices have these addresses.
    pub(crate) fn join(&mut self, addresses: Arc<[u32]>) {
        self.link_addresses = addresses;
    }

    /// Its description.
    pub const fn description(&self) -> &Arc<Description> {
        &self.description
    }

    /// The address on the wire; 1 if the description has none.
    pub fn address(&self) -> u32 {
        self.place.address.or(self.description.address).unwrap_or(1)
    }

    /// Sets the variable called `name`.
    ///
    /// # Errors
    /// If there is no such variable, it is computed or measured, or it cannot have this value.
    pub fn set(&mut self, name: &str, value: Value) -> Result<(), String> {
        self.state.set(name, value)
    }

    /// The variables of the device: address of the register if there is one, name, value, and value
    /// in words.
    pub fn values(&self, now: Instant, world: &World) -> Vec<(Option<u32>, String, Value, String)> {
        let known = self.description.variables.iter().enumerate();
        let rows = known.map(|(index, variable)| {
            let value = self.state.read(index, now, world);
            let words = variable.words(&value);
            let at = self
                .description
                .registers
                .as_ref()
                .and_then(|all| all.address_of(index));
            (at, variable.name.to_string(), value, words)
        });
        rows.collect()
    }

    /// Resets everything except the variables at `now`. Received bytes that were not processed yet
    /// ended later.
    fn begin(&mut self, now: Instant) {
        self.cutter = self.description.cutter_of(From::Host);
        self.quiet_at = None;
        self.silent.clear();
        self.overlong = Overlong::default();
        self.watchdog_at = None;
        self.pending.clear();
        // Bytes that a prompt line has taken before `now` are on the wire.
        let left = self.sending_until.as_nanos().saturating_sub(now.as_nanos());
        let byte = self.description.line.byte_time().as_nanos().max(1);
        let left = usize::try_from(u128::from(left) / byte).unwrap_or(usize::MAX);
        self.output.truncate(self.output.len().saturating_sub(left));
        self.sending_until = now;
        self.busy_until = now;
        self.events.clear();
        let up = now + self.description.boot.unwrap_or(Duration::ZERO);
        self.boot_until = self.description.boot.map(|_| up);
        self.timers = Timer::of(&self.description, up);
        if self.boot_until.is_none() {
            self.events.push_back((now, EventSpec::Start));
        }
    }

    /// Restarts the device.
    fn restart(&mut self, now: Instant, why: &str) {
        self.state.restart(now);
        self.begin(now);
        self.log.note(now, "restarted", why.to_owned());
        self.send_garbage(now);
    }

    /// Records that a byte ended at `at`.
    fn heard(&mut self, at: Instant) {
        self.quiet_at = Some(at + self.idle);
    }

    /// Queues a frame to be sent at `due`.
    fn queue(&mut self, due: Instant, frame: Vec<u8>) {
        if self.pending.len() >= QUEUE_MAX {
            let detail = || format!("{QUEUE_MAX} frames wait already");
            return self
                .log
                .repeated(due, EventKind::Violation, "queue-full", detail);
        }
        match self.pending.iter().position(|(other, _)| *other > due) {
            Some(behind) => self.pending.insert(behind, (due, frame)),
            None => self.pending.push_back((due, frame)),
        }
    }

    /// Moves due frames to the transmitter.
    fn send_due(&mut self, now: Instant) {
        while let Some((due, frame)) = self.pending.pop_front() {
            if due > now {
                self.pending.push_front((due, frame));
                break;
            }
            if self.faults.is_off() || self.is_mute() {
                continue;
            }
            if self.output.len() + frame.len() > OUTPUT_MAX {
                let detail = || format!("{OUTPUT_MAX} bytes wait already");
                self.log
                    .repeated(now, EventKind::Note, "output-full", detail);
                continue;
            }
            let line = self.description.line;
            self.sending_until = self.sending_until.max(due) + line.bytes_time(frame.len() as u64);
            self.output.extend(frame);
        }
    }

    /// Time at which the device acts next without further bytes.
    fn acts_at(&self) -> Option<Instant> {
        let due = self.pending.front().map(|(due, _)| *due);
        let event = self.events.front().map(|(at, _)| *at);
        let first = sooner(
            sooner(due, event),
            sooner(self.watchdog_at, self.boot_until),
        );
        let timers = self.timers.iter();
        timers.fold(first, |first, timer| sooner(first, Some(timer.at)))
    }

    /// Whether a poll at `now` changes nothing but the transmitter.
    fn is_at_rest(&self, now: Instant) -> bool {
        let is_due = |at: Option<Instant>| at.is_some_and(|at| at <= now);
        self.inbox.is_empty()
            && self.events.is_empty()
            && !self.faults.is_changed()
            && !is_due(self.boot_until)
            && !is_due(self.quiet_at)
            && !is_due(self.watchdog_at)
            && self.timers.iter().all(|timer| timer.at > now)
    }

    fn is_modbus(&self) -> bool {
        self.description.protocol.is_some()
    }

    /// Whether its requests contain an address.
    fn is_addressed(&self) -> bool {
        self.is_modbus() || self.address_field.is_some()
    }

    /// The address in `request`, if it is not the own one and no broadcast.
    fn foreign_address(&self, request: &Record) -> Option<i128> {
        let asked = self.address_field.as_ref()?.asked(request)?;
        (asked != i128::from(self.address())).then_some(asked)
    }
}

/// The earlier one of two times. A device is asked for its next time several times for each
/// request.
fn sooner(one: Option<Instant>, other: Option<Instant>) -> Option<Instant> {
    match (one, other) {
        (Some(one), Some(other)) => Some(one.min(other)),
        (one, other) => one.or(other),
    }
}

impl Device for Described {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        if port == Self::UART && self.faults.is_off() {
            self.heard.pass(bytes.len());
        } else if port == Self::UART {
            let mut own = core::mem::take(&mut self.spare);
            own.clear();
            own.extend_from_slice(bytes);
            self.inbox.push_back((now, own));
            if self.description.echoes {
                self.output.extend(bytes);
            }
        }
    }

    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        if port != Self::UART || self.faults.is_off() {
            return;
        }
        match event {
            LineEvent::Break => self.events.push_back((now, EventSpec::Break)),
            // A character that is not a byte: the frame around it is damaged.
            LineEvent::FramingError | LineEvent::ParityError => {
                self.log
                    .repeated(now, EventKind::Note, "bad-character", || {
                        format!("{event:?}")
                    });
            }
            _ => {}
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        self.log.poll(now);
        if self.faults.is_off() {
            let lost = self.inbox.drain(..).map(|(_, bytes)| bytes.len());
            self.heard.pass(lost.sum());
            self.pending.clear();
            self.output.clear();
            return;
        }
        if self.is_at_rest(now) {
            return self.send_due(now);
        }
        self.lay_faults(now, world);
        let description = self.description.clone();
        let mut doer = Doer {
            of: &description,
            device: self,
            world,
        };
        doer.hear(now);
        doer.act(now);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        if port == Self::UART {
            take(&mut self.output, buf)
        } else {
            0
        }
    }

    fn may_send(&self, _: Port) -> bool {
        !self.output.is_empty()
    }

    fn poll_at(&self) -> Option<Instant> {
        // A poll has no effect while the device is off, so expired timers must not request one.
        if self.faults.is_off() {
            return self.log.poll_at();
        }
        let inbox = self.inbox.front().map(|(at, _)| *at);
        let own = sooner(self.acts_at(), sooner(inbox, self.quiet_at));
        sooner(own, self.log.poll_at())
    }

    fn line_config(&self, _: Port) -> LineConfig {
        self.description.line
    }

    fn known_faults(&self) -> &'static [&'static str] {
        self.description.fault_names
    }

    fn takes_figure(&self, fault: &str) -> bool {
        self.description.takes_figure(fault)
    }

    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        self.change_fault(now, fault, figure, begins);
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }

    fn unframed(&self) -> u64 {
        let mut messages = self.description.messages().iter();
        let has_requests = messages.any(|message| message.from != From::Device);
        match has_requests && !self.has_framed {
            true => self.heard.passed(),
            false => 0,
        }
    }
}
