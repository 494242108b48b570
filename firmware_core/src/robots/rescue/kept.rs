//! Points of earlier scans: a lidar that measures little of a turn leaves obstacles out.

use core::time::Duration;

use protocols::Instant;

use super::movers::polar;
use crate::pose::{Point, Pose, PoseChange};
use crate::scan::{BEAMS, Scan};

/// A scan is poor with less than a third of its beams, or less than two thirds of the last good
/// one.
const BEAMS_MIN: usize = BEAMS / 3;
const SHARE: [usize; 2] = [2, 3];
/// Time after which a scan counts as good although the one before had more: the lidar sees no more
/// here.
const USUAL: Duration = Duration::from_secs(10);
/// Number of scans for which a point is kept: 3 s.
const SCANS: u8 = 15;
/// Distance up to which points are kept, mm, and up to which they count.
const KEPT_MM: f32 = 1_500.0;
const NEAR_MM: f32 = 700.0;
/// The robot's middle.
const MIDDLE: Point = Point::new(0.0, 0.0);

/// The newest near point of each bearing, one degree each.
#[derive(Clone, Debug)]
pub(super) struct Kept {
    spots: [Spot; BEAMS],
    /// Number of points of the last good scan, and its end.
    usual: usize,
    end: Instant,
    is_poor: bool,
}

/// A point, whole millimetres as the board has little memory, and the number of scans since.
#[derive(Clone, Copy, Debug)]
struct Spot {
    place_mm: [i16; 2],
    age: u8,
}

impl Spot {
    const NONE: Self = Self {
        place_mm: [0; 2],
        age: u8::MAX,
    };

    fn place(self) -> Point {
        let [x_mm, y_mm] = self.place_mm.map(f32::from);
        Point::new(x_mm, y_mm)
    }
}

impl Kept {
    pub(super) const fn new() -> Self {
        Self {
            spots: [Spot::NONE; BEAMS],
            usual: 0,
            end: Instant::ZERO,
            is_poor: false,
        }
    }

    /// Takes a scan; `motion` is that of the robot since the scan before, if it is known.
    pub(super) fn take(&mut self, scan: &Scan, motion: Option<PoseChange>) {
        let before = core::mem::replace(&mut self.spots, [Spot::NONE; BEAMS]);
        if let Some(motion) = motion {
            let back = Pose::default().then(motion.inverse());
            for spot in before.into_iter().filter(|spot| spot.age < SCANS) {
                self.put(back.to_world(spot.place()), spot.age + 1);
            }
        }
        for point in scan.points() {
            self.put(*point, 0);
        }
        let count = scan.points().len();
        let is_usual = count * SHARE[1] >= self.usual * SHARE[0] || scan.end - self.end >= USUAL;
        self.is_poor = count < BEAMS_MIN || !is_usual;
        if is_usual {
            (self.usual, self.end) = (count, scan.end);
        }
    }

    /// A newer point replaces older ones of its bearing, also if it lies too far to be kept.
    fn put(&mut self, point: Point, age: u8) {
        let (bearing, range_mm) = polar(point, MIDDLE);
        let slot = &mut self.spots[bearing];
        let is_nearer = || range_mm < slot.place().distance_mm(MIDDLE);
        if slot.age < age || slot.age == age && !is_nearer() {
            return;
        }
        *slot = match range_mm < KEPT_MM {
            true => Spot {
                place_mm: [point.x_mm, point.y_mm].map(rounded),
                age,
            },
            false => Spot::NONE,
        };
    }

    /// Points of earlier scans near the robot, in directions without newer ones, if the newest scan
    /// is a poor one. `since` is the motion since its end.
    pub(super) fn seen_after(&self, since: PoseChange) -> impl Iterator<Item = Point> {
        let back = Pose::default().then(since.inverse());
        let old = |spot: &&Spot| self.is_poor && (1..=SCANS).contains(&spot.age);
        let moved = self.spots.iter().filter(old);
        let moved = moved.map(move |spot| back.to_world(spot.place()));
        moved.filter(|point| point.distance_mm(MIDDLE) < NEAR_MM)
    }
}

