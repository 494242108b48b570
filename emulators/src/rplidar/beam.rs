//! One beam: from a place and a direction in the world to a distance.

use core::f64::consts::PI;

use protocols::Instant;

use crate::lidar::Mount;
use crate::lidar::beam::{Beam, normal};
use crate::rng::Rng;
use crate::world::World;

/// Nearer than this there is no measurement (LD108).
const RANGE_MIN_MM: f64 = 150.0;
/// Standard deviation of a distance, parts of it. LD108 says below 1 %; the noise has no tails
/// beyond 3.5 of them.
const RANGE_SIGMA: f64 = 0.0025;
/// Angular jitter of a beam. A guess.
const JITTER_RAD: f64 = 0.05 * PI / 180.0;

/// The optics with their noise.
#[derive(Clone, Debug)]
pub(super) struct Optics {
    mount: Mount,
    /// Nothing is seen.
    pub(super) dark: bool,
    /// Distance told by distance measured.
    pub(super) range_factor: f64,
    /// Where the turn begins, degrees clockwise from where it should.
    pub(super) turned_deg: f64,
    /// The head seems to turn the other way.
    pub(super) mirrored: bool,
    beam: Rng,
    range: Rng,
}

impl Optics {
    pub(super) const fn new(mount: Mount, beam: Rng, range: Rng) -> Self {
        Self {
            mount,
            dark: false,
            range_factor: 1.0,
            turned_deg: 0.0,
            mirrored: false,
            beam,
            range,
        }
    }

