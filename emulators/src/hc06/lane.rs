//! One direction through the module and over the air.
//!
//! ```text
//! push -> queue --a byte per step--> open burst -> on the air --at its slot--> ready -> take
//!         bounded                    one frame     in order, one frame a slot
//! ```
//!
//! The module's processor is the bottleneck: it moves a byte every 48.8 us. Frames arrive on the
//! grid of the radio's slots, later after a pause than in a flow.

use std::collections::VecDeque;

use core::time::Duration;

use protocols::Instant;

use super::Profile;
use crate::device::{next_multiple, take};
use crate::rng::Rng;

/// Later than any event: the value is compared for each byte, and comparing plain times is quick.
pub(super) const NEVER: Instant = Instant::from_nanos(u64::MAX);

/// Bytes that travel as one radio frame.
#[derive(Clone, Debug)]
struct Burst {
    bytes: Vec<u8>,
    due: Instant,
}

/// Traffic of one direction since the module was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Bytes that went into the queue.
    pub accepted: u64,
    /// Bytes that found the queue full.
    pub lost: u64,
    /// Bytes thrown away when a connection ended.
    pub dropped: u64,
    /// Bytes that came out at the other end.
    pub delivered: u64,
}

/// One direction.
#[derive(Clone, Debug)]
pub(super) struct Lane {
    queue: VecDeque<u8>,
    queue_len: usize,
    window: usize,
    frame_max: usize,
    slot: Duration,
    latency_idle: [Duration; 2],
    latency_busy: [Duration; 2],
    idle_after: Duration,
    /// Time at which the front byte of the queue has been moved.
    moves_at: Instant,
    open: Option<Burst>,
    air: VecDeque<Burst>,
    /// Bytes in `open` and `air`.
    under_way: usize,
    ready: VecDeque<u8>,
    last_due: Option<Instant>,
    rng: Rng,
    traffic: Traffic,
}

impl Lane {
    pub(super) fn new(profile: &Profile, queue_len: usize, rng: Rng) -> Self {
        Self {
            queue: VecDeque::new(),
            queue_len,
            window: profile.window.max(1),
            frame_max: profile.frame_max.max(1),
            slot: profile.slot,
            latency_idle: profile.latency_idle,
            latency_busy: profile.latency_busy,
            idle_after: profile.idle_after,
            moves_at: Instant::ZERO,
            open: None,
            air: VecDeque::new(),
            under_way: 0,
            ready: VecDeque::new(),
            last_due: None,
            rng,
            traffic: Traffic::default(),
        }
    }

    pub(super) const fn traffic(&self) -> Traffic {
        self.traffic
    }

    /// Bytes the queue still takes.
    pub(super) fn room(&self) -> usize {
        self.queue_len - self.queue.len()
    }

    /// Puts bytes into the queue, all at `at`, until it is full; returns how many fitted. `step` is
    /// the time to move a byte now.
    pub(super) fn push(&mut self, bytes: &[u8], at: Instant, step: Duration) -> usize {
        let taken = bytes.len().min(self.room());
        if self.queue.is_empty() {
            self.moves_at = at + step;
        }
        self.queue.extend(&bytes[..taken]);
        self.traffic.accepted += taken as u64;
        self.traffic.lost += (bytes.len() - taken) as u64;
        taken
    }

    /// Appends bytes to the output at the other end, without going over the air.
    pub(super) fn put_ready(&mut self, bytes: &[u8]) {
        self.ready.extend(bytes);
        self.traffic.delivered += bytes.len() as u64;
    }

    /// Takes bytes that arrived.
    pub(super) fn take(&mut self, buf: &mut [u8]) -> usize {
        take(&mut self.ready, buf)
    }

    /// Whether nothing waits to be taken.
    pub(super) fn is_drained(&self) -> bool {
        self.ready.is_empty()
    }

    /// Whether a byte is being moved.
    pub(super) fn is_moving(&self) -> bool {
        !self.queue.is_empty() && !self.is_stopped()
    }

