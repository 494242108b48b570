//! Walls that a robot has seen, and the correction of its pose by them. For the part of a robot's
//! program that runs on a PC; feature `host`.
//!
//! A map of 10 cm cells is too coarse for the correction of a pose, and with uncorrected odometry
//! walls become two cells thick until corridors close. Lines are exact to millimetres.

use alloc::vec::Vec;

use crate::local_map::Segment;
use crate::pose::{Point, Pose, normalised};

/// Walls shorter than this have no certain direction.
const LENGTH_MIN_MM: f32 = 150.0;
/// Largest angle between two directions of the same wall, radians.
const TURN_MAX: f32 = 0.26;
/// Maximum plausible correction; a larger one is an error.
const SHIFT_MAX_MM: f32 = 300.0;
const ROTATION_MAX: f32 = 0.17;
/// Spacing of points on a seen wall.
const STEP_MM: f32 = 50.0;
/// Maximum distance between a point and its wall, in each round.
const NEAR_MM: [f32; 6] = [250.0, 200.0, 150.0, 100.0, 80.0, 60.0];
/// Weight of the odometry against one point: a point is certain to 2 cm, the odometry to 10 cm and
/// 3 degrees.
const TRUST: [f64; 3] = [0.04, 0.04, 146_000.0];
/// Maximum number of walls kept.
const WALLS_MAX: usize = 4_000;

/// Maximum unnoticed shift and turn of a robot: a motor runs on for 60 ms.
const LOST_MM: f32 = 400.0;
const LOST_RAD: f32 = 0.9;
/// Offsets at which a lost robot is searched, radians and millimetres.
const TURNS: [f32; 11] = [
    0.0, 0.15, -0.15, 0.3, -0.3, 0.45, -0.45, 0.6, -0.6, 0.75, -0.75,
];
const SHIFTS_MM: [[f32; 2]; 5] = [
    [0.0, 0.0],
    [150.0, 0.0],
    [-150.0, 0.0],
    [0.0, 150.0],
    [0.0, -150.0],
];
/// Minimum share of the points fitting at the believed pose that must fit at the corrected pose.
/// Without this limit, in rows of similar wall ends, wrong neighbouring walls drew the pose 12 cm
/// away from a pose where all points fitted.
const AS_MANY: (usize, usize) = (9, 10);
/// Minimum ratio of the points that fit at another pose to those at the believed pose.
const BETTER: (usize, usize) = (6, 5);

/// Faces of walls in the map's frame, the oldest first; free space is to the left of them, so that
/// the two faces of a thin wall are not confused.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Walls {
    segments: Vec<Segment>,
}

impl Walls {
    /// Adds walls seen by a robot at `robot`.
    pub fn add(&mut self, robot: Pose, lines: &[Segment]) {
        let room = WALLS_MAX.saturating_sub(self.segments.len());
        self.segments.extend(faces(robot, lines).take(room));
    }

    /// Adds faces in the map's frame, with free space to the left of each.
    pub fn add_faces(&mut self, faces: impl Iterator<Item = Segment>) {
        let room = WALLS_MAX.saturating_sub(self.segments.len());
        self.segments.extend(faces.take(room));
    }

    /// Whether no wall is known.
    pub const fn is_empty(&self) -> bool {
        self.segments.is_empty()
    }

    /// The corrected pose of a robot that believes it is at `robot` and sees `lines`; `robot`
    /// itself if the walls give no better pose.
    pub fn corrected(&self, robot: Pose, lines: &[Segment]) -> Pose {
        self.fitted(robot, lines)
            .filter(|pose| is_within(*pose, robot, SHIFT_MAX_MM, ROTATION_MAX))
            .filter(|pose| {
                let [there, here] = [*pose, robot].map(|pose| self.known(pose, lines));
                there * AS_MANY.1 >= here * AS_MANY.0
            })
            .unwrap_or(robot)
    }

    /// As [`corrected`](Self::corrected), for a robot that was turned and moved without notice.
    /// Other headings and nearby positions are tried; one is taken if clearly more of the scan lies
    /// on known walls.
    pub fn recovered(&self, robot: Pose, lines: &[Segment]) -> Pose {
        let near = self.corrected(robot, lines);
        let mut best = (self.known(near, lines) * BETTER.0 / BETTER.1, near);
        for turn in TURNS {
            for [x, y] in SHIFTS_MM {
                let start = Pose::new(robot.x_mm + x, robot.y_mm + y, robot.heading + turn);
                let found = self.fitted(start, lines);
                let is_near = |pose: &Pose| is_within(*pose, robot, LOST_MM, LOST_RAD);
                let Some(pose) = found.filter(is_near) else {
                    continue;
                };
                let known = self.known(pose, lines);
                if known > best.0 {
                    best = (known, pose);
                }
            }
        }
        best.1
    }

