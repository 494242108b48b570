use super::*;
use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, SQRT_2};

/// A wall from (1, -1) to (1, 1).
fn wall() -> Primitive {
    Primitive::Segment(Segment::new(Point::new(1.0, -1.0), Point::new(1.0, 1.0)).unwrap())
}

/// A pillar of radius 1 around (3, 0).
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

/// The ray passes 0.6 m beside the middle of a circle of 1 m: half of its chord is 0.8 m.
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
    assert_eq!(
        pillar().nearest(Point::new(3.0, 0.0)),
        (Point::new(4.0, 0.0), 1.0)
    );
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

/// The wall from (1, 0) to (1, 1) is met up to a nanometre beyond either end, and at exactly that
/// distance.
#[test]
fn a_wall_is_met_up_to_a_nanometre_beyond_its_ends() {
    let wall = Segment::new(Point::new(1.0, 0.0), Point::new(1.0, 1.0)).unwrap();
    let is_met = |y: f64| cast(Primitive::Segment(wall), 0.0, y, 0.0).is_some();
    assert_eq!([-2e-9, -1e-9, 0.0].map(is_met), [false, true, true]);
    assert_eq!(
        [0.0, 0.5e-9, 2e-9].map(|over| is_met(1.0 + over)),
        [true, true, false]
    );
}

/// Rays on the wall's line. A ray that starts beyond the wall's other end by a nanometre misses it.
/// Other rays meet it if they are long enough, and up to a nanometre beside it.
#[test]
fn a_ray_along_the_wall_meets_it_up_to_a_nanometre() {
    let met = |x: f64, y: f64, limit: f64| {
        let ray = Ray::new(Point::new(x, y), FRAC_PI_2);
        wall().cross(ray, limit).map(|crossing| crossing.distance)
    };
    assert_eq!([met(1.0, 0.0, 9.0), met(1.0, 1.0, 9.0)], [Some(0.0); 2]);
    assert_eq!(met(1.0, 1.0 + 1e-6, 9.0), None);
    assert_eq!(
        [met(1.0, -5.0, 4.0), met(1.0, -5.0, 3.99)],
        [Some(4.0), None]
    );
    assert!(met(1.0 + 0.5e-9, -5.0, 9.0).is_some() && met(1.0 - 0.5e-9, -5.0, 9.0).is_some());
    assert_eq!(
        [met(1.0 + 2e-9, -5.0, 9.0), met(1.0 - 2e-9, -5.0, 9.0)],
        [None; 2]
    );
}

/// Half a turn is returned as pi, from either side; a turn and a half is half a turn.
#[test]
fn an_angle_is_wrapped_into_one_turn() {
    assert_eq!([PI, -PI, 0.5, -0.5].map(wrap_angle), [PI, PI, 0.5, -0.5]);
    let near = |angle: f64, expected: f64| (wrap_angle(angle) - expected).abs() < 1e-12;
    assert!(near(3.5, 3.5 - TAU) && near(-3.5, TAU - 3.5));
    assert!(near(TAU, 0.0) && near(7.0, 7.0 - TAU) && near(-13.0, 2.0 * TAU - 13.0));
    assert!(near(3.0 * PI, PI) && near(-3.0 * PI, PI));
}

#[test]
fn a_place_is_finite_if_each_of_its_figures_is() {
    let bad = [f64::NAN, f64::INFINITY];
    assert!(Point::new(1.0, -2.0).is_finite());
    assert!(Pose::new(1.0, -2.0, 9.0).is_finite());
    for bad in bad {
        assert!(!Point::new(bad, 0.0).is_finite());
        assert!(!Point::new(0.0, bad).is_finite());
        assert!(!Pose::new(bad, 0.0, 0.0).is_finite());
        assert!(!Pose::new(0.0, bad, 0.0).is_finite());
        assert!(!Pose::new(0.0, 0.0, bad).is_finite());
    }
}

fn bounds(min: [f64; 2], max: [f64; 2]) -> Bounds {
    let [min, max] = [min, max].map(|[x, y]| Point::new(x, y));
    Bounds { min, max }
}

#[test]
fn rectangles_grow_and_join_to_each_side() {
    let around = Bounds::around(Point::new(3.0, -1.0), 2.0);
    assert_eq!(around, bounds([1.0, -3.0], [5.0, 1.0]));
    assert_eq!(around.grown(0.5), bounds([0.5, -3.5], [5.5, 1.5]));
    let other = bounds([2.0, -9.0], [4.0, 7.0]);
    let union = bounds([1.0, -9.0], [5.0, 7.0]);
    assert_eq!([around.union(other), other.union(around)], [union; 2]);
}

