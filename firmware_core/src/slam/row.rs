//! The search's inner loop: scores of neighbouring poses side by side.
//!
//! Poses that differ by whole cells along x look up neighbouring cells of the same row, so one load
//! serves [`LANES`] of them. Intrinsics are not needed, and not possible without `unsafe`:
//! compilers turn [`Twos`] into SSE2 code (0.03 ns per look-up measured, including the whole
//! search). [`packed`] does the same with four cells to a word, for a Cortex-M4, which adds two
//! 16-bit sums at a time.

use super::WIDE;
use crate::grid::Grid;

/// Number of poses scored side by side.
pub(super) const LANES: usize = 32;

/// Maximum number of points for 16-bit sums: 257 times 255 is 65535.
pub(super) const POINTS_MAX: usize = 257;

/// Sums of map values of neighbouring poses; even and odd lanes are separate, as they are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sums {
    even: [u16; LANES / 2],
    odd: [u16; LANES / 2],
}

impl Sums {
    /// The lanes in their order.
    pub(super) fn lanes(&self) -> impl Iterator<Item = u16> {
        self.even
            .iter()
            .zip(&self.odd)
            .flat_map(|(even, odd)| [*even, *odd])
    }

    /// Sums from lanes in their order.
    pub(super) fn from_lanes(lane: impl Fn(usize) -> u16) -> Self {
        Self {
            even: core::array::from_fn(|index| lane(2 * index)),
            odd: core::array::from_fn(|index| lane(2 * index + 1)),
        }
    }

    /// The highest lane; of each lane only the bits in `masks` count.
    pub(super) fn highest(&self, masks: &Self) -> u16 {
        let of = |sums: &[u16], masks: &[u16]| {
            let kept = sums.iter().zip(masks).map(|(sum, mask)| sum & mask);
            kept.fold(0, u16::max)
        };
        of(&self.even, &masks.even).max(of(&self.odd, &masks.odd))
    }

    fn add(&mut self, other: &Self) {
        let even = self.even.iter_mut().zip(&other.even);
        let odd = self.odd.iter_mut().zip(&other.odd);
        even.chain(odd).for_each(|(sum, more)| *sum += more);
    }
}

/// Adds up the cells that start at each of `starts` plus `offset`; cells beyond the end of the map
/// count as 0.
#[inline(never)]
pub(super) fn sums(cells: &[u8], starts: &[u32], offset: usize) -> Sums {
    if WIDE {
        spread(cells, starts, offset)
    } else {
        packed(cells, starts, offset)
    }
}

/// As [`sums`], for two rows, one above the other, on a map of `W` cells across; both must lie on
/// the map.
#[inline(never)]
pub(super) fn pair<const W: usize>(cells: &[u8], starts: &[u32], offset: usize) -> [Sums; 2] {
    if !WIDE {
        return [0, W].map(|above| sums(cells, starts, offset + above));
    }
    let cells = cells.get(offset..).unwrap_or(&[]);
    let (mut low, mut high) = (Twos::ZERO, Twos::ZERO);
    for start in starts {
        let start = *start as usize;
        if let Some(rows) = cells.get(start..start.wrapping_add(W + LANES))
            && let (Some(row), Some(above)) = (rows.first_chunk(), rows.last_chunk())
        {
            low.add(row);
            high.add(above);
        }
    }
    [low.sums(), high.sums()]
}

/// As [`sums`], for the first `L` lanes of `N` rows, one above the other: a window that is narrow
/// needs few lanes, and all of its rows pass while a point's position is at hand. All rows must lie
/// on the map.
#[inline(never)]
pub(super) fn narrow<const N: usize, const L: usize, const W: usize>(
    cells: &[u8],
    starts: &[u32],
    offset: usize,
) -> [[u16; L]; N] {
    let cells = cells.get(offset..).unwrap_or(&[]);
    let mut sums = [[0_u16; L]; N];
    for start in starts {
        let start = *start as usize;
        let Some(cells) = cells.get(start..start.wrapping_add((N - 1) * W + L)) else {
            continue;
        };
        for (row, sums) in sums.iter_mut().enumerate() {
            if let Some(lanes) = cells[row * W..].first_chunk::<L>() {
                for (sum, cell) in sums.iter_mut().zip(lanes) {
                    *sum += u16::from(*cell);
                }
            }
        }
    }
    sums
}

