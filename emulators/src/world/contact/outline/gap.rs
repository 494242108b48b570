//! Distances between an outline and a surface.

use crate::world::geometry::{Circle, Point, Primitive};

/// Depth of a body whose sides cross a surface, however little.
const CROSSED_M: f64 = 1e-9;

/// Where body and surface are closest.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gap {
    /// Metres; negative if they overlap.
    pub(super) gap: f64,
    pub(super) body: Point,
    pub(super) surface: Point,
}

/// Of `point` from a surface whose origin is at `place`.
pub(super) fn distance(point: Point, primitive: &Primitive, place: Point) -> f64 {
    let seen = Point::new(point.x - place.x, point.y - place.y);
    primitive.nearest(seen).1
}

/// Where a body with these `corners` is closest to a surface whose origin is at `place`.
pub(super) fn gap(corners: &[Point], middle: Point, primitive: &Primitive, place: Point) -> Gap {
    match primitive {
        Primitive::Segment(wall) => {
            let ends = wall.ends();
            let ends = ends.map(|end| Point::new(end.x + place.x, end.y + place.y));
            to_segment(corners, middle, ends)
        }
        Primitive::Circle(circle) => {
            let center = Point::new(circle.center.x + place.x, circle.center.y + place.y);
            let radius = circle.radius;
            to_circle(corners, Circle { center, radius })
        }
    }
}

fn to_segment(corners: &[Point], middle: Point, [from, to]: [Point; 2]) -> Gap {
    let mut best = Gap {
        gap: f64::INFINITY,
        body: from,
        surface: from,
    };
    let mut overlaps = contains(corners, from);
    let mut closer = |body: Point, surface: Point| {
        let gap = body.distance(surface);
        if gap < best.gap {
            best = Gap { gap, body, surface };
        }
    };
    for [a, b] in sides(corners) {
        closer(a, on_side([from, to], a));
        for end in [from, to] {
            closer(on_side([a, b], end), end);
        }
        overlaps |= cross([a, b], [from, to]);
    }
    if !overlaps {
        return best;
    }
    let surface = on_side([from, to], middle);
    let body = on_outline(corners, surface);
    let depth = if contains(corners, surface) {
        body.distance(surface)
    } else {
        0.0
    };
    Gap {
        gap: -depth.max(CROSSED_M),
        body,
        surface,
    }
}

/// A circle is hollow: the body may stand outside or inside.
fn to_circle(corners: &[Point], Circle { center, radius }: Circle) -> Gap {
    let at = |body: Point| {
        let away = center.distance(body);
        let scale = if away > 0.0 { radius / away } else { 0.0 };
        Point::new(
            center.x + (body.x - center.x) * scale,
            center.y + (body.y - center.y) * scale,
        )
    };
    let near = on_outline(corners, center);
    let away = center.distance(near);
    let outside = if contains(corners, center) {
        -away - radius
    } else {
        away - radius
    };
    let far = corners.iter().copied().fold(near, |far, corner| {
        if center.distance(corner) > center.distance(far) {
            corner
        } else {
            far
        }
    });
    let inside = radius - center.distance(far);
    let (gap, body) = if outside >= inside {
        (outside, near)
    } else {
        (inside, far)
    };
    let surface = at(body);
    Gap { gap, body, surface }
}

fn sides(corners: &[Point]) -> impl Iterator<Item = [Point; 2]> {
    let next = corners.iter().cycle().skip(1);
    corners.iter().zip(next).map(|(&a, &b)| [a, b])
}

/// The point of the way from `a` to `b` that is nearest to `point`.
fn on_side([a, b]: [Point; 2], point: Point) -> Point {
    let (dx, dy) = (b.x - a.x, b.y - a.y);
    let square = dx * dx + dy * dy;
    let along = ((point.x - a.x) * dx + (point.y - a.y) * dy) / square;
    let along = along.clamp(0.0, 1.0);
    Point::new(a.x + dx * along, a.y + dy * along)
}

fn on_outline(corners: &[Point], point: Point) -> Point {
    let mut best = (f64::INFINITY, point);
    for side in sides(corners) {
        let at = on_side(side, point);
        let away = at.distance(point);
        if away < best.0 {
            best = (away, at);
        }
    }
    best.1
}

/// Whether two ways cross at a point within both.
fn cross([a, b]: [Point; 2], [c, d]: [Point; 2]) -> bool {
    let side = |a: Point, b: Point, c: Point| (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}

/// Whether `point` lies within the outline: a ray to the right leaves it an odd number of times.
fn contains(corners: &[Point], point: Point) -> bool {
    let mut within = false;
    for [a, b] in sides(corners) {
        if (a.y > point.y) != (b.y > point.y)
            && point.x < a.x + (point.y - a.y) * (b.x - a.x) / (b.y - a.y)
        {
            within = !within;
        }
    }
    within
}
