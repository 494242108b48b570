//! Outline of a body for collisions: a disc, or a polygon.

use core::fmt;

use crate::world::geometry::{Point, Pose};

/// Minimum and maximum radius of a disc, metres.
const RADIUS_M: [f64; 2] = [0.02, 2.0];
/// Maximum number of corners of an outline: a collision test examines each.
const CORNERS_MAX: usize = 64;
/// Shortest side of an outline, metres.
const SIDE_MIN_M: f64 = 1e-3;
/// Maximum distance of a corner from the reference point, metres.
const REACH_MAX_M: f64 = 4.0;

/// The part of the floor that a body covers, in its own axes: metres, x forward, y left, the origin
/// at the chassis's reference point. Exists only if physics can work with it.
#[derive(Clone, Debug, PartialEq)]
pub struct Footprint {
    shape: Shape,
    reach_m: f64,
    middle: Point,
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    Circle,
    Polygon(Vec<Point>),
}

/// A [`Footprint`] in the form for drawing and measuring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outline<'a> {
    /// A disc around the reference point.
    Circle {
        /// Metres.
        radius_m: f64,
    },
    /// Corners in order, in body axes; the last joins the first.
    Polygon(&'a [Point]),
}

impl Footprint {
    /// A disc around the reference point.
    ///
    /// # Errors
    /// If the radius is not within 0.02 m to 2 m.
    pub fn circle(radius_m: f64) -> Result<Self, FootprintError> {
        let [min, max] = RADIUS_M;
        if !(min..=max).contains(&radius_m) {
            return Err(FootprintError::Radius { found: radius_m });
        }
        Ok(Self {
            shape: Shape::Circle,
            reach_m: radius_m,
            middle: Point::default(),
        })
    }

    /// A closed outline, convex or not, in either sense of rotation. It need not contain the
    /// reference point.
    ///
    /// # Errors
    /// If the outline has fewer than 3 or more than 64 corners, or sides that touch or cross each
    /// other. If a corner is not finite or more than 4 m away, or a side is shorter than 1 mm.
    pub fn polygon(corners: Vec<Point>) -> Result<Self, FootprintError> {
        let count = corners.len();
        if !(3..=CORNERS_MAX).contains(&count) {
            return Err(FootprintError::Corners { found: count });
        }
        let far = |corner: &Point| Point::default().distance(*corner);
        // Not-a-number is in no range.
        let within = |corner: &Point| far(corner) <= REACH_MAX_M;
        if let Some(corner) = corners.iter().position(|corner| !within(corner)) {
            return Err(FootprintError::Reach { corner });
        }
        let side = |index: usize| [corners[index], corners[(index + 1) % count]];
        let short = |index: &usize| {
            let [from, to] = side(*index);
            from.distance(to) < SIDE_MIN_M
        };
        if let Some(side) = (0..count).find(short) {
            return Err(FootprintError::Side { side });
        }
        for index in 0..count {
            for other in index + 1..count {
                let next = other == index + 1 || (index == 0 && other == count - 1);
                let folded = next && folds(side(index), side(other));
                if folded || (!next && meet(side(index), side(other))) {
                    return Err(FootprintError::Crossing {
                        sides: [index, other],
                    });
                }
            }
        }
        let reach_m = corners.iter().map(far).fold(0.0, f64::max);
        let share = 1.0 / f64::from(u32::try_from(count).unwrap_or(u32::MAX));
        let middle = Point::new(
            corners.iter().map(|corner| corner.x).sum::<f64>() * share,
            corners.iter().map(|corner| corner.y).sum::<f64>() * share,
        );
        Ok(Self {
            shape: Shape::Polygon(corners),
            reach_m,
            middle,
        })
    }

    /// A rectangle that reaches `front_m` ahead of the reference point, `rear_m` behind it, and is
    /// `width_m` wide.
    ///
    /// # Errors
    /// As [`Self::polygon`].
    pub fn rectangle(front_m: f64, rear_m: f64, width_m: f64) -> Result<Self, FootprintError> {
        let half = 0.5 * width_m;
        let corners = [
            (front_m, -half),
            (front_m, half),
            (-rear_m, half),
            (-rear_m, -half),
        ];
        Self::polygon(corners.map(|(x, y)| Point::new(x, y)).to_vec())
    }

