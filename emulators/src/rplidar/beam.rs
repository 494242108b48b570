//! One beam: from a position and a direction in the world to a distance.
//!
//! The sensor triangulates: its beam leaves [`ASIDE_M`] to the right of the axis of rotation and
//! looks [`BACK_DEG`] behind the head's zero, so the angle at which a point lies depends on its
//! distance. The figures are those that the vendor's public SDK takes off the head's angle
//! (`handler_capsules.cpp`, capsules of the kind 0x84).

use core::f64::consts::PI;

use protocols::Instant;

use crate::lidar::Mount;
use crate::lidar::beam::{Beam, normal};
use crate::rng::Rng;
use crate::world::World;

/// Minimum distance of a measurement (LD108).
const RANGE_MIN_MM: f64 = 150.0;
/// Standard deviation of a distance, as a part of it. LD108 says below 1 %; the noise is limited to
/// 3.5 deviations.
const RANGE_SIGMA: f64 = 0.0025;
/// Angular jitter of a beam. A guess.
const JITTER_RAD: f64 = 0.05 * PI / 180.0;
/// Distance of the beam's origin from the axis, metres.
const ASIDE_M: f64 = 0.024_014;
/// Angle of the beam behind the head's zero, degrees.
const BACK_DEG: f64 = 8.0;
/// Angle of a point at 1 m behind the head's zero: the angles of a turn count from there.
pub(super) const ZERO_DEG: f64 = 6.624;
/// If the dot falls on two surfaces, one is measured if it has more light than the other by this
/// share. A guess, fitted to the shares of real turns (see FIDELITY).
const EDGE_STEP: f64 = 0.04;
/// Half of the dot's width as an angle. A guess: about the size of a collimated diode's dot at 2 m.
const DOT_RAD: f64 = 0.35 * PI / 180.0;
/// Share of the samples of a plain surface that are lost by chance. A guess.
const LOST: f64 = 0.015;
/// Spots on surfaces that never give a measurement (black, shiny, a screw): their size in metres,
/// and one spot in how many. Guesses.
const SPOT_M: f64 = 0.04;
const SPOT_ONE_IN: u64 = 16;
/// Light that a sample needs, relative to a white wall at the greatest distance, and its variation
/// from sample to sample (standard deviation, parts of it): specks. Guesses.
const SPECK: f64 = 0.15;

/// Result of one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Seen {
    /// Quarters of a millimetre; 0 without a measurement.
    pub(super) distance_q2: u16,
    /// Angle of the point behind the head's zero, degrees; 0 without a measurement.
    pub(super) lead_deg: f64,
    /// Light divided by the minimum light of a measurement; at least 1 where something was
    /// measured.
    pub(super) light: f64,
}

/// The optics with their noise.
#[derive(Clone, Debug)]
pub(super) struct Optics {
    mount: Mount,
    /// Whether the sensor measures no distance at all.
    pub(super) dark: bool,
    /// Reported distance divided by measured distance.
    pub(super) range_factor: f64,
    /// Error of the turn's beginning, degrees clockwise.
    pub(super) turned_deg: f64,
    /// The head seems to turn in the other direction.
    pub(super) mirrored: bool,
    beam: Rng,
    range: Rng,
    /// Specks, and samples that are lost.
    light: Rng,
}

impl Optics {
    pub(super) const fn new(mount: Mount, [beam, range, light]: [Rng; 3]) -> Self {
        Self {
            mount,
            dark: false,
            range_factor: 1.0,
            turned_deg: 0.0,
            mirrored: false,
            beam,
            range,
            light,
        }
    }

