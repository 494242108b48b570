//! Checks that the lines that the robot reports are those of its scan.

use core::time::Duration;
use std::collections::VecDeque;
use std::sync::Arc;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use crate::rig::Rig;
use crate::robots::Instruments;
use crate::scenario::FaultSpec;

/// Maximum time from the search for lines until the station has them.
const AGE: Duration = Duration::from_millis(1_500);
/// Distance between neighbouring points beyond which they belong to different walls, and maximum
/// distance of a point from its line, millimetres.
const GAP_MM: f64 = 300.0;
const NEAR_MM: f64 = 75.0;
/// Maximum distance of the points from a line of pieces that bend by up to 10 degrees, as a share
/// of the line's length.
const BENT: f64 = 0.05;
/// Minimum number of points of a line.
const POINTS_MIN: usize = 3;
/// Minimum distance between the points of two walls in one sequence of points. It is also the
/// maximum distance of a line's end from its point if another line may move the end; otherwise that
/// is `AT_POINT_MM`. Both in millimetres.
const JUMP_MM: f64 = 60.0;
const AT_POINT_MM: f64 = 8.0;
/// Maximum number of points of a corner that a line cuts off.
const CORNER: usize = 5;
/// A smooth wall: its minimum length and number of points, the maximum distance of the points from
/// its line, and that of their middle, millimetres.
const LONG_MM: f64 = 500.0;
const MANY: usize = 20;
const SMOOTH_MM: f64 = 20.0;
const BESIDE_MM: f64 = 2.5;
/// Maximum distance and bend, in millimetres and radians, of two lines that count as one.
const JOINED_MM: f64 = 50.0;
const GOES_ON_RAD: f64 = 0.07;
/// Minimum number of points of a straight wall that a line must cover, and their maximum distance
/// from the chord, millimetres.
const WALL: usize = 12;
const STRAIGHT_MM: f64 = 10.0;
/// Number of points at each end of a wall that one line must cover, and the maximum distance of the
/// line from the outermost of these points, millimetres.
const END: usize = 6;
const END_MM: f64 = 5.0;
/// Maximum number of lines that the robot reports; it omits further ones.
const LINES_MAX: usize = 20;

type Point = [f64; 2];
type Line = [Point; 2];

/// The reported lines are the walls in the points of the scan: each line has points, each straight
/// wall has a line.
#[derive(Clone)]
pub struct LinesTrue {
    instruments: Arc<dyn Instruments>,
    calm: Calm,
    /// Recent scans.
    scans: VecDeque<(Instant, Vec<Point>)>,
    told_at: Option<Instant>,
    reports: u64,
    broken: Option<(Instant, String)>,
}

impl LinesTrue {
    /// Observes the lines of `instruments` while the links of its station and its drive are `calm`.
    pub const fn new(instruments: Arc<dyn Instruments>, calm: Calm) -> Self {
        Self {
            instruments,
            calm,
            scans: VecDeque::new(),
            told_at: None,
            reports: 0,
            broken: None,
        }
    }
}

impl Checker for LinesTrue {
    fn observe(&mut self, look: &Look<'_>) {
        let now = look.rig.now();
        let points = self.instruments.searched_points(look.rig);
        if self
            .scans
            .back()
            .is_none_or(|(_, newest)| *newest != points)
        {
            self.scans.push_back((now, points));
        }
        // The scan before the oldest change was in use until then.
        while self.scans.get(1).is_some_and(|(at, _)| now - *at > AGE) {
            self.scans.pop_front();
        }
        let Some((at, lines)) = self.instruments.told_lines(look.rig) else {
            return;
        };
        if self.told_at.replace(at) == Some(at) || !self.calm.is(now) {
            return;
        }
        self.reports += 1;
        let mut found = self
            .scans
            .iter()
            .map(|(_, points)| difference(&lines, points));
        let newest = found.next_back().flatten();
        if let Some(what) = newest.filter(|_| found.all(|other| other.is_some())) {
            self.broken.get_or_insert((now, what));
        }
    }

