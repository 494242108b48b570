//! Errors of a scene.

use core::fmt;

use crate::world::geometry::Bounds;

/// Error of a scene, with the part that causes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneError {
    /// The part at fault.
    pub part: Part,
    /// The error.
    pub cause: Cause,
}

/// A part of a scene, counted from 0 in the order given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// One of the fixtures.
    Fixture(usize),
    /// One of the obstacles.
    Obstacle(usize),
}

/// Error of a part of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Cause {
    /// A coordinate or radius is NaN or infinite.
    NotFinite,
    /// A wall, or one side of a polygon, of no length.
    TooShort {
        /// Its length.
        length_m: f64,
    },
    /// A polygon with less than three corners.
    TooFewCorners {
        /// Its number of points.
        found: usize,
    },
    /// A circle of no or negative radius.
    Radius {
        /// Its radius, metres.
        found: f64,
    },
    /// Reflectivity outside 0..=100.
    Reflectivity {
        /// The given reflectivity.
        found: f64,
    },
    /// A height of 0 or less, or not a number.
    Height {
        /// The given height, metres.
        found: f64,
    },
    /// The part reaches beyond the scene.
    OutOfBounds {
        /// Extent of the part.
        found: Bounds,
        /// Extent of the scene.
        bounds: Bounds,
    },
    /// More walls and circles than a scene may have.
    TooMany {
        /// The maximum number.
        limit: usize,
    },
    /// A path without way-points.
    NoWaypoints,
    /// A waypoint that is not later than the previous one.
    TimesNotRising {
        /// Its index, from 0.
        waypoint: usize,
    },
    /// A looping path whose last place is not its first.
    OpenLoop,
    /// An obstacle too fast for the contact test.
    TooFast {
        /// Its greatest speed, m/s.
        found_m_s: f64,
        /// The limit, m/s.
        limit_m_s: f64,
    },
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.part {
            Part::Fixture(index) => write!(f, "fixture {index}: ")?,
            Part::Obstacle(index) => write!(f, "obstacle {index}: ")?,
        }
        self.cause.fmt(f)
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => write!(f, "a coordinate or radius is not a finite number"),
            Self::TooShort { length_m } => {
                write!(f, "a wall of {length_m} m; expected at least 0.000001 m")
            }
            Self::TooFewCorners { found } => {
                write!(f, "a polygon of {found} corners; expected at least 3")
            }
            Self::Radius { found } => {
                write!(f, "a radius of {found} m; expected at least 0.000001 m")
            }
            Self::Reflectivity { found } => {
                write!(f, "a reflectivity of {found}; expected 0 to 100")
            }
            Self::Height { found } => write!(f, "a height of {found} m; expected more than 0"),
            Self::OutOfBounds { found, bounds } => write!(
                f,
                "it reaches from ({}, {}) to ({}, {}) m; expected within ({}, {}) to ({}, {}) m",
                found.min.x,
                found.min.y,
                found.max.x,
                found.max.y,
                bounds.min.x,
                bounds.min.y,
                bounds.max.x,
                bounds.max.y,
            ),
            Self::TooMany { limit } => write!(f, "more than {limit} walls and circles"),
            Self::NoWaypoints => write!(f, "a path without way-points; expected at least 1"),
            Self::TimesNotRising { waypoint } => {
                write!(
                    f,
                    "way-point {waypoint} is not later than the one before it"
                )
            }
            Self::OpenLoop => write!(f, "a looping path must end where it begins"),
            Self::TooFast {
                found_m_s,
                limit_m_s,
            } => {
                write!(
                    f,
                    "a speed of {found_m_s} m/s; expected at most {limit_m_s} m/s"
                )
            }
        }
    }
}

impl core::error::Error for SceneError {}
impl core::error::Error for Cause {}
