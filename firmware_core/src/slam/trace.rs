//! Drawing a scan into the map with accuracy below a cell. In contrast to [`super::update`], the
//! beam crosses the cells at its true position, and the hole's summit lies at the wall instead of
//! in the middle of the nearest cell.

use core::cmp::Ordering;

use super::matching::{CellFrame, whole};
use super::settings::Settings;
use super::walk::{Steps, Walk, faded};
use crate::grid::{Grid, UNKNOWN};
use crate::pose::Pose;
use crate::scan::Scan;

/// Changes of cells by rays.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Strokes {
    /// The hole around a beam's end.
    wall: Steps,
    /// The hole on a cell that was never drawn.
    first: Steps,
    /// New value of a cell on the free path.
    free: [u8; 256],
}

impl Strokes {
    /// Strokes for a scan that draws its walls with `weight`; the other weights follow in
    /// proportion.
    pub(super) fn new(weight: u16, settings: &Settings) -> Self {
        let part = |of: u16| {
            let scaled = u32::from(of) * u32::from(weight) / u32::from(settings.weight.max(1));
            u16::try_from(scaled.clamp(1, 256)).expect("clamped")
        };
        Self::of(
            weight,
            part(settings.free_weight),
            part(settings.first_weight),
        )
    }

    /// Weights of the hole, of the free path to it, and of both on a cell that was never drawn.
    pub(super) fn of(wall: u16, free: u16, first: u16) -> Self {
        let mut then = faded(free);
        then[usize::from(UNKNOWN)] = faded(first)[usize::from(UNKNOWN)];
        Self {
            wall: Steps::new(wall.into(), 255),
            first: Steps::new(first.into(), 255),
            free: then,
        }
    }
}

/// Draws all beams of a scan taken at `pose`.
pub(super) fn trace_scan<const W: usize, const H: usize>(
    grid: &mut Grid<W, H>,
    pose: Pose,
    scan: &Scan,
    hole_cells: f32,
    strokes: &Strokes,
) {
    let frame = CellFrame::new(pose, grid.resolution_mm());
    for (point, beam) in scan.points().iter().zip(scan.beams()) {
        let beam = Beam {
            from: frame.place(scan.origin(*beam)),
            hit: frame.place(*point),
            half_hole: hole_cells / 2.0,
        };
        trace(grid.rows_mut(), &beam, strokes);
    }
}

/// A beam in cells of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Beam {
    /// Start of the beam.
    pub(super) from: (f32, f32),
    /// End of the beam.
    pub(super) hit: (f32, f32),
    /// Half the hole's width along the beam.
    pub(super) half_hole: f32,
}

const BITS: u32 = 16;
const CELL: f32 = (1 << BITS) as f32;
/// Margin to the map's edge, in cells, so that rounding never leaves the map.
const EDGE: f32 = 0.01;

/// Draws one beam; skips the part outside the map.
pub(super) fn trace<const W: usize, const H: usize>(
    cells: &mut [[u8; W]; H],
    beam: &Beam,
    strokes: &Strokes,
) {
    let (dx, dy) = (beam.hit.0 - beam.from.0, beam.hit.1 - beam.from.1);
    let cells = cells.as_flattened_mut();
    if dx.abs() >= dy.abs() {
        let line = Line::new(beam.from, (dx, dy), beam.half_hole, (W, H));
        line.draw(strokes, (1, W), cells);
    } else {
        let swapped = (beam.from.1, beam.from.0);
        let line = Line::new(swapped, (dy, dx), beam.half_hole, (H, W));
        line.draw(strokes, (W, 1), cells);
    }
}

/// A beam along its long axis: cells `first..=last` in the direction of `step`.
struct Line {
    first: i32,
    step: i32,
    /// Number of cells to draw as free, then as hole.
    free: i32,
    hole: i32,
    /// Position along the short axis, at the middle of the first cell, and its change per cell.
    short: i32,
    slope: i32,
    /// Value of the hole at its first cell, 16 binary places, and its rise per cell.
    value: i32,
    rise: i32,
}

