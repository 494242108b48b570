//! Points, poses and the two primitives that everything solid is made of.
//!
//! Every shape ends up as wall segments and circles. Both are hollow: they are surfaces, seen from
//! either side, so a polygon serves as the outline of a room and of a cupboard alike.

use core::f64::consts::{PI, TAU};

/// Slack in metres within which a ray counts as touching. Walls are longer by this much at either
/// end, so that no ray slips through a corner; a nanometre is far below anything measured.
const TOUCH_M: f64 = 1e-9;

/// Sine of the angle between ray and wall below which the two count as parallel: over the largest
/// world (2 km) such a ray drifts by no more than [`TOUCH_M`].
const PARALLEL: f64 = 5e-13;

/// A place in the world, or the way from one place to another, in metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Forward (east), metres.
    pub x: f64,
    /// Left (north), metres.
    pub y: f64,
}

impl Point {
    /// The place at these coordinates.
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }

    /// Distance to `other`.
    pub fn distance(self, other: Self) -> f64 {
        let (dx, dy) = (other.x - self.x, other.y - self.y);
        (dx * dx + dy * dy).sqrt()
    }

    /// Whether both coordinates are numbers.
    pub const fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite()
    }
}

/// Where a body is and which way it looks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Metres forward (east).
    pub x: f64,
    /// Metres left (north).
    pub y: f64,
    /// Heading in radians, counter-clockwise from x; what the world hands out is in (-pi, pi].
    pub theta: f64,
}

impl Pose {
    /// The pose with these coordinates.
    pub const fn new(x: f64, y: f64, theta: f64) -> Self {
        Self { x, y, theta }
    }

    /// Without the heading.
    pub const fn point(self) -> Point {
        Point::new(self.x, self.y)
    }

    /// Whether all three are numbers.
    pub const fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.theta.is_finite()
    }

    /// The place that lies `ahead` and `left` of this pose: where a sensor sits.
    pub fn offset(self, ahead: f64, left: f64) -> Point {
        let (sin, cos) = libm::sincos(self.theta);
        Point::new(
            self.x + ahead * cos - left * sin,
            self.y + ahead * sin + left * cos,
        )
    }
}

/// The same angle in (-pi, pi].
pub fn wrap_angle(angle: f64) -> f64 {
    if angle > -PI && angle <= PI {
        return angle;
    }
    let turned = angle - TAU * (angle / TAU).round();
    if turned <= -PI { turned + TAU } else { turned }
}

/// An upright rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The corner with the least coordinates.
    pub min: Point,
    /// The corner with the greatest coordinates.
    pub max: Point,
}

impl Bounds {
    /// The rectangle around `point` that reaches `reach` metres to each side.
    pub const fn around(point: Point, reach: f64) -> Self {
        Self {
            min: Point::new(point.x - reach, point.y - reach),
            max: Point::new(point.x + reach, point.y + reach),
        }
    }

    /// The same rectangle with `by` metres more to each side.
    #[must_use]
    pub const fn grown(self, by: f64) -> Self {
        Self {
            min: Point::new(self.min.x - by, self.min.y - by),
            max: Point::new(self.max.x + by, self.max.y + by),
        }
    }

    /// The least rectangle around this and `other`.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self {
            min: Point::new(self.min.x.min(other.min.x), self.min.y.min(other.min.y)),
            max: Point::new(self.max.x.max(other.max.x), self.max.y.max(other.max.y)),
        }
    }

    /// Whether `other` lies inside, edges included.
    pub const fn contains(self, other: Self) -> bool {
        self.min.x <= other.min.x
            && self.min.y <= other.min.y
            && self.max.x >= other.max.x
            && self.max.y >= other.max.y
    }
}

/// A ray: where it starts and its direction as a unit vector.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) from: Point,
    pub(super) dir: Point,
}

impl Ray {
    pub(super) fn new(from: Point, angle: f64) -> Self {
        let (sin, cos) = libm::sincos(angle);
        Self {
            from,
            dir: Point::new(cos, sin),
        }
    }

    /// The same ray seen by something that stands at `at`.
    pub(super) fn seen_from(self, at: Point) -> Self {
        Self {
            from: Point::new(self.from.x - at.x, self.from.y - at.y),
            dir: self.dir,
        }
    }

    /// Whether the ray comes within `reach` of the place it takes as its origin.
    pub(super) fn passes_origin(self, reach: f64) -> bool {
        let ahead = -(self.from.x * self.dir.x + self.from.y * self.dir.y);
        let aside = self.dir.x * self.from.y - self.dir.y * self.from.x;
        aside.abs() <= reach && ahead >= -reach
    }
}

