//! A node program as a device of a rig.
//!
//! Input is kept until the rig polls the device; one exchange then passes all of it on. Output is
//! kept until its time has come and the line accepts it. A program that requests no calls costs
//! nothing.
//!
//! The process is started when the node is first needed. A copy of the device holds the saved state
//! of its program, and starts its own process when it is first needed.

mod frames;
mod port;

use core::cell::{Ref, RefCell};
use std::sync::Arc;

use emulators::device::{Device, Event, EventKind, earliest};
use emulators::world::World;
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::error::NodeError;
use crate::host::{BYTES_MAX, Host};
use crate::intern::forever;
use crate::message::{Input, Item, Output};
use crate::process::last_words;
pub use crate::slowness::{SLOW, Slowness, Stopwatch};
use crate::spec::{NodeSpec, line_of};
use crate::typed::Listener;
use port::{Out, PortState};

/// A node program in a rig.
pub struct NodeDevice {
    spec: Arc<NodeSpec>,
    life: RefCell<Life>,
    /// Number of exchanges of the original, if this device is a copy.
    exchanges_before: u64,
    now: Instant,
    has_greeted: bool,
    /// Whether the failure of the program has been logged.
    has_failed: bool,
    inbox: Vec<Item<Input>>,
    ports: Vec<PortState>,
    next: Option<Instant>,
    events: Vec<Event>,
    /// Names and values of the program's outputs.
    outputs: Vec<(String, Option<f64>)>,
    reports: u64,
    /// The value of each quantity that the program received last.
    told: Vec<Option<f64>>,
    /// Decodes frames of the description, if the program uses messages.
    listener: Option<Listener>,
    stopwatch: Option<Stopwatch>,
    slowness: Slowness,
}

/// The state of the process.
enum Life {
    /// Not started yet; begins with this state, if there is one.
    Waiting(Option<Arc<[u8]>>),
    /// Running.
    Running(Box<Host>),
    /// Ended: the error if there was one, the last output, and the number of exchanges.
    Over {
        error: Option<NodeError>,
        said: String,
        exchanges: u64,
    },
}

impl NodeDevice {
    /// The node of `spec`; its process is started when it is first needed.
    pub fn new(spec: NodeSpec) -> Self {
        Self {
            life: RefCell::new(Life::Waiting(None)),
            exchanges_before: 0,
            now: Instant::ZERO,
            has_greeted: false,
            has_failed: false,
            inbox: Vec::new(),
            ports: spec.ports.iter().map(PortState::new).collect(),
            next: Some(Instant::ZERO),
            events: Vec::new(),
            outputs: Vec::new(),
            reports: 0,
            told: vec![None; spec.quantities.len()],
            listener: None,
            stopwatch: None,
            slowness: Slowness::default(),
            spec: Arc::new(spec),
        }
    }

    /// The specification of the node.
    pub fn spec(&self) -> &NodeSpec {
        &self.spec
    }

    /// The reason why the program cannot continue, if it has failed.
    pub fn error(&self) -> Option<NodeError> {
        match &*self.life.borrow() {
            Life::Over { error, .. } => error.clone(),
            _ => None,
        }
    }

    /// Number of exchanges.
    pub fn exchanges(&self) -> u64 {
        let own = match &*self.life.borrow() {
            Life::Waiting(_) => 0,
            Life::Running(host) => host.exchanges(),
            Life::Over { exchanges, .. } => *exchanges,
        };
        self.exchanges_before + own
    }

    /// The end of the program's standard error output so far.
    pub fn said(&self) -> String {
        match &*self.life.borrow() {
            Life::Waiting(_) => String::new(),
            Life::Running(host) => host.said(),
            Life::Over { said, .. } => said.clone(),
        }
    }

    /// The program's outputs by name.
    pub fn outputs(&self) -> impl Iterator<Item = (&str, f64)> {
        (self.outputs.iter()).filter_map(|(name, value)| Some((name.as_str(), (*value)?)))
    }

    /// Number of times that the program has set an output or reported its work by a note.
    pub const fn reports(&self) -> u64 {
        self.reports
    }

    /// The names of the outputs that the program has declared, also of those not shown yet.
    pub fn output_names(&self) -> impl Iterator<Item = &str> {
        self.outputs.iter().map(|(name, _)| name.as_str())
    }

    /// Whether a copy of the device could continue like it. Starts the program if necessary.
    pub fn can_save(&self) -> bool {
        self.host().is_some_and(|host| host.greeting().save)
    }

    /// Measures the time of the program's answers with `stopwatch` from now on.
    pub fn measure_by(&mut self, stopwatch: Stopwatch) {
        self.stopwatch = Some(stopwatch);
        if let Life::Running(host) = self.life.get_mut() {
            host.part();
        }
    }

    /// The measured times of the program's answers.
    pub const fn slowness(&self) -> Slowness {
        self.slowness
    }

    /// Ends the program, if it is running, and waits for its exit.
    pub fn end(&mut self) {
        let life = self.life.get_mut();
        if let Life::Running(host) = life {
            let error = host.end().err();
            *life = over(host, error);
        }
    }

