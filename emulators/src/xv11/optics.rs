//! Geometry of the sensor's optics, and the laws of its readings.
//!
//! Figures marked (A) are from the 2.4 "hand in box" capture, (B) from the 2.1 "no shield" ones.

use core::f64::consts::PI;

use super::{Detail, Profile};
use crate::lidar::Direction;

/// Geometry of the optics. No document gives it with certainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Angle of the first reading to the axis of the housing, degrees; the wiki says -10 or 0.
    pub index0_deg: f64,
    /// Distance between laser beam and axis, millimetres; reports say 0 to 25.
    pub beam_offset_mm: f64,
    /// Direction of rotation of the head.
    pub direction: Direction,
    /// Distance between laser and camera, millimetres. Before a near object that comes into view
    /// (A) and (B) show one to three readings without a dot: the camera, ahead of the beam in
    /// the sense of rotation, does not see the far dot past the near edge.
    pub baseline_mm: f64,
}

impl Default for Optics {
    fn default() -> Self {
        Self {
            index0_deg: 0.0,
            beam_offset_mm: 0.0,
            direction: Direction::CounterClockwise,
            baseline_mm: 38.0,
        }
    }
}

/// Beyond this there is no dot.
pub const RANGE_MAX_MM: f64 = 6_000.0;
/// Nearer than this the dot is too wide: the runs of 0x03 in (A) and (B) start and end at 144 to
/// 154 mm.
pub const RANGE_MIN_MM: f64 = 145.0;
/// No reading from here on carries the strength warning (A, B).
const WARNING_MAX_MM: f64 = 650.0;
/// Strength warning: below this strength at this distance (A, B).
const WARNING: [(f64, f64); 9] = [
    (160.0, 300.0),
    (200.0, 230.0),
    (240.0, 230.0),
    (300.0, 150.0),
    (340.0, 150.0),
    (400.0, 85.0),
    (460.0, 60.0),
    (540.0, 50.0),
    (WARNING_MAX_MM, 50.0),
];

/// Standard deviation of a range, millimetres, before rounding: 0.42 mm at 575 mm, growing with the
/// power 9/4. Fit over (A), 0.08 mm at 275 mm to 0.39 mm at 575 mm without the rounding to whole
/// millimetres, and over (B), 14.0 mm at 2721 mm and 19.6 mm at 3113 mm; extrapolated beyond.
pub fn range_sigma_mm(distance_mm: f64) -> f64 {
    let scaled = distance_mm * (1.0 / 575.0);
    0.42 * scaled * scaled * scaled.sqrt().sqrt()
}

/// Part of the law above that is the noise of the sensor. The rest is the surface: a beam with
/// angular jitter over a rough wall.
const SENSORS_PART: f64 = 0.75;

/// The same deviation, as (A) shows it from turn to turn. A distance that the noise moves by much
/// less than a millimetre changes in 1.128 sigma of the turns: 0.08 mm at 287 mm, 0.13 at 350, 0.17
/// at 412, 0.21 at 450, 0.30 at 510, 0.36 at 585.
fn range_sigma_captured_mm(distance_mm: f64) -> f64 {
    let near = 0.345 * libm::pow(distance_mm / 550.0, 1.7);
    near.max(SENSORS_PART * range_sigma_mm(distance_mm))
}

/// The same for firmware 2.1: a part of the distance and a part of its square. Where the wall faces
/// the sensor, (B) has 0.43 mm at 225 mm, 8.3 mm at 2.6 m, 9.1 mm at 2.85 m and 12.5 mm at 3.1 m.
/// That sensor turned by half a degree meanwhile, so slanting walls show more: its repeats over all
/// walls, 14.0 mm at 2721 mm and 19.6 mm at 3113 mm, are 1 / 0.62 of this.
fn range_sigma_captured_21_mm(distance_mm: f64) -> f64 {
    0.62 * ((0.002_73 + 8.9e-7 * distance_mm) * distance_mm)
}

/// Mean strength of a return from a white surface, 1.0e8 / d^2: fit over (A) and (B).
pub fn strength_mean(distance_mm: f64) -> f64 {
    1.0e8 / (distance_mm * distance_mm)
}

/// Standard deviation of a strength: 0.47 times its root. (A) has 1.3 % at 1100 and 2.8 % at 300.
pub fn strength_sigma(mean: f64) -> f64 {
    0.47 * mean.sqrt()
}

/// Standard deviation of a strength on a surface with speckle: the noise of a median point. (A) has
/// 0.50 times the root at 295, 0.43 at 520 and 0.38 at 900; (B) has 0.60 times the root at 27.
fn strength_sigma_captured(mean: f64) -> f64 {
    (0.44 * mean / (1.0 + mean / 500.0)).sqrt()
}

