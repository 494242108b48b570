//! Obstacles that the lidar does not see: glass, which its beam passes, and objects lower than its
//! beam.
//!
//! The base's infrared sensors see them. An infrared echo without a lidar point nearby is added to
//! a list of positions. The robot's surroundings include these positions until a sensor measures
//! through them, and the current echoes at their exact positions.

use core::f32::consts::{FRAC_PI_2, PI};

use crate::navigation::Surroundings;
use crate::pose::{Point, Pose, sin_cos};

/// Infrared sensors of the base.
pub(super) const SENSORS: usize = 10;
/// Maximum number of stored positions; a new one then replaces the oldest. They cover five doors of
/// 90 cm.
const PLACES_MAX: usize = 80;
/// Minimum distance between stored positions.
const APART_MM: f32 = 60.0;
/// Maximum valid range of a sensor when the robot drives straight, and when it turns. A reading is
/// up to 0.25 s old; in that time a robot that steers for a goal turns by 11 degrees.
const BELIEVED_MM: f32 = 700.0;
const BELIEVED_TURNING_MM: f32 = 350.0;
/// Difference of the wheels' speeds, ticks per 40 ms, from which the robot turns.
const TURNING: u8 = 4;
/// A lidar point nearer than this to the sensor's echo is the same obstacle.
const SAME_MM: f32 = 130.0;
/// Margin before a sensor's echo, and half width of its line, within which positions are cleared.
const BEFORE_MM: f32 = 150.0;
const BESIDE_MM: f32 = 40.0;
/// Number of readings through a position that delete it.
const THROUGH: u8 = 3;

/// Reading of a base after its reset until the sensor is measured, up to 0.15 s. A real reading has
/// this value only by chance.
const UNMEASURED: i16 = 0;

/// Mount of a sensor: ahead and to the left, mm, and its bearing.
type Mount = [f32; 3];

/// Mounts in the order of the base's registers, 1 to 11 and 21 to 31. These are the mounts of the
/// emulated base. They are a guess, because the report shows pairs on four sides and no figures.
const MOUNTS: [Mount; SENSORS] = [
    [-130.0, -60.0, PI],
    [-60.0, -130.0, -FRAC_PI_2],
    [-60.0, 130.0, FRAC_PI_2],
    [-130.0, 60.0, PI],
    [150.0, 0.0, 0.0],
    [-150.0, 0.0, PI],
    [130.0, 60.0, 0.0],
    [60.0, 130.0, FRAC_PI_2],
    [60.0, -130.0, -FRAC_PI_2],
    [130.0, -60.0, 0.0],
];

/// A position in the map's frame.
#[derive(Clone, Copy, Debug)]
struct Place {
    at: Point,
    /// Number of readings through the position since the last echo there.
    through: u8,
}

/// The list of positions.
#[derive(Clone, Debug)]
pub(super) struct Blind {
    places: [Place; PLACES_MAX],
    count: usize,
    oldest: usize,
    /// Current echo of each sensor without a lidar point.
    met: [Option<Point>; SENSORS],
}

impl Blind {
    pub(super) const fn new() -> Self {
        let nowhere = Place {
            at: Point::new(0.0, 0.0),
            through: 0,
        };
        Self {
            places: [nowhere; PLACES_MAX],
            count: 0,
            oldest: 0,
            met: [None; SENSORS],
        }
    }

    /// Takes the sensors' readings, mm, at `pose`, with the lidar's points `around`; `speed` of the
    /// wheels in ticks per 40 ms.
    pub(super) fn take(
        &mut self,
        readings_mm: [i16; SENSORS],
        pose: Pose,
        around: &Surroundings,
        speed: [i8; 2],
    ) {
        let reach_mm = match speed[0].abs_diff(speed[1]) > TURNING {
            true => BELIEVED_TURNING_MM,
            false => BELIEVED_MM,
        };
        self.met = [None; SENSORS];
        let sensors = (0..).zip(MOUNTS).zip(readings_mm);
        for ((index, mount), reading) in sensors.filter(|(_, reading)| *reading != UNMEASURED) {
            let range_mm = f32::from(reading);
            self.look_through(mount, range_mm.min(reach_mm), pose);
            let [ahead, left, bearing] = mount;
            let (sin, cos) = sin_cos(bearing);
            let seen = Point::new(ahead + range_mm * cos, left + range_mm * sin);
            let is_shown = || {
                let mut points = around.points();
                points.any(|(point, _)| point.distance_mm(seen) < SAME_MM)
            };
            if range_mm < reach_mm && !is_shown() {
                let place = pose.to_world(seen);
                self.met[index] = Some(place);
                self.keep(place);
            }
        }
    }