    /// Share of `lines`, seen from about `robot`, that lies on known walls, 0 to 1.
    pub fn share_known(&self, robot: Pose, lines: &[Segment]) -> f32 {
        let pose = self.corrected(robot, lines);
        let all: usize = faces(pose, lines)
            .map(|face| face.points(STEP_MM).count())
            .sum();
        self.known(pose, lines) as f32 / all.max(1) as f32
    }

    /// The pose near `robot` from which `lines` lie on known walls.
    fn fitted(&self, robot: Pose, lines: &[Segment]) -> Option<Pose> {
        let mut pose = robot;
        for near_mm in NEAR_MM {
            let mut sums = Sums::new(robot, pose);
            for face in faces(pose, lines) {
                self.add_line(&mut sums, face, near_mm);
            }
            let [x, y, turn] = sums.solve()?;
            pose = Pose::new(pose.x_mm + x, pose.y_mm + y, pose.heading + turn);
        }
        Some(pose)
    }

    /// Number of points of `lines`, seen from `pose`, on known walls.
    fn known(&self, pose: Pose, lines: &[Segment]) -> usize {
        let near_mm = NEAR_MM[NEAR_MM.len() - 1];
        let is_known = |along: Point, point: Point| {
            let mut offsets = self.segments.iter();
            offsets
                .any(|wall| offset(*wall, along, point).is_some_and(|(_, off)| off.abs() < near_mm))
        };
        let count = |face: Segment| {
            let along = direction(face, face.length_mm());
            face.points(STEP_MM)
                .filter(|it| is_known(along, *it))
                .count()
        };
        faces(pose, lines).map(count).sum()
    }

    fn add_line(&self, sums: &mut Sums, line: Segment, near_mm: f32) {
        let along = direction(line, line.length_mm());
        for point in line.points(STEP_MM) {
            // Use the oldest wall: it was seen before the odometry had much error.
            let mut offsets = self
                .segments
                .iter()
                .filter_map(|wall| offset(*wall, along, point));
            if let Some((normal, off)) = offsets.find(|(_, off)| off.abs() < near_mm) {
                sums.add(point, normal, off);
            }
        }
    }
}

/// Whether `pose` is within these limits of `robot`.
fn is_within(pose: Pose, robot: Pose, most_mm: f32, most_rad: f32) -> bool {
    let turn = normalised(pose.heading - robot.heading).abs();
    pose.position().distance_mm(robot.position()) < most_mm && turn < most_rad
}

/// The lines that are long enough, as seen by a robot at `robot`, each with the robot to its left.
fn faces(robot: Pose, lines: &[Segment]) -> impl Iterator<Item = Segment> {
    let long = lines.iter().filter(|line| line.length_mm() > LENGTH_MIN_MM);
    long.map(move |line| {
        let (from, to) = (line.start, line.end);
        let is_left = from.x_mm * to.y_mm > from.y_mm * to.x_mm;
        let face = if is_left {
            *line
        } else {
            Segment::new(to, from)
        };
        face.to_world(robot)
    })
}

/// The unit vector along a segment of this length.
fn direction(segment: Segment, length_mm: f32) -> Point {
    let along = |start: f32, end: f32| (end - start) / length_mm;
    Point::new(
        along(segment.start.x_mm, segment.end.x_mm),
        along(segment.start.y_mm, segment.end.y_mm),
    )
}

/// The normal of `wall` and the distance from it of `point`, which belongs to a line in the
/// direction `other`, if both may be the same wall.
fn offset(wall: Segment, other: Point, point: Point) -> Option<(Point, f32)> {
    let length_mm = wall.length_mm();
    let along = direction(wall, length_mm);
    let cross = along.x_mm * other.y_mm - along.y_mm * other.x_mm;
    let is_same_side = along.x_mm * other.x_mm + along.y_mm * other.y_mm > 0.0;
    let (x, y) = (point.x_mm - wall.start.x_mm, point.y_mm - wall.start.y_mm);
    let at = along.x_mm * x + along.y_mm * y;
    let is_beside = (0.0..=length_mm).contains(&at);
    let off = along.x_mm * y - along.y_mm * x;
    (is_beside && is_same_side && cross.abs() < libm::sinf(TURN_MAX))
        .then_some((Point::new(-along.y_mm, along.x_mm), off))
}

/// Least squares for a small shift and turn about the robot.
struct Sums {
    robot: Pose,
    matrix: [[f64; 3]; 3],
    right: [f64; 3],
}

