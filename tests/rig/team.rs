//! Several robots in one world and one file.

use hilrig::robots::{self, Dut, PcEnd};
use hilrig::run::check::Status;
use hilrig::run::{Outcome, Run};
use hilrig::scenario::{Scenario, Source};
use hilrig::show::report;
use protocols::Instant;

use super::{failures, shipped};
use crate::thorough::few;

const TEAM: &str = "yellow-team";

/// The shipped scenario with `added` before the table of its further robot.
fn with(added: &str) -> (Scenario, Source) {
    let (_, source) = shipped(TEAM);
    let head = "[team.blue]\n";
    let text = source.text.replacen(head, &format!("{added}\n{head}"), 1);
    Scenario::parse(&source.path, text).expect("sound")
}

fn run(scenario: &Scenario, source: &Source) -> Run {
    Run::new(scenario.clone(), source, None).expect("can be wired")
}

/// x of the first robot after 5 s.
fn x_at_5_s(outcome: &Outcome) -> f64 {
    let mut path = outcome.truth.iter();
    let at = path.find(|(at, _)| *at >= Instant::from_secs(5));
    at.expect("the run is longer").1.x
}

/// Two robots leave one labyrinth without a contact, with any seed. The middle of the second one
/// stands 0.95 m ahead, and both have a radius of 0.12 m: the first one stops before x = 0.96 m
/// and waits. The checks name the robot. The same run has the same bytes.
#[test]
fn two_yellows_leave_one_labyrinth_without_a_contact() {
    for seed in few(2, 1..=20) {
        let (mut scenario, source) = shipped(TEAM);
        scenario.seed = seed;
        let outcome = run(&scenario, &source).finish();
        assert_eq!(failures(&outcome), [""; 0], "seed {seed}");
        let x = x_at_5_s(&outcome);
        assert!((0.85..0.96).contains(&x), "seed {seed}: {x}");
        let named = outcome.checks.iter();
        let mut named = named.filter(|check| check.name == "blue/waypoints-visited");
        assert!(named.any(|check| check.status == Status::Pass));
        if seed == 1 {
            let again = run(&outcome.case, &source).finish();
            assert_eq!(again.trace_hash, outcome.trace_hash);
            let origin = outcome.case.origin.as_ref().expect("a saved case");
            assert_eq!(origin.trace_hash, outcome.trace_hash);
            let alone = outcome.team.iter().map(|(_, end)| &end.trace_hash);
            assert!(alone.into_iter().all(|hash| *hash != outcome.trace_hash));
            let [all, own] = [&outcome, &outcome.team[0].1].map(report::html);
            let link = "<a href=\"team/blue/report.html\">blue</a>";
            assert!(all.contains(link) && !own.contains(link));
        }
    }
}

/// Without the second robot the first one drives on, 0.3 m/s.
#[test]
fn a_robot_alone_does_not_wait() {
    let (mut scenario, source) = shipped(TEAM);
    scenario.team.clear();
    scenario.duration = hilrig::scenario::Span(core::time::Duration::from_secs(6));
    let outcome = run(&scenario, &source).finish();
    assert!(x_at_5_s(&outcome) > 1.2, "{}", x_at_5_s(&outcome));
}

/// A robot whose infrared sensors and lidar are blind from 3 s to 4.5 s drives into the other one:
/// both have a contact, and only the one that drove fails.
#[test]
fn a_robot_that_does_not_see_the_other_one_runs_into_it() {
    let blind = "[[fault]]\nkind = \"device\"\ndevice = \"board\"\nfault = \"blind\"\n\
                 from = \"3s\"\nlasting = \"1500ms\"\n[[fault]]\nkind = \"device\"\n\
                 device = \"lidar\"\nfault = \"dark\"\nfrom = \"3s\"\nlasting = \"1500ms\"\n";
    let (scenario, source) = with(blind);
    let outcome = run(&scenario, &source).finish();
    let failed = failures(&outcome);
    assert!(failed[0].starts_with("no-collision-at-speed"), "{failed:?}");
    let is_of_blue = |check: &&String| check.starts_with("blue/");
    assert_eq!(failed.iter().find(is_of_blue), None);
    let met = |outcome: &Outcome| {
        let check = outcome.checks.iter();
        let mut check = check.filter(|check| check.name == "no-collision-at-speed");
        check.next().expect("checked").detail.clone()
    };
    let (name, blue) = &outcome.team[0];
    assert!(met(blue).starts_with("1 contacts"), "{}", met(blue));
    assert_eq!(
        (name.as_str(), outcome.passed(), blue.passed()),
        ("blue", false, true)
    );
}