impl Line {
    fn new(
        from: (f32, f32),
        (long, short): (f32, f32),
        half_hole: f32,
        (size_long, size_short): (usize, usize),
    ) -> Self {
        let nothing = Self {
            first: 0,
            step: 1,
            free: 0,
            hole: 0,
            short: 0,
            slope: 0,
            value: 0,
            rise: 0,
        };
        let length = libm::hypotf(long, short);
        if !(length > 0.1 && length < 1e4) {
            return nothing;
        }
        let along = long.abs() / length;
        // Position s counts cells along the long axis in the direction of the beam.
        let sign = long.signum();
        let start = from.0 * sign;
        let hit = start + long.abs();
        let half = (half_hole * along).max(0.75);
        let (size_long, size_short) = (size_long as f32, size_short as f32);
        let slope = short / long.abs();
        let (low, high) = if sign > 0.0 {
            (0.0, size_long)
        } else {
            (-size_long, 0.0)
        };
        // Interval of the beam on the map along both axes.
        let (mut enter, mut leave) = (start.max(low), (hit + half).min(high));
        if slope != 0.0 {
            let (low, high) = (EDGE - from.1, size_short - EDGE - from.1);
            let (a, b) = (start + low / slope, start + high / slope);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        } else if !(EDGE..size_short - EDGE).contains(&from.1) {
            return nothing;
        }
        if leave.partial_cmp(&enter) != Some(Ordering::Greater) {
            return nothing;
        }
        // The first cell with its middle on the ray, the first cell of the hole, and the last cell.
        let first = ceil(enter - 0.5);
        let last = ceil(leave - 0.5) - 1.0;
        let hole_from = ceil(hit - half - 0.5).max(first);
        if last < first {
            return nothing;
        }
        let middle = first + 0.5;
        let cell = if sign > 0.0 { first } else { -first - 1.0 };
        let rise = 255.0 / half;
        Self {
            first: whole(cell),
            step: whole(sign),
            free: whole(hole_from.min(last + 1.0) - first),
            hole: whole((last + 1.0 - hole_from).max(0.0)),
            short: whole((from.1 + (middle - start) * slope) * CELL),
            slope: whole(slope * CELL),
            value: whole((255.0 - (hit - hole_from - 0.5) * rise) * CELL),
            rise: whole(rise * CELL),
        }
    }

    fn draw(&self, strokes: &Strokes, strides: (usize, usize), cells: &mut [u8]) {
        let mut walk = self.walk(strides);
        walk.map(cells, self.free, &strokes.free);
        let peak = 255 << BITS;
        let mut value = self.value;
        for _ in 0..self.hole {
            let height = (peak - (value - peak).abs()).max(0) >> BITS;
            value += self.rise;
            if let Some(cell) = cells.get_mut(walk.next()) {
                let steps = if *cell == UNKNOWN {
                    &strokes.first
                } else {
                    &strokes.wall
                };
                steps.apply(cell, height.unsigned_abs() as usize);
            }
        }
    }

    /// The beam's cells on a map with strides `ahead` and `aside` between cells along its long and
    /// its short axis. The position along the short axis is never negative on the map.
    fn walk(&self, (ahead, aside): (usize, usize)) -> Walk {
        let at = |cell: i32| cell.cast_unsigned() as usize;
        let first = at(self.first).wrapping_mul(ahead);
        let first = first.wrapping_add(at(self.short >> BITS).wrapping_mul(aside));
        let straight = if self.step > 0 {
            ahead
        } else {
            ahead.wrapping_neg()
        };
        let (aside, way) = if self.slope < 0 {
            (aside.wrapping_neg(), !self.short)
        } else {
            (aside, self.short)
        };
        let diagonal = straight.wrapping_add(aside);
        let slope = self.slope.unsigned_abs();
        if slope >> BITS > 0 {
            return Walk::straight(first, diagonal);
        }
        Walk {
            at: first,
            straight,
            diagonal,
            place: way.cast_unsigned() << BITS,
            slope: slope << BITS,
        }
    }
}

