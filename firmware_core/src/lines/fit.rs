//! A straight line through points.

use super::{Line, Settings};
use crate::pose::{Point, sin_cos};

/// A line through a run of points: its ends, and its direction from the first to the last.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Fit {
    pub(super) start: Point,
    pub(super) end: Point,
    direction: [f32; 2],
}

impl Fit {
    /// The line with the least sum of squared perpendicular distances; its ends are the points on
    /// it nearest to the first and the last point.
    pub(super) fn of(points: impl Iterator<Item = Point> + Clone, settings: &Settings) -> Self {
        let mut all = points.clone();
        let Some(first) = all.next() else {
            return Self::default();
        };
        let last = all.last().unwrap_or(first);
        let chord = Self::chord(first, last);
        if settings.defects.draws_chords {
            return chord;
        }
        // Relative to the first point, so that the squares of distant points do not lose digits.
        let local = points.map(|point| [point.x_mm - first.x_mm, point.y_mm - first.y_mm]);
        let (mut count, mut sum) = (0.0, [0.0_f32; 2]);
        for [x, y] in local.clone() {
            count += 1.0;
            sum = [sum[0] + x, sum[1] + y];
        }
        let mean = sum.map(|sum| sum / count);
        let (mut xx_yy, mut xy) = (0.0, 0.0);
        for [x, y] in local {
            let [x, y] = [x - mean[0], y - mean[1]];
            xx_yy += x * x - y * y;
            xy += x * y;
        }
        let (sin, cos) = sin_cos(libm::atan2f(2.0 * xy, xx_yy) / 2.0);
        let sign = match cos * chord.direction[0] + sin * chord.direction[1] < 0.0 {
            true => -1.0,
            false => 1.0,
        };
        let direction = [cos * sign, sin * sign];
        let on_line = |point: Point| {
            let [x, y] = [
                point.x_mm - first.x_mm - mean[0],
                point.y_mm - first.y_mm - mean[1],
            ];
            let along = x * direction[0] + y * direction[1];
            Point::new(
                first.x_mm + mean[0] + along * direction[0],
                first.y_mm + mean[1] + along * direction[1],
            )
        };
        Self {
            start: on_line(first),
            end: on_line(last),
            direction,
        }
    }

    /// The line from point to point.
    fn chord(start: Point, end: Point) -> Self {
        let length = start.distance_mm(end);
        let direction = match length > 0.0 {
            true => [
                (end.x_mm - start.x_mm) / length,
                (end.y_mm - start.y_mm) / length,
            ],
            false => [1.0, 0.0],
        };
        Self {
            start,
            end,
            direction,
        }
    }

    pub(super) const fn line(&self) -> Line {
        Line {
            start: self.start,
            end: self.end,
        }
    }

    /// Distance of a point from this line, extended.
    pub(super) fn beside_mm(&self, point: Point) -> f32 {
        let (dx, dy) = (point.x_mm - self.start.x_mm, point.y_mm - self.start.y_mm);
        (dy * self.direction[0] - dx * self.direction[1]).abs()
    }

    /// Cosine of the change of direction from this line to `next`.
    pub(super) fn cos_to(&self, next: &Self) -> f32 {
        self.direction[0] * next.direction[0] + self.direction[1] * next.direction[1]
    }

