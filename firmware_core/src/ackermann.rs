//! Motion of a car with a steered front axle: from steering angle and travel to motion, and back.
//!
//! ```text
//!            ahead
//!              ^
//!   front axle |/ steering angle, to the left positive
//!              +
//!   wheelbase  |
//!              +   rear axle: turns about a point on its own line, k / tan(angle) to the left
//!     left <---+
//! ```
//!
//! Either of two points describes the car's position: the middles of its two axles. Both move along
//! arcs about the same centre. Source of the front axle's equations: seed 003, chapter on odometry;
//! its inverse has three wrong signs. They are corrected here; failing tests show the original
//! signs. The code uses double precision because it runs on a PC on the car.

use core::f64::consts::{PI, TAU};

/// Dimensions of a car that its odometry needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarGeometry {
    /// Distance between the axles.
    pub wheelbase_m: f64,
    /// Distance between the wheels of an axle.
    pub track_m: f64,
}

/// A motion as seen from the pose before it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Along the heading before.
    pub ahead_m: f64,
    /// To the left of the heading before.
    pub left_m: f64,
    /// Change of the heading, counter-clockwise.
    pub turn_rad: f64,
}

impl Motion {
    /// The motion that undoes this one.
    #[must_use]
    pub fn inverse(self) -> Self {
        CarPose::default().then(self).motion_to(CarPose::default())
    }
}

/// A pose in double precision: metres and radians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CarPose {
    /// Along x.
    pub x_m: f64,
    /// Along y.
    pub y_m: f64,
    /// Counter-clockwise from x, in (-pi, pi].
    pub heading_rad: f64,
}

impl CarPose {
    /// The pose after `motion`.
    #[must_use]
    pub fn then(self, motion: Motion) -> Self {
        let (sin, cos) = libm::sincos(self.heading_rad);
        Self {
            x_m: self.x_m + cos * motion.ahead_m - sin * motion.left_m,
            y_m: self.y_m + sin * motion.ahead_m + cos * motion.left_m,
            heading_rad: wrapped(self.heading_rad + motion.turn_rad),
        }
    }

    /// The motion that leads from here to `target`.
    pub fn motion_to(self, target: Self) -> Motion {
        let (sin, cos) = libm::sincos(self.heading_rad);
        let (dx, dy) = (target.x_m - self.x_m, target.y_m - self.y_m);
        Motion {
            ahead_m: cos * dx + sin * dy,
            left_m: cos * dy - sin * dx,
            turn_rad: wrapped(target.heading_rad - self.heading_rad),
        }
    }

    /// The pose of a point on the same body, `ahead_m` metres in front of this one. From the rear
    /// axle to the front axle that is the wheelbase; in the other direction it is negative.
    #[must_use]
    pub fn shifted(self, ahead_m: f64) -> Self {
        let along = Motion {
            ahead_m,
            ..Motion::default()
        };
        self.then(along)
    }

    /// Distance to `other`; the headings do not count.
    pub fn distance_m(self, other: Self) -> f64 {
        self.distance_to([other.x_m, other.y_m])
    }

    /// Distance to a position, metres.
    pub fn distance_to(self, [x_m, y_m]: [f64; 2]) -> f64 {
        libm::hypot(self.x_m - x_m, self.y_m - y_m)
    }

    /// The point, metres, that has the same position relative to `other` as the given point has
    /// relative to `self`.
    pub fn carried(self, other: Self, [x_m, y_m]: [f64; 2]) -> [f64; 2] {
        let heading_rad = self.heading_rad;
        let place = other.then(self.motion_to(Self {
            x_m,
            y_m,
            heading_rad,
        }));
        [place.x_m, place.y_m]
    }
}

impl CarGeometry {
    /// Motion of the rear axle's middle along an arc of `path_m` metres, backwards if it is
    /// negative. The steering angle must be less than a quarter turn.
    pub fn rear_arc(&self, steering_rad: f64, path_m: f64) -> Motion {
        let turn_rad = path_m * libm::tan(steering_rad) / self.wheelbase_m;
        arc(path_m, turn_rad)
    }

