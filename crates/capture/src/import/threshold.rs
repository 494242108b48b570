//! Conversion of voltages to levels.

use super::uart::Levels;

/// Minimum difference of the two levels, volts.
const SWING_MIN: f64 = 0.5;

/// Levels of a line from its voltage: high above 60 % of the voltage swing, low below 40 %. `None`
/// if the swing is too small.
pub(super) fn digital(samples: &[(u64, f64)]) -> Option<Levels> {
    let mut volts: Vec<f64> = samples.iter().map(|(_, volts)| *volts).collect();
    volts.sort_by(f64::total_cmp);
    // A few samples may overshoot.
    let edge = volts.len() / 100;
    let (low, high) = (*volts.get(edge)?, *volts.get(volts.len() - 1 - edge)?);
    if !(high - low).is_finite() || high - low < SWING_MIN {
        return None;
    }
    let (below, above) = (low + 0.4 * (high - low), low + 0.6 * (high - low));
    let first = samples.first().is_some_and(|(_, volts)| *volts > below);
    let mut levels = Levels {
        first,
        ..Levels::default()
    };
    let mut level = first;
    for &(at, volts) in samples {
        level = if level { volts > below } else { volts > above };
        levels.set(at, level);
    }
    Some(levels)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0 and 3.3 V: the level changes above 1.98 V upwards and below 1.32 V downwards.
    #[test]
    fn noise_between_the_thresholds_changes_nothing() {
        let volts = [3.3, 3.2, 1.5, 1.4, 0.1, 1.9, 0.0, 2.1, 3.3, 3.3];
        let samples: Vec<(u64, f64)> = (0..).zip(volts).collect();
        let levels = digital(&samples).expect("it swings");
        assert_eq!((levels.first, &levels.changes[..]), (true, &[4, 7][..]));
        assert_eq!(digital(&[(0, 3.3), (1, 3.2)]), None);
        assert_eq!(digital(&[]), None);
    }

    fn samples(volts: &[f64]) -> Vec<(u64, f64)> {
        (0..).zip(volts.iter().copied()).collect()
    }

    /// 1 and 11 V: the level falls at 5 V and rises above 7 V. A first sample at 5 V is low.
    #[test]
    fn a_voltage_at_a_threshold_is_low() {
        let levels = digital(&samples(&[5.0, 7.0, 7.5, 5.5, 5.0, 11.0, 1.0])).expect("it swings");
        assert_eq!(
            (levels.first, &levels.changes[..]),
            (false, &[2, 4, 5, 6][..])
        );
        let levels = digital(&samples(&[5.5, 7.0, 11.0, 1.0])).expect("it swings");
        assert_eq!((levels.first, &levels.changes[..]), (true, &[3][..]));
    }

    /// A swing of half a volt is a signal. Of 200 samples, two beyond each level are overshoots;
    /// three are a level.
    #[test]
    fn a_few_samples_may_overshoot() {
        assert!(digital(&samples(&[0.0, 0.5])).is_some());
        assert_eq!(digital(&samples(&[0.0, 0.49])), None);
        assert_eq!(digital(&samples(&[0.0, f64::INFINITY])), None);
        let levels = |overshoots: usize| {
            let (low, high) = (vec![0.0; 100 - overshoots], vec![1.0; 100 - overshoots]);
            let (below, above) = (vec![-100.0; overshoots], vec![100.0; overshoots]);
            digital(&samples(&[below, low, high, above].concat())).expect("it swings")
        };
        assert_eq!(levels(1).changes, [100]);
        assert_eq!(levels(2).changes, [100]);
        // Levels of -100 and 100 V: 0 and 1 V lie between the thresholds of -20 and 20 V.
        assert_eq!(levels(3).changes, [197]);
    }
}
