//! Both directions over the air: they share the module's processor and the radio.

use core::time::Duration;

use protocols::Instant;

use super::lane::{Lane, NEVER};
use super::{Profile, Radio};
use crate::rng::Rng;

/// Both directions, and the time up to which they are known.
#[derive(Clone, Debug)]
pub(super) struct Air {
    /// From the UART to the host.
    pub(super) up: Lane,
    /// From the host to the UART.
    pub(super) down: Lane,
    now: Instant,
    carrier: Radio,
    /// Time to move a byte while the other direction is idle.
    step: Duration,
    slot: Duration,
}

impl Air {
    pub(super) fn new(profile: &Profile, seed: u64) -> Self {
        let lane = |queue_len, name| Lane::new(profile, queue_len, Rng::stream(seed, name));
        Self {
            up: lane(profile.fifo_len, "hc06.up"),
            down: lane(profile.host_queue_len, "hc06.down"),
            now: Instant::ZERO,
            carrier: Radio::Lost,
            step: Duration::from_secs(1) / profile.rate_bytes_s.max(1),
            slot: profile.slot.max(Duration::from_micros(1)),
        }
    }

    /// Time up to which all is known.
    pub(super) const fn now(&self) -> Instant {
        self.now
    }

    /// Time to move a byte while the other direction is idle.
    pub(super) const fn step(&self) -> Duration {
        self.step
    }

    /// Starts or stops the flow.
    pub(super) fn set_carrier(&mut self, now: Instant, carrier: Radio) {
        self.advance(now);
        if carrier == Radio::InReach && self.carrier == Radio::Lost {
            self.up.resume(now);
            self.down.resume(now);
        }
        self.carrier = carrier;
    }

    /// Accepts bytes of the UART, all at `at`; returns how many fitted.
    pub(super) fn push_up(&mut self, bytes: &[u8], at: Instant) -> usize {
        let step = step_beside(self.step, &self.down);
        self.up.push(bytes, at, step)
    }

    /// Accepts bytes of the host, all at `at`; returns how many fitted.
    pub(super) fn push_down(&mut self, bytes: &[u8], at: Instant) -> usize {
        let step = step_beside(self.step, &self.up);
        self.down.push(bytes, at, step)
    }

    /// Moves and delivers everything due by `now`.
    pub(super) fn advance(&mut self, now: Instant) {
        if now <= self.now {
            return;
        }
        while self.carrier == Radio::InReach {
            let up = self.up.due().min(self.up.moves_at());
            let down = self.down.due().min(self.down.moves_at());
            if up.min(down) > now {
                break;
            }
            let (lane, other) = if up <= down {
                (&mut self.up, &self.down)
            } else {
                (&mut self.down, &self.up)
            };
            let (due, moves_at) = (lane.due(), lane.moves_at());
            if due <= moves_at {
                lane.deliver();
                continue;
            }
            // The other direction, if loaded, gets its turn after each byte.
            let until = if other.is_moving() {
                moves_at
            } else {
                due.min(now)
            };
            lane.shift(self.now, until, step_beside(self.step, other));
        }
        self.now = now;
    }

    /// Time of the next event without further input.
    pub(super) fn poll_at(&self) -> Option<Instant> {
        if self.carrier == Radio::Lost {
            return None;
        }
        // A frame on the air is due before any later one. A stopped lane looks again a slot later,
        // because no event reports when its other end has taken bytes.
        let next = |lane: &Lane| match lane.due() {
            NEVER if lane.is_waiting() => self.now + self.slot,
            NEVER => lane.moves_at(),
            due => due,
        };
        Some(next(&self.up).min(next(&self.down))).filter(|&at| at != NEVER)
    }
}

/// Time to move a byte beside another direction: load on both halves the rate of each.
fn step_beside(step: Duration, other: &Lane) -> Duration {
    if other.is_moving() { step * 2 } else { step }
}
