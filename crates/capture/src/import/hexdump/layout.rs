//! Layouts of the offsets and cells of a dump.

use engine::hex;

/// One layout of a tool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    /// Number base of the offsets.
    radix: u32,
    cell: Cell,
}

/// Kind of the cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cell {
    /// Bytes in order, two hex digits each, in groups of any size.
    Pairs,
    /// A number with this number of digits in this radix, the low byte first.
    Word {
        radix: u32,
        digits: usize,
        bytes: usize,
    },
    /// A byte as a decimal number, perhaps with a sign.
    Decimal,
    /// A byte as eight binary digits.
    Bits,
    /// A byte as a character, an escape or three octal digits, in a field of four columns.
    Char,
}

/// Properties of all rows together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Whether a colon follows the offset: xxd, whose groups are bytes in order.
    pub(super) has_colon: bool,
}

const fn word(radix: u32, digits: usize, bytes: usize) -> Cell {
    Cell::Word {
        radix,
        digits,
        bytes,
    }
}

/// All kinds of cells, the most common first.
const CELLS: [Cell; 11] = [
    Cell::Pairs,
    word(16, 4, 2),
    word(8, 6, 2),
    word(8, 3, 1),
    word(16, 8, 4),
    word(16, 16, 8),
    word(10, 5, 2),
    word(8, 11, 4),
    Cell::Bits,
    Cell::Char,
    Cell::Decimal,
];

/// All layouts of a dump with this number of digits in its offsets, in groups with one kind of
/// cell, the most common first. od has seven digits, octal by default. hexdump without -C also has
/// seven, but in hex.
pub(super) fn layouts(digits: usize) -> impl Iterator<Item = [Layout; 3]> {
    let radixes = if digits == 7 {
        [8, 10, 16]
    } else {
        // Octal offsets have seven digits.
        [16, 10, 16]
    };
    let of = move |cell| radixes.map(|radix| Layout { radix, cell });
    CELLS.into_iter().map(of)
}

impl Layout {
    pub(super) fn offset(self, text: &str) -> Option<usize> {
        let digits = text.strip_suffix(':').unwrap_or(text);
        usize::from_str_radix(digits, self.radix).ok()
    }

