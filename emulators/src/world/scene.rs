//! Everything solid that the robot did not bring along: walls, furniture, people.

mod cast;
mod error;
mod floor;
mod heat;
mod moving;
mod row;
mod slick;
mod track;
mod view;

use std::sync::Arc;

use protocols::Instant;

use super::body::Footprint;
use super::geometry::{Bounds, Circle, Crossing, Point, Pose, Primitive, Segment};
use super::grid::Grid;
use super::path::Path;
use super::sectors::Places;
pub use error::{Cause, Part, SceneError};
pub use floor::{FloorLine, FloorLineError};
pub use heat::{AMBIENT_C, HeatPlate, HeatPlateError};
use moving::MovingBody;
pub use row::Row;
pub use slick::{SlickFloor, SlickFloorError};
pub(super) use track::Track;
pub use view::Cone;

/// Coordinates beyond this are taken for a mistake (a floor plan in millimetres, say).
const COORDINATE_MAX_M: f64 = 1_000.0;
/// Walls and circles in one scene; a building of 100 m x 100 m at 5 cm needs some ten thousand.
pub const PRIMITIVES_MAX: usize = 200_000;
/// Faster obstacles are taken for a mistake, and would pass through the robot between two steps.
const OBSTACLE_SPEED_MAX_M_S: f64 = 20.0;

/// The outline of something solid, metres.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A straight wall without thickness.
    Wall {
        /// First end.
        from: Point,
        /// Second end.
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

/// A shape and the optical properties of its surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Fixture {
    /// Outline.
    pub shape: Shape,
    /// Light returned compared with the white wall a lidar is specified for (1.0); a black
    /// sofa has about 0.1.
    pub reflectivity: f64,
    /// Height above the floor, metres. A sensor at this height or higher looks over it, see
    /// [`Scene::slice`]. The robot's body collides with it all the same.
    pub height_m: f64,
    /// A pane of glass: the beam of a lidar goes through it, see [`Scene::for_lidar`]. Infrared
    /// sensors, cameras and the body meet it.
    pub is_glass: bool,
}

impl From<Shape> for Fixture {
    /// A white surface, up to the ceiling.
    fn from(shape: Shape) -> Self {
        Self {
            shape,
            reflectivity: 1.0,
            height_m: f64::INFINITY,
            is_glass: false,
        }
    }
}

/// A fixture that moves: its shape is drawn around its own origin, which follows the path.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// Outline, relative to the place on the path, and surface.
    pub fixture: Fixture,
    /// Its position over time.
    pub path: Path,
}

/// Result of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Metres from the origin of the ray.
    pub distance: f64,
    /// Cosine of the angle between ray and surface normal: 1 head on, 0 grazing.
    pub incidence: f64,
    /// Reflectivity of the surface, see [`Fixture::reflectivity`].
    pub reflectivity: f64,
}

/// All fixtures and obstacles, checked and indexed for ray casts. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Scene {
    inner: Arc<Inner>,
    floor: Arc<[FloorLine]>,
    heat: Arc<[HeatPlate]>,
    slick: Arc<[SlickFloor]>,
}

#[derive(Debug)]
struct Inner {
    fixtures: Vec<Fixture>,
    obstacles: Vec<Obstacle>,
    bounds: Bounds,
    fixed: Body,
    grid: Grid,
    /// Shared by scenes with the same fixtures.
    places: Arc<Places>,
    moving: Vec<MovingBody>,
}

/// Primitives with the reflectivity of each.
#[derive(Clone, Debug, Default)]
struct Body {
    primitives: Vec<Primitive>,
    reflectivity: Vec<f64>,
}

impl Scene {
    /// A scene without outer limit; its bounds are those of its content.
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

    /// Calls `visit` for each obstacle surface, as placed at time `at`. Indices continue behind
    /// those of the fixtures.
    pub(super) fn each_moving(&self, at: Instant, point: Point, mut visit: impl FnMut(Near)) {
        let mut index = self.inner.fixed.primitives.len();
        for moving in &self.inner.moving {
            let placed = moving.placed(at);
            let place = placed.origin;
            let seen = Point::new(point.x - place.x, point.y - place.y);
            for (primitive, _) in placed.surfaces() {
                let mut near = Near::of(index, &primitive, seen);
                near.at = Point::new(near.at.x + place.x, near.at.y + place.y);
                visit(near);
                index += 1;
            }
        }
    }

