//! The form of text lines: words, and numbers at their positions.

/// A number in a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Number {
    /// Its characters, with its sign.
    pub(super) text: String,
    decimals: usize,
}

impl Number {
    /// The number without leading zeros and without `+`.
    pub(super) fn value(&self) -> String {
        let value = self.text.parse::<f64>().unwrap_or_default();
        value.to_string()
    }
}

/// The placeholder for the number of this index with the texts `seen`, with leading zeros and a
/// sign if it has them.
pub(super) fn placeholder(index: usize, seen: &[Number]) -> String {
    let Some(first) = seen.first() else {
        return format!("{{n{index}}}");
    };
    let decimals = first.decimals;
    if seen.iter().any(|one| one.decimals != decimals) {
        return format!("{{n{index}}}");
    }
    let len = first.text.len();
    let is_signed = seen.iter().any(|one| one.text.starts_with('+'));
    let digits = |one: &Number| one.text.trim_start_matches(['+', '-']).to_owned();
    let has_zeros = |one: &Number| {
        let digits = digits(one);
        let whole = digits.split('.').next().unwrap_or(&digits);
        whole.len() > 1 && whole.starts_with('0')
    };
    let is_wide = seen.iter().all(|one| one.text.len() == len) && seen.iter().any(has_zeros);
    let sign = if is_signed { "+" } else { "" };
    let width = if is_wide {
        format!("0{len}")
    } else {
        String::new()
    };
    match (decimals, sign, &*width) {
        (0, "", "") => format!("{{n{index}}}"),
        (0, ..) => format!("{{n{index}:{sign}{width}d}}"),
        (decimals, ..) => format!("{{n{index}:{sign}{width}.{decimals}f}}"),
    }
}

/// The form of a line with numbers in braces, and the numbers.
pub(super) fn skeleton(line: &[u8]) -> (String, Vec<Number>) {
    let text: String = line.iter().map(|&byte| char::from(byte)).collect();
    let text = text.trim_end_matches(['\r', '\n']);
    let (mut out, mut numbers) = (String::new(), Vec::new());
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let signed = rest.strip_prefix(['-', '+']).unwrap_or(rest);
        // A number with a sign may follow a letter, as in `SP+0250`.
        let is_word =
            signed.len() == rest.len() && out.ends_with(|c: char| c.is_ascii_alphanumeric());
        if signed.starts_with(|c: char| c.is_ascii_digit()) && !is_word {
            let whole = signed.bytes().take_while(u8::is_ascii_digit).count();
            let behind = &signed[whole..];
            let fraction = behind.strip_prefix('.').map_or(0, |digits| {
                digits.bytes().take_while(u8::is_ascii_digit).count()
            });
            let len =
                (rest.len() - signed.len()) + whole + if fraction > 0 { 1 + fraction } else { 0 };
            out += "{}";
            numbers.push(Number {
                text: rest[..len].to_owned(),
                decimals: fraction,
            });
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
    (out, numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_form() {
        let message = |lines: &[&str]| {
            let all: Vec<_> = lines
                .iter()
                .map(|line| skeleton(line.as_bytes()).1)
                .collect();
            let column = |at: usize| -> Vec<Number> {
                all.iter().map(|numbers| numbers[at].clone()).collect()
            };
            (0..all[0].len())
                .map(|at| placeholder(at, &column(at)))
                .collect::<Vec<_>>()
        };
        let seen = message(&["?07;+021.23;C", "?07;-001.50;C"]);
        assert_eq!(seen, ["{n0:02d}", "{n1:+07.2f}"]);
        assert_eq!(message(&["SP+0250", "SP-0012"]), ["{n0:+05d}"]);
        assert_eq!(message(&["mm=700 12.5", "mm=71 3.25"]), ["{n0}", "{n1}"]);
        assert_eq!(message(&["T 1.5", "T 12.5"]), ["{n0:.1f}"]);
        let (form, numbers) = skeleton(b"SP-0250 A1");
        assert_eq!((&*form, numbers[0].value()), ("SP{} A1", "-250".to_owned()));
    }
}
