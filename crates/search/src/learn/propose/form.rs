//! The form of text lines: words, and numbers at their positions.

/// The form of a line with numbers in braces, and the number of decimals of each.
pub(super) fn skeleton(line: &[u8]) -> (String, Vec<usize>) {
    let text: String = line.iter().map(|&byte| char::from(byte)).collect();
    let text = text.trim_end_matches(['\r', '\n']);
    let (mut out, mut decimals) = (String::new(), Vec::new());
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let signed = rest.strip_prefix(['-', '+']).unwrap_or(rest);
        let is_word = out.ends_with(|c: char| c.is_ascii_alphanumeric());
        if signed.starts_with(|c: char| c.is_ascii_digit()) && !is_word {
            let whole = signed.bytes().take_while(u8::is_ascii_digit).count();
            let behind = &signed[whole..];
            let fraction = behind.strip_prefix('.').map_or(0, |digits| {
                digits.bytes().take_while(u8::is_ascii_digit).count()
            });
            let len =
                (rest.len() - signed.len()) + whole + if fraction > 0 { 1 + fraction } else { 0 };
            out += "{}";
            decimals.push(fraction);
            rest = &rest[len..];
            continue;
        }
        match c {
            '{' => out += "{{",
            '}' => out += "}}",
            c => out.push(c),
        }
        rest = &rest[c.len_utf8()..];
    }
    (out, decimals)
}