/// The next whole number, for positions on a map and near it.
#[inline]
fn ceil(value: f32) -> f32 {
    let towards_zero = whole(value) as f32;
    if towards_zero < value {
        towards_zero + 1.0
    } else {
        towards_zero
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn black() -> Strokes {
        Strokes::of(256, 256, 256)
    }

    /// A beam along x from the middle of cell 2 to a wall a quarter into cell 10, with half a hole
    /// of four cells. The drawn value is 255 less 63.75 for each cell between a cell's middle and
    /// the wall.
    #[test]
    fn the_summit_lies_where_the_wall_is() {
        let mut cells = [[7; 16]; 3];
        let beam = Beam {
            from: (2.5, 1.5),
            hit: (10.25, 1.5),
            half_hole: 4.0,
        };
        trace(&mut cells, &beam, &black());
        assert_eq!(cells[1][..7], [7, 7, 0, 0, 0, 0, 15]);
        assert_eq!(cells[1][7..], [79, 143, 207, 239, 175, 111, 47, 7, 7]);
        assert_eq!([cells[0], cells[2]], [[7; 16]; 2]);
    }

    #[test]
    fn a_cell_that_was_never_drawn_takes_the_first_stroke() {
        let mut cells = [[UNKNOWN; 8]; 1];
        cells[0][3] = 100;
        let beam = Beam {
            from: (0.5, 0.5),
            hit: (7.5, 0.5),
            half_hole: 1.0,
        };
        trace(&mut cells, &beam, &Strokes::of(40, 64, 128));
        assert_eq!(cells[0], [63, 63, 63, 75, 63, 63, 63, 191]);
    }

    #[test]
    fn absurd_beams_draw_nothing() {
        let nan = f32::NAN;
        let far = [
            (nan, 1.0),
            (1.0, nan),
            (f32::INFINITY, 1.0),
            (3.0, 3.0),
            (1e9, 1.0),
        ];
        for hit in far {
            let mut cells = [[9; 8]; 8];
            trace(
                &mut cells,
                &Beam {
                    from: (3.0, 3.0),
                    hit,
                    half_hole: 6.0,
                },
                &black(),
            );
            assert_eq!(cells, [[9; 8]; 8], "{hit:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8 * ProptestConfig::default().cases))]
        /// Every drawn cell is compared with the plain rule in double precision: the cell's middle
        /// along the long axis lies on the beam, and its row is the beam's row there. Beams that
        /// pass a border of two rows within a hundredth of a cell may choose either row.
        #[test]
        fn beams_draw_the_cells_that_they_cross(
            fx in -5.0_f32..45.0, fy in -5.0_f32..35.0,
            hx in -20.0_f32..60.0, hy in -20.0_f32..50.0,
            half in 1.0_f32..8.0,
        ) {
            let beam = Beam { from: (fx, fy), hit: (hx, hy), half_hole: half };
            let mut cells = [[9; 40]; 30];
            trace(&mut cells, &beam, &black());
            let [fx, fy, hx, hy, half] = [fx, fy, hx, hy, half].map(f64::from);
            let (dx, dy) = (hx - fx, hy - fy);
            let length = dx.hypot(dy);
            prop_assume!(length > 0.2);
            let flat = dx.abs() >= dy.abs();
            let (long, from, hit) = if flat { (dx, fx, hx) } else { (dy, fy, hy) };
            let half = (half * long.abs() / length).max(0.75);
            for (y, row) in cells.iter().enumerate() {
                for (x, cell) in row.iter().enumerate() {
                    let (x, y) = (x as f64, y as f64);
                    let middle = 0.5 + if flat { x } else { y };
                    let along = (middle - from) / long;
                    let across = if flat { fy + along * dy - y } else { fx + along * dx - x };
                    let to_end = (middle - hit) * long.signum();
                    let borders = [across, across - 1.0, along * 9.0, to_end - half];
                    if borders.iter().any(|border| border.abs() < 0.01) {
                        continue;
                    }
                    let edge = if flat { fy + along * dy } else { fx + along * dx };
                    let size = if flat { 30.0 } else { 40.0 };
                    if edge < 0.03 || edge > size - 0.03 {
                        continue;
                    }
                    let crossed = (0.0..1.0).contains(&across) && along > 0.0 && to_end < half;
                    let expected = if crossed { 255.0 * (1.0 - to_end.abs() / half) } else { 9.0 };
                    prop_assert!((f64::from(*cell) - expected.max(0.0)).abs() <= 2.0,
                        "{x} {y}: {cell} {expected}");
                }
            }
        }
    }
}
