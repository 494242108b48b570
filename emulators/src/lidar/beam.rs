//! Direction of a beam, and its noise.

use core::f64::consts::PI;

use protocols::Instant;

use super::Mount;
use crate::rng::Rng;
use crate::world::{Point, World};

/// A beam in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beam {
    pub(crate) at: Instant,
    pub(crate) from: Point,
    /// Radians, counter-clockwise from the world's x.
    pub(crate) angle: f64,
}

impl Beam {
    /// The beam of a sensor at `mount`, `degrees` counter-clockwise from the robot's forward axis.
    /// The beam leaves `offset_m` to the left of the sensor's axis.
    pub(crate) fn aim(
        world: &World,
        at: Instant,
        mount: Mount,
        degrees: f64,
        jitter_rad: f64,
        offset_m: f64,
    ) -> Self {
        let pose = world.pose_at(at);
        let angle = pose.theta + degrees * (PI / 180.0) + jitter_rad;
        let mut from = pose.point();
        if mount.x_m != 0.0 || mount.y_m != 0.0 {
            from = pose.offset(mount.x_m, mount.y_m);
        }
        if offset_m != 0.0 {
            from = aside(from, angle, offset_m);
        }
        Self { at, from, angle }
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

/// The point `left_m` to the left of `from`, looking along `angle`.
pub(crate) fn aside(from: Point, angle: f64, left_m: f64) -> Point {
    let (sin, cos) = libm::sincos(angle);
    Point::new(from.x - left_m * sin, from.y + left_m * cos)
}
