use super::super::path::{Repeat, Waypoint};
use super::*;
use core::f64::consts::{FRAC_PI_2, PI};

fn wall(x0: f64, y0: f64, x1: f64, y1: f64) -> Shape {
    Shape::Wall {
        from: Point::new(x0, y0),
        to: Point::new(x1, y1),
    }
}

fn polygon(corners: &[(f64, f64)]) -> Shape {
    Shape::Polygon {
        corners: corners.iter().map(|&(x, y)| Point::new(x, y)).collect(),
    }
}

fn circle(x: f64, y: f64, radius_m: f64) -> Shape {
    Shape::Circle {
        center: Point::new(x, y),
        radius_m,
    }
}

/// An obstacle that walks from (2, 0) to (2, 4) within 4 s.
fn walker(shape: Shape) -> Obstacle {
    let waypoint = |secs, y| Waypoint {
        at: Instant::from_secs(secs),
        position: Point::new(2.0, y),
    };
    Obstacle {
        fixture: Fixture {
            shape,
            reflectivity: 0.4,
            height_m: f64::INFINITY,
            is_glass: false,
        },
        path: Path {
            waypoints: vec![waypoint(0, 0.0), waypoint(4, 4.0)],
            repeat: Repeat::Once,
        },
    }
}

fn fault(fixtures: Vec<Shape>, obstacles: Vec<Obstacle>) -> (Part, Cause) {
    let error = Scene::new(fixtures, obstacles).expect_err("the scene is faulty");
    (error.part, error.cause)
}

fn distance(scene: &Scene, millis: u64, angle: f64) -> Option<f64> {
    let at = Instant::from_millis(millis);
    scene
        .cast_ray(at, Point::default(), angle, 10.0)
        .map(|hit| hit.distance)
}

#[test]
fn a_polygon_is_closed_and_seen_from_inside_and_outside() {
    let square = polygon(&[(1.0, -1.0), (3.0, -1.0), (3.0, 1.0), (1.0, 1.0)]);
    let scene = Scene::new([square], vec![]).unwrap();
    assert_eq!(distance(&scene, 0, 0.0), Some(1.0));
    let inside = scene
        .cast_ray(Instant::ZERO, Point::new(2.0, 0.0), FRAC_PI_2, 10.0)
        .unwrap();
    assert!((inside.distance - 1.0).abs() < 1e-15);
    let bounds = Bounds {
        min: Point::new(1.0, -1.0),
        max: Point::new(3.0, 1.0),
    };
    assert_eq!(scene.bounds(), bounds);
}

