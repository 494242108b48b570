//! Bytes in hexadecimal: the only module that writes and reads them.
//!
//! Two spellings: *pairs*, `AB 24 0A`, where people read frames, and *digits*, `AB240A`, where
//! bytes are one word of a line. Output has capital letters; input may have both cases.

const DIGITS: [u8; 16] = *b"0123456789ABCDEF";

/// Appends `byte` to `out`.
fn push(out: &mut String, byte: u8) {
    out.push(char::from(DIGITS[usize::from(byte >> 4)]));
    out.push(char::from(DIGITS[usize::from(byte & 15)]));
}

/// Appends `bytes` to `out` without separators.
pub fn push_digits(out: &mut String, bytes: &[u8]) {
    out.reserve(2 * bytes.len());
    bytes.iter().for_each(|&byte| push(out, byte));
}

/// `bytes` without separators.
pub fn digits(bytes: &[u8]) -> String {
    let mut out = String::new();
    push_digits(&mut out, bytes);
    out
}

/// `bytes` separated by spaces.
pub fn pairs(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(3 * bytes.len());
    for (index, &byte) in bytes.iter().enumerate() {
        if index > 0 {
            out.push(' ');
        }
        push(&mut out, byte);
    }
    out
}

/// The byte of two digits; `None` for signs, spaces and any other number of letters.
pub fn byte(pair: &[u8]) -> Option<u8> {
    let &[high, low] = pair else { return None };
    let digit = |letter: u8| char::from(letter).to_digit(16);
    u8::try_from(digit(high)? * 16 + digit(low)?).ok()
}

/// The bytes of digits without separators.
pub fn bytes(text: &str) -> Option<Vec<u8>> {
    text.as_bytes().chunks(2).map(byte).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_spellings_are_those_of_a_dump() {
        assert_eq!(pairs(&[0xAB, 0x04, 0xFF]), "AB 04 FF");
        assert_eq!(digits(&[0xAB, 0x04, 0xFF]), "AB04FF");
        assert_eq!((pairs(&[]), digits(&[])), (String::new(), String::new()));
    }

    #[test]
    fn hexadecimal_is_read_or_refused() {
        assert_eq!(bytes("00FFa5"), Some(vec![0x00, 0xFF, 0xA5]));
        assert_eq!(bytes(""), Some(Vec::new()));
        assert_eq!(bytes("0"), None);
        assert_eq!(bytes("+1"), None);
        assert_eq!(byte(b"0"), None);
        assert_eq!(byte(b"G0"), None);
    }
}
