//! The mutants as cargo-mutants lists them, and the draw among them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::Deserialize;

/// One change of the source, as listed by `cargo mutants --list --json`.
#[derive(Debug, Deserialize)]
pub struct Mutant {
    /// Position and description of the change; unique.
    pub name: String,
    /// The file, relative to the workspace.
    pub file: String,
    /// Kind of the change.
    pub genre: Genre,
    /// The replaced part: an operator, a body, a guard, an arm.
    pub span: Span,
    /// The new text.
    pub replacement: String,
}

/// The kinds of change in cargo-mutants.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
pub enum Genre {
    /// A function returns a made-up value.
    FnValue,
    /// Another operator between the same operands, or in an assignment.
    BinaryOperator,
    /// An operator is removed.
    UnaryOperator,
    /// An arm is removed.
    MatchArm,
    /// A guard is always true, or always false.
    MatchArmGuard,
    /// A field keeps its default.
    StructField,
}

/// Start of the replaced part; its end follows from the syntax.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct Span {
    /// Position of its first character.
    pub start: Place,
}

/// A line and a column, both from 1.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
pub struct Place {
    /// Number of the line, from 1.
    pub line: usize,
    /// Number of the character, from 1.
    pub column: usize,
}

/// Draws `count` of the listed mutants (0: all) by `seed`, except those in the file of equivalent
/// mutants. Returns them and the number of candidates.
pub fn draw(
    list: &Path,
    equivalent: &Path,
    count: usize,
    seed: u64,
) -> Result<(Vec<Mutant>, usize), String> {
    let text = read(list)?;
    let mut mutants: Vec<Mutant> =
        serde_json::from_str(&text).map_err(|error| format!("{}: {error}", list.display()))?;
    let known = equivalent_among(&mutants, &read(equivalent)?);
    let mut numbers = 0..;
    mutants.retain(|_| !numbers.next().is_some_and(|number| known.contains(&number)));
    if mutants.is_empty() {
        return Err("no mutant there: nothing was seen".to_owned());
    }
    let total = mutants.len();
    if count > 0 {
        let mut numbers = Numbers(seed);
        mutants.sort_by_cached_key(|_| numbers.next());
        mutants.truncate(count);
        mutants.sort_by(|one, other| one.name.cmp(&other.name));
    }
    Ok((mutants, total))
}

/// The numbers of the mutants that `lines`, `NAME -- REASON` each, name as equivalent. Lines move,
/// so a name stands for the same change in the same function of a file. If there are several, it
/// stands for the one at its position, otherwise for the nearest one in its column.
fn equivalent_among(mutants: &[Mutant], lines: &str) -> BTreeSet<usize> {
    let mut left: BTreeMap<(&str, &str), Vec<(Place, usize)>> = BTreeMap::new();
    for (number, mutant) in mutants.iter().enumerate() {
        if let Some((change, place)) = parts(&mutant.name) {
            left.entry(change).or_default().push((place, number));
        }
    }
    let lines = lines.lines().filter(|line| !line.starts_with('#'));
    let names = lines.filter_map(|line| line.split_once(" -- ").map(|(name, _)| name));
    let mut known: Vec<_> = names.filter_map(parts).collect();
    // A name at its position goes first, so that no moved one takes it.
    let has_moved = |(change, place): &((&str, &str), Place)| {
        let alike = left.get(change).into_iter().flatten();
        !alike.map(|(at, _)| at).any(|at| at == place)
    };
    known.sort_by_cached_key(has_moved);
    let mut found = BTreeSet::new();
    for (change, place) in known {
        let Some(alike) = left.get_mut(&change) else {
            continue;
        };
        let distance =
            |(at, _): &(Place, usize)| (at.column != place.column, at.line.abs_diff(place.line));
        let nearest = (0..alike.len()).min_by_key(|&index| distance(&alike[index]));
        found.extend(nearest.map(|index| alike.remove(index).1));
    }
    found
}

/// File and change of a mutant's name, `FILE:LINE:COLUMN: CHANGE`, and its position.
fn parts(name: &str) -> Option<((&str, &str), Place)> {
    let (place, change) = name.split_once(": ")?;
    let (place, column) = place.rsplit_once(':')?;
    let (file, line) = place.rsplit_once(':')?;
    let (line, column) = (line.parse().ok()?, column.parse().ok()?);
    Some(((file, change), Place { line, column }))
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// SplitMix64 (Steele, Lea and Flood 2014): the same draw on every machine.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mutant(name: &str) -> Mutant {
        Mutant {
            name: name.to_owned(),
            file: String::new(),
            genre: Genre::BinaryOperator,
            span: Span {
                start: Place { line: 1, column: 1 },
            },
            replacement: String::new(),
        }
    }

    /// Numbers of the mutants that the lines name, in a list of four: the same change at lines 10,
    /// 20 and 21, and one in another function.
    fn found(lines: &str) -> Vec<usize> {
        let list = [
            "src/a.rs:10:5: replace < with <= in near",
            "src/a.rs:20:5: replace < with <= in near",
            "src/a.rs:21:9: replace < with <= in near",
            "src/a.rs:30:5: replace < with <= in far",
        ];
        let list = list.map(mutant);
        equivalent_among(&list, lines).into_iter().collect()
    }

    #[test]
    fn a_name_holds_where_its_line_has_moved() {
        assert_eq!(found("src/a.rs:35:9: replace < with <= in far -- so"), [3]);
        for other in [
            "src/b.rs:30:5: replace < with <= in far -- so",
            "src/a.rs:30:5: replace < with == in far -- so",
            "src/a.rs:30:5: replace < with <= in further -- so",
            "# src/a.rs:30:5: replace < with <= in far -- so",
            "src/a.rs:30:5: replace < with <= in far",
        ] {
            assert!(found(other).is_empty(), "{other}");
        }
    }

    #[test]
    fn of_equal_changes_a_name_means_the_one_at_its_place_or_the_nearest() {
        let all = |places: &[&str]| {
            let line = |at: &&str| format!("src/a.rs:{at}: replace < with <= in near -- so\n");
            found(&places.iter().map(line).collect::<String>())
        };
        for (places, expected) in [
            (&["10:5"][..], &[0][..]),
            (&["20:5"], &[1]),
            (&["21:9"], &[2]),
            (&["14:5"], &[0]),
            (&["16:5"], &[1]),
            (&["22:5"], &[1]),
            (&["3:9"], &[2]),
            // The first name has moved, and leaves line 20 to its own name.
            (&["19:5", "20:5"], &[0, 1]),
            (&["1:5", "2:5", "3:5", "4:5"], &[0, 1, 2]),
        ] {
            assert_eq!(all(places), expected, "{places:?}");
        }
    }
}
