//! Requests and replies of all links: figures of the whole run, and the last ones in full.
//!
//! A mark holds the figures of a link up to a place between two frames. Bytes after the mark are
//! counted when they are asked for, or when the next mark is made.

use protocols::Instant;
use serde::Serialize;

use super::exchange::{Exchange, ReplyTimes, Talk, paired};
use super::figures::Figures;
use super::tail::{Placed, Tail};
use super::{Frame, LoggedLane, WireLog};
use crate::codec::Codec;
use crate::rig::LinkKind;

/// Maximum number of marks of a link: for a page, which goes back, and for a report.
const MARKS_MAX: [usize; 2] = [32, 4];
/// Maximum number of bytes between two marks.
const STEP_MAX: usize = 1 << 15;
/// Number of bytes before the asked time whose frames are listed.
const LISTED_BYTES: u64 = 20_000;

/// The marks of a link, oldest first.
#[derive(Clone, Debug)]
pub(super) struct Marks {
    all: Vec<Mark>,
    /// Maximum number of marks.
    most: usize,
    /// Number of bytes of one direction between two marks.
    step: u64,
    /// Offsets at which the next mark is due, by direction.
    next: [u64; 2],
}

/// The figures until a time.
#[derive(Clone, Debug, Default)]
struct Mark {
    at: Instant,
    /// Offsets behind the counted bytes, by direction.
    from: [u64; 2],
    figures: Figures,
    /// The last request, while it waits for a reply; not counted yet.
    open: Option<Exchange>,
    /// The last counted frame that its decoder recognises alone, by direction.
    primers: [Vec<u8>; 2],
}

impl Marks {
    pub(super) fn new(bytes_max: usize) -> Self {
        let step = (bytes_max / 16).clamp(1, STEP_MAX) as u64;
        let is_report = step < STEP_MAX as u64;
        Self {
            all: vec![Mark::default()],
            most: MARKS_MAX[usize::from(is_report)],
            step,
            next: [step; 2],
        }
    }

    /// The newest mark with at least the bytes to be listed between it and `until`; otherwise the
    /// oldest one whose bytes are stored.
    fn before(&self, until: Instant, lanes: &[LoggedLane; 2]) -> &Mark {
        let stored = || self.all.iter().filter(|mark| mark.is_stored(lanes));
        let is_early = |mark: &&Mark| {
            let mut ends = lanes.iter().map(|lane| lane.end_at(until)).zip(mark.from);
            mark.at <= until && ends.any(|(end, from)| from + LISTED_BYTES <= end)
        };
        let newest = stored().rfind(is_early);
        let found = newest.or_else(|| stored().next()).or(self.all.last());
        found.expect("there is always a mark")
    }

    fn add(&mut self, mark: Mark, lanes: &[LoggedLane; 2]) {
        self.all.push(mark);
        let kept = self.all.iter().position(|mark| mark.is_stored(lanes));
        self.all.drain(..kept.unwrap_or(self.all.len() - 1));
        if self.all.len() > self.most {
            let mut number = 0;
            self.all.retain(|_| {
                number += 1;
                number % 2 == 1 || number > self.most
            });
        }
    }
}

/// The bytes and figures from which a [`Dialogue`] is made, without the log's lock.
#[derive(Debug)]
pub struct Heard {
    until: Instant,
    links: Vec<HeardLink>,
}

#[derive(Debug)]
struct HeardLink {
    name: String,
    bytes: [u64; 2],
    mark: Mark,
    tails: [Tail; 2],
}

/// Requests and replies of all links until a time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Dialogue {
    /// Figures of each link.
    pub talks: Vec<Talk>,
    /// Reply times of each link that carried requests.
    pub plots: Vec<ReplyTimes>,
    /// The last exchanges, in order of time.
    pub exchanges: Vec<Exchange>,
    /// Start of the listed exchanges, seconds; zero if the list is complete.
    pub listed_from_s: f64,
    /// Time until which the figures count, seconds, if the bytes of the asked time are no longer
    /// kept.
    pub late_s: Option<f64>,
}

