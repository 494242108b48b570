//! Damaged logs: valid data is used, invalid data is counted with its line, and nothing panics.

use firmware_core::pose::Point;
use firmware_core::slam::Mode;
use hilrig::realtime::clock::WallClock;
use hilrig::slam::finding::Kind;
use hilrig::slam::survey::{CELL_MM, settings, survey};
use hilrig::slam::{Log, carmen};
use proptest::prelude::*;

use crate::room;

/// Five beams and odometry (x, 0, 0) at a time.
fn scan(ranges: &str, x: f64, time: f64) -> String {
    format!("FLASER {ranges} {x} 0 0 {x} 0 0 {time} host {time}\n")
}

fn read(text: &str) -> Log {
    carmen::read(text.as_bytes()).expect("some scans are good")
}

const GOOD: &str = "5 1 2 3 2 1";

#[test]
fn a_log_that_ends_within_a_message_keeps_the_messages_before() {
    let whole = scan(GOOD, 0.0, 1.0) + &scan(GOOD, 0.1, 2.0);
    let log = read(&whole[..whole.len() - 30]);
    assert_eq!((log.shots.len(), log.findings.count(Kind::Cut)), (1, 1));
    let told = &log.findings.told()[0];
    assert!(told.starts_with("line 2: "), "{told}");
}

#[test]
fn what_is_no_number_is_told_with_line_and_field() {
    let text = scan(GOOD, 0.0, 1.0) + "ODOM 1 zwei 3 0 0 0 1 host 1\n" + &scan("x", 0.1, 2.0);
    let log = read(&text);
    assert_eq!(log.shots.len(), 1);
    assert_eq!(log.findings.count(Kind::Unreadable), 2);
    let told = log.findings.told();
    assert_eq!(told[0], "line 2: x y theta is \"zwei\", expected a number");
    assert_eq!(told[1], "line 3: ranges is \"x\", expected a number");
}

/// Not-a-number, negative, infinite and endless readings are no returns; the other readings of the
/// scan are used.
#[test]
fn absurd_readings_are_counted_and_the_others_used() {
    let log = read(&scan("6 NaN -3 inf 1e300 2 1", 0.0, 1.0));
    assert_eq!(
        (log.shots[0].points.len(), log.findings.absurd_readings),
        (2, 2)
    );
}

#[test]
fn scans_without_a_return_are_skipped() {
    let text = scan(GOOD, 0.0, 1.0) + &scan("0", 0.1, 2.0) + &scan("3 81 81 81", 0.2, 3.0);
    let log = read(&text);
    assert_eq!((log.shots.len(), log.findings.count(Kind::Blind)), (1, 2));
    assert_eq!(
        log.findings.told()[0],
        "line 2: none of 0 beams has a distance"
    );
}

/// The motion until a skipped scan is kept: the next scan includes both motions.
#[test]
fn a_scan_from_the_past_is_skipped_but_the_wheels_go_on() {
    let times = [1.0, 5.0, 2.0, 6.0];
    let lines = times
        .iter()
        .enumerate()
        .map(|(i, time)| scan(GOOD, i as f64 * 0.1, *time));
    let log = read(&lines.collect::<String>());
    assert_eq!(
        (log.shots.len(), log.findings.count(Kind::Backwards)),
        (3, 1)
    );
    assert!((log.shots[2].moved.x - 0.2).abs() < 1e-9);
}

/// A clock that was set back stays so: two scans are lost, not all.
#[test]
fn a_clock_that_was_set_back_is_believed_at_the_third_scan() {
    let times = [100.0, 1.0, 2.0, 3.0, 4.0];
    let log = read(&times.map(|time| scan(GOOD, 0.0, time)).concat());
    assert_eq!(
        (log.shots.len(), log.findings.count(Kind::Backwards)),
        (3, 2)
    );
}

#[test]
fn a_pose_farther_than_robots_drive_is_refused() {
    let log = read(&(scan(GOOD, 0.0, 1.0) + &scan(GOOD, 1e9, 2.0)));
    assert_eq!((log.shots.len(), log.findings.count(Kind::Absurd)), (1, 1));
}

#[test]
fn a_file_of_something_else_is_an_error_that_says_so() {
    let error = carmen::read(b"hello there\n")
        .expect_err("no log")
        .to_string();
    assert!(error.starts_with("no FLASER or ROBOTLASER1 line in it, expected a CARMEN log"));
    assert!(
        error.contains("line 1: \"hello\" is no name of a message"),
        "{error}"
    );
    assert!(carmen::read(b"").is_err());
}

