//! The result of a request, without a socket.

use hilrig::realtime::control::obey;
use hilrig::run::Run;
use hilrig::run::check::Status;
use protocols::Instant;

use crate::{in_a_room, start};

fn said(run: &mut Run, request: &str) -> String {
    obey(run, request.as_bytes(), Instant::from_millis(1500)).line()
}

/// `asked` is the time of the clock, `applied` the virtual time.
#[test]
fn a_request_is_answered_with_what_came_of_it() {
    let mut run = start(in_a_room("60s", ""));
    run.go_on_until(Instant::from_millis(1490));
    let add = r#"{"do":"add","fault":{"link":"base","direction":"to-device","kind":"cut"}}"#;
    insta::assert_snapshot!(said(&mut run, add), @r#"{"ok":true,"id":0,"asked":"1500ms","applied":"1490ms"}"#);
    insta::assert_snapshot!(said(&mut run, r#"{"do":"list"}"#), @r#"{"ok":true,"faults":[{"id":0,"state":"active","fault":{"kind":"cut","link":"base","direction":"to-device","from":"1490000001ns"}}]}"#);
    insta::assert_snapshot!(said(&mut run, r#"{"do":"end","id":0}"#), @r#"{"ok":true,"id":0,"asked":"1500ms","applied":"1490ms"}"#);
    insta::assert_snapshot!(said(&mut run, r#"{"do":"end","id":0}"#), @r#"{"ok":false,"key":"id","message":"fault 0 is over already"}"#);
}

/// Bad requests change nothing, and the answer names the expected value.
#[test]
fn a_request_that_makes_no_sense_is_told_what_was_expected() {
    let mut run = start(in_a_room("60s", ""));
    insta::assert_snapshot!(said(&mut run, "cut"), @r#"{"ok":false,"key":"request","message":"expected value at line 1 column 1"}"#);
    insta::assert_snapshot!(said(&mut run, r#"{"do":"begin"}"#), @r#"{"ok":false,"key":"do","message":"is \"begin\", expected one of hello, state, wait, step, pause, resume, speed, press, mission, verdict, quit, add, modem, list, end"}"#);
    insta::assert_snapshot!(said(&mut run, r#"{"do":"list","of":1}"#), @r#"{"ok":false,"key":"of","message":"unknown field `of`, there are no fields"}"#);
    let add =
        r#"{"do":"add","fault":{"link":"base","direction":"to-device","kind":"cut","rat":1}}"#;
    insta::assert_snapshot!(said(&mut run, add), @r#"{"ok":false,"key":"rat","message":"is an unknown key, did you mean \"rate\"? Expected one of kind, link, direction, device, devices, rate, byte, bit, value, len, fifo, by, baud, ppm, ppm_per_s, with, back_as, fault, factor, from, until, lasting, every, count, at_byte, at_frame, when, begins_when, ends_when, stream"}"#);
    let add =
        r#"{"do":"add","fault":{"link":"base","direction":"to-device","kind":"flip","rate":7}}"#;
    insta::assert_snapshot!(said(&mut run, add), @r#"{"ok":false,"key":"rate","message":"is 7, expected a chance per byte from 0 to 1"}"#);
    let add = r#"{"do":"add","fault":{"link":"sonar","direction":"to-device","kind":"cut"}}"#;
    insta::assert_snapshot!(said(&mut run, add), @r#"{"ok":false,"key":"link","message":"is \"sonar\", expected one of lidar, motor, base, radio, pc"}"#);
    assert_eq!(run.faults().count(), 0);
}

/// A person walks at 0.5 m/s into a standing robot: 0.31 m centre to centre on contact, 0.59 m from
/// the start of the walk. Both speeds are reported, and the contact is not the robot's fault.
#[test]
fn who_ran_into_whom_is_told() {
    let person = "[[world.moving]]\npath_m = [[0.6, 1.2], [1.3, 1.2]]\nspeed_m_s = 0.5\n\
                  radius_m = 0.15\n";
    let mut run = start(in_a_room("10s", person));
    run.go_on_until(Instant::from_secs(5));
    let state = obey(&mut run, br#"{"do":"state"}"#, Instant::from_secs(5)).line();
    let state: serde_json::Value = serde_json::from_str(&state).expect("JSON");
    assert_eq!(state["contacts"]["count"], 1, "{state}");
    let contact = &state["contacts"]["new"][0];
    let number = |key: &str| contact[key].as_f64().expect("a number");
    assert!((number("at_ns") / 1e9 - 1.18).abs() < 0.002, "{contact}");
    assert!((number("speed_m_s") - 0.5).abs() < 1e-6, "{contact}");
    assert_eq!(number("own_m_s"), 0.0);
    let checks = run.checks();
    let check = checks
        .iter()
        .find(|check| check.name == "no-collision-at-speed");
    let check = check.expect("it is always judged");
    assert_eq!(check.status, Status::Pass);
    assert_eq!(check.detail, "1 contacts, none at more than 0.05 m/s");
}
