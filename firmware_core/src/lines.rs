//! Straight walls in a scan: split and merge.
//!
//! ```text
//! points by angle --gap--> regions --split at the farthest--> segments --merge--> lines
//! ```
//!
//! A region ends where two neighbouring points are far apart; the scan is a circle, so one region
//! may lie across its beginning. A segment is complete if all its points lie near its chord;
//! otherwise it is split at the farthest point. Neighbouring segments that continue nearly straight
//! are merged. Each remaining segment is fitted by least squares of the perpendicular distances.
//! Two lines that share a point meet where they cross. Figures and the fielded faults: public code
//! of a course's robot, its lidar's task; the fit and the circle are our own.

mod fit;
mod split;

use crate::pose::Point;
use fit::Fit;
use split::Splitter;

/// Maximum number of lines that are found.
pub const LINES_MAX: usize = 20;
/// Maximum number of segments before they are merged.
const SEGMENTS_MAX: usize = 64;

/// Distance from two lines, in tolerances, from which a point between them belongs to neither.
const ALONE: f32 = 2.0;

/// The ends of a line, in the order of the points.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Line {
    /// The end with the smaller angle.
    pub start: Point,
    /// The other end.
    pub end: Point,
}

/// Settings of the line search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Neighbouring points farther apart than this belong to different regions.
    pub gap_mm: f32,
    /// Maximum distance of a point from its line.
    pub tolerance_mm: f32,
    /// Neighbours become one line if the angle between them, seen from inside, is larger.
    pub merge_deg: f32,
    /// Minimum number of points of a line.
    pub points_min: u16,
    /// Enabled defects of the fielded program.
    pub defects: Defects,
}

impl Settings {
    /// The fielded figures.
    pub const DEFAULT: Self = Self {
        gap_mm: 300.0,
        tolerance_mm: 60.0,
        merge_deg: 170.0,
        points_min: 3,
        defects: Defects::NONE,
    };
}

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Enabled defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The cosine of the change of direction is compared with 10 degrees in radians: everything
    /// below 79.95 degrees is merged.
    pub merges_below_80_deg: bool,
    /// Regions with too few points are erased in a loop that goes forward: the region behind an
    /// erased one is skipped.
    pub skips_behind_erased: bool,
    /// The last point of a region counts twice.
    pub duplicates_last: bool,
    /// The first point of a region is left out.
    pub drops_first: bool,
    /// A line goes from its first to its last point, without regard to those between, and a region
    /// ends where the scan begins.
    pub draws_chords: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        merges_below_80_deg: false,
        skips_behind_erased: false,
        duplicates_last: false,
        drops_first: false,
        draws_chords: false,
    };
}

/// The lines of a scan.
#[derive(Clone, Debug)]
pub struct Lines {
    lines: [Line; LINES_MAX],
    len: usize,
    left_out: u32,
}

/// A run of points, by their indices from the circle's start; both ends belong to the run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Segment {
    first: usize,
    last: usize,
    fit: Fit,
}

impl Lines {
    /// No lines.
    pub const NONE: Self = Self {
        lines: [Line {
            start: Point::new(0.0, 0.0),
            end: Point::new(0.0, 0.0),
        }; LINES_MAX],
        len: 0,
        left_out: 0,
    };

    /// Finds the lines of a scan. The points must be in the order of their angles around the
    /// sensor, counter-clockwise.
    pub fn find(points: &[Point], settings: &Settings) -> Self {
        let mut lines = Self::NONE;
        let circle = Circle::new(points, settings);
        let mut segments = Splitter::new(&circle, settings).segments();
        segments.merge(&circle, settings);
        if !settings.defects.draws_chords {
            segments.join(&circle, settings);
        }
        for segment in segments.as_slice() {
            lines.push(segment.fit.line());
        }
        lines.left_out = lines.left_out.saturating_add(segments.left_out);
        lines
    }

    /// The lines, in the order of their points.
    pub fn as_slice(&self) -> &[Line] {
        &self.lines[..self.len]
    }

    /// Number of lines for which there was no room.
    pub const fn left_out(&self) -> u32 {
        self.left_out
    }

    fn push(&mut self, line: Line) {
        match self.lines.get_mut(self.len) {
            Some(slot) => {
                *slot = line;
                self.len += 1;
            }
            None => self.left_out = self.left_out.saturating_add(1),
        }
    }
}

/// The points of a scan as a circle that starts at the start of a region.
#[derive(Clone, Copy, Debug)]
struct Circle<'a> {
    points: &'a [Point],
    begin: usize,
    /// There is no gap: the walls enclose the sensor.
    is_closed: bool,
}

