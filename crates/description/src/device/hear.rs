//! Reception: from bytes to messages, with the driver's errors.

use core::ops::Range;
use core::time::Duration;

use protocols::{Decode, FrameError, Instant};

use emulators::device::{EventKind, byte_end};

use super::Described;
use super::act::Doer;
use super::shared::Complaint;
use crate::framing::{FRAME_MAX, Frame};
use crate::schema::behaviour::EventSpec;
use crate::schema::message::From;

/// The rule: frames follow each other without the silence that ends a frame.
pub const MISSING_PAUSE: &str = "missing-pause";

/// The words on `count` frames without the silence `idle` between them.
pub fn no_pause(count: usize, idle: Duration) -> String {
    let ms = idle.as_secs_f64() * 1e3;
    format!(
        "{count} requests follow each other without a silence of {ms:.1} ms, so they are one invalid \
         frame"
    )
}

impl Doer<'_> {
    /// Processes the received bytes.
    pub(super) fn hear(&mut self, now: Instant) {
        while let Some((at, bytes)) = self.device.inbox.pop_front() {
            if at > now {
                self.device.inbox.push_front((at, bytes));
                break;
            }
            self.end_of_silence(first_start(self.device.description.line, at, bytes.len()));
            self.chunk(at, &bytes);
            self.device.spare = bytes;
        }
        self.end_of_silence(now);
    }

    /// Processes bytes that arrived back to back, the last of them at `at`. The result is the same
    /// for one delivery of all bytes and for one of each byte.
    fn chunk(&mut self, at: Instant, bytes: &[u8]) {
        let line = self.device.description.line;
        let next = self.catch_up(byte_end(at, line, 0, bytes.len()));
        if next.is_none_or(|next| next >= at) && self.is_free(at, bytes.len()) {
            if self.device.is_silence_framed {
                self.device.heard(at);
                self.device.heard.pass(bytes.len());
                return self.device.hear_silently(bytes);
            }
            // A usual request arrives at once; one look at all of it saves one for each byte.
            if let Some(frame) = self.device.cutter.whole(bytes) {
                self.device.heard(at);
                self.device.heard.pass(bytes.len());
                self.device.overlong.end();
                return self.frame(at, &frame, 0);
            }
        }
        for (index, &byte) in bytes.iter().enumerate() {
            let end = || byte_end(at, line, index, bytes.len());
            // A byte before it may have caused an action that is due before this byte.
            if self.device.acts_at().is_some() {
                self.catch_up(end());
            }
            self.byte(&end, byte, index + 1 == bytes.len());
        }
    }

    /// Does everything that is due before `end`, at its time; returns the time of the next action.
    fn catch_up(&mut self, end: Instant) -> Option<Instant> {
        loop {
            match self.device.acts_at() {
                Some(due) if due < end => self.act(due),
                next => return next,
            }
        }
    }

    /// Whether the device hears all of `count` bytes that end at `at`, before which no action is
    /// due: it hears none while it starts, and on a half-duplex line none while it sends.
    fn is_free(&self, at: Instant, count: usize) -> bool {
        let device = &*self.device;
        if device.boot_until.is_some() {
            return false;
        }
        if !device.description.is_half_duplex {
            return true;
        }
        let line = device.description.line;
        let started = line.byte_end(byte_end(at, line, 0, count), 1);
        device.pending.is_empty() && !device.is_sending(started)
    }

    /// Ends a frame if the line was silent for long enough before `now`.
    fn end_of_silence(&mut self, now: Instant) {
        let Some(at) = self.device.quiet_at.filter(|at| *at <= now) else {
            return;
        };
        // An action that is due before the silence ends changes what the frame reads.
        self.catch_up(at);
        self.device.quiet_at = None;
        if self.device.is_silence_framed {
            let bytes = core::mem::take(&mut self.device.silent);
            return self.silent_frame(at, &bytes);
        }
        self.device.cutter.idle();
        self.cut(at, &[]);
        self.device.overlong.end();
    }

    /// Processes a byte that ended at `end`; `is_last` marks the last byte of a chunk.
    fn byte(&mut self, end: &dyn Fn() -> Instant, byte: u8, is_last: bool) {
        let device = &mut *self.device;
        device.heard.pass(1);
        if let Some(up) = device.boot_until.filter(|up| end() < *up) {
            let detail = || {
                let ms = up.as_millis();
                format!("bytes arrived while the device starts, until {ms} ms")
            };
            let log = &mut device.log;
            return log.repeated(end(), EventKind::Violation, "not-ready", detail);
        }
        if device.description.is_half_duplex {
            let at = end();
            let started = device.description.line.byte_end(at, 1);
            let is_waiting = !device.pending.is_empty();
            if is_waiting || device.is_sending(started) {
                let detail = || match is_waiting {
                    true => "bytes arrived before the reply to the last request".to_owned(),
                    false => "bytes arrived while the device sends, and are lost".to_owned(),
                };
                return device.log.repeated(
                    at,
                    EventKind::Violation,
                    "request-before-reply",
                    detail,
                );
            }
        }
        // The end time is computed only where it is used.
        if is_last {
            device.heard(end());
        }
        if device.is_silence_framed {
            return device.hear_silently(&[byte]);
        }
        let mut rest = &[byte][..];
        if let Some(outcome) = self.device.cutter.step(&mut rest) {
            let at = end();
            self.device.heard(at);
            self.outcomes(at, outcome, rest);
        }
    }

    /// Processes a frame that ended with a silence.
    fn silent_frame(&mut self, at: Instant, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        let heard = self.device.description.frames_of(From::Host);
        let whole = heard.whole(bytes);
        match whole {
            Ok(frame) => self.frame(at, &frame, 0),
            Err(error) => {
                let len = usize::try_from(self.device.silent_len).unwrap_or(usize::MAX);
                let span = self.device.heard.span(len, 0);
                let count = self.of.without_pause(bytes).filter(|_| len == bytes.len());
                if let Some(count) = count {
                    let detail = no_pause(count, self.device.idle);
                    return self.bad_for(at, (MISSING_PAUSE, detail), bytes, vec![span]);
                }
                self.bad(at, error, bytes, vec![span]);
            }
        }
    }

    /// Feeds bytes to the decoder.
    fn cut(&mut self, at: Instant, bytes: &[u8]) {
        let mut rest = bytes;
        if let Some(outcome) = self.device.cutter.step(&mut rest) {
            self.outcomes(at, outcome, rest);
        }
    }

    /// Processes the decoder's result, and further results from `rest`.
    fn outcomes(&mut self, at: Instant, first: Result<Frame, FrameError>, mut rest: &[u8]) {
        let mut first_error = None;
        let mut spans = Vec::new();
        let mut next = Some(first);
        while let Some(outcome) = next {
            let device = &mut *self.device;
            let behind = device.cutter.pending() + rest.len();
            let is_swallowed = device.overlong.swallows(&outcome, &self.of.frames);
            match outcome {
                _ if is_swallowed => {}
                Ok(frame) => {
                    if let Some(error) = first_error.take() {
                        self.bad(at, error, &[], core::mem::take(&mut spans));
                    }
                    self.frame(at, &frame, behind);
                }
                // The rest of a damaged frame causes further errors; the first error gives the
                // reason.
                Err(error) => {
                    first_error = first_error.or(Some(error));
                    spans.push(device.heard.span(1, behind));
                }
            }
            next = self.device.cutter.step(&mut rest);
        }
        if let Some(error) = first_error {
            self.bad(at, error, &[], spans);
        }
    }

    fn bad(&mut self, at: Instant, error: FrameError, bytes: &[u8], spans: Vec<Range<u64>>) {
        let rule = match error {
            FrameError::Checksum { .. } => "bad-checksum",
            FrameError::Truncated { .. } => "frame-cut-off",
            FrameError::Length { .. } => "bad-length",
            _ => "bad-frame",
        };
        self.bad_for(at, (rule, error.to_string()), bytes, spans);
    }

    /// Reports bytes that break `rule`.
    fn bad_for(
        &mut self,
        at: Instant,
        (rule, detail): (&'static str, String),
        bytes: &[u8],
        spans: Vec<Range<u64>>,
    ) {
        self.device.complain(Complaint {
            bytes: bytes.to_vec(),
            spans,
            ..Complaint::new(at, rule, detail)
        });
        self.device.events.push_back((at, EventSpec::BadFrame));
        self.run_events(at);
    }

    /// Processes a frame, behind which the decoder has `behind` bytes already.
    fn frame(&mut self, at: Instant, frame: &Frame, behind: usize) {
        self.device.has_framed = true;
        let span = self.device.heard.span(frame.bytes.len(), behind);
        if !self.device.place.is_alone && self.knows(frame) {
            self.device.heard.know(span.clone());
            if !self.device.is_addressed() {
                self.device.heard.claim(span.clone());
            }
        }
        let device = &mut *self.device;
        if at < device.busy_until {
            let until = device.busy_until;
            let detail = || format!("a frame arrived while the device is busy, until {until} s");
            return device
                .log
                .repeated(at, EventKind::Violation, "too-fast", detail);
        }
        let watchdog = device.description.watchdog;
        device.watchdog_at = watchdog.map(|time| at + time);
        let is_modbus = device.is_modbus();
        let Some(body) = self.of.body_of(frame) else {
            return;
        };
        match is_modbus {
            true => self.modbus(at, &body, span),
            false => self.message(at, frame, &body, span),
        }
    }

    /// Whether the frame is a message of the description.
    fn knows(&self, frame: &Frame) -> bool {
        let of = self.of;
        self.device.is_modbus()
            || of.body_of(frame).is_some_and(|body| {
                let found = of.decode(frame.format, &body, From::Host);
                found.is_some()
            })
    }
}

impl Described {
    /// Whether the device still sends when a byte starts at `started`.
    fn is_sending(&self, started: Instant) -> bool {
        // Byte times are rounded. No receiver detects an overlap of less than a bit.
        let line = self.description.line;
        let bit = line.byte_time() / line.bits_per_byte();
        started + bit < self.sending_until
    }

    /// Keeps the bytes of a frame that a silence will end.
    fn hear_silently(&mut self, bytes: &[u8]) {
        // A frame that is too long stays invalid, whatever bytes follow.
        let room = (FRAME_MAX + 1).saturating_sub(self.silent.len());
        match self.silent.is_empty() {
            true => self.silent_len = bytes.len() as u64,
            false => self.silent_len += bytes.len() as u64,
        }
        self.silent.extend(&bytes[..bytes.len().min(room)]);
    }
}

/// Time at which the first of `count` bytes began.
fn first_start(line: protocols::LineConfig, end: Instant, count: usize) -> Instant {
    line.byte_end(end, count as u64)
}
