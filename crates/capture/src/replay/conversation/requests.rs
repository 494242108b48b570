//! Matching of the program's bytes with the requests of the capture.

use core::ops::Bound;
use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet};

use super::cut::Cut;
use super::script::Exchange;

/// Silence after which bytes are complete, if they are a request by themselves or the beginning of
/// none.
pub(super) const QUIET: Duration = Duration::from_millis(20);
/// Silence for the beginning of a request: a program may write a request in several calls.
pub(super) const UNFINISHED: Duration = Duration::from_secs(1);
/// Maximum number of requests that are compared for similarity.
const LIKE_MAX: usize = 64;

/// Result of matching some bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// The first bytes are the request of this exchange.
    Request { len: usize, exchange: usize },
    /// The bytes may become a request: more bytes or silence must follow.
    Unfinished,
    /// The first bytes are no request of the capture; `like` is the most similar one.
    Unknown { len: usize, like: Option<usize> },
}

/// The requests of a link, and those that were made.
#[derive(Clone, Debug)]
pub(super) struct Requests {
    /// Exchanges of each request, and those of them that are still to come.
    all: BTreeMap<Vec<u8>, BTreeSet<usize>>,
    open: BTreeMap<Vec<u8>, BTreeSet<usize>>,
    /// Exchanges that are still to come.
    left: BTreeSet<usize>,
    lengths: BTreeSet<usize>,
    /// The exchange after the last one that was made.
    next: usize,
    /// The exchange that was made last.
    last: Option<usize>,
    /// Number of requests made so far, including repeated ones.
    made: usize,
    terminator: Option<u8>,
}

impl Requests {
    pub(super) fn of(exchanges: &[Exchange], cut: Cut) -> Self {
        let mut all: BTreeMap<Vec<u8>, BTreeSet<usize>> = BTreeMap::new();
        for (index, exchange) in exchanges.iter().enumerate() {
            all.entry(exchange.request.clone())
                .or_default()
                .insert(index);
        }
        Self {
            open: all.clone(),
            lengths: all.keys().map(Vec::len).collect(),
            all,
            left: (0..exchanges.len()).collect(),
            next: 0,
            last: None,
            made: 0,
            terminator: match cut {
                Cut::Lines(terminator) => Some(terminator),
                Cut::Frames(_) | Cut::Gaps => None,
            },
        }
    }

    /// Whether as many requests were made as the capture contains, each at least once. A program
    /// that repeats one and omits its next turn has still completed the conversation.
    pub(super) fn are_made(&self) -> bool {
        self.missing().is_none()
    }

    /// An exchange whose request is missing: one that was never made, or the next if too few were
    /// made.
    pub(super) fn missing(&self) -> Option<usize> {
        let never = |index: &&usize| {
            let own = self.all.values().find(|all| all.contains(index));
            own.is_some_and(|own| own.iter().all(|one| self.left.contains(one)))
        };
        let count: usize = self.all.values().map(BTreeSet::len).sum();
        let never = || self.left.iter().find(never).copied();
        let too_few = (self.made < count).then(|| self.expected()).flatten();
        match self.left.is_empty() {
            true => None,
            false => too_few.or_else(never),
        }
    }

    /// The next exchange in the capture.
    pub(super) fn expected(&self) -> Option<usize> {
        let behind = self.left.range(self.next..).next();
        behind.or_else(|| self.left.first()).copied()
    }

    /// Matches `heard`, which is followed by silence for `quiet`.
    pub(super) fn find(
        &self,
        heard: &[u8],
        quiet: Duration,
        exchanges: &[Exchange],
        cut: Cut,
    ) -> Found {
        let expected = self.expected().map(|index| &exchanges[index].request[..]);
        let whole = |len: usize| {
            let exchange = self.exchange_of(&heard[..len], exchanges)?;
            Some(Found::Request { len, exchange })
        };
        if let Some(found) = expected
            .filter(|expected| heard.starts_with(expected))
            .and_then(|expected| whole(expected.len()))
        {
            return found;
        }
        let may_grow = self.begins_with(heard);
        let lengths = self.lengths.range(..=heard.len()).rev().copied();
        if let Some(found) = lengths.into_iter().find_map(whole) {
            return match may_grow && quiet < QUIET {
                true => Found::Unfinished,
                false => found,
            };
        }
        if may_grow && quiet < UNFINISHED {
            return Found::Unfinished;
        }
        self.unknown(heard, quiet, exchanges, cut)
    }

