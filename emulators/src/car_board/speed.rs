//! From the motor level on the wire to the speed of the car.

use protocols::car_board::Level;

/// Speeds of the levels from 0 on, and from 0 down, m/s. 2 and -3 are measured (report); later
/// software of the car drove 3 and -4; the others are guesses. -1 and -2 do not move the car.
const FORWARD_M_S: [f64; 4] = [0.0, 0.11, 0.22, 0.35];
const BACKWARD_M_S: [f64; 5] = [0.0, 0.0, 0.0, -0.22, -0.35];
/// Speed at level 10, and backwards at -10: a guess. Between the last known level and it speed is
/// linear.
pub const FULL_SPEED_M_S: f64 = 1.2;

/// Speed that a level leads to, m/s; the car gets there with a lag.
pub fn speed_m_s(level: Level) -> f64 {
    let (known, full) = match level.get() {
        0.. => (&FORWARD_M_S[..], FULL_SPEED_M_S),
        _ => (&BACKWARD_M_S[..], -FULL_SPEED_M_S),
    };
    let steps = level.get().unsigned_abs();
    if let Some(speed) = known.get(usize::from(steps)) {
        return *speed;
    }
    let last = u8::try_from(known.len() - 1).unwrap_or_default();
    let from = known[usize::from(last)];
    from + (full - from) * f64::from(steps - last) / f64::from(10 - last)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels beyond the measured ones lie on a straight line: 0.35 + (1.2 - 0.35) * 4 / 7 is
    /// 0.835714 m/s, and -0.35 - 0.85 * 3 / 6 is -0.775 m/s.
    #[test]
    fn levels_are_the_measured_ones_and_straight_beyond() {
        for (level, speed) in [
            (0, 0.0),
            (1, 0.11),
            (2, 0.22),
            (3, 0.35),
            (7, 0.835_714),
            (10, 1.2),
            (-1, 0.0),
            (-2, 0.0),
            (-3, -0.22),
            (-4, -0.35),
            (-7, -0.775),
            (-10, -1.2),
        ] {
            let found = speed_m_s(Level::new(level).unwrap());
            assert!((found - speed).abs() < 1e-6, "{level}: {found}");
        }
    }
}