/// One row of the sums.
#[inline]
fn spread(cells: &[u8], starts: &[u32], offset: usize) -> Sums {
    let cells = cells.get(offset..).unwrap_or(&[]);
    let mut twos = Twos::ZERO;
    for start in starts {
        let start = *start as usize;
        let row = cells.get(start..start.wrapping_add(LANES));
        if let Some(row) = row.and_then(|row| row.first_chunk()) {
            twos.add(row);
        }
    }
    twos.sums()
}

/// Sums of cells two by two, for processors that add eight words at a time. Separating cells is the
/// most expensive step, and half of that step can wait for the end. A word of two cells is added as
/// a whole, modulo 2^16, and its upper cell is added once more alone. The first sum minus 256 times
/// the second is the sum of the lower cells, because that is below 2^16.
#[derive(Clone, Copy)]
struct Twos {
    words: [u16; LANES / 2],
    odd: [u16; LANES / 2],
}

impl Twos {
    const ZERO: Self = Self {
        words: [0; LANES / 2],
        odd: [0; LANES / 2],
    };

    #[inline]
    fn add(&mut self, row: &[u8; LANES]) {
        let (twos, _) = row.as_chunks::<2>();
        for ((words, odd), two) in self.words.iter_mut().zip(&mut self.odd).zip(twos) {
            let word = u16::from_le_bytes(*two);
            *words = words.wrapping_add(word);
            *odd += word >> 8;
        }
    }

    /// Adds the cells with a mask of ones; the others count as 0.
    #[inline]
    fn add_masked(&mut self, row: &[u8; LANES], masks: &[u8; LANES]) {
        let (twos, masks) = (row.as_chunks::<2>().0, masks.as_chunks::<2>().0);
        let sums = self.words.iter_mut().zip(&mut self.odd);
        for ((words, odd), (two, mask)) in sums.zip(twos.iter().zip(masks)) {
            let word = u16::from_le_bytes(*two) & u16::from_le_bytes(*mask);
            *words = words.wrapping_add(word);
            *odd += word >> 8;
        }
    }

    #[inline]
    fn sums(&self) -> Sums {
        let lower = |index: usize| self.words[index].wrapping_sub(self.odd[index] << 8);
        Sums {
            even: core::array::from_fn(lower),
            odd: self.odd,
        }
    }
}

/// A point with a window that hangs over the map's edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cut {
    /// Index of the lower left cell in the map's rows, taken as one long row that continues to both
    /// sides.
    start: i32,
    /// Lowest row of the window.
    low: i16,
    /// Start in [`KEPT`] of the lanes that lie on the map; past its end for a map narrower than the
    /// lanes, which has none.
    kept: u8,
}

/// Masks of the valid lanes, for windows that hang over the left edge, none, or the right one.
static KEPT: [[u8; LANES]; 3] = [[0; LANES], [u8::MAX; LANES], [0; LANES]];

impl Cut {
    pub(super) const EMPTY: Self = Self {
        start: 0,
        low: 0,
        kept: u8::MAX,
    };

    /// A cut for a window that begins at column `left` of row `low` on a map of `width` cells.
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
            kept: kept.filter(|_| width >= LANES).unwrap_or(u8::MAX),
        }
    }

    /// Whether row `y` of a window from column `left` on hangs over the map's first or last cell;
    /// on a map narrower than the lanes each row does.
    const fn has_end<const W: usize, const H: usize>(left: i32, y: i32) -> bool {
        let (width, height) = (Grid::<W, H>::WIDTH, Grid::<W, H>::HEIGHT);
        let hangs_over = (y == 0 && left < 0) || (y == height - 1 && left + 32 > width);
        y >= 0 && y < height && (W < LANES || hangs_over)
    }

    /// A bit for each row with such an end, of the window at column `left` of row `low`.
    #[inline]
    pub(super) const fn ends<const W: usize, const H: usize>(left: i32, low: i32) -> u32 {
        let height = Grid::<W, H>::HEIGHT;
        if W < LANES {
            return u32::MAX;
        }
        let mut bits = 0;
        if left < 0 && low <= 0 && low > -32 {
            bits |= 1 << -low;
        }
        if left + 32 > Grid::<W, H>::WIDTH && low < height && low > height - 33 {
            bits |= 1 << (height - 1 - low);
        }
        bits
    }
}