    /// All stored positions and current echoes, relative to `pose`.
    pub(super) fn seen_from(&self, pose: Pose) -> impl Iterator<Item = Point> + '_ {
        let (sin, cos) = sin_cos(pose.heading);
        let kept = self.places[..self.count].iter().map(|place| place.at);
        kept.chain(self.met.into_iter().flatten()).map(move |at| {
            let (dx, dy) = (at.x_mm - pose.x_mm, at.y_mm - pose.y_mm);
            Point::new(cos * dx + sin * dy, cos * dy - sin * dx)
        })
    }

    fn keep(&mut self, at: Point) {
        let kept = &mut self.places[..self.count];
        let near = |place: &&mut Place| place.at.distance_mm(at) < APART_MM;
        if let Some(place) = kept.iter_mut().find(near) {
            place.through = 0;
            return;
        }
        let new = Place { at, through: 0 };
        if self.count < PLACES_MAX {
            self.places[self.count] = new;
            self.count += 1;
        } else {
            self.places[self.oldest] = new;
            self.oldest = (self.oldest + 1) % PLACES_MAX;
        }
    }

    /// Deletes positions that a sensor has measured through often enough.
    fn look_through(&mut self, [ahead, left, bearing]: Mount, range_mm: f32, pose: Pose) {
        let from = pose.to_world(Point::new(ahead, left));
        let (sin, cos) = sin_cos(pose.heading + bearing);
        let mut at = 0;
        while at < self.count {
            let place = &mut self.places[at];
            let (dx, dy) = (place.at.x_mm - from.x_mm, place.at.y_mm - from.y_mm);
            let (along, aside) = (cos * dx + sin * dy, cos * dy - sin * dx);
            if along > 0.0 && along < range_mm - BEFORE_MM && aside.abs() < BESIDE_MM {
                place.through += 1;
            }
            if place.through >= THROUGH {
                self.count -= 1;
                self.places[at] = self.places[self.count];
            } else {
                at += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use alloc::vec::Vec;

    use super::*;

    const AT_REST: [i8; 2] = [0, 0];
    const FRONT: usize = 4;

    /// Guards against a robot that, after its base was reset, stands in a ring of walls that no
    /// sensor sees.
    #[test]
    fn what_was_not_measured_is_no_wall() {
        let mut blind = Blind::new();
        blind.take([0; SENSORS], Pose::default(), &wall(), AT_REST);
        assert_eq!(places(&blind), []);
        blind.take([1; SENSORS], Pose::default(), &wall(), AT_REST);
        assert_eq!(places(&blind).len(), SENSORS);
    }

    /// Only the front sensor reads an obstacle within a metre.
    fn front(mm: i16) -> [i16; SENSORS] {
        let mut readings = [1_000; SENSORS];
        readings[FRONT] = mm;
        readings
    }

    /// A wall 2 m ahead.
    fn wall() -> Surroundings {
        let along = (-100..=100_i16).map(|n| Point::new(2_000.0, f32::from(n) * 10.0));
        Surroundings::of(along)
    }

    fn places(blind: &Blind) -> Vec<Point> {
        let kept = blind.places[..blind.count].iter();
        kept.map(|place| place.at).collect()
    }

    /// The sensor sits 150 mm ahead: a pane at 400 mm lies at 550. Turned to the left at (1, 2) m,
    /// that is (1, 2.55) m.
    #[test]
    fn what_only_the_infrared_sees_is_kept_in_the_map() {
        let mut blind = Blind::new();
        let pose = Pose::new(1_000.0, 2_000.0, FRAC_PI_2);
        blind.take(front(400), pose, &wall(), AT_REST);
        let [place] = places(&blind)[..] else {
            panic!("{:?}", places(&blind));
        };
        assert!(place.distance_mm(Point::new(1_000.0, 2_550.0)) < 0.5);
        // The position is stored, and is also the current echo.
        let seen: Vec<Point> = blind.seen_from(pose).collect();
        assert_eq!(seen.len(), 2);
        let is_there = |seen: &Point| seen.distance_mm(Point::new(550.0, 0.0)) < 0.5;
        assert!(seen.iter().all(is_there), "{seen:?}");
    }

    /// A pane that comes nearer by 40 mm is no new position, but the current echo follows it. The
    /// echo ends as soon as the sensor reads beyond its valid range, or reads nothing.
    #[test]
    fn what_is_met_now_is_where_it_was_read() {
        let mut blind = Blind::new();
        let mut seen = |mm| {
            blind.take(front(mm), Pose::default(), &wall(), AT_REST);
            let seen = blind.seen_from(Pose::default());
            seen.map(|place| place.x_mm).collect::<Vec<_>>()
        };
        assert_eq!(seen(400), [550.0, 550.0]);
        assert_eq!(seen(360), [550.0, 510.0]);
        assert_eq!(seen(700), [550.0]);
        assert_eq!(seen(360), [550.0, 510.0]);
        assert_eq!(seen(UNMEASURED), [550.0]);
    }

    #[test]
    fn what_the_lidar_shows_is_not_kept() {
        let mut blind = Blind::new();
        let shown = Surroundings::of(core::iter::once(Point::new(560.0, 20.0)));
        blind.take(front(400), Pose::default(), &shown, AT_REST);
        assert_eq!(places(&blind), []);
    }

    /// While the robot turns, a reading of 400 mm is too far to count, one of 300 mm is not.
    #[test]
    fn in_a_turn_only_what_is_near_counts() {
        let mut blind = Blind::new();
        blind.take(front(400), Pose::default(), &wall(), [-9, 9]);
        assert_eq!(places(&blind), []);
        blind.take(front(300), Pose::default(), &wall(), [-9, 9]);
        assert_eq!(places(&blind).len(), 1);
    }

    /// A person who has left disappears after three readings through the position; a neighbour
    /// beside the line stays.
    #[test]
    fn what_is_looked_through_is_forgotten() {
        let mut blind = Blind::new();
        blind.take(front(300), Pose::default(), &wall(), AT_REST);
        let mut take = |mm| {
            blind.take(front(mm), Pose::default(), &wall(), AT_REST);
            places(&blind).len()
        };
        assert_eq!([1_000, 1_000, 300, 1_000, 1_000].map(&mut take), [1; 5]);
        assert_eq!(take(1_000), 0);
    }

    #[test]
    fn a_full_list_forgets_its_oldest_places() {
        let mut blind = Blind::new();
        for n in 0..=PLACES_MAX {
            blind.keep(Point::new(n as f32 * 100.0, 0.0));
        }
        let kept = places(&blind);
        assert_eq!(kept.len(), PLACES_MAX);
        assert!(kept.iter().all(|place| place.x_mm > 50.0));
    }

    /// A sensor at (150, 0) that looks ahead, from (1, 2) m. A reading clears positions more than
    /// 150 mm before its echo and less than 40 mm beside its line; the third such reading deletes
    /// them.
    #[test]
    fn a_place_is_forgotten_when_it_was_looked_through_three_times() {
        let looked = |place: [f32; 2], heading: f32, times: usize| {
            let mut blind = Blind::new();
            let pose = Pose::new(1_000.0, 2_000.0, heading);
            blind.keep(Point::new(place[0], place[1]));
            for _ in 0..times {
                blind.look_through([150.0, 0.0, 0.0], 600.0, pose);
            }
            blind.count
        };
        assert_eq!(
            [1, 2, 3].map(|times| looked([1_300.0, 2_000.0], 0.0, times)),
            [1, 1, 0]
        );
        let count = |x, y| looked([x, y], 0.0, 3);
        assert_eq!([count(1_599.0, 2_000.0), count(1_601.0, 2_000.0)], [0, 1]);
        assert_eq!([count(1_151.0, 2_000.0), count(1_149.0, 2_000.0)], [0, 1]);
        assert_eq!([count(1_300.0, 2_039.0), count(1_300.0, 1_961.0)], [0; 2]);
        assert_eq!([count(1_300.0, 2_041.0), count(1_300.0, 1_959.0)], [1; 2]);
        let left = FRAC_PI_2;
        assert_eq!(
            [
                looked([1_000.0, 2_300.0], left, 3),
                looked([1_300.0, 2_000.0], left, 3)
            ],
            [0, 1]
        );
    }

    /// Within 60 mm it is the same position; in a full list the oldest is replaced.
    #[test]
    fn places_are_kept_apart_and_the_oldest_goes() {
        let mut blind = Blind::new();
        blind.keep(Point::new(0.0, 0.0));
        blind.keep(Point::new(59.0, 0.0));
        assert_eq!(blind.count, 1);
        blind.keep(Point::new(61.0, 0.0));
        assert_eq!(blind.count, 2);
        for n in 2..82_u8 {
            blind.keep(Point::new(f32::from(n) * 100.0, 0.0));
        }
        assert_eq!((blind.count, blind.oldest), (PLACES_MAX, 2));
        assert_eq!(blind.places[0].at.x_mm, 8_000.0);
        assert_eq!(
            [blind.places[1].at.x_mm, blind.places[2].at.x_mm],
            [8_100.0, 200.0]
        );
    }

    /// At (1, 2) m and looking along y, a point at (0.7, 2.6) m is 0.6 m ahead and 0.3 m to the
    /// left.
    #[test]
    fn places_are_seen_from_where_the_robot_stands() {
        let mut blind = Blind::new();
        blind.keep(Point::new(700.0, 2_600.0));
        blind.keep(Point::new(1_200.0, 1_900.0));
        let pose = Pose::new(1_000.0, 2_000.0, FRAC_PI_2);
        let seen: Vec<Point> = blind.seen_from(pose).collect();
        let expected = [(600.0, 300.0), (-100.0, -200.0)].map(|(x, y)| Point::new(x, y));
        assert_eq!(seen.len(), 2);
        for (seen, expected) in seen.iter().zip(expected) {
            assert!(seen.distance_mm(expected) < 0.1, "{seen:?}");
        }
    }
}
