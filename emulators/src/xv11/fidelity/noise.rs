//! Repeatability: differences of a beam's distance from one turn to the next.

use std::collections::BTreeMap;

/// Width of a class of distances below one metre; beyond it classes are ten times as wide.
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
    /// Minimum distance of the class, millimetres.
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
    /// Notes that this turn has no distance at this angle.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// `pairs` differences at one angle, between two distances in turn.
    fn between(one: u16, other: u16, pairs: usize) -> Vec<Bin> {
        let mut repeats = Repeats::default();
        let in_turn = [one, other].into_iter().cycle();
        in_turn.take(pairs + 1).for_each(|mm| repeats.range(7, mm));
        repeats.bins()
    }

    /// Differences of 2 mm: the variance of one distance is half of 4. Fewer than 300 give no
    /// class.
    #[test]
    fn a_class_tells_the_deviation_of_one_distance() {
        assert_eq!(between(950, 952, 299), []);
        let sigma_mm = f64::sqrt(2.0);
        let bin = |from_mm, pairs| Bin {
            from_mm,
            pairs,
            sigma_mm,
        };
        assert_eq!(between(950, 952, 300), [bin(900, 300)]);
        assert_eq!(between(997, 999, 400), [bin(900, 400)]);
        assert_eq!(between(1000, 1002, 300), [bin(1000, 300)]);
        assert_eq!(between(1997, 1999, 300), [bin(1000, 300)]);
        assert_eq!(between(2000, 2002, 300), [bin(2000, 300)]);
        assert_eq!(between(998, 1000, 600), [bin(900, 300), bin(1000, 300)]);
    }

    /// The limit of a difference is 1.5 + 12 = 13.5 mm at 1 m and 1.5 + 48 = 49.5 mm at 2 m.
    #[test]
    fn what_differs_by_more_has_moved() {
        let pairs = |one, other| between(one, other, 300).first().map(|bin| bin.pairs);
        assert_eq!(pairs(1000, 1013), Some(300));
        assert_eq!(pairs(1000, 1014), None);
        assert_eq!(pairs(2000, 2049), Some(300));
        assert_eq!(pairs(2000, 2052), None);
    }

    /// Angles are compared with themselves, and only from one turn to the very next.
    #[test]
    fn a_gap_or_another_angle_is_no_pair() {
        let mut repeats = Repeats::default();
        for mm in [950, 952].into_iter().cycle().take(2000) {
            repeats.range(7, mm);
            repeats.gap(7);
        }
        (0..360).for_each(|degree| repeats.range(degree, 950));
        assert_eq!(repeats.bins(), []);
    }
}
