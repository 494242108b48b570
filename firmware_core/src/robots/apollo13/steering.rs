//! Steering values and motor levels of the car's board, with their angles and speeds.
//!
//! Facts: seed 003, table of 101 angles measured at 11 values; -50 is hard left, 0 is 6 degrees to
//! the left, straight ahead lies between 7 and 8. Speeds: level 2 is 0.22 m/s, -3 is -0.22 m/s;
//! thresholds of the published code's later state.

/// Steering value for almost straight driving, 0.4 degrees to the right.
pub const STRAIGHT: i8 = 8;
/// The largest steering value in either direction.
pub const STEERING_MAX: i8 = 50;

/// Angles measured at -50, -40, .. 50: degrees, to the left positive.
const MEASURED_DEG: [f64; 11] = [
    25.0, 21.0, 17.0, 12.0, 9.0, 6.0, -2.0, -5.0, -9.0, -13.0, -18.0,
];

/// Angle of the front wheels at a steering value, degrees, to the left positive; values beyond the
/// ends give the angle of the end.
pub fn angle_deg(value: i8) -> f64 {
    let along = f64::from(value.clamp(-STEERING_MAX, STEERING_MAX) + STEERING_MAX) / 10.0;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "0 to 10"
    )]
    let index = (along as usize).min(MEASURED_DEG.len() - 2);
    let part = along - index as f64;
    MEASURED_DEG[index] + part * (MEASURED_DEG[index + 1] - MEASURED_DEG[index])
}

/// The steering value with the nearest angle; `None` for not-a-number. (The fielded search takes
/// the next one to the right, and returns no result for not-a-number.)
pub fn value_for(angle_deg_wanted: f64) -> Option<i8> {
    let off = |value: &i8| (angle_deg(*value) - angle_deg_wanted).abs();
    let values = -STEERING_MAX..=STEERING_MAX;
    let nearest = values.min_by(|one, other| off(one).total_cmp(&off(other)));
    nearest.filter(|_| !angle_deg_wanted.is_nan())
}

/// Motor level for a speed, m/s: the smallest with about that speed. Backwards, level 3 drives 0.22
/// m/s (report). The published code takes level 4 from 0.15 m/s on, which drives 0.35 m/s: at that
/// speed the encoder loses counts, and the car its position.
pub fn level_for(speed_m_s: f64) -> i8 {
    match speed_m_s {
        speed if speed > 0.0 && speed < 0.15 => 1,
        speed if speed > 0.0 && speed < 0.28 => 2,
        speed if speed > 0.0 => 3,
        speed if speed < 0.0 && speed > -0.28 => -3,
        speed if speed < 0.0 => -4,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// AP5: the values of the seed's table, which fall everywhere.
    #[test]
    fn ap5_the_angles_are_those_of_the_report() {
        let near = |value: i8, expected: f64| {
            assert!(
                (angle_deg(value) - expected).abs() < 1e-9,
                "{value}: {}",
                angle_deg(value)
            );
        };
        for (value, expected) in
            (-50..=-41).zip([25.0, 24.6, 24.2, 23.8, 23.4, 23.0, 22.6, 22.2, 21.8, 21.4])
        {
            near(value, expected);
        }
        for (value, expected) in
            (0..=10).zip([6.0, 5.2, 4.4, 3.6, 2.8, 2.0, 1.2, 0.4, -0.4, -1.2, -2.0])
        {
            near(value, expected);
        }
        for (value, expected) in (40..=50).zip([
            -13.0, -13.5, -14.0, -14.5, -15.0, -15.5, -16.0, -16.5, -17.0, -17.5, -18.0,
        ]) {
            near(value, expected);
        }
        near(-19, 11.7);
        near(31, -9.4);
        near(i8::MAX, -18.0);
        near(i8::MIN, 25.0);
        assert!((-50..50).all(|value| angle_deg(value) > angle_deg(value + 1)));
    }

    /// AP5: the inverse gives back each value, and is off by half the widest step at most.
    #[test]
    fn ap5_the_nearest_value_is_found() {
        assert!((-50..=50).all(|value| value_for(angle_deg(value)) == Some(value)));
        for tenths in -180..=250 {
            let wanted = f64::from(tenths) / 10.0;
            let off = (angle_deg(value_for(wanted).unwrap()) - wanted).abs();
            assert!(off <= 0.4 + 1e-9, "{wanted}: {off}");
        }
        assert_eq!(value_for(90.0), Some(-50));
        assert_eq!(value_for(-90.0), Some(50));
        assert_eq!(value_for(f64::NAN), None);
        assert_eq!(value_for(-0.4), Some(STRAIGHT));
    }

    #[test]
    fn levels_are_those_of_the_published_code() {
        let speeds = [
            0.0,
            0.1,
            0.15,
            0.22,
            0.28,
            1.0,
            -0.1,
            -0.22,
            -0.28,
            -0.35,
            f64::NAN,
        ];
        assert_eq!(speeds.map(level_for), [0, 1, 2, 2, 3, 3, -3, -3, -4, -4, 0]);
    }
}