impl WireLog {
    /// The requests and replies until `until`.
    pub fn heard(&self, until: Instant) -> Heard {
        let links = self.lanes.as_chunks::<2>().0.iter().zip(&self.marks);
        // A pin has levels, no messages.
        let links = links.filter(|(lanes, _)| lanes[0].kind != LinkKind::Pin);
        let links = links.map(|(lanes, marks)| {
            let ends = lanes.each_ref().map(|lane| lane.end_at(until));
            let mark = marks.before(until, lanes).clone();
            HeardLink {
                name: lanes[0].link.clone(),
                bytes: [0, 1].map(|way| ends[way].max(mark.from[way])),
                tails: sections(lanes, &mark, until),
                mark,
            }
        });
        let links = links.collect();
        Heard { until, links }
    }

    /// Adds a mark to the link of lane `index` if it is due.
    pub(super) fn count(&mut self, index: usize, now: Instant) {
        let (link, way) = (index / 2, index % 2);
        let Some((marks, lanes)) = self
            .marks
            .get_mut(link)
            .zip(self.lanes.as_chunks::<2>().0.get(link))
        else {
            return;
        };
        let is_short = lanes[way].end < marks.next[way];
        if is_short || lanes[0].kind == LinkKind::Pin {
            return;
        }
        marks.next = lanes.each_ref().map(|lane| lane.end + marks.step);
        let last = marks.all.last().expect("it is never empty");
        let tails = sections(lanes, last, now);
        let mark = last.after(&tails);
        marks.add(mark, lanes);
    }

    /// Removes the counts after `until`.
    pub(super) fn cut_marks(&mut self, until: Instant) {
        for (marks, lanes) in self.marks.iter_mut().zip(self.lanes.as_chunks::<2>().0) {
            marks.all.retain(|mark| mark.at <= until);
            marks.next = lanes.each_ref().map(|lane| lane.end + marks.step);
            if marks.all.is_empty() {
                marks.all.push(Mark {
                    at: until,
                    from: lanes.each_ref().map(|lane| lane.end),
                    figures: Figures::since(until),
                    ..Mark::default()
                });
            }
        }
    }
}

/// The bytes of both directions after `mark`.
fn sections(lanes: &[LoggedLane; 2], mark: &Mark, until: Instant) -> [Tail; 2] {
    [0, 1].map(|way| {
        let mut tail = lanes[way].section(mark.from[way], until);
        tail.is_whole = tail.from == mark.from[way];
        tail.primer.clone_from(&mark.primers[way]);
        if tail.codec.is_none() {
            tail.pause_where(&lanes[1 - way].pieces);
        }
        tail
    })
}

/// The frames of both directions in order of time.
fn merged(tails: &[Tail; 2]) -> Vec<(usize, Placed)> {
    let both = tails.iter().enumerate();
    let mut all: Vec<_> = both
        .flat_map(|(way, tail)| tail.placed().into_iter().map(move |one| (way, one)))
        .collect();
    all.sort_by_key(|(_, one)| one.frame.at_ns);
    all
}

impl Mark {
    /// Whether the bytes behind the mark are stored.
    fn is_stored(&self, lanes: &[LoggedLane; 2]) -> bool {
        let mut places = self.from.iter().zip(lanes);
        places.all(|(from, lane)| *from >= lane.first())
    }

