//! Drives along a wall at a distance: proportional and derivative control of the steering angle.
//!
//! Seed 003, mission I; its developers dropped the integral part because it had no visible effect.
//! The gains are not published; these follow from the car's lateral motion, `y'' = v^2 / k *
//! angle`: natural frequency and damping of 0.6 /s and 1 at 0.22 m/s (specification A4).

/// Side of the wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// To the left.
    Left,
    /// To the right.
    Right,
}

/// Gains of the controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// Steering by distance, rad/m.
    pub proportional: f64,
    /// Steering by the distance's change, rad s/m.
    pub derivative: f64,
    /// Steering by the distance's sum, rad/(m s); the seed's was dropped.
    pub integral: f64,
    /// Share of a new reading in the smoothed change.
    pub smoothing: f64,
}

impl Default for Gains {
    fn default() -> Self {
        Self {
            proportional: 1.92,
            derivative: 6.4,
            integral: 0.0,
            smoothing: 0.15,
        }
    }
}

/// Controller of the distance to a wall.
#[derive(Clone, Debug)]
pub struct WallDistance {
    side: Side,
    wanted_m: f64,
    gains: Gains,
    before_m: Option<f64>,
    change_m_s: f64,
    sum_m_s: f64,
}

impl WallDistance {
    /// A controller that keeps `wanted_m` to the wall on `side`.
    pub const fn new(side: Side, wanted_m: f64, gains: Gains) -> Self {
        Self {
            side,
            wanted_m,
            gains,
            before_m: None,
            change_m_s: 0.0,
            sum_m_s: 0.0,
        }
    }

    /// Takes a reading, `passed_s` after the one before; returns the steering angle, radians, to
    /// the left positive.
    pub fn update(&mut self, distance_m: f64, passed_s: f64) -> f64 {
        if !distance_m.is_finite() || passed_s <= 0.0 {
            return 0.0;
        }
        let before_m = self.before_m.replace(distance_m);
        let change = before_m.map_or(0.0, |before| (distance_m - before) / passed_s);
        self.change_m_s += self.gains.smoothing * (change - self.change_m_s);
        let error = distance_m - self.wanted_m;
        self.sum_m_s += error * passed_s;
        let towards = self.gains.proportional * error
            + self.gains.derivative * self.change_m_s
            + self.gains.integral * self.sum_m_s;
        match self.side {
            Side::Left => towards,
            Side::Right => -towards,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::steering;
    use super::*;
    use crate::ackermann::{CarGeometry, CarPose};
    use crate::random::Pcg32;

    /// The drive of specification A4: 0.22 m/s, wheelbase 0.258 m, steering by the table, readings
    /// of a whole centimetre each 65 ms with 5 mm of noise; distances each 65 ms.
    fn drive(side: Side, start_m: f64, gains: Gains, seed: u32) -> [f64; 460] {
        let car = CarGeometry {
            wheelbase_m: 0.258,
            track_m: 0.155,
        };
        let mut random = Pcg32::new(u64::from(seed));
        let mut noise = move || {
            (0..12)
                .map(|_| f64::from(random.below(1_000)) / 1e3)
                .sum::<f64>()
                - 6.0
        };
        let mut control = WallDistance::new(side, 0.40, gains);
        let sign = if side == Side::Right { 1.0 } else { -1.0 };
        let mut pose = CarPose {
            y_m: sign * start_m,
            ..CarPose::default()
        };
        core::array::from_fn(|_| {
            let distance = sign * pose.y_m;
            let seen = libm::round((distance + 0.005 * noise()) * 100.0) / 100.0;
            let wanted = control.update(seen, 0.065).to_degrees();
            let value = steering::value_for(wanted).unwrap();
            let angle = steering::angle_deg(value).to_radians();
            pose = pose.then(car.rear_arc(angle, 0.22 * 0.065));
            distance
        })
    }

    fn rms(distances: &[f64]) -> f64 {
        let squares = distances
            .iter()
            .map(|distance| (distance - 0.40) * (distance - 0.40));
        libm::sqrt(squares.sum::<f64>() / distances.len() as f64)
    }

    /// AP8: a car that starts at 0.60 m or 0.25 m is within 0.40 +- 0.03 m after 8 s (123
    /// readings). From then on its error is 1 cm rms, and it never touches the wall; 20 seeds, both
    /// sides.
    #[test]
    fn ap8_the_distance_is_kept() {
        for seed in 0..20 {
            for (side, start_m) in [
                (Side::Right, 0.60),
                (Side::Left, 0.60),
                (Side::Right, 0.25),
                (Side::Left, 0.25),
            ] {
                let distances = drive(side, start_m, Gains::default(), seed);
                let later = &distances[123..];
                let worst = later
                    .iter()
                    .map(|distance| (distance - 0.40).abs())
                    .fold(0.0, f64::max);
                assert!(
                    worst <= 0.03,
                    "seed {seed}, {side:?} from {start_m}: {worst}"
                );
                assert!(
                    rms(later) <= 0.01,
                    "seed {seed}, {side:?} from {start_m}: {}",
                    rms(later)
                );
                assert!(distances.iter().all(|distance| *distance > 0.17));
            }
        }
    }

    /// D1: the integral part has no visible effect: less than 5 mm rms of difference.
    #[test]
    fn d1_the_integral_part_does_nothing_that_is_seen() {
        let with = drive(
            Side::Right,
            0.60,
            Gains {
                integral: 0.01,
                ..Gains::default()
            },
            3,
        );
        let without = drive(Side::Right, 0.60, Gains::default(), 3);
        let both = with
            .iter()
            .zip(without)
            .map(|(one, other)| (one - other) * (one - other));
        let difference = libm::sqrt(both.sum::<f64>() / 460.0);
        assert!(difference < 0.005 && difference > 0.0, "{difference}");
    }

    #[test]
    fn a_reading_that_is_none_steers_nowhere() {
        let mut control = WallDistance::new(Side::Left, 0.4, Gains::default());
        assert_eq!(control.update(f64::NAN, 0.1), 0.0);
        assert_eq!(control.update(1.0, 0.0), 0.0);
        assert!(control.update(0.5, 0.1) > 0.0);
    }
}
