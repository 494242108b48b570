//! Unusable parts of a log with their positions: counted by kind; the first ones are reported.

use core::fmt;
use std::collections::BTreeMap;

/// The reason why a part of a log is skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A message cannot be parsed.
    Unreadable,
    /// The file ends within a message.
    Cut,
    /// A chunk, page or file of a recording is damaged or missing.
    Part,
    /// A scan has no return.
    Blind,
    /// A scan is older than the previous one.
    Backwards,
    /// A scan or pose is NaN, or at an implausible distance.
    Absurd,
}

impl Kind {
    /// The kind in words.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Unreadable => "unreadable messages",
            Self::Cut => "cut-off messages",
            Self::Part => "parts of the recording that are damaged or missing",
            Self::Blind => "scans without a return",
            Self::Backwards => "scans older than the one before",
            Self::Absurd => "messages with impossible numbers",
        }
    }
}

/// Maximum number of findings that are reported in words; the others are only counted.
const TOLD_MAX: usize = 10;

/// All findings of a log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Findings {
    counts: BTreeMap<Kind, u64>,
    told: Vec<String>,
    /// Number of single readings that are NaN or negative.
    pub absurd_readings: u64,
}

impl Findings {
    /// Records a finding; `place` is a line or an offset, e.g. "line 12".
    pub fn add(&mut self, kind: Kind, place: fmt::Arguments<'_>, what: fmt::Arguments<'_>) {
        *self.counts.entry(kind).or_default() += 1;
        if self.told.len() < TOLD_MAX {
            self.told.push(format!("{place}: {what}"));
        }
    }

    /// Adds the findings of another part.
    pub fn extend(&mut self, other: Self) {
        for (kind, count) in other.counts {
            *self.counts.entry(kind).or_default() += count;
        }
        let room = TOLD_MAX.saturating_sub(self.told.len());
        self.told.extend(other.told.into_iter().take(room));
        self.absurd_readings += other.absurd_readings;
    }

    /// The number of findings of this kind.
    pub fn count(&self, kind: Kind) -> u64 {
        self.counts.get(&kind).copied().unwrap_or(0)
    }

    /// The first findings, as sentences with their positions.
    pub fn told(&self) -> &[String] {
        &self.told
    }

    /// The numbers of findings by kind.
    pub fn counts(&self) -> impl Iterator<Item = (Kind, u64)> + '_ {
        self.counts.iter().map(|(kind, count)| (*kind, *count))
    }
}
