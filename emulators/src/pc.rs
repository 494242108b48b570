//! A PC at the other end of the radio, with a person who follows a script.
//!
//! It opens the port, sends waypoints and orders, and collects the robot's messages: map, pose,
//! state, waypoints. If the robot does not return a list of waypoints within two seconds, the PC
//! sends the list again. In manual mode it repeats the order, because the robot stops without one.
//! No message of the robot can break the PC: invalid messages are counted as violations of the
//! robot.
//!
//! Rules: `bad-message`, `bad-row`, `waypoints-not-confirmed`, `order-not-confirmed`.

mod map;
mod record;
mod script;
mod talk;
#[cfg(test)]
mod tests;
mod wish;

use std::collections::VecDeque;

use core::time::Duration;

use protocols::pcui::message::{Mode, Order};
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::device::{BrokenRules, Device, Event, earliest, take};
use crate::event_log::EventLog;
use crate::hc06::AIR_LINE;
use crate::world::World;

pub use map::{CELLS_MAX, PcMap, RowError, UNSEEN};
pub use record::{Counts, Record, StatedPose, TRAJECTORY_MAX};
pub use script::{Action, RAW_MAX, STEPS_MAX, Script, ScriptError, Step, When};

use wish::{Insist, Wish};

/// Maximum number of bytes that wait for the port; a frame that does not fit is not written.
const OUT_MAX: usize = 131_072;

/// Timeouts and retries of the PC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// Idle time after which a partial frame is discarded. The radio's own gaps stay below 40 ms.
    pub idle: Duration,
    /// Time for the robot to confirm waypoints or an order before they are sent again.
    pub confirm: Duration,
    /// Maximum number of times that unconfirmed waypoints or an order are sent.
    pub tries_max: u32,
    /// Time between two orders in manual mode: the robot needs at least one a second.
    pub order_period: Duration,
    /// Time after which the PC reopens a port that the other end closed; `None`: never.
    pub reopen: Option<Duration>,
    /// Time for the other end to answer before the PC calls again; `None`: forever.
    pub answer: Option<Duration>,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            idle: Duration::from_millis(50),
            confirm: Duration::from_secs(2),
            tries_max: 5,
            order_period: Duration::from_millis(500),
            reopen: Some(Duration::from_millis(500)),
            answer: Some(Duration::from_secs(10)),
        }
    }
}

impl Patience {
    const fn until_confirmed(&self) -> Insist {
        Insist::UntilConfirmed {
            every: self.confirm,
            tries_max: self.tries_max,
        }
    }
}

/// The PC's side of the connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Connection {
    /// The port is closed.
    Closed,
    /// The port is open; nothing was received yet.
    Opening,
    /// Connected since then, by the radio's report or by the first frame.
    Connected(Instant),
}

/// A scripted PC.
#[derive(Clone, Debug)]
pub struct Pc {
    script: Script,
    patience: Patience,
    /// The next step, and the time of the previous one.
    next_step: usize,
    stepped_at: Instant,
    connection: Connection,
    reopen_at: Option<Instant>,
    waypoints: Option<Wish<Vec<[i16; 2]>>>,
    order: Option<Wish<Order>>,
    quiet_at: Option<Instant>,
    record: Record,
    out: VecDeque<u8>,
    changes: VecDeque<LineEvent>,
    log: EventLog,
}

impl Pc {
    /// The serial port.
    pub const AIR: Port = Port(0);

    /// A PC with its port closed.
    pub fn new(script: Script) -> Self {
        Self::with_patience(script, Patience::default())
    }

    /// A PC with its port closed and the given timeouts and retries.
    pub fn with_patience(script: Script, patience: Patience) -> Self {
        Self {
            script,
            patience,
            next_step: 0,
            stepped_at: Instant::ZERO,
            connection: Connection::Closed,
            reopen_at: None,
            waypoints: None,
            order: None,
            quiet_at: None,
            record: Record::default(),
            out: VecDeque::new(),
            changes: VecDeque::new(),
            log: EventLog::default(),
        }
    }

