//! What a request comes to, without any socket.

use hilrig::realtime::control::obey;
use hilrig::run::Run;
use protocols::Instant;

use crate::{in_a_room, start};

fn said(run: &mut Run, request: &str) -> String {
    obey(run, request.as_bytes(), Instant::from_millis(1500)).line()
}

/// `asked` is what the clock said, `applied` where the virtual time was.
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

/// Bad requests change nothing, and the answer says what was expected.
#[test]
fn a_request_that_makes_no_sense_is_told_what_was_expected() {
    let mut run = start(in_a_room("60s", ""));
    insta::assert_snapshot!(said(&mut run, "cut"), @r#"{"ok":false,"key":"request","message":"expected value at line 1 column 1"}"#);
    insta::assert_snapshot!(said(&mut run, r#"{"do":"begin"}"#), @r#"{"ok":false,"key":"do","message":"is \"begin\", expected one of hello, state, wait, step, pause, resume, speed, press, mission, verdict, quit, add, modem, list, end"}"#);
    insta::assert_snapshot!(said(&mut run, r#"{"do":"list","of":1}"#), @r#"{"ok":false,"key":"of","message":"unknown field `of`, there are no fields"}"#);
    let add =
        r#"{"do":"add","fault":{"link":"base","direction":"to-device","kind":"cut","rat":1}}"#;
    insta::assert_snapshot!(said(&mut run, add), @r#"{"ok":false,"key":"rat","message":"unknown field `rat`, expected one of `kind`, `link`, `direction`, `device`, `devices`, `rate`, `byte`, `bit`, `value`, `len`, `fifo`, `by`, `baud`, `ppm`, `ppm_per_s`, `with`, `fault`, `factor`, `from`, `until`, `lasting`, `every`, `count`, `at_byte`, `at_frame`, `when`, `stream`"}"#);
    let add =
        r#"{"do":"add","fault":{"link":"base","direction":"to-device","kind":"flip","rate":7}}"#;
    insta::assert_snapshot!(said(&mut run, add), @r#"{"ok":false,"key":"rate","message":"expected a chance per byte from 0 to 1"}"#);
    let add = r#"{"do":"add","fault":{"link":"sonar","direction":"to-device","kind":"cut"}}"#;
    insta::assert_snapshot!(said(&mut run, add), @r#"{"ok":false,"key":"link","message":"is \"sonar\", expected one of lidar, motor, base, radio, pc"}"#);
    assert_eq!(run.faults().count(), 0);
}
