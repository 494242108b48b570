//! Mapping from a robot's links: from its capture, and from the MCAP file made of it.

use std::path::Path;

use crate::command::{Session, text};

/// Forty seconds of the L-shaped room, run and saved in `run`.
fn driven(name: &str) -> Session {
    let session = Session::new(name);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/l-shape.toml");
    let scenario = std::fs::read_to_string(path).expect("it is there");
    let short = scenario.replace("duration = \"90s\"", "duration = \"40s\"");
    assert_ne!(short, scenario);
    session.write("short.toml", short.as_bytes());
    // The robot does not reach all its waypoints, so the run fails; only the capture is needed.
    session.hilrig(&["run", "short.toml", "--out", "run"]);
    assert!(session.has("run/capture.pcapng"));
    session
}

/// Output of the command, which must succeed.
fn done(session: &Session, arguments: &[&str]) -> [String; 2] {
    let output = session.hilrig(arguments);
    let said = [&output.stdout, &output.stderr].map(|bytes| text(bytes).to_owned());
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {said:?}");
    said
}

/// Maximum distance (m) of a trajectory from another at the nearest time.
fn farthest(session: &Session, way: &str, truth: &str) -> f64 {
    let poses = |name: &str| -> Vec<[f64; 3]> {
        let numbers = |line: &str| -> Option<Vec<f64>> {
            line.split(' ').map(|field| field.parse().ok()).collect()
        };
        let text = session.read(name);
        let lines = text.lines().filter_map(numbers);
        lines
            .map(|fields| [fields[0], fields[1], fields[2]])
            .collect()
    };
    let truth = poses(truth);
    let mut worst = 0.0_f64;
    for [at, x, y] in poses(way) {
        let after = truth.partition_point(|pose| pose[0] < at);
        let [_, tx, ty] = truth[after.min(truth.len() - 1)];
        worst = worst.max(libm::hypot(x - tx, y - ty));
    }
    worst
}

/// The turns and counts are those of the robot's program: they give its map, and the true path.
#[test]
fn a_robots_capture_and_its_mcap_give_the_runs_map() {
    let session = driven("links");
    let [said, _] = done(
        &session,
        &[
            "slam",
            "run",
            "--mode",
            "core",
            "--cell-mm",
            "10",
            "--out",
            "capture",
        ],
    );
    assert!(
        said.contains(" scans, 0 skipped, 0 doubtful, 0 ambiguous"),
        "{said}"
    );
    let off = farthest(&session, "capture/trajectory.tum", "run/true.tum");
    assert!(off < 0.05, "{off} m off");
    let [said, _] = done(
        &session,
        &[
            "map",
            "diff",
            "run/map.yaml",
            "capture/map.yaml",
            "--wall-mm-max",
            "10",
            "--overlap-min",
            "0.95",
        ],
    );
    println!("{said}");
    mcap_gives_the_same(&session);
}

#[cfg(not(feature = "mcap"))]
fn mcap_gives_the_same(_session: &Session) {}

/// The MCAP file has the same bytes at the same times, so the results are equal. Cut in half, it
/// gives the first half.
#[cfg(feature = "mcap")]
fn mcap_gives_the_same(session: &Session) {
    done(session, &["export", "run", "-o", "run.mcap"]);
    done(
        session,
        &[
            "slam",
            "run.mcap",
            "--mode",
            "core",
            "--cell-mm",
            "10",
            "--out",
            "mcap",
        ],
    );
    let of_mcap = session.read("mcap/trajectory.tum");
    assert!(of_mcap == session.read("capture/trajectory.tum"));

    let whole = session.bytes("run.mcap");
    session.write("cut.mcap", &whole[..whole.len() / 2]);
    let [said, told] = done(
        session,
        &[
            "slam",
            "cut.mcap",
            "--mode",
            "core",
            "--cell-mm",
            "10",
            "--out",
            "cut",
        ],
    );
    assert!(told.contains("skipped 1 cut-off messages"), "{told}");
    assert!(said.contains(" scans, 1 skipped,"), "{said}");
    let of_cut = session.read("cut/trajectory.tum");
    assert!(of_cut.len() > 1000 && of_cut.len() < of_mcap.len());
}

#[test]
fn a_capture_of_an_unknown_robot_asks_for_its_scenario() {
    let session = Session::new("links-unknown");
    session.write("short.pcapng", b"\x0A\x0D\x0D\x0A");
    let output = session.hilrig(&["slam", "short.pcapng"]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(
        said.contains("short.pcapng: expected a capture, it has no record"),
        "{said}"
    );
}
