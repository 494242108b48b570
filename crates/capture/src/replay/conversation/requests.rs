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

#[cfg(test)]
mod tests {
    use super::super::script::Message;
    use super::*;

    fn exchanges(requests: &[&str]) -> Vec<Exchange> {
        let exchange = |request: &&str| Exchange {
            request: request.as_bytes().to_vec(),
            ..Exchange::default()
        };
        requests.iter().map(exchange).collect()
    }

    const fn millis(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// A request that is the beginning of another one waits for 20 ms, if it is not the next one;
    /// the beginning of a request waits for a second.
    #[test]
    fn a_request_that_may_grow_waits_for_silence() {
        let all = exchanges(&["AB", "ABC", "X"]);
        let mut requests = Requests::of(&all, Cut::Gaps);
        let request = |len, exchange| Found::Request { len, exchange };
        let find = |requests: &Requests, heard: &str, ms| {
            requests.find(heard.as_bytes(), millis(ms), &all, Cut::Gaps)
        };
        assert_eq!(find(&requests, "AB", 0), request(2, 0));
        assert_eq!(find(&requests, "ABX", 0), request(2, 0));
        assert_eq!(requests.make(0, &all), Some(true));
        assert_eq!(find(&requests, "AB", 19), Found::Unfinished);
        assert_eq!(find(&requests, "AB", 20), request(2, 0));
        assert_eq!(find(&requests, "ABC", 0), request(3, 1));
        assert_eq!(find(&requests, "X", 0), request(1, 2));
        assert_eq!(find(&requests, "A", 999), Found::Unfinished);
        let like = Some(0);
        assert_eq!(find(&requests, "A", 1_000), Found::Unknown { len: 1, like });
    }

    /// A known request behind a byte of noise is found after 20 ms. A line ends where it ends.
    #[test]
    fn noise_and_unknown_lines_have_their_own_length() {
        let all = exchanges(&["GO\n", "X"]);
        let gaps = Requests::of(&all, Cut::Gaps);
        let like = None;
        let find = |ms| gaps.find(b"zX", millis(ms), &all, Cut::Gaps);
        assert_eq!(
            [find(19), find(20)],
            [Found::Unfinished, Found::Unknown { len: 1, like }]
        );
        let cut = Cut::Lines(b'\n');
        let lines = Requests::of(&all, cut);
        let like = Some(0);
        let found = lines.find(b"NO\nGO\n", millis(0), &all, cut);
        assert_eq!(found, Found::Unknown { len: 3, like });
        assert_eq!(lines.find(b"NO", millis(0), &all, cut), Found::Unfinished);
    }

    /// Of the captured requests A, B and A, each kind has to be made, and three requests in all:
    /// another request may take the place of the last A.
    #[test]
    fn requests_are_missing_until_as_many_were_made() {
        let all = exchanges(&["A", "B", "A"]);
        let after = |made: &[usize]| {
            let mut requests = Requests::of(&all, Cut::Gaps);
            let ways: Vec<_> = made
                .iter()
                .map(|&index| requests.make(index, &all))
                .collect();
            (requests.missing(), requests.are_made(), ways)
        };
        assert_eq!(after(&[]), (Some(0), false, vec![]));
        assert_eq!(after(&[0]), (Some(1), false, vec![Some(true)]));
        assert_eq!(after(&[0, 1]), (Some(2), false, vec![Some(true); 2]));
        let again = vec![Some(true), Some(true), None];
        assert_eq!(after(&[0, 1, 0]), (None, true, again));
        let without = vec![Some(true), None, None];
        assert_eq!(after(&[0, 0, 0]), (Some(1), false, without));
        let backwards = vec![Some(false), Some(false), Some(true)];
        assert_eq!(after(&[2, 0, 1]), (None, true, backwards));
    }

    /// The second of three equal requests had no reply, the third was not sound: a repeated one
    /// gets the reply of the first.
    #[test]
    fn a_repeated_request_gets_a_sound_reply() {
        let mut all = exchanges(&["A", "A", "A", "A"]);
        let answer = || vec![Message::default()];
        (all[0].is_answered, all[0].answers, all[2].answers) = (true, answer(), answer());
        let found = |all: &[Exchange]| {
            let mut requests = Requests::of(all, Cut::Gaps);
            for exchange in 0..3 {
                requests.make(exchange, all);
            }
            // The fourth is due: it is the next one, not a repeated one.
            assert_eq!(requests.exchange_of(b"A", all), Some(3));
            requests.make(3, all);
            requests.exchange_of(b"A", all)
        };
        assert_eq!(found(&all), Some(0));
        all[0].is_answered = false;
        assert_eq!(found(&all), Some(2));
        (all[0].answers, all[2].answers) = (vec![], vec![]);
        assert_eq!(found(&all), Some(3));
    }

    /// Equal bytes at the beginning count twice if the lengths are equal: 2 + 3 of 4. With other
    /// lengths only the beginning counts; less than a quarter of the longer one is nothing.
    #[test]
    fn requests_are_alike_by_their_bytes() {
        let of = |one: &str, other: &str| likeness(one.as_bytes(), other.as_bytes());
        assert_eq!((of("abcd", "abcd"), of("abcd", "abxd")), (2_000, 1_250));
        assert_eq!((of("abcd", "xbcd"), of("abc", "abcdefgh")), (750, 375));
        assert_eq!((of("a", "abcd"), of("a", "abcde")), (250, 0));
        assert_eq!(of("abcd", "wxyz"), 0);
    }

    /// The next of equally similar requests, then those before it, then those that were made.
    #[test]
    fn the_most_similar_request_is_the_next_one() {
        let all = exchanges(&["aa1", "aa2", "b", "aa3"]);
        let mut requests = Requests::of(&all, Cut::Gaps);
        assert_eq!(requests.like(b"aa9", &all), Some(0));
        requests.make(1, &all);
        assert_eq!(requests.like(b"aa9", &all), Some(3));
        requests.make(3, &all);
        assert_eq!(requests.like(b"aa9", &all), Some(0));
        requests.make(0, &all);
        assert_eq!(requests.like(b"aa3", &all), Some(3), "made before");
        assert_eq!(requests.like(b"zz9", &all), None);
    }
}
