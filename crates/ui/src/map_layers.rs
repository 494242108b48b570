//! Maps as rows with version numbers, so that a page gets only changed rows.

use std::sync::Arc;

use bytes::Bytes;
use protocols::rle::{self, Dialect};
use serde::Serialize;

/// One row as run-length pairs of count and value.
#[derive(Clone, Debug)]
pub(super) struct Row {
    version: u64,
    code: Bytes,
}

/// A map at one snapshot. Rows that did not change are shared between snapshots.
#[derive(Clone, Debug)]
pub(super) struct Layer {
    pub(super) head: Head,
    rows: Vec<Row>,
}

/// Properties of a map that a page needs before its rows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Head {
    /// The owner of the map.
    pub(super) name: &'static str,
    /// Cells along x.
    pub(super) width: usize,
    /// Cells along y.
    pub(super) height: usize,
    /// Edge of a cell.
    pub(super) resolution_m: f64,
    /// Corner with minimum x and y.
    pub(super) origin_m: [f64; 2],
}

/// First byte of a message with rows.
const ROWS: u8 = 1;

impl Layer {
    /// Appends the rows newer than `seen` in the format for pages; returns the newest version.
    ///
    /// ```text
    /// | layer u8 | row u16 | length u16 | code |      little-endian, after one byte 1 for them all
    /// ```
    pub(super) fn write_since(&self, seen: u64, layer: u8, out: &mut Vec<u8>) -> u64 {
        let mut newest = seen;
        for (y, row) in (0_u16..).zip(&self.rows) {
            if row.version <= seen {
                continue;
            }
            newest = newest.max(row.version);
            let len = u16::try_from(row.code.len()).expect("twice the width of a map");
            if out.is_empty() {
                out.push(ROWS);
            }
            out.push(layer);
            out.extend(y.to_le_bytes());
            out.extend(len.to_le_bytes());
            out.extend(&*row.code);
        }
        newest
    }

    /// All rows of `layers` as one message.
    pub(super) fn whole(layers: &[Arc<Self>]) -> Vec<u8> {
        let mut out = Vec::new();
        for (index, layer) in (0..).zip(layers) {
            layer.write_since(0, index, &mut out);
        }
        out
    }
}

/// The latest state of a map.
#[derive(Debug)]
pub(super) struct MapLayer {
    cells: Vec<u8>,
    version: u64,
    last: Arc<Layer>,
}

impl MapLayer {
    /// An empty map.
    pub(super) fn new(name: &'static str) -> Self {
        let head = Head {
            name,
            width: 0,
            height: 0,
            resolution_m: 0.0,
            origin_m: [0.0; 2],
        };
        let rows = Vec::new();
        Self {
            cells: Vec::new(),
            version: 0,
            last: Arc::new(Layer { head, rows }),
        }
    }

    /// The owner of the map.
    pub(super) fn name(&self) -> &'static str {
        self.last.head.name
    }

    /// The latest state of the map.
    pub(super) fn last(&self) -> Arc<Layer> {
        Arc::clone(&self.last)
    }

    /// Updates the map row by row.
    pub(super) fn look<'a>(
        &mut self,
        [width, height]: [usize; 2],
        resolution_m: f64,
        origin_m: [f64; 2],
        row: impl Fn(usize) -> Option<&'a [u8]>,
    ) {
        let mut layer = Layer::clone(&self.last);
        let head = Head {
            width,
            height,
            resolution_m,
            origin_m,
            ..layer.head
        };
        let is_new = layer.head != head;
        self.version += 1;
        if is_new {
            layer.head = head;
            self.cells = vec![0; width * height];
            let nothing = Row {
                version: 0,
                code: Bytes::new(),
            };
            layer.rows = vec![nothing; height];
        }
        let mut code = vec![0; 2 * width];
        for (y, old) in self.cells.chunks_mut(width.max(1)).enumerate() {
            let Some(cells) = row(y).filter(|cells| is_new || *cells != &*old) else {
                continue;
            };
            old.copy_from_slice(cells);
            let len = rle::encode(cells, Dialect::Lossless, &mut code).expect("two bytes a cell");
            layer.rows[y] = Row {
                version: self.version,
                code: Bytes::copy_from_slice(&code[..len]),
            };
        }
        self.last = Arc::new(layer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 300 cells of one value are runs of 255 and 45; an unchanged row is not sent again.
    #[test]
    fn a_page_gets_each_change_once() {
        let mut book = MapLayer::new("map");
        let mut cells = vec![[127_u8; 300]; 2];
        let size = [300, 2];
        book.look(size, 0.01, [0.0; 2], |y| Some(&cells[y]));
        let mut out = Vec::new();
        let seen = book.last().write_since(0, 3, &mut out);
        let row = |y| [3, y, 0, 4, 0, 255, 127, 45, 127];
        assert_eq!(out, [&[ROWS][..], &row(0), &row(1)].concat());

        cells[1][299] = 9;
        book.look(size, 0.01, [0.0; 2], |y| Some(&cells[y]));
        out.clear();
        let seen = book.last().write_since(seen, 3, &mut out);
        assert_eq!(out, [ROWS, 3, 1, 0, 6, 0, 255, 127, 44, 127, 1, 9]);
        out.clear();
        book.look(size, 0.01, [0.0; 2], |y| Some(&cells[y]));
        assert_eq!(book.last().write_since(seen, 3, &mut out), seen);
        assert!(out.is_empty(), "{out:?}");
    }
}
