//! Fuzzing of a foreign program or board, through its ports.
//!
//! ```text
//!  scenario --> devices + faults --+
//!                                  +--> ports --> the program, a process of its own
//!  seed -----> raw traffic --------+                 |
//!              on one link                           v
//!  finding <-- smaller case <-- cause <-- ends, says nothing, breaks a rule, takes what is damaged
//! ```
//!
//! A *case* is what the program is told, as a value: a scenario with faults in what the program
//! receives, or traffic on one link in place of a device's. It is the same for the same seed. What
//! the program does is the same in virtual time; else it is not, as it lives in the time of the
//! wall clock. So it is judged by what needs no exact time, and with generous limits: whether it
//! lives, whether a device calls what it does against the rules, whether it answers a damaged
//! frame as it answers the sound one. The last one needs an experiment. The fuzzer picks a frame
//! that gets the same answer twice, while noise does not get that answer. It damages the frame so
//! that it is no valid frame of the format. A program that still answers it has not checked its
//! checksum.

mod case;
mod cause;
mod compare;
mod coverage;
mod dialogue;
mod errors;
mod finding;
mod found;
mod guide;
mod harness;
mod learn;
mod message;
mod plan;
mod player;
mod probe;
mod search;
mod session;
mod speech;
mod traffic;
mod trial;
mod wiring;

pub use crate::learn::{Corpus, CorpusError};
pub use case::{Answered, Case, Exchange, Hex, Known, Pair, Raw, Told, Turn};
pub use cause::Cause;
pub use coverage::{RUNTIME, Reached};
pub use errors::ErrorRule;
pub use finding::{Finding, Kept, State};
pub use guide::Guide;
pub use harness::{Harness, HarnessError, Spent, Whose};
pub use plan::{Progress, TrialPlan};
pub use probe::Probed;
pub use search::Search;
pub use speech::{Shape, Speech};
pub use trial::{TrialOutcome, run};
