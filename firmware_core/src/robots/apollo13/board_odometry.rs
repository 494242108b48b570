//! Odometry from the car's board alone: pulses of a wheel, and the commanded steering.
//!
//! It is coarser than the odometer (25 mm a pulse) and relies on the steering table. The program
//! uses it while the odometer is silent. Facts: 8 magnets at the left rear wheel, whose radius is
//! 32 mm (seed 003 and ucboard).

use core::f64::consts::TAU;
use core::time::Duration;

use protocols::Instant;

use super::arbiter::Drive;
use super::steering;
use crate::ackermann::{CarGeometry, CarPose, Motion};

/// Travel of the wheel from pulse to pulse.
const PULSE_M: f64 = TAU * 0.032 / 8.0;
/// Maximum number of pulses between two frames, 1 m; more mean a reset of the board.
const PULSES_MAX: u16 = 40;
/// Time constant of the motor's speed with and without a drive, seconds.
const LAG_S: f64 = 0.3;
/// The car as the program knows it.
const CAR: CarGeometry = CarGeometry {
    wheelbase_m: 0.25,
    track_m: 0.155,
};

/// Odometry from pulses.
#[derive(Clone, Debug, Default)]
pub struct BoardOdometry {
    pose: CarPose,
    /// Time and pulses of the last frame.
    heard: Option<(Instant, u16)>,
    /// Speed of the wheel by its pulses, m/s.
    speed_m_s: f64,
    angle_rad: f64,
    is_backwards: bool,
}

impl BoardOdometry {
    /// The car's pose relative to its start.
    pub const fn pose(&self) -> CarPose {
        self.pose
    }

    /// The car's pose at `now` if the motor has been off since the last frame: a silent board may
    /// be restarting.
    pub fn pose_at(&self, now: Instant) -> CarPose {
        let rolled_m = self
            .heard
            .map_or(0.0, |(heard, _)| self.rolled_m(now - heard));
        let path_m = CAR.rear_of_left_wheel(self.angle_rad, rolled_m);
        self.pose.then(self.arc(path_m))
    }

    /// Distance that the wheel rolls without a drive.
    fn rolled_m(&self, passed: Duration) -> f64 {
        self.speed_m_s * LAG_S * (1.0 - libm::exp(-passed.as_secs_f64() / LAG_S))
    }

    /// Whether the last motor command was backwards.
    pub const fn is_backwards(&self) -> bool {
        self.is_backwards
    }

    /// The commanded steering angle, radians, to the left positive.
    pub const fn steering_rad(&self) -> f64 {
        self.angle_rad
    }

    /// Sets the current command. A car that is commanded to stop keeps its direction while it rolls
    /// on.
    pub fn command(&mut self, drive: Drive) {
        self.angle_rad = steering::angle_deg(drive.steering).to_radians();
        if drive.level != 0 {
            self.is_backwards = drive.level < 0;
        }
    }

    /// Takes a frame of the board with its pulses since the start, which wrap; returns whether the
    /// wheel turned. The magnets do not show the direction. A board that was reset stopped its
    /// motor at an unknown time since the frame before, and did not count while the car rolled out.
    pub fn hear(&mut self, now: Instant, pulses: u16) -> bool {
        let Some((heard, before)) = self.heard.replace((now, pulses)) else {
            return false;
        };
        let passed = now - heard;
        let new = pulses.wrapping_sub(before);
        let way = if self.is_backwards { -1.0 } else { 1.0 };
        let wheel_m = match new > PULSES_MAX {
            true => self.rolled_m(passed),
            false => way * PULSE_M * f64::from(new),
        };
        self.speed_m_s += (wheel_m - self.speed_m_s * passed.as_secs_f64().min(LAG_S)) / LAG_S;
        if new == 0 {
            return false;
        }
        let path_m = CAR.rear_of_left_wheel(self.angle_rad, wheel_m);
        self.pose = self.pose.then(self.arc(path_m));
        true
    }

    /// Motion with the commanded steering over `path_m` of the rear axle's middle.
    pub fn arc(&self, path_m: f64) -> Motion {
        CAR.rear_arc(self.angle_rad, path_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn driven(level: i8, value: i8, pulses: &[u16]) -> BoardOdometry {
        let mut board = BoardOdometry::default();
        let steering = value;
        board.command(Drive { level, steering });
        for (frame, pulses) in (0..).zip(pulses) {
            board.hear(at_frame(frame), *pulses);
        }
        board
    }

    /// Time of a frame; frames come 15 times a second.
    fn at_frame(frame: u64) -> Instant {
        Instant::from_nanos(frame * 66_666_667)
    }

    /// 40 pulses of 25.13 mm are 1.0053 m of the left wheel, also across the end of the 16-bit
    /// counter and backwards. Steering value 8 is 0.4 degrees to the right, 0.0279 rad a metre: the
    /// middle travels 0.2 % less.
    #[test]
    fn pulses_are_travel() {
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 3e-3, "{found}");
        let ahead = driven(2, 8, &[65_530, 65_534, 10, 34]);
        near(ahead.pose().x_m, 1.0053);
        near(driven(-3, 8, &[0, 40]).pose().x_m, -1.0053);
        near(driven(0, 8, &[0, 20]).pose().x_m, 0.5027);
    }

    /// Steering value -50 is 25 degrees to the left: its tangent is 0.4663, and the car turns by
    /// 1.865 rad a metre. The left wheel travels 1 - 1.865 * 0.0775 = 0.8555 of the middle's
    /// distance. 10 pulses are 0.2513 m of the wheel and 0.2938 m of the middle.
    #[test]
    fn a_curve_turns_as_far_as_its_steering_says() {
        let turned = driven(2, -50, &[100, 110]).pose().heading_rad;
        assert!((turned - 0.5479).abs() < 1e-3, "{turned}");
    }

    /// The first frame only sets the start, as does the first frame after a reset while the car
    /// stood.
    #[test]
    fn a_board_that_was_reset_at_rest_has_not_moved() {
        let board = driven(2, 8, &[500, 0, 3]);
        assert!((board.pose().x_m - 3.0 * PULSE_M).abs() < 1e-3);
    }

    /// At 0.22 m/s for 4 s, then 0.4 s without a frame, and a counter that restarts: the car rolled
    /// 0.22 * 0.3 m * (1 - exp(-4/3)) = 48.6 mm. A car that had stopped before did not roll. One
    /// pulse is 25 mm.
    #[test]
    fn a_car_rolls_out_while_its_board_starts() {
        for (stands, expected_m) in [(0, 0.0486), (40, 0.0)] {
            // The car makes 7 pulses in 12 frames.
            let pulses = |frame: u16| frame * 7 / 12;
            let mut board = BoardOdometry::default();
            let (level, steering) = (2, 8);
            board.command(Drive { level, steering });
            for frame in 0..60 + stands {
                board.hear(at_frame(frame.into()), 100 + pulses(frame.min(59)));
            }
            let (before_m, starts) = (board.pose().x_m, at_frame(u64::from(stands) + 65));
            let foreseen_m = board.pose_at(starts).x_m;
            board.hear(starts, 0);
            let rolled_m = board.pose().x_m - before_m;
            assert!((rolled_m - expected_m).abs() < 0.01, "{rolled_m}");
            assert!((foreseen_m - board.pose().x_m).abs() < 1e-9);
        }
    }
}
