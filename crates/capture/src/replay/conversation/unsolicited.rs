//! Distinction of unsolicited messages from answers.

use core::time::Duration;
use std::collections::BTreeMap;

use protocols::Instant;

use super::cut::{Cut, Piece};
use engine::codec::What;
use engine::rig::line::Direction;

/// Number of messages of a kind before the first request that make the kind unsolicited.
const FREE_MIN: usize = 3;
/// Maximum number of first bytes that distinguish unsolicited messages from answers.
const HEAD_MAX: usize = 4;
/// An additional message in a period is an answer; the period may differ by one part in this many.
const PERIOD_PARTS: u32 = 4;

/// For each of `messages`, whether it is unsolicited. Their kinds are those that are repeated and
/// occurred before the first of `requests`. A message of such a kind is an answer if it follows a
/// request and comes in addition to those of the period.
pub(super) fn are_unsolicited(
    cut: Cut,
    messages: &[Vec<Piece>],
    requests: &[Instant],
) -> Vec<bool> {
    let Some(&first_request) = requests.first() else {
        return vec![false; messages.len()];
    };
    let mut kinds: BTreeMap<Vec<u8>, Vec<usize>> = BTreeMap::new();
    for (index, message) in messages.iter().enumerate() {
        kinds.entry(kind(cut, message)).or_default().push(index);
    }
    let mut free = vec![false; messages.len()];
    for of_kind in kinds.into_values() {
        let is_early = |index: &&usize| messages[**index][0].arrived < first_request;
        let early: Vec<usize> = of_kind.iter().filter(is_early).copied().collect();
        if early.len() < 2 && (early.is_empty() || of_kind.len() <= FREE_MIN) {
            continue;
        }
        let head = match cut {
            Cut::Lines(_) => Vec::new(),
            Cut::Frames(_) | Cut::Gaps => common_head(messages, &early),
        };
        let begins = |index: &usize| bytes_of(&messages[*index]).starts_with(&head);
        let of_kind: Vec<usize> = of_kind.into_iter().filter(begins).collect();
        let times: Vec<Instant> = of_kind.iter().map(|&index| messages[index][0].at).collect();
        for (index, is_answer) in of_kind.into_iter().zip(additional(&times, requests)) {
            free[index] = !is_answer;
        }
    }
    free
}

fn bytes_of(message: &[Piece]) -> Vec<u8> {
    message
        .iter()
        .flat_map(|piece| &piece.bytes)
        .copied()
        .collect()
}

/// The first bytes that these messages have in common, at most [`HEAD_MAX`]; empty for one message.
fn common_head(messages: &[Vec<Piece>], indices: &[usize]) -> Vec<u8> {
    let [first, rest @ ..] = indices else {
        return Vec::new();
    };
    if rest.is_empty() {
        return Vec::new();
    }
    let mut head = bytes_of(&messages[*first]);
    head.truncate(HEAD_MAX);
    for &index in rest {
        let other = bytes_of(&messages[index]);
        let same = head
            .iter()
            .zip(&other)
            .take_while(|(one, other)| one == other);
        head.truncate(same.count());
    }
    head
}

/// For each of the `times` of periodic messages, whether the message is one more than the period
/// has, and follows a request.
fn additional(times: &[Instant], requests: &[Instant]) -> Vec<bool> {
    let mut gaps: Vec<Duration> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_unstable();
    let mut extra = vec![false; times.len()];
    let Some(&period) = gaps.get(gaps.len() / 2) else {
        return extra;
    };
    for index in 1..times.len().saturating_sub(1) {
        let (before, at, behind) = (times[index - 1], times[index], times[index + 1]);
        let asked = requests.partition_point(|&time| time <= at).checked_sub(1);
        let is_asked = asked.is_some_and(|asked| requests[asked] > before);
        let around = behind - before;
        let is_period = around.abs_diff(period) <= period / PERIOD_PARTS;
        extra[index] = is_asked && is_period && !extra[index - 1];
    }
    extra
}

