//! Lines painted on the floor: nothing solid, but light sensors under a robot see them.

use core::fmt;
use std::sync::Arc;

use super::Scene;
use crate::world::geometry::Point;

/// Minimum and maximum width of a line, metres.
const WIDTH_M: [f64; 2] = [1e-3, 1.0];

/// A straight line on the floor with round ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorLine {
    from: Point,
    to: Point,
    width_m: f64,
}

impl FloorLine {
    /// A line `width_m` wide; of a single point if both ends are the same.
    ///
    /// # Errors
    /// If an end is not finite, or the width is not within 1 mm to 1 m.
    pub fn new(from: Point, to: Point, width_m: f64) -> Result<Self, FloorLineError> {
        if !from.is_finite() || !to.is_finite() {
            return Err(FloorLineError::NotFinite);
        }
        let [least, greatest] = WIDTH_M;
        if !(least..=greatest).contains(&width_m) {
            return Err(FloorLineError::Width { found: width_m });
        }
        Ok(Self { from, to, width_m })
    }

    /// Whether `point` lies on the line.
    pub fn covers(&self, point: Point) -> bool {
        let (dx, dy) = (self.to.x - self.from.x, self.to.y - self.from.y);
        let (px, py) = (point.x - self.from.x, point.y - self.from.y);
        let square = dx * dx + dy * dy;
        let part = match square > 0.0 {
            true => ((px * dx + py * dy) / square).clamp(0.0, 1.0),
            false => 0.0,
        };
        let nearest = Point::new(self.from.x + part * dx, self.from.y + part * dy);
        nearest.distance(point) <= 0.5 * self.width_m
    }
}

impl Scene {
    /// The same scene with these lines on its floor, and no others.
    #[must_use]
    pub fn with_floor_lines(self, lines: Vec<FloorLine>) -> Self {
        Self {
            floor: Arc::from(lines),
            ..self
        }
    }

    /// The lines on the floor.
    pub fn floor_lines(&self) -> &[FloorLine] {
        &self.floor
    }

    /// Whether there is a line on the floor at `point`.
    pub fn is_on_line(&self, point: Point) -> bool {
        self.floor.iter().any(|line| line.covers(point))
    }
}

/// Error of an invalid line.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum FloorLineError {
    /// A coordinate is NaN or infinite.
    NotFinite,
    /// Too thin or too wide.
    Width {
        /// The given width, metres.
        found: f64,
    },
}

impl fmt::Display for FloorLineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [least, greatest] = WIDTH_M;
        match self {
            Self::NotFinite => f.write_str("a coordinate is not finite"),
            Self::Width { found } => {
                write!(f, "width is {found} m, expected {least} to {greatest}")
            }
        }
    }
}

impl core::error::Error for FloorLineError {}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line of 2 cm along x: 1 cm aside is on it, 1.1 cm is not, nor is 1.1 cm beyond its end.
    #[test]
    fn a_point_is_on_a_line_within_half_its_width() {
        let line = FloorLine::new(Point::new(0.0, 0.0), Point::new(1.0, 0.0), 0.02).unwrap();
        let scene = Scene::new(Vec::<super::super::Fixture>::new(), vec![]).unwrap();
        assert!(!scene.is_on_line(Point::new(0.5, 0.0)));
        let scene = scene.with_floor_lines(vec![line]);
        for (x, y, on) in [
            (0.5, 0.0, true),
            (0.5, 0.0099, true),
            (0.5, -0.011, false),
            (1.0099, 0.0, true),
            (1.011, 0.0, false),
            (-0.011, 0.0, false),
        ] {
            assert_eq!(scene.is_on_line(Point::new(x, y)), on, "{x} {y}");
        }
    }

    #[test]
    fn lines_that_are_none_are_refused() {
        let origin = Point::default();
        let line = |x, width_m| FloorLine::new(origin, Point::new(x, 0.0), width_m);
        assert_eq!(line(f64::NAN, 0.02), Err(FloorLineError::NotFinite));
        assert_eq!(line(1.0, 0.0), Err(FloorLineError::Width { found: 0.0 }));
        assert!(line(1.0, f64::NAN).is_err());
        assert!(line(0.0, 0.02).is_ok_and(|dot| dot.covers(origin)));
    }

    /// A line of 2 cm width from (1, 2) on, (3, 4) metres long: the direction across it is (-0.8,
    /// 0.6).
    #[test]
    fn a_line_may_lie_askew_anywhere() {
        let line = FloorLine::new(Point::new(1.0, 2.0), Point::new(4.0, 6.0), 0.02).unwrap();
        let covers = |along: f64, aside: f64| {
            let x = 1.0 + 0.6 * along - 0.8 * aside;
            line.covers(Point::new(x, 2.0 + 0.8 * along + 0.6 * aside))
        };
        for along in [0.0, 1.0, 2.5, 5.0] {
            assert!(covers(along, 0.009) && covers(along, -0.009), "{along}");
            assert!(!covers(along, 0.011) && !covers(along, -0.011), "{along}");
        }
        assert!(covers(-0.009, 0.0) && !covers(-0.011, 0.0));
        assert!(covers(5.009, 0.0) && !covers(5.011, 0.0));
    }

    #[test]
    fn what_is_wrong_with_a_line_is_told() {
        let line = |x, width_m| FloorLine::new(Point::default(), Point::new(x, 0.0), width_m);
        let told = |line: Result<FloorLine, FloorLineError>| line.unwrap_err().to_string();
        assert_eq!(told(line(f64::NAN, 0.02)), "a coordinate is not finite");
        assert_eq!(told(line(1.0, 2.0)), "width is 2 m, expected 0.001 to 1");
        let from_nowhere = FloorLine::new(Point::new(0.0, f64::NAN), Point::default(), 0.02);
        assert_eq!(from_nowhere, Err(FloorLineError::NotFinite));
    }
}