/// Rays in all directions to the corners of a room, and between them, from a lidar in the middle.
#[test]
fn no_ray_leaves_a_closed_room() {
    let room = polygon(&[(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]);
    let scene = Scene::new([room], vec![]).unwrap();
    let lost: Vec<i32> = (0..72_000)
        .filter(|&n| distance(&scene, 0, f64::from(n) * PI / 36_000.0).is_none())
        .collect();
    assert_eq!(lost, Vec::<i32>::new());
}

#[test]
fn the_hit_carries_the_reflectivity_of_what_was_hit() {
    let black = Fixture {
        shape: wall(1.0, -1.0, 1.0, 1.0),
        reflectivity: 0.1,
        height_m: f64::INFINITY,
        is_glass: false,
    };
    let scene = Scene::new([black, wall(2.0, -1.0, 2.0, 1.0).into()], vec![]).unwrap();
    let hit = scene
        .cast_ray(Instant::ZERO, Point::default(), 0.0, 10.0)
        .unwrap();
    assert_eq!(
        hit,
        Hit {
            distance: 1.0,
            incidence: 1.0,
            reflectivity: 0.1
        }
    );
}

/// The walker's circle (radius 0.5) passes x = 2; a wall stands behind it at x = 3.
#[test]
fn an_obstacle_hides_the_wall_only_while_it_is_there() {
    let scene = Scene::new(
        [wall(3.0, -9.0, 3.0, 9.0)],
        vec![walker(circle(0.0, 0.0, 0.5))],
    )
    .unwrap();
    assert_eq!(distance(&scene, 0, 0.0), Some(1.5));
    assert_eq!(distance(&scene, 300, 0.0), Some(2.0 - 0.4));
    assert_eq!(distance(&scene, 600, 0.0), Some(3.0));
}

#[test]
fn a_scene_keeps_what_it_was_given() {
    let walls = [wall(3.0, -9.0, 3.0, 9.0), circle(1.0, 1.0, 0.5)];
    let scene = Scene::new(walls.clone(), vec![walker(circle(0.0, 0.0, 0.5))]).unwrap();
    let shapes: Vec<Shape> = scene
        .fixtures()
        .iter()
        .map(|one| one.shape.clone())
        .collect();
    assert_eq!(shapes, walls);
    assert_eq!(scene.obstacles().len(), 1);
    assert_eq!(scene.obstacles()[0].fixture.shape, circle(0.0, 0.0, 0.5));
}

/// The two walls are 0 and 1; the moving triangle's sides 2, 3 and 4, and a pillar after it 5.
#[test]
fn surfaces_that_move_are_numbered_behind_those_that_stay() {
    let walls = [wall(3.0, -9.0, 3.0, 9.0), wall(-3.0, -9.0, -3.0, 9.0)];
    let triangle = polygon(&[(0.0, 0.0), (0.5, 0.0), (0.0, 0.5)]);
    let moving = vec![walker(triangle), walker(circle(0.0, 0.0, 0.5))];
    let scene = Scene::new(walls, moving).unwrap();
    let mut numbers = Vec::new();
    scene.each_moving_shape([Instant::ZERO; 2], |number, _| numbers.push(number));
    assert_eq!(numbers, [2, 3, 4, 5]);
}

/// A search from any distance beyond the walls, on any side, finds the surfaces in reach.
#[test]
fn what_is_near_is_found_from_beyond_the_scene_too() {
    let room = polygon(&[(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)]);
    let scene = Scene::new([room], vec![]).unwrap();
    let far = |x, y| {
        let near = scene.nearest_fixed(Point::new(x, y), 20.0);
        near.map(|near| near.distance)
    };
    assert_eq!(far(2.0, 1.0), Some(1.0));
    let beyond = [(-7.0, 1.0), (11.0, 1.0), (2.0, -7.0), (2.0, 10.0)];
    assert_eq!(beyond.map(|(x, y)| far(x, y)), [Some(7.0); 4]);
    let corners = [(-3.0, -4.0), (7.0, -4.0), (-3.0, 7.0), (7.0, 7.0)];
    assert_eq!(corners.map(|(x, y)| far(x, y)), [Some(5.0); 4]);
    assert!(scene.nearest_fixed(Point::new(2.0, 10.0), 6.0).is_none());
}

#[test]
fn a_wall_in_front_of_an_obstacle_hides_it() {
    let scene = Scene::new(
        [wall(1.0, -9.0, 1.0, 9.0)],
        vec![walker(circle(0.0, 0.0, 0.5))],
    )
    .unwrap();
    assert_eq!(distance(&scene, 0, 0.0), Some(1.0));
}

#[test]
fn a_moving_polygon_is_met_at_its_side() {
    let square = polygon(&[(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]);
    let scene = Scene::new::<Shape>([], vec![walker(square)]).unwrap();
    let hit = scene
        .cast_ray(Instant::ZERO, Point::default(), 0.0, 10.0)
        .unwrap();
    assert_eq!(
        hit,
        Hit {
            distance: 1.5,
            incidence: 1.0,
            reflectivity: 0.4
        }
    );
    assert_eq!(distance(&scene, 1_000, 0.0), None);
}

#[test]
fn an_empty_scene_is_open_floor() {
    let scene = Scene::new::<Shape>([], vec![]).unwrap();
    assert_eq!(distance(&scene, 0, 0.0), None);
}

#[test]
fn coordinates_that_are_no_number_are_refused() {
    let nan = wall(0.0, f64::NAN, 1.0, 1.0);
    assert_eq!(
        fault(vec![circle(0.0, 0.0, 1.0), nan], vec![]).0,
        Part::Fixture(1)
    );
    let infinite = circle(0.0, 0.0, f64::INFINITY);
    assert_eq!(
        fault(vec![infinite], vec![]),
        (Part::Fixture(0), Cause::NotFinite)
    );
}

/// Lengths whose square overflows lose all values derived from it.
#[test]
fn walls_beyond_the_numbers_are_refused() {
    for far in [1e308, -1e200, 1e160, 1e150, 1e4] {
        for shape in [
            wall(0.0, 0.0, 2.0, far),
            polygon(&[(0.0, 0.0), (1.0, 0.0), (far, 1.0)]),
            circle(far, 0.0, 1.0),
            circle(0.0, 0.0, far.abs()),
        ] {
            let (_, cause) = fault(vec![shape], vec![]);
            assert!(matches!(cause, Cause::OutOfBounds { .. }), "{far}: {cause}");
        }
    }
}

#[test]
fn walls_without_length_are_refused() {
    let dot = wall(1.0, 1.0, 1.0, 1.0);
    assert_eq!(
        fault(vec![dot], vec![]).1,
        Cause::TooShort { length_m: 0.0 }
    );
    let twice = polygon(&[(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0)]);
    assert_eq!(
        fault(vec![twice], vec![]).1,
        Cause::TooShort { length_m: 0.0 }
    );
}

#[test]
fn polygons_of_two_corners_and_circles_without_radius_are_refused() {
    let line = polygon(&[(0.0, 0.0), (1.0, 0.0)]);
    assert_eq!(
        fault(vec![line], vec![]).1,
        Cause::TooFewCorners { found: 2 }
    );
    assert_eq!(
        fault(vec![circle(0.0, 0.0, -1.0)], vec![]).1,
        Cause::Radius { found: -1.0 }
    );
}

#[test]
fn a_wall_outside_is_refused_with_its_place() {
    let bounds = Bounds {
        min: Point::new(0.0, 0.0),
        max: Point::new(3.0, 3.0),
    };
    let error = Scene::within(bounds, [wall(1.0, 1.0, 1.0, 3.5)], vec![]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "fixture 0: it reaches from (1, 1) to (1, 3.5) m; expected within (0, 0) to (3, 3) m"
    );
}

#[test]
fn a_plan_in_millimetres_is_refused() {
    let cause = fault(vec![wall(0.0, 0.0, 3_000.0, 0.0)], vec![]).1;
    assert!(matches!(cause, Cause::OutOfBounds { .. }), "{cause}");
}

#[test]
fn negative_reflectivity_is_refused() {
    let fixture = Fixture {
        shape: circle(0.0, 0.0, 1.0),
        reflectivity: -0.1,
        height_m: f64::INFINITY,
        is_glass: false,
    };
    let error = Scene::new([fixture], vec![]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "fixture 0: a reflectivity of -0.1; expected 0 to 100"
    );
}

#[test]
fn paths_that_cannot_be_walked_are_refused() {
    let good = walker(circle(0.0, 0.0, 0.5));
    let mut nowhere = good.clone();
    nowhere.path.waypoints.clear();
    assert_eq!(
        fault(vec![], vec![nowhere]),
        (Part::Obstacle(0), Cause::NoWaypoints)
    );
    let mut timeless = good.clone();
    timeless.path.waypoints[1].at = Instant::ZERO;
    let cause = fault(vec![], vec![good.clone(), timeless]);
    assert_eq!(
        cause,
        (Part::Obstacle(1), Cause::TimesNotRising { waypoint: 1 })
    );
    let mut open = good.clone();
    open.path.repeat = Repeat::Loop;
    assert_eq!(fault(vec![], vec![open]).1, Cause::OpenLoop);
    let mut fast = good;
    fast.path.waypoints[1].at = Instant::from_millis(100);
    let limit = Cause::TooFast {
        found_m_s: 40.0,
        limit_m_s: 20.0,
    };
    assert_eq!(fault(vec![], vec![fast]).1, limit);
}

/// A pillar of 0.1 m keeps within the bounds with its whole width along its path, on each side.
#[test]
fn an_obstacle_keeps_within_the_bounds_with_all_of_it() {
    let bounds = Bounds {
        min: Point::new(-2.0, -3.0),
        max: Point::new(4.0, 5.0),
    };
    let is_within = |x: f64, y: f64| {
        let obstacle = Obstacle {
            path: Path {
                waypoints: vec![Waypoint {
                    at: Instant::ZERO,
                    position: Point::new(x, y),
                }],
                repeat: Repeat::Once,
            },
            ..walker(circle(0.0, 0.0, 0.1))
        };
        Scene::within(bounds, Vec::<Shape>::new(), vec![obstacle]).is_ok()
    };
    let inside = [(-1.85, 1.0), (3.85, 1.0), (1.0, -2.85), (1.0, 4.85)];
    assert_eq!(inside.map(|(x, y)| is_within(x, y)), [true; 4]);
    let outside = [(-1.95, 1.0), (3.95, 1.0), (1.0, -2.95), (1.0, 4.95)];
    assert_eq!(outside.map(|(x, y)| is_within(x, y)), [false; 4]);
}

/// Each triangle has three walls: of 200,000 at most 66,666 fit.
#[test]
fn a_scene_has_two_hundred_thousand_walls_at_most() {
    let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)].map(|(x, y)| Point::new(x, y));
    let triangle = Shape::Polygon {
        corners: corners.to_vec(),
    };
    let error = Scene::new(vec![triangle; 66_667], vec![]).expect_err("too many");
    assert!(
        matches!(error.cause, Cause::TooMany { limit: 200_000 }),
        "{error}"
    );
}

