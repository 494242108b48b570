//! Detects a stuck gyroscope.
//!
//! A chip with stuck registers reports one rate forever; the odometer adds this rate up to a
//! heading, and its lines look valid. A working gyroscope is never quiet: its noise is 0.05 degrees
//! a second (MPU-6050, data sheet), 0.8 of its step of 0.061 in the range of 2,000 degrees a
//! second. One line in three therefore repeats the rate of the line before. The run of equal rates
//! counted here occurs by chance once in 10^14 lines. For a stuck gyroscope the turn is computed
//! from the steering.

use protocols::odometer::Reading;

use crate::ackermann::{CarGeometry, wrapped};

/// Number of lines in a row with the same rate, 0.3 s, that mean a stuck chip.
const SAME_MAX: u32 = 30;
/// The car as the program knows it.
const CAR: CarGeometry = CarGeometry {
    wheelbase_m: 0.25,
    track_m: 0.155,
};

/// The watch.
#[derive(Clone, Debug, Default)]
pub struct GyroWatch {
    before: Option<Reading>,
    /// Lines since the rate changed.
    same: u32,
    /// Turn by the steering minus turn by the gyroscope since then, radians.
    off_rad: f64,
}

impl GyroWatch {
    /// Restarts the watch after a reset of the odometer.
    pub const fn begin_anew(&mut self) {
        self.before = None;
        self.same = 0;
        self.off_rad = 0.0;
    }

    /// Whether the chip is stuck.
    pub const fn is_stuck(&self) -> bool {
        self.same >= SAME_MAX
    }

    /// Takes a line, and the steering angle of the wheels, radians. Returns the correction of the
    /// reported heading, radians: 0 while the chip works. The chip was stuck from the first of the
    /// equal lines on, so the turn of all of them is corrected at once.
    pub fn hear(&mut self, reading: Reading, steering_rad: f64) -> f64 {
        let Some(before) = self.before.replace(reading) else {
            return 0.0;
        };
        #[expect(
            clippy::float_cmp,
            reason = "the same figure of a line, not about the same"
        )]
        let is_same = reading.rate_rad_s == before.rate_rad_s;
        if !is_same {
            (self.same, self.off_rad) = (0, 0.0);
            return 0.0;
        }
        self.same = self.same.saturating_add(1);
        let way_m = reading.distance_m - before.distance_m;
        let steered_rad = CAR.rear_arc(steering_rad, way_m).turn_rad;
        self.off_rad += steered_rad - wrapped(reading.yaw_rad - before.yaw_rad);
        match self.is_stuck() {
            true => core::mem::take(&mut self.off_rad),
            false => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    /// Line `index` of a car that drives 2.2 mm a line and reports this rate.
    fn line(index: u32, rate_rad_s: f64) -> Reading {
        Reading {
            distance_m: 0.002_2 * f64::from(index),
            rate_rad_s,
            yaw_rad: 0.01 * rate_rad_s * f64::from(index),
            time_s: 0.01 * f64::from(index),
        }
    }

    /// A car with a wheelbase of 0.25 m and wheels at atan(0.25) turns by a radian a metre: 0.22 m
    /// in 100 lines are 0.22 rad. A stuck chip that reports 0.5 rad/s gives 0.50 rad in the same
    /// second.
    #[test]
    fn a_stuck_gyroscope_is_not_believed_from_its_first_stuck_line_on() {
        let mut watch = GyroWatch::default();
        let steering_rad = libm::atan(0.25);
        let off = |index| watch.hear(line(index, 0.5), steering_rad);
        let all: std::vec::Vec<f64> = (0..=100).map(off).collect();
        assert!(all[..30].iter().all(|off| *off == 0.0));
        assert!((all[30] - (0.066 - 0.15)).abs() < 1e-9, "{}", all[30]);
        let whole: f64 = all.iter().sum();
        assert!((whole - (0.22 - 0.50)).abs() < 1e-9, "{whole}");
        assert!(watch.is_stuck());
    }

    /// A noise of one step is normal; a chip that measures again is trusted at once.
    #[test]
    fn a_gyroscope_that_measures_is_believed() {
        let mut watch = GyroWatch::default();
        for index in 0..200 {
            let rate = 0.5 + f64::from(index / 29 % 2) * 0.001;
            assert_eq!(watch.hear(line(index, rate), 0.0), 0.0, "{index}");
        }
        for index in 200..240 {
            watch.hear(line(index, 0.3), 0.0);
        }
        assert!(watch.is_stuck());
        assert_eq!(watch.hear(line(240, 0.301), 0.0), 0.0);
        assert!(!watch.is_stuck());
        watch.begin_anew();
        assert_eq!(watch.hear(line(241, 0.301), 0.0), 0.0);
    }
}
