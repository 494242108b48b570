//! The robot's map as received by the PC so far.

use protocols::Instant;
use protocols::pcui::message::MapProperties;
use protocols::rle::{self, RleError};

/// Maximum number of cells of a map, enough for 28 m in cells of 10 mm; larger ones are taken for
/// nonsense.
pub const CELLS_MAX: usize = 1 << 23;
/// Value of a cell that no row has shown: the robot's own word for unknown.
pub const UNSEEN: u8 = 127;

/// Rows collected from the wire; layer 0 only, as no robot has more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PcMap {
    /// Cells in x.
    pub width: usize,
    /// Cells in y.
    pub height: usize,
    /// Edge of a cell.
    pub resolution_mm: u8,
    /// Cells, row by row from y = 0.
    pub pixels: Vec<u8>,
    /// Time at which each row last arrived.
    pub row_seen: Vec<Option<Instant>>,
    rows_missing: usize,
    complete_at: Option<Instant>,
}

/// Reason for a refused row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RowError {
    /// The map has no such layer.
    Layer(u8),
    /// The map has no such row.
    Row {
        /// Number of rows.
        height: usize,
        /// The received row.
        found: u16,
    },
    /// The row is not as wide as the map.
    Width {
        /// Width of the map.
        expected: usize,
        /// The number of received pixels.
        found: usize,
    },
    /// The run-length code is wrong in itself.
    Code(RleError),
}

