//! Poses and motions in double precision: metres and radians.

use emulators::world::{Pose, wrap_angle};

/// `to` relative to `from`.
pub fn between(from: Pose, to: Pose) -> Pose {
    let (sin, cos) = (libm::sin(from.theta), libm::cos(from.theta));
    let (dx, dy) = (to.x - from.x, to.y - from.y);
    Pose::new(
        cos * dx + sin * dy,
        cos * dy - sin * dx,
        wrap_angle(to.theta - from.theta),
    )
}

/// The pose after the motion `by` from `from`.
pub fn moved(from: Pose, by: Pose) -> Pose {
    let (sin, cos) = (libm::sin(from.theta), libm::cos(from.theta));
    Pose::new(
        from.x + cos * by.x - sin * by.y,
        from.y + sin * by.x + cos * by.y,
        wrap_angle(from.theta + by.theta),
    )
}

/// Distance between two poses, metres.
pub fn distance(a: Pose, b: Pose) -> f64 {
    libm::hypot(a.x - b.x, a.y - b.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;

    /// From (1, 2), facing +y, a position 3 ahead and 1 to the left is (0, 5).
    #[test]
    fn a_motion_leads_where_it_was_seen() {
        let from = Pose::new(1.0, 2.0, FRAC_PI_2);
        let to = moved(from, Pose::new(3.0, 1.0, 0.5));
        assert!((to.x - 0.0).abs() < 1e-12 && (to.y - 5.0).abs() < 1e-12);
        let back = between(from, to);
        assert!((back.x - 3.0).abs() < 1e-12 && (back.theta - 0.5).abs() < 1e-12);
        assert!((distance(from, to) - 10_f64.sqrt()).abs() < 1e-12);
    }
}
