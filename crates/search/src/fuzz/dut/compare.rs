//! Comparisons that a program made, and inputs that change their results.
//!
//! If one side of a comparison occurs in the input, as bytes or digits, the other side replaces it
//! (Aschermann et al., REDQUEEN, NDSS 2019). A condition that random bytes meet once in a million
//! tries then costs a few tries.

use std::collections::BTreeSet;

/// Maximum number of bytes of a side; the same as in the runtime.
pub(super) const SIDE: usize = 32;
/// Number of bytes of a comparison in the file; the same as in the runtime.
pub(super) const PAIR: usize = 8 + 2 * SIDE;
/// Kinds of comparisons; the same as in the runtime.
const FLOATING: u8 = 0x40;
const TEXT: u8 = 0x80;
/// Maximum number of positions in a message at which a side is replaced.
const PLACES_MAX: usize = 6;
/// Maximum number of messages that one comparison creates.
const MADE_MAX: usize = 40;

/// Two sides that were not equal.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Comparison {
    /// The location of the comparison in the program.
    pub(super) place: u32,
    sides: Sides,
}

#[derive(Clone, Debug, PartialEq)]
enum Sides {
    /// Integers with this number of bytes.
    Numbers(usize, [u64; 2]),
    /// Floating-point numbers with this number of bytes.
    Floating(usize, [f64; 2]),
    /// Texts or memory.
    Texts([Vec<u8>; 2]),
}

impl Comparison {
    /// Parses an entry of the runtime; the program may have overwritten it.
    pub(super) fn read(pair: &[u8]) -> Option<Self> {
        let place = u32::from_le_bytes(pair.get(..4)?.try_into().ok()?);
        let side = |at: usize| {
            let bytes = pair.get(8 + at * SIDE..)?.get(..SIDE)?;
            Some((bytes, bytes.get(..usize::from(pair[5 + at]))?))
        };
        let ((one, one_text), (other, other_text)) = (side(0)?, side(1)?);
        let bytes = [one, other].map(|side| side.first_chunk().copied().unwrap_or_default());
        let [one, other] = bytes.map(u64::from_le_bytes);
        let sides = match pair[4] {
            TEXT => Sides::Texts([one_text.to_vec(), other_text.to_vec()]),
            kind if kind & FLOATING != 0 => {
                let len = usize::from(kind & !FLOATING);
                let number = |[a, b, c, d, ..]: [u8; 8]| f32::from_le_bytes([a, b, c, d]).into();
                let sides = match len {
                    4 => bytes.map(number),
                    _ => bytes.map(f64::from_le_bytes),
                };
                Sides::Floating(len, sides)
            }
            len => Sides::Numbers(usize::from(len).clamp(1, 8), [one, other]),
        };
        Some(Self { place, sides })
    }

    /// Whether texts were compared, e.g. a word with a list of commands.
    pub(super) const fn is_of_texts(&self) -> bool {
        matches!(self.sides, Sides::Texts(_))
    }

    /// Variants of `message` that change the result, the most promising first.
    pub(super) fn instead(&self, message: &[u8]) -> Vec<Vec<u8>> {
        let mut made = Made::new(message);
        match &self.sides {
            Sides::Texts([one, other]) => {
                made.replace(one, other);
                made.replace(other, one);
            }
            Sides::Numbers(len, [one, other]) => {
                made.number(*len, *one, *other);
                made.number(*len, *other, *one);
            }
            Sides::Floating(len, [one, other]) => {
                made.floating(*len, *one, *other);
                made.floating(*len, *other, *one);
            }
        }
        made.all
    }

    /// Texts in the program that occur in none of `messages`: words of its language.
    pub(super) fn words<'a>(&'a self, messages: &[&[u8]]) -> impl Iterator<Item = &'a [u8]> {
        let sides = match &self.sides {
            Sides::Texts(sides) => sides.as_slice(),
            _ => &[],
        };
        let is_told = |side: &[u8]| messages.iter().any(|told| !found(told, side).is_empty());
        let is_new = move |side: &&[u8]| !side.is_empty() && !is_told(side);
        sides.iter().map(Vec::as_slice).filter(is_new)
    }
}

/// The first positions of `part` in `message`.
fn found(message: &[u8], part: &[u8]) -> Vec<usize> {
    if part.is_empty() {
        return Vec::new();
    }
    let windows = message.windows(part.len()).enumerate();
    let places = windows.filter(|(_, window)| *window == part);
    places.map(|(at, _)| at).take(PLACES_MAX).collect()
}

