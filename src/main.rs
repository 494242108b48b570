//! The `hilrig` command.

fn main() {}
