//! Bodies that move: obstacles on their paths, and other robots.

use protocols::Instant;

use super::track::Track;
use super::{Body, Cause, OBSTACLE_SPEED_MAX_M_S, Obstacle, Shape};
use crate::world::body::{Footprint, Outline};
use crate::world::geometry::{Bounds, Point, Pose, Primitive};
use crate::world::path::{Path, Repeat};

/// Surfaces that move together.
#[derive(Clone, Debug)]
pub(super) struct MovingBody {
    body: Body,
    /// Radius of the circle around its origin that contains the obstacle.
    reach: f64,
    course: Course,
}

/// Motion of a body over time.
#[derive(Clone, Debug)]
enum Course {
    /// Along a path, without turning.
    Path(Path),
    /// As another robot moves.
    Track(Track),
}

/// A moving body at one time.
pub(super) struct Placed<'a> {
    body: &'a Body,
    /// Its origin.
    pub(super) origin: Point,
    /// Heading of its axes, radians.
    heading: f64,
}

impl MovingBody {
    /// The body of an obstacle.
    pub(super) fn of(obstacle: &Obstacle, limits: Bounds) -> Result<Self, Cause> {
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
        Ok(Self {
            body,
            reach: reach + 1e-6,
            course: Course::Path(path.clone()),
        })
    }

    /// The body of another robot that stands at `start`; white, up to the ceiling.
    pub(super) fn robot(footprint: &Footprint, start: Pose) -> Self {
        let shape = match footprint.outline() {
            Outline::Circle { radius_m } => Shape::Circle {
                center: Point::default(),
                radius_m,
            },
            Outline::Polygon(corners) => Shape::Polygon {
                corners: corners.to_vec(),
            },
        };
        let mut body = Body::default();
        body.add(&shape.into())
            .expect("a footprint has a radius, or sides with a length");
        Self {
            body,
            reach: footprint.reach_m() + 1e-6,
            course: Course::Track(Track::at(start)),
        }
    }

    /// Its track, if it is another robot.
    pub(super) const fn track(&self) -> Option<&Track> {
        match &self.course {
            Course::Track(track) => Some(track),
            Course::Path(_) => None,
        }
    }

    /// The same body with a track of its own.
    pub(super) fn separated(&self) -> Self {
        let course = match &self.course {
            Course::Track(track) => Course::Track(track.separated()),
            course => course.clone(),
        };
        Self {
            course,
            ..self.clone()
        }
    }

    /// Radius of the circle around its origin that contains the obstacle, metres.
    pub(super) const fn reach(&self) -> f64 {
        self.reach
    }

    /// Maximum speed of the body, m/s.
    pub(super) fn top_speed_m_s(&self) -> f64 {
        match &self.course {
            Course::Path(path) => path.top_speed_m_s(),
            Course::Track(_) => OBSTACLE_SPEED_MAX_M_S,
        }
    }

    /// The body where it is at the time `at`.
    pub(super) fn placed(&self, at: Instant) -> Placed<'_> {
        let pose = match &self.course {
            Course::Path(path) => {
                let Point { x, y } = path.position(at);
                Pose::new(x, y, 0.0)
            }
            Course::Track(track) => track.pose(at),
        };
        Placed {
            body: &self.body,
            origin: pose.point(),
            heading: pose.theta,
        }
    }
}

impl Placed<'_> {
    /// Its surfaces as seen from its origin, in the world's axes, each with its reflectivity.
    pub(super) fn surfaces(&self) -> impl Iterator<Item = (Primitive, f64)> {
        let turned = (self.heading != 0.0).then(|| libm::sincos(self.heading));
        let surface = move |primitive: &Primitive| match turned {
            Some(by) => primitive.turned(by),
            None => *primitive,
        };
        let primitives = self.body.primitives.iter().map(surface);
        primitives.zip(self.body.reflectivity.iter().copied())
    }

    /// Its outline in the world's axes.
    pub(super) fn outline(&self) -> Shape {
        let place = |at: Point| Point::new(at.x + self.origin.x, at.y + self.origin.y);
        let mut corners = Vec::new();
        for (primitive, _) in self.surfaces() {
            match primitive {
                Primitive::Circle(circle) => {
                    return Shape::Circle {
                        center: place(circle.center),
                        radius_m: circle.radius,
                    };
                }
                Primitive::Segment(side) => corners.push(place(side.ends()[0])),
            }
        }
        Shape::Polygon { corners }
    }
}