/// The nearest whole number, as `libm::roundf` gives it: half way it is the one farther from 0. The
/// cast discards the fraction, so nothing else is needed for a number of 16 bits.
fn rounded(mm: f32) -> i16 {
    // The number below a half: with a half, the sum for 0.49999997 would round up to 1.
    const HALF: f32 = 0.5 - 0.25 * f32::EPSILON;
    #[expect(clippy::cast_possible_truncation, reason = "at most 1,500 mm")]
    let whole = (mm + HALF.copysign(mm)) as i16;
    whole
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::pose::sin_cos;

    /// All halves of a millimetre that fit, and the numbers next to them, round as `roundf` does.
    #[test]
    fn places_are_rounded_as_the_library_does() {
        for half in -65_000_i32..65_000 {
            let mm = half as f32 / 2.0;
            for mm in [mm.next_down(), mm, mm.next_up()] {
                assert_eq!(f32::from(rounded(mm)), libm::roundf(mm), "{mm}");
            }
        }
    }

    /// A scan with points at this distance on whole degrees.
    fn scan(degrees: core::ops::Range<u16>, range_mm: f32, ms: u64) -> Scan {
        let points: Vec<Point> = degrees
            .map(|degree| {
                let (sin, cos) = sin_cos(f32::from(degree).to_radians());
                Point::new(range_mm * cos, range_mm * sin)
            })
            .collect();
        Scan::from_points(&points, Instant::ZERO, Instant::from_millis(ms))
    }

    const REST: Option<PoseChange> = Some(PoseChange::NONE);

    /// A scan of 300 beams, then scans of 199 and fewer: the other directions are those of the
    /// first one for 15 scans. With 200 of 300 nothing is added.
    #[test]
    fn points_stay_while_the_lidar_measures_less_than_before() {
        let mut kept = Kept::new();
        let count = |kept: &Kept| kept.seen_after(PoseChange::NONE).count();
        kept.take(&scan(0..300, 500.0, 1_000), REST);
        assert_eq!(count(&kept), 0);
        kept.take(&scan(0..200, 500.0, 1_200), REST);
        assert_eq!(count(&kept), 0);
        kept.take(&scan(0..132, 500.0, 1_400), REST);
        assert_eq!(count(&kept), 168);
        for turn in 0..13 {
            kept.take(&scan(0..100, 500.0, 1_600 + 200 * turn), REST);
            assert_eq!(count(&kept), 200, "{turn}");
        }
        kept.take(&scan(0..100, 500.0, 4_200), REST);
        assert_eq!(count(&kept), 100, "the first scan is too old");
        // Without a known motion nothing stays.
        kept.take(&scan(0..100, 500.0, 4_400), None);
        assert_eq!(count(&kept), 0);
    }

    /// A lidar that measures a tenth of each turn, each time a different one: its measurements add
    /// up. A far point replaces a near one of its bearing.
    #[test]
    fn parts_of_turns_add_up() {
        let mut kept = Kept::new();
        for part in 0..10 {
            let ms = 1_000 + 200 * u64::from(part);
            kept.take(&scan(36 * part..36 * part + 36, 600.0, ms), REST);
        }
        assert_eq!(kept.seen_after(PoseChange::NONE).count(), 324);
        kept.take(&scan(0..36, 2_000.0, 3_000), REST);
        assert_eq!(kept.seen_after(PoseChange::NONE).count(), 324);
        kept.take(&scan(36..72, 2_000.0, 3_200), REST);
        assert_eq!(kept.seen_after(PoseChange::NONE).count(), 288);
    }

    /// The robot drives 100 mm ahead and turns left by a quarter, then as much again: a point 500
    /// mm ahead is then 400 mm to the right, then 400 mm behind and 100 mm to the left. Beyond 700
    /// mm it does not count.
    #[test]
    fn points_stay_where_they_are_while_the_robot_moves() {
        let step = PoseChange {
            forward_mm: 100.0,
            left_mm: 0.0,
            turn: core::f32::consts::FRAC_PI_2,
        };
        let mut kept = Kept::new();
        kept.take(&scan(0..1, 500.0, 1_000), REST);
        kept.take(&scan(0..0, 500.0, 1_200), Some(step));
        let near = |point: Point, x_mm: f32, y_mm: f32| {
            (point.x_mm - x_mm).abs() < 1.0 && (point.y_mm - y_mm).abs() < 1.0
        };
        let all = |since| kept.seen_after(since).collect::<Vec<_>>();
        assert!(matches!(all(PoseChange::NONE)[..], [at] if near(at, 0.0, -400.0)));
        assert!(matches!(all(step)[..], [at] if near(at, -400.0, 100.0)));
        let far = PoseChange {
            forward_mm: 600.0,
            ..PoseChange::NONE
        };
        assert!(all(far).is_empty());
    }

    /// Of the points of one bearing the newest stays, and of points of the same age the nearest.
    #[test]
    fn one_point_of_a_bearing_stays() {
        let mut kept = Kept::new();
        for (x_mm, age, stays_mm) in [
            (500.0, 2, 500),
            (400.0, 3, 500),
            (450.0, 2, 450),
            (480.0, 2, 450),
            (600.0, 1, 600),
            (300.0, 2, 600),
        ] {
            kept.put(Point::new(x_mm, 0.0), age);
            assert_eq!(kept.spots[0].place_mm, [stays_mm, 0], "{x_mm} of age {age}");
        }
        kept.put(Point::new(1_500.0, 0.0), 0);
        assert_eq!(kept.spots[0].age, u8::MAX);
    }
}
