//! Time of the processor: a main loop that interrupts delay.
//!
//! ```text
//! receive and transmit interrupt    not interrupted themselves; receive comes first
//!   tick interrupt                  lets those two in; a late tick runs on top of the last one
//!     main loop                     load state, test it -> answer, or give a fragment up -> rest
//! ```
//!
//! Three positions decide when an answer comes, which byte is lost and which fragment is discarded:
//! those of main loop, tick interrupt and byte interrupts. Figures: field firmware b77a6df run in a
//! simulated ATmega2560 at 16 MHz with a byte every 10 us. Those marked as derived follow from
//! measured latencies.
//!
//! This module knows only durations. Its owner takes one [`Step`] after the other from
//! [`Cpu::advance`] and executes it.

use std::collections::VecDeque;

use core::time::Duration;

use protocols::Instant;

use super::ticks::{TICK, Ticks};

/// One received byte. Measured.
const RECEIVE: u64 = 6_400;
/// Duration of the transmit interrupt until its byte is in the line's register, and after that.
/// Derived: 20 requests without a gap get three or four answers.
const TRANSMIT: [u64; 2] = [3_000, 3_600];
/// The line takes this long for a byte. Measured: replies have a pitch of 10.0 to 10.2 us.
const BYTE: u64 = 10_000;
/// One pass of the main loop without work. Measured.
const PASS: u64 = 24_600;
/// From the load of the receiver's state to the test of its time-out. Derived: a frame of 5 bytes
/// vanishes with a chance of 5e-5, see the field-bug catalogue, AV-21.
const LOAD_TO_TEST: u64 = 800;
/// The main loop puts one byte of a reply into the ring. Derived: a second request 20 to 40 us
/// behind the first is answered in 5 percent of the cases.
const PUT: u64 = 1_800;
/// Bytes that the ring in front of the line holds; with more to send the main loop waits.
const RING: usize = 31;
/// The count of the divider falls this long after its tick interrupt has begun. Derived: the main
/// loop has seen it 42 us later.
const TICK_TO_COUNT: u64 = 66_000;

/// The next event of the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// The receive interrupt has taken `byte`, which ended at `ended`.
    Received {
        /// End of the byte on the line.
        ended: Instant,
        /// The byte.
        byte: u8,
    },
    /// A byte goes to the line.
    Sent(u8),
    /// The tick interrupt begins; it does nothing until [`Cpu::begin_tick`] sets its duration.
    Tick,
    /// The divider counts.
    Count,
    /// The main loop loads the receiver's state.
    Load,
    /// The main loop tests the time-outs, with the state loaded before.
    Test,
    /// The reply is in the ring, all of it.
    Replied,
}

/// An interrupt that lets no other in, and ns until it is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interrupt {
    Receive { left: u64, ended: Instant, byte: u8 },
    Feed { left: u64, byte: u8 },
    Return { left: u64 },
}

/// A reply that the main loop works on.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Reply {
    /// Until its next byte is put into the ring, ns.
    left: u64,
    bytes: VecDeque<u8>,
}

/// The processor.
#[derive(Clone, Debug)]
pub(super) struct Cpu {
    at: u64,
    next_tick: u64,
    /// Bytes that the receive interrupt has not seen, with their ends.
    incoming: VecDeque<(Instant, u8)>,
    interrupt: Option<Interrupt>,
    /// Work left in tick interrupts.
    tick_left: u64,
    /// Work left until the divider counts.
    count_left: Option<u64>,
    /// The main loop does not run before.
    main_from: u64,
    /// Whether the main loop's next step is the load.
    to_load: bool,
    /// Work left until that step.
    main_left: u64,
    reply: Option<Reply>,
    ring: VecDeque<u8>,
    /// The line's register is free from here on.
    line_free: u64,
}

/// The task that has the processor, and until when, unless an interrupt comes in between.
enum Slice {
    Interrupt(u64),
    Tick(u64),
    Reply(u64),
    Main(u64),
    /// The main loop waits: for its start, or for room in the ring.
    Idle,
}

impl Cpu {
    /// A processor whose main loop begins at `main_from`.
    pub(super) fn new(now: Instant, ticks: Ticks, main_from: Instant) -> Self {
        Self {
            at: now.as_nanos(),
            next_tick: ticks.after(now, TICK, 1).as_nanos(),
            incoming: VecDeque::new(),
            interrupt: None,
            tick_left: 0,
            count_left: None,
            main_from: main_from.as_nanos(),
            to_load: true,
            main_left: PASS,
            reply: None,
            ring: VecDeque::new(),
            line_free: 0,
        }
    }

