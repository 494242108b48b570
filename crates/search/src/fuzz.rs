//! Search for unexpected failures: bytes into decoders and programs, and whole scenarios.
//!
//! ```text
//! pool of choices --havoc--> choices --> case --> subject --> behaviour, verdict
//!        ^                                                       |         |
//!        +------------- choices that did something new ----------+         +--> finding
//! ```
//!
//! A fuzzer mutates strings of *choices*, any bytes at all; a [`Subject`] makes a case of them,
//! runs it, and judges it. Choices that bring about what none did before are kept and mutated
//! further. A *finding* is kept as a value that people can read, never as a seed: bytes in
//! hexadecimal, a scenario as TOML. So it means the same in every later version.
//!
//! [`dut`] is for programs that cannot be looked into: they are met through their ports.

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
