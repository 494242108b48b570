/// Cost of a search on the robot's processor, in cycles of a Cortex-M4: the instructions of the
/// inner loops in the release build for thumbv7em-none-eabihf. A load or a store takes two cycles,
/// everything else one. The figures assume memory without wait states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Effort {
    cycles: u64,
    /// Poses compared.
    pub(super) poses: u32,
}

/// One point looked up for all poses of a row, side by side: 86 instructions, 36 of them loads and
/// stores, 3 for the jumps; 3.9 cycles for each of 32 poses. `tests/bare_metal` repeats the count.
const CYCLES_PER_ROW: u32 = 125;
/// One pose compared with the best so far, in floating point.
const CYCLES_PER_POSE: u32 = 30;
/// One point turned into its cell and sorted by whether its window lies on the map.
const CYCLES_PER_PLACED: u32 = 30;
/// One point interpolated from nine cells.
const CYCLES_PER_SMOOTH: u32 = 100;
/// One look-up of the fielded code: 3.457 us at 168 MHz, from the seed report's search times.
const CYCLES_PER_DOCUMENT_POINT: u64 = 581;

impl Effort {
    /// Adds rows of poses side by side: `lanes` poses each, `points` look-ups each.
    pub(super) const fn rows(&mut self, rows: u32, lanes: u32, points: u32) {
        self.poses = self.poses.saturating_add(rows * lanes);
        let row = (CYCLES_PER_ROW * points + CYCLES_PER_POSE * lanes) as u64;
        self.cycles += row * rows as u64;
    }

    /// Adds points turned and shifted into the map.
    pub(super) const fn placed(&mut self, points: u32) {
        self.cycles += (CYCLES_PER_PLACED * points) as u64;
    }

    /// Adds interpolated points.
    pub(super) const fn smooth(&mut self, points: u32) {
        self.cycles += (CYCLES_PER_SMOOTH * points) as u64;
    }

    /// The effort as a number of the document's look-ups.
    pub(super) fn document_points(&self) -> u32 {
        u32::try_from(self.cycles.div_ceil(CYCLES_PER_DOCUMENT_POINT)).unwrap_or(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The widest search of a scan, 31 rows at 49 headings with 120 points, fits the 150 ms that
    /// the seed report gives a search: 25.2 million cycles at 168 MHz.
    #[test]
    fn the_widest_search_of_a_scan_fits_the_time_of_a_search() {
        let mut effort = Effort::default();
        for _ in 0..49 {
            effort.placed(120);
            effort.rows(31, 31, 120);
        }
        effort.smooth(30 * 180);
        assert_eq!(effort.poses, 47_089);
        assert!(effort.cycles < 25_200_000, "{}", effort.cycles);
        assert!(
            effort.document_points() < 150_000 * 1000 / 3457,
            "{effort:?}"
        );
    }
}
