//! Base of the numbers in a text.

use super::literal::is_literal;

/// Number format of a text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::import) enum Base {
    /// Pairs of hex digits.
    #[default]
    Hex,
    /// Hex without leading zeros, as from Arduino's `print(x, HEX)`.
    Loose,
    /// Decimal numbers, perhaps with a sign, as Python, Rust and Java print lists of bytes.
    Decimal,
    /// Three octal digits each.
    Octal,
    /// Eight binary digits each.
    Binary,
    /// Literals of bytes, of which some are not digits.
    Text,
}

/// Text around the numbers of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::import) enum Around {
    /// Nothing: a dump may have written them.
    Nothing,
    /// Times, directions or other columns, as logs and tables have; they have no octal numbers.
    Marks,
}

/// Counts of number forms in a text.
#[derive(Default)]
struct Shape {
    all: usize,
    /// Numbers of one, two and three digits.
    lens: [usize; 3],
    longer: usize,
    /// Numbers with a letter.
    letters: usize,
    /// Numbers of two digits, the first of which is 0.
    padded: usize,
    /// Numbers of three digits, the first of which is 0.
    zeros: usize,
    negative: usize,
    /// Numbers of three digits that are octal, and numbers up to 255 in decimal.
    octal: usize,
    decimal: usize,
    /// Numbers of six octal digits, as od writes words.
    words: usize,
    /// Numbers of eight binary digits.
    binary: usize,
    is_marked: bool,
    is_last_short: bool,
}

/// The base of all numbers in `bodies`.
///
/// # Errors
/// If two bases are possible.
pub(in crate::import) fn of<'a>(
    bodies: impl Iterator<Item = &'a str>,
    around: Around,
) -> Result<Base, String> {
    let mut shape = Shape::default();
    let (mut is_list, mut is_text, mut is_quoted) = (false, false, false);
    for body in bodies {
        let body = body.trim();
        // Escapes and quoted text have no base.
        is_text |= body.contains('\\') || is_literal(body);
        is_quoted |= body.contains(['\\', '"', '\'']);
        is_list |= body.starts_with('[');
        shape.take(body);
    }
    match (is_text, is_quoted) {
        (true, _) => Ok(Base::Text),
        (_, true) => Ok(Base::Hex),
        _ => shape.base(is_list, around),
    }
}

impl Shape {
    fn take(&mut self, body: &str) {
        let is_divider = |c: char| c.is_whitespace() || ",;:|{}[]()_".contains(c);
        for token in body.split(is_divider).filter(|token| !token.is_empty()) {
            let is_negative =
                token.starts_with('-') && token[1..].bytes().all(|b| b.is_ascii_digit());
            if is_negative && (2..=4).contains(&token.len()) {
                (self.negative, self.all) = (self.negative + 1, self.all + 1);
                continue;
            }
            let parts = token.split('-').filter(|part| !part.is_empty());
            parts.for_each(|part| self.number(part));
        }
    }

    fn number(&mut self, token: &str) {
        let is_hex = token.bytes().all(|byte| byte.is_ascii_hexdigit());
        let has_letter = token.bytes().any(|byte| byte.is_ascii_alphabetic());
        self.is_marked |= !is_hex && has_letter;
        self.all += 1;
        self.letters += usize::from(is_hex && has_letter);
        match token.len() {
            len @ 1..=3 => self.lens[len - 1] += 1,
            _ => self.longer += 1,
        }
        let is_octal = token.bytes().all(|byte| matches!(byte, b'0'..=b'7'));
        self.padded += usize::from(token.len() == 2 && token.starts_with('0'));
        if token.len() == 3 {
            self.zeros += usize::from(token.starts_with('0'));
            self.octal += usize::from(is_octal && token <= "377");
            self.decimal += usize::from(token.parse::<u8>().is_ok());
        }
        let is_word = token.len() == 6 && is_octal && token <= "177777";
        self.words += usize::from(is_word);
        let is_binary = token.len() == 8 && token.bytes().all(|byte| matches!(byte, b'0' | b'1'));
        self.binary += usize::from(is_binary);
        self.is_last_short = token.len() == 1;
    }

