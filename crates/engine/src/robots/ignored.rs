//! Keys of a scenario that its robot does not read: each is a warning.

use super::Robot;
use crate::scenario::world::BodySpec;
use crate::scenario::{Condition, NO_ROBOT, ProgramSpec, Scenario, ScenarioError, Source};

/// Keys of `[program]` that only the rescue robot reads.
#[cfg(feature = "robots")]
pub(super) const OF_RESCUE: [&str; 5] = [
    "program.mapper",
    "program.cpu",
    "program.diagnosis",
    "program.radio_baud",
    "program.tuning",
];

/// Keys of `[program]` that only yellow reads.
pub(super) const OF_YELLOW: [&str; 2] = ["program.map", "program.votes"];

/// Keys of `[expect.safety]` about the counters, orders and pose of a built-in program: the rig
/// cannot observe them in your own program.
const OF_BUILT_IN: [&str; 10] = [
    "expect.safety.true_telemetry",
    "expect.safety.true_counts",
    "expect.safety.sends_cyclically",
    "expect.safety.asks_again",
    "expect.safety.true_complaints",
    "expect.safety.says_within",
    "expect.safety.pose_within_mm",
    "expect.safety.motion_within_percent",
    "expect.safety.short_turns",
    "expect.safety.obeys_within",
];

/// Keys of `[expect.safety]` about a body that moves.
const OF_BODY: [&str; 4] = [
    "expect.safety.rests_within",
    "expect.safety.commands_within",
    "expect.safety.by_hand",
    "expect.safety.contacts_until",
];

/// The keys and tables of `scenario` that `robot` ignores.
pub(super) fn warnings(
    robot: &dyn Robot,
    scenario: &Scenario,
    source: &Source,
) -> Vec<ScenarioError> {
    let (program, usual) = (&scenario.program, ProgramSpec::default());
    let safety = scenario.expect.safety.clone().unwrap_or_default();
    let of_safety = [
        safety.true_telemetry,
        safety.true_counts,
        safety.sends_cyclically,
        safety.asks_again,
        safety.true_complaints,
        safety.says_within.is_some(),
        safety.pose_within_mm.is_some(),
        safety.motion_within_percent.is_some(),
        safety.short_turns,
        safety.obeys_within.is_some(),
    ];
    let given = [
        ("program.mapper", program.mapper != usual.mapper),
        ("program.cpu", program.cpu != usual.cpu),
        ("program.diagnosis", program.diagnosis),
        ("program.radio_baud", program.radio_baud.is_some()),
        ("program.tuning", program.tuning.is_some()),
        ("program.map", program.map.is_some()),
        ("program.votes", program.votes.is_some()),
        ("world.body", scenario.world.body != BodySpec::default()),
        ("mission.connect", !scenario.mission.connects_as_usual()),
    ];
    let ignored = robot.ignores(scenario);
    let given = given
        .into_iter()
        .chain(OF_BUILT_IN.into_iter().zip(of_safety));
    let given = given.filter(|(_, is_given)| *is_given);
    let is_foreign = !robot.takes_orders();
    let given =
        given.filter(|(key, _)| ignored.contains(key) || is_foreign && OF_BUILT_IN.contains(key));
    let of_body = [
        safety.rests_within.is_some(),
        safety.commands_within.is_some(),
        safety.by_hand,
        safety.contacts_until.is_some(),
    ];
    let of_body = OF_BODY.into_iter().zip(of_body);
    let of_body = of_body.filter(|(_, is_given)| *is_given && scenario.robot == NO_ROBOT);
    let given = given.chain(of_body);
    let unjudged = is_foreign.then(|| {
        let waypoints = of_unjudged_waypoints(scenario, source);
        waypoints.into_iter().chain(of_orders(scenario, source))
    });
    let ignored = given.map(|(key, _)| {
        let span = source.find(key.rsplit('.').next().unwrap_or(key));
        let message = match (OF_BUILT_IN.contains(&key), OF_BODY.contains(&key)) {
            (true, _) => "has no effect: it cannot be observed in your own program".to_owned(),
            (_, true) => "has no effect: the scenario has no robot that moves".to_owned(),
            _ => format!("has no effect: the robot \"{}\" ignores it", robot.name()),
        };
        source.invalid(span, key, message)
    });
    ignored.chain(unjudged.into_iter().flatten()).collect()
}

