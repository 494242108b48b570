//! Verdict on a row: each band against the measured values.

use super::super::Plot;
use super::super::runs::Spread;
use super::{Band, Measured, Row};

/// Verdict on a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Each band has its share of the values.
    Reproduced,
    /// A band has less than its share.
    Differs,
    /// Each band has its share, but the values follow from the rig's own settings.
    ByConstruction,
    /// The rig cannot measure the row.
    Refused,
    /// The command was interrupted before this row.
    NotRun,
}

impl Verdict {
    /// Name for the user.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Reproduced => "reproduced",
            Self::Differs => "differs",
            Self::ByConstruction => "by construction",
            Self::Refused => "refused",
            Self::NotRun => "not run",
        }
    }
}

/// A band and our values.
#[derive(Clone, Debug)]
pub struct JudgedBand {
    /// The band.
    pub band: &'static Band,
    /// The values, one for each run; of a curve, its distance to the report's.
    pub values: Vec<f64>,
    /// Median and quartiles of the values.
    spread: Spread,
    /// Whether the band's share of the values lies inside.
    pub holds: bool,
}

impl JudgedBand {
    fn of(row: &'static Row, band: &'static Band, measured: &Measured) -> Self {
        let values = measured.values(&band.of).map(<[f64]>::to_vec);
        let values = values.unwrap_or_else(|| {
            let theirs = row.curves.iter().find(|curve| curve.name == band.of);
            let ours = measured.curve_of(&band.of);
            let apart = theirs
                .zip(ours)
                .map(|(theirs, ours)| distance(&theirs.points, ours));
            apart.into_iter().collect()
        });
        let is_inside = |value: &&f64| (band.least..=band.most).contains(*value);
        let spread = Spread::of(values.iter().copied());
        let inside = values.iter().filter(is_inside).count() as f64;
        let holds = !values.is_empty() && inside >= band.share * values.len() as f64;
        Self {
            band,
            values,
            spread,
            holds,
        }
    }

    /// Number of values inside the band.
    pub fn inside(&self) -> usize {
        let is_inside = |value: &&f64| (self.band.least..=self.band.most).contains(*value);
        self.values.iter().filter(is_inside).count()
    }

    /// The median; NaN without values.
    pub const fn median(&self) -> f64 {
        self.spread.median
    }

    /// Lower and upper quartile.
    pub const fn quartiles(&self) -> [f64; 2] {
        self.spread.quartiles
    }
}

/// Root mean square of the vertical distance between the report's points and our curve, within the
/// range of both; NaN if they share less than half of the report's points.
fn distance(theirs: &[[f64; 2]], ours: &[[f64; 2]]) -> f64 {
    let apart: Vec<f64> = theirs
        .iter()
        .filter_map(|[x, y]| Some(at(ours, *x)? - y))
        .collect();
    if apart.len() * 2 < theirs.len() || apart.is_empty() {
        return f64::NAN;
    }
    let squares: f64 = apart.iter().map(|y| y * y).sum();
    (squares / apart.len() as f64).sqrt()
}

/// The value of a curve at `x`, between its points; `None` outside.
fn at(curve: &[[f64; 2]], x: f64) -> Option<f64> {
    let pair = curve
        .windows(2)
        .find(|pair| pair[0][0] <= x && x <= pair[1][0]);
    if let Some(&[[x0, y0], [x1, y1]]) = pair {
        let part = if x1 > x0 { (x - x0) / (x1 - x0) } else { 0.0 };
        return Some(y0 + part * (y1 - y0));
    }
    let only = curve.iter().find(|[x0, _]| *x0 == x);
    only.map(|[_, y]| *y)
}

/// A judged row.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The row.
    pub row: &'static Row,
    /// The verdict.
    pub verdict: Verdict,
    /// Number of seeds.
    pub seeds: u64,
    /// The bands.
    pub bands: Vec<JudgedBand>,
    /// The report's curves over ours.
    pub plot: Option<Plot>,
}

impl Judged {
    pub(super) fn of(row: &'static Row, measured: &Measured, seeds: u64) -> Self {
        let bands = row.bands.iter();
        let bands: Vec<JudgedBand> = bands
            .map(|band| JudgedBand::of(row, band, measured))
            .collect();
        let holds = !bands.is_empty() && bands.iter().all(|band| band.holds);
        Self {
            row,
            verdict: match (holds, row.given) {
                (true, false) => Verdict::Reproduced,
                (true, true) => Verdict::ByConstruction,
                (false, _) => Verdict::Differs,
            },
            seeds,
            plot: Some(plot(row, measured, &bands)),
            bands,
        }
    }

