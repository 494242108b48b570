//! Figures of a line that state its number of bytes.

/// Number of bytes that a text states: `5 bytes`, `Length 5`, `len=5`.
pub(super) fn told(text: &str) -> Option<usize> {
    let lower = text.to_ascii_lowercase();
    if lower.contains("expect") || lower.contains(" of ") {
        return None;
    }
    let words: Vec<&str> = lower
        .split(|c: char| !c.is_alphanumeric())
        .filter(|word| !word.is_empty())
        .collect();
    words.windows(2).find_map(|pair| match pair {
        [count, "byte" | "bytes"] | ["length" | "len" | "size" | "count", count] => {
            count.parse().ok()
        }
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_states_its_number_of_bytes() {
        for (text, count) in [
            ("wrote 5 bytes:", Some(5)),
            ("1 byte", Some(1)),
            ("Length 5: ", Some(5)),
            ("len=6", Some(6)),
            ("size 7", Some(7)),
            ("count: 8", Some(8)),
            ("expecting 9 bytes", None),
            ("2 of 3 bytes", None),
            ("bytes 5", None),
            ("5", None),
        ] {
            assert_eq!(told(text), count, "{text}");
        }
    }
}
