//! Splitting of the bytes of one direction into messages: by frames, by lines of text, or by gaps.

mod shape;

use core::ops::Range;
use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet};

use protocols::{Instant, LineConfig};

use crate::divergence::Track;
use engine::codec::{self, Codec};
use shape::Shape;

/// Minimum share of bytes in valid frames for splitting by frames, per cent.
const FRAMED_MIN: u64 = 80;
/// Minimum silence that ends a message, independent of the baud rate: a program writes a request in
/// one or two calls, which are less than this apart.
const GAP_MIN: Duration = Duration::from_millis(3);
/// Silence that ends an unfinished frame or line.
const GAP_IN_MESSAGE: Duration = Duration::from_millis(50);

/// Bytes of a message that arrived together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Piece {
    /// Time at which the last byte was complete, if the bytes had their rate.
    pub(super) at: Instant,
    /// Time of the record.
    pub(super) arrived: Instant,
    /// The bytes.
    pub(super) bytes: Vec<u8>,
}

/// Method of splitting a direction.
#[derive(Clone, Copy)]
pub(super) enum Cut {
    /// Frames of a known protocol.
    Frames(&'static Codec),
    /// Lines of text that end with this byte.
    Lines(u8),
    /// Bytes without a separating silence.
    Gaps,
}

impl Cut {
    /// The method that fits `bytes`.
    pub(super) fn of(bytes: &[u8]) -> Self {
        if let Some((codec, framed)) = codec::best(bytes)
            && framed * 100 >= FRAMED_MIN * bytes.len() as u64
        {
            return Self::Frames(codec);
        }
        match terminator(bytes) {
            Some(terminator) => Self::Lines(terminator),
            None => Self::Gaps,
        }
    }

    /// The protocol, if known.
    pub(super) const fn codec(self) -> Option<&'static Codec> {
        match self {
            Self::Frames(codec) => Some(codec),
            Self::Lines(_) | Self::Gaps => None,
        }
    }

    /// Splits the pieces of `track` into messages. Without frames, a message also ends at each time
    /// of `breaks`, in ascending order, at which the other side sent bytes.
    pub(super) fn messages(
        self,
        track: &Track,
        line: LineConfig,
        breaks: &[Instant],
    ) -> Vec<Vec<Piece>> {
        let bytes = track.bytes();
        let mut ends = BTreeSet::from([bytes.len()]);
        match self {
            Self::Frames(codec) => {
                for stretch in codec.found(bytes) {
                    ends.extend(usize::try_from(stretch.bytes.end));
                }
            }
            Self::Lines(terminator) => {
                let places = bytes.iter().zip(1..);
                ends.extend(
                    places
                        .filter(|&(&byte, _)| byte == terminator)
                        .map(|(_, end)| end),
                );
            }
            Self::Gaps => {}
        }
        let shape = match self {
            Self::Gaps => Shape::of(bytes, &undisturbed(track, line, breaks)),
            Self::Lines(_) | Self::Frames(_) => Shape::default(),
        };
        ends.extend(self.silences(track, line, breaks, &shape));
        ends.remove(&0);
        if matches!(self, Self::Gaps) {
            shape.cut(bytes, &mut ends);
            cut_by_form(bytes, &mut ends);
        }
        split(track, line, &ends)
    }