    /// Measurement of the head at `angle_deg`, clockwise, [`ZERO_DEG`] behind its zero. The number
    /// of draws does not depend on the result.
    pub(super) fn measure(
        &mut self,
        world: &World,
        at: Instant,
        angle_deg: f64,
        range_max_mm: f64,
    ) -> Seen {
        let (jitter, noise) = (normal(&mut self.beam), normal(&mut self.range));
        let speck = 1.0 + SPECK * normal(&mut self.light);
        let is_lost = self.light.chance(LOST);
        let pose = world.pose_at(at);
        let cast = |aside_rad: f64| {
            let clockwise = angle_deg + ZERO_DEG - BACK_DEG + self.turned_deg;
            let side = if self.mirrored { 1.0 } else { -1.0 };
            let degrees = self.mount.yaw_deg + side * clockwise;
            let jitter = JITTER_RAD * jitter + aside_rad;
            let beam = Beam::aim(pose, at, self.mount, degrees, jitter, side * ASIDE_M);
            let hit = beam.cast(world.scene(), range_max_mm / 1e3);
            hit.map(|hit| (beam, hit))
        };
        let Some((beam, hit)) = cast(0.0).filter(|_| !self.dark) else {
            return Seen::default();
        };
        let metres = libm::hypot(hit.distance, ASIDE_M);
        let mm = metres * 1e3;
        // Light falls off with the square of the distance; the range is meant for a white wall.
        let reach = range_max_mm / mm;
        let light = hit.reflectivity * (hit.incidence * 2.0).min(1.0) * reach * reach * speck;
        let is_at_edge = || {
            let sides = [DOT_RAD, -DOT_RAD].map(cast);
            sides.iter().any(|side| {
                let far = side.map_or(f64::INFINITY, |(_, side)| side.distance);
                (far - hit.distance).abs() > EDGE_STEP * hit.distance
            })
        };
        let is_unseen = mm < RANGE_MIN_MM || light < 1.0 || is_lost;
        if is_unseen || is_spot(beam, hit.distance) || is_at_edge() {
            return Seen::default();
        }
        let noisy = mm * (1.0 + RANGE_SIGMA * noise) * self.range_factor;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a cast of a float saturates"
        )]
        let distance_q2 = (noisy * 4.0 + 0.5) as u16;
        Seen {
            distance_q2,
            lead_deg: BACK_DEG - libm::asin(ASIDE_M / metres) * (180.0 / PI),
            light,
        }
    }
}

