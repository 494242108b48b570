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
