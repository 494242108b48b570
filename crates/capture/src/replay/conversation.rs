//! A link of a capture played back as a conversation: the capture replies to requests.
//!
//! ```text
//! capture:  opened .. greeting    request A .. answer A    request B .. answer B .. message
//!           cause     distance    cause        distance    cause        distance    distance
//! ```
//!
//! A capture is split into requests of the captured program, each with the bytes that the other
//! side sent after it. The bytes of the playing program are matched with these requests: by frames
//! if the protocol is known, by lines of text, or by bytes and silence. A reply follows its request
//! with the captured latency. Unsolicited bytes follow their cause: the previous reply, the
//! previous message, or the opening of the port. Messages that were repeated before any request
//! follow their own clock. A message is sent whole: another one that becomes due meanwhile waits.
//!
//! A program that starts later, is slower, sends requests in another order or repeats them
//! therefore has the same conversation. A request that the capture does not contain is a
//! [`Divergence`]; it gets the reply to the most similar request.
//!
//! A [`Conversation`] has the four methods of every node, and no clock of its own.

mod cut;
mod requests;
mod script;
mod unsolicited;

use core::fmt;
use core::ops::Range;
use core::time::Duration;
use std::collections::{BTreeMap, VecDeque};

use protocols::Instant;

use super::Passage;
use crate::divergence::Divergence;
use engine::rig::line::Direction;
use requests::{Found, QUIET, Requests, UNFINISHED};
use script::{Message, Script};

/// Maximum number of messages of an earlier request that may follow a new one. If there are more,
/// they were a stream, which the new request has ended.
const LEFT_MAX: usize = 2;
/// Minimum silence after which no more requests of the program are expected.
const PATIENCE: Duration = Duration::from_secs(2);
/// Minimum silence before the program has sent anything: it may wait for a board to start, or read
/// its settings.
const PATIENCE_FIRST: Duration = Duration::from_secs(10);
/// Minimum silence in multiples of the longest gap of the capture: the program may be slower by
/// this factor.
const PATIENCE_GAPS: u32 = 4;
/// Time for the program to answer the last message.
const ANSWERS: Duration = Duration::from_secs(1);

/// Cause of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Source {
    Stream,
    Opening,
    Exchange(usize),
}

/// Bytes that will be sent.
#[derive(Clone, Debug)]
struct Due {
    source: Source,
    message: usize,
    /// Number of the message among all planned ones, and whether this is its last piece.
    unit: u64,
    is_last: bool,
    is_reply: bool,
    /// Whether this is a repeated reply, which counts as no progress.
    is_again: bool,
    bytes: Vec<u8>,
}

/// One link of a capture that replies to a program.
#[derive(Clone)]
pub struct Conversation {
    link: String,
    script: Script,
    /// Whether the line adds the transmission time of each byte.
    is_on_line: bool,
    requests: Requests,
    is_open: bool,
    openings: usize,
    begun: bool,
    heard: Vec<u8>,
    heard_at: Instant,
    /// Whether the matching decided that more bytes must follow even after a silence.
    is_quiet: bool,
    heard_before: usize,
    due: BTreeMap<(Instant, u64), Due>,
    /// Number of due messages of the stream, and the origin of their times.
    streaming: usize,
    stream_from: Instant,
    /// The stream after a request: its exchange, the number of remaining messages, and the start of
    /// its present repetition.
    flow: Option<(usize, usize, Instant)>,
    numbered: u64,
    units: u64,
    /// The message that was sent last.
    saying: Option<(Source, usize)>,
    /// The message of which some pieces were sent; no other message may begin before its end.
    under_way: Option<u64>,
    ready: VecDeque<u8>,
    moved_at: Instant,
    said: u64,
    tally: Tally,
    first: Option<Divergence>,
}

