//! Common shape of messages of an unknown protocol, learnt from those between silences: their first
//! and last byte, and the lengths of each kind.

use core::ops::Range;
use std::collections::{BTreeMap, BTreeSet};

/// Minimum number of messages from which a shape is learnt.
const LEARNT_MIN: usize = 5;
/// Minimum share of messages with the most common first byte, and of those with the same last byte
/// among them, per cent.
const BEGIN_SHARE: usize = 50;
const DELIMITED_SHARE: usize = 60;
/// One in this many messages of a kind may be shorter than the shortest whole one: a pause of the
/// recorder has divided it.
const DIVIDED: usize = 10;

/// Shape of messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Shape {
    /// First and last byte of each message.
    delimiters: Option<[u8; 2]>,
    /// Lengths of the messages with these first bytes, at most two, in ascending order.
    lengths: BTreeMap<Vec<u8>, Vec<usize>>,
}

impl Shape {
    /// The shape of `messages` of `bytes`.
    pub(super) fn of(bytes: &[u8], messages: &[Range<usize>]) -> Self {
        let mut this = Self::default();
        let mut pairs: BTreeMap<[u8; 2], usize> = BTreeMap::new();
        let mut firsts: BTreeMap<u8, usize> = BTreeMap::new();
        for range in messages {
            let message = &bytes[range.clone()];
            let lengths = this.lengths.entry(head(message).to_vec()).or_default();
            lengths.push(message.len());
            if let [first, inner @ .., last] = message {
                *firsts.entry(*first).or_default() += 1;
                // A byte that also occurs between two flags is no flag.
                let is_flag = match first == last {
                    true => !inner.contains(first),
                    false => !inner.windows(2).any(|pair| pair == [*last, *first]),
                };
                *pairs.entry([*first, *last]).or_default() += usize::from(is_flag);
            }
        }
        this.lengths.retain(|_, lengths| {
            lengths.sort_unstable();
            lengths.len() >= LEARNT_MIN
        });
        let most = pairs.into_iter().max_by_key(|&(_, count)| count);
        let is_common = |&(pair, count): &([u8; 2], usize)| {
            let begin = firsts[&pair[0]];
            count >= LEARNT_MIN
                && count * 100 >= begin * DELIMITED_SHARE
                && begin * 100 >= messages.len() * BEGIN_SHARE
        };
        this.delimiters = most.filter(is_common).map(|(pair, _)| pair);
        this
    }

    /// Whether `message` is only the beginning of a message.
    pub(super) fn is_cut_off(&self, message: &[u8]) -> bool {
        if self.delimiters.is_some() && self.is_delimited(message) == Some(false) {
            return true;
        }
        match self.lengths.get(head(message)) {
            Some(lengths) => message.len() < lengths[lengths.len() / DIVIDED],
            None => message.len() == 1 && self.lengths.keys().any(|head| head[0] == message[0]),
        }
    }

    /// Whether `next` continues `message` after a pause, which only the recorder has made.
    /// `is_asked`: the other side sent bytes in the pause.
    pub(super) fn goes_on(&self, message: &[u8], next: &[u8], is_asked: bool) -> bool {
        if !self.is_cut_off(message) {
            return false;
        }
        match (self.delimiters, self.is_delimited(message)) {
            (Some([first, last]), Some(false)) => {
                let begins = next.first() == Some(&first);
                !begins || (first == last && (next.len() == 1 || next[1] == first))
            }
            _ => !is_asked && !self.lengths.contains_key(head(next)),
        }
    }

    /// Whether `message` has its last byte; `None` if it does not begin as all others.
    fn is_delimited(&self, message: &[u8]) -> Option<bool> {
        let [first, last] = self.delimiters?;
        let rest = message.strip_prefix(&[first])?;
        Some(rest.last() == Some(&last))
    }

    /// Adds the ends of messages that follow each other without a silence.
    pub(super) fn cut(&self, bytes: &[u8], ends: &mut BTreeSet<usize>) {
        if let Some([first, last]) = self.delimiters {
            let places = bytes.windows(2).zip(1..);
            let between = places.filter(|&(pair, _)| pair == [last, first]);
            ends.extend(between.map(|(_, end)| end));
        }
    }
}

fn head(message: &[u8]) -> &[u8] {
    &message[..message.len().min(2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shape of `messages`, each of them five times.
    fn shape(messages: &[&[u8]]) -> Shape {
        let (mut bytes, mut ranges) = (Vec::new(), Vec::new());
        for message in messages.iter().flat_map(|message| [message; 5]) {
            ranges.push(bytes.len()..bytes.len() + message.len());
            bytes.extend_from_slice(message);
        }
        Shape::of(&bytes, &ranges)
    }

    /// HDLC: a flag at both ends. STX and ETX. A header of two bytes with a length that varies.
    #[test]
    fn the_beginning_of_a_message_is_known() {
        let hdlc = shape(&[b"~\x90abcdef~", b"~\x91a~"]);
        let text = shape(&[b"\x02V1\x03", b"\x02W123\x03"]);
        assert_eq!(shape(&[b"\x07\x07\x07"]).delimiters, None, "no flag");
        let header = shape(&[b"\xAA\x55abcd", b"\xAA\x55abcdef"]);
        for (shape, message, next, expected) in [
            (&hdlc, &b"~\x90ab"[..], &b"cdef~"[..], [true, true]),
            (&hdlc, b"~\x90abcdef", b"~", [true, true]),
            (&hdlc, b"~\x90ab", b"~\x91a~", [true, false]),
            (&hdlc, b"~\x91a~", b"~\x90abcdef~", [false, false]),
            (&hdlc, b"~", b"\x90abcdef~", [true, true]),
            (&text, b"\x02W1", b"23\x03", [true, true]),
            (&text, b"\x02V1\x03", b"\x02V1\x03", [false, false]),
            (&text, b"\x06", b"\x02V1\x03", [false, false]),
            (&header, b"\xAA\x55ab", b"cd", [true, true]),
            (&header, b"\xAA\x55ab", b"\xAA\x55abcd", [true, false]),
            (&header, b"\xAA\x55abcd", b"\x06", [false, false]),
            (&header, b"\xAA", b"\x55abcd", [true, true]),
        ] {
            let got = [
                shape.is_cut_off(message),
                shape.goes_on(message, next, false),
            ];
            assert_eq!(got, expected, "{message:02X?} {next:02X?}");
        }
        assert!(!header.goes_on(b"\xAA\x55ab", b"\x06", true), "an answer");
        assert!(hdlc.goes_on(b"~\x90ab", b"cdef~", true));
        assert!(!shape(&[]).is_cut_off(b"~\x90ab"));
    }
}
