//! Effects of the measured processor's steps on the base.

use core::time::Duration;

use protocols::Instant;

use super::config::DebugText;
use super::cpu::{Cpu, Step};
use super::memory::Tasks;
use super::profile::ReceiverKind;
use super::request::{Request, RequestKind};
use super::ticks::{Due, REGULATOR, TICK, Ticks};
use super::{AvrBase, Pending, answer};
use crate::world::World;

/// From the load of the receiver's state to the first byte in the ring, for a read: 127 cycles.
const READ_WORK: Duration = Duration::from_nanos(7_938);
/// The same for a write, and for each byte of its data: 142 and 38 cycles.
const WRITE_WORK: [Duration; 2] = [Duration::from_nanos(8_875), Duration::from_nanos(2_375)];
/// The same for a request with a wrong checksum, and for each byte of its data: 103 and 18 cycles.
const REFUSE_WORK: [Duration; 2] = [Duration::from_nanos(6_438), Duration::from_nanos(1_125)];

/// The processor, and the variables that its main loop and interrupts share.
#[derive(Clone, Debug)]
pub(super) struct Chip {
    pub(super) cpu: Cpu,
    /// The receiver is deaf: a request waits or is answered.
    pub(super) busy: bool,
    /// The main loop has loaded the state of a fragment and not tested it yet.
    saw_fragment: bool,
    /// Counts of the divider until a fragment is discarded; each byte sets it to 1.
    frame_counts: u8,
    /// Counts of the divider until the motors time out.
    pub(super) watchdog_counts: Option<u16>,
}

impl Chip {
    pub(super) fn new(now: Instant, ticks: Ticks, up_at: Instant) -> Self {
        Self {
            cpu: Cpu::new(now, ticks, up_at),
            busy: false,
            saw_fragment: false,
            frame_counts: 0,
            watchdog_counts: None,
        }
    }
}

impl AvrBase {
    /// Whether the main loop has work in its next steps.
    fn is_attentive(&self) -> bool {
        let fragment = !self.listens_to_a_buffer() && !self.receiver.is_waiting();
        let expired = self.chip.watchdog_counts == Some(0);
        fragment || expired || self.chip.saw_fragment || !self.pending.is_empty()
    }

    fn listens_to_a_buffer(&self) -> bool {
        self.quirks.receiver != ReceiverKind::Interrupt
    }

    /// Time of the processor's next poll: its next step while bytes or replies are under way, else
    /// the next possible task.
    pub(super) fn chip_at(&self) -> Instant {
        let expired = self.chip.watchdog_counts == Some(0);
        if expired || self.chip.cpu.is_busy() || !self.pending.is_empty() {
            return self.chip.cpu.next_change();
        }
        // Every task's period is a multiple of five ticks.
        self.ticks.after(self.now, 5 * TICK, 1)
    }

    /// Runs the processor to its next step, at `limit` at the latest; returns whether there was
    /// one.
    pub(super) fn step(&mut self, limit: Instant, world: &mut World) -> bool {
        let attentive = self.is_attentive();
        let Some((at, step)) = self.chip.cpu.advance(limit, attentive) else {
            return false;
        };
        match step {
            Step::Received { ended, byte } => self.received(ended, byte),
            Step::Sent(byte) => self.bus.send(at, &[byte]),
            Step::Tick => self.tick(at, world),
            Step::Count => {
                let chip = &mut self.chip;
                chip.frame_counts = chip.frame_counts.saturating_sub(1);
                chip.watchdog_counts = chip.watchdog_counts.map(|n| n.saturating_sub(1));
                self.battery.convert(&mut self.memory);
            }
            Step::Load => self.load(at, world),
            Step::Test => self.test(at, world),
            Step::Replied => self.chip.busy = false,
        }
        true
    }

    fn received(&mut self, ended: Instant, byte: u8) {
        self.chip.frame_counts = 1;
        if !self.chip.busy {
            self.chip.cpu.work_on_byte(self.receiver.work(byte));
        }
        let mut heard = Vec::new();
        self.byte(ended, byte, &mut heard);
        heard.into_iter().for_each(|heard| self.hear(heard));
        self.chip.busy |= !self.listens_to_a_buffer() && !self.pending.is_empty();
    }

    /// Runs the tick interrupt: its duration, and its tasks that need the world. If the rig polls
    /// late, they run once.
    fn tick(&mut self, at: Instant, world: &mut World) {
        match self.memory.tasks() {
            Tasks::Sound => {}
            Tasks::Damaged => return self.crash(at),
            Tasks::Gone => return self.chip.cpu.begin_tick(Due::bare_work(), false),
        }
        let due = self.ticks.due(at);
        let work = due.work(self.infrared.block(), self.set_points() != [0; 2]);
        self.chip.cpu.begin_tick(work, due.divider);
        if due.regulator && self.ticks.after(at, REGULATOR, 1) > self.now {
            self.regulate(at, world);
        }
        if due.analog {
            self.analog(at, world);
        }
    }

    fn load(&mut self, at: Instant, world: &mut World) {
        if let Some(Pending { request, .. }) = self.pending.pop_front() {
            self.look_at_wheels(world);
            self.main_loop_pass();
            let work = self.reply_work(&request);
            let reply = self.answer(at, &request);
            self.chip.cpu.reply(work, reply.as_bytes());
        } else {
            self.chip.saw_fragment = !self.listens_to_a_buffer() && !self.receiver.is_waiting();
        }
    }

    /// Tests the loaded state, which may be outdated. If a tick interrupt with a count of the
    /// divider completed a frame in between, the main loop discards that frame as a fragment.
    fn test(&mut self, at: Instant, world: &mut World) {
        if core::mem::take(&mut self.chip.saw_fragment) && self.chip.frame_counts == 0 {
            if let Some(Pending { request, .. }) = self.pending.pop_front() {
                self.chip.busy = false;
                let detail = format!("a sound frame of {} bytes", request.bytes.len());
                self.journal.note(at, "frame-vanished", detail);
            } else if !self.receiver.is_waiting() {
                let mut heard = Vec::new();
                self.receiver.expire(at, &mut self.journal, &mut heard);
            }
        }
        if self.chip.watchdog_counts == Some(0) {
            self.motor_watchdog(at, world);
        }
    }

    fn reply_work(&self, request: &Request) -> Duration {
        let is_write = request.kind() == RequestKind::Write;
        let data = if is_write {
            u32::from(request.count())
        } else {
            0
        };
        let mut work = match (request.valid, is_write) {
            (true, false) => READ_WORK,
            (true, true) => WRITE_WORK[0] + WRITE_WORK[1] * data,
            (false, _) => REFUSE_WORK[0] + REFUSE_WORK[1] * data,
        };
        if self.config.debug_text == DebugText::On {
            work += answer::DEBUG_TEXT_TIME;
        }
        work
    }
}
