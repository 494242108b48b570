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
