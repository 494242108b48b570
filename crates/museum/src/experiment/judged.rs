//! Figures, tables and measured statements of the reports, each judged against the rig.
//!
//! ```text
//! data/reports.toml --> rows --+
//!                              +--> bands --> verdict, plot, page
//! measure --seeds--> values ---+
//! ```
//!
//! The file holds the reports' values and the bands. The source of a band is the scatter of the
//! report's own figure or a stated physical reason, never our result. A planted change of the
//! model proves each row, not each band: with it, the verdict is the other one. An open row has
//! no such change yet.

mod measures;
mod page;
mod rows;
mod verdict;

use core::fmt;
use std::collections::BTreeMap;

pub use measures::{MEASURES, Measure, Model};
pub use page::{html, markdown, static_part};
pub use rows::{Band, Curve, Report, Row, rows};
pub use verdict::{Judged, JudgedBand, Verdict};

use super::Plan;

/// Number of seeds of each row.
pub const SEEDS: u64 = 10;

/// Results of a measure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    values: BTreeMap<&'static str, Vec<f64>>,
    curves: Vec<(&'static str, Vec<[f64; 2]>)>,
}

impl Measured {
    /// Adds the values of all runs; a run without the value has NaN, which lies in no band.
    pub(super) fn value(&mut self, name: &'static str, of: impl IntoIterator<Item = f64>) {
        self.values.entry(name).or_default().extend(of);
    }

    /// Adds a curve.
    pub(super) fn curve(&mut self, name: &'static str, of: impl IntoIterator<Item = [f64; 2]>) {
        self.curves.push((name, of.into_iter().collect()));
    }

    /// The values of this name.
    pub fn values(&self, name: &str) -> Option<&[f64]> {
        self.values.get(name).map(Vec::as_slice)
    }

    /// The curve of this name.
    pub fn curve_of(&self, name: &str) -> Option<&[[f64; 2]]> {
        let found = self.curves.iter().find(|(known, _)| *known == name);
        found.map(|(_, curve)| curve.as_slice())
    }
}

/// A row that does not exist.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownRow(pub String);

impl fmt::Display for UnknownRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let known: Vec<&str> = rows().iter().map(|row| row.name.as_str()).collect();
        write!(
            f,
            "unknown row \"{}\"; expected one of {}",
            self.0,
            known.join(", ")
        )
    }
}

impl core::error::Error for UnknownRow {}

/// The rows of these names, in the order of the file; all rows without names.
///
/// # Errors
/// If a name is unknown.
pub fn select(names: &[String]) -> Result<Vec<&'static Row>, UnknownRow> {
    for name in names {
        if !rows().iter().any(|row| row.name == *name) {
            return Err(UnknownRow(name.clone()));
        }
    }
    let is_wanted = |row: &&Row| names.is_empty() || names.contains(&row.name);
    Ok(rows().iter().filter(is_wanted).collect())
}

/// Progress of [`judge`]: the row, the number of finished runs of its measure, and of all its runs.
pub type Told<'a> = dyn Fn(&Row, usize, usize) + Sync + 'a;

/// Judges `rows` one after the other, and hands each to `done`. Rows with the same measure share
/// its runs.
pub fn judge(
    rows: &[&'static Row],
    plan: &Plan,
    model: Model,
    tell: &Told<'_>,
    done: &mut dyn FnMut(Judged),
) {
    let mut measured: BTreeMap<&str, Measured> = BTreeMap::new();
    for row in rows {
        let Some(measure) = row.measure() else {
            done(Judged::refused(row));
            continue;
        };
        let found = measured
            .entry(measure.name)
            .or_insert_with(|| (measure.perform)(plan, model, &|done, all| tell(row, done, all)));
        done(Judged::of(row, found, plan.seeds));
    }
}

/// Whether rows are missing, were interrupted, or have too few seeds for a verdict that counts.
pub fn is_partial(judged: &[Judged]) -> bool {
    let is_missing = |one: &Judged| one.verdict == Verdict::NotRun || one.is_of_few_seeds();
    judged.len() < rows().len() || judged.iter().any(is_missing)
}