    pub(super) const fn refused(row: &'static Row) -> Self {
        Self::without_run(row, Verdict::Refused)
    }

    const fn without_run(row: &'static Row, verdict: Verdict) -> Self {
        Self {
            row,
            verdict,
            seeds: 0,
            bands: Vec::new(),
            plot: None,
        }
    }

    /// A row that was not run: the command was interrupted before.
    pub const fn not_run(row: &'static Row) -> Self {
        Self::without_run(row, Verdict::NotRun)
    }

    /// Whether the verdict is the one that the row expects. A refused row and one that was not run
    /// promise nothing.
    pub fn is_as_expected(&self) -> bool {
        match self.verdict {
            Verdict::Reproduced | Verdict::ByConstruction => !self.row.differs,
            Verdict::Differs => self.row.differs,
            Verdict::Refused | Verdict::NotRun => true,
        }
    }

    /// Whether the row was measured with fewer seeds than a verdict needs.
    pub fn is_of_few_seeds(&self) -> bool {
        let is_measured = !matches!(self.verdict, Verdict::Refused | Verdict::NotRun);
        is_measured && self.seeds < super::SEEDS
    }

    /// Whether the row was to be reproduced and differs.
    pub fn is_lost(&self) -> bool {
        self.verdict == Verdict::Differs && !self.row.differs
    }
}

/// The report's curves and ours; without curves, the values of all runs within their bands.
fn plot(row: &Row, measured: &Measured, bands: &[JudgedBand]) -> Plot {
    let title = format!("{}, {}", row.report.name(), row.place);
    if let Some([x, y]) = &row.axes {
        let mut plot = Plot::new(title, [x, y]);
        for curve in &row.curves {
            let name = format!("report: {}", curve.name);
            plot = plot.points(name, curve.points.iter().copied());
        }
        for (name, curve) in &measured.curves {
            plot = plot.line(format!("rig: {name}"), curve.iter().copied());
        }
        return plot;
    }
    let count = bands.len() as f64;
    let axes = ["band", "place in the band (0 lower, 1 upper limit)"];
    let mut plot = Plot::new(title, axes)
        .line("lower limit", [[0.5, 0.0], [count + 0.5, 0.0]])
        .line("upper limit", [[0.5, 1.0], [count + 0.5, 1.0]]);
    for (index, judged) in (1..).zip(bands) {
        let Band { least, most, .. } = judged.band;
        // A count has no width.
        let width = if most > least { most - least } else { 1.0 };
        let place = |value: &f64| [f64::from(index), (value - least) / width];
        let values = judged.values.iter().map(place);
        plot = plot.points(format!("{index}: {}", judged.band.of), values);
    }
    plot
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points 2 and 4 above a line through 0 and 10: the mean square of their distances is 10.
    #[test]
    fn curves_are_as_far_apart_as_their_points() {
        let theirs = [[1.0, 12.0], [5.0, 54.0], [20.0, 0.0]];
        let ours = [[0.0, 0.0], [10.0, 100.0]];
        assert!((distance(&theirs[..2], &ours) - 10_f64.sqrt()).abs() < 1e-9);
        assert!(distance(&theirs[2..], &ours).is_nan());
        assert_eq!(at(&ours, 2.5), Some(25.0));
    }

    /// A band holds for its share of the runs; a value that is missing lies in no band.
    #[test]
    fn a_missing_value_lies_in_no_band() {
        let row = super::super::rows().iter();
        let row = row.clone().find(|row| !row.bands.is_empty()).expect("one");
        let band = &row.bands[0];
        let middle = f64::midpoint(band.least, band.most);
        let name: &'static str = Box::leak(band.of.clone().into_boxed_str());
        let judged = |values: &[f64]| {
            let mut measured = Measured::default();
            measured.value(name, values.iter().copied());
            JudgedBand::of(row, band, &measured).holds
        };
        assert!(judged(&[middle; 3]));
        let mut ten = [middle; 10];
        ten[0] = band.most + 1.0;
        assert_eq!(judged(&ten), band.share <= 0.9);
        ten[1] = f64::NAN;
        assert!(!judged(&ten));
        assert!(!judged(&[]) && !judged(&[f64::NAN]) && !judged(&[band.most + 1e9; 3]));
    }
}
