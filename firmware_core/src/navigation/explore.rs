use core::f32::consts::FRAC_PI_2;

use super::{Settings, Surroundings, ticks};

/// Law of the wall follower.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WallLaw {
    /// The seed report's law: keeps the beam 50 degrees left of ahead at a fixed length. The law
    /// needs a wall at the start: without one the robot drives in circles.
    Beam,
    /// Keeps the nearest point (ahead or on the left) abeam and at a fixed distance. This also
    /// leads around inner and outer corners.
    Nearest,
}

/// Settings of the wall follower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallFollowing {
    /// Law of the wall follower.
    pub law: WallLaw,
    /// Target distance to the wall.
    pub distance_mm: f32,
    /// Maximum distance of a followed wall.
    pub lost_mm: f32,
    /// Distance ahead below which the robot turns away; only for the beam's law, which does not
    /// check ahead itself.
    pub front_mm: f32,
}

impl WallFollowing {
    /// The seed report's: 260 mm along the beam, obstacles within 300 mm.
    pub const DOCUMENT: Self = Self {
        law: WallLaw::Beam,
        distance_mm: 260.0,
        lost_mm: f32::INFINITY,
        front_mm: 300.0,
    };

    /// Around corners, with a little more room.
    pub const NEAREST: Self = Self {
        law: WallLaw::Nearest,
        distance_mm: 270.0,
        lost_mm: 700.0,
        front_mm: 330.0,
    };

    /// The seed report's rule for the length of the beam: reg = (260 - length) / 10, left = 20 +
    /// reg within 0 to 20, right = 20 - reg within -20 to 20.
    pub fn follow_beam(&self, length_mm: f32) -> [i8; 2] {
        let reg = (self.distance_mm - length_mm) / 10.0;
        [
            ticks((20.0 + reg).clamp(0.0, 20.0)),
            ticks((20.0 - reg).clamp(-20.0, 20.0)),
        ]
    }

    /// The bearing to steer for, with the wall's nearest point at `bearing` and `range_mm`.
    pub fn follow_nearest(&self, bearing: f32, range_mm: f32) -> f32 {
        let towards = (range_mm - self.distance_mm) * TOWARDS_PER_MM;
        bearing - FRAC_PI_2 + towards.clamp(-TOWARDS_MAX, TOWARDS_MAX)
    }
}

/// Half a degree towards the wall per millimetre too far from it, up to 40 degrees.
const TOWARDS_PER_MM: f32 = DEGREE / 2.0;
const TOWARDS_MAX: f32 = 40.0 * DEGREE;

/// Bearings in which the followed wall is searched.
const LEFT: core::ops::RangeInclusive<f32> = -45.0 * DEGREE..=150.0 * DEGREE;

/// Direction of the beam that measures the wall.
const WALL_BEARING: f32 = 50.0 * DEGREE;
/// Spread of neighbouring beams, which replace a missing reading.
const WALL_SPREAD: f32 = 3.0 * DEGREE;
/// A turn away from an obstacle continues until this much more is free.
const HYSTERESIS_MM: f32 = 60.0;

const DEGREE: f32 = core::f32::consts::PI / 180.0;

/// Turning speed on the spot, as of the fielded robot's avoider.
const TURN: i8 = 10;

/// Follows walls on the left.
#[derive(Clone, Debug)]
pub struct Explorer {
    /// Direction of an unfinished turn: 1 left, -1 right, 0 none.
    turning: i8,
}

impl Explorer {
    pub(super) const fn new() -> Self {
        Self { turning: 0 }
    }

    pub(super) fn step(&mut self, settings: &Settings, around: &Surroundings) -> [i8; 2] {
        let wall = &settings.wall;
        let cruise = [settings.steering.cruise; 2];
        match wall.law {
            WallLaw::Beam => self.turn_away(settings, around).unwrap_or_else(|| {
                around
                    .nearest(WALL_BEARING - WALL_SPREAD..=WALL_BEARING + WALL_SPREAD)
                    .map_or(cruise, |(_, length)| wall.follow_beam(length))
            }),
            WallLaw::Nearest => around
                .nearest(LEFT)
                .filter(|(_, range)| *range <= wall.lost_mm)
                .map_or(cruise, |(bearing, range)| {
                    settings
                        .steering
                        .towards(wall.follow_nearest(bearing, range))
                }),
        }
    }

    /// A turn away from an obstacle too near ahead; keeps its side until the path is free.
    fn turn_away(&mut self, settings: &Settings, around: &Surroundings) -> Option<[i8; 2]> {
        let (left, right) = front_mm(settings, around);
        let near = settings.wall.front_mm
            + if self.turning == 0 {
                0.0
            } else {
                HYSTERESIS_MM
            };
        if left.min(right) >= near {
            self.turning = 0;
            return None;
        }
        if self.turning == 0 {
            self.turning = if left <= right { -1 } else { 1 };
        }
        Some([-TURN * self.turning, TURN * self.turning])
    }
}