    /// Time up to which the processor has run.
    pub(super) const fn now(&self) -> Instant {
        Instant::from_nanos(self.at)
    }

    /// A byte that ended at `ended`.
    pub(super) fn receive(&mut self, ended: Instant, byte: u8) {
        self.incoming.push_back((ended, byte));
    }

    /// Sets the duration of the tick interrupt that has just begun, and whether the divider counts
    /// in it.
    pub(super) fn begin_tick(&mut self, work: Duration, counts: bool) {
        self.tick_left += nanos(work);
        if counts {
            self.count_left = Some(TICK_TO_COUNT);
        }
    }

    /// The main loop answers: `work` until the first byte, then byte after byte.
    pub(super) fn reply(&mut self, work: Duration, bytes: &[u8]) {
        self.reply = Some(Reply {
            left: nanos(work),
            bytes: bytes.iter().copied().collect(),
        });
    }

    /// Whether bytes of a reply are not on the line yet.
    pub(super) fn is_replying(&self) -> bool {
        self.reply.is_some() || !self.ring.is_empty()
    }

    /// Whether the processor handles bytes or replies.
    pub(super) fn is_busy(&self) -> bool {
        self.is_replying() || !self.incoming.is_empty() || self.interrupt.is_some()
    }

    /// No step comes before.
    pub(super) fn next_change(&self) -> Instant {
        let left = match self.slice() {
            // Bytes and ticks wait for the interrupt's end.
            Slice::Interrupt(left) => return Instant::from_nanos(self.at + left),
            Slice::Tick(left) | Slice::Reply(left) => left,
            // A step without a look.
            Slice::Main(0) => PASS,
            Slice::Main(left) => left,
            Slice::Idle => u64::MAX,
        };
        Instant::from_nanos(self.at.saturating_add(left).min(self.next_entry()))
    }

    /// The next step up to `limit`, and its time. Unless `attentive`, passes of the main loop
    /// are no steps.
    pub(super) fn advance(&mut self, limit: Instant, attentive: bool) -> Option<(Instant, Step)> {
        let limit = limit.as_nanos();
        loop {
            if self.enter() {
                return Some((self.now(), Step::Tick));
            }
            let slice = self.slice();
            if let Some(step) = self.finish(&slice, attentive) {
                return Some((self.now(), step));
            }
            if matches!(slice, Slice::Interrupt(0) | Slice::Reply(0)) {
                continue;
            }
            if self.at >= limit {
                return None;
            }
            let end = match slice {
                Slice::Interrupt(left) => self.at + left,
                Slice::Tick(left) | Slice::Reply(left) => (self.at + left).min(self.next_entry()),
                Slice::Main(left) if attentive => (self.at + left).min(self.next_entry()),
                Slice::Main(_) | Slice::Idle => self.next_entry(),
            };
            self.spend(&slice, end.min(limit).saturating_sub(self.at));
        }
    }

    /// Time of the next interrupt, at least now.
    fn next_entry(&self) -> u64 {
        let byte = self.incoming.front().map(|(ended, _)| ended.as_nanos());
        let line = (!self.ring.is_empty()).then_some(self.line_free);
        let main = (self.main_from > self.at).then_some(self.main_from);
        let next = [byte, line, main].into_iter().flatten().min();
        next.map_or(self.next_tick, |next| next.min(self.next_tick))
            .max(self.at)
    }

    /// Starts a due interrupt; `true` if it is a tick.
    fn enter(&mut self) -> bool {
        if self.interrupt.is_some() {
            return false;
        }
        if self.at >= self.next_tick {
            self.next_tick += nanos(TICK);
            return true;
        }
        let now = self.now();
        if let Some(&(ended, byte)) = self.incoming.front().filter(|(ended, _)| *ended <= now) {
            self.incoming.pop_front();
            let left = RECEIVE;
            self.interrupt = Some(Interrupt::Receive { left, ended, byte });
        } else if self.line_free <= self.at
            && let Some(byte) = self.ring.pop_front()
        {
            let left = TRANSMIT[0];
            self.interrupt = Some(Interrupt::Feed { left, byte });
        }
        false
    }

    fn slice(&self) -> Slice {
        match (&self.interrupt, &self.reply) {
            (
                Some(
                    Interrupt::Receive { left, .. }
                    | Interrupt::Feed { left, .. }
                    | Interrupt::Return { left },
                ),
                _,
            ) => Slice::Interrupt(*left),
            _ if self.tick_left > 0 => {
                let count = self.count_left.unwrap_or(self.tick_left);
                Slice::Tick(count.min(self.tick_left))
            }
            _ if self.at < self.main_from => Slice::Idle,
            (_, Some(reply)) if reply.left == 0 && self.is_blocked(reply) => Slice::Idle,
            (_, Some(reply)) => Slice::Reply(reply.left),
            (_, None) => Slice::Main(self.main_left),
        }
    }

