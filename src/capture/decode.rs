//! Captures and dumps in words, and what is wrong with all of them.

pub mod diagnose;
pub mod summary;
pub mod transcript;
