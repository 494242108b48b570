//! The figures of a run, for result file and report.

use core::time::Duration;

use schemars::JsonSchema;
use serde::Serialize;

use crate::run::Outcome;

/// Figures of a run.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Metrics {
    /// Virtual time, seconds.
    pub sim_s: f64,
    /// Time that it took, seconds.
    pub wall_s: f64,
    /// How many times faster than real time.
    pub speedup: f64,
    /// Root mean square of the position error, mm.
    pub pose_rms_mm: Option<f64>,
    /// Worst position error, mm.
    pub pose_max_mm: Option<f64>,
    /// Root mean square of the heading error, degrees.
    pub heading_rms_deg: Option<f64>,
    /// Share of walls found and of found walls right, the smaller one.
    pub wall_overlap: Option<f64>,
    /// Share of the walls seen that are in the map.
    pub walls_found: Option<f64>,
    /// Share of the walls in the map that are there.
    pub walls_right: Option<f64>,
    /// Waypoints visited in order.
    pub waypoints_visited: usize,
    /// Waypoints of the mission.
    pub waypoints: usize,
    /// Rules of devices that the program broke.
    pub violations: u64,
}

impl Metrics {
    /// The figures of `outcome`, which took `wall`.
    pub fn of(outcome: &Outcome, wall: Duration) -> Self {
        let (sim_s, wall_s) = (outcome.ran.as_secs_f64(), wall.as_secs_f64());
        let rounded = |value: f64| (value * 1e4).round() / 1e4;
        let (error, walls) = (outcome.pose_error, outcome.wall_overlap);
        Self {
            sim_s: rounded(sim_s),
            wall_s: rounded(wall_s),
            speedup: (sim_s / wall_s.max(1e-6)).round(),
            pose_rms_mm: error.map(|error| rounded(error.rms_mm)),
            pose_max_mm: error.map(|error| rounded(error.max_mm)),
            heading_rms_deg: error.map(|error| rounded(error.rms_deg)),
            wall_overlap: walls.map(|walls| rounded(walls.least())),
            walls_found: walls.map(|walls| rounded(walls.found)),
            walls_right: walls.map(|walls| rounded(walls.right)),
            waypoints_visited: outcome.waypoints[0],
            waypoints: outcome.waypoints[1],
            violations: outcome.violations,
        }
    }
}
