//! Subjects of the fuzzer: a subject creates a case from any bytes, runs it and judges it.

use std::path::Path;

use crate::shrink::Effort;
use engine::codec::wire::Broken;

/// A broken law.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// The law in kebab case; after an optional colon, words without figures that distinguish the
    /// ways to break it. Equal causes have equal words.
    pub cause: String,
    /// A sentence with the figures.
    pub detail: String,
}

impl Violation {
    /// `cause` with its figures.
    pub fn new(cause: impl Into<String>, detail: impl Into<String>) -> Self {
        Self {
            cause: cause.into(),
            detail: detail.into(),
        }
    }

    /// The name of the law.
    pub fn law(&self) -> &str {
        law(&self.cause)
    }
}

/// The name of the law in `cause`.
pub(super) fn law(cause: &str) -> &str {
    cause.split(':').next().unwrap_or_default()
}

impl From<Broken> for Violation {
    fn from(broken: Broken) -> Self {
        Self::new(broken.law, broken.detail)
    }
}

/// The behaviour of a case as marks: a mark that was never set before is new behaviour.
#[derive(Clone, Debug, Default)]
pub struct Behaviour {
    marks: Vec<u32>,
}

/// Number of different marks.
pub(super) const MARKS: u32 = 1 << 20;

impl Behaviour {
    /// Records that `what` happened. Different numbers count as different behaviour: pass counts
    /// and lengths as their [`size`].
    pub fn note(&mut self, what: &[u64]) {
        // FNV-1a over whole words, folded.
        let hash = what.iter().fold(0xCBF2_9CE4_8422_2325, |hash: u64, word| {
            (hash ^ word)
                .wrapping_mul(0x0000_0100_0000_01B3)
                .rotate_left(23)
        });
        let folded = (hash ^ (hash >> 20) ^ (hash >> 40)) % u64::from(MARKS);
        self.marks.push(u32::try_from(folded).expect("below 2^20"));
    }

    /// Records that the event `name` happened `count` times.
    pub fn named(&mut self, name: &str, count: u64) {
        let hash = name.bytes().fold(0, |hash: u64, byte| {
            hash.wrapping_mul(31).wrapping_add(u64::from(byte))
        });
        self.note(&[hash, size(count)]);
    }

    /// The recorded marks.
    pub(super) fn marks(&self) -> &[u32] {
        &self.marks
    }

    /// Removes all marks.
    pub(super) fn clear(&mut self) {
        self.marks.clear();
    }
}

/// The size of a number: its number of bits.
pub const fn size(number: u64) -> u64 {
    (u64::BITS - number.leading_zeros()) as u64
}

/// A finding, minimised as far as the effort allowed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kept {
    /// The violation of the minimised case.
    pub fault: Violation,
    /// Names and contents of its files; the first one is the case.
    pub files: Vec<(&'static str, Vec<u8>)>,
}

/// A target of the fuzzer that accepts any bytes.
pub trait Subject: Sync {
    /// The name on the command line and of the corpus folder.
    fn name(&self) -> &str;

    /// Number of cases that are run with the same pool: enough for a moment on a few processors.
    fn round(&self) -> u64;

    /// Maximum number of tries that minimise a finding.
    fn tries(&self) -> u32;

    /// Creates a case from `choices`, runs it, records its behaviour, and judges it. Any choices
    /// are valid, and equal choices create equal cases.
    ///
    /// # Errors
    /// The broken law.
    fn run(&self, choices: &[u8], behaviour: &mut Behaviour) -> Result<(), Violation>;

    /// Numbers of the active defects.
    fn defects(&self) -> &[String] {
        &[]
    }

    /// Initial choices.
    fn seeds(&self) -> Vec<Vec<u8>>;

    /// The case of `choices` as lines of readable text.
    fn in_words(&self, choices: &[u8]) -> String;

    /// Minimises the case of `choices` that broke a law.
    fn keep(&self, choices: &[u8], fault: &Violation, effort: &mut Effort<'_>) -> Kept;

    /// Name of the file that contains the case of a finding.
    fn case_file(&self) -> &'static str;

    /// The command that repeats the finding in the folder `dir`.
    fn repeat(&self, dir: &Path) -> String;

    /// Choices that create the case in `text`, if they can be reconstructed.
    ///
    /// # Errors
    /// A message about the error in `text`.
    fn choices_of(&self, text: &str) -> Result<Option<Vec<u8>>, String>;

    /// Runs and judges the case in `text`.
    ///
    /// # Errors
    /// A message about the error in `text`.
    fn repeated(&self, text: &str) -> Result<Result<(), Violation>, String>;
}
