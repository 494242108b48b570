use core::f32::consts::PI;

use crate::pose::{Point, Pose, normalised};

use super::{STEP, Settings, Surroundings};

/// Scans without motion after which the robot is stuck: eight seconds.
const STUCK_SCANS: u8 = 40;
/// Minimum distance of a motion.
const MOVED_MM: f32 = 60.0;
/// The escape ends when the robot is this far from where it was stuck, or after this many scans:
/// turning round takes twenty.
const ESCAPED_MM: f32 = 200.0;
const ESCAPE_SCANS: u8 = 35;
/// Limit beyond which more free path has no value.
const FREE_MAX_MM: f32 = 1000.0;

/// Frees a robot that only turns to and fro: drives it in the direction with the most free path.
#[derive(Clone, Debug)]
pub(super) struct Escape {
    at: Option<Point>,
    still: u8,
    /// Heading of the escape, its start, and the remaining scans.
    heading: f32,
    from: Point,
    left: u8,
}

impl Escape {
    pub(super) const fn new() -> Self {
        Self {
            at: None,
            still: 0,
            heading: 0.0,
            from: Point::new(0.0, 0.0),
            left: 0,
        }
    }

    /// Scans since the robot moved.
    pub(super) const fn still_scans(&self) -> u8 {
        self.still
    }

    /// Whether the newest step was the first of an escape.
    pub(super) const fn has_begun(&self) -> bool {
        self.left == ESCAPE_SCANS - 1
    }

    /// The bearing of the escape, if the robot is stuck. Call it once per scan while the robot is
    /// to move.
    pub(super) fn step(
        &mut self,
        settings: &Settings,
        pose: Pose,
        around: &Surroundings,
    ) -> Option<f32> {
        let here = pose.position();
        match self.at {
            Some(at) if at.distance_mm(here) < MOVED_MM => {
                self.still = self.still.saturating_add(1)
            }
            _ => (self.at, self.still) = (Some(here), 0),
        }
        if self.still >= STUCK_SCANS {
            self.still = 0;
            self.left = ESCAPE_SCANS;
            self.from = here;
            self.heading = pose.heading + freest(settings, around);
        }
        if self.from.distance_mm(here) >= ESCAPED_MM {
            self.left = 0;
        }
        self.left = self.left.checked_sub(1)?;
        Some(normalised(self.heading - pose.heading))
    }
}

/// Bearing with the most free path for a body at its full clearance: a path that only just passes
/// the blocking obstacle is no escape. If there is none, the nearest obstacles may be passed at
/// their current distance.
fn freest(settings: &Settings, around: &Surroundings) -> f32 {
    let body = &settings.body;
    let strict = most(|bearing| around.free_by_mm(body.keep_mm(), bearing));
    let (bearing, free) = match strict {
        (_, free) if free > 0.0 => strict,
        _ => most(|bearing| around.free_mm(body, bearing)),
    };
    if free > 0.0 { bearing } else { 0.0 }
}