/// A run from a checkpoint at any time, and in other pieces, has the same end. Faults of the
/// further robot change its own bytes.
#[test]
fn a_team_continues_from_a_checkpoint() {
    let (mut scenario, source) = shipped(TEAM);
    scenario.duration = hilrig::scenario::Span(core::time::Duration::from_secs(7));
    let whole = run(&scenario, &source).finish();
    let mut pieces = run(&scenario, &source);
    pieces.go_on_until(Instant::from_nanos(4_500_300_000));
    let checkpoint = pieces.checkpoint().expect("plain state");
    for run in [checkpoint.resume(), pieces, checkpoint.resume()] {
        let end = run.finish();
        assert_eq!(end.trace_hash, whole.trace_hash);
        assert_eq!(failures(&end), failures(&whole));
    }
    let fault = "[[team.blue.fault]]\nkind = \"cut\"\nlink = \"lidar\"\n\
                 direction = \"to-master\"\nfrom = \"6s\"\n";
    let (mut faulted, source) = with(fault);
    faulted.duration = scenario.duration;
    let faulted = run(&faulted, &source).finish();
    assert_ne!(faulted.team[0].1.trace_hash, whole.team[0].1.trace_hash);
    let bytes = |outcome: &Outcome| {
        let check = outcome.checks.iter();
        let mut check = check.filter(|check| check.name == "bytes-conserved");
        check.next().expect("checked").detail.clone()
    };
    assert_eq!(bytes(&faulted), bytes(&whole));
}

/// Each error names its line, its key in the file, and the fix.
#[test]
fn errors_of_a_further_robot_have_the_lines_of_the_file() {
    let (_, source) = shipped(TEAM);
    let place = "x_m = 1.2, y_m = 0.25";
    let expect = "[team.blue.expect]";
    let rows = [
        (
            place,
            "x_m = 0.4, y_m = 0.25",
            "start: stands in another robot",
        ),
        (
            place,
            "x_m = 1.2, y_m = 0.05",
            "start: at its start (1.2, 0.05) m the robot stands",
        ),
        (
            place,
            "x_m = 1e9, y_m = 0",
            "start.x_m: is 1e9, expected -10000 to 10000",
        ),
        (
            expect,
            "[team.blue.device.lidar.xv11]\n[team.blue.expect]",
            "device.lidar: is of kind xv11",
        ),
        (
            expect,
            "[team.blue.world]\n[team.blue.expect]",
            "world: is an unknown key",
        ),
        (
            expect,
            "[team.blue.chassis.differential]\n[team.blue.expect]",
            "chassis: expected none",
        ),
        (
            expect,
            "[[team.blue.fault]]\nkind = \"cut\"\nlink = \"lidr\"\n\
             direction = \"to-master\"\n[team.blue.expect]",
            "fault[0].link: is \"lidr\", did you mean \"lidar\"?",
        ),
        (
            "visit_within_mm = 200\nviolations",
            "visit_within_mm = -1\nviolations",
            "expect.visit_within_mm: is -1",
        ),
        (
            "robot = \"yellow\"\nstart",
            "robot = \"none\"\nstart",
            "robot: is \"none\", expected a robot",
        ),
        (
            "robot = \"yellow\"\nstart",
            "robot = \"yelow\"\nstart",
            "robot: is \"yelow\", did you mean \"yellow\"?",
        ),
        (
            "at = \"4500ms\"\ndo = { mode = \"reactive\"",
            "at = \"4500ms\"\ndo = { mode = \"rea\"",
            "mission.step[0].do: mode \"rea\"",
        ),
    ];
    for (old, new, told) in rows {
        let at = source.text.rfind(old).expect("in the file");
        let text = format!(
            "{}{new}{}",
            &source.text[..at],
            &source.text[at + old.len()..]
        );
        let parsed = Scenario::parse(&source.path, text.clone());
        let wired = parsed.and_then(|(scenario, source)| Run::new(scenario, &source, None));
        let error = wired.map(|_| new).expect_err("wrong").to_string();
        let line = 1 + text[..at].matches('\n').count() + new.matches('\n').count();
        let lines = line.saturating_sub(2)..=line;
        let has_line = lines
            .into_iter()
            .any(|line| error.contains(&format!("yellow-team.toml:{line}: team.blue.{told}")));
        assert!(has_line, "line {line} team.blue.{told}:\n{error}");
    }
}

/// Users of the rig of one robot refuse the file instead of running half of it.
#[test]
fn other_commands_refuse_several_robots() {
    let (scenario, source) = shipped(TEAM);
    for dut in [Dut::Internal, Dut::External] {
        let wired = robots::wire(&scenario, &source, dut, PcEnd::Scripted);
        let error = wired.map(|_| ()).expect_err("refused").to_string();
        assert!(error.contains("team: expected none here"), "{error}");
    }
}
