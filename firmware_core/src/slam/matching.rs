//! Score of a scan at a pose: end points are looked up in the grid, in whole numbers, so that every
//! host and every build gives the same score.
//!
//! Points are sixteenths of a cell in 16 bits, sine and cosine have 14 binary places. One
//! coordinate of a turned and shifted point is therefore two 16-bit products and a sum with 18
//! binary places. That is one instruction on a Cortex-M4 (SMLAD) and in SSE2 (PMADDWD).

use super::WIDE;
use crate::grid::Grid;
use crate::pose::{Point, Pose, sin_cos};
use crate::scan::BEAMS;

/// Binary places of a point's coordinates, in cells.
const POINT_BITS: u32 = 4;
/// Binary places of sine and cosine.
pub(super) const TRIG_BITS: u32 = 14;
/// Binary places of a placed coordinate, in cells.
pub(super) const CELL_BITS: u32 = POINT_BITS + TRIG_BITS;

/// End points in the robot's frame, in sixteenths of a cell.
#[derive(Clone, Debug)]
pub(super) struct EndPoints {
    xy: [[i16; 2]; BEAMS],
    count: usize,
}

/// A pose in the matcher's units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Placement {
    pub(super) x: i32,
    pub(super) y: i32,
    pub(super) cos: i32,
    pub(super) sin: i32,
}

/// Sums of one candidate's look-ups.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Tally {
    /// Sum of the cells' values.
    pub(super) sum: u32,
    /// End points that lie on the map.
    pub(super) inside: u32,
}

impl EndPoints {
    pub(super) const EMPTY: Self = Self {
        xy: [[0; 2]; BEAMS],
        count: 0,
    };

    /// Replaces the points, skipping any beyond the range of the numbers (2047 cells).
    pub(super) fn set(&mut self, points: impl IntoIterator<Item = Point>, resolution_mm: f32) {
        self.count = 0;
        for point in points {
            if self.count == BEAMS {
                break;
            }
            let fixed = |mm: f32| fixed_i16(mm / resolution_mm * 16.0);
            if let (Some(x), Some(y)) = (fixed(point.x_mm), fixed(point.y_mm)) {
                self.xy[self.count] = [x, y];
                self.count += 1;
            }
        }
    }

    pub(super) fn all(&self) -> &[[i16; 2]] {
        &self.xy[..self.count]
    }
}

impl Placement {
    pub(super) fn new(pose: Pose, resolution_mm: f32) -> Self {
        let (sin, cos) = sin_cos(pose.heading);
        Self::from_parts(
            pose.x_mm / resolution_mm,
            pose.y_mm / resolution_mm,
            sin,
            cos,
        )
    }

    /// Position in cells; coordinates beyond 8191 cells saturate, which is outside of any map.
    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "saturates, which is what is wanted"
    )]
    pub(super) fn from_parts(x_cells: f32, y_cells: f32, sin: f32, cos: f32) -> Self {
        const CELL: f32 = (1_u32 << CELL_BITS) as f32;
        const TRIG: f32 = (1_u32 << TRIG_BITS) as f32;
        const FAR: f32 = 4000.0;
        let position = |cells: f32| (cells.clamp(-FAR, FAR) * CELL) as i32;
        let trig = |value: f32| (value * TRIG + TRIG + 0.5) as i32 - (1 << TRIG_BITS);
        Self {
            x: position(x_cells),
            y: position(y_cells),
            cos: trig(cos),
            sin: trig(sin),
        }
    }

    /// The cell of a point, possibly outside the map.
    #[inline]
    pub(super) const fn cell(&self, point: [i16; 2]) -> (i32, i32) {
        let (x, y) = self.fixed(point);
        (x >> CELL_BITS, y >> CELL_BITS)
    }

    /// The position of a point, in cells with [`CELL_BITS`] binary places.
    #[inline]
    pub(super) const fn fixed(&self, [x, y]: [i16; 2]) -> (i32, i32) {
        let (x, y) = (x as i32, y as i32);
        (
            self.cos * x - self.sin * y + self.x,
            self.sin * x + self.cos * y + self.y,
        )
    }
}

/// The robot's frame at a pose, in cells of the map.
pub(super) struct CellFrame {
    x: f32,
    y: f32,
    sin: f32,
    cos: f32,
    cells_per_mm: f32,
}

impl CellFrame {
    pub(super) fn new(pose: Pose, resolution_mm: f32) -> Self {
        let (sin, cos) = sin_cos(pose.heading);
        let cells_per_mm = 1.0 / resolution_mm;
        Self {
            x: pose.x_mm * cells_per_mm,
            y: pose.y_mm * cells_per_mm,
            sin,
            cos,
            cells_per_mm,
        }
    }

    /// Position of a point of the robot's frame.
    #[inline]
    pub(super) fn place(&self, point: Point) -> (f32, f32) {
        let (x, y) = (
            point.x_mm * self.cells_per_mm,
            point.y_mm * self.cells_per_mm,
        );
        (
            self.x + self.cos * x - self.sin * y,
            self.y + self.sin * x + self.cos * y,
        )
    }
}