/// Where a ray meets a primitive: how far along, and the cosine between ray and surface normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Crossing {
    pub(super) distance: f64,
    pub(super) incidence: f64,
}

/// A straight wall or a circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Primitive {
    Segment(Segment),
    Circle(Circle),
}

impl Primitive {
    /// Where `ray` first meets it, no farther than `limit`.
    #[inline]
    pub(super) fn cross(&self, ray: Ray, limit: f64) -> Option<Crossing> {
        match self {
            Self::Segment(segment) => segment.cross(ray, limit),
            Self::Circle(circle) => circle.cross(ray, limit),
        }
    }

    /// The point of the surface that is nearest to `point`, and how far it is.
    pub(super) fn nearest(&self, point: Point) -> (Point, f64) {
        let at = match self {
            Self::Segment(segment) => segment.nearest(point),
            Self::Circle(circle) => circle.nearest(point),
        };
        (at, at.distance(point))
    }

    pub(super) fn bounds(&self) -> Bounds {
        match self {
            Self::Segment(s) => {
                Bounds::around(s.from, 0.0).union(Bounds::around(s.at(s.length), 0.0))
            }
            Self::Circle(c) => Bounds::around(c.center, c.radius),
        }
    }

    /// Whether the surface passes within `half` of `center` along both axes: whether it enters
    /// that square. May say yes for a circle that only comes near a corner, never a wrong no.
    pub(super) fn enters(&self, center: Point, half: f64) -> bool {
        match self {
            Self::Segment(s) => {
                let box_bounds = Bounds::around(center, half);
                let own = self.bounds();
                let aside = (center.x - s.from.x) * s.along.y - (center.y - s.from.y) * s.along.x;
                own.min.x <= box_bounds.max.x
                    && own.max.x >= box_bounds.min.x
                    && own.min.y <= box_bounds.max.y
                    && own.max.y >= box_bounds.min.y
                    && aside.abs() <= half * (s.along.x.abs() + s.along.y.abs())
            }
            Self::Circle(c) => {
                (c.center.distance(center) - c.radius).abs() <= half * core::f64::consts::SQRT_2
            }
        }
    }
}

/// A straight wall without thickness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    from: Point,
    /// Unit vector along the wall.
    along: Point,
    length: f64,
}

impl Segment {
    /// The wall between two places; `None` if they are closer than a micrometre.
    pub(super) fn new(from: Point, to: Point) -> Option<Self> {
        let length = from.distance(to);
        (length >= 1e-6).then(|| Self {
            from,
            along: Point::new((to.x - from.x) / length, (to.y - from.y) / length),
            length,
        })
    }

    /// Unit vector from one end to the other.
    pub(super) fn along(&self) -> Point {
        self.along
    }

    pub(super) fn length(&self) -> f64 {
        self.length
    }

    pub(super) fn middle(&self) -> Point {
        self.at(0.5 * self.length)
    }

    fn at(&self, distance: f64) -> Point {
        Point::new(
            self.from.x + self.along.x * distance,
            self.from.y + self.along.y * distance,
        )
    }

    /// The division comes last: nearly every candidate is refused before it.
    #[inline]
    fn cross(&self, ray: Ray, limit: f64) -> Option<Crossing> {
        let (rx, ry) = (self.from.x - ray.from.x, self.from.y - ray.from.y);
        let sin = ray.dir.x * self.along.y - ray.dir.y * self.along.x;
        let aside = rx * self.along.y - ry * self.along.x;
        if sin.abs() <= PARALLEL {
            return self.cross_end_on(ray, rx, ry, aside, limit);
        }
        let incidence = sin.abs();
        let ahead = if sin < 0.0 { -aside } else { aside };
        if ahead < -TOUCH_M * incidence || ahead > limit * incidence {
            return None;
        }
        let cos = ray.dir.x * self.along.x + ray.dir.y * self.along.y;
        let along = ahead * cos - (rx * self.along.x + ry * self.along.y) * incidence;
        if along < -TOUCH_M * incidence || along > (self.length + TOUCH_M) * incidence {
            return None;
        }
        Some(Crossing {
            distance: (ahead / incidence).max(0.0),
            incidence,
        })
    }

    /// A ray along the line of the wall meets its nearer end, or starts on it.
    #[cold]
    fn cross_end_on(&self, ray: Ray, rx: f64, ry: f64, aside: f64, limit: f64) -> Option<Crossing> {
        if aside.abs() > TOUCH_M {
            return None;
        }
        let cos = ray.dir.x * self.along.x + ray.dir.y * self.along.y;
        let one_end = rx * ray.dir.x + ry * ray.dir.y;
        let other_end = one_end + self.length * cos;
        let (near, far) = (one_end.min(other_end), one_end.max(other_end));
        (far >= -TOUCH_M && near <= limit).then(|| Crossing {
            distance: near.max(0.0),
            incidence: 0.0,
        })
    }

