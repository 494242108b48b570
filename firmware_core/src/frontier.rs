//! Choice of the next view, and the test for a complete map. For the part of a robot's program that
//! runs on a PC; feature `host`.
//!
//! The course's report calls a map complete when "all white is enclosed by black". In other words:
//! no free cell near the robot's reachable area has an unknown neighbour. Such cells are the map's
//! open edges.

use alloc::collections::{BTreeMap, BTreeSet, VecDeque};
use alloc::vec::Vec;

use crate::cell_map::{Cell, CellMap};
use crate::grid::{FREE, OBSTACLE, UNKNOWN};
use crate::pose::sin_cos;
use crate::prm::{Dice, escape};

/// Minimum number of connected cells of an open edge; fewer are a crack.
pub const EDGE_CELLS_MIN: usize = 3;
/// Rays of a view, as in the course's program.
const RAYS: u16 = 36;
/// Range of a ray in cells: 5 m, the lidar's range.
const REACH: u16 = 50;
/// Maximum number of unknown cells that a ray counts: 1.5 m.
const UNKNOWN_MAX: u32 = 15;
/// Cost of a cell of the path, in unknown cells.
const WAY_WEIGHT: f32 = 2.0;

/// A position to look from.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Position of the robot.
    pub place: Cell,
    /// The open edges visible from there.
    pub edges: BTreeSet<Cell>,
}

/// The open edges near the area that a robot at `start`, three cells wide, can reach. Edges of
/// `given_up` are left out.
pub fn open_edges(map: &CellMap, start: Cell, given_up: &BTreeSet<Cell>) -> BTreeSet<Cell> {
    let reach = reach(map, &map.eroded(), start);
    let is_edge = |cell: &Cell| {
        let is_open = map.is_free(*cell) && !given_up.contains(cell);
        is_open && cell.neighbours().any(|near| map.get(near) == UNKNOWN)
    };
    let near = reach.keys().flat_map(|cell| cell.block());
    let mut left: BTreeSet<Cell> = near.filter(is_edge).collect();
    let mut edges = BTreeSet::new();
    while let Some(first) = left.pop_first() {
        let mut edge = alloc::vec![first];
        let mut at = 0;
        while let Some(cell) = edge.get(at).copied() {
            edge.extend(cell.neighbours().filter(|near| left.remove(near)));
            at += 1;
        }
        if edge.len() >= EDGE_CELLS_MIN {
            edges.extend(edge);
        }
    }
    edges
}

/// The best position to see the space behind `edges`: many unknown cells, and a short path. `None`
/// if the robot can reach no cell, or there are no edges.
pub fn next_view(map: &CellMap, start: Cell, edges: &BTreeSet<Cell>) -> Option<View> {
    let reach = reach(map, &map.eroded(), start);
    let rays = rays();
    let scored = reach.iter().filter_map(|(place, way)| {
        let (unknown, seen) = look(map, *place, edges, &rays);
        let score = unknown as f32 - WAY_WEIGHT * *way as f32;
        (unknown > 0).then_some((score, *place, seen))
    });
    let best = scored.max_by(|one, other| one.0.total_cmp(&other.0));
    if let Some((_, place, edges)) = best {
        return Some(View { place, edges });
    }
    // If no ray hits the edges, move right in front of one.
    let beside = |cell: &Cell| cell.block().find(|near| reach.contains_key(near));
    let (edge, place) = edges.iter().find_map(|edge| Some((edge, beside(edge)?)))?;
    let edges = BTreeSet::from([*edge]);
    Some(View { place, edges })
}

/// The course's choice: a twentieth of the free cells is drawn at random, and the cell whose rays
/// pass through the most unknown cells wins. Unknown cells behind others count, too. `None` if no
/// ray meets an unknown cell: the map counts as complete.
pub fn random_view(map: &CellMap, open: &CellMap, dice: &mut Dice) -> Option<Cell> {
    let free = open.iter().filter(|(_, value)| *value == FREE);
    let free: Vec<Cell> = free.map(|(cell, _)| cell).collect();
    let drawn = (0..free.len().div_ceil(20)).map(|_| free[dice.index(free.len())]);
    let rays = rays();
    let scored = drawn.map(|place| (all_unknown(map, place, &rays), place));
    let best = scored.max_by_key(|(unknown, _)| *unknown);
    best.filter(|(unknown, _)| *unknown > 0)
        .map(|(_, place)| place)
}