/// Adds the windows of `cuts` to the lanes, in the rows from `row` on; cells outside the map count
/// as 0. `ends` has a bit for each row with ends, see [`Cut::ends`].
#[inline(never)]
pub(super) fn add_cut<const N: usize, const W: usize, const H: usize>(
    sums: &mut [Sums; N],
    cells: &[[u8; W]; H],
    cuts: &[Cut],
    row: u16,
    ends: u32,
) {
    let flat = cells.as_flattened();
    let offset = i32::from(row) * Grid::<W, H>::WIDTH;
    let masks = KEPT.as_flattened();
    let mut twos = [Twos::ZERO; N];
    for cut in cuts {
        let kept = usize::from(cut.kept);
        let kept = masks.get(kept..kept.wrapping_add(LANES));
        let Some(kept) = kept.and_then(|kept| kept.first_chunk()) else {
            continue;
        };
        // For a row below the map, or the part of its first row before the map, the start becomes
        // huge. For a row above the map, or the part of its last row behind the map, the end lies
        // too far.
        let mut start = cut.start + offset;
        for twos in &mut twos {
            let at = start.cast_unsigned() as usize;
            let lanes = flat.get(at..at.wrapping_add(LANES));
            if let Some(lanes) = lanes.and_then(|lanes| lanes.first_chunk()) {
                twos.add_masked(lanes, kept);
            }
            start += Grid::<W, H>::WIDTH;
        }
    }
    for ((row, sums), twos) in (row..).zip(sums).zip(twos) {
        sums.add(&twos.sums());
        if ends >> row & 1 == 1 {
            add_ends(sums, cells, cuts, row);
        }
    }
}

/// Adds the lanes that [`add_cut`]'s loop could not reach: at rows whose end is also the map's end.
#[cold]
#[inline(never)]
fn add_ends<const W: usize, const H: usize>(
    sums: &mut Sums,
    cells: &[[u8; W]; H],
    cuts: &[Cut],
    row: u16,
) {
    for cut in cuts {
        let y = i32::from(cut.low) + i32::from(row);
        let left = cut.start - i32::from(cut.low) * Grid::<W, H>::WIDTH;
        if Cut::has_end::<W, H>(left, y) {
            let part = part(&cells[y.unsigned_abs() as usize], left);
            sums.add(&Sums::from_lanes(|lane| u16::from(part[lane])));
        }
    }
}

