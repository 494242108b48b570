//! Localisation only: each scan is aligned with a known map, which does not change.

use emulators::world::Pose;

use super::{Mapper, OFF_MIDDLE_M, Outcome, Settings, WALLS_M};
use crate::mapping::Shot;
use crate::mapping::cloud::{Cloud, Frame, Spot};

/// A point of a wall on a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallPoint {
    /// Position, metres.
    pub at: [f32; 2],
    /// Unit normal of the wall, towards the side from which it was seen; zero if unknown.
    pub normal: [f32; 2],
}

impl Mapper {
    /// Points of the walls.
    pub fn walls(&self) -> Vec<WallPoint> {
        let all = self.keyframes.iter().zip(&self.graph.poses);
        all.flat_map(|(keyframe, pose)| {
            let frame = Frame::new(*pose);
            let spots = keyframe.cloud.spots().iter();
            spots.map(move |spot| WallPoint {
                at: frame.place(spot.at),
                normal: frame.turned(spot.normal),
            })
        })
        .collect()
    }
}

/// A pose on a known map.
#[derive(Clone, Debug)]
pub struct Localiser {
    mapper: Mapper,
    map: Vec<Spot>,
    has_walls: bool,
    way: Vec<Pose>,
    /// Variance of the pose before the last motion: square metres, square radians.
    unsure: [f64; 2],
}

/// Standard deviations of a start pose from the user: metres, radians.
const START: [f64; 2] = [0.5, 0.15];
/// Factor for the uncertainty of the odometry, higher than during mapping: a map is slightly bent,
/// and precise odometry would pull the robot off the map. With factors 1 and 2, Freiburg's log is
/// lost on its own map.
const SLACK: f64 = 4.0;
/// Maximum standard deviations of a pose that odometry alone continues: metres, radians.
const LOST: [f64; 2] = [1.0, 0.35];

impl Localiser {
    /// A localiser at the start pose of `settings`, on the map of these walls.
    pub fn new(settings: Settings, walls: &[WallPoint]) -> Self {
        let spot = |wall: &WallPoint| Spot {
            at: wall.at,
            normal: wall.normal,
            is_joined: false,
        };
        let mapper = Mapper::new(Settings {
            noise: SLACK * settings.noise,
            ..settings
        });
        Self {
            mapper,
            map: walls.iter().map(spot).collect(),
            has_walls: false,
            way: Vec::new(),
            unsure: START.map(|deviation| deviation * deviation),
        }
    }

    /// Processes a scan: determines its pose on the map.
    pub fn take(&mut self, shot: &Shot<'_>) -> Outcome {
        let cloud = Cloud::new(shot.ends);
        let is_first = self.way.is_empty();
        let mut wide = self.mapper.predicted(shot);
        if is_first {
            // The path begins with the first scan, whatever the earlier odometry was.
            wide.pose = self.mapper.settings.start;
        }
        for axis in [0, 1] {
            let variance = wide.deviation[axis] * wide.deviation[axis] + self.unsure[axis];
            wide.deviation[axis] = libm::sqrt(variance).min(LOST[axis]);
        }
        self.look_around(wide.pose);
        let way_m = libm::hypot(shot.moved.x, shot.moved.y);
        let placed = self.mapper.place(&cloud, wide, way_m);
        let outcome = self.mapper.told(&placed);
        let [xx, yy, tt] = [0, 1, 2].map(|axis| outcome.covariance[axis][axis]);
        self.unsure = if outcome.is_doubtful {
            placed
                .prior
                .deviation
                .map(|deviation| deviation * deviation)
        } else {
            [xx.max(yy), tt]
        };
        self.way.push(outcome.pose);
        outcome
    }

    /// Draws the walls around a position, unless they are drawn.
    fn look_around(&mut self, pose: Pose) {
        let [x, y] = self.mapper.walls.middle().map(f64::from);
        let is_near = libm::hypot(pose.x - x, pose.y - y) < OFF_MIDDLE_M;
        if is_near && self.has_walls {
            return;
        }
        #[expect(clippy::cast_possible_truncation, reason = "metres of a building")]
        let middle = [pose.x as f32, pose.y as f32];
        let is_near = |spot: &&Spot| {
            (spot.at[0] - middle[0]).abs() < WALLS_M && (spot.at[1] - middle[1]).abs() < WALLS_M
        };
        let near: Vec<Spot> = self.map.iter().filter(is_near).copied().collect();
        self.mapper.walls.clear(middle);
        let near = Cloud::from_spots(near);
        self.mapper.walls.draw(Pose::default(), &near);
        self.has_walls = true;
    }

    /// The pose of each scan.
    pub fn way(&self) -> &[Pose] {
        &self.way
    }
}