    /// The program, which is started if necessary; `None` if it has ended.
    fn host(&self) -> Option<Ref<'_, Host>> {
        if matches!(&*self.life.borrow(), Life::Waiting(_)) {
            let life = &mut *self.life.borrow_mut();
            if let Life::Waiting(state) = life {
                *life = begin(&self.spec, state.as_deref());
                if let (Life::Running(host), Some(_)) = (&mut *life, &self.stopwatch) {
                    host.part();
                }
            }
        }
        let running = |life: &Life| matches!(life, Life::Running(_));
        if !running(&self.life.borrow()) {
            return None;
        }
        Ref::filter_map(self.life.borrow(), |life| match life {
            Life::Running(host) => Some(&**host),
            _ => None,
        })
        .ok()
    }

    /// Applies the program's greeting.
    fn greet(&mut self) -> bool {
        let Some(host) = self.host() else {
            return false;
        };
        if self.has_greeted {
            return true;
        }
        let greeting = host.greeting().clone();
        drop(host);
        self.has_greeted = true;
        for port in greeting.ports {
            let number = self
                .spec
                .ports
                .iter()
                .position(|known| known.name == port.name);
            if let (Some(number), Some(line)) = (number, line_of(port.rate, &port.format)) {
                self.ports[number].line = line;
            }
        }
        let description = self.spec.description.clone();
        let description = description.filter(|_| greeting.messages);
        self.listener = description.map(Listener::new);
        let outputs = greeting.outputs.into_iter();
        self.outputs = outputs.map(|name| (name, None)).collect();
        true
    }

    fn fail(&mut self, error: NodeError) {
        let life = self.life.get_mut();
        if let Life::Running(host) = life {
            *life = over(host, Some(error));
        }
        self.note_failure();
    }

    /// Logs once that the program has ended.
    fn note_failure(&mut self) {
        self.inbox.clear();
        (self.next, self.listener) = (None, None);
        for port in &mut self.ports {
            port.clear();
        }
        if let Some(error) = self.error().filter(|_| !self.has_failed) {
            self.has_failed = true;
            let words = last_words(&self.said()).map(|line| format!("; its last words: {line}"));
            self.events.push(Event {
                at: self.now,
                kind: EventKind::Note,
                rule: FAILED,
                detail: format!("the node program {error}{}", words.unwrap_or_default()),
                bytes: Vec::new(),
            });
        }
    }

    /// Executes one exchange with all inputs since the last one.
    fn exchange(&mut self, world: &mut World) {
        let now = self.now;
        for (number, quantity) in self.spec.quantities.iter().enumerate() {
            let value = quantity.source.read([0, 0], now - Instant::ZERO, world);
            #[expect(clippy::cast_precision_loss, reason = "the nearest number is meant")]
            let value = value as f64;
            if self.told[number] != Some(value) {
                self.told[number] = Some(value);
                self.inbox.push(Item {
                    port: u8::try_from(number).unwrap_or(u8::MAX),
                    at: now,
                    what: Input::Quantity(value),
                });
            }
        }
        let Life::Running(host) = self.life.get_mut() else {
            return;
        };
        let began = self.stopwatch.as_ref().map(|stopwatch| stopwatch());
        let reply = host.exchange(now, &self.inbox);
        self.inbox.clear();
        if let (Some(stopwatch), Some(began)) = (&self.stopwatch, began) {
            let took = stopwatch().saturating_sub(began);
            self.slowness.answers += u64::from(took > SLOW);
            self.slowness.longest = self.slowness.longest.max(took);
        }
        let reply = match reply {
            Ok(reply) => reply,
            Err(error) => return self.fail(error),
        };
        self.next = reply.next;
        for item in reply.items {
            let port = usize::from(item.port);
            let out = match item.what {
                Output::Note(note) => {
                    self.reports += u64::from(note.is_report());
                    self.events.push(note.into_event(item.at));
                    continue;
                }
                Output::Quantity(value) => {
                    self.give(port, value, world);
                    continue;
                }
                Output::Bytes(bytes) => Out::Bytes(bytes.into()),
                Output::Message(message) => match self.frame_of(&message) {
                    Ok(bytes) => Out::Bytes(bytes.into()),
                    Err(error) => return self.fail(error),
                },
                Output::Line(event) => Out::Line(event),
                Output::Coding(line) => Out::Coding(line),
            };
            self.ports[port].put(item.at, out);
        }
        let ports = self.ports.iter().enumerate();
        let flooded = ports.map(|(number, port)| (number, port.waiting));
        if let Some((port, len)) = flooded.into_iter().find(|(_, len)| *len > BYTES_MAX) {
            let what = format!(
                "{len} bytes wait for the line of port {port}, which carries {} B/s, at most \
                 {BYTES_MAX} may wait",
                self.ports[port].line.baud / self.ports[port].line.bits_per_byte()
            );
            self.fail(NodeError::Flood(what));
        }
    }

    /// Sets an output of the program, and the actuators that follow it.
    fn give(&mut self, number: usize, value: f64, world: &mut World) {
        let Some((name, known)) = self.outputs.get_mut(number) else {
            return;
        };
        *known = Some(value);
        self.reports += 1;
        for drive in self
            .spec
            .drives
            .iter()
            .filter(|drive| drive.output == *name)
        {
            let command = drive.sink.command_of(value);
            if let Err(error) = world.actuate(&drive.sink.actuator, command) {
                self.events.push(Event {
                    at: self.now,
                    kind: EventKind::Note,
                    rule: "not-driven",
                    detail: format!("{name}: {error}"),
                    bytes: Vec::new(),
                });
            }
        }
    }
}

