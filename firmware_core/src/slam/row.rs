//! The search's inner loop: scores of neighbouring poses side by side.
//!
//! Poses that differ by whole cells along x look up neighbouring cells of the same row, so one
//! load serves [`LANES`] of them. No intrinsics are needed, and none can be had without `unsafe`:
//! [`spread`] is written so that compilers turn it into SSE2 code (0.03 ns per look-up measured),
//! and [`packed`] says the same with four cells to a word, for a Cortex-M4, which adds two 16-bit
//! sums at a time.

use crate::grid::Grid;

/// Poses that are scored side by side.
pub(super) const LANES: usize = 32;

/// Points that 16-bit sums can hold: 257 times 255 is 65535.
pub(super) const POINTS_MAX: usize = 257;

/// Sums of map values of neighbouring poses.
pub(super) type Sums = [u16; LANES];

/// Adds up the cells from each of `starts`, plus `offset`, on; a row that runs over the end of the
/// map counts as 0.
#[inline(never)]
pub(super) fn sums(cells: &[u8], starts: &[u32], offset: usize) -> Sums {
    if cfg!(target_arch = "x86_64") {
        spread(cells, starts, offset)
    } else {
        packed(cells, starts, offset)
    }
}

/// One 16-bit sum per lane. The plainest loop is the best one: its sums stay in registers as long
/// as a row is found with a single comparison.
#[inline]
fn spread(cells: &[u8], starts: &[u32], offset: usize) -> Sums {
    let cells = cells.get(offset..).unwrap_or(&[]);
    let mut sums = [0_u16; LANES];
    for start in starts {
        let start = *start as usize;
        if let Some(row) = cells.get(start..start.wrapping_add(LANES)) {
            for (sum, cell) in sums.iter_mut().zip(row) {
                *sum += u16::from(*cell);
            }
        }
    }
    sums
}

/// A point whose window hangs over the map's edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cut {
    /// Index of its lower left cell, were the map's rows one long one that goes on to both sides.
    start: i32,
    /// Its lowest row.
    low: i16,
    /// Where in [`KEPT`] the lanes begin that lie on the map; a map narrower than they are has
    /// none.
    kept: Option<u8>,
}

/// Which lanes count, for windows that hang over the left edge, none, or the right one.
static KEPT: [[u8; LANES]; 3] = [[0; LANES], [u8::MAX; LANES], [0; LANES]];

impl Cut {
    pub(super) const EMPTY: Self = Self {
        start: 0,
        low: 0,
        kept: None,
    };

    /// The point whose window begins at column `left` of row `low` on a map of `width` cells.
    #[inline]
    pub(super) fn new(left: i32, low: i32, width: i32) -> Self {
        const LANES: i32 = 32;
        const {
            assert!(
                LANES.unsigned_abs() as usize == self::LANES,
                "the same lanes"
            )
        };
        let over = (left + LANES - width).max(0);
        let kept = u8::try_from(LANES + left.min(0) + over).ok();
        Self {
            start: low * width + left,
            low: i16::try_from(low).expect("near the map"),
            kept: kept.filter(|_| width >= LANES),
        }
    }
}

/// Adds row `row` of the windows of `cuts` to the lanes; what is not on the map counts as 0.
#[inline(never)]
pub(super) fn add_cut<const W: usize, const H: usize>(
    mut sums: Sums,
    cells: &[[u8; W]; H],
    cuts: &[Cut],
    row: u16,
) -> Sums {
    let flat = cells.as_flattened();
    let offset = i32::from(row) * Grid::<W, H>::WIDTH;
    for cut in cuts {
        let y = (i32::from(cut.low) + i32::from(row)).cast_unsigned() as usize;
        if y >= H {
            continue;
        }
        // A start before the map becomes a huge one here.
        let start = (cut.start + offset).cast_unsigned() as usize;
        let lanes = flat.get(start..start.wrapping_add(LANES));
        let kept = cut.kept.map(usize::from);
        let kept = kept.and_then(|from| KEPT.as_flattened().get(from..from + LANES));
        if let (Some(lanes), Some(kept)) = (lanes, kept) {
            for ((sum, cell), kept) in sums.iter_mut().zip(lanes).zip(kept) {
                *sum += u16::from(*cell & *kept);
            }
        } else {
            let left = cut.start - i32::from(cut.low) * Grid::<W, H>::WIDTH;
            for (sum, cell) in sums.iter_mut().zip(&part(&cells[y], left)) {
                *sum += u16::from(*cell);
            }
        }
    }
    sums
}

