//! The words and numbers that register maps use. Each list is closed: another word is an error, so
//! that none is misread.

/// A word in lower case, with single spaces and without hyphens and underscores.
pub(super) fn plain(text: &str) -> String {
    let text = text.to_lowercase().replace(['_', '-'], " ");
    one_line(&text)
}

/// Text with each run of white space as one space.
pub(super) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The numbers of a list such as 3/6/16 or "FC 03, 06"; `None` if it holds anything else.
fn codes(word: &str) -> Option<Vec<u32>> {
    let parts = word.split(['/', ',', ';', '&', '+', ' ']);
    let parts = parts.filter(|part| !part.is_empty() && *part != "fc");
    let codes = parts.map(|part| match part.strip_prefix("0x") {
        Some(digits) => u32::from_str_radix(digits, 16).ok(),
        None => part.strip_prefix("fc").unwrap_or(part).parse().ok(),
    });
    let codes: Option<Vec<u32>> = codes.collect();
    codes.filter(|codes| !codes.is_empty())
}

/// The index of a table.
pub(super) fn table(text: &str) -> Option<usize> {
    const NAMES: [&[&str]; 4] = [
        &[
            "coil",
            "coils",
            "co",
            "output coil",
            "output coils",
            "digital output",
            "digital outputs",
            "discrete output",
            "discrete outputs",
            "do",
            "read coil",
            "read coils",
            "write coil",
            "write coils",
            "0x",
        ],
        &[
            "discrete",
            "discrete input",
            "discrete inputs",
            "digital input",
            "digital inputs",
            "input contact",
            "contact",
            "contacts",
            "di",
            "read discrete inputs",
            "1x",
        ],
        &[
            "input",
            "inputs",
            "input register",
            "input registers",
            "analog input",
            "analog inputs",
            "ai",
            "ir",
            "read input registers",
            "read only register",
            "read only registers",
            "3x",
        ],
        &[
            "holding",
            "holding register",
            "holding registers",
            "analog output",
            "analog outputs",
            "ao",
            "hr",
            "read holding registers",
            "write holding registers",
            "4x",
        ],
    ];
    let word = plain(text);
    if let Some(table) = NAMES.iter().position(|names| names.contains(&&*word)) {
        return Some(table);
    }
    let of_code = |code: &u32| match code {
        1 | 5 | 15 => Some(0),
        2 => Some(1),
        4 => Some(2),
        3 | 6 | 16 | 22 | 23 => Some(3),
        _ => None,
    };
    let codes = codes(&word)?;
    let table = of_code(codes.first()?)?;
    codes
        .iter()
        .all(|code| of_code(code) == Some(table))
        .then_some(table)
}

/// Whether a register may be written.
pub(super) fn access(text: &str) -> Option<bool> {
    let word = plain(text);
    match &*word {
        "r" | "ro" | "read" | "read only" | "readonly" => return Some(false),
        "rw" | "r/w" | "r w" | "wr" | "w/r" | "w" | "wo" | "write" | "write only" | "writeonly"
        | "read/write" | "read / write" | "read write" | "readwrite" | "r / w" => {
            return Some(true);
        }
        _ => {}
    }
    let codes = codes(&word)?;
    let is_known = codes
        .iter()
        .all(|code| matches!(code, 1..=6 | 15 | 16 | 22 | 23));
    is_known.then(|| codes.iter().any(|code| *code > 4))
}

/// Whether the device offers no read of a register that may be written.
fn is_write_only(text: &str) -> bool {
    let word = plain(text);
    match &*word {
        "w" | "wo" | "write" | "write only" | "writeonly" => true,
        _ => codes(&word)
            .is_some_and(|codes| codes.iter().all(|code| matches!(code, 5 | 6 | 15 | 16))),
    }
}

/// A note about write-only registers, from each line and its access.
pub(super) fn write_only<'a>(
    lines: impl Iterator<Item = (usize, Option<&'a str>)>,
) -> Option<String> {
    let own = lines.filter(|(_, access)| access.is_some_and(is_write_only));
    let own: Vec<_> = own.map(|(line, _)| line.to_string()).collect();
    (!own.is_empty()).then(|| {
        format!(
            "write-only registers: {}, in line {}; the device also answers reads of them, with the \
             value written last (a register of a description cannot refuse reads)",
            own.len(),
            own.join(", ")
        )
    })
}

/// The orders of words and of the bytes in a word; true for little.
pub(super) fn order(text: &str) -> Option<[bool; 2]> {
    Some(match &*plain(text) {
        "abcd"
        | "big"
        | "big endian"
        | "be"
        | "msw"
        | "msw first"
        | "high first"
        | "high word first"
        | "most significant word first"
        | "normal" => [false, false],
        "cdab"
        | "little"
        | "little endian"
        | "le"
        | "lsw"
        | "lsw first"
        | "low first"
        | "low word first"
        | "least significant word first"
        | "swap"
        | "swapped"
        | "word swap" => [true, false],
        "badc" | "byte swap" => [false, true],
        "dcba" => [true, true],
        _ => return None,
    })
}