/// The bearing with the most free path, and that path; of equal ones, the one with the least turn.
fn most(free: impl Fn(f32) -> f32) -> (f32, f32) {
    let mut best = (0.0, 0.0, f32::NEG_INFINITY);
    for step in -36..36_i8 {
        let bearing = f32::from(step) * STEP;
        let free = free(bearing).min(FREE_MAX_MM);
        let worth = free - bearing.abs() / PI;
        if worth > best.2 {
            best = (bearing, free, worth);
        }
    }
    (best.0, best.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigation::Body;

    const SETTINGS: Settings = Settings::new(Body {
        radius_mm: 160.0,
        clearance_mm: 45.0,
        tick_mm_s: 11.345,
        axle_mm: 260.0,
    });

    /// A wall ahead and on both sides: the only free direction is behind.
    fn niche() -> Surroundings {
        let side = |y: f32| (-20..=40_i8).map(move |n| Point::new(f32::from(n) * 10.0, y));
        let front = (-30..=30_i8).map(|n| Point::new(400.0, f32::from(n) * 10.0));
        Surroundings::of(side(300.0).chain(side(-300.0)).chain(front))
    }

    #[test]
    fn a_robot_that_does_not_move_for_eight_seconds_leaves_by_the_free_side() {
        let (mut escape, around) = (Escape::new(), niche());
        let mut step = || escape.step(&SETTINGS, Pose::default(), &around);
        assert!((0..40).all(|_| step().is_none()));
        let way = step().expect("a way out");
        assert!(way.abs() > 2.0, "{way}");
        // Seven seconds in all: turning round takes four, and the robot has to drive away.
        assert_eq!((0..60).take_while(|_| step().is_some()).count(), 34);
    }

    #[test]
    fn the_way_out_ends_20_cm_from_where_the_robot_was_stuck() {
        let (mut escape, around) = (Escape::new(), niche());
        let mut step = |x| escape.step(&SETTINGS, Pose::new(x, 0.0, 0.0), &around);
        assert!((0..40).all(|_| step(0.0).is_none()));
        assert!(step(0.0).is_some() && step(-190.0).is_some());
        assert!(step(-200.0).is_none());
    }

    /// R4: the robot touches a corner at 35 degrees. A tangent passes the corner by 1 mm, which the
    /// next scan's noise removes; the escape must gain distance.
    #[test]
    fn a_robot_at_a_corner_leaves_it_behind() {
        let corner = Point::new(131.0, 92.0);
        let faces = (0..40_i8).flat_map(|n| {
            let along = f32::from(n) * 10.0;
            let (x, y) = (corner.x_mm, corner.y_mm);
            [Point::new(x, y + along), Point::new(x + along, y)]
        });
        let around = Surroundings::of(faces);
        let way = freest(&SETTINGS, &around);
        let away = normalised(way - libm::atan2f(corner.y_mm, corner.x_mm));
        assert!(away.abs() > PI / 2.0, "{} degrees", away.to_degrees());
    }

    #[test]
    fn a_robot_that_moves_is_left_alone() {
        let (mut escape, around) = (Escape::new(), niche());
        let is_quiet = (0..100_u8).all(|scan| {
            let pose = Pose::new(f32::from(scan) * 3.0, 0.0, 0.0);
            escape.step(&SETTINGS, pose, &around).is_none()
        });
        assert!(is_quiet);
    }

    /// A turn by 180 degrees must gain a millimetre of free path, one by 90 degrees half a
    /// millimetre. Free path beyond a metre has no value.
    #[test]
    fn of_equally_free_ways_the_nearest_is_taken() {
        let ahead_or = |more: f32, side: f32| {
            let is_there = move |bearing: f32| (bearing - side).abs() < 0.01;
            let (bearing, free) = most(|bearing| {
                if is_there(bearing) {
                    500.0 + more
                } else {
                    500.0
                }
            });
            assert!(free == 500.0 || (free - 500.0 - more).abs() < 1e-3);
            bearing
        };
        let quarter = PI / 2.0;
        assert_eq!([ahead_or(0.4, quarter), ahead_or(0.4, -quarter)], [0.0; 2]);
        assert!((ahead_or(0.6, quarter) - quarter).abs() < 0.01);
        assert!((ahead_or(0.6, -quarter) + quarter).abs() < 0.01);
        assert!(ahead_or(0.9, -PI) == 0.0 && ahead_or(1.1, -PI) < -3.1);
        let far = most(|bearing| if bearing > 1.0 { 9_000.0 } else { 1_000.0 });
        assert_eq!(far, (0.0, 1_000.0));
    }

    /// Walls 190 mm to both sides, and one ahead: no direction keeps the 205 mm that the body
    /// needs. If the distance of the walls is allowed, the direction back is free.
    #[test]
    fn where_it_is_too_narrow_everywhere_the_robot_leaves_along_the_walls() {
        let side = |y: f32| (-100..=30_i8).map(move |n| Point::new(f32::from(n) * 10.0, y));
        let front = (-19..=19_i8).map(|n| Point::new(300.0, f32::from(n) * 10.0));
        let around = Surroundings::of(side(190.0).chain(side(-190.0)).chain(front));
        let strict = most(|bearing| around.free_by_mm(SETTINGS.body.keep_mm(), bearing));
        assert_eq!(strict, (0.0, 0.0));
        assert_eq!(freest(&SETTINGS, &around), -PI);
    }

    /// No direction is free: straight on is as good as any.
    #[test]
    fn a_robot_that_is_walled_in_stays_as_it_looks() {
        let ring = (0..72_u8).map(|n| {
            let (sin, cos) = libm::sincosf(f32::from(n) * STEP);
            Point::new(5.0 * cos, 5.0 * sin)
        });
        assert_eq!(freest(&SETTINGS, &Surroundings::of(ring)), 0.0);
    }

    #[test]
    fn a_way_out_begins_once() {
        let (mut escape, around) = (Escape::new(), niche());
        let mut begins = |scans: u8| {
            let begun = (0..scans).filter(|_| {
                escape.step(&SETTINGS, Pose::default(), &around);
                escape.has_begun()
            });
            begun.count()
        };
        assert_eq!([40, 1, 34].map(&mut begins), [0, 1, 0]);
    }
}
