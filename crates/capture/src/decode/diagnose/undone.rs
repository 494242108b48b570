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
