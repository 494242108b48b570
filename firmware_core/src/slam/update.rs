//! Drawing a scan into the map: free along each beam, then a hole of rising and falling values
//! around its end (seed report, map update; checked against the profile of the field code).
//!
//! ```text
//! 255            /\
//!               /  \         derr cells up to the hit, derr cells down to the end of the hole
//!   0 _________/    \
//!     robot       hit  end
//! ```

use super::WIDE;
use super::matching::{CellFrame, whole};
use super::settings::{Defects, Rounding};
use super::walk::{Steps, Walk, faded};
use crate::grid::{Grid, OBSTACLE};
use crate::pose::Pose;
use crate::scan::Scan;

/// One ray, in cells, from the lidar to the end of the hole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ray {
    pub(super) from: (i32, i32),
    pub(super) hit: (i32, i32),
    pub(super) end: (i32, i32),
}

/// Weight and shape of a drawn ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ink {
    /// Weight of the new value, of 256.
    pub(super) weight: u16,
    pub(super) rounding: Rounding,
    /// Skip holes shorter than two cells, as the fielded code on its processor does.
    pub(super) loses_short_holes: bool,
}

impl Ink {
    pub(super) const fn new(weight: u16, defects: &Defects) -> Self {
        let rounding = if defects.truncating_rounding {
            Rounding::Truncating
        } else {
            Rounding::Corrected
        };
        Self {
            weight,
            rounding,
            loses_short_holes: defects.loses_short_holes,
        }
    }
}

/// Draws all beams of a scan taken at `pose`.
pub(super) fn draw_scan<const W: usize, const H: usize>(
    grid: &mut Grid<W, H>,
    pose: Pose,
    scan: &Scan,
    hole_cells: f32,
    ink: Ink,
) {
    let frame = CellFrame::new(pose, grid.resolution_mm());
    let mut brush = Brush::new(ink);
    for (point, beam) in scan.points().iter().zip(scan.beams()) {
        let (from, hit) = (frame.place(scan.origin(*beam)), frame.place(*point));
        let (dx, dy) = (hit.0 - from.0, hit.1 - from.1);
        let length = libm::hypotf(dx, dy);
        if length < 0.1 {
            continue;
        }
        let stretch = 1.0 + hole_cells / 2.0 / length;
        let end = (from.0 + dx * stretch, from.1 + dy * stretch);
        let ray = Ray {
            from: cell(from),
            hit: cell(hit),
            end: cell(end),
        };
        draw(grid.rows_mut(), &ray, ink, &mut brush);
    }
}

/// The cell of a position; positions far off the map are moved nearer.
fn cell((x, y): (f32, f32)) -> (i32, i32) {
    let index = |cells: f32| {
        let cells = cells.clamp(-9e3, 9e3);
        let towards_zero = whole(cells);
        towards_zero - i32::from(towards_zero as f32 > cells)
    };
    (index(x), index(y))
}

/// The walk from `at` of `long` steps along the long axis and `short` steps along the other; each
/// step changes the index by the given amount.
fn walk(at: usize, (long, ahead): (i32, isize), (short, aside): (i32, isize)) -> Walk {
    // After i steps floor((2 i short + long - 1) / (2 long)) cells have been crossed. Rounded up,
    // the position is too large by at most 2^-18 within the 8191 steps of a map, and the next
    // border is 2^-16 away or farther. At the start the position is a half less half a step's
    // share.
    let (long, short) = (long.unsigned_abs().max(1), short.unsigned_abs());
    let diagonal = (ahead + aside).cast_unsigned();
    if long == short {
        return Walk::straight(at, diagonal);
    }
    Walk {
        at,
        straight: ahead.cast_unsigned(),
        diagonal,
        place: (1 << 31) - (1 << 31) / long,
        slope: parts(short, long),
    }
}

/// `part / whole` with 32 binary places, rounded up; both have 16 bits, and `part` is the smaller.
#[expect(clippy::cast_possible_truncation, reason = "less than one")]
#[expect(clippy::cast_sign_loss, reason = "of positive numbers")]
fn parts(part: u32, whole: u32) -> u32 {
    if WIDE {
        // Double precision, because its division takes half as long as one of 64-bit numbers. The
        // result is accurate to 2^-20, and quotients that are not whole differ from a whole number
        // by at least 2^-16.
        let quotient = f64::from(part) * (1_u64 << 32) as f64 / f64::from(whole);
        let down = quotient as u64 as u32;
        return down + u32::from(f64::from(down) < quotient);
    }
    narrow_parts(part, whole)
}

