//! A capture as a conversation: requests with their replies.

use core::ops::Range;
use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet};

use protocols::{Instant, LineConfig};

use super::cut::{Cut, Piece};
use super::unsolicited::{are_unsolicited, kind};
use crate::divergence::Track;
use crate::replay::Passage;
use engine::codec::Codec;
use engine::rig::line::Direction;

/// Bytes of the other side that belong together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Message {
    /// The pieces, and the time of the last byte of each, counted from the cause.
    pub(super) parts: Vec<(Duration, Vec<u8>)>,
    /// Whether the message is the reply, or follows it at once.
    pub(super) is_reply: bool,
    /// Whether the device sends such messages by itself, after any request.
    pub(super) is_pushed: bool,
}

impl Message {
    /// Times, counted from the cause, at which the pieces are handed over: with a `line`, when
    /// their transmission begins. The line sends one byte after the other, so a piece begins early
    /// enough for the pieces behind it.
    pub(super) fn starts(&self, line: Option<LineConfig>) -> Vec<Duration> {
        let Some(line) = line else {
            return self.parts.iter().map(|&(after, _)| after).collect();
        };
        let mut next = Duration::MAX;
        let mut starts = Vec::new();
        for (after, bytes) in self.parts.iter().rev() {
            let lead = line.bytes_time(bytes.len() as u64);
            next = next.min(*after).saturating_sub(lead);
            starts.push(next);
        }
        starts.reverse();
        starts
    }
}

/// A request of the program, and the bytes of the other side until the next request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Exchange {
    /// The program's bytes.
    pub(super) request: Vec<u8>,
    /// Time of its last byte in the capture.
    pub(super) at: Instant,
    /// Number of its first byte among all bytes of the program.
    pub(super) byte: usize,
    /// The messages that follow.
    pub(super) answers: Vec<Message>,
    /// Whether there is a reply, and no byte of it is damaged, as far as its protocol is known.
    pub(super) is_answered: bool,
    /// The end of a stream that the request started; it is repeated until the next request.
    pub(super) tail: Option<Tail>,
}

/// One link of a capture as a conversation.
#[derive(Clone)]
pub(super) struct Script {
    /// Coding of the line.
    pub(super) line: LineConfig,
    /// Bytes after the port is opened, for each opening in the capture.
    pub(super) openings: Vec<Vec<Message>>,
    /// Periodic bytes, independent of requests; times count from the first opening.
    pub(super) stream: Vec<Message>,
    /// The end of that stream, which is repeated if the stream lasted to the end of the capture.
    pub(super) tail: Option<Tail>,
    /// Requests in their order.
    pub(super) exchanges: Vec<Exchange>,
    /// Method of distinguishing requests.
    pub(super) cut: Cut,
    /// The longest time between two requests, or before the first.
    pub(super) longest_gap: Duration,
}

/// The last messages of a stream that lasted to the end of the capture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Tail {
    /// The messages, timed as the stream.
    pub(super) messages: Vec<Message>,
    /// Time after which they are repeated.
    pub(super) period: Duration,
}

impl Tail {
    /// The tail of `stream`, if it continued to the end of a session that lasted `lasted`.
    fn of(stream: &[Message], lasted: Duration) -> Option<Self> {
        let ends = |message: &Message| message.parts.last().map(|&(after, _)| after);
        let (first, last) = (
            stream.first().and_then(ends)?,
            stream.last().and_then(ends)?,
        );
        let gap = last.saturating_sub(first) / u32::try_from(stream.len() - 1).ok()?.max(1);
        let goes_on = lasted.saturating_sub(last) <= gap * STREAM_GAPS + BURST_GAP;
        let begins = |message: &Message| ends(message).is_some_and(|at| at + TAIL >= last);
        let index = stream.iter().position(begins)?.max(1);
        let before = ends(stream.get(index - 1)?)?;
        let period = last.saturating_sub(before);
        let is_stream = stream.len() >= STREAM_LEN && !period.is_zero();
        (goes_on && is_stream).then(|| Self {
            messages: stream[index..].to_vec(),
            period,
        })
    }
}

/// Minimum number of messages of a stream.
const STREAM_LEN: usize = 10;
/// A stream counts as endless if the capture ends within this many of its gaps after its last
/// message.
const STREAM_GAPS: u32 = 3;
/// Length of the end that is repeated.
const TAIL: Duration = Duration::from_secs(1);
/// Maximum pause within a reply of several messages.
const BURST_GAP: Duration = Duration::from_millis(20);
/// Time from the opening to the first message of a capture that begins with a message. Such a
/// capture does not contain the opening, and many programs discard bytes from before they were
/// ready.
const BEGINS_AFTER: Duration = Duration::from_millis(100);
/// Minimum number of messages after a request that count as a stream.
const STREAM_MIN: usize = 16;

