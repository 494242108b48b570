//! The world of a scenario: walls and obstacles, the robot's start, moving obstacles and pushes.

mod body;
mod floor_line;
mod heat;
mod moving;
mod outline;
mod reach;
mod slick;

use emulators::world::{
    Bounds, Chassis, Fixture, OccupancyImage, Part, Point, Pose, Scene, Shape, World, WorldError,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::{MazeSpec, ScenarioError, Source, Span};
use crate::scenario::{body_error, plan};
pub use body::BodySpec;
pub use floor_line::FloorLineSpec;
pub use heat::HeatSpec;
pub use slick::SlickSpec;

/// Ground truth as data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WorldSpec {
    /// Start pose of the robot; the robot's program knows this pose.
    #[schemars(with = "StartSpec")]
    pub start: Spanned<StartSpec>,
    /// Rectangle that contains the whole world; ±1 km if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<BoundsSpec>,
    /// A floor plan from a map picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<PlanSpec>")]
    pub plan: Option<Spanned<PlanSpec>>,
    /// The robot's body.
    #[serde(default)]
    pub body: BodySpec,
    /// An arena of tiles, generated from a seed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<MazeSpec>")]
    pub maze: Option<Spanned<MazeSpec>>,
    /// Walls along a line of points.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<WallSpec>")]
    pub wall: Vec<Spanned<WallSpec>>,
    /// Closed outlines.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<PolygonSpec>")]
    pub polygon: Vec<Spanned<PolygonSpec>>,
    /// Round pillars and the thin legs of furniture.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<PillarSpec>")]
    pub pillar: Vec<Spanned<PillarSpec>>,
    /// Warm plates: victims.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<HeatSpec>")]
    pub heat: Vec<Spanned<HeatSpec>>,
    /// Areas of floor with little grip.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<SlickSpec>")]
    pub slick: Vec<Spanned<SlickSpec>>,
    /// Lines on the floor.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<FloorLineSpec>")]
    pub line: Vec<Spanned<FloorLineSpec>>,
    /// Round obstacles that move.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<MovingSpec>")]
    pub moving: Vec<Spanned<MovingSpec>>,
    /// Pushes of the robot.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub push: Vec<PushSpec>,
    /// The scenario has no world.
    #[serde(skip)]
    #[schemars(skip)]
    is_nowhere: bool,
}

/// Start pose of the robot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StartSpec {
    /// Metres, -10000 to 10000.
    #[schemars(range(min = -10_000.0, max = 10_000.0))]
    pub x_m: f64,
    /// Metres, -10000 to 10000.
    #[schemars(range(min = -10_000.0, max = 10_000.0))]
    pub y_m: f64,
    /// Degrees counter-clockwise from +x, -3600 to 3600.
    #[schemars(range(min = -3_600.0, max = 3_600.0))]
    pub heading_deg: f64,
}

/// A rectangle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoundsSpec {
    /// Lower left corner, metres.
    pub min_m: [f64; 2],
    /// Upper right corner, metres.
    pub max_m: [f64; 2],
}

/// A ROS map: the yaml file, relative to the scenario.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanSpec {
    /// Path of the yaml file.
    pub yaml: String,
}

/// Walls along a line of points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WallSpec {
    /// At least two points, metres, -1000 to 1000.
    pub path_m: Vec<[f64; 2]>,
    /// Light returned, compared with a white wall: 0 to 100; 1 is white, 0.4 a dark sofa.
    #[schemars(range(min = 0.0, max = 100.0))]
    #[serde(default = "white")]
    pub reflectivity: f64,
    /// Height above the floor, metres, more than 0; to the ceiling if not given. Sensors at this
    /// height or higher do not see it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.000_001))]
    pub height_m: Option<f64>,
    /// Whether the object is missing on the floor plan for robots.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub unmapped: bool,
    /// Whether the wall is of glass. An `xv11` does not see it; infrared sensors detect it, and a
    /// robot collides with it.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub glass: bool,
}

/// A closed outline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PolygonSpec {
    /// At least three corners, metres, -1000 to 1000.
    pub corners_m: Vec<[f64; 2]>,
    /// Light returned, compared with a white wall: 0 to 100; 1 is white, 0.4 a dark sofa.
    #[schemars(range(min = 0.0, max = 100.0))]
    #[serde(default = "white")]
    pub reflectivity: f64,
    /// Height above the floor, metres, more than 0; to the ceiling if not given. Sensors at this
    /// height or higher do not see it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.000_001))]
    pub height_m: Option<f64>,
    /// Whether the object is missing on the floor plan for robots.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub unmapped: bool,
}

/// Round pillars of one size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PillarSpec {
    /// Positions, metres, -1000 to 1000.
    pub at_m: Vec<[f64; 2]>,
    /// Radius, metres, at least 0.000001.
    #[schemars(range(min = 0.000_001))]
    pub radius_m: f64,
    /// Light returned, compared with a white wall: 0 to 100; 1 is white, 0.4 a dark sofa.
    #[schemars(range(min = 0.0, max = 100.0))]
    #[serde(default = "white")]
    pub reflectivity: f64,
    /// Height above the floor, metres, more than 0; to the ceiling if not given. Sensors at this
    /// height or higher do not see it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.000_001))]
    pub height_m: Option<f64>,
    /// Whether the object is missing on the floor plan for robots.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub unmapped: bool,
}