    /// The mark behind the settled frames of `tails`.
    fn after(&self, tails: &[Tail; 2]) -> Self {
        let mut mark = self.clone();
        let all = merged(tails);
        let settled: Vec<_> = all
            .into_iter()
            .take_while(|(_, one)| one.is_settled)
            .collect();
        for (way, one) in &settled {
            mark.from[*way] = one.place.end;
            mark.at = Instant::from_nanos(one.frame.at_ns);
        }
        mark.primers = [0, 1].map(|way| {
            let own = settled.iter().rev().filter(|(of, _)| *of == way);
            primer(&tails[way], own.map(|(_, one)| one))
                .unwrap_or_else(|| self.primers[way].clone())
        });
        let frames = settled.into_iter().map(|(_, one)| one.frame).collect();
        let mut exchanges = paired(mark.open.take(), frames);
        // Only invalid bytes can follow a request that waits.
        let open = exchanges
            .iter()
            .rposition(|one| one.request.is_some() && !one.is_bad());
        if let Some(open) = open.filter(|open| exchanges[*open].is_unanswered()) {
            mark.open = Some(exchanges.remove(open));
        }
        exchanges.iter().for_each(|one| mark.figures.add(one));
        mark
    }
}

/// The last frame that sets the state of a decoder. `own` has the frames from the last one on.
fn primer<'a>(tail: &Tail, own: impl Iterator<Item = &'a Placed>) -> Option<Vec<u8>> {
    let codec: &'static Codec = tail.codec?;
    let bytes = |one: &Placed| {
        let range = [one.place.start, one.place.end].map(|at| super::as_index(at - tail.from));
        tail.bytes[range[0]..range[1]].to_vec()
    };
    let frames = own.filter(|one| !one.frame.is_bad).map(bytes);
    let mut alone = frames.filter(|frame| {
        let found = codec.found_towards(frame, tail.way);
        found.len() == 1 && found[0].is_frame()
    });
    alone.next()
}

impl Heard {
    /// The requests and replies, the last `most` of them in full.
    pub fn dialogue(self, most: usize) -> Dialogue {
        let mut dialogue = Dialogue {
            talks: Vec::new(),
            plots: Vec::new(),
            exchanges: Vec::new(),
            listed_from_s: 0.0,
            late_s: None,
        };
        let (mut from, mut late): (Option<u64>, Option<Instant>) = (None, None);
        for link in self.links {
            let frames: Vec<Frame> = merged(&link.tails)
                .into_iter()
                .map(|(_, one)| one.frame)
                .collect();
            let mut figures = link.mark.figures;
            if link.mark.at > self.until {
                late = late.max(Some(link.mark.at));
            }
            if link.mark.from != [0, 0] {
                from = from.max(Some(link.mark.at.as_nanos()));
            }
            let open = link
                .mark
                .open
                .filter(|one| one.begin_ns() <= self.until.as_nanos());
            let exchanges = paired(open, frames);
            exchanges.iter().for_each(|one| figures.add(one));
            dialogue.talks.push(figures.talk(&link.name, link.bytes));
            dialogue.plots.extend(figures.reply_times(&link.name));
            dialogue.exchanges.extend(exchanges);
        }
        let exchanges = &mut dialogue.exchanges;
        exchanges.sort_by_key(Exchange::begin_ns);
        // All links are listed from the same time on.
        if let Some(from) = from {
            exchanges.retain(|one| one.begin_ns() > from);
        }
        let skipped = exchanges.len().saturating_sub(most);
        if skipped > 0 {
            from = exchanges.get(skipped).map(Exchange::begin_ns);
        }
        exchanges.drain(..skipped);
        dialogue.late_s = late.map(Instant::as_secs_f64);
        dialogue.listed_from_s = from.map_or(0.0, |from| from as f64 / 1e9);
        dialogue
    }
}

#[cfg(test)]
mod tests {
    use super::super::Lane;
    use super::*;
    use crate::codec::{BUS, RPLIDAR};
    use crate::rig::line::Direction;

    fn log(bytes_max: usize, kind: LinkKind, codec: Option<&'static Codec>) -> WireLog {
        let mut log = WireLog {
            bytes_max,
            ..WireLog::default()
        };
        let ways = [Direction::ToMaster, Direction::ToDevice];
        let lanes = ways.map(|way| Lane {
            link: "a",
            way,
            kind,
            codec,
        });
        log.begin(lanes.into_iter());
        log.count_exchanges();
        log
    }

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn text(millis: u64, log: &mut WireLog, way: usize, line: &str) {
        log.push(way, at(millis), line.as_bytes());
    }

