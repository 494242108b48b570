//! The page of a rig in real time: `--ui` of `up` and of `run --realtime`.

use std::fs;
use std::process::Command;

use serde_json::json;

use super::server::{Process, Server, folder, scenario};

/// The page controls the rig's own PC program, but not the clock, which is the wall clock; the case
/// contains the actions.
#[test]
fn a_rig_on_ports_is_shown_and_steered() {
    let dir = folder("live");
    let case = dir.join("case.toml");
    let (dir, case_path) = (dir.join("ports"), case.to_str().expect("plain letters"));
    let dir = dir.to_str().expect("plain letters");
    let room = scenario("empty-room");
    let up = ["up", &*room, "--ui", "--dir", dir, "--case", case_path];
    let mut up = Server::of_process(Process::start(&up));
    let _program = Process::start(&["dut", "--dir", dir]);
    let mut page = up.page().expect("there is room");
    let stage = page.hear("stage", |_| true).expect("shown");
    assert_eq!([&stage["pace"], &stage["pc"]], [false, true]);

    let now = page.hear("now", |now| !now["pc"]["size_mm"].is_null());
    assert!(now.expect("shown")["truth"].is_array());
    // The program runs elsewhere: its believed pose is the one that it sends.
    page.hear("now", |now| now["believed"].is_array());
    assert!(page.send(r#"{"do":"pause"}"#));
    let refused = page.hear("refused", |_| true).expect("told");
    assert!(
        refused["why"]
            .as_str()
            .is_some_and(|why| why.contains("wall clock")),
        "{refused}"
    );
    page.send(r#"{"do":"clear"}"#);
    page.send(r#"{"do":"add","at":[900,1200]}"#);
    page.hear("now", |now| {
        now["pc"]["confirmed"] == true && now["pc"]["waypoints"] == json!([[900, 1200]])
    });
    let fault = r#"{"link":"base","direction":"to-master","kind":"flip","rate":0.05}"#;
    page.send(&format!(r#"{{"do":"fault","fault":{fault}}}"#));
    page.hear("slow", |slow| {
        let lanes = slow["lanes"].as_array().expect("all links");
        let base = lanes.iter().find(|lane| lane["name"] == "base");
        base.expect("there is one")["to-master"]["tally"]["faults"].as_u64() > Some(0)
    });
    assert!(up.process().end());
    let case = fs::read_to_string(case).expect("was written");
    assert!(
        case.contains("[[fault]]") && case.contains("[[mission.step]]"),
        "{case}"
    );
}

/// A judged run may be watched: the page sees its start and progress, and the verdict does not
/// change.
#[test]
fn a_judged_run_in_real_time_is_shown() {
    let dir = folder("judged");
    let (room, out) = (scenario("empty-room"), dir.join("out"));
    let out = out.to_str().expect("plain letters");
    let run = ["run", &*room, "--realtime", "--ui", "--out", out];
    let mut run = Server::of_process(Process::start(&run));
    let mut page = run.page().expect("there is room");
    let stage = page.hear("stage", |_| true).expect("shown");
    assert_eq!(stage["name"], "empty-room");
    assert!(
        page.hear("now", |now| now["at_ns"].as_u64() > Some(500_000_000))
            .is_some()
    );
    // A signal ends the run shortly before its mission is done; the run is judged nevertheless.
    assert!(!run.process().end());
    assert!(dir.join("out/result.json").exists());
}

/// A run in virtual time is over before a page can show it.
#[test]
fn a_page_beside_a_run_in_virtual_time_is_refused_with_advice() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    command.args(["run", &scenario("empty-room"), "--ui"]);
    let output = command.output().expect("runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("--ui") && said.contains("--realtime"),
        "{said}"
    );
}
