//! The house rules that no compiler checks. Each rule is a function over text, so that a sample
//! that breaks it can show that it would be found.

mod crates;
mod data;
mod files;
mod findings;
mod rooms;
mod text;
