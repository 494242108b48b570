//! Bytes of the field in files: recorded, replayed, imported, exported, and kept as cases.

mod case;
mod core;
mod export;
mod import;
mod ports;
mod record;
mod support;
mod tools;

#[path = "../support/thorough.rs"]
mod thorough;
