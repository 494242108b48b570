//! Shrinking: only the relevant part remains, and it fails for the same reason.

use hilrig::capture::{Capture, Interface, Kind, Record};
use hilrig::rig::line::Direction;
use hilrig::search::shrink;
use protocols::Instant;
use protocols::xv11::{Frame, RawReading, SpeedWord};

use super::{Session, shipped, text};

const TWELVE_FAULTS: &str = include_str!("twelve-faults.toml");

#[test]
fn twelve_faults_of_which_two_matter_come_down_to_those_two() {
    let session = Session::new("shrink-faults");
    session.write("twelve.toml", TWELVE_FAULTS);
    for out in ["one", "two"] {
        let output = session.hilrig(&["shrink", "twelve.toml", "--out", out]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    }
    let small = session.read("one/case.toml");
    assert_eq!(session.read("two/case.toml"), small);
    assert_eq!(small.matches("kind = \"cut\"").count(), 2, "{small}");
    assert_eq!(small.matches("[[fault]]").count(), 2, "{small}");
    assert_eq!(small.matches("link = \"base\"").count(), 2, "{small}");

    let again = session.hilrig(&["run", "one/case.toml", "--out", "again"]);
    assert_eq!(again.status.code(), Some(1));
    let said = text(&again.stdout);
    assert!(said.contains("FAIL motors-stop-after-silence"), "{said}");
}

/// Ten seconds of a lidar at 5 turns a second in which a bit of one packet flipped.
fn ten_seconds_with_one_bad_packet() -> Vec<u8> {
    let reading = RawReading([0xE8, 0x03, 0xC8, 0x00]);
    let records = (0..4_500_u64).map(|number| {
        let index = u8::try_from(number % 90).expect("below 90");
        let frame = Frame::new(index, SpeedWord(19_200), [reading; 4]);
        let mut bytes = frame.as_bytes().to_vec();
        if number == 3_210 {
            bytes[8] ^= 0x10;
        }
        Record {
            link: 0,
            sequence: Some(number),
            at: Instant::from_nanos(number * 2_222_222),
            direction: Direction::ToMaster,
            kind: Kind::Data,
            bytes: bytes.into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        }
    });
    shrink::to_bytes(&Capture {
        links: vec![Interface::new("lidar", 115_200)],
        records: records.collect(),
        ..Capture::default()
    })
}

#[test]
fn a_capture_with_one_bad_packet_comes_down_to_a_few() {
    let session = Session::new("shrink-capture");
    std::fs::write(
        session.path("ten.pcapng"),
        ten_seconds_with_one_bad_packet(),
    )
    .expect("room");
    for out in ["one", "two"] {
        let output = session.hilrig(&["shrink", "ten.pcapng", "--out", out]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let said = text(&output.stdout);
        assert!(
            said.starts_with("lidar to-master: a checksum that does not fit\n"),
            "{said}"
        );
    }
    let read = |out: &str| std::fs::read(session.path(out)).expect("written");
    let small = read("one/capture.pcapng");
    assert_eq!(small, read("two/capture.pcapng"));
    let small = Capture::of(&small);
    assert!(small.records.len() <= 20, "{} records", small.records.len());
    let units = shrink::units(&small);
    let cause = shrink::fault_of(&small, &units);
    assert_eq!(
        cause.as_deref(),
        Some("lidar to-master: a checksum that does not fit")
    );
}

/// A command is the test: grep finds the magic word of the PC link in the file.
#[test]
fn a_command_decides_what_is_bad() {
    let session = Session::new("shrink-while");
    session.write("twelve.toml", TWELVE_FAULTS);
    let judge = "grep -q 'y_m = 1.0'";
    let output = session.hilrig(&["shrink", "twelve.toml", "--while", judge, "--out", "small"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let small = session.read("small/case.toml");
    assert!(small.contains("y_m = 1.0"), "{small}");
    assert_eq!(small.matches("[[fault]]").count(), 0, "{small}");
}

/// The test command also sends Ctrl-C, at the first try: the result is the whole case, which still
/// fails, and the command that repeats it.
#[test]
fn the_best_so_far_is_the_result_when_somebody_stops_the_search() {
    let session = Session::new("shrink-stopped");
    session.write("twelve.toml", TWELVE_FAULTS);
    // The thread of the command that waits for signals ends when it has received one.
    let waits = "while grep -qxs signals /proc/$PPID/task/*/comm; do sleep 0.02; done";
    let judge = format!("kill -INT $PPID; {waits}; grep -q 'y_m = 1.0'");
    let output = session.hilrig(&["shrink", "twelve.toml", "--while", &judge, "--out", "small"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    assert!(said.contains(", 0 tries."), "{said}");
    assert!(
        said.contains("repeat with: hilrig run small/case.toml"),
        "{said}"
    );
    let small = session.read("small/case.toml");
    assert!(
        small.contains("y_m = 1.0") && small.contains("[[fault]]"),
        "{small}"
    );
}

#[test]
fn what_passes_cannot_be_shrunk() {
    let session = Session::new("shrink-passes");
    let scenario = shipped("empty-room").replace("\"90s\"", "\"1s\"");
    session.write("good.toml", &scenario.replace("visit_within_mm = 200", ""));
    let output = session.hilrig(&["shrink", "good.toml"]);
    assert_eq!(output.status.code(), Some(2));
    let error = text(&output.stderr);
    assert_eq!(
        error,
        "error: good.toml: passes, expected a file that fails\n"
    );
}
