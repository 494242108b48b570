//! The search's inner loop: scores of neighbouring poses side by side.
//!
//! Poses that differ by whole cells along x look up neighbouring cells of the same row, so one
//! load serves [`LANES`] of them. No intrinsics are needed, and none can be had without `unsafe`:
//! [`spread`] is written so that compilers turn it into SSE2 code (0.03 ns per look-up measured),
//! and [`packed`] says the same with four cells to a word, for a Cortex-M4, which adds two 16-bit
//! sums at a time.

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

/// One 16-bit sum per lane; eight rows at a time, so that the sums are loaded and stored seldom.
#[inline]
fn spread(cells: &[u8], starts: &[u32], offset: usize) -> Sums {
    let mut sums = [0_u16; LANES];
    let (groups, rest) = starts.as_chunks::<8>();
    for group in groups {
        let rows = group.map(|start| lanes(cells, start, offset).unwrap_or(&[0; LANES]));
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum += rows.iter().map(|row| u16::from(row[lane])).sum::<u16>();
        }
    }
    for start in rest {
        if let Some(row) = lanes(cells, *start, offset) {
            add(&mut sums, row);
        }
    }
    sums
}

/// Adds a row's cells to the lanes.
#[inline]
pub(super) fn add(sums: &mut Sums, row: &[u8; LANES]) {
    for (sum, cell) in sums.iter_mut().zip(row) {
        *sum += u16::from(*cell);
    }
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

    #[test]
    fn the_most_points_of_the_highest_value_do_not_overflow() {
        let starts = [0; POINTS_MAX];
        assert_eq!(sums(&[255; LANES], &starts, 0), [u16::MAX; LANES]);
        assert_eq!(packed(&[255; LANES], &starts, 0), [u16::MAX; LANES]);
    }
}
