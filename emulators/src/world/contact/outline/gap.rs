//! Distances between an outline and a surface.

use crate::world::geometry::{Circle, Point, Primitive};

/// Depth of a body whose sides cross a surface, however little.
const CROSSED_M: f64 = 1e-9;

/// Closest points of body and surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gap {
    /// Metres; negative if they overlap.
    pub(super) gap: f64,
    pub(super) body: Point,
    pub(super) surface: Point,
}

/// Distance of `point` from a surface whose origin is at `place`.
pub(super) fn distance(point: Point, primitive: &Primitive, place: Point) -> f64 {
    let seen = Point::new(point.x - place.x, point.y - place.y);
    primitive.nearest(seen).1
}

/// Closest points of a body with these `corners` and a surface whose origin is at `place`.
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

/// The point between `a` and `b` that is nearest to `point`.
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

/// Whether two lines cross at a point within both.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::geometry::Segment;

    fn at(x: f64, y: f64) -> Point {
        Point::new(x, y)
    }

    /// 2 m along x and 1 m along y, from the origin on.
    fn body() -> [Point; 4] {
        [at(0.0, 0.0), at(2.0, 0.0), at(2.0, 1.0), at(0.0, 1.0)]
    }

    fn wall(from: Point, to: Point) -> Primitive {
        Primitive::Segment(Segment::new(from, to).unwrap())
    }

    fn pillar(center: Point, radius: f64) -> Primitive {
        Primitive::Circle(Circle { center, radius })
    }

    /// The gap, and the places on body and surface.
    fn found(primitive: &Primitive, place: Point) -> (f64, Point, Point) {
        let found = gap(&body(), at(1.0, 0.5), primitive, place);
        (found.gap, found.body, found.surface)
    }

    fn assert_is(found: (f64, Point, Point), gap: f64, body: Point, surface: Point) {
        assert!((found.0 - gap).abs() < 1e-12, "{found:?}");
        assert!(found.1.distance(body) < 1e-12, "{found:?}");
        assert!(found.2.distance(surface) < 1e-12, "{found:?}");
    }

    /// Beside a side, an end before a side, and beyond a corner (3, 4, 5). Another origin adds its
    /// distance.
    #[test]
    fn the_gap_to_a_wall_is_that_of_the_nearest_points() {
        let end = wall(at(1.0, 1.25), at(1.0, 4.0));
        let near = found(&end, Point::default());
        assert_is(near, 0.25, at(1.0, 1.0), at(1.0, 1.25));
        let moved = found(&end, at(0.5, 0.5));
        assert_is(moved, 0.75, at(1.5, 1.0), at(1.5, 1.75));
        let corner = wall(at(2.3, 1.4), at(5.0, 1.4));
        let near = found(&corner, Point::default());
        assert_is(near, 0.5, at(2.0, 1.0), at(2.3, 1.4));
        let slanted = wall(at(3.0, 0.0), at(2.0, 2.0));
        // (2, 1) is 0.5 m from the wall along x and 1 m along y, so 0.5 / sqrt(1.25) = sqrt(0.2) m
        // away.
        let near = found(&slanted, Point::default());
        let foot = at(2.4, 1.2);
        assert_is(near, 0.2_f64.sqrt(), at(2.0, 1.0), foot);
    }

    /// A wall through the body is as deep in it as its point nearest to the middle; one that cuts a
    /// corner off, or lies within, overlaps.
    #[test]
    fn a_wall_within_the_body_is_a_gap_below_zero() {
        let through = found(&wall(at(1.7, -1.0), at(1.7, 2.0)), Point::default());
        assert_is(through, -0.3, at(2.0, 0.5), at(1.7, 0.5));
        let cut = gap(
            &body(),
            at(1.0, 0.5),
            &wall(at(1.5, -0.3), at(2.2, 0.3)),
            Point::default(),
        );
        assert!((cut.gap + 1e-9).abs() < 1e-15, "{cut:?}");
        let within = found(&wall(at(0.2, 0.4), at(0.2, 0.6)), Point::default());
        assert_is(within, -0.2, at(0.0, 0.5), at(0.2, 0.5));
    }

    /// A pillar outside, one within the body, and a round room of 2 m around the body. The body's
    /// corners, 1.118 m from its middle, are nearest to the room's wall.
    #[test]
    fn the_gap_to_a_circle_is_that_of_its_rim() {
        let outside = found(&pillar(at(4.0, 0.5), 0.5), Point::default());
        assert_is(outside, 1.5, at(2.0, 0.5), at(3.5, 0.5));
        let moved = found(&pillar(at(4.0, 0.5), 0.5), at(-1.0, 0.0));
        assert_is(moved, 0.5, at(2.0, 0.5), at(2.5, 0.5));
        let within = found(&pillar(at(1.0, 0.4), 0.1), Point::default());
        assert_is(within, -0.5, at(1.0, 0.0), at(1.0, 0.3));
        let (room, corner, _) = found(&pillar(at(1.0, 0.5), 2.0), Point::default());
        assert!((room - (2.0 - 1.25_f64.sqrt())).abs() < 1e-12, "{room}");
        assert!((corner.distance(at(1.0, 0.5)) - 1.25_f64.sqrt()).abs() < 1e-12);
        // The room is moved to the left: its wall, at x = 1.5 m, cuts through the body.
        let (room, corner, surface) = found(&pillar(at(-0.5, 0.0), 2.0), Point::default());
        assert!((room - (2.0 - 7.25_f64.sqrt())).abs() < 1e-12, "{room}");
        assert!(corner.distance(at(2.0, 1.0)) < 1e-12);
        assert!((surface.distance(at(-0.5, 0.0)) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_surface_is_seen_from_its_origin() {
        let pillar = pillar(at(0.0, 0.0), 1.0);
        let away = |x: f64, y: f64| distance(at(1.0, 1.0), &pillar, at(x, y));
        assert_eq!(
            [away(1.0, 3.0), away(3.0, 1.0), away(1.0, 1.0)],
            [1.0, 1.0, 1.0]
        );
    }

    #[test]
    fn ways_cross_within_both() {
        let level = [at(0.0, 1.0), at(4.0, 1.0)];
        let crosses = |x0, y0, x1, y1| cross(level, [at(x0, y0), at(x1, y1)]);
        assert!(crosses(1.0, 0.0, 2.0, 3.0) && crosses(2.0, 3.0, 1.0, 0.0));
        assert!(!crosses(1.0, 1.5, 2.0, 3.0) && !crosses(5.0, 0.0, 5.0, 3.0));
        assert!(!crosses(-1.0, 0.0, -0.5, 3.0) && !crosses(1.0, 0.0, 2.0, 0.5));
    }

    #[test]
    fn a_point_lies_within_or_not() {
        let triangle = [at(0.0, 0.0), at(4.0, 0.0), at(1.0, 2.0)];
        let inside = [(1.0, 0.5), (2.4, 1.0), (0.6, 1.0), (3.5, 0.1)];
        let outside = [
            (2.6, 1.0),
            (0.4, 1.0),
            (1.0, 2.1),
            (1.0, -0.1),
            (-1.0, 0.5),
            (5.0, 0.5),
        ];
        assert_eq!(
            inside.map(|(x, y)| contains(&triangle, at(x, y))),
            [true; 4]
        );
        assert_eq!(
            outside.map(|(x, y)| contains(&triangle, at(x, y))),
            [false; 6]
        );
    }

    /// A square with sides of 1 m around (0, 3); the surface's origin is at (2, 3).
    #[test]
    fn a_surface_is_where_its_place_puts_it() {
        let square = [(0.5, 2.5), (0.5, 3.5), (-0.5, 3.5), (-0.5, 2.5)];
        let corners = square.map(|(x, y)| Point::new(x, y));
        let [middle, place] = [Point::new(0.0, 3.0), Point::new(2.0, 3.0)];
        let wall = Segment::new(Point::new(0.0, -1.0), Point::new(0.0, 1.0));
        let wall = Primitive::Segment(wall.expect("is 2 m long"));
        let post = Primitive::Circle(Circle {
            center: Point::new(0.0, 0.0),
            radius: 0.5,
        });
        assert!((gap(&corners, middle, &wall, place).gap - 1.5).abs() < 1e-12);
        assert!((gap(&corners, middle, &post, place).gap - 1.0).abs() < 1e-12);
        assert!((distance(Point::new(0.0, 3.0), &wall, place) - 2.0).abs() < 1e-12);
        assert!((distance(Point::new(0.0, 3.0), &post, place) - 1.5).abs() < 1e-12);
    }

    /// Random paths far from the origin: by Cramer's rule they cross if both parts lie between 0
    /// and 1.
    #[test]
    fn ways_at_random_cross_where_both_parts_lie_within() {
        let mut dice = crate::rng::Rng::stream(1, "ways");
        let mut crossings = 0;
        for _ in 0..2_000 {
            let [a, b, c, d] =
                [(); 4].map(|()| at(20.0 + dice.range(-2.0, 2.0), -9.0 + dice.range(-2.0, 2.0)));
            let [r, s, w] = [(a, b), (c, d), (a, c)].map(|(p, q)| [q.x - p.x, q.y - p.y]);
            let product = |u: [f64; 2], v: [f64; 2]| u[0] * v[1] - u[1] * v[0];
            let whole = product(r, s);
            let parts = [product(w, s) / whole, product(w, r) / whole];
            let expected = parts.iter().all(|part| (0.0..=1.0).contains(part));
            assert_eq!(cross([a, b], [c, d]), expected, "{a:?} {b:?} {c:?} {d:?}");
            crossings += u32::from(expected);
        }
        assert!((200..1_000).contains(&crossings), "{crossings}");
    }

    /// A corner in the very middle of a pillar has no direction to its rim.
    #[test]
    fn a_corner_in_the_middle_of_a_pillar_is_as_deep_as_its_radius() {
        let corner = at(2.0, 1.0);
        let inside = found(&pillar(corner, 0.5), Point::default());
        assert_is(inside, -0.5, corner, corner);
    }
}