    /// A request is not paired with a reply of another period, and the figures are not only those
    /// of the last bytes. 20 requests a second with 8 bytes, replies with 25 bytes after 7 ms; the
    /// log keeps 4096 bytes. Of 10000 requests, the one at 50 s had no reply, and the one at 100 s
    /// had it after 30 ms.
    #[test]
    fn figures_are_of_the_whole_run_and_rows_of_its_end() {
        let mut log = log(4_096, LinkKind::Uart, None);
        for number in 0..10_000 {
            let begin = 50 * number;
            text(begin, &mut log, 1, "weight\r\n");
            let reply = if begin == 100_000 { 30 } else { 7 };
            if begin != 50_000 {
                text(begin + reply, &mut log, 0, "S S     1234.567 kg abc\r\n");
            }
        }
        let told = log.heard(at(500_000)).dialogue(200);
        let talk = &told.talks[0];
        assert_eq!((talk.requests, talk.unanswered), (10_000, 1));
        assert_eq!((talk.unasked, talk.bad, talk.since_s), (0, 0, None));
        assert_eq!((talk.reply_ms, talk.reply_ms_max), (Some(7.0), Some(30.0)));
        assert_eq!(
            [talk.bytes_to_device, talk.bytes_to_master],
            [80_000, 9_999 * 25]
        );
        // 4096 bytes have 163 replies of 25 bytes.
        let rows = told.exchanges.len();
        assert!((50..=163).contains(&rows), "{rows}");
        assert!(told.exchanges.iter().all(|one| one.reply_ms == Some(7.0)));
        assert!(told.listed_from_s > 490.0, "{}", told.listed_from_s);
        let plot = &told.plots[0];
        let longest = plot.values.iter().position(|ms| *ms == Some(30.0));
        assert_eq!(longest.map(|place| plot.at[place]), Some(100.0));
        // The past that is stored has its own figures, and the figures of a lost past say so.
        assert_eq!(log.heard(at(499_000)).dialogue(5).talks[0].requests, 9_981);
        let late = log.heard(at(1_000)).dialogue(5);
        assert!(
            late.exchanges.is_empty() && late.late_s > Some(480.0),
            "{late:?}"
        );
        log.cut(at(499_000));
        assert_eq!(log.heard(at(500_000)).dialogue(5).talks[0].requests, 9_981);
        log.cut(at(1_000));
        text(1_050, &mut log, 1, "weight\r\n");
        let talk = log.heard(at(2_000)).dialogue(5).talks.remove(0);
        assert_eq!((talk.requests, talk.since_s), (1, Some(1.0)));
    }

    /// The first stored bytes of a stream are not taken for the reply to the request that began it.
    /// The reply came after 12 ms; 2000 lines without a request follow, 10 ms apart.
    #[test]
    fn a_stream_is_not_the_reply_to_its_start() {
        let mut log = log(4_096, LinkKind::Uart, None);
        text(1_000, &mut log, 1, "start\n");
        for number in 0..2_001 {
            text(1_012 + 10 * number, &mut log, 0, "mm=700\n");
        }
        let talk = log.heard(at(60_000)).dialogue(5).talks.remove(0);
        assert_eq!(
            (talk.requests, talk.unanswered, talk.unasked),
            (1, 0, 2_000)
        );
        assert_eq!(talk.reply_ms_max, Some(12.0));
    }