/// Cells of `open` that the middle of a robot at `start` can reach over `map`, with their distances
/// in steps.
pub fn reach(map: &CellMap, open: &CellMap, start: Cell) -> BTreeMap<Cell, u32> {
    let mut reach = BTreeMap::new();
    let first = escape(map, open, start).and_then(|way| way.last().copied());
    let mut next: VecDeque<Cell> = first.into_iter().collect();
    reach.extend(first.map(|cell| (cell, 0)));
    while let Some(cell) = next.pop_front() {
        let way = reach[&cell] + 1;
        for near in cell.edge_neighbours() {
            if open.is_free(near) && !reach.contains_key(&near) {
                reach.insert(near, way);
                next.push_back(near);
            }
        }
    }
    reach
}

/// The cells of a ray, relative to its start, without the start.
type Ray = Vec<Cell>;

/// The rays of a view, equal for all positions.
fn rays() -> Vec<Ray> {
    let ray = |ray: u16| {
        let (sin, cos) = sin_cos((f32::from(ray) * 10.0 + 1.0).to_radians());
        #[expect(clippy::cast_possible_truncation, reason = "at most 50")]
        let along = |far: u16, part: f32| libm::roundf(f32::from(far) * part) as i32;
        let cell = |far: u16| Cell::new(along(far, cos), along(far, sin));
        (1..=REACH).map(cell).collect()
    };
    (0..RAYS).map(ray).collect()
}

/// The cells of a ray that begins at `place`.
fn seen_from(place: Cell, ray: &Ray) -> impl Iterator<Item = Cell> {
    ray.iter()
        .map(move |cell| Cell::new(place.x + cell.x, place.y + cell.y))
}

/// The number of unknown cells seen behind `edges` from `place` along `rays`, and the edges in
/// front of them.
fn look(map: &CellMap, place: Cell, edges: &BTreeSet<Cell>, rays: &[Ray]) -> (u32, BTreeSet<Cell>) {
    let (mut sum, mut seen) = (0, BTreeSet::new());
    for ray in rays {
        let (mut unknown, mut last) = (0, place);
        for cell in seen_from(place, ray) {
            match map.get(cell) {
                FREE if unknown == 0 => last = cell,
                UNKNOWN if unknown > 0 || edges.contains(&last) => unknown += 1,
                // Cells behind unknown ones are uncertain.
                _ => break,
            }
            if unknown == UNKNOWN_MAX {
                break;
            }
        }
        if unknown > 0 {
            seen.insert(last);
            sum += unknown;
        }
    }
    (sum, seen)
}