    fn base(&self, is_list: bool, around: Around) -> Result<Base, String> {
        let [ones, twos, threes] = self.lens;
        if self.is_marked || self.all == 0 {
            return Ok(Base::Hex);
        }
        // The last number of a cut text may lack digits.
        let whole_ones = ones - usize::from(self.is_last_short).min(ones);
        if self.letters > 0 {
            let is_loose =
                whole_ones > 0 && self.padded == 0 && ones + twos == self.all && self.negative == 0;
            return Ok(if is_loose { Base::Loose } else { Base::Hex });
        }
        if self.binary == self.all && self.all > 1 {
            return Ok(Base::Binary);
        }
        let is_padded = threes == self.all && self.zeros > 0;
        let are_bytes = self.decimal == threes && self.longer == 0 && self.padded == 0;
        let is_decimal =
            are_bytes && (is_padded || self.zeros == 0) && (threes > 0 || self.negative > 0);
        let is_octal = is_padded && self.octal == threes;
        match (is_octal, is_decimal) {
            (true, true) if is_list || around == Around::Marks => return Ok(Base::Decimal),
            (true, true) => {
                return Err(
                    "numbers of three digits, which may be decimal or octal: write them as \
                     0x0A, or as [010, 005] if they are decimal"
                        .to_owned(),
                );
            }
            (true, false) => return Ok(Base::Octal),
            (false, true) => return Ok(Base::Decimal),
            (false, false) => {}
        }
        if self.words == self.all && self.all >= 4 {
            return Err(
                "groups of six octal digits: words of od without offsets; dump with od \
                        -t x1, or with the offsets"
                    .to_owned(),
            );
        }
        let is_short = ones + twos == self.all && self.padded == 0;
        match (is_short, is_list) {
            (true, true) => Ok(Base::Decimal),
            (true, false) if whole_ones > 0 => Err(
                "numbers of one and two digits, none with a letter: they may be decimal or hex; \
                 write them as 0x0A, or as [10, 5] if they are decimal"
                    .to_owned(),
            ),
            _ => Ok(Base::Hex),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn base(text: &str) -> Option<Base> {
        of(text.lines(), Around::Nothing).ok()
    }

    #[test]
    fn the_base_is_told_by_all_numbers() {
        for (text, expected) in [
            ("AB 24 0A 00 D9", Some(Base::Hex)),
            ("ab240a00d9", Some(Base::Hex)),
            ("AB-24-0A", Some(Base::Hex)),
            ("01 03 00 10", Some(Base::Hex)),
            ("0x1 0x3", Some(Base::Hex)),
            ("AB 24 A 0 D9", Some(Base::Loose)),
            ("AB 24 0A 00 D", Some(Base::Hex)),
            ("AB 2", Some(Base::Hex)),
            ("[171, 36, 10, 0, 217]", Some(Base::Decimal)),
            ("171 36 10 0 217", Some(Base::Decimal)),
            ("[-85, 36, 10, 0, -39]", Some(Base::Decimal)),
            ("[1, 3, 0, 0, 0, 2]", Some(Base::Decimal)),
            ("[10, 20, 30]", Some(Base::Decimal)),
            ("253 044 012 000 331", Some(Base::Octal)),
            ("001 003 196 011", Some(Base::Decimal)),
            ("001 003 000 009", Some(Base::Decimal)),
            ("[001, 003, 000, 255]", Some(Base::Decimal)),
            ("001 003 000 255", None),
            ("00000001 00000011 11111111", Some(Base::Binary)),
            ("00000001 00000012", Some(Base::Hex)),
            ("1 3 0 10", None),
            ("022253 000012 125731 020044", None),
        ] {
            assert_eq!(base(text), expected, "{text}");
        }
        let of_log = |text: &str| of(text.lines(), Around::Marks).ok();
        assert_eq!(of_log("001 003 000 255"), Some(Base::Decimal));
        assert_eq!(of_log("001 003 000 377"), Some(Base::Octal));
    }

    /// Texts on both sides of each condition.
    #[test]
    fn each_condition_of_a_base_has_two_sides() {
        for (text, expected) in [
            // A sign makes numbers of up to three digits decimal; "-" alone is no number.
            ("-5 3", Some(Base::Decimal)),
            ("-128 3", Some(Base::Decimal)),
            ("-1000 3", Some(Base::Hex)),
            ("- 10", Some(Base::Hex)),
            // No decimal number of a byte has a zero before two digits, four digits or 256.
            ("171 36 5", Some(Base::Decimal)),
            ("171 36 05", Some(Base::Hex)),
            ("171 1234", Some(Base::Hex)),
            ("255 1", Some(Base::Decimal)),
            ("256 1", Some(Base::Hex)),
            ("012 1", Some(Base::Hex)),
            ("253 044 378", Some(Base::Hex)),
            ("001 377", Some(Base::Octal)),
            ("001 400", Some(Base::Hex)),
            // Four words of od, up to 0o177777.
            ("022253 000012 125731", Some(Base::Hex)),
            ("177777 000012 125731 020044", None),
            ("200000 000012 125731 020044", Some(Base::Hex)),
            ("022258 000012 125731 020044", Some(Base::Hex)),
            ("00000001", Some(Base::Hex)),
            ("00000001 1", Some(Base::Hex)),
            // A letter, and a number of one digit that is not the last one.
            ("1 2 A 10", Some(Base::Loose)),
            ("A 10 5", Some(Base::Loose)),
            ("A", Some(Base::Hex)),
            ("AB 1 -5", Some(Base::Hex)),
            ("AB 1 123 4", Some(Base::Hex)),
            ("AB 1 05", Some(Base::Hex)),
            ("10 20 30", Some(Base::Hex)),
            ("10 20 3", Some(Base::Hex)),
            ("10 3 20", None),
            ("[10 05]", Some(Base::Hex)),
            ("[10 123 G1]", Some(Base::Hex)),
            ("", Some(Base::Hex)),
            ("[]", Some(Base::Hex)),
            ("\"1 3 0 10\"", Some(Base::Hex)),
            ("\\x01", Some(Base::Text)),
        ] {
            assert_eq!(base(text), expected, "{text}");
        }
    }

    /// Numbers of one to three digits, and longer ones; those with a letter, with a leading zero,
    /// or with a sign; and those that can be octal, decimal, a word of od or binary.
    #[test]
    fn the_forms_of_numbers_are_counted() {
        let mut shape = Shape::default();
        shape.take("1 A 02 10 012 400 256 -12 1234 000017 00000110-7");
        assert_eq!((shape.all, shape.lens, shape.longer), (12, [3, 2, 3], 3));
        assert_eq!((shape.letters, shape.padded, shape.zeros), (1, 1, 1));
        // 012 and 256 are octal, 012 alone is a byte in decimal.
        assert_eq!((shape.negative, shape.octal, shape.decimal), (1, 2, 1));
        assert_eq!((shape.words, shape.binary), (1, 1));
        assert!(shape.is_last_short && !shape.is_marked);
        shape.take("0x10");
        assert!(!shape.is_last_short && shape.is_marked);
        assert_eq!((shape.all, shape.letters, shape.longer), (13, 1, 4));
    }
}
