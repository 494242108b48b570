//! Finds the request of the capture for the program's bytes.

use core::ops::Bound;
use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet};

use super::cut::Cut;
use super::script::Exchange;

/// Silence after which bytes are no beginning of a longer request, if they are one by themselves or
/// the beginning of none.
pub(super) const QUIET: Duration = Duration::from_millis(20);
/// The same for the beginning of a request: a program may write one in several calls.
pub(super) const UNFINISHED: Duration = Duration::from_secs(1);
/// Requests among which one is looked for that is like what came.
const LIKE_MAX: usize = 64;

/// Meaning of some bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// The first bytes are the request of this exchange.
    Request { len: usize, exchange: usize },
    /// They may become a request: more must come, or silence.
    Unfinished,
    /// The first bytes are no request of the capture; the one that they are most like.
    Unknown { len: usize, like: Option<usize> },
}

/// The requests of a link, and which of them were made.
#[derive(Clone, Debug)]
pub(super) struct Requests {
    /// Exchanges of each request, and those of them that are still to come.
    all: BTreeMap<Vec<u8>, BTreeSet<usize>>,
    open: BTreeMap<Vec<u8>, BTreeSet<usize>>,
    /// Exchanges that are still to come.
    left: BTreeSet<usize>,
    lengths: BTreeSet<usize>,
    /// The exchange behind the last one that was made.
    next: usize,
    /// The last one that was made.
    last: Option<usize>,
    /// Requests made so far, repeated ones among them.
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

    /// Whether as many were made as the capture has, each at least once. A program that repeats one
    /// and leaves out its next turn has gone through the conversation all the same.
    pub(super) fn are_made(&self) -> bool {
        self.missing().is_none()
    }

    /// An exchange whose request was not made: one that never was, else the next if too few were.
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

    /// The exchange that comes next in the capture.
    pub(super) fn expected(&self) -> Option<usize> {
        let behind = self.left.range(self.next..).next();
        behind.or_else(|| self.left.first()).copied()
    }

    /// Meaning of `heard`, followed by silence for `quiet`.
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

    /// The bytes that make up one request which the capture does not have.
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
            // Noise may be before a request that is known.
            None => (1..heard.len())
                .find(|&from| self.all.contains_key(&heard[from..]))
                .unwrap_or(heard.len()),
        };
        let like = self.like(&heard[..len], exchanges);
        Found::Unknown { len, like }
    }

    /// The exchange that `request` belongs to: the last one again if another request is due, else
    /// the next one, else one that was left out, else the last one made. A request that is made
    /// again is answered if it ever was.
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
            let is_answered = |index: &&usize| !exchanges[**index].answers.is_empty();
            made_before()
                .find(is_answered)
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

    /// Takes note that the request of `exchange` was made. Whether that was right behind the last
    /// new
    /// one; `None` if it was made before, which changes no place.
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

    /// The exchange still to come whose request is most like `request`: of the same length and with
    /// most bytes alike, the next one of several.
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