/// Angular jitter of a beam. A guess; it lets the dot fall on either side of an edge, and is small
/// enough to leave the noise of slanting walls to the range law.
const JITTER_RAD: f64 = 0.01 * PI / 180.0;
/// Angular jitter of a captured sensor: over 32 turns of (A) slanting walls have no more noise than
/// walls that face the sensor, and the scan turns by less than 0.006 degrees.
const JITTER_CAPTURED_RAD: f64 = 0.003 * PI / 180.0;
/// Odds that a wall spoils the dot for no visible reason, so that it is too wide: (A) outside of
/// hand and corners, and where all neighbours see the same wall (3 of 11,520).
const FLAW_TOO_WIDE: f64 = 7e-4;
const FLAW_TOO_WIDE_CAPTURED: f64 = 1e-4;
/// Odds that a wall makes the dot too dim for no visible reason.
const FLAW_TOO_DIM: f64 = 3e-4;
const FLAW_TOO_DIM_CAPTURED: f64 = 1.8e-4;

/// Noise: deviations of a range by its distance, millimetres, and of a strength by its mean.
#[derive(Clone, Copy, Debug)]
pub(super) struct Laws {
    pub(super) range_mm: fn(f64) -> f64,
    pub(super) strength: fn(f64) -> f64,
    /// Deviation of a beam's angle.
    pub(super) jitter_rad: f64,
    /// Odds of a dot that is too wide for no visible reason.
    pub(super) too_wide: f64,
    /// Odds of a dot that is too dim for no visible reason.
    pub(super) too_dim: f64,
}

impl Laws {
    /// With captured detail the noise of 2.1 differs; without it all units have the noise of 2.4.
    pub(super) fn of(profile: Profile, detail: Detail) -> Self {
        match (detail, profile) {
            (Detail::Even, _) => Self::EVEN,
            (Detail::Captured, Profile::Fw21) => Self::captured(range_sigma_captured_21_mm),
            (Detail::Captured, _) => Self::captured(range_sigma_captured_mm),
        }
    }

    /// Laws of even surfaces.
    pub(super) const EVEN: Self = Self {
        range_mm: range_sigma_mm,
        strength: strength_sigma,
        jitter_rad: JITTER_RAD,
        too_wide: FLAW_TOO_WIDE,
        too_dim: FLAW_TOO_DIM,
    };

    /// Laws of a captured sensor whose ranges have this deviation.
    const fn captured(range_mm: fn(f64) -> f64) -> Self {
        Self {
            range_mm,
            strength: strength_sigma_captured,
            jitter_rad: JITTER_CAPTURED_RAD,
            too_wide: FLAW_TOO_WIDE_CAPTURED,
            too_dim: FLAW_TOO_DIM_CAPTURED,
        }
    }
}

