//! Scenarios of the mapper in a small world: accuracy of the pose and content of the map.
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
