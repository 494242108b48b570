//! Names that were probably meant.

/// Maximum number of different letters of a misspelt name.
const LETTERS: usize = 2;

/// Letters that two names have in common at least, if one begins with the other.
const STEM: usize = 4;

/// The name of `known` that `name` misspells; `None` if `name` is in the list. A name counts as
/// another name if it differs by more than two letters, or by half of its letters.
pub fn misspelt<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    if known.contains(&name) {
        return None;
    }
    let near = known.iter().map(|&one| (distance(name, one), one)).min()?;
    (near.0 <= LETTERS && 2 * near.0 < name.chars().count()).then_some(near.1)
}

/// The name of `known` to propose in a message about `name`: one that `name` misspells, or one that
/// begins with `name` or is its beginning. Only for messages: `wrong-current` may be another name
/// than `wrong`.
pub fn meant<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    if known.contains(&name) {
        return None;
    }
    misspelt(name, known).or_else(|| known.iter().copied().find(|one| begins(one, name)))
}

/// Whether one of the names is the beginning of the other, up to a unit or another part: `speed`
/// and `speed_m_s`, `baudrate` and `baud`.
fn begins(one: &str, other: &str) -> bool {
    let is_part = |short: &str, long: &str| {
        let rest = long.strip_prefix(short);
        rest.is_some_and(|rest| rest.starts_with(['_', '-']) || short.len() >= STEM)
    };
    is_part(one, other) || is_part(other, one)
}

/// The expected names for a message about `name`: the name that was probably meant, and all `known`
/// names.
pub fn expected(name: &str, known: &[&str]) -> String {
    let all = known.join(", ");
    match meant(name, known) {
        Some(meant) => format!("is \"{name}\", did you mean \"{meant}\"? Expected one of {all}"),
        None if known.is_empty() => format!("is \"{name}\", but there are none"),
        None => format!("is \"{name}\", expected one of {all}"),
    }
}

/// A message with a list of names, such as `"name", expected one of: a, b`, with the name that was
/// probably meant. Further words may follow behind `; `.
pub fn with_meant(message: &str) -> String {
    let named = || {
        let (before, all) = message.split_once(", expected one of")?;
        let list = all.trim_start_matches([':', ' ']);
        let list = list.split_once("; ").map_or(list, |(list, _)| list);
        let known: Vec<&str> = list
            .split(", ")
            .map(|name| name.trim_matches('`'))
            .collect();
        let meant = meant(before.rsplit(['"', '`']).nth(1)?, &known)?;
        Some(format!(
            "{before}, did you mean \"{meant}\"? Expected one of{all}"
        ))
    };
    named().unwrap_or_else(|| message.to_owned())
}

/// Number of letters to insert, remove, change, or exchange with the next one.
fn distance(a: &str, b: &str) -> usize {
    let [a, b] = [a, b].map(|text| text.chars().collect::<Vec<char>>());
    let mut before: Vec<usize> = Vec::new();
    let mut last: Vec<usize> = (0..=b.len()).collect();
    for (row, &letter) in a.iter().enumerate() {
        let mut next = vec![row + 1];
        for (column, &other) in b.iter().enumerate() {
            let changed = last[column] + usize::from(letter != other);
            let mut least = changed.min(last[column + 1] + 1).min(next[column] + 1);
            if row > 0 && column > 0 && letter == b[column - 1] && a[row - 1] == other {
                least = least.min(before[column - 1] + 1);
            }
            next.push(least);
        }
        before = core::mem::replace(&mut last, next);
    }
    last[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_with_two_wrong_letters_is_found() {
        let known = ["weight", "status", "x", "heading_deg", "baud", "x_m"];
        let rows = [
            ("wieghtx", Some("weight")),
            ("heading", Some("heading_deg")),
            ("baudrate", Some("baud")),
            ("head", Some("heading_deg")),
            ("wieght", Some("weight")),
            ("weigt", Some("weight")),
            ("weight", None),
            ("speed", None),
            ("buad", Some("baud")),
            ("bus", None),
            ("y", None),
        ];
        for (name, expected) in rows {
            assert_eq!(meant(name, &known), expected, "{name}");
        }
    }

    #[test]
    fn a_message_names_the_value_that_was_meant() {
        let said = "\"wieght + 1\": there is no value \"wieght\", expected one of: weight, x";
        let said = with_meant(said);
        let end = "value \"wieght\", did you mean \"weight\"? Expected one of: weight, x";
        assert!(said.ends_with(end), "{said}");
        let said = "no message \"red\" of the driver, expected one of read, x; see help";
        let said = with_meant(said);
        assert!(
            said.contains("did you mean \"read\"? Expected one of read, x;"),
            "{said}"
        );
        let said = with_meant("unknown variant `cosb`, expected one of `slip`, `cobs`");
        assert!(
            said.contains("did you mean \"cobs\"? Expected one of `slip`"),
            "{said}"
        );
        let other = "is \"speed\", expected one of a, b";
        assert_eq!(with_meant(other), other);
    }

    /// A name with another part is proposed, but it is no misspelling: it may be a name of its own.
    #[test]
    fn a_longer_name_is_no_misspelling() {
        for (name, known) in [("wrong-current", "wrong"), ("overload", "overload-cleared")] {
            let found = [misspelt(name, &[known]), meant(name, &[known])];
            assert_eq!(found, [None, Some(known)], "{name}");
        }
    }
}