    /// Whether bytes wait for the other end to take some.
    pub(super) fn is_waiting(&self) -> bool {
        !self.queue.is_empty() && self.is_stopped()
    }

    /// Whether too many bytes are under way for further bytes to be moved.
    fn is_stopped(&self) -> bool {
        self.under_way + self.ready.len() >= self.window
    }

    /// Time at which the next byte has been moved, or [`NEVER`].
    pub(super) fn moves_at(&self) -> Instant {
        if self.is_moving() {
            self.moves_at
        } else {
            NEVER
        }
    }

    /// Arrival of the next frame, or [`NEVER`].
    pub(super) fn due(&self) -> Instant {
        let next = self.air.front().or(self.open.as_ref());
        next.map_or(NEVER, |burst| burst.due)
    }

    /// Hands over the next frame.
    pub(super) fn deliver(&mut self) {
        if let Some(burst) = self.air.pop_front().or_else(|| self.open.take()) {
            self.under_way -= burst.bytes.len();
            self.put_ready(&burst.bytes);
        }
    }

    /// Moves the front byte, and those after it that follow every `step` until `until`, as far as
    /// they fit the same frame.
    pub(super) fn shift(&mut self, not_before: Instant, until: Instant, step: Duration) {
        let at = self.moves_at.max(not_before);
        let leaves = |burst: &Burst| at + self.slot >= burst.due;
        if self.open.as_ref().is_some_and(leaves) {
            self.air.extend(self.open.take());
        }
        let mut burst = self.open.take().unwrap_or_else(|| self.new_burst(at));
        // The frame leaves one slot before it arrives; later bytes need another frame.
        let leaves_at = Instant::ZERO + (burst.due - (Instant::ZERO + self.slot));
        let until = until.min(leaves_at);
        let steps = nanos(until - at) / nanos(step).max(1);
        let count = usize::try_from(steps)
            .unwrap_or(usize::MAX)
            .saturating_add(1)
            .min(self.queue.len())
            .min(self.frame_max - burst.bytes.len())
            .min(self.window - self.under_way - self.ready.len());
        let held = burst.bytes.len();
        burst.bytes.resize(held + count, 0);
        take(&mut self.queue, &mut burst.bytes[held..]);
        self.under_way += count;
        self.moves_at = at + step * u32::try_from(count).unwrap_or(u32::MAX);
        if burst.bytes.len() == self.frame_max {
            self.air.push_back(burst);
        } else {
            self.open = Some(burst);
        }
    }

    /// A frame whose first byte is moved at `at`. One draw, whatever the latency.
    fn new_burst(&mut self, at: Instant) -> Burst {
        let idle = self.air.is_empty()
            && self
                .last_due
                .is_none_or(|last_due| last_due + self.idle_after <= at);
        let [least, greatest] = if idle {
            self.latency_idle
        } else {
            self.latency_busy
        };
        // Rounding up to the grid adds up to a slot.
        let span = greatest.saturating_sub(least).saturating_sub(self.slot);
        let span = u64::try_from(span.as_nanos()).unwrap_or(u64::MAX);
        let drawn = Duration::from_nanos(self.rng.below(span.max(1)));
        let due = next_multiple(at + least + drawn, self.slot);
        let due = self.last_due.map_or(due, |last| due.max(last + self.slot));
        self.last_due = Some(due);
        Burst {
            bytes: Vec::with_capacity(self.frame_max),
            due,
        }
    }

    /// Continues at `now` after frames were held up: they arrive from now on, one a slot.
    pub(super) fn resume(&mut self, now: Instant) {
        self.moves_at = self.moves_at.max(now);
        let mut earliest = next_multiple(now, self.slot);
        for burst in self.air.iter_mut().chain(&mut self.open) {
            burst.due = burst.due.max(earliest);
            earliest = burst.due + self.slot;
            self.last_due = self.last_due.max(Some(burst.due));
        }
    }