    /// As [`rear_arc`](Self::rear_arc), for the middle of the front axle, which has moved `path_m`:
    /// it rolls along the steered wheels.
    pub fn front_arc(&self, steering_rad: f64, path_m: f64) -> Motion {
        let (sin, cos) = libm::sincos(steering_rad);
        let turn_rad = path_m * sin / self.wheelbase_m;
        let seen = arc(path_m, turn_rad);
        // Along the wheels, which point sideways.
        Motion {
            ahead_m: cos * seen.ahead_m - sin * seen.left_m,
            left_m: sin * seen.ahead_m + cos * seen.left_m,
            turn_rad,
        }
    }

    /// Steering angle and travel of the front axle that move it to `ahead_m`, `left_m` on the
    /// shorter path, backwards if that path is shorter. `None` if the target is the current
    /// position or is not finite.
    pub fn front_inverse(&self, ahead_m: f64, left_m: f64) -> Option<(f64, f64)> {
        let (x, y, k) = (-left_m, ahead_m, self.wheelbase_m);
        let square = x * x + y * y;
        if !square.is_finite() || square == 0.0 {
            return None;
        }
        let steering = match x == 0.0 {
            // The point two wheelbases behind gives a quotient of two zeros.
            true => 0.0,
            false => libm::atan(2.0 * x * k / (-square - 2.0 * y * k)),
        };
        if !steering.is_finite() {
            return None;
        }
        if steering == 0.0 {
            return Some((0.0, y));
        }
        let radius = k / libm::sin(steering).abs();
        let centre = k / libm::tan(steering);
        let way = match steering > 0.0 {
            true => libm::atan2(y + k, x + centre) - steering,
            false => PI + steering - libm::atan2(y + k, x + centre),
        };
        Some((steering, wrapped(way) * radius))
    }

    /// Travel of the rear axle's middle when its left wheel has moved `wheel_m`.
    pub fn rear_of_left_wheel(&self, steering_rad: f64, wheel_m: f64) -> f64 {
        let turn_per_m = libm::tan(steering_rad) / self.wheelbase_m;
        wheel_m / (1.0 - turn_per_m * self.track_m / 2.0)
    }

    /// Travel of the front axle's middle when the rear axle's has moved `rear_m`.
    pub fn front_of_rear(&self, steering_rad: f64, rear_m: f64) -> f64 {
        rear_m / libm::cos(steering_rad)
    }

    /// Steering angle at which the car turns at `turn_rad_s` while its rear axle goes at
    /// `speed_m_s`; 0 at rest.
    pub fn steering_for(&self, turn_rad_s: f64, speed_m_s: f64) -> f64 {
        match speed_m_s == 0.0 {
            true => 0.0,
            false => libm::atan(self.wheelbase_m * turn_rad_s / speed_m_s),
        }
    }
}

/// Motion along an arc of length `path_m` that starts straight ahead and turns by `turn_rad`.
fn arc(path_m: f64, turn_rad: f64) -> Motion {
    let half = turn_rad / 2.0;
    let (sin, cos) = libm::sincos(half);
    // The chord starts at half the turn. For a short arc use the series, because the quotient would
    // lose digits.
    let chord = match half.abs() < 1e-4 {
        true => path_m * (1.0 - half * half / 6.0),
        false => path_m * sin / half,
    };
    Motion {
        ahead_m: chord * cos,
        left_m: chord * sin,
        turn_rad,
    }
}

