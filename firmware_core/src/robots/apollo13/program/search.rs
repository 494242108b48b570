//! How far the search for gates has come.

use protocols::Instant;

/// The search for gates that are not in sight.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Search {
    /// Somebody said where the car is, while there was no gate: there are more of them.
    pub(super) is_asked: bool,
    /// Since when there is none.
    pub(super) since: Option<Instant>,
    /// How many places were looked from.
    pub(super) places: u32,
    pub(super) looked: Option<Instant>,
}
