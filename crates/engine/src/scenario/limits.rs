//! Limits of figures that no other check rejects.

use std::collections::BTreeSet;

use emulators::world::PRIMITIVES_MAX;

use super::{Action, Expect, Flaw, GoldenSpec, Scenario, ScenarioError, Source};

/// Maximum distance from the origin, metres.
const FAR_M: f64 = 10_000.0;
/// Maximum angle, degrees; more than ten turns are a mistake.
const TURN_DEG: f64 = 3_600.0;

/// Checks the length of `source`. Parsing a shape needs kilobytes of memory before the scene can
/// reject it.
pub(super) fn check_text(source: &Source) -> Result<(), ScenarioError> {
    // Each shape has one of these keys in any form of its table.
    let keys = ["path_m", "corners_m", "at_m"];
    let found: usize = keys
        .iter()
        .map(|key| source.text.matches(key).count())
        .sum();
    if found > PRIMITIVES_MAX {
        let message = format!("has {found} shapes, expected at most {PRIMITIVES_MAX}");
        return Err(source.invalid(source.find("world"), "world", message));
    }
    Ok(())
}

/// Checks that the start and all waypoints are within the maximum distance, and that the
/// expectations are possible. Adds the errors to `problems`, except for tables that already have an
/// error.
pub(super) fn check(scenario: &Scenario, source: &Source, problems: &mut Vec<ScenarioError>) {
    // A wrong value was replaced; its table and those around it say nothing about the file.
    let wrong: Vec<String> = problems
        .iter()
        .map(|error| error.key().to_owned())
        .collect();
    let mut found = Vec::new();
    check_run(scenario, source, &mut found);
    check_start(scenario, source, &mut found);
    check_expectations(scenario, source, &mut found);
    check_rules(scenario, source, &mut found);
    check_mission(scenario, source, &mut found);
    check_faults(scenario, source, &mut found);
    found.retain(|error| {
        let (key, table) = (error.key(), table_of(error.key()));
        let is_of = |wrong: &String| wrong.starts_with(key) || table_of(wrong) == table;
        !wrong.iter().any(is_of)
    });
    problems.extend(found);
}

/// The table of a key.
fn table_of(key: &str) -> &str {
    key.rsplit_once('.').map_or(key, |(table, _)| table)
}

/// A run of no length, and programs without a command, do nothing.
fn check_run(scenario: &Scenario, source: &Source, found: &mut Vec<ScenarioError>) {
    if scenario.duration.0.is_zero() {
        let message = "is 0, expected a longer time";
        found.push(source.invalid(source.find("duration"), "duration", message));
    }
    for (name, spec) in &scenario.exec {
        if spec.command.trim().is_empty() {
            let key = format!("exec.{name}.command");
            let message = "is empty, expected the shell command that starts the program";
            found.push(source.invalid(source.find("command"), &key, message));
        }
    }
}

fn check_start(scenario: &Scenario, source: &Source, found: &mut Vec<ScenarioError>) {
    let start = &scenario.world.start;
    let at = start.get_ref();
    for (key, value, most) in [
        ("x_m", at.x_m, FAR_M),
        ("y_m", at.y_m, FAR_M),
        ("heading_deg", at.heading_deg, TURN_DEG),
    ] {
        if !(-most..=most).contains(&value) {
            let message = format!("is {}, expected -{most} to {most}", shown(value));
            found.push(source.invalid(Some(start.span()), format!("world.start.{key}"), message));
        }
    }
}

fn check_expectations(scenario: &Scenario, source: &Source, found: &mut Vec<ScenarioError>) {
    for (key, value, most) in bounded(&scenario.expect) {
        if value.is_some_and(|value| !(0.0..=most).contains(&value)) {
            let value = shown(value.unwrap_or_default());
            let message = match most.is_finite() {
                true => format!("is {value}, expected 0 to {most}"),
                false => format!("is {value}, expected at least 0"),
            };
            found.push(source.invalid(source.find(key), format!("expect.{key}"), message));
        }
    }
    if let Some(Err(flaw)) = scenario.expect.golden.as_ref().map(GoldenSpec::check) {
        let span = source.find(flaw.key);
        let key = format!("expect.golden.{}", flaw.key);
        found.push(source.invalid(span, key, flaw.message));
    }
}

fn check_mission(scenario: &Scenario, source: &Source, found: &mut Vec<ScenarioError>) {
    if let Some(message) = beyond(&scenario.mission.waypoints_m) {
        let span = source.find("waypoints_m");
        found.push(source.invalid(span, "mission.waypoints_m", message));
    }
    for (index, step) in scenario.mission.step.iter().enumerate() {
        if let Err(flaw) = step.check() {
            let span = source.find_in_list("mission.step", index, "do");
            let key = format!("mission.step[{index}].{}", flaw.key);
            found.push(source.invalid(span, key, flaw.message));
        }
        if let Action::WaypointsM(waypoints) = &step.action
            && let Some(message) = beyond(waypoints)
        {
            let span = source.find_in_list("mission.step", index, "do");
            let key = format!("mission.step[{index}].do.waypoints-m");
            found.push(source.invalid(span, key, message));
        }
    }
}