    /// The ends of messages by silence.
    fn silences(
        self,
        track: &Track,
        line: LineConfig,
        breaks: &[Instant],
        shape: &Shape,
    ) -> Vec<usize> {
        let (bytes, least) = (track.bytes(), least_gap(line));
        let (limit, limit_at_break) = match self {
            Self::Gaps => (least, Some(Duration::ZERO)),
            // A prompt has no end of line; a line in two pieces continues at once.
            Self::Lines(_) => (GAP_IN_MESSAGE, Some(least)),
            Self::Frames(_) => (GAP_IN_MESSAGE, None),
        };
        let mut ends = Vec::new();
        let mut before: Option<(usize, Instant)> = None;
        let mut begin = 0;
        for (at, piece) in track.pieces() {
            let start = line.byte_end(at, piece.len() as u64);
            let (from, last) = before.unwrap_or((0, start));
            let is_broken = |until: Instant| is_between(breaks, last, until);
            let gap = start - last;
            let message = &bytes[begin..from];
            let is_silent = gap > limit
                && (gap > GAP_IN_MESSAGE || !shape.goes_on(message, piece, is_broken(start)));
            let may_break = limit_at_break.is_some_and(|least| gap >= least);
            let is_answered = || may_break && is_broken(start) && !shape.is_cut_off(message);
            // On a pseudo-terminal, bytes take no time. The other side may therefore seem to have
            // sent bytes while this piece was in flight. A piece that begins as the previous
            // message is a new one.
            let begins_again = || {
                let head = &piece[..piece.len().min(HEAD)];
                matches!(self, Self::Gaps)
                    && message.len() >= piece.len()
                    && message.starts_with(head)
                    && is_broken(at)
                    && !shape.is_cut_off(message)
            };
            if from > 0 && (is_silent || is_answered() || begins_again()) {
                ends.push(from);
                begin = from;
            }
            before = Some((from + piece.len(), at));
        }
        ends
    }
}

/// Minimum silence that ends a message of an unknown protocol.
fn least_gap(line: LineConfig) -> Duration {
    GAP_MIN.max(line.byte_time() * 7 / 2)
}

/// Whether one of `breaks` is in `from..until`.
fn is_between(breaks: &[Instant], from: Instant, until: Instant) -> bool {
    let next = breaks.partition_point(|&time| time < from);
    breaks.get(next).is_some_and(|&time| time < until)
}

/// The messages between silences during which the other side sent nothing.
fn undisturbed(track: &Track, line: LineConfig, breaks: &[Instant]) -> Vec<Range<usize>> {
    let least = least_gap(line);
    let mut messages: Vec<(Range<usize>, Range<Instant>)> = Vec::new();
    let mut from = 0;
    for (at, piece) in track.pieces() {
        let start = line.byte_end(at, piece.len() as u64);
        let range = from..from + piece.len();
        from = range.end;
        match messages.last_mut() {
            Some((bytes, times)) if start - times.end <= least => {
                (bytes.end, times.end) = (range.end, at);
            }
            _ => messages.push((range, start..at)),
        }
    }
    let is_alone = |(_, times): &(_, Range<Instant>)| !is_between(breaks, times.start, times.end);
    let alone = messages.into_iter().filter(is_alone);
    alone.map(|(bytes, _)| bytes).collect()
}

/// Number of first bytes that are equal in messages of the same kind.
const HEAD: usize = 2;
/// Minimum number of messages of one form, and minimum share of all messages in per cent, for the
/// form of a stream.
const FORM_MIN: usize = 10;
const FORM_SHARE: usize = 50;

/// One in this many messages may differ from the others: a pause of the recorder has divided it, or
/// another message follows it without a silence.
const ODD: usize = 10;

/// The form of most messages of a stream.
struct Form<'a> {
    head: &'a [u8],
    len: usize,
    /// The last byte, if it is the same in all messages of the form: it marks the end.
    last: Option<u8>,
}

