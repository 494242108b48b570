//! Damage that is proved by undoing it: bytes outside of frames become valid frames of the format.

use super::{Damage, Line, SAMPLE};
use engine::codec::{self, Codec};

/// A change of bytes that can be undone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// 0x00 is removed.
    NulStripped,
    /// 0x0D becomes 0x0A.
    CrToLf,
    /// 0x11 and 0x13 are removed.
    FlowControl,
    /// The first bit of each byte is taken for its last one.
    BitsReversed,
    /// Each bit has the other value.
    BitsInverted,
}

impl core::fmt::Display for Change {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::NulStripped => "NUL bytes are missing: the host strips 0x00",
            Self::CrToLf => "the host turns CR into LF",
            Self::FlowControl => "the host does software flow control: XON and XOFF are missing",
            Self::BitsReversed => "the bits of each byte are in reverse order",
            Self::BitsInverted => "all bits are inverted",
        })
    }
}

/// Bytes in valid frames of the expected protocol, or of the best one.
fn framed(line: &Line<'_>, bytes: &[u8]) -> u64 {
    match (line.codec, line.direction) {
        (Some(codec), Some(direction)) => codec.framed_towards(bytes, direction),
        (Some(codec), None) => codec.framed(bytes),
        (None, _) => codec::best(bytes).map_or(0, |(_, framed)| framed),
    }
}

/// The function that undoes a change of one byte.
type Undo = fn(u8) -> u8;

/// Changes of every byte of the line, `sound` bytes of which are in valid frames.
pub(super) fn of_all(line: &Line<'_>, sound: u64) -> Option<Damage> {
    let sample = &line.bytes[..line.bytes.len().min(SAMPLE)];
    let bytes = sample.len() as u64;
    if sound * 10 > line.bytes.len() as u64 * 2 {
        return None;
    }
    let changes: [(Change, Undo); 2] = [
        (Change::BitsReversed, u8::reverse_bits),
        (Change::BitsInverted, |byte| !byte),
    ];
    changes.into_iter().find_map(|(change, undo)| {
        let right: Vec<u8> = sample.iter().copied().map(undo).collect();
        // Only a silence may show where a frame ends.
        let of_message = |message: &Vec<u8>| {
            let right: Vec<u8> = message.iter().copied().map(undo).collect();
            framed(line, &right)
        };
        let by_message = || match line.codec {
            Some(_) => line.messages.iter().map(of_message).sum(),
            None => 0,
        };
        let (of, found) = match framed(line, &right) {
            found if found * 10 >= bytes * 8 => (bytes, found),
            _ => (line.bytes.len() as u64, by_message()),
        };
        (found * 10 >= of * 8).then_some(Damage::Undone {
            change,
            framed: found,
            bytes: of,
        })
    })
}

/// Maximum number of damaged messages that are examined, and of their bytes.
const MESSAGES_MAX: usize = 64;
const LEN_MAX: usize = 64;
/// Minimum number of damaged messages for a diagnosis.
const MESSAGES_MIN: usize = 8;
/// Maximum number of values that are put back into one message, and of tries for it.
const PUT_MAX: usize = 4;
const TRIES_MAX: usize = 2_000;