/// Checks the ends of faults, before phases set them.
fn check_faults(scenario: &Scenario, source: &Source, found: &mut Vec<ScenarioError>) {
    for (index, fault) in scenario.fault.iter().enumerate() {
        if let Err(flaw) = fault.check_end() {
            let span = source.find_in_list("fault", index, flaw.key);
            let key = format!("fault[{index}].{}", flaw.key);
            found.push(source.invalid(span, key, flaw.message));
        }
    }
}

/// Checks each rule, and that no two have one name.
fn check_rules(scenario: &Scenario, source: &Source, found: &mut Vec<ScenarioError>) {
    let mut names = BTreeSet::new();
    for (index, spanned) in scenario.expect.rule.iter().enumerate() {
        let rule = spanned.get_ref();
        let is_new = names.insert(rule.check_name());
        let flaw = match rule.check() {
            Err(flaw) => flaw,
            Ok(()) if is_new => continue,
            Ok(()) => {
                let message = format!("is \"{}\" once more, expected another name", rule.name);
                Flaw::new("name", message)
            }
        };
        let key = format!("expect.rule[{index}].{}", flaw.key);
        let span = source.find_in_list("expect.rule", index, flaw.key);
        let span = span.or(Some(spanned.span()));
        found.push(source.invalid(span, key, flaw.message));
    }
}

