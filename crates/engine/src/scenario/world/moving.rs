//! Obstacles that move.

use core::time::Duration;

use emulators::world::{Fixture, Obstacle, Path, Point, Repeat, Shape, Waypoint};

use super::{MovingSpec, Origin, RepeatSpec, WorldSpec, point};
use crate::scenario::{ScenarioError, Source};

impl WorldSpec {
    pub(super) fn obstacles(
        &self,
        source: &Source,
    ) -> Result<(Vec<Obstacle>, Vec<Origin>), ScenarioError> {
        let mut obstacles = Vec::new();
        let mut origins = Vec::new();
        let mut wrong = Vec::new();
        for (index, spec) in self.moving.iter().enumerate() {
            let moving = spec.get_ref();
            let key = format!("world.moving[{index}]");
            let (span, speed) = (spec.span(), moving.speed_m_s);
            if !(speed.is_finite() && speed > 0.0) {
                let message = format!("speed_m_s is {speed}, expected more than 0");
                wrong.push(source.invalid(Some(span), key, message));
                continue;
            }
            let shape = Shape::Circle {
                center: Point::default(),
                radius_m: moving.radius_m,
            };
            let fixture = Fixture {
                shape,
                reflectivity: 1.0,
                height_m: f64::INFINITY,
                is_glass: false,
            };
            obstacles.push(Obstacle {
                fixture,
                path: moving.path(),
            });
            origins.push(Origin { key, span });
        }
        ScenarioError::none_of(wrong)?;
        Ok((obstacles, origins))
    }
}

impl MovingSpec {
    fn path(&self) -> Path {
        let mut at = self.from.instant();
        let mut waypoints: Vec<Waypoint> = Vec::new();
        for &place in &self.path_m {
            let position = point(place);
            if let Some(last) = waypoints.last() {
                let seconds = last.position.distance(position) / self.speed_m_s;
                at += Duration::try_from_secs_f64(seconds).unwrap_or_default();
            }
            waypoints.push(Waypoint { at, position });
        }
        let repeat = match self.repeat {
            RepeatSpec::Once => Repeat::Once,
            RepeatSpec::Loop => Repeat::Loop,
            RepeatSpec::PingPong => Repeat::PingPong,
        };
        Path { waypoints, repeat }
    }
}