    /// Discards bytes that have not arrived.
    pub(super) fn drop_under_way(&mut self) {
        self.traffic.dropped += (self.queue.len() + self.under_way) as u64;
        self.queue.clear();
        self.open = None;
        self.air.clear();
        self.under_way = 0;
    }

    /// Discards bytes that arrived and were not taken.
    pub(super) fn drop_ready(&mut self) {
        self.traffic.dropped += self.ready.len() as u64;
        self.traffic.delivered -= self.ready.len() as u64;
        self.ready.clear();
    }
}

/// A span shorter than 584 years.
fn nanos(span: Duration) -> u64 {
    u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Microseconds.
    const fn us(micros: u64) -> Duration {
        Duration::from_micros(micros)
    }

    fn at(micros: u64) -> Instant {
        Instant::from_micros(micros)
    }

    const STEP: Duration = Duration::from_millis(1);

    /// Frames of four bytes on slots of 1.25 ms, 10 ms on the air after a pause of 50 ms and 5 ms
    /// otherwise, at most eight bytes under way, twelve in the queue.
    fn lane() -> Lane {
        let profile = Profile {
            frame_max: 4,
            slot: us(1_250),
            latency_idle: [us(10_000); 2],
            latency_busy: [us(5_000); 2],
            idle_after: us(50_000),
            window: 8,
            ..Profile::default()
        };
        Lane::new(&profile, 12, Rng::stream(1, "lane"))
    }

    /// Takes everything that has arrived.
    fn taken(lane: &mut Lane) -> Vec<u8> {
        let mut buf = [0; 32];
        let len = lane.take(&mut buf);
        buf[..len].to_vec()
    }

    /// Three bytes arrive, one a millisecond from 1 ms on. With 10 ms of latency the frame arrives
    /// at the slot behind 11 ms.
    #[test]
    fn bytes_travel_as_one_frame() {
        let mut lane = lane();
        assert_eq!(
            (lane.moves_at(), lane.due(), lane.room()),
            (NEVER, NEVER, 12)
        );
        assert_eq!(lane.push(&[1, 2, 3], at(0), STEP), 3);
        assert_eq!((lane.moves_at(), lane.room()), (at(1_000), 9));
        lane.shift(at(0), at(3_000), STEP);
        assert_eq!((lane.moves_at(), lane.due()), (NEVER, at(11_250)));
        assert_eq!(lane.under_way, 3);
        lane.deliver();
        assert_eq!(
            (lane.due(), lane.under_way, lane.is_drained()),
            (NEVER, 0, false)
        );
        assert_eq!((taken(&mut lane), lane.is_drained()), (vec![1, 2, 3], true));
        let traffic = Traffic {
            accepted: 3,
            delivered: 3,
            ..Traffic::default()
        };
        assert_eq!(lane.traffic(), traffic);
    }

    /// Up to 2.9 ms only two of three bytes have been moved.
    #[test]
    fn a_byte_takes_a_step() {
        let mut lane = lane();
        lane.push(&[1, 2, 3], at(0), STEP);
        lane.shift(at(0), at(2_900), STEP);
        assert_eq!((lane.under_way, lane.moves_at()), (2, at(3_000)));
        lane.shift(at(3_500), at(3_500), STEP);
        assert_eq!(lane.under_way, 3);
    }

    /// The fifth byte needs a second frame: its latency would end at 11.25 ms, but the slot of the
    /// first frame is 11.25 ms, so it gets the next one. Then eight bytes are under way and no
    /// further byte is moved until some are taken.
    #[test]
    fn frames_are_full_and_bytes_under_way_are_limited() {
        let mut lane = lane();
        assert_eq!(lane.push(&[7; 20], at(0), STEP), 12);
        lane.shift(at(0), at(90_000), STEP);
        assert_eq!(
            (lane.under_way, lane.moves_at(), lane.due()),
            (4, at(5_000), at(11_250))
        );
        assert!(lane.is_moving() && !lane.is_waiting());
        lane.shift(at(0), at(90_000), STEP);
        assert_eq!((lane.under_way, lane.moves_at()), (8, NEVER));
        assert!(!lane.is_moving() && lane.is_waiting());
        lane.deliver();
        assert_eq!((lane.due(), lane.is_waiting()), (at(12_500), true));
        assert_eq!(taken(&mut lane).len(), 4);
        assert_eq!((lane.moves_at(), lane.is_waiting()), (at(9_000), false));
        assert_eq!((lane.traffic().accepted, lane.traffic().lost), (12, 8));
    }

    /// A frame leaves a slot before it arrives: a byte that is moved at 10 ms needs another one. On
    /// a busy link it arrives 5 ms later, at the slot behind 15 ms.
    #[test]
    fn a_late_byte_needs_another_frame() {
        let second = |moved_at: u64| {
            let mut lane = lane();
            lane.push(&[1], at(0), STEP);
            lane.shift(at(0), at(1_000), STEP);
            lane.push(&[2], at(moved_at - 1_000), STEP);
            lane.shift(at(0), at(moved_at), STEP);
            lane.deliver();
            (taken(&mut lane).len(), lane.due())
        };
        assert_eq!(second(9_999), (2, NEVER));
        assert_eq!(second(10_000), (1, at(16_250)));
    }

    /// The link is idle again 50 ms after the last frame, at 11.25 + 50 = 61.25 ms.
    #[test]
    fn an_idle_link_is_slow_again() {
        let second = |moved_at: u64| {
            let mut lane = lane();
            lane.push(&[1], at(0), STEP);
            lane.shift(at(0), at(1_000), STEP);
            lane.deliver();
            lane.push(&[2], at(moved_at - 1_000), STEP);
            lane.shift(at(0), at(moved_at), STEP);
            lane.due()
        };
        assert_eq!(
            second(61_249),
            at(66_250),
            "5 ms: the slot behind 66.249 ms"
        );
        assert_eq!(
            second(61_250),
            at(72_500),
            "10 ms: the slot behind 71.25 ms"
        );
    }

    /// After a disturbance at 20 ms the frames of 11.25 and 12.5 ms arrive in the next two slots.
    #[test]
    fn frames_that_were_held_up_arrive_one_a_slot() {
        let [mut lane, mut early] = [lane(), lane()];
        lane.push(&[7; 6], at(0), STEP);
        lane.shift(at(0), at(90_000), STEP);
        lane.shift(at(0), at(90_000), STEP);
        lane.resume(at(20_000));
        assert_eq!((lane.due(), lane.last_due), (at(21_250), Some(at(22_500))));
        lane.deliver();
        assert_eq!(lane.due(), at(22_500));
        early.push(&[7; 6], at(0), STEP);
        early.shift(at(0), at(90_000), STEP);
        early.resume(at(2_000));
        assert_eq!((early.due(), early.moves_at()), (at(11_250), at(5_000)));
        early.resume(at(6_000));
        assert_eq!(early.moves_at(), at(6_000));
    }

    #[test]
    fn bytes_are_dropped_where_they_are() {
        let mut lane = lane();
        lane.push(&[7; 6], at(0), STEP);
        lane.shift(at(0), at(90_000), STEP);
        lane.deliver();
        lane.shift(at(0), at(5_000), STEP);
        assert_eq!(
            (lane.under_way, lane.queue.len(), lane.ready.len()),
            (1, 1, 4)
        );
        lane.drop_under_way();
        assert_eq!((lane.under_way, lane.room(), lane.due()), (0, 12, NEVER));
        assert_eq!((lane.traffic().dropped, lane.traffic().delivered), (2, 4));
        lane.drop_ready();
        assert_eq!((lane.traffic().dropped, lane.traffic().delivered), (6, 0));
        lane.put_ready(b"ab");
        assert_eq!(
            (taken(&mut lane), lane.traffic().delivered),
            (b"ab".to_vec(), 2)
        );
    }
}