impl Sums {
    /// Sums with only the odometry's weight: its pose is `believed`, the assumed one is `robot`.
    fn new(believed: Pose, robot: Pose) -> Self {
        let mut matrix = [[0.0; 3]; 3];
        for (axis, trust) in TRUST.into_iter().enumerate() {
            matrix[axis][axis] = trust;
        }
        let back = [
            believed.x_mm - robot.x_mm,
            believed.y_mm - robot.y_mm,
            normalised(believed.heading - robot.heading),
        ];
        let right = core::array::from_fn(|axis| TRUST[axis] * f64::from(back[axis]));
        Self {
            robot,
            matrix,
            right,
        }
    }

    /// Adds a `point` that should lie on a wall with this normal, but is `off` beside it.
    fn add(&mut self, point: Point, normal: Point, off: f32) {
        let (x, y) = (point.x_mm - self.robot.x_mm, point.y_mm - self.robot.y_mm);
        let turn = normal.y_mm * x - normal.x_mm * y;
        let row = [normal.x_mm, normal.y_mm, turn].map(f64::from);
        for (sums, one) in self.matrix.iter_mut().zip(row) {
            for (sum, other) in sums.iter_mut().zip(row) {
                *sum += one * other;
            }
        }
        for (sum, one) in self.right.iter_mut().zip(row) {
            *sum -= one * f64::from(off);
        }
    }

    /// Solution by Cramer's rule.
    fn solve(&self) -> Option<[f32; 3]> {
        let whole = determinant(self.matrix);
        let replaced = |column: usize| {
            let mut matrix = self.matrix;
            for (row, right) in matrix.iter_mut().zip(self.right) {
                row[column] = right;
            }
            #[expect(clippy::cast_possible_truncation, reason = "precise enough")]
            let value = (determinant(matrix) / whole) as f32;
            value
        };
        let found = [replaced(0), replaced(1), replaced(2)];
        found.iter().all(|value| value.is_finite()).then_some(found)
    }
}