/// Cause of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cause {
    Opening(usize),
    Request(usize),
}

impl Script {
    /// The conversation on `passage`; `session` is the time of the program's session in the
    /// capture.
    pub(super) fn of(passage: &Passage, session: &Range<Instant>) -> Self {
        let origin = session.start;
        let line = passage.line();
        let mut said = Track::default();
        let begins = passage.opened.first().copied().unwrap_or(origin);
        for arrival in passage.arrivals.iter().filter(|one| one.at >= begins) {
            said.push(arrival.at, &arrival.bytes);
        }
        let cut = Cut::of(passage.sent.bytes());
        let starts = said.pieces().map(|(at, _)| at).collect::<Vec<_>>();
        let mut byte = 0;
        let requests = cut.messages(&passage.sent, line, &starts).into_iter();
        let exchanges = requests.map(|parts| {
            let at = parts.last().map_or(origin, |piece| piece.at);
            let request: Vec<u8> = parts.into_iter().flat_map(|piece| piece.bytes).collect();
            let first = byte;
            byte += request.len();
            Exchange {
                request,
                at,
                byte: first,
                answers: Vec::new(),
                is_answered: false,
                tail: None,
            }
        });
        let mut this = Self {
            line,
            openings: Vec::new(),
            stream: Vec::new(),
            tail: None,
            exchanges: exchanges.collect(),
            cut,
            longest_gap: Duration::ZERO,
        };
        // The program did not receive bytes from before it opened the port.
        let opened = match &passage.opened[..] {
            [] => vec![origin],
            opened => opened.to_vec(),
        };
        this.openings = vec![Vec::new(); opened.len()];
        this.attach(&said, &opened);
        this.tail = Tail::of(&this.stream, session.end - begins);
        let next = this.exchanges.iter().skip(1).map(|one| one.at);
        let ends: Vec<Instant> = next.chain([session.end]).collect();
        for (exchange, end) in this.exchanges.iter_mut().zip(ends) {
            exchange.tail = Tail::of(&exchange.answers, end - exchange.at);
        }
        let times = this.exchanges.iter().map(|one| one.at);
        let times: Vec<Instant> = core::iter::once(begins).chain(times).collect();
        let gaps = times.windows(2).map(|pair| pair[1] - pair[0]);
        this.longest_gap = gaps.max().unwrap_or_default();
        this
    }

    /// Assigns its cause to each message of the other side.
    fn attach(&mut self, said: &Track, opened: &[Instant]) {
        let cut = Cut::of(said.bytes());
        let asked: Vec<Instant> = self.exchanges.iter().map(|one| one.at).collect();
        let messages = cut.messages(said, self.line, &asked);
        let free = are_unsolicited(cut, &messages, &asked);
        let begins_with_it = messages.first().is_some_and(|one| one[0].at == opened[0]);
        let mut kinds = vec![Vec::new(); self.exchanges.len()];
        for (parts, is_free) in messages.into_iter().zip(free) {
            // The record counts: on a pseudo-terminal, bytes take no time.
            let at = parts[0].arrived;
            let opening = opened.partition_point(|&time| time <= at).max(1) - 1;
            let asked = self.exchanges.partition_point(|one| one.at <= at);
            let (cause, since) = match asked.checked_sub(1) {
                Some(index) if self.exchanges[index].at >= opened[opening] => {
                    (Cause::Request(index), self.exchanges[index].at)
                }
                _ => (Cause::Opening(opening), opened[opening]),
            };
            let since = if is_free { opened[0] } else { since };
            let is_asked = matches!(cause, Cause::Request(_)) && !is_free;
            let delay = match begins_with_it && !is_asked {
                true => BEGINS_AFTER,
                false => Duration::ZERO,
            };
            let kind = kind(cut, &parts);
            let timed = |piece: Piece| (piece.at - since + delay, piece.bytes);
            let message = Message {
                parts: parts.into_iter().map(timed).collect(),
                is_reply: false,
                is_pushed: false,
            };
            match cause {
                _ if is_free => self.stream.push(message),
                Cause::Opening(index) => self.openings[index].push(message),
                Cause::Request(index) => {
                    self.exchanges[index].answers.push(message);
                    kinds[index].push(kind);
                }
            }
        }
        for exchange in &mut self.exchanges {
            mark_replies(&mut exchange.answers, self.line);
            exchange.is_answered = is_sound(&exchange.answers, cut);
        }
        mark_pushed(&mut self.exchanges, &kinds);
    }
}

