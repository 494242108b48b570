use core::ops::RangeInclusive;

use crate::pose::{Point, PoseChange, sin_cos};
use crate::scan::{BEAMS, Scan};

use super::{Body, HALT, arc_end, ticks};

/// Minimum number of points. With fewer, the robot sees nothing at all, or stands so close to an
/// obstacle that every beam fails.
const POINTS_MIN: usize = 10;

/// Times at which an arc is checked: stopping takes one scan and the motors' lag.
const LOOK_AHEAD_S: [f32; 5] = [0.15, 0.3, 0.5, 0.7, 0.9];
/// Approaches below this do not count.
const APPROACH_MM: f32 = 4.0;

/// Maximum number of points: those of a scan, and 80 positions of other sensors.
const POINTS_MAX: usize = BEAMS + 80;

/// The last scan of the lidar, relative to the robot's current pose.
#[derive(Clone, Debug)]
pub struct Surroundings {
    points: [Point; POINTS_MAX],
    /// Distances of the points.
    ranges_mm: [f32; POINTS_MAX],
    count: usize,
    nearest_mm: f32,
}

impl Surroundings {
    /// Surroundings without points.
    pub const EMPTY: Self = Self {
        points: [Point::new(0.0, 0.0); POINTS_MAX],
        ranges_mm: [0.0; POINTS_MAX],
        count: 0,
        nearest_mm: f32::INFINITY,
    };

    /// The points of `scan` after the robot has moved by `since`.
    pub fn seen(scan: &Scan, since: PoseChange) -> Self {
        let (sin, cos) = sin_cos(-since.turn);
        let moved = scan.points().iter().map(|point| {
            let (x, y) = (point.x_mm - since.forward_mm, point.y_mm - since.left_mm);
            Point::new(cos * x - sin * y, sin * x + cos * y)
        });
        Self::of(moved)
    }

    /// Surroundings of these points, at most [`BEAMS`].
    pub fn of(points: impl Iterator<Item = Point>) -> Self {
        let mut around = Self::EMPTY;
        around.put(points.take(BEAMS));
        around
    }

    /// Adds points of other sensors. A robot with a blind lidar stays blind.
    pub fn add(&mut self, points: impl Iterator<Item = Point>) {
        if !self.is_blind() {
            self.put(points);
        }
    }

    fn put(&mut self, points: impl Iterator<Item = Point>) {
        for point in points.take(POINTS_MAX - self.count) {
            self.points[self.count] = point;
            let range = libm::sqrtf(point.x_mm * point.x_mm + point.y_mm * point.y_mm);
            self.ranges_mm[self.count] = range;
            self.nearest_mm = self.nearest_mm.min(range);
            self.count += 1;
        }
    }

    /// Whether there are too few points for any motion.
    pub const fn is_blind(&self) -> bool {
        self.count < POINTS_MIN
    }

    /// Distance of the nearest point; infinite if nothing is seen.
    pub(super) const fn nearest_mm(&self) -> f32 {
        self.nearest_mm
    }

