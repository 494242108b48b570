//! hilrig: a hardware-in-the-loop rig for serial robots and devices.
//!
//! Follow a byte: a device makes it ([`emulators`]), a [line](rig::line) carries it, damages it by
//! its [faults](rig::fault) and shows it to the [trace](rig::trace), the [`rig`] hands it to the
//! robot's program ([`firmware_core`]) and carries the answer back.
//!
//! From another crate `use hilrig::prelude::*`: see the [`prelude`]. A test needs the engine alone:
//! `hilrig = { .., default-features = false }`.
//!
//! This crate is the face of those in `crates/`, each of which stands only on those below it:
//!
//! | module | is | feature |
//! |---|---|---|
//! | `cli` | the commands | `command` |
//! | `museum` | the defects of the fielded programs, each with its reproduction; the reports' experiments | `command` |
//! | `search` | fuzzing, campaigns, generated missions, shrinking | `command` |
//! | `slam` | the mapper over logs of any robot; ROS maps, and how two differ | `command` |
//! | `realtime` | the rig, or the program alone, at the pace of the wall clock; foreign programs in virtual time | `command` |
//! | `capture` | captures: written, read, decoded, compared, replayed, imported, exported | `command` |
//! | `show` | report, pictures, result folder | `command` |
//! | [`ports`] | ports in virtual time for drivers of every style | `serialport`, `embedded`, `futures`, `tokio` |
//! | [`run`] | a run watched and judged | |
//! | [`robots`] | devices, links and program of each robot | built-in ones: `robots` |
//! | [`scenario`] | a run as data; floor plans | |
//! | [`codec`] | bytes in words | |
//! | [`rig`] | nodes and lines under one clock, faults on the way | |
//! | [`picture`] | pixels, read from files and written to them | PNG: `command` |

#[cfg(feature = "command")]
pub mod cli;
pub mod prelude;

pub use engine::{NameTaken, Shared, TOOL, codec, picture, rig, robots, run, scenario};
#[cfg(feature = "command")]
pub use {capture, museum, museum::experiment, realtime, search, show, slam};
/// The crates below, so that another crate needs this one alone; see the [`prelude`].
pub use {description, emulators, firmware_core, ports, protocols};
/// The crates that the settings of an own device are derived with.
pub use {schemars, serde, toml};