/// Computes the quotient with two divisions of 32 bits, which a Cortex-M4 can do.
const fn narrow_parts(part: u32, whole: u32) -> u32 {
    let (high, rest) = ((part << 16) / whole, (part << 16) % whole);
    (high << 16) + (rest << 16).div_ceil(whole)
}

/// Draws `ray` from its start up to its end or the map's edge; draws nothing if it starts outside.
#[expect(clippy::cast_possible_truncation, reason = "sizes <= 8191")]
pub(super) fn draw<const W: usize, const H: usize>(
    cells: &mut [[u8; W]; H],
    ray: &Ray,
    ink: Ink,
    brush: &mut Brush,
) {
    let (x, y) = ray.from;
    let (width, height) = (W as i32, H as i32);
    if x < 0 || x >= width || y < 0 || y >= height {
        return;
    }
    let (dx, dy) = (ray.end.0 - x, ray.end.1 - y);
    let steep = dy.abs() >= dx.abs();
    let along_x = (dx.abs(), dx.signum() as isize);
    let along_y = (dy.abs(), dy.signum() as isize * W.cast_signed());
    let (long, short) = if steep {
        (along_y, along_x)
    } else {
        (along_x, along_y)
    };
    let mut line = walk((y * width + x).unsigned_abs() as usize, long, short);
    let (long, short) = (long.0, short.0);
    let behind_hit = if steep {
        (ray.end.1 - ray.hit.1).abs()
    } else {
        (ray.end.0 - ray.hit.0).abs()
    };
    // Cells before the edge on each axis; on the short one, the ray leaves after `short_room`.
    let room = |at: i32, step: i32, size: i32| if step > 0 { size - 1 - at } else { at };
    let (x_room, y_room) = (room(x, dx, width), room(y, dy, height));
    let (long_room, short_room) = if steep {
        (y_room, x_room)
    } else {
        (x_room, y_room)
    };
    let steps = long
        .min(long_room)
        .min(steps_inside(long, short, short_room));
    let hole = Hole::new(long, behind_hit, ink);
    let free_steps = hole.begins_after.clamp(-1, steps);
    let cells = cells.as_flattened_mut();
    line.map(cells, free_steps + 1, &brush.free);
    for flank in hole.flanks(steps, &mut brush.slopes) {
        flank.draw(cells, &mut line, &brush.steps);
    }
}

/// Tables that all rays of a scan share.
pub(super) struct Brush {
    /// New value of a cell on the free path.
    free: [u8; 256],
    /// Steps towards the value of a hole.
    steps: Steps,
    /// Slopes of the hole drawn last.
    slopes: Slopes,
}

impl Brush {
    pub(super) fn new(ink: Ink) -> Self {
        let up = match ink.rounding {
            Rounding::Corrected => 255,
            Rounding::Truncating => 0,
        };
        Self {
            free: faded(ink.weight),
            steps: Steps::new(ink.weight.into(), up),
            slopes: Slopes::new(1),
        }
    }
}

/// The slopes of a hole.
#[derive(Clone, Copy)]
struct Slopes {
    half: u32,
    /// Change of the value per cell and its first part, with 32 binary places.
    rise: u64,
    shift: u64,
}

impl Slopes {
    /// Slopes of a hole of `half` cells to each side, at least one.
    fn new(half: u32) -> Self {
        let peak = u32::from(OBSTACLE);
        Self {
            half,
            rise: (u64::from(peak / half) << 32) + u64::from(parts(peak % half, half)),
            shift: u64::from(parts(half / 2, half)),
        }
    }
}

/// The hole at the end of a ray, along its long axis.
#[derive(Clone, Copy)]
struct Hole {
    /// Last free step; negative if the hole begins at the robot.
    begins_after: i32,
    /// Steps from the hole's begin to the hit, and from the hit to its end.
    half: i32,
}

/// The drawn part of one side of the hole.
struct Flank {
    cells: i32,
    /// Value of the first cell and its change, with 32 binary places.
    value: u64,
    rise: u64,
}

impl Hole {
    /// `behind_hit` cells lie between the hit and the end of a ray of `long` cells.
    const fn new(long: i32, behind_hit: i32, ink: Ink) -> Self {
        let half = match behind_hit {
            0 if ink.loses_short_holes => 0,
            0 => 1,
            half => half,
        };
        Self {
            begins_after: long - behind_hit - half,
            half,
        }
    }

