//! Solid shapes of a world at one moment, as drawn by page and report.

use emulators::world::{Outline as Body, Point, Shape, World};
use serde::Serialize;

pub use crate::robots::overlay::millimetres;

/// Solid shapes: `scene` of `show/view/view.js`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scene {
    /// Minimum and maximum x and y: x0, y0, x1, y1.
    pub bounds: [f64; 4],
    /// Outlines at the current time.
    pub shapes: Vec<Outline>,
}

/// An outline: `SHAPE` of `show/view/view.js`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outline {
    /// Both ends.
    Wall([f64; 4]),
    /// x and y of each corner in turn.
    Polygon(Vec<f64>),
    /// Middle and radius.
    Circle([f64; 3]),
}

/// The fixtures of `world`, and its obstacles and other robots at their current positions.
pub fn scene(world: &World) -> Scene {
    let scene = world.scene();
    let bounds = scene.bounds();
    let corners = [bounds.min.x, bounds.min.y, bounds.max.x, bounds.max.y];
    let is_bounded = corners.iter().all(|corner| corner.is_finite());
    let fixed = scene.fixtures().iter();
    let fixed = fixed.map(|fixture| outline(&fixture.shape, Point::new(0.0, 0.0)));
    let moving = scene.obstacles().iter().map(|obstacle| {
        let at = obstacle.path.position(world.now());
        outline(&obstacle.fixture.shape, at)
    });
    let robots = world.robot_outlines();
    let robots = robots
        .iter()
        .map(|body| outline(body, Point::new(0.0, 0.0)));
    Scene {
        bounds: if is_bounded { corners } else { NOWHERE }.map(millimetres),
        shapes: fixed.chain(moving).chain(robots).collect(),
    }
}

/// The robot's outline in its own axes, x ahead.
pub fn footprint(world: &World) -> Outline {
    match world.footprint().outline() {
        Body::Circle { radius_m } => Outline::Circle([0.0, 0.0, millimetres(radius_m)]),
        Body::Polygon(corners) => {
            let flat = corners.iter().flat_map(|corner| [corner.x, corner.y]);
            Outline::Polygon(flat.map(millimetres).collect())
        }
    }
}

/// The view of an empty world.
const NOWHERE: [f64; 4] = [0.0, 0.0, 3.0, 3.0];

fn outline(shape: &Shape, from: Point) -> Outline {
    let place = |point: &Point| [point.x + from.x, point.y + from.y].map(millimetres);
    match shape {
        Shape::Wall { from, to } => {
            let ([x0, y0], [x1, y1]) = (place(from), place(to));
            Outline::Wall([x0, y0, x1, y1])
        }
        Shape::Polygon { corners } => Outline::Polygon(corners.iter().flat_map(place).collect()),
        Shape::Circle { center, radius_m } => {
            let [x, y] = place(center);
            Outline::Circle([x, y, millimetres(*radius_m)])
        }
    }
}

#[cfg(test)]
mod tests {
    use emulators::world::{
        Ackermann, AckermannConfig, BodyConfig, Chassis as _, Obstacle, Path, Pose, Repeat,
        Scene as Solid, Waypoint,
    };
    use protocols::Instant;

    use super::*;

    /// A car's box, or a round robot as a disc around its middle.
    #[test]
    fn a_footprint_is_what_is_solid_of_the_robot() {
        let solid = Solid::new(Vec::<Shape>::new(), Vec::new()).expect("empty");
        let round = World::new(solid.clone(), BodyConfig::default(), Pose::default(), 1);
        let radius_m = BodyConfig::default().radius_m;
        let disc = Outline::Circle([0.0, 0.0, radius_m]);
        assert_eq!(footprint(&round.expect("room")), disc);
        let car = Ackermann::new(AckermannConfig::default(), 1).expect("a car");
        let corners = match car.footprint().outline() {
            Body::Polygon(corners) => corners.len(),
            Body::Circle { .. } => 0,
        };
        assert!(corners >= 4, "{corners}");
        let world = World::with_chassis(solid, Box::new(car), Pose::default());
        let Outline::Polygon(flat) = footprint(&world.expect("room")) else {
            panic!("a car is no disc");
        };
        assert_eq!(flat.len(), 2 * corners);
    }

    /// A wall, and a pillar that walks a metre along y in a second: halfway after half of it.
    #[test]
    fn obstacles_are_shown_where_they_are() {
        let wall = Shape::Wall {
            from: Point::new(0.0, 0.0),
            to: Point::new(3.0, 0.0),
        };
        let pillar = Shape::Circle {
            center: Point::new(0.1, 0.0),
            radius_m: 0.05,
        };
        let stop = |at, y| Waypoint {
            at: Instant::from_millis(at),
            position: Point::new(1.0, y),
        };
        let obstacle = Obstacle {
            fixture: pillar.into(),
            path: Path {
                waypoints: vec![stop(0, 1.0), stop(1000, 2.0)],
                repeat: Repeat::Once,
            },
        };
        let solid = Solid::new([wall], vec![obstacle]).expect("sound");
        let start = Pose::new(2.0, 0.5, 0.0);
        let mut world = World::new(solid, BodyConfig::default(), start, 1).expect("sound");
        world.advance(Instant::from_millis(500));

        let json = serde_json::to_string(&scene(&world).shapes).expect("plain data");
        assert_eq!(
            json,
            r#"[{"wall":[0.0,0.0,3.0,0.0]},{"circle":[1.1,1.5,0.05]}]"#
        );
    }
}
