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
