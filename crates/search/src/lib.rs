//! Cases made by chance, judged in great numbers, made small.

pub mod campaign;
mod error;
mod files;
pub mod fuzz;
pub mod generate;
pub mod learn;
pub mod mutants;
pub mod shrink;

pub use error::StoreError;
