//! Both directions over the air: they share the module's processor and the radio.

use core::time::Duration;

use protocols::Instant;

use super::lane::Lane;
use super::{Profile, Radio};
use crate::device::earliest;
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
    /// Time to move a byte while the other direction rests.
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

    /// Time to move a byte while the other direction rests.
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

    /// Takes bytes of the UART, all at `at`; how many found room.
    pub(super) fn push_up(&mut self, bytes: &[u8], at: Instant) -> usize {
        let step = step_beside(self.step, &self.down);
        self.up.push(bytes, at, step)
    }

    /// Takes bytes of the host, all at `at`; how many found room.
    pub(super) fn push_down(&mut self, bytes: &[u8], at: Instant) -> usize {
        let step = step_beside(self.step, &self.up);
        self.down.push(bytes, at, step)
    }

    /// Moves and delivers everything due by `now`.
    pub(super) fn advance(&mut self, now: Instant) {
        while self.carrier == Radio::InReach {
            let due = earliest([self.up.due(), self.down.due()]);
            let moves_at = earliest([self.up.moves_at(), self.down.moves_at()]);
            match (due, moves_at) {
                (Some(due), moves_at) if due <= now && moves_at.is_none_or(|at| due <= at) => {
                    let lane = match self.up.due() {
                        Some(up) if up == due => &mut self.up,
                        _ => &mut self.down,
                    };
                    lane.deliver();
                }
                (due, Some(moves_at)) if moves_at <= now => {
                    self.shift(moves_at, due.map_or(now, |due| due.min(now)));
                }
                _ => break,
            }
        }
        self.now = self.now.max(now);
    }

    /// Moves the byte that is next at `at`, and its followers until `until` if the other direction
    /// rests.
    fn shift(&mut self, at: Instant, until: Instant) {
        let (lane, other) = match self.up.moves_at() {
            Some(up) if up == at => (&mut self.up, &self.down),
            _ => (&mut self.down, &self.up),
        };
        let until = if other.is_moving() { at } else { until };
        let step = step_beside(self.step, other);
        lane.shift(self.now, until, step);
    }

    /// When something next happens by itself.
    pub(super) fn poll_at(&self) -> Option<Instant> {
        if self.carrier == Radio::Lost {
            return None;
        }
        earliest([&self.up, &self.down].map(|lane| {
            // A frame on its way is due before any that is yet to be made. A lane that is stopped
            // looks again a slot later, as nobody tells when its far end has taken bytes.
            let stopped = (lane.queued() > 0 && lane.is_stopped()).then(|| self.now + self.slot);
            lane.due().or(lane.moves_at()).or(stopped)
        }))
    }
}

/// Time to move a byte beside another direction: load on both halves the rate of each.
fn step_beside(step: Duration, other: &Lane) -> Duration {
    if other.is_moving() { step * 2 } else { step }
}