    /// The distance at `angle_deg` (clockwise), quarters of a millimetre; 0 without a measurement.
    /// Draws the same numbers whatever is seen.
    pub(super) fn measure(
        &mut self,
        world: &World,
        at: Instant,
        angle_deg: f64,
        range_max_mm: f64,
    ) -> u16 {
        let (jitter, noise) = (normal(&mut self.beam), normal(&mut self.range));
        let clockwise = angle_deg + self.turned_deg;
        let left = if self.mirrored { clockwise } else { -clockwise };
        let degrees = self.mount.yaw_deg + left;
        let beam = Beam::aim(world, at, self.mount, degrees, JITTER_RAD * jitter, 0.0);
        let hit = world.cast_ray_at(at, beam.from, beam.angle, range_max_mm / 1e3);
        let Some(hit) = hit.filter(|_| !self.dark) else {
            return 0;
        };
        let mm = hit.distance * 1e3;
        // Light falls off with the square of the distance; the range is meant for a white wall.
        let light = hit.reflectivity * (hit.incidence * 2.0).min(1.0);
        if mm < RANGE_MIN_MM || mm > range_max_mm * light.max(0.0).sqrt() {
            return 0;
        }
        let noisy = mm * (1.0 + RANGE_SIGMA * noise) * self.range_factor;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a cast of a float saturates"
        )]
        let distance_q2 = (noisy * 4.0 + 0.5) as u16;
        distance_q2
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{BodyConfig, Fixture, Point, Pose, Scene, Shape};

    const AHEAD: Mount = Mount {
        x_m: 0.0,
        y_m: 0.0,
        yaw_deg: 0.0,
    };

    /// A robot at the origin before a wall that crosses its way at `far_m`, turned by `slant`
    /// radians from square.
    fn world(far_m: f64, slant: f64, reflectivity: f64) -> World {
        let (sin, cos) = libm::sincos(slant);
        let end = |along: f64| Point::new(far_m - along * sin, along * cos);
        let wall = Fixture {
            shape: Shape::Wall {
                from: end(-3.0),
                to: end(3.0),
            },
            reflectivity,
            height_m: f64::INFINITY,
            is_glass: false,
        };
        let scene = Scene::new([wall], vec![]).expect("a wall");
        let body = BodyConfig {
            radius_m: 0.02,
            ..BodyConfig::default().ideal()
        };
        World::new(scene, body, Pose::default(), 1).expect("free")
    }

    fn optics() -> Optics {
        Optics::new(AHEAD, Rng::stream(3, "beam"), Rng::stream(3, "range"))
    }

    /// Jitter is 0.05 degrees, noise a quarter of a percent, each times the next number of its own
    /// stream; a square wall at 1 m is 1 / cos of the jitter away. Told in quarters of a
    /// millimetre, the nearest one, here 1.1 times too long.
    #[test]
    fn a_distance_has_the_noise_of_its_streams() {
        let world = world(1.0, 0.0, 1.0);
        let mut optics = optics();
        optics.range_factor = 1.1;
        let (mut beam, mut range) = (Rng::stream(3, "beam"), Rng::stream(3, "range"));
        for _ in 0..50 {
            let jitter = 0.05_f64.to_radians() * normal(&mut beam);
            let mm = 1_000.0 / libm::cos(jitter) * (1.0 + 0.0025 * normal(&mut range));
            let expected = mm * 1.1 * 4.0;
            let found = optics.measure(&world, Instant::ZERO, 0.0, 6_000.0);
            assert!(
                (f64::from(found) - expected).abs() <= 0.501,
                "{found} {expected}"
            );
        }
    }

    /// A grey wall of a quarter of the light is seen as far as half of the range; one that is
    /// slanted counts in full up to 60 degrees. Nearer than 150 mm nothing is.
    #[test]
    fn dark_walls_are_seen_less_far() {
        let is_seen = |far_m, slant: f64, reflectivity| {
            let world = world(far_m, slant.to_radians(), reflectivity);
            optics().measure(&world, Instant::ZERO, 0.0, 6_000.0) > 0
        };
        assert!(is_seen(2.95, 0.0, 0.25) && !is_seen(3.05, 0.0, 0.25));
        assert!(is_seen(5.95, 0.0, 1.0) && !is_seen(6.05, 0.0, 1.0));
        assert!(is_seen(5.9, 55.0, 1.0) && is_seen(2.9, 55.0, 0.25));
        // Twice the cosine of 75 degrees is 0.5176, whose root is 0.7195: 4.317 m.
        assert!(is_seen(4.25, 75.0, 1.0) && !is_seen(4.4, 75.0, 1.0));
        assert!(is_seen(0.151, 0.0, 1.0) && !is_seen(0.149, 0.0, 1.0));
    }

    /// The wall is 1 m ahead; 30 degrees to either side it is 1.155 m away, and behind it is not.
    /// A sensor whose turn begins 30 degrees later, or that is mounted so, sees it by that.
    #[test]
    fn angles_run_clockwise_unless_the_head_is_mirrored() {
        let world = world(1.0, 20_f64.to_radians(), 1.0);
        let at = |optics: &mut Optics, degrees| {
            f64::from(optics.measure(&world, Instant::ZERO, degrees, 6_000.0)) / 4_000.0
        };
        // The wall's normal points 20 degrees to the left: 0.9397 m / cos(angle - 20).
        let metres = |left: f64| {
            let cos = |degrees: f64| libm::cos(degrees.to_radians());
            cos(20.0) / cos(left - 20.0)
        };
        let is = |found: f64, expected: f64| (found / expected - 1.0).abs() < 0.015;
        assert!(is(at(&mut optics(), 30.0), metres(-30.0)));
        assert!(is(at(&mut optics(), -30.0), metres(30.0)));
        let mut mirrored = optics();
        mirrored.mirrored = true;
        assert!(is(at(&mut mirrored, 30.0), metres(30.0)));
        let mut turned = optics();
        turned.turned_deg = 30.0;
        assert!(is(at(&mut turned, 10.0), metres(-40.0)));
        turned.mount.yaw_deg = 50.0;
        assert!(is(at(&mut turned, 10.0), metres(10.0)));
        assert_eq!(at(&mut optics(), 180.0), 0.0);
        let mut dark = optics();
        dark.dark = true;
        assert_eq!(at(&mut dark, 0.0), 0.0);
    }
}
