//! What can be plotted of a run: errors of the pose, axes, and whatever the robot's panels say in
//! numbers.

use serde::Serialize;

use engine::robots::{Axis, Panel};
use engine::run::Run;

/// What a figure is of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Series {
    /// What belongs together, e.g. a panel.
    group: String,
    name: String,
    unit: String,
}

impl Series {
    pub(super) fn new(group: &str, name: &str, unit: &str) -> Self {
        Self {
            group: group.to_owned(),
            name: name.to_owned(),
            unit: unit.to_owned(),
        }
    }
}

/// One figure at one time.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Figure {
    pub(super) series: Series,
    pub(super) value: f64,
}

impl Figure {
    /// Three places are enough for the eye.
    fn new(group: &str, name: &str, unit: &str, value: f64) -> Self {
        Self {
            series: Series::new(group, name, unit),
            value: (value * 1000.0).round() / 1000.0 + 0.0,
        }
    }
}

/// What the difference between the true and the believed pose is made of.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Gap {
    /// When the belief held, nanoseconds.
    pub(super) at_ns: u64,
    /// Where the robot truly was at that time.
    pub(super) truth: [f64; 3],
    /// How far apart the two were at that time, mm.
    pub(super) error_mm: f64,
    /// And by how much they looked another way, degrees.
    pub(super) error_deg: f64,
    /// How old the belief is, ms.
    pub(super) lag_ms: f64,
    /// How far the robot went since, mm.
    pub(super) went_mm: f64,
}

/// The world knows where the robot was so long ago, ms; an older belief is not compared.
const TRAIL_MS: f64 = 250.0;

/// The gap now; `None` without a belief, or if that is too old to be compared.
pub(super) fn gap(run: &Run) -> Option<Gap> {
    let (at, believed) = run.estimate()?;
    let (now, world) = (run.rig.now(), &run.rig.world);
    let lag_ms = (now - at).as_secs_f64() * 1000.0;
    if at > now || lag_ms > TRAIL_MS {
        return None;
    }
    let then = world.pose_at(at);
    let turned = emulators::world::wrap_angle(believed.theta - then.theta);
    let mm = |metres: f64| (metres * 10_000.0).round() / 10.0;
    Some(Gap {
        at_ns: at.as_nanos(),
        truth: short_pose(then),
        error_mm: mm(then.point().distance(believed.point())),
        error_deg: (turned.abs().to_degrees() * 100.0).round() / 100.0,
        lag_ms: lag_ms.round(),
        went_mm: mm(world.pose().point().distance(then.point())),
    })
}

/// All figures of `run` now.
pub(super) fn all(run: &Run) -> Vec<Figure> {
    let mut all = Vec::new();
    if let Some(gap) = gap(run) {
        all.push(Figure::new("error", "position error", "mm", gap.error_mm));
        all.push(Figure::new("error", "heading error", "deg", gap.error_deg));
        all.push(Figure::new(
            "error",
            "lag of the estimate",
            "ms",
            gap.lag_ms,
        ));
    }
    let instruments = run.instruments();
    all.extend(instruments.axes(&run.rig).iter().flat_map(of_axis));
    all.extend(of_panels(&instruments.panels(&run.rig)));
    all
}

/// What panels say in numbers.
pub(super) fn of_panels(panels: &[Panel]) -> Vec<Figure> {
    panels.iter().flat_map(of_panel).collect()
}

fn of_axis(axis: &Axis) -> impl Iterator<Item = Figure> + use<> {
    let told = Figure::new(
        "axes",
        &format!("{} told", axis.name),
        axis.unit,
        axis.set_point,
    );
    let does = axis.actual;
    let does =
        does.map(|value| Figure::new("axes", &format!("{} does", axis.name), axis.unit, value));
    [told].into_iter().chain(does)
}

/// What is no number is no figure.
fn of_panel(panel: &Panel) -> impl Iterator<Item = Figure> + '_ {
    panel.rows.iter().filter_map(|row| {
        let value: f64 = row.value.parse().ok()?;
        value
            .is_finite()
            .then(|| Figure::new(&panel.name, &row.name, &row.unit, value))
    })
}

/// A number with as many digits as can be seen: millimetres, and about a twentieth of a degree.
pub(super) fn short_pose(pose: emulators::world::Pose) -> [f64; 3] {
    [pose.x, pose.y, pose.theta].map(show::view::millimetres)
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::robots::PanelRow;

    #[test]
    fn numbers_of_a_panel_are_figures_and_words_are_none() {
        let row = |name: &'static str, value: &str| PanelRow {
            name: name.into(),
            address: None,
            value: value.to_owned(),
            unit: "V".into(),
        };
        let panel = Panel {
            name: "board".to_owned(),
            rows: vec![
                row("state", "idle"),
                row("supply", "11.90004"),
                row("odd", "NaN"),
            ],
        };
        let figures: Vec<Figure> = of_panel(&panel).collect();
        assert_eq!(figures, [Figure::new("board", "supply", "V", 11.9)]);
    }
}
