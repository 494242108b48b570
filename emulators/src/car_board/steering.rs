//! From the steering value on the wire to the angle of the front wheels.

use protocols::car_board::Steering;

/// Angles measured at the values -50, -40, .. 50: degrees, counter-clockwise, so left is positive.
/// Between them the table of the car's software is linear. Source: report, chapter 3.
const MEASURED_DEG: [f64; 11] = [
    25.0, 21.0, 17.0, 12.0, 9.0, 6.0, -2.0, -5.0, -9.0, -13.0, -18.0,
];
/// Values from one measured angle to the next.
const SPACING: usize = 10;

/// Angle of the wheels for a steering value, degrees, left is positive. Value 0 is 6 degrees to the
/// left; straight ahead lies between 7 and 8.
pub fn angle_deg(steering: Steering) -> f64 {
    let index = usize::from(steering.get().abs_diff(Steering::RANGE[0]));
    let (place, part) = (index / SPACING, index % SPACING);
    let from = MEASURED_DEG[place];
    let to = MEASURED_DEG.get(place + 1).copied().unwrap_or(from);
    let part = f64::from(u8::try_from(part).unwrap_or_default());
    from + (to - from) * part / 10.0
}

/// The steering value with the nearest angle; an angle beyond the table gives its end. `None` if
/// the angle is not a number.
pub fn nearest(angle_deg: f64) -> Option<Steering> {
    if angle_deg.is_nan() {
        return None;
    }
    // So that the ends are nearest to an infinite angle as well.
    let angle_deg = angle_deg.clamp(MEASURED_DEG[10], MEASURED_DEG[0]);
    // The angles fall, so the nearest value lies between two measured ones, or is one of them.
    let [least, _] = Steering::RANGE.map(i16::from);
    let mut spans = (least..).step_by(SPACING).zip(&MEASURED_DEG[1..]);
    let (first, _) = spans.find(|(_, end_deg)| **end_deg <= angle_deg)?;
    let values = (first..).take(SPACING + 1);
    let values = values.filter_map(|value| Steering::new(value).ok());
    let off = |value: Steering| (self::angle_deg(value) - angle_deg).abs();
    let values = values.map(|value| (value, off(value)));
    let nearest = values.min_by(|(_, one), (_, other)| one.total_cmp(other));
    nearest.map(|(value, _)| value)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table of the report, row by row.
    const TABLE: [f64; 101] = [
        25.0, 24.6, 24.2, 23.8, 23.4, 23.0, 22.6, 22.2, 21.8, 21.4, //
        21.0, 20.6, 20.2, 19.8, 19.4, 19.0, 18.6, 18.2, 17.8, 17.4, //
        17.0, 16.5, 16.0, 15.5, 15.0, 14.5, 14.0, 13.5, 13.0, 12.5, //
        12.0, 11.7, 11.4, 11.1, 10.8, 10.5, 10.2, 9.9, 9.6, 9.3, //
        9.0, 8.7, 8.4, 8.1, 7.8, 7.5, 7.2, 6.9, 6.6, 6.3, //
        6.0, 5.2, 4.4, 3.6, 2.8, 2.0, 1.2, 0.4, -0.4, -1.2, //
        -2.0, -2.3, -2.6, -2.9, -3.2, -3.5, -3.8, -4.1, -4.4, -4.7, //
        -5.0, -5.4, -5.8, -6.2, -6.6, -7.0, -7.4, -7.8, -8.2, -8.6, //
        -9.0, -9.4, -9.8, -10.2, -10.6, -11.0, -11.4, -11.8, -12.2, -12.6, //
        -13.0, -13.5, -14.0, -14.5, -15.0, -15.5, -16.0, -16.5, -17.0, -17.5, -18.0,
    ];

    fn values() -> impl Iterator<Item = Steering> {
        (-50..=50).map(|value| Steering::new(value).unwrap())
    }

    #[test]
    fn ap5_the_101_angles_are_those_of_the_report() {
        for (value, expected) in values().zip(TABLE) {
            assert!((angle_deg(value) - expected).abs() < 1e-9, "{value:?}");
        }
        assert!(values().is_sorted_by(|a, b| angle_deg(*a) > angle_deg(*b)));
    }

    #[test]
    fn ap5_the_nearest_value_of_an_angle_of_the_table_is_its_own() {
        for (value, angle) in values().zip(TABLE) {
            assert_eq!(nearest(angle), Some(value));
        }
    }

    /// The widest gap is 0.8 degrees, so no angle is farther than 0.4 from one of the table.
    #[test]
    fn ap5_any_angle_within_the_limits_is_met_to_four_tenths() {
        for tenths in -1_800..=2_500 {
            let angle = f64::from(tenths) / 100.0;
            let off = (angle_deg(nearest(angle).unwrap()) - angle).abs();
            assert!(off <= 0.4 + 1e-9, "{angle}: {off}");
        }
        assert_eq!(nearest(90.0).map(Steering::get), Some(-50));
        assert_eq!(nearest(f64::NEG_INFINITY).map(Steering::get), Some(50));
        assert_eq!(nearest(f64::NAN), None);
        let ahead = nearest(0.0).map(Steering::get);
        assert!(matches!(ahead, Some(7 | 8)), "{ahead:?}");
    }
}
