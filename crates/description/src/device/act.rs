//! The actions of a device: replies, state changes, timers.

use core::ops::Range;
use core::time::Duration;

use emulators::device::EventKind;
use emulators::world::World;
use protocols::Instant;

use super::Described;
use super::scope::{Filled, Seen};
use super::shared::{Complaint, WRONG_ADDRESS};
use crate::behaviour::{Deed, On, Trigger};
use crate::description::Description;
use crate::expr::Expr;
use crate::framing::{Frame, Framing};
use crate::message::Message;
use crate::registers::Refusal;
use crate::schema::behaviour::EventSpec;
use crate::schema::message::From;
use crate::state::Reading;
use crate::value::{Record, Value};

/// An action that is due at a set time.
#[derive(Clone, Debug)]
pub(super) struct Timer {
    pub(super) at: Instant,
    what: Timed,
    /// Fields of the message that started the timer.
    request: Record,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Timed {
    Every(usize),
    After(usize),
}

/// Maximum number of characters of a frame in a log.
const WORDS_MAX: usize = 200;
/// Maximum number of timers: each message can start one.
const TIMERS_MAX: usize = 256;

impl Timer {
    /// The timers of a device that has started at `up`.
    pub(super) fn of(description: &Description, up: Instant) -> Vec<Self> {
        let every = description.every.iter().enumerate();
        let timers = every.map(|(index, every)| Self {
            at: up + every.first,
            what: Timed::Every(index),
            request: Record::default(),
        });
        timers.collect()
    }
}

/// A device that acts in its world.
pub(super) struct Doer<'a> {
    /// The device's description: a reference of its own, because actions change the device.
    pub(super) of: &'a Description,
    pub(super) device: &'a mut Described,
    pub(super) world: &'a World,
}

impl<'d> Doer<'d> {
    fn seen<'a>(&'a self, now: Instant, request: &'a Record) -> Seen<'a> {
        let reading = Reading {
            state: &self.device.state,
            now,
            world: self.world,
        };
        Seen {
            request,
            reading,
            device: self.device,
        }
    }

    fn eval(&mut self, now: Instant, expr: &Expr, request: &Record) -> Option<Value> {
        let value = expr.eval(&self.seen(now, request));
        value
            .map_err(|error| self.failed(now, &format!("{}: {error}", expr.source())))
            .ok()
    }

    /// Does everything that is due at `now`.
    pub(super) fn act(&mut self, now: Instant) {
        if let Some(up) = self.device.boot_until.take_if(|up| *up <= now) {
            self.device.events.push_back((up, EventSpec::Start));
        }
        self.run_timers(now);
        self.run_events(now);
        self.device.watch(now);
        self.run_events(now);
        self.device.send_due(now);
    }

    fn failed(&mut self, now: Instant, detail: &str) {
        let detail = || detail.to_owned();
        self.device
            .log
            .repeated(now, EventKind::Note, "expression-failed", detail);
    }

    fn holds(&mut self, now: Instant, when: Option<&Expr>, request: &Record) -> bool {
        match when {
            None => true,
            Some(when) => self
                .eval(now, when, request)
                .is_some_and(|value| value.is_true()),
        }
    }

    pub(super) fn wrong(&mut self, at: Instant, rule: &'static str, detail: String) {
        self.device
            .log
            .repeated(at, EventKind::Violation, rule, || detail);
    }

    /// Handles a frame of a protocol other than Modbus, which has the bytes `span` of the wire.
    pub(super) fn message(&mut self, at: Instant, frame: &Frame, body: &[u8], span: Range<u64>) {
        let description = self.of;
        let Some((index, request)) = description.decode(frame.format, body, From::Host) else {
            let words = shortened(description.words(frame));
            self.device.complain(Complaint {
                spans: vec![span],
                ..Complaint::new(at, "unknown-message", words)
            });
            self.device.events.push_back((at, EventSpec::Unknown));
            return self.run_events(at);
        };
        self.begin_timers(at, Trigger::Message(index), &request);
        let fits = |on: &On| match on.trigger {
            Trigger::Message(wanted) => wanted == index,
            Trigger::AnyMessage => true,
            Trigger::Event(_) => false,
        };
        let mut entries = description.on.iter().filter(|on| fits(on));
        let entry = entries.find(|on| self.holds(at, on.deed.when.as_ref(), &request));
        let is_taken = entry.is_some_and(|on| !on.is_ignored());
        let refuses = |on: &On| on.violation == Some(WRONG_ADDRESS);
        if (!is_taken || entry.is_some_and(refuses))
            && let Some(asked) = self.device.foreign_address(&request)
        {
            return self.device.complain_if_absent(at, asked, span);
        }
        // Limits of a message for another device are not limits of this one.
        if entry.is_some_and(On::is_ignored) {
            return;
        }
        if is_taken && !self.device.place.is_alone && self.device.is_addressed() {
            self.device.heard.claim(span);
        }
        let message = &description.messages[index];
        self.check_limits(at, message, &request);
        match entry {
            Some(on) => self.react(at, on, &request),
            None => {
                let detail = format!("{} is not answered now", message.name);
                let log = &mut self.device.log;
                log.repeated(at, EventKind::Note, "not-answered", || detail);
            }
        }
    }

