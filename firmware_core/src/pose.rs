//! Poses: position in millimetres, heading in radians, and changes of both.
//!
//! Heading 0 points along +x and grows counter-clockwise, as everywhere in the project. The PC link
//! uses whole millimetres and clockwise degrees instead, with `psi = 180 - heading`: psi 90 drives
//! to +y, psi 0 to -x, psi 180 to +x. That conversion happens here and nowhere else.

use core::f32::consts::{PI, TAU};

/// Sine and cosine of `angle` by `libm`, so that the bits are equal on every host.
pub fn sin_cos(angle: f32) -> (f32, f32) {
    libm::sincosf(angle)
}

/// `angle` brought into (-pi, pi].
pub fn normalised(angle: f32) -> f32 {
    if angle > -PI && angle <= PI {
        return angle;
    }
    let turned = angle - TAU * libm::ceilf((angle - PI) / TAU);
    turned.clamp(-PI, PI)
}

/// A point in the plane, in millimetres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Along x, or forward in the robot's own frame.
    pub x_mm: f32,
    /// Along y, or to the left in the robot's own frame.
    pub y_mm: f32,
}

impl Point {
    /// The point at these coordinates.
    pub const fn new(x_mm: f32, y_mm: f32) -> Self {
        Self { x_mm, y_mm }
    }

    /// Distance to `other`.
    pub fn distance_mm(self, other: Self) -> f32 {
        libm::hypotf(self.x_mm - other.x_mm, self.y_mm - other.y_mm)
    }
}

/// Position and heading.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Along x.
    pub x_mm: f32,
    /// Along y.
    pub y_mm: f32,
    /// Radians, counter-clockwise from +x, in (-pi, pi].
    pub heading: f32,
}

/// A change of pose, relative to the pose before: first the shift, then the turn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseChange {
    /// Along the heading before the change.
    pub forward_mm: f32,
    /// To the left of the heading before the change.
    pub left_mm: f32,
    /// Radians, counter-clockwise.
    pub turn: f32,
}

/// A pose as the PC link carries it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WirePose {
    /// Along x, whole millimetres.
    pub x_mm: i16,
    /// Along y, whole millimetres.
    pub y_mm: i16,
    /// Clockwise degrees, 0 to 359.
    pub psi_deg: i16,
}

impl PoseChange {
    /// No change.
    pub const NONE: Self = Self {
        forward_mm: 0.0,
        left_mm: 0.0,
        turn: 0.0,
    };

    /// Length of the shift.
    pub fn distance_mm(self) -> f32 {
        libm::hypotf(self.forward_mm, self.left_mm)
    }

    /// The change that undoes this one.
    pub fn inverse(self) -> Self {
        let (sin, cos) = sin_cos(self.turn);
        Self {
            forward_mm: -(cos * self.forward_mm + sin * self.left_mm),
            left_mm: sin * self.forward_mm - cos * self.left_mm,
            turn: -self.turn,
        }
    }

    /// This change, then `next`.
    pub fn then(self, next: Self) -> Self {
        let (sin, cos) = sin_cos(self.turn);
        Self {
            forward_mm: self.forward_mm + cos * next.forward_mm - sin * next.left_mm,
            left_mm: self.left_mm + sin * next.forward_mm + cos * next.left_mm,
            turn: normalised(self.turn + next.turn),
        }
    }
}

impl Pose {
    /// The pose at these coordinates; the heading is normalised.
    pub fn new(x_mm: f32, y_mm: f32, heading: f32) -> Self {
        Self {
            x_mm,
            y_mm,
            heading: normalised(heading),
        }
    }

    /// The pose after `change`.
    #[must_use]
    pub fn then(self, change: PoseChange) -> Self {
        let (sin, cos) = sin_cos(self.heading);
        Self::new(
            self.x_mm + cos * change.forward_mm - sin * change.left_mm,
            self.y_mm + sin * change.forward_mm + cos * change.left_mm,
            self.heading + change.turn,
        )
    }

    /// The change that leads from here to `target`.
    pub fn change_to(self, target: Self) -> PoseChange {
        let (sin, cos) = sin_cos(self.heading);
        let (dx, dy) = (target.x_mm - self.x_mm, target.y_mm - self.y_mm);
        PoseChange {
            forward_mm: cos * dx + sin * dy,
            left_mm: cos * dy - sin * dx,
            turn: normalised(target.heading - self.heading),
        }
    }

    /// Converts a point of the robot's frame to the world's.
    pub fn to_world(self, point: Point) -> Point {
        let (sin, cos) = sin_cos(self.heading);
        Point {
            x_mm: self.x_mm + cos * point.x_mm - sin * point.y_mm,
            y_mm: self.y_mm + sin * point.x_mm + cos * point.y_mm,
        }
    }

    /// The position without the heading.
    pub const fn position(self) -> Point {
        Point {
            x_mm: self.x_mm,
            y_mm: self.y_mm,
        }
    }

    /// The pose for the PC link: rounded, saturated, psi normalised to 0..360. (The fielded code
    /// let psi grow without bound, and its PC program reads it as unsigned.)
    pub fn to_wire(self) -> WirePose {
        let psi_deg = round_to_i16(180.0 - self.heading.to_degrees()).rem_euclid(360);
        WirePose {
            x_mm: round_to_i16(self.x_mm),
            y_mm: round_to_i16(self.y_mm),
            psi_deg,
        }
    }

