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
}
