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
}
