//! Text of other sources as HTML.

use core::ops::Range;

use crate::html::escape;

/// Escapes `text` and turns each time in it, seconds with six decimals, into a button that jumps
/// there.
pub(super) fn with_jumps(text: &str) -> String {
    let (mut out, mut rest) = (String::new(), text);
    while let Some(time) = next_time(rest) {
        let at = &rest[time.clone()];
        out += &escape(&rest[..time.start]);
        out += &format!("<button type=\"button\" class=\"jump\" data-at=\"{at}\">{at}</button>");
        rest = &rest[time.end..];
    }
    out + &escape(rest)
}

/// The first time in `text`, seconds.
pub(super) fn first_time(text: &str) -> Option<f64> {
    text[next_time(text)?].parse().ok()
}

/// Range of the first number with exactly six decimals; only times are written with six decimals.
fn next_time(text: &str) -> Option<Range<usize>> {
    let is_part = |byte: u8| byte.is_ascii_digit() || byte == b'.';
    let bytes = text.as_bytes();
    let mut start = 0;
    while start < bytes.len() {
        let len = bytes[start..].iter().take_while(|&&b| is_part(b)).count();
        // Digits and dots are whole characters; other bytes may be parts of one.
        let number = text.get(start..start + len).unwrap_or_default();
        if let Some((whole, decimals)) = number.split_once('.')
            && !whole.is_empty()
            && decimals.len() == 6
            && !decimals.contains('.')
        {
            return Some(start..start + len);
        }
        start += len.max(1);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_of_others_is_markup() {
        assert_eq!(with_jumps("a<b"), "a&lt;b");
    }

    /// A figure with fewer decimals, a version, or the full stop of a sentence is not a time.
    #[test]
    fn times_become_jumps_and_other_figures_do_not() {
        assert_eq!(first_time("0.913 found, fw 2.4.13386, 1.0000001"), None);
        assert_eq!(first_time("first: 12.345678 base"), Some(12.345678));
        assert_eq!(
            with_jumps("ä 1.000000 s"),
            "ä <button type=\"button\" class=\"jump\" data-at=\"1.000000\">1.000000</button> s"
        );
    }
}