    /// Points with their distances.
    pub fn points(&self) -> impl Iterator<Item = (Point, f32)> + '_ {
        self.points[..self.count]
            .iter()
            .copied()
            .zip(self.ranges_mm[..self.count].iter().copied())
    }

    /// Bearing and distance of the nearest point between two bearings (radians, from right to
    /// left).
    pub fn nearest(&self, bearings: RangeInclusive<f32>) -> Option<(f32, f32)> {
        self.points()
            .map(|(point, range)| (libm::atan2f(point.y_mm, point.x_mm), range))
            .filter(|(bearing, _)| bearings.contains(bearing))
            .reduce(|nearest, other| if other.1 < nearest.1 { other } else { nearest })
    }

    /// Distance that the body can move along `bearing` before an obstacle comes too near.
    pub fn free_mm(&self, body: &Body, bearing: f32) -> f32 {
        self.free_by_mm(self.keep_mm(body), bearing)
    }

    /// Distance that a body can move along `bearing` before an obstacle comes nearer than `keep`.
    pub(super) fn free_by_mm(&self, keep: f32, bearing: f32) -> f32 {
        let (sin, cos) = sin_cos(bearing);
        let mut free = f32::INFINITY;
        for (point, _) in self.points() {
            let along = cos * point.x_mm + sin * point.y_mm;
            let aside = cos * point.y_mm - sin * point.x_mm;
            if along > 0.0 && aside.abs() < keep {
                free = free.min(along - libm::sqrtf(keep * keep - aside * aside));
            }
        }
        free.max(0.0)
    }

    /// `wanted`, slowed down as far as needed to keep away from seen obstacles; in the limit only
    /// the turn is left. A blind robot stops.
    pub fn guarded(&self, body: &Body, wanted: [i8; 2]) -> [i8; 2] {
        // Field defect XV-11: the fielded robot drove straight ahead when every beam was invalid.
        if self.is_blind() {
            return HALT;
        }
        for share in [1.0, 0.7, 0.45, 0.25] {
            let slower = wanted.map(|wheel| ticks(f32::from(wheel) * share));
            if self.is_clear(body, slower) {
                return slower;
            }
        }
        let turn = (f32::from(wanted[1]) - f32::from(wanted[0])) / 2.0;
        [-turn, turn].map(ticks)
    }

    /// The distance to keep. A robot with an obstacle nearer than that may move along it, but not
    /// nearer.
    fn keep_mm(&self, body: &Body) -> f32 {
        body.keep_mm().min(self.nearest_mm - APPROACH_MM).max(0.0)
    }

    /// Whether the arc keeps away from all points.
    fn is_clear(&self, body: &Body, set_point: [i8; 2]) -> bool {
        let ends = LOOK_AHEAD_S.map(|seconds| arc_end(body, set_point, seconds));
        let [.., last] = ends;
        let keep = self.keep_mm(body);
        let reach = keep + libm::sqrtf(last.x_mm * last.x_mm + last.y_mm * last.y_mm) + 1.0;
        self.points()
            .filter(|(_, range)| *range < reach)
            .all(|(point, _)| {
                ends.iter().all(|end| {
                    let (x, y) = (point.x_mm - end.x_mm, point.y_mm - end.y_mm);
                    x * x + y * y >= keep * keep
                })
            })
    }
}

#[cfg(test)]
mod tests {
    use protocols::Instant;

    use super::*;

    const BODY: Body = Body {
        radius_mm: 160.0,
        clearance_mm: 45.0,
        tick_mm_s: 11.345,
        axle_mm: 260.0,
    };

    /// Finding T5: a post is 300 mm ahead and 100 mm beside the path. It stops a body of 205 mm at
    /// sqrt(205^2 - 100^2) = 178.96 mm before it, after 121.04 mm. 205 mm beside the path, the post
    /// no longer blocks.
    #[test]
    fn a_post_beside_the_way_is_reached_later() {
        let free = |y| Surroundings::of(core::iter::once(Point::new(300.0, y))).free_mm(&BODY, 0.0);
        assert!((free(100.0) - 121.04).abs() < 0.01, "{}", free(100.0));
        assert!((free(-100.0) - 121.04).abs() < 0.01);
        assert!((free(0.0) - 95.0).abs() < 0.01);
        assert_eq!((free(204.9) > 290.0, free(204.9) < 300.0), (true, true));
        assert_eq!((free(205.0), free(-205.0)), (f32::INFINITY, f32::INFINITY));
    }

    /// Finding T5: with the left wheel at rest the robot turns about it: the right wheel moves
    /// 226.9 mm on a circle of 260 mm, and the middle half of that: 130 sin 0.8727 and 130 (1 - cos
    /// 0.8727).
    #[test]
    fn an_arc_ends_on_its_circle() {
        let is_at = |set_point, seconds, [x, y]: [f32; 2]| {
            let end = arc_end(&BODY, set_point, seconds);
            (end.x_mm - x).abs() < 0.05 && (end.y_mm - y).abs() < 0.05
        };
        assert!(is_at([0, 20], 1.0, [99.59, 46.44]));
        assert!(is_at([20, 0], 1.0, [99.59, -46.44]));
        assert!(is_at([20, 20], 0.5, [113.45, 0.0]));
        assert!(is_at([-20, -20], 0.5, [-113.45, 0.0]));
        assert!(is_at([10, -10], 1.0, [0.0, 0.0]));
        assert!(is_at([20, 19], 1.0, [221.16, -4.83]));
        // With the first wheel slower than the other, half the time is half the path.
        assert!(is_at([0, 20], 0.0, [0.0, 0.0]));
    }

