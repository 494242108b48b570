//! Captures and dumps in words, and what is wrong with all of them.

pub mod diagnose;
pub mod profile;
pub mod transcript;