#[test]
fn a_rectangle_holds_what_reaches_beyond_none_of_its_edges() {
    let whole = bounds([0.0, 10.0], [4.0, 13.0]);
    assert!(whole.contains(whole));
    assert!(whole.contains(bounds([1.0, 11.0], [2.0, 12.0])));
    assert!(!whole.contains(bounds([-0.5, 11.0], [2.0, 12.0])));
    assert!(!whole.contains(bounds([1.0, 9.5], [2.0, 12.0])));
    assert!(!whole.contains(bounds([1.0, 11.0], [4.5, 12.0])));
    assert!(!whole.contains(bounds([1.0, 11.0], [2.0, 13.5])));
}

/// From (1, 2) along the diagonal (1, 1): the origin lies 3 / root 2 behind and 1 / root 2 aside.
#[test]
fn a_ray_passes_what_it_comes_near_and_does_not_leave_behind() {
    let passes = |x, y, angle, reach| Ray::new(Point::new(x, y), angle).passes_origin(reach);
    assert_eq!(
        [2.12, 2.13].map(|r| passes(1.0, 2.0, FRAC_PI_4, r)),
        [false, true]
    );
    assert_eq!(
        [0.70, 0.71].map(|r| passes(-1.0, -2.0, FRAC_PI_4, r)),
        [false, true]
    );
    assert_eq!([0.9, 1.1].map(|r| passes(-5.0, 1.0, 0.0, r)), [false, true]);
    assert_eq!(
        [0.9, 1.1].map(|r| passes(-5.0, -1.0, 0.0, r)),
        [false, true]
    );
    assert!(!passes(5.0, 0.0, 0.0, 1.0));
    let moved = Ray::new(Point::new(4.0, 1.0), 0.0).seen_from(Point::new(3.0, 7.0));
    assert_eq!(moved.from, Point::new(1.0, -6.0));
    assert_eq!(moved.dir, Point::new(1.0, 0.0));
}

/// A wall from (1, 2) to (4, 6) is 3 long along x, 4 along y and 5 in all.
#[test]
fn a_wall_has_two_ends_a_middle_and_a_way_along() {
    let [from, to] = [Point::new(1.0, 2.0), Point::new(4.0, 6.0)];
    let wall = Segment::new(from, to).expect("it is long enough");
    assert_eq!(wall.length(), 5.0);
    assert_eq!(wall.along(), Point::new(0.6, 0.8));
    assert_eq!(wall.middle(), Point::new(2.5, 4.0));
    assert_eq!(wall.ends(), [from, to]);
    assert_eq!(
        Primitive::Segment(wall).bounds(),
        bounds([1.0, 2.0], [4.0, 6.0])
    );
    let back = Segment::new(to, from).expect("it is as long");
    assert_eq!(
        Primitive::Segment(back).bounds(),
        bounds([1.0, 2.0], [4.0, 6.0])
    );
    assert_eq!(pillar().bounds(), bounds([2.0, -1.0], [4.0, 1.0]));
    let near = |metres: f64| Segment::new(from, Point::new(1.0, 2.0 + metres)).is_some();
    assert_eq!([0.9e-6, 1.1e-6].map(near), [false, true]);
}

/// The wall from (1, -1) to (1, 1) and squares of half a metre to each side; the circle of radius 1
/// around (3, 0) and squares whose corners are 0.707 m away.
#[test]
fn a_surface_enters_the_squares_it_passes_through() {
    let enters = |one: Primitive, x, y| one.enters(Point::new(x, y), 0.5);
    assert!(enters(wall(), 1.4, 0.0) && enters(wall(), 0.6, 0.0));
    assert!(!enters(wall(), 1.6, 0.0) && !enters(wall(), 0.4, 0.0));
    assert!(enters(wall(), 1.0, 1.4) && enters(wall(), 1.0, -1.4));
    assert!(!enters(wall(), 1.0, 1.6) && !enters(wall(), 1.0, -1.6));
    let diagonal = Segment::new(Point::new(0.0, 0.0), Point::new(4.0, 4.0));
    let diagonal = Primitive::Segment(diagonal.expect("long enough"));
    assert!(enters(diagonal, 2.4, 1.6) && enters(diagonal, 1.6, 2.4));
    assert!(!enters(diagonal, 2.6, 1.4) && !enters(diagonal, 1.4, 2.6));
    assert!(!enters(pillar(), 3.0, 0.0), "it is hollow");
    assert!(enters(pillar(), 3.4, 0.0) && enters(pillar(), 4.7, 0.0));
    assert!(!enters(pillar(), 3.25, 0.0) && !enters(pillar(), 4.75, 0.0));
}

