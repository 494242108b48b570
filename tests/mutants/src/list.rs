//! The mutants as cargo-mutants lists them, and the draw among them.

use std::collections::BTreeSet;
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
    let known = read(equivalent)?;
    let known: BTreeSet<&str> = known
        .lines()
        .filter(|line| !line.starts_with('#'))
        .filter_map(|line| line.split_once(" -- ").map(|(name, _)| name))
        .collect();
    mutants.retain(|mutant| !known.contains(mutant.name.as_str()));
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
