//! Paths over a map by a probabilistic roadmap. For the part of a robot's program that runs on a
//! PC; feature `host`.
//!
//! Vertices are drawn at random from the open cells. Each is joined to all earlier ones within
//! reach if the straight line between them is open (as in P. Corke's Robotics Toolbox, which the
//! robot's developers used). The map is eroded before, so that a robot has room around its middle.

use alloc::vec::Vec;

use crate::astar::cheapest_way;
use crate::cell_map::{Cell, CellMap};
use crate::grid::FREE;
use crate::random::Pcg32;

/// Vertices of the course's roadmap.
pub const VERTICES: usize = 100;
/// Maximum number of vertices before the search from cell to cell.
pub const VERTICES_MAX: usize = 800;
/// Maximum length of an edge, cells.
pub const REACH_CELLS: f32 = 30.0;
/// Maximum distance of the start from the open cells, in steps from cell to cell.
const ESCAPE_STEPS: usize = 4;
/// Maximum shift of a path point towards more room, cells.
const SHIFT_CELLS: i32 = 3;
/// Distance from walls beyond which more room has no value, cells.
const ROOM_CELLS: i32 = 4;

/// Vertices and their edges.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Roadmap {
    /// Positions of the vertices.
    pub vertices: Vec<Cell>,
    /// Pairs of vertices, the later one first.
    pub edges: Vec<(usize, usize)>,
}

/// Random numbers for vertices, from a seed.
#[derive(Clone, Debug)]
pub struct Dice(Pcg32);

impl Dice {
    /// The random numbers of this seed.
    pub const fn new(seed: u64) -> Self {
        Self(Pcg32::new(seed))
    }

    /// A random index below `count`, 0 if `count` is 0.
    pub fn index(&mut self, count: usize) -> usize {
        let limit = u32::try_from(count).unwrap_or(u32::MAX).max(1);
        usize::try_from(self.0.below(limit)).unwrap_or(0)
    }
}

impl Roadmap {
    /// A roadmap of `count` vertices on the free cells of `open`; empty if no cell is free.
    pub fn new(open: &CellMap, count: usize, dice: &mut Dice) -> Self {
        let free = open.iter().filter(|(_, value)| *value == FREE);
        let free: Vec<Cell> = free.map(|(cell, _)| cell).collect();
        let mut roadmap = Self::default();
        let count = if free.is_empty() { 0 } else { count };
        for at in 0..count {
            let vertex = free[dice.index(free.len())];
            for (earlier, to) in roadmap.vertices.iter().enumerate() {
                if vertex.distance(*to) <= REACH_CELLS && is_clear(open, vertex, *to) {
                    roadmap.edges.push((at, earlier));
                }
            }
            roadmap.vertices.push(vertex);
        }
        roadmap
    }

    /// The shortest path over the roadmap, from the visible vertex nearest to `start` to the
    /// visible one nearest to `goal`; `None` without one.
    pub fn way(&self, open: &CellMap, start: Cell, goal: Cell) -> Option<Vec<Cell>> {
        let (from, to) = (self.nearest(open, start)?, self.nearest(open, goal)?);
        let mut near = alloc::vec![Vec::new(); self.vertices.len()];
        for &(one, other) in &self.edges {
            near[one].push(other);
            near[other].push(one);
        }
        let cost = |one: usize, other: usize| cost(self.vertices[one], self.vertices[other]);
        let edges = |at: usize, report: &mut dyn FnMut(usize, u32)| {
            near[at].iter().for_each(|to| report(*to, cost(at, *to)));
        };
        let way = cheapest_way(near.len(), from, to, edges, |at| cost(at, to))?;
        let mut cells = alloc::vec![start];
        cells.extend(way.into_iter().map(|vertex| self.vertices[vertex]));
        cells.push(goal);
        cells.dedup();
        Some(cells)
    }

    fn nearest(&self, open: &CellMap, to: Cell) -> Option<usize> {
        let mut order: Vec<usize> = (0..self.vertices.len()).collect();
        let distance = |at: &usize| self.vertices[*at].distance(to);
        order.sort_by(|one, other| distance(one).total_cmp(&distance(other)));
        order
            .into_iter()
            .find(|at| is_clear(open, self.vertices[*at], to))
    }
}

