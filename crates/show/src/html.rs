//! Escaping of text in HTML, so that text from any source is never read as markup.

use core::fmt::{self, Write as _};

/// Formatter that escapes all markup, also inside quoted attributes.
pub struct Escaped<'a>(pub &'a str);

impl fmt::Display for Escaped<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.chars().try_for_each(|letter| match letter {
            '&' => f.write_str("&amp;"),
            '<' => f.write_str("&lt;"),
            '>' => f.write_str("&gt;"),
            '"' => f.write_str("&quot;"),
            '\'' => f.write_str("&#39;"),
            letter => f.write_char(letter),
        })
    }
}

/// Returns `text` with all markup escaped.
pub fn escape(text: &str) -> String {
    Escaped(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_never_markup() {
        assert_eq!(
            escape("<b onclick='x'>\"&amp;"),
            "&lt;b onclick=&#39;x&#39;&gt;&quot;&amp;amp;"
        );
    }
}
