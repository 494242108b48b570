//! Checks that missions and rooms fit the robot's map.

use core::ops::Range;

use super::conditions::Moment;
use super::{Robot, Wired};
use crate::near;
use crate::rig::Rig;
use crate::scenario::{Action, Flaw, Scenario, ScenarioError, Source};

/// Checks that all waypoints lie on the robot's map.
///
/// # Errors
/// The first waypoint outside: the robot cannot drive there.
pub(super) fn check_waypoints(
    robot: &dyn Robot,
    scenario: &Scenario,
    source: &Source,
) -> Result<(), ScenarioError> {
    let Some(map) = robot.map_m() else {
        return Ok(());
    };
    if let Some(message) = beyond(map, &scenario.mission.waypoints_m) {
        let span = source.find("waypoints_m");
        return Err(source.invalid(span, "mission.waypoints_m", message));
    }
    for (index, step) in scenario.mission.step.iter().enumerate() {
        if let Action::WaypointsM(waypoints) = &step.action
            && let Some(message) = beyond(map, waypoints)
        {
            let span = source.find_in_list("mission.step", index, "do");
            let key = format!("mission.step[{index}].do.waypoints-m");
            return Err(source.invalid(span, key, message));
        }
    }
    Ok(())
}

/// Checks that the links of `[expect.safety]` exist.
///
/// # Errors
/// The first unknown link.
pub(super) fn check_safety_links(
    rig: &Rig,
    scenario: &Scenario,
    source: &Source,
) -> Result<(), ScenarioError> {
    let Some(spec) = &scenario.expect.safety else {
        return Ok(());
    };
    let unknown = spec.links().find(|(_, link)| rig.link(link).is_none());
    let Some((key, link)) = unknown else {
        return Ok(());
    };
    let known: Vec<&str> = rig.links().iter().map(|link| &*link.name).collect();
    let message = near::expected(link, &known);
    Err(source.invalid(source.find(key), format!("expect.safety.{key}"), message))
}

/// A list of the file, an index in it, and its position if that is known.
type Entry<'a> = (&'a str, usize, Option<Range<usize>>);

/// Checks that the robot has the items that the conditions of rules and steps name.
///
/// # Errors
/// All unknown names.
pub(super) fn check_conditions(
    wired: &Wired,
    scenario: &Scenario,
    source: &Source,
) -> Result<(), ScenarioError> {
    let moment = Moment {
        rig: &wired.rig,
        instruments: &*wired.instruments,
        axes: None,
        devices: &scenario.device,
        waypoints: [0, scenario.mission.waypoints_m.len()],
    };
    let mut wrong = Vec::new();
    let mut check = |checked: Result<(), Flaw>, (list, index, place): Entry<'_>, key: &str| {
        if let Err(flaw) = checked {
            let span = source.find_in_list(list, index, key).or(place);
            let key = format!("{list}[{index}].{key}.{}", flaw.key);
            wrong.push(source.invalid(span, key, flaw.message));
        }
    };
    for (index, spanned) in scenario.expect.rule.iter().enumerate() {
        for (key, condition) in spanned.get_ref().conditions() {
            let place = ("expect.rule", index, Some(spanned.span()));
            check(moment.check(condition), place, key);
        }
    }
    for (index, fault) in scenario.fault.iter().enumerate() {
        for (key, condition) in fault.conditions() {
            check(moment.check(condition), ("fault", index, None), key);
        }
        if let (Some(_), Ok(Some(condition))) = (&fault.when, fault.begin_condition()) {
            // The keys of `when` have other names than those of the condition.
            let checked = moment.check(&condition).map_err(|flaw| {
                let key = fault
                    .when
                    .as_ref()
                    .map_or(flaw.key, |when| when.key_of(flaw.key));
                Flaw::new(key, flaw.message)
            });
            check(checked, ("fault", index, None), "when");
        }
    }
    for (index, step) in scenario.mission.step.iter().enumerate() {
        let entry = ("mission.step", index, None);
        check(moment.check_action(&step.action), entry.clone(), "do");
        if let Some(condition) = &step.when {
            check(moment.check(condition), entry, "when");
        }
    }
    ScenarioError::none_of(wrong)
}

/// The error if one of the waypoints of the robot called `name` is outside its map.
pub(crate) fn beyond_map(name: &str, places: &[[f64; 2]]) -> Option<String> {
    let map = super::find(name).and_then(Robot::map_m)?;
    beyond(map, places)
}

fn beyond([least, most]: [[f64; 2]; 2], places: &[[f64; 2]]) -> Option<String> {
    let is_in =
        |&[x, y]: &[f64; 2]| (least[0]..=most[0]).contains(&x) && (least[1]..=most[1]).contains(&y);
    let index = places.iter().position(|place| !is_in(place))?;
    let [[x, y], [from_x, from_y], [to_x, to_y]] = [places[index], least, most];
    Some(format!(
        "waypoint {index} is {x}, {y}, outside the robot's map, expected {from_x}, {from_y} to \
         {to_x}, {to_y}"
    ))
}
