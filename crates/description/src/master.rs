//! The host's side of a line: polls a device with requests of its description, and judges the
//! replies.
//!
//! ```text
//! | request 1 |  reply  |      pause      | request 2 |  timeout  | request 1 | ..
//! |<------------- period ---------------->|<------- period ------>|
//! ```

use core::time::Duration;
use std::collections::VecDeque;
use std::sync::Arc;

use emulators::device::{BrokenRules, Device, Event, EventKind, earliest, take};
use emulators::event_log::EventLog;
use emulators::world::World;
use protocols::{Decode as _, FrameError, Instant, LineConfig, Port};

use crate::description::Description;
use crate::framing::{Cutter, Frame, Overlong};
use crate::schema::message::From;
use crate::speak::Request;
use crate::value::Value;

/// Maximum number of values that are kept.
const VALUES_MAX: usize = 1_024;

/// The requests of a master, and their times.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MasterPlan {
    /// Requests in words, in their order, as for `hilrig talk`. After the last one, the first one
    /// follows.
    pub requests: Vec<String>,
    /// Time from the beginning of a request to that of the next one.
    pub period: Duration,
    /// Time from the end of a request within which its reply must be complete.
    pub timeout: Duration,
}

/// A master that polls a device.
#[derive(Clone)]
pub struct Master {
    description: Arc<Description>,
    requests: Vec<Request>,
    period: Duration,
    timeout: Duration,
    /// Index of the next request, and its time.
    next: usize,
    due: Instant,
    /// The request without a reply so far, and the end of its timeout.
    asked: Option<(usize, Instant)>,
    /// The messages, by index, that still belong to the last reply.
    rest: Vec<usize>,
    /// The request whose timeout ended last, until its reply comes late.
    late: Option<usize>,
    /// Number of requests that need a reply and whose timeout is over, and number of those that got
    /// one.
    judged: [u64; 2],
    cutter: Cutter,
    overlong: Overlong,
    /// Time at which a silence is long enough to end a frame.
    quiet_at: Option<Instant>,
    /// Earliest time of a request: the last bytes and a silence are over.
    free_at: Instant,
    inbox: VecDeque<(Instant, Vec<u8>)>,
    output: VecDeque<u8>,
    values: Vec<(String, Value, String)>,
    log: EventLog,
}

impl Master {
    /// The serial port of the master.
    pub const UART: Port = Port(0);

    /// A master of a described device.
    ///
    /// # Errors
    /// If a request is wrong; with its index and the expected words.
    pub fn new(description: Arc<Description>, plan: &MasterPlan) -> Result<Self, (usize, String)> {
        let mut requests = Vec::new();
        for (index, text) in plan.requests.iter().enumerate() {
            let words: Vec<&str> = text.split_whitespace().collect();
            let parsed = description.requests(&words);
            requests.extend(parsed.map_err(|error| (index, error))?);
        }
        if requests.is_empty() {
            return Err((0, "is empty, expected a request".to_owned()));
        }
        Ok(Self {
            cutter: description.cutter_of(From::Device),
            description,
            requests,
            period: plan.period,
            timeout: plan.timeout,
            next: 0,
            due: Instant::ZERO + plan.period,
            asked: None,
            rest: Vec::new(),
            late: None,
            judged: [0; 2],
            overlong: Overlong::default(),
            quiet_at: None,
            free_at: Instant::ZERO,
            inbox: VecDeque::new(),
            output: VecDeque::new(),
            values: Vec::new(),
            log: EventLog::default(),
        })
    }

    /// The last values of the device: name, value, and value in words.
    pub fn values(&self) -> &[(String, Value, String)] {
        &self.values
    }

    /// Number of requests that need a reply and whose timeout is over, and number of those that got
    /// one.
    pub const fn judged(&self) -> [u64; 2] {
        self.judged
    }

    fn tell(&mut self, at: Instant, rule: &'static str, detail: impl FnOnce() -> String) {
        self.log.repeated(at, EventKind::Violation, rule, detail);
    }

    /// Does everything that is due by `now` before further bytes.
    fn catch_up(&mut self, now: Instant) {
        if let Some(at) = self.quiet_at.take_if(|at| *at <= now) {
            self.cutter.idle();
            self.take(at, &[]);
            self.overlong.end();
        }
        if let Some((index, _)) = self.asked.take_if(|(_, until)| *until <= now) {
            self.judged[0] += 1;
            self.late = Some(index);
            let timeout = self.timeout;
            let words = self.requests[index].words.clone();
            self.tell(now, "no-reply", || {
                format!("\"{words}\" has no reply within {timeout:?}")
            });
        }
    }

