//! The emulated sensor in the room of a capture, so that a comparison does not depend on the room.
//!
//! Distances and strengths of each degree, as medians over turns, give a piece of wall and its
//! reflectivity. The teeth of the ring are uneven, and emulated surfaces have a texture of their
//! own. So the room is built, measured, and corrected until the emulated medians are those of the
//! capture.

use protocols::{Instant, Port};

use super::turns::{Turn, steady};
use crate::device::Device as _;
use crate::world::{BodyConfig, Fixture, Point, Pose, Scene, Shape, World};
use crate::xv11::{Config, Detail, MotorSupply, Mount, Profile, Xv11};

/// Degrees of a turn.
pub(super) const DEGREES: usize = 360;
/// A degree belongs to the room if at least this share of its turns has a distance,
const SEEN: f64 = 0.6;
/// and if at least this share of the distances is near their median.
const STILL: f64 = 0.6;
/// Rounds of building and measuring, and turns of a measurement.
const ROUNDS: usize = 5;
const TURNS: usize = 30;
/// Part of a difference that a round corrects: the measured medians have noise.
const CORRECTED: f64 = 0.7;
/// Time until the head turns evenly.
const SPIN_UP: Instant = Instant::from_millis(3_000);

/// A place of the room: distance and strength of a degree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spot {
    pub(super) mm: f64,
    pub(super) strength: f64,
}

impl Spot {
    /// Whether a distance is of this place, and not of something before it.
    pub(super) fn is_at(self, mm: f64) -> bool {
        (mm - self.mm).abs() <= 3.0 + 0.015 * self.mm
    }
}

/// Spots that a sensor at rest measured repeatedly.
pub(super) type Room = Vec<Option<Spot>>;

fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// The room of `turns`.
pub(super) fn room<'a>(turns: impl Iterator<Item = &'a Turn> + Clone) -> Room {
    let count = turns.clone().count() as f64;
    let spot = |degree: usize| {
        let ranges: Vec<_> = turns
            .clone()
            .filter_map(|turn| turn.range(degree))
            .collect();
        let mut distances: Vec<f64> = ranges.iter().map(|(mm, _)| *mm).collect();
        let found = Spot {
            mm: median(&mut distances)?,
            strength: 0.0,
        };
        let near: Vec<_> = ranges.iter().filter(|(mm, _)| found.is_at(*mm)).collect();
        let mut strengths: Vec<f64> = near.iter().map(|(_, strength)| *strength).collect();
        let seen = ranges.len() as f64;
        let is_room = seen >= SEEN * count && near.len() as f64 >= STILL * seen;
        // The mean of distances tells more than their median, which is a whole number.
        let mm = near.iter().map(|(mm, _)| mm).sum::<f64>() / near.len().max(1) as f64;
        let strength = median(&mut strengths)?;
        is_room.then_some(Spot { mm, strength })
    };
    (0..DEGREES).map(spot).collect()
}

/// Turns of the emulated sensor in `wanted`.
pub(super) struct Twin {
    profile: Profile,
    built: Room,
}

impl Twin {
    /// A sensor in a room as built, without corrections.
    pub(super) const fn new(profile: Profile, built: Room) -> Self {
        Self { profile, built }
    }

    /// Builds the room and corrects it.
    pub(super) fn of(profile: Profile, wanted: &Room) -> Self {
        let mut twin = Self::new(profile, wanted.clone());
        for round in 0..ROUNDS {
            let seed = 1_000 + round as u64;
            let measured = room(twin.turns(seed, TURNS).iter());
            for ((built, wanted), measured) in twin.built.iter_mut().zip(wanted).zip(measured) {
                if let (Some(built), Some(wanted), Some(found)) = (built, wanted, measured) {
                    built.mm = (built.mm + CORRECTED * (wanted.mm - found.mm)).clamp(30.0, 2e4);
                    let ratio = wanted.strength / found.strength.max(1.0);
                    built.strength *= 1.0 + CORRECTED * (ratio - 1.0);
                }
            }
        }
        twin
    }

    /// The first steady `count` turns of the unit with this `seed`.
    pub(super) fn turns(&self, seed: u64, count: usize) -> Vec<Turn> {
        let config = Config {
            profile: self.profile,
            supply: MotorSupply::Fixed { volts: 3.3 },
            detail: Detail::Captured,
            mount: Mount {
                yaw_deg: 0.0,
                ..Mount::default()
            },
            ..Config::default()
        };
        let mut lidar = Xv11::new("lidar", seed, config);
        let mut world = self.world();
        // A turn takes 0.2 s.
        let millis = 230 * (count as u64 + 2);
        let end = SPIN_UP + core::time::Duration::from_millis(millis);
        let mut bytes = Vec::new();
        let mut buf = [0; 1024];
        const PORT: Port = Xv11::UART;
        while let Some(at) = lidar.poll_at().filter(|&at| at < end) {
            lidar.poll(at, &mut world);
            let len = lidar.transmit(PORT, &mut buf);
            if at >= SPIN_UP {
                bytes.extend_from_slice(&buf[..len]);
            }
        }
        let mut turns = steady(&bytes);
        turns.truncate(count);
        turns
    }