/// The state of a bit.
pub(super) fn bit(text: &str) -> Option<bool> {
    Some(match &*plain(text) {
        "1" | "1.0" | "0x1" | "0x01" | "0xff00" | "true" | "on" | "yes" | "y" | "active"
        | "enabled" => true,
        "0" | "0.0" | "0x0" | "0x00" | "0x0000" | "false" | "off" | "no" | "n" | "inactive"
        | "disabled" => false,
        _ => return None,
    })
}

/// Whether the title of a column says that its numbers are hexadecimal, as "Address (hex)".
pub(super) fn is_hex_title(title: &str) -> bool {
    let mut words = title.split(|c: char| !c.is_ascii_alphanumeric());
    words.any(|word| ["hex", "hexadecimal", "0x"].contains(&&*word.to_ascii_lowercase()))
}

/// A whole number in hexadecimal digits, with or without a mark.
pub(super) fn hex_number(text: &str) -> Option<f64> {
    let hex = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let digits = hex
        .or_else(|| text.strip_suffix(['h', 'H']))
        .unwrap_or(text);
    let is_plain = digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    let value = u32::from_str_radix(digits, 16).ok()?;
    is_plain.then(|| f64::from(value))
}

/// A number with a point; with a comma only where no comma separates cells or thousands.
pub(super) fn number(text: &str, separator: char) -> Option<f64> {
    let hex = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    if let Some(digits) = hex {
        return u32::from_str_radix(digits, 16).ok().map(f64::from);
    }
    let value: f64 = match text.contains(',') {
        false => text.parse().ok()?,
        true if separator == ',' || has_thousands(text) => return None,
        true => text.replace(',', ".").parse().ok()?,
    };
    value.is_finite().then_some(value)
}

/// Whether commas may separate thousands, as in 1,000; none begins with 0.
fn has_thousands(text: &str) -> bool {
    let mut groups = text.trim_start_matches(['-', '+']).split(',');
    let first = groups.next().unwrap_or_default();
    !first.starts_with('0') && groups.all(|group| group.len() == 3 || group.contains('.'))
}

/// An address as a map writes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Address {
    pub(super) at: u32,
    /// Number of decimal digits, or 0 in hexadecimal.
    digits: usize,
}

impl Address {
    /// Reads an address; of a range, such as 0-1, the first one. `is_hex` if digits without a mark
    /// are hexadecimal.
    pub(super) fn parse(text: &str, is_hex: bool) -> Option<Self> {
        let first = text.split(['-', '–', '~']).next().unwrap_or(text).trim();
        let hex = first
            .strip_prefix("0x")
            .or_else(|| first.strip_prefix("0X"));
        let hex = hex.or_else(|| first.strip_suffix(['h', 'H']));
        let hex = hex.or_else(|| is_hex.then_some(first));
        let is_decimal = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
        Some(match hex {
            Some(digits) => Self {
                at: u32::from_str_radix(digits, 16).ok()?,
                digits: 0,
            },
            None if is_decimal(first) => Self {
                at: first.parse().ok()?,
                digits: first.len(),
            },
            None => return None,
        })
    }

    /// The table and the address if this is a number such as 40001 or 400001.
    pub(super) fn numbered(self) -> Option<(usize, u32)> {
        let unit = match self.digits {
            5 => 10_000,
            6 => 100_000,
            _ => return None,
        };
        let table = match self.at / unit {
            0 => 0,
            1 => 1,
            3 => 2,
            4 => 3,
            _ => return None,
        };
        let at = (self.at % unit).checked_sub(1)?;
        (at <= 0xFFFF).then_some((table, at))
    }
}

/// The unit of a size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SizeUnit {
    Bits,
    Bytes,
    Registers,
}

impl SizeUnit {
    /// The unit that the title of a column names.
    pub(super) fn of_title(title: &str) -> Option<Self> {
        let title = title.to_lowercase();
        let has = |words: &[&str]| words.iter().any(|word| title.contains(word));
        if has(&["byte"]) {
            Some(Self::Bytes)
        } else if has(&["reg", "word", "quantity"]) {
            Some(Self::Registers)
        } else {
            has(&["bit"]).then_some(Self::Bits)
        }
    }

    const fn bytes(self, size: u16) -> Option<u16> {
        match self {
            Self::Bits if size.is_multiple_of(8) => Some(size / 8),
            Self::Bits => None,
            Self::Bytes => Some(size),
            Self::Registers => size.checked_mul(2),
        }
    }
}

