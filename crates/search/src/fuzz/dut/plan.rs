//! The plan of a search, and its progress.

use core::cell::Cell;
use core::time::Duration;
use std::path::PathBuf;
use std::sync::Arc;

use description::Description;

use crate::learn::Corpus;
use engine::scenario::Scenario;

/// The plan of a search.
#[derive(Clone, Debug)]
pub struct TrialPlan {
    /// World and devices.
    pub scenario: Scenario,
    /// Frames and conversations to learn from, in addition to the program's own.
    pub corpus: Option<Corpus>,
    /// Descriptions of the devices, by link, in the order of the scenario; one without a link is
    /// for any link.
    pub descriptions: Vec<(Option<String>, Arc<Description>)>,
    /// The link to be fuzzed with raw traffic; none: faults on all links, and raw traffic on each
    /// link in turn.
    pub link: Option<String>,
    /// Seed of all random choices.
    pub seed: u64,
    /// Length of a case.
    pub lasting: Duration,
    /// Maximum number of tries that minimise a finding.
    pub tries: u32,
    /// Folder of the results.
    pub out: PathBuf,
    /// The command that repeats a finding, without its folder.
    pub repeat: String,
}

/// Progress of a search, for the callback that decides whether it continues.
#[derive(Debug, Default)]
pub struct Progress {
    /// Number of cases since the search was started or continued.
    pub cases: Cell<u64>,
    /// Number of causes found, with those of earlier searches.
    pub findings: Cell<usize>,
    /// Number of inputs: frames, lines, turns of a conversation.
    pub inputs: Cell<u64>,
    /// Whether the program has sent any byte in one of these cases.
    pub has_spoken: Cell<bool>,
    /// Number of tries that confirm and minimise a finding; 0 while there is none.
    pub tries: Cell<u32>,
}

/// Captures of the last case, and of the last confirmation.
pub(super) const RECORDINGS: [&str; 3] = [".last.pcapng", ".copy.pcapng", ".again.pcapng"];

/// The conversations that the program ended by itself.
#[derive(Clone, Copy, Debug, Default)]
pub struct GivenUp {
    /// Number of these conversations.
    pub cases: u64,
    /// Number of their inputs.
    pub inputs: u64,
}

impl GivenUp {
    /// Number of inputs of a conversation that does not end early.
    pub const INPUTS_MAX: usize = 100;
}
