//! Points, poses and the two primitives that everything solid is made of.
//!
//! Every shape ends up as wall segments and circles. Both are hollow: they are surfaces, seen from
//! either side, so a polygon serves as the outline of a room and of a cupboard alike.

use core::f64::consts::{PI, TAU};

/// Slack in metres within which a ray counts as touching. Walls are longer by this much at either
/// end, so that no ray slips through a corner; a nanometre is far below anything measured.
const TOUCH_M: f64 = 1e-9;

/// Sine of the angle between ray and wall below which both count as parallel: over the largest
/// world (2 km) such a ray drifts by no more than [`TOUCH_M`].
const PARALLEL: f64 = 5e-13;

/// A position in the world, or the vector from one position to another, in metres.
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

/// Pose of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Metres forward (east).
    pub x: f64,
    /// Metres left (north).
    pub y: f64,
    /// Heading in radians, counter-clockwise from x; the world returns values in (-pi, pi].
    pub theta: f64,
}

impl Pose {
    /// The pose with these coordinates.
    pub const fn new(x: f64, y: f64, theta: f64) -> Self {
        Self { x, y, theta }
    }

    /// The position without the heading.
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

    /// The same ray relative to an origin at `at`.
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

/// Intersection of a ray with a primitive: distance along the ray, and the cosine between ray and
/// surface normal.
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
    /// First intersection with `ray`, within `limit`.
    #[inline]
    pub(super) fn cross(&self, ray: Ray, limit: f64) -> Option<Crossing> {
        match self {
            Self::Segment(segment) => segment.cross(ray, limit),
            Self::Circle(circle) => circle.cross(ray, limit),
        }
    }

    /// The point of the surface that is nearest to `point`, and its distance.
    pub(super) fn nearest(&self, point: Point) -> (Point, f64) {
        let at = match self {
            Self::Segment(segment) => segment.nearest(point),
            Self::Circle(circle) => circle.nearest(point),
        };
        (at, at.distance(point))
    }

    /// The surface turned about the origin by an angle with this sine and cosine.
    pub(super) fn turned(&self, (sin, cos): (f64, f64)) -> Self {
        let turn = |at: Point| Point::new(at.x * cos - at.y * sin, at.x * sin + at.y * cos);
        match *self {
            Self::Segment(segment) => Self::Segment(Segment {
                from: turn(segment.from),
                along: turn(segment.along),
                ..segment
            }),
            Self::Circle(circle) => Self::Circle(Circle {
                center: turn(circle.center),
                ..circle
            }),
        }
    }

    pub(super) fn bounds(&self) -> Bounds {
        match self {
            Self::Segment(s) => {
                Bounds::around(s.from, 0.0).union(Bounds::around(s.at(s.length), 0.0))
            }
            Self::Circle(c) => Bounds::around(c.center, c.radius),
        }
    }

    /// Whether the surface passes within `half` of `center` along both axes: whether it enters that
    /// square. May be `true` for a circle that only comes near a corner, but `false` is always
    /// right.
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
    /// The wall between two points; `None` if they are closer than a micrometre.
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

    pub(super) fn ends(&self) -> [Point; 2] {
        [self.from, self.at(self.length)]
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
mod tests;