/// Maximum number of bytes of a text: those of the registers of one read.
const TEXT_MAX: u16 = 250;

/// The type of a description, and the number of bytes of a text.
///
/// # Errors
/// The wrong part: the type, or its size.
pub(super) fn kind(
    text: &str,
    size: Option<u16>,
    unit: Option<SizeUnit>,
) -> Result<(&'static str, Option<u16>), Wrong> {
    let word: String = plain(text).split(' ').collect();
    for name in ["string", "str", "ascii", "char", "text"] {
        if let Some(rest) = word.strip_prefix(name) {
            return text_size(rest, size, unit).map(|size| ("str", Some(size)));
        }
    }
    let (kind, is_generic) = match &*word {
        "" | "uint" | "unsigned" | "unsignedint" | "unsignedinteger" => ("u16", true),
        "int" | "signed" | "integer" | "signedint" | "signedinteger" => ("i16", true),
        "bool" | "boolean" | "bit" | "coil" | "u16" | "uint16" | "word" | "ushort"
        | "unsignedshort" | "enum" | "bitfield" | "bitfield16" | "flags" | "u2" | "enum16" => {
            ("u16", false)
        }
        "i16" | "int16" | "s16" | "sint16" | "short" | "s2" => ("i16", false),
        "u32" | "uint32" | "udint" | "dword" | "ulong" | "bitfield32" | "acc32" | "u4" => {
            ("u32", false)
        }
        "i32" | "int32" | "s32" | "sint32" | "dint" | "long" | "s4" => ("i32", false),
        "u64" | "uint64" | "ulint" | "qword" | "acc64" | "u8bytes" => ("u64", false),
        "i64" | "int64" | "s64" | "lint" => ("i64", false),
        "f32" | "float" | "float32" | "real" | "single" | "f4" | "ieee754" => ("f32", false),
        "f64" | "float64" | "double" | "lreal" | "f8" => ("f64", false),
        _ => return Err(Wrong::Kind),
    };
    let Some(size) = size else {
        return Ok((kind, None));
    };
    let bytes = match unit {
        Some(unit) => unit.bytes(size),
        // Without a unit 2 and 4 are bytes or registers.
        None if is_generic => match size {
            1 => Some(2),
            8 => Some(8),
            16 | 32 | 64 => Some(size / 8),
            _ => None,
        },
        None => {
            let own = own_bytes(kind);
            [own, own / 2, own * 8].contains(&size).then_some(own)
        }
    };
    let bytes = bytes.ok_or(Wrong::Size)?;
    // A bit may be called a byte.
    let is_bit = matches!(&*word, "bool" | "boolean" | "bit" | "coil") && bytes <= 2;
    match (kind, bytes) {
        _ if is_bit || bytes == own_bytes(kind) => Ok((kind, None)),
        ("u16", 4) if is_generic => Ok(("u32", None)),
        ("u16", 8) if is_generic => Ok(("u64", None)),
        ("i16", 4) if is_generic => Ok(("i32", None)),
        ("i16", 8) if is_generic => Ok(("i64", None)),
        _ => Err(Wrong::Size),
    }
}

/// The wrong part of a type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wrong {
    Kind,
    Size,
}

const fn own_bytes(kind: &str) -> u16 {
    match kind.as_bytes() {
        [_, b'1', b'6'] => 2,
        [_, b'3', b'2'] => 4,
        _ => 8,
    }
}

/// The number of bytes of a text, from the rest of its type, such as `[16]`, or from its size.
fn text_size(rest: &str, size: Option<u16>, unit: Option<SizeUnit>) -> Result<u16, Wrong> {
    let inner = [('[', ']'), ('(', ')')]
        .iter()
        .find_map(|(open, close)| rest.strip_prefix(*open)?.strip_suffix(*close));
    let own = match rest {
        "" | "utf8" | "ascii" => None,
        rest => Some(
            inner
                .unwrap_or(rest)
                .parse::<u16>()
                .map_err(|_| Wrong::Kind)?,
        ),
    };
    let given = match size {
        Some(size) => Some(
            unit.unwrap_or(SizeUnit::Bytes)
                .bytes(size)
                .ok_or(Wrong::Size)?,
        ),
        None => None,
    };
    let bytes = match (own, given) {
        (Some(own), None) => own,
        (None, Some(given)) => given,
        // The size of the column may count registers.
        (Some(own), Some(given))
            if own == given || unit.is_none() && given.checked_mul(2) == Some(own) =>
        {
            own
        }
        _ => return Err(Wrong::Size),
    };
    match (1..=TEXT_MAX).contains(&bytes) {
        true => Ok(bytes.next_multiple_of(2)),
        false => Err(Wrong::Size),
    }
}
