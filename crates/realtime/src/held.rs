//! A clock that can be stopped: rig time pauses, continues, steps, and runs slower or faster.

use core::cell::Cell;
use core::time::Duration;

use protocols::Instant;

use super::clock::{Clock, WallClock};

/// Minimum and maximum speed of rig time while ports are open, seconds per second. A rig at a
/// higher speed could not transfer its bytes in time.
pub(crate) const SPEEDS: [f64; 2] = [0.01, 4.0];
/// Maximum step.
pub(crate) const STEP_MAX: Duration = Duration::from_secs(600);

/// A wall clock that stands until it is released, and can be stopped again. While it stands, the
/// rig waits with its devices and with open ports. Bytes that clients send wait at their ports.
#[derive(Debug)]
pub struct Held {
    wall: WallClock,
    /// Two corresponding times: of the wall clock, of the rig.
    anchor: Cell<[Instant; 2]>,
    goes: Cell<bool>,
    has_begun: Cell<bool>,
    speed: Cell<f64>,
    /// End of the current step.
    stops_at: Cell<Option<Instant>>,
}

impl Held {
    /// A clock that stands at `moment`.
    pub fn at(moment: Instant) -> Self {
        Self {
            wall: WallClock::start(),
            anchor: Cell::new([Instant::ZERO, moment]),
            goes: Cell::new(false),
            has_begun: Cell::new(false),
            speed: Cell::new(1.0),
            stops_at: Cell::new(None),
        }
    }

    /// Wall time since its creation, also while it stands.
    pub fn waited(&self) -> Duration {
        self.wall.now() - Instant::ZERO
    }

    /// Starts the clock.
    pub fn let_go(&self) {
        self.set_anchor();
        self.goes.set(true);
        self.has_begun.set(true);
        self.stops_at.set(None);
    }

    /// Stops the clock.
    pub fn hold(&self) {
        self.set_anchor();
        self.goes.set(false);
    }

    /// Runs for `by` and then stops; returns the time of the stop.
    pub fn step(&self, by: Duration) -> Instant {
        let end = self.now() + by.min(STEP_MAX);
        self.let_go();
        self.stops_at.set(Some(end));
        end
    }

    /// Sets the speed, seconds of the rig per second within `SPEEDS`.
    pub fn set_speed(&self, speed: f64) {
        self.set_anchor();
        self.speed.set(speed.clamp(SPEEDS[0], SPEEDS[1]));
    }

    /// Whether the clock was ever started.
    pub const fn has_begun(&self) -> bool {
        self.has_begun.get()
    }

    /// Whether the clock stands.
    pub fn stands(&self) -> bool {
        !self.goes.get() || self.stops_at.get().is_some_and(|end| self.now() >= end)
    }

    /// Seconds of the rig per second, while the clock runs.
    pub const fn speed(&self) -> f64 {
        self.speed.get()
    }

    fn set_anchor(&self) {
        self.anchor.set([self.wall.now(), self.now()]);
    }
}

impl Clock for Held {
    fn now(&self) -> Instant {
        let [wall, moment] = self.anchor.get();
        if !self.goes.get() {
            return moment;
        }
        let (since, speed) = (self.wall.now() - wall, self.speed.get());
        // At real time, avoid the rounding of floating-point numbers.
        let is_real = (speed - 1.0).abs() < f64::EPSILON;
        let now = moment + if is_real { since } else { since.mul_f64(speed) };
        self.stops_at.get().map_or(now, |end| now.min(end))
    }

    fn slip(&self, by: Duration) -> bool {
        let [wall, moment] = [self.wall.now(), self.now()];
        let moment = Instant::ZERO + (moment - Instant::ZERO).saturating_sub(by);
        self.anchor.set([wall, moment]);
        true
    }

    fn lasts(&self, time: Duration) -> Duration {
        time.div_f64(self.speed.get())
    }

    fn sleep_until(&self, deadline: Instant) {
        let real = self.lasts(deadline - self.now());
        self.wall.sleep_until(self.wall.now() + real);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_stands_until_it_is_let_go_and_waits_all_the_same() {
        let (held, moment) = (Held::at(Instant::from_secs(5)), Instant::from_secs(5));
        held.sleep_until(moment + Duration::from_millis(2));
        assert!(held.waited() >= Duration::from_millis(2));
        assert_eq!(held.now(), moment);
        held.let_go();
        held.sleep_until(moment + Duration::from_millis(2));
        assert!(held.now() >= moment + Duration::from_millis(2));
    }

    #[test]
    fn held_again_it_loses_no_time_and_a_step_ends_where_it_says() {
        let (held, millis) = (Held::at(Instant::ZERO), Duration::from_millis);
        assert!(held.stands() && !held.has_begun());
        held.let_go();
        held.hold();
        let stood = held.now();
        held.sleep_until(stood + millis(3));
        assert_eq!(held.now(), stood);
        let end = held.step(millis(1));
        assert_eq!(end, stood + millis(1));
        held.sleep_until(stood + millis(5));
        assert!(held.stands());
        assert_eq!(held.now(), end);
        held.let_go();
        assert!(!held.stands() && held.now() >= end);
    }

    #[test]
    fn at_another_speed_time_never_runs_back() {
        let held = Held::at(Instant::ZERO);
        held.let_go();
        held.sleep_until(Instant::from_millis(2));
        let before = held.now();
        held.set_speed(0.01);
        let after = held.now();
        assert!(after >= before && after < before + Duration::from_millis(500));
        held.set_speed(1e9);
        assert!((held.speed() - SPEEDS[1]).abs() < 1e-9);
        held.set_speed(4.0);
        let lasts = held.lasts(Duration::from_millis(20));
        assert_eq!(lasts, Duration::from_millis(5));
    }
}
