//! Victims: warm positions on the walls found by the heat sensors.
//!
//! A sensor looks to the side. While it passes a warm object, the program averages the wall's
//! positions right beside the sensor, weighted by the square of the excess temperature. The mean is
//! the middle of the object. A reading counts if it is as warm as a victim on that wall would make
//! it; a victim farther away, seen past the wall's end, does not count.

use crate::pose::{Point, Pose};

use super::Surroundings;

/// Maximum number of stored victims.
pub const VICTIMS_MAX: usize = 16;
/// Minimum excess over the ambient temperature, in tenths of a degree: 37 degrees on a third of the
/// sensor's view, in a hall of 22.
const WARM: i16 = 45;
/// Excess of a victim that fills the sensor's view: 37 degrees in a hall of 22.
const FULL: f32 = 150.0;
/// Share of the old estimate of the ambient temperature kept at each reading, in 64ths.
const KEEP_64: i32 = 62;
/// Largest drop of the estimated ambient temperature at once, tenths of a degree: at the first
/// reading a victim may have been in view.
const COLDER_MAX: i32 = 150;
/// Distance of a sensor from the robot's middle, millimetres.
const MOUNT_MM: f32 = 100.0;
/// Half of a sensor's field of view, radians, and its tangent.
const HALF_VIEW_RAD: f32 = 0.305;
const HALF_VIEW_TAN: f32 = 0.315;
/// Margin around the field of view in which a victim still warms a delayed reading.
const RIM_RAD: f32 = 0.15;
/// Half of a warm plate, millimetres.
const HALF_PLATE_MM: f32 = 50.0;
/// Distance from the sensor above which the position on the wall is uncertain, millimetres. Walls
/// that the search counts as felt are nearer: 0.42 m from the middle, less the flank of 60 mm that
/// the map draws before a wall.
const FAR_MM: f32 = 450.0;
/// Maximum distance at which a victim is felt at all.
const FELT_MM: f32 = 1500.0;
/// Excess over the ambient temperature from which a reading may be the edge of a victim, tenths of
/// a degree.
const CALM: i16 = 15;
/// Half width beside the middle of the field of view in which the wall is searched: tangent, and
/// millimetres.
const BESIDE_TAN: f32 = 0.1;
const BESIDE_MM: f32 = 8.0;
/// Cosine of the angle to a wall below which a victim's position on it is uncertain.
const OBLIQUE_COS: f32 = 0.5;
/// Radius around a point of a wall whose points give the wall's direction, millimetres.
const AROUND_MM: f32 = 60.0;
/// Distance behind the wall, millimetres, from which an object there may be the source of the
/// warmth. It is not if the reading exceeds that of a victim there by this factor.
const BEHIND_MM: f32 = 120.0;
const NOT_BEHIND: f32 = 1.25;
/// Minimum share of the expected reading that a victim on the wall reaches, and minimum number of
/// readings.
const SHARE_MIN: f32 = 0.6;
const READINGS_MIN: u8 = 2;
/// Radius within which two victims are the same.
const SAME_MM: f32 = 250.0;
/// Maximum number of stored candidates with too few readings; the newest are kept.
const DOUBTS_MAX: usize = 4;
/// Two doubtful objects nearer together than this are the same, millimetres: a robot that passes a
/// plate at 0.2 m/s measures it once each time, at positions this close.
const SAME_DOUBT_MM: f32 = 150.0;

/// A victim.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Victim {
    /// Position in the map.
    pub place: Point,
    /// Sum of the weights of the averaged readings.
    weight: f32,
}

/// Warm object that passes a sensor.
#[derive(Clone, Copy, Debug)]
struct Passing {
    victim: Victim,
    readings: u8,
    /// The largest share of the reading that a victim on that wall would cause.
    share: f32,
}

impl Passing {
    const NOBODY: Self = Self {
        victim: Victims::NOBODY,
        readings: 0,
        share: 0.0,
    };

    /// Whether the passed body is a victim for sure.
    fn is_sure(&self) -> bool {
        self.readings >= READINGS_MIN && self.share >= SHARE_MIN
    }

