//! Four walls or circles screened at once, before any is tested exactly.
//!
//! A cell of the [grid](super::grid) holds its primitives in bundles of four. The screen works in
//! `f32`, because four of those fill one register. It errs on one side only: primitives that pass
//! are tested exactly afterwards, and refused ones are out of reach of all rounding. So it costs or
//! saves time and never changes a result.
//!
//! A circle is screened as a wall of the same width that always faces the ray.

use core::ops::{Add, Mul, Sub};

use super::geometry::{Point, Primitive, Ray};

/// Primitives in one bundle.
pub(super) const LANES: usize = 4;

/// Four numbers that go through the same steps. Each operation is written out lane by lane, which
/// is the form that compilers turn into one instruction.
#[derive(Clone, Copy, Debug)]
struct Four([f32; LANES]);

impl Four {
    #[inline(always)]
    fn all(value: f32) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    fn map(self, f: impl Fn(f32) -> f32) -> Self {
        let [a, b, c, d] = self.0;
        Self([f(a), f(b), f(c), f(d)])
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let ([a, b, c, d], [e, g, h, i]) = (self.0, other.0);
        Self([f(a, e), f(b, g), f(c, h), f(d, i)])
    }

    #[inline(always)]
    fn least(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    /// Changes sign where `other` is negative.
    #[inline(always)]
    fn signed_by(self, other: Self) -> Self {
        self.zip(other, |a, b| {
            f32::from_bits(a.to_bits() ^ (b.to_bits() & 0x8000_0000))
        })
    }
}

impl Add for Four {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl Sub for Four {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Four {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

/// Maximum error of the screen by rounding, in metres, among points no farther apart than `extent`.
/// Some 45 roundings of numbers up to `extent` add up in the worst case, each half a unit in the
/// last of 24 bits: 2.7e-6 of it.
pub(super) fn tolerance(extent: f64) -> f64 {
    1e-5 + 4e-6 * extent
}

/// Up to four primitives of one cell, and where its next bundle is.
#[derive(Clone, Debug)]
pub(super) struct Bundle {
    /// Middle of each, seen from the corner of the grid.
    middle_x: Four,
    middle_y: Four,
    /// Unit vector along a wall; 0 for a circle.
    along_x: Four,
    along_y: Four,
    /// 1 for a circle, which turns to face the ray.
    faces: Four,
    /// Half a wall's length, or a circle's radius; with tolerance.
    half: Four,
    /// Distance of the surface from its middle along the ray: 0, or a circle's radius; with
    /// tolerance. Minus infinity makes an empty lane refuse everything.
    depth: Four,
    tolerance: f32,
    index: [u32; LANES],
    /// Index of the cell's next bundle; 0 if there is none.
    pub(super) next: u32,
}

impl Bundle {
    pub(super) fn empty() -> Self {
        let zero = Four::all(0.0);
        Self {
            middle_x: zero,
            middle_y: zero,
            along_x: zero,
            along_y: zero,
            faces: zero,
            half: zero,
            depth: Four::all(f32::NEG_INFINITY),
            tolerance: 0.0,
            index: [0; LANES],
            next: 0,
        }
    }

    /// Puts a primitive into the first empty lane; `false` if all are full.
    pub(super) fn add(
        &mut self,
        index: u32,
        primitive: &Primitive,
        corner: Point,
        tolerance: f64,
    ) -> bool {
        let Some(lane) = self
            .depth
            .0
            .iter()
            .position(|&depth| depth == f32::NEG_INFINITY)
        else {
            return false;
        };
        let (middle, along, half) = match primitive {
            Primitive::Segment(wall) => (wall.middle(), wall.along(), wall.length() * 0.5),
            Primitive::Circle(circle) => (circle.center, Point::default(), circle.radius),
        };
        let is_circle = matches!(primitive, Primitive::Circle(_));
        self.middle_x.0[lane] = single(middle.x - corner.x);
        self.middle_y.0[lane] = single(middle.y - corner.y);
        self.along_x.0[lane] = single(along.x);
        self.along_y.0[lane] = single(along.y);
        self.faces.0[lane] = if is_circle { 1.0 } else { 0.0 };
        self.half.0[lane] = single(half);
        self.depth.0[lane] = single(if is_circle {
            half + tolerance
        } else {
            tolerance
        });
        self.tolerance = single(tolerance);
        self.index[lane] = index;
        true
    }

    /// Indices of the primitives in it.
    pub(super) fn indices(&self) -> impl Iterator<Item = usize> {
        let used = |&(_, &depth): &(&u32, &f32)| depth > f32::NEG_INFINITY;
        self.index
            .iter()
            .zip(&self.depth.0)
            .filter(used)
            .map(|(&index, _)| index as usize)
    }

    /// Index of the primitive in `lane`.
    #[inline]
    pub(super) fn index(&self, lane: usize) -> usize {
        self.index[lane] as usize
    }