    /// Its shape.
    pub fn outline(&self) -> Outline<'_> {
        match &self.shape {
            Shape::Circle => Outline::Circle {
                radius_m: self.reach_m,
            },
            Shape::Polygon(corners) => Outline::Polygon(corners),
        }
    }

    /// Radius of the circle around the reference point that just contains it, metres.
    pub fn reach_m(&self) -> f64 {
        self.reach_m
    }

    /// Mean of its corners, in body axes; the reference point of a disc.
    pub(in crate::world) fn middle(&self) -> Point {
        self.middle
    }

    /// Its corners when the body stands at `pose`; a disc has none.
    pub(in crate::world) fn place(&self, pose: Pose, corners: &mut Vec<Point>) {
        corners.clear();
        if let Shape::Polygon(own) = &self.shape {
            let (sin, cos) = libm::sincos(pose.theta);
            corners.extend(own.iter().map(|corner| {
                Point::new(
                    pose.x + corner.x * cos - corner.y * sin,
                    pose.y + corner.x * sin + corner.y * cos,
                )
            }));
        }
    }
}

/// Twice the area of the triangle; positive if `c` lies left of the line from `a` to `b`.
fn side_of(a: Point, b: Point, c: Point) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// Whether two sides that share no corner touch or cross.
fn meet([a, b]: [Point; 2], [c, d]: [Point; 2]) -> bool {
    let apart = |p: f64, q: f64, r: f64, s: f64| p.max(q) < r.min(s) || r.max(s) < p.min(q);
    if apart(a.x, b.x, c.x, d.x) || apart(a.y, b.y, c.y, d.y) {
        return false;
    }
    side_of(a, b, c) * side_of(a, b, d) <= 0.0 && side_of(c, d, a) * side_of(c, d, b) <= 0.0
}

/// Whether two sides that share a corner lie on each other.
fn folds(one: [Point; 2], other: [Point; 2]) -> bool {
    let way = |[from, to]: [Point; 2]| Point::new(to.x - from.x, to.y - from.y);
    let (u, v) = (way(one), way(other));
    u.x * v.y - u.y * v.x == 0.0 && u.x * v.x + u.y * v.y < 0.0
}

/// Error of an invalid outline.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum FootprintError {
    /// The radius of a disc.
    Radius {
        /// The given radius, metres.
        found: f64,
    },
    /// The number of corners.
    Corners {
        /// The given number.
        found: usize,
    },
    /// A corner is not finite or too far from the reference point.
    Reach {
        /// Number of the corner.
        corner: usize,
    },
    /// A side is too short.
    Side {
        /// The side from this corner to the next.
        side: usize,
    },
    /// Two sides touch or cross.
    Crossing {
        /// The sides, each from the corner of this number to the next.
        sides: [usize; 2],
    },
}

impl fmt::Display for FootprintError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Radius { found } => {
                let [min, max] = RADIUS_M;
                write!(f, "the radius is {found} m; expected {min} to {max}")
            }
            Self::Corners { found } => {
                write!(f, "{found} corners; expected 3 to {CORNERS_MAX}")
            }
            Self::Reach { corner } => write!(
                f,
                "corner {corner} is more than {REACH_MAX_M} m from the reference point"
            ),
            Self::Side { side } => {
                write!(f, "side {side} is shorter than {SIDE_MIN_M} m")
            }
            Self::Crossing {
                sides: [one, other],
            } => {
                write!(f, "sides {one} and {other} touch or cross each other")
            }
        }
    }
}

