//! How far the search for gates has come.

use protocols::Instant;

/// The search for gates that are not in sight.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Search {
    /// The operator set the car's pose while no gate was known: there are more gates.
    pub(super) is_asked: bool,
    /// Since when there is none.
    pub(super) since: Option<Instant>,
    /// How many places were looked from.
    pub(super) places: u32,
    pub(super) looked: Option<Instant>,
}
