//! What a search is about, and how far it is.

use core::cell::Cell;
use core::time::Duration;
use std::path::PathBuf;
use std::sync::Arc;

use description::Description;

use crate::learn::Corpus;
use engine::scenario::Scenario;

/// What is searched for, and how.
#[derive(Clone, Debug)]
pub struct TrialPlan {
    /// World and devices.
    pub scenario: Scenario,
    /// Frames and conversations to learn from, besides the program's own.
    pub corpus: Option<Corpus>,
    /// Descriptions of the devices on links, by the link; one without a link is of any.
    pub descriptions: Vec<(Option<String>, Arc<Description>)>,
    /// The one link to be fuzzed with raw traffic; none: faults everywhere, and each link in turn.
    pub link: Option<String>,
    /// Chooses everything.
    pub seed: u64,
    /// Length of a case.
    pub lasting: Duration,
    /// Most tries to make a finding smaller.
    pub tries: u32,
    /// Folder of the results.
    pub out: PathBuf,
    /// The command that repeats a finding, up to its folder.
    pub repeat: String,
}

/// Progress of a search, for the callback that decides whether it continues.
#[derive(Debug, Default)]
pub struct Progress {
    /// Cases since it was begun or gone on with.
    pub cases: Cell<u64>,
    /// Causes found, those of earlier searches counted.
    pub findings: Cell<usize>,
    /// What was said to the program: frames, lines, turns of a conversation.
    pub inputs: Cell<u64>,
    /// Tries to see a finding again and to make it smaller; 0 while none is.
    pub tries: Cell<u32>,
}

/// Captures of the last case, and of the last try to see one again.
pub(super) const RECORDINGS: [&str; 3] = [".last.pcapng", ".copy.pcapng", ".again.pcapng"];