/// A round obstacle that moves along a line of points at constant speed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MovingSpec {
    /// At least one point, metres, -1000 to 1000.
    pub path_m: Vec<[f64; 2]>,
    /// Metres per second, more than 0, at most 20.
    #[schemars(range(min = 0.0, max = 20.0))]
    pub speed_m_s: f64,
    /// Radius, metres, at least 0.000001.
    #[schemars(range(min = 0.000_001))]
    pub radius_m: f64,
    /// Start of its motion, counted from the start of the run.
    #[serde(default)]
    pub from: Span,
    /// Behaviour at the end of the path.
    #[serde(default)]
    pub repeat: RepeatSpec,
}

/// Behaviour of a moving obstacle at the end of its path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RepeatSpec {
    /// It stops.
    #[default]
    Once,
    /// It starts again; the path must end at its first point.
    Loop,
    /// It turns back.
    PingPong,
}

/// A push of the robot: the body moves, but the wheels do not turn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PushSpec {
    /// Begin, counted from the start of the run.
    pub at: Span,
    /// Displacement, metres in the world's frame.
    pub by_m: [f64; 2],
    /// Rotation of the robot, degrees counter-clockwise, -36000 to 36000.
    #[serde(default)]
    #[schemars(range(min = -36_000.0, max = 36_000.0))]
    pub turn_deg: f64,
    /// Duration; a push faster than 5 m/s or 20 rad/s takes longer.
    pub over: Span,
}

const fn white() -> f64 {
    1.0
}

fn height(metres: Option<f64>) -> f64 {
    metres.unwrap_or(f64::INFINITY)
}

const fn point([x, y]: [f64; 2]) -> Point {
    Point::new(x, y)
}

/// A part of the scene and its position in the file.
struct Origin {
    key: String,
    span: core::ops::Range<usize>,
}

impl WorldSpec {
    /// No world at all, for devices without a robot.
    pub fn nowhere() -> Self {
        let start = StartSpec {
            x_m: 0.0,
            y_m: 0.0,
            heading_deg: 0.0,
        };
        Self {
            start: Spanned::new(0..0, start),
            bounds: None,
            plan: None,
            maze: None,
            body: BodySpec::default(),
            wall: Vec::new(),
            polygon: Vec::new(),
            pillar: Vec::new(),
            heat: Vec::new(),
            slick: Vec::new(),
            line: Vec::new(),
            moving: Vec::new(),
            push: Vec::new(),
            is_nowhere: true,
        }
    }

    /// The same world with another robot in it, which nothing pushes.
    pub(super) fn with_robot(&self, start: &Spanned<StartSpec>, body: BodySpec) -> Self {
        Self {
            start: start.clone(),
            body,
            push: Vec::new(),
            ..self.clone()
        }
    }

    /// Whether the world is missing.
    pub const fn is_nowhere(&self) -> bool {
        self.is_nowhere
    }

    /// The start pose.
    pub fn start_pose(&self) -> Pose {
        let start = self.start.get_ref();
        Pose::new(start.x_m, start.y_m, start.heading_deg.to_radians())
    }

    /// Builds the world: a robot on `chassis`, or on two wheels as in `body`; `seed` seeds the
    /// noise.
    ///
    /// # Errors
    /// If an object has an impossible position or size.
    pub fn build(
        &self,
        seed: u64,
        chassis: Option<Box<dyn Chassis>>,
        source: &Source,
    ) -> Result<World, ScenarioError> {
        let scene = self.scene(source)?;
        let world = match chassis {
            Some(chassis) => World::with_chassis(scene, chassis, self.start_pose()),
            None => World::new(scene, self.body.into(), self.start_pose(), seed),
        };
        world.map_err(|error| match error {
            WorldError::Body(error) => body_error(source, &error.to_string()),
            error => source.invalid(Some(self.start.span()), "world.start", error.to_string()),
        })
    }

    /// The solid shapes of the floor plan for robots: without moving and unmapped ones.
    ///
    /// # Errors
    /// If an object has an impossible position or size.
    pub fn mapped(&self, source: &Source) -> Result<Scene, ScenarioError> {
        let mut mapped = self.clone();
        mapped.wall.retain(|wall| !wall.get_ref().unmapped);
        mapped.polygon.retain(|polygon| !polygon.get_ref().unmapped);
        mapped.pillar.retain(|pillar| !pillar.get_ref().unmapped);
        mapped.moving.clear();
        mapped.scene(source)
    }

    /// Checks the solid shapes, without the robot among them.
    ///
    /// # Errors
    /// All objects with an impossible position or size.
    pub(crate) fn check(&self, source: &Source) -> Result<(), ScenarioError> {
        self.scene(source).map(drop)
    }