/// Whether `answers` begin with a reply without a damaged byte.
fn is_sound(answers: &[Message], cut: Cut) -> bool {
    let reply = answers.iter().filter(|message| message.is_reply);
    let parts = reply.flat_map(|message| &message.parts);
    let bytes: Vec<u8> = parts.flat_map(|(_, bytes)| bytes).copied().collect();
    let is_whole =
        |codec: &Codec| codec.framed_towards(&bytes, Direction::ToMaster) == bytes.len() as u64;
    !bytes.is_empty() && cut.codec().is_none_or(is_whole)
}

/// Marks messages that the device sends by itself. Their kinds follow the replies to different
/// requests, or the same request in different numbers.
fn mark_pushed(exchanges: &mut [Exchange], kinds: &[Vec<Vec<u8>>]) {
    // Requests that a kind follows, each with the numbers of its messages.
    let mut following: BTreeMap<&[u8], BTreeMap<Vec<u8>, BTreeSet<usize>>> = BTreeMap::new();
    for (exchange, kinds) in exchanges.iter().zip(kinds) {
        let mut counts: BTreeMap<&[u8], usize> = BTreeMap::new();
        for (message, kind) in exchange.answers.iter().zip(kinds) {
            *counts.entry(kind).or_default() += usize::from(!message.is_reply);
        }
        for (kind, count) in counts.into_iter().filter(|(_, count)| *count > 0) {
            let requests = following.entry(kind).or_default();
            let numbers = requests.entry(exchange.request.clone()).or_default();
            numbers.insert(count);
        }
    }
    let is_pushed = |requests: &BTreeMap<_, BTreeSet<usize>>| {
        requests.len() > 1 || requests.values().any(|numbers| numbers.len() > 1)
    };
    following.retain(|_, requests| is_pushed(requests));
    for (exchange, kinds) in exchanges.iter_mut().zip(kinds) {
        for (message, kind) in exchange.answers.iter_mut().zip(kinds) {
            message.is_pushed = !message.is_reply && following.contains_key(&kind[..]);
        }
    }
}

