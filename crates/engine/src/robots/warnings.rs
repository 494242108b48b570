//! Warnings: keys without effect, and objects that the robot's map cannot hold.

use super::{Robot, ignored, rates};
use crate::scenario::{Scenario, ScenarioError, Source};

/// Maximum distance of a wall outside the map, metres: the last cell of a map is drawn from inside.
const SLACK_M: f64 = 0.05;

/// The warnings of a scenario in `source`.
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