    /// Of two equally near points (3, 4 and 5) the first counts; a nearer one outside the bearings
    /// does not.
    #[test]
    fn the_nearest_point_between_two_bearings_is_told() {
        let places = [
            (400.0, -300.0),
            (300.0, 400.0),
            (400.0, 300.0),
            (600.0, 800.0),
        ];
        let points = places.map(|(x, y)| Point::new(x, y));
        let around = Surroundings::of(points.into_iter());
        let nearest = around.nearest(0.0..=1.5).expect("there are three");
        assert!(
            (nearest.0 - 0.9273).abs() < 1e-3 && (nearest.1 - 500.0).abs() < 0.1,
            "{nearest:?}"
        );
        let right = around.nearest(-1.5..=0.0).expect("there is one");
        assert!((right.0 + 0.6435).abs() < 1e-3, "{right:?}");
        assert_eq!(around.nearest(2.0..=3.0), None);
    }

    /// A robot has driven 100 mm forward and 20 mm to the left, and turned left by a quarter. A
    /// point that was at (300, 220) is then 200 mm ahead in the old direction, which is now to the
    /// robot's right.
    #[test]
    fn what_was_seen_is_where_the_robot_has_left_it() {
        let points = [Point::new(300.0, 220.0), Point::new(100.0, 120.0)];
        let scan = Scan::from_points(&points, Instant::ZERO, Instant::ZERO);
        let since = PoseChange {
            forward_mm: 100.0,
            left_mm: 20.0,
            turn: core::f32::consts::FRAC_PI_2,
        };
        let around = Surroundings::seen(&scan, since);
        let near = |at: usize, x, y| around.points[at].distance_mm(Point::new(x, y)) < 0.01;
        assert!(near(0, 200.0, -200.0) && near(1, 100.0, 0.0));
        assert!((around.nearest_mm - 100.0).abs() < 0.01 && around.count == 2);
    }

    /// Ten points are enough to see. Points of other sensors do not help a blind robot.
    #[test]
    fn ten_points_are_sight() {
        let points = |count| core::iter::repeat_n(Point::new(900.0, 0.0), count);
        let mut around = Surroundings::of(points(9));
        assert!(around.is_blind() && around.guarded(&BODY, [20, 20]) == [0, 0]);
        around.add(points(5));
        assert_eq!(around.count, 9);
        let mut around = Surroundings::of(points(10));
        around.add(points(5));
        assert!(!around.is_blind() && around.count == 15);
        around.add(points(1_000));
        assert_eq!(around.count, POINTS_MAX);
        assert_eq!(Surroundings::of(points(1_000)).count, BEAMS);
    }

    /// At 20 ticks, 226.9 mm/s, the robot drives 204.2 mm in the checked 0.9 s; it keeps 205 mm
    /// from a post. With a post 400 mm ahead seven tenths of the way, 142.9 mm, are clear; with one
    /// at 300 mm a quarter, 51.1 mm; with one at 230 mm nothing. The robot may turn on the spot.
    #[test]
    fn a_robot_slows_down_before_what_is_near() {
        let guarded = |x: f32, y: f32, wanted| {
            let near = core::iter::once(Point::new(x, y));
            let far = core::iter::repeat_n(Point::new(-2_000.0, 0.0), 10);
            Surroundings::of(near.chain(far)).guarded(&BODY, wanted)
        };
        assert_eq!(guarded(420.0, 0.0, [20, 20]), [20, 20]);
        assert_eq!(guarded(400.0, 0.0, [20, 20]), [14, 14]);
        assert_eq!(guarded(300.0, 0.0, [20, 20]), [9, 9]);
        assert_eq!(guarded(280.0, 0.0, [20, 20]), [5, 5]);
        assert_eq!(guarded(230.0, 0.0, [20, 20]), [0, 0]);
        assert_eq!(guarded(-230.0, 0.0, [20, 20]), [20, 20]);
        assert_eq!(guarded(-230.0, 0.0, [-20, -20]), [0, 0]);
        assert_eq!(guarded(230.0, 0.0, [-10, 10]), [-10, 10]);
        assert_eq!(guarded(200.0, 0.0, [4, 20]), [-8, 8]);
    }

    /// 204.2 mm on, a post at 409.0 mm is 204.8 mm away, one at 409.4 mm is 205.2 mm away: only the
    /// latter is clear.
    #[test]
    fn a_post_just_within_what_is_kept_counts() {
        let guarded = |x: f32| {
            let near = core::iter::once(Point::new(x, 0.0));
            let far = core::iter::repeat_n(Point::new(-2_000.0, 0.0), 10);
            Surroundings::of(near.chain(far)).guarded(&BODY, [20, 20])
        };
        assert_eq!([409.0, 409.4].map(guarded), [[14, 14], [20, 20]]);
    }
}
