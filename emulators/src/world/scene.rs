//! Everything solid that the robot did not bring along: walls, furniture, people.

mod error;

use std::sync::Arc;

use protocols::Instant;

use super::geometry::{Bounds, Circle, Crossing, Point, Primitive, Ray, Segment};
use super::grid::Grid;
use super::path::{Path, Repeat};
pub use error::{Cause, Part, SceneError};

/// Coordinates beyond this are taken for a mistake (a floor plan in millimetres, say).
const COORDINATE_MAX_M: f64 = 1_000.0;
/// Walls and circles in one scene; a building of 100 m x 100 m at 5 cm needs some ten thousand.
const PRIMITIVES_MAX: usize = 200_000;
/// Faster obstacles are taken for a mistake, and would pass through the robot between two steps.
const OBSTACLE_SPEED_MAX_M_S: f64 = 20.0;

/// The outline of something solid, metres.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A straight wall without thickness.
    Wall {
        /// One end.
        from: Point,
        /// The other end.
        to: Point,
    },
    /// A closed outline: a room or a piece of furniture. The last corner joins the first.
    Polygon {
        /// The corners in order, at least three.
        corners: Vec<Point>,
    },
    /// A pillar, or the leg of a chair.
    Circle {
        /// The middle.
        center: Point,
        /// Metres.
        radius_m: f64,
    },
}

/// A shape and what its surface does to light.
#[derive(Clone, Debug, PartialEq)]
pub struct Fixture {
    /// Outline.
    pub shape: Shape,
    /// Light returned compared with the white wall a lidar is specified for (1.0); a black
    /// sofa has about 0.1.
    pub reflectivity: f64,
}

impl From<Shape> for Fixture {
    /// A white surface.
    fn from(shape: Shape) -> Self {
        Self {
            shape,
            reflectivity: 1.0,
        }
    }
}

/// A fixture that moves: its shape is drawn around its own origin, which follows the path.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// Outline, relative to the place on the path, and surface.
    pub fixture: Fixture,
    /// Where it is when.
    pub path: Path,
}

/// What a ray met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Metres from the origin of the ray.
    pub distance: f64,
    /// Cosine of the angle between ray and surface normal: 1 head on, 0 grazing.
    pub incidence: f64,
    /// Of the surface, see [`Fixture::reflectivity`].
    pub reflectivity: f64,
}

/// All fixtures and obstacles, checked and indexed for ray casts. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Scene {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    fixtures: Vec<Fixture>,
    obstacles: Vec<Obstacle>,
    bounds: Bounds,
    fixed: Body,
    grid: Grid,
    moving: Vec<MovingBody>,
}

/// Primitives with the reflectivity of each.
#[derive(Debug, Default)]
struct Body {
    primitives: Vec<Primitive>,
    reflectivity: Vec<f64>,
}

#[derive(Debug)]
struct MovingBody {
    body: Body,
    /// Distance from its origin within which all of it lies.
    reach: f64,
}

impl Scene {
    /// A scene without outer limit; its bounds are those of what is in it.
    pub fn new<F: Into<Fixture>>(
        fixtures: impl IntoIterator<Item = F>,
        obstacles: Vec<Obstacle>,
    ) -> Result<Self, SceneError> {
        let reach = Bounds::around(Point::default(), COORDINATE_MAX_M);
        Self::build(
            reach,
            fixtures.into_iter().map(Into::into).collect(),
            obstacles,
        )
    }

    /// A scene in which everything must lie within `bounds`.
    pub fn within<F: Into<Fixture>>(
        bounds: Bounds,
        fixtures: impl IntoIterator<Item = F>,
        obstacles: Vec<Obstacle>,
    ) -> Result<Self, SceneError> {
        Self::build(
            bounds,
            fixtures.into_iter().map(Into::into).collect(),
            obstacles,
        )
    }

    /// The fixtures as given.
    pub fn fixtures(&self) -> &[Fixture] {
        &self.inner.fixtures
    }

