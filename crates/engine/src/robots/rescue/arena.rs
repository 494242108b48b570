//! The properties of generated worlds and missions that suit the robot.

use crate::robots::Arena;

/// The map of the robot is 3 m wide. The robot keeps a distance of 4.5 cm to obstacles, and its
/// planner uses cells of 3 cm. A third of its speed of 227 mm/s leaves time for turns and new
/// plans.
pub(super) const ARENA: Arena = Arena {
    side_m: 3.0,
    margin_m: 0.13,
    pace_m_s: 0.075,
    passage_mm: [700, 1000],
    obstacle_mm: [25, 120],
};

/// Situations that a campaign must cause: possible events on each link.
pub(super) const SITUATIONS: [&str; 14] = [
    "lidar packets lost",
    "lidar packets bad",
    "lidar turns skipped",
    "lidar silences",
    "base retries",
    "base failures",
    "base silences",
    "base unsolicited",
    "base errors",
    "base bad frames",
    "encoder readings disbelieved",
    "radio bad frames",
    "radio frames without meaning",
    "waypoints reached",
];
