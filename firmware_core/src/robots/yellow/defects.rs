//! The defects of the fielded program, each behind its own number.

use super::Config;

/// Faults of the fielded program to show; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {}

impl Defects {
    /// None.
    pub const NONE: Self = Self {};
}

/// Switches a defect on.
type Switch = fn(&mut Config);

/// Every defect that the program can have.
const SWITCHES: [(&str, Switch); 0] = [];

impl Config {
    /// Numbers of the defects that [`with_defect`](Self::with_defect) knows.
    pub fn defects() -> impl Iterator<Item = &'static str> {
        SWITCHES.iter().map(|(id, _)| *id)
    }

    /// The robot with the defect `id` of the fielded program; `None` if there is no such.
    pub fn with_defect(mut self, id: &str) -> Option<Self> {
        let (_, switch) = SWITCHES.iter().find(|(known, _)| *known == id)?;
        switch(&mut self);
        Some(self)
    }
}