/// Changes of some values, in messages between silences.
pub(super) fn of_values(line: &Line<'_>) -> Option<Damage> {
    let codec = line.codec?;
    let is_whole = |bytes: &[u8]| is_whole(codec, line, bytes);
    let bad = line
        .messages
        .iter()
        .filter(|message| (1..=LEN_MAX).contains(&message.len()) && !is_whole(message));
    let bad: Vec<&Vec<u8>> = bad.take(MESSAGES_MAX).collect();
    if bad.len() < MESSAGES_MIN {
        return None;
    }
    let has = |value: u8| line.bytes.contains(&value);
    let inserted = |values: &'static [u8]| {
        move |message: &[u8], is: &dyn Fn(&[u8]) -> bool| {
            is_mended_by_inserting(message, values, is)
        }
    };
    let replaced = |value: u8| {
        move |message: &[u8], is: &dyn Fn(&[u8]) -> bool| is_mended_by_replacing(message, value, is)
    };
    type Mend<'a> = Box<dyn Fn(&[u8], &dyn Fn(&[u8]) -> bool) -> bool + 'a>;
    // Each with a control: other values, which mend a message only by chance.
    let changes: [(Change, bool, [Mend<'_>; 2]); 3] = [
        (
            Change::NulStripped,
            !has(0x00),
            [Box::new(inserted(&[0x00])), Box::new(inserted(&[0x55]))],
        ),
        (
            Change::CrToLf,
            !has(0x0D) && has(0x0A),
            [Box::new(replaced(0x0D)), Box::new(replaced(0x55))],
        ),
        (
            Change::FlowControl,
            !has(0x11) && !has(0x13),
            [
                Box::new(inserted(&[0x11, 0x13])),
                Box::new(inserted(&[0x55, 0x57])),
            ],
        ),
    ];
    let possible = changes
        .into_iter()
        .filter(|(_, is_possible, _)| *is_possible);
    possible
        .into_iter()
        .find_map(|(change, _, [mend, control])| {
            let mended: Vec<_> = bad.iter().filter(|one| mend(one, &is_whole)).collect();
            if mended.len() < MESSAGES_MIN || mended.len() * 10 < bad.len() * 6 {
                return None;
            }
            let by_chance = bad.iter().filter(|one| control(one, &is_whole)).count();
            let len = |all: &mut dyn Iterator<Item = usize>| all.sum::<usize>() as u64;
            (by_chance * 4 <= mended.len()).then(|| Damage::Undone {
                change,
                framed: len(&mut mended.iter().map(|one| one.len())),
                bytes: len(&mut bad.iter().map(|one| one.len())),
            })
        })
}

/// Whether `bytes` consist of valid frames.
fn is_whole(codec: &Codec, line: &Line<'_>, bytes: &[u8]) -> bool {
    let framed = match line.direction {
        Some(direction) => codec.framed_towards(bytes, direction),
        None => codec.framed(bytes),
    };
    framed == bytes.len() as u64
}

/// Whether some of `values`, put into `message`, make it valid.
fn is_mended_by_inserting(message: &[u8], values: &[u8], is_whole: &dyn Fn(&[u8]) -> bool) -> bool {
    /// Puts `count` values at or behind `from`.
    fn put(
        bytes: &mut Vec<u8>,
        (from, count): (usize, usize),
        values: &[u8],
        tries: &mut usize,
        is_whole: &dyn Fn(&[u8]) -> bool,
    ) -> bool {
        if count == 0 {
            *tries = tries.saturating_sub(1);
            return is_whole(bytes);
        }
        for at in from..=bytes.len() {
            for &value in values {
                if *tries == 0 {
                    return false;
                }
                bytes.insert(at, value);
                let is_mended = put(bytes, (at + 1, count - 1), values, tries, is_whole);
                bytes.remove(at);
                if is_mended {
                    return true;
                }
            }
        }
        false
    }
    let mut tries = TRIES_MAX;
    (1..=PUT_MAX).any(|count| {
        put(
            &mut message.to_vec(),
            (0, count),
            values,
            &mut tries,
            is_whole,
        )
    })
}

/// Whether `value` in place of some 0x0A makes `message` valid.
fn is_mended_by_replacing(message: &[u8], value: u8, is_whole: &dyn Fn(&[u8]) -> bool) -> bool {
    let places: Vec<usize> = (0..message.len())
        .filter(|&at| message[at] == 0x0A)
        .collect();
    let places = &places[..places.len().min(TRIES_MAX.ilog2() as usize)];
    (1..1_usize << places.len()).any(|chosen| {
        let mut bytes = message.to_vec();
        for (bit, &at) in places.iter().enumerate() {
            if chosen >> bit & 1 == 1 {
                bytes[at] = value;
            }
        }
        is_whole(&bytes)
    })
}

#[cfg(test)]
mod tests {
    use core::cell::Cell;

    use protocols::avr::{ChecksumOrder, Frame};

    use super::*;
    use engine::codec::BUS;

    /// A read of a register, five bytes: AB, register, count, and their sum in two bytes.
    fn read(register: u8, count: u8) -> Vec<u8> {
        let frame = Frame::read(register, count, ChecksumOrder::LowFirst);
        frame.as_bytes().to_vec()
    }

    /// The damage of the bytes of `messages`, of a line with this protocol.
    fn damage(codec: Option<&'static Codec>, messages: &[Vec<u8>]) -> Option<Damage> {
        let bytes = messages.concat();
        of_values(&Line {
            bytes: &bytes,
            codec,
            messages,
            ..Line::default()
        })
    }

    fn undone(change: Change, framed: u64, bytes: u64) -> Option<Damage> {
        Some(Damage::Undone {
            change,
            framed,
            bytes,
        })
    }

    /// 80 % of the bytes in frames prove the change, unless over 20 % are in frames without it.
    #[test]
    fn every_byte_is_changed_back() {
        let of = |undo: Undo, frames: usize, noise: usize, sound: u64| {
            let mut bytes: Vec<u8> = read(36, 10).repeat(frames);
            bytes.extend(vec![0x55; noise]);
            let bytes: Vec<u8> = bytes.into_iter().map(undo).collect();
            let line = Line {
                bytes: &bytes,
                codec: Some(&BUS),
                ..Line::default()
            };
            of_all(&line, sound)
        };
        let (reversed, inverted) = (Change::BitsReversed, Change::BitsInverted);
        assert_eq!(of(u8::reverse_bits, 40, 0, 0), undone(reversed, 200, 200));
        assert_eq!(of(|byte| !byte, 40, 0, 0), undone(inverted, 200, 200));
        assert_eq!(of(|byte| byte, 40, 0, 0), None);
        assert_eq!(of(u8::reverse_bits, 40, 0, 40), undone(reversed, 200, 200));
        assert_eq!(of(u8::reverse_bits, 40, 0, 41), None);
        assert_eq!(of(u8::reverse_bits, 32, 40, 0), undone(reversed, 160, 200));
        assert_eq!(of(u8::reverse_bits, 31, 45, 0), None);
    }

    /// The frames of the messages between silences count if the stream has too few, and if the
    /// protocol is expected.
    #[test]
    fn messages_may_prove_what_the_stream_does_not() {
        let of = |codec, messages: usize| {
            let reversed: Vec<u8> = read(36, 10).into_iter().map(u8::reverse_bits).collect();
            let bytes = [reversed.repeat(8), vec![0x55; 160]].concat();
            let messages = vec![reversed; messages];
            let line = Line {
                bytes: &bytes,
                codec,
                messages: &messages,
                ..Line::default()
            };
            of_all(&line, 0)
        };
        let found = undone(Change::BitsReversed, 160, 200);
        assert_eq!((of(Some(&BUS), 32), of(Some(&BUS), 31)), (found, None));
        assert_eq!(of(None, 32), None);
    }

    /// Eight damaged messages, of which six in ten become whole by the value. Whole messages, empty
    /// ones and long ones do not count.
    #[test]
    fn most_damaged_messages_become_whole() {
        // 0xAB + 0x24 + 0x0A is 0xD9; the other sum, 0x119, has no zero.
        let stripped: Vec<u8> = read(36, 10).into_iter().filter(|&byte| byte != 0).collect();
        assert_eq!(stripped.len(), 4);
        let of = |mended: usize, other: usize, more: Vec<Vec<u8>>| {
            let mut messages = vec![stripped.clone(); mended];
            messages.extend(vec![vec![0x77]; other]);
            messages.extend(more);
            damage(Some(&BUS), &messages)
        };
        let found =
            |mended: u64, other: u64| undone(Change::NulStripped, 4 * mended, 4 * mended + other);
        assert_eq!((of(7, 0, vec![]), of(8, 0, vec![])), (None, found(8, 0)));
        assert_eq!((of(8, 5, vec![]), of(8, 6, vec![])), (found(8, 5), None));
        assert_eq!(of(9, 6, vec![]), found(9, 6));
        assert_eq!(of(8, 0, vec![read(100, 10); 20]), found(8, 0));
        assert_eq!(of(8, 0, vec![vec![0x77; 65]; 20]), found(8, 0));
        assert_eq!(of(8, 0, vec![vec![0x77; 64]; 1]), {
            let bytes = 8 * 4 + 64;
            undone(Change::NulStripped, 32, bytes)
        });
        assert_eq!(of(8, 0, vec![vec![]; 20]), found(8, 0));
        // The first 64 damaged messages count.
        assert_eq!(of(64, 60, vec![]), found(64, 0));
        // A line with a zero does not strip them; without a protocol nothing is whole.
        assert_eq!(of(8, 0, vec![read(36, 10)]), None);
        assert_eq!(damage(None, &vec![stripped.clone(); 8]), None);
    }

    /// Register 13 is read as register 10, and register 17 is missing.
    #[test]
    fn other_values_are_put_back() {
        let feed: Vec<u8> = read(13, 1)
            .into_iter()
            .map(|byte| if byte == 0x0D { 0x0A } else { byte })
            .collect();
        let found = undone(Change::CrToLf, 40, 40);
        assert_eq!(damage(Some(&BUS), &vec![feed.clone(); 8]), found);
        let mut with_return = vec![feed; 8];
        with_return.push(vec![0x0D]);
        assert_eq!(damage(Some(&BUS), &with_return), None);
        for register in [0x11, 0x13] {
            let eaten: Vec<u8> = read(register, 1)
                .into_iter()
                .filter(|&byte| byte != register)
                .collect();
            let found = undone(Change::FlowControl, 32, 32);
            assert_eq!(damage(Some(&BUS), &vec![eaten.clone(); 8]), found);
            for other in [0x11, 0x13] {
                let mut with_it = vec![eaten.clone(); 8];
                with_it.push(vec![other]);
                assert_eq!(damage(Some(&BUS), &with_it), None);
            }
        }
    }

    /// Another value than the removed one mends a quarter of as many messages at most.
    #[test]
    fn other_values_mend_only_by_chance() {
        let without = |register: u8, value: u8| -> Vec<u8> {
            let bytes = read(register, 10).into_iter();
            bytes.filter(|&byte| byte != value).collect()
        };
        let of = |by_chance: usize| {
            let mut messages = vec![without(36, 0); 8];
            messages.extend(vec![without(0x55, 0x55); by_chance]);
            damage(Some(&BUS), &messages)
        };
        assert_eq!(of(2), undone(Change::NulStripped, 32, 40));
        assert_eq!(of(3), None);
    }

    /// Up to four values are put anywhere, also beside each other. For one byte there are 2, 3, 4
    /// and 5 places to choose 1 to 4 of: with two values 4 + 12 + 32 + 80 tries. Of a long message,
    /// 2,000 are tried.
    #[test]
    fn values_are_put_in_all_places() {
        let is = |message: &[u8], target: &[u8]| {
            is_mended_by_inserting(message, b"xy", &|bytes| bytes == target)
        };
        for target in [
            &b"xab"[..],
            b"axb",
            b"aby",
            b"xxab",
            b"yaxbx",
            b"xyxyab",
            b"axyxyb",
        ] {
            assert!(is(b"ab", target), "{target:?}");
        }
        for target in [&b"ab"[..], b"xxxxxab", b"ba", b"xba", b"azb"] {
            assert!(!is(b"ab", target), "{target:?}");
        }
        let tries = |message: &[u8]| {
            let count = Cell::new(0);
            let never = |_: &[u8]| {
                count.set(count.get() + 1);
                false
            };
            assert!(!is_mended_by_inserting(message, b"xy", &never));
            count.get()
        };
        assert_eq!((tries(b"a"), tries(&[b'a'; 64])), (4 + 12 + 32 + 80, 2_000));
    }

    /// Each choice of the line feeds but none: seven of three, and of the first ten at most.
    #[test]
    fn some_line_feeds_are_replaced() {
        let is = |message: &[u8], target: &[u8]| {
            is_mended_by_replacing(message, b'x', &|bytes| bytes == target)
        };
        for target in [&b"xa\nb\n"[..], b"\naxb\n", b"\na\nbx", b"xaxbx"] {
            assert!(is(b"\na\nb\n", target), "{target:?}");
        }
        assert!(!is(b"\na\nb\n", b"\na\nb\n") && !is(b"ab", b"ab"));
        let tries = |feeds: usize| {
            let count = Cell::new(0);
            let never = |_: &[u8]| {
                count.set(count.get() + 1);
                false
            };
            assert!(!is_mended_by_replacing(&vec![b'\n'; feeds], b'x', &never));
            count.get()
        };
        assert_eq!([0, 1, 3, 10, 11].map(tries), [0, 1, 7, 1_023, 1_023]);
    }
}
