//! Direction of a beam, and its noise.

use core::f64::consts::PI;

use protocols::Instant;

use super::Mount;
use crate::rng::Rng;
use crate::world::{Hit, Point, Pose, Scene};

/// A beam in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beam {
    pub(crate) at: Instant,
    pub(crate) from: Point,
    /// Radians, counter-clockwise from the world's x.
    pub(crate) angle: f64,
    /// Unit vector in this direction: three uses share one sine and cosine.
    pub(crate) ahead: Point,
}

impl Beam {
    /// The beam of a sensor at `mount` of a robot at `pose`, `degrees` counter-clockwise from the
    /// robot's forward axis. The beam leaves `offset_m` to the left of the sensor's axis.
    pub(crate) fn aim(
        pose: Pose,
        at: Instant,
        mount: Mount,
        degrees: f64,
        jitter_rad: f64,
        offset_m: f64,
    ) -> Self {
        let angle = pose.theta + degrees * (PI / 180.0) + jitter_rad;
        let mut from = pose.point();
        if mount.x_m != 0.0 || mount.y_m != 0.0 {
            from = pose.offset(mount.x_m, mount.y_m);
        }
        let (sin, cos) = libm::sincos(angle);
        let ahead = Point::new(cos, sin);
        if offset_m != 0.0 {
            from = beside(from, ahead, offset_m);
        }
        Self {
            at,
            from,
            angle,
            ahead,
        }
    }

    /// The place `metres` along the beam.
    pub(crate) fn place(&self, metres: f64) -> Point {
        Point::new(
            self.from.x + metres * self.ahead.x,
            self.from.y + metres * self.ahead.y,
        )
    }

    /// The point `left_m` to the left of the beam's begin.
    pub(crate) fn aside(&self, left_m: f64) -> Point {
        beside(self.from, self.ahead, left_m)
    }

    /// First hit in `scene` within `reach` metres.
    pub(crate) fn cast(&self, scene: &Scene, reach: f64) -> Option<Hit> {
        scene.cast_ahead(self.at, (self.from, self.angle, self.ahead), reach)
    }
}

/// Standard normal to 3.5 sigma: the sum of four 16-bit numbers. One draw, and a tenth of the time
/// of an exact one; a sensor's noise has no longer tails.
pub(crate) fn normal(rng: &mut Rng) -> f64 {
    let bits = rng.next_u64();
    let sum = (bits & 0xFFFF) + (bits >> 16 & 0xFFFF) + (bits >> 32 & 0xFFFF) + (bits >> 48);
    let sum = u32::try_from(sum).expect("four 16-bit numbers fit 18 bits");
    (f64::from(sum) - 131_070.0) * (3.0_f64.sqrt() / 65_536.0)
}

/// The point `left_m` to the left of `from`, looking along the unit vector `ahead`.
fn beside(from: Point, ahead: Point, left_m: f64) -> Point {
    Point::new(from.x - left_m * ahead.y, from.y + left_m * ahead.x)
}