    /// Logs the values of a request that are beyond their limits.
    fn check_limits(&mut self, at: Instant, message: &Message, request: &Record) {
        if !message.has_limits {
            return;
        }
        for (name, value) in &request.0 {
            let field = crate::field::find(message.fields(), name);
            if let Some((field, [least, most])) =
                field.and_then(|field| Some((field, field.beyond(value)?)))
            {
                let words = field.words(value);
                let detail = format!(
                    "{} {name} {words}, expected {least} to {most}",
                    message.name
                );
                self.wrong(at, "out-of-range", detail);
            }
        }
    }

    /// Executes an entry.
    fn react(&mut self, at: Instant, on: &On, request: &Record) {
        if let Some(rule) = on.violation {
            let detail = Value::Record(request.clone()).to_string();
            self.wrong(at, rule, detail);
        }
        if let Some((address, data)) = &on.write
            && !self.write(at, address, data, request)
        {
            return;
        }
        self.set(at, &on.deed, request);
        if on.restarts {
            return self.device.restart(at, "by an [[on]] of its description");
        }
        let latency = self.latency(on.latency, on.jitter);
        let due = at + latency.max(self.device.description.turnaround);
        if let Some(busy) = on.busy {
            self.device.busy_until = at + busy;
        }
        self.send(at, due, &on.deed, request);
    }

    /// The time until a reply, with jitter and faults.
    pub(super) fn latency(&mut self, latency: Duration, jitter: Option<Duration>) -> Duration {
        let by_chance = match jitter {
            None => Duration::ZERO,
            Some(most) => most.mul_f64(self.device.dice.uniform()),
        };
        self.device.slowed(latency + by_chance)
    }

    fn set(&mut self, at: Instant, deed: &Deed, request: &Record) {
        for (variable, expr) in &deed.set {
            if let Some(value) = self.eval(at, expr, request)
                && !self.device.state.write(*variable, value.clone())
            {
                let name = &self.device.description.variables[*variable].name;
                let detail = format!("{name} = {value} is beyond its limits");
                self.wrong(at, "value-cut", detail);
            }
        }
    }

    /// Writes to the table of bytes; `false` if the write is refused.
    fn write(&mut self, at: Instant, address: &Expr, data: &Expr, request: &Record) -> bool {
        let address = self
            .eval(at, address, request)
            .and_then(|value| value.as_int());
        let bytes = self.eval(at, data, request).map(|value| match value {
            Value::Bytes(bytes) => bytes,
            Value::List(list) => {
                let byte = |value: &Value| u8::try_from(value.as_int()?).ok();
                list.iter().map(|value| byte(value).unwrap_or(0)).collect()
            }
            other => vec![u8::try_from(other.as_int().unwrap_or(0) & 0xff).unwrap_or(0)],
        });
        let (Some(address), Some(bytes)) = (address, bytes) else {
            return false;
        };
        let description = self.of;
        let Some(registers) = &description.registers else {
            return false;
        };
        let values = |index: usize| self.device.state.read(index, at, self.world);
        let address = u32::try_from(address).unwrap_or(u32::MAX);
        match registers.bytes.write(address, &bytes, &values) {
            Ok(changes) => {
                for (variable, value) in changes {
                    self.device.state.write(variable, value);
                }
                true
            }
            Err(refusal) => {
                self.refused(at, &refusal);
                self.run_events_of(at, EventSpec::Refused, request);
                false
            }
        }
    }

    pub(super) fn refused(&mut self, at: Instant, refusal: &Refusal) {
        let description = self.of;
        let name = |variable: usize| &description.variables[variable].name;
        match refusal {
            Refusal::Unknown(address) => {
                self.wrong(
                    at,
                    "unknown-register",
                    format!("there is no register {address}"),
                );
            }
            Refusal::ReadOnly(variable) => {
                let detail = format!("{} cannot be written", name(*variable));
                self.wrong(at, "write-read-only", detail);
            }
            Refusal::OutOfRange(variable, value, [least, most]) => {
                let detail = format!("{} = {value}, expected {least} to {most}", name(*variable));
                self.wrong(at, "out-of-range", detail);
            }
        }
    }

    /// Starts the timers of `trigger`.
    fn begin_timers(&mut self, at: Instant, trigger: Trigger, request: &Record) {
        let description = self.of;
        for (index, after) in description.after.iter().enumerate() {
            let fits = after.trigger == trigger
                || (after.trigger == Trigger::AnyMessage && matches!(trigger, Trigger::Message(_)));
            if !fits {
                continue;
            }
            if self.device.timers.len() >= TIMERS_MAX {
                let detail = || format!("{TIMERS_MAX} delays run already");
                self.device
                    .log
                    .repeated(at, EventKind::Note, "too-many-delays", detail);
                continue;
            }
            let (what, request) = (Timed::After(index), request.clone());
            self.device.timers.push(Timer {
                at: at + after.delay,
                what,
                request,
            });
        }
    }

