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
