//! The two driven wheels of a car behind an ideal differential gear: in a curve the outer one
//! travels farther.

use super::super::STEP_S;

/// Left and right.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct RearWheels {
    /// Travel of the rims at the beginning of the current step, metres.
    travel: [f64; 2],
    /// Speed of the rims, m/s; holds for the current step.
    pub(super) speed: [f64; 2],
}

impl RearWheels {
    /// Begins the next step: the axle's middle rolls at `speed`; `bend` is half of the track
    /// divided by the radius of the middle's circle, positive to the left.
    pub(super) fn step(&mut self, speed: f64, bend: f64) {
        for (travel, speed) in self.travel.iter_mut().zip(self.speed) {
            *travel += speed * STEP_S;
        }
        self.speed = [speed * (1.0 - bend), speed * (1.0 + bend)];
    }

    /// Whole counts of `tick_m` of one wheel, `after_s` into the current step.
    pub(super) fn ticks(&self, wheel: usize, after_s: f64, tick_m: f64) -> i64 {
        let travel = self.travel[wheel] + self.speed[wheel] * after_s;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a robot lives less than 2^63 ticks"
        )]
        let ticks = (travel / tick_m).floor() as i64;
        ticks
    }
}