    /// The flanks up to 255 at the hit and down again, for the last of `steps` steps. The remainder
    /// of the division is spread as by the field code's line-drawing error: after i steps up
    /// floor((255 i + half / 2 - 1) / half), after i steps down 255 less ceil((255 i - half / 2) /
    /// half). Both values are too large by less than 2^-15, and the next whole number is 2^-15 away
    /// or farther.
    fn flanks(self, steps: i32, slopes: &mut Slopes) -> [Flank; 2] {
        let half = self.half.unsigned_abs().max(1);
        if slopes.half != half {
            *slopes = Slopes::new(half);
        }
        let Slopes { rise, shift, .. } = *slopes;
        let peak = u32::from(OBSTACLE);
        // 2^-16 for the -1 in the formula: enough to bring the value below a whole number.
        let bottom = shift.saturating_sub(1 << 16);
        let top = (u64::from(peak) << 32) + shift + (1 << 16);
        // Steps of the hole before the robot, and up to the last that is drawn.
        let first = (-1 - self.begins_after).max(0);
        let last = (steps - self.begins_after).max(first);
        let up = first.min(self.half);
        let down = first.max(self.half) - self.half;
        let passed = |cells: i32| u64::from(cells.unsigned_abs() + 1) * rise;
        [
            Flank {
                cells: last.min(self.half) - up,
                value: bottom + passed(up),
                rise,
            },
            Flank {
                cells: last.max(self.half) - self.half - down,
                value: top.wrapping_sub(passed(down)),
                rise: rise.wrapping_neg(),
            },
        ]
    }
}

impl Flank {
    #[inline(never)]
    fn draw(&self, cells: &mut [u8], line: &mut Walk, steps: &Steps) {
        let mut walk = *line;
        let mut value = self.value;
        for _ in 0..self.cells {
            let whole = (value >> 32) as usize;
            value = value.wrapping_add(self.rise);
            let Some(cell) = cells.get_mut(walk.next()) else {
                break;
            };
            steps.apply(cell, whole);
        }
        *line = walk;
    }
}