/// Looks all `points` up.
#[inline]
pub(super) fn tally<const W: usize, const H: usize>(
    cells: &[[u8; W]; H],
    points: &[[i16; 2]],
    placement: &Placement,
) -> Tally {
    if WIDE {
        tally_in_blocks(cells, points, placement)
    } else {
        tally_each(cells, points, placement)
    }
}

/// One point after the other.
#[inline]
fn tally_each<const W: usize, const H: usize>(
    cells: &[[u8; W]; H],
    points: &[[i16; 2]],
    placement: &Placement,
) -> Tally {
    let mut tally = Tally::default();
    let both = BothAxes::new(placement);
    for point in points {
        let (x, y) = both.cell(*point);
        // A negative coordinate becomes a huge one here.
        let (x, y) = (x.cast_unsigned() as usize, y.cast_unsigned() as usize);
        if let Some(cell) = cells.get(y).and_then(|row| row.get(x)) {
            tally.sum += u32::from(*cell);
            tally.inside += 1;
        }
    }
    tally
}

/// Number of points whose cells are computed together.
const BLOCK: usize = 12;

/// As [`tally_each`], in blocks of points. The compiler turns the multiplications and comparisons
/// of a block into SSE2 code.
#[inline]
fn tally_in_blocks<const W: usize, const H: usize>(
    cells: &[[u8; W]; H],
    points: &[[i16; 2]],
    placement: &Placement,
) -> Tally {
    let part = |value: i32| i16::try_from(value).expect("sines have 15 bits with sign");
    let (cos, sin) = (placement.cos, placement.sin);
    let factors = Factors {
        x: [[part(cos), part(-sin)]; BLOCK],
        y: [[part(sin), part(cos)]; BLOCK],
    };
    let flat = cells.as_flattened();
    let mut sum = 0;
    let mut add = |at: &[u32]| {
        for at in at {
            sum += flat.get(*at as usize).copied().map_or(0, u32::from);
        }
    };
    let mut outside = 0;
    let mut at = [0; BLOCK];
    let (blocks, rest) = points.as_chunks();
    for block in blocks {
        outside += factors.indices::<W, H>(block, placement, &mut at);
        add(&at);
    }
    let last = flat.last().copied().map_or(0, u32::from);
    let rest = tally_each(cells, rest, placement);
    let in_blocks = super::count_u32(blocks.as_flattened().len());
    Tally {
        sum: sum - outside * last + rest.sum,
        inside: in_blocks - outside + rest.inside,
    }
}

/// Factors for the points of a block, one copy for each point.
struct Factors {
    x: [[i16; 2]; BLOCK],
    y: [[i16; 2]; BLOCK],
}

impl Factors {
    /// Indices of the points' cells in the map, and the number of points outside. Points outside
    /// get the last cell instead of a branch, because the branch would be hard to predict.
    ///
    /// The function is not inlined. Otherwise the compiler would see that all factors are equal,
    /// and would no longer use one instruction for two 16-bit products and their sum.
    #[inline(never)]
    fn indices<const W: usize, const H: usize>(
        &self,
        points: &[[i16; 2]; BLOCK],
        placement: &Placement,
        at: &mut [u32; BLOCK],
    ) -> u32 {
        let (width, height) = (Grid::<W, H>::WIDTH, Grid::<W, H>::HEIGHT);
        let cell = |[x, y]: [i16; 2], [by_x, by_y]: [i16; 2], from: i32| {
            let turned = i32::from(x) * i32::from(by_x) + i32::from(y) * i32::from(by_y);
            (turned + from) >> CELL_BITS
        };
        let last = (width * height - 1).cast_unsigned();
        let mut outside = 0;
        for (index, at) in at.iter_mut().enumerate() {
            let x = cell(points[index], self.x[index], placement.x);
            let y = cell(points[index], self.y[index], placement.y);
            let is_outside = (x.cast_unsigned() >= width.cast_unsigned())
                | (y.cast_unsigned() >= height.cast_unsigned());
            let flat = (y * width + x).cast_unsigned();
            *at = if is_outside { last } else { flat };
            outside += u32::from(is_outside);
        }
        outside
    }
}

/// A placement with x in the lower and y in the upper half of a word. One multiplication then
/// serves both, because a 64-bit processor has few multiplication units.
struct BothAxes {
    per_x: i64,
    per_y: i64,
    offset: i64,
}

impl BothAxes {
    #[inline]
    const fn new(placement: &Placement) -> Self {
        const fn packed(x: i32, y: i32) -> i64 {
            x as i64 + ((y as i64) << 32)
        }
        Self {
            per_x: packed(placement.cos, placement.sin),
            per_y: packed(-placement.sin, placement.cos),
            offset: packed(placement.x, placement.y),
        }
    }