/// Common part of all messages of a kind: the name of a described message, the first word of a
/// line, or the first bytes.
pub(super) fn kind(cut: Cut, message: &[Piece]) -> Vec<u8> {
    let bytes = bytes_of(message);
    match cut {
        Cut::Frames(codec) if codec.is_own() => {
            let found = codec.found_towards(&bytes, Direction::ToMaster);
            let words = found.into_iter().find_map(|stretch| match stretch.what {
                What::Frame(words) => Some(words),
                What::Bad(_) => None,
            });
            let name = words.as_deref().and_then(|words| words.split(':').next());
            name.unwrap_or_default().as_bytes().to_vec()
        }
        Cut::Frames(codec) => (codec.answers().kind)(&bytes).to_vec(),
        Cut::Lines(_) => {
            let is_word = |byte: &&u8| byte.is_ascii_alphabetic() || **byte == b'$';
            bytes.iter().take_while(is_word).copied().collect()
        }
        Cut::Gaps => bytes.iter().take(2).copied().collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn message(at: u64, bytes: &[u8]) -> Vec<Piece> {
        vec![Piece {
            at: ms(at),
            arrived: ms(at),
            bytes: bytes.to_vec(),
        }]
    }

    /// The messages that, by their times and bytes, are unsolicited beside these requests.
    fn free(messages: &[(u64, &[u8])], requests: &[u64]) -> Vec<bool> {
        let messages: Vec<_> = messages
            .iter()
            .map(|&(at, bytes)| message(at, bytes))
            .collect();
        let requests: Vec<Instant> = requests.iter().map(|&at| ms(at)).collect();
        are_unsolicited(Cut::Gaps, &messages, &requests)
    }

    /// A kind is unsolicited if two of its messages come before the first request, or one of four
    /// in all.
    #[test]
    fn a_kind_that_comes_before_any_request_is_unsolicited() {
        let times = |list: &[u64]| list.iter().map(|&at| (at, &b"ab"[..])).collect::<Vec<_>>();
        assert_eq!(free(&times(&[10, 20, 100, 130]), &[50]), [true; 4]);
        assert_eq!(free(&times(&[10, 60, 110]), &[50]), [false; 3]);
        assert_eq!(free(&times(&[10, 60, 110, 160]), &[50]), [true; 4]);
        assert_eq!(free(&times(&[60, 110, 160, 210]), &[50]), [false; 4]);
        assert_eq!(
            free(&times(&[50, 100, 150, 200]), &[50]),
            [false; 4],
            "at its end"
        );
        assert_eq!(free(&times(&[10, 20]), &[]), [false; 2], "no request");
    }

    /// The period is 100 ms. A message between two of them that follows a request is its answer if
    /// the two are a period apart, to a quarter of it.
    #[test]
    fn a_message_more_than_the_period_has_is_an_answer() {
        let extra = |times: &[u64], requests: &[u64]| {
            let [times, requests] =
                [times, requests].map(|list| list.iter().map(|&at| ms(at)).collect::<Vec<_>>());
            additional(&times, &requests)
        };
        let times = [0, 100, 200, 300, 340, 400, 500];
        let only = |index: usize| (0..7).map(|at| at == index).collect::<Vec<_>>();
        assert_eq!(extra(&times, &[310]), only(4));
        assert_eq!(extra(&times, &[340]), only(4), "with it");
        assert_eq!(extra(&times, &[300]), only(9), "with the one before");
        assert_eq!(extra(&times, &[341]), only(9));
        assert_eq!(extra(&times, &[]), only(9));
        let late = |at| [0, 100, 200, 300, 340, at, at + 100, at + 200];
        assert_eq!(extra(&late(425), &[310])[4..6], [true, false]);
        assert_eq!(extra(&late(426), &[310])[4..6], [false, false]);
        assert_eq!(extra(&[5], &[1]), [false]);
        // Not two answers in a row: the second message is that of the period.
        let dense = [0, 100, 200, 250, 300, 350, 400, 500, 600, 700];
        let found = extra(&dense, &[210, 260, 310]);
        let places: Vec<usize> = (0..dense.len()).filter(|&at| found[at]).collect();
        assert_eq!(places, [3, 5]);
    }

    /// At most four bytes; one message has no head.
    #[test]
    fn a_head_is_what_early_messages_have_in_common() {
        let messages = [&b"abcdefg"[..], b"abcdxyz", b"abQ"].map(|bytes| message(0, bytes));
        let head = |indices: &[usize]| common_head(&messages, indices);
        assert_eq!(head(&[0, 1]), b"abcd");
        assert_eq!(
            (head(&[0, 1, 2]), head(&[0]), head(&[])),
            (b"ab".to_vec(), vec![], vec![])
        );
    }

    #[test]
    fn a_kind_is_the_first_word_or_the_first_two_bytes() {
        let kind = |cut, bytes: &[u8]| kind(cut, &message(0, bytes));
        assert_eq!(kind(Cut::Lines(b'\n'), b"$GPRMC,1\n"), b"$GPRMC");
        assert_eq!(kind(Cut::Lines(b'\n'), b"5 V\n"), b"");
        assert_eq!(
            (kind(Cut::Gaps, b"abc"), kind(Cut::Gaps, b"a")),
            (b"ab".to_vec(), b"a".to_vec())
        );
    }

    /// NMEA 0183: the checksum of "GPGGA,1" is 0x4B, that of "GPVTG,1" 0x4F, by exclusive or. Each
    /// message of a description has its name, and bytes that are no message have none.
    #[test]
    fn a_described_message_is_of_the_kind_of_its_name() {
        let text = "name = \"nmea\"\nabout = \"sentences\"\nline = { baud = 9600 }\n\
                    frame = { start = \"$\", end = \"\\r\\n\", checksum = \"nmea\" }\n\
                    message = [{ name = \"gga\", from = \"device\", text = \"GPGGA,1\" },\n\
                    { name = \"vtg\", from = \"device\", text = \"GPVTG,1\" }]\n\
                    every = [{ period = \"1s\", send = [\"gga\", \"vtg\"] }]\n";
        let none = |_: &str| Err("no file".to_owned());
        let description = ::description::Description::parse("nmea.toml", text, &none);
        let codec = engine::scenario::device::description::codec_of(&description.expect("sound"));
        let kind = |bytes: &[u8]| kind(Cut::Frames(codec), &message(0, bytes));
        assert_eq!(kind(b"$GPGGA,1*4B\r\n"), b"gga");
        assert_eq!(kind(b"$GPVTG,1*4F\r\n"), b"vtg");
        assert_eq!(kind(b"$GPGGA,1*4C\r\n"), b"");
    }
}