    /// A read of the bus chapter, noise, and its reply 5 ms after the read: the noise is no reply.
    /// Then half of a reply before a silence to the end: invalid bytes, and no reply.
    #[test]
    fn invalid_bytes_are_no_reply() {
        use protocols::avr::{ChecksumOrder, Frame as Bus};
        let mut log = log(4_096, LinkKind::Uart, Some(&BUS));
        let frame = Bus::read(36, 10, ChecksumOrder::LowFirst);
        log.push(1, at(10), frame.as_bytes());
        log.push(0, at(11), &[0x55, 0x55]);
        log.push(0, at(15), frame.as_bytes());
        log.push(1, at(500), frame.as_bytes());
        log.push(0, at(505), &frame.as_bytes()[..3]);
        let told = log.heard(at(1_000)).dialogue(9);
        let talk = &told.talks[0];
        assert_eq!((talk.requests, talk.unanswered, talk.bad), (2, 1, 2));
        assert_eq!((talk.unasked, talk.reply_ms_max), (0, Some(5.0)));
        let bad: Vec<_> = told.exchanges.iter().filter(|one| one.is_bad()).collect();
        assert_eq!(bad.len(), 2);
        assert!(
            bad.iter()
                .all(|one| one.request.is_none() && !one.is_unanswered())
        );
    }

    /// A level of a pin is no request. Two messages of a bus within 1 ms are two requests.
    #[test]
    fn pins_have_no_requests_and_messages_stay_whole() {
        for (kind, expected) in [(LinkKind::Pin, None), (LinkKind::I2c, Some(2))] {
            let mut log = log(4_096, kind, None);
            log.push(1, at(1), &[1]);
            log.push(1, at(2), &[2, 3]);
            let told = log.heard(at(1_000)).dialogue(9);
            assert_eq!(told.talks.first().map(|talk| talk.requests), expected);
            assert_eq!(super::super::frames(&log.tails(at(9), None)).len(), 2);
        }
    }

    /// A format whose frames depend on an earlier one, as an RPLIDAR's nodes on their descriptor,
    /// is read from the middle. A request, its descriptor, and 2000 nodes: 10000 bytes, of which
    /// 4096 are stored.
    #[test]
    fn a_stream_stays_valid_when_its_begin_is_no_longer_stored() {
        let mut log = log(4_096, LinkKind::Uart, Some(&RPLIDAR));
        log.push(1, at(1), &[0xA5, 0x20]);
        log.push(0, at(3), &[0xA5, 0x5A, 0x05, 0, 0, 0x40, 0x81]);
        for node in 0..2_000 {
            // Quality 15; the check bit of the angle is set, the start bits are inverse.
            let start = if node % 400 == 0 { 0x3D } else { 0x3E };
            log.push(0, at(4 + node), &[start, 0x01, 0x10, 0x00, 0x20]);
        }
        let talk = log.heard(at(60_000)).dialogue(5).talks.remove(0);
        assert_eq!((talk.requests, talk.unanswered, talk.bad), (1, 0, 0));
        assert_eq!((talk.unasked, talk.reply_ms_max), (2_000, Some(2.0)));
    }

    /// A sixteenth of the stored bytes, at most 32 KiB, lie between two marks; a page keeps 32 of
    /// them, a report four.
    #[test]
    fn marks_are_as_far_apart_as_the_log_is_long() {
        let of = |bytes_max: usize| {
            let marks = Marks::new(bytes_max);
            assert_eq!(marks.next, [marks.step; 2]);
            (marks.step, marks.most)
        };
        assert_eq!(of(4_096), (256, 4));
        assert_eq!(of(1 << 19), (1 << 15, 32));
        assert_eq!(of((1 << 19) - 16), ((1 << 15) - 1, 4));
        assert_eq!([of(1 << 22).0, of(9).0], [1 << 15, 1]);
    }

    fn lanes() -> [LoggedLane; 2] {
        let log = log(1 << 20, LinkKind::Uart, None);
        let [up, down] = &log.lanes[..] else {
            panic!("two lanes")
        };
        [up.clone(), down.clone()]
    }

    fn mark(millis: u64, from: [u64; 2]) -> Mark {
        Mark {
            at: at(millis),
            from,
            ..Mark::default()
        }
    }