    /// Whether the reply's next byte waits for room in the ring.
    fn is_blocked(&self, reply: &Reply) -> bool {
        self.ring.len() >= RING && !reply.bytes.is_empty()
    }

    /// Ends a slice that has no work left.
    fn finish(&mut self, slice: &Slice, attentive: bool) -> Option<Step> {
        match slice {
            Slice::Interrupt(0) => match self.interrupt.take()? {
                Interrupt::Receive { ended, byte, .. } => Some(Step::Received { ended, byte }),
                Interrupt::Feed { byte, .. } => {
                    // The register is free while the byte before is still on the line.
                    self.line_free = self.at + BYTE - TRANSMIT[0];
                    let left = TRANSMIT[1];
                    self.interrupt = Some(Interrupt::Return { left });
                    Some(Step::Sent(byte))
                }
                Interrupt::Return { .. } => None,
            },
            Slice::Tick(0) => {
                self.count_left = None;
                Some(Step::Count)
            }
            Slice::Reply(0) => self.put(),
            Slice::Main(0) if attentive => {
                let step = if self.to_load { Step::Load } else { Step::Test };
                self.main_left = if self.to_load {
                    LOAD_TO_TEST
                } else {
                    PASS - LOAD_TO_TEST
                };
                self.to_load = !self.to_load;
                Some(step)
            }
            _ => None,
        }
    }

    /// The next byte of the reply goes into the ring.
    fn put(&mut self) -> Option<Step> {
        let reply = self.reply.as_mut()?;
        let Some(byte) = reply.bytes.pop_front() else {
            self.reply = None;
            return Some(Step::Replied);
        };
        // Behind the last byte the receiver works again at once.
        reply.left = if reply.bytes.is_empty() { 0 } else { PUT };
        self.ring.push_back(byte);
        None
    }

    fn spend(&mut self, slice: &Slice, time: u64) {
        self.at += time;
        match slice {
            Slice::Interrupt(_) => match &mut self.interrupt {
                Some(
                    Interrupt::Receive { left, .. }
                    | Interrupt::Feed { left, .. }
                    | Interrupt::Return { left },
                ) => *left -= time,
                None => {}
            },
            Slice::Tick(_) => {
                self.tick_left -= time;
                self.count_left = self.count_left.map(|left| left - time);
            }
            Slice::Reply(_) => {
                if let Some(reply) = &mut self.reply {
                    reply.left -= time;
                }
            }
            Slice::Main(_) => self.go_round(time),
            Slice::Idle => {}
        }
    }

    /// The main loop runs for `time`, past as many steps as that takes.
    fn go_round(&mut self, time: u64) {
        if time <= self.main_left {
            self.main_left -= time;
            return;
        }
        let step = if self.to_load { PASS } else { LOAD_TO_TEST };
        let place = (step - self.main_left + time) % PASS;
        (self.to_load, self.main_left) = match place {
            0 => (true, 0),
            _ if place < LOAD_TO_TEST => (false, LOAD_TO_TEST - place),
            _ => (true, PASS - place),
        };
    }
}

