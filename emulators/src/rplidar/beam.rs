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
