//! Stories of the mapper in a small world: how well it knows where it is, and what its map shows.

mod measure;
mod world;

mod flat;
