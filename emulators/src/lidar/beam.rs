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

#[cfg(test)]
mod tests {
    use super::*;

    fn is(found: Point, x: f64, y: f64) -> bool {
        found.distance(Point::new(x, y)) < 1e-12
    }

    /// The robot stands at (1, 2) and looks along y. The sensor is half a metre ahead and a quarter
    /// to the left, and its beam leaves 0.1 m to the left of its axis.
    #[test]
    fn a_beam_begins_at_its_sensor() {
        let pose = Pose::new(1.0, 2.0, PI / 2.0);
        let mount = Mount {
            x_m: 0.5,
            y_m: 0.25,
            yaw_deg: 0.0,
        };
        let beam = Beam::aim(pose, Instant::ZERO, mount, 0.0, 0.0, 0.1);
        assert!(is(beam.from, 0.65, 2.5) && is(beam.ahead, 0.0, 1.0));
        assert!(is(beam.place(2.0), 0.65, 4.5) && is(beam.aside(1.0), -0.35, 2.5));
        let plain = Beam::aim(pose, Instant::ZERO, mount, 0.0, 0.0, 0.0);
        assert!(is(plain.from, 0.75, 2.5));
        let turned = Beam::aim(pose, Instant::ZERO, mount, 60.0, PI / 6.0, 0.0);
        assert!(is(turned.ahead, -1.0, 0.0) && (turned.angle - PI).abs() < 1e-12);
        for (x_m, y_m, x, y) in [(0.5, 0.0, 1.0, 2.5), (0.0, 0.5, 0.5, 2.0)] {
            let mount = Mount {
                x_m,
                y_m,
                yaw_deg: 0.0,
            };
            assert!(is(
                Beam::aim(pose, Instant::ZERO, mount, 0.0, 0.0, 0.0).from,
                x,
                y
            ));
        }
    }

    /// Mean 0, deviation 1 and no number beyond 3.5, of 20,000; each from one draw.
    #[test]
    fn the_noise_of_a_beam_is_normal() {
        let mut rng = Rng::stream(1, "noise");
        let all: Vec<f64> = (0..20_000).map(|_| normal(&mut rng)).collect();
        let mean = all.iter().sum::<f64>() / 20_000.0;
        let square = all.iter().map(|one| one * one).sum::<f64>() / 20_000.0;
        assert!(
            mean.abs() < 0.03 && (square - 1.0).abs() < 0.03,
            "{mean} {square}"
        );
        assert!(all.iter().all(|one| one.abs() < 3.47));
        assert!(all.iter().any(|one| *one > 3.0) && all.iter().any(|one| *one < -3.0));
        let mut drawn = Rng::stream(1, "noise");
        let bits = drawn.next_u64();
        let parts = [0, 16, 32, 48].map(|shift| (bits >> shift) % 65_536);
        let sum: f64 = parts.iter().map(|part| *part as f64).sum();
        let by_hand = (sum - 131_070.0) / 65_536.0 * 3.0_f64.sqrt();
        assert!((all[0] - by_hand).abs() < 1e-9);
    }
}
