//! The order of records with equal times.

use core::time::Duration;

use engine::rig::line::Direction;
use protocols::{Instant, LineConfig};

use crate::decode::pause::is_exact;
use crate::{Capture, Kind, Record};

/// The last record of a link. A log's clock may show only seconds or milliseconds: a request after
/// an answer then has the same time, and only the order of the records separates them.
#[derive(Clone, Debug, Default)]
pub(super) struct Turn {
    at: Instant,
    is_answer: bool,
    /// Whether the times are exact: those of virtual time.
    is_exact: bool,
}

/// Time from an answer to a request with the same time, besides that of its bytes.
const NEXT_REQUEST: Duration = Duration::from_millis(5);

impl Turn {
    /// The beginning of a link of `capture`.
    pub(super) fn of(capture: &Capture) -> Self {
        Self {
            is_exact: is_exact(&capture.sections),
            ..Self::default()
        }
    }

    /// The delay of `record`, which keeps it behind the record ahead of it.
    pub(super) fn later(&mut self, record: &Record, line: LineConfig) -> Duration {
        if self.is_exact || record.kind != Kind::Data {
            return Duration::ZERO;
        }
        let is_answer = record.direction == Direction::ToMaster;
        let mut at = record.at.max(self.at);
        if self.is_answer && !is_answer && record.at <= self.at {
            at += line.bytes_time(record.bytes.len() as u64) + NEXT_REQUEST;
        }
        (self.at, self.is_answer) = (at, is_answer);
        at - record.at
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Section;

    const TO: Direction = Direction::ToDevice;
    const FROM: Direction = Direction::ToMaster;

    /// Delays in microseconds of records of two bytes at these milliseconds; at 10,000 baud they
    /// take 2 ms.
    fn delays(about: &str, records: &[(u64, Direction)]) -> Vec<u128> {
        let capture = Capture {
            sections: vec![Section {
                about: about.to_owned(),
                ..Section::default()
            }],
            ..Capture::default()
        };
        let mut turn = Turn::of(&capture);
        let line = LineConfig::new_8n1(10_000);
        let delay = |&(millis, direction): &(u64, Direction)| {
            let record = Record {
                link: 0,
                sequence: None,
                at: Instant::from_millis(millis),
                direction,
                kind: Kind::Data,
                bytes: vec![7, 8].into(),
                sent: None,
                pieces: Vec::new(),
                comment: String::new(),
            };
            turn.later(&record, line).as_micros()
        };
        records.iter().map(delay).collect()
    }

    /// A request behind an answer comes 5 ms and its own 2 ms later; what follows at the same time
    /// stays behind it. Later records keep their times.
    #[test]
    fn a_request_keeps_behind_the_answer_of_the_same_time() {
        let own = |records: &[(u64, Direction)]| delays("clock=utc", records);
        assert_eq!(own(&[(10, FROM), (10, TO)]), [0, 7_000]);
        assert_eq!(own(&[(10, FROM), (11, TO)]), [0, 0]);
        assert_eq!(own(&[(10, TO), (10, TO)]), [0, 0]);
        assert_eq!(own(&[(10, FROM), (10, FROM)]), [0, 0]);
        assert_eq!(own(&[(10, TO), (10, FROM)]), [0, 0]);
        assert_eq!(
            own(&[
                (10, FROM),
                (10, TO),
                (10, FROM),
                (10, TO),
                (12, FROM),
                (30, TO)
            ]),
            [0, 7_000, 7_000, 14_000, 12_000, 0]
        );
        let exact = delays("clock=virtual", &[(10, FROM), (10, TO)]);
        assert_eq!(exact, [0, 0]);
    }
}