/// The lanes from `left` on, where a row's end is the map's as well.
#[cold]
#[inline(never)]
fn part(row: &[u8], left: i32) -> [u8; LANES] {
    let mut part = [0; LANES];
    let skip = left.min(0).unsigned_abs() as usize;
    let cells = row.get(left.max(0).unsigned_abs() as usize..);
    let cells = cells.unwrap_or(&[]);
    for (lane, cell) in part.iter_mut().skip(skip).zip(cells) {
        *lane = *cell;
    }
    part
}

/// Even and odd cells of a word as two 16-bit sums each.
#[inline]
#[cfg_attr(
    target_arch = "x86_64",
    allow(dead_code, reason = "compared with `spread` in tests")
)]
fn packed(cells: &[u8], starts: &[u32], offset: usize) -> Sums {
    const WORDS: usize = LANES / 4;
    const EVEN: u32 = 0x00FF_00FF;
    let (mut even, mut odd) = ([0_u32; WORDS], [0_u32; WORDS]);
    for start in starts {
        let Some(row) = lanes(cells, *start, offset) else {
            continue;
        };
        let (words, _) = row.as_chunks::<4>();
        for ((even, odd), word) in even.iter_mut().zip(&mut odd).zip(words) {
            let word = u32::from_le_bytes(*word);
            *even += word & EVEN;
            *odd += (word >> 8) & EVEN;
        }
    }
    let mut sums = [0; LANES];
    for ((even, odd), sums) in even.iter().zip(odd).zip(sums.as_chunks_mut::<4>().0) {
        let [a0, a1, c0, c1] = even.to_le_bytes();
        let [b0, b1, d0, d1] = odd.to_le_bytes();
        *sums = [[a0, a1], [b0, b1], [c0, c1], [d0, d1]].map(u16::from_le_bytes);
    }
    sums
}

#[inline]
fn lanes(cells: &[u8], start: u32, offset: usize) -> Option<&[u8; LANES]> {
    cells.get(start as usize + offset..)?.first_chunk()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Both forms of the kernel, and the target's choice, against one sum after the other.
        #[test]
        fn every_form_of_the_kernel_gives_the_naive_sums(
            cells in proptest::collection::vec(0_u8.., 400..800),
            starts in proptest::collection::vec(0_u32..800, 0..POINTS_MAX),
            offset in 0_usize..200,
        ) {
            let naive: Sums = core::array::from_fn(|lane| {
                let whole = starts.iter().map(|start| *start as usize + offset);
                let whole = whole.filter(|start| start + LANES <= cells.len());
                whole.map(|start| u16::from(cells[start + lane])).sum()
            });
            prop_assert_eq!(spread(&cells, &starts, offset), naive);
            prop_assert_eq!(packed(&cells, &starts, offset), naive);
            prop_assert_eq!(sums(&cells, &starts, offset), naive);
        }
    }

    fn cut_sums_are_naive<const W: usize>(cells: &[[u8; W]; 9], corners: &[(i32, i32)], row: u16) {
        let width = i32::try_from(W).unwrap();
        let mut cuts = [Cut::EMPTY; 20];
        for (cut, (left, low)) in cuts.iter_mut().zip(corners) {
            *cut = Cut::new(*left, *low, width);
        }
        let cuts = &cuts[..corners.len()];
        let sums = add_cut([7; LANES], cells, cuts, row);
        let naive: Sums = core::array::from_fn(|lane| {
            let lane = i32::try_from(lane).unwrap();
            let of = |(left, low): &(i32, i32)| {
                let y = usize::try_from(low + i32::from(row)).ok()?;
                let x = usize::try_from(left + lane).ok()?;
                cells.get(y)?.get(x).copied().map(u16::from)
            };
            7 + corners.iter().filter_map(of).sum::<u16>()
        });
        assert_eq!(sums, naive);
    }

    proptest! {
        /// At all edges, on maps wider and narrower than the lanes.
        #[test]
        fn windows_over_the_edge_count_what_lies_on_the_map(
            values in proptest::collection::vec(0_u8.., 9 * 40),
            corners in proptest::collection::vec((-32_i32..42, -10_i32..12), 0..20),
            row in 0_u16..31,
        ) {
            cut_sums_are_naive::<40>(values.as_chunks().0.try_into().unwrap(), &corners, row);
            let narrow = values[..180].as_chunks().0;
            cut_sums_are_naive::<20>(narrow.try_into().unwrap(), &corners, row);
        }
    }

    #[test]
    fn the_most_points_of_the_highest_value_do_not_overflow() {
        let starts = [0; POINTS_MAX];
        assert_eq!(sums(&[255; LANES], &starts, 0), [u16::MAX; LANES]);
        assert_eq!(packed(&[255; LANES], &starts, 0), [u16::MAX; LANES]);
    }
}