    /// The obstacles as given.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.inner.obstacles
    }

    /// The least rectangle around all fixtures; a point at the origin if there is none.
    pub fn bounds(&self) -> Bounds {
        self.inner.bounds
    }

    /// What a ray meets first at time `at`, up to `max_range` metres away.
    pub fn cast_ray(&self, at: Instant, from: Point, angle: f64, max_range: f64) -> Option<Hit> {
        let ray = Ray::new(from, angle);
        let inner = &*self.inner;
        let fixed = inner.grid.cross(&inner.fixed.primitives, ray, max_range);
        let mut limit = max_range;
        let mut hit = fixed.map(|(index, crossing)| {
            limit = crossing.distance;
            Hit::new(crossing, inner.fixed.reflectivity[index])
        });
        for (obstacle, moving) in inner.obstacles.iter().zip(&inner.moving) {
            let ray = ray.seen_from(obstacle.path.position(at));
            if !ray.passes_origin(moving.reach) {
                continue;
            }
            for (primitive, &reflectivity) in
                moving.body.primitives.iter().zip(&moving.body.reflectivity)
            {
                if let Some(crossing) = primitive.cross(ray, limit).filter(|c| c.distance < limit) {
                    limit = crossing.distance;
                    hit = Some(Hit::new(crossing, reflectivity));
                }
            }
        }
        hit
    }

    /// The fixture surface nearest to `point`, if any is within `reach`: its place and distance.
    pub(super) fn nearest_fixed(&self, point: Point, reach: f64) -> Option<Near> {
        let mut best: Option<Near> = None;
        self.each_fixed_near(point, reach, |near| {
            if best.is_none_or(|b| near.distance < b.distance) {
                best = Some(near);
            }
        });
        best
    }

    /// Calls `visit` for each fixture surface within `reach` of `point`; possibly repeatedly.
    pub(super) fn each_fixed_near(&self, point: Point, reach: f64, mut visit: impl FnMut(Near)) {
        let inner = &*self.inner;
        inner.grid.each_near(point, reach, |index| {
            let near = Near::of(index, &inner.fixed.primitives[index], point);
            if near.distance <= reach {
                visit(near);
            }
        });
    }

    /// The nearest point of one fixture surface.
    pub(super) fn fixed(&self, index: usize, point: Point) -> Near {
        Near::of(index, &self.inner.fixed.primitives[index], point)
    }

    /// Calls `visit` for each obstacle surface, as placed at time `at`. Indices go on behind those
    /// of the fixtures.
    pub(super) fn each_moving(&self, at: Instant, point: Point, mut visit: impl FnMut(Near)) {
        let mut index = self.inner.fixed.primitives.len();
        for (obstacle, moving) in self.inner.obstacles.iter().zip(&self.inner.moving) {
            let place = obstacle.path.position(at);
            let seen = Point::new(point.x - place.x, point.y - place.y);
            for primitive in &moving.body.primitives {
                let mut near = Near::of(index, primitive, seen);
                near.at = Point::new(near.at.x + place.x, near.at.y + place.y);
                visit(near);
                index += 1;
            }
        }
    }

    /// No obstacle is ever faster than this, m/s.
    pub(super) fn obstacle_speed_m_s(&self) -> f64 {
        self.inner
            .obstacles
            .iter()
            .map(|o| o.path.top_speed_m_s())
            .fold(0.0, f64::max)
    }

    fn build(
        limits: Bounds,
        fixtures: Vec<Fixture>,
        obstacles: Vec<Obstacle>,
    ) -> Result<Self, SceneError> {
        let mut fixed = Body::default();
        for (index, fixture) in fixtures.iter().enumerate() {
            let own = fixed.add(fixture).map_err(|cause| SceneError {
                part: Part::Fixture(index),
                cause,
            })?;
            let outside = !limits.contains(own);
            if outside {
                let cause = Cause::OutOfBounds {
                    found: own,
                    bounds: limits,
                };
                return Err(SceneError {
                    part: Part::Fixture(index),
                    cause,
                });
            }
        }
        let mut moving = Vec::new();
        for (index, obstacle) in obstacles.iter().enumerate() {
            moving.push(
                check_obstacle(obstacle, limits).map_err(|cause| SceneError {
                    part: Part::Obstacle(index),
                    cause,
                })?,
            );
        }
        let bounds = fixed
            .primitives
            .iter()
            .map(Primitive::bounds)
            .reduce(Bounds::union)
            .unwrap_or(Bounds::around(Point::default(), 0.0));
        let grid = Grid::new(&fixed.primitives, bounds);
        Ok(Self {
            inner: Arc::new(Inner {
                fixtures,
                obstacles,
                bounds,
                fixed,
                grid,
                moving,
            }),
        })
    }
}

impl Hit {
    fn new(crossing: Crossing, reflectivity: f64) -> Self {
        Self {
            distance: crossing.distance,
            incidence: crossing.incidence,
            reflectivity,
        }
    }
}

/// A surface near the robot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near {
    /// Which primitive of the scene.
    pub(super) index: usize,
    /// Its nearest point.
    pub(super) at: Point,
    /// How far that is.
    pub(super) distance: f64,
}

