//! hilrig: a hardware-in-the-loop rig for small serial robots.
//!
//! Follow a byte: a device makes it ([`emulators`]), a [line](rig::line) carries it, damages it by
//! its [faults](rig::fault) and shows it to the [trace](rig::trace), the [`rig`] hands it to the
//! robot's program ([`firmware_core`]) and carries the answer back.
//!
//! From another crate `use hilrig::prelude::*`: see the [`prelude`].
//!
//! Each room stands only on those below it:
//!
//! | room | is |
//! |---|---|
//! | [`cli`] | the commands |
//! | [`museum`] | the defects of the fielded programs, each with its reproduction |
//! | [`search`] | fuzzing, campaigns, generated missions, shrinking |
//! | [`slam`] | the mapper over anybody's log; maps as others keep them, and how two differ |
//! | [`capture`] | the file of all bytes: written, read, decoded, compared, replayed, imported, exported |
//! | [`show`] | page, report, pictures, result folder |
//! | `guest` | a foreign program in virtual time |
//! | [`realtime`] | the rig, or the program alone, at the pace of the wall clock |
//! | [`run`] | a run watched and judged |
//! | [`robots`] | which devices, links and program a robot consists of |
//! | [`scenario`] | a run as data; floor plans |
//! | [`codec`] | bytes in words |
//! | [`rig`] | nodes and lines under one clock, faults on the way |
//! | [`picture`] | pixels, read from files and written to them |

pub mod capture;
pub mod cli;
pub mod codec;
pub mod experiment;
mod guest;
mod hex;
mod html;
pub mod museum;
pub mod picture;
pub mod prelude;
pub mod realtime;
mod registry;
pub mod rig;
pub mod robots;
pub mod run;
pub mod scenario;
pub mod search;
pub mod show;
pub mod slam;
mod whole_file;
mod workers;

pub use registry::NameTaken;
/// The crates below, so that another crate needs this one alone; see the [`prelude`].
pub use {emulators, firmware_core, protocols};
/// What the settings of a device of one's own are derived with.
pub use {schemars, serde, toml};

/// Name of the tool as written into results.
pub const TOOL: &str = "hilrig";