/// Orders of a robot whose link of orders is unknown.
fn of_orders(scenario: &Scenario, source: &Source) -> Option<ScenarioError> {
    let safety = scenario.expect.safety.as_ref()?;
    (safety.sound_orders && safety.orders_link.is_none()).then(|| {
        let message = "has no effect without orders_link: the link that carries the orders to your \
                       own program is unknown";
        let span = source.find("sound_orders");
        source.invalid(span, "expect.safety.sound_orders", message)
    })
}

/// Waypoints of a robot that gets no orders, if no expectation or condition counts them.
fn of_unjudged_waypoints(scenario: &Scenario, source: &Source) -> Option<ScenarioError> {
    fn counts(condition: &Condition) -> bool {
        match condition {
            Condition::Visited(_) => true,
            Condition::All(parts) | Condition::Any(parts) => parts.iter().any(counts),
            Condition::Not(inner) => counts(inner),
            _ => false,
        }
    }
    let is_counted = scenario.expect.visit_within_mm.is_some()
        || scenario
            .conditions()
            .any(|(.., condition)| counts(condition));
    (!is_counted && !scenario.mission.waypoints_m.is_empty()).then(|| {
        let message = "has no effect: your own program gets no orders, and nothing judges the \
                       waypoints; set expect.visit_within_mm";
        let span = source.find("waypoints_m");
        source.invalid(span, "mission.waypoints_m", message)
    })
}

