//! Random test cases: created and judged in large numbers, and minimised.

pub mod campaign;
mod error;
mod files;
pub mod fuzz;
pub mod generate;
pub mod learn;
pub mod mutants;
pub mod shrink;

pub use error::StoreError;