/// Variants of one message.
struct Made<'a> {
    message: &'a [u8],
    all: Vec<Vec<u8>>,
    known: BTreeSet<Vec<u8>>,
}

impl<'a> Made<'a> {
    fn new(message: &'a [u8]) -> Self {
        let known = BTreeSet::from([message.to_vec()]);
        let all = Vec::new();
        Self {
            message,
            all,
            known,
        }
    }

    fn put(&mut self, range: core::ops::Range<usize>, bytes: &[u8]) {
        let mut new = self.message.to_vec();
        new.splice(range, bytes.iter().copied());
        if self.all.len() < MADE_MAX && self.known.insert(new.clone()) {
            self.all.push(new);
        }
    }

    fn replace(&mut self, from: &[u8], to: &[u8]) {
        for at in found(self.message, from) {
            self.put(at..at + from.len(), to);
        }
    }

    /// Replaces `from` with `to` and its neighbours, because the program may test for less or
    /// greater.
    fn number(&mut self, len: usize, from: u64, to: u64) {
        for to in [to, to.wrapping_add(1), to.wrapping_sub(1)] {
            self.digits(len, from, to);
            // Compilers widen narrow numbers before they compare them.
            for width in [1, 2, 4, 8].into_iter().filter(|width| *width <= len) {
                if !fits(from, len, width) || !fits(to, len, width) {
                    continue;
                }
                let [mut from, mut to] = [from, to].map(|number| number.to_le_bytes());
                self.replace(&from[..width], &to[..width]);
                if width > 1 {
                    from[..width].reverse();
                    to[..width].reverse();
                    self.replace(&from[..width], &to[..width]);
                } else if from[0].is_ascii_alphabetic() {
                    self.replace(&[from[0] ^ 0x20], &to[..1]);
                }
            }
        }
    }

    fn digits(&mut self, len: usize, from: u64, to: u64) {
        let [signed, new] = [from, to].map(|number| signed(number, len));
        for range in runs(self.message, |byte| byte.is_ascii_digit() || byte == b'-') {
            let text = str::from_utf8(&self.message[range.clone()]).unwrap_or_default();
            if text.parse::<i64>().is_ok_and(|number| number == signed) {
                self.put(range, new.to_string().as_bytes());
            } else if text.parse::<u64>().is_ok_and(|number| number == from) {
                self.put(range, to.to_string().as_bytes());
            }
        }
        for range in runs(self.message, |byte| byte.is_ascii_hexdigit()) {
            let text = str::from_utf8(&self.message[range.clone()]).unwrap_or_default();
            if u64::from_str_radix(text, 16).is_ok_and(|number| number == from) {
                let digits = format!("{:01$X}", to & mask(len), text.len());
                self.put(range, digits.as_bytes());
            }
        }
    }

    fn floating(&mut self, len: usize, from: f64, to: f64) {
        for to in [to, to + 1.0, to - 1.0] {
            for range in runs(self.message, |byte| {
                byte.is_ascii_digit() || b"-.".contains(&byte)
            }) {
                let text = str::from_utf8(&self.message[range.clone()]).unwrap_or_default();
                if text.parse::<f64>().is_ok_and(|number| number == from) {
                    self.put(range, to.to_string().as_bytes());
                }
            }
            let [mut from, mut to] = [from, to].map(|number| bytes_of(number, len));
            self.replace(&from, &to);
            from.reverse();
            to.reverse();
            self.replace(&from, &to);
        }
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "it was of single precision"
)]
fn bytes_of(number: f64, len: usize) -> Vec<u8> {
    match len {
        4 => (number as f32).to_le_bytes().to_vec(),
        _ => number.to_le_bytes().to_vec(),
    }
}

const fn mask(len: usize) -> u64 {
    if len < 8 {
        (1 << (8 * len)) - 1
    } else {
        u64::MAX
    }
}

/// The signed value of a number of `len` bytes.
const fn signed(number: u64, len: usize) -> i64 {
    let unused = 64 - 8 * len;
    (number.cast_signed() << unused) >> unused
}

/// Whether a number of `len` bytes fits `width` bytes, signed or unsigned.
fn fits(number: u64, len: usize, width: usize) -> bool {
    let number = number & mask(len);
    number <= mask(width) || signed(number, len) == signed(number, width)
}

