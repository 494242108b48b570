//! Figures of the requests and replies of one link, of the whole run in bounded memory.

use std::collections::BTreeMap;

use protocols::Instant;

use super::exchange::{Exchange, ReplyTimes, Talk};

/// Maximum number of points of a plot.
const POINTS_MAX: usize = 1_000;
/// Maximum number of different reply times; beyond it the resolution is halved.
const TIMES_MAX: usize = 512;

/// Figures of a link.
#[derive(Clone, Debug, Default)]
pub(super) struct Figures {
    /// Start of the count, if it is not the start of the run.
    since: Option<Instant>,
    requests: u64,
    unanswered: u64,
    unasked: u64,
    bad: u64,
    times: Times,
    points: Vec<Point>,
    /// Number of requests per point is 2 to this power.
    doublings: u32,
}

/// Reply times with the number of replies of each.
#[derive(Clone, Debug, Default)]
struct Times {
    /// Times are rounded down to 2 to this power, microseconds.
    doublings: u32,
    counts: BTreeMap<u64, u64>,
    max: Option<u64>,
}

/// The longest reply time of neighbouring requests.
#[derive(Clone, Copy, Debug)]
struct Point {
    at_us: u64,
    reply_us: Option<u64>,
    requests: u64,
}

impl Figures {
    /// Figures that count from `begin` on, not from the start of the run.
    pub(super) fn since(begin: Instant) -> Self {
        Self {
            since: Some(begin),
            ..Self::default()
        }
    }

    pub(super) fn add(&mut self, one: &Exchange) {
        let is_bad = one.frames().filter(|frame| frame.is_bad).count() as u64;
        self.bad += is_bad;
        if is_bad > 0 {
            return;
        }
        let Some(request) = &one.request else {
            self.unasked += 1;
            return;
        };
        let reply_us = one.reply_us();
        self.requests += 1;
        self.unanswered += u64::from(reply_us.is_none());
        if let Some(time) = reply_us {
            self.times.add(time);
        }
        self.plot(Point {
            at_us: request.at_ns / 1_000,
            reply_us,
            requests: 1,
        });
    }

    fn plot(&mut self, point: Point) {
        let each = 1 << self.doublings;
        match self.points.last_mut().filter(|last| last.requests < each) {
            Some(last) => *last = last.and(point),
            None => self.points.push(point),
        }
        if self.points.len() > POINTS_MAX {
            self.doublings += 1;
            let pairs = self.points.chunks(2);
            let merged = pairs.map(|pair| pair.iter().copied().reduce(Point::and));
            self.points = merged.flatten().collect();
        }
    }

    /// Figures of `link`, which carried `bytes` to the master and to the device.
    pub(super) fn talk(&self, link: &str, bytes: [u64; 2]) -> Talk {
        let ms = |micros: u64| micros as f64 / 1_000.0;
        Talk {
            link: link.to_owned(),
            since_s: self.since.map(|since| since.as_secs_f64()),
            bytes_to_master: bytes[0],
            bytes_to_device: bytes[1],
            requests: self.requests,
            unanswered: self.unanswered,
            unasked: self.unasked,
            bad: self.bad,
            reply_ms: self.times.median_ms(),
            reply_ms_max: self.times.max.map(ms),
        }
    }

    /// The plot of `link`; `None` without requests.
    pub(super) fn reply_times(&self, link: &str) -> Option<ReplyTimes> {
        let points = || self.points.iter();
        (!self.points.is_empty()).then(|| ReplyTimes {
            name: format!("reply time {link}"),
            unit: "ms",
            at: points().map(|point| point.at_us as f64 / 1e6).collect(),
            values: points()
                .map(|point| Some(point.reply_us? as f64 / 1_000.0))
                .collect(),
        })
    }
}

impl Point {
    /// Both points in one: the longer reply time at its own time.
    fn and(self, other: Self) -> Self {
        let longer = if other.reply_us > self.reply_us {
            other
        } else {
            self
        };
        Self {
            requests: self.requests + other.requests,
            ..longer
        }
    }
}

impl Times {
    fn add(&mut self, micros: u64) {
        self.max = self.max.max(Some(micros));
        *self.counts.entry(self.rounded(micros)).or_default() += 1;
        while self.counts.len() > TIMES_MAX {
            self.doublings += 1;
            for (time, count) in core::mem::take(&mut self.counts) {
                *self.counts.entry(self.rounded(time)).or_default() += count;
            }
        }
    }

    const fn rounded(&self, micros: u64) -> u64 {
        micros >> self.doublings << self.doublings
    }