    /// Combines both, if they have the same position.
    fn with(mut self, other: &Self) -> Option<Self> {
        let [here, there] = [self.victim.place, other.victim.place];
        if other.readings == 0 || here.distance_mm(there) >= SAME_DOUBT_MM {
            return None;
        }
        mix(&mut self.victim, there, other.victim.weight);
        self.readings = self.readings.saturating_add(other.readings);
        self.share = self.share.max(other.share);
        Some(self)
    }
}

/// All victims and candidates.
#[derive(Clone, Debug)]
pub(super) struct Victims {
    list: [Victim; VICTIMS_MAX],
    len: usize,
    /// Warm objects that pass the sensors now.
    passing: [Passing; 2],
    /// Passed objects with too few readings, the newest first.
    doubts: [Passing; DOUBTS_MAX],
    /// The newest readings are warmer than the surroundings.
    is_warm: [bool; 2],
    /// Ambient temperature, 64ths of a tenth of a degree; 0: not known yet.
    ambient_64: [i32; 2],
}

impl Victims {
    const NOBODY: Victim = Victim {
        place: Point::new(0.0, 0.0),
        weight: 0.0,
    };

    pub(super) const fn new() -> Self {
        Self {
            list: [Self::NOBODY; VICTIMS_MAX],
            len: 0,
            passing: [Passing::NOBODY; 2],
            doubts: [Passing::NOBODY; DOUBTS_MAX],
            is_warm: [false; 2],
            ambient_64: [0; 2],
        }
    }

    pub(super) fn all(&self) -> &[Victim] {
        &self.list[..self.len]
    }

    /// Positions of all victims in whole millimetres, for the PC.
    pub(super) fn told<'a>(&self, places: &'a mut [[i16; 2]; VICTIMS_MAX]) -> &'a [[i16; 2]] {
        for (place, victim) in places.iter_mut().zip(self.all()) {
            let Point { x_mm, y_mm } = victim.place;
            #[expect(clippy::cast_possible_truncation, reason = "saturates")]
            let told = [x_mm, y_mm].map(|mm| libm::roundf(mm) as i16);
            *place = told;
        }
        &places[..self.len]
    }

    /// Whether the sensors, left and right, feel no victim, or only known ones.
    pub(super) fn are_explained(&self, pose: Pose) -> [bool; 2] {
        [(0, 1.0), (1, -1.0)].map(|(index, side)| {
            let is_seen = |victim: &Victim| {
                let Point { x_mm, y_mm } = victim.place;
                let from_here = pose.change_to(Pose::new(x_mm, y_mm, 0.0));
                let ahead = side * from_here.left_mm - MOUNT_MM;
                let aside = libm::atan2f(from_here.forward_mm, ahead).abs();
                ahead < FELT_MM && aside < HALF_VIEW_RAD + RIM_RAD
            };
            !self.is_warm[index] || self.all().iter().any(is_seen)
        })
    }

    /// Takes the heat sensors' readings, left and right, tenths of a degree; true if they belong to
    /// a new victim.
    pub(super) fn take(&mut self, readings: [i16; 2], pose: Pose, around: &Surroundings) -> bool {
        let mut is_new = false;
        // A base that has just started has not measured yet and reports 0. This is not a cold hall,
        // in which all other readings would count as warm.
        let measured = readings.into_iter().enumerate();
        for (index, reading) in measured.filter(|(_, reading)| *reading != 0) {
            let excess = self.excess(index, reading);
            self.is_warm[index] = excess >= CALM;
            if excess < WARM {
                is_new |= self.passed(index);
                continue;
            }
            let side = if index == 0 { 1.0 } else { -1.0 };
            let excess = f32::from(excess);
            if let Some((wall, share)) = warm_wall(around, side, excess) {
                let passing = &mut self.passing[index];
                mix(&mut passing.victim, pose.to_world(wall), excess * excess);
                passing.readings = passing.readings.saturating_add(1);
                passing.share = passing.share.max(share);
            }
        }
        is_new
    }

    /// Excess over the ambient temperature.
    fn excess(&mut self, index: usize, reading: i16) -> i16 {
        let ambient = &mut self.ambient_64[index];
        let reading_64 = i32::from(reading) * 64;
        if *ambient == 0 {
            *ambient = reading_64;
        }
        let excess = i32::from(reading) - *ambient / 64;
        // Warm readings do not count as ambient, nor does the edge of a warm object, beside which a
        // robot may stand for long. Colder readings do count. A single outlier changes the estimate
        // little.
        if excess < i32::from(CALM) {
            let seen = reading_64.max(*ambient - 64 * COLDER_MAX);
            *ambient = (*ambient * KEEP_64 + seen * (64 - KEEP_64)) / 64;
        }
        i16::try_from(excess).unwrap_or(0)
    }

    /// Ends the passage of a warm object on this side: it is a victim if it had enough readings,
    /// now or together with earlier ones there.
    fn passed(&mut self, index: usize) -> bool {
        let mut passed = core::mem::replace(&mut self.passing[index], Passing::NOBODY);
        if passed.readings == 0 {
            return false;
        }
        if !passed.is_sure() {
            let mut doubts = self.doubts.iter_mut();
            let before = doubts.find_map(|doubt| passed.with(doubt).map(|both| (doubt, both)));
            match before {
                Some((doubt, both)) if both.is_sure() => {
                    *doubt = Passing::NOBODY;
                    passed = both;
                }
                Some((doubt, both)) => {
                    *doubt = both;
                    return false;
                }
                None => {
                    self.doubts.rotate_right(1);
                    self.doubts[0] = passed;
                    return false;
                }
            }
        }
        let found = passed.victim;
        let known = &mut self.list[..self.len];
        let same = |known: &&mut Victim| known.place.distance_mm(found.place) < SAME_MM;
        if let Some(known) = known.iter_mut().find(same) {
            mix(known, found.place, found.weight);
            return false;
        }
        let Some(slot) = self.list.get_mut(self.len) else {
            return false;
        };
        *slot = found;
        self.len += 1;
        true
    }
}

