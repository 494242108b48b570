//! Bytes that damaged or missing rows of a dump had.

use std::collections::BTreeMap;

use super::layout::Layout;
use super::lines::Row;
use crate::import::imported::ImportError;
use crate::import::text::Line;

/// Maximum share of damaged rows: one of this number.
const SHARE: usize = 4;
/// Maximum number of rows that may be missing at one place. A larger offset is damaged itself.
pub(super) const GAP_MAX: usize = 64;

/// The damage of a dump.
#[derive(Clone, Debug, Default)]
pub(super) struct Losses {
    are_counted: bool,
    /// Number of damaged rows, and of places with missing rows.
    pub(super) rows: usize,
    pub(super) bytes: usize,
    first: Option<ImportError>,
    /// The first row that was left out and is not counted yet: the gap behind it is.
    skipped: Option<ImportError>,
}

impl Losses {
    /// Damage is an error.
    pub(super) fn none() -> Self {
        Self::default()
    }

    /// Damage is counted.
    pub(super) fn counted() -> Self {
        Self {
            are_counted: true,
            ..Self::default()
        }
    }

    pub(super) const fn are_counted(&self) -> bool {
        self.are_counted
    }

    /// Counts a damaged row.
    ///
    /// # Errors
    /// `error`, if damage is an error.
    pub(super) fn take(&mut self, error: ImportError) -> Result<(), ImportError> {
        if !self.are_counted {
            return Err(error);
        }
        self.rows += 1;
        self.first.get_or_insert(error);
        Ok(())
    }

    /// Leaves a row out.
    ///
    /// # Errors
    /// As of [`take`](Self::take).
    pub(super) fn skip(&mut self, error: ImportError) -> Result<(), ImportError> {
        if !self.are_counted {
            return Err(error);
        }
        self.skipped.get_or_insert(error);
        Ok(())
    }

    /// Counts a place where rows are missing, or were left out.
    ///
    /// # Errors
    /// As of [`take`](Self::take).
    pub(super) fn gap(&mut self, error: ImportError) -> Result<(), ImportError> {
        let error = self.skipped.take().unwrap_or(error);
        self.take(error)
    }

    /// Counts rows that were left out without a gap behind them.
    ///
    /// # Errors
    /// As of [`take`](Self::take).
    pub(super) fn end(&mut self) -> Result<(), ImportError> {
        self.skipped.take().map_or(Ok(()), |error| self.take(error))
    }

    /// Whether few of `rows` are damaged: otherwise the text is no dump, or of another layout.
    pub(super) const fn are_few(&self, rows: usize) -> bool {
        self.rows * SHARE <= rows
    }

    pub(super) fn note(&self) -> Option<String> {
        let first = self.first.as_ref()?;
        let count = |count: usize, noun: &str| match count {
            1 => format!("1 {noun} is"),
            count => format!("{count} {noun}s are"),
        };
        let (rows, bytes) = (count(self.rows, "row"), count(self.bytes, "byte"));
        Some(format!(
            "{rows} damaged or missing, {bytes} lost; the first: {first}"
        ))
    }
}

/// The usual number of bytes in a row: the most frequent difference of successive offsets.
pub(super) fn stride(layout: Layout, rows: &[(Line<'_>, Row)]) -> usize {
    let offsets = rows.iter().filter_map(|(_, row)| match row {
        Row::At { offset, .. } => layout.offset(offset),
        _ => None,
    });
    let offsets: Vec<usize> = offsets.collect();
    let mut counts = BTreeMap::<usize, usize>::new();
    for pair in offsets.windows(2) {
        if let Some(step) = pair[1].checked_sub(pair[0]).filter(|step| *step > 0) {
            *counts.entry(step).or_default() += 1;
        }
    }
    // Of two as frequent ones the shorter one: the other is that of missing rows.
    let most = counts.iter().max_by(|a, b| a.1.cmp(b.1).then(b.0.cmp(a.0)));
    most.map_or(STRIDE, |(step, _)| *step)
}

/// Number of bytes in a row of most tools.
const STRIDE: usize = 16;
