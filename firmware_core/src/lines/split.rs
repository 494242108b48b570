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
