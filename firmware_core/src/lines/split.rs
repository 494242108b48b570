//! Regions, and their split into segments.

use super::fit::Fit;
use super::{Circle, SEGMENTS_MAX, Segment, Segments, Settings};
use crate::pose::Point;

/// Cuts a circle of points into segments.
#[derive(Clone, Debug)]
pub(super) struct Splitter<'a> {
    circle: &'a Circle<'a>,
    settings: &'a Settings,
    segments: Segments,
    /// The segment before was erased, so the fielded loop skips this one.
    skips: bool,
}

impl<'a> Splitter<'a> {
    pub(super) fn new(circle: &'a Circle<'a>, settings: &'a Settings) -> Self {
        Self {
            circle,
            settings,
            segments: Segments {
                items: [Segment::default(); SEGMENTS_MAX],
                len: 0,
                left_out: 0,
            },
            skips: false,
        }
    }

    /// All segments with enough points.
    pub(super) fn segments(mut self) -> Segments {
        let len = self.circle.len();
        let mut first = 0;
        for next in 1..=len {
            let is_cut = next == len || {
                let [a, b] = [self.circle.at(next - 1), self.circle.at(next)];
                a.distance_mm(b) > self.settings.gap_mm
            };
            if is_cut {
                let dropped = usize::from(self.settings.defects.drops_first);
                if first + dropped < next {
                    self.split(first + dropped, next - 1);
                }
                first = next;
            }
        }
        self.segments
    }

    /// Splits a region at its bends. The remaining ends wait on a stack; when the stack is full,
    /// the splitting stops.
    fn split(&mut self, first: usize, last: usize) {
        let mut ends = [0; SEGMENTS_MAX];
        ends[0] = last;
        let (mut first, mut waiting) = (first, 1);
        while waiting > 0 {
            let last = ends[waiting - 1];
            match self.farthest(first, last) {
                Some(bend) if waiting < SEGMENTS_MAX => {
                    ends[waiting] = bend;
                    waiting += 1;
                }
                _ => {
                    self.keep(first, last);
                    first = last;
                    waiting -= 1;
                }
            }
        }
    }

    /// The index of the point farthest from the chord, if that is too far.
    fn farthest(&self, first: usize, last: usize) -> Option<usize> {
        let [from, to] = [self.circle.at(first), self.circle.at(last)];
        let mut farthest = (self.settings.tolerance_mm, None);
        for place in first + 1..last {
            let beside = beside_mm(from, to, self.circle.at(place));
            if beside > farthest.0 {
                farthest = (beside, Some(place));
            }
        }
        farthest.1
    }

    /// Takes a segment if it has enough points.
    fn keep(&mut self, first: usize, last: usize) {
        let defects = &self.settings.defects;
        let points = last - first + 1 + usize::from(defects.duplicates_last);
        let is_short = points < usize::from(self.settings.points_min);
        if is_short && !(defects.skips_behind_erased && self.skips) {
            self.skips = true;
            return;
        }
        self.skips = false;
        let fit = Fit::of(self.circle.run(first, last), self.settings);
        self.segments.push(Segment { first, last, fit });
    }
}

/// Distance of a point from the chord; a closed chord is a single point.
fn beside_mm(from: Point, to: Point, point: Point) -> f32 {
    let length = from.distance_mm(to);
    // Below the resolution of a lidar: such a chord has no direction.
    if length < 1.0 {
        return from.distance_mm(point);
    }
    let (dx, dy) = (to.x_mm - from.x_mm, to.y_mm - from.y_mm);
    let across = dy * (point.x_mm - from.x_mm) - dx * (point.y_mm - from.y_mm);
    across.abs() / length
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::lines::Defects;

    /// First and last index of each segment of these points.
    fn segments(points: &[(f32, f32)], defects: Defects) -> Vec<(usize, usize)> {
        let points: Vec<Point> = points.iter().map(|(x, y)| Point::new(*x, *y)).collect();
        let circle = Circle {
            points: &points,
            begin: 0,
            is_closed: false,
        };
        let settings = Settings {
            defects,
            ..Settings::DEFAULT
        };
        let found = Splitter::new(&circle, &settings).segments();
        let places = found.as_slice().iter().map(|it| (it.first, it.last));
        places.collect()
    }

    /// Distance from a line of 3, 4 and 5; for a line shorter than a millimetre, the distance from
    /// its point.
    #[test]
    fn a_point_lies_beside_its_chord() {
        let beside = |(x, y), (px, py)| {
            beside_mm(Point::new(1.0, 2.0), Point::new(x, y), Point::new(px, py))
        };
        assert_eq!(beside((101.0, 2.0), (51.0, 32.0)), 30.0);
        assert_eq!(beside((1.0, 102.0), (-19.0, 52.0)), 20.0);
        // The distance is (40 * 40 - 30 * 30) / 50 = 14.
        assert_eq!(beside((31.0, 42.0), (41.0, 32.0)), 14.0);
        assert_eq!(beside((2.0, 2.0), (4.0, 6.0)), 4.0);
        assert_eq!(beside((1.5, 2.0), (4.0, 6.0)), 5.0);
    }

    /// 300 mm are no gap yet. Three points are a segment; a program that drops the first point of
    /// each region, or counts the last one twice, counts one less or more.
    #[test]
    fn a_region_ends_at_a_gap() {
        let row = |xs: &[f32]| xs.iter().map(|x| (*x, 1_000.0)).collect::<Vec<_>>();
        let two = row(&[0.0, 100.0, 200.0, 500.0, 801.0, 901.0, 1_001.0]);
        assert_eq!(segments(&two, Defects::NONE), [(0, 3), (4, 6)]);
        let drops_first = Defects {
            drops_first: true,
            ..Defects::NONE
        };
        assert_eq!(segments(&two, drops_first), [(1, 3)]);
        let pair = row(&[0.0, 100.0]);
        let duplicates_last = Defects {
            duplicates_last: true,
            ..Defects::NONE
        };
        assert_eq!(segments(&pair, Defects::NONE), []);
        assert_eq!(segments(&pair, duplicates_last), [(0, 1)]);
        assert_eq!(segments(&pair[..1], duplicates_last), []);
        assert_eq!(segments(&[], Defects::NONE), []);
    }

    /// A roof with its ridge 60 mm from the chord is one line, and two if the ridge is higher.
    #[test]
    fn a_bend_is_more_than_60_mm_high() {
        let roof = |ridge: f32| {
            let half = ridge / 2.0;
            let points = [
                (0.0, 0.0),
                (50.0, half),
                (100.0, ridge),
                (150.0, half),
                (200.0, 0.0),
            ];
            segments(&points, Defects::NONE)
        };
        assert_eq!(roof(60.0), [(0, 4)]);
        assert_eq!([roof(60.5), roof(-90.0)], [[(0, 2), (2, 4)]; 2]);
    }

    /// Three pairs of points, each too short: the fielded loop skips the one behind an erased one.
    #[test]
    fn the_segment_behind_an_erased_one_may_be_kept() {
        let pairs = [0.0, 100.0, 1_000.0, 1_100.0, 2_000.0, 2_100.0].map(|x| (x, 0.0));
        let skips_behind_erased = Defects {
            skips_behind_erased: true,
            ..Defects::NONE
        };
        assert_eq!(segments(&pairs, Defects::NONE), []);
        assert_eq!(segments(&pairs, skips_behind_erased), [(2, 3)]);
    }
}
