//! Floor with little grip: wheels that drive harder than it holds spin, and those that brake slide.

use core::fmt;
use std::sync::Arc;

use super::Scene;
use crate::world::geometry::{Bounds, Point};

/// Greatest grip that counts as little: that of dry rubber.
const GRIP_MAX: f64 = 1.0;

/// A rectangle of floor with too little grip for a body's wheels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlickFloor {
    bounds: Bounds,
    grip: f64,
}

impl SlickFloor {
    /// All of `bounds`, where a body gains and loses speed by at most `grip` times the acceleration
    /// of free fall: 0 is no grip, wet ice has 0.05.
    ///
    /// # Errors
    /// If a corner is not finite or the wrong one, or the grip is not within 0 to 1.
    pub fn new(bounds: Bounds, grip: f64) -> Result<Self, SlickFloorError> {
        let Bounds { min, max } = bounds;
        if !(min.is_finite() && max.is_finite() && min.x < max.x && min.y < max.y) {
            return Err(SlickFloorError::Corners);
        }
        if !(0.0..=GRIP_MAX).contains(&grip) {
            return Err(SlickFloorError::Grip { found: grip });
        }
        Ok(Self { bounds, grip })
    }

    fn covers(&self, point: Point) -> bool {
        let Bounds { min, max } = self.bounds;
        (min.x..=max.x).contains(&point.x) && (min.y..=max.y).contains(&point.y)
    }
}

impl Scene {
    /// The same scene with these slick places on its floor, and no others.
    #[must_use]
    pub fn with_slick_floors(self, slick: Vec<SlickFloor>) -> Self {
        Self {
            slick: Arc::from(slick),
            ..self
        }
    }

    /// The least grip of the floor at `point`, as a part of free fall; `None` where wheels always
    /// hold.
    pub fn grip_at(&self, point: Point) -> Option<f64> {
        let here = self.slick.iter().filter(|floor| floor.covers(point));
        here.map(|floor| floor.grip).reduce(f64::min)
    }
}

/// Error of an invalid slick area.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum SlickFloorError {
    /// The first corner is not the lower left one of the two, or one is not finite.
    Corners,
    /// A negative grip, or more than rubber has.
    Grip {
        /// The given grip.
        found: f64,
    },
}

impl fmt::Display for SlickFloorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Corners => f.write_str("the first corner is not the lower left one"),
            Self::Grip { found } => write!(f, "grip is {found}, expected 0 to {GRIP_MAX}"),
        }
    }
}

impl core::error::Error for SlickFloorError {}

#[cfg(test)]
mod tests {
    use super::super::Fixture;
    use super::*;

    const fn square(from: f64, to: f64) -> Bounds {
        Bounds {
            min: Point::new(from, from),
            max: Point::new(to, to),
        }
    }

    #[test]
    fn the_least_grip_of_a_place_counts() {
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
        let floors = [(0.0, 2.0, 0.3), (1.0, 3.0, 0.1)];
        let floors = floors.map(|(from, to, grip)| SlickFloor::new(square(from, to), grip));
        let scene = scene.with_slick_floors(floors.into_iter().map(Result::unwrap).collect());
        let found = [-0.1, 0.5, 1.5, 2.5, 3.1].map(|at| scene.grip_at(Point::new(at, at)));
        assert_eq!(found, [None, Some(0.3), Some(0.1), Some(0.1), None]);
    }

    #[test]
    fn places_that_are_none_are_refused() {
        let of = |from, to, grip| SlickFloor::new(square(from, to), grip).err();
        assert_eq!(of(1.0, 0.0, 0.1), Some(SlickFloorError::Corners));
        assert_eq!(of(0.0, f64::NAN, 0.1), Some(SlickFloorError::Corners));
        assert_eq!(
            of(0.0, 1.0, 1.1),
            Some(SlickFloorError::Grip { found: 1.1 })
        );
        assert!(of(0.0, 1.0, f64::NAN).is_some() && of(0.0, 1.0, 0.0).is_none());
    }

    #[test]
    fn a_place_that_is_none_is_told() {
        let shown = |error: SlickFloorError| format!("{error}");
        assert_eq!(
            shown(SlickFloorError::Corners),
            "the first corner is not the lower left one"
        );
        let grip = shown(SlickFloorError::Grip { found: -0.5 });
        assert!(grip.starts_with("grip is -0.5, expected 0 to "), "{grip}");
    }
}