impl<'a> Circle<'a> {
    fn new(points: &'a [Point], settings: &Settings) -> Self {
        let open = Self {
            points,
            begin: 0,
            is_closed: false,
        };
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            return open;
        };
        if settings.defects.draws_chords {
            return open;
        }
        let count = points.len();
        let before = |at: usize| points[(at + count - 1) % count];
        let is_gap = |at: &usize| before(*at).distance_mm(points[*at]) > settings.gap_mm;
        if let Some(begin) = (0..count).find(is_gap) {
            return Self { begin, ..open };
        }
        // The last point connects to the first only if the walls enclose the sensor.
        if last.x_mm * first.y_mm - last.y_mm * first.x_mm <= 0.0 {
            return open;
        }
        // Without a gap start at a corner: the point farthest from any given point is one.
        let corner = (0..count).max_by(|a, b| {
            let [a, b] = [*a, *b].map(|at| points[at].distance_mm(*first));
            a.total_cmp(&b)
        });
        Self {
            begin: corner.unwrap_or(0),
            is_closed: true,
            ..open
        }
    }

    /// Number of points to process: a closed circle ends with its first point.
    fn len(&self) -> usize {
        self.points.len() + usize::from(self.is_closed)
    }

    /// The point at this index from the start.
    fn at(&self, place: usize) -> Point {
        self.points[(self.begin + place) % self.points.len()]
    }

    /// The points with these indices.
    fn run(&self, first: usize, last: usize) -> impl Iterator<Item = Point> + Clone {
        (first..=last).map(|place| self.at(place))
    }
}

/// Segments in the order of their points.
#[derive(Clone, Debug)]
struct Segments {
    items: [Segment; SEGMENTS_MAX],
    len: usize,
    left_out: u32,
}

impl Segments {
    fn as_slice(&self) -> &[Segment] {
        &self.items[..self.len]
    }

    fn push(&mut self, segment: Segment) {
        match self.items.get_mut(self.len) {
            Some(slot) => {
                *slot = segment;
                self.len += 1;
            }
            None => self.left_out = self.left_out.saturating_add(1),
        }
    }

    fn remove(&mut self, at: usize) {
        self.items.copy_within(at + 1..self.len, at);
        self.len -= 1;
    }

    /// Merges neighbours that continue nearly straight, including the last and the first.
    fn merge(&mut self, circle: &Circle<'_>, settings: &Settings) {
        let mut at = 0;
        while at + 1 < self.len {
            if goes_on(&self.items[at], &self.items[at + 1], settings) {
                self.unite(at, at + 1, circle, settings);
            } else {
                at += 1;
            }
        }
        if self.len > 1 && goes_on(&self.items[at], &self.items[0], settings) {
            self.unite(at, 0, circle, settings);
        }
    }

    /// Merges the segment at `at` and the segment at `next`, which follows it on the circle.
    fn unite(&mut self, at: usize, next: usize, circle: &Circle<'_>, settings: &Settings) {
        let [a, b] = [self.items[at], self.items[next]];
        let turn = circle.points.len();
        // A line across the beginning has its end a turn later.
        let last = if next < at { b.last + turn } else { b.last };
        let last = last.min(a.first + turn);
        // A point between them that is far from both belongs to neither.
        let far_mm = settings.tolerance_mm * ALONE;
        let is_of = |point: &Point| [a, b].iter().any(|it| it.fit.beside_mm(*point) <= far_mm);
        let fit = Fit::of(circle.run(a.first, last).filter(is_of), settings);
        self.items[at] = Segment { fit, last, ..a };
        self.remove(next);
    }

    /// Moves the common end of neighbouring lines to their intersection.
    fn join(&mut self, circle: &Circle<'_>, settings: &Settings) {
        let turn = circle.points.len();
        for at in 0..self.len {
            let next = (at + 1) % self.len;
            let [a, b] = [self.items[at], self.items[next]];
            if at == next || a.last % turn != b.first % turn {
                continue;
            }
            let corner = circle.at(a.last);
            let near = |cross: &Point| cross.distance_mm(corner) <= settings.tolerance_mm;
            if let Some(cross) = a.fit.crossing(&b.fit).filter(near) {
                self.items[at].fit.end = cross;
                self.items[next].fit.start = cross;
            }
        }
    }
}

