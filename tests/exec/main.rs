//! A user's program gets a verdict: Python with nothing but its standard library, on real
//! pseudo-terminals, started by `hilrig run --exec`.
//!
//! Content and order only, never how long something took.

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod begins;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod board;
mod causes;
mod commands;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod computing;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod conversation;
mod custom;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod damaged;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod debugger;
mod endings;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod field_bugs;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod generated;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod guest;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod lent;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod lines;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod own_drivers;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod pair;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod probes;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod races;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod restarts;
mod signals;
mod support;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod team;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod terminals;
#[path = "../support/thorough.rs"]
mod thorough;
mod verdicts;
