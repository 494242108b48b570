//! Rules of a scenario in generated missions and worlds.

use engine::scenario::{Condition, Quantity, Scenario};

/// Removes the rules whose conditions name replaced items: waypoints beyond the number of the
/// mission, and, in a generated world, places.
pub(super) fn keep_fitting(made: &mut Scenario, has_new_world: bool) {
    let waypoints = made.mission.waypoints_m.len();
    let is_gone = |condition: &Condition| match condition {
        Condition::Visited(count) => *count > waypoints,
        Condition::Pose(_) => has_new_world,
        Condition::Robot(robot) => has_new_world && matches!(robot.of, Quantity::XM | Quantity::YM),
        _ => false,
    };
    made.expect.rule.retain(|rule| {
        let mut conditions = rule.get_ref().conditions();
        !conditions.any(|(_, condition)| condition.has(&is_gone))
    });
}
