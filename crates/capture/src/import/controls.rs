//! Characters without a glyph that a terminal writes as a name or an escape.
//!
//! ```text
//! AT<CR><LF>        Docklight       AT\r\n      programs
//! ```

use super::hextext::escape;

/// Names of the characters 0 to 31.
const NAMES: [&str; 32] = [
    "NUL", "SOH", "STX", "ETX", "EOT", "ENQ", "ACK", "BEL", "BS", "HT", "LF", "VT", "FF", "CR",
    "SO", "SI", "DLE", "DC1", "DC2", "DC3", "DC4", "NAK", "SYN", "ETB", "CAN", "EM", "SUB", "ESC",
    "FS", "GS", "RS", "US",
];

/// Notation of such characters in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Notation {
    /// `<CR>`
    Names,
    /// `\r`
    Escapes,
}

impl Notation {
    /// The notation of lines that end with a written line end.
    pub(super) fn of<'a>(texts: impl Iterator<Item = &'a str> + Clone) -> Option<Self> {
        let ends = |marks: [&str; 2]| {
            let mut texts = texts.clone().map(str::trim_end);
            texts.any(|text| marks.iter().any(|mark| text.ends_with(mark)))
        };
        match (ends(["<CR>", "<LF>"]), ends(["\\r", "\\n"])) {
            (true, false) => Some(Self::Names),
            (false, true) => Some(Self::Escapes),
            _ => None,
        }
    }

    /// The bytes of a text; `None` if an escape is invalid.
    pub(super) fn bytes(self, text: &str) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut chars = text.chars();
        while let Some(c) = chars.next() {
            match (self, c) {
                (Self::Names, '<') => match name(chars.as_str()) {
                    Some((byte, len)) => {
                        bytes.push(byte);
                        chars = chars.as_str()[len..].chars();
                    }
                    None => bytes.push(b'<'),
                },
                (Self::Escapes, '\\') => bytes.push(escape(&mut chars)?),
                (_, c) => bytes.push(u8::try_from(c).ok()?),
            }
        }
        Some(bytes)
    }
}

/// The character whose name and closing bracket begin a text, and their length.
fn name(text: &str) -> Option<(u8, usize)> {
    let (name, _) = text.split_once('>')?;
    let byte = match name {
        "DEL" => 0x7F,
        _ => u8::try_from(NAMES.iter().position(|known| *known == name)?).ok()?,
    };
    Some((byte, name.len() + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_written_line_end_tells_the_notation() {
        for (text, expected) in [
            ("AT<CR><LF>", Some((Notation::Names, &b"AT\r\n"[..]))),
            (
                "<STX>a<b>\\n<ETX><CR> ",
                Some((Notation::Names, b"\x02a<b>\\n\x03\r ")),
            ),
            ("AT\\r\\n", Some((Notation::Escapes, b"AT\r\n"))),
            ("a<CR>\\x7f\\n", Some((Notation::Escapes, b"a<CR>\x7f\n"))),
            ("a<CR>b", None),
            ("C:\\new", None),
            ("", None),
        ] {
            let notation = Notation::of([text].into_iter());
            let found = notation.map(|own| (own, own.bytes(text).expect("valid")));
            let found = found.as_ref().map(|(own, bytes)| (*own, &bytes[..]));
            assert_eq!(found, expected, "{text}");
        }
        assert_eq!(Notation::Escapes.bytes("a\\q\\n"), None);
    }

    /// The names of ASCII: DEL is 0x7F. A name ends at its bracket.
    #[test]
    fn characters_have_the_names_of_ascii() {
        for (text, byte, len) in [
            ("NUL>", 0x00, 4),
            ("ESC>x", 0x1B, 4),
            ("US>", 0x1F, 3),
            ("DEL>>", 0x7F, 4),
        ] {
            assert_eq!(name(text), Some((byte, len)), "{text}");
        }
        assert_eq!((name("DEL"), name("del>"), name("b>")), (None, None, None));
        assert_eq!(
            Notation::Names.bytes("a<DEL>b<US><x").as_deref(),
            Some(&b"a\x7Fb\x1F<x"[..])
        );
    }
}
