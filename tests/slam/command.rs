//! `hilrig slam` from the user's side.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::room;

/// A separate folder, removed afterwards.
pub(crate) struct Session(PathBuf);

impl Session {
    pub(crate) fn new(name: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("slam-{name}"));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).expect("the target folder can be written");
        Self(folder)
    }

    pub(crate) fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.0.join(name), bytes).expect("the target folder can be written");
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    #[cfg(feature = "mcap")]
    pub(crate) fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.0.join(name)).expect("a command wrote it")
    }

    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.0.join(name)).expect("the command wrote it")
    }

    fn slam(&self, arguments: &[&str]) -> Output {
        self.hilrig(&[&["slam"], arguments].concat())
    }

    pub(crate) fn hilrig(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
        command.args(arguments).current_dir(&self.0);
        command.output().expect("the command starts")
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.0.join(name).is_file()
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

pub(crate) fn text(bytes: &[u8]) -> &str {
    core::str::from_utf8(bytes).expect("the command speaks UTF-8")
}

/// After 33 turns, the robot's end pose is correct within 50 mm, although the wheels are wrong by
/// five per cent. The ROS map names its picture and corner.
#[test]
fn a_log_becomes_a_map_and_a_way() {
    let session = Session::new("room");
    let (log, truth) = room::log();
    session.write("room.log", log.as_bytes());
    let output = session.slam(&["room.log", "--out", "out"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stdout).starts_with("160 scans, 0 skipped, 0 doubtful, 0 ambiguous"));
    let way = session.read("out/trajectory.tum");
    let last: Vec<f64> = way
        .lines()
        .last()
        .expect("a line a scan")
        .split(' ')
        .map(|field| field.parse().expect("a number"))
        .collect();
    assert_eq!(last.len(), 8);
    let off = libm::hypot(last[1] - truth.x, last[2] - truth.y);
    assert!(off < 0.05, "{off} m off");
    let yaml = session.read("out/map.yaml");
    assert!(
        yaml.contains("image: map.pgm") && yaml.contains("resolution: 0.05"),
        "{yaml}"
    );
    for file in ["map.pgm", "map.png", "timing.json"] {
        assert!(session.0.join("out").join(file).is_file(), "{file}");
    }
}

#[test]
fn the_seeds_algorithm_can_be_chosen() {
    let session = Session::new("seed");
    session.write("room.log", room::log().0.as_bytes());
    let output = session.slam(&["room.log", "--mode", "seed", "--out", "out"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(
        session
            .read("out/timing.json")
            .contains("\"mode\": \"seed\"")
    );
}

#[test]
fn what_cannot_be_used_is_told_and_the_rest_mapped() {
    let session = Session::new("damaged");
    let (log, _) = room::log();
    session.write("room.log", &log.as_bytes()[..log.len() / 2]);
    let output = session.slam(&["room.log", "--out", "out"]);
    assert_eq!(output.status.code(), Some(0));
    let said = text(&output.stderr);
    assert!(said.contains("skipped 1 cut-off messages"), "{said}");
    assert!(text(&output.stdout).contains(", 1 skipped,"));
}

/// The robot is localised on the map of its first pass, with a start pose that is wrong by a metre;
/// the map's folder stays unchanged.
#[test]
fn a_log_is_found_on_a_map_that_there_is() {
    let session = Session::new("on-map");
    let (log, truth) = room::log();
    session.write("room.log", log.as_bytes());
    session.slam(&["room.log", "--start", "1,-2,90", "--out", "map"]);
    let first = session.read("map/trajectory.tum");
    assert!(
        first
            .lines()
            .nth(1)
            .is_some_and(|line| line.contains(" 1.000000 -2.000000 0 "))
    );

    for map in ["map", "map/map.yaml", "map/walls.pcd"] {
        let output = session.slam(&["room.log", "--map", map, "--start", "1.2,-2.1,85"]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let said = text(&output.stdout);
        assert!(
            said.starts_with("160 scans, 0 skipped, 0 doubtful"),
            "{said}"
        );
        let way = session.read("hilrig-out/on-map-room/trajectory.tum");
        let last = way.lines().last().expect("a line a scan");
        let last: Vec<f64> = last
            .split(' ')
            .filter_map(|field| field.parse().ok())
            .collect();
        // The path began at (1, -2), facing +y.
        let off = libm::hypot(last[1] - (1.0 - truth.y), last[2] - (truth.x - 2.0));
        assert!(off < 0.06, "{map}: {off} m off");
    }
    for file in ["scans.csv", "timing.json", "map.png"] {
        assert!(
            session.has(&format!("hilrig-out/on-map-room/{file}")),
            "{file}"
        );
    }
    assert!(!session.has("hilrig-out/on-map-room/map.yaml"));
    assert_eq!(session.read("map/trajectory.tum"), first);
}

#[test]
fn a_map_that_is_none_is_refused() {
    let session = Session::new("no-map");
    session.write("room.log", room::log().0.as_bytes());
    session.write("empty.pcd", b"FIELDS x y z\nDATA ascii\n");
    session.write("binary.pcd", b"FIELDS x y z\nDATA binary\n\0\0\0\0");
    for (arguments, words) in [
        (&["--map", "nowhere"][..], "nowhere"),
        (
            &["--map", "empty.pcd"],
            "empty.pcd: has no walls, expected a map",
        ),
        (&["--map", "binary.pcd"], "expected DATA ascii"),
        (
            &["--map", "empty.pcd", "--mode", "seed"],
            "--map goes with --mode graph",
        ),
        (
            &["--start", "1,2"],
            "expected metres and degrees as X,Y,DEG",
        ),
    ] {
        let output = session.slam(&[&["room.log"], arguments].concat());
        let told = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(words), "{told}");
    }
}

#[test]
fn what_is_no_log_is_refused() {
    let session = Session::new("no-log");
    session.write("notes.txt", b"dear diary\n");
    let output = session.slam(&["notes.txt"]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(
        said.starts_with("error: notes.txt: no FLASER or ROBOTLASER1 line in it"),
        "{said}"
    );
    let output = session.slam(&["missing.log"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).starts_with("error: cannot read missing.log: "));
}
