//! Properties of surfaces besides their mean reflectivity: the reflectivity varies from point to
//! point, and no wall is flat to a tenth of a millimetre.
//!
//! Both are fixed in the world: a point looks the same in every turn. Figures from the walls of the
//! "hand in box" capture, over 17 turns without the hand: the logarithm of strength times distance
//! squared has a deviation of 0.196. Degrees correlate by 0.93 if neighbours, 0.85 if 8 degrees
//! apart, 0.63 if 20, 0.42 if 30; a degree is 8 to 10 mm there. One box cannot separate the
//! surface's part from that of the angle of incidence.

use crate::world::Point;

/// Layers of the reflectivity: size of a patch in metres, and deviation of its logarithm.
const PATCHES: [(f64, f64); 2] = [(0.30, 0.15), (0.08, 0.055)];
/// Flecks besides the patches: size in metres, and deviation of the logarithm. Between neighbouring
/// degrees of the capture the median step is 0.03 and the deviation 0.07: few large steps.
const FLECK_M: f64 = 0.004;
const FLECK: f64 = 0.05;

/// Deviation of the distance, millimetres, and size of the unevenness, metres. A guess from the
/// second differences along a wall of the capture, 0.54 mm where noise and rounding make 0.27.
const ROUGH_MM: f64 = 0.33;
const ROUGH_M: f64 = 0.006;
/// Deviation of the logarithm of a point's noise, and size of a point with its own noise,
/// metres. Over 32 turns of the capture the strength noise of a degree is Gaussian (kurtosis 2.7).
/// Over all degrees it is not (5.2): some have three times the noise of others. All steps of 2 mm
/// are on three degrees. Speckle as the cause is a guess.
const SPECKLE: f64 = 0.36;
const SPECKLE_M: f64 = 0.005;

/// Properties of a point on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    /// Times the reflectivity.
    pub(super) reflects: f64,
    /// Added to the distance.
    pub(super) deeper_mm: f64,
    /// Times the noise of a strength; its root times that of a distance.
    pub(super) speckle: f64,
}

impl Place {
    /// A point without peculiarities.
    pub(super) const PLAIN: Self = Self {
        reflects: 1.0,
        deeper_mm: 0.0,
        speckle: 1.0,
    };

    /// The place at `point` of the world.
    pub(super) fn at(point: Point) -> Self {
        let layers = (0_u64..).zip(PATCHES);
        let logarithm: f64 = layers
            .map(|(layer, (size_m, deviation))| deviation * patch(point, size_m, layer))
            .sum();
        let fleck = patch(point, FLECK_M, 8);
        // The cube of a number with a deviation of 1, evenly distributed, has a deviation of about
        // 3.
        let fleck = FLECK / 3.0 * fleck * fleck * fleck;
        Self {
            reflects: libm::exp(logarithm + fleck),
            deeper_mm: ROUGH_MM * patch(point, ROUGH_M, 9),
            speckle: libm::exp(SPECKLE * patch(point, SPECKLE_M, 10)),
        }
    }
}

/// A smooth field over the world with a mean of 0 and a deviation of about 1, by values at the
/// corners of squares of `size_m`.
fn patch(point: Point, size_m: f64, layer: u64) -> f64 {
    let (x, y) = (point.x / size_m + 0.37, point.y / size_m + 0.61);
    let (left, low) = (libm::floor(x), libm::floor(y));
    let (across, up) = (smoothed(x - left), smoothed(y - low));
    let corner = |dx: f64, dy: f64| value(left + dx, low + dy, layer);
    let below = corner(0.0, 0.0) * (1.0 - across) + corner(1.0, 0.0) * across;
    let above = corner(0.0, 1.0) * (1.0 - across) + corner(1.0, 1.0) * across;
    // The mean of four has less spread than a single value: the factor 1.35 corrects this.
    1.35 * (below * (1.0 - up) + above * up)
}

fn smoothed(part: f64) -> f64 {
    part * part * (3.0 - 2.0 * part)
}