    /// Length of one unknown request at the beginning of the bytes.
    fn unknown(&self, heard: &[u8], quiet: Duration, exchanges: &[Exchange], cut: Cut) -> Found {
        let ends = self.terminator.and_then(|terminator| {
            let place = heard.iter().position(|&byte| byte == terminator);
            place.map(|place| place + 1)
        });
        let frame = cut.codec().and_then(|codec| codec.frame_at(heard));
        let frame = frame.filter(|len| (1..=heard.len()).contains(len));
        let len = match frame.or(ends) {
            Some(len) => len,
            None if quiet < QUIET => return Found::Unfinished,
            // Noise may precede a known request.
            None => (1..heard.len())
                .find(|&from| self.all.contains_key(&heard[from..]))
                .unwrap_or(heard.len()),
        };
        let like = self.like(&heard[..len], exchanges);
        Found::Unknown { len, like }
    }

    /// The exchange of `request`. The last one is repeated if another request is due; otherwise the
    /// next one, then one that was omitted, then the last one made. A repeated request gets a sound
    /// reply if it ever had one: a device does not damage the next one, too.
    fn exchange_of(&self, request: &[u8], exchanges: &[Exchange]) -> Option<usize> {
        let is = |index: usize| exchanges[index].request == request;
        let is_due = self.expected().is_some_and(is);
        let is_repeated = self.last.is_some_and(is) && !is_due;
        let open = self.open.get(request).filter(|_| !is_repeated);
        let next = open.and_then(|open| open.range(self.next..).next().or_else(|| open.first()));
        let made = || {
            let all = self.all.get(request)?;
            let made = || {
                all.range(..self.next)
                    .rev()
                    .chain(all.range(self.next..).rev())
            };
            let made_before = || made().filter(|index| !self.left.contains(*index));
            let is_sound = |index: &&usize| exchanges[**index].is_answered;
            let is_answered = |index: &&usize| !exchanges[**index].answers.is_empty();
            made_before()
                .find(is_sound)
                .or_else(|| made_before().find(is_answered))
                .or_else(|| made_before().next())
        };
        next.or_else(made).copied()
    }

    /// Whether a longer request begins with `heard`.
    fn begins_with(&self, heard: &[u8]) -> bool {
        let longer = (Bound::Excluded(heard), Bound::Unbounded);
        let mut longer = self.all.range::<[u8], _>(longer);
        longer
            .next()
            .is_some_and(|(next, _)| next.starts_with(heard))
    }

    /// Records that the request of `exchange` was made. Returns whether it directly followed the
    /// last new one; `None` if it was made before, which does not move the position.
    pub(super) fn make(&mut self, exchange: usize, exchanges: &[Exchange]) -> Option<bool> {
        self.last = Some(exchange);
        self.made += 1;
        if let Some(open) = self.open.get_mut(&exchanges[exchange].request) {
            open.remove(&exchange);
        }
        if !self.left.remove(&exchange) {
            return None;
        }
        let is_next = exchange == self.next;
        self.next = exchange + 1;
        Some(is_next)
    }

    /// The remaining exchange with the most similar request: of the same length and with most equal
    /// bytes; the next one among several.
    fn like(&self, request: &[u8], exchanges: &[Exchange]) -> Option<usize> {
        let coming = self.left.range(self.next..).chain(&self.left);
        let made = self.all.values().filter_map(|all| all.last());
        let mut best: Option<(usize, usize)> = None;
        for &index in coming.take(LIKE_MAX).chain(made.take(LIKE_MAX)) {
            let score = likeness(&exchanges[index].request, request);
            if score > best.map_or(0, |(best, _)| best) {
                best = Some((score, index));
            }
        }
        best.map(|(_, index)| index)
    }
}

/// Similarity of two requests, from 0; at least a quarter of the bytes must be equal.
fn likeness(one: &[u8], other: &[u8]) -> usize {
    let pairs = || one.iter().zip(other);
    let prefix = pairs().take_while(|(one, other)| one == other).count();
    let longest = one.len().max(other.len());
    let alike = match one.len() == other.len() {
        true => prefix + pairs().filter(|(one, other)| one == other).count(),
        false => prefix,
    };
    if alike * 4 < longest {
        0
    } else {
        alike * 1000 / longest
    }
}
