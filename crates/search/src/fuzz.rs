//! Search for unexpected failures: bytes into decoders and programs, and whole scenarios.
//!
//! ```text
//! pool of choices --havoc--> choices --> case --> subject --> behaviour, verdict
//!        ^                                                       |         |
//!        +------------- choices that did something new ----------+         +--> finding
//! ```
//!
//! A fuzzer mutates strings of *choices*, which may be any bytes. A [`Subject`] builds a case from
//! them, runs it and judges it. Choices that cause new behaviour are kept and mutated further. A
//! *finding* is stored as a readable value, never as a seed: bytes in hexadecimal, a scenario as
//! TOML. Therefore it has the same meaning in every later version.
//!
//! [`dut`] is for programs without access to their inside: it tests them through their ports.

pub mod dut;
mod engine;
mod folder;
mod havoc;
mod missions;
mod session;
mod subject;
mod wires;

pub use engine::{FirstCase, Fuzzer, Round, silence_panics};
pub use folder::read_corpus;
pub use folder::{Folder, FuzzPlan};
pub use missions::Missions;
pub use session::{PROGRAMS, programs};
pub use subject::{Behaviour, Kept, Subject, Violation, size};
pub use wires::Wires;