/// Ranges of consecutive bytes of one kind.
fn runs(message: &[u8], is: impl Fn(u8) -> bool) -> Vec<core::ops::Range<usize>> {
    let (mut all, mut start) = (Vec::new(), 0);
    for stretch in message.split_inclusive(|byte| !is(*byte)) {
        let len = stretch.iter().filter(|byte| is(**byte)).count();
        if len > 0 {
            all.push(start..start + len);
        }
        start += stretch.len();
    }
    all.truncate(PLACES_MAX);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(len: usize, sides: [u64; 2]) -> Comparison {
        let sides = Sides::Numbers(len, sides);
        Comparison { place: 1, sides }
    }

    fn has(comparison: &Comparison, message: &[u8], expected: &[u8]) -> bool {
        comparison
            .instead(message)
            .iter()
            .any(|made| made == expected)
    }

    /// 300 is 01 2C; it is compared as four bytes with 513, 02 01. The neighbours of 513 are tried
    /// too.
    #[test]
    fn a_number_is_found_in_either_order_of_its_bytes_and_in_digits() {
        let compared = numbers(4, [300, 513]);
        assert!(has(&compared, b"a\x01\x2Cb", b"a\x02\x01b"));
        assert!(has(&compared, b"a\x2C\x01b", b"a\x01\x02b"));
        assert!(has(&compared, b"a\x01\x2Cb", b"a\x02\x02b"));
        assert!(has(&compared, b"v=300\r\n", b"v=513\r\n"));
        assert!(has(&compared, b"v=300\r\n", b"v=514\r\n"));
        assert!(has(&compared, b"v 012C", b"v 0201"));
        assert!(has(&compared, b"\x02\x01", b"\x01\x2C"));
        assert!(compared.instead(b"nothing of it").is_empty());
    }

    /// FFFFFFFF is -1 in four bytes.
    #[test]
    fn a_number_below_nought_is_one() {
        let compared = numbers(4, [0xFFFF_FFFF, 5]);
        assert!(has(&compared, b"v=-1;", b"v=5;"));
        assert!(has(&compared, b"\xFF", b"\x05"));
        assert!(has(&numbers(4, [7, 0xFFFF_FF9C]), b"v=7;", b"v=-100;"));
    }

    #[test]
    fn a_text_takes_the_place_of_another_and_is_a_word() {
        let sides = Sides::Texts([b"ping".to_vec(), b"selftest".to_vec()]);
        let compared = Comparison { place: 1, sides };
        assert_eq!(compared.instead(b"ping 1\n"), [b"selftest 1\n".to_vec()]);
        let words: Vec<&[u8]> = compared.words(&[b"ping 1\n"]).collect();
        assert_eq!(words, [b"selftest"]);
    }

    /// 2.5 is 40200000 in single precision, 8.0 is 41000000.
    #[test]
    fn a_floating_number_is_found_in_its_bytes_and_in_digits() {
        let sides = Sides::Floating(4, [2.5, 8.0]);
        let compared = Comparison { place: 1, sides };
        assert!(has(&compared, b"x2.5\n", b"x8\n"));
        assert!(has(&compared, b"a\x00\x00\x20\x40", b"a\x00\x00\x00\x41"));
    }

    /// An entry as the runtime writes it: location 7, two bytes, 1 and 2; then entries with invalid
    /// lengths.
    #[test]
    fn what_a_program_wrote_is_read_and_never_believed() {
        let mut pair = [0; PAIR];
        (pair[0], pair[4], pair[5], pair[6]) = (7, 2, 8, 8);
        (pair[8], pair[8 + SIDE]) = (1, 2);
        let expected = Comparison {
            place: 7,
            sides: Sides::Numbers(2, [1, 2]),
        };
        assert_eq!(Comparison::read(&pair), Some(expected));
        pair[5] = 200;
        assert_eq!(Comparison::read(&pair), None);
        assert_eq!(Comparison::read(&pair[..20]), None);
        for kind in 0..=255 {
            let mut wild = [0xFF; PAIR];
            (wild[4], wild[5], wild[6]) = (kind, 32, 32);
            let read = Comparison::read(&wild).expect("any kind is one");
            assert!(read.instead(&[0xFF; 40]).len() <= MADE_MAX);
        }
    }
}
