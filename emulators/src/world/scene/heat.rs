//! Warm plates on walls: the victims of RoboCup Rescue's arenas.

use core::fmt;
use std::sync::Arc;

use protocols::Instant;

use super::Scene;
use crate::world::geometry::Point;

/// Temperature of everything else, degrees Celsius: a hall.
pub const AMBIENT_C: f64 = 22.0;
/// Maximum distance of a plate from the surface of its wall, metres.
const ON_WALL_M: f64 = 0.005;

/// A plate on a wall, seen from above as a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeatPlate {
    from: Point,
    to: Point,
    celsius: f64,
}

/// Error of an invalid plate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeatPlateError;

impl fmt::Display for HeatPlateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a heat plate has finite ends apart from each other, and -50 to 150 degrees")
    }
}

impl core::error::Error for HeatPlateError {}

impl HeatPlate {
    /// A plate between two points, as warm as `celsius`.
    ///
    /// # Errors
    /// If a figure is out of range.
    pub fn new(from: Point, to: Point, celsius: f64) -> Result<Self, HeatPlateError> {
        let is_sound = from.is_finite() && to.is_finite() && from != to;
        let plate = Self { from, to, celsius };
        let sound = is_sound && (-50.0..=150.0).contains(&celsius);
        sound.then_some(plate).ok_or(HeatPlateError)
    }

    /// Its middle.
    pub fn middle(&self) -> Point {
        Point::new(
            (self.from.x + self.to.x) / 2.0,
            (self.from.y + self.to.y) / 2.0,
        )
    }

    /// Distance of the hit along a ray.
    fn met_at(&self, origin: Point, [cos, sin]: [f64; 2]) -> Option<f64> {
        let (ex, ey) = (self.to.x - self.from.x, self.to.y - self.from.y);
        let (fx, fy) = (self.from.x - origin.x, self.from.y - origin.y);
        let cross = cos * ey - sin * ex;
        let along = (fx * ey - fy * ex) / cross;
        let share = (fx * sin - fy * cos) / cross;
        (along > 0.0 && (0.0..=1.0).contains(&share)).then_some(along)
    }
}

impl Scene {
    /// The same scene with these plates, and no others.
    #[must_use]
    pub fn with_heat_plates(self, plates: Vec<HeatPlate>) -> Self {
        Self {
            heat: Arc::from(plates),
            ..self
        }
    }

    /// The plates.
    pub fn heat_plates(&self) -> &[HeatPlate] {
        &self.heat
    }

    /// Temperature of the surface that a ray meets at `at`, degrees Celsius.
    pub fn temperature(&self, at: Instant, from: Point, angle: f64, max_range: f64) -> f64 {
        let direction = [libm::cos(angle), libm::sin(angle)];
        let wall = self.cast_ray(at, from, angle, max_range);
        let wall_m = wall.map_or(max_range, |hit| hit.distance + ON_WALL_M);
        let met = self.heat.iter().filter_map(|plate| {
            let far = plate.met_at(from, direction)?;
            (far <= wall_m).then_some((far, plate.celsius))
        });
        let nearest = met.min_by(|one, other| one.0.total_cmp(&other.0));
        nearest.map_or(AMBIENT_C, |(_, celsius)| celsius)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::scene::{Obstacle, Shape};

    /// A wall along x = 1 with a plate from y = -0.05 to 0.05 on its left face, and one behind it.
    #[test]
    fn a_plate_is_felt_on_its_side_of_the_wall_only() {
        let wall = Shape::Wall {
            from: Point::new(1.0, -1.0),
            to: Point::new(1.0, 1.0),
        };
        let plate = |x: f64, celsius| {
            HeatPlate::new(Point::new(x, -0.05), Point::new(x, 0.05), celsius).expect("sound")
        };
        let scene = Scene::new(vec![wall], Vec::<Obstacle>::new()).expect("sound");
        let scene = scene.with_heat_plates(vec![plate(1.0, 37.0), plate(1.02, 60.0)]);
        let felt = |x, angle| scene.temperature(Instant::ZERO, Point::new(x, 0.0), angle, 2.0);
        assert_eq!(felt(0.5, 0.0), 37.0);
        // Half a metre away the plate ends at 5.7 degrees.
        assert_eq!((felt(0.5, 0.095), felt(0.5, 0.105)), (37.0, AMBIENT_C));
        assert_eq!(felt(0.5, core::f64::consts::PI), AMBIENT_C);
        assert_eq!(felt(1.5, core::f64::consts::PI), 60.0);
    }

    #[test]
    fn what_is_no_plate_is_refused() {
        assert_eq!(
            HeatPlateError.to_string(),
            "a heat plate has finite ends apart from each other, and -50 to 150 degrees"
        );
        let here = Point::new(0.0, 0.0);
        assert_eq!(HeatPlate::new(here, here, 37.0), Err(HeatPlateError));
        let there = Point::new(0.1, 0.0);
        for celsius in [151.0, -51.0, f64::NAN] {
            assert_eq!(HeatPlate::new(here, there, celsius), Err(HeatPlateError));
        }
        let nowhere = Point::new(f64::NAN, 0.0);
        assert_eq!(HeatPlate::new(nowhere, there, 37.0), Err(HeatPlateError));
        assert_eq!(HeatPlate::new(here, nowhere, 37.0), Err(HeatPlateError));
        assert_eq!(
            HeatPlate::new(here, there, 37.0).map(|plate| plate.middle().x),
            Ok(0.05)
        );
    }

    #[test]
    fn a_scene_has_the_plates_that_it_was_given() {
        let plates = [20.0, 37.0].map(|celsius| {
            HeatPlate::new(Point::new(0.0, 0.0), Point::new(0.1, 0.0), celsius).unwrap()
        });
        let scene = Scene::new(Vec::<Shape>::new(), vec![]).unwrap();
        assert_eq!(scene.heat_plates(), []);
        assert_eq!(
            scene.with_heat_plates(plates.to_vec()).heat_plates(),
            plates
        );
    }

    /// A plate from (3, 1) to (3, 5), seen from (1, 2): 2 m straight ahead, 2.5 m along (4, 3) / 5
    /// and 2.236 m along (2, -1); beyond its ends and behind nothing.
    #[test]
    fn a_plate_is_met_where_it_is() {
        let plate = HeatPlate::new(Point::new(3.0, 1.0), Point::new(3.0, 5.0), 37.0);
        let met = |dx: f64, dy: f64| {
            let length = libm::hypot(dx, dy);
            let direction = [dx / length, dy / length];
            plate
                .expect("sound")
                .met_at(Point::new(1.0, 2.0), direction)
        };
        let is = |found: Option<f64>, expected: f64| {
            found.is_some_and(|found| (found - expected).abs() < 1e-12)
        };
        assert!(is(met(1.0, 0.0), 2.0) && is(met(4.0, 3.0), 2.5));
        assert!(is(met(1.99, -0.99), libm::hypot(1.0, 99.0 / 199.0) * 2.0));
        assert_eq!(
            [
                met(2.0, -1.01),
                met(2.0, 3.01),
                met(-1.0, 0.0),
                met(-2.0, 1.0)
            ],
            [None; 4]
        );
        assert!(is(met(2.0, 2.99), libm::hypot(2.0, 2.99)));
        let across = HeatPlate::new(Point::new(0.0, 6.0), Point::new(4.0, 6.0), 37.0);
        let far = across
            .expect("sound")
            .met_at(Point::new(1.0, 2.0), [0.6, 0.8]);
        assert!(is(far, 5.0) && across.expect("sound").middle() == Point::new(2.0, 6.0));
    }
}