    fn verdict(&self) -> Check {
        let detail = match &self.broken {
            Some((at, what)) => format!("at {at} s {what}"),
            None if self.reports == 0 => "no lines were reported".to_owned(),
            None => format!("{} reports of lines agree with the scan", self.reports),
        };
        Check::new("lines-true", self.broken.is_none(), detail).if_observed(self.reports > 0)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.calm.renew(faults, rig);
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

/// The first difference of `lines` from a scan of `points`, by their angles.
fn difference(lines: &[Line], points: &[Point]) -> Option<String> {
    let first = |is_wrong: fn(&Line, &[Point]) -> bool, what: &str| {
        let mut all = lines.iter();
        let line = all.find(|line| is_wrong(line, points))?;
        Some(format!(
            "the reported line from {} to {} {what}",
            at(line[0]),
            at(line[1])
        ))
    };
    first(has_few, "has fewer than three points of the scan")
        .or_else(|| first(cuts, "cuts off a corner of the scan"))
        .or_else(|| first(is_beside, "is beside its points"))
        .or_else(|| cut(lines))
        .or_else(|| missing(lines, points))
}

/// A wall with two lines.
fn cut(lines: &[Line]) -> Option<String> {
    let next = lines.iter().cycle().skip(1);
    let mut pairs = lines.iter().zip(next).filter(|_| lines.len() > 1);
    let (_, next) = pairs.find(|(line, next)| goes_on(line, next))?;
    Some(format!(
        "a straight wall is reported as two lines, which meet at {}",
        at(next[0])
    ))
}

/// A wall without a line, or with one that is too short.
fn missing(lines: &[Line], points: &[Point]) -> Option<String> {
    if lines.len() == LINES_MAX {
        return None;
    }
    let runs = runs(points);
    if let Some(point) = runs.iter().find_map(|run| missed(run, lines)) {
        return Some(format!(
            "the straight wall at {} has no reported line",
            at(point)
        ));
    }
    let runs = runs
        .iter()
        .filter(|run| run.len() >= END && !is_closed(run));
    let is_uncovered = |end: &[Point], point: Point| {
        is_straight(end) && !lines.iter().any(|line| is_of(line, point, END_MM))
    };
    let mut ends = runs.flat_map(|run| {
        let (begin, end) = (&run[..END], &run[run.len() - END..]);
        [(begin, begin[0]), (end, end[END - 1])]
    });
    let (_, point) = ends.find(|(end, point)| is_uncovered(end, *point))?;
    Some(format!(
        "no reported line reaches the end of the wall at {}",
        at(point)
    ))
}

/// A position in the robot's frame.
fn at([x, y]: Point) -> String {
    format!("({:.2}, {:.2}) m", x / 1_000.0, y / 1_000.0)
}

/// The runs of points without a gap; the scan is a circle.
fn runs(points: &[Point]) -> Vec<Vec<Point>> {
    let mut runs: Vec<Vec<Point>> = Vec::new();
    for point in points {
        match runs.last_mut() {
            Some(run)
                if run
                    .last()
                    .is_some_and(|last| distance(*last, *point) <= GAP_MM) =>
            {
                run.push(*point);
            }
            _ => runs.push(vec![*point]),
        }
    }
    let ends = points.first().zip(points.last());
    if runs.len() > 1 && ends.is_some_and(|(first, last)| distance(*first, *last) <= GAP_MM) {
        let first = runs.remove(0);
        runs.last_mut().expect("another run").extend(first);
    }
    runs
}

/// Whether a run of points may be a closed circle.
fn is_closed(run: &[Point]) -> bool {
    distance(run[0], run[run.len() - 1]) <= GAP_MM
}

fn distance([ax, ay]: Point, [bx, by]: Point) -> f64 {
    libm::hypot(ax - bx, ay - by)
}

fn length([start, end]: &Line) -> f64 {
    distance(*start, *end)
}

/// Position of `point` along the line and beside it; `None` if the line is a point.
fn placed(line: &Line, point: Point) -> Option<[f64; 2]> {
    let ([start, end], length) = (line, length(line));
    let [dx, dy] = [end[0] - start[0], end[1] - start[1]].map(|side| side / length);
    let [x, y] = [point[0] - start[0], point[1] - start[1]];
    (length >= 1.0).then(|| [x * dx + y * dy, (y * dx - x * dy).abs()])
}

/// Whether `point` belongs to the line, which may be longer by `more`. No point belongs to a line
/// without a length.
fn is_of(line: &Line, point: Point, more: f64) -> bool {
    let length = length(line);
    placed(line, point).is_some_and(|[along, beside]| {
        beside <= NEAR_MM + BENT * length && (-more..=length + more).contains(&along)
    })
}

/// Whether the points lie on one line.
fn is_straight(points: &[Point]) -> bool {
    let chord = [points[0], points[points.len() - 1]];
    let mut beside = points.iter().map(|point| placed(&chord, *point));
    beside.all(|placed| placed.is_some_and(|[_, beside]| beside <= STRAIGHT_MM))
}

/// The points from one end of the line to the other one, if there is a point `within` this distance
/// of each end.
fn piece(line: &Line, points: &[Point], within: f64) -> Option<Vec<Point>> {
    let [first, last] = line.map(|end| {
        let far = points.iter().map(|point| distance(*point, end));
        let nearest = far
            .enumerate()
            .min_by(|one, other| one.1.total_cmp(&other.1));
        nearest.filter(|(_, far)| *far <= within).map(|(at, _)| at)
    });
    let (first, last) = first.zip(last)?;
    let count = (last + points.len() - first) % points.len() + 1;
    let piece = points.iter().cycle().skip(first).take(count);
    Some(piece.copied().collect())
}

/// Whether the line has too few points: it goes from one point to the next. Near a corner its end
/// may be between two points.
fn has_few(line: &Line, points: &[Point]) -> bool {
    length(line) >= JUMP_MM
        && piece(line, points, AT_POINT_MM).is_some_and(|piece| piece.len() < POINTS_MIN)
}

/// Whether points between the ends of the line are beside it. A few points may belong to an object
/// in front of the wall that is too narrow for a line. The points at the ends of a short line may
/// be in the other order.
fn cuts(line: &Line, points: &[Point]) -> bool {
    let ends = piece(line, points, JUMP_MM).filter(|_| length(line) >= 2.0 * JUMP_MM);
    let Some(piece) = ends else {
        return false;
    };
    let chord = [piece[0], piece[piece.len() - 1]];
    let limit = NEAR_MM + BENT * length(line);
    let beside = piece.iter().filter_map(|point| placed(&chord, *point));
    let beside = beside.filter(|[_, beside]| *beside > limit);
    beside.take(CORNER).count() == CORNER
}

/// Whether the line is beside the middle of its points. Points beyond its ends belong to other
/// lines.
fn is_beside(line: &Line, points: &[Point]) -> bool {
    let ([start, end], length) = (line, length(line));
    let Some(piece) = piece(line, points, JUMP_MM).filter(|_| length >= LONG_MM) else {
        return false;
    };
    let inner = 0.0..=length;
    let is_inner =
        |point: &&Point| placed(line, **point).is_some_and(|[along, _]| inner.contains(&along));
    let left = piece.iter().filter(is_inner).map(|[x, y]| {
        let across = (end[0] - start[0]) * (y - start[1]) - (end[1] - start[1]) * (x - start[0]);
        across / length
    });
    let count = left.clone().count();
    let mean = left.clone().sum::<f64>() / count.max(1) as f64;
    let is_smooth = count >= MANY && left.into_iter().all(|left| left.abs() < SMOOTH_MM);
    is_smooth && mean.abs() > BESIDE_MM
}

/// Whether `next` continues the line.
fn goes_on(line: &Line, next: &Line) -> bool {
    let direction = |[start, end]: &Line| libm::atan2(end[1] - start[1], end[0] - start[0]);
    let bend = emulators::world::wrap_angle(direction(next) - direction(line));
    distance(line[1], next[0]) <= JOINED_MM && bend.abs() < GOES_ON_RAD
}

/// The middle of a straight wall in this run of points that has no line: of the whole run, or of a
/// part of it.
fn missed(run: &[Point], lines: &[Line]) -> Option<Point> {
    let is_covered = |point: Point| lines.iter().any(|line| is_of(line, point, NEAR_MM));
    let size = run.len().min(WALL);
    let mut parts = run.windows(size).filter(|_| size >= POINTS_MIN);
    let part = parts.find(|part| is_straight(part) && !is_covered(part[size / 2]));
    part.map(|part| part[size / 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a wall each 50 mm.
    fn wall([from, to]: Line) -> Vec<Point> {
        let steps = (distance(from, to) / 50.0).round();
        let at = |step: u32| {
            let part = f64::from(step) / steps;
            [0, 1].map(|axis| from[axis] + part * (to[axis] - from[axis]))
        };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "some tens"
        )]
        let steps = steps as u32;
        (0..=steps).map(at).collect()
    }

    const RIGHT: Line = [[1_000.0, -1_000.0], [1_000.0, 0.0]];
    const LEFT: Line = [[1_000.0, 0.0], [1_000.0, 1_000.0]];
    const AHEAD: Line = [[1_000.0, -1_000.0], [1_000.0, 1_000.0]];

    fn said(lines: &[Line], points: &[Point]) -> String {
        difference(lines, points).unwrap_or_default()
    }

    /// One wall ahead is one line: not none, not two, not a shorter one, not one beside it.
    #[test]
    fn a_wall_is_one_line() {
        let points = wall(AHEAD);
        assert_eq!(said(&[AHEAD], &points), "");
        let missed = "the straight wall at (1.00, -0.70) m has no reported line";
        assert_eq!(said(&[], &points), missed);
        let dot = [AHEAD[0]; 2];
        assert_eq!(said(&[dot], &points), missed);
        assert_eq!(said(&[[[f64::NAN; 2]; 2]], &points), missed);
        let missed = "the straight wall at (1.00, 0.10) m has no reported line";
        assert_eq!(said(&[RIGHT], &points), missed);
        let two = "a straight wall is reported as two lines, which meet at (1.00, 0.00) m";
        assert_eq!(said(&[RIGHT, LEFT], &points), two);
        let short = [AHEAD[0], [1_000.0, 940.0]];
        let ends = "no reported line reaches the end of the wall at (1.00, 1.00) m";
        assert_eq!(said(&[short], &points), ends);
        let beside = AHEAD.map(|[x, y]| [x + 4.0, y]);
        let line = "the reported line from (1.00, -1.00) m to (1.00, 1.00) m is beside its points";
        assert_eq!(said(&[beside], &points), line);
    }

    /// A bend of 45 degrees is a corner, one of 5 degrees is not.
    #[test]
    fn a_corner_is_two_lines() {
        let bent = |x_mm: f64| [LEFT[0], [x_mm, 1_000.0]];
        let points = |other| [wall(RIGHT), wall(other)[1..].to_vec()].concat();
        let corner = bent(0.0);
        assert_eq!(said(&[RIGHT, corner], &points(corner)), "");
        // The point at the start of this line is behind the one at its end.
        let tiny = [[975.0, 28.0], [1_000.0, -15.0]];
        assert_eq!(said(&[RIGHT, tiny, corner], &points(corner)), "");
        let cut = "the reported line from (1.00, -1.00) m to (0.00, 1.00) m cuts off a corner of \
                   the scan";
        assert_eq!(said(&[[RIGHT[0], corner[1]]], &points(corner)), cut);
        let flat = bent(913.0);
        assert_eq!(said(&[[RIGHT[0], flat[1]]], &points(flat)), "");
    }

    /// Three points are a wall, two are not.
    #[test]
    fn two_points_are_no_wall() {
        let short = [[1_000.0, 0.0], [1_000.0, 100.0]];
        let points = wall(short);
        assert_eq!(said(&[short], &points), "");
        assert!(said(&[], &points).starts_with("the straight wall"));
        let few = "the reported line from (1.00, 0.00) m to (1.00, 0.10) m has fewer than three \
                   points of the scan";
        let two = [points[0], points[2]];
        assert_eq!(said(&[short], &two), few);
        assert_eq!(said(&[], &two), "");
    }

    fn flat(xs: &[f64], y: f64) -> Vec<Point> {
        xs.iter().map(|&x| [x, y]).collect()
    }

    /// Up to 300 mm are no gap, also between the last point and the first one.
    #[test]
    fn points_without_a_gap_are_a_run() {
        let lens = |points: &[Point]| runs(points).iter().map(Vec::len).collect::<Vec<_>>();
        assert_eq!(lens(&flat(&[0.0, 300.0, 601.0], 0.0)), [2, 1]);
        let around = |y: f64| {
            let far = [[1_000.0, 0.0], [1_000.0, 100.0]];
            [vec![[0.0, 0.0], [100.0, 0.0]], far.to_vec(), vec![[0.0, y]]].concat()
        };
        assert_eq!(lens(&around(301.0)), [2, 2, 1]);
        let joined = runs(&around(300.0));
        assert_eq!(joined[1], [[0.0, 300.0], [0.0, 0.0], [100.0, 0.0]]);
        assert_eq!(joined.len(), 2);
        assert_eq!(
            lens(&flat(&[0.0, 100.0], 0.0)),
            [2],
            "no run is joined with itself"
        );
        assert_eq!(lens(&[]), [0; 0]);
        let closed = |y: f64| is_closed(&[[0.0, 0.0], [500.0, 0.0], [0.0, y]]);
        assert_eq!([closed(300.0), closed(301.0)], [true, false]);
    }

    /// A line from (1, 1) to (4, 5) has the direction (0.6, 0.8). Ten along and five to the left
    /// or the right of it are (3, 12) and (11, 6).
    #[test]
    fn a_place_is_along_a_line_and_beside_it() {
        let line = [[1.0, 1.0], [4.0, 5.0]];
        for point in [[3.0, 12.0], [11.0, 6.0]] {
            let [along, beside] = placed(&line, point).expect("it has a length");
            assert!(
                (along - 10.0).abs() < 1e-9 && (beside - 5.0).abs() < 1e-9,
                "{point:?}"
            );
        }
        assert!(placed(&[[0.0, 0.0], [1.0, 0.0]], [0.0, 0.0]).is_some());
        assert!(placed(&[[0.0, 0.0], [0.99, 0.0]], [0.0, 0.0]).is_none());
        // 75 mm and a twentieth of the length beside it.
        let long = [[0.0, 0.0], [1_000.0, 0.0]];
        let of = |x, y| is_of(&long, [x, y], 5.0);
        assert_eq!(
            [of(500.0, 125.0), of(500.0, -125.0), of(500.0, 125.1)],
            [true, true, false]
        );
        assert_eq!([of(-5.0, 0.0), of(-5.1, 0.0)], [true, false]);
        assert_eq!([of(1_005.0, 0.0), of(1_005.1, 0.0)], [true, false]);
        let straight = |y| is_straight(&[[0.0, 0.0], [50.0, y], [100.0, 0.0]]);
        assert_eq!(
            [straight(10.0), straight(10.1), straight(-10.1)],
            [true, false, false]
        );
        assert!(!is_straight(&flat(&[0.0, 50.0, 0.0], 0.0)));
    }

    /// The points of a scan are a circle: the piece may go beyond its end.
    #[test]
    fn a_piece_goes_from_one_end_to_the_other() {
        let line = [[0.0, 0.0], [100.0, 0.0]];
        let points = [[0.0, 8.0], [50.0, 0.0], [100.0, -8.0], [900.0, 0.0]];
        assert_eq!(piece(&line, &points, 8.0), Some(points[..3].to_vec()));
        assert_eq!(piece(&line, &points, 7.9), None);
        let around = [[100.0, 0.0], [500.0, 500.0], [0.0, 0.0], [50.0, 0.0]];
        let found = [[0.0, 0.0], [50.0, 0.0], [100.0, 0.0]];
        assert_eq!(piece(&line, &around, 1.0), Some(found.to_vec()));
        assert_eq!(piece(&line, &[], 9.0), None);
        let few =
            |length: f64, at: f64| has_few(&[[0.0, 0.0], [length, 0.0]], &[[0.0, 0.0], [at, 0.0]]);
        assert_eq!([few(60.0, 60.0), few(59.9, 60.0)], [true, false]);
        assert_eq!([few(100.0, 92.0), few(100.0, 91.9)], [true, false]);
        assert!(!has_few(
            &[[0.0, 0.0], [60.0, 0.0]],
            &flat(&[0.0, 30.0, 60.0], 0.0)
        ));
    }

    /// Five points more than 75 mm and a twentieth of the length beside the chord: 125 mm of
    /// 1,000 mm, 81 mm of 120 mm.
    #[test]
    fn five_points_beside_a_line_are_a_corner() {
        let cut = |length: f64, count: usize, y: f64| {
            let middle = (0..9).map(|at: usize| {
                let x = length * (at as f64 + 1.0) / 10.0;
                [x, if at < count { y } else { 0.0 }]
            });
            let points: Vec<Point> = [[0.0, 0.0]]
                .into_iter()
                .chain(middle)
                .chain([[length, 0.0]])
                .collect();
            cuts(&[[0.0, 0.0], [length, 0.0]], &points)
        };
        assert_eq!(
            [5, 4].map(|count| cut(1_000.0, count, 126.0)),
            [true, false]
        );
        assert_eq!(
            [cut(1_000.0, 9, 125.0), cut(1_000.0, 9, -126.0)],
            [false, true]
        );
        assert_eq!([cut(120.0, 5, 81.5), cut(120.0, 5, 80.5)], [true, false]);
        assert!(!cut(119.9, 5, 90.0));
    }

    /// The mean of 20 points, each less than 20 mm from a line of at least 500 mm, is at most 2.5
    /// mm from it. Points beyond its ends do not count.
    #[test]
    fn a_line_is_the_middle_of_its_points() {
        let beside = |length: f64, count: usize, y: fn(usize) -> f64| {
            let at = |index: usize| [500.0 * index as f64 / (count as f64 - 1.0), y(index)];
            let points: Vec<Point> = (0..count).map(at).collect();
            is_beside(&[[0.0, 0.0], [length, 0.0]], &points)
        };
        assert!(beside(500.0, 21, |_| 2.6) && beside(500.0, 21, |_| -2.6));
        assert!(!beside(500.0, 21, |_| 2.4) && !beside(500.0, 21, |_| -2.4));
        assert!(beside(500.0, 20, |_| 2.6) && !beside(500.0, 19, |_| 2.6));
        assert!(!beside(499.0, 40, |_| 2.6));
        assert!(beside(500.0, 21, |_| 19.9) && !beside(500.0, 21, |_| 20.0));
        // Half of them at 5.2 mm, or on both sides.
        assert!(beside(500.0, 20, |at| if at % 2 == 0 { 5.2 } else { 0.0 }));
        assert!(!beside(500.0, 20, |at| if at % 2 == 0 {
            5.2
        } else {
            -5.2
        }));
        // Of 30 points on 560 mm the nearest to the ends of the line are at 0 and 500 mm.
        let inner = flat(&[0.0, 500.0], 0.0);
        let more: Vec<Point> = (1..25).map(|at| [20.0 * f64::from(at), 2.8]).collect();
        let points = [&inner[..1], &more, &inner[1..], &[[510.0, 2.8]][..]].concat();
        assert!(is_beside(&[[0.0, 0.0], [500.0, 0.0]], &points));
        // A line upwards with points to its left.
        let up: Vec<Point> = (0..=20).map(|at| [-2.6, 25.0 * f64::from(at)]).collect();
        assert!(is_beside(&[[0.0, 0.0], [0.0, 500.0]], &up));
        let on: Vec<Point> = (0..=20).map(|at| [0.0, 25.0 * f64::from(at)]).collect();
        assert!(!is_beside(&[[0.0, 0.0], [0.0, 500.0]], &on));
    }

    /// 50 mm and 4 degrees (0.07 rad) from one line to the next one.
    #[test]
    fn two_lines_are_one_if_they_go_on() {
        let line = [[0.0, 0.0], [1_000.0, 0.0]];
        let next = |x: f64, bend: f64| {
            let end = [x + 1_000.0 * libm::cos(bend), 1_000.0 * libm::sin(bend)];
            goes_on(&line, &[[x, 0.0], end])
        };
        assert_eq!(
            [next(1_050.0, 0.0), next(1_050.1, 0.0), next(949.9, 0.0)],
            [true, false, false]
        );
        assert_eq!(
            [0.069, 0.071, -0.069, -0.071].map(|bend| next(1_000.0, bend)),
            [true, false, true, false]
        );
        // The last line may be continued by the first one; a single one is not.
        let lines = [[[1_000.0, 0.0], [2_000.0, 0.0]], line];
        assert!(
            cut(&lines)
                .expect("one wall")
                .ends_with("meet at (1.00, 0.00) m")
        );
        assert_eq!(cut(&[[[0.0, 0.0], [30.0, 0.0]]]), None);
    }

    /// Points 100 mm apart. A line that is short of the end by up to 5 mm reaches it; fewer than
    /// six points have no end.
    #[test]
    fn a_wall_is_covered_to_its_ends() {
        let missing = |count: u32, line: [f64; 2]| {
            let xs: Vec<f64> = (0..count).map(|at| 100.0 * f64::from(at)).collect();
            missing(&[line.map(|x| [x, 0.0])], &flat(&xs, 0.0)).unwrap_or_default()
        };
        let end = "no reported line reaches the end of the wall at (0.50, 0.00) m";
        assert_eq!(missing(6, [0.0, 300.0]), end);
        assert_eq!(
            [missing(6, [0.0, 495.0]), missing(6, [5.0, 500.0])],
            ["", ""]
        );
        assert_eq!(missing(6, [0.0, 494.9]), end);
        let begin = "no reported line reaches the end of the wall at (0.00, 0.00) m";
        assert_eq!(missing(6, [5.1, 500.0]), begin);
        assert_eq!(missing(5, [0.0, 200.0]), "");
    }

    /// A robot tells 20 lines at most.
    #[test]
    fn a_robot_with_all_its_lines_leaves_out_further_ones() {
        let points = wall(AHEAD);
        let far = [[9_000.0, 0.0], [9_000.0, 500.0]];
        assert!(missing(&[far; 19], &points).is_some());
        assert_eq!(missing(&[far; 20], &points), None);
    }

    /// The report of a robot, and the points of its scan.
    type Told = (Option<(Instant, Vec<Line>)>, Vec<Point>);

    #[derive(Clone, Default)]
    struct Robot(crate::Shared<Told>);

    impl Instruments for Robot {
        fn told_lines(&self, _: &Rig) -> Option<(Instant, Vec<Line>)> {
            self.0.lock().0.clone()
        }

        fn searched_points(&self, _: &Rig) -> Vec<Point> {
            self.0.lock().1.clone()
        }
    }

    /// A wall ahead until 2 s, then one to the left: the line of the first one agrees with a scan
    /// that was in use 1.5 s before.
    #[test]
    fn a_report_may_be_of_a_scan_before() {
        use super::super::puppet::copied;
        use super::super::tests::{look_at, rig};
        use crate::run::check::Status;
        let told = |at_ms: u64| {
            let (robot, mut rig) = (Robot::default(), rig());
            let mut checker = LinesTrue::new(Arc::new(robot.clone()), Calm::default());
            let none = checker.verdict();
            assert_eq!(none.status, Status::NotObserved);
            assert_eq!(none.detail, "no lines were reported");
            let side: Line = [[-1_000.0, 1_000.0], [1_000.0, 1_000.0]];
            let mut look = |at: u64, wall_is: Line, line: Line| {
                let told = Some((Instant::from_millis(at), vec![line]));
                *robot.0.lock() = (told, wall(wall_is));
                look_at(&mut checker, &mut rig, at, 0.0);
            };
            look(1_000, AHEAD, AHEAD);
            look(2_000, side, side);
            look(at_ms, side, AHEAD);
            look(at_ms + 1_000, side, side);
            let text = checker.verdict().to_string();
            assert_eq!(copied(&checker, &rig), text);
            let check = checker.verdict();
            (check.status, check.detail)
        };
        let agree = "4 reports of lines agree with the scan".to_owned();
        assert_eq!(told(3_500), (Status::Pass, agree));
        let (status, detail) = told(3_501);
        assert_eq!(status, Status::Fail);
        assert!(
            detail.starts_with("at 3.501000 s the straight wall at "),
            "{detail}"
        );
    }

    /// A report is judged once, and not during a fault of the station or the drive.
    #[test]
    fn each_report_is_judged_once_while_it_is_calm() {
        use super::super::puppet::{cut, scenario};
        use super::super::tests::look_at;
        let (mut rig, _) = crate::rig::bare::linked(["radio"], 1_000_000);
        let calm = Calm::of(&scenario("").0, &rig, &|link| link == "radio");
        let robot = Robot::default();
        let mut checker = LinesTrue::new(Arc::new(robot.clone()), calm);
        checker.faults_changed(&[cut("radio", 1, 2)], &rig);
        let mut reports = Vec::new();
        for (at, told) in [
            (500, 500),
            (600, 500),
            (1_000, 1_000),
            (7_100, 7_000),
            (7_200, 7_000),
        ] {
            let told = Some((Instant::from_millis(told), vec![AHEAD]));
            *robot.0.lock() = (told, wall(AHEAD));
            look_at(&mut checker, &mut rig, at, 0.0);
            reports.push(checker.reports);
        }
        assert_eq!(reports, [1, 1, 1, 2, 2]);
    }
}