    /// Executes all actions that are due by `now`, in order of time.
    pub(super) fn run_timers(&mut self, now: Instant) {
        let due = |timers: &[Timer]| {
            let due = timers
                .iter()
                .enumerate()
                .filter(|(_, timer)| timer.at <= now);
            due.min_by_key(|(index, timer)| (timer.at, *index))
                .map(|(index, _)| index)
        };
        while let Some(index) = due(&self.device.timers) {
            let timer = self.device.timers.remove(index);
            let description = self.of;
            let deed = match timer.what {
                Timed::After(after) => &description.after[after].deed,
                Timed::Every(every) => {
                    let every = &description.every[every];
                    let late = match every.jitter {
                        None => Duration::ZERO,
                        Some(most) => most.mul_f64(self.device.dice.uniform()),
                    };
                    // After a late poll, messages of the past are skipped.
                    let next = Timer {
                        at: (timer.at + every.period).max(now),
                        ..timer.clone()
                    };
                    self.device.timers.insert(index, next);
                    if self.holds(now, every.deed.when.as_ref(), &timer.request) {
                        self.set(now, &every.deed, &timer.request);
                        let due = now + self.device.delayed() + late;
                        self.send(now, due, &every.deed, &timer.request);
                    }
                    continue;
                }
            };
            if self.holds(now, deed.when.as_ref(), &timer.request) {
                self.set(now, deed, &timer.request);
                let due = now + self.device.delayed();
                self.send(now, due, deed, &timer.request);
            }
        }
    }

    /// Processes queued events.
    pub(super) fn run_events(&mut self, now: Instant) {
        while let Some((at, event)) = self.device.events.pop_front() {
            self.run_events_of(at.max(Instant::ZERO).min(now), event, &Record::default());
        }
    }

    fn run_events_of(&mut self, at: Instant, event: EventSpec, request: &Record) {
        let description = self.of;
        let trigger = Trigger::Event(event);
        self.begin_timers(at, trigger, request);
        for on in description.on.iter().filter(|on| on.trigger == trigger) {
            if self.holds(at, on.deed.when.as_ref(), request) {
                return self.react(at, on, request);
            }
        }
    }

    /// Sends the messages of an action at `due`.
    fn send(&mut self, at: Instant, due: Instant, deed: &Deed, request: &Record) {
        let description = self.of;
        for &index in &deed.send {
            let mut given = Record(Vec::with_capacity(deed.with.len()));
            for (field, expr) in &deed.with {
                if let Some(value) = self.eval(at, expr, request) {
                    given.set_shared(field, value);
                }
            }
            let index = self.device.replaced(index);
            let message = &description.messages[index];
            let seen = self.seen(at, request);
            let framing = description.frames.0.get(message.frame);
            // In the usual place the body needs no copy into its frame.
            let front = framing.and_then(Framing::front);
            let filled = Filled { given, seen };
            let mut written = message.encode_behind(front.unwrap_or(0), &filled);
            let bytes = core::mem::take(&mut written.bytes);
            let frame = framing.and_then(|framing| match front {
                Some(_) => framing.frame_behind(bytes),
                None => framing.frame(&bytes),
            });
            for (name, value) in written.cut {
                let detail = || format!("{}: {name} cannot be {value}", message.name);
                self.device
                    .log
                    .repeated(at, EventKind::Note, "value-cut", detail);
            }
            for failed in written.failed {
                self.failed(at, &failed);
            }
            match frame {
                Some(frame) => self.queue(due, message.frame, frame),
                None => {
                    let detail = || format!("{} does not fit a frame", message.name);
                    self.device
                        .log
                        .repeated(at, EventKind::Note, "frame-too-long", detail);
                }
            }
        }
    }

    pub(super) fn queue(&mut self, due: Instant, format: usize, frame: Vec<u8>) {
        let frame = self.device.spoiled(format, frame);
        self.device.queue(due, frame);
    }
}

impl Described {
    /// Checks the watchdog.
    pub(super) fn watch(&mut self, now: Instant) {
        if let Some(at) = self.watchdog_at.take_if(|at| *at <= now) {
            if self.state.make_safe() {
                let detail =
                    "the driver is silent: variables are set to their safe values".to_owned();
                self.log.note(now, "made-safe", detail);
            }
            self.events.push_back((at, EventSpec::Watchdog));
        }
    }
}

/// The beginning of a text that is too long for a log, and its length.
fn shortened(text: String) -> String {
    match text.char_indices().nth(WORDS_MAX) {
        Some((end, _)) => format!("{} .. ({} characters)", &text[..end], text.chars().count()),
        None => text,
    }
}