/// Steps after which a line is still within `room` cells of its start along the short axis.
const fn steps_inside(long: i32, short: i32, room: i32) -> i32 {
    if short == 0 {
        i32::MAX
    } else {
        long * (2 * room + 1) / (2 * short)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::UNKNOWN;
    use proptest::prelude::*;

    const BLACK: Ink = Ink {
        weight: 255,
        rounding: Rounding::Truncating,
        loses_short_holes: false,
    };

    fn row<const N: usize>(ray: &Ray, ink: Ink, start: u8) -> [u8; N] {
        let mut cells = [[start; N]; 3];
        draw(&mut cells, ray, ink, &mut Brush::new(ink));
        cells[1]
    }

    fn along_x(from: i32, hit: i32, end: i32) -> Ray {
        Ray {
            from: (from, 1),
            hit: (hit, 1),
            end: (end, 1),
        }
    }

    /// The profile of the field firmware with weight 255, for a wall at 1000 mm, a hole of 350 mm
    /// and cells of 20 mm: the hit is 50 cells away, the end 59 cells.
    #[test]
    fn the_hole_has_the_fielded_profile() {
        let cells = row::<70>(&along_x(0, 50, 59), BLACK, 0);
        assert_eq!(cells[..42], [0; 42]);
        assert_eq!(
            cells[42..59],
            [
                27, 56, 84, 112, 141, 169, 197, 226, 254, 226, 197, 169, 141, 112, 84, 56, 27
            ]
        );
        assert_eq!(cells[59..], [0; 11]);
    }

    /// Final value for weight k under endless 255: SL-06's figures with the fielded rounding, the
    /// full 255 with ours. Weight 1 never raises the value (SL-05).
    #[test]
    fn only_the_fielded_rounding_makes_the_weight_a_ceiling() {
        let ceiling = |weight, rounding| {
            let ink = Ink {
                weight,
                rounding,
                ..BLACK
            };
            let mut cells = [[UNKNOWN; 3]; 3];
            let mut brush = Brush::new(ink);
            (0..5000).for_each(|_| draw(&mut cells, &along_x(0, 1, 2), ink, &mut brush));
            cells[1][1]
        };
        let fielded =
            [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 100].map(|k| ceiling(k, Rounding::Truncating));
        assert_eq!(
            fielded,
            [127, 128, 170, 192, 204, 213, 219, 224, 227, 230, 253]
        );
        let corrected = [1, 3, 10].map(|k| ceiling(k, Rounding::Corrected));
        assert_eq!(corrected, [255; 3]);
    }

    /// SL-12: a hole of less than two cells divides by zero; the fielded processor answers 0 and
    /// the wall is never drawn.
    #[test]
    fn a_hole_of_less_than_two_cells_still_draws_its_wall() {
        let short = along_x(0, 5, 5);
        assert_eq!(row::<8>(&short, BLACK, 0), [0, 0, 0, 0, 0, 254, 0, 0]);
        let lost = Ink {
            loses_short_holes: true,
            ..BLACK
        };
        assert_eq!(row::<8>(&short, lost, 0), [0; 8]);
    }

    #[test]
    fn a_wall_nearer_than_half_the_hole_is_drawn_at_its_place() {
        let cells = row::<20>(&along_x(10, 12, 17), BLACK, 0);
        assert_eq!(cells[10..18], [152, 203, 254, 203, 152, 101, 50, 0]);
    }

    #[test]
    fn a_ray_from_outside_the_map_draws_nothing() {
        for from in [(-1, 1), (20, 1), (5, 3), (5, -1)] {
            let ray = Ray {
                from,
                hit: (10, 1),
                end: (12, 1),
            };
            assert_eq!(row::<20>(&ray, BLACK, 9), [9; 20]);
        }
    }

    /// The reference: one cell after the other along the same line.
    fn naive<const W: usize, const H: usize>(cells: &mut [[u8; W]; H], ray: &Ray, ink: Ink) {
        let inside = |x: i32, y: i32| x >= 0 && y >= 0 && (x as usize) < W && (y as usize) < H;
        let ((mut x, mut y), (ex, ey)) = (ray.from, ray.end);
        let (dx, dy) = ((ex - x).abs(), (ey - y).abs());
        let steep = dy >= dx;
        let (long, short) = (dx.max(dy), dx.min(dy));
        let half = if steep {
            (ey - ray.hit.1).abs()
        } else {
            (ex - ray.hit.0).abs()
        };
        let (behind_hit, half) = (half, half.max(1));
        let profile = |step: i32| -> i32 {
            let (rise, rest, error) = (255 / half, 255 % half, half / 2);
            match step - (long - behind_hit - half) {
                ..=0 => 0,
                // The error overflows when it exceeds `half`, so not at equality.
                up if up <= half => rise * up + (error + rest * up - 1).div_euclid(half).max(0),
                // On the way down the error is borrowed when it falls below 0.
                down => {
                    let down = down - half;
                    255 - rise * down + (error - rest * down).div_euclid(half).min(0)
                }
            }
        };
        let mut error = 2 * short - long;
        for step in 0..=long {
            if !inside(x, y) {
                return;
            }
            let old = i32::from(cells[y as usize][x as usize]);
            let value = profile(step);
            let weight = i32::from(ink.weight);
            let mixed = (256 - weight) * old + weight * value;
            let rounds_up = ink.rounding == Rounding::Corrected && value > old;
            cells[y as usize][x as usize] =
                u8::try_from((mixed + if rounds_up { 255 } else { 0 }) / 256).unwrap();
            if error > 0 {
                if steep {
                    x += (ex - x).signum()
                } else {
                    y += (ey - y).signum()
                }
                error -= 2 * long;
            }
            error += 2 * short;
            if steep {
                y += (ey - ray.from.1).signum()
            } else {
                x += (ex - ray.from.0).signum()
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8 * ProptestConfig::default().cases))]
        #[test]
        fn rays_draw_the_same_cells_as_the_naive_rule(
            from in (0_i32..40, 0_i32..30), hit in (-60_i32..100, -60_i32..90),
            tenths in 10_i32..18, weight in 1_u16..=255, corrected: bool, start: u8,
        ) {
            let end = |from: i32, hit: i32| from + (hit - from) * tenths / 10;
            let ray = Ray { from, hit, end: (end(from.0, hit.0), end(from.1, hit.1)) };
            let rounding = if corrected { Rounding::Corrected } else { Rounding::Truncating };
            let ink = Ink { weight, rounding, loses_short_holes: false };
            let (mut cells, mut truth) = ([[start; 40]; 30], [[start; 40]; 30]);
            draw(&mut cells, &ray, ink, &mut Brush::new(ink));
            naive(&mut truth, &ray, ink);
            prop_assert!(cells == truth);
        }
    }

    #[test]
    fn a_ray_that_leaves_the_map_is_drawn_up_to_the_edge() {
        let mut grid = Grid::<300, 300>::new(10.0);
        let ray = Ray {
            from: (150, 150),
            hit: (9000, -9000),
            end: (9000, -9000),
        };
        draw(grid.rows_mut(), &ray, BLACK, &mut Brush::new(BLACK));
        // 150 rows down at a slope of 9150 : 8850, so 145 columns farther.
        assert_eq!(
            (grid.get(295, 0), grid.get(296, 0)),
            (Some(0), Some(UNKNOWN))
        );
    }

    /// Of 2^32, a half is 2^31, a third is 1431655765.3, and 65534 parts of 65535 are 65537.00002
    /// less than all of it; fractions are rounded up. This holds for any division of the machine.
    #[test]
    fn parts_are_rounded_up_to_32_places() {
        let expected = [
            ((1, 2), 1 << 31),
            ((3, 8), 3 << 29),
            ((1, 3), 1_431_655_766),
            ((2, 3), 2_863_311_531),
            ((65_534, 65_535), 4_294_901_759),
            ((0, 7), 0),
        ];
        for ((part, whole), parts_2_32) in expected {
            assert_eq!(parts(part, whole), parts_2_32, "{part} {whole}");
            assert_eq!(narrow_parts(part, whole), parts_2_32, "{part} {whole}");
        }
    }

    /// A cell holds the positions from its number on, on both sides of 0; a position off the map is
    /// limited to the range of any map.
    #[test]
    fn a_place_lies_in_the_cell_below() {
        let cells = [(1.5, -1.5), (-2.0, 3.0), (0.99, -0.01), (1e6, -1e6)].map(cell);
        assert_eq!(cells, [(1, -2), (-2, 3), (0, -1), (9_000, -9_000)]);
    }

    /// Cells of 10 mm, a hole of four: a point ten cells ahead has two cells of hole behind it, and
    /// two before. A point nearer than a tenth of a cell has no direction, and is not drawn.
    #[test]
    fn each_beam_of_a_scan_is_a_ray() {
        use crate::pose::Point;
        use protocols::Instant;

        let drawn = |x_mm: f32, y_mm: f32| {
            let mut grid = Grid::<40, 40>::new(10.0);
            let points = [Point::new(x_mm, y_mm)];
            let scan = Scan::from_points(&points, Instant::ZERO, Instant::ZERO);
            draw_scan(&mut grid, Pose::new(205.0, 205.0, 0.0), &scan, 4.0, BLACK);
            grid
        };
        let by_hand = |hit, end| {
            let mut grid = Grid::<40, 40>::new(10.0);
            let ray = Ray {
                from: (20, 20),
                hit,
                end,
            };
            draw(grid.rows_mut(), &ray, BLACK, &mut Brush::new(BLACK));
            grid
        };
        let is_alike = |one: Grid<40, 40>, other: Grid<40, 40>| one.rows() == other.rows();
        assert!(is_alike(drawn(100.0, 0.0), by_hand((30, 20), (32, 20))));
        assert!(is_alike(drawn(0.0, -100.0), by_hand((20, 10), (20, 8))));
        // The point (30, 40) is 50 mm away; the hole's 20 mm behind it are (12, 16).
        assert!(is_alike(drawn(30.0, 40.0), by_hand((23, 24), (24, 26))));
        assert!(is_alike(drawn(0.9, 0.0), Grid::new(10.0)));
        assert!(!is_alike(drawn(1.1, 0.0), Grid::new(10.0)));
    }

    /// Step by step, for holes that start before the robot, at it and behind it, drawn up to their
    /// hit, their end and farther.
    #[test]
    fn both_sides_of_a_hole_are_its_steps_that_are_drawn() {
        for (half, begins_after, steps) in (2..7).flat_map(|half| {
            (-13..4).flat_map(move |begins| (0..12).map(move |steps| (half, begins, steps)))
        }) {
            let hole = Hole { begins_after, half };
            let flanks = hole.flanks(steps, &mut Slopes::new(1));
            let drawn = (begins_after + 1).max(0)..=steps;
            let behind = drawn.map(|step| step - begins_after);
            let (mut up, mut down) = ((0, None), (0, None));
            for i in behind {
                let (side, value) = match i <= half {
                    true => (&mut up, (255 * i + half / 2 - 1) / half),
                    false => {
                        let fallen = 255 * (i - half) - half / 2;
                        (&mut down, 255 - (fallen + half - 1).div_euclid(half))
                    }
                };
                side.0 += 1;
                side.1 = side.1.or(Some(value));
            }
            for (flank, (cells, first)) in flanks.into_iter().zip([up, down]) {
                assert_eq!(flank.cells, cells, "{half} {begins_after} {steps}");
                let is_hole = first.is_none_or(|first| (0..=255).contains(&first));
                let whole = i32::try_from(flank.value >> 32).unwrap_or(-1);
                assert!(
                    !is_hole || first.is_none_or(|first| whole == first),
                    "{half} {begins_after} {steps}: {whole} {first:?}"
                );
            }
        }
    }
}
