//! Literals of bytes, as Python and Rust print them.

use engine::hex;

/// Text between the quotes of a literal.
fn inside(text: &str) -> Option<&str> {
    let inside = ["b'", "b\""]
        .iter()
        .find_map(|open| text.strip_prefix(open))?;
    inside.strip_suffix(['\'', '"'])
}

/// Whether a text has the form of a literal.
pub(super) fn is_quoted(text: &str) -> bool {
    inside(text).is_some()
}

/// Whether a text is a literal. A text of hex digits alone may be digits in quotes.
pub(super) fn is_literal(text: &str) -> bool {
    inside(text).is_some_and(|inside| hex::bytes(inside).is_none())
}
