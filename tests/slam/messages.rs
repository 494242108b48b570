//! MCAP files of other tools: laser scans and odometry as messages, valid and damaged.

use std::collections::BTreeMap;
use std::io::Cursor;

use emulators::world::Pose;
use hilrig::slam::bag::mcap::read;
use hilrig::slam::finding::Kind;
use hilrig::slam::motion::moved;
use mcap::WriteOptions;
use mcap::records::MessageHeader;
use proptest::prelude::*;

use crate::command::{Session, text};
use crate::ros::{laser_scan, odometry, room_messages};

/// A file with these messages, each with the number of its topic (0: scans, 1: odometry) and its
/// time.
pub(crate) fn file(messages: &[(u16, f64, Vec<u8>)]) -> Vec<u8> {
    let options = WriteOptions::new().compression(None).chunk_size(Some(4096));
    let mut writer = options.create(Cursor::new(Vec::new())).expect("memory");
    let topics = [
        ("/scan", "sensor_msgs/msg/LaserScan"),
        ("/odom", "nav_msgs/msg/Odometry"),
    ];
    let channels = topics.map(|(topic, schema)| {
        let schema = writer.add_schema(schema, "ros2msg", b"").expect("memory");
        let none = BTreeMap::new();
        writer
            .add_channel(schema, topic, "cdr", &none)
            .expect("memory")
    });
    for (sequence, (topic, at_s, data)) in (0..).zip(messages) {
        #[expect(clippy::cast_possible_truncation, reason = "small")]
        #[expect(clippy::cast_sign_loss, reason = "not negative")]
        let nanos = (at_s * 1e9) as u64;
        let header = MessageHeader {
            channel_id: channels[usize::from(*topic)],
            sequence,
            log_time: nanos,
            publish_time: nanos,
        };
        writer
            .write_to_known_channel(&header, data)
            .expect("memory");
    }
    writer.finish().expect("memory");
    writer.into_inner().into_inner()
}

/// As from its CARMEN log: the robot's end position is correct within 50 mm.
#[test]
fn scans_and_odometry_of_ros_become_a_map_and_a_way() {
    let session = Session::new("messages");
    let (messages, truth) = room_messages();
    session.write("bag.mcap", &file(&messages));
    let output = session.hilrig(&["slam", "bag.mcap", "--out", "out"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    assert!(
        said.starts_with("160 scans, 0 skipped, 0 doubtful, 0 ambiguous"),
        "{said}"
    );
    assert!(text(&output.stderr).contains("scans of /scan, odometry of /odom"));
    let way = session.read("out/trajectory.tum");
    let last: Vec<f64> = way
        .lines()
        .last()
        .expect("a line a scan")
        .split(' ')
        .map(|field| field.parse().expect("a number"))
        .collect();
    let off = libm::hypot(last[1] - truth.x, last[2] - truth.y);
    assert!(off < 0.05, "{off} m off");
}

/// Not-a-number, a cut message, a pose at an absurd distance, a scan without beams, time that runs
/// backwards: each is counted, and the other messages are used.
#[test]
fn what_is_wrong_with_messages_is_counted() {
    let good = [1.0, 2.0, f32::NAN, 3.0, -1.0];
    let scan = |at_s: f64| (0, at_s, laser_scan(at_s, &good));
    let mut cut = scan(3.0);
    cut.2.truncate(60);
    let nowhere = Pose::new(1e9, 0.0, 0.0);
    let messages = [
        (1, 0.5, odometry(0.5, Pose::default())),
        scan(1.0),
        (0, 2.0, laser_scan(2.0, &[])),
        cut,
        (1, 3.5, odometry(3.5, nowhere)),
        (0, 4.0, laser_scan(1e-3, &good)),
        (0, 4.5, vec![9, 9, 9]),
        scan(5.0),
    ];
    let log = read(&file(&messages)).log().expect("two scans are good");
    let counts = [Kind::Blind, Kind::Unreadable, Kind::Absurd, Kind::Backwards];
    assert_eq!(counts.map(|kind| log.findings.count(kind)), [1, 2, 1, 1]);
    // A distance below the laser's stated minimum range is not a reading.
    assert_eq!((log.shots.len(), log.findings.absurd_readings), (2, 2));
    let told = log.findings.told();
    assert_eq!(told[0], "/scan at 3.000000 s: ends before ranges");
}

#[test]
fn a_file_without_scans_says_what_was_expected() {
    let messages = [(1, 0.5, odometry(0.5, Pose::default()))];
    let error = read(&file(&messages))
        .log()
        .expect_err("no scan")
        .to_string();
    assert!(
        error.starts_with("contains no laser scan, expected foxglove.LaserScan"),
        "{error}"
    );
    let error = read(b"\x89MCAP0\r\n")
        .log()
        .expect_err("nothing")
        .to_string();
    assert!(error.contains("ended in the middle"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::default())]
    /// Bytes are changed, cut or left out anywhere: readable data is read, and nothing panics.
    #[test]
    fn no_damage_to_a_file_panics_the_reader(
        flips in proptest::collection::vec((any::<usize>(), 1_u8..), 0..6),
        cut: usize, gap in 0..200_usize, at: usize,
    ) {
        let turned = moved(Pose::default(), Pose::new(0.1, 0.0, 0.2));
        let mut bytes = file(&[
            (1, 0.5, odometry(0.5, turned)),
            (0, 1.0, laser_scan(1.0, &[1.0; 90])),
            (0, 2.0, laser_scan(2.0, &[2.0; 90])),
        ]);
        for (place, by) in flips {
            let place = place % bytes.len();
            bytes[place] ^= by;
        }
        let from = at % bytes.len();
        let to = (from + gap).min(bytes.len());
        bytes.drain(from..to);
        bytes.truncate(cut % (2 * bytes.len()));
        match read(&bytes).log() {
            Ok(log) => prop_assert!(!log.shots.is_empty()),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }
}