    /// Processes bytes of the device, the last of them complete at `at`.
    fn take(&mut self, at: Instant, bytes: &[u8]) {
        let found: Vec<Result<Frame, FrameError>> = self.cutter.push(bytes).collect();
        let mut error = None;
        for outcome in found {
            if self.overlong.swallows(&outcome, &self.description.frames) {
                continue;
            }
            match outcome {
                Ok(frame) => self.hear(at, &frame),
                Err(first) => error = error.or(Some(first)),
            }
        }
        if let Some(error) = error {
            let rule = match error {
                FrameError::Checksum { .. } => "bad-checksum",
                FrameError::Truncated { .. } => "frame-cut-off",
                FrameError::Length { .. } => "bad-length",
                _ => "bad-frame",
            };
            self.tell(at, rule, || error.to_string());
        }
    }

    /// Whether the frame needs no request: the device sends its message by itself, it belongs to
    /// the last reply, or it is a late reply, whose lateness was reported.
    fn is_expected(&mut self, frame: &Frame) -> bool {
        let description = &self.description;
        let body = description.body(frame).unwrap_or_default();
        let message = description.decode(frame.format, &body, From::Device);
        let index = message.map(|(index, _)| index);
        if let Some(at) = self.rest.iter().position(|rest| Some(*rest) == index) {
            self.rest.remove(at);
            return true;
        }
        let is_late = |index: &mut usize| {
            let reply = description.reply(&self.requests[*index], frame);
            reply.is_asked
        };
        if self.late.take_if(is_late).is_some() {
            self.rest = description.rest_of_reply(frame);
            return true;
        }
        description.is_unasked(frame) || description.is_at_event(frame)
    }

    /// Judges a frame of the device.
    fn hear(&mut self, at: Instant, frame: &Frame) {
        let description = self.description.clone();
        let Some((index, _)) = self.asked else {
            if !self.is_expected(frame) {
                let words = description.words_for(frame, From::Device);
                self.tell(at, "unasked-reply", || words);
            }
            return;
        };
        let reply = description.reply(&self.requests[index], frame);
        if !reply.is_asked {
            if !self.is_expected(frame) {
                self.tell(at, "unknown-reply", || reply.words);
            }
            return;
        }
        self.asked = None;
        self.rest = description.rest_of_reply(frame);
        self.judged = self.judged.map(|count| count + 1);
        if reply.is_refusal {
            let words = self.requests[index].words.clone();
            return self.tell(at, "refused", || format!("\"{words}\": {}", reply.words));
        }
        for row in reply.values {
            match self.values.iter().position(|(known, ..)| *known == row.0) {
                Some(at) => self.values[at] = row,
                None if self.values.len() < VALUES_MAX => self.values.push(row),
                None => {}
            }
        }
    }

    /// Sends the next request, if it is due.
    fn ask(&mut self, now: Instant) {
        if self.asked.is_some() || now < self.asks_at() {
            return;
        }
        let index = self.next;
        self.next = (index + 1) % self.requests.len();
        self.due = (self.due + self.period).max(now);
        let request = &self.requests[index];
        let end = now + self.description.line.bytes_time(request.bytes.len() as u64);
        self.output.extend(&request.bytes);
        self.free_at = end + self.description.idle();
        if request.is_answered() {
            self.asked = Some((index, end + self.timeout));
        }
    }

    /// Time at which the next request is due.
    fn asks_at(&self) -> Instant {
        self.due.max(self.free_at)
    }
}

impl Device for Master {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        if port == Self::UART {
            self.inbox.push_back((now, bytes.to_vec()));
        }
    }

    fn poll(&mut self, now: Instant, _: &mut World) {
        self.log.poll(now);
        while let Some((at, bytes)) = self.inbox.pop_front() {
            if at > now {
                self.inbox.push_front((at, bytes));
                break;
            }
            let first = self.description.line.byte_end(at, bytes.len() as u64);
            self.catch_up(first);
            self.take(at, &bytes);
            let quiet_at = at + self.description.idle();
            self.quiet_at = Some(quiet_at);
            self.free_at = self.free_at.max(quiet_at);
        }
        self.catch_up(now);
        self.ask(now);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        match port == Self::UART {
            true => take(&mut self.output, buf),
            false => 0,
        }
    }

    fn may_send(&self, _: Port) -> bool {
        !self.output.is_empty()
    }

    fn poll_at(&self) -> Option<Instant> {
        let inbox = self.inbox.front().map(|(at, _)| *at);
        let next = match self.asked {
            Some((_, until)) => until,
            None => self.asks_at(),
        };
        earliest([Some(next), inbox, self.quiet_at, self.log.poll_at()])
    }

    fn line_config(&self, _: Port) -> LineConfig {
        self.description.line
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }
}
