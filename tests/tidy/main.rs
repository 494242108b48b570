//! The house rules that no compiler checks. Each rule is a function over text, so that a test can
//! prove with a wrong sample that the rule finds it.

mod crates;
mod data;
mod files;
mod findings;
mod rooms;
mod text;