    /// Calls `visit` with number and shape of each fixture surface that may be within `reach` of
    /// `point`; possibly repeatedly.
    pub(super) fn each_fixed_shape(
        &self,
        point: Point,
        reach: f64,
        mut visit: impl FnMut(usize, Primitive),
    ) {
        let inner = &*self.inner;
        inner.grid.each_near(point, reach, |index| {
            visit(index, inner.fixed.primitives[index]);
        });
    }

    /// Calls `visit` with the number of each obstacle surface, and with its shape and its origin at
    /// two times. The shape is seen from the origin; numbers continue behind those of the fixtures.
    pub(super) fn each_moving_shape(
        &self,
        times: [Instant; 2],
        mut visit: impl FnMut(usize, [(Primitive, Point); 2]),
    ) {
        let mut index = self.inner.fixed.primitives.len();
        for moving in &self.inner.moving {
            let [first, then] = times.map(|at| moving.placed(at));
            for ((one, _), (other, _)) in first.surfaces().zip(then.surfaces()) {
                visit(index, [(one, first.origin), (other, then.origin)]);
                index += 1;
            }
        }
    }

    /// This scene and other robots, each at its start.
    pub(super) fn with_robots(&self, robots: &[(Footprint, Pose)]) -> Self {
        let robots = robots
            .iter()
            .map(|(body, start)| MovingBody::robot(body, *start));
        self.with_moving(self.inner.moving.iter().cloned().chain(robots).collect())
    }

    /// The same scene, in which the other robots move independently of this one.
    pub(super) fn separated(&self) -> Self {
        let moving = self.inner.moving.iter().map(MovingBody::separated);
        self.with_moving(moving.collect())
    }

    fn with_moving(&self, moving: Vec<MovingBody>) -> Self {
        let inner = &*self.inner;
        Self {
            inner: Arc::new(Inner {
                fixtures: inner.fixtures.clone(),
                obstacles: inner.obstacles.clone(),
                bounds: inner.bounds,
                fixed: inner.fixed.clone(),
                grid: inner.grid.clone(),
                places: Arc::clone(&inner.places),
                moving,
            }),
            ..self.clone()
        }
    }

    /// The other robots.
    pub(super) fn robots(&self) -> impl Iterator<Item = &Track> {
        self.inner.moving.iter().filter_map(MovingBody::track)
    }

    /// Outlines of the other robots at the time `at`.
    pub(super) fn robot_outlines(&self, at: Instant) -> Vec<Shape> {
        let robots = self.inner.moving.iter().filter(|it| it.track().is_some());
        robots.map(|robot| robot.placed(at).outline()).collect()
    }

    /// Whether there is anything that may move.
    pub(super) fn has_moving(&self) -> bool {
        !self.inner.moving.is_empty()
    }

    /// Maximum speed of all obstacles, m/s.
    pub(super) fn obstacle_speed_m_s(&self) -> f64 {
        let speeds = self.inner.moving.iter().map(MovingBody::top_speed_m_s);
        speeds.fold(0.0, f64::max)
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
                MovingBody::of(obstacle, limits).map_err(|cause| SceneError {
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
        let places = Arc::new(Places::new(&fixed.primitives, bounds));
        Ok(Self {
            floor: Arc::new([]),
            heat: Arc::new([]),
            slick: Arc::new([]),
            inner: Arc::new(Inner {
                fixtures,
                obstacles,
                bounds,
                fixed,
                grid,
                places,
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
    /// Index of the primitive in the scene.
    pub(super) index: usize,
    /// Its nearest point.
    pub(super) at: Point,
    /// Its distance.
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
        let height_m = fixture.height_m;
        if height_m.is_nan() || height_m <= 0.0 {
            return Err(Cause::Height { found: height_m });
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
    // The square of such a length is beyond the numbers, as are all values derived from it.
    if !from.distance(to).is_finite() {
        return Err(Cause::OutOfBounds {
            found: Bounds::around(from, 0.0).union(Bounds::around(to, 0.0)),
            bounds: Bounds::around(Point::default(), COORDINATE_MAX_M),
        });
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

#[cfg(test)]
mod tests;