/// Marks the reply itself: the first message, and messages that follow at once, unless they are a
/// stream.
fn mark_replies(answers: &mut [Message], line: LineConfig) {
    let is_stream = answers.len() >= STREAM_MIN;
    let mut end: Option<Duration> = None;
    for message in answers {
        let (Some((first, bytes)), Some((last, _))) = (message.parts.first(), message.parts.last())
        else {
            continue;
        };
        let start = first.saturating_sub(line.bytes_time(bytes.len() as u64));
        let is_next = |end: Duration| !is_stream && start.saturating_sub(end) <= BURST_GAP;
        message.is_reply = end.is_none_or(is_next);
        if !message.is_reply {
            break;
        }
        end = Some(*last);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A byte takes 10 us.
    const LINE: LineConfig = LineConfig::new_8n1(1_000_000);

    const fn us(micros: u64) -> Duration {
        Duration::from_micros(micros)
    }

    /// A message of one piece of three bytes that ends at this time.
    fn message(end_us: u64) -> Message {
        Message {
            parts: vec![(us(end_us), vec![1, 2, 3])],
            ..Message::default()
        }
    }

    /// Two bytes that end at 10 ms and three that end 10 us later: the line begins with the second
    /// piece at 9.98 ms and has to be done with the first one by then.
    #[test]
    fn a_piece_begins_early_enough_for_those_behind_it() {
        let message = Message {
            parts: vec![(us(10_000), vec![1, 2]), (us(10_010), vec![3, 4, 5])],
            ..Message::default()
        };
        assert_eq!(message.starts(None), [us(10_000), us(10_010)]);
        assert_eq!(message.starts(Some(LINE)), [us(9_960), us(9_980)]);
        let early = Message {
            parts: vec![(us(10), vec![1, 2])],
            ..Message::default()
        };
        assert_eq!(early.starts(Some(LINE)), [us(0)]);
    }

    /// Ten messages, 100 ms apart, the last at 1 s. The stream continues if the session ends within
    /// three gaps and 20 ms. Messages that begin in its last second are repeated, except the first
    /// one.
    #[test]
    fn a_stream_to_the_end_is_repeated() {
        let stream = |count: u64| {
            (1..=count)
                .map(|n| message(n * 100_000))
                .collect::<Vec<_>>()
        };
        let tail = |count, lasted_us| Tail::of(&stream(count), us(lasted_us));
        let found = tail(10, 1_320_000).expect("it continues");
        assert_eq!((found.messages.len(), found.period), (9, us(900_000)));
        assert_eq!(found.messages[0], message(200_000));
        assert_eq!(tail(10, 1_320_001), None);
        assert_eq!(tail(9, 900_000), None, "too few");
        let found = tail(20, 2_000_000).expect("it continues");
        assert_eq!((found.messages.len(), found.period), (11, us(1_100_000)));
        assert_eq!(Tail::of(&vec![message(5); 12], us(5)), None, "all at once");
        assert_eq!(Tail::of(&[], us(5)), None);
    }

    /// The second message begins 20 ms after the end of the first, the third 20.01 ms after that. A
    /// message after one that is no reply is no reply either. Of 16 messages, only the first is a
    /// reply: they are a stream.
    #[test]
    fn messages_that_follow_at_once_belong_to_the_reply() {
        let marked = |ends: &[u64]| -> Vec<bool> {
            let mut answers: Vec<Message> = ends.iter().map(|&end| message(end)).collect();
            mark_replies(&mut answers, LINE);
            answers.iter().map(|message| message.is_reply).collect()
        };
        let ends = [10_000, 30_030, 50_070, 50_100];
        assert_eq!(marked(&ends), [true, true, false, false]);
        let close = |count: u64| (1..=count).map(|n| n * 1_000).collect::<Vec<_>>();
        assert!(marked(&close(15)).iter().all(|is_reply| *is_reply));
        let stream = marked(&close(16));
        assert_eq!((stream[0], stream[1..].contains(&true)), (true, false));
    }

    /// Messages behind the reply come by themselves if they follow two different requests, or the
    /// same one in different numbers.
    #[test]
    fn messages_of_the_device_itself_follow_any_request() {
        let pushed = |list: &[(&str, usize)]| -> Vec<Vec<bool>> {
            let exchange = |&(request, count): &(&str, usize)| {
                let mut answers = vec![message(0); 1 + count];
                answers[0].is_reply = true;
                Exchange {
                    request: request.as_bytes().to_vec(),
                    answers,
                    ..Exchange::default()
                }
            };
            let mut exchanges: Vec<Exchange> = list.iter().map(exchange).collect();
            let kinds: Vec<Vec<Vec<u8>>> = list
                .iter()
                .map(|&(_, count)| {
                    let mut kinds = vec![b"T".to_vec(); 1 + count];
                    kinds[0] = b"R".to_vec();
                    kinds
                })
                .collect();
            mark_pushed(&mut exchanges, &kinds);
            let all = exchanges.iter();
            all.map(|one| one.answers.iter().map(|it| it.is_pushed).collect())
                .collect()
        };
        assert_eq!(
            pushed(&[("a", 1), ("b", 1)]),
            [[false, true], [false, true]]
        );
        assert_eq!(
            pushed(&[("a", 1), ("a", 1)]),
            [[false, false], [false, false]]
        );
        let two = [vec![false, true], vec![false, true, true]];
        assert_eq!(pushed(&[("a", 1), ("a", 2)]), two);
        assert_eq!(
            pushed(&[("a", 0), ("b", 1)]),
            [vec![false], vec![false, false]]
        );
    }

    #[test]
    fn a_reply_without_a_byte_is_not_sound() {
        let answers = |is_reply| {
            let mut message = message(0);
            message.is_reply = is_reply;
            [message]
        };
        assert!(is_sound(&answers(true), Cut::Gaps));
        assert!(!is_sound(&answers(false), Cut::Gaps) && !is_sound(&[], Cut::Gaps));
    }

    /// Gaps of 30 and 70 ms between requests, and 10 ms from the opening to the first one.
    #[test]
    fn the_longest_gap_counts_from_the_opening() {
        let script = |requests: &[u64], opened: u64| {
            let mut passage = Passage {
                link: "port".to_owned(),
                baud: LINE.baud,
                opened: vec![Instant::from_millis(opened)],
                ..Passage::default()
            };
            for &at in requests {
                passage.sent.push(Instant::from_millis(at), b"\x80\x01");
            }
            Script::of(&passage, &(Instant::ZERO..Instant::from_secs(1)))
        };
        let gap = |requests: &[u64], opened| script(requests, opened).longest_gap;
        assert_eq!(gap(&[20, 50, 120], 10), us(70_000));
        assert_eq!(gap(&[120, 150], 10), us(110_000));
        assert_eq!(gap(&[], 10), us(0));
        let bytes: Vec<usize> = script(&[20, 50, 120], 10)
            .exchanges
            .iter()
            .map(|one| one.byte)
            .collect();
        assert_eq!(bytes, [0, 2, 4]);
    }
}
