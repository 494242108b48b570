//! What of a log could not be used, and where: counted by kind, the first ones told.

use core::fmt;
use std::collections::BTreeMap;

/// Why something of a log is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A message that cannot be read.
    Unreadable,
    /// The file ends in the middle of a message.
    Cut,
    /// A chunk, a page or a file of a recording that is damaged or missing.
    Part,
    /// A scan without a single return.
    Blind,
    /// A scan older than the one before it.
    Backwards,
    /// A scan or pose that is not a number, or farther than any robot drives.
    Absurd,
}

impl Kind {
    /// In words.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Unreadable => "unreadable messages",
            Self::Cut => "cut-off messages",
            Self::Part => "parts of the recording that are damaged or missing",
            Self::Blind => "scans without a return",
            Self::Backwards => "scans older than the one before",
            Self::Absurd => "messages with absurd numbers",
        }
    }
}

/// Findings that are reported in words; the others are only counted.
const TOLD_MAX: usize = 10;

/// All findings of a log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Findings {
    counts: BTreeMap<Kind, u64>,
    told: Vec<String>,
    /// Single readings that were not a number or negative.
    pub absurd_readings: u64,
}

impl Findings {
    /// Notes one; `place` is a line or an offset, e.g. "line 12".
    pub fn add(&mut self, kind: Kind, place: fmt::Arguments<'_>, what: fmt::Arguments<'_>) {
        *self.counts.entry(kind).or_default() += 1;
        if self.told.len() < TOLD_MAX {
            self.told.push(format!("{place}: {what}"));
        }
    }

    /// Takes over what was found elsewhere.
    pub fn extend(&mut self, other: Self) {
        for (kind, count) in other.counts {
            *self.counts.entry(kind).or_default() += count;
        }
        let room = TOLD_MAX.saturating_sub(self.told.len());
        self.told.extend(other.told.into_iter().take(room));
        self.absurd_readings += other.absurd_readings;
    }

    /// How often something of this kind was found.
    pub fn count(&self, kind: Kind) -> u64 {
        self.counts.get(&kind).copied().unwrap_or(0)
    }

    /// The first ones, as sentences with their place.
    pub fn told(&self) -> &[String] {
        &self.told
    }

    /// Kinds and numbers of all.
    pub fn counts(&self) -> impl Iterator<Item = (Kind, u64)> + '_ {
        self.counts.iter().map(|(kind, count)| (*kind, *count))
    }
}
