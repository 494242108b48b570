//! Conversion of text in the encodings of editors and Windows programs to UTF-8 without a mark.

use std::borrow::Cow;

/// Returns `bytes` without a byte-order mark, and UTF-16 as UTF-8. Bytes that are not text stay
/// unchanged.
pub(super) fn decoded(bytes: Cow<'_, [u8]>) -> Cow<'_, [u8]> {
    if let Some(rest) = bytes.strip_prefix(b"\xEF\xBB\xBF") {
        return match core::str::from_utf8(rest) {
            Ok(_) => Cow::Owned(rest.to_vec()),
            Err(_) => bytes,
        };
    }
    let text = match &*bytes {
        [0xFF, 0xFE, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xFE, 0xFF, rest @ ..] => utf16(rest, u16::from_be_bytes),
        [first, 0, second, 0, ..] if is_plain(*first) && is_plain(*second) => {
            utf16(&bytes, u16::from_le_bytes)
        }
        [0, first, 0, second, ..] if is_plain(*first) && is_plain(*second) => {
            utf16(&bytes, u16::from_be_bytes)
        }
        _ => None,
    };
    match text {
        Some(text) => Cow::Owned(text.into_bytes()),
        None => bytes,
    }
}

/// Decodes UTF-16, if the result is text: nearly all plain characters.
fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Option<String> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    let units: Vec<u16> = pairs.iter().map(|&pair| unit(pair)).collect();
    let text = String::from_utf16(&units)
        .ok()
        .filter(|_| rest.is_empty())?;
    let plain = text.bytes().filter(|&byte| is_plain(byte)).count();
    (plain * 20 >= text.len() * 19 && !text.is_empty()).then_some(text)
}

const fn is_plain(byte: u8) -> bool {
    matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(bytes: &[u8]) -> Vec<u8> {
        decoded(Cow::Borrowed(bytes)).into_owned()
    }

    /// The marks of UTF-8, UTF-16LE and UTF-16BE; and UTF-16 without one.
    #[test]
    fn text_loses_its_mark_and_its_encoding() {
        assert_eq!(of(b"\xEF\xBB\xBFab"), b"ab");
        assert_eq!(of(b"\xFF\xFEa\0b\0\r\0\n\0"), b"ab\r\n");
        assert_eq!(of(b"\xFE\xFF\0a\0b"), b"ab");
        assert_eq!(of(b"a\0b\0"), b"ab");
        assert_eq!(of(b"\0a\0b"), b"ab");
    }

    /// Bytes of a line that begin like a mark are not text.
    #[test]
    fn bytes_that_are_no_text_stay_as_they_are() {
        for bytes in [
            &b"\xFF\xFE\x01\x02\x03\x04"[..],
            b"\xFF\xFE",
            b"\xEF\xBB\xBF\xFF",
            b"a\0b\0\x07\x01\x02\x03",
            b"a\0b\0c",
            b"",
        ] {
            assert_eq!(of(bytes), bytes, "{bytes:02X?}");
        }
    }

    /// Both of the first two characters have to be text.
    #[test]
    fn two_characters_prove_an_encoding() {
        for bytes in [&b"\0a\0\x01"[..], b"\0\x01\0a", b"a\0\x01\0", b"\x01\0a\0"] {
            assert_eq!(of(bytes), bytes, "{bytes:02X?}");
        }
    }
}