/// The lanes from `left` on, for rows whose end is also the map's end.
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
    let halves = |word: u32| {
        let [a, b, c, d] = word.to_le_bytes();
        [[a, b], [c, d]].map(u16::from_le_bytes)
    };
    let apart = |words: [u32; WORDS]| {
        let mut sums = [0; LANES / 2];
        let (twos, _) = sums.as_chunks_mut();
        for (two, word) in twos.iter_mut().zip(words) {
            *two = halves(word);
        }
        sums
    };
    Sums {
        even: apart(even),
        odd: apart(odd),
    }
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
        /// Both variants of the kernel, and the one that the target chooses, equal one sum after
        /// the other.
        #[test]
        fn every_form_of_the_kernel_gives_the_naive_sums(
            cells in proptest::collection::vec(0_u8.., 400..800),
            starts in proptest::collection::vec(0_u32..800, 0..POINTS_MAX),
            offset in 0_usize..200,
        ) {
            let naive = Sums::from_lanes(|lane| {
                let whole = starts.iter().map(|start| *start as usize + offset);
                let whole = whole.filter(|start| start + LANES <= cells.len());
                whole.map(|start| u16::from(cells[start + lane])).sum()
            });
            prop_assert_eq!(spread(&cells, &starts, offset), naive);
            prop_assert_eq!(packed(&cells, &starts, offset), naive);
            prop_assert_eq!(sums(&cells, &starts, offset), naive);
        }

        /// The narrow kernel gives the first lanes of each row, in every variant that is used.
        #[test]
        fn narrow_rows_are_the_first_lanes_of_rows(
            cells in proptest::collection::vec(0_u8.., 900),
            starts in proptest::collection::vec(0_u32..500, 0..POINTS_MAX),
            offset in 0_usize..60,
        ) {
            const W: usize = 40;
            fn check<const N: usize, const L: usize>(
                cells: &[u8],
                starts: &[u32],
                offset: usize,
            ) -> Result<(), TestCaseError> {
                let found = narrow::<N, L, W>(cells, starts, offset);
                for (row, found) in found.iter().enumerate() {
                    let row = sums(cells, starts, offset + row * W);
                    prop_assert!(row.lanes().take(L).eq(found.iter().copied()), "{found:?}");
                }
                Ok(())
            }
            check::<1, 16>(&cells, &starts, offset)?;
            check::<2, 16>(&cells, &starts, offset)?;
            check::<3, 16>(&cells, &starts, offset)?;
            check::<3, 8>(&cells, &starts, offset)?;
            check::<5, 8>(&cells, &starts, offset)?;
            check::<7, 8>(&cells, &starts, offset)?;
        }

        /// Two rows that are summed at once have the same sums as two single rows.
        #[test]
        fn a_pair_of_rows_has_the_sums_of_both(
            cells in proptest::collection::vec(0_u8.., 700),
            starts in proptest::collection::vec(0_u32..500, 0..POINTS_MAX),
            offset in 0_usize..100,
        ) {
            let rows = [0, 70].map(|above| packed(&cells, &starts, offset + above));
            prop_assert_eq!(pair::<70>(&cells, &starts, offset), rows);
        }
    }

    fn cut_sums_are_naive<const W: usize>(cells: &[[u8; W]; 9], corners: &[(i32, i32)], row: u16) {
        let width = i32::try_from(W).unwrap();
        let mut cuts = [Cut::EMPTY; 20];
        for (cut, (left, low)) in cuts.iter_mut().zip(corners) {
            *cut = Cut::new(*left, *low, width);
        }
        let cuts = &cuts[..corners.len()];
        let ends = corners
            .iter()
            .fold(0, |ends, (left, low)| ends | Cut::ends::<W, 9>(*left, *low));
        let mut sums = [Sums::from_lanes(|_| 7); 2];
        add_cut(&mut sums, cells, cuts, row, ends);
        let naive = |row: u16| {
            Sums::from_lanes(|lane| {
                let lane = i32::try_from(lane).unwrap();
                let of = |(left, low): &(i32, i32)| {
                    let y = usize::try_from(low + i32::from(row)).ok()?;
                    let x = usize::try_from(left + lane).ok()?;
                    cells.get(y)?.get(x).copied().map(u16::from)
                };
                7 + corners.iter().filter_map(of).sum::<u16>()
            })
        };
        assert_eq!(sums, [naive(row), naive(row + 1)]);
    }

    proptest! {
        /// Windows over all edges, on maps wider and narrower than the lanes.
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
        assert_eq!(
            sums(&[255; LANES], &starts, 0),
            Sums::from_lanes(|_| u16::MAX)
        );
        assert_eq!(
            packed(&[255; LANES], &starts, 0),
            Sums::from_lanes(|_| u16::MAX)
        );
    }

    /// Row after row as [`Cut::has_end`] gives, for windows all around a map at least as wide as
    /// the lanes; on a narrower map each row has ends.
    #[test]
    fn the_rows_with_ends_are_those_that_hang_over() {
        let mut narrow = 0;
        for left in -40..60 {
            for low in -40..60 {
                let expected = (0..32).filter(|row| Cut::has_end::<48, 50>(left, low + row));
                let bits = expected.fold(0, |bits, row| bits | 1_u32 << row);
                assert_eq!(Cut::ends::<48, 50>(left, low), bits, "{left} {low}");
                narrow |= !Cut::ends::<20, 50>(left, low);
            }
        }
        assert_eq!(narrow, 0);
    }

    /// The lanes hold 100, 101 up to 131; a lane without a mask does not count, and 131 without its
    /// lowest two bits is 128.
    #[test]
    fn the_highest_lane_is_that_of_the_masks() {
        let sums = Sums::from_lanes(|lane| 100 + u16::try_from(lane).unwrap());
        let highest = |mask: &dyn Fn(usize) -> u16| sums.highest(&Sums::from_lanes(mask));
        assert_eq!(highest(&|_| u16::MAX), 131);
        assert_eq!(highest(&|_| 0), 0);
        assert_eq!(highest(&|lane| if lane <= 7 { u16::MAX } else { 0 }), 107);
        assert_eq!(highest(&|lane| if lane == 4 { u16::MAX } else { 0 }), 104);
        assert_eq!(highest(&|_| !3), 128);
    }
}
