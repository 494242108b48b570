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

/// The exchanges in `frames`, which are in order of time. The first frame of a device after a
/// request is the reply. A request that is followed by another one has no reply.
pub fn exchanges(frames: Vec<Frame>) -> Vec<Exchange> {
    let mut all: Vec<Exchange> = Vec::new();
    // The last exchange of each link, while it waits for a reply.
    let mut open: Vec<(String, usize)> = Vec::new();
    for frame in frames {
        let link = frame.link.clone();
        let waiting = open.iter().position(|(name, _)| *name == link);
        let waiting = waiting.map(|index| open.swap_remove(index).1);
        if frame.way == Direction::ToDevice.name() {
            open.push((link.clone(), all.len()));
            all.push(Exchange {
                link,
                request: Some(frame),
                reply: None,
                reply_ms: None,
            });
            continue;
        }
        match waiting.map(|index| &mut all[index]) {
            Some(exchange) => {
                let asked = exchange.request.as_ref().map_or(0, |request| request.at_ns);
                let micros = frame.at_ns.saturating_sub(asked) / 1_000;
                exchange.reply_ms = Some(micros as f64 / 1_000.0);
                exchange.reply = Some(frame);
            }
            None => all.push(Exchange {
                link,
                request: None,
                reply: Some(frame),
                reply_ms: None,
            }),
        }
    }
    all
}

/// Reply times of one link over time, as a plot of the time line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReplyTimes {
    /// Name of the plot.
    pub name: String,
    /// Unit of the values.
    pub unit: &'static str,
    /// Times of the requests, seconds.
    pub at: Vec<f64>,
    /// Reply times; `None` without a reply.
    pub values: Vec<Option<f64>>,
}

/// Maximum number of points of a plot.
const TIMES_MAX: usize = 1_000;

/// Reply times of each link that carried requests. A long run has only the longest one of several
/// neighbours, and a missing reply counts as longer than any.
pub fn reply_times(exchanges: &[Exchange]) -> Vec<ReplyTimes> {
    let mut plots: Vec<ReplyTimes> = Vec::new();
    for (one, request) in exchanges
        .iter()
        .filter_map(|one| Some((one, one.request.as_ref()?)))
    {
        let name = format!("reply time {}", one.link);
        let known = plots.iter().position(|plot| plot.name == name);
        let index = known.unwrap_or_else(|| {
            plots.push(ReplyTimes {
                name,
                unit: "ms",
                at: Vec::new(),
                values: Vec::new(),
            });
            plots.len() - 1
        });
        plots[index].at.push((request.at_ns / 1_000) as f64 / 1e6);
        plots[index].values.push(one.reply_ms);
    }
    plots.iter_mut().for_each(thin);
    plots
}

fn thin(plot: &mut ReplyTimes) {
    let each = plot.at.len().div_ceil(TIMES_MAX).max(1);
    let rank = |value: &Option<f64>| value.unwrap_or(f64::INFINITY);
    let longest = plot.values.chunks(each).map(|part| {
        let longest = part.iter().max_by(|a, b| rank(a).total_cmp(&rank(b)));
        longest.copied().flatten()
    });
    plot.values = longest.collect();
    plot.at = plot.at.iter().step_by(each).copied().collect();
}

/// Figures of the traffic on one link.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Talk {
    /// Name of the link.
    pub link: String,
    /// Number of all bytes from the device.
    pub bytes_to_master: u64,
    /// Number of all bytes to the device.
    pub bytes_to_device: u64,
    /// Number of the listed requests.
    pub requests: usize,
    /// Number of the listed requests without a reply.
    pub unanswered: usize,
    /// Number of the listed frames from the device that answer no request.
    pub unasked: usize,
    /// Number of the listed stretches of bytes that are no frame.
    pub bad: usize,
    /// Median of the reply times, milliseconds.
    pub reply_ms: Option<f64>,
    /// Longest reply time, milliseconds.
    pub reply_ms_max: Option<f64>,
}

/// Figures of each link of `totals` from the listed exchanges.
pub fn talks(totals: &[(String, [u64; 2])], exchanges: &[Exchange]) -> Vec<Talk> {
    let talk = |(link, [to_master, to_device]): &(String, [u64; 2])| {
        let own = || exchanges.iter().filter(move |one| one.link == *link);
        let count = |is: fn(&Exchange) -> bool| own().filter(|one| is(one)).count();
        let is_bad = |frame: &Option<Frame>| frame.as_ref().is_some_and(|frame| frame.is_bad);
        let mut times: Vec<f64> = own().filter_map(|one| one.reply_ms).collect();
        times.sort_by(f64::total_cmp);
        Talk {
            link: link.to_owned(),
            bytes_to_master: *to_master,
            bytes_to_device: *to_device,
            requests: count(|one| one.request.is_some()),
            unanswered: count(|one| one.reply.is_none()),
            unasked: count(|one| one.request.is_none()),
            bad: own().filter(|one| is_bad(&one.request)).count()
                + own().filter(|one| is_bad(&one.reply)).count(),
            reply_ms: times.get(times.len() / 2).copied(),
            reply_ms_max: times.last().copied(),
        }
    };
    totals.iter().map(talk).collect()
}

#[cfg(test)]
mod tests {
    use protocols::Instant;

    use super::super::WireLog;
    use super::*;

    /// Two links: a request with its reply after 12 ms and an unasked line on the first; a lost
    /// request, a repeated one and its reply after 3 ms on the second. A line per frame.
    #[test]
    fn the_first_frame_after_a_request_is_its_reply() {
        let mut log = WireLog::default();
        let ways = [Direction::ToMaster, Direction::ToDevice];
        let lanes = ["a", "b"].map(|link| ways.map(|way| (link, way, None)));
        log.begin(lanes.into_iter().flatten());
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
        let frames = super::super::all_frames(&log.tails(end, None));
        let all = exchanges(frames);
        let times: Vec<_> = all.iter().map(|one| (&*one.link, one.reply_ms)).collect();
        let expected = [
            ("a", Some(12.0)),
            ("b", None),
            ("a", None),
            ("b", Some(3.0)),
        ];
        assert_eq!(times, expected);
        let [a, b] = &talks(&log.totals(end), &all)[..] else {
            panic!("two links");
        };
        assert_eq!((a.requests, a.unanswered, a.unasked), (1, 0, 1));
        assert_eq!((b.requests, b.unanswered, b.unasked), (2, 1, 0));
        assert_eq!((a.bytes_to_master, a.bytes_to_device), (9, 3));
        assert_eq!([a.reply_ms, b.reply_ms_max], [Some(12.0), Some(3.0)]);
    }
}
