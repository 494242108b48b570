//! Motions from which plans are composed.

use core::f64::consts::{FRAC_PI_4, TAU};

use alloc::vec::Vec;

/// Speed at which a primitive's length is timed, m/s.
const NOMINAL_M_S: f64 = 0.4;
/// Time for a turn by 45 degrees, seconds.
const TURN_45_S: f64 = 0.6;
/// Number of poses of a generated primitive.
const POSES: usize = 10;

/// One motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive {
    /// Start heading, of [`PrimitiveSet::angles`].
    pub start: u32,
    /// End: cells along x and y from the first cell, and the heading.
    pub end: ([i32; 2], u32),
    /// Factor of the cost relative to the time.
    pub multiplier: u32,
    /// Poses along the motion, including the first and last: metres from the middle of the first
    /// cell, and the heading, radians.
    pub poses: Vec<[f64; 3]>,
}

/// A set of primitives, the same number for each heading.
#[derive(Clone, Debug, PartialEq)]
pub struct PrimitiveSet {
    resolution_m: f64,
    angles: u32,
    primitives: Vec<Primitive>,
}

impl PrimitiveSet {
    /// The primitives of the car of seed 003: per heading one short and one long straight, one
    /// straight back at ten times the cost, and two curves at twice the cost. Where the lattice has
    /// no short straight, the long one occurs twice. Cells of 5 cm, 16 headings.
    pub fn car() -> Self {
        let mut primitives = Vec::new();
        for start in 0..16_u32 {
            let (quarter, base) = (start / 4, start % 4);
            for (template, multiplier) in CAR[[0, 1, 2, 1][base as usize]] {
                let ([x, y], end) = template;
                // Heading 3 is the mirror of heading 1 at the diagonal.
                let (cell, end) = match base {
                    3 => ([y, x], 4 - end),
                    _ => ([x, y], end),
                };
                let cell = (0..quarter).fold(cell, |[x, y], _| [-y, x]);
                let end = (end + 4 * i32::try_from(quarter).unwrap_or(0)).rem_euclid(16);
                let end = u32::try_from(end).unwrap_or(0);
                primitives.push(Primitive {
                    start,
                    end: (cell, end),
                    multiplier,
                    poses: poses(0.05, 16, start, cell, end),
                });
            }
        }
        Self {
            resolution_m: 0.05,
            angles: 16,
            primitives,
        }
    }

    /// Edge of a cell, metres.
    pub const fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// Number of headings.
    pub const fn angles(&self) -> u32 {
        self.angles
    }

    /// All primitives.
    pub fn all(&self) -> &[Primitive] {
        &self.primitives
    }

    /// The primitives that begin with heading `angle`.
    pub fn of(&self, angle: u32) -> impl Iterator<Item = &Primitive> {
        self.primitives.iter().filter(move |one| one.start == angle)
    }

    /// The heading nearest to `heading_rad`.
    pub fn angle(&self, heading_rad: f64) -> u32 {
        let count = f64::from(self.angles);
        let index = libm::round(heading_rad / TAU * count);
        let index = index - count * libm::floor(index / count);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "0 up to the number of headings"
        )]
        let index = index as u32;
        index % self.angles
    }

    /// Radians of a heading, in [0, 2 pi).
    pub fn heading_rad(&self, angle: u32) -> f64 {
        f64::from(angle) * TAU / f64::from(self.angles)
    }
}

impl Primitive {
    /// Length of the path, metres.
    pub fn length_m(&self) -> f64 {
        let steps = self.poses.windows(2);
        let lengths =
            steps.map(|pair| libm::hypot(pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]));
        lengths.sum()
    }

    /// Cost over free cells: milliseconds at the nominal speeds, rounded up, times the multiplier.
    pub fn base_cost(&self) -> u32 {
        let turned = self.poses.first().zip(self.poses.last());
        let turned = turned.map_or(0.0, |(first, last)| last[2] - first[2]);
        let turned = crate::ackermann::wrapped(turned).abs();
        let seconds = (self.length_m() / NOMINAL_M_S).max(turned / FRAC_PI_4 * TURN_45_S);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates"
        )]
        // A whole number in decimal may not be whole in binary.
        let cost = libm::ceil(1_000.0 * seconds - 1e-9) as u32;
        cost.max(1).saturating_mul(self.multiplier)
    }
}

/// End of a template, and its cost factor.
type Template = (([i32; 2], i32), u32);

/// The car's primitives for headings 0, 22.5 and 45 degrees.
const CAR: [[Template; 5]; 3] = [
    [
        (([1, 0], 0), 1),
        (([7, 0], 0), 1),
        (([-1, 0], 0), 10),
        (([14, 2], 1), 2),
        (([14, -2], -1), 2),
    ],
    [
        (([5, 2], 1), 1),
        (([5, 2], 1), 1),
        (([-5, -2], 1), 10),
        (([14, 8], 2), 2),
        (([14, 3], 0), 2),
    ],
    [
        (([5, 5], 2), 1),
        (([5, 5], 2), 1),
        (([-5, -5], 2), 10),
        (([10, 13], 3), 2),
        (([13, 9], 1), 2),
    ],
];

/// Poses of a primitive: a straight, or a straight and then an arc that ends at the right position
/// with the right heading.
fn poses(cell_m: f64, angles: u32, start: u32, end: [i32; 2], end_angle: u32) -> Vec<[f64; 3]> {
    let [x, y] = end.map(|cells| f64::from(cells) * cell_m);
    let first = f64::from(start) * TAU / f64::from(angles);
    let turn = f64::from(end_angle) * TAU / f64::from(angles) - first;
    let turn = crate::ackermann::wrapped(turn);
    let parts = (0..POSES).map(|index| index as f64 / (POSES - 1) as f64);
    if turn == 0.0 {
        return parts.map(|part| [x * part, y * part, first]).collect();
    }
    // [x y] = l [cos0 sin0] + r [sin1 - sin0, cos0 - cos1], for l and r.
    let ((sin0, cos0), (sin1, cos1)) = (libm::sincos(first), libm::sincos(first + turn));
    let (a, b) = (sin1 - sin0, cos0 - cos1);
    let det = cos0 * b - sin0 * a;
    let straight = (x * b - y * a) / det;
    let radius = (cos0 * y - sin0 * x) / det;
    let length = straight + radius * turn;
    let place = |part: f64| {
        let way = part * length;
        if way <= straight {
            return [way * cos0, way * sin0, first];
        }
        let heading = first + (way - straight) / radius;
        let (sin, cos) = libm::sincos(heading);
        [
            straight * cos0 + radius * (sin - sin0),
            straight * sin0 + radius * (cos0 - cos),
            heading,
        ]
    };
    parts.map(place).collect()
}