/// Distance in hundredths of a cell.
fn cost(from: Cell, to: Cell) -> u32 {
    #[expect(clippy::cast_possible_truncation, reason = "a map is far smaller")]
    #[expect(clippy::cast_sign_loss, reason = "a distance")]
    let cost = libm::roundf(from.distance(to) * 100.0) as u32;
    cost
}

/// Whether all cells of the straight path are free (Bresenham's line, as in the toolbox). The first
/// cell may have any value because the robot is already there.
pub fn is_clear(open: &CellMap, from: Cell, to: Cell) -> bool {
    let (dx, dy) = ((to.x - from.x).abs(), (to.y - from.y).abs());
    let (step_x, step_y) = ((to.x - from.x).signum(), (to.y - from.y).signum());
    let (mut cell, mut error) = (from, dx - dy);
    while cell != to {
        let double = 2 * error;
        if double > -dy {
            error -= dy;
            cell.x += step_x;
        }
        if double < dx {
            error += dx;
            cell.y += step_y;
        }
        if !open.is_free(cell) && cell != to {
            return false;
        }
    }
    open.is_free(to) || from == to
}

/// The shortest path from cell to cell, without cutting corners; `None` without one.
pub fn grid_way(open: &CellMap, start: Cell, goal: Cell) -> Option<Vec<Cell>> {
    let (width, height) = open.size();
    let low = open.low();
    let inside = |cell: Cell| {
        let (x, y) = (cell.x - low.x, cell.y - low.y);
        let is_inside = (0..width).contains(&x) && (0..height).contains(&y);
        is_inside.then(|| usize::try_from(y * width + x).ok())?
    };
    let cell = |index: usize| {
        let index = i32::try_from(index).unwrap_or(0);
        Cell::new(low.x + index % width, low.y + index / width)
    };
    let edges = |at: usize, report: &mut dyn FnMut(usize, u32)| {
        let from = cell(at);
        for next in from.neighbours().filter(|next| open.is_free(*next)) {
            let corners = [Cell::new(from.x, next.y), Cell::new(next.x, from.y)];
            let is_cut = corners.iter().any(|by| *by != from && !open.is_free(*by));
            if let Some(index) = inside(next).filter(|_| !is_cut) {
                report(index, cost(from, next));
            }
        }
    };
    let (from, to) = (inside(start)?, inside(goal)?);
    let count = usize::try_from(i64::from(width) * i64::from(height)).ok()?;
    let way = cheapest_way(count, from, to, edges, |at| cost(cell(at), goal))?;
    Some(way.into_iter().map(cell).collect())
}

/// Whether all cells that the straight line touches are free, except perhaps the first.
fn is_wide(open: &CellMap, from: Cell, to: Cell) -> bool {
    let mut is_wide = true;
    let walk = open.walk(open.centre_of(from), open.centre_of(to), |cell| {
        is_wide &= cell == from || open.is_free(cell);
        is_wide
    });
    walk.is_ok() && is_wide
}

/// Removes unnecessary points: corners are cut if all cells that the straight line touches are
/// free.
pub fn smoothed(open: &CellMap, way: &[Cell]) -> Vec<Cell> {
    let mut kept: Vec<Cell> = way.first().copied().into_iter().collect();
    let mut at = 0;
    while at + 1 < way.len() {
        let far = (at + 2..way.len()).rev();
        let next = far
            .into_iter()
            .find(|next| is_wide(open, way[at], way[*next]))
            .unwrap_or(at + 1);
        kept.push(way[next]);
        at = next;
    }
    kept
}

/// Moves the inner points of a path away from walls, because odometry is not exact. Each point
/// moves to the nearby cell with the most room that has both its neighbours in sight.
pub fn centred(map: &CellMap, open: &CellMap, way: &[Cell]) -> Vec<Cell> {
    let mut way = way.to_vec();
    for at in 1..way.len().saturating_sub(1) {
        let (before, here, after) = (way[at - 1], way[at], way[at + 1]);
        let near = square(here, SHIFT_CELLS).filter(|cell| {
            let is_open = open.is_free(*cell);
            is_open && is_wide(open, before, *cell) && is_wide(open, *cell, after)
        });
        let room = |cell: &Cell| (room(map, *cell), u32::MAX - cost(*cell, here));
        way[at] = near.max_by_key(room).unwrap_or(here);
    }
    way
}