/// A metre ahead and half a metre left of (2, 3).
#[test]
fn what_lies_ahead_and_left_turns_with_the_robot() {
    let offset = |theta| Pose::new(2.0, 3.0, theta).offset(1.0, 0.5);
    for (theta, x, y) in [
        (0.0, 3.0, 3.5),
        (FRAC_PI_2, 1.5, 4.0),
        (PI, 1.0, 2.5),
        (-FRAC_PI_2, 2.5, 2.0),
    ] {
        let found = offset(theta);
        assert!(found.distance(Point::new(x, y)) < 1e-12, "{found:?}");
    }
}

/// A quarter turn takes x to y and y to -x: the pillar at (3, 0) stands at (0, 3), the wall from
/// (1, -1) to (1, 1) goes from (1, 1) to (-1, 1).
#[test]
fn a_surface_turns_about_the_origin() {
    let at = |primitive: Primitive, x, y| primitive.nearest(Point::new(x, y)).0;
    let is = |at: Point, x: f64, y: f64| (at.x - x).abs() < 1e-12 && (at.y - y).abs() < 1e-12;
    let quarter = (1.0, 0.0);
    assert!(is(at(pillar().turned(quarter), 0.0, 0.0), 0.0, 2.0));
    assert!(is(at(wall().turned(quarter), 2.0, 3.0), 1.0, 1.0));
    assert!(is(at(wall().turned(quarter), -2.0, 3.0), -1.0, 1.0));
    let eighth = libm::sincos(FRAC_PI_4);
    assert!(is(at(wall().turned(eighth), -9.0, 9.0), 0.0, SQRT_2));
    let tilted = Primitive::Circle(Circle {
        center: Point::new(1.0, 1.0),
        radius: 0.0,
    });
    assert!(is(at(tilted.turned(eighth), 9.0, 9.0), 0.0, SQRT_2));
}

/// From (1, 2) to (4, 6), 5 m long; its normal is (-0.8, 0.6).
fn slanted_wall() -> Primitive {
    Primitive::Segment(Segment::new(Point::new(1.0, 2.0), Point::new(4.0, 6.0)).unwrap())
}

/// The wall x = y from (1, 1) on, 2 m long. A ray from (1 + over, 0) in the direction of y meets it
/// after 1 + over metres, at a cosine of 0.707.
#[test]
fn at_45_degrees_limit_and_ends_are_those_of_the_ray_and_the_wall() {
    let end = Point::new(1.0 + SQRT_2, 1.0 + SQRT_2);
    let wall = Segment::new(Point::new(1.0, 1.0), end).unwrap();
    let met = |over: f64, limit: f64| {
        let ray = Ray::new(Point::new(1.0 + over, 0.0), FRAC_PI_2);
        let found = Primitive::Segment(wall).cross(ray, limit);
        found.map(|found| found.distance)
    };
    let reaches = [0.7, 1.4, 1.49, 1.51, 2.1].map(|limit| met(0.5, limit).is_some());
    assert_eq!(reaches, [false, false, false, true, true]);
    // Along the wall a nanometre is 0.707 nm to the side.
    let before = [-0.4e-9, -1.0e-9, -1.6e-9].map(|over| met(over, 9.0).is_some());
    assert_eq!(before, [true, false, false]);
    let beyond = [0.4e-9, 1.0e-9, 0.5, 5.0].map(|over| met(SQRT_2 + over, 9.0).is_some());
    assert_eq!(beyond, [true, false, false, false]);
    // A start that lies a nanometre behind the wall, measured along the ray, still touches it.
    let behind = |metres: f64| {
        let ray = Ray::new(Point::new(1.5, 1.5 + metres), FRAC_PI_2);
        Primitive::Segment(wall).cross(ray, 9.0).is_some()
    };
    assert_eq!([0.6e-9, 1.4e-9].map(behind), [true, false]);
}

/// From 10 m before the wall's end, on its line, to the end; from beyond it, back; from inside.
#[test]
fn a_ray_along_a_slanted_wall_meets_its_nearer_end() {
    let angle = libm::atan2(4.0, 3.0);
    let along = |metres: f64, angle: f64| {
        let (x, y) = (1.0 + 0.6 * metres, 2.0 + 0.8 * metres);
        cast(slanted_wall(), x, y, angle)
    };
    assert_close(along(-10.0, angle), 10.0, 0.0);
    assert_close(along(12.0, angle - PI), 7.0, 0.0);
    assert_close(along(2.0, angle), 0.0, 0.0);
    assert_eq!(along(6.0, angle), None);
    assert_eq!(along(-1.0, angle - PI), None);
}