fn all_unknown(map: &CellMap, place: Cell, rays: &[Ray]) -> usize {
    let (width, height) = map.size();
    let low = map.low();
    let is_inside = |cell: &Cell| {
        (0..width).contains(&(cell.x - low.x)) && (0..height).contains(&(cell.y - low.y))
    };
    let unknown = rays.iter().map(|ray| {
        seen_from(place, ray)
            .take_while(|cell| is_inside(cell) && map.get(*cell) != OBSTACLE)
            .filter(|cell| map.get(*cell) == UNKNOWN)
            .count()
    });
    unknown.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A room of 9 x 9 free cells between walls, with a door of `door` cells in the right one.
    fn room(door: i32) -> CellMap {
        let mut map = CellMap::new(100.0, 2, 10_000);
        for y in 0..=10 {
            for x in 0..=10 {
                let is_door = x == 10 && (4..4 + door).contains(&y);
                let is_wall = [0, 10].contains(&x) || [0, 10].contains(&y);
                let value = if is_wall && !is_door { OBSTACLE } else { FREE };
                map.set(Cell::new(x, y), value).expect("fits");
            }
        }
        map
    }

    const MIDDLE: Cell = Cell::new(5, 5);

    fn edges(map: &CellMap) -> BTreeSet<Cell> {
        open_edges(map, MIDDLE, &BTreeSet::new())
    }

    /// B7: fewer than three cells are no open edge.
    #[test]
    fn a_room_is_complete_when_white_is_enclosed_by_black() {
        assert_eq!(edges(&room(0)), BTreeSet::new());
        assert_eq!(edges(&room(2)), BTreeSet::new());
        let door: BTreeSet<Cell> = (4..7).map(|y| Cell::new(10, y)).collect();
        assert_eq!(edges(&room(3)), door);
        assert_eq!(open_edges(&room(3), MIDDLE, &door), BTreeSet::new());
    }

    /// Free cells in the corner have at most two unknown neighbours: a crack. In the middle of a
    /// wall three cells have one each.
    #[test]
    fn fewer_than_three_cells_are_a_crack() {
        let mut map = room(0);
        for cell in [Cell::new(10, 10), Cell::new(10, 9)] {
            map.set(cell, UNKNOWN).expect("inside");
        }
        assert_eq!(edges(&map), BTreeSet::new());
        map.set(Cell::new(10, 5), UNKNOWN).expect("inside");
        let edge: BTreeSet<Cell> = (4..7).map(|y| Cell::new(9, y)).collect();
        assert_eq!(edges(&map), edge);
    }

    /// An open edge behind a wall that the robot cannot pass does not count.
    #[test]
    fn what_cannot_be_reached_does_not_count() {
        let mut map = room(3);
        for y in 0..=10 {
            map.set(Cell::new(8, y), OBSTACLE).expect("fits");
        }
        assert_eq!(edges(&map), BTreeSet::new());
        assert_eq!(next_view(&map, MIDDLE, &edges(&map)), None);
    }

    #[test]
    fn the_next_view_looks_through_the_door() {
        let map = room(3);
        let view = next_view(&map, MIDDLE, &edges(&map)).expect("there is one");
        assert!(view.place.x >= 5 && !view.edges.is_empty(), "{view:?}");
        let open = map.eroded();
        assert!(open.is_free(view.place));
        // The course's choice finds it, too, unless it draws no cell that sees it.
        let found = (0..20).filter_map(|seed| random_view(&map, &open, &mut Dice::new(seed)));
        assert!(found.count() > 0);
        let closed = room(0);
        let none = random_view(&closed, &closed.eroded(), &mut Dice::new(1));
        assert_eq!(none, None);
    }

    /// Rays of 1, 11 and 351 degrees from the middle of the room leave through the door of three
    /// cells; rays of 21 and 341 degrees meet the wall beside it. Each ray counts at most 15
    /// unknown cells, and none behind the next free cell, 3 m ahead.
    #[test]
    fn a_view_counts_what_is_unknown_behind_the_door() {
        let (mut map, door) = (room(3), edges(&room(3)));
        let seen = [4, 5, 6].map(|y| Cell::new(10, y));
        assert_eq!(
            look(&map, MIDDLE, &door, &rays()),
            (45, BTreeSet::from(seen))
        );
        let only = BTreeSet::from([seen[0]]);
        assert_eq!(look(&map, MIDDLE, &only, &rays()), (15, only.clone()));
        map.set(Cell::new(13, 5), FREE).expect("fits");
        assert_eq!(look(&map, MIDDLE, &door, &rays()).0, 2 + 15 + 15);
        // The course's rays stay in the map, whose margin is one cell there; the walls hide all
        // other unknown cells.
        assert_eq!(all_unknown(&room(3), MIDDLE, &rays()), 3);
        assert_eq!(all_unknown(&room(0), MIDDLE, &rays()), 0);
    }

    /// Distances are counted in steps across cell edges: in 7 x 7 cells the corners are 3 + 3 steps
    /// from the middle.
    #[test]
    fn the_way_to_a_cell_is_counted_in_steps() {
        let map = room(0);
        let reach = reach(&map, &map.eroded(), MIDDLE);
        assert_eq!(reach.len(), 49);
        for (cell, steps) in reach {
            let expected = (cell.x - 5).unsigned_abs() + (cell.y - 5).unsigned_abs();
            assert_eq!(steps, expected, "{cell:?}");
        }
    }
}