/// Limits of random faults without such a fault, and an order of less than two waypoints.
pub(super) fn of_nothing(scenario: &Scenario, source: &Source) -> Vec<ScenarioError> {
    let members = scenario.team.values().flat_map(|member| &member.fault);
    let has_random = { scenario.fault.iter().chain(members) }.any(|fault| fault.rate.is_some());
    let mut found = Vec::new();
    if scenario.budget.is_some() && !has_random {
        let message = "has no effect: no fault of the scenario has a rate";
        found.push(source.invalid(source.find("budget"), "budget", message));
    }
    if scenario.mission.any_order && scenario.mission.waypoints_m.len() < 2 {
        let message = "has no effect: the mission has less than two waypoints";
        found.push(source.invalid(source.find("any_order"), "mission.any_order", message));
    }
    found
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::{OF_BODY, OF_BUILT_IN};
    use crate::robots;
    use crate::scenario::Scenario;

    const WORLD: &str = "[world]\nstart = { x_m = 1, y_m = 1, heading_deg = 0 }\n";

    /// The keys of all warnings for a robot with `more`.
    fn keys(robot: &str, more: &str) -> Vec<String> {
        let head = "schema = 1\nname = \"t\"\nduration = \"5s\"\n";
        let world = if robot == "none" { "" } else { WORLD };
        let text = format!("{head}robot = \"{robot}\"\n{more}\n{world}");
        let parsed = Scenario::parse(Path::new("t.toml"), text);
        let (scenario, source) = parsed.expect("sound");
        let warnings = robots::warnings(&scenario, &source).into_iter();
        warnings
            .map(|warning| {
                let said = warning.to_string();
                assert!(
                    said.starts_with("t.toml:") && said.contains("has no effect"),
                    "{said}"
                );
                warning.key().to_owned()
            })
            .collect()
    }

    /// Each key alone, for each robot: a warning where the robot ignores the key, else none.
    #[test]
    fn keys_that_a_robot_ignores_are_warnings() {
        let rows = [
            (
                "[program]\nmapper = \"document\"",
                "program.mapper",
                "rescue",
            ),
            ("[program]\ncpu = \"ideal\"", "program.cpu", "rescue"),
            ("[program]\ndiagnosis = true", "program.diagnosis", "rescue"),
            (
                "[program]\nradio_baud = 9600",
                "program.radio_baud",
                "rescue",
            ),
            ("[program.tuning]\nsmear = true", "program.tuning", "rescue"),
            ("[program]\nmap = \"map.yaml\"", "program.map", "yellow"),
            ("[program]\nvotes = \"added\"", "program.votes", "yellow"),
            (
                "[world.body]\naxle_m = 0.2",
                "world.body",
                "rescue yellow custom",
            ),
            (
                "[mission]\nconnect = \"1s\"",
                "mission.connect",
                "rescue yellow apollo13",
            ),
            ("[budget]\ntotal = 9", "budget", ""),
            ("[mission]\nany_order = true", "mission.any_order", ""),
        ];
        for (more, key, readers) in rows {
            for robot in ["rescue", "yellow", "apollo13", "custom"] {
                // For other robots, a table [program] is an error.
                if robot == "custom" && key.starts_with("program") {
                    continue;
                }
                let expected: &[&str] = match readers.split(' ').any(|reader| reader == robot) {
                    true => &[],
                    false => &[key],
                };
                assert_eq!(keys(robot, more), expected, "{robot}: {more}");
            }
        }
        for key in OF_BODY {
            let name = key.rsplit('.').next().expect("a key");
            let value = if name == "by_hand" { "true" } else { "\"2s\"" };
            let more = format!("[expect.safety]\n{name} = {value}");
            assert_eq!(keys("none", &more), [key]);
            assert_eq!(keys("custom", &more), [""; 0]);
        }
        for key in OF_BUILT_IN {
            let name = key.rsplit('.').next().expect("a key");
            let value = match name {
                "pose_within_mm" | "motion_within_percent" => "9",
                "says_within" | "obeys_within" => "\"2s\"",
                _ => "true",
            };
            let more = format!("[expect.safety]\n{name} = {value}");
            assert_eq!(keys("custom", &more), [key]);
            assert_eq!(keys("rescue", &more), [""; 0], "{key}");
        }
        let orders = "[expect.safety]\nsound_orders = true\n";
        assert_eq!(keys("custom", orders), ["expect.safety.sound_orders"]);
        let named = format!("{orders}orders_link = \"pc\"");
        assert_eq!(keys("custom", &named), [""; 0]);
        let way = "[mission]\nwaypoints_m = [[1.5, 1.5]]\n";
        assert_eq!(keys("custom", way), ["mission.waypoints_m"]);
        assert_eq!(keys("rescue", way), [""; 0]);
        for judge in [
            "[expect]\nvisit_within_mm = 90",
            "[[expect.rule]]\nname = \"r\"\neventually = { any = [{ visited = 1 }] }",
        ] {
            assert_eq!(keys("custom", &format!("{way}{judge}")), [""; 0], "{judge}");
        }
        let car = "[world.body]\naxle_m = 0.2\n[chassis.ackermann]";
        assert_eq!(keys("custom", car), ["world.body"]);
        let meter = "[device.meter]\ndescription = \"modbus-meter\"\n[mission]\nconnect = \"1s\"";
        assert_eq!(keys("none", meter), ["mission.connect"]);
        let random = "[budget]\ntotal = 9\n[[fault]]\nkind = \"flip\"\nlink = \"lidar\"\n\
                      direction = \"to-master\"\nrate = 0.1";
        assert_eq!(keys("rescue", random), [""; 0]);
        let both = "[mission]\nany_order = true\nwaypoints_m = [[1.0, 1.5], [1.5, 1.5]]";
        assert_eq!(keys("rescue", both), [""; 0]);
    }
}