/// Comparison of the program's requests with those of the capture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Requests of the capture.
    pub all: usize,
    /// Requests of the capture that the program has made.
    pub made: usize,
    /// Number of requests out of order.
    pub out_of_turn: usize,
    /// Number of repeated requests.
    pub repeated: usize,
    /// Requests that the capture does not have.
    pub unknown: usize,
    /// Requests that the capture does not have, made after all of its requests.
    pub later: usize,
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            all,
            made,
            out_of_turn,
            repeated,
            unknown,
            later,
        } = self;
        write!(f, "{made} of {all} requests were made")?;
        for (count, what) in [
            (out_of_turn, "out of turn"),
            (repeated, "repeated"),
            (unknown, "not in the capture"),
            (later, "after the last one of the capture"),
        ] {
            if *count > 0 {
                write!(f, ", {count} {what}")?;
            }
        }
        Ok(())
    }
}

impl Conversation {
    /// The conversation of `passage` in the `session` of a capture. With `is_on_line`, the line
    /// adds the transmission time of the bytes; otherwise bytes are sent when their last byte is
    /// complete.
    pub fn new(passage: &Passage, session: &Range<Instant>, is_on_line: bool) -> Self {
        let script = Script::of(passage, session);
        Self {
            link: passage.link.clone(),
            is_on_line,
            requests: Requests::of(&script.exchanges, script.cut),
            is_open: false,
            openings: 0,
            begun: false,
            heard: Vec::new(),
            heard_at: Instant::ZERO,
            is_quiet: false,
            heard_before: 0,
            due: BTreeMap::new(),
            streaming: 0,
            stream_from: Instant::ZERO,
            flow: None,
            numbered: 0,
            units: 0,
            saying: None,
            under_way: None,
            ready: VecDeque::new(),
            moved_at: Instant::ZERO,
            said: 0,
            tally: Tally {
                all: script.exchanges.len(),
                ..Tally::default()
            },
            first: None,
            script,
        }
    }

    /// Name of the link.
    pub fn link(&self) -> &str {
        &self.link
    }

    /// Handles the opening of the port by the program.
    pub fn open(&mut self, now: Instant) {
        if core::mem::replace(&mut self.is_open, true) {
            return;
        }
        let opening = self.openings.min(self.script.openings.len() - 1);
        self.openings += 1;
        if self.openings <= self.script.openings.len() {
            self.moved_at = now;
        }
        if !core::mem::replace(&mut self.begun, true) {
            let stream = core::mem::take(&mut self.script.stream);
            self.stream_from = now;
            self.plan(Source::Stream, now, &stream, false);
        }
        let said = self.script.openings[opening].clone();
        let is_again = self.openings > self.script.openings.len();
        self.plan(Source::Opening, now, &said, is_again);
    }

    /// Handles the closing of the port by the program.
    pub const fn close(&mut self) {
        self.is_open = false;
    }

