//! Statistics of a line with an unknown protocol: its messages, their replies, their common
//! beginnings and ends.

use core::fmt;
use core::time::Duration;
use std::collections::BTreeMap;

use protocols::{Instant, LineConfig};

use super::transcript::silence;
use crate::{Interface, Kind, Record};
use engine::hex;
use engine::rig::line::Direction;

/// Bytes that arrived together.
struct Piece {
    direction: Direction,
    begins: Instant,
    ends: Instant,
    bytes: Vec<u8>,
}

/// Minimum, median and maximum of some values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread<T> {
    /// The minimum.
    pub least: T,
    /// The median.
    pub median: T,
    /// The maximum.
    pub most: T,
}

impl<T: Copy + Ord> Spread<T> {
    fn of(mut values: Vec<T>) -> Option<Self> {
        values.sort_unstable();
        Some(Self {
            least: *values.first()?,
            median: values[values.len() / 2],
            most: *values.last()?,
        })
    }
}

/// A beginning or end that many pieces share.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shared {
    /// The common bytes.
    pub bytes: Vec<u8>,
    /// Number of messages that have them.
    pub count: usize,
}

/// One direction of a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Number of messages, separated by silence or by bytes of the other direction.
    pub pieces: usize,
    /// Their lengths.
    pub lengths: Option<Spread<usize>>,
    /// The most frequent length.
    pub usual: Option<usize>,
    /// Times between the beginnings of messages.
    pub periods: Option<Spread<Duration>>,
    /// Number of messages that follow one of the other direction, and the times between the two.
    pub answers: Option<(usize, Spread<Duration>)>,
    /// Entropy in bits per byte, from the frequencies of the values.
    pub entropy: f64,
    /// Percentage of printable bytes.
    pub printable: usize,
    /// Common first bytes of pieces.
    pub begins: Option<Shared>,
    /// Common last bytes of pieces: a candidate for a terminator.
    pub ends: Option<Shared>,
}

impl Profile {
    /// Statistics of `direction` of the link with this index.
    pub fn of(records: &[Record], index: usize, link: &Interface, direction: Direction) -> Self {
        let all = pieces(records, index, link);
        let own: Vec<&Piece> = all
            .iter()
            .filter(|piece| piece.direction == direction)
            .collect();
        let begins = own.windows(2).map(|pair| pair[1].begins - pair[0].begins);
        let answers = all
            .windows(2)
            .filter(|pair| pair[0].direction != direction && pair[1].direction == direction);
        let answers: Vec<Duration> = answers.map(|pair| pair[1].begins - pair[0].ends).collect();
        let bytes: Vec<u8> = own
            .iter()
            .flat_map(|piece| piece.bytes.iter().copied())
            .collect();
        let lengths = own.iter().map(|piece| piece.bytes.len());
        let printable = bytes
            .iter()
            .filter(|byte| matches!(byte, b' '..=b'~' | b'\r' | b'\n'));
        Self {
            pieces: own.len(),
            lengths: Spread::of(lengths.clone().collect()),
            usual: most_common(lengths)
                .filter(|(_, count)| *count > 1)
                .map(|(length, _)| length),
            periods: Spread::of(begins.collect()),
            answers: Spread::of(answers.clone()).map(|spread| (answers.len(), spread)),
            entropy: entropy(&bytes),
            printable: printable.count() * 100 / bytes.len().max(1),
            begins: shared(&own, |bytes, len| bytes.get(..len)),
            ends: shared(&own, |bytes, len| {
                bytes.get(bytes.len().checked_sub(len)?..)
            }),
        }
    }
}

/// The messages in `direction` of the link with this index: bytes between silences or bytes of the
/// other direction.
pub fn messages(
    records: &[Record],
    index: usize,
    link: &Interface,
    direction: Direction,
) -> Vec<Vec<u8>> {
    let all = pieces(records, index, link).into_iter();
    let own = all.filter(|piece| piece.direction == direction);
    own.map(|piece| piece.bytes).collect()
}

