//! The figures of a run, for result file and report.

use core::time::Duration;

use schemars::JsonSchema;
use serde::Serialize;

use engine::run::Outcome;

/// Figures of a run.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Metrics {
    /// Virtual time, seconds.
    pub sim_s: f64,
    /// Time that it took, seconds.
    pub wall_s: f64,
    /// Ratio of virtual time to real time.
    pub speedup: f64,
    /// Root mean square of the position error, mm.
    pub pose_rms_mm: Option<f64>,
    /// Worst position error, mm.
    pub pose_max_mm: Option<f64>,
    /// Root mean square of the heading error, degrees.
    pub heading_rms_deg: Option<f64>,
    /// The smaller one of `walls_found` and `walls_right`.
    pub wall_overlap: Option<f64>,
    /// Share of the seen walls that are in the map.
    pub walls_found: Option<f64>,
    /// Share of the walls in the map that exist in the world.
    pub walls_right: Option<f64>,
    /// Waypoints visited in order.
    pub waypoints_visited: usize,
    /// Waypoints of the mission.
    pub waypoints: usize,
    /// Rules of devices that the program broke.
    pub violations: u64,
}

impl Metrics {
    /// Figures of `outcome`, whose run took `wall`.
    pub fn of(outcome: &Outcome, wall: Duration) -> Self {
        let (sim_s, wall_s) = (outcome.ran.as_secs_f64(), wall.as_secs_f64());
        let rounded = |value: f64| (value * 1e4).round() / 1e4;
        let (error, walls) = (outcome.pose_error, outcome.wall_overlap);
        Self {
            sim_s: rounded(sim_s),
            wall_s: rounded(wall_s),
            speedup: rounded(sim_s / wall_s.max(1e-6)),
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

/// Formats a factor as `523`, `9.8` or `0.26`: two significant digits below ten, so that a small
/// factor does not become zero.
pub fn factor(value: f64) -> String {
    let places = match value {
        10.0.. => 0,
        1.0..10.0 => 1,
        0.1..1.0 => 2,
        _ => 3,
    };
    format!("{value:.places$}")
}

#[cfg(test)]
mod tests {
    use super::factor;

    #[test]
    fn little_is_not_nothing() {
        let shown = [523.4, 9.84, 0.256, 0.004, 0.0].map(factor);
        assert_eq!(shown, ["523", "9.8", "0.26", "0.004", "0.000"]);
    }
}
