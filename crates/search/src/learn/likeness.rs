//! Likeness of messages in an unknown format: equal apart from their values.

/// Whether two messages are the same apart from their values: texts with other numbers, or as many
/// bytes of which at least half are equal.
pub(crate) fn resemble(one: &[u8], other: &[u8]) -> bool {
    if let (Some(one), Some(other)) = (skeleton(one), skeleton(other)) {
        return one == other;
    }
    let pairs = one.iter().zip(other);
    let equal = pairs.filter(|(one, other)| one == other).count();
    !one.is_empty() && one.len() == other.len() && 2 * equal >= one.len()
}

/// Whether `others` look like `usual` messages of one kind. In texts, numbers may differ. In bytes,
/// those that are the same in all `usual` messages must be the same in `others`; they must be a
/// quarter of all.
pub(crate) fn are_like(usual: &[Vec<u8>], others: &[Vec<u8>]) -> bool {
    let Some(first) = usual.first().filter(|first| !first.is_empty()) else {
        return false;
    };
    let mut all = usual.iter().chain(others);
    if let Some(text) = skeleton(first) {
        return all.all(|one| skeleton(one).as_ref() == Some(&text));
    }
    if all.any(|one| one.len() != first.len()) {
        return false;
    }
    let is_stable = |at: &usize| usual.iter().all(|one| one[*at] == first[*at]);
    let stable: Vec<usize> = (0..first.len()).filter(is_stable).collect();
    let is_same = |other: &Vec<u8>| stable.iter().all(|&at| other[at] == first[at]);
    4 * stable.len() >= first.len() && others.iter().all(is_same)
}

/// A text with `#` in place of each word with a digit and of each word after `*`, which is a
/// checksum; `None` for bytes that are no text.
fn skeleton(bytes: &[u8]) -> Option<Vec<u8>> {
    let is_text = |byte: &u8| matches!(byte, b' '..=b'~' | b'\r' | b'\n' | b'\t');
    if bytes.len() < 2 || !bytes.iter().all(is_text) {
        return None;
    }
    let is_in_word = |byte: u8| byte.is_ascii_alphanumeric() || b".+-".contains(&byte);
    let mut out = Vec::new();
    for word in bytes.chunk_by(|one, other| is_in_word(*one) && is_in_word(*other)) {
        let is_value = is_in_word(word[0])
            && (word.iter().any(u8::is_ascii_digit) || out.last() == Some(&b'*'));
        match is_value {
            true => out.push(b'#'),
            false => out.extend(word),
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_alike_if_only_their_values_differ() {
        assert!(resemble(b"$T,21.5*4A\r\n", b"$T,7*BE\r\n"));
        assert!(!resemble(b"OK\r\n", b"ERR\r\n"));
        assert!(resemble(&[1, 3, 0, 9, 2], &[1, 3, 0, 8, 7]));
        assert!(!resemble(&[1, 3, 0, 9, 2], &[1, 3, 0, 9]));
        let usual = [vec![1, 3, 2, 0, 9], vec![1, 3, 2, 1, 7]];
        assert!(are_like(&usual, &[vec![1, 3, 2, 4, 4]]));
        assert!(!are_like(&usual, &[vec![1, 0x83, 2, 4, 4]]));
        assert!(!are_like(&[], &usual) && !are_like(&usual, &[Vec::new()]));
    }
}
