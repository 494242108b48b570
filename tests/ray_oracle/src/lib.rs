//! The world's ray cast beside parry2d, another library with another algorithm.

#[path = "../../../emulators/benches/floor/flat.rs"]
pub mod flat;
pub mod rival;