    /// Four marks: the fifth drops every second one of the older ones.
    #[test]
    fn old_marks_are_thinned() {
        let mut marks = Marks::new(4_096);
        let lanes = lanes();
        let times = |marks: &Marks| {
            let all = marks.all.iter();
            all.map(|mark| mark.at.as_millis()).collect::<Vec<_>>()
        };
        for millis in [1, 2, 3] {
            marks.add(mark(millis, [0; 2]), &lanes);
        }
        assert_eq!(times(&marks), [0, 1, 2, 3]);
        marks.add(mark(4, [0; 2]), &lanes);
        assert_eq!(times(&marks), [0, 2, 4]);
        for millis in [5, 6] {
            marks.add(mark(millis, [0; 2]), &lanes);
        }
        assert_eq!(times(&marks), [0, 4, 6]);
    }

    /// Bytes 100 and on are stored of one lane, all of the other one: a mark needs both.
    #[test]
    fn marks_without_their_bytes_are_dropped() {
        let mut lanes = lanes();
        lanes[0].end = 100;
        let stored = |from| mark(1, from).is_stored(&lanes);
        assert!(stored([100, 0]) && stored([101, 7]) && !stored([99, 7]));
        let mut marks = Marks::new(4_096);
        for (millis, from) in [(1, [50, 0]), (2, [100, 0])] {
            marks.add(mark(millis, from), &lanes);
        }
        let froms: Vec<[u64; 2]> = marks.all.iter().map(|mark| mark.from).collect();
        assert_eq!(froms, [[100, 0]]);
        // Without any stored one the newest stays.
        marks.add(mark(3, [90, 0]), &lanes);
        lanes[1].end = 5;
        marks.add(mark(4, [100, 4]), &lanes);
        assert_eq!(marks.all.len(), 1);
        assert_eq!(marks.all[0].at, at(4));
    }

    /// The newest mark that is at least 20,000 bytes of one direction, and in time, before the end.
    #[test]
    fn a_mark_leaves_the_listed_bytes() {
        let mut log = log(1 << 20, LinkKind::Uart, None);
        for millis in 1..=50 {
            log.push(0, at(millis), &[7; 1_000]);
        }
        let [up, down] = &log.lanes[..] else {
            panic!("two lanes")
        };
        let lanes = [up.clone(), down.clone()];
        let mut marks = Marks::new(1 << 20);
        for (millis, from) in [(10, 10_000), (20, 20_000), (30, 30_000), (31, 30_001)] {
            marks.all.push(mark(millis, [from, 0]));
        }
        let before = |until: u64| marks.before(at(until), &lanes).at.as_millis();
        assert_eq!(
            [before(50), before(49), before(40), before(39)],
            [30, 20, 20, 10]
        );
        assert_eq!(before(5), 0);
    }

    /// Five requests, a second apart: the last two are listed from 4 s on; all of them from the
    /// start.
    #[test]
    fn a_list_begins_with_its_first_exchange() {
        let mut log = log(4_096, LinkKind::Uart, None);
        for second in 1..=5 {
            text(1_000 * second, &mut log, 1, "weight\n");
            text(1_000 * second + 7, &mut log, 0, "7 kg\n");
        }
        let listed = |most: usize| {
            let told = log.heard(at(10_000)).dialogue(most);
            (told.exchanges.len(), told.listed_from_s)
        };
        assert_eq!(
            [listed(2), listed(5), listed(9)],
            [(2, 4.0), (5, 0.0), (5, 0.0)]
        );
    }

    /// Behind a branch the next mark is due a step later: 256 bytes of 4,096.
    #[test]
    fn a_branch_begins_a_step_anew() {
        let mut log = log(4_096, LinkKind::Uart, None);
        log.push(0, at(1), &[7; 100]);
        log.push(1, at(2), &[7; 40]);
        log.push(0, at(9), &[7; 100]);
        log.cut(at(2));
        assert_eq!(log.marks[0].next, [100 + 256, 40 + 256]);
    }
}
