//! Time of the processor: a main loop that interrupts delay.
//!
//! ```text
//! receive and transmit interrupt    not interrupted themselves; receive comes first
//!   tick interrupt                  lets those two in; a late tick runs on top of the last one
//!     main loop                     load state, test it -> answer, or give a fragment up -> rest
//! ```
//!
//! Three positions decide when an answer comes, which byte is lost and which fragment is discarded:
//! those of main loop, tick interrupt and byte interrupts. Figures: cycles of field firmware
//! b77a6df in a simulated ATmega2560 at 16 MHz, counted without interrupts.
//!
//! This module knows only durations. Its owner takes one [`Step`] after the other from
//! [`Cpu::advance`] and executes it.

use std::collections::VecDeque;

use core::time::Duration;

use protocols::Instant;

use super::ticks::{TICK, Ticks};

/// Duration of the receive interrupt until its byte counts, and after that: 65 and 36 cycles.
const RECEIVE: [u64; 2] = [4_062, 2_250];
/// Duration of the transmit interrupt until its byte is in the line's register, and after that: 41
/// and 24 cycles. On a busy line the next byte begins when the line asks for it: each 10.0 us.
const TRANSMIT: [u64; 2] = [2_562, 1_500];
/// Duration of the transmit interrupt that finds an empty ring: 56 cycles.
const TRANSMIT_NOTHING: u64 = 3_500;
/// The line takes this long for a byte.
const BYTE: u64 = 10_000;
/// One pass of the main loop without work: 394 cycles.
const PASS: u64 = 24_625;
/// From the load of the receiver's state to the test of its time-out. Derived: a frame of 5 bytes
/// vanishes with a chance of 5e-5, see the field-bug catalogue, AV-21.
const LOAD_TO_TEST: u64 = 800;
/// Bytes that the ring in front of the line holds; with more to send the main loop waits.
const RING: usize = 31;
/// From the last byte of a reply in the ring to a receiver that listens again: 23 cycles.
const PUT_TO_READY: u64 = 1_437;
/// The tick interrupt lets no other in for this long: 128 cycles.
const TICK_ENTRY: u64 = 8_000;
/// The count of the divider falls this long after its tick interrupt has begun: 1,439 cycles.
const TICK_TO_COUNT: u64 = 89_900;

/// The next event of the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// The receive interrupt has taken `byte`, which ended at `ended`; see [`Cpu::work_on_byte`].
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
    /// Bytes, each with the work before it.
    bytes: VecDeque<(u64, u8)>,
}