/// Nearest distances ahead, left and right of the middle, within the width that the body sweeps.
fn front_mm(settings: &Settings, around: &Surroundings) -> (f32, f32) {
    let half = settings.body.radius_mm + settings.body.clearance_mm / 2.0;
    let mut nearest = (f32::INFINITY, f32::INFINITY);
    for (point, range) in around.points() {
        let bearing = libm::atan2f(point.y_mm, point.x_mm);
        if point.y_mm.abs() > half || bearing.abs() > FRAC_PI_2 {
            continue;
        }
        let side = if point.y_mm >= 0.0 {
            &mut nearest.0
        } else {
            &mut nearest.1
        };
        *side = side.min(range);
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigation::Body;
    use crate::pose::Point;

    /// The seed report's law; obstacles ahead count within 160 + 45 / 2 = 182.5 mm of the middle.
    const SETTINGS: Settings = {
        let mut settings = Settings::new(Body {
            radius_mm: 160.0,
            clearance_mm: 45.0,
            tick_mm_s: 11.345,
            axle_mm: 260.0,
        });
        settings.wall = WallFollowing::DOCUMENT;
        settings
    };

    fn seen(points: &[(f32, f32)]) -> Surroundings {
        Surroundings::of(points.iter().map(|&(x, y)| Point::new(x, y)))
    }

    fn front(points: &[(f32, f32)]) -> (f32, f32) {
        front_mm(&SETTINGS, &seen(points))
    }

    /// Finding T5: 3-4-5 triangles. Points beside the body's width or behind the robot do not
    /// count.
    #[test]
    fn the_nearest_ahead_is_told_for_each_side() {
        const NONE: f32 = f32::INFINITY;
        assert_eq!(front(&[(240.0, 180.0), (400.0, 0.0)]), (300.0, NONE));
        assert_eq!(front(&[(240.0, -180.0), (400.0, 0.0)]), (400.0, 300.0));
        assert_eq!(front(&[(240.0, 182.0), (240.0, -183.0)]).1, NONE);
        assert!(front(&[(240.0, 182.0), (240.0, -183.0)]).0 < 302.0);
        assert_eq!(front(&[(-50.0, 100.0), (-50.0, -100.0)]), (NONE, NONE));
        assert_eq!(front(&[(0.0, 100.0), (0.0, -90.0)]), (100.0, 90.0));
    }

    /// Finding T5: from 300 mm on the robot turns away from the nearer side, until 360 mm are free;
    /// meanwhile it keeps its direction.
    #[test]
    fn what_is_near_ahead_is_turned_away_from() {
        let mut explorer = Explorer::new();
        let mut turn = |left: f32, right: f32| {
            explorer.turn_away(&SETTINGS, &seen(&[(left, 0.0), (right, -1.0)]))
        };
        assert_eq!(turn(300.0, 500.0), None);
        assert_eq!(turn(299.0, 500.0), Some([10, -10]));
        assert_eq!(turn(500.0, 250.0), Some([10, -10]));
        assert_eq!(turn(359.0, 500.0), Some([10, -10]));
        assert_eq!(turn(360.0, 500.0), None);
        assert_eq!(turn(359.0, 500.0), None);
        assert_eq!(turn(500.0, 290.0), Some([-10, 10]));
        assert_eq!(turn(200.0, 500.0), Some([-10, 10]));
        assert_eq!(turn(500.0, 500.0), None);
    }

    #[test]
    fn both_sides_alike_turn_to_the_right() {
        let mut explorer = Explorer::new();
        let around = seen(&[(240.0, 100.0), (240.0, -100.0)]);
        assert_eq!(explorer.turn_away(&SETTINGS, &around), Some([10, -10]));
    }

    /// Finding T5: a beam of 360 mm at 50 degrees is 100 mm too long, so the left wheel gets 10
    /// ticks and the right one 20. Beams within three degrees replace a missing one, others do not,
    /// and without a wall the robot drives straight on.
    #[test]
    fn the_beam_at_50_degrees_is_followed() {
        let step = |degrees: f32, length: f32| {
            let (sin, cos) = crate::pose::sin_cos(degrees.to_radians());
            Explorer::new().step(&SETTINGS, &seen(&[(length * cos, length * sin)]))
        };
        assert_eq!(
            [50.0, 47.1, 52.9].map(|degrees| step(degrees, 360.0)),
            [[10, 20]; 3]
        );
        assert_eq!(
            [46.9, 53.1, -50.0].map(|degrees| step(degrees, 360.0)),
            [[20, 20]; 3]
        );
        assert_eq!(step(50.0, 310.0), [15, 20]);
    }
}