const fn nanos(duration: Duration) -> u64 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "at most a few seconds, 2^64 ns are 584 years"
    )]
    let nanos = duration.as_nanos() as u64;
    nanos
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    /// A processor that has just started; its first tick comes after 1.004 ms.
    fn cpu(main_from: u64) -> Cpu {
        Cpu::new(at(0), Ticks::started_at(at(0)), at(main_from))
    }

    /// All steps up to `limit` ns.
    fn steps(cpu: &mut Cpu, limit: u64, attentive: bool) -> Vec<(u64, Step)> {
        let next = || {
            let (now, step) = cpu.advance(at(limit), attentive)?;
            Some((now.as_nanos(), step))
        };
        core::iter::from_fn(next).collect()
    }

    fn received(ended: u64, byte: u8) -> Step {
        let ended = at(ended);
        Step::Received { ended, byte }
    }

    /// A pass takes 24.6 us, and the test comes 0.8 us after the load. Without observed steps, the
    /// main loop takes the same time.
    #[test]
    fn the_main_loop_loads_and_tests() {
        for main_from in [0, 10_000] {
            let mut seen = cpu(main_from);
            let first = if main_from == 0 { 24_600 } else { main_from };
            assert_eq!(seen.next_change(), at(first));
            let expected = [
                (24_600, Step::Load),
                (25_400, Step::Test),
                (49_200, Step::Load),
                (50_000, Step::Test),
            ];
            let expected = expected.map(|(after, step)| (main_from + after, step));
            assert_eq!(steps(&mut seen, main_from + 50_000, true), expected);
            let mut unseen = cpu(main_from);
            assert_eq!(steps(&mut unseen, main_from + 50_000, false), []);
            assert_eq!(unseen.now(), at(main_from + 50_000));
            assert_eq!((unseen.to_load, unseen.main_left), (true, 23_800));
        }
    }

    /// From 24.6 us before a load: up to the load, 0.4 us after it, to the test, after the test,
    /// and two passes.
    #[test]
    fn the_main_loop_goes_round_without_steps() {
        let after = |times: &[u64]| {
            let mut cpu = cpu(0);
            times.iter().for_each(|time| cpu.go_round(*time));
            (cpu.to_load, cpu.main_left)
        };
        assert_eq!(after(&[24_600]), (true, 0));
        assert_eq!(after(&[25_000]), (false, 400));
        assert_eq!(after(&[25_000, 400]), (false, 0));
        assert_eq!(after(&[25_000, 401]), (true, 23_799));
        assert_eq!(after(&[25_400]), (true, 23_800));
        assert_eq!(after(&[49_200]), (true, 0));
        assert_eq!(after(&[10_000, 40_000]), (true, 23_800));
        let mut cpu = cpu(0);
        cpu.go_round(24_600);
        assert_eq!(cpu.next_change(), at(24_600));
    }

    /// 6.4 us each, one directly after the other.
    #[test]
    fn a_byte_is_received_when_its_interrupt_is_over() {
        let mut cpu = cpu(0);
        assert!(!cpu.is_busy());
        cpu.receive(at(1_000), 7);
        cpu.receive(at(2_000), 8);
        assert!(cpu.is_busy());
        assert_eq!(cpu.next_change(), at(1_000));
        assert_eq!(steps(&mut cpu, 3_000, false), []);
        assert_eq!((cpu.now(), cpu.next_change()), (at(3_000), at(7_400)));
        let expected = [(7_400, received(1_000, 7)), (13_800, received(2_000, 8))];
        assert_eq!(steps(&mut cpu, 30_000, false), expected);
        assert!(!cpu.is_busy());
        // The main loop was held up by both.
        assert_eq!((cpu.to_load, cpu.main_left), (true, 7_400));
    }

    /// The first byte is in the ring after 5 us of work and on the line 3 us later. The next bytes
    /// follow every 10 us. The last one is in the ring after 1.8 us more of work.
    #[test]
    fn a_reply_goes_out_at_the_pace_of_the_line() {
        let mut cpu = cpu(0);
        cpu.reply(Duration::from_micros(5), &[1, 2, 3]);
        assert!(cpu.is_replying());
        let expected = [
            (8_000, Step::Sent(1)),
            (18_000, Step::Sent(2)),
            (21_800, Step::Replied),
            (28_000, Step::Sent(3)),
        ];
        assert_eq!(steps(&mut cpu, 40_000, false), expected);
        assert!(!cpu.is_replying());
    }

    /// 31 bytes are in the ring: one more waits, but not the end of a reply.
    #[test]
    fn a_reply_waits_for_room_in_the_ring() {
        let slice = |waiting: usize, bytes: &[u8]| {
            let mut cpu = cpu(0);
            cpu.ring = vec![0; waiting].into();
            cpu.reply(Duration::ZERO, bytes);
            matches!(cpu.slice(), Slice::Idle)
        };
        assert!(slice(31, &[1]) && slice(32, &[1]));
        assert!(!slice(30, &[1]) && !slice(31, &[]));
    }

    /// A tick takes 0.1 ms, and counts 66 us behind its beginning; a byte that comes meanwhile is
    /// received at once, and the count is late by that.
    #[test]
    fn a_tick_lets_bytes_in_and_holds_the_main_loop_up() {
        let mut cpu = cpu(0);
        let tick = cpu.advance(at(1_300_000), false);
        assert_eq!(tick, Some((at(1_004_000), Step::Tick)));
        cpu.begin_tick(Duration::from_micros(100), true);
        assert_eq!(cpu.next_change(), at(1_070_000));
        cpu.receive(at(1_010_000), 9);
        let expected = [
            (1_016_400, received(1_010_000, 9)),
            (1_076_400, Step::Count),
        ];
        assert_eq!(steps(&mut cpu, 1_300_000, false), expected);
        // 1300 - 100 - 6.4 us are 48 passes and 12.8 us.
        assert_eq!((cpu.to_load, cpu.main_left), (true, 11_800));
        let tick = cpu.advance(at(2_100_000), false);
        assert_eq!(tick, Some((at(2_008_000), Step::Tick)));
    }
}