    fn nearest(&self, point: Point) -> Point {
        let (px, py) = (point.x - self.from.x, point.y - self.from.y);
        let along = (px * self.along.x + py * self.along.y).clamp(0.0, self.length);
        Point::new(
            self.from.x + self.along.x * along,
            self.from.y + self.along.y * along,
        )
    }
}

/// A round pillar or a thin leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Circle {
    pub(super) center: Point,
    pub(super) radius: f64,
}

impl Circle {
    #[inline]
    fn cross(&self, ray: Ray, limit: f64) -> Option<Crossing> {
        let (rx, ry) = (self.center.x - ray.from.x, self.center.y - ray.from.y);
        let aside = ray.dir.x * ry - ray.dir.y * rx;
        let beside = (self.radius - aside) * (self.radius + aside);
        if beside < 0.0 {
            return None;
        }
        let ahead = rx * ray.dir.x + ry * ray.dir.y;
        let half_chord = beside.sqrt();
        let entry = ahead - half_chord;
        let distance = if entry >= -TOUCH_M {
            entry
        } else {
            ahead + half_chord
        };
        (distance >= -TOUCH_M && distance <= limit).then(|| Crossing {
            distance: distance.max(0.0),
            incidence: half_chord / self.radius,
        })
    }

    fn nearest(&self, point: Point) -> Point {
        let distance = self.center.distance(point);
        if distance == 0.0 {
            return Point::new(self.center.x + self.radius, self.center.y);
        }
        let scale = self.radius / distance;
        Point::new(
            self.center.x + (point.x - self.center.x) * scale,
            self.center.y + (point.y - self.center.y) * scale,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, SQRT_2};

    /// From (1, -1) to (1, 1).
    fn wall() -> Primitive {
        Primitive::Segment(Segment::new(Point::new(1.0, -1.0), Point::new(1.0, 1.0)).unwrap())
    }

    /// Of radius 1 around (3, 0).
    fn pillar() -> Primitive {
        Primitive::Circle(Circle {
            center: Point::new(3.0, 0.0),
            radius: 1.0,
        })
    }

    fn cast(primitive: Primitive, x: f64, y: f64, angle: f64) -> Option<Crossing> {
        primitive.cross(Ray::new(Point::new(x, y), angle), 100.0)
    }

    fn crossing(distance: f64, incidence: f64) -> Option<Crossing> {
        Some(Crossing {
            distance,
            incidence,
        })
    }

    fn assert_close(found: Option<Crossing>, distance: f64, incidence: f64) {
        let found = found.expect("a crossing");
        assert!((found.distance - distance).abs() < 1e-12, "{found:?}");
        assert!((found.incidence - incidence).abs() < 1e-7, "{found:?}");
    }

    #[test]
    fn a_ray_head_on_meets_the_wall_from_either_side() {
        assert_eq!(cast(wall(), 0.0, 0.5, 0.0), crossing(1.0, 1.0));
        assert_close(cast(wall(), 2.5, 0.5, PI), 1.5, 1.0);
    }

    #[test]
    fn a_ray_at_45_degrees_goes_sqrt_2_as_far_at_cosine_0_7() {
        assert_close(cast(wall(), 0.0, -0.5, FRAC_PI_4), SQRT_2, 0.5 * SQRT_2);
    }

    #[test]
    fn a_wall_behind_is_not_met() {
        assert_eq!(cast(wall(), 2.0, 0.0, 0.0), None);
    }

    #[test]
    fn a_parallel_ray_beside_the_wall_misses() {
        assert_eq!(cast(wall(), 1.1, -5.0, FRAC_PI_2), None);
    }

    #[test]
    fn a_collinear_ray_meets_the_nearer_end_from_below_and_from_above() {
        assert_close(cast(wall(), 1.0, -5.0, FRAC_PI_2), 4.0, 0.0);
        assert_close(cast(wall(), 1.0, 5.0, -FRAC_PI_2), 4.0, 0.0);
    }

    #[test]
    fn a_collinear_ray_that_starts_on_the_wall_meets_it_at_once() {
        assert_close(cast(wall(), 1.0, 0.25, FRAC_PI_2), 0.0, 0.0);
    }

    #[test]
    fn a_collinear_ray_that_leaves_the_wall_behind_misses() {
        assert_eq!(cast(wall(), 1.0, 1.5, FRAC_PI_2), None);
    }

    #[test]
    fn a_ray_that_starts_on_the_wall_meets_it_at_once_in_both_directions() {
        assert_eq!(cast(wall(), 1.0, 0.0, 0.0), crossing(0.0, 1.0));
        assert_close(cast(wall(), 1.0, 0.0, PI), 0.0, 1.0);
    }

    /// The corner (1, 1) is where two walls of a room meet; by rounding the ray may pass either
    /// end a tiny bit outside.
    #[test]
    fn a_ray_through_an_end_of_the_wall_meets_it() {
        assert_close(cast(wall(), 0.0, 0.0, FRAC_PI_4), SQRT_2, 0.5 * SQRT_2);
        assert_close(cast(wall(), -2.0, 1.0, 0.0), 3.0, 1.0);
    }

    #[test]
    fn a_ray_that_passes_an_end_by_a_micrometre_misses() {
        assert_eq!(cast(wall(), 0.0, 1.000_001, 0.0), None);
    }

    #[test]
    fn a_wall_beyond_the_limit_is_not_met_and_one_at_the_limit_is() {
        let ray = Ray::new(Point::new(0.0, 0.0), 0.0);
        assert_eq!(wall().cross(ray, 0.999), None);
        assert_eq!(wall().cross(ray, 1.0), crossing(1.0, 1.0));
    }

    #[test]
    fn a_ray_at_the_middle_of_a_circle_meets_its_near_side_head_on() {
        assert_eq!(cast(pillar(), 0.0, 0.0, 0.0), crossing(2.0, 1.0));
    }

    /// 0.6 beside the middle: half chord 0.8.
    #[test]
    fn a_ray_beside_the_middle_of_a_circle_meets_it_askew() {
        assert_close(cast(pillar(), 0.0, 0.6, 0.0), 2.2, 0.8);
    }

    #[test]
    fn a_tangent_meets_the_circle_where_it_touches() {
        assert_eq!(cast(pillar(), 0.0, 1.0, 0.0), crossing(3.0, 0.0));
        assert_eq!(cast(pillar(), 0.0, 1.000_001, 0.0), None);
    }

    #[test]
    fn a_ray_from_inside_a_circle_meets_its_far_side() {
        assert_eq!(cast(pillar(), 3.0, 0.0, 0.0), crossing(1.0, 1.0));
        assert_close(cast(pillar(), 3.5, 0.0, PI), 1.5, 1.0);
    }

    #[test]
    fn a_ray_from_the_circle_itself_meets_it_at_once() {
        assert_eq!(cast(pillar(), 2.0, 0.0, 0.0), crossing(0.0, 1.0));
        assert_close(cast(pillar(), 2.0, 0.0, PI), 0.0, 1.0);
    }

    #[test]
    fn a_circle_behind_is_not_met() {
        assert_eq!(cast(pillar(), 4.5, 0.0, 0.0), None);
    }

    #[test]
    fn the_nearest_point_of_a_wall_is_beside_it_or_its_end() {
        assert_eq!(
            wall().nearest(Point::new(4.0, 0.5)),
            (Point::new(1.0, 0.5), 3.0)
        );
        assert_eq!(
            wall().nearest(Point::new(4.0, 5.0)),
            (Point::new(1.0, 1.0), 5.0)
        );
    }

    #[test]
    fn the_nearest_point_of_a_circle_is_found_from_its_middle_too() {
        assert_eq!(
            pillar().nearest(Point::new(0.0, 0.0)),
            (Point::new(2.0, 0.0), 2.0)
        );
        assert_eq!(pillar().nearest(Point::new(3.0, 0.0)).1, 1.0);
    }

    #[test]
    fn a_wall_that_passes_a_corner_of_a_square_does_not_enter_it() {
        let diagonal = Segment::new(Point::new(0.0, 2.1), Point::new(2.1, 0.0)).unwrap();
        assert!(!Primitive::Segment(diagonal).enters(Point::new(0.5, 0.5), 0.5));
        assert!(Primitive::Segment(diagonal).enters(Point::new(0.6, 0.6), 0.5));
    }

    #[test]
    fn angles_wrap_to_half_a_turn_either_way() {
        assert_eq!(wrap_angle(PI), PI);
        assert!((wrap_angle(-PI) - PI).abs() < 1e-15);
        assert!((wrap_angle(7.0) - (7.0 - TAU)).abs() < 1e-15);
        assert!((wrap_angle(-100.0) - (16.0 * TAU - 100.0)).abs() < 1e-13);
    }

    #[test]
    fn a_sensor_ahead_and_left_of_a_robot_that_looks_left_is_behind_it_in_x() {
        let place = Pose::new(1.0, 2.0, FRAC_PI_2).offset(0.3, 0.1);
        assert!(
            (place.x - 0.9).abs() < 1e-15 && (place.y - 2.3).abs() < 1e-15,
            "{place:?}"
        );
    }
}
