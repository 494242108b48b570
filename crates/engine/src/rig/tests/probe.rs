//! A device or a program whose behaviour is set by its fields, and which keeps all that reaches it.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use emulators::world::World;
use emulators::{BrokenRules, Device, Event};
use firmware_core::map_view::MapView;
use firmware_core::pose::Pose;
use firmware_core::{Inspect, Master, Work};
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::rig::line::{Delivery, Direction};
use crate::rig::trace::{Side, Tap};

/// See the module. Times are in microseconds.
#[derive(Clone)]
pub(in crate::rig) struct Probe {
    /// Received bytes: port, time, bytes.
    pub(in crate::rig) received: Vec<(u8, u64, Vec<u8>)>,
    /// Received line events: port, time, event.
    pub(in crate::rig) line_events: Vec<(u8, u64, LineEvent)>,
    /// Times of all polls.
    pub(in crate::rig) polls: Vec<u64>,
    /// Bytes to send on any port.
    pub(in crate::rig) to_send: VecDeque<u8>,
    /// Next change of its end of a line.
    pub(in crate::rig) change: Option<LineEvent>,
    /// Answer to `may_send`.
    pub(in crate::rig) may_send: bool,
    /// Time of the next poll, once.
    pub(in crate::rig) wakes_at: Option<Instant>,
    /// Entries of its log to take.
    pub(in crate::rig) events: Vec<Event>,
    /// Rules that it counts.
    pub(in crate::rig) broken: Option<BrokenRules>,
    /// Faults as they were set: time, name, figure, whether the fault begins.
    pub(in crate::rig) faults: Vec<(u64, String, Option<f64>, bool)>,
    /// Its line coding, on each port.
    pub(in crate::rig) line: LineConfig,
    /// Work of the next poll.
    pub(in crate::rig) work: Work,
}

impl Default for Probe {
    fn default() -> Self {
        Self {
            received: Vec::new(),
            line_events: Vec::new(),
            polls: Vec::new(),
            to_send: VecDeque::new(),
            change: None,
            may_send: true,
            wakes_at: None,
            events: Vec::new(),
            broken: None,
            faults: Vec::new(),
            line: LineConfig::new_8n1(1_000_000),
            work: Work::NONE,
        }
    }
}

impl Probe {
    fn wake(&self) -> Option<Instant> {
        let last = self.polls.last();
        self.wakes_at
            .filter(|at| last.is_none_or(|last| *last < at.as_micros()))
    }

    fn move_to(&mut self, buf: &mut [u8]) -> usize {
        let len = buf.len().min(self.to_send.len());
        for (to, byte) in buf.iter_mut().zip(self.to_send.drain(..len)) {
            *to = byte;
        }
        len
    }
}

impl Device for Probe {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        self.received
            .push((port.0, now.as_micros(), bytes.to_vec()));
    }

    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        self.line_events.push((port.0, now.as_micros(), event));
    }

    fn poll(&mut self, now: Instant, _: &mut World) {
        self.polls.push(now.as_micros());
    }

    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        self.move_to(buf)
    }

    fn may_send(&self, _: Port) -> bool {
        self.may_send
    }

    fn line_change(&mut self, _: Port) -> Option<LineEvent> {
        self.change.take()
    }

    fn poll_at(&self) -> Option<Instant> {
        self.wake()
    }

    fn line_config(&self, _: Port) -> LineConfig {
        self.line
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &["off", "slow"]
    }

    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        let fault = fault.to_owned();
        self.faults.push((now.as_micros(), fault, figure, begins));
    }

    /// Register 3 holds 33.
    fn peek(&self, address: u8) -> Option<u8> {
        (address == 3).then_some(33)
    }

    fn take_events(&mut self) -> Vec<Event> {
        core::mem::take(&mut self.events)
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        self.broken.as_ref()
    }
}

impl Master for Probe {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        Device::receive(self, port, now, bytes);
    }

    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        Device::line_event(self, port, now, event);
    }

    fn line_change(&mut self, _: Port) -> Option<LineEvent> {
        self.change.take()
    }

    fn poll(&mut self, now: Instant) {
        self.polls.push(now.as_micros());
    }

    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        self.move_to(buf)
    }

    fn may_send(&self, _: Port) -> bool {
        self.may_send
    }

    fn poll_at(&self) -> Option<Instant> {
        self.wake()
    }

    fn line_config(&self, _: Port) -> LineConfig {
        self.line
    }

    fn take_work(&mut self) -> Work {
        core::mem::take(&mut self.work)
    }
}

impl Inspect for Probe {
    fn estimate(&self) -> Option<(Instant, Pose)> {
        None
    }

    fn map(&self) -> Option<MapView<'_>> {
        None
    }

    fn mode(&self) -> &'static str {
        "probe"
    }

    fn counters(&self, _: &mut dyn FnMut(&'static str, u64)) {}
}

/// What a [`Watch`] saw, as text: one line for each call.
#[derive(Clone, Default)]
pub(in crate::rig) struct Notes(Arc<Mutex<Vec<String>>>);

impl Notes {
    /// Takes the lines since the last call.
    pub(in crate::rig) fn take(&self) -> Vec<String> {
        core::mem::take(&mut *self.0.lock().expect("one thread"))
    }

    fn add(&self, line: String) {
        self.0.lock().expect("one thread").push(line);
    }
}

/// An observer whose file cannot be written, if it has a trouble.
#[derive(Default)]
pub(in crate::rig) struct Watch {
    pub(in crate::rig) notes: Notes,
    pub(in crate::rig) trouble: Option<String>,
}

impl Tap for Watch {
    fn record(&mut self, link: usize, direction: Direction, side: Side, at: Instant, bytes: &[u8]) {
        let (direction, at) = (direction.name(), at.as_micros());
        self.notes
            .add(format!("{link} {direction} {side:?} {at} {bytes:?}"));
    }

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        let (direction, at) = (direction.name(), delivery.at.as_micros());
        self.notes.add(format!(
            "{link} {direction} arrived {at} {:?}",
            delivery.bytes
        ));
    }

    fn line_event(&mut self, link: usize, to: Direction, at: Instant, event: LineEvent) {
        let (to, at) = (to.name(), at.as_micros());
        self.notes.add(format!("{link} {to} {event:?} {at}"));
    }

    fn reached(&mut self, now: Instant) {
        self.notes.add(format!("reached {}", now.as_micros()));
    }

    fn take_trouble(&mut self) -> Option<String> {
        self.trouble.clone()
    }

    fn finish(&mut self) -> std::io::Result<()> {
        self.notes.add("finished".to_owned());
        match self.trouble.take() {
            Some(trouble) => Err(std::io::Error::other(trouble)),
            None => Ok(()),
        }
    }
}
