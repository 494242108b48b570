//! Checks that missions and rooms fit the robot's map.

use core::ops::Range;

use super::conditions::Moment;
use super::{Robot, Wired, ignored, rates};
use crate::near;
use crate::rig::Rig;
use crate::scenario::{Action, Flaw, Scenario, ScenarioError, Source};

/// Maximum distance of a wall outside the map, metres: the last cell of a map is drawn from inside.
const SLACK_M: f64 = 0.05;

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

/// Keys in `source` without effect, and objects that the robot's map cannot hold.
pub fn warnings(scenario: &Scenario, source: &Source) -> Vec<ScenarioError> {
    let mut found = warnings_of_one(scenario, source);
    found.extend(ignored::of_nothing(scenario, source));
    for (name, member, part) in scenario.members(source) {
        let own = warnings_of_one(&member, &part).into_iter();
        let own = own.map(|warning| warning.of_member(&name));
        // The world is that of the file, whose warnings are known.
        found.extend(own.filter(|warning| !warning.key().starts_with("world")));
    }
    found
}

fn warnings_of_one(scenario: &Scenario, source: &Source) -> Vec<ScenarioError> {
    let mut warnings = scenario.warnings(source);
    let robot = super::find(&scenario.robot);
    if let Some(robot) = robot {
        warnings.extend(ignored::warnings(robot, scenario, source));
        warnings.extend(rates::warnings(robot, scenario, source));
    }
    let map = robot.and_then(Robot::map_m);
    let Some([least, most]) = map else {
        return warnings;
    };
    let is_in = |&[x, y]: &[f64; 2]| {
        let fits = |value: f64, axis: usize| {
            (least[axis] - SLACK_M..=most[axis] + SLACK_M).contains(&value)
        };
        fits(x, 0) && fits(y, 1)
    };
    // An object outside the world is an error.
    let is_in_world = |&[x, y]: &[f64; 2]| {
        scenario.world.bounds.as_ref().is_none_or(|bounds| {
            let ([from_x, from_y], [to_x, to_y]) = (bounds.min_m, bounds.max_m);
            (from_x..=to_x).contains(&x) && (from_y..=to_y).contains(&y)
        })
    };
    let objects = scenario.world.outlines(source).into_iter();
    let mut outside =
        objects.filter(|(.., points)| points.iter().all(is_in_world) && !points.iter().all(is_in));
    if let Some((key, span, _)) = outside.next() {
        let message = format!(
            "reaches beyond the robot's map of {}, {} to {}, {} m: objects outside are not \
             drawn, and the robot does not plan there",
            least[0], least[1], most[0], most[1]
        );
        warnings.push(source.invalid(Some(span), key, message));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An object of each kind reaches 3.5 m, the map of the robot ends at 3 m. The same object
    /// inside gives no warning.
    #[test]
    fn objects_of_each_kind_beyond_the_map_are_named() {
        let rows = [
            (
                "[[world.wall]]\npath_m = [[1, 1], [X, 1]]",
                "wall[0].path_m",
            ),
            (
                "[[world.polygon]]\ncorners_m = [[2, 1], [X, 1], [X, 2]]",
                "polygon[0].corners_m",
            ),
            (
                "[[world.pillar]]\nat_m = [[X, 1]]\nradius_m = 0.1",
                "pillar[0].at_m",
            ),
            (
                "[[world.moving]]\npath_m = [[1, 2], [X, 2]]\nspeed_m_s = 0.1\nradius_m = 0.1",
                "moving[0].path_m",
            ),
            ("[world.maze]\ncolumns = Y\nrows = 5", "maze"),
        ];
        for (object, key) in rows {
            let warned = |x: &str, columns: &str| {
                let object = object.replace('X', x).replace('Y', columns);
                let text = format!(
                    "schema = 1\nname = \"r\"\nrobot = \"rescue\"\nduration = \"1s\"\n\
                     [world]\nstart = {{ x_m = 0.4, y_m = 0.4, heading_deg = 0 }}\n{object}\n"
                );
                let (scenario, source) = Scenario::from_text(&text).expect("sound");
                let found = warnings(&scenario, &source).into_iter();
                found.map(|one| one.to_string()).collect::<Vec<_>>()
            };
            let [told] = &warned("3.5", "7")[..] else {
                panic!("{object}: {:?}", warned("3.5", "7"));
            };
            assert!(
                told.contains(&format!("world.{key}: reaches beyond")),
                "{told}"
            );
            assert!(told.contains("robot's map of 0, 0 to 3, 3 m"), "{told}");
            assert_eq!(warned("2.5", "5"), [""; 0], "{object}");
        }
    }
}