/// Figures of `[expect]` with their maximum; the minimum is 0.
fn bounded(expect: &Expect) -> [(&'static str, Option<f64>, f64); 9] {
    let far = f64::INFINITY;
    [
        ("visit_within_mm", expect.visit_within_mm, far),
        ("return_within_mm", expect.return_within_mm, far),
        ("home_within_mm", expect.home_within_mm, far),
        ("explored_min", expect.explored_min, 1.0),
        ("victims_within_mm", expect.victims_within_mm, far),
        ("pose_rms_mm_max", expect.pose_rms_mm_max, far),
        ("heading_rms_deg_max", expect.heading_rms_deg_max, far),
        ("wall_overlap_min", expect.wall_overlap_min, 1.0),
        ("wall_within_mm", expect.wall_within_mm, 1_000.0),
    ]
}

/// Error for the first waypoint that is too far away.
fn beyond(waypoints: &[[f64; 2]]) -> Option<String> {
    let is_far = |place: &[f64; 2]| place.iter().any(|m| !(-FAR_M..=FAR_M).contains(m));
    let index = waypoints.iter().position(is_far)?;
    let [x, y] = waypoints[index];
    Some(format!(
        "waypoint {index} is {}, {}, expected -{FAR_M} to {FAR_M}",
        shown(x),
        shown(y),
    ))
}

/// A figure for messages: a large one as a power of ten.
fn shown(figure: f64) -> String {
    if figure.is_finite() && figure.abs() >= 1e9 {
        format!("{figure:e}")
    } else {
        figure.to_string()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::scenario::Scenario;

    fn refused(start: &str, mission: &str) -> String {
        let text = format!(
            "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"1s\"\n{mission}\n\
             [world]\nstart = {start}\n"
        );
        let parsed = Scenario::parse(Path::new("t.toml"), text);
        parsed.expect_err("refused").to_string()
    }

    const START: &str = "{ x_m = 1, y_m = 1, heading_deg = 0 }";

    #[test]
    fn a_start_beyond_the_horizon_is_refused() {
        insta::assert_snapshot!(
            refused("{ x_m = 1e300, y_m = 1, heading_deg = 0 }", ""),
            @r#"t.toml:7: world.start.x_m: is 1e300, expected -10000 to 10000"#
        );
        insta::assert_snapshot!(
            refused("{ x_m = 1, y_m = nan, heading_deg = 0 }", ""),
            @r#"t.toml:7: world.start.y_m: is NaN, expected -10000 to 10000"#
        );
        insta::assert_snapshot!(
            refused("{ x_m = 1, y_m = 1, heading_deg = inf }", ""),
            @r#"t.toml:7: world.start.heading_deg: is inf, expected -3600 to 3600"#
        );
    }

    /// A push by such an angle once panicked or never ended. A number without other limits must be
    /// finite.
    #[test]
    fn numbers_that_no_quantity_has_are_refused() {
        let push = |turn: &str| {
            let push = "[[world.push]]\nat = \"1s\"\nover = \"1s\"\nby_m = [0, 0]\nturn_deg = ";
            format!(
                "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"1s\"\n\
                 [world]\nstart = {START}\n{push}{turn}\n"
            )
        };
        for turn in ["nan", "-inf"] {
            let error = Scenario::from_text(&push(turn)).expect_err("refused");
            let said = format!("world.push[0].turn_deg: is {turn}, expected a finite number");
            assert!(error.to_string().ends_with(&said), "{error}");
        }
        let (scenario, source) = Scenario::from_text(&push("1e30")).expect("well-formed");
        let error = crate::run::Run::new(scenario, &source, None)
            .err()
            .expect("refused");
        let said = "world.push[0].turn_deg: is 1e30, expected -36000 to 36000";
        assert!(error.to_string().ends_with(said), "{error}");
    }

    /// A share in per cent could never be reached, and a negative one always is.
    #[test]
    fn what_cannot_come_true_is_not_expected() {
        insta::assert_snapshot!(
            refused(START, "[expect]\nwall_overlap_min = 90"),
            @r#"t.toml:6: expect.wall_overlap_min: is 90, expected 0 to 1"#
        );
        insta::assert_snapshot!(
            refused(START, "[expect]\nvisit_within_mm = -5"),
            @r#"t.toml:6: expect.visit_within_mm: is -5, expected at least 0"#
        );
        insta::assert_snapshot!(
            refused(START, "[expect]\nwall_within_mm = nan"),
            @r#"t.toml:6: expect.wall_within_mm: is NaN, expected 0 to 1000"#
        );
    }

    /// Each of these values was once accepted and had no effect.
    #[test]
    fn what_lasts_no_time_or_starts_nothing_is_refused() {
        let head = "schema = 1\nname = \"t\"\nrobot = \"none\"\nduration = ";
        let device = "[device.m.text]\nbaud = 9600\n[[device.m.text.command]]\n\
                      request = \"a\"\nreply = \"b\"\n";
        let fault = "[[fault]]\nlink = \"m\"\ndirection = \"to-master\"\n";
        for (rest, expected) in [
            (format!("\"0s\"\n{device}"), "t.toml:4: duration: is 0"),
            (
                format!("\"1s\"\n{device}[exec.p]\ncommand = \" \"\n"),
                "exec.p.command: is empty",
            ),
            (
                format!("\"1s\"\n{device}{fault}kind = \"clog\"\nlasting = \"0s\"\n"),
                "fault[0].lasting: is 0",
            ),
            (
                format!(
                    "\"1s\"\n{device}{fault}kind = \"cut\"\nuntil = \"9s\"\nlasting = \"1s\"\n"
                ),
                "fault[0].lasting: is 1s beside until = \"9s\", expected one of them",
            ),
            (
                "\"1s\"\n[device.m.text]\nbaud = 9600\nwatchdog = \"0s\"\ncommand = []\n"
                    .to_owned(),
                "t.toml:7: device.m.text.watchdog: is 0s and would expire at once",
            ),
            (
                "\"1s\"\n[device.m.registers]\nbaud = 9600\nidle_gap = \"0s\"\nregister = []\n"
                    .to_owned(),
                "t.toml:7: device.m.registers.idle_gap: is 0s and would end each frame",
            ),
            (
                format!("\"1s\"\n{device}{fault}kind = \"burst\"\nrate = 0.1\nvalue = 0\n"),
                "fault[0].value: is 0, which changes no bit",
            ),
        ] {
            let text = format!("{head}{rest}");
            let parsed = Scenario::parse(Path::new("t.toml"), text);
            let said = match parsed {
                Err(error) => error.to_string(),
                Ok((scenario, source)) => match crate::run::Run::new(scenario, &source, None) {
                    Err(error) => error.to_string(),
                    Ok(_) => panic!("accepted: {expected}"),
                },
            };
            assert!(said.contains(expected), "{said}");
        }
    }

    /// A million walls once took 3.2 GB to reject.
    #[test]
    fn more_walls_than_a_scene_can_have_are_refused_before_they_are_read() {
        let walls = "[[world.wall]]\npath_m = [[0, 0], [1, 0]]\n".repeat(200_001);
        let text = format!(
            "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"1s\"\n\
             [world]\nstart = {START}\n{walls}"
        );
        let parsed = Scenario::parse(Path::new("t.toml"), text);
        insta::assert_snapshot!(
            parsed.expect_err("refused"),
            @"t.toml:5: world: has 200001 shapes, expected at most 200000"
        );
    }

    #[test]
    fn a_waypoint_beyond_the_horizon_is_refused() {
        insta::assert_snapshot!(
            refused(START, "[mission]\nwaypoints_m = [[1, 1], [inf, 2]]"),
            @r#"t.toml:6: mission.waypoints_m: waypoint 1 is inf, 2, expected -10000 to 10000"#
        );
        let step = "[[mission.step]]\nat = \"1s\"\ndo = { waypoints-m = [[10001, 0]] }";
        insta::assert_snapshot!(
            refused(START, step),
            @r#"t.toml:7: mission.step[0].do.waypoints-m: waypoint 0 is 10001, 0, expected -10000 to 10000"#
        );
    }
}
