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
}
