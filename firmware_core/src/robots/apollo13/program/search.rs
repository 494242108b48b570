//! Progress of the search for gates.

use protocols::Instant;

/// The search for gates that are not in sight.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Search {
    /// Whether the operator set the car's pose while no gate was known, which means that there are
    /// more gates.
    pub(super) is_asked: bool,
    /// Time since which there is no gate.
    pub(super) since: Option<Instant>,
    /// Number of lookouts visited.
    pub(super) places: u32,
    pub(super) looked: Option<Instant>,
    /// Time of the last look for obstacles in gates.
    pub(super) looked_for_blocked: Option<Instant>,
}
