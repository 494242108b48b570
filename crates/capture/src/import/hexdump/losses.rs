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
    /// Maximum number of damaged rows; `None` if damage is an error.
    most: Option<usize>,
    /// Number of damaged rows, and of places with missing rows.
    pub(super) rows: usize,
    /// Number of lost bytes, as far as offsets tell it.
    pub(super) bytes: usize,
    first: Option<ImportError>,
    /// Number of rows that were left out and are not counted yet, and the first error: the gap
    /// behind them counts once for all of its rows.
    skipped: usize,
    skipped_first: Option<ImportError>,
}

impl Losses {
    /// Damage is an error.
    pub(super) fn none() -> Self {
        Self::default()
    }

    /// Damage of few of `rows` is counted.
    pub(super) fn of_few(rows: usize) -> Self {
        Self {
            most: Some(rows / SHARE),
            ..Self::default()
        }
    }

    pub(super) const fn are_counted(&self) -> bool {
        self.most.is_some()
    }

    /// Counts a damaged row.
    ///
    /// # Errors
    /// `error`, if damage is an error, or if too many rows are damaged: the text is no dump, or has
    /// another layout.
    pub(super) fn take(&mut self, error: ImportError) -> Result<(), ImportError> {
        self.count(1, error)
    }

    fn count(&mut self, rows: usize, error: ImportError) -> Result<(), ImportError> {
        self.rows += rows;
        if self.most.is_none_or(|most| self.rows > most) {
            return Err(error);
        }
        self.first.get_or_insert(error);
        Ok(())
    }

    /// Leaves a row out.
    ///
    /// # Errors
    /// See [`take`](Self::take).
    pub(super) fn skip(&mut self, error: ImportError) -> Result<(), ImportError> {
        self.skipped += 1;
        if self.most.is_none_or(|most| self.rows + self.skipped > most) {
            return Err(error);
        }
        self.skipped_first.get_or_insert(error);
        Ok(())
    }

    /// Counts a place where rows are missing, or were left out.
    ///
    /// # Errors
    /// See [`take`](Self::take).
    pub(super) fn gap(&mut self, error: ImportError) -> Result<(), ImportError> {
        let rows = core::mem::take(&mut self.skipped).max(1);
        let error = self.skipped_first.take().unwrap_or(error);
        self.count(rows, error)
    }

    /// Counts rows that were left out without a gap behind them.
    ///
    /// # Errors
    /// See [`take`](Self::take).
    pub(super) fn end(&mut self) -> Result<(), ImportError> {
        let rows = core::mem::take(&mut self.skipped);
        let error = self.skipped_first.take();
        error.map_or(Ok(()), |error| self.count(rows, error))
    }

    pub(super) fn note(&self) -> Option<String> {
        let first = self.first.as_ref()?;
        let count = |count: usize, noun: &str| match count {
            1 => format!("1 {noun} is"),
            count => format!("{count} {noun}s are"),
        };
        let rows = count(self.rows, "row");
        let bytes = match self.bytes {
            0 => String::new(),
            bytes => format!(", {} lost", count(bytes, "byte")),
        };
        Some(format!(
            "{rows} damaged or missing{bytes}; the first: {first}"
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

#[cfg(test)]
mod tests {
    use super::*;

    fn error(words: &str) -> ImportError {
        ImportError::of_file(words)
    }

    fn counted(rows: usize) -> Losses {
        Losses::of_few(rows)
    }

    /// A quarter of the rows may be damaged.
    #[test]
    fn few_damaged_rows_are_counted() {
        let mut losses = counted(8);
        assert!(losses.are_counted() && losses.take(error("a")).is_ok());
        assert!(losses.take(error("b")).is_ok() && losses.take(error("c")).is_err());
        let mut none = Losses::none();
        assert!(!none.are_counted() && none.take(error("a")).is_err());
        assert!(Losses::none().skip(error("a")).is_err());
    }

    /// Rows that were left out count with the gap behind them, or at the end.
    #[test]
    fn rows_that_were_left_out_count_once() {
        let mut losses = counted(16);
        for words in ["first", "second"] {
            losses.skip(error(words)).expect("few");
        }
        losses.gap(error("gap")).expect("few");
        assert_eq!(losses.rows, 2);
        losses.gap(error("gap")).expect("few");
        assert_eq!(losses.rows, 3);
        losses.skip(error("third")).expect("few");
        assert!(losses.skip(error("fourth")).is_err());
        let note = losses.note().expect("some");
        assert!(
            note.starts_with("3 rows are damaged or missing; the first: "),
            "{note}"
        );
        assert!(note.ends_with("first"), "{note}");
        let mut at_end = counted(8);
        at_end.skip(error("only")).expect("few");
        at_end.bytes = 1;
        assert!(at_end.note().is_none() && at_end.end().is_ok() && at_end.end().is_ok());
        let note = at_end.note().expect("one");
        assert!(
            note.starts_with("1 row is damaged or missing, 1 byte is lost; "),
            "{note}"
        );
    }

    /// A row that was left out counts with those that are damaged.
    #[test]
    fn rows_left_out_are_added_to_damaged_ones() {
        let mut losses = counted(8);
        assert!(losses.take(error("a")).is_ok() && losses.skip(error("b")).is_ok());
        assert!(losses.skip(error("c")).is_err());
        let mut many = counted(12);
        assert!(many.skip(error("a")).is_ok() && many.skip(error("b")).is_ok());
        assert!(many.skip(error("c")).is_ok() && many.skip(error("d")).is_err());
    }

    /// Rows of 16 bytes, one of 8, and a gap; of two steps as frequent the shorter one.
    #[test]
    fn the_usual_step_is_the_most_frequent() {
        let stride = |text: &str| {
            let rows = super::super::lines::rows(text.as_bytes(), &mut Vec::new());
            let mut groups = super::super::layout::layouts(8);
            let [layout, ..] = groups.next().expect("pairs");
            stride(layout, &rows.expect("rows"))
        };
        let row = |at: usize| format!("{at:08x} 41 42\n");
        let text = |offsets: &[usize]| offsets.iter().map(|at| row(*at)).collect::<String>();
        assert_eq!(stride(&text(&[0, 16, 32, 40, 56])), 16);
        assert_eq!(stride(&text(&[0, 32, 40])), 8);
        assert_eq!(stride(&text(&[0, 32, 32, 16])), 32);
        assert_eq!(stride(&text(&[64])), STRIDE);
    }
}