fn determinant([a, b, c]: [[f64; 3]; 3]) -> f64 {
    let minor = |i: usize, j: usize| b[i] * c[j] - b[j] * c[i];
    a[0] * minor(1, 2) - a[1] * minor(0, 2) + a[2] * minor(0, 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::sin_cos;

    /// A corridor's end at 1 m was first seen 12 cm too far, on seven tenths of its width. At that
    /// position the robot has 34 of 40 points on known walls, at its own pose all 40.
    #[test]
    fn what_fits_is_not_drawn_to_where_less_does() {
        let wall = |from: [f32; 2], to: [f32; 2]| {
            Segment::new(Point::new(from[0], from[1]), Point::new(to[0], to[1]))
        };
        let false_end = wall([1_120.0, -350.0], [1_120.0, 350.0]);
        let lines = [
            wall([500.0, -500.0], [1_000.0, -500.0]),
            wall([1_000.0, -500.0], [1_000.0, 500.0]),
            wall([500.0, 500.0], [1_000.0, 500.0]),
        ];
        let home = Pose::new(0.0, 0.0, 0.0);
        let mut walls = Walls::default();
        walls.add(home, &[false_end]);
        walls.add(home, &lines);
        let drawn = walls.fitted(home, &lines).expect("there are walls");
        assert!((100.0..125.0).contains(&drawn.x_mm), "{drawn:?}");
        assert_eq!(walls.corrected(home, &lines), home);
        // If as many points fit there as at the believed pose, the map's oldest wall counts.
        let mut walls = Walls::default();
        walls.add(home, &[wall([1_020.0, -500.0], [1_020.0, 500.0])]);
        walls.add(home, &lines);
        let corrected = walls.corrected(home, &lines);
        assert!((15.0..21.0).contains(&corrected.x_mm), "{corrected:?}");
    }

    /// A room of 3 by 2 m, seen from (1, 1.1) m by a robot that believes it is 10 cm and 0.5
    /// radians away: too far for a correction, but no other pose fits as well.
    #[test]
    fn a_robot_that_rolled_without_knowing_is_found() {
        let corners = [
            [0.0, 0.0],
            [3_000.0, 0.0],
            [3_000.0, 2_000.0],
            [0.0, 2_000.0],
        ];
        let point = |[x, y]: [f32; 2]| Point::new(x, y);
        let truth = Pose::new(1_000.0, 1_100.0, 0.5);
        let (sin, cos) = sin_cos(-truth.heading);
        let seen = |[x, y]: [f32; 2]| {
            let (x, y) = (x - truth.x_mm, y - truth.y_mm);
            Point::new(cos * x - sin * y, sin * x + cos * y)
        };
        let sides = |place: &dyn Fn([f32; 2]) -> Point| -> Vec<Segment> {
            let next = corners.iter().cycle().skip(1);
            let sides = corners.iter().zip(next);
            sides
                .map(|(a, b)| Segment::new(place(*a), place(*b)))
                .collect()
        };
        let mut walls = Walls::default();
        let home = Pose::new(0.0, 0.0, 0.0);
        // Seen as from the middle, so that the robot is on the lines' left.
        let middle = Pose::new(1_500.0, 1_000.0, 0.0);
        let from_middle = sides(&|corner| point([corner[0] - 1_500.0, corner[1] - 1_000.0]));
        walls.add(middle, &from_middle);
        assert_eq!(walls.recovered(home, &[]), home);
        let lines = sides(&seen);
        let believed = Pose::new(1_080.0, 1_040.0, 0.0);
        assert_eq!(walls.corrected(believed, &lines), believed);
        let found = walls.recovered(believed, &lines);
        assert!(
            found.position().distance_mm(truth.position()) < 10.0,
            "{found:?}"
        );
        assert!((found.heading - truth.heading).abs() < 0.01, "{found:?}");
    }

    /// A corner seen from (1, 1) m by a robot with an error of 5 cm and 3 degrees.
    #[test]
    fn two_walls_tell_the_pose() {
        let walls = [
            Segment::new(Point::new(0.0, 0.0), Point::new(3_000.0, 0.0)),
            Segment::new(Point::new(0.0, 0.0), Point::new(0.0, 3_000.0)),
        ];
        let truth = Pose::new(1_000.0, 1_000.0, 0.5);
        let (sin, cos) = sin_cos(-truth.heading);
        let seen = |point: Point| {
            let (x, y) = (point.x_mm - 1_000.0, point.y_mm - 1_000.0);
            Point::new(cos * x - sin * y, sin * x + cos * y)
        };
        let seen = walls.map(|wall| Segment::new(seen(wall.start), seen(wall.end)));
        let mut known = Walls::default();
        known.add(truth, &seen);
        let believed = Pose::new(1_050.0, 960.0, 0.5 + 0.052);
        let found = known.corrected(believed, &seen);
        let off = found.position().distance_mm(truth.position());
        let turn = (found.heading - truth.heading).abs();
        assert!(off < 5.0 && turn < 0.005, "{found:?}");
        // Distant walls have no influence.
        let far = Pose::new(9_000.0, 9_000.0, 0.0);
        assert_eq!(known.corrected(far, &seen), far);
        // The back of a wall 10 cm thick is not its front: a scan from behind changes no pose.
        let behind = Segment::new(Point::new(500.0, -500.0), Point::new(500.0, 500.0));
        let back = Pose::new(-600.0, 1_500.0, 0.0);
        assert_eq!(known.corrected(back, &[behind]), back);
    }

    /// Lines of 150 mm and below have no direction. Whichever end of a line comes first, the robot
    /// is to the left of its face: ahead of the robot the face runs from right to left.
    #[test]
    fn faces_are_long_and_have_the_robot_to_their_left() {
        let line =
            |from: f32, to: f32| Segment::new(Point::new(1_000.0, from), Point::new(1_000.0, to));
        let robot = Pose::new(0.0, 0.0, 0.0);
        let mut known = Walls::default();
        known.add(
            robot,
            &[line(0.0, 150.0), line(-200.0, 200.0), line(200.0, -200.0)],
        );
        assert_eq!(known.segments, [line(-200.0, 200.0); 2]);
    }

    /// Of a corner's two walls, each 1 m long, one is known: half of the sight.
    #[test]
    fn what_is_known_of_a_sight_is_a_share() {
        let far = Segment::new(Point::new(1_000.0, -500.0), Point::new(1_000.0, 500.0));
        let beside = Segment::new(Point::new(0.0, 1_000.0), Point::new(1_000.0, 1_000.0));
        let home = Pose::new(0.0, 0.0, 0.0);
        let mut known = Walls::default();
        assert_eq!(known.share_known(home, &[far]), 0.0);
        known.add(home, &[far]);
        assert_eq!(known.share_known(home, &[]), 0.0);
        let share = known.share_known(Pose::new(20.0, 0.0, 0.0), &[far, beside]);
        assert!((share - 0.5).abs() < 0.05, "{share}");
    }

    /// A turn of 0.2 rad exceeds the odometry's error between two looks; one of 0.1 does not.
    #[test]
    fn a_correction_that_is_too_large_is_none() {
        let corners = [
            (-1e3, -1e3),
            (1e3, -1e3),
            (1e3, 1e3),
            (-1e3, 1e3),
            (-1e3, -1e3),
        ];
        let corners = corners.map(|(x, y)| Point::new(x, y));
        let walls = corners.windows(2);
        let walls: Vec<_> = walls.map(|pair| Segment::new(pair[0], pair[1])).collect();
        let mut known = Walls::default();
        known.add(Pose::new(0.0, 0.0, 0.0), &walls);
        let far = Pose::new(0.0, 0.0, 0.2);
        assert_eq!(known.corrected(far, &walls), far);
        let near = known.corrected(Pose::new(0.0, 0.0, 0.1), &walls);
        assert!(near.heading.abs() < 0.02, "{near:?}");
    }
}
