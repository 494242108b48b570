//! From bytes to requests that wait for the main loop: what the base hears, what it misses while it
//! is busy, and when it will answer.

use core::time::Duration;

use protocols::Instant;

use super::config::DebugText;
use super::journal::rules;
use super::profile::{Processor, ReceiverKind};
use super::receiver::Heard;
use super::request::Request;
use super::{AvrBase, Pending, answer, ticks};

/// The processor's own watchdog.
const MCU_WATCHDOG: Duration = Duration::from_secs(1);
/// Each byte received keeps the main loop from its work this long, each byte sent that long.
/// Chosen so that of 20 requests back to back two are answered, as was seen.
const RECEIVE_LOAD: Duration = Duration::from_micros(9);
const TRANSMIT_LOAD: Duration = Duration::from_micros(4);
/// Bytes that the ring in front of the line holds: a longer reply keeps the main loop busy.
const RING: u32 = 31;

impl AvrBase {
    /// Until when the receive interrupt drops bytes: until the last request is answered but for
    /// what fits the ring.
    fn deaf_until(&self) -> Option<Instant> {
        if self.quirks.receiver != ReceiverKind::Interrupt {
            return None;
        }
        let pitch = self.bus.byte_time();
        let mut free = self.bus.free_at();
        let mut due = Instant::ZERO;
        for pending in &self.pending {
            due = pending.due;
            free = free.max(due) + pitch * pending.request.reply_len();
        }
        let ring = Instant::ZERO + (free - Instant::ZERO).saturating_sub(pitch * RING);
        Some(due.max(ring))
    }

    pub(super) fn byte(&mut self, at: Instant, byte: u8, heard: &mut Vec<Heard>) {
        if self.start.crashed_until.is_some() {
            return;
        }
        if at < self.start.up_at {
            let up_at = self.start.up_at;
            let starting = || format!("the base is up from {up_at} s on");
            let rule = rules::BYTES_WHILE_STARTING;
            self.journal.violation(at, rule, &[byte], starting);
            if self.quirks.receiver != ReceiverKind::Interrupt {
                return;
            }
        }
        if self.deaf_until().is_some_and(|until| at <= until) {
            self.drop_byte(at, byte);
            return;
        }
        if let Some(deadline) = self.receiver.deadline(self.divider())
            && deadline <= at
        {
            self.receiver.expire(deadline, &mut self.journal, heard);
        }
        if self.receiver.is_waiting() {
            self.judge_haste(at, byte);
        }
        self.receiver.byte(at, byte, &mut self.journal, heard);
    }

    /// The interrupt runs for a byte that it drops, and the main loop waits for it.
    fn drop_byte(&mut self, at: Instant, byte: u8) {
        if let Some(last) = self.pending.back_mut()
            && at < last.due
        {
            last.due += RECEIVE_LOAD;
        }
        self.journal
            .violation(at, rules::BYTES_WHILE_BUSY, &[byte], || {
                format!("byte {byte:02X} while a request was worked on is lost")
            });
    }

    fn judge_haste(&mut self, at: Instant, byte: u8) {
        let waits = self.pending.back().is_some_and(|last| last.request.valid);
        let ends = self.bus.free_at();
        if waits || at < ends {
            let rule = rules::REQUEST_BEFORE_REPLY;
            self.journal.violation(at, rule, &[byte], || {
                "a frame begins before the reply to the one before has ended".into()
            });
        }
    }

    pub(super) fn hear(&mut self, heard: Heard) {
        match heard {
            Heard::Crash => self.crash(),
            Heard::Request(request) => {
                if let ReceiverKind::Buffered { queue, .. } = self.quirks.receiver {
                    self.pending.retain(|p| p.request.valid);
                    if self.pending.len() >= queue {
                        let rule = rules::QUEUE_FULL;
                        self.journal
                            .violation(request.at, rule, &request.bytes, || {
                                format!("{queue} requests wait already")
                            });
                        return;
                    }
                }
                let due = self.due(&request);
                self.pending.push_back(Pending { request, due });
            }
        }
    }

    /// When the main loop will answer `request`.
    fn due(&mut self, request: &Request) -> Instant {
        match self.quirks.processor {
            Processor::Steady { latency } => request.at + latency,
            Processor::Measured => {
                let mut work = ticks::reply_work(&mut self.latency, request.kind());
                work += TRANSMIT_LOAD * self.bus.waiting(request.at);
                if self.config.debug_text == DebugText::On {
                    work += answer::DEBUG_TEXT_TIME;
                }
                self.ticks.finish(request.at.max(self.start.up_at), work)
            }
        }
    }

    /// The program runs on through memory that is none of its own. The timers drive the motors as
    /// before until the watchdog bites.
    fn crash(&mut self) {
        let at = self.now;
        self.start.crashed_until = Some(at + MCU_WATCHDOG);
        self.pending.clear();
        let detail = "the receiver wrote below its buffer; the watchdog will restart the processor";
        self.journal.note(at, "crashed", detail.into());
    }
}