    /// The pose of a message from the PC link.
    pub fn from_wire(wire: WirePose) -> Self {
        let heading = (180.0 - f32::from(wire.psi_deg)).to_radians();
        Self::new(f32::from(wire.x_mm), f32::from(wire.y_mm), heading)
    }
}

/// Nearest whole number; not-a-number becomes 0.
fn round_to_i16(value: f32) -> i16 {
    let rounded = libm::roundf(value);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "saturates, which is what is wanted"
    )]
    let whole = rounded as i16;
    whole
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::FRAC_PI_2;
    use proptest::prelude::*;

    fn near(a: f32, b: f32, tolerance: f32) -> bool {
        (a - b).abs() <= tolerance
    }

    /// Seed report, chapter on the PC link: psi 90 drives to +y, psi 0 to -x, psi 180 to +x.
    #[test]
    fn psi_runs_clockwise_from_minus_x() {
        let ahead = PoseChange {
            forward_mm: 100.0,
            ..PoseChange::NONE
        };
        let drive = |psi_deg| {
            let end = Pose::from_wire(WirePose {
                x_mm: 0,
                y_mm: 0,
                psi_deg,
            })
            .then(ahead)
            .to_wire();
            (end.x_mm, end.y_mm, end.psi_deg)
        };
        assert_eq!(drive(90), (0, 100, 90));
        assert_eq!(drive(0), (-100, 0, 0));
        assert_eq!(drive(180), (100, 0, 180));
        assert_eq!(drive(270), (0, -100, 270));
    }

    /// Defect SL-13 of the fielded code: psi grows without bound and wraps in the 16-bit field.
    #[test]
    fn psi_on_the_wire_stays_within_a_turn() {
        let turned = |heading| Pose::new(0.0, 0.0, heading).to_wire().psi_deg;
        assert_eq!(turned(1000.0 * TAU + FRAC_PI_2), 90);
        assert_eq!(turned(PI), 0);
        assert_eq!(turned(-PI + 1e-4), 0);
        assert_eq!(turned(-FRAC_PI_2), 270);
    }

    #[test]
    fn positions_beyond_the_wire_saturate() {
        let far = Pose::new(40_000.0, -40_000.0, f32::NAN).to_wire();
        assert_eq!((far.x_mm, far.y_mm), (i16::MAX, i16::MIN));
    }

    #[test]
    fn a_quarter_turn_maps_forward_to_left() {
        let pose = Pose::new(10.0, 20.0, FRAC_PI_2);
        let tip = pose.to_world(Point::new(100.0, 5.0));
        assert!(
            near(tip.x_mm, 5.0, 1e-3) && near(tip.y_mm, 120.0, 1e-3),
            "{tip:?}"
        );
    }

    /// 100 mm ahead, 50 mm to the left and a quarter turn to the left. The start is then 50 mm
    /// behind and 100 mm to the left; the same change once more ends 50 mm ahead, 150 mm to the
    /// left.
    #[test]
    fn a_change_with_a_quarter_turn_is_undone_and_added_by_hand() {
        let change = PoseChange {
            forward_mm: 100.0,
            left_mm: 50.0,
            turn: FRAC_PI_2,
        };
        let is_near = |found: PoseChange, [forward, left, turn]: [f32; 3]| {
            near(found.forward_mm, forward, 1e-3)
                && near(found.left_mm, left, 1e-3)
                && near(found.turn, turn, 1e-6)
        };
        let back = change.inverse();
        assert!(is_near(back, [-50.0, 100.0, -FRAC_PI_2]), "{back:?}");
        let twice = change.then(change);
        assert!(is_near(twice, [50.0, 150.0, PI]), "{twice:?}");
        let still = change.then(back);
        assert!(is_near(still, [0.0; 3]), "{still:?}");
        assert!(near(change.distance_mm(), 111.803, 1e-2));
    }

    proptest! {
        #[test]
        fn normalised_angles_lie_within_half_a_turn(angle in -1e4_f32..1e4) {
            let n = normalised(angle);
            prop_assert!(n > -PI - 1e-6 && n <= PI);
            let (s0, c0) = sin_cos(angle);
            let (s1, c1) = sin_cos(n);
            prop_assert!(near(s0, s1, 2e-3) && near(c0, c1, 2e-3));
        }

        #[test]
        fn a_change_leads_where_it_was_measured(
            x in -3e3_f32..3e3, y in -3e3_f32..3e3, a in -3.0_f32..3.0,
            f in -500.0_f32..500.0, l in -500.0_f32..500.0, t in -3.0_f32..3.0,
        ) {
            let from = Pose::new(x, y, a);
            let change = PoseChange { forward_mm: f, left_mm: l, turn: t };
            let to = from.then(change);
            let back = from.change_to(to);
            prop_assert!(near(back.forward_mm, f, 0.01) && near(back.left_mm, l, 0.01));
            prop_assert!(near(normalised(back.turn - t), 0.0, 1e-5));
            let home = to.then(change.inverse());
            prop_assert!(home.position().distance_mm(from.position()) < 0.01);
            let still = change.then(change.inverse());
            prop_assert!(still.distance_mm() < 0.01);
        }
    }
}
