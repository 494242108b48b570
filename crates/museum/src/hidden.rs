//! Defects that no run of a campaign can show.

use serde::Deserialize;

const FILE: &str = include_str!("../data/hidden.toml");

/// A defect that no run can show.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hidden {
    /// Its number.
    pub id: String,
    /// The reason.
    pub because: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    defect: Vec<Hidden>,
}

/// The defects of the robots' programs that no run can show.
pub fn hidden() -> Vec<Hidden> {
    let file: File = toml::from_str(FILE).expect("a test reads it");
    file.defect
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use engine::robots;

    /// Each number is a switch of a robot's program, once, and has a reason.
    #[test]
    fn hidden_defects_are_known_and_have_a_reason() {
        let known: BTreeSet<&str> = crate::wings()
            .filter_map(|wing| robots::find(wing.robot))
            .flat_map(robots::Robot::defects)
            .collect();
        let mut seen = BTreeSet::new();
        for one in hidden() {
            assert!(
                known.contains(&*one.id) && !one.because.is_empty(),
                "{}",
                one.id
            );
            assert!(seen.insert(one.id.clone()), "{} is there twice", one.id);
        }
    }
}
