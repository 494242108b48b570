//! Node programs: processes in any language that play one node of a rig.
//!
//! ```text
//!   rig, virtual time                          process of any language
//!   NodeDevice --- Host --- request, answer --- four verbs: receive, poll, transmit, poll_at
//!                  one exchange covers all that arrived at one moment
//! ```
//!
//! The rig waits for each answer, so virtual time is exact and every run gives the same bytes.
//! `docs/nodes.md` is the contract.
//!
//! | module | is |
//! |---|---|
//! | [`message`] | requests, answers and their items |
//! | [`binary`], [`json`] | the two forms of a message |
//! | [`process`] | a process with pipes: started, written to, read, ended with all that it started |
//! | [`host`] | a node program behind the contract: greeting, exchanges, checks of each answer |
//! | [`device`] | a node program as a device of a rig |
//! | [`program`] | the other end, for node programs in Rust |
//! | [`conform`] | whether a program keeps the contract |

pub mod binary;
pub mod conform;
pub mod device;
mod error;
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
pub use message::{Form, Input, Item, Output};
pub use process::last_words;
pub use spec::{
    Drive, NUMBERS_MAX, NodePort, NodeSpec, PATIENCE, Quantity, Role, format_of, line_of,
};

/// The version of the contract that this crate speaks.
pub const VERSION: u64 = 1;