/// Whether a return of this strength at this distance carries the strength warning.
pub fn is_weak(distance_mm: f64, strength: f64) -> bool {
    if distance_mm >= WARNING_MAX_MM {
        return false;
    }
    let after = WARNING.partition_point(|&(mm, _)| mm <= distance_mm);
    let threshold = match after {
        0 => WARNING[0].1,
        n => {
            let ((x0, y0), (x1, y1)) = (WARNING[n - 1], WARNING[n]);
            y0 + (y1 - y0) * (distance_mm - x0) / (x1 - x0)
        }
    };
    strength < threshold
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Medians over beams that see the same wall turn after turn: 2721 mm and 3113 mm of the 2.1
    /// capture, 0.45 mm +-30 % with rounding (1/12) at 471 mm and 527 mm of the two captures.
    #[test]
    fn the_range_law_passes_through_the_captured_figures() {
        let near = |mm, figure: f64, part: f64| (range_sigma_mm(mm) - figure).abs() < part * figure;
        assert!(near(2721.0, 14.0, 0.1));
        assert!(near(3113.0, 19.6, 0.1));
        let rounded = |mm: f64| (range_sigma_mm(mm) * range_sigma_mm(mm) + 1.0 / 12.0).sqrt();
        assert!((rounded(471.0) - 0.46).abs() < 0.3 * 0.46);
        assert!((rounded(527.0) - 0.45).abs() < 0.3 * 0.45);
    }

    /// The noise law for firmware 2.1 agrees within a fifth with the noise of its captures, which
    /// is measured by second differences where the wall faces the sensor. At 225 mm the law for 2.4
    /// gives less than half of that.
    #[test]
    fn f9_the_noise_of_2_1_is_its_own() {
        let [own, other] = [Profile::Fw21, Profile::Fw24]
            .map(|profile| Laws::of(profile, Detail::Captured).range_mm);
        for (mm, figure) in [
            (225.0, 0.43),
            (2_600.0, 8.34),
            (2_850.0, 9.1),
            (3_100.0, 12.5),
        ] {
            let found = own(mm);
            assert!((found / figure - 1.0).abs() < 0.2, "{mm}: {found}");
        }
        assert!(other(225.0) < 0.5 * own(225.0));
    }

    /// Checks the noise over 32 turns of the 2.4 capture, by the share of turns that change a
    /// distance, within a third.
    #[test]
    fn f8_the_noise_of_a_captured_sensor_is_that_of_facing_walls() {
        let near = |found: f64, figure: f64| (found / figure - 1.0).abs() < 0.34;
        for (mm, figure) in [
            (312.0, 0.138),
            (437.0, 0.22),
            (462.0, 0.212),
            (587.0, 0.355),
        ] {
            let law = Laws::of(Profile::Fw24, Detail::Captured).range_mm;
            assert!(near(law(mm), figure), "{mm}");
        }
        for (strength, figure) in [(295.0, 0.50), (520.0, 0.43), (900.0, 0.38), (27.0, 0.60)] {
            let found = strength_sigma_captured(strength) / f64::sqrt(strength);
            assert!(near(found, figure), "{strength}");
        }
    }

    /// Captured strengths of light surfaces: 1018 at 295 mm, 592 at 426 mm, 352 at 527 mm.
    #[test]
    fn the_strength_law_passes_through_the_captured_figures() {
        for (mm, strength) in [(295.0, 1018.0), (426.0, 592.0), (527.0, 352.0)] {
            assert!((strength_mean(mm) / strength - 1.0).abs() < 0.15);
        }
    }

    /// In the golden packet the reading of 271 mm with strength 80 has a warning. Its neighbours,
    /// 266 mm with strength 356 and 263 mm with 466, have none. The farthest warning seen is at 648
    /// mm.
    #[test]
    fn only_near_and_dim_readings_carry_the_warning() {
        assert!(is_weak(271.0, 80.0));
        assert!(!is_weak(266.0, 356.0));
        assert!(!is_weak(263.0, 466.0));
        assert!(is_weak(648.0, 20.0));
        assert!(!is_weak(651.0, 5.0));
    }

    /// Half and twice the distance change 0.42 mm by 2 to the power 9/4, 4.7568. Of the captured
    /// law the near part counts at 550 mm, and three quarters of the other law at 2750 mm: 5 to the
    /// power 1.7 is 15.43, 2750 / 575 to the power 9/4 is 33.83.
    #[test]
    fn deviations_are_those_of_the_laws_by_hand() {
        let near = |found: f64, by_hand: f64| {
            assert!((found / by_hand - 1.0).abs() < 1e-3, "{found} {by_hand}");
        };
        near(range_sigma_mm(575.0), 0.42);
        near(range_sigma_mm(1_150.0), 1.997_9);
        near(range_sigma_mm(287.5), 0.088_29);
        near(range_sigma_captured_mm(550.0), 0.345);
        near(range_sigma_captured_mm(275.0), 0.345 / libm::pow(2.0, 1.7));
        near(range_sigma_captured_mm(2_750.0), 0.75 * 0.42 * 33.83);
        near(range_sigma_captured_21_mm(1_000.0), 0.62 * (2.73 + 0.89));
        near(range_sigma_captured_21_mm(100.0), 0.62 * (0.273 + 0.008_9));
        near(strength_mean(200.0), 2_500.0);
        near(strength_sigma(400.0), 9.4);
        near(strength_sigma_captured(500.0), 110.0_f64.sqrt());
        near(strength_sigma_captured(100.0), (44.0_f64 / 1.2).sqrt());
    }

    /// Jitter in thousandths of a degree, flaws in hundred-thousandths, the deviation at 1 m: 0.42
    /// mm times 3.474 of the even law, three quarters of that or 0.95 mm, and 2.244 mm.
    #[test]
    fn firmware_and_detail_choose_the_laws() {
        for (profile, detail, jitter, wide, dim, range_mm) in [
            (Profile::Fw24, Detail::Even, 10.0, 70.0, 30.0, 1.459),
            (Profile::Fw21, Detail::Even, 10.0, 70.0, 30.0, 1.459),
            (Profile::Fw24, Detail::Captured, 3.0, 10.0, 18.0, 1.094),
            (Profile::Fw21, Detail::Captured, 3.0, 10.0, 18.0, 2.244),
        ] {
            let laws = Laws::of(profile, detail);
            assert!((laws.jitter_rad.to_degrees() * 1e3 - jitter).abs() < 1e-9);
            assert!((laws.too_wide * 1e5 - wide).abs() < 1e-9);
            assert!((laws.too_dim * 1e5 - dim).abs() < 1e-9);
            let found = (laws.range_mm)(1_000.0);
            assert!((found / range_mm - 1.0).abs() < 1e-3, "{found} {range_mm}");
        }
    }

    /// The thresholds of the table, half way between two of them, and before the first.
    #[test]
    fn the_warning_starts_below_a_threshold_that_falls_with_the_distance() {
        for (mm, threshold) in [
            (100.0, 300.0),
            (160.0, 300.0),
            (180.0, 265.0),
            (200.0, 230.0),
            (220.0, 230.0),
            (270.0, 190.0),
            (320.0, 150.0),
            (370.0, 117.5),
            (430.0, 72.5),
            (445.0, 66.25),
            (600.0, 50.0),
            (649.9, 50.0),
        ] {
            let is = [threshold - 0.01, threshold + 0.01].map(|strength| is_weak(mm, strength));
            assert_eq!(is, [true, false], "{mm}");
        }
        assert!(!is_weak(160.0, 300.0) && !is_weak(650.0, 0.0));
    }
}
