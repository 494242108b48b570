//! A stored map of a robot.

use firmware_core::map_view::MapView;

/// A map at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptMap {
    width: usize,
    cell_mm: f32,
    origin_mm: [f32; 2],
    cells: Box<[u8]>,
}

impl KeptMap {
    /// The map.
    pub fn view(&self) -> MapView<'_> {
        MapView::new(self.width, self.cell_mm, self.origin_mm, &self.cells)
    }
}

impl From<MapView<'_>> for KeptMap {
    fn from(map: MapView<'_>) -> Self {
        Self {
            width: map.width(),
            cell_mm: map.cell_mm(),
            origin_mm: map.origin_mm(),
            cells: map.cells().into(),
        }
    }
}