    /// The same cell as [`Placement::cell`].
    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "takes the halves apart")]
    const fn cell(&self, [x, y]: [i16; 2]) -> (i32, i32) {
        let both = self.per_x * x as i64 + self.per_y * y as i64 + self.offset;
        let x = both as i32;
        // A negative lower half has borrowed from the upper one.
        let y = ((both - x as i64) >> 32) as i32;
        (x >> CELL_BITS, y >> CELL_BITS)
    }
}

/// The whole part of a number, saturated.
#[expect(
    clippy::cast_possible_truncation,
    reason = "saturates, which is what is wanted"
)]
#[inline]
pub(super) const fn whole(value: f32) -> i32 {
    value as i32
}

#[expect(clippy::cast_possible_truncation, reason = "range checked")]
fn fixed_i16(value: f32) -> Option<i16> {
    let rounded = libm::floorf(value + 0.5);
    (rounded.abs() <= f32::from(i16::MAX)).then_some(rounded as i16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use proptest::prelude::*;

    proptest! {
        /// The form with two multiplications gives the same cell as that with four, over the whole
        /// range of the numbers.
        #[test]
        fn both_axes_at_once_give_the_same_cell(
            x in -4000.0_f32..4000.0, y in -4000.0_f32..4000.0, heading in -3.2_f32..3.2,
            point in [-i16::MAX..=i16::MAX, -i16::MAX..=i16::MAX],
        ) {
            let (sin, cos) = sin_cos(heading);
            let placement = Placement::from_parts(x, y, sin, cos);
            prop_assert_eq!(BothAxes::new(&placement).cell(point), placement.cell(point));
        }

        /// Both variants of the tally equal a count of one cell after the other, on the map, at its
        /// edges and far off.
        #[test]
        fn every_form_of_the_tally_is_the_naive_one(
            values in proptest::collection::vec(0_u8.., 60 * 50),
            points in proptest::collection::vec([-700_i16..700, -i16::MAX..i16::MAX], 0..40),
            near: bool, x in -20.0_f32..80.0, y in -20.0_f32..70.0, heading in -3.2_f32..3.2,
        ) {
            let mut points = points;
            points.iter_mut().for_each(|[_, y]| *y = if near { *y / 50 } else { *y });
            let cells: &[[u8; 60]; 50] = values.as_chunks().0.try_into().unwrap();
            let (sin, cos) = sin_cos(heading);
            let placement = Placement::from_parts(x, y, sin, cos);
            let mut naive = Tally::default();
            for point in &points {
                let (x, y) = placement.cell(*point);
                if (0..60).contains(&x) && (0..50).contains(&y) {
                    naive.sum += u32::from(cells[y as usize][x as usize]);
                    naive.inside += 1;
                }
            }
            prop_assert_eq!(tally_each(cells, &points, &placement), naive);
            prop_assert_eq!(tally_in_blocks(cells, &points, &placement), naive);
            prop_assert_eq!(tally(cells, &points, &placement), naive);
        }

        /// The fixed-point cell against floating point: at most a tenth of a cell apart.
        #[test]
        fn placed_points_lie_where_floating_point_puts_them(
            x in 0.0_f32..3000.0, y in 0.0_f32..3000.0, heading in -3.1_f32..3.1,
            px in -6000.0_f32..6000.0, py in -6000.0_f32..6000.0,
        ) {
            let pose = Pose::new(x, y, heading);
            let mut points = EndPoints::EMPTY;
            points.set([Point::new(px, py)], 10.0);
            let truth = pose.to_world(Point::new(px, py));
            let (cx, cy) = Placement::new(pose, 10.0).cell(points.all()[0]);
            let off = |cell: i32, mm: f32| (cell as f32 + 0.5 - mm / 10.0).abs();
            prop_assert!(off(cx, truth.x_mm) < 0.6 && off(cy, truth.y_mm) < 0.6);
        }
    }

    #[test]
    fn points_that_the_numbers_cannot_hold_are_skipped() {
        let mut points = EndPoints::EMPTY;
        let far = [f32::NAN, f32::INFINITY, 20_490.0, -20_490.0].map(|x| Point::new(x, 0.0));
        points.set(far, 10.0);
        assert!(points.all().is_empty());
        points.set([Point::new(20_470.0, -20_470.0)], 10.0);
        assert_eq!(points.all(), &[[32_752, -32_752]]);
    }

    #[test]
    fn points_outside_the_map_are_told_apart() {
        let mut grid = Grid::<30, 30>::new(10.0);
        grid.set(20, 15, 200);
        let mut points = EndPoints::EMPTY;
        points.set(
            [
                Point::new(50.0, 0.0),
                Point::new(200.0, 0.0),
                Point::new(-200.0, 0.0),
            ],
            10.0,
        );
        let here = Placement::new(Pose::new(155.0, 155.0, 0.0), 10.0);
        assert_eq!(
            tally(grid.rows(), points.all(), &here),
            Tally {
                sum: 200,
                inside: 1
            }
        );
    }
}