    pub(super) const fn offset_name(self) -> &'static str {
        match self.radix {
            16 => "hex digits",
            8 => "octal digits",
            _ => "decimal digits",
        }
    }

    /// Whether hexdump writes such cells, with hex offsets of seven digits.
    pub(super) const fn is_of_hexdump(self) -> bool {
        match self.cell {
            Cell::Word { digits, .. } => digits <= 6,
            Cell::Char => true,
            _ => false,
        }
    }

    /// Whether offsets are hex.
    pub(super) const fn has_hex_offsets(self) -> bool {
        self.radix == 16
    }

    /// Whether cells hold the later byte first.
    pub(super) const fn is_swapped(self) -> bool {
        matches!(self.cell, Cell::Word { bytes, .. } if bytes > 1)
    }

    /// Decodes the bytes of a row; `len` of them, if the next offset determines the number.
    pub(super) fn row(
        self,
        rest: &str,
        len: Option<usize>,
        shape: Shape,
    ) -> Result<Vec<u8>, String> {
        if self.cell == Cell::Char {
            return characters(rest, len);
        }
        let mut best: Option<Vec<u8>> = None;
        let (mut bytes, mut end) = (Vec::new(), 0);
        loop {
            let behind = &rest[end..];
            // Only a text column with the same bytes proves words after a colon, or groups without
            // one.
            let is_long_enough = len.is_none_or(|len| bytes.len() >= len);
            if !bytes.is_empty() && is_long_enough {
                let mut cut = bytes.clone();
                let padding = cut.split_off(len.unwrap_or(cut.len()).min(cut.len()));
                let is_whole = padding.iter().all(|&byte| byte == 0);
                let is_proved = shown_beside(behind, &cut);
                let needs_proof = !behind.trim().is_empty() || self.needs_proof(rest, shape);
                if is_whole && is_proved {
                    return Ok(cut);
                }
                if is_whole && !needs_proof {
                    best = Some(cut);
                }
                if len.is_some() {
                    break;
                }
            }
            let Some((token, after)) = next_token(rest, end) else {
                break;
            };
            let Some(cell) = self.cell(token, shape) else {
                break;
            };
            bytes.extend(cell);
            end = after;
        }
        best.ok_or_else(|| match len {
            Some(len) => format!(
                "expected {len} bytes up to the next offset, and the same as text if there is text"
            ),
            None => "expected bytes, and the same as text if there is text".to_owned(),
        })
    }

    /// The bytes of a damaged row up to the damage, at most `most`.
    pub(super) fn rest_of(self, rest: &str, most: usize, shape: Shape) -> Vec<u8> {
        // Text is farther away from the last cell than the cells from each other.
        let blanks_max = if self.cell == Cell::Pairs { 2 } else { 8 };
        let (mut bytes, mut end) = (Vec::new(), 0);
        while let Some((token, after)) = next_token(rest, end) {
            let blanks = after - token.len() - end;
            let is_text = !bytes.is_empty() && blanks > blanks_max;
            let Some(cell) = self.cell(token, shape).filter(|_| !is_text) else {
                break;
            };
            bytes.extend(cell);
            end = after;
            if bytes.len() >= most {
                break;
            }
        }
        bytes.truncate(most);
        bytes
    }

    /// Whether the cells alone do not determine the order of their bytes.
    fn needs_proof(self, rest: &str, shape: Shape) -> bool {
        let token = next_token(rest, 0).map_or("", |(token, _)| token);
        match self.cell {
            Cell::Pairs => token.len() > 2 && !token.starts_with("0x") && !shape.has_colon,
            Cell::Word { bytes, .. } => bytes > 1 && shape.has_colon,
            _ => false,
        }
    }

    fn cell(self, token: &str, shape: Shape) -> Option<Vec<u8>> {
        match self.cell {
            // gdb prefixes each byte.
            Cell::Pairs => match token.strip_prefix("0x") {
                Some(digits) => hex::byte(digits.as_bytes()).map(|byte| vec![byte]),
                None => hex::bytes(token),
            },
            Cell::Word {
                radix,
                digits,
                bytes,
            } => {
                // xxd writes the last word at its actual length.
                let is_rest = shape.has_colon && radix == 16 && token.len().is_multiple_of(2);
                let is_cell = token.len() == digits || (is_rest && token.len() < digits);
                let number = u64::from_str_radix(token, radix).ok();
                let number = number.filter(|_| is_cell && !token.starts_with('+'))?;
                let all = number.to_le_bytes();
                let count = if is_rest { token.len() / 2 } else { bytes };
                let (used, unused) = all.split_at(count);
                unused.iter().all(|&byte| byte == 0).then(|| used.to_vec())
            }
            Cell::Decimal => {
                let number: i16 = token.parse().ok().filter(|_| !token.starts_with('+'))?;
                let byte = u8::try_from(number).ok();
                let byte = byte.or_else(|| Some(i8::try_from(number).ok()?.cast_unsigned()));
                byte.map(|byte| vec![byte])
            }
            Cell::Bits => {
                let byte = u8::from_str_radix(token, 2).ok();
                byte.filter(|_| token.len() == 8).map(|byte| vec![byte])
            }
            Cell::Char => None,
        }
    }
}

/// Whether a line has the bytes of a row in any other form.
pub(super) fn same(text: &str, bytes: &[u8], shape: Shape) -> bool {
    CELLS.into_iter().any(|cell| {
        let layout = Layout { radix: 16, cell };
        layout
            .row(text, Some(bytes.len()), shape)
            .is_ok_and(|found| found == bytes)
    })
}

/// The next word after `from`, and its end.
fn next_token(text: &str, from: usize) -> Option<(&str, usize)> {
    let rest = &text[from..];
    let start = from + rest.len() - rest.trim_start().len();
    let len = text[start..]
        .find([' ', '\t'])
        .unwrap_or(text.len() - start);
    (len > 0).then(|| (&text[start..start + len], start + len))
}

