//! Logs of other tools: the meaning of ambiguous lines, and the errors for unreadable files.

use hilrig::slam::{Log, carmen};

use crate::command::{Session, text};
use crate::room;

fn read(text: &str) -> Log {
    carmen::read(text.as_bytes()).expect("a good log")
}

/// A beam of 2 m straight ahead; `laser` and `robot` are the poses of the laser and of the robot.
fn scan(laser: &str, robot: &str, time: f64) -> String {
    format!("FLASER 3 99 2 99 {laser} {robot} {time} host {time}\n")
}

/// If the poses of laser and robot are equal, they are the laser's own. If they differ, they define
/// the offset of the laser from the robot. Only if the poses are in different frames, PARAM defines
/// the offset.
#[test]
fn the_laser_sits_where_its_pose_says() {
    let ahead_mm = |laser: &str| {
        let log = String::from("PARAM robot_frontlaser_offset 0.25 host 0\n");
        read(&(log + &scan(laser, "1 1 0", 1.0))).shots[0].points[0].x_mm
    };
    let near = |mm: f32, wanted: f32| (mm - wanted).abs() < 0.1;
    assert!(near(ahead_mm("1 1 0"), 2000.0));
    assert!(near(ahead_mm("1.1 1 0"), 2100.0));
    assert!(near(ahead_mm("40 30 0"), 2250.0));
}

/// The range limit of the navigation is not a limit of the laser.
#[test]
fn readings_beyond_what_the_navigation_uses_count() {
    let text = "PARAM robot_front_laser_max 1.5 host 0\n".to_owned() + &scan("0 0 0", "0 0 0", 1.0);
    assert_eq!(read(&text).shots[0].points.len(), 1);
}

/// A mapper writes NEFF, the number of remaining particles. The poses are therefore the mapper's,
/// and without odometry in between, the robot's motion is unknown.
#[test]
fn a_log_with_a_count_of_particles_was_corrected() {
    let scans = scan("0 0 0", "0 0 0", 1.0) + &scan("5 0 0", "5 0 0", 2.0);
    let [plain, corrected] =
        ["", "NEFF 30 1 host 1\n"].map(|neff| read(&(neff.to_owned() + &scans)));
    assert!((plain.shots[1].moved.x - 5.0).abs() < 1e-9 && plain.shots[1].is_measured);
    assert!(corrected.shots[1].moved.x.abs() < 1e-9 && !corrected.shots[1].is_measured);
    assert!(
        corrected.shots[0].is_measured,
        "nothing comes before the first"
    );
    assert!(corrected.notes[0].contains("corrected by a mapper"));
}

#[test]
fn a_file_of_another_kind_is_told_with_what_to_do() {
    let session = Session::new("foreign");
    for (bytes, words) in [
        (&b"#ROSBAG V2.0\n"[..], "mcap convert"),
        (b"BZh91AY", "bunzip2"),
        (b"\xFD7zXZ\0..", "unxz"),
    ] {
        session.write("log", bytes);
        let output = session.hilrig(&["slam", "log"]);
        let told = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(words) && told.contains("expected"), "{told}");
    }
}

/// A bag of ROS 2 is a folder; files in it that are no recordings are skipped.
#[test]
fn a_folder_without_one_recording_is_told() {
    let session = Session::new("bag");
    session.write("metadata.yaml", b"");
    let told = |session: &Session| text(&session.hilrig(&["slam", "."]).stderr).to_owned();
    assert!(told(&session).contains("neither capture.pcapng nor an .mcap or .db3 file"));
    session.write("a.db3", b"SQLite format 3\0");
    assert!(told(&session).contains("a.db3: the header of its SQLite file is damaged"));
    session.write("b.mcap", b"");
    assert!(told(&session).contains("holds 2 recordings and no metadata.yaml"));
}

/// The result of the seed's mapper depends on its random numbers, so the seed is reported. A jump
/// of two metres in the odometry is reported.
#[test]
fn the_draw_has_a_seed_and_jumps_are_told() {
    let session = Session::new("draw");
    let (log, _) = room::log();
    session.write("room.log", log.as_bytes());
    let way = |seed: &str| {
        session.hilrig(&[
            "slam", "room.log", "--mode", "seed", "--seed", seed, "--out", "seed",
        ]);
        session.read("seed/trajectory.tum")
    };
    let first = way("1");
    assert!(first == way("1") && first != way("2"));

    // From the 80th scan on, the odometry is 0.6 m ahead; the walls correct this.
    let jumping: String = log.lines().enumerate().map(pushed).collect();
    session.write("jumping.log", jumping.as_bytes());
    let output = session.hilrig(&["slam", "jumping.log", "--out", "out"]);
    let timing: serde_json::Value = serde_json::from_str(&session.read("out/timing.json")).unwrap();
    assert_eq!(timing["jumps"].as_array().map(Vec::len), Some(1));
    let told = text(&output.stderr);
    assert!(told.contains("jumps against the odometry: 1,"), "{told}");
}

/// A line of the log; from the 160th line on, its poses are moved along x.
fn pushed((number, line): (usize, &str)) -> String {
    let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
    let places = match words[0].as_str() {
        "FLASER" => vec![182, 185],
        "ODOM" => vec![1],
        _ => vec![],
    };
    for place in places.into_iter().filter(|_| number >= 160) {
        let x: f64 = words[place].parse().expect("a pose");
        words[place] = format!("{:.6}", x + 0.6);
    }
    words.join(" ") + "\n"
}
