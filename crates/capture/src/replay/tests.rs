use core::time::Duration;

use protocols::Instant;

use super::Recorded;
use crate::{Capture, Interface, Kind, Record, Section};
use engine::rig::line::Direction;

/// Three bytes a nanosecond apart; the requested end is the second. The clock is that of a run, or
/// another one that starts with the first byte.
#[test]
fn what_is_to_be_played_ends_at_the_time_asked_for() {
    let heard = |clock: &str, until_ns: u64| {
        let capture = Capture {
            sections: vec![Section {
                about: format!("clock={clock}"),
                ..Section::default()
            }],
            links: ["lidar", "base"]
                .map(|name| Interface::new(name, 9600))
                .to_vec(),
            records: (0..3)
                .map(|number| Record {
                    link: 1,
                    sequence: Some(number),
                    at: Instant::from_nanos(5_000_000_123 + number),
                    direction: Direction::ToMaster,
                    kind: Kind::Data,
                    bytes: vec![7].into(),
                    sent: None,
                    pieces: Vec::new(),
                    comment: String::new(),
                })
                .collect(),
            ..Capture::default()
        };
        let recorded = Recorded::of(&capture, Some(Duration::from_nanos(until_ns)));
        (recorded.links[1].arrivals.len(), recorded.end.as_nanos())
    };
    assert_eq!(heard("virtual", 5_000_000_124), (2, 5_000_000_124));
    assert_eq!(heard("utc", 1), (2, 1));
    // The log of another tool with times of the day.
    assert_eq!(heard("virtual\nimported=hex", 1), (2, 1));
    // 1 s from the start of a live run at 4 s.
    let live = heard("utc\nstart_ns=4000000000", 1_000_000_124);
    assert_eq!(live, (2, 1));
}

/// Two requests with their answers, all at the same second: the second request is behind the first
/// answer, by its bytes and 5 ms. Two bytes at 9600 baud take 20 bits, 2.083 ms.
#[test]
fn records_of_one_second_keep_their_order() {
    let (ask, tell) = (Direction::ToDevice, Direction::ToMaster);
    let record = |(number, direction): (u64, Direction)| Record {
        link: 0,
        sequence: Some(number),
        at: Instant::from_millis(1_000),
        direction,
        kind: Kind::Data,
        bytes: vec![7, 8].into(),
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    };
    let capture = Capture {
        sections: vec![Section {
            about: "imported=hex\nclock=virtual".to_owned(),
            ..Section::default()
        }],
        links: vec![Interface::new("a", 9600)],
        records: (0..).zip([ask, tell, ask, tell]).map(record).collect(),
        ..Capture::default()
    };
    let recorded = Recorded::of(&capture, None);
    let link = &recorded.links[0];
    // Times count from the first record of an imported log.
    let first = Instant::ZERO;
    let second = first + Duration::from_nanos(5_000_000 + 20 * 1_000_000_000 / 9600);
    let sent: Vec<Instant> = link.sent.pieces().map(|(at, _)| at).collect();
    assert_eq!((sent[0], link.arrivals[0].at), (first, first));
    assert!((sent[1] - second).as_micros() < 5, "{sent:?}");
    assert!(link.arrivals[1].at >= sent[1], "{:?}", link.arrivals);
}

/// The exact time of a run counts from its start, that of another log from its first record. The
/// program opens a port once until it closes it.
#[test]
fn openings_of_a_port_are_found() {
    use protocols::LineEvent::{Closed, Opened, ParityError};
    let event = |second: u64, direction, event| Record {
        link: 0,
        sequence: None,
        at: Instant::from_secs(second),
        direction,
        kind: Kind::Line(event),
        bytes: vec![].into(),
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    };
    let to = Direction::ToDevice;
    let capture = Capture {
        sections: vec![Section {
            about: "clock=virtual".to_owned(),
            ..Section::default()
        }],
        links: vec![Interface::new("a", 9600)],
        records: vec![
            event(1, to, ParityError),
            event(2, Direction::ToMaster, Opened),
            event(3, to, Opened),
            event(4, to, Opened),
            event(5, to, ParityError),
            event(6, to, Closed),
            event(7, to, Closed),
            event(8, to, Opened),
        ],
        ..Capture::default()
    };
    let recorded = Recorded::of(&capture, None);
    assert_eq!(recorded.links[0].opened, [3, 8].map(Instant::from_secs));
    assert_eq!(recorded.origin(), Instant::from_secs(3));
    assert_eq!(recorded.links[0].link, "a");
    assert_eq!(
        recorded.session(),
        Instant::from_secs(3)..Instant::from_secs(8)
    );
}