/// After each scan of a corrected log, the odometry starts again at the mapper's pose. The wheels
/// move 0.5 m and 0.4 m; the corrections of 0.1 m to the left are not motion of the robot.
#[test]
fn of_a_corrected_log_only_the_motion_between_the_scans_is_the_wheels() {
    let odom = |x: f64, y: f64, t: f64| format!("ODOM {x} {y} 0 0 0 0 {t} host {t}\n");
    let at = |x: f64, y: f64, t: f64| format!("FLASER {GOOD} {x} {y} 0 {x} {y} 0 {t} host {t}\n");
    let text = [
        odom(0.0, 0.0, 1.0),
        at(0.0, 0.1, 1.0),
        odom(0.0, 0.1, 0.0),
        odom(0.5, 0.1, 2.0),
        at(0.5, 0.2, 2.0),
        odom(0.5, 0.2, 0.0),
        odom(0.9, 0.2, 3.0),
        at(0.9, 0.3, 3.0),
        odom(0.9, 0.3, 0.0),
    ];
    let log = read(&text.concat());
    let moved: Vec<_> = log.shots.iter().map(|shot| shot.moved).collect();
    assert!(
        (moved[1].x - 0.5).abs() < 1e-9 && moved[1].y.abs() < 1e-9,
        "{moved:?}"
    );
    assert!(
        (moved[2].x - 0.4).abs() < 1e-9 && moved[2].y.abs() < 1e-9,
        "{moved:?}"
    );
    assert!(
        log.notes[0].contains("corrected by a mapper"),
        "{:?}",
        log.notes
    );
}

/// Five beams of the old kind make a half circle: the first points to the right, the last to the
/// left. ROBOTLASER1 contains the angles and the laser's position: 0.2 m ahead.
#[test]
fn beams_look_where_the_kind_of_message_says() {
    let log = read(&scan("5 1 9 1 9 1", 0.0, 1.0));
    let [right, _, ahead, ..] = log.shots[0].points[..] else {
        panic!("five points")
    };
    assert!(right.distance_mm(Point::new(0.0, -1000.0)) < 0.1);
    assert!(ahead.distance_mm(Point::new(1000.0, 0.0)) < 0.1);

    let line = "ROBOTLASER1 0 0.0 6.28 1.5707963 10.0 0.01 0 4 1 2 3 4 0 0.2 0 0 0 0 0 \
                0 0 0.1 0.1 1e6 7.5 host 7.5\n";
    let log = read(line);
    let expected = [
        (1200.0, 0.0),
        (200.0, 2000.0),
        (-2800.0, 0.0),
        (200.0, -4000.0),
    ];
    assert!((log.shots[0].at_s - 7.5).abs() < 1e-9);
    for (point, (x, y)) in log.shots[0].points.iter().zip(expected) {
        assert!(point.distance_mm(Point::new(x, y)) < 0.1, "{point:?}");
    }
}

/// Damage of a file.
#[derive(Clone, Debug)]
enum Damage {
    Flip(usize, u8),
    Cut(usize),
    Insert(usize, &'static str),
    Remove(usize, usize),
    Repeat(usize, usize),
}

fn damages() -> impl Strategy<Value = Vec<Damage>> {
    let words = prop::sample::select(vec![
        "NaN ",
        " -inf",
        "\n",
        " 1e999 ",
        "FLASER 99999999 ",
        "-",
        "\u{0}",
        " 0 ",
        "ODOM ",
    ]);
    let one = prop_oneof![
        (any::<usize>(), any::<u8>()).prop_map(|(at, by)| Damage::Flip(at, by)),
        any::<usize>().prop_map(Damage::Cut),
        (any::<usize>(), words).prop_map(|(at, word)| Damage::Insert(at, word)),
        (any::<usize>(), 1..3000_usize).prop_map(|(at, many)| Damage::Remove(at, many)),
        (any::<usize>(), 1..3000_usize).prop_map(|(at, many)| Damage::Repeat(at, many)),
    ];
    prop::collection::vec(one, 1..12)
}

fn damaged(text: &str, damages: &[Damage]) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for damage in damages {
        let place = |at: usize| at % bytes.len().max(1);
        match *damage {
            Damage::Flip(at, by) => {
                let at = place(at);
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= by;
                }
            }
            Damage::Cut(at) => bytes.truncate(place(at)),
            Damage::Insert(at, word) => {
                let at = place(at);
                bytes.splice(at..at, word.bytes());
            }
            Damage::Remove(at, many) => {
                let at = place(at);
                bytes.drain(at..(at + many).min(bytes.len()));
            }
            Damage::Repeat(at, many) => {
                let at = place(at);
                let piece = bytes[at..(at + many).min(bytes.len())].to_vec();
                bytes.splice(at..at, piece);
            }
        }
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig::default())]
    #[test]
    fn no_damage_to_a_log_panics_the_reader(damages in damages()) {
        let bytes = damaged(&room::log().0, &damages);
        match carmen::read(&bytes) {
            Ok(log) => prop_assert!(!log.shots.is_empty()),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    /// Any result of reading can be mapped, and every pose is a number.
    #[test]
    fn no_damage_to_a_log_panics_the_mapper(damages in damages()) {
        if let Ok(log) = carmen::read(&damaged(&room::log().0, &damages)) {
            for mode in [Mode::Core, Mode::Document] {
                let settings = settings(mode, CELL_MM);
                let mut log = log.clone();
                log.shots.truncate(20);
                let result = survey(&log, settings, &still(), &mut |_| {});
                prop_assert_eq!(result.way.len(), log.shots.len());
                prop_assert!(result.way.iter().all(|(_, place)| place.is_finite()));
            }
        }
    }
}

/// A clock for tests that do not measure time.
pub(crate) fn still() -> WallClock {
    WallClock::start()
}
