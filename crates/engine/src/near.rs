//! Names that were probably meant.

/// Maximum number of different letters of a misspelt name.
const LETTERS: usize = 2;

/// The name of `known` that was probably meant, if `name` is not in the list. A name counts as
/// another name if it differs by more than two letters, or if it has no more letters than differ.
pub fn misspelt<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    if known.contains(&name) {
        return None;
    }
    let near = known.iter().map(|&one| (distance(name, one), one)).min()?;
    (near.0 <= LETTERS && near.0 < name.chars().count()).then_some(near.1)
}

/// The expected names for a message about `name`: the name that was probably meant, and all `known`
/// names.
pub fn expected(name: &str, known: &[&str]) -> String {
    let all = known.join(", ");
    match misspelt(name, known) {
        Some(meant) => format!("is \"{name}\", did you mean \"{meant}\"? Expected one of {all}"),
        None if known.is_empty() => format!("is \"{name}\", but there are none"),
        None => format!("is \"{name}\", expected one of {all}"),
    }
}

/// Number of letters to insert, remove or change.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (index, letter) in a.chars().enumerate() {
        let mut before = row[0];
        row[0] = index + 1;
        for (column, other) in b.iter().enumerate() {
            let changed = before + usize::from(letter != *other);
            before = row[column + 1];
            row[column + 1] = changed.min(before + 1).min(row[column] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_with_two_wrong_letters_is_found() {
        let known = ["weight", "status", "x"];
        let rows = [
            ("wieght", Some("weight")),
            ("weigt", Some("weight")),
            ("weight", None),
            ("speed", None),
            ("y", None),
        ];
        for (name, meant) in rows {
            assert_eq!(misspelt(name, &known), meant, "{name}");
        }
    }
}