/// Whether the text after the cells shows the same bytes, one character each. The text is in bars
/// or brackets, or after spaces. Trailing spaces of a line may be lost.
fn shown_beside(behind: &str, bytes: &[u8]) -> bool {
    let text = behind.trim_end();
    if text.is_empty() {
        return false;
    }
    for (open, close) in [('|', '|'), ('>', '<')] {
        let inside = text.trim_start().strip_prefix(open);
        if let Some(inside) = inside.and_then(|inside| inside.strip_suffix(close))
            && shows(inside, bytes)
        {
            return true;
        }
    }
    let visible = text.trim_start().chars();
    let count = visible.clone().count();
    // Wireshark separates the text of a conversation after eight characters.
    if bytes.len() > 8 && count == bytes.len() + 1 {
        let undivided = visible.enumerate().filter(|(at, _)| *at != 8);
        if undivided
            .zip(bytes)
            .all(|((_, c), byte)| shows_byte(c, *byte))
        {
            return true;
        }
    }
    // Further cells are longer than a text of these bytes.
    if count > bytes.len() {
        return false;
    }
    let all: Vec<char> = behind.chars().collect();
    let blanks = all.iter().take_while(|c| c.is_whitespace()).count();
    // The first bytes may be blanks.
    (1..=blanks).any(|skip| {
        let end = skip + bytes.len();
        let shown = (skip..end).map(|at| all.get(at).copied().unwrap_or(' '));
        let mut pairs = shown.zip(bytes);
        end >= blanks + count && pairs.all(|(c, byte)| shows_byte(c, *byte))
    })
}

fn shows(shown: &str, bytes: &[u8]) -> bool {
    let mut pairs = shown.chars().zip(bytes);
    shown.chars().count() == bytes.len() && pairs.all(|(c, byte)| shows_byte(c, *byte))
}

/// Whether a tool shows a byte as this character.
fn shows_byte(c: char, byte: u8) -> bool {
    match byte {
        b' '..=b'~' => c == char::from(byte),
        _ => c == '.' || !c.is_ascii_alphanumeric(),
    }
}

