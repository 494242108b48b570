//! Set of five lidar turns: one filtered distance each half degree.
//!
//! The sensor gives about one sample a degree, each turn at other angles. The distance of a
//! direction is the trimmed mean of its samples of the last turns; a direction with fewer than
//! three samples also uses those of its neighbours. The trimmed mean leaves out the extremes: one
//! outlier changes it as little as the median, and it has less noise. The fielded set has one slot
//! a degree, which holds the last sample, and copies it five times.

use crate::memory::StrayWrites;
use crate::pose::{Point, sin_cos};

/// Directions of a set.
pub(super) const BINS: usize = 720;
/// Turns of a set.
const TURNS: usize = 5;
/// Minimum number of samples for a distance.
const SAMPLES_MIN: usize = 3;
/// Range of the sensor, and the distance beyond which readings are ignored.
const NEAREST_MM: f32 = 150.0;
const FARTHEST_MM: f32 = 5_000.0;
/// Minimum difference of two samples of one direction that belong to two surfaces.
const SURFACE_MM: u16 = 100;
/// Distance that is sent for a direction without a measurement.
pub(super) const NOTHING_MM: i32 = 10_000;
/// The fielded program ignores weaker readings.
const FIELDED_QUALITY_MIN: u8 = 10;
/// Elements of the fielded program's array.
const FIELDED_DIRECTIONS: i32 = 360;

/// Enabled defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// A set is five copies of the newest distances, one a degree.
    pub copies: bool,
    /// Angles are truncated to whole degrees.
    pub whole_degrees: bool,
    /// Distances stay until new ones arrive.
    pub never_ages: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        copies: false,
        whole_degrees: false,
        never_ages: false,
    };
}

/// The last turns and the distances computed from them.
#[derive(Clone, Debug)]
pub(super) struct Scans {
    defects: Defects,
    /// Millimetres by turn and direction; 0: no measurement.
    turns: [[u16; BINS]; TURNS],
    /// Index of the turn that is being filled.
    turn: usize,
    quality: [u8; BINS],
    /// The newest set.
    set_mm: [u16; BINS],
    points: [Point; BINS],
    point_count: usize,
    /// Writes outside the fielded program's array.
    pub(super) stray: StrayWrites,
    pub(super) sets: u32,
}

impl Scans {
    pub(super) const fn new(defects: Defects) -> Self {
        Self {
            defects,
            turns: [[0; BINS]; TURNS],
            turn: 0,
            quality: [0; BINS],
            set_mm: [0; BINS],
            points: [Point::new(0.0, 0.0); BINS],
            point_count: 0,
            stray: StrayWrites::NONE,
            sets: 0,
        }
    }

    /// Takes a sample at `angle_q6`, 64ths of a degree clockwise; `None`: no measurement.
    pub(super) fn sample(&mut self, angle_q6: u16, distance_mm: Option<f32>, quality: u8) {
        let Some(bin) = self.bin(angle_q6) else {
            self.stray
                .note(FIELDED_DIRECTIONS - i32::from(angle_q6 / 64));
            return;
        };
        let is_valid = |it: &f32| match self.defects.copies {
            true => *it > 0.0 && *it < FARTHEST_MM && quality >= FIELDED_QUALITY_MIN,
            false => (NEAREST_MM..=FARTHEST_MM).contains(it),
        };
        let distance_mm = distance_mm.filter(is_valid).map_or(0, to_u16);
        // Two samples of a turn may share a direction: a failed one does not replace a valid one.
        if distance_mm > 0 || self.defects.copies {
            self.quality[bin] = quality;
            self.turns[self.turn][bin] = distance_mm;
        }
    }

    /// Completes a turn: computes its distances, and discards the oldest turn.
    pub(super) fn turn_ends(&mut self) {
        for bin in 0..BINS {
            self.set_mm[bin] = self.combined(bin);
        }
        self.sets = self.sets.saturating_add(1);
        self.draw();
        // The median of five copies is the copy, so storing one turn is enough.
        if !self.defects.copies {
            self.turn = (self.turn + 1) % TURNS;
            self.turns[self.turn] = [0; BINS];
        }
    }

