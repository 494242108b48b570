//! What is fuzzed: something that makes a case of any bytes, runs it and judges it.

use std::path::Path;

use crate::shrink::Effort;
use engine::codec::wire::Broken;

/// A law that was broken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// The law in kebab case, and perhaps after a colon what sets one way of breaking it apart from
    /// others, without figures: the same cause has the same words.
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

    /// The law alone.
    pub fn law(&self) -> &str {
        law(&self.cause)
    }
}

/// The law in `cause`.
pub(super) fn law(cause: &str) -> &str {
    cause.split(':').next().unwrap_or_default()
}

impl From<Broken> for Violation {
    fn from(broken: Broken) -> Self {
        Self::new(broken.law, broken.detail)
    }
}

/// What a case brought about, as marks: a mark that was never set before is new behaviour.
#[derive(Clone, Debug, Default)]
pub struct Behaviour {
    marks: Vec<u32>,
}

/// Marks that are distinguished.
pub(super) const MARKS: u32 = 1 << 20;

impl Behaviour {
    /// Notes that `what` happened, where numbers are meant as they are: give counts and lengths as
    /// their [`size`].
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

    /// Notes that something called `name` happened, `count` times.
    pub fn named(&mut self, name: &str, count: u64) {
        let hash = name.bytes().fold(0, |hash: u64, byte| {
            hash.wrapping_mul(31).wrapping_add(u64::from(byte))
        });
        self.note(&[hash, size(count)]);
    }

    /// What was noted.
    pub(super) fn marks(&self) -> &[u32] {
        &self.marks
    }

    /// Forgets all.
    pub(super) fn clear(&mut self) {
        self.marks.clear();
    }
}

/// The size of a number: how many bits it has.
pub const fn size(number: u64) -> u64 {
    (u64::BITS - number.leading_zeros()) as u64
}

/// A finding, made as small as the effort allowed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kept {
    /// What is wrong with the small case.
    pub fault: Violation,
    /// Names and contents of its files; the first is the case itself.
    pub files: Vec<(&'static str, Vec<u8>)>,
}

/// A decoder that accepts any bytes.
pub trait Subject: Sync {
    /// Its name, as on the command line and of its folder in the corpus.
    fn name(&self) -> &str;

    /// How many cases are tried with the same pool: as many as take a moment on a few processors.
    fn round(&self) -> u64;

    /// How many tries making a finding small is worth.
    fn tries(&self) -> u32;

    /// Makes a case of `choices`, runs it, notes what it did, and judges it. Any choices mean
    /// something, and always the same.
    ///
    /// # Errors
    /// The law that was broken.
    fn run(&self, choices: &[u8], behaviour: &mut Behaviour) -> Result<(), Violation>;

    /// Numbers of the defects that were switched on in it.
    fn defects(&self) -> &[String] {
        &[]
    }

    /// Choices to begin with.
    fn seeds(&self) -> Vec<Vec<u8>>;

    /// The case that `choices` make, for people, as lines.
    fn in_words(&self, choices: &[u8]) -> String;

    /// Makes what `choices` do wrong small.
    fn keep(&self, choices: &[u8], fault: &Violation, effort: &mut Effort<'_>) -> Kept;

    /// Name of the file that holds the case of a finding.
    fn case_file(&self) -> &'static str;

    /// The command that repeats a finding in the folder `dir`.
    fn repeat(&self, dir: &Path) -> String;

    /// Choices that make the case that `text` describes, if there are such.
    ///
    /// # Errors
    /// A sentence on what in `text` is wrong.
    fn choices_of(&self, text: &str) -> Result<Option<Vec<u8>>, String>;

    /// Runs and judges the case that `text` describes.
    ///
    /// # Errors
    /// A sentence on what in `text` is wrong.
    fn repeated(&self, text: &str) -> Result<Result<(), Violation>, String>;
}