fn mix(victim: &mut Victim, place: Point, weight: f32) {
    victim.weight += weight;
    let share = weight / victim.weight;
    victim.place.x_mm += (place.x_mm - victim.place.x_mm) * share;
    victim.place.y_mm += (place.y_mm - victim.place.y_mm) * share;
}

/// The wall beside the sensor on that side (1 left, -1 right), relative to the robot, if the warmth
/// comes from the wall. Also the reading as a share of that of a victim there.
fn warm_wall(around: &Surroundings, side: f32, excess: f32) -> Option<(Point, f32)> {
    let seen_by = |point: Point| {
        let seen = Point::new(point.x_mm, side * point.y_mm - MOUNT_MM);
        let Point {
            x_mm: aside,
            y_mm: ahead,
        } = seen;
        (ahead > 0.0 && aside.abs() <= ahead * HALF_VIEW_TAN).then_some(seen)
    };
    let seen = || around.points().filter_map(|(point, _)| seen_by(point));
    // For a wall parallel to the robot, the point right beside the sensor.
    let (mut wall, mut near) = (None, FAR_MM);
    for point in seen() {
        let Point {
            x_mm: aside,
            y_mm: ahead,
        } = point;
        let range = libm::sqrtf(ahead * ahead + aside * aside);
        if range < near && aside.abs() <= ahead * BESIDE_TAN + BESIDE_MM {
            (wall, near) = (Some(point), range);
        }
    }
    let wall = wall?;
    let along = direction(wall, seen());
    if along[0] < OBLIQUE_COS {
        return None;
    }
    // Points farther away than the wall's continuation.
    let behind = |point: &Point| {
        (point.y_mm - wall.y_mm) * along[0] - (point.x_mm - wall.x_mm) * along[1] > BEHIND_MM
    };
    let far = seen()
        .filter(behind)
        .fold(0.0_f32, |far, point| far.max(point.y_mm));
    let is_there = far == 0.0 || excess >= expected(far) * NOT_BEHIND;
    let place = Point::new(wall.x_mm, side * (wall.y_mm + MOUNT_MM));
    is_there.then(|| (place, excess / plate_there(wall, along)))
}

