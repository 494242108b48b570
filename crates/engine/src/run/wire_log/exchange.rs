//! Requests and their replies, paired from the frames of a link.

use serde::Serialize;

use super::Frame;
use crate::rig::direction::Direction;

/// A request and its reply; or a frame of the device that answers no request.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exchange {
    /// Name of the link.
    pub link: String,
    /// Frame to the device.
    pub request: Option<Frame>,
    /// Frame from the device.
    pub reply: Option<Frame>,
    /// Time from the last byte of the request to the last byte of the reply, milliseconds.
    pub reply_ms: Option<f64>,
}

impl Exchange {
    /// Its frames.
    pub(super) fn frames(&self) -> impl Iterator<Item = &Frame> {
        self.request.iter().chain(&self.reply)
    }

    /// Time of its first frame, nanoseconds.
    pub fn begin_ns(&self) -> u64 {
        self.frames().next().map_or(0, |frame| frame.at_ns)
    }

    /// Whether it is a stretch of invalid bytes.
    pub fn is_bad(&self) -> bool {
        self.frames().any(|frame| frame.is_bad)
    }

    /// Whether it is a request that had no reply.
    pub fn is_unanswered(&self) -> bool {
        let is_request = self.request.as_ref().is_some_and(|frame| !frame.is_bad);
        is_request && self.reply.is_none()
    }

    /// Reply time, microseconds.
    pub(super) fn reply_us(&self) -> Option<u64> {
        let (request, reply) = self.request.as_ref().zip(self.reply.as_ref())?;
        Some(reply.at_ns.saturating_sub(request.at_ns) / 1_000)
    }

    fn of(frame: Frame) -> Self {
        let is_request = frame.way == Direction::ToDevice.name();
        let link = frame.link.clone();
        let (request, reply) = match is_request {
            true => (Some(frame), None),
            false => (None, Some(frame)),
        };
        Self {
            link,
            request,
            reply,
            reply_ms: None,
        }
    }
}

/// The exchanges of one link in `frames`, which are in order of time, after the `open` request. The
/// first valid frame of a device after a request is the reply. A request that is followed by
/// another one has no reply. Invalid bytes are neither.
pub(super) fn paired(open: Option<Exchange>, frames: Vec<Frame>) -> Vec<Exchange> {
    let mut all: Vec<Exchange> = open.into_iter().collect();
    // Place of the last request, while it waits for a reply.
    let mut waiting = (!all.is_empty()).then_some(0);
    for frame in frames {
        if frame.is_bad {
            all.push(Exchange::of(frame));
            continue;
        }
        if frame.way == Direction::ToDevice.name() {
            waiting = Some(all.len());
            all.push(Exchange::of(frame));
            continue;
        }
        match waiting.take() {
            Some(index) => {
                let exchange = &mut all[index];
                exchange.reply = Some(frame);
                let micros = exchange.reply_us();
                exchange.reply_ms = micros.map(|micros| micros as f64 / 1_000.0);
            }
            None => all.push(Exchange::of(frame)),
        }
    }
    all
}

/// Reply times of one link over time, as a plot of the time line. A long run has only the longest
/// one of several neighbours.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReplyTimes {
    /// Name of the plot.
    pub name: String,
    /// Unit of the values.
    pub unit: &'static str,
    /// Times of the requests, seconds.
    pub at: Vec<f64>,
    /// Reply times; `None` if no neighbour had a reply.
    pub values: Vec<Option<f64>>,
}

/// Figures of the traffic on one link.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Talk {
    /// Name of the link.
    pub link: String,
    /// Start of the count, seconds, if earlier requests are not counted.
    pub since_s: Option<f64>,
    /// Number of all bytes from the device.
    pub bytes_to_master: u64,
    /// Number of all bytes to the device.
    pub bytes_to_device: u64,
    /// Number of requests.
    pub requests: u64,
    /// Number of requests without a reply.
    pub unanswered: u64,
    /// Number of frames from the device that answer no request.
    pub unasked: u64,
    /// Number of stretches of bytes that are no frame.
    pub bad: u64,
    /// Median of the reply times, milliseconds.
    pub reply_ms: Option<f64>,
    /// Longest reply time, milliseconds.
    pub reply_ms_max: Option<f64>,
}

#[cfg(test)]
mod tests {
    use protocols::Instant;

    use super::super::{Lane, WireLog};
    use super::*;
    use crate::rig::LinkKind;

    /// Two links: a request with its reply after 12 ms and an unasked line on the first; a lost
    /// request, a repeated one and its reply after 3 ms on the second. A line per frame.
    #[test]
    fn the_first_frame_after_a_request_is_its_reply() {
        let mut log = WireLog::default();
        let ways = [Direction::ToMaster, Direction::ToDevice];
        let lanes = ["a", "b"].map(|link| ways.map(|way| (link, way)));
        let lanes = lanes.into_iter().flatten().map(|(link, way)| Lane {
            link,
            way,
            kind: LinkKind::Uart,
            codec: None,
        });
        log.begin(lanes);
        log.count_exchanges();
        for (millis, lane, line) in [
            (10, 1, "SI\n"),
            (20, 3, "Q1\n"),
            (22, 0, "S S\n"),
            (90, 0, "late\n"),
            (500, 3, "Q1\n"),
            (503, 2, "(230\n"),
        ] {
            log.push(lane, Instant::from_millis(millis), line.as_bytes());
        }
        let end = Instant::from_secs(1);
        let told = log.heard(end).dialogue(9);
        let all = &told.exchanges;
        let times: Vec<_> = all.iter().map(|one| (&*one.link, one.reply_ms)).collect();
        let expected = [
            ("a", Some(12.0)),
            ("b", None),
            ("a", None),
            ("b", Some(3.0)),
        ];
        assert_eq!(times, expected);
        let [a, b] = &told.talks[..] else {
            panic!("two links");
        };
        assert_eq!((a.requests, a.unanswered, a.unasked), (1, 0, 1));
        assert_eq!((b.requests, b.unanswered, b.unasked), (2, 1, 0));
        assert_eq!((a.bytes_to_master, a.bytes_to_device), (9, 3));
        assert_eq!([a.reply_ms, b.reply_ms_max], [Some(12.0), Some(3.0)]);
    }
}