impl Near {
    fn of(index: usize, primitive: &Primitive, point: Point) -> Self {
        let (at, distance) = primitive.nearest(point);
        Self {
            index,
            at,
            distance,
        }
    }
}

impl Body {
    /// Takes the surfaces of one fixture; returns the rectangle around them.
    fn add(&mut self, fixture: &Fixture) -> Result<Bounds, Cause> {
        let reflectivity = fixture.reflectivity;
        if !(0.0..=100.0).contains(&reflectivity) {
            return Err(Cause::Reflectivity {
                found: reflectivity,
            });
        }
        let before = self.primitives.len();
        match &fixture.shape {
            Shape::Wall { from, to } => self.primitives.push(wall(*from, *to)?),
            Shape::Polygon { corners } => {
                if corners.len() < 3 {
                    return Err(Cause::TooFewCorners {
                        found: corners.len(),
                    });
                }
                for (index, &from) in corners.iter().enumerate() {
                    self.primitives
                        .push(wall(from, corners[(index + 1) % corners.len()])?);
                }
            }
            Shape::Circle { center, radius_m } => self.primitives.push(circle(*center, *radius_m)?),
        }
        if self.primitives.len() > PRIMITIVES_MAX {
            return Err(Cause::TooMany {
                limit: PRIMITIVES_MAX,
            });
        }
        self.reflectivity
            .resize(self.primitives.len(), reflectivity);
        let own = self.primitives[before..]
            .iter()
            .map(Primitive::bounds)
            .reduce(Bounds::union);
        Ok(own.expect("each shape adds at least one primitive"))
    }
}

fn wall(from: Point, to: Point) -> Result<Primitive, Cause> {
    if !from.is_finite() || !to.is_finite() {
        return Err(Cause::NotFinite);
    }
    Segment::new(from, to)
        .map(Primitive::Segment)
        .ok_or(Cause::TooShort {
            length_m: from.distance(to),
        })
}

fn circle(center: Point, radius: f64) -> Result<Primitive, Cause> {
    if !center.is_finite() || !radius.is_finite() {
        return Err(Cause::NotFinite);
    }
    if radius < 1e-6 {
        return Err(Cause::Radius { found: radius });
    }
    Ok(Primitive::Circle(Circle { center, radius }))
}

fn check_obstacle(obstacle: &Obstacle, limits: Bounds) -> Result<MovingBody, Cause> {
    let mut body = Body::default();
    let own = body.add(&obstacle.fixture)?;
    let path = &obstacle.path;
    let (Some(first), Some(last)) = (path.waypoints.first(), path.waypoints.last()) else {
        return Err(Cause::NoWaypoints);
    };
    for waypoint in &path.waypoints {
        let Point { x, y } = waypoint.position;
        if !waypoint.position.is_finite() {
            return Err(Cause::NotFinite);
        }
        let found = Bounds {
            min: Point::new(own.min.x + x, own.min.y + y),
            max: Point::new(own.max.x + x, own.max.y + y),
        };
        if !limits.contains(found) {
            return Err(Cause::OutOfBounds {
                found,
                bounds: limits,
            });
        }
    }
    if let Some(index) = path
        .waypoints
        .windows(2)
        .position(|pair| pair[1].at <= pair[0].at)
    {
        return Err(Cause::TimesNotRising {
            waypoint: index + 1,
        });
    }
    if path.repeat == Repeat::Loop && first.position != last.position {
        return Err(Cause::OpenLoop);
    }
    let found_m_s = path.top_speed_m_s();
    if found_m_s > OBSTACLE_SPEED_MAX_M_S {
        return Err(Cause::TooFast {
            found_m_s,
            limit_m_s: OBSTACLE_SPEED_MAX_M_S,
        });
    }
    let corner = |x: f64, y: f64| Point::default().distance(Point::new(x, y));
    let reach = corner(
        own.min.x.abs().max(own.max.x.abs()),
        own.min.y.abs().max(own.max.y.abs()),
    );
    Ok(MovingBody {
        body,
        reach: reach + 1e-6,
    })
}

#[cfg(test)]
mod tests {
    use super::super::path::Waypoint;
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

    /// Walks from (2, 0) to (2, 4) within 4 s.
    fn walker(shape: Shape) -> Obstacle {
        let waypoint = |secs, y| Waypoint {
            at: Instant::from_secs(secs),
            position: Point::new(2.0, y),
        };
        Obstacle {
            fixture: Fixture {
                shape,
                reflectivity: 0.4,
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

    /// All directions to the corners, and between them, of a room with the lidar in the middle.
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
}