impl<'a> Form<'a> {
    /// The form of most of `messages`; `None` if messages with this head have several lengths.
    fn of(messages: &[&'a [u8]]) -> Option<Self> {
        let mut forms: BTreeMap<(&[u8], usize), usize> = BTreeMap::new();
        for message in messages {
            if let Some(head) = message.get(..HEAD) {
                *forms.entry((head, message.len())).or_default() += 1;
            }
        }
        let ((head, len), count) = forms.into_iter().max_by_key(|&(_, count)| count)?;
        if count < FORM_MIN || count * 100 < messages.len() * FORM_SHARE || len <= HEAD {
            return None;
        }
        let own = || messages.iter().filter(|message| message.starts_with(head));
        let mut lasts: BTreeMap<u8, usize> = BTreeMap::new();
        for message in own().filter(|message| message.len() == len) {
            *lasts.entry(message[len - 1]).or_default() += 1;
        }
        let last = lasts.into_iter().max_by_key(|&(_, count)| count);
        let last = last.filter(|&(_, alike)| alike + count / ODD >= count);
        let form = Self {
            head,
            len,
            last: last.map(|(last, _)| last),
        };
        let is_odd = |message: &&&[u8]| {
            let mut rest = **message;
            while form.begins(rest) {
                rest = &rest[len..];
            }
            rest.len() < message.len() && !rest.is_empty() && !rest.starts_with(head)
        };
        (own().filter(is_odd).count() * ODD <= count).then_some(form)
    }

    /// Whether `bytes` begin with a message of this form.
    fn begins(&self, bytes: &[u8]) -> bool {
        bytes.starts_with(self.head)
            && bytes.len() >= self.len
            && self.last.is_none_or(|last| bytes[self.len - 1] == last)
    }
}

/// Splits messages without silence between them, if they have the form of most messages: the same
/// two first bytes, the same length, and the same last byte if that is constant.
fn cut_by_form(bytes: &[u8], ends: &mut BTreeSet<usize>) {
    let mut from = 0;
    let ranges = ends
        .iter()
        .map(|&end| core::mem::replace(&mut from, end)..end);
    let ranges: Vec<Range<usize>> = ranges.collect();
    let messages: Vec<&[u8]> = ranges.iter().map(|range| &bytes[range.clone()]).collect();
    let Some(form) = Form::of(&messages) else {
        return;
    };
    for range in ranges {
        let mut place = range.start;
        while place + form.len <= range.end {
            if !form.begins(&bytes[place..range.end]) {
                place += 1;
                continue;
            }
            let both = [place, place + form.len];
            ends.extend(both.into_iter().filter(|&end| end > 0));
            place += form.len;
        }
    }
}

/// Splits the pieces of `track` at `ends`, one message up to each of them.
fn split(track: &Track, line: LineConfig, ends: &BTreeSet<usize>) -> Vec<Vec<Piece>> {
    let (mut messages, mut message) = (Vec::new(), Vec::new());
    let (mut place, mut ends) = (0, ends.iter().copied().peekable());
    for (arrived, piece) in track.pieces() {
        let mut rest = piece;
        while let Some(end) = ends.next_if(|&end| end <= place + rest.len()) {
            let (own, behind) = rest.split_at(end - place);
            message.push(Piece {
                at: line.byte_end(arrived, behind.len() as u64),
                arrived,
                bytes: own.to_vec(),
            });
            messages.push(core::mem::take(&mut message));
            (rest, place) = (behind, end);
        }
        if !rest.is_empty() {
            message.push(Piece {
                at: arrived,
                arrived,
                bytes: rest.to_vec(),
            });
            place += rest.len();
        }
    }
    messages.extend((!message.is_empty()).then_some(message));
    messages
}

/// The byte that ends the lines of `bytes`, if they are text.
fn terminator(bytes: &[u8]) -> Option<u8> {
    let is_text = |byte: &u8| matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n');
    if bytes.is_empty() || !bytes.iter().all(is_text) {
        return None;
    }
    [b'\n', b'\r'].into_iter().find(|end| bytes.contains(end))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLOW: LineConfig = LineConfig::new_8n1(9600);

    fn track(pieces: &[(u64, &[u8])]) -> Track {
        let mut track = Track::default();
        for &(at, bytes) in pieces {
            track.push(Instant::from_millis(at), bytes);
        }
        track
    }

    fn cut(pieces: &[(u64, &[u8])], breaks: &[u64]) -> Vec<Vec<u8>> {
        let track = track(pieces);
        let breaks: Vec<_> = breaks.iter().map(|&at| Instant::from_millis(at)).collect();
        let messages = Cut::of(track.bytes()).messages(&track, SLOW, &breaks);
        let join = |message: &Vec<Piece>| {
            let bytes = message.iter().map(|piece| &piece.bytes[..]);
            bytes.collect::<Vec<_>>().concat()
        };
        messages.iter().map(join).collect()
    }

    /// Two requests of a Modbus master, each written in two pieces 1 ms apart at 9600 baud.
    #[test]
    fn bytes_of_no_known_protocol_are_cut_by_silence() {
        let pieces: [(u64, &[u8]); 3] = [
            (10, &[1, 4, 0, 0]),
            (15, &[0, 2, 0x71, 0xCB]),
            (60, &[1, 4, 0, 12]),
        ];
        let expected = [vec![1, 4, 0, 0, 0, 2, 0x71, 0xCB], vec![1, 4, 0, 12]];
        assert_eq!(cut(&pieces, &[]), expected);
    }

    /// Two requests 2 ms apart are two messages if a reply came between them.
    #[test]
    fn an_answer_ends_a_request() {
        let pieces: [(u64, &[u8]); 2] = [(10, &[0x80]), (13, &[0x81])];
        assert_eq!(cut(&pieces, &[]), [vec![0x80, 0x81]]);
        assert_eq!(cut(&pieces, &[11]), [vec![0x80], vec![0x81]]);
    }

    /// Two requests of eight bytes 0.5 ms apart on a pseudo-terminal, where bytes take no time; a
    /// reply came between them. A request in two pieces is one message, even with bytes between
    /// them.
    #[test]
    fn an_answer_ends_a_request_whose_bytes_took_no_time() {
        let track = |second: &[u8]| {
            let mut track = Track::default();
            track.push(Instant::from_micros(10_000), b"BW000012");
            track.push(Instant::from_micros(10_500), second);
            track
        };
        let fast = LineConfig::new_8n1(115_200);
        let count = |second: &[u8], breaks: &[Instant]| {
            Cut::Gaps.messages(&track(second), fast, breaks).len()
        };
        let answer = [Instant::from_micros(10_200)];
        assert_eq!(count(b"BW000016", &answer), 2);
        assert_eq!(count(b"BW000016", &[]), 1);
        assert_eq!(count(b"00001602", &answer), 1);
    }

    /// Frames of a range finder each 10 ms; the reply to a command follows one of them at once.
    #[test]
    fn an_answer_within_a_stream_is_a_message_of_its_own() {
        let frame = b"YYabcdefg";
        let mut pieces: Vec<(u64, &[u8])> = (1..=12).map(|n| (n * 20, &frame[..])).collect();
        pieces.push((250, b"YYabcdefg\x42\x57\x02\x01"));
        let mut expected = vec![frame.to_vec(); 13];
        expected.push(b"\x42\x57\x02\x01".to_vec());
        let track = track(&pieces);
        let fast = LineConfig::new_8n1(115_200);
        let messages = Cut::Gaps.messages(&track, fast, &[]);
        let join = |message: &Vec<Piece>| {
            let bytes = message.iter().map(|piece| &piece.bytes[..]);
            bytes.collect::<Vec<_>>().concat()
        };
        assert_eq!(messages.iter().map(join).collect::<Vec<_>>(), expected);
    }

    /// Fifteen requests of SLIP, each 200 ms apart. One has an escape, so it is one byte longer:
    /// the form of six bytes would leave its last byte as a request of its own. Without a
    /// marker, three longer messages of fifteen show that the length varies.
    #[test]
    fn a_longer_request_is_not_cut_by_the_form_of_the_others() {
        let pieces = |short: &'static [u8], long: &'static [u8], longer: &[u64]| {
            let one = |at: u64| match longer.contains(&at) {
                true => (at * 200, long),
                false => (at * 200, short),
            };
            (1..=15).map(one).collect::<Vec<_>>()
        };
        let slip = b"\xC0\x01\xD0\x69\x7D\xC0";
        let escaped = b"\xC0\x01\xDB\xDC\xED\x8A\xC0";
        for (short, long, longer) in [
            (&slip[..], &escaped[..], &[7][..]),
            (b"\x01\x06abcd", b"\x01\x06abcdefg", &[3, 7, 11]),
            // Binary messages with a marker at the end only.
            (b"\x01\x06ab\x00", b"\x01\x06abcd\x00", &[7]),
        ] {
            let pieces = pieces(short, long, longer);
            let expected: Vec<_> = pieces.iter().map(|(_, bytes)| bytes.to_vec()).collect();
            assert_eq!(cut(&pieces, &[]), expected);
        }
    }

    #[test]
    fn text_is_cut_by_lines_however_it_came() {
        let pieces: [(u64, &[u8]); 3] = [(10, b"ATZ\rAT"), (11, b"E0\r"), (500, b"0100\r")];
        assert_eq!(
            cut(&pieces, &[]),
            [b"ATZ\r".to_vec(), b"ATE0\r".to_vec(), b"0100\r".to_vec()]
        );
        // A line feed ends a line, also after a carriage return.
        assert_eq!(
            cut(&[(10, b"a\r\nb\r\n")], &[]),
            [b"a\r\n".to_vec(), b"b\r\n".to_vec()]
        );
    }

    /// The golden read of ten registers from 36 of the rescue base, twice back to back.
    #[test]
    fn frames_of_a_known_protocol_are_cut_without_silence() {
        let frame = [0xAB, 0x24, 0x0A, 0x00, 0xD9];
        let twice = [frame, frame].concat();
        assert_eq!(cut(&[(10, &twice)], &[]), [frame.to_vec(), frame.to_vec()]);
    }

    /// A byte at 9600 baud takes 1,041,666 ns: the first of two lines ends two characters earlier.
    #[test]
    fn each_part_knows_when_its_last_byte_was_complete() {
        let track = track(&[(10, b"a\nb\n")]);
        let messages = Cut::Lines(b'\n').messages(&track, SLOW, &[]);
        let times: Vec<_> = messages.iter().map(|one| one[0].at.as_nanos()).collect();
        assert_eq!(times, [7_916_667, 10_000_000]);
    }
    /// Ten messages of a form, and half of all. Only one in ten may have another last byte, or
    /// bytes behind it that are no message of the form.
    #[test]
    fn a_form_needs_ten_messages_and_half_of_all() {
        let form = |own: &[(usize, &'static [u8])], others: u8| {
            let own = own.iter().flat_map(|&(count, bytes)| vec![bytes; count]);
            let foreign: Vec<[u8; 3]> = (0..others).map(|n| [n, n, n]).collect();
            let messages: Vec<&[u8]> = own.chain(foreign.iter().map(|one| &one[..])).collect();
            Form::of(&messages).map(|form| (form.head.to_vec(), form.len, form.last))
        };
        let own = |last| Some((b"YY".to_vec(), 6, last));
        assert_eq!(form(&[(9, b"YYabcd")], 0), None);
        assert_eq!(form(&[(10, b"YYabcd")], 0), own(Some(b'd')));
        assert_eq!(form(&[(10, b"YYabcd")], 10), own(Some(b'd')));
        assert_eq!(form(&[(10, b"YYabcd")], 11), None);
        assert_eq!(form(&[(10, b"YY")], 0), None);
        assert_eq!(
            form(&[(10, b"YYd")], 0),
            Some((b"YY".to_vec(), 3, Some(b'd')))
        );
        assert_eq!(form(&[(9, b"YYabcd"), (1, b"YYabce")], 0), own(Some(b'd')));
        assert_eq!(form(&[(8, b"YYabcd"), (2, b"YYabce")], 0), own(None));
        assert_eq!(
            form(&[(10, b"YYabcd"), (1, b"YYabcdZZ")], 0),
            own(Some(b'd'))
        );
        assert_eq!(form(&[(10, b"YYabcd"), (2, b"YYabcdZZ")], 0), None);
        // Two messages without a silence are none that differ, nor is a short one.
        let whole = [(10, &b"YYabcd"[..]), (5, b"YYabcdYYabcd"), (5, b"YYab")];
        assert_eq!(form(&whole, 0), own(Some(b'd')));
        assert_eq!(form(&[(10, b"Y")], 0), None);
    }

    /// A message of the form has its last byte, too.
    #[test]
    fn bytes_begin_with_a_message_of_the_form() {
        let form = |last| Form {
            head: b"YY",
            len: 4,
            last,
        };
        let begins = |bytes: &[u8]| [form(None).begins(bytes), form(Some(b'd')).begins(bytes)];
        assert_eq!(begins(b"YYad"), [true, true]);
        assert_eq!(begins(b"YYadxx"), [true, true]);
        assert_eq!(begins(b"YYax"), [true, false]);
        assert_eq!((begins(b"YYa"), begins(b"Yaad")), ([false; 2], [false; 2]));
    }

    #[test]
    fn a_time_is_between_two_others_from_the_first_on() {
        let at = Instant::from_millis;
        let breaks = [at(10), at(20)];
        let times = [(9, 10), (10, 10), (10, 11), (11, 20), (11, 21), (21, 90)];
        let found = times.map(|(from, until)| is_between(&breaks, at(from), at(until)));
        assert_eq!(found, [false, false, true, false, true, false]);
    }

    /// The least gap is three and a half characters, here of 1.0417 ms, but at least 3 ms.
    #[test]
    fn the_least_gap_is_three_characters_and_a_half() {
        assert_eq!(least_gap(SLOW).as_micros(), 3_645);
        assert_eq!(least_gap(LineConfig::new_8n1(115_200)), GAP_MIN);
    }

    /// At 1 Mbaud a byte takes 10 us. Pieces 3 ms apart are one message. A message is left out if
    /// the other side sent bytes during it.
    #[test]
    fn messages_during_which_the_other_side_is_silent_are_learnt_from() {
        let fast = LineConfig::new_8n1(1_000_000);
        let mut track = Track::default();
        for (micros, bytes) in [
            (10_000, &b"ab"[..]),
            (13_010, b"c"),
            (20_000, b"de"),
            (23_011, b"f"),
        ] {
            track.push(Instant::from_micros(micros), bytes);
        }
        let at = Instant::from_micros;
        let ranges = |breaks: &[Instant]| undisturbed(&track, fast, breaks);
        assert_eq!(ranges(&[]), [0..3, 3..5, 5..6]);
        assert_eq!(ranges(&[at(11_000)]), [3..5, 5..6]);
        assert_eq!(ranges(&[at(15_000), at(23_000)]), [0..3, 3..5, 5..6]);
        assert_eq!(ranges(&[at(23_001)]), [0..3, 3..5]);
    }

    /// A line in two pieces is one line if they are at most 50 ms apart, at 9600 baud with 3.1 ms
    /// for the second piece. A prompt ends where the other side has sent something after it.
    #[test]
    fn an_unfinished_line_ends_with_a_long_silence() {
        let both = |at| cut(&[(10, b"AT"), (at, b"E0\r")], &[]).len();
        assert_eq!([63, 64].map(both), [1, 2]);
        let prompt = |breaks: &[u64]| cut(&[(10, b"OK\r>"), (30, b"NO\r>")], breaks);
        assert_eq!(
            prompt(&[]),
            [b"OK\r".to_vec(), b">NO\r".to_vec(), b">".to_vec()]
        );
        let apart = [&b"OK\r"[..], b">", b"NO\r", b">"].map(<[u8]>::to_vec);
        assert_eq!(prompt(&[20]), apart);
    }

    #[test]
    fn text_ends_with_a_line_feed_or_a_carriage_return() {
        let of = |bytes: &[u8]| terminator(bytes);
        assert_eq!(
            (of(b"a\r\nb"), of(b"a\rb\t~"), of(b"a b")),
            (Some(b'\n'), Some(b'\r'), None)
        );
        assert_eq!(
            (of(b""), of(b"a\n\x7F"), of(b"\x1Fa\n")),
            (None, None, None)
        );
    }

    /// Four fifths of the bytes in frames of a protocol are its frames. The golden read of a
    /// register has five bytes.
    #[test]
    fn frames_have_a_protocol() {
        let frames = [0xAB, 0x24, 0x0A, 0x00, 0xD9].repeat(8);
        let name = |noise: usize| {
            let bytes = [&frames[..], &vec![0x80; noise]].concat();
            Cut::of(&bytes).codec().map(Codec::name)
        };
        let bus = codec::guess(&frames).map(Codec::name);
        assert!(bus.is_some());
        assert_eq!((name(0), name(10), name(11)), (bus, bus, None));
        assert!(Cut::Gaps.codec().is_none() && Cut::Lines(b'\n').codec().is_none());
    }
}