impl core::fmt::Display for RowError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Layer(layer) => write!(f, "layer {layer}, but the map has only layer 0"),
            Self::Row { height, found } => write!(f, "row {found}, but the map has {height} rows"),
            Self::Width { expected, found } => {
                write!(f, "{found} pixels in a row of {expected}")
            }
            Self::Code(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for RowError {}

impl PcMap {
    /// An unseen map of the size that the robot states, unless that makes no sense.
    pub fn new(properties: &MapProperties) -> Option<Self> {
        let [width, height] = Self::size(properties)?;
        Some(Self {
            width,
            height,
            resolution_mm: properties.resolution_mm,
            pixels: vec![UNSEEN; width * height],
            row_seen: vec![None; height],
            rows_missing: height,
            complete_at: None,
        })
    }

    /// Whether the robot still reports a map of this size.
    pub fn matches(&self, properties: &MapProperties) -> bool {
        self.resolution_mm == properties.resolution_mm
            && Self::size(properties) == Some([self.width, self.height])
    }

    /// Width and height in cells.
    fn size(properties: &MapProperties) -> Option<[usize; 2]> {
        let cells = |size_mm: u16| size_mm.checked_div(u16::from(properties.resolution_mm));
        let [x, y] = properties.size_mm.map(cells);
        let size = [usize::from(x?), usize::from(y?)];
        (1..=CELLS_MAX)
            .contains(&(size[0] * size[1]))
            .then_some(size)
    }

    /// Takes a row of plain pixels.
    pub fn put_row(
        &mut self,
        now: Instant,
        layer: u8,
        y: u16,
        pixels: &[u8],
    ) -> Result<(), RowError> {
        let expected = self.width;
        let row = self.row_mut(layer, y)?;
        if pixels.len() != expected {
            let found = pixels.len();
            return Err(RowError::Width { expected, found });
        }
        row.copy_from_slice(pixels);
        self.see(now, y);
        Ok(())
    }

    /// Takes a row of run-length code. The fielded rule leaves the last pixel out: it keeps its
    /// value.
    pub fn put_coded_row(
        &mut self,
        now: Instant,
        layer: u8,
        y: u16,
        code: &[u8],
    ) -> Result<(), RowError> {
        let expected = self.width;
        let row = self.row_mut(layer, y)?;
        let pairs = code.as_chunks::<2>().0;
        let found = pairs.iter().map(|&[count, _]| usize::from(count)).sum();
        if found + 1 < expected {
            return Err(RowError::Width { expected, found });
        }
        rle::decode(code, row).map_err(RowError::Code)?;
        self.see(now, y);
        Ok(())
    }

    fn row_mut(&mut self, layer: u8, y: u16) -> Result<&mut [u8], RowError> {
        if layer != 0 {
            return Err(RowError::Layer(layer));
        }
        let (start, height) = (usize::from(y) * self.width, self.height);
        self.pixels
            .get_mut(start..start + self.width)
            .ok_or(RowError::Row { height, found: y })
    }

    fn see(&mut self, now: Instant, y: u16) {
        if self.row_seen[usize::from(y)].replace(now).is_none() {
            self.rows_missing -= 1;
            if self.rows_missing == 0 {
                self.complete_at = Some(now);
            }
        }
    }

    /// Number of rows that have not arrived yet.
    pub const fn rows_missing(&self) -> usize {
        self.rows_missing
    }

    /// Time at which the last missing row arrived.
    pub const fn complete_at(&self) -> Option<Instant> {
        self.complete_at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn properties(resolution_mm: u8, size_mm: [u16; 2]) -> MapProperties {
        MapProperties {
            resolution_mm,
            size_mm,
            layers: 1,
            position_mm: [0; 2],
            layer: 0,
            psi_deg: 0,
        }
    }

    /// A map of 4 columns and 2 rows, so that swapped dimensions show.
    fn small() -> PcMap {
        PcMap::new(&properties(10, [40, 20])).expect("eight cells")
    }

    /// The fielded program's figures: 6 m in cells of 20 mm are 300.
    #[test]
    fn the_fielded_map_has_300_rows() {
        let map = PcMap::new(&properties(20, [6_000, 6_000])).expect("90,000 cells");
        assert_eq!((map.width, map.height, map.rows_missing()), (300, 300, 300));
    }

    #[test]
    fn a_size_without_sense_makes_no_map() {
        assert_eq!(PcMap::new(&properties(0, [6_000, 6_000])), None);
        assert_eq!(PcMap::new(&properties(20, [6_000, 19])), None);
        assert_eq!(PcMap::new(&properties(1, [u16::MAX; 2])), None);
    }

    /// Rows like these crashed the fielded PC program.
    #[test]
    fn absurd_rows_change_nothing() {
        let mut map = small();
        let now = Instant::ZERO;
        let width = RowError::Width {
            expected: 4,
            found: 1,
        };
        let row = RowError::Row {
            height: 2,
            found: 2,
        };
        assert_eq!(map.put_row(now, 0, 2, &[0; 4]), Err(row));
        assert_eq!(map.put_row(now, 0, 0, &[0]), Err(width));
        assert_eq!(map.put_row(now, 1, 0, &[0; 4]), Err(RowError::Layer(1)));
        assert_eq!(map.put_coded_row(now, 0, 0, &[1, 0]), Err(width));
        assert_eq!(
            map.put_coded_row(now, 0, 0, &[4, 0, 9]),
            Err(RowError::Code(RleError::OddLength))
        );
        assert_eq!(
            map.put_coded_row(now, 0, 0, &[5, 0]),
            Err(RowError::Code(RleError::TooLong { width: 4 }))
        );
        assert_eq!(map, small());
    }

    /// Both dialects of the code; the fielded one leaves the last column unchanged.
    #[test]
    fn both_dialects_fill_a_row() {
        let mut map = small();
        let [first, second] = [1, 2].map(Instant::from_secs);
        assert_eq!(map.put_coded_row(first, 0, 1, &[1, 9, 3, 5]), Ok(()));
        assert_eq!(map.complete_at(), None);
        assert_eq!(map.put_coded_row(second, 0, 0, &[3, 7]), Ok(()));

        assert_eq!(map.pixels, [7, 7, 7, UNSEEN, 9, 5, 5, 5]);
        assert_eq!(map.complete_at(), Some(second));
        assert_eq!(map.row_seen, [Some(second), Some(first)]);
    }

    /// Cells of another size are another map even if there are as many, and so is another number
    /// of cells.
    #[test]
    fn a_map_is_the_same_by_its_cells_and_their_size() {
        let map = small();
        assert!(map.matches(&properties(10, [40, 20])) && map.matches(&properties(10, [49, 29])));
        assert!(!map.matches(&properties(20, [80, 40])));
        assert!(!map.matches(&properties(10, [20, 40])) && !map.matches(&properties(10, [50, 20])));
        assert!(!map.matches(&properties(0, [40, 20])));
    }
}