/// The bytes of the reply `frame`, each with the work in ns before the main loop puts it into the
/// ring; `work` is that before the first one. The sum is computed behind the data.
fn puts(work: u64, frame: &[u8]) -> VecDeque<(u64, u8)> {
    let data = frame.len().saturating_sub(5) as u64;
    let has_data = frame.get(2).is_some_and(|control| control & 0x80 != 0);
    let first_sum = frame.len().saturating_sub(2);
    let cycles = |index: usize| match index {
        0 => 0,
        _ if index > first_sum => 32,
        _ if index == first_sum && data > 0 => 92 + 18 * data,
        _ if index == first_sum && has_data => 96,
        _ if index == first_sum => 78,
        1 | 2 => 32,
        3 => 55,
        _ => 51,
    };
    let bytes = frame.iter().enumerate();
    let bytes = bytes.map(|(index, byte)| (cycles(index) * 125 / 2, *byte));
    let mut bytes: VecDeque<_> = bytes.collect();
    if let Some((before, _)) = bytes.front_mut() {
        *before = work;
    }
    bytes
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
    /// Time before which the main loop does not run.
    main_from: u64,
    /// Whether the main loop's next step is the load.
    to_load: bool,
    /// Work left until that step.
    main_left: u64,
    reply: Option<Reply>,
    ring: VecDeque<u8>,
    /// Whether the transmit interrupt is on: bytes were put since it found the ring empty.
    feeds: bool,
    /// Time at which the line requests its next byte.
    asks_at: u64,
    /// Whether the line has asked in vain, and its next byte begins at any time.
    is_idle: bool,
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
            feeds: false,
            asks_at: 0,
            is_idle: true,
        }
    }

    /// Time up to which the processor has run.
    pub(super) const fn now(&self) -> Instant {
        Instant::from_nanos(self.at)
    }

    /// Takes a byte that ended at `ended`.
    pub(super) fn receive(&mut self, ended: Instant, byte: u8) {
        self.incoming.push_back((ended, byte));
    }

    /// Sets the duration of the tick interrupt that has just begun, and whether the divider counts
    /// in it.
    pub(super) fn begin_tick(&mut self, work: Duration, counts: bool) {
        self.interrupt = Some(Interrupt::Return { left: TICK_ENTRY });
        self.tick_left += nanos(work).saturating_sub(TICK_ENTRY);
        if counts {
            self.count_left = Some(TICK_TO_COUNT - TICK_ENTRY);
        }
    }

    /// The receive interrupt takes `work` longer, because of the byte that it has taken.
    pub(super) fn work_on_byte(&mut self, work: Duration) {
        if let Some(Interrupt::Return { left }) = &mut self.interrupt {
            *left += nanos(work);
        }
    }

    /// Starts an answer of the main loop: `work` until the first byte, then byte after byte.
    pub(super) fn reply(&mut self, work: Duration, bytes: &[u8]) {
        let bytes = puts(nanos(work), bytes);
        let left = bytes.front().map_or(0, |(before, _)| *before);
        self.reply = Some(Reply { left, bytes });
    }

    /// Whether bytes of a reply are not on the line yet.
    pub(super) fn is_replying(&self) -> bool {
        self.reply.is_some() || !self.ring.is_empty()
    }

    /// Whether the processor handles bytes or replies.
    pub(super) fn is_busy(&self) -> bool {
        self.is_replying() || !self.incoming.is_empty() || self.interrupt.is_some()
    }

    /// Time before which no step comes.
    pub(super) fn next_change(&self) -> Instant {
        let left = match self.slice() {
            // Bytes and ticks wait for the interrupt's end.
            Slice::Interrupt(left) => return Instant::from_nanos(self.at + left),
            Slice::Tick(left) | Slice::Reply(left) => left,
            // The next step may be skipped.
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
        let line = self.feeds.then_some(self.asks_at);
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
            let left = RECEIVE[0];
            self.interrupt = Some(Interrupt::Receive { left, ended, byte });
        } else if self.feeds && self.asks_at <= self.at {
            let byte = self.ring.pop_front();
            self.feeds = byte.is_some();
            self.asks_at += ((self.at - self.asks_at) / BYTE + 1) * BYTE;
            self.interrupt = Some(match byte {
                Some(byte) if self.is_idle => Interrupt::Feed {
                    left: TRANSMIT[0],
                    byte,
                },
                Some(byte) => Interrupt::Feed { left: 0, byte },
                None => Interrupt::Return {
                    left: TRANSMIT_NOTHING,
                },
            });
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
                Interrupt::Receive { ended, byte, .. } => {
                    let left = RECEIVE[1];
                    self.interrupt = Some(Interrupt::Return { left });
                    Some(Step::Received { ended, byte })
                }
                Interrupt::Feed { byte, .. } => {
                    let mut left = TRANSMIT[0] + TRANSMIT[1];
                    if core::mem::take(&mut self.is_idle) {
                        self.asks_at = self.at + BYTE;
                        left = TRANSMIT[1];
                    }
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

    /// Puts the next byte of the reply into the ring.
    fn put(&mut self) -> Option<Step> {
        let reply = self.reply.as_mut()?;
        let Some((_, byte)) = reply.bytes.pop_front() else {
            self.reply = None;
            return Some(Step::Replied);
        };
        reply.left = reply
            .bytes
            .front()
            .map_or(PUT_TO_READY, |(before, _)| *before);
        self.ring.push_back(byte);
        if !self.feeds {
            self.feeds = true;
            self.is_idle |= self.asks_at <= self.at;
            self.asks_at = self.asks_at.max(self.at);
        }
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

    /// Runs the main loop for `time`, past as many steps as that takes.
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

    /// A pass of the main loop takes 24.625 us, and the test comes 0.8 us after the load. Without
    /// observed steps, the main loop takes the same time.
    #[test]
    fn the_main_loop_loads_and_tests() {
        for main_from in [0, 10_000] {
            let mut seen = cpu(main_from);
            let first = if main_from == 0 { 24_625 } else { main_from };
            assert_eq!(seen.next_change(), at(first));
            let expected = [
                (24_625, Step::Load),
                (25_425, Step::Test),
                (49_250, Step::Load),
                (50_050, Step::Test),
            ];
            let expected = expected.map(|(after, step)| (main_from + after, step));
            assert_eq!(steps(&mut seen, main_from + 50_050, true), expected);
            let mut unseen = cpu(main_from);
            assert_eq!(steps(&mut unseen, main_from + 50_050, false), []);
            assert_eq!(unseen.now(), at(main_from + 50_050));
            assert_eq!((unseen.to_load, unseen.main_left), (true, 23_825));
        }
    }

    /// The main loop starts 24.625 us before a load. Its state is checked at the load, 0.4 us after
    /// it, at the test, after the test, and after two passes.
    #[test]
    fn the_main_loop_goes_round_without_steps() {
        let after = |times: &[u64]| {
            let mut cpu = cpu(0);
            times.iter().for_each(|time| cpu.go_round(*time));
            (cpu.to_load, cpu.main_left)
        };
        assert_eq!(after(&[24_625]), (true, 0));
        assert_eq!(after(&[25_025]), (false, 400));
        assert_eq!(after(&[25_025, 400]), (false, 0));
        assert_eq!(after(&[25_025, 401]), (true, 23_824));
        assert_eq!(after(&[25_425]), (true, 23_825));
        assert_eq!(after(&[49_250]), (true, 0));
        assert_eq!(after(&[10_000, 40_050]), (true, 23_825));
        let mut cpu = cpu(0);
        cpu.go_round(24_625);
        assert_eq!(cpu.next_change(), at(24_625));
    }

    /// Each byte counts after 4.1 us; the interrupt then takes 2.3 us more, plus the work for the
    /// byte.
    #[test]
    fn a_byte_counts_before_its_interrupt_is_over() {
        let mut cpu = cpu(0);
        assert!(!cpu.is_busy());
        cpu.receive(at(1_000), 7);
        cpu.receive(at(2_000), 8);
        assert!(cpu.is_busy());
        assert_eq!(cpu.next_change(), at(1_000));
        assert_eq!(steps(&mut cpu, 3_000, false), []);
        assert_eq!((cpu.now(), cpu.next_change()), (at(3_000), at(5_062)));
        let (now, first) = cpu.advance(at(30_000), false).expect("the first byte");
        assert_eq!((now, first), (at(5_062), received(1_000, 7)));
        cpu.work_on_byte(Duration::from_nanos(700));
        let expected = [(5_062 + 2_250 + 700 + 4_062, received(2_000, 8))];
        assert_eq!(steps(&mut cpu, 30_000, false), expected);
        assert!(!cpu.is_busy());
        // The main loop was held up by both: for 13.324 us.
        assert_eq!(
            (cpu.to_load, cpu.main_left),
            (true, 24_625 - (30_000 - 13_324))
        );
    }

    /// The first byte is in the ring after 5 us of work and on the line 2.6 us later. The next
    /// bytes follow every 10 us. The last byte, the checksum, is in the ring 1.5 + 2.0 + 4.9 us
    /// after the first byte went out, and the receiver listens 1.4 us later.
    #[test]
    fn a_reply_goes_out_at_the_pace_of_the_line() {
        let mut cpu = cpu(0);
        cpu.reply(Duration::from_micros(5), &[1, 2, 3]);
        assert!(cpu.is_replying());
        let replied = 7_562 + 1_500 + 2_000 + 4_875 + 1_437;
        let expected = [
            (7_562, Step::Sent(1)),
            (replied, Step::Replied),
            (17_562, Step::Sent(2)),
            (27_562, Step::Sent(3)),
        ];
        assert_eq!(steps(&mut cpu, 40_000, false), expected);
        assert!(!cpu.is_replying());
    }

    /// Cycles of the chip's main loop between two bytes of a reply: a read of two bytes, one of
    /// none, and an acknowledgement. 16 cycles are a microsecond.
    #[test]
    fn the_sum_of_a_reply_takes_longer_with_its_data() {
        let cycles = |frame: &[u8]| {
            let puts = puts(0, frame).into_iter().skip(1);
            puts.map(|(before, _)| before * 16 / 1_000)
                .collect::<Vec<_>>()
        };
        assert_eq!(
            cycles(&[0xAB, 10, 0x82, 0, 0, 1, 2]),
            [32, 32, 54, 50, 128, 32]
        );
        assert_eq!(cycles(&[0xAB, 10, 0x80, 1, 2]), [32, 32, 96, 32]);
        assert_eq!(cycles(&[0xAB, 10, 0, 1, 2]), [32, 32, 78, 32]);
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

    /// A tick takes 0.1 ms. It lets no byte in for its first 8 us, and counts 89.9 us after its
    /// beginning. A byte that comes in between is received before the count, which is late by the
    /// time for that byte.
    #[test]
    fn a_tick_lets_bytes_in_and_holds_the_main_loop_up() {
        let mut cpu = cpu(0);
        let tick = cpu.advance(at(1_300_000), false);
        assert_eq!(tick, Some((at(1_004_000), Step::Tick)));
        cpu.begin_tick(Duration::from_micros(100), true);
        assert_eq!(cpu.next_change(), at(1_012_000));
        cpu.receive(at(1_005_000), 9);
        let expected = [
            (1_016_062, received(1_005_000, 9)),
            (1_093_900 + 6_312, Step::Count),
        ];
        assert_eq!(steps(&mut cpu, 1_300_000, false), expected);
        // Less the tick and the byte, 1300 - 100 - 6.312 us are 48 passes and 11.688 us.
        assert_eq!((cpu.to_load, cpu.main_left), (true, 24_625 - 11_688));
        let tick = cpu.advance(at(2_100_000), false);
        assert_eq!(tick, Some((at(2_008_000), Step::Tick)));
    }

    /// The line asks each 10 us, and not again for what the processor came late to: 25 us late it
    /// has asked at 10, 20 and 30 us. A byte for an idle line takes 41 cycles more, and an empty
    /// ring 56.
    #[test]
    fn the_line_asks_again_at_its_own_pace() {
        let entered = |at: u64, is_idle: bool, ring: &[u8]| {
            let mut cpu = cpu(0);
            (cpu.at, cpu.asks_at) = (at, 10_000);
            (cpu.feeds, cpu.is_idle) = (true, is_idle);
            cpu.ring = ring.to_vec().into();
            assert!(!cpu.enter());
            (cpu.asks_at, cpu.interrupt, cpu.feeds)
        };
        assert_eq!(entered(9_999, false, &[7]), (10_000, None, true));
        let feed = |left| Some(Interrupt::Feed { left, byte: 7 });
        for (at, next) in [
            (10_000, 20_000),
            (19_999, 20_000),
            (20_000, 30_000),
            (35_000, 40_000),
        ] {
            assert_eq!(entered(at, false, &[7, 8]), (next, feed(0), true));
            assert_eq!(entered(at, true, &[7]), (next, feed(2_562), true));
        }
        let nothing = Some(Interrupt::Return { left: 3_500 });
        assert_eq!(entered(10_000, true, &[]), (20_000, nothing, false));
    }
}
