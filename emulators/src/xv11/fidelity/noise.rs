//! Repeatability: how much a beam's distance differs from one turn to the next.

use std::collections::BTreeMap;

/// Width of a class of distances below one metre; beyond it is ten times as much.
pub const BIN_MM: u16 = 100;
/// Differences beyond these many millimetres plus a part of the square of the distance are motion
/// in the scene, not noise.
const MOTION_MM: f64 = 1.5;
const MOTION_PER_MM2: f64 = 1.2e-5;
/// Differences that a class needs to be worth a figure.
const PAIRS_MIN: u64 = 300;

/// One class of distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    /// Least distance of the class, millimetres.
    pub from_mm: u16,
    /// Differences it holds.
    pub pairs: u64,
    /// Standard deviation of a distance, rounding included: that of the differences over root two.
    pub sigma_mm: f64,
}

/// Differences of successive turns, by distance.
#[derive(Debug, Default)]
pub(super) struct Repeats {
    last: BTreeMap<usize, u16>,
    /// Count and sum of squared differences.
    bins: BTreeMap<u16, (u64, f64)>,
}

impl Repeats {
    /// No distance at this angle in this turn.
    pub(super) fn gap(&mut self, degree: usize) {
        self.last.remove(&degree);
    }

    pub(super) fn range(&mut self, degree: usize, distance_mm: u16) {
        let Some(before) = self.last.insert(degree, distance_mm) else {
            return;
        };
        let mm = f64::from(distance_mm);
        let difference = mm - f64::from(before);
        if difference.abs() > MOTION_MM + MOTION_PER_MM2 * mm * mm {
            return;
        }
        let width = if distance_mm < 1_000 {
            BIN_MM
        } else {
            10 * BIN_MM
        };
        let (count, squares) = self.bins.entry(distance_mm / width * width).or_default();
        *count += 1;
        *squares += difference * difference;
    }

    pub(super) fn bins(&self) -> Vec<Bin> {
        let full = self
            .bins
            .iter()
            .filter(|(_, (count, _))| *count >= PAIRS_MIN);
        full.map(|(&from_mm, &(pairs, squares))| {
            #[expect(clippy::cast_precision_loss, reason = "counts are below 2^53")]
            let variance = squares / (2.0 * pairs as f64);
            Bin {
                from_mm,
                pairs,
                sigma_mm: variance.sqrt(),
            }
        })
        .collect()
    }
}
