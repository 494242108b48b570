//! The car's perception and plans, drawn over the world: its path, pose hypotheses, gates, and
//! obstacles that are not on its map.

use firmware_core::robots::apollo13::Apollo13;

use crate::robots::{Overlay, OverlayRole};

/// Maximum number of shown pose hypotheses.
const GUESSES_MAX: usize = 200;

/// All overlays of `program`.
pub(super) fn of(program: &Apollo13) -> Vec<Overlay> {
    [
        plan(program),
        guesses(program),
        gates(program),
        sensed(program),
    ]
    .into()
}

fn plan(program: &Apollo13) -> Overlay {
    let plan = Overlay::new("plan", OverlayRole::Planned);
    let pilot = program.pilot();
    let places = pilot.path().iter().map(|pose| [pose.x_m, pose.y_m]);
    let plan = match pilot.path().is_empty() {
        true => plan,
        false => plan.line(places),
    };
    let goal = pilot.goal().map(|goal| [goal.x_m, goal.y_m]);
    goal.into_iter().fold(plan, Overlay::point)
}

fn guesses(program: &Apollo13) -> Overlay {
    let all = program.particles();
    let step = all.len().div_ceil(GUESSES_MAX).max(1);
    let shown = all.iter().step_by(step).map(|one| one.pose);
    let guesses = Overlay::new("particles", OverlayRole::Guess);
    shown.fold(guesses, |overlay, pose| overlay.point([pose.x_m, pose.y_m]))
}

/// Markers as points, gates as lines between two of them.
fn gates(program: &Apollo13) -> Overlay {
    let gates = Overlay::new("gates", OverlayRole::Mark);
    let markers = program.gates().markers();
    let gates = markers.fold(gates, |overlay, (_, place)| overlay.point(place));
    let found = program.gates().found().into_iter();
    found.fold(gates, Overlay::line)
}

fn sensed(program: &Apollo13) -> Overlay {
    let sensed = Overlay::new("costmap", OverlayRole::Sensed);
    program.in_the_way().fold(sensed, Overlay::point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_core::ackermann::CarPose;
    use firmware_core::robots::apollo13::Config;
    use firmware_core::robots::apollo13::floor::FloorPlan;

    /// An empty floor of 1 m by 1 m: 2000 hypotheses, of which every tenth is shown, and a goal
    /// without a plan.
    #[test]
    fn plan_goal_and_guesses_are_shown() {
        let floor = FloorPlan {
            width: 20,
            cell_m: 0.05,
            origin_m: [0.0; 2],
            obstacles: vec![false; 400],
        };
        let mut program = Apollo13::new(Config {
            floor,
            ..Config::default()
        });
        let x_m = 0.75;
        program.set_goal(Some(CarPose {
            x_m,
            ..CarPose::default()
        }));
        let shown = of(&program);
        let names: Vec<&str> = shown.iter().map(|overlay| overlay.name).collect();
        assert_eq!(names, ["plan", "particles", "gates", "costmap"]);
        assert_eq!(shown[0].points(), [0.75, 0.0]);
        assert_eq!(shown[1].points().len(), 2 * 200);
        assert!(shown[2].is_empty() && shown[3].is_empty());
    }
}
