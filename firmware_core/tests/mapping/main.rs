//! Stories of the mapper in a small world: how well it knows where it is, and what its map shows.
#![expect(
    clippy::cast_possible_truncation,
    reason = "the figures of a small world are small"
)]

mod measure;
mod world;

mod arena;
mod corridor;
mod endurance;
mod flat;
mod lost;
mod same;
mod scenes;