/// Whether `b` continues where `a` ends, nearly straight.
fn goes_on(a: &Segment, b: &Segment, settings: &Settings) -> bool {
    if a.fit.end.distance_mm(b.fit.start) > settings.tolerance_mm {
        return false;
    }
    let cos = a.fit.cos_to(&b.fit);
    let change_deg = 180.0 - settings.merge_deg;
    if settings.defects.merges_below_80_deg {
        return cos > change_deg.to_radians();
    }
    cos > libm::cosf(change_deg.to_radians())
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;

    /// A segment between two positions.
    fn segment(start: (f32, f32), end: (f32, f32)) -> Segment {
        let [start, end] = [start, end].map(|(x, y)| Point::new(x, y));
        let settings = Settings::default();
        let fit = Fit::of([start, end].into_iter(), &settings);
        Segment {
            first: 0,
            last: 1,
            fit,
        }
    }

    /// Lines are merged up to a gap of 60 mm and an angle of 10 degrees, whose tangent is 0.1763.
    /// The fielded program merged below 79.95 degrees, whose tangent is 5.64.
    #[test]
    fn a_line_goes_on_nearly_straight_behind_a_small_gap() {
        let before = segment((0.0, 0.0), (400.0, 0.0));
        let is_one = |defects, start: f32, rise: f32| {
            let settings = Settings {
                defects,
                ..Settings::default()
            };
            let behind = segment((start, 0.0), (start + 100.0, 100.0 * rise));
            goes_on(&before, &behind, &settings)
        };
        let sound = |start, rise| is_one(Defects::NONE, start, rise);
        assert!(sound(460.0, 0.0) && !sound(461.0, 0.0) && sound(340.0, 0.0));
        assert!(sound(410.0, 0.175) && sound(410.0, -0.175));
        assert!(!sound(410.0, 0.178) && !sound(410.0, -0.178));
        let merges_below_80_deg = Defects {
            merges_below_80_deg: true,
            ..Defects::NONE
        };
        assert!(
            is_one(merges_below_80_deg, 410.0, 5.5) && !is_one(merges_below_80_deg, 410.0, 5.8)
        );
    }

    /// Three points within 40 mm are a line. It is the only line, so there is no other to merge it
    /// with.
    #[test]
    fn a_short_line_alone_stays() {
        let points = [0.0, 20.0, 40.0].map(|y| Point::new(1_000.0, y));
        let lines = Lines::find(&points, &Settings::default());
        assert_eq!(
            lines.as_slice(),
            [Line {
                start: points[0],
                end: points[2]
            }]
        );
    }

    /// A wall of 1 m, 1 m ahead, a point each 20 mm. One ray goes through a hole in its middle, and
    /// ends 2 m behind it.
    #[test]
    fn a_point_behind_a_wall_does_not_turn_its_line() {
        let point = |at: i8| {
            let x_mm = if at == 0 { 3_000.0 } else { 1_000.0 };
            Point::new(x_mm, f32::from(at) * 20.0)
        };
        let points: Vec<Point> = (-25..=25).map(point).collect();
        let wall = [-500.0, 500.0].map(|y| Point::new(1_000.0, y));
        let [start, end] = wall;
        let lines = Lines::find(&points, &Settings::default());
        assert_eq!(lines.as_slice(), [Line { start, end }]);
    }

    /// A spiral, each point twice as far as the one before and a quarter turn on. The farthest
    /// point from each chord is the last but one, so that each bend waits for the next. Splitting
    /// stops when the stack is full, and the rest becomes one more line.
    #[test]
    fn a_line_with_too_many_bends_is_split_as_far_as_there_is_room() {
        let place = |index: u8| {
            let far = libm::powf(1.5, index.into());
            let [x, y] = [[far, 0.0], [0.0, far], [-far, 0.0], [0.0, -far]][usize::from(index % 4)];
            Point::new(x, y)
        };
        let found = |count: u8| {
            let points: Vec<Point> = (0..count).map(place).collect();
            let settings = Settings {
                gap_mm: f32::INFINITY,
                points_min: 2,
                tolerance_mm: 0.01,
                ..Settings::default()
            };
            let lines = Lines::find(&points, &settings);
            lines.as_slice().len() + lines.left_out() as usize
        };
        assert_eq!([10, 62, 66].map(found), [9, 61, 64]);
        assert_eq!(found(82), 64);
    }

    /// Eight points along x, indices 0 to 7 of a turn. Two merged pieces end where the second ends.
    /// If the turn's last piece is merged with its first, that index is one turn higher.
    #[test]
    fn united_segments_end_where_the_second_ends() {
        let points: Vec<Point> = (0..8_u8)
            .map(|n| Point::new(f32::from(n) * 10.0, 0.0))
            .collect();
        let settings = Settings::default();
        let circle = Circle {
            points: &points,
            begin: 0,
            is_closed: true,
        };
        let united = |at: usize, next: usize| {
            let piece = |first, last| Segment {
                first,
                last,
                fit: Fit::of(circle.run(first, last), &settings),
            };
            let mut segments = Segments {
                items: [piece(0, 1); SEGMENTS_MAX],
                len: 0,
                left_out: 0,
            };
            for (first, last) in [(0, 2), (2, 4), (5, 7)] {
                segments.push(piece(first, last));
            }
            segments.unite(at, next, &circle, &settings);
            segments
                .as_slice()
                .iter()
                .map(|one| (one.first, one.last))
                .collect::<Vec<_>>()
        };
        assert_eq!(united(0, 1), [(0, 4), (5, 7)]);
        assert_eq!(united(1, 2), [(0, 2), (2, 7)]);
        assert_eq!(united(2, 0), [(2, 4), (5, 10)]);
    }
}
