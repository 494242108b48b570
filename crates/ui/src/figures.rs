//! Figures for plots: errors of the pose, axes, and numbers in the robot's panels.

use serde::Serialize;

use engine::robots::{Axis, Panel};
use engine::run::Run;

/// The identity of a figure.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Series {
    /// The group, e.g. a panel.
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
    /// Three decimals suffice for a plot.
    fn new(group: &str, name: &str, unit: &str, value: f64) -> Self {
        Self {
            series: Series::new(group, name, unit),
            value: (value * 1000.0).round() / 1000.0 + 0.0,
        }
    }
}

/// The parts of the difference between the true and the believed pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Gap {
    /// Time of the believed pose, nanoseconds.
    pub(super) at_ns: u64,
    /// True pose of the robot at that time.
    pub(super) truth: [f64; 3],
    /// Distance between the two poses at that time, mm.
    pub(super) error_mm: f64,
    /// Difference between the two headings at that time, degrees.
    pub(super) error_deg: f64,
    /// Age of the believed pose, ms.
    pub(super) lag_ms: f64,
    /// Distance that the robot has moved since, mm.
    pub(super) went_mm: f64,
}

/// Time for which the world stores true poses, ms; an older believed pose is not compared.
const TRAIL_MS: f64 = 250.0;

/// The current difference; `None` without a believed pose, or if it is too old.
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

/// All current figures of `run`.
pub(super) fn all(run: &Run) -> Vec<Figure> {
    let mut all = Vec::new();
    if let Some(gap) = gap(run) {
        all.push(Figure::new("error", "position error", "mm", gap.error_mm));
        all.push(Figure::new("error", "heading error", "deg", gap.error_deg));
        all.push(Figure::new(
            "error",
            "age of the estimate",
            "ms",
            gap.lag_ms,
        ));
    }
    let instruments = run.instruments();
    all.extend(instruments.axes(&run.rig).iter().flat_map(of_axis));
    all.extend(of_panels(&instruments.panels(&run.rig)));
    all
}

/// The numbers in panels.
pub(super) fn of_panels(panels: &[Panel]) -> Vec<Figure> {
    panels.iter().flat_map(of_panel).collect()
}

fn of_axis(axis: &Axis) -> impl Iterator<Item = Figure> + use<> {
    let told = Figure::new(
        "axes",
        &format!("{} set-point", axis.name),
        axis.unit,
        axis.set_point,
    );
    let does = axis.actual;
    let does =
        does.map(|value| Figure::new("axes", &format!("{} actual", axis.name), axis.unit, value));
    [told].into_iter().chain(does)
}

/// Values other than numbers are skipped.
fn of_panel(panel: &Panel) -> impl Iterator<Item = Figure> + '_ {
    panel.rows.iter().filter_map(|row| {
        let value: f64 = row.value.parse().ok()?;
        value
            .is_finite()
            .then(|| Figure::new(&panel.name, &row.name, &row.unit, value))
    })
}

/// A pose with the visible digits: millimetres, and about a twentieth of a degree.
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
