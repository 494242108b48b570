//! Requests of the host, and the time of their handling.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::rplidar::{Command, Request, RequestDecoder, Requests};
use protocols::{Decode, FrameError, Instant};

use super::{Fault, LINE, Phase, Rplidar};
use crate::device::{EventKind, byte_end, earliest};

/// All bytes of a request must come within this time, or it is discarded (LR001).
const REQUEST_TIME: Duration = Duration::from_secs(5);
/// From the last byte of a request to its answer. A guess.
const ANSWER_TIME: Duration = Duration::from_millis(1);
/// From a reset, or from power-up, to the start text; an A1M8 with firmware 1.29 takes 0.671 to
/// 0.672 s, and answers 4 ms after the text (measured by a user, see the profile). LR001 says at
/// least 2 ms.
const START_TIME: Duration = Duration::from_micros(671_500);
/// Maximum number of waiting requests. The size of the UART's buffer is not known; a driver sends
/// at most two ahead.
const WAITING_MAX: usize = 16;

/// Received requests, in the order of their arrival.
///
/// LR001 tells the host to wait after a stop (1 ms), and not to ask while an answer is due. That is
/// advice: a real sensor answers back-to-back requests. The vendor's own library for
/// microcontrollers relies on it (stop and scan in one write).
#[derive(Clone, Debug, Default)]
pub(super) struct Handling {
    /// The action, and its time.
    requests: VecDeque<(Instant, Command)>,
    /// Time of the start text.
    text_at: Option<Instant>,
    /// End of the time in which requests are discarded: the processor starts, or a fault keeps it
    /// busy.
    deaf_until: Instant,
}

impl Handling {
    /// State of a processor that starts at `now`: it takes no request before it has printed its
    /// text.
    pub(super) fn starting(now: Instant) -> Self {
        let text_at = now + START_TIME;
        Self {
            requests: VecDeque::new(),
            text_at: Some(text_at),
            deaf_until: text_at,
        }
    }

    pub(super) fn next_at(&self) -> Option<Instant> {
        earliest([self.requests.front().map(|(at, _)| *at), self.text_at])
    }
}

impl Rplidar {
    pub(super) fn host_bytes(&mut self, now: Instant, bytes: &[u8]) {
        if self.phase == Phase::Off {
            return;
        }
        for (index, &byte) in bytes.iter().enumerate() {
            let at = byte_end(now, LINE, index, bytes.len());
            if self.give_up_at.is_some_and(|due| due <= at) {
                self.give_up_request(at);
            }
            let was_idle = self.requests.pending() == 0;
            let outcomes: Vec<_> = self.requests.push(&[byte]).collect();
            if outcomes.is_empty() && was_idle && self.requests.pending() == 0 {
                let detail = || format!("byte {byte:02X} outside a request");
                let kind = EventKind::Violation;
                self.log.repeated(at, kind, "stray-bytes", detail);
            }
            for outcome in outcomes {
                match outcome {
                    Ok(request) => self.accept(at, now, &request),
                    Err(error) => self.reject(at, error),
                }
            }
            match self.requests.pending() {
                0 => self.give_up_at = None,
                _ if was_idle => self.give_up_at = Some(at + REQUEST_TIME),
                _ => {}
            }
        }
    }

    /// Discards an incomplete request after its time.
    pub(super) fn give_up_request(&mut self, at: Instant) {
        let pending = self.requests.pending();
        self.requests = RequestDecoder::with_format(Requests);
        self.give_up_at = None;
        let detail = format!("{pending} bytes of a request, and no further bytes within 5 s");
        self.log.violation(at, "request-cut", detail, &[]);
    }

    fn reject(&mut self, at: Instant, error: FrameError) {
        let kind = EventKind::Violation;
        let detail = || error.to_string();
        self.log.repeated(at, kind, "request-damaged", detail);
    }

    /// Takes a request that was complete at `at`. The sensor handles it at `now` at the earliest,
    /// because the answers to earlier requests are sent already.
    fn accept(&mut self, at: Instant, now: Instant, request: &Request) {
        let bytes = request.as_bytes();
        let Some(command) = request.command() else {
            let detail = format!("command {:02X} is not known", request.code());
            self.log.violation(at, "request-unknown", detail, bytes);
            return;
        };
        let is_full = self.handling.requests.len() >= WAITING_MAX;
        if at < self.handling.deaf_until || is_full {
            let why = if is_full {
                "16 others waited"
            } else {
                "the sensor took none"
            };
            let detail = format!("{command:?} arrived while {why}");
            self.log.violation(at, "request-while-busy", detail, bytes);
            return;
        }
        let due = match command {
            Command::Stop | Command::Reset | Command::MotorPwm { .. } => at,
            _ => at + ANSWER_TIME + self.seconds(Fault::LateAnswers),
        };
        if command == Command::Reset {
            // The sensor restarts at once and forgets waiting requests.
            self.handling.requests.clear();
        }
        let before = self.handling.requests.back().map(|(at, _)| *at);
        let due = due.max(now).max(before.unwrap_or(due));
        self.handling.requests.push_back((due, command));
        if command == Command::Stop {
            self.handling.deaf_until = at + self.seconds(Fault::SlowStop);
        }
    }

    /// The figure of a fault as a time, zero if it is not set.
    fn seconds(&self, fault: Fault) -> Duration {
        let seconds = self.faults.figure(fault).unwrap_or(0.0);
        Duration::try_from_secs_f64(seconds).unwrap_or_default()
    }

    /// Handles the request that is due at `at`.
    pub(super) fn handle(&mut self, at: Instant) {
        if self.handling.text_at.take_if(|due| *due <= at).is_some() {
            let text = self.profile.start_text();
            self.output.send(text.as_bytes(), &mut self.faults);
            return;
        }
        let Some((_, command)) = self.handling.requests.pop_front() else {
            return;
        };
        match command {
            Command::Reset => self.restart(at, "reset", "the host resets the sensor"),
            Command::Stop => self.end_scan(),
            Command::Scan | Command::ForceScan | Command::ExpressScan { .. } => {
                self.start_scan(at, command);
            }
            // The motor is another board's concern. That a scan continues is a guess.
            Command::MotorPwm { pwm } => self.set_pwm(at, pwm),
            Command::MotorSpeed { .. } => self.answer(at, command),
            _ => {
                self.end_scan();
                self.answer(at, command);
            }
        }
    }
}