impl core::error::Error for FootprintError {}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(corners: &[(f64, f64)]) -> Result<Footprint, FootprintError> {
        Footprint::polygon(corners.iter().map(|&(x, y)| Point::new(x, y)).collect())
    }

    /// The car reaches 0.359 m ahead and half of 0.33 m aside, so the far corner is sqrt(0.359^2 +
    /// 0.165^2) away.
    #[test]
    fn the_reach_is_that_of_the_farthest_corner() {
        let car = Footprint::rectangle(0.359, 0.101, 0.33).unwrap();
        assert!(
            (car.reach_m() - 0.395_102).abs() < 1e-6,
            "{}",
            car.reach_m()
        );
        assert!((car.middle().x - 0.129).abs() < 1e-12 && car.middle().y.abs() < 1e-12);
    }

    #[test]
    fn outlines_that_are_none_are_refused_with_the_place() {
        use FootprintError as E;
        let square = [(0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.1, -0.1)];
        assert!(polygon(&square).is_ok());
        let arrow = [(0.2, 0.0), (-0.1, 0.1), (0.0, 0.0), (-0.1, -0.1)];
        assert!(polygon(&arrow).is_ok(), "not convex");
        assert_eq!(polygon(&square[..2]), Err(E::Corners { found: 2 }));
        let bow = [square[0], square[2], square[1], square[3]];
        assert_eq!(polygon(&bow), Err(E::Crossing { sides: [0, 2] }));
        let spike = [(0.1, 0.0), (-0.1, 0.0), (0.05, 0.0)];
        assert_eq!(polygon(&spike), Err(E::Crossing { sides: [0, 1] }));
        let double = [square[0], square[1], square[1], square[2]];
        assert_eq!(polygon(&double), Err(E::Side { side: 1 }));
        let lost = [square[0], (f64::NAN, 0.0), square[2]];
        assert_eq!(polygon(&lost), Err(E::Reach { corner: 1 }));
        assert!(matches!(Footprint::circle(0.0), Err(E::Radius { .. })));
    }

    /// 3 times 7 less 4 times 2; the opposite sign from b to a; zero on the line.
    #[test]
    fn a_point_lies_left_or_right_of_a_way() {
        let [a, b] = [Point::new(1.0, 2.0), Point::new(4.0, 6.0)];
        let c = Point::new(3.0, 9.0);
        assert_eq!([side_of(a, b, c), side_of(b, a, c)], [13.0, -13.0]);
        assert_eq!(side_of(a, b, Point::new(7.0, 10.0)), 0.0);
    }

    fn side(from: (f64, f64), to: (f64, f64)) -> [Point; 2] {
        [from, to].map(|(x, y)| Point::new(x, y))
    }

    /// Across each other, end to end, one on the other; beside, behind and before each other, and
    /// one that would meet the other if it were longer. Whichever is named first.
    #[test]
    fn sides_meet_where_they_have_a_point_in_common() {
        let meets = |one, other| {
            let found = [meet(one, other), meet(other, one)];
            assert_eq!(found[0], found[1]);
            found[0]
        };
        let long = side((0.0, 0.0), (4.0, 4.0));
        assert!(
            meets(long, side((0.0, 4.0), (4.0, 0.0))) && meets(long, side((4.0, 4.0), (9.0, 0.0)))
        );
        assert!(
            meets(long, side((2.0, 2.0), (3.0, 0.0))) && meets(long, side((1.0, 1.0), (6.0, 6.0)))
        );
        assert!(
            !meets(long, side((3.0, 1.0), (2.5, 1.5)))
                && !meets(long, side((1.0, 3.0), (1.5, 2.5)))
        );
        assert!(
            !meets(long, side((1.0, 0.0), (5.0, 4.0)))
                && !meets(long, side((5.0, 5.0), (6.0, 6.0)))
        );
        let level = side((0.0, 1.0), (2.0, 1.0));
        assert!(
            !meets(level, side((3.0, 1.0), (4.0, 1.0)))
                && meets(level, side((2.0, 1.0), (4.0, 1.0)))
        );
        let steep = side((1.0, 0.0), (1.0, 2.0));
        assert!(!meets(steep, side((1.0, -3.0), (1.0, -1.0))) && meets(steep, level));
        assert!(!meets(steep, side((1.5, 0.5), (2.5, 1.5))));
    }

    /// A side folds if it goes back on the one before, not if it goes straight on or around a
    /// corner.
    #[test]
    fn a_side_folds_back_onto_the_one_before() {
        let out = side((0.0, 0.0), (2.0, 1.0));
        assert!(
            folds(out, side((2.0, 1.0), (0.0, 0.0))) && folds(out, side((2.0, 1.0), (-2.0, -1.0)))
        );
        assert!(
            !folds(out, side((2.0, 1.0), (4.0, 2.0))) && !folds(out, side((2.0, 1.0), (1.0, 3.0)))
        );
        assert!(!folds(out, side((2.0, 1.0), (0.0, 0.1))));
    }

    /// There and back along any direction is a fold; straight on and around a corner are none.
    #[test]
    fn sides_that_go_back_on_themselves_fold() {
        let fold = |a, b, c| folds(side(a, b), side(b, c));
        for (x, y) in [
            (2.0, 0.0),
            (0.0, 2.0),
            (2.0, 4.0),
            (-4.0, 2.0),
            (-2.0, -6.0),
        ] {
            assert!(fold((0.0, 0.0), (x, y), (0.5 * x, 0.5 * y)), "{x} {y}");
            assert!(fold((0.0, 0.0), (x, y), (-x, -y)), "{x} {y}");
            assert!(!fold((0.0, 0.0), (x, y), (1.5 * x, 1.5 * y)), "{x} {y}");
            assert!(!fold((0.0, 0.0), (x, y), (x - y, y + x)), "{x} {y}");
            assert!(
                !fold((0.0, 0.0), (x, y), (0.5 * x - 0.05 * y, 0.5 * y + 0.05 * x)),
                "{x} {y}"
            );
        }
    }
}