/// `angle` brought into (-pi, pi].
pub fn wrapped(angle: f64) -> f64 {
    if angle > -PI && angle <= PI {
        return angle;
    }
    angle - TAU * libm::ceil((angle - PI) / TAU)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use proptest::prelude::*;

    use super::*;

    const CAR: CarGeometry = CarGeometry {
        wheelbase_m: 0.25,
        track_m: 0.155,
    };

    /// Numerical integration of the car's differential equations (the front axle rolls along its
    /// wheels): 1000 steps of fourth order. The reference for the closed forms.
    fn integrated(steering: f64, path: f64) -> CarPose {
        let (steps, mut pose) = (1_000, CarPose::default());
        let step = path / f64::from(steps);
        let rate = libm::sin(steering) / CAR.wheelbase_m;
        for _ in 0..steps {
            // The heading changes uniformly, so Simpson's rule over it is the method of fourth
            // order.
            let along = |part: f64| libm::sincos(pose.heading_rad + steering + rate * step * part);
            let [(s0, c0), (s1, c1), (s2, c2)] = [0.0, 0.5, 1.0].map(along);
            pose.x_m += step * (c0 + 4.0 * c1 + c2) / 6.0;
            pose.y_m += step * (s0 + 4.0 * s1 + s2) / 6.0;
            pose.heading_rad = wrapped(pose.heading_rad + rate * step);
        }
        pose
    }

    proptest! {
        /// AP6: the front axle's equations against the differential equations, up to 2.6 rad round
        /// the circle, forwards and backwards.
        #[test]
        fn ap6_the_forward_equations_are_those_of_the_car(
            steering_deg in prop_oneof![2.0..25.0, -25.0..-2.0], way in -2.6..2.6_f64,
        ) {
            let steering = f64::to_radians(steering_deg);
            let path = way * CAR.wheelbase_m / libm::sin(steering).abs();
            let found = CarPose::default().then(CAR.front_arc(steering, path));
            let expected = integrated(steering, path);
            prop_assert!(found.distance_m(expected) < 1e-6, "{found:?} {expected:?}");
            prop_assert!(wrapped(found.heading_rad - expected.heading_rad).abs() < 1e-9);
            // The rear axle of the same car: a wheelbase behind, before and after the motion.
            let rear = CarPose::default().shifted(-CAR.wheelbase_m);
            let rear = rear.then(CAR.rear_arc(steering, path * libm::cos(steering)));
            prop_assert!(rear.shifted(CAR.wheelbase_m).distance_m(expected) < 1e-6);
        }

        /// AP6: the inverse undoes the forward equations for less than half a circle.
        #[test]
        fn ap6_the_inverse_undoes_the_forward_equations(
            steering_deg in prop_oneof![2.0..25.0, -25.0..-2.0], way in 0.01..3.1_f64,
            ahead: bool,
        ) {
            let steering = f64::to_radians(steering_deg);
            let way = if ahead { way } else { -way };
            let path = way * CAR.wheelbase_m / libm::sin(steering).abs();
            let motion = CAR.front_arc(steering, path);
            let (found, travel) = CAR.front_inverse(motion.ahead_m, motion.left_m).unwrap();
            prop_assert!((found - steering).abs() < 1e-9, "{found} for {steering}");
            prop_assert!((travel - path).abs() < 1e-9, "{travel} for {path}");
        }

        #[test]
        fn any_place_has_an_arc_or_none(ahead in -1e3..1e3_f64, left in -1e3..1e3_f64) {
            if let Some((steering, path)) = CAR.front_inverse(ahead, left) {
                let there = CAR.front_arc(steering, path);
                let off = libm::hypot(there.ahead_m - ahead, there.left_m - left);
                prop_assert!(off < 1e-6 * (1.0 + path.abs()), "{off}");
            }
        }
    }

    /// The report's inverse has three signs that are wrong, tried one by one: each makes the angle
    /// wrong by many degrees for most arcs.
    #[test]
    fn ap6_the_signs_of_the_report_are_wrong() {
        let k = CAR.wheelbase_m;
        let (mut steering_off, mut left_off, mut right_off) = (0, 0, 0);
        let mut count = 0;
        for deg in 2..=25 {
            for tenth in 1..=20 {
                count += 1;
                let (steering, way) = (f64::from(deg).to_radians(), f64::from(tenth) / 10.0);
                let radius = k / libm::sin(steering);
                let left = CAR.front_arc(steering, way * radius);
                let (x, y) = (-left.left_m, left.ahead_m);
                // (V): + 2 y k instead of - 2 y k.
                let seed = libm::atan(2.0 * x * k / (-x * x - y * y + 2.0 * y * k));
                steering_off += i32::from((seed - steering).abs() > 1_f64.to_radians());
                // (VII) for a left turn: + alpha instead of - alpha.
                let seed = libm::asin(((y + k) / radius).min(1.0)) + steering;
                left_off += i32::from((seed - way).abs() > 1_f64.to_radians());
                // (VII) for a right turn: the arc sine covers only half of the circle.
                let right = CAR.front_arc(-steering, way * radius);
                let sine = ((right.ahead_m + k) / radius).min(1.0);
                let seed = PI - steering - libm::asin(sine);
                right_off += i32::from((seed - way).abs() > 1_f64.to_radians());
            }
        }
        assert!(steering_off * 10 > count * 8, "{steering_off} of {count}");
        assert!(left_off * 10 > count * 8, "{left_off} of {count}");
        assert!(right_off * 10 > count * 4, "{right_off} of {count}");
    }

    /// Specification A3: the front axle travels 9.4 % more than the rear axle at 25 degrees to the
    /// left, the left rear wheel 14 % less than its axle.
    #[test]
    fn the_left_rear_wheel_goes_less_in_a_left_turn() {
        let steering = 25_f64.to_radians();
        let rear = CAR.rear_of_left_wheel(steering, 1.0);
        // The rear axle's radius is k / tan(25 degrees) = 0.5361 m. The left wheel's radius is
        // smaller by half the track: 0.4586 m, 0.8554 of the axle's. 1 / 0.8554 is 1.169.
        assert!((rear - 1.169).abs() < 0.001, "{rear}");
        assert!((CAR.rear_of_left_wheel(-steering, 1.0) - 0.874).abs() < 0.001);
        // The cosine of 25 degrees is 0.9063: 9.4 % less.
        assert!((1.0 / CAR.front_of_rear(steering, 1.0) - 0.906).abs() < 0.001);
        // Both together: 22.5 % less than the front axle.
        let front = CAR.front_of_rear(steering, rear);
        assert!((1.0 - 1.0 / front - 0.225).abs() < 0.002, "{front}");
    }

    #[test]
    fn a_straight_way_and_no_way_are_arcs_too() {
        let ahead = CAR.front_arc(0.0, -2.0);
        assert_eq!(
            (ahead.ahead_m, ahead.left_m, ahead.turn_rad),
            (-2.0, 0.0, 0.0)
        );
        assert_eq!(CAR.front_inverse(3.0, 0.0), Some((0.0, 3.0)));
        let behind = -2.0 * CAR.wheelbase_m;
        assert_eq!(CAR.front_inverse(behind, 0.0), Some((0.0, behind)));
        assert_eq!(CAR.front_inverse(0.0, 0.0), None);
        assert_eq!(CAR.front_inverse(f64::NAN, 1.0), None);
        assert_eq!(CAR.steering_for(1.0, 0.0), 0.0);
        // The turn rate at 25 degrees is tan(25 degrees) * 0.3 / 0.25 = 0.5596 rad/s.
        let steering = CAR.steering_for(0.5596, 0.3);
        assert!((steering.to_degrees() - 25.0).abs() < 0.01, "{steering}");
    }

    /// For a turn of t radians the chord has sin(t / 2) / (t / 2) of the arc's length and points t
    /// / 2 to the side. The car therefore gets sin(t) / t ahead and (1 - cos(t)) / t sideways. For
    /// 1.98e-4 rad the series give 1 - t^2 / 6 = 1 - 6.534e-9 and t / 2 = 9.9e-5. The code changes
    /// from the series to the quotient at 2e-4 rad.
    #[test]
    fn a_short_arc_keeps_its_digits() {
        let short = arc(3.0, 1.98e-4);
        assert!(
            (short.ahead_m / 3.0 - (1.0 - 6.534e-9)).abs() < 1e-14,
            "{short:?}"
        );
        assert!((short.left_m / 3.0 - 9.9e-5).abs() < 1e-12, "{short:?}");
        let (below, above) = (arc(3.0, 1.999_999e-4), arc(3.0, 2.000_001e-4));
        assert!((below.ahead_m - above.ahead_m).abs() < 1e-13);
        let quarter = arc(PI / 2.0, PI / 2.0);
        assert!((quarter.ahead_m - 1.0).abs() < 1e-12 && (quarter.left_m - 1.0).abs() < 1e-12);
    }
}
