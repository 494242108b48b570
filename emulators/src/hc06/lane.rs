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

    /// The radio works again at `now` after frames were held up: they arrive from now on, one a
    /// slot.
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
