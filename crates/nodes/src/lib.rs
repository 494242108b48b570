//! Node programs: processes in any language that act as one node of a rig.
//!
//! ```text
//!   rig, virtual time                          process of any language
//!   NodeDevice --- Host --- request, answer --- four functions: receive, poll, transmit, poll_at
//!                  one exchange passes on all input of one moment
//! ```
//!
//! The rig waits for each answer, so virtual time is exact and every run gives the same bytes. The
//! contract is in `docs/nodes.md`.
//!
//! | module | is |
//! |---|---|
//! | [`message`] | requests, answers and their items |
//! | [`binary`], [`json`] | the two forms of a message |
//! | [`process`] | a process with pipes: start, write, read, and end with all its children |
//! | [`group`] | the members of a process group |
//! | [`host`] | a running node program: greeting, exchanges, checks of each answer |
//! | [`device`] | a node program as a device of a rig |
//! | [`program`] | the other end, for node programs in Rust |
//! | [`conform`] | the conformance test of a program |

pub mod binary;
pub mod conform;
pub mod device;
mod error;
pub mod group;
pub mod host;
mod intern;
pub mod json;
pub mod message;
pub mod process;
mod processor;
pub mod program;
mod slowness;
mod spec;
mod typed;

pub use device::{FAILED, NodeDevice, Slowness, Stopwatch};
pub use error::{Ending, NodeError};
pub use host::set_form;
pub use intern::forever;
pub use message::{Form, Input, Item, Output, RECEIVER_OFF, SLEEPS_ON, WATCHDOG_RESET};
pub use process::last_words;
pub use spec::{
    Drive, NUMBERS_MAX, NodePort, NodeSpec, PATIENCE, Quantity, Role, format_of, line_of,
};

/// The version of the contract that this crate implements.
pub const VERSION: u64 = 1;
