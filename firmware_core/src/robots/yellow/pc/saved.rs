//! Faces of the walls of a saved map. Its cells tell no more about the lines from which it was
//! made.
//!
//! ```text
//! # # # .      a run of wall cells with free cells on one side is a face, in the middle of the
//! . . . .      cells: the wall was somewhere in them
//! ```

use alloc::collections::BTreeSet;
use alloc::vec::Vec;

use crate::cell_map::{Cell, CellMap};
use crate::grid::{FREE, OBSTACLE};
use crate::local_map::{CELL_MM, Segment};
use crate::pose::Point;

/// Least number of cells of a face: one cell has no direction.
const CELLS_MIN: i32 = 2;

/// The faces of `map`, each with free space to its left.
pub(super) fn faces(map: &CellMap) -> impl Iterator<Item = Segment> {
    let [walls, free] = [OBSTACLE, FREE].map(|value| cells(map, value));
    // The directions along a face.
    let ways = [[1, 0], [0, 1], [-1, 0], [0, -1]];
    ways.into_iter().flat_map(move |way| {
        let is_face = |cell: Cell| {
            let left = Cell::new(cell.x - way[1], cell.y + way[0]);
            walls.contains(&cell) && free.contains(&left)
        };
        let after =
            |cell: Cell, count: i32| Cell::new(cell.x + count * way[0], cell.y + count * way[1]);
        let begins = walls.iter().copied();
        let begins = begins.filter(|cell| is_face(*cell) && !is_face(after(*cell, -1)));
        let lines = begins.filter_map(|first| {
            let count = (1..).find(|count| !is_face(after(first, *count)))?;
            let last = after(first, count - 1);
            (count >= CELLS_MIN).then(|| Segment::new(edge(first, way, -1), edge(last, way, 1)))
        });
        lines.collect::<Vec<Segment>>()
    })
}

fn cells(map: &CellMap, wanted: u8) -> BTreeSet<Cell> {
    let wanted = map.iter().filter(|(_, value)| *value == wanted);
    wanted.map(|(cell, _)| cell).collect()
}

/// The middle of the edge of `cell` that lies behind (-1) or ahead (1) in the direction `way`.
fn edge(cell: Cell, way: [i32; 2], side: i32) -> Point {
    let along = |at: i32, step: i32| ((2 * at + 1 + side * step) as f32) * CELL_MM / 2.0;
    Point::new(along(cell.x, way[0]), along(cell.y, way[1]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of three cells, free on its lower side, and a single cell with free cells around. The
    /// wall has one face from right to left, so that the free space below is to its left; it is 15
    /// cm high. The single cell has none.
    #[test]
    fn a_run_of_cells_is_a_face_with_free_space_to_its_left() {
        let mut map = CellMap::new(CELL_MM, 0, 100);
        let cells = [(0, 1, OBSTACLE), (1, 1, OBSTACLE), (2, 1, OBSTACLE)];
        let free = [(0, 0, FREE), (1, 0, FREE), (2, 0, FREE), (4, 0, FREE)];
        for (x, y, value) in cells.into_iter().chain(free).chain([(5, 0, OBSTACLE)]) {
            map.set(Cell::new(x, y), value).expect("small");
        }
        let found: Vec<Segment> = faces(&map).collect();
        let expected = Segment::new(Point::new(300.0, 150.0), Point::new(0.0, 150.0));
        assert_eq!(found, [expected]);
    }

    /// A room of 3 by 3 free cells has four faces, which run around it counter-clockwise.
    #[test]
    fn a_room_has_four_faces() {
        let mut map = CellMap::new(CELL_MM, 0, 100);
        for (x, y) in (0..5).flat_map(|y| (0..5).map(move |x| (x, y))) {
            let is_free = (1..4).contains(&x) && (1..4).contains(&y);
            let value = if is_free { FREE } else { OBSTACLE };
            map.set(Cell::new(x, y), value).expect("small");
        }
        let found: Vec<Segment> = faces(&map).collect();
        let line = |from: [f32; 2], to: [f32; 2]| {
            Segment::new(Point::new(from[0], from[1]), Point::new(to[0], to[1]))
        };
        let expected = [
            line([100.0, 50.0], [400.0, 50.0]),
            line([450.0, 100.0], [450.0, 400.0]),
            line([400.0, 450.0], [100.0, 450.0]),
            line([50.0, 400.0], [50.0, 100.0]),
        ];
        assert_eq!(found, expected);
    }
}