/// Squared distance to the nearest cell that is not free, within `ROOM_CELLS`.
fn room(map: &CellMap, cell: Cell) -> i32 {
    let apart = |near: Cell| (near.x - cell.x).pow(2) + (near.y - cell.y).pow(2);
    let walls = square(cell, ROOM_CELLS).filter(|near| !map.is_free(*near));
    walls.map(apart).min().unwrap_or(i32::MAX)
}

fn square(cell: Cell, reach: i32) -> impl Iterator<Item = Cell> {
    (-reach..=reach)
        .flat_map(move |y| (-reach..=reach).map(move |x| Cell::new(cell.x + x, cell.y + y)))
}

/// The path from `start`, which may not be open, to the nearest open cell: `start` alone if it is
/// open, `None` if there is no open cell nearby.
pub fn escape(map: &CellMap, open: &CellMap, start: Cell) -> Option<Vec<Cell>> {
    let mut reached = alloc::vec![(start, 0)];
    let mut from = 0;
    let back = |reached: &[(Cell, usize)], mut at: usize| {
        let mut way = alloc::vec![reached[at].0];
        while at != 0 {
            at = reached[at].1;
            way.push(reached[at].0);
        }
        way.reverse();
        way
    };
    for _ in 0..=ESCAPE_STEPS {
        let to = reached.len();
        if let Some(at) = (from..to).find(|at| open.is_free(reached[*at].0)) {
            return Some(back(&reached, at));
        }
        for at in from..to {
            for near in reached[at].0.edge_neighbours() {
                let is_new = reached.iter().all(|(known, _)| *known != near);
                if is_new && map.is_free(near) {
                    reached.push((near, at));
                }
            }
        }
        from = to;
    }
    None
}

/// Plans a path over `map` for a robot that needs the room of 3 x 3 cells: by roadmaps of more and
/// more vertices, finally from cell to cell. Also returns the last roadmap.
pub fn plan(
    map: &CellMap,
    start: Cell,
    goal: Cell,
    dice: &mut Dice,
) -> (Roadmap, Option<Vec<Cell>>) {
    let open = map.eroded();
    let mut roadmap = Roadmap::default();
    let Some(mut way) = escape(map, &open, start) else {
        return (roadmap, None);
    };
    let from = way.pop().unwrap_or(start);
    let mut count = VERTICES;
    let mut found = None;
    while found.is_none() && count <= VERTICES_MAX {
        roadmap = Roadmap::new(&open, count, dice);
        found = roadmap.way(&open, from, goal);
        count *= 2;
    }
    let found = found.or_else(|| grid_way(&open, from, goal));
    let found = found.map(|rest| {
        way.extend(centred(map, &open, &smoothed(&open, &rest)));
        way
    });
    (roadmap, found)
}

