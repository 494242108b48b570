//! hilrig: a hardware-in-the-loop rig for serial robots and devices.
//!
//! Data flow: a device creates a byte ([`emulators`]), a [line](rig::line) transmits it, damages it
//! by its [faults](rig::fault) and reports it to the [trace](rig::trace). The [`rig`] passes it to
//! the robot's program ([`firmware_core`]) and transmits the reply.
//!
//! In another crate, `use hilrig::prelude::*`: see the [`prelude`]. A test needs the engine only:
//! `hilrig = { .., default-features = false }`.
//!
//! This crate is the interface to the crates in `crates/`, each of which depends only on those
//! below it:
//!
//! | module | is | feature |
//! |---|---|---|
//! | `cli` | the commands | `command` |
//! | `museum` | the defects of the fielded programs, each with its reproduction; the reports' experiments | `command` |
//! | `search` | fuzzing, campaigns, generated missions, shrinking | `command` |
//! | `slam` | the mapper for logs of any robot; ROS maps and their comparison | `command` |
//! | `realtime` | the rig, or the program alone, in real time; foreign programs in virtual time | `command` |
//! | `capture` | captures: written, read, decoded, compared, replayed, imported, exported | `command` |
//! | `show` | report, pictures, result folder | `command` |
//! | [`ports`] | ports in virtual time for drivers of every style | `serialport`, `embedded`, `futures`, `tokio` |
//! | [`run`] | a run with its checks and verdict | |
//! | [`robots`] | devices, links and program of each robot | built-in ones: `robots` |
//! | [`scenario::device`] | kinds of devices | those played by a process: `programs` |
//! | [`scenario`] | scenarios as data; floor plans | |
//! | [`codec`] | protocols: bytes in words | |
//! | [`rig`] | nodes and lines under one clock, faults of lines | |
//! | [`picture`] | pixels; reading and writing of picture files | PNG: `command` |

#[cfg(feature = "command")]
pub mod cli;
pub mod prelude;

pub use engine::{NameTaken, Shared, TOOL, codec, picture, rig, robots, run, scenario};
#[cfg(feature = "command")]
pub use {capture, museum, museum::experiment, realtime, search, show, slam};
/// The crates below this one, so that another crate needs only one dependency; see the [`prelude`].
pub use {description, emulators, firmware_core, ports, protocols};
/// Crates for the derives on settings of a user-defined device.
pub use {schemars, serde, toml};
