/// What a search costs on the robot's processor, estimated in cycles of a Cortex-M4 from the
/// instructions of the inner loops' bare-metal build, loads as two cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Effort {
    cycles: u64,
    /// Poses compared.
    pub(super) poses: u32,
}

/// One point looked up for the poses of a row, side by side.
const CYCLES_PER_ROW: u32 = 54;
/// One pose compared with the best so far.
const CYCLES_PER_POSE: u32 = 8;
/// One point turned into its cell.
const CYCLES_PER_PLACED: u32 = 20;
/// One point interpolated.
const CYCLES_PER_SMOOTH: u32 = 70;
/// One look-up of the fielded code: 3.457 us at 168 MHz, from the seed report's search times.
const CYCLES_PER_DOCUMENT_POINT: u64 = 581;

impl Effort {
    /// Rows of poses side by side: `lanes` poses each, `points` look-ups each.
    pub(super) const fn rows(&mut self, rows: u32, lanes: u32, points: u32) {
        self.poses = self.poses.saturating_add(rows * lanes);
        let row = (CYCLES_PER_ROW * points + CYCLES_PER_POSE * lanes) as u64;
        self.cycles += row * rows as u64;
    }

    /// Points turned and shifted into the map.
    pub(super) const fn placed(&mut self, points: u32) {
        self.cycles += (CYCLES_PER_PLACED * points) as u64;
    }

    /// Points interpolated.
    pub(super) const fn smooth(&mut self, points: u32) {
        self.cycles += (CYCLES_PER_SMOOTH * points) as u64;
    }

    /// The effort as a number of the document's look-ups.
    pub(super) fn document_points(&self) -> u32 {
        u32::try_from(self.cycles.div_ceil(CYCLES_PER_DOCUMENT_POINT)).unwrap_or(u32::MAX)
    }
}