    /// Everything learned from the robot.
    pub const fn record(&self) -> &Record {
        &self.record
    }

    /// The map, once its size is known.
    pub const fn map(&self) -> Option<&PcMap> {
        self.record.map.as_ref()
    }

    /// Time at which every row of the map had arrived.
    pub fn map_complete_at(&self) -> Option<Instant> {
        self.map()?.complete_at()
    }

    /// The PC's side of the connection.
    pub const fn connection(&self) -> Connection {
        self.connection
    }

    /// Time at which the robot confirmed the last waypoints.
    pub fn waypoints_confirmed_at(&self) -> Option<Instant> {
        self.waypoints.as_ref()?.confirmed_at()
    }

    /// Whether every step was done and the robot confirmed all its orders.
    pub fn is_done(&self) -> bool {
        self.next_step == self.script.steps().len() && self.confirmed_at().is_some()
    }

    /// Performs an action that is not in the script, like a person at the keyboard.
    pub fn perform(&mut self, now: Instant, action: Action) -> Result<(), ScriptError> {
        action.check()?;
        self.do_it(now, action);
        self.say(now);
        Ok(())
    }

    /// Puts a step in front of the step `index` of the script, or of the first one that is not
    /// done yet. A run in which it was there from the beginning is the same from then on.
    pub fn insert(&mut self, index: usize, step: Step) -> Result<(), ScriptError> {
        self.script.insert(index.max(self.next_step), step)
    }

    /// Number of steps of the script.
    pub fn steps(&self) -> usize {
        self.script.steps().len()
    }

    /// Waypoints that were sent, or will be sent, and are not confirmed yet.
    pub fn unconfirmed_waypoints(&self) -> Option<&[[i16; 2]]> {
        let wish = self.waypoints.as_ref()?;
        wish.confirmed_at().is_none().then_some(&wish.what[..])
    }

    /// The last order, confirmed or not.
    pub fn order(&self) -> Option<Order> {
        self.order.as_ref().map(|wish| wish.what)
    }

    fn do_it(&mut self, now: Instant, action: Action) {
        match action {
            Action::Open => self.open(now),
            Action::Close => self.close(now),
            Action::Waypoints(list) => {
                self.waypoints = Some(Wish::new(list, self.patience.until_confirmed()));
            }
            Action::Order(order) => {
                let insist = match order.mode {
                    Mode::Manual => Insist::ForEver {
                        every: self.patience.order_period,
                    },
                    Mode::Stop | Mode::Exploration | Mode::Waypoint | Mode::Explore => {
                        self.patience.until_confirmed()
                    }
                };
                self.order = Some(Wish::new(order, insist));
            }
            Action::Raw(bytes) => self.write(now, &bytes),
        }
    }

    fn open(&mut self, now: Instant) {
        if self.connection == Connection::Closed {
            self.connection = Connection::Opening;
            self.call(now);
        }
    }

    fn call(&mut self, now: Instant) {
        self.reopen_at = self.patience.answer.map(|after| now + after);
        self.changes.push_back(LineEvent::Opened);
    }

    /// Opens the port again: the other end did not answer, or closed the port.
    fn reopen(&mut self, now: Instant) {
        if self.connection == Connection::Opening {
            self.log.note(now, "no-answer", String::new());
            self.call(now);
        } else {
            self.open(now);
        }
    }

    fn close(&mut self, now: Instant) {
        self.reopen_at = None;
        if self.connection != Connection::Closed {
            self.changes.push_back(LineEvent::Closed);
            self.lose(now);
        }
    }

    /// The connection is gone, whichever end closed it.
    fn lose(&mut self, now: Instant) {
        self.connection = Connection::Closed;
        self.quiet_at = None;
        self.idle(now);
        self.waypoints.iter_mut().for_each(Wish::start_again);
        self.order.iter_mut().for_each(Wish::start_again);
        self.log.note(now, "disconnected", String::new());
    }

