//! Files and exit code of a run.

use std::process::{Command, Stdio};

use hilrig::picture::Picture;

use super::{Session, shipped, text};

/// Lines of `text` that begin with `start`, without the figures that differ from host to host.
fn lines(text: &str, start: &str) -> Vec<String> {
    text.lines()
        .filter(|line| line.trim_start().starts_with(start))
        .map(str::to_owned)
        .collect()
}

#[test]
fn the_demo_passes_and_leaves_the_whole_folder() {
    let session = Session::new("demo");
    let output = session.hilrig(&["demo", "--out", "out"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(
        lines(text(&output.stdout), "PASS"),
        ["PASS rescue-flat seed 1"]
    );
    assert_eq!(
        lines(text(&output.stderr), "").len(),
        8,
        "a title and seven waypoints"
    );

    let mut files: Vec<String> = std::fs::read_dir(session.folder.join("out"))
        .expect("made")
        .map(|entry| {
            entry
                .expect("readable")
                .file_name()
                .into_string()
                .expect("plain names")
        })
        .collect();
    files.sort();
    let expected = [
        "capture.pcapng",
        "case.toml",
        "display.png",
        "estimate.tum",
        "events.txt",
        "junit.xml",
        "map.pgm",
        "map.png",
        "map.txt",
        "map.yaml",
        "report.html",
        "result.json",
        "true.tum",
    ];
    assert_eq!(files, expected);
    let result: serde_json::Value =
        serde_json::from_str(&session.read("out/result.json")).expect("JSON");
    assert!(session.read("out/report.html").len() < 3_000_000);
    assert_eq!(result["tool"], "hilrig");
    assert_eq!(result["scenario"], "rescue-flat");
    assert_eq!(result["verdict"], "pass");
    assert!(result["metrics"]["pose_rms_mm"].as_f64().expect("a number") <= 30.0);
    assert!(result["checks"].as_array().expect("a list").len() >= 8);
    assert_eq!(result["trace_hash"].as_str().expect("a string").len(), 16);
}

/// A saved case gives the same bytes again, through the files.
#[test]
fn a_saved_case_repeats_the_run() {
    let session = Session::new("case");
    session.write("s.toml", &shipped("empty-room"));
    session.hilrig(&["run", "s.toml", "--seed", "7", "--out", "first"]);
    let output = session.hilrig(&["run", "first/case.toml", "--out", "second"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(
        session.read("first/case.toml"),
        session.read("second/case.toml")
    );
    let hash = |file: &str| {
        let result: serde_json::Value = serde_json::from_str(&session.read(file)).expect("JSON");
        (
            result["trace_hash"].clone(),
            result["map_hash"].clone(),
            result["seed"].clone(),
        )
    };
    assert_eq!(hash("first/result.json"), hash("second/result.json"));
}

/// Wheels of which one slips by a fifth: no waypoint is reached with the required accuracy, and the
/// command prints how to repeat the run.
#[test]
fn a_failed_expectation_is_exit_code_1_and_tells_how_to_repeat() {
    let session = Session::new("fail");
    session.write("s.toml", &shipped("empty-room").replace("= 200", "= 1"));
    let output = session.hilrig(&["run", "s.toml", "--seed", "3", "--junit", "junit.xml"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    assert_eq!(
        lines(text(&output.stderr), "repeat"),
        ["repeat with: hilrig run s.toml --seed 3"]
    );
    let junit = session.read("junit.xml");
    assert!(junit.contains("failures=\"1\""), "{junit}");
    assert!(junit.contains("waypoints-visited"), "{junit}");
}

/// R11: the disk becomes full while the capture is written. The command reports this at once,
/// prints the verdicts nevertheless, and its exit code shows that a file is incomplete.
#[test]
fn a_full_disk_costs_the_files_and_not_the_verdicts() {
    let session = Session::new("full");
    session.write("s.toml", &shipped("empty-room"));
    // No file may be longer than 50 kB; a longer write is an error and does not end the process.
    let full = "trap '' XFSZ; ulimit -f 100; exec \"$0\" run s.toml --out out";
    let mut command = Command::new("sh");
    command.args(["-c", full, env!("CARGO_BIN_EXE_hilrig")]);
    let output = command.current_dir(&session.folder).output();
    let output = output.expect("there is a shell");
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    let (said, told) = (text(&output.stdout), text(&output.stderr));
    assert!(
        said.contains("PASS empty-room") && said.contains("waypoints-visited"),
        "{said}"
    );
    assert!(told.contains("the capture ends here"), "{told}");
    assert!(told.contains("cannot write"), "{told}");
}

/// Trajectories in TUM form have exactly eight columns; evo refuses anything else.
#[test]
fn trajectories_have_eight_columns_and_rising_time() {
    let session = Session::new("tum");
    session.write("s.toml", &shipped("empty-room"));
    session.hilrig(&["run", "s.toml", "--out", "out"]);
    for file in ["out/true.tum", "out/estimate.tum"] {
        let text = session.read(file);
        let rows: Vec<Vec<f64>> = text
            .lines()
            .filter(|line| !line.starts_with('#'))
            .map(|line| {
                line.split(' ')
                    .map(|field| field.parse().expect("a number"))
                    .collect()
            })
            .collect();
        assert!(rows.len() > 50, "{file}");
        assert!(rows.iter().all(|row| row.len() == 8), "{file}");
        assert!(rows.is_sorted_by(|a, b| a[0] < b[0]), "{file}");
    }
}

/// The ROS map has the same values when it is read back: nav2's default free_thresh would turn
/// unknown cells into free ones.
#[test]
fn unknown_stays_unknown_in_the_ros_map() {
    let session = Session::new("ros");
    session.hilrig(&["demo", "--out", "out"]);
    let yaml = session.read("out/map.yaml");
    assert!(yaml.contains("free_thresh: 0.196"), "{yaml}");
    let map = session.folder.join("out/map.pgm");
    let map = Picture::<u8>::read(&map, 90_000).expect("a PGM");
    assert_eq!((map.width(), map.height()), (300, 300));
    // Below the sofa, in the corner of the picture, the map is unknown.
    let corner = map.get(299, 299).expect("inside");
    let occupancy = f64::from(255 - corner) / 255.0;
    assert!(occupancy > 0.196 && occupancy < 0.65, "{corner}");
}

/// U4: a reader that closes the pipe early, such as `head -1`, ends no command and causes no panic
/// message. The pipe is closed before the first write, and the exit code is that of the results.
#[test]
fn u4_a_reader_who_has_seen_enough_ends_no_command() {
    let session = Session::new("pipe");
    session.write("s.toml", &shipped("empty-room"));
    session.hilrig(&["run", "s.toml", "--out", "out"]);
    let commands: [&[&str]; 3] = [
        &["run", "s.toml", "--out", "again"],
        &["fidelity", "xv11"],
        &["map", "diff", "out/map.yaml", "out/map.yaml"],
    ];
    for arguments in commands {
        let mut child = Command::new(env!("CARGO_BIN_EXE_hilrig"))
            .args(arguments)
            .current_dir(&session.folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("ends");
        let told = text(&output.stderr);
        assert!(!told.contains("panicked"), "{arguments:?}: {told}");
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {told}");
    }
    let verdict = session.read("again/result.json");
    assert!(verdict.contains("waypoints-visited"), "{verdict}");
}

/// U10: one scenario given twice has one folder, and the second result would overwrite the first.
#[test]
fn u10_two_runs_never_share_a_folder() {
    let session = Session::new("twice");
    session.write("s.toml", &shipped("empty-room"));
    let output = session.hilrig(&["run", "s.toml", "s.toml", "--out", "dup"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stdout));
    let told = text(&output.stderr);
    assert!(
        told.contains("s.toml and s.toml are both \"empty-room\" with seed"),
        "{told}"
    );
    assert!(!session.path("dup").exists());
}

/// U10: on a full disk, here of 50 kB, an import leaves the earlier file unchanged.
#[test]
fn u10_an_import_is_whole_or_not_there() {
    let session = Session::new("torn");
    session.write("dump.bin", &"x".repeat(200_000));
    session.write("c.pcapng", "the earlier one");
    let full = "trap '' XFSZ; ulimit -f 100; \
        exec \"$0\" import dump.bin --format raw --baud 9600 -o c.pcapng";
    let mut command = Command::new("sh");
    command.args(["-c", full, env!("CARGO_BIN_EXE_hilrig")]);
    let output = command.current_dir(&session.folder).output();
    let output = output.expect("there is a shell");
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert_eq!(session.read("c.pcapng"), "the earlier one");
    assert!(!session.path("c.pcapng.part").exists());
}