/// The pieces of both directions of a link.
fn pieces(records: &[Record], index: usize, link: &Interface) -> Vec<Piece> {
    let rate = LineConfig::new_8n1(link.baud.max(1));
    let silence = silence(link.baud);
    let mut pieces: Vec<Piece> = Vec::new();
    let own = records
        .iter()
        .filter(|record| record.link == index && record.kind == Kind::Data);
    for record in own {
        for (at, bytes) in record.chunks(rate) {
            if bytes.is_empty() {
                continue;
            }
            // At an unknown rate, the start of a message equals its end.
            let begins = match link.baud {
                0 => at,
                _ => rate.byte_end(at, bytes.len() as u64),
            };
            let goes_on = pieces.last().is_some_and(|last| {
                last.direction == record.direction
                    && (begins <= last.ends || begins - last.ends <= silence)
            });
            match pieces.last_mut().filter(|_| goes_on) {
                Some(last) => {
                    last.bytes.extend_from_slice(bytes);
                    last.ends = at;
                }
                None => pieces.push(Piece {
                    direction: record.direction,
                    begins,
                    ends: at,
                    bytes: bytes.to_vec(),
                }),
            }
        }
    }
    pieces
}

fn most_common<T: Ord>(values: impl Iterator<Item = T>) -> Option<(T, usize)> {
    let mut counts: BTreeMap<T, usize> = BTreeMap::new();
    values.for_each(|value| *counts.entry(value).or_default() += 1);
    counts.into_iter().max_by_key(|(_, count)| *count)
}

/// The longest beginning or end, of up to four bytes, that half of the messages share.
fn shared(own: &[&Piece], part: fn(&[u8], usize) -> Option<&[u8]>) -> Option<Shared> {
    (1..=4).rev().find_map(|len| {
        let parts = own.iter().filter(|piece| piece.bytes.len() > len);
        let (bytes, count) = most_common(parts.filter_map(|piece| part(&piece.bytes, len)))?;
        let bytes = bytes.to_vec();
        (count >= 3 && count * 2 >= own.len()).then_some(Shared { bytes, count })
    })
}

fn entropy(bytes: &[u8]) -> f64 {
    let mut counts = [0_u32; 256];
    bytes
        .iter()
        .for_each(|&byte| counts[usize::from(byte)] += 1);
    let all = bytes.len().max(1) as f64;
    let shares = counts
        .iter()
        .filter(|count| **count > 0)
        .map(|&count| f64::from(count) / all);
    let sum: f64 = shares.map(|share| share * libm::log2(share)).sum();
    // Avoids a minus sign before zero.
    if sum == 0.0 { 0.0 } else { -sum }
}