    /// The median; the mean of both middle times if their number is even.
    fn median_ms(&self) -> Option<f64> {
        let all: u64 = self.counts.values().sum();
        let nth = |nth: u64| {
            let mut before = 0;
            let mut times = self.counts.iter();
            let found = times.find(|(_, count)| {
                before += **count;
                before > nth
            });
            found.map(|(time, _)| *time)
        };
        let (lower, upper) = (nth(all.checked_sub(1)? / 2)?, nth(all / 2)?);
        Some((lower + upper) as f64 / 2_000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 10 and 20 ms give 15 ms; a third time of 20 ms gives 20 ms.
    #[test]
    fn the_median_of_two_times_lies_between_them() {
        let mut times = Times::default();
        assert_eq!(times.median_ms(), None);
        times.add(10_000);
        times.add(20_000);
        assert_eq!(times.median_ms(), Some(15.0));
        times.add(20_000);
        assert_eq!(times.median_ms(), Some(20.0));
    }

    /// 0 to 1023 us once each: 512 different times remain, of 2 us each. Time 1023 stays exact.
    #[test]
    fn many_different_times_cost_resolution() {
        let mut times = Times::default();
        (0..1_024).for_each(|micros| times.add(micros));
        assert_eq!((times.counts.len(), times.doublings), (512, 1));
        assert_eq!((times.median_ms(), times.max), (Some(0.511), Some(1_023)));
    }

    /// 4000 requests, every second one lost: no point is a gap, and each value has its own time.
    #[test]
    fn lost_replies_do_not_hide_the_others_in_a_long_plot() {
        let mut figures = Figures::default();
        for at_us in 0..4_000 {
            let reply_us = (at_us % 2 == 1).then_some(at_us);
            figures.plot(Point {
                at_us,
                reply_us,
                requests: 1,
            });
        }
        let plot = figures.reply_times("a").expect("it has requests");
        assert!(plot.at.len() <= POINTS_MAX && plot.at.len() >= POINTS_MAX / 2);
        let own = |(at, value): (&f64, &Option<f64>)| {
            value.is_some_and(|value| (value - at * 1_000.0).abs() < 1e-6)
        };
        assert!(plot.at.iter().zip(&plot.values).all(own), "{plot:?}");
    }

    use super::super::Frame;

    fn frame(at_us: u64, is_bad: bool) -> Frame {
        Frame {
            at_ns: 1_000 * at_us,
            link: "a".to_owned(),
            way: "to-device",
            words: String::new(),
            bytes: String::new(),
            is_bad,
            is_hit: false,
        }
    }

    /// A request at 1 ms with its reply 250 us later, one without, a frame without a request,
    /// and invalid bytes of both directions.
    #[test]
    fn exchanges_are_counted_by_kind() {
        let exchange = |request: Option<(u64, bool)>, reply: Option<(u64, bool)>| Exchange {
            link: "a".to_owned(),
            request: request.map(|(at_us, is_bad)| frame(at_us, is_bad)),
            reply: reply.map(|(at_us, is_bad)| frame(at_us, is_bad)),
            reply_ms: None,
        };
        let mut figures = Figures::since(Instant::from_millis(500));
        assert_eq!(figures.reply_times("a"), None);
        for one in [
            exchange(Some((1_000, false)), Some((1_250, false))),
            exchange(Some((2_000, false)), None),
            exchange(None, Some((3_000, false))),
            exchange(None, Some((4_000, true))),
            exchange(Some((5_000, true)), Some((6_000, true))),
        ] {
            figures.add(&one);
        }
        let talk = figures.talk("a", [7, 9]);
        assert_eq!((talk.link.as_str(), talk.since_s), ("a", Some(0.5)));
        assert_eq!((talk.bytes_to_master, talk.bytes_to_device), (7, 9));
        assert_eq!(
            (talk.requests, talk.unanswered, talk.unasked, talk.bad),
            (2, 1, 1, 3)
        );
        assert_eq!((talk.reply_ms, talk.reply_ms_max), (Some(0.25), Some(0.25)));
        let plot = figures.reply_times("a").expect("two requests");
        assert_eq!((plot.name.as_str(), plot.unit), ("reply time a", "ms"));
        assert_eq!(
            (plot.at, plot.values),
            (vec![0.001, 0.002], vec![Some(0.25), None])
        );
    }

    /// Of 1,001 points each two become one, the last one stays alone; further ones fill it.
    #[test]
    fn points_are_united_in_pairs() {
        let mut figures = Figures::default();
        let mut plot = |at_us: u64, reply_us: u64| {
            figures.plot(Point {
                at_us,
                reply_us: Some(reply_us),
                requests: 1,
            });
            (figures.points.len(), figures.doublings)
        };
        for at_us in 0..999 {
            plot(at_us, 5);
        }
        assert_eq!(plot(999, 5), (1_000, 0));
        assert_eq!(plot(1_000, 5), (501, 1));
        assert_eq!(plot(1_001, 9), (501, 1));
        assert_eq!(plot(1_002, 9), (502, 1));
        let [.., last, _] = &figures.points[..] else {
            panic!("many");
        };
        assert_eq!(
            (last.at_us, last.reply_us, last.requests),
            (1_001, Some(9), 2)
        );
        // Of two equal ones the earlier stays.
        let first = figures.points[0];
        assert_eq!((first.at_us, first.requests), (0, 2));
    }

    /// 1 us three times and 4 us once: the median is 1 us. With 4 us three times it is 2.5 us.
    #[test]
    fn a_median_regards_how_often_a_time_came() {
        let mut times = Times::default();
        for micros in [1, 1, 1, 4] {
            times.add(micros);
        }
        assert_eq!(times.median_ms(), Some(0.001));
        for micros in [4, 4] {
            times.add(micros);
        }
        assert_eq!((times.median_ms(), times.max), (Some(0.0025), Some(4)));
        times.doublings = 2;
        assert_eq!(
            [3, 4, 7, 8].map(|micros| times.rounded(micros)),
            [0, 4, 4, 8]
        );
    }
}