    /// Discards all distances of a silent sensor.
    pub(super) fn forget(&mut self) {
        if self.defects.never_ages {
            return;
        }
        self.turns = [[0; BINS]; TURNS];
        self.set_mm = [0; BINS];
        self.point_count = 0;
    }

    /// The points of the newest set in the robot's frame, by their angles.
    pub(super) fn points(&self) -> &[Point] {
        &self.points[..self.point_count]
    }

    /// Distance in whole millimetres, and quality, in that direction, counter-clockwise from ahead.
    pub(super) fn reading(&self, degrees: usize) -> (i32, i32) {
        let bin = degrees * 2 % BINS;
        let distance_mm = match self.set_mm[bin] {
            0 => NOTHING_MM,
            distance_mm => i32::from(distance_mm),
        };
        (distance_mm, i32::from(self.quality[bin]))
    }

    const fn has_whole_degrees(&self) -> bool {
        self.defects.whole_degrees || self.defects.copies
    }

    /// Index of the direction of an angle, counter-clockwise; the fielded program can leave its
    /// array.
    fn bin(&self, angle_q6: u16) -> Option<usize> {
        if self.has_whole_degrees() {
            let degrees = usize::from(angle_q6 / 64);
            return match self.defects.whole_degrees {
                // Ahead gives index 360, beyond the array's end.
                true => 360_usize.checked_sub(degrees).filter(|it| *it < 360),
                false => Some((720 - degrees % 360) % 360),
            }
            .map(|degrees| degrees * 2);
        }
        let half_degrees = (usize::from(angle_q6) + 16) / 32 % BINS;
        Some((BINS - half_degrees) % BINS)
    }

    /// The distance of a direction.
    fn combined(&self, bin: usize) -> u16 {
        if self.has_whole_degrees() && bin % 2 == 1 {
            return 0;
        }
        if self.defects.copies {
            return self.turns[self.turn][bin];
        }
        let mut samples = Samples::default();
        samples.add(&self.turns, bin);
        if samples.len < SAMPLES_MIN {
            samples.add(&self.turns, (bin + 1) % BINS);
            samples.add(&self.turns, (bin + BINS - 1) % BINS);
        }
        samples.middle()
    }

    fn draw(&mut self) {
        let mut count = 0;
        for (half_degrees, distance_mm) in (0_u16..).zip(self.set_mm) {
            if distance_mm == 0 {
                continue;
            }
            let (sin, cos) = sin_cos((f32::from(half_degrees) / 2.0).to_radians());
            let distance_mm = f32::from(distance_mm);
            self.points[count] = Point::new(distance_mm * cos, distance_mm * sin);
            count += 1;
        }
        self.point_count = count;
    }
}

/// Samples of a direction.
#[derive(Clone, Copy, Debug, Default)]
struct Samples {
    items: [u16; 3 * TURNS],
    len: usize,
}

impl Samples {
    fn add(&mut self, turns: &[[u16; BINS]; TURNS], bin: usize) {
        for turn in turns {
            if turn[bin] != 0 {
                self.items[self.len] = turn[bin];
                self.len += 1;
            }
        }
    }

    /// The mean without a quarter of the samples at each end, but at least one: the median of three
    /// or four. If the samples are of two surfaces, as at the end of a wall, the surface nearer to
    /// the median counts: no point between them was measured. 0 if there are too few samples.
    fn middle(&mut self) -> u16 {
        if self.len < SAMPLES_MIN {
            return 0;
        }
        let items = &mut self.items[..self.len];
        items.sort_unstable();
        let cut = (items.len() / 4).max(1);
        let middle = &items[cut..items.len() - cut];
        let median = middle[(middle.len() - 1) / 2];
        let is_near = |item: &u16| item.abs_diff(median) <= SURFACE_MM;
        let (mut sum, mut count) = (0, 0);
        for item in middle.iter().copied().filter(is_near) {
            (sum, count) = (sum + u32::from(item), count + 1);
        }
        u16::try_from((sum + count / 2) / count).unwrap_or(u16::MAX)
    }
}

