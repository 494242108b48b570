//! Fuzzing of a foreign program or board, through its ports.
//!
//! ```text
//!  scenario --> devices + faults --+
//!                                  +--> ports --> the program, a process of its own
//!  seed -----> raw traffic --------+                 |
//!              on one link                           v
//!  finding <-- smaller case <-- cause <-- ends, is silent, breaks a rule, accepts damage
//! ```
//!
//! A *case* is the complete input of the program as a value: a scenario with faults in the data
//! that the program receives, or raw traffic on one link instead of a device's. The same seed gives
//! the same case.
//!
//! In virtual time the program's behaviour is reproducible; in real time it is not. Therefore the
//! verdict needs no exact times and has generous limits: whether the program is alive, whether a
//! device reports a violation, and whether the program answers a damaged frame like the intact one.
//!
//! The last check is an experiment. The fuzzer selects a frame that gets the same answer twice,
//! while noise does not get that answer. It damages the frame so that it is not a valid frame of
//! the format. A program that still answers it has not verified the checksum.

mod answers;
mod case;
mod cause;
mod compare;
mod constants;
mod coverage;
mod damage;
pub mod device;
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
mod replies;
mod restart;
mod search;
mod session;
mod speech;
mod traffic;
mod trial;
mod wiring;

pub use crate::learn::{Corpus, CorpusError};
pub use case::{Answered, Case, Damage, Exchange, Hex, Kind, Known, Pair, Raw, Told, Turn};
pub use cause::Cause;
pub use coverage::{RUNTIME, Reached};
pub use errors::ErrorRule;
pub use finding::{Finding, Kept, State};
pub use guide::Guide;
pub use harness::{Harness, HarnessError, Spent, Whose};
pub use plan::{GivenUp, Progress, TrialPlan};
pub use probe::Probed;
pub use replies::Held;
pub use search::Search;
pub use speech::{Shape, Speech};
pub use trial::{TrialOutcome, run};