/// Decodes `  \0   A 377`: each character in four columns. Trailing spaces of a line may be lost.
fn characters(rest: &str, len: Option<usize>) -> Result<Vec<u8>, String> {
    let expected = || "expected characters in fields of four, as od -c writes".to_owned();
    let rest = rest.trim_end();
    let mut bytes = Vec::new();
    for field in rest.as_bytes().chunks(4) {
        let text = core::str::from_utf8(field).map_err(|_| expected())?;
        let byte = match text.trim() {
            "" => b' ',
            "\\0" => 0,
            "\\a" => 7,
            "\\b" => 8,
            "\\t" => b'\t',
            "\\n" => b'\n',
            "\\v" => 11,
            "\\f" => 12,
            "\\r" => b'\r',
            "\\\\" => b'\\',
            digits if digits.len() == 3 => {
                let byte = u8::from_str_radix(digits, 8).ok();
                byte.ok_or_else(expected)?
            }
            one if one.len() == 1 => one.as_bytes()[0],
            _ => return Err(expected()),
        };
        bytes.push(byte);
    }
    if let Some(len) = len {
        if bytes.len() > len {
            return Err(expected());
        }
        bytes.resize(len, b' ');
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Shape = Shape { has_colon: false };
    const COLON: Shape = Shape { has_colon: true };

    const fn of(cell: Cell) -> Layout {
        Layout { radix: 16, cell }
    }

    /// od writes seven octal digits by default, decimal ones with `-A d`; hexdump writes seven hex
    /// digits. Offsets of another length are never octal.
    #[test]
    fn offsets_of_seven_digits_may_be_octal() {
        let offsets = |digits, text: &str| {
            let group = layouts(digits).next().expect("pairs come first");
            group.map(|layout| layout.offset(text))
        };
        assert_eq!(
            offsets(7, "0000040"),
            [Some(0o40), Some(40), Some(0x40)],
            "seven"
        );
        assert_eq!(offsets(8, "00000040:"), [Some(0x40), Some(40), Some(0x40)]);
        assert_eq!(offsets(7, "0000008"), [None, Some(8), Some(8)]);
        assert_eq!(offsets(8, "zz"), [None; 3]);
        let group = layouts(7).next().expect("pairs");
        let names = group.map(Layout::offset_name);
        assert_eq!(names, ["octal digits", "decimal digits", "hex digits"]);
        assert_eq!(group.map(Layout::has_hex_offsets), [false, false, true]);
    }

    /// hexdump has words of two bytes in hex, octal and decimal, octal bytes and characters. A cell
    /// of one byte has no order.
    #[test]
    fn cells_of_hexdump_are_words_of_two_bytes_and_characters() {
        for (cell, is_of_hexdump, is_swapped) in [
            (Cell::Pairs, false, false),
            (word(16, 4, 2), true, true),
            (word(8, 6, 2), true, true),
            (word(8, 3, 1), true, false),
            (word(16, 8, 4), false, true),
            (word(10, 5, 2), true, true),
            (Cell::Bits, false, false),
            (Cell::Char, true, false),
            (Cell::Decimal, false, false),
        ] {
            let own = of(cell);
            assert_eq!(
                (own.is_of_hexdump(), own.is_swapped()),
                (is_of_hexdump, is_swapped),
                "{cell:?}"
            );
        }
    }

    /// Each kind of cell with a sound value, and the values that it cannot have.
    #[test]
    fn a_cell_has_the_form_of_its_tool() {
        for (cell, shape, token, expected) in [
            (Cell::Pairs, PLAIN, "ab24", Some(&[0xAB, 0x24][..])),
            (Cell::Pairs, PLAIN, "0xab", Some(&[0xAB])),
            (Cell::Pairs, PLAIN, "0xab24", None),
            (Cell::Pairs, PLAIN, "abc", None),
            (word(16, 4, 2), PLAIN, "24ab", Some(&[0xAB, 0x24])),
            (word(16, 4, 2), PLAIN, "24", None),
            (word(16, 4, 2), PLAIN, "+4ab", None),
            (word(16, 4, 2), PLAIN, "024ab", None),
            // The last word of xxd -e is shorter; hex alone, and whole bytes.
            (word(16, 8, 4), COLON, "24ab", Some(&[0xAB, 0x24])),
            (
                word(16, 8, 4),
                COLON,
                "000a24ab",
                Some(&[0xAB, 0x24, 0x0A, 0]),
            ),
            (word(16, 8, 4), COLON, "4ab", None),
            (word(16, 8, 4), COLON, "00000a24ab", None),
            (word(16, 8, 4), PLAIN, "24ab", None),
            (word(8, 6, 2), COLON, "2253", None),
            // 0o022253 is 0x24AB; 0o777777 has more than 16 bits, as 65,536 has.
            (word(8, 6, 2), PLAIN, "022253", Some(&[0xAB, 0x24])),
            (word(8, 6, 2), PLAIN, "777777", None),
            (word(10, 5, 2), PLAIN, "65535", Some(&[0xFF, 0xFF])),
            (word(10, 5, 2), PLAIN, "65536", None),
            (word(8, 3, 1), PLAIN, "377", Some(&[0xFF])),
            (word(8, 3, 1), PLAIN, "400", None),
            (Cell::Decimal, PLAIN, "255", Some(&[0xFF])),
            (Cell::Decimal, PLAIN, "-1", Some(&[0xFF])),
            (Cell::Decimal, PLAIN, "-128", Some(&[0x80])),
            (Cell::Decimal, PLAIN, "-129", None),
            (Cell::Decimal, PLAIN, "256", None),
            (Cell::Decimal, PLAIN, "+1", None),
            (Cell::Bits, PLAIN, "01000001", Some(&[0x41])),
            (Cell::Bits, PLAIN, "1000001", None),
            (Cell::Bits, PLAIN, "010000012", None),
            (Cell::Char, PLAIN, "a", None),
        ] {
            let found = of(cell).cell(token, shape);
            assert_eq!(found.as_deref(), expected, "{cell:?} {token}");
        }
    }

    /// Groups without a colon and words with one need a text beside them. Pairs, gdb's bytes and
    /// cells of one byte do not.
    #[test]
    fn cells_that_tell_no_order_need_a_proof() {
        for (cell, shape, rest, expected) in [
            (Cell::Pairs, PLAIN, " ab24 0a00", true),
            (Cell::Pairs, PLAIN, " ab 24", false),
            (Cell::Pairs, PLAIN, "\t0xab\t0x24", false),
            (Cell::Pairs, COLON, " ab24 0a00", false),
            (Cell::Pairs, PLAIN, "", false),
            (word(16, 4, 2), COLON, " 24ab", true),
            (word(16, 4, 2), PLAIN, " 24ab", false),
            (word(8, 3, 1), COLON, " 253", false),
            (Cell::Bits, COLON, " 01000001", false),
        ] {
            assert_eq!(of(cell).needs_proof(rest, shape), expected, "{rest}");
        }
    }

    /// The next offset determines the number of bytes. More cells are no row, except zeros that pad
    /// a word; words behind the cells are wrong if they are not their text.
    #[test]
    fn a_row_has_the_bytes_up_to_the_next_offset() {
        let pairs = |rest: &str, len| of(Cell::Pairs).row(rest, len, PLAIN).ok();
        assert_eq!(pairs(" 41 42", Some(2)), Some(b"AB".to_vec()));
        assert_eq!(pairs(" 41 42", None), Some(b"AB".to_vec()));
        assert_eq!(pairs(" 41 42", Some(3)), None);
        assert_eq!(pairs(" 41 42", Some(1)), None);
        assert_eq!(pairs(" 41 42  |AB|", Some(2)), Some(b"AB".to_vec()));
        assert_eq!(pairs(" 41 42  |AC|", Some(2)), None);
        assert_eq!(pairs(" 41 42  |AB|", None), Some(b"AB".to_vec()));
        assert_eq!(pairs(" 41 42  |AC|", None), None);
        assert_eq!(pairs("", None), None);
        let words = |rest: &str, len| of(word(16, 4, 2)).row(rest, len, PLAIN).ok();
        assert_eq!(words(" 4241 0043", Some(3)), Some(b"ABC".to_vec()));
        assert_eq!(words(" 4241 0143", Some(3)), None);
        // Groups of pairs need their text, and their text alone decides where they end.
        assert_eq!(pairs(" 4142", Some(2)), None);
        assert_eq!(pairs(" 4142  AB", Some(2)), Some(b"AB".to_vec()));
        assert_eq!(pairs(" 6162  ab", None), Some(b"ab".to_vec()));
        let error = |len| of(Cell::Pairs).row(" ?", len, PLAIN).expect_err("no cells");
        assert_eq!(
            error(Some(4)),
            "expected 4 bytes up to the next offset, and the same as text if there is text"
        );
        assert_eq!(
            error(None),
            "expected bytes, and the same as text if there is text"
        );
    }

    /// Cells of pairs are at most two blanks apart, other cells at most eight; then comes the text.
    #[test]
    fn a_damaged_row_keeps_its_bytes_up_to_the_damage() {
        let pairs = |rest: &str, most| of(Cell::Pairs).rest_of(rest, most, PLAIN);
        assert_eq!(pairs(" 41 42  43 ? 44", 9), b"ABC");
        assert_eq!(pairs(" 41 42   43", 9), b"AB");
        assert_eq!(pairs("      41 42", 9), b"AB");
        assert_eq!(pairs(" 41 42 43", 2), b"AB");
        assert_eq!(pairs(" 4142 4344", 3), b"ABC");
        assert_eq!(pairs(" 41 42", 0), b"");
        assert_eq!(pairs(" ?? 42", 9), b"");
        let words = |rest: &str| of(word(16, 4, 2)).rest_of(rest, 9, PLAIN);
        assert_eq!(words(" 4241        4443"), b"ABCD");
        assert_eq!(words(" 4241         4443"), b"AB");
    }

    /// A line of od with two -t has the bytes of the row before in any form.
    #[test]
    fn another_form_shows_the_same_bytes() {
        for text in [
            " 41 42", " 4241", " 041102", " 101 102", "  A   B", " 65 66",
        ] {
            assert_eq!(
                same(text, b"AB", PLAIN),
                text != " 041102",
                "0o041102 is 0x4242: {text}"
            );
        }
        assert!(same(" 041101", b"AB", PLAIN) && !same(" 41 43", b"AB", PLAIN));
        assert!(!same(" 41", b"AB", PLAIN) && !same("", b"AB", PLAIN));
    }

    #[test]
    fn a_word_ends_at_a_blank_or_a_tab() {
        assert_eq!(next_token("  ab\tcd", 0), Some(("ab", 4)));
        assert_eq!(next_token("  ab\tcd", 4), Some(("cd", 7)));
        assert_eq!(next_token("  ab\tcd", 7), None);
        assert_eq!(next_token("ab  ", 2), None);
    }

    /// Bars, brackets, or blanks before the text; a blank after eight characters as in Wireshark's
    /// conversations. A text of another length or with another letter is not the same.
    #[test]
    fn the_text_beside_a_row_shows_its_bytes() {
        for (behind, bytes) in [
            ("  |AB|", &b"AB"[..]),
            ("  >AB<", b"AB"),
            ("  AB", b"AB"),
            (" AB", b"AB"),
            ("   A", b"A "),
            ("   A", b" A"),
            ("  a.c", b"a\x01c"),
            ("   ABCDEFGH IJ", b"ABCDEFGHIJ"),
            ("  ABCDEFGH I", b"ABCDEFGHI"),
            // A byte that is no character may be any sign, as in code page 1252.
            ("  \u{ab}B", b"\xABB"),
        ] {
            assert!(shown_beside(behind, bytes), "{behind:?} {bytes:?}");
        }
        for (behind, bytes) in [
            ("", &b"AB"[..]),
            ("    ", b"AB"),
            ("  |AC|", b"AB"),
            ("  |ABC|", b"AB"),
            ("  >AB|", b"AB"),
            ("  AC", b"AB"),
            ("  ABC", b"AB"),
            ("AB", b"AB"),
            ("  aXc", b"a\x01c"),
            ("  ABCDEFG HIJ", b"ABCDEFGHIJ"),
            ("  ABCDEFGH IK", b"ABCDEFGHIJ"),
            ("  ABCDEFGH ", b"ABCDEFG"),
        ] {
            assert!(!shown_beside(behind, bytes), "{behind:?} {bytes:?}");
        }
    }

    /// The escapes of `od -c`: those of C, and three octal digits.
    #[test]
    fn characters_have_fields_of_four() {
        let all = "  \\0  \\a  \\b  \\t  \\n  \\v  \\f  \\r  \\\\   A 377      z";
        let bytes = [0, 7, 8, 9, 10, 11, 12, 13, b'\\', b'A', 0xFF, b' ', b'z'];
        assert_eq!(characters(all, None), Ok(bytes.to_vec()));
        // The blanks at the end of a line may be lost.
        assert_eq!(characters("   A", Some(3)), Ok(b"A  ".to_vec()));
        assert_eq!(characters("   A   B", Some(2)), Ok(b"AB".to_vec()));
        for (text, len) in [
            ("   A   B", Some(1)),
            (" 400", None),
            (" 38a", None),
            ("  ab", None),
            ("  \\x", None),
            (" \u{e9}\u{e9}", None),
        ] {
            assert!(characters(text, len).is_err(), "{text}");
        }
    }
}