/// Whether the beam ends on a place that never gives a measurement: fixed in the world, drawn by
/// its place alone.
fn is_spot(beam: Beam, metres: f64) -> bool {
    let cell = |at: f64| {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a cast of a float saturates"
        )]
        let cell = libm::floor(at / SPOT_M + 0.3) as i64;
        cell.cast_unsigned()
    };
    let place = beam.place(metres);
    let (x, y) = (cell(place.x), cell(place.y));
    // Two rounds of a multiplicative hash, so that neighbours are independent.
    let mut mixed = x.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    mixed = (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (mixed ^ mixed >> 32) % SPOT_ONE_IN == 0
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

    /// A robot at the origin before a wall ahead at `far_m`, turned by `slant` radians from square.
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
        let streams = ["beam", "range", "light"].map(|name| Rng::stream(3, name));
        Optics::new(AHEAD, streams)
    }

    /// Distance in most of 40 looks, millimetres: chance and a spot may cost some.
    fn look(optics: &mut Optics, world: &World, degrees: f64) -> f64 {
        // A beam that looks along the robot's x is 8 degrees behind the head's zero.
        let at = |k: i32| degrees + BACK_DEG - ZERO_DEG + f64::from(k) * 0.1;
        let mut seen: Vec<f64> = (-20..20)
            .map(|k| {
                f64::from(
                    optics
                        .measure(world, Instant::ZERO, at(k), 6_000.0)
                        .distance_q2,
                )
            })
            .collect();
        seen.sort_by(f64::total_cmp);
        seen[24] / 4.0
    }

    /// Jitter is 0.05 degrees, noise a quarter of a percent, each times the next number of its own
    /// stream. The beam leaves 24 mm aside, so the distance to a square wall at 1 m is the
    /// hypotenuse. The result is in quarters of a millimetre, rounded, here 1.1 times too long.
    #[test]
    fn a_distance_has_the_noise_of_its_streams() {
        let world = world(1.0, 0.0, 1.0);
        let mut optics = optics();
        optics.range_factor = 1.1;
        let (mut beam, mut range) = (Rng::stream(3, "beam"), Rng::stream(3, "range"));
        let mut measured = 0;
        for _ in 0..50 {
            let jitter = 0.05_f64.to_radians() * normal(&mut beam);
            // The beam turns about the point where it leaves: 24 mm aside of the axis.
            let along = (1_000.0 - 24.014 * libm::sin(jitter)) / libm::cos(jitter);
            let mm = libm::hypot(along, 24.014) * (1.0 + 0.0025 * normal(&mut range));
            let seen = optics.measure(&world, Instant::ZERO, BACK_DEG - ZERO_DEG, 6_000.0);
            if seen.distance_q2 > 0 {
                let off = f64::from(seen.distance_q2) - mm * 1.1 * 4.0;
                assert!(off.abs() <= 0.6, "{off} quarters of a millimetre");
                // 8 degrees less the angle whose sine is 24.014 / 1000.
                assert!((seen.lead_deg - 6.624).abs() < 0.01, "{}", seen.lead_deg);
                measured += 1;
            }
        }
        assert!(measured > 40, "{measured}");
    }

    /// A grey wall with a quarter of the light is visible up to half of the range. A slanted wall
    /// counts in full up to 60 degrees. Nearer than 150 mm the sensor sees nothing. Specks take or
    /// add up to half of the light, so a fifth of the distance.
    #[test]
    fn dark_walls_are_seen_less_far() {
        let is_seen = |far_m, slant: f64, reflectivity| {
            let world = world(far_m, slant.to_radians(), reflectivity);
            look(&mut optics(), &world, 0.0) > 0.0
        };
        assert!(is_seen(2.6, 0.0, 0.25) && !is_seen(3.6, 0.0, 0.25));
        assert!(is_seen(5.3, 0.0, 1.0) && !is_seen(6.05, 0.0, 1.0));
        assert!(is_seen(5.2, 55.0, 1.0) && is_seen(2.6, 55.0, 0.25));
        // Twice the cosine of 75 degrees is 0.5176, whose root is 0.7195: 4.317 m.
        assert!(is_seen(3.6, 75.0, 1.0) && !is_seen(5.2, 75.0, 1.0));
        assert!(is_seen(0.153, 0.0, 1.0) && !is_seen(0.145, 0.0, 1.0));
    }

    /// The wall is 1 m ahead. 30 degrees to either side it is 1.155 m away; behind the robot is
    /// none. A sensor whose turn begins 30 degrees later, or that is mounted so, shifts its angles
    /// by 30 degrees.
    #[test]
    fn angles_run_clockwise_unless_the_head_is_mirrored() {
        let world = world(1.0, 20_f64.to_radians(), 1.0);
        let at = |optics: &mut Optics, degrees| look(optics, &world, degrees) / 1e3;
        // The wall's normal points 20 degrees to the left: 0.9397 m / cos(angle - 20). The beam
        // leaves 24 mm aside and is looked along from there: up to 3 % at these angles.
        let metres = |left: f64| {
            let cos = |degrees: f64| libm::cos(degrees.to_radians());
            cos(20.0) / cos(left - 20.0)
        };
        let is = |found: f64, expected: f64| (found / expected - 1.0).abs() < 0.06;
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

    /// Two surfaces in one dot give no measurement. A post of 4 cm, 1 m before a wall of 3 m, has
    /// lost samples at both sides; the wall beside it loses samples only by chance.
    #[test]
    fn f13_edges_and_spots_give_no_measurement() {
        let post = [(1.0, -0.02), (1.04, -0.02), (1.04, 0.02), (1.0, 0.02)];
        let wall = [(3.0, -4.0), (3.1, -4.0), (3.1, 4.0), (3.0, 4.0)];
        let shape = |corners: [(f64, f64); 4]| Shape::Polygon {
            corners: corners.map(|(x, y)| Point::new(x, y)).to_vec(),
        };
        let scene = Scene::new([shape(post), shape(wall)], vec![]).expect("outlines");
        let body = BodyConfig {
            radius_m: 0.02,
            ..BodyConfig::default().ideal()
        };
        let world = World::new(scene, body, Pose::default(), 1).expect("free");
        let mut optics = optics();
        let mut lost = |from: f64, to: f64| {
            let looks = 400;
            let angle = |k: i32| from + (to - from) * f64::from(k) / f64::from(looks);
            let lost = (0..looks).filter(|&k| {
                let seen = optics.measure(&world, Instant::ZERO, angle(k), 12_000.0);
                seen.distance_q2 == 0
            });
            lost.count() * 100 / 400
        };
        // The post is 2.3 degrees wide; 0.35 degrees to each side of its edges are lost.
        let around_the_post = lost(BACK_DEG - ZERO_DEG - 4.0, BACK_DEG - ZERO_DEG + 2.0);
        assert!((18..=60).contains(&around_the_post), "{around_the_post} %");
        let plain = lost(8.0, 40.0);
        assert!((3..=14).contains(&plain), "{plain} %");
    }
    /// Whether the place `(x, y)`, in cells of 4 cm, is a spot.
    fn is_spot_at(x: f64, y: f64) -> bool {
        let pose = Pose::default();
        let mount = Mount {
            x_m: -1.0,
            y_m: y * 0.04,
            yaw_deg: 0.0,
        };
        let beam = Beam::aim(pose, Instant::ZERO, mount, 0.0, 0.0, 0.0);
        is_spot(beam, 1.0 + x * 0.04)
    }

    /// Of 40,000 cells one in 16 is a spot, and of neighbours one pair in 256, sideways, ahead and
    /// aslant: 2,500 and 156, to four standard deviations.
    #[test]
    fn one_cell_in_sixteen_is_a_spot_whatever_its_neighbours_are() {
        let cells =
            || (-100..100).flat_map(|x| (-100..100).map(move |y| (f64::from(x), f64::from(y))));
        let both = |(dx, dy): (f64, f64)| {
            let pairs = cells().filter(|&(x, y)| is_spot_at(x, y) && is_spot_at(x + dx, y + dy));
            pairs.count()
        };
        let all = both((0.0, 0.0));
        assert!((2_300..2_700).contains(&all), "{all}");
        for way in [
            (1.0, 0.0),
            (0.0, 1.0),
            (1.0, 1.0),
            (1.0, -1.0),
            (0.0, 2.0),
            (2.0, 0.0),
        ] {
            let pairs = both(way);
            assert!((106..206).contains(&pairs), "{way:?}: {pairs}");
        }
    }

    /// A cell extends from 0.3 of its edge before a whole number to 0.7 behind it.
    #[test]
    fn a_spot_has_the_size_of_its_cell() {
        for step in 0..200 {
            let cell = f64::from(step);
            let ends = [-0.29, 0.69];
            let along = ends.map(|end| is_spot_at(cell + end, 5.0));
            let across = ends.map(|end| is_spot_at(5.0, cell + end));
            assert!(along[0] == along[1] && across[0] == across[1], "{step}");
        }
    }

    /// The nine spots of 13 x 13 cells, as a second implementation of the two rounds finds them:
    /// multiplied by 9E3779B97F4A7C15 and C2B2AE3D27D4EB4F, mixed, multiplied by BF58476D1CE4E5B9.
    #[test]
    fn a_spot_stays_where_it_is() {
        let cells = (-6..=6).flat_map(|x| (-6..=6).map(move |y| (x, y)));
        let spots = cells.filter(|&(x, y)| is_spot_at(f64::from(x), f64::from(y)));
        let expected = [
            (-6, -1),
            (-3, -2),
            (-2, 3),
            (-2, 6),
            (0, -6),
            (0, 0),
            (0, 3),
            (2, -6),
            (5, -6),
        ];
        assert!(spots.eq(expected));
    }
}