fn millis(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

impl fmt::Display for Profile {
    /// Indented lines, without a final line end.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (count, entropy, printable) = (self.pieces, self.entropy, self.printable);
        write!(f, "  {count} pieces")?;
        if let Some(Spread { least, most, .. }) = self.lengths {
            write!(f, " of {least} to {most} bytes")?;
        }
        if let Some(usual) = self.usual {
            write!(f, ", most often {usual}")?;
        }
        if let Some(Spread {
            least,
            median,
            most,
        }) = self.periods
        {
            let [least, median, most] = [least, median, most].map(millis);
            write!(f, "; one each {median:.3} ms ({least:.3} to {most:.3})")?;
        }
        if let Some((
            count,
            Spread {
                least,
                median,
                most,
            },
        )) = self.answers
        {
            let [least, median, most] = [least, median, most].map(millis);
            write!(
                f,
                "\n  {count} follow the other direction, {median:.3} ms later ({least:.3} to \
                 {most:.3})"
            )?;
        }
        write!(
            f,
            "\n  {entropy:.2} bits of entropy a byte, {printable} % printable"
        )?;
        for (what, shared) in [("begin with", &self.begins), ("end with", &self.ends)] {
            if let Some(Shared { bytes, count }) = shared {
                let (pairs, all) = (hex::pairs(bytes), self.pieces);
                write!(f, "\n  {count} of {all} pieces {what} {pairs}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten requests of three bytes, each answered by two messages 5 ms later; at 9,600 baud a
    /// character takes 1.04 ms. Two equally frequent values have an entropy of one bit.
    #[test]
    fn requests_and_answers_are_told_by_their_times() {
        let record = |millis: u64, direction, bytes: &[u8]| Record {
            link: 0,
            sequence: None,
            at: Instant::from_millis(millis),
            direction,
            kind: Kind::Data,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        let mut records = Vec::new();
        for turn in 0..10 {
            let at = 100 * turn + 10;
            records.push(record(at, Direction::ToDevice, &[0xC1, 3, 0]));
            records.push(record(at + 6, Direction::ToMaster, &[0xC1]));
            records.push(record(at + 7, Direction::ToMaster, &[0x0D]));
        }
        let link = Interface::new("x", 9_600);
        let answers = Profile::of(&records, 0, &link, Direction::ToMaster);
        assert_eq!((answers.pieces, answers.usual), (10, Some(2)));
        let (count, spread) = answers.answers.expect("answers");
        assert_eq!(count, 10);
        assert!((4..=6).contains(&spread.median.as_millis()), "{spread:?}");
        assert!((answers.entropy - 1.0).abs() < 1e-9);
        let begins = answers.begins.clone().expect("all begin alike");
        assert_eq!((begins.bytes, begins.count), (vec![0xC1], 10));
        let period = answers.periods.expect("several").median;
        assert_eq!(period, Duration::from_millis(100));
        let requests = Profile::of(&records, 0, &link, Direction::ToDevice);
        assert_eq!(requests.lengths.map(|spread| spread.most), Some(3));
        let said = requests.to_string();
        assert!(
            said.contains("10 pieces of 3 to 3 bytes, most often 3"),
            "{said}"
        );
        assert!(said.contains("10 of 10 pieces begin with C1 03"), "{said}");
    }

    #[test]
    fn nothing_has_no_profile_to_speak_of() {
        let link = Interface::new("x", 0);
        let said = Profile::of(&[], 0, &link, Direction::ToMaster).to_string();
        assert!(said.starts_with("  0 pieces\n  0.00 bits"), "{said}");
    }

    fn record(millis: u64, direction: Direction, bytes: &[u8]) -> Record {
        Record {
            link: 0,
            sequence: None,
            at: Instant::from_millis(millis),
            direction,
            kind: Kind::Data,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        }
    }

    const TO: Direction = Direction::ToDevice;
    const FROM: Direction = Direction::ToMaster;

    /// At 10,000 baud a byte takes a millisecond, and three of them are a silence. At an unknown
    /// rate bytes take no time, and 2 ms are a silence.
    #[test]
    fn messages_end_with_a_silence() {
        let lens = |baud, times: &[u64]| -> Vec<usize> {
            let records: Vec<Record> = times.iter().map(|at| record(*at, FROM, b"ab")).collect();
            let link = Interface::new("x", baud);
            let found = messages(&records, 0, &link, FROM).into_iter();
            found.map(|message| message.len()).collect()
        };
        assert_eq!(lens(10_000, &[10, 15]), [4]);
        assert_eq!(lens(10_000, &[10, 16]), [2, 2]);
        assert_eq!(lens(10_000, &[10, 11]), [4]);
        assert_eq!(lens(0, &[10, 12]), [4]);
        assert_eq!(lens(0, &[10, 13]), [2, 2]);
    }

    /// Another direction ends a message; another link, an empty record and an event of the line do
    /// not.
    #[test]
    fn messages_belong_to_one_direction_of_one_link() {
        let records = [
            record(10, FROM, b"a"),
            record(10, FROM, b""),
            Record {
                link: 1,
                ..record(10, TO, b"x")
            },
            Record {
                kind: Kind::Other(7),
                ..record(10, TO, b"y")
            },
            record(10, FROM, b"b"),
            record(10, TO, b"c"),
            record(10, FROM, b"d"),
        ];
        let link = Interface::new("x", 0);
        let of = |direction| messages(&records, 0, &link, direction);
        assert_eq!(of(FROM), [b"ab".to_vec(), b"d".to_vec()]);
        assert_eq!(of(TO), [b"c".to_vec()]);
    }

    /// Messages of 1 to 4 bytes at 0, 100, 300 and 600 ms, at an unknown rate; the second and the
    /// fourth one follow a request by 3 and 7 ms.
    #[test]
    fn the_figures_of_a_line_by_hand() {
        let records = [
            record(1_000, FROM, b"ab"),
            record(1_097, TO, b"?"),
            record(1_100, FROM, b"abc"),
            record(1_300, FROM, b"a"),
            record(1_593, TO, b"?"),
            record(1_600, FROM, b"ab\x01\x02"),
        ];
        let link = Interface::new("x", 0);
        let own = Profile::of(&records, 0, &link, FROM);
        assert_eq!((own.pieces, own.usual), (4, None));
        let lengths = own.lengths.expect("four");
        assert_eq!((lengths.least, lengths.median, lengths.most), (1, 3, 4));
        let periods = own.periods.expect("three");
        let millis = [periods.least, periods.median, periods.most].map(|one| one.as_millis());
        assert_eq!(millis, [100, 200, 300]);
        let (count, times) = own.answers.expect("two");
        let millis = [times.least, times.most].map(|one| one.as_millis());
        assert_eq!((count, millis), (2, [3, 7]));
        // Eight of ten bytes are printable.
        assert_eq!(own.printable, 80);
        let said = own.to_string();
        let expected = "  4 pieces of 1 to 4 bytes; one each 200.000 ms (100.000 to 300.000)\n  2 \
                        follow the other direction, 7.000 ms later (3.000 to 7.000)\n";
        assert!(said.starts_with(expected), "{said}");
        // Of four messages, three have two bytes or more; they begin with 'a'.
        let begins = own.begins.expect("three of four");
        assert_eq!((&*begins.bytes, begins.count), (&b"a"[..], 3));
        assert_eq!(own.ends, None);
    }

    /// A message shares at most four bytes with at least two others, which are half of all. A whole
    /// message is no beginning of itself.
    #[test]
    fn half_of_the_messages_share_a_beginning() {
        let of = |messages: &[&[u8]]| {
            let records: Vec<Record> = (1..)
                .zip(messages)
                .map(|(n, bytes)| record(n * 100, FROM, bytes))
                .collect();
            let own = Profile::of(&records, 0, &Interface::new("x", 0), FROM);
            let bytes = |shared: Option<Shared>| shared.map(|one| (one.bytes, one.count));
            (bytes(own.begins), bytes(own.ends))
        };
        let five = of(&[b"abcdeX", b"abcdeY", b"abcdeZ"]);
        assert_eq!(five, (Some((b"abcd".to_vec(), 3)), None));
        let whole = of(&[b"abcd", b"abcd", b"abcd"]);
        let expected = (Some((b"abc".to_vec(), 3)), Some((b"bcd".to_vec(), 3)));
        assert_eq!(whole, expected);
        assert_eq!(of(&[b"aX", b"aY"]), (None, None));
        let half = [&b"aX"[..], b"aY", b"aZ", b"bU", b"cV", b"dW"];
        assert_eq!(of(&half).0, Some((b"a".to_vec(), 3)));
        let less = [&half[..], &[&b"eT"[..]]].concat();
        assert_eq!(of(&less).0, None);
    }

    /// The most frequent length counts if it occurs twice. Four equally frequent values have two
    /// bits; 1/4 and 3/4 have 0.5 + 0.75 * 0.415 = 0.811.
    #[test]
    fn entropy_is_in_bits() {
        let of = |bytes: &[u8]| (entropy(bytes) * 1e3).round();
        assert_eq!(
            [of(&[1, 2, 3, 4]), of(&[1, 2, 2, 2]), of(&[7; 9]), of(&[])],
            [2_000.0, 811.0, 0.0, 0.0]
        );
        assert!(entropy(&[7; 9]).is_sign_positive());
        assert_eq!(most_common([3, 5, 5].into_iter()), Some((5, 2)));
    }
}