    fn connect(&mut self, now: Instant) {
        if self.connection == Connection::Opening {
            self.reopen_at = None;
            self.connection = Connection::Connected(now);
            self.log.note(now, "connected", String::new());
        }
    }

    /// Handles everything due by `now`. A PC needs no world, so it can also be on a real port.
    pub fn tick(&mut self, now: Instant) {
        if self.quiet_at.is_some_and(|at| at <= now) {
            self.quiet_at = None;
            self.idle(now);
        }
        if self.reopen_at.is_some_and(|at| at <= now) {
            self.reopen(now);
        }
        // A new wish replaces the old one before the old one is sent again.
        while self.step_at().is_some_and(|at| at <= now) {
            let action = self.script.steps()[self.next_step].action.clone();
            self.next_step += 1;
            self.stepped_at = now;
            self.do_it(now, action);
            self.say(now);
        }
        self.say(now);
        self.log.poll(now);
    }

    fn write(&mut self, now: Instant, bytes: &[u8]) {
        if self.connection == Connection::Closed || self.out.len() + bytes.len() > OUT_MAX {
            let detail = format!(
                "{} bytes: the port is closed or does not keep up",
                bytes.len()
            );
            self.log.note(now, "not-written", detail);
            return;
        }
        self.out.extend(bytes);
    }

    /// Time of the next step, if it is known.
    fn step_at(&self) -> Option<Instant> {
        let step = self.script.steps().get(self.next_step)?;
        let at = match step.when {
            When::At(after) => Instant::ZERO + after,
            When::AfterPrevious(after) => self.stepped_at + after,
            When::AfterConnected(after) => match self.connection {
                Connection::Connected(since) => since + after,
                Connection::Closed | Connection::Opening => return None,
            },
            When::AfterMode(mode, after) => {
                let (_, state) = self.record.state?;
                let since = self.record.mode_since.filter(|_| state.mode == mode)?;
                since + after
            }
            When::AfterConfirmed(after) => self.confirmed_at()? + after,
            When::AfterMapComplete(after) => self.map_complete_at()? + after,
        };
        Some(at.max(self.stepped_at))
    }
}

impl Device for Pc {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        if port != Self::AIR || self.connection == Connection::Closed {
            return;
        }
        if self.quiet_at.take().is_some_and(|at| at <= now) {
            self.idle(now);
        }
        self.quiet_at = Some(now + self.patience.idle);
        let mut news = Vec::new();
        self.record.take(now, bytes, |item| news.push(item));
        self.hear(now, &news);
    }

    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        match (port, event) {
            (Self::AIR, LineEvent::Opened) => self.connect(now),
            (Self::AIR, LineEvent::Closed) if self.connection != Connection::Closed => {
                self.changes.clear();
                self.out.clear();
                self.lose(now);
                self.reopen_at = self.patience.reopen.map(|after| now + after);
            }
            _ => {}
        }
    }

    fn poll(&mut self, now: Instant, _world: &mut World) {
        self.tick(now);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        if port != Self::AIR {
            return 0;
        }
        take(&mut self.out, buf)
    }

    fn line_change(&mut self, port: Port) -> Option<LineEvent> {
        // Closing waits until everything is written, as an operating system does.
        let waits = self.changes.front() == Some(&LineEvent::Closed) && !self.out.is_empty();
        if port != Self::AIR || waits {
            return None;
        }
        self.changes.pop_front()
    }

    fn may_send(&self, port: Port) -> bool {
        port == Self::AIR && !(self.out.is_empty() && self.changes.is_empty())
    }

    fn poll_at(&self) -> Option<Instant> {
        earliest([
            self.quiet_at,
            self.reopen_at,
            self.say_at(),
            self.step_at(),
            self.log.poll_at(),
        ])
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        AIR_LINE
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }
}