/// Name of the log entry with the failure of a node program.
pub const FAILED: &str = "node-failed";

fn begin(spec: &NodeSpec, state: Option<&[u8]>) -> Life {
    let ended = |(error, said)| Life::Over {
        error: Some(error),
        said,
        exchanges: 0,
    };
    match Host::start(spec) {
        Err(failed) => ended(failed),
        Ok(mut host) => match state.map_or(Ok(()), |state| host.load(state)) {
            Ok(()) => Life::Running(Box::new(host)),
            Err(error) => ended((error, host.last_words())),
        },
    }
}

fn over(host: &mut Host, error: Option<NodeError>) -> Life {
    Life::Over {
        error,
        said: host.last_words(),
        exchanges: host.exchanges(),
    }
}

impl Clone for NodeDevice {
    /// The copy begins with the saved state of the program, or with the error of saving.
    fn clone(&self) -> Self {
        let exchanges_before = match &*self.life.borrow() {
            Life::Over { .. } => self.exchanges_before,
            Life::Waiting(_) | Life::Running(_) => self.exchanges(),
        };
        let life = match &mut *self.life.borrow_mut() {
            Life::Waiting(state) => Life::Waiting(state.clone()),
            Life::Running(host) => match host.save() {
                Ok(state) => Life::Waiting(Some(state.into())),
                Err(error) => Life::Over {
                    error: Some(error),
                    said: host.said(),
                    exchanges: host.exchanges(),
                },
            },
            Life::Over {
                error,
                said,
                exchanges,
            } => Life::Over {
                error: error.clone(),
                said: said.clone(),
                exchanges: *exchanges,
            },
        };
        Self {
            spec: Arc::clone(&self.spec),
            life: RefCell::new(life),
            exchanges_before,
            now: self.now,
            has_greeted: self.has_greeted,
            has_failed: self.has_failed,
            inbox: self.inbox.clone(),
            ports: self.ports.clone(),
            next: self.next,
            events: self.events.clone(),
            outputs: self.outputs.clone(),
            reports: self.reports,
            told: self.told.clone(),
            listener: self.listener.clone(),
            stopwatch: None,
            slowness: Slowness::default(),
        }
    }
}

impl Device for NodeDevice {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        self.inbox.push(Item {
            port: port.0,
            at: now,
            what: Input::Bytes(bytes.to_vec()),
        });
    }

    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        self.inbox.push(Item {
            port: port.0,
            at: now,
            what: Input::Line(event),
        });
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        self.now = now;
        let quiet_at = self.listener.as_ref().and_then(Listener::quiet_at);
        let is_due = |at: Option<Instant>| at.is_some_and(|at| at <= now);
        if self.inbox.is_empty() && !is_due(self.next) && !is_due(quiet_at) {
            return;
        }
        if !self.greet() {
            return self.note_failure();
        }
        self.read_frames();
        if !self.inbox.is_empty() || is_due(self.next) {
            self.exchange(world);
        }
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        let now = self.now;
        let port = self.ports.get_mut(usize::from(port.0));
        port.map_or(0, |port| port.transmit(now, buf))
    }

    fn may_send(&self, port: Port) -> bool {
        let port = self.ports.get(usize::from(port.0));
        port.is_some_and(|port| port.is_due(self.now))
    }

    fn line_change(&mut self, port: Port) -> Option<LineEvent> {
        let now = self.now;
        self.ports.get_mut(usize::from(port.0))?.line_change(now)
    }

    fn poll_at(&self) -> Option<Instant> {
        let out = self.ports.iter().map(|port| port.poll_at(self.now));
        let quiet_at = self.listener.as_ref().and_then(Listener::quiet_at);
        earliest(out.chain([self.next, quiet_at]))
    }

    fn line_config(&self, port: Port) -> LineConfig {
        let port = self.ports.get(usize::from(port.0));
        port.map_or(LineConfig::new_8n1(9_600), |port| port.line)
    }

    fn known_faults(&self) -> &'static [&'static str] {
        let Some(host) = self.host() else {
            return &[];
        };
        let names: Vec<_> = host
            .greeting()
            .faults
            .iter()
            .map(|name| forever(name))
            .collect();
        crate::intern::list_forever(names)
    }

    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        self.inbox.push(Item {
            port: 0,
            at: now,
            what: Input::Fault {
                name: fault.to_owned(),
                begins,
                figure,
            },
        });
    }

    fn take_events(&mut self) -> Vec<Event> {
        core::mem::take(&mut self.events)
    }
}
