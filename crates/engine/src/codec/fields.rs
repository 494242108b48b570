//! Values of a frame's fields, found in its words as `decode` prints them.

/// Value of the field `name` in the words of a frame: `weight 120 g`, `speed_left_to=20 ticks`, or
/// before its unit, `7.2 V`.
///
/// ```
/// use hilrig_engine::codec::value_in;
///
/// let words = "reading: weight 120 g, state \"stable\"";
/// assert_eq!(value_in(words, "weight"), Some("120"));
/// assert_eq!(value_in(words, "state"), Some("stable"));
/// assert_eq!(value_in("46: speed_left_to=20 ticks", "speed_left_to"), Some("20"));
/// assert_eq!(value_in("front 13 cm, 7.2 V", "V"), Some("7.2"));
/// assert_eq!(value_in(words, "wieght"), None);
/// ```
pub fn value_in<'a>(words: &'a str, name: &str) -> Option<&'a str> {
    if name.is_empty() {
        return None;
    }
    let places = || places_of(words, name);
    let assigned = places().find_map(|(_, after)| token(after.strip_prefix('=')?));
    let beside = || places().find_map(|(_, after)| token(after.strip_prefix(' ')?));
    let unit = || places().find_map(|(before, _)| number_at_end(before));
    assigned.or_else(beside).or_else(unit)
}

/// The text before and after each occurrence of `name` as a whole word, outside of quoted text.
fn places_of<'a>(words: &'a str, name: &str) -> impl Iterator<Item = (&'a str, &'a str)> {
    let is_part = |c: char| c.is_alphanumeric() || "_-.".contains(c);
    let quotes = |text: &str| text.matches('"').count();
    let has_pairs = quotes(words).is_multiple_of(2);
    let places = words.match_indices(name);
    places.filter_map(move |(at, found)| {
        let (before, after) = (&words[..at], &words[at + found.len()..]);
        let begins = !before.ends_with(is_part);
        let ends = !after.starts_with(is_part);
        let is_quoted = has_pairs && !quotes(before).is_multiple_of(2);
        (begins && ends && !is_quoted).then_some((before, after))
    })
}

/// The value at the start of `text`: a quoted text, a list in brackets, or a word.
fn token(text: &str) -> Option<&str> {
    for (open, close) in [('"', '"'), ('[', ']'), ('{', '}')] {
        if let Some(inner) = text.strip_prefix(open) {
            let end = inner.find(close)?;
            let whole = &text[..end + 2];
            return Some(if open == '"' { &inner[..end] } else { whole });
        }
    }
    let end = text.find([' ', ',', ';', '}']).unwrap_or(text.len());
    let word = text[..end].trim_end_matches(':');
    (!word.is_empty()).then_some(word)
}

/// The number at the end of `text`, before a space.
fn number_at_end(text: &str) -> Option<&str> {
    let text = text.strip_suffix(' ')?;
    let begin = text.rfind([' ', '=', ',']).map_or(0, |at| at + 1);
    let word = &text[begin..];
    word.parse::<f64>().is_ok().then_some(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words of golden frames of each style, and of a described message with a list and a group.
    #[test]
    fn fields_are_found_in_words_of_each_style() {
        let rows = [
            ("297.22 rpm, from 0 deg: 295 295 mm", "rpm", Some("297.22")),
            ("297.22 rpm, from 0 deg: 295 295 mm", "from", Some("0")),
            ("pen down at 291,2748", "pen", Some("down")),
            (
                "model 18, firmware 1.29, hardware 7",
                "firmware",
                Some("1.29"),
            ),
            ("1250 ok, 3 weak", "weak", Some("3")),
            ("a=1 b=-2.5 c=x", "b", Some("-2.5")),
            ("a=1 b=-2.5 c=x", "c", Some("x")),
            ("set: speed 3, speed_max 9", "speed_max", Some("9")),
            ("set: speed_max 9", "speed", None),
            ("all: at [1, 2], of {x 1, y 2}", "at", Some("[1, 2]")),
            ("all: at [1, 2], of {x 1, y 2}", "y", Some("2")),
            ("say: text \"a, b\"", "text", Some("a, b")),
            ("say: text \"x=5\" x=7", "x", Some("7")),
            ("say: text \"x=5\"", "x", None),
            ("ping", "ping", None),
            ("", "x", None),
        ];
        for (words, name, value) in rows {
            assert_eq!(value_in(words, name), value, "{name} in {words}");
        }
    }
}