    /// A piece of wall for each degree, from half a degree before it to half a degree behind it.
    fn world(&self) -> World {
        let at = |degree: usize| self.built[degree % DEGREES];
        let point = |degrees: f64, mm: f64| {
            let (sin, cos) = libm::sincos(degrees.to_radians());
            Point::new(mm / 1e3 * cos, mm / 1e3 * sin)
        };
        let wall = |degree: usize| {
            let spot = at(degree)?;
            // The border to a neighbour lies between both, unless there is an edge.
            let border = |other: Option<Spot>| match other {
                Some(other) if (other.mm - spot.mm).abs() < 30.0 + 0.03 * spot.mm => {
                    (spot.mm + other.mm) / 2.0
                }
                _ => spot.mm,
            };
            let [before, behind] = [at(degree + DEGREES - 1), at(degree + 1)].map(border);
            let angle = degree as f64;
            let ends = [
                (angle - 0.5, before),
                (angle, spot.mm),
                (angle + 0.5, behind),
            ];
            let [from, middle, to] = ends.map(|(angle, mm)| point(angle, mm.max(30.0)));
            // A scene takes no more than 100; reflective tape is beyond it from 4.5 m on.
            let reflectivity = (spot.strength * spot.mm * spot.mm / 1e8).clamp(0.0, 100.0);
            Some([(from, middle), (middle, to)].map(|(from, to)| Fixture {
                shape: Shape::Wall { from, to },
                reflectivity,
                height_m: f64::INFINITY,
                is_glass: false,
            }))
        };
        let walls: Vec<Fixture> = (0..DEGREES).filter_map(wall).flatten().collect();
        let scene = Scene::new(walls, vec![]).expect("walls of a measured room");
        let body = BodyConfig {
            radius_m: 0.02,
            ..BodyConfig::default().ideal()
        };
        World::new(scene, body, Pose::default(), 0).expect("nothing is nearer than 3 cm")
    }
}

#[cfg(test)]
mod tests {
    use protocols::xv11::Reading;

    use super::*;

    /// A distance may differ by 3 mm and 1.5 %, which is 18 mm at 1 m.
    #[test]
    fn a_distance_is_of_the_place_it_is_near() {
        let spot = Spot {
            mm: 1_000.0,
            strength: 100.0,
        };
        assert!(spot.is_at(1_000.0) && spot.is_at(1_018.0) && spot.is_at(982.0));
        assert!(!spot.is_at(1_018.1) && !spot.is_at(981.9) && !spot.is_at(0.0));
    }

    /// Ten turns. Degree 0: six distances of 1000 and 1010 mm, strengths 90 to 95, the others are
    /// invalid. Degree 1: five distances. Degree 2: ten, of which a person hides five at 500 mm.
    /// Degree 3: the same with four, whose strengths do not count.
    #[test]
    fn a_spot_is_what_most_turns_show() {
        let range = |distance_mm, strength| Reading::Range {
            distance_mm,
            strength,
            weak: false,
        };
        let none = Reading::Invalid {
            code: 0x21,
            strength: 0,
        };
        let turns: Vec<Turn> = (0..10_u16)
            .map(|turn| {
                let hidden = |by: u16, range| match turn < by {
                    true => range_of_a_person(),
                    false => range,
                };
                let mut readings = vec![none; DEGREES];
                if turn < 6 {
                    readings[0] = range(1_000 + turn % 2 * 10, 90 + turn);
                }
                if turn < 5 {
                    readings[1] = range(1_000, 90);
                }
                readings[2] = hidden(5, range(1_000, 90));
                readings[3] = hidden(4, range(1_000, 90));
                Turn {
                    speeds_rpm: Vec::new(),
                    readings,
                    packets: Vec::new(),
                }
            })
            .collect();
        let room = room(turns.iter());
        let spot = |mm, strength| Some(Spot { mm, strength });
        assert_eq!(
            room[..4],
            [spot(1_005.0, 93.0), None, None, spot(1_000.0, 90.0)]
        );
        assert!(room[4..].iter().all(Option::is_none));
    }

    fn range_of_a_person() -> Reading {
        Reading::Range {
            distance_mm: 500,
            strength: 300,
            weak: false,
        }
    }

    /// The emulated surfaces have a texture of their own: a room as built is off by 0.5 mm and 14 %
    /// of the strength, a corrected one by a fifth of them at most.
    #[test]
    fn a_twin_measures_the_room_of_the_capture() {
        let spot = |degree: usize| {
            let cos = libm::cos((degree as f64 % 90.0 - 45.0).to_radians());
            Some(Spot {
                mm: 700.0 / cos,
                strength: 190.0 * cos * cos,
            })
        };
        let wanted: Room = (0..DEGREES).map(spot).collect();
        let far = |twin: &Twin| {
            let found = room(twin.turns(77, TURNS).iter());
            let both = found.iter().zip(&wanted).skip(3).step_by(4);
            let both: Vec<_> = both.filter_map(|(a, b)| Some(((*a)?, (*b)?))).collect();
            assert!(both.len() > 70, "{}", both.len());
            let mean = |of: &dyn Fn(&(Spot, Spot)) -> f64| {
                both.iter().map(of).sum::<f64>() / both.len() as f64
            };
            [
                mean(&|(found, wanted)| (found.mm - wanted.mm).abs()),
                mean(&|(found, wanted)| (found.strength / wanted.strength - 1.0).abs()),
            ]
        };
        let built = far(&Twin::new(Profile::Fw24, wanted.clone()));
        let corrected = far(&Twin::of(Profile::Fw24, &wanted));
        assert!(built[0] > 0.3 && built[1] > 0.1, "{built:?}");
        assert!(corrected[0] < 0.2 && corrected[1] < 0.03, "{corrected:?}");
    }
}