/// A number with a mean of 0 and a deviation of 1, even between its ends, by its place alone.
fn value(x: f64, y: f64, layer: u64) -> f64 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a cast of a float saturates"
    )]
    let [x, y] = [x as i64, y as i64].map(i64::cast_unsigned);
    let mut mixed = x
        .wrapping_mul(0x9E37_79B9_7F4A_7C15)
        .wrapping_add(y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F))
        .wrapping_add(layer.wrapping_mul(0x1656_67B1_9E37_79F9));
    mixed = (mixed ^ mixed >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    let high = u32::try_from((mixed ^ mixed >> 31) >> 32).expect("32 bits");
    (f64::from(high) / f64::from(u32::MAX) - 0.5) * 12.0_f64.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Along 200 walls of 0.5 m, a place each 8 mm: the deviation and the likeness of neighbours
    /// and of places farther apart, as captured, and a roughness that neighbours do not share.
    #[test]
    fn f8_reflectivity_varies_smoothly_along_a_wall() {
        let walls: Vec<Vec<Place>> = (0..200)
            .map(|wall| {
                let from = Point::new(f64::from(wall) * 3.1, f64::from(wall) * 1.7);
                let along = |k| Point::new(from.x + 0.008 * f64::from(k), from.y + 0.1);
                (0..62).map(|k| Place::at(along(k))).collect()
            })
            .collect();
        let logs: Vec<Vec<f64>> = walls
            .iter()
            .map(|wall| wall.iter().map(|place| libm::log(place.reflects)).collect())
            .collect();
        let all: Vec<f64> = logs.concat();
        let deviation = (all.iter().map(|a| a * a).sum::<f64>() / all.len() as f64).sqrt();
        assert!((0.12..0.25).contains(&deviation), "{deviation}");
        let alike = |rows: &[Vec<f64>], lag: usize| {
            let pairs = rows.iter().flat_map(|row| row.iter().zip(&row[lag..]));
            let sum: f64 = pairs.clone().map(|(a, b)| a * b).sum();
            let own: f64 = pairs.map(|(a, b)| (a * a + b * b) / 2.0).sum();
            sum / own
        };
        assert!(
            (0.88..0.99).contains(&alike(&logs, 1)),
            "{}",
            alike(&logs, 1)
        );
        assert!(
            (0.4..0.95).contains(&alike(&logs, 20)),
            "{}",
            alike(&logs, 20)
        );
        let rough: Vec<Vec<f64>> = walls
            .iter()
            .map(|wall| wall.iter().map(|place| place.deeper_mm).collect())
            .collect();
        assert!(alike(&rough, 1).abs() < 0.35, "{}", alike(&rough, 1));
    }

    /// The mixer is that of SplitMix64. Of seed 0 its first outputs are known: E220A8397B1DCDAF,
    /// 6E789E6AA1B965F4 and 06C45D188009454F. The other numbers follow from its rules.
    #[test]
    fn a_value_depends_on_its_place_and_layer_alone() {
        for (x, y, layer, high) in [
            (0.0, 0.0, 0, 0_u32),
            (1.0, 0.0, 0, 0xE220_A839),
            (2.0, 0.0, 0, 0x6E78_9E6A),
            (3.0, 0.0, 0, 0x06C4_5D18),
            (-1.0, 0.0, 0, 0x3365_03C6),
            (0.0, 1.0, 0, 0x6885_0AC7),
            (0.0, -3.0, 0, 0x0EC6_86D4),
            (0.0, 0.0, 1, 0xB393_62CB),
            (5.0, -7.0, 10, 0x463E_F4AA),
        ] {
            let expected = (f64::from(high) / 4_294_967_295.0 - 0.5) * 2.0 * 3.0_f64.sqrt();
            let found = value(x, y, layer);
            assert!((found - expected).abs() < 1e-9, "{x} {y} {layer}: {found}");
        }
    }

    /// In the middle of a square the field is the mean of four values, times 1.35. A quarter of a
    /// side from the left one, the right one counts by (3 - 2 / 4) / 16 = 0.15625.
    #[test]
    fn a_patch_is_smooth_between_the_corners_of_its_square() {
        assert_eq!(
            [0.0, 0.25, 0.5, 1.0].map(smoothed),
            [0.0, 0.15625, 0.5, 1.0]
        );
        let size_m = 0.08;
        let at = |x: f64, y: f64| {
            let point = Point::new((x - 0.37) * size_m, (y - 0.61) * size_m);
            patch(point, size_m, 3)
        };
        let [a, b, c, d] =
            [(5.0, -2.0), (6.0, -2.0), (5.0, -1.0), (6.0, -1.0)].map(|(x, y)| value(x, y, 3));
        for (x, y, mean) in [
            (5.0, -2.0, a),
            (5.5, -1.5, (a + b + c + d) / 4.0),
            (5.25, -2.0, 0.84375 * a + 0.15625 * b),
            (5.75, -1.0, 0.15625 * c + 0.84375 * d),
            (5.0, -1.75, 0.84375 * a + 0.15625 * c),
            (6.0, -1.25, 0.15625 * b + 0.84375 * d),
        ] {
            let found = at(x, y);
            assert!(
                (found - 1.35 * mean).abs() < 1e-9,
                "{x} {y}: {found} {mean}"
            );
        }
    }

    /// Patches of 30 cm and 8 cm, flecks of 4 mm, unevenness of 6 mm, speckle of 5 mm.
    #[test]
    fn a_place_adds_up_its_layers() {
        for (x, y) in [(0.0, 0.0), (1.234, -0.567), (-3.21, 2.5), (0.4, 7.77)] {
            let point = Point::new(x, y);
            let place = Place::at(point);
            let patches = 0.15 * patch(point, 0.30, 0) + 0.055 * patch(point, 0.08, 1);
            let fleck = 0.05 / 3.0 * patch(point, 0.004, 8).powi(3);
            let speckle = 0.36 * patch(point, 0.005, 10);
            assert!((libm::log(place.reflects) - patches - fleck).abs() < 1e-12);
            assert!((place.deeper_mm - 0.33 * patch(point, 0.006, 9)).abs() < 1e-12);
            assert!((libm::log(place.speckle) - speckle).abs() < 1e-12);
        }
    }
}