/// As [`plan`], but as the course does it: frees the start, builds one roadmap of 100 vertices, and
/// returns its result.
pub fn plan_once(
    map: &CellMap,
    start: Cell,
    goal: Cell,
    dice: &mut Dice,
) -> (Roadmap, Option<Vec<Cell>>) {
    let mut open = map.eroded();
    let roadmap = match open.set(start, FREE) {
        Ok(()) => Roadmap::new(&open, VERTICES, dice),
        Err(_) => Roadmap::default(),
    };
    let way = roadmap.way(&open, start, goal);
    (roadmap, way)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::OBSTACLE;

    /// Six corridors of five cells between walls of one, joined at alternating ends: 3.7 m square,
    /// as in the specification's figures.
    fn serpentine() -> CellMap {
        let mut map = CellMap::new(100.0, 0, 10_000);
        for y in 0..37 {
            for x in 0..37 {
                let is_outside = [x, y].iter().any(|at| [0, 36].contains(at));
                let is_gap = if y % 12 == 6 { x > 30 } else { x < 6 };
                let is_wall = is_outside || (y % 6 == 0 && !is_gap);
                let value = if is_wall { OBSTACLE } else { FREE };
                map.set(Cell::new(x, y), value).expect("fits");
            }
        }
        map
    }

    const START: Cell = Cell::new(3, 3);
    const GOAL: Cell = Cell::new(3, 33);

    fn successes(count: usize) -> usize {
        let open = serpentine().eroded();
        let way = |seed| Roadmap::new(&open, count, &mut Dice::new(seed)).way(&open, START, GOAL);
        (0..100).filter(|seed| way(*seed).is_some()).count()
    }

    /// The specification found a path with 3, 50, 95 and 100 of 100 seeds, for 50, 100, 200 and 300
    /// vertices. It does not give the start and goal, so other counts near these are accepted.
    #[test]
    fn more_vertices_find_a_way_through_a_serpentine() {
        let [few, course, more, many] = [50, 100, 200, 300].map(successes);
        assert!(few <= 10, "{few}");
        assert!((30..=70).contains(&course), "{course}");
        assert!(more >= 90 && many >= 98, "{more} {many}");
    }

    #[test]
    fn ours_always_finds_the_way_through_a_serpentine() {
        let map = serpentine();
        let open = map.eroded();
        for seed in 0..20 {
            let (_, way) = plan(&map, START, GOAL, &mut Dice::new(seed));
            let way = way.expect("there is one");
            assert_eq!((way.first(), way.last()), (Some(&START), Some(&GOAL)));
            assert!(way.iter().all(|cell| open.is_free(*cell)), "{way:?}");
            assert!(
                way.windows(2).all(|leg| is_clear(&open, leg[0], leg[1])),
                "{way:?}"
            );
        }
        // The search from cell to cell alone, and a goal inside a wall.
        assert!(grid_way(&open, START, GOAL).is_some());
        let (_, way) = plan(&map, START, Cell::new(0, 0), &mut Dice::new(1));
        assert_eq!(way, None);
    }

    /// Two halls of 140 x 140 cells, joined by a passage with four corners and one open cell in
    /// each row: hardly any vertex falls into it.
    #[test]
    fn where_no_roadmap_helps_cells_do() {
        let mut map = CellMap::new(100.0, 0, 100_000);
        let mut fill = |low: Cell, high: Cell| {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    map.set(Cell::new(x, y), FREE).expect("fits");
                }
            }
        };
        fill(Cell::new(0, 0), Cell::new(139, 139));
        fill(Cell::new(160, 0), Cell::new(299, 139));
        fill(Cell::new(139, 60), Cell::new(146, 62));
        fill(Cell::new(144, 60), Cell::new(146, 70));
        fill(Cell::new(144, 68), Cell::new(154, 70));
        fill(Cell::new(152, 60), Cell::new(154, 70));
        fill(Cell::new(152, 60), Cell::new(161, 62));
        let (start, goal) = (Cell::new(5, 5), Cell::new(290, 5));
        let (roadmap, way) = plan(&map, start, goal, &mut Dice::new(1));
        assert_eq!(roadmap.vertices.len(), VERTICES_MAX);
        assert!(way.is_some());
    }

    /// A robot in a cell beside a wall first drives to a cell with room.
    #[test]
    fn a_robot_beside_a_wall_gets_away() {
        let map = serpentine();
        let (_, way) = plan(&map, Cell::new(1, 3), GOAL, &mut Dice::new(1));
        assert_eq!(
            way.expect("there is one")[..2],
            [Cell::new(1, 3), Cell::new(2, 3)]
        );
    }

    /// A map of rows from y = 0; its first cell is `low`: a dot is free, all other characters are
    /// obstacles.
    fn drawn(low: Cell, rows: &[&str]) -> CellMap {
        let mut map = CellMap::new(100.0, 0, 10_000);
        for (y, row) in (low.y..).zip(rows) {
            for (x, what) in (low.x..).zip(row.chars()) {
                let value = if what == '.' { FREE } else { OBSTACLE };
                map.set(Cell::new(x, y), value).expect("fits");
            }
        }
        map
    }

    const ORIGIN: Cell = Cell::new(0, 0);

    fn cells(places: &[(i32, i32)]) -> Vec<Cell> {
        places.iter().map(|(x, y)| Cell::new(*x, *y)).collect()
    }

    /// Bresenham's line of four cells across and two up, by hand, and its mirror images: an
    /// obstacle in any of its cells but the first blocks the path, and no other cell does.
    #[test]
    fn a_straight_way_is_clear_when_its_cells_are() {
        let line = [(1, 0), (2, 1), (3, 1), (4, 2)];
        let images: [fn(i32, i32) -> Cell; 6] = [
            |x, y| Cell::new(x, y),
            |x, y| Cell::new(-x, y),
            |x, y| Cell::new(x, -y),
            |x, y| Cell::new(-x, -y),
            |x, y| Cell::new(y, x),
            |x, y| Cell::new(-y, -x),
        ];
        let open = drawn(Cell::new(-5, -5), &["..........."; 11]);
        for image in images {
            let on_the_line = line.map(|(x, y)| image(x, y));
            for (block, _) in open.iter() {
                let mut map = open.clone();
                map.set(block, OBSTACLE).expect("inside");
                let is_clear = is_clear(&map, ORIGIN, image(4, 2));
                assert_eq!(is_clear, !on_the_line.contains(&block), "{block:?}");
            }
        }
        assert!(is_clear(&drawn(ORIGIN, &["#"]), ORIGIN, ORIGIN));
    }

    /// Around an obstacle in the middle of nine cells no corner is cut: four steps. Without the
    /// obstacle, two steps across the diagonal.
    #[test]
    fn the_way_from_cell_to_cell_cuts_no_corner() {
        let low = Cell::new(-5, 7);
        let at = |x: i32, y: i32| Cell::new(low.x + x, low.y + y);
        let round = drawn(low, &["...", ".#.", "##."]);
        let way = [at(0, 1), at(0, 0), at(1, 0), at(2, 0), at(2, 1)];
        assert_eq!(grid_way(&round, at(0, 1), at(2, 1)), Some(way.into()));
        let open = drawn(low, &["..."; 3]);
        let across = [at(0, 0), at(1, 1), at(2, 2)];
        assert_eq!(grid_way(&open, at(0, 0), at(2, 2)), Some(across.into()));
        let walled = drawn(low, &[".#."; 3]);
        assert_eq!(grid_way(&walled, at(0, 0), at(2, 2)), None);
        assert_eq!(grid_way(&open, at(0, 0), at(3, 2)), None);
        assert_eq!(grid_way(&open, at(0, -1), at(2, 2)), None);
        assert_eq!(
            [
                cost(ORIGIN, Cell::new(-3, 4)),
                cost(ORIGIN, Cell::new(1, 1))
            ],
            [500, 141]
        );
    }

    /// By hand, around a wall at x = 2 that leaves the lowest row free: the line from 0, 4 to 1, 0
    /// touches columns 0 and 1 only; the line from 1, 0 to 5, 1 leaves row 0 at x = 3.5, behind the
    /// wall; one to 5, 2 would touch the wall's end.
    #[test]
    fn a_way_goes_straight_where_it_can() {
        let map = drawn(ORIGIN, &["......", "..#...", "..#...", "..#...", "..#..."]);
        let down = (0..=4).rev().map(|y| (0, y));
        let along = (1..=5).map(|x| (x, 0));
        let up = (1..=4).map(|y| (5, y));
        let way: Vec<_> = down.chain(along).chain(up).collect();
        let expected = cells(&[(0, 4), (1, 0), (5, 1), (5, 4)]);
        assert_eq!(smoothed(&map, &cells(&way)), expected);
        assert_eq!(smoothed(&map, &cells(&[(3, 3)])), cells(&[(3, 3)]));
        assert_eq!(smoothed(&map, &[]), []);
    }

    /// In a corridor of nine cells only the middle one has more than four cells to both sides: the
    /// point moves two cells sideways, to the nearest such cell; the ends stay. Beside a pillar 2
    /// and 1 cells away the squared distance is 4 + 1.
    #[test]
    fn a_way_is_moved_to_where_there_is_room() {
        let mut map = drawn(ORIGIN, &["........."; 21]);
        let way = cells(&[(2, 2), (2, 10), (2, 18)]);
        assert_eq!(
            centred(&map, &map, &way),
            cells(&[(2, 2), (4, 10), (2, 18)])
        );
        // Four cells sideways are too many: the point moves by at most three.
        let way = cells(&[(0, 2), (0, 10), (0, 18)]);
        assert_eq!(
            centred(&map, &map, &way),
            cells(&[(0, 2), (3, 10), (0, 18)])
        );
        assert_eq!(room(&map, Cell::new(4, 10)), i32::MAX);
        assert_eq!(room(&map, Cell::new(3, 10)), 16);
        assert_eq!(room(&map, Cell::new(8, 10)), 1);
        map.set(Cell::new(6, 11), OBSTACLE).expect("inside");
        assert_eq!(room(&map, Cell::new(4, 10)), 5);
    }

    /// On an open floor exactly those vertices are joined that are at most 30 cells apart.
    #[test]
    fn vertices_within_reach_are_joined() {
        let open = drawn(
            ORIGIN,
            &["............................................."; 2],
        );
        let roadmap = Roadmap::new(&open, 40, &mut Dice::new(3));
        assert_eq!(roadmap.vertices.len(), 40);
        for (one, from) in roadmap.vertices.iter().enumerate() {
            for (other, to) in roadmap.vertices.iter().enumerate().take(one) {
                let is_near = from.distance(*to) <= 30.0;
                assert_eq!(
                    roadmap.edges.contains(&(one, other)),
                    is_near,
                    "{from:?} {to:?}"
                );
            }
        }
        let walled = drawn(ORIGIN, &["###"]);
        assert_eq!(
            Roadmap::new(&walled, 40, &mut Dice::new(3)),
            Roadmap::default()
        );
    }

    /// From 1 the nearest vertex is 0, to 8 it is 9; the straight edge between them is shorter than
    /// the path by row 1. A nearer vertex behind a wall is not in sight.
    #[test]
    fn a_way_begins_and_ends_at_the_vertices_in_sight() {
        let open = drawn(ORIGIN, &["..........", ".........."]);
        let roadmap = Roadmap {
            vertices: cells(&[(0, 0), (5, 1), (9, 0)]),
            edges: alloc::vec![(1, 0), (2, 1)],
        };
        let ends = (Cell::new(1, 0), Cell::new(8, 0));
        let way = roadmap.way(&open, ends.0, ends.1);
        assert_eq!(way, Some(cells(&[(1, 0), (0, 0), (5, 1), (9, 0), (8, 0)])));
        let direct = Roadmap {
            edges: alloc::vec![(1, 0), (2, 0), (2, 1)],
            ..roadmap.clone()
        };
        let way = direct.way(&open, ends.0, ends.1);
        assert_eq!(way, Some(cells(&[(1, 0), (0, 0), (9, 0), (8, 0)])));
        let walled = drawn(ORIGIN, &["...#......", "...#......"]);
        let beside = Roadmap {
            vertices: cells(&[(4, 0), (0, 0)]),
            edges: Vec::new(),
        };
        assert_eq!(beside.nearest(&open, Cell::new(2, 0)), Some(0));
        assert_eq!(beside.nearest(&walled, Cell::new(2, 0)), Some(1));
        assert_eq!(Roadmap::default().way(&open, ends.0, ends.1), None);
    }

    /// From a cell beside the wall of a room the next open cell is one step away, and four steps
    /// are not too many; five are.
    #[test]
    fn the_next_open_cell_is_at_most_four_steps_away() {
        let map = drawn(ORIGIN, &["........"]);
        let escaped = |steps: i32| {
            let mut open = drawn(ORIGIN, &["########"]);
            open.set(Cell::new(1 + steps, 0), FREE).expect("inside");
            let way = escape(&map, &open, Cell::new(1, 0));
            way.map(|way| way.iter().map(|cell| cell.x).collect::<Vec<_>>())
        };
        assert_eq!(escaped(0), Some(alloc::vec![1]));
        assert_eq!(escaped(-1), Some(alloc::vec![1, 0]));
        assert_eq!(escaped(4), Some(alloc::vec![1, 2, 3, 4, 5]));
        assert_eq!(escaped(5), None);
    }
}
