//! The rows: figures that the reports publish, typed as numbers, and the bands.

use std::sync::OnceLock;

use serde::Deserialize;

use super::measures::{MEASURES, Measure};

const FILE: &str = include_str!("../../../data/reports.toml");

/// A report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Report {
    /// The rescue robot's, 2015.
    Rescue,
    /// The model car's, 2016.
    Car,
    /// Yellow's, 2019.
    Yellow,
}

impl Report {
    /// Name for the user.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rescue => "rescue robot",
            Self::Car => "model car",
            Self::Yellow => "Yellow",
        }
    }
}

/// A curve of a report.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Curve {
    /// Its name, the same as of our curve.
    pub name: String,
    /// The points.
    pub points: Vec<[f64; 2]>,
}

/// Limits of a value, or of the distance between two curves.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Band {
    /// Name of the measured value with its unit, or of a curve.
    pub of: String,
    /// The value in the report.
    pub report: String,
    /// Lower limit.
    pub least: f64,
    /// Upper limit.
    pub most: f64,
    /// Share of the runs that must lie inside, above 0 and at most 1.
    pub share: f64,
    /// Source of the limits.
    pub because: String,
}

/// A figure, table or measured statement of a report.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Its name.
    pub name: String,
    /// The report.
    pub report: Report,
    /// Figure and page, or page of the statement.
    pub place: String,
    /// Description of the figure or statement, a sentence.
    pub what: String,
    /// Axes of the report's figure with their units.
    #[serde(default)]
    pub axes: Option<[String; 2]>,
    /// Name of the measure.
    #[serde(default)]
    measure: Option<String>,
    /// Reason why the rig cannot measure the row.
    #[serde(default)]
    pub refused: Option<String>,
    /// Whether the rig is expected to differ from the report.
    #[serde(default)]
    pub differs: bool,
    /// Whether the row shows an error of the report. The note has the evidence.
    #[serde(default)]
    pub refuted: bool,
    /// Whether no change of the model was found with which the row has the other verdict.
    #[serde(default)]
    pub open: bool,
    /// Whether the values follow from the rig's own settings: the row is outside the count.
    #[serde(default)]
    pub given: bool,
    /// Explanation: why the rig differs, or how the row is measured.
    #[serde(default)]
    pub note: String,
    /// The report's curves.
    #[serde(default, rename = "curve")]
    pub curves: Vec<Curve>,
    /// The limits.
    #[serde(default, rename = "band")]
    pub bands: Vec<Band>,
}

impl Row {
    /// The measure; `None` if the row is refused.
    pub fn measure(&self) -> Option<&'static Measure> {
        let name = self.measure.as_deref()?;
        MEASURES.iter().find(|measure| measure.name == name)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    row: Vec<Row>,
}

/// All rows, in the order of the reports and their pages.
///
/// # Panics
/// Never: a test reads the file.
pub fn rows() -> &'static [Row] {
    static ROWS: OnceLock<Vec<Row>> = OnceLock::new();
    ROWS.get_or_init(|| {
        let file: File = toml::from_str(FILE).expect("a test reads the file");
        file.row
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// Every row has its own name, and either bands and a known measure, or the reason of its
    /// refusal. A row that differs says why.
    #[test]
    fn every_row_is_judged_or_refused() {
        let mut names = BTreeSet::new();
        for row in rows() {
            assert!(names.insert(&row.name), "{} stands twice", row.name);
            let is_measured = row.measure().is_some() && !row.bands.is_empty();
            assert_eq!(is_measured, row.refused.is_none(), "{}", row.name);
            assert_eq!(row.measure.is_some(), is_measured, "{}", row.name);
            assert!(!row.differs || row.note.len() > 100, "{}", row.name);
            assert!(!row.given || !row.note.is_empty(), "{}", row.name);
            assert!(!(row.given && row.differs), "{}", row.name);
            assert!(!row.open || row.differs, "{}", row.name);
            assert!(!row.refuted || row.differs && !row.open, "{}", row.name);
            for band in &row.bands {
                assert!(band.least <= band.most, "{}: {}", row.name, band.of);
                let needs_all = band.least == band.most || band.because == "All.";
                let is_share = band.share > 0.0 && band.share <= 1.0;
                assert!(is_share, "{}: {}", row.name, band.of);
                let promised = band.share == 1.0 || !needs_all || band.because.contains(" ten");
                assert!(promised, "{}: {}", row.name, band.of);
                assert!(!band.because.is_empty(), "{}: {}", row.name, band.of);
            }
            for curve in &row.curves {
                assert!(row.axes.is_some(), "{}: {}", row.name, curve.name);
                let xs = curve.points.windows(2).all(|pair| pair[0][0] < pair[1][0]);
                assert!(xs, "{}: {} goes back", row.name, curve.name);
            }
        }
    }

    /// No measure is without a row.
    #[test]
    fn every_measure_has_a_row() {
        for measure in MEASURES {
            let is_its = |row: &&Row| row.measure.as_deref() == Some(measure.name);
            assert!(rows().iter().find(is_its).is_some(), "{}", measure.name);
        }
    }
}
