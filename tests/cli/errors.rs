//! Every error message names file, line, field and the expected value; the exit code is 2.

use super::{Session, shipped, text};

/// Runs `scenario`, which must be refused; returns the error message.
fn refusal(name: &str, scenario: &str) -> String {
    let session = Session::new(name);
    session.write("s.toml", scenario);
    let output = session.hilrig(&["run", "s.toml"]);
    let said = text(&output.stderr).to_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

#[test]
fn a_misspelt_key_is_shown_with_its_line() {
    let scenario = shipped("empty-room").replace("duration", "duratoin");
    let said = refusal("key", &scenario);
    let expected = "error: s.toml:6: duratoin: is an unknown key, did you mean \"duration\"? \
                    Expected one of schema, name";
    assert!(said.starts_with(expected), "{said}");
}

#[test]
fn a_time_without_unit_is_refused() {
    let scenario = shipped("empty-room").replace("\"90s\"", "90");
    insta::assert_snapshot!(refusal("unit", &scenario), @r#"error: s.toml:6: duration: is 90, expected a time with its unit such as "90s" or "200ms""#);
}

#[test]
fn a_wrong_unit_is_refused() {
    let scenario = shipped("empty-room").replace("\"90s\"", "\"90y\"");
    insta::assert_snapshot!(refusal("wrong-unit", &scenario), @r#"error: s.toml:6: duration: "90y" is no time, expected a number with its unit such as "90s" or "200ms""#);
}

#[test]
fn a_wall_outside_is_named() {
    let scenario =
        shipped("rescue-flat").replace("[2.90, 2.90], [0.10, 2.90]", "[2.90, 3.90], [0.10, 2.90]");
    insta::assert_snapshot!(refusal("outside", &scenario), @"error: s.toml:38: world.wall[0]: it reaches from (2.9, 0.1) to (2.9, 3.9) m; expected within (0, 0) to (3, 3) m");
}

#[test]
fn a_start_inside_a_wall_is_refused() {
    let scenario = shipped("empty-room").replace("x_m = 1.0, y_m = 1.0", "x_m = 0.3, y_m = 1.0");
    insta::assert_snapshot!(refusal("start", &scenario), @"error: s.toml:16: world.start: at its start (0.3, 1) m the robot stands 0.160 m deep in a surface");
}

#[test]
fn an_unknown_profile_lists_the_known_ones() {
    let device = "[device.lidar.xv11]\nprofile = \"fw9\"\n\n[world]\n";
    let scenario = shipped("empty-room").replace("[world]\n", device);
    insta::assert_snapshot!(refusal("profile", &scenario), @r#"
    error: s.toml:16: device.lidar.xv11.profile: is "fw9", expected one of fw2.1, fw2.4.13386, fw2.6.15295
    "#);
}

/// Firmware 2.1 sends whole turns, which the robot's program cannot decode: the robot stood still
/// without a message.
#[test]
fn a_lidar_that_the_program_cannot_read_is_refused() {
    let device = "[device.lidar.xv11]\nprofile = \"fw2.1\"\n\n[world]\n";
    let scenario = shipped("empty-room").replace("[world]\n", device);
    insta::assert_snapshot!(refusal("old-lidar", &scenario), @"error: s.toml:16: device.lidar.xv11.profile: the rescue robot's program reads packets of 22 bytes, which fw2.4.13386 and fw2.6.15295 send; fw2.1 sends turns of 1446 bytes");
}

#[test]
fn an_unknown_device_lists_the_known_ones() {
    let device = "[device.ldar.xv11]\n\n[world]\n";
    let scenario = shipped("empty-room").replace("[world]\n", device);
    insta::assert_snapshot!(refusal("device", &scenario), @r#"error: s.toml:15: device.ldar: is "ldar", did you mean "lidar"? Expected one of lidar, base, radio, display"#);
}

#[test]
fn a_fault_on_no_link_lists_the_links() {
    let fault = "[[fault]]\nlink = \"bus\"\ndirection = \"to-master\"\nkind = \"drop\"\nrate = 0.1\n\n[world]\n";
    let scenario = shipped("empty-room").replace("[world]\n", fault);
    insta::assert_snapshot!(refusal("fault", &scenario), @r#"
    error: s.toml:16: fault[0].link: is "bus", expected one of lidar, motor, base, radio, pc
    "#);
}

#[test]
fn a_rate_beyond_one_is_refused() {
    let fault = "[[fault]]\nlink = \"base\"\ndirection = \"to-master\"\nkind = \"drop\"\nrate = 10\n\n[world]\n";
    let scenario = shipped("empty-room").replace("[world]\n", fault);
    insta::assert_snapshot!(refusal("rate", &scenario), @"error: s.toml:19: fault[0].rate: is 10, expected a chance per byte from 0 to 1");
}

#[test]
fn a_floor_plan_that_is_not_there_is_named() {
    let scenario = shipped("empty-room").replace(
        "[[world.wall]]",
        "[world.plan]\nyaml = \"flat.yaml\"\n\n[[world.wall]]",
    );
    insta::assert_snapshot!(refusal("plan", &scenario), @"error: s.toml:18: world.plan: cannot read flat.yaml: No such file or directory (os error 2)");
}

#[test]
fn a_schema_of_the_future_is_refused() {
    let scenario = shipped("empty-room").replace("schema = 1", "schema = 2");
    insta::assert_snapshot!(refusal("schema", &scenario), @"error: s.toml:2: schema: is 2, expected 1");
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let output = Session::new("missing").hilrig(&["run", "nowhere.toml"]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(text(&output.stderr), @"error: cannot read scenario nowhere.toml: No such file or directory (os error 2)");
}

#[test]
fn a_file_that_is_no_text_is_refused() {
    let session = Session::new("binary");
    std::fs::write(session.folder.join("s.toml"), [0xFA, 0xA0, 0x80, 0x00]).expect("writable");
    let output = session.hilrig(&["run", "s.toml"]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(text(&output.stderr), @"error: s.toml is no text (expected a scenario or a case)");
}

/// The folder of the results cannot be created: the error comes before the run, not after it.
#[test]
fn a_folder_that_cannot_be_made_is_named() {
    let session = Session::new("out");
    session.write("taken", "a file");
    let output = session.hilrig(&["demo", "--out", "taken/out"]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(text(&output.stderr), @"error: cannot write taken/out: Not a directory (os error 20)");
}

#[test]
fn a_seed_that_is_no_number_names_the_flag() {
    let output = Session::new("seed").hilrig(&["demo", "--seed", "lucky"]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(text(&output.stderr), @r#"
    error: invalid value 'lucky' for '--seed <N>': invalid digit found in string

    For more information, try '--help'.
    "#);
}

#[test]
fn no_command_is_a_question_for_help() {
    let output = Session::new("none").hilrig(&[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("Usage: hilrig [OPTIONS] <COMMAND>"));
}

/// Options of one program under test have no effect on another: each is refused, not ignored.
#[test]
fn options_of_another_program_under_test_are_refused() {
    let session = Session::new("other-program");
    let firmware = &["--firmware", "x.elf", "--board", "cortex-m4"][..];
    let node = &["--node", "exit 0"][..];
    let flat = format!(
        "{}/scenarios/yellow-reactive.toml",
        env!("CARGO_MANIFEST_DIR")
    );
    let bytes = format!("{}/tests/replay/cases/v1.toml", env!("CARGO_MANIFEST_DIR"));
    let of_exec = [
        &["--virtual"][..],
        &["--exec-wait", "10s"],
        &["--exec-may-end"],
        &["--exec-may-idle"],
        &["--exec-needs", "lidar"],
        &["--exec-no-lines"],
        &["--call-cost", "1us"],
        &["--check"],
        &["--trace-calls", "calls.txt"],
        &["--dir", "ports"],
        &["--exec", "true"],
    ];
    let of_firmware = [
        &["--board", "cortex-m4"][..],
        &["--wire", "a=b"],
        &["--gdb", "3333"],
        &["--firmware-may-idle"],
        firmware,
    ];
    let tell = |words: &[&str]| {
        let output = session.hilrig(words);
        let said = text(&output.stderr).to_owned();
        assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
        said
    };
    for (program, others) in [
        (firmware, &of_exec[..]),
        (node, &of_exec),
        (node, &of_firmware),
    ] {
        for other in others {
            let said = tell(&[&["run", &flat], program, other].concat());
            assert!(said.contains("--"), "{other:?}: {said}");
        }
        let said = tell(&[&["run", &bytes][..], program].concat());
        assert!(said.contains("v1.toml is a case of bytes"), "{said}");
    }
    // Wires that lead to the same pin are rejected as well.
    for (wires, expected) in [
        (
            &["--wire", "a=b", "--wire", "a=c"][..],
            "port \"a\" of the rig is connected twice",
        ),
        (
            &["--wire", "lidar=board"],
            "both connected to the port \"board\" of the firmware",
        ),
    ] {
        let said = tell(&[&["run", &flat], firmware, wires].concat());
        assert!(said.contains(expected), "{wires:?}: {said}");
    }
}

/// A robot whose program takes no settings as words on a board.
#[test]
fn settings_that_do_not_reach_a_board_are_refused() {
    let session = Session::new("board-settings");
    session.write("s.toml", &shipped("apollo13-wall"));
    let words = [
        "run",
        "s.toml",
        "--firmware",
        "x.elf",
        "--board",
        "cortex-m4",
    ];
    let output = session.hilrig(&words);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("cannot receive settings on a simulated board"),
        "{said}"
    );
}