/// Of two surfaces at the same distance the fixture is met, and of two obstacles the first.
#[test]
fn of_two_surfaces_in_one_place_the_first_is_met() {
    let met = |fixtures: Vec<Shape>, second: f64| {
        let mut dark = walker(circle(0.0, 0.0, 0.5));
        dark.fixture.reflectivity = second;
        let scene = Scene::new(fixtures, vec![walker(circle(0.0, 0.0, 0.5)), dark]).unwrap();
        let hit = scene.cast_ray(Instant::ZERO, Point::default(), 0.0, 10.0);
        hit.unwrap().reflectivity
    };
    assert_eq!(met(Vec::new(), 0.1), 0.4);
    let fixed = met(vec![circle(2.0, 0.0, 0.5)], 0.1);
    assert_eq!(fixed, Fixture::from(circle(2.0, 0.0, 0.5)).reflectivity);
    assert_ne!(fixed, 0.4);
}

/// Each coordinate of either end, and the radius of a pillar.
#[test]
fn a_wall_with_one_end_nowhere_is_refused() {
    for nowhere in [f64::NAN, f64::INFINITY] {
        for shape in [
            wall(nowhere, 0.0, 1.0, 1.0),
            wall(0.0, nowhere, 1.0, 1.0),
            wall(0.0, 0.0, nowhere, 1.0),
            wall(0.0, 0.0, 1.0, nowhere),
            circle(nowhere, 0.0, 1.0),
            circle(0.0, 0.0, nowhere),
        ] {
            let (part, cause) = fault(vec![shape], vec![]);
            assert_eq!((part, cause), (Part::Fixture(0), Cause::NotFinite));
        }
    }
}