    fn scene(&self, source: &Source) -> Result<Scene, ScenarioError> {
        self.check_reach(source)?;
        let mut wrong = Vec::new();
        let fixtures = kept(self.fixtures(source), &mut wrong);
        let obstacles = kept(self.obstacles(source), &mut wrong);
        let plates = kept(self.heat_plates(source), &mut wrong);
        let slick = kept(slick::build(&self.slick, source), &mut wrong);
        let lines = kept(floor_line::build(&self.line, source), &mut wrong);
        ScenarioError::none_of(wrong)?;
        let (fixtures, fixture_origins) = fixtures;
        let (obstacles, obstacle_origins) = obstacles;
        let scene = match &self.bounds {
            Some(bounds) => {
                let bounds = Bounds {
                    min: point(bounds.min_m),
                    max: point(bounds.max_m),
                };
                Scene::within(bounds, fixtures, obstacles)
            }
            None => Scene::new(fixtures, obstacles),
        };
        let scene = scene.map(|scene| {
            let scene = scene.with_heat_plates(plates);
            scene.with_slick_floors(slick).with_floor_lines(lines)
        });
        scene.map_err(|error| {
            let origin = match error.part {
                Part::Fixture(index) => fixture_origins.get(index),
                Part::Obstacle(index) => obstacle_origins.get(index),
            };
            let key = origin.map_or("world", |origin| &origin.key);
            let span = origin.map(|origin| origin.span.clone());
            source.invalid(span, key, error.cause.to_string())
        })
    }

    fn fixtures(&self, source: &Source) -> Result<(Vec<Fixture>, Vec<Origin>), ScenarioError> {
        let mut fixtures = Vec::new();
        let mut origins = Vec::new();
        let mut wrong = Vec::new();
        let mut add =
            |shape, [reflectivity, height_m]: [f64; 2], is_glass, key: &str, index: usize, span| {
                fixtures.push(Fixture {
                    shape,
                    reflectivity,
                    height_m,
                    is_glass,
                });
                origins.push(Origin {
                    key: format!("world.{key}[{index}]"),
                    span,
                });
            };
        for (index, spec) in self.wall.iter().enumerate() {
            let wall = spec.get_ref();
            if wall.path_m.len() < 2 {
                let message = format!(
                    "path_m has {} points, expected two or more",
                    wall.path_m.len()
                );
                let key = format!("world.wall[{index}]");
                wrong.push(source.invalid(Some(spec.span()), key, message));
            }
            for pair in wall.path_m.windows(2) {
                let shape = Shape::Wall {
                    from: point(pair[0]),
                    to: point(pair[1]),
                };
                let looks = [wall.reflectivity, height(wall.height_m)];
                add(shape, looks, wall.glass, "wall", index, spec.span());
            }
        }
        for (index, spec) in self.polygon.iter().enumerate() {
            let polygon = spec.get_ref();
            let corners = polygon.corners_m.iter().copied().map(point).collect();
            let shape = Shape::Polygon { corners };
            let looks = [polygon.reflectivity, height(polygon.height_m)];
            add(shape, looks, false, "polygon", index, spec.span());
        }
        for (index, spec) in self.pillar.iter().enumerate() {
            let pillar = spec.get_ref();
            for &at in &pillar.at_m {
                let shape = Shape::Circle {
                    center: point(at),
                    radius_m: pillar.radius_m,
                };
                let looks = [pillar.reflectivity, height(pillar.height_m)];
                add(shape, looks, false, "pillar", index, spec.span());
            }
        }
        if let Some(spec) = &self.maze {
            let maze = spec.get_ref();
            let checked = maze.check();
            let boards = checked.is_ok().then(|| maze.boards());
            if let Err(flaw) = checked {
                let key = format!("world.maze.{}", flaw.key);
                wrong.push(source.invalid(Some(spec.span()), key, flaw.message));
            }
            for corners in boards.into_iter().flatten() {
                let corners = corners.into_iter().map(point).collect();
                let looks = [1.0, f64::INFINITY];
                let shape = Shape::Polygon { corners };
                add(shape, looks, false, "maze", 0, spec.span());
            }
        }
        if let Some(spec) = &self.plan {
            match plan::read(&spec.get_ref().yaml, source) {
                Ok(image) => OccupancyImage::walls(&image).into_iter().for_each(|shape| {
                    add(shape, [1.0, f64::INFINITY], false, "plan", 0, spec.span());
                }),
                Err(message) => {
                    wrong.push(source.invalid(Some(spec.span()), "world.plan", message));
                }
            }
        }
        ScenarioError::none_of(wrong)?;
        Ok((fixtures, origins))
    }
}

/// The value of `result`. If it is an error, the default; the error is added to `wrong`.
fn kept<T: Default>(result: Result<T, ScenarioError>, wrong: &mut Vec<ScenarioError>) -> T {
    result.unwrap_or_else(|error| {
        wrong.push(error);
        T::default()
    })
}
