//! Odometry from the car's encoder and gyroscope.

use crate::ackermann::{CarPose, Motion, wrapped};

/// Defects of the fielded odometry; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The sideways motion has the wrong sign, and the whole turn is applied before the motion.
    pub wrong_side: bool,
}

/// Sum of travel and heading.
#[derive(Clone, Debug)]
pub struct GyroOdometry {
    defects: Defects,
    pose: CarPose,
    /// Travel and heading of the last reading.
    told: Option<[f64; 2]>,
}

impl GyroOdometry {
    /// Odometry that starts at `start`.
    pub const fn new(start: CarPose, defects: Defects) -> Self {
        Self {
            defects,
            pose: start,
            told: None,
        }
    }

    /// The car's pose.
    pub const fn pose(&self) -> CarPose {
        self.pose
    }

    /// Notes a reset of the board: the next travel and heading only set the start values.
    pub const fn begin_anew(&mut self) {
        self.told = None;
    }

    /// Adds a motion of the car during a silence of the odometer, from another source.
    pub fn bridge(&mut self, motion: Motion) {
        self.pose = self.pose.then(motion);
    }

    /// Distance counted since the last reading, metres; 0 without one.
    pub fn counted_m(&self, travel_m: f64) -> f64 {
        self.told.map_or(0.0, |[before_m, _]| travel_m - before_m)
    }

    /// Takes the travel since the board's start, metres, and the gyroscope's heading, radians; the
    /// first ones only set the start values. A travel that falls back by more than a metre means a
    /// reset of the board, and sets the start values again. Returns the distance since the last
    /// reading, metres.
    pub fn update(&mut self, travel_m: f64, heading_rad: f64) -> f64 {
        if !travel_m.is_finite() || !heading_rad.is_finite() {
            return 0.0;
        }
        let Some([before_m, before_rad]) = self.told.replace([travel_m, heading_rad]) else {
            return 0.0;
        };
        let way = travel_m - before_m;
        if way.abs() > 1.0 {
            return 0.0;
        }
        let turn_rad = wrapped(heading_rad - before_rad);
        // The chord of the arc starts at half the turn.
        let (sin, cos) = match self.defects.wrong_side {
            true => {
                let (sin, cos) = libm::sincos(turn_rad);
                (-sin, cos)
            }
            false => libm::sincos(turn_rad / 2.0),
        };
        self.pose = self.pose.then(Motion {
            ahead_m: way * cos,
            left_m: way * sin,
            turn_rad,
        });
        way
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ackermann::CarGeometry;

    const CAR: CarGeometry = CarGeometry {
        wheelbase_m: 0.258,
        track_m: 0.155,
    };

    /// A course of 10 m: two quarter turns to the left and two to the right at 15 degrees of
    /// steering, with 45 readings a second at 0.22 m/s.
    fn course() -> (CarPose, CarPose) {
        let step = 0.22 / 45.0;
        // A quarter turn takes k / tan(15 degrees) * pi / 2 = 1.5125 m.
        let quarter = 1.5125;
        let mut truth = CarPose::default();
        let mut odometry = GyroOdometry::new(truth, Defects::default());
        let (mut travel, mut heading) = (0.0, 0.0);
        odometry.update(travel, heading);
        let legs = [
            (0.0, 1.0),
            (15.0, quarter),
            (-15.0, quarter),
            (0.0, 1.95),
            (-15.0, quarter),
            (15.0, quarter),
            (0.0, 1.0),
        ];
        for (angle_deg, length) in legs {
            let mut done = 0.0;
            while done < length {
                let motion = CAR.rear_arc(f64::to_radians(angle_deg), step);
                truth = truth.then(motion);
                done += step;
                travel += step;
                heading += motion.turn_rad;
                odometry.update(travel, heading);
            }
        }
        (truth, odometry.pose())
    }

    /// AP7: within 1 % of the distance and 1 degree.
    #[test]
    fn ap7_a_course_of_ten_metres_ends_where_it_ends() {
        let (truth, found) = course();
        assert!(
            found.distance_m(truth) < 0.10,
            "{}",
            found.distance_m(truth)
        );
        assert!(wrapped(found.heading_rad - truth.heading_rad).abs() < 1_f64.to_radians());
        // The midpoint form is much more accurate than that.
        assert!(found.distance_m(truth) < 0.001);
    }

    /// Half a circle at 15 degrees: each step of `ds` is moved by `3/2 ds turn` to the wrong side,
    /// which adds up to three steps of 4.9 mm.
    #[test]
    fn ap7_the_fielded_signs_cost_a_centimetre_and_a_half() {
        let step = 0.22 / 45.0;
        let mut odometry = GyroOdometry::new(CarPose::default(), Defects { wrong_side: true });
        let (mut truth, mut travel, mut heading) = (CarPose::default(), 0.0, 0.0);
        odometry.update(travel, heading);
        while heading < core::f64::consts::PI {
            let motion = CAR.rear_arc(15_f64.to_radians(), step);
            truth = truth.then(motion);
            travel += step;
            heading += motion.turn_rad;
            odometry.update(travel, heading);
        }
        let off = odometry.pose().distance_m(truth);
        assert!((off - 3.0 * step).abs() < 0.0003, "{off}");
    }

    /// AP7: a bias of 0.05 degrees a second for 120 s are 6 degrees.
    #[test]
    fn ap7_a_bias_turns_the_heading_by_six_degrees() {
        let mut odometry = GyroOdometry::new(CarPose::default(), Defects::default());
        for reading in 0..=5_400 {
            let time = f64::from(reading) / 45.0;
            odometry.update(0.22 * time, (0.05 * time).to_radians());
        }
        let heading = odometry.pose().heading_rad.to_degrees();
        assert!((heading - 6.0).abs() < 1e-6, "{heading}");
    }

    #[test]
    fn a_board_that_says_so_begins_anew() {
        let mut odometry = GyroOdometry::new(CarPose::default(), Defects::default());
        odometry.update(0.0, 0.0);
        odometry.update(0.5, 0.3);
        let before = odometry.pose();
        odometry.begin_anew();
        odometry.update(0.0, 0.0);
        assert_eq!(odometry.pose(), before);
    }

    #[test]
    fn a_board_that_was_reset_begins_anew() {
        let mut odometry = GyroOdometry::new(CarPose::default(), Defects::default());
        for travel in [5.0, 5.5, 0.0, 0.25, f64::NAN] {
            odometry.update(travel, 0.0);
        }
        assert_eq!(odometry.pose().x_m, 0.75);
    }
}