/// Bytes that arrived count for the program; those that it sent are kept as sent.
#[test]
fn bytes_belong_to_their_direction() {
    let record = |second: u64, direction| Record {
        link: 0,
        sequence: None,
        at: Instant::from_secs(second),
        direction,
        kind: Kind::Data,
        bytes: vec![7].into(),
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    };
    let capture = Capture {
        links: vec![Interface::new("a", 9600)],
        records: vec![
            record(5, Direction::ToMaster),
            record(6, Direction::ToDevice),
        ],
        ..Capture::default()
    };
    let link = &Recorded::of(&capture, None).links[0];
    assert_eq!((link.arrivals.len(), link.heard.len()), (1, 1));
    assert_eq!(link.sent.bytes(), [7]);
    // The first byte is at zero; a session without an opening begins there at the earliest.
    assert_eq!(link.arrivals[0].at, Instant::ZERO);
    assert_eq!(link.sent.time_of(0), Some(Instant::from_secs(1)));
}

/// The first section with a scenario counts.
#[test]
fn a_capture_may_have_a_scenario() {
    let section = |scenario: &str| Section {
        scenario: scenario.to_owned(),
        ..Section::default()
    };
    let text = "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"1s\"\n\
                device.meter = { description = \"gps\" }\n";
    let of = |sections: Vec<Section>| {
        let capture = Capture {
            sections,
            ..Capture::default()
        };
        let found = super::scenario_of(&capture, std::path::Path::new("x"));
        found.expect("readable").map(|(scenario, _)| scenario.name)
    };
    assert_eq!(of(vec![section(""), section(text)]), Some("s".into()));
    assert_eq!(of(vec![section("")]), None);
}

/// The program of the rescue robot hears one byte of its lidar, and sends to its base by itself.
/// The capture has another byte of it, at the end.
#[test]
fn a_replay_runs_the_program_to_the_end_of_the_capture() {
    use super::{Arrival, Passage, Replay, Voice};
    use crate::divergence::Track;
    let text = "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"1s\"\n\
                [mission]\nwaypoints_m = [[0.8, 1.9]]\n\
                [world]\nstart = { x_m = 0.8, y_m = 1.4, heading_deg = 90 }\n\
                [[world.wall]]\npath_m = [[0.0, 0.0], [3.0, 0.0]]\n";
    let (scenario, source) = engine::scenario::Scenario::from_text(text).expect("sound");
    let end = Instant::from_millis(300);
    let mut sent = Track::default();
    sent.push(end, &[0x00]);
    let recorded = Recorded {
        links: vec![
            Passage {
                link: "lidar".to_owned(),
                baud: 115_200,
                arrivals: vec![Arrival {
                    at: Instant::from_millis(100),
                    bytes: vec![0xFA],
                }],
                ..Passage::default()
            },
            Passage {
                link: "base".to_owned(),
                baud: 1_000_000,
                sent,
                ..Passage::default()
            },
        ],
        end,
        zero: Instant::ZERO,
    };
    let new = || Replay::new(&recorded, &scenario, &source, Voice::Program).expect("wired");
    let mut replay = new();
    assert!(!replay.is_over());
    replay.run_for(Duration::from_millis(200));
    assert_eq!(replay.rig().now(), Instant::from_millis(200));
    replay.run_for(Duration::from_millis(200));
    assert!(replay.is_over() && replay.rig().now() == end);
    let mut replay = new();
    let mut is_replaced = false;
    replay.replace_program(|program| {
        is_replaced = true;
        program
    });
    assert!(is_replaced);
    let replayed = replay.finish();
    assert_eq!((replayed.ran, replayed.heard), (end - Instant::ZERO, 1));
    assert!(replayed.sent() > 1, "{}", replayed.sent());
    let lens = replayed.links.iter().map(|one| one.got.bytes().len());
    assert_eq!(replayed.sent(), lens.sum::<usize>());
    // Its first byte came earlier than that of the capture.
    assert!(replayed.largest_shift() > Duration::from_millis(1));
    // The earliest difference is a byte that the capture does not have.
    let divergence = replayed.divergence().expect("another byte");
    assert_eq!((divergence.byte, divergence.expected), (0, None));
    assert!(divergence.got.is_some() && divergence.at < end);
    let nothing = Recorded::default();
    let error = Replay::new(&nothing, &scenario, &source, Voice::Program).map(|_| ());
    let error = error.expect_err("no bytes").to_string();
    assert!(
        error.contains("expected a capture with bytes to-master on "),
        "{error}"
    );
}