    /// The lanes that the beam may meet within `limit`. The formulas are those of the exact test
    /// for walls, with the middle in place of the end.
    #[inline(always)]
    pub(super) fn screen(&self, beam: &Beam, limit: f32) -> [bool; LANES] {
        let (dir_x, dir_y) = (beam.dir_x, beam.dir_y);
        let along_x = self.along_x - self.faces * dir_y;
        let along_y = self.along_y + self.faces * dir_x;
        let to_x = self.middle_x - beam.from_x;
        let to_y = self.middle_y - beam.from_y;
        let sin = dir_x * along_y - dir_y * along_x;
        let cos = dir_x * along_x + dir_y * along_y;
        let side = sin.map(f32::abs);
        let ahead = (to_x * along_y - to_y * along_x).signed_by(sin);
        let off = (ahead * cos - (to_x * along_x + to_y * along_y) * side).map(f32::abs);
        let front = ahead + self.depth;
        let back = Four::all(limit) * side + self.depth - ahead;
        let ends = self.half * side + Four::all(self.tolerance) - off;
        let [a, b, c, d] = front.least(back).least(ends).0;
        [a >= 0.0, b >= 0.0, c >= 0.0, d >= 0.0]
    }
}

/// A ray as the screen sees it.
pub(super) struct Beam {
    from_x: Four,
    from_y: Four,
    dir_x: Four,
    dir_y: Four,
}

impl Beam {
    /// The ray from the place `entered` metres along it, seen from the corner of the grid.
    pub(super) fn new(ray: Ray, entered: f64, corner: Point) -> Self {
        Self {
            from_x: Four::all(single(ray.from.x + ray.dir.x * entered - corner.x)),
            from_y: Four::all(single(ray.from.y + ray.dir.y * entered - corner.y)),
            dir_x: Four::all(single(ray.dir.x)),
            dir_y: Four::all(single(ray.dir.y)),
        }
    }
}

/// Rounds to single precision; the tolerance covers it.
#[inline]
#[expect(
    clippy::cast_possible_truncation,
    reason = "the rounding is what is wanted"
)]
pub(super) fn single(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::super::geometry::{Circle, Segment};
    use super::*;

    const NOWHERE: Point = Point::new(-10.0, -20.0);

    /// The lanes, of four, that a ray from `from` at `angle` may meet within `limit`. The lanes are
    /// a wall across at 1 m, half a metre to either side; a wall along the ray, 0.2 m to the left
    /// from 1 m to 3 m; a circle of 0.3 m around (2, 0); and an empty lane.
    fn screened(from: (f64, f64), angle: f64, limit: f32) -> [bool; LANES] {
        let at = Point::new;
        let wall = |from, to| Primitive::Segment(Segment::new(from, to).expect("long"));
        let mut bundle = Bundle::empty();
        let circle = Circle {
            center: at(2.0, 0.0),
            radius: 0.3,
        };
        let three = [
            wall(at(1.0, -0.5), at(1.0, 0.5)),
            wall(at(1.0, 0.2), at(3.0, 0.2)),
            Primitive::Circle(circle),
        ];
        for (index, primitive) in (7..).zip(&three) {
            assert!(bundle.add(index, primitive, NOWHERE, 1e-4));
        }
        assert!(bundle.indices().eq([7, 8, 9]) && bundle.index(1) == 8);
        let ray = Ray::new(at(from.0, from.1), angle);
        bundle.screen(&Beam::new(ray, 0.0, NOWHERE), limit)
    }

    /// A ray that passes a millimetre beside, before or behind a primitive is out of reach, so no
    /// exact test is needed.
    #[test]
    fn a_screen_refuses_what_is_out_of_reach() {
        let ahead = |y: f64, limit| screened((0.0, y), 0.0, limit);
        assert_eq!(ahead(0.0, 9.0), [true, false, true, false]);
        assert_eq!([ahead(0.499, 9.0)[0], ahead(0.501, 9.0)[0]], [true, false]);
        assert_eq!(
            [ahead(-0.499, 9.0)[0], ahead(-0.501, 9.0)[0]],
            [true, false]
        );
        // A tolerance of 0.1 mm.
        assert_eq!(
            [ahead(0.500_05, 9.0)[0], ahead(0.500_15, 9.0)[0]],
            [true, false]
        );
        assert_eq!([ahead(0.0, 0.999)[0], ahead(0.0, 1.001)[0]], [false, true]);
        assert_eq!([ahead(0.299, 9.0)[2], ahead(0.301, 9.0)[2]], [true, false]);
        assert_eq!(
            [ahead(-0.299, 9.0)[2], ahead(-0.301, 9.0)[2]],
            [true, false]
        );
        assert_eq!([ahead(0.0, 1.699)[2], ahead(0.0, 1.701)[2]], [false, true]);
        let back = screened((0.0, 0.0), core::f64::consts::PI, 9.0);
        assert_eq!(back, [false; LANES]);
        // From within the circle its far side is met.
        assert!(screened((2.0, 0.0), 1.0, 9.0)[2] && !screened((2.302, 0.0), 0.0, 9.0)[2]);
        let up = |x: f64, limit| screened((x, 0.0), core::f64::consts::FRAC_PI_2, limit)[1];
        assert_eq!(
            [0.999, 1.001, 2.999, 3.001].map(|x| up(x, 9.0)),
            [false, true, true, false]
        );
        assert_eq!([up(2.5, 0.199), up(2.5, 0.201)], [false, true]);
    }

    /// The tolerance is 1e-5 m and 4 millionths of half a kilometre. Four primitives fit into a
    /// bundle, a fifth does not.
    #[test]
    fn four_fit_into_a_bundle() {
        assert!((tolerance(500.0) - 2.01e-3).abs() < 1e-12);
        let wall = Segment::new(Point::new(0.0, 0.0), Point::new(1.0, 0.0)).expect("long");
        let mut bundle = Bundle::empty();
        let added = [0, 1, 2, 3, 4]
            .map(|index| bundle.add(index, &Primitive::Segment(wall), NOWHERE, 1e-4));
        assert_eq!(added, [true, true, true, true, false]);
    }
}
