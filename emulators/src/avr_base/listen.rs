//! From bytes to requests that wait for the main loop: bytes that the base receives, and bytes that
//! it misses while busy.

use core::time::Duration;

use protocols::Instant;

use super::journal::rules;
use super::processor::Chip;
use super::profile::{Processor, ReceiverKind};
use super::receiver::Heard;
use super::request::Request;
use super::{AvrBase, Pending};

/// The processor's own watchdog.
const MCU_WATCHDOG: Duration = Duration::from_secs(1);
/// Bytes that the ring in front of the line holds: a longer reply keeps the main loop busy.
const RING: u32 = 31;

impl AvrBase {
    /// Whether the receive interrupt drops a byte that ends at `at`. The interrupt drops bytes
    /// until the rest of the last reply fits the ring.
    fn is_deaf(&self, at: Instant) -> bool {
        if self.quirks.receiver != ReceiverKind::Interrupt {
            return false;
        }
        if self.is_measured() {
            return self.chip.busy;
        }
        let pitch = self.bus.byte_time();
        let mut free = self.bus.free_at();
        let mut due = Instant::ZERO;
        for pending in &self.pending {
            due = pending.due;
            free = free.max(due) + pitch * pending.request.reply_len();
        }
        let ring = Instant::ZERO + (free - Instant::ZERO).saturating_sub(pitch * RING);
        at <= due.max(ring)
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
        if self.is_deaf(at) {
            self.drop_byte(at, byte);
            return;
        }
        if let Some(deadline) = self.frame_deadline()
            && deadline <= at
        {
            self.receiver.expire(deadline, &mut self.journal, heard);
        }
        if self.receiver.is_waiting() {
            self.judge_haste(at, byte);
        }
        let memory = self.is_measured().then_some(&mut self.memory);
        self.receiver
            .byte(at, byte, memory, &mut self.journal, heard);
    }

    fn drop_byte(&mut self, at: Instant, byte: u8) {
        self.journal
            .violation(at, rules::BYTES_WHILE_BUSY, &[byte], || {
                format!("byte {byte:02X} is lost: a request was being processed")
            });
    }

    fn judge_haste(&mut self, at: Instant, byte: u8) {
        let waits = self.pending.back().is_some_and(|last| last.request.valid);
        // No master can wait for an unsolicited report.
        let answers = at < self.bus.free_at() && at >= self.announces_until;
        let replies = self.chip.cpu.is_replying() || answers;
        if waits || replies {
            let rule = rules::REQUEST_BEFORE_REPLY;
            self.journal.violation(at, rule, &[byte], || {
                "a frame begins before the reply to the previous frame has ended".into()
            });
        }
    }

    pub(super) fn hear(&mut self, heard: Heard) {
        match heard {
            Heard::Crash => self.crash(self.now),
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

    /// Time of the answer to `request`; the measured processor determines it by itself.
    fn due(&self, request: &Request) -> Instant {
        match self.quirks.processor {
            Processor::Steady { latency } => request.at + latency,
            Processor::Measured => Instant::from_nanos(u64::MAX),
        }
    }

    /// Crash: the program runs on through foreign memory. The timers drive the motors as before
    /// until the processor's watchdog restarts the base.
    pub(super) fn crash(&mut self, at: Instant) {
        let until = at + MCU_WATCHDOG;
        self.start.crashed_until = Some(until);
        self.chip = Chip::new(until, self.ticks, until);
        self.pending.clear();
        let detail = "the receiver wrote below its buffer; the watchdog will restart the processor";
        self.journal.note(at, "crashed", detail.into());
    }
}