    /// Receives `bytes` of the program, the last of them complete at `now`.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) {
        self.open(now);
        self.settle(now);
        self.heard.extend_from_slice(bytes);
        self.heard_at = now;
        self.settle(now);
    }

    /// Performs due actions.
    pub fn poll(&mut self, now: Instant) {
        self.settle(now);
        while let Some(key) = self.next_due().filter(|key| key.0 <= now)
            && let Some(due) = self.due.remove(&key)
        {
            self.streaming -= usize::from(due.source == Source::Stream);
            self.saying = Some((due.source, due.message));
            self.under_way = (!due.is_last).then_some(due.unit);
            self.ready.extend(due.bytes);
            if !due.is_again {
                self.moved_at = now;
            }
            self.go_on_streaming();
            self.go_on_flowing(due.source);
        }
    }

    /// The next piece: of the message under way, otherwise the earliest one.
    fn next_due(&self) -> Option<(Instant, u64)> {
        let is_own = |due: &Due| self.under_way == Some(due.unit);
        let own = || self.due.iter().find(|(_, due)| is_own(due));
        let next = self.under_way.and_then(|_| own());
        next.or_else(|| self.due.iter().next()).map(|(&key, _)| key)
    }

    /// Continues a stream that a request has started, until the next request.
    fn go_on_flowing(&mut self, said: Source) {
        let Some((exchange, left, from)) = &mut self.flow else {
            return;
        };
        if said != Source::Exchange(*exchange) {
            return;
        }
        *left = left.saturating_sub(1);
        let tail = self.script.exchanges[*exchange].tail.as_ref();
        if let Some(tail) = tail.filter(|_| *left == 0) {
            *from += tail.period;
            *left = pieces(&tail.messages);
            let (from, messages) = (*from, tail.messages.clone());
            self.plan(said, from, &messages, true);
        }
    }

    /// Repeats the end of a stream that lasted to the end of the capture.
    fn go_on_streaming(&mut self) {
        if let Some(tail) = self.script.tail.as_ref().filter(|_| self.streaming == 0) {
            self.stream_from += tail.period;
            let messages = tail.messages.clone();
            self.plan(Source::Stream, self.stream_from, &messages, true);
        }
    }

    /// Moves bytes to be sent into `buf` and returns their number.
    pub fn transmit(&mut self, buf: &mut [u8]) -> usize {
        let len = buf.len().min(self.ready.len());
        for (slot, byte) in buf.iter_mut().zip(self.ready.drain(..len)) {
            *slot = byte;
        }
        self.said += len as u64;
        len
    }

    /// Number of bytes sent so far.
    pub const fn said(&self) -> u64 {
        self.said
    }

    /// Time of the next action.
    pub fn poll_at(&self) -> Option<Instant> {
        let due = self.next_due().map(|(at, _)| at);
        let heard = (!self.heard.is_empty()).then_some(self.heard_at);
        // The silence was examined when the last byte arrived, so the next examination can be
        // later.
        let quiet = heard.map(|at| at + if self.is_quiet { UNFINISHED } else { QUIET });
        due.into_iter().chain(quiet).min()
    }

    /// Whether there are bytes to send now.
    pub fn has_more(&self) -> bool {
        !self.ready.is_empty()
    }

    /// Whether all requests were made and all replies sent.
    pub fn is_done(&self) -> bool {
        self.begun && !self.has_news() && self.ready.is_empty() && self.requests.are_made()
    }

    /// Whether bytes are due that were not sent before.
    fn has_news(&self) -> bool {
        self.due.values().any(|due| !due.is_again)
    }

    /// Time of the conversation's last progress.
    pub const fn moved_at(&self) -> Instant {
        self.moved_at
    }

    /// Maximum time without progress before the conversation is over.
    pub fn patience(&self) -> Duration {
        let has_spoken = self.tally.made + self.tally.unknown > 0 || !self.heard.is_empty();
        let least = if has_spoken { PATIENCE } else { PATIENCE_FIRST };
        least + self.script.longest_gap * PATIENCE_GAPS
    }

    /// Number of its sent requests.
    pub const fn tally(&self) -> Tally {
        self.tally
    }

    /// The first request that differs from the capture; at the end also a missing one.
    pub fn divergence(&self) -> Option<Divergence> {
        let missing = || {
            let exchange = &self.script.exchanges[self.requests.missing()?];
            let got = (!self.heard.is_empty()).then_some(&self.heard[..]);
            Some(self.differs(
                self.heard_at.max(self.moved_at),
                Some(&exchange.request),
                got,
            ))
        };
        self.first.clone().or_else(missing)
    }

    fn differs(&self, at: Instant, expected: Option<&[u8]>, got: Option<&[u8]>) -> Divergence {
        let place = (at, self.heard_before);
        let mut found = Divergence::between(
            (&self.link, Direction::ToDevice),
            place,
            expected,
            got,
            self.script.cut.codec(),
        );
        found.note = self.tally.to_string();
        found
    }

    /// Matches the received bytes with requests.
    fn settle(&mut self, now: Instant) {
        while !self.heard.is_empty() {
            let quiet = now - self.heard_at;
            self.is_quiet = quiet >= QUIET;
            let (exchanges, cut) = (&self.script.exchanges, self.script.cut);
            match self.requests.find(&self.heard, quiet, exchanges, cut) {
                Found::Request { len, exchange } => {
                    self.take(len);
                    self.answer(exchange, false);
                }
                Found::Unfinished => break,
                Found::Unknown { len, like } => {
                    // After its end, the capture does not determine further requests.
                    if !self.requests.are_made() || self.tally.all == 0 {
                        self.tally.unknown += 1;
                        let expected = like.or_else(|| self.requests.expected());
                        let expected = expected.map(|index| &exchanges[index].request[..]);
                        let got = Some(&self.heard[..len]);
                        if self.first.is_none() {
                            self.first = Some(self.differs(self.heard_at, expected, got));
                        }
                    } else {
                        self.tally.later += 1;
                    }
                    self.take(len);
                    if let Some(exchange) = like {
                        self.answer(exchange, true);
                    }
                }
            }
        }
    }

    fn take(&mut self, len: usize) {
        self.heard.drain(..len);
        self.heard_before += len;
        self.is_quiet = false;
    }

    /// Schedules the messages of the other side after the request of `exchange`.
    fn answer(&mut self, exchange: usize, is_unknown: bool) {
        let made = self.requests.make(exchange, &self.script.exchanges);
        if made.is_some() {
            self.moved_at = self.heard_at;
        }
        match made {
            _ if is_unknown => {}
            Some(is_next) => {
                self.tally.made += 1;
                self.tally.out_of_turn += usize::from(!is_next);
            }
            None => self.tally.repeated += 1,
        }
        self.drop_streams();
        // A repeated request repeats its reply, not what the device sent by itself.
        let is_wanted = |message: &&Message| made.is_some() || !message.is_pushed;
        let all = &self.script.exchanges[exchange].answers;
        let answers: Vec<Message> = all.iter().filter(is_wanted).cloned().collect();
        let flow = (exchange, pieces(&answers), self.heard_at);
        self.flow = (answers.len() == all.len()).then_some(flow);
        let source = Source::Exchange(exchange);
        self.plan(source, self.heard_at, &answers, made.is_none());
    }

    /// Schedules `messages` after `cause`, in the order of the bytes on the line: a record has the
    /// time of its arrival, and records may be closer together than their bytes.
    fn plan(&mut self, source: Source, cause: Instant, messages: &[Message], is_again: bool) {
        let mut earliest = cause;
        for (number, message) in messages.iter().enumerate() {
            let line = self.is_on_line.then_some(self.script.line);
            let starts = message.starts(line);
            self.units += 1;
            for (index, ((_, bytes), after)) in message.parts.iter().zip(starts).enumerate() {
                let due = Due {
                    source,
                    message: number,
                    unit: self.units,
                    is_last: index + 1 == message.parts.len(),
                    is_reply: message.is_reply,
                    is_again,
                    bytes: bytes.clone(),
                };
                self.numbered += 1;
                self.streaming += usize::from(source == Source::Stream);
                earliest = earliest.max(cause + after);
                self.due.insert((earliest, self.numbered), due);
            }
        }
    }

    /// Ends the streams of earlier requests when a new request arrives.
    fn drop_streams(&mut self) {
        let saying = self.saying;
        let may_go = |due: &Due| {
            let is_of_request = matches!(due.source, Source::Exchange(_));
            is_of_request && !due.is_reply && saying != Some((due.source, due.message))
        };
        let mut left: BTreeMap<Source, Vec<usize>> = BTreeMap::new();
        for due in self.due.values().filter(|due| may_go(due)) {
            let messages = left.entry(due.source).or_default();
            if messages.last() != Some(&due.message) {
                messages.push(due.message);
            }
        }
        let is_stream = |due: &Due| {
            let left = left.get(&due.source);
            left.is_some_and(|left| left.len() > LEFT_MAX)
        };
        self.due.retain(|_, due| !(may_go(due) && is_stream(due)));
    }
}

fn pieces(messages: &[Message]) -> usize {
    messages.iter().map(|message| message.parts.len()).sum()
}

/// Whether all conversations of a session are complete at `now`: nothing to send and nothing to
/// wait for. The session lasts at least until `end`.
pub fn are_over<'a>(
    talks: impl IntoIterator<Item = &'a Conversation>,
    now: Instant,
    end: Instant,
) -> bool {
    let is_over = |one: &Conversation| {
        let stands_for = now - one.moved_at();
        let has_waited = stands_for > one.patience() && !one.has_more() && !one.has_news();
        has_waited || (one.is_done() && stands_for >= ANSWERS)
    };
    now >= end && talks.into_iter().all(is_over)
}

#[cfg(test)]
mod order;
#[cfg(test)]
mod tests;