/// In the direction (0.6, 0.8) the circle of radius 2 lies 10 m ahead, and 1.2 m to the left or to
/// the right: half the chord is 1.6 m, 0.8 of the radius.
#[test]
fn a_slanted_ray_meets_a_circle_at_either_side_of_its_middle() {
    let angle = libm::atan2(4.0, 3.0);
    let circle = |ahead: f64, left: f64| {
        let (x, y) = (
            1.0 + 0.6 * ahead - 0.8 * left,
            5.0 + 0.8 * ahead + 0.6 * left,
        );
        Primitive::Circle(Circle {
            center: Point::new(x, y),
            radius: 2.0,
        })
    };
    for left in [1.2, -1.2] {
        assert_close(cast(circle(10.0, left), 1.0, 5.0, angle), 8.4, 0.8);
        // From inside, the far side.
        assert_close(cast(circle(0.5, left), 1.0, 5.0, angle), 2.1, 0.8);
        assert_eq!(cast(circle(-2.0, left), 1.0, 5.0, angle), None);
    }
    for left in [2.1, -2.1] {
        assert_eq!(cast(circle(10.0, left), 1.0, 5.0, angle), None);
    }
}

/// The pillar of radius 1 around (3, 0): its near side is 2 m from the origin, its far side 1.5 m
/// from (2.5, 0).
#[test]
fn a_circle_is_met_up_to_the_limit() {
    let met = |x: f64, limit: f64| {
        let found = pillar().cross(Ray::new(Point::new(x, 0.0), 0.0), limit);
        found.map(|found| found.distance)
    };
    assert_eq!([met(0.0, 1.99), met(0.0, 2.0)], [None, Some(2.0)]);
    assert_eq!([met(2.5, 1.49), met(2.5, 1.5)], [None, Some(1.5)]);
    // A nanometre behind the far side counts as touching it.
    assert_eq!(
        [met(4.0 + 0.5e-9, 9.0), met(4.0 + 2e-9, 9.0)],
        [Some(0.0), None]
    );
    // A start within a nanometre behind the near side meets that side, not the far one.
    assert_eq!(met(2.0 + 0.5e-9, 9.0), Some(0.0));
    assert!(met(2.0 + 2e-9, 9.0).is_some_and(|distance| distance > 1.9));
}

/// 2 m along the slanted wall and 3 m to its left; and 3, 4 and 5 from a circle's middle.
#[test]
fn the_nearest_point_of_a_slanted_surface_has_both_coordinates() {
    let is = |found: (Point, f64), x: f64, y: f64, away: f64| {
        assert!(found.0.distance(Point::new(x, y)) < 1e-12, "{found:?}");
        assert!((found.1 - away).abs() < 1e-12, "{found:?}");
    };
    is(slanted_wall().nearest(Point::new(-0.2, 5.4)), 2.2, 3.6, 3.0);
    // Beyond either end by 1 m.
    is(slanted_wall().nearest(Point::new(0.4, 1.2)), 1.0, 2.0, 1.0);
    is(slanted_wall().nearest(Point::new(4.6, 6.8)), 4.0, 6.0, 1.0);
    let circle = Primitive::Circle(Circle {
        center: Point::new(-2.0, 7.0),
        radius: 2.0,
    });
    is(circle.nearest(Point::new(1.0, 11.0)), -0.8, 8.6, 3.0);
    is(circle.nearest(Point::new(-2.6, 6.2)), -3.2, 5.4, 1.0);
}

/// The wall of 3, 4 and 5: it passes 0.7 m beside the middle of a square of which a side is 1 m if
/// it only touches it, as 0.5 (0.6 + 0.8) = 0.7.
#[test]
fn a_slanted_wall_enters_a_square_up_to_its_corner() {
    let beside = |metres: f64| {
        let middle = Point::new(2.5 - 0.8 * metres, 4.0 + 0.6 * metres);
        slanted_wall().enters(middle, 0.5)
    };
    assert_eq!(
        [0.69, 0.71, -0.69, -0.71].map(beside),
        [true, false, true, false]
    );
    // Squares whose edge lies on that of the wall's bounds are entered.
    let enters = |x: f64, y: f64| wall().enters(Point::new(x, y), 0.5);
    assert!(enters(1.5, 0.0) && enters(0.5, 0.0) && enters(1.0, 1.5) && enters(1.0, -1.5));
}
