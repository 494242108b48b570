//! The relation of virtual time to the wall clock: a speed, a pause, or single steps.

use core::time::Duration;

use protocols::Instant;

/// Maximum speed.
pub const SPEED_MAX: f64 = 100.0;
/// Maximum virtual time that a run catches up. A run that cannot keep up becomes slower, but stays
/// responsive.
const DEBT_MAX: Duration = Duration::from_millis(200);
/// Maximum length of a step.
const STEP_MAX: Duration = Duration::from_secs(60);

/// Computes the virtual time that a run should have reached.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PagePace {
    speed: f64,
    is_paused: bool,
    /// A wall clock time and the corresponding virtual time.
    anchor: [Instant; 2],
}

impl PagePace {
    /// Starts at `virtual_now` with `speed`.
    pub(crate) fn new(speed: f64, wall: Instant, virtual_now: Instant) -> Self {
        Self {
            speed: clamp(speed),
            is_paused: false,
            anchor: [wall, virtual_now],
        }
    }

    /// Virtual seconds per second.
    pub(crate) const fn speed(&self) -> f64 {
        self.speed
    }

    /// Whether the run is paused.
    pub(crate) const fn is_paused(&self) -> bool {
        self.is_paused
    }

    /// The virtual time that a run at `virtual_now` should reach.
    pub(crate) fn target(&mut self, wall: Instant, virtual_now: Instant) -> Instant {
        if self.is_paused {
            return virtual_now;
        }
        let [wall_anchor, virtual_anchor] = self.anchor;
        let target = virtual_anchor + (wall - wall_anchor).mul_f64(self.speed);
        let debt = DEBT_MAX.mul_f64(self.speed.max(1.0));
        if target - virtual_now > debt {
            self.anchor = [wall, virtual_now + debt];
            return virtual_now + debt;
        }
        target.max(virtual_now)
    }

    /// Pauses.
    pub(crate) const fn pause(&mut self) {
        self.is_paused = true;
    }

    /// Resumes.
    pub(crate) const fn play(&mut self, wall: Instant, virtual_now: Instant) {
        self.is_paused = false;
        self.anchor = [wall, virtual_now];
    }

    /// Sets the speed, now or after a pause.
    pub(crate) fn set_speed(&mut self, speed: f64, wall: Instant, virtual_now: Instant) {
        self.speed = clamp(speed);
        self.anchor = [wall, virtual_now];
    }

    /// Pauses after a step of `millis`; returns the end of the step.
    pub(crate) fn step(&mut self, millis: u32, virtual_now: Instant) -> Instant {
        self.is_paused = true;
        virtual_now + Duration::from_millis(u64::from(millis)).min(STEP_MAX)
    }
}

/// The state of the clock for pages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tempo {
    pub(super) is_paused: bool,
    pub(super) speed: f64,
    pub(super) is_ours: bool,
}

impl Tempo {
    /// The state of `pace`, if the clock can be set.
    pub(super) fn of(pace: Option<&PagePace>) -> Self {
        Self {
            is_paused: pace.is_some_and(PagePace::is_paused),
            speed: pace.map_or(1.0, PagePace::speed),
            is_ours: pace.is_some(),
        }
    }
}

/// Limits a requested speed to the valid range.
fn clamp(speed: f64) -> f64 {
    if speed.is_finite() {
        speed.clamp(0.01, SPEED_MAX)
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    #[test]
    fn at_four_times_the_speed_a_quarter_of_a_second_is_a_second() {
        let mut pace = PagePace::new(4.0, at(0), at(0));
        assert_eq!(pace.target(at(250), at(900)), at(1000));
        pace.set_speed(0.5, at(250), at(1000));
        assert_eq!(pace.target(at(450), at(1000)), at(1100));
    }

    #[test]
    fn a_pause_leaves_no_debt() {
        let mut pace = PagePace::new(1.0, at(0), at(0));
        pace.pause();
        assert_eq!(pace.target(at(60_000), at(10)), at(10));
        assert_eq!(pace.step(50, at(10)), at(60));
        pace.play(at(60_000), at(60));
        assert_eq!(pace.target(at(60_100), at(60)), at(160));
    }

    /// After an hour of suspend the run continues 200 ms later, not an hour later.
    #[test]
    fn what_cannot_be_made_up_for_is_given_up() {
        let mut pace = PagePace::new(1.0, at(0), at(0));
        assert_eq!(pace.target(at(3_600_000), at(0)), at(200));
        assert_eq!(pace.target(at(3_600_100), at(200)), at(300));
    }

    #[test]
    fn a_speed_without_sense_is_none() {
        for (asked, speed) in [(f64::NAN, 1.0), (-1.0, 0.01), (0.0, 0.01), (1e9, SPEED_MAX)] {
            assert!((PagePace::new(asked, at(0), at(0)).speed() - speed).abs() < 1e-9);
        }
    }
}
