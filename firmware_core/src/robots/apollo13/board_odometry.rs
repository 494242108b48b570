//! Where the car went by its board alone: pulses of a wheel, and the steering that was commanded.
//!
//! Coarser than the odometer, 25 mm a pulse, and it believes the steering table; for the time in
//! which the odometer is silent. Facts: 8 magnets at the left rear wheel, whose radius is 32 mm
//! (seed 003 and ucboard).

use core::f64::consts::TAU;

use super::arbiter::Drive;
use super::steering;
use crate::ackermann::{CarGeometry, CarPose};

/// Travel of the wheel from pulse to pulse.
const PULSE_M: f64 = TAU * 0.032 / 8.0;
/// More pulses from frame to frame are those of a board that was reset: 1 m.
const PULSES_MAX: u16 = 40;
/// The car as the program knows it.
const CAR: CarGeometry = CarGeometry {
    wheelbase_m: 0.25,
    track_m: 0.155,
};

/// Adds up pulses.
#[derive(Clone, Debug, Default)]
pub struct BoardOdometry {
    pose: CarPose,
    pulses: Option<u16>,
    angle_rad: f64,
    is_backwards: bool,
}

impl BoardOdometry {
    /// Where the car is, seen from where it began.
    pub const fn pose(&self) -> CarPose {
        self.pose
    }

    /// Whether it was told to drive backwards last.
    pub const fn is_backwards(&self) -> bool {
        self.is_backwards
    }

    /// How the wheels were told to stand, radians, to the left positive.
    pub const fn steering_rad(&self) -> f64 {
        self.angle_rad
    }

    /// What is commanded from now on. A car that is told to stop rolls on as it did.
    pub fn command(&mut self, drive: Drive) {
        self.angle_rad = steering::angle_deg(drive.steering).to_radians();
        if drive.level != 0 {
            self.is_backwards = drive.level < 0;
        }
    }

    /// A frame of the board with its pulses since the start, which wrap; whether there are new
    /// ones. The magnets do not tell forth from back.
    pub fn hear(&mut self, pulses: u16) -> bool {
        let Some(before) = self.pulses.replace(pulses) else {
            return false;
        };
        let new = pulses.wrapping_sub(before);
        if new == 0 || new > PULSES_MAX {
            return false;
        }
        let way = if self.is_backwards { -1.0 } else { 1.0 };
        let wheel_m = way * PULSE_M * f64::from(new);
        let path_m = CAR.rear_of_left_wheel(self.angle_rad, wheel_m);
        self.pose = self.pose.then(CAR.rear_arc(self.angle_rad, path_m));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn driven(level: i8, value: i8, pulses: &[u16]) -> BoardOdometry {
        let mut board = BoardOdometry::default();
        let steering = value;
        board.command(Drive { level, steering });
        for pulses in pulses {
            board.hear(*pulses);
        }
        board
    }

    /// 40 pulses of 25.13 mm are 1.0053 m of the left wheel; across the end of 16 bits, and back as
    /// well. Value 8 is 0.4 degrees to the right, 0.0279 rad a metre: the middle goes 0.2 % less.
    #[test]
    fn pulses_are_travel() {
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 3e-3, "{found}");
        let ahead = driven(2, 8, &[65_530, 65_534, 10, 34]);
        near(ahead.pose().x_m, 1.0053);
        near(driven(-3, 8, &[0, 40]).pose().x_m, -1.0053);
        near(driven(0, 8, &[0, 20]).pose().x_m, 0.5027);
    }

    /// -50 is 25 degrees to the left: tan is 0.4663, 1.865 rad a metre; the left wheel goes
    /// 1 - 1.865 * 0.0775 = 0.8555 of the middle. 10 pulses are 0.2513 m of it and 0.2938 m.
    #[test]
    fn a_curve_turns_as_far_as_its_steering_says() {
        let turned = driven(2, -50, &[100, 110]).pose().heading_rad;
        assert!((turned - 0.5479).abs() < 1e-3, "{turned}");
    }

    /// The first frame only sets the beginning, and so does that of a board that was reset.
    #[test]
    fn a_board_that_was_reset_has_not_moved() {
        let board = driven(2, 8, &[500, 0, 3]);
        assert!((board.pose().x_m - 3.0 * PULSE_M).abs() < 1e-3);
    }
}
