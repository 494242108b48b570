//! Visible parts of a scene from a height, and within a cone.

use std::sync::Arc;

use protocols::Instant;

use super::{Fixture, Obstacle, Scene};
use crate::world::geometry::Point;

/// Maximum angle between rays of a cone: half a degree, as in the simulator of the car's
/// university.
const CONE_STEP_RAD: f64 = core::f64::consts::PI / 360.0;

/// Directions around one in the middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Its middle, radians, in the world's frame.
    pub angle: f64,
    /// Angle to either side, radians; at most half a turn.
    pub half_angle: f64,
}

impl Scene {
    /// Objects higher than `height_m`: the scene as a sensor at that height sees it. Make it once
    /// and keep it. If everything is higher, the result is this scene.
    #[must_use]
    pub fn slice(&self, height_m: f64) -> Self {
        self.only(|fixture| fixture.height_m > height_m)
    }

    /// Objects that the beam of a lidar at `height_m` meets: higher ones except glass. It is a
    /// guess that all panes let all light through; a real pane is visible at a right angle.
    #[must_use]
    pub fn for_lidar(&self, height_m: f64) -> Self {
        self.only(|fixture| fixture.height_m > height_m && !fixture.is_glass)
    }

    /// Whether `other` is a clone of this scene.
    pub fn is_clone_of(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.inner, &other.inner)
    }

    fn only(&self, is_seen: impl Fn(&Fixture) -> bool) -> Self {
        let inner = &*self.inner;
        let obstacles = || inner.obstacles.iter();
        if inner.fixtures.iter().all(&is_seen) && obstacles().all(|it| is_seen(&it.fixture)) {
            return self.clone();
        }
        let fixtures = inner.fixtures.iter().filter(|it| is_seen(it)).cloned();
        let obstacles: Vec<Obstacle> = obstacles()
            .filter(|it| is_seen(&it.fixture))
            .cloned()
            .collect();
        let seen = Self::new(fixtures.collect::<Vec<_>>(), obstacles);
        // Parts of a scene that was accepted are accepted again.
        let Ok(seen) = seen else {
            return self.clone();
        };
        // A sensor sees another robot at any height.
        let robots = inner.moving.iter().filter(|it| it.track().is_some());
        let moving = seen.inner.moving.iter().chain(robots).cloned();
        let seen = match self.robots().next() {
            Some(_) => seen.with_moving(moving.collect()),
            None => seen,
        };
        Self {
            floor: self.floor.clone(),
            heat: self.heat.clone(),
            slick: self.slick.clone(),
            ..seen
        }
    }

    /// Distance to the nearest thing in `cone` at time `at`, up to `max_range` metres away.
    pub fn cast_cone(&self, at: Instant, from: Point, cone: Cone, max_range: f64) -> Option<f64> {
        let half = cone.half_angle.clamp(0.0, core::f64::consts::PI);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "0 to 360"
        )]
        let steps = (half / CONE_STEP_RAD).ceil() as u32;
        let step = half / f64::from(steps.max(1));
        let rays = (0..=2 * steps).map(|ray| f64::from(ray) - f64::from(steps));
        rays.fold(None, |nearest, ray| {
            let limit = nearest.unwrap_or(max_range);
            let hit = self.cast_ray(at, from, cone.angle + ray * step, limit);
            hit.map(|hit| hit.distance).or(nearest)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::Shape;
    use super::*;
    use crate::world::path::{Path, Repeat, Waypoint};

    fn wall(x: f64, height_m: f64) -> Fixture {
        let shape = Shape::Wall {
            from: Point::new(x, -5.0),
            to: Point::new(x, 5.0),
        };
        Fixture {
            height_m,
            is_glass: false,
            ..shape.into()
        }
    }

    fn range(scene: &Scene) -> Option<f64> {
        let hit = scene.cast_ray(Instant::ZERO, Point::default(), 0.0, 10.0);
        hit.map(|hit| hit.distance)
    }

    /// Report, page 15: the scan lies at 35 cm; a box of 30 cm is below it, one of 40 cm is not.
    #[test]
    fn a_slice_at_35_cm_sees_40_cm_and_not_30_cm() {
        let low = wall(1.0, 0.30);
        let high = wall(2.0, 0.40);
        let scene = Scene::new([low, high, wall(3.0, f64::INFINITY)], vec![]).unwrap();
        assert_eq!(range(&scene), Some(1.0));
        assert_eq!(range(&scene.slice(0.10)), Some(1.0));
        assert_eq!(range(&scene.slice(0.35)), Some(2.0));
        assert_eq!(range(&scene.slice(0.40)), Some(3.0));
    }

    #[test]
    fn moving_things_have_a_height_as_well() {
        let origin = Waypoint {
            at: Instant::ZERO,
            position: Point::default(),
        };
        let path = Path {
            waypoints: vec![origin],
            repeat: Repeat::Once,
        };
        let toy = Obstacle {
            fixture: wall(1.0, 0.2),
            path,
        };
        let scene = Scene::new([wall(2.0, 1.0)], vec![toy]).unwrap();
        assert_eq!(range(&scene), Some(1.0));
        assert_eq!(range(&scene.slice(0.35)), Some(2.0));
    }

    /// A lidar 10 cm above the floor does not see a pane 1 m ahead and a threshold of 4 cm 2 m
    /// ahead; the scene itself contains both.
    #[test]
    fn a_lidar_looks_through_glass_and_over_a_threshold() {
        let pane = Fixture {
            is_glass: true,
            ..wall(1.0, f64::INFINITY)
        };
        let fixtures = [pane, wall(2.0, 0.04), wall(3.0, f64::INFINITY)];
        let scene = Scene::new(fixtures, vec![]).unwrap();
        assert_eq!(range(&scene), Some(1.0));
        assert_eq!(range(&scene.slice(0.10)), Some(1.0));
        let seen = scene.for_lidar(0.10);
        assert_eq!(range(&seen), Some(3.0));
        assert!(seen.is_clone_of(&seen.for_lidar(0.10)) && !seen.is_clone_of(&scene));
    }

    #[test]
    fn a_height_of_nothing_is_refused() {
        for height_m in [0.0, -1.0, f64::NAN] {
            assert!(Scene::new([wall(1.0, height_m)], vec![]).is_err());
        }
    }

    /// A pillar of 10 cm, 1 m away and 20 degrees aside, is 0.9 m away for a cone of 21.8 degrees.
    /// A cone of 10 degrees misses it; the wall behind is 2 m away.
    #[test]
    fn a_cone_sees_what_is_nearest_in_it() {
        let (sin, cos) = libm::sincos(20_f64.to_radians());
        let pillar = Shape::Circle {
            center: Point::new(cos, sin),
            radius_m: 0.1,
        };
        let scene = Scene::new([wall(2.0, 1.0), pillar.into()], vec![]).unwrap();
        let range = |degrees: f64, max_range| {
            let cone = Cone {
                angle: 0.0,
                half_angle: degrees.to_radians(),
            };
            scene.cast_cone(Instant::ZERO, Point::default(), cone, max_range)
        };
        assert!((range(21.8, 6.0).unwrap() - 0.9).abs() < 1e-4);
        assert!((range(10.0, 6.0).unwrap() - 2.0).abs() < 1e-12);
        assert_eq!(range(10.0, 1.9), None);
        assert!((range(0.0, 6.0).unwrap() - 2.0).abs() < 1e-12);
    }

    /// A cut scene keeps lines on the floor, warm plates and slick floors, which have no height.
    #[test]
    fn a_slice_keeps_what_has_no_height() {
        use super::super::{FloorLine, HeatPlate, SlickFloor};
        use crate::world::geometry::Bounds;
        let [from, to] = [Point::new(0.0, 0.0), Point::new(1.0, 0.0)];
        let line = FloorLine::new(from, to, 0.02).unwrap();
        let plate = HeatPlate::new(from, to, 37.0).unwrap();
        let slick = SlickFloor::new(Bounds::around(from, 1.0), 0.1).unwrap();
        let scene = Scene::new([wall(1.0, 0.3), wall(2.0, 1.0)], vec![]).unwrap();
        let scene = scene.with_floor_lines(vec![line]);
        let scene = scene.with_heat_plates(vec![plate]);
        let scene = scene.with_slick_floors(vec![slick]);
        for seen in [scene.slice(0.35), scene.for_lidar(0.35)] {
            assert_eq!(range(&seen), Some(2.0));
            assert_eq!(seen.floor_lines(), [line]);
            assert_eq!(seen.heat_plates(), [plate]);
            assert_eq!(seen.grip_at(Point::new(0.5, 0.0)), Some(0.1));
        }
    }
}