    /// Intersection of both lines, extended; `None` if they are nearly parallel.
    pub(super) fn crossing(&self, other: &Self) -> Option<Point> {
        let [[ax, ay], [bx, by]] = [self.direction, other.direction];
        let sin = ax * by - ay * bx;
        if sin.abs() < 0.1 {
            return None;
        }
        let (dx, dy) = (
            other.start.x_mm - self.start.x_mm,
            other.start.y_mm - self.start.y_mm,
        );
        let along = (dx * by - dy * bx) / sin;
        Some(Point::new(
            self.start.x_mm + along * ax,
            self.start.y_mm + along * ay,
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_mm: f32, y_mm: f32) -> Point {
        Point::new(x_mm, y_mm)
    }

    /// A triangle of 3, 4 and 5; between two equal points no direction is better than another.
    #[test]
    fn a_chord_runs_from_point_to_point() {
        let chord = Fit::chord(at(10.0, 20.0), at(40.0, -20.0));
        assert_eq!(chord.direction, [0.6, -0.8]);
        assert_eq!(Fit::chord(at(1.0, 1.0), at(1.0, 1.0)).direction, [1.0, 0.0]);
    }

    /// x = 10 + 4 s, y = 20 + 3 s, and points 5 to both sides of it, which cancel out. Backwards
    /// the line has the other direction.
    #[test]
    fn a_line_is_fitted_through_the_middle_of_its_points() {
        let steps = [
            (0.0, 0.0),
            (10.0, 5.0),
            (20.0, -5.0),
            (30.0, -5.0),
            (40.0, 5.0),
            (50.0, 0.0),
        ];
        let points = steps
            .map(|(s, off): (f32, f32)| at(10.0 + 4.0 * s - 0.6 * off, 20.0 + 3.0 * s + 0.8 * off));
        let settings = Settings::default();
        let fit = Fit::of(points.into_iter(), &settings);
        let back = Fit::of(points.into_iter().rev(), &settings);
        let is = |found: [f32; 2], expected: [f32; 2]| {
            (found[0] - expected[0]).abs() < 0.01 && (found[1] - expected[1]).abs() < 0.01
        };
        assert!(
            is(fit.direction, [0.8, 0.6]) && is(back.direction, [-0.8, -0.6]),
            "{fit:?}"
        );
        assert!(fit.start.distance_mm(at(10.0, 20.0)) < 0.1, "{fit:?}");
        assert!(fit.end.distance_mm(at(210.0, 170.0)) < 0.1, "{fit:?}");
        assert!((fit.cos_to(&back) + 1.0).abs() < 1e-4);
        assert_eq!((fit.line().start, fit.line().end), (fit.start, fit.end));
    }

    /// The lines (0, 10) + s (4, 3) and (100, 0) + s (0, 1) meet at (100, 85). Lines less than 5.7
    /// degrees apart have no intersection.
    #[test]
    fn two_lines_meet_where_both_would_go_on_to() {
        let (one, other) = (
            Fit::chord(at(0.0, 10.0), at(40.0, 40.0)),
            Fit::chord(at(100.0, 0.0), at(100.0, 7.0)),
        );
        for crossing in [one.crossing(&other), other.crossing(&one)] {
            let crossing = crossing.expect("they are not parallel");
            assert!(crossing.distance_mm(at(100.0, 85.0)) < 0.01, "{crossing:?}");
        }
        let level = Fit::chord(at(0.0, 0.0), at(100.0, 0.0));
        let meets = |y_mm: f32| level.crossing(&Fit::chord(at(0.0, 50.0), at(100.0, y_mm)));
        assert_eq!((meets(59.9), meets(40.1)), (None, None));
        assert!(meets(60.1).is_some() && meets(39.9).is_some());
    }

    /// Deviations from the mean (150, 22.5): the sums of squares are 50,000 along x and 1,475 along
    /// y, which differ by 48,525. Twice the sum of products, 8,500, is 17,000. The line's angle is
    /// half of that of (48,525, 17,000): 0.168 rad. The ends were worked out with a calculator.
    #[test]
    fn a_line_leans_to_where_its_points_do() {
        let points = [(0.0, 0.0), (100.0, 20.0), (200.0, 10.0), (300.0, 60.0)];
        let points = points.map(|(x, y)| at(x + 1_000.0, y - 500.0));
        let fit = Fit::of(points.into_iter(), &Settings::default());
        assert!((fit.direction[0] - 0.985_511).abs() < 1e-5, "{fit:?}");
        assert!((fit.direction[1] - 0.169_613).abs() < 1e-5);
        assert!(fit.start.distance_mm(at(1_000.554, -503.221)) < 0.01);
        assert!(fit.end.distance_mm(at(1_301.953, -451.348)) < 0.01);
    }

    /// Nearly along y, from below to above and back: the signs of x and y must both count.
    #[test]
    fn a_line_points_from_its_first_point_to_its_last() {
        let points = [(3.0, 0.0), (2.0, 100.0), (0.0, 200.0), (-1.0, 300.0)].map(|(x, y)| at(x, y));
        for (angle, swap) in [(0, false), (0, true), (1, false), (1, true)] {
            let turned = points.map(|point| match angle {
                0 => point,
                _ => at(point.y_mm, point.x_mm),
            });
            let settings = Settings::default();
            let fit = match swap {
                false => Fit::of(turned.into_iter(), &settings),
                true => Fit::of(turned.into_iter().rev(), &settings),
            };
            let (first, last) = if swap { (3, 0) } else { (0, 3) };
            let way = [
                turned[last].x_mm - turned[first].x_mm,
                turned[last].y_mm - turned[first].y_mm,
            ];
            let along = way[0] * fit.direction[0] + way[1] * fit.direction[1];
            assert!((along - 300.0).abs() < 0.1, "{angle} {swap}: {fit:?}");
        }
    }
}