/// A valid distance in whole millimetres.
fn to_u16(distance_mm: f32) -> u16 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "saturates, and is below 5000 anyway"
    )]
    let whole = libm::roundf(distance_mm) as u16;
    whole
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    fn middle(items: &[u16]) -> u16 {
        let mut samples = Samples::default();
        samples.items[..items.len()].copy_from_slice(items);
        samples.len = items.len();
        samples.middle()
    }

    /// Means worked out by hand; an outlier at either end does not count.
    #[test]
    fn the_middle_is_without_the_ends() {
        assert_eq!(middle(&[1_000, 1_010]), 0);
        assert_eq!(middle(&[4_000, 1_000, 1_010]), 1_010);
        assert_eq!(middle(&[4_000, 1_000, 1_010, 1_020]), 1_015);
        assert_eq!(middle(&[1_000, 160, 1_003, 1_005, 4_999]), 1_003);
        assert_eq!(middle(&[10, 1, 2, 3, 4, 5, 6, 99]), 5);
    }

    /// A wall ends at 1 m before one at 2 m. By hand: without the ends 1000, 1000, 2000, 2000, 2000
    /// are left. Their median is 2000; no surface is at their mean of 1600.
    #[test]
    fn nothing_is_seen_between_two_surfaces() {
        let items = [2_000, 1_000, 2_010, 1_000, 2_000, 1_000, 2_000];
        assert_eq!(middle(&items), 2_000);
        assert_eq!(middle(&[1_000, 1_000, 2_000, 2_000]), 1_000);
        // A difference of 100 mm belongs to one surface, seen at a flat angle.
        assert_eq!(middle(&[900, 1_000, 1_100, 1_100]), 1_050);
    }

    /// 90 degrees to the right are 270 to the left; a sixteenth of a degree below ahead counts as
    /// ahead.
    #[test]
    fn angles_are_turned_round() {
        let scans = Scans::new(Defects::NONE);
        let bin = |degrees: u16| scans.bin(degrees * 64);
        assert_eq!(
            [0, 1, 90, 359].map(bin),
            [Some(0), Some(718), Some(540), Some(2)]
        );
        assert_eq!(
            [360 * 64 - 4, 15, 16].map(|q6| scans.bin(q6)),
            [Some(0), Some(0), Some(719)]
        );
        // The format's greatest angle is just below 512 degrees, 152 after a whole turn: 208 in the
        // other direction, rounded up.
        assert_eq!(scans.bin(u16::MAX >> 1), Some(416));
    }

    /// Three samples of five turns are enough, two are not; samples of the next half degree help.
    #[test]
    fn three_samples_make_a_distance() {
        let mut scans = Scans::new(Defects::NONE);
        for turn in 0..5 {
            let valid = |turns| (turn < turns).then_some(1_000.0);
            scans.sample(10 * 64, valid(3), 47);
            scans.sample(20 * 64, valid(2), 47);
            scans.sample(30 * 64, valid(2), 47);
            scans.sample(30 * 64 + 32, valid(1), 47);
            scans.turn_ends();
        }
        assert_eq!(scans.reading(350), (1_000, 47));
        assert_eq!(scans.reading(340), (NOTHING_MM, 47));
        assert_eq!(scans.reading(330), (1_000, 47));
        // Another turn without a sample, and the first turn is discarded.
        scans.turn_ends();
        assert_eq!(scans.reading(350).0, NOTHING_MM);
    }

    #[test]
    fn too_near_and_too_far_are_nothing() {
        let mut scans = Scans::new(Defects::NONE);
        for _ in 0..5 {
            for (degrees, distance_mm) in [(1, 149.0), (2, 151.0), (3, 4_999.0), (4, 5_001.0)] {
                scans.sample(degrees * 64, Some(distance_mm), 47);
            }
            scans.turn_ends();
        }
        let told = [359, 358, 357, 356].map(|degrees| scans.reading(degrees).0);
        assert_eq!(told, [NOTHING_MM, 151, 4_999, NOTHING_MM]);
    }

    /// Angles are cut to whole degrees; one program stores at 360 minus the angle, which is outside
    /// its array for an angle of 0; the other wraps it.
    #[test]
    fn fielded_angles_are_whole_degrees() {
        let bins = |defects| {
            let scans = Scans::new(defects);
            [0, 63, 64, 90 * 64 + 32, 359 * 64, 360 * 64, 361 * 64].map(|q6| scans.bin(q6))
        };
        let whole_degrees = Defects {
            whole_degrees: true,
            ..Defects::NONE
        };
        let copies = Defects {
            copies: true,
            ..Defects::NONE
        };
        let found = [None, None, Some(718), Some(540), Some(2), Some(0), None];
        assert_eq!(bins(whole_degrees), found);
        let found = [0, 0, 718, 540, 2, 0, 718].map(Some);
        assert_eq!(bins(copies), found);
        let mut scans = Scans::new(whole_degrees);
        scans.sample(0, Some(1_000.0), 47);
        scans.sample(64, Some(1_000.0), 47);
        let ahead = StrayWrites {
            count: 1,
            first: 360,
            last: 360,
        };
        assert_eq!((scans.stray, scans.turns[0][718]), (ahead, 1_000));
    }

    /// A copied set holds the last sample, good or not; weak and far readings do not count.
    #[test]
    fn a_copied_set_holds_what_came_last() {
        let copies = Defects {
            copies: true,
            ..Defects::NONE
        };
        let mut scans = Scans::new(copies);
        let mut told = |distance_mm, quality| {
            scans.sample(10 * 64, distance_mm, quality);
            scans.turn_ends();
            scans.reading(350)
        };
        assert_eq!(told(Some(20.0), 10), (20, 10));
        assert_eq!(told(Some(900.0), 9), (NOTHING_MM, 9));
        assert_eq!(told(Some(4_999.0), 47), (4_999, 47));
        assert_eq!(told(Some(5_000.0), 47).0, NOTHING_MM);
        assert_eq!(
            (told(Some(700.0), 47), told(None, 47)),
            ((700, 47), (NOTHING_MM, 47))
        );
        assert_eq!(scans.sets, 6);
    }

    /// Points lie at half degrees counter-clockwise; after `forget` there are none, except in the
    /// program that never forgets.
    #[test]
    fn a_set_is_drawn_counter_clockwise() {
        let seen = |never_ages| {
            let mut scans = Scans::new(Defects {
                never_ages,
                ..Defects::NONE
            });
            for _ in 0..3 {
                scans.sample(90 * 64, Some(1_000.0), 47);
                scans.sample(270 * 64 + 32, Some(2_000.0), 47);
                scans.turn_ends();
            }
            let points = scans.points().to_vec();
            scans.forget();
            (points, scans.points().len())
        };
        let (points, after) = seen(false);
        // The neighbouring half degrees use its samples as well.
        assert_eq!((points.len(), after, seen(true).1), (6, 0, 6));
        // 270.5 degrees clockwise are 89.5 counter-clockwise.
        let (sin, cos) = sin_cos(89.5_f32.to_radians());
        assert!(points[1].distance_mm(Point::new(2_000.0 * cos, 2_000.0 * sin)) < 0.1);
        assert!(
            points[4].distance_mm(Point::new(0.0, -1_000.0)) < 0.1,
            "{points:?}"
        );
    }
}