/// Direction of the wall around a point of it: a unit vector, forward or straight away.
fn direction(at: Point, seen: impl Iterator<Item = Point>) -> [f32; 2] {
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for point in seen.filter(|point| point.distance_mm(at) <= AROUND_MM) {
        let [x, y] = [point.x_mm - at.x_mm, point.y_mm - at.y_mm];
        (xx, yy, xy) = (xx + x * x, yy + y * y, xy + x * y);
    }
    let (sin, cos) = libm::sincosf(libm::atan2f(2.0 * xy, xx - yy) / 2.0);
    [cos, sin]
}

/// Excess of a victim at that position on a wall with direction `along`.
fn plate_there(wall: Point, along: [f32; 2]) -> f32 {
    let bearing = |half: f32| {
        let [x, y] = [wall.x_mm + half * along[0], wall.y_mm + half * along[1]];
        libm::atan2f(x, y).clamp(-HALF_VIEW_RAD, HALF_VIEW_RAD)
    };
    let seen = (bearing(HALF_PLATE_MM) - bearing(-HALF_PLATE_MM)).abs();
    FULL * seen / (2.0 * HALF_VIEW_RAD)
}

/// Excess of a victim straight ahead of the sensor.
fn expected(far_mm: f32) -> f32 {
    let seen = libm::atan2f(HALF_PLATE_MM, far_mm) / HALF_VIEW_RAD;
    FULL * seen.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall 270 mm to the left, from x = -1 m to 1 m.
    fn wall() -> Surroundings {
        let along = (-100..=100_i16).map(|n| Point::new(f32::from(n) * 10.0, 270.0));
        Surroundings::of(along)
    }

    /// The robot passes a victim at x = 500 mm, felt from 50 mm on both sides.
    fn pass(victims: &mut Victims) -> u32 {
        let mut found = 0;
        for x in (0..=1000_i16).step_by(20) {
            let left = if (450..=550).contains(&x) { 320 } else { 220 };
            let pose = Pose::new(f32::from(x), 0.0, 0.0);
            found += u32::from(victims.take([left, 221], pose, &wall()));
        }
        found
    }

    #[test]
    fn somebody_is_found_once_and_in_the_middle_of_what_is_warm() {
        let mut victims = Victims::new();
        assert_eq!((pass(&mut victims), pass(&mut victims)), (1, 0));
        let [victim] = victims.all() else {
            panic!("{:?}", victims.all());
        };
        let expected = Point::new(500.0, 270.0);
        assert!(victim.place.distance_mm(expected) < 20.0, "{victim:?}");
    }

    /// A base that restarts again and again sends 0 until it has measured. Afterwards 22 degrees
    /// are no victim, and a victim is found.
    #[test]
    fn what_was_not_measured_yet_is_not_cold() {
        let mut victims = Victims::new();
        for n in 0..100_u8 {
            let left = if n % 4 == 0 { 220 } else { 0 };
            assert!(!victims.take([left, 0], Pose::default(), &wall()));
        }
        assert_eq!(victims.are_explained(Pose::default()), [true; 2]);
        assert_eq!(pass(&mut victims), 1);
    }

    /// An extra byte on the wire can turn a reading into -2000 degrees. The hall's estimate drops
    /// by half a degree, 150 / 32 tenths, and no victim is found.
    #[test]
    fn a_reading_far_off_is_no_cold_hall() {
        let mut victims = Victims::new();
        for left in [220, 220, -20_000, 220, 220, -20_000, 220, 220] {
            assert!(!victims.take([left, 220], Pose::default(), &wall()));
            assert_eq!(victims.are_explained(Pose::default()), [true; 2]);
        }
        assert_eq!(pass(&mut victims), 1);
    }

    /// A hall that warms up by ten degrees in a thousand readings is no victim.
    #[test]
    fn a_warm_day_is_nobody() {
        let mut victims = Victims::new();
        for n in 0..1000_i16 {
            assert!(!victims.take([220 + n / 10; 2], Pose::default(), &wall()));
        }
        assert_eq!(victims.all(), []);
    }

    #[test]
    fn more_than_the_list_holds_are_not_told() {
        let mut victims = Victims::new();
        let mut found = 0;
        for n in 0..20_i16 {
            let pose = Pose::new(f32::from(n) * 400.0, 0.0, 0.0);
            for left in [220, 330, 330, 220] {
                found += usize::from(victims.take([left, 220], pose, &wall()));
            }
        }
        assert_eq!((found, victims.all().len()), (VICTIMS_MAX, VICTIMS_MAX));
    }

    /// Number of victims after the robot's side stood at the wall at 270 mm with these readings.
    fn told(readings: &[i16], around: &Surroundings) -> usize {
        let mut victims = Victims::new();
        for left in [&[220], readings, &[220]].concat() {
            victims.take([left, 220], Pose::default(), around);
        }
        victims.all().len()
    }

    /// A robot that passes quickly feels a victim once, and again on its way back; single readings
    /// at two positions are noise.
    #[test]
    fn what_is_felt_once_and_once_more_is_somebody() {
        let found = |places: &[i16]| {
            let mut victims = Victims::new();
            for &x in places {
                for left in [220, 320, 220] {
                    victims.take([left, 220], Pose::new(f32::from(x), 0.0, 0.0), &wall());
                }
            }
            victims.all().first().map(|one| one.place.x_mm)
        };
        assert_eq!(found(&[300, 440]), Some(370.0));
        assert_eq!(found(&[300, 450]), None);
        // The last four are stored.
        assert_eq!(found(&[300, 700, -100, -500, 300]), Some(300.0));
        assert_eq!(found(&[300, 700, -100, -500, -900, 300]), None);
    }

    /// 170 mm before a sensor a victim fills 16.4 of 17.5 degrees: 14 degrees more than the hall. A
    /// reading of 7 is its edge or another victim, a single reading is noise.
    #[test]
    fn what_is_too_cold_for_its_wall_or_read_once_is_nobody() {
        assert_eq!(told(&[320, 320], &wall()), 1);
        assert_eq!(told(&[320], &wall()), 0);
        assert_eq!(told(&[290, 290, 290], &wall()), 0);
    }

    /// A board that ends beside the robot at 270 mm, and another one behind it at 650 mm: a victim
    /// on the farther one causes 4.5 degrees, and may cause 5.5, but not 9.
    #[test]
    fn somebody_past_the_end_of_a_board_is_not_on_it() {
        let near = (-40..=1_i16).map(|n| Point::new(f32::from(n) * 10.0, 370.0));
        let behind = (2..=40_i16).map(|n| Point::new(f32::from(n) * 10.0, 650.0));
        let around = Surroundings::of(near.chain(behind));
        let found = [275, 310].map(|left| told(&[left; 3], &around));
        assert_eq!(found, [0, 1]);
    }

    /// The wall beside a warm object is not felt while the source of the warmth is unknown.
    #[test]
    fn what_is_warm_is_explained_by_somebody_who_is_known() {
        let mut victims = Victims::new();
        let here = Pose::default();
        victims.take([220, 221], here, &wall());
        assert_eq!(victims.are_explained(here), [true, true]);
        victims.take([320, 221], here, &wall());
        assert_eq!(victims.are_explained(here), [false, true]);
        victims.take([320, 221], here, &wall());
        victims.take([220, 221], here, &wall());
        victims.take([320, 320], here, &wall());
        assert_eq!(victims.are_explained(here), [true, false]);
        let turned_away = Pose::new(0.0, 0.0, core::f32::consts::FRAC_PI_2);
        assert_eq!(victims.are_explained(turned_away), [false, false]);
    }

    /// A victim with exactly six tenths of the expected reading, felt twice, counts; one with a
    /// little less does not, nor does a single reading. 250 mm from a victim a new one starts.
    #[test]
    fn a_victim_fills_six_tenths_twice_and_is_another_one_from_250_mm_on() {
        let passed = |victims: &mut Victims, x_mm: f32, readings: u8, share: f32| {
            let victim = Victim {
                place: Point::new(x_mm, 0.0),
                weight: 1.0,
            };
            victims.passing[1] = Passing {
                victim,
                readings,
                share,
            };
            victims.passed(1)
        };
        let mut victims = Victims::new();
        assert!(!passed(&mut victims, 0.0, 2, 0.599));
        assert!(!passed(&mut victims, 900.0, 1, 0.9));
        assert!(passed(&mut Victims::new(), 0.0, 2, 0.6));
        let mut victims = Victims::new();
        assert!(passed(&mut victims, 0.0, 2, 0.6));
        assert!(!passed(&mut victims, 249.0, 2, 0.6));
        // The middle of two victims with equal weights is 124.5.
        assert_eq!(victims.all()[0].place.x_mm, 124.5);
        assert!(passed(&mut victims, 374.5, 2, 0.6));
        assert_eq!(victims.all().len(), 2);
        let mut places = [[0; 2]; VICTIMS_MAX];
        assert_eq!(victims.told(&mut places), [[125, 0], [375, 0]]);
    }

    /// A victim 170 mm before the sensor causes a reading of 14.07 degrees, and counts from six
    /// tenths of it on, 8.44. A victim 340 mm away causes 7.18 degrees; readings up to 8.97 are
    /// attributed to that distance. A reading of 8.7 may come from there if there is a board behind
    /// in the field of view, but not beside it, 107 mm from its middle.
    #[test]
    fn a_board_beside_the_field_of_view_does_not_count() {
        let with = |x: i16, y_mm: f32| {
            let near = (-100..=100_i16).map(|n| Point::new(f32::from(n) * 10.0, 270.0));
            let behind = (0..=4).map(|n| Point::new(f32::from(x + 2 * n), y_mm));
            let ahead = behind.clone().map(|point| Point::new(-point.x_mm, y_mm));
            Surroundings::of(near.chain(behind).chain(ahead))
        };
        assert_eq!(told(&[307, 307], &with(110, 440.0)), 1);
        assert_eq!(told(&[307, 307], &with(98, 440.0)), 0);
        // A point 100 mm behind the wall counts as the wall.
        assert_eq!(told(&[307, 307], &with(50, 370.0)), 1);
        // On the other side, and under the sensor, there are no points.
        assert_eq!(told(&[307, 307], &with(0, -440.0)), 1);
    }

    /// A reading of 4.5 degrees above the hall is warm, one of 4.4 is not. From 1.5 degrees on it
    /// is the edge of a victim, and does not count as ambient.
    #[test]
    fn warmth_begins_at_its_limits() {
        let mut victims = Victims::new();
        assert_eq!(victims.excess(0, 220), 0);
        assert_eq!(victims.excess(0, 235), 15);
        assert_eq!(victims.ambient_64[0], 220 * 64);
        assert_eq!(victims.excess(0, 234), 14);
        // The estimate rises by 2/64 of the 14 tenths by which the reading exceeds it.
        assert_eq!(victims.ambient_64[0], 220 * 64 + 28);
        assert_eq!(victims.ambient_64[1], 0);
        let around = wall();
        let felt = |left: i16| {
            let mut victims = Victims::new();
            victims.take([220; 2], Pose::default(), &around);
            victims.take([left, 220], Pose::default(), &around);
            (victims.passing[0].readings, victims.is_warm[0])
        };
        assert_eq!([felt(265), felt(264)], [(1, true), (0, true)]);
        assert_eq!([felt(235), felt(234)], [(0, true), (0, false)]);
    }

    /// Seen by the left sensor, which looks from 100 mm to the left: the nearest of the points
    /// right beside it, less than 450 mm away. Beside it means within a tenth of the distance and 8
    /// mm: 25 mm of 170. Of two equally near points the first counts.
    #[test]
    fn the_wall_is_the_nearest_beside_the_sensor() {
        let wall = |points: &[[f32; 2]]| {
            let around = points.iter().map(|[x, y]| Point::new(*x, *y));
            let found = warm_wall(&Surroundings::of(around), 1.0, 0.0);
            found.map(|(wall, _)| [wall.x_mm, wall.y_mm])
        };
        assert_eq!(wall(&[[0.0, 549.0]]), Some([0.0, 549.0]));
        assert_eq!(wall(&[[0.0, 550.0]]), None);
        assert_eq!(wall(&[[0.0, 100.0], [0.0, 270.0]]), Some([0.0, 270.0]));
        assert_eq!(wall(&[[-25.0, 270.0]]), Some([-25.0, 270.0]));
        assert_eq!(wall(&[[25.5, 270.0]]), None);
        assert_eq!(wall(&[[0.0, 270.0], [40.0, 265.0]]), Some([0.0, 270.0]));
        assert_eq!(wall(&[[-5.0, 270.0], [5.0, 270.0]]), Some([-5.0, 270.0]));
        assert_eq!(wall(&[[20.0, 270.0], [0.0, 271.0]]), Some([0.0, 271.0]));
    }

    /// A wall at 49 degrees to the robot, 228 mm before the sensor on its axis. The sensor sees a
    /// victim on it from 32.8 mm before the axis, 190.3 mm away, to 32.8 mm behind the axis, 265.7
    /// mm away. That fills (atan(0.1725) + atan(0.1235)) / 0.61 of its view, and this share of 150
    /// tenths is 72.2. A farther part of the same wall does not count as another wall; at 61
    /// degrees the result is uncertain.
    #[test]
    fn a_wall_seen_obliquely_shows_less_of_somebody() {
        let seen = |degrees: f32| {
            let (sin, cos) = libm::sincosf(degrees.to_radians());
            let wall = (0..=200_i16).map(|n| f32::from(n) * 5.0 - 500.0);
            let wall = wall.map(|at| Point::new(at * cos, 328.0 + at * sin));
            // No point nearer than the axis is beside the sensor.
            let wall = wall.filter(|point| point.x_mm >= 0.0 || point.x_mm < -60.0);
            warm_wall(&Surroundings::of(wall), 1.0, 72.2)
        };
        let (place, share) = seen(49.0).expect("is there");
        assert!(place.distance_mm(Point::new(0.0, 328.0)) < 1.0, "{place:?}");
        assert!((share - 1.0).abs() < 0.01, "{share}");
        assert!(seen(59.0).is_some() && seen(61.0).is_none());
        assert!(seen(-59.0).is_some() && seen(-61.0).is_none());
    }

    /// Behind a board 100 mm away there may be an object 120 mm farther off. An object 121 mm
    /// behind the board causes 150 * atan(50 / 221) / 0.305 = 109.4 tenths, five quarters of which
    /// are 136.8; at the edge of the field of view, 63 mm of 200, it counts as well.
    #[test]
    fn what_is_behind_a_wall_counts_from_its_limits_on() {
        let is_there = |behind: [f32; 2], excess: f32| {
            let points = [[0.0, 170.0], behind].map(|[x, y]| Point::new(x, y));
            warm_wall(&Surroundings::of(points.into_iter()), 1.0, excess).is_some()
        };
        assert!(is_there([0.0, 290.0], 0.0) && !is_there([0.0, 291.0], 0.0));
        assert!(is_there([0.0, 321.0], 136.9) && !is_there([0.0, 321.0], 136.7));
        assert!(is_there([0.0, 321.0], expected(221.0) * 1.25));
        assert!(!is_there([63.0, 300.0], 0.0) && is_there([63.5, 300.0], 0.0));
        // 150 * atan(50 / 170) / 0.305 = 140.7 tenths are the full reading of a victim there.
        let wall = Surroundings::of([Point::new(0.0, 270.0)].into_iter());
        let share = |excess| warm_wall(&wall, 1.0, excess).map(|(_, share)| share);
        assert!((share(140.7).unwrap() - 1.0).abs() < 1e-3);
        assert!((share(70.35).unwrap() - 0.5).abs() < 1e-3);
    }
}
