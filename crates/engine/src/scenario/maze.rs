//! Arenas of square tiles, as in RoboCup Rescue, generated from a seed.
//!
//! ```text
//! +--+--+--+     a board of `wall_m` between two tiles, or none; every tile can be reached:
//! |     |  |     first a tree over all tiles, then a share of the boards that are left is
//! +  +--+  +     taken out, which makes loops
//! |        |
//! +--+--+--+
//! ```

use emulators::rng::Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Flaw;

/// Maximum number of tiles along a side.
const TILES_MAX: usize = 100;

/// Width of a warm plate, metres.
const PLATE_M: f64 = 0.1;
/// Victims are no nearer to each other than this, through boards as well.
const APART_M: f64 = 0.5;

/// An arena of tiles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MazeSpec {
    /// Seed of its boards.
    #[serde(default = "seed")]
    pub seed: u64,
    /// Tiles along x, 1 to 100.
    #[schemars(range(min = 1, max = 100))]
    pub columns: usize,
    /// Tiles along y, 1 to 100.
    #[schemars(range(min = 1, max = 100))]
    pub rows: usize,
    /// Distance between the middles of two neighbouring boards, metres, 0.1 to 10. RoboCup's tiles
    /// of 0.30 m fail for any robot with this lidar: from the middle of a tile its walls are 0.14 m
    /// away, nearer than the lidar's shortest distance of 0.145 m. The rescue robot is 0.32 m wide
    /// as well, and works from 0.45 m on.
    #[serde(default = "tile")]
    #[schemars(range(min = 0.1, max = 10.0))]
    pub tile_m: f64,
    /// Thickness of the boards, metres, 0.001 to 1.
    #[serde(default = "board")]
    #[schemars(range(min = 0.001, max = 1.0))]
    pub wall_m: f64,
    /// Lower left corner of the arena, metres: the middle of its boards.
    #[serde(default = "corner")]
    pub corner_m: [f64; 2],
    /// Share of removed boards, 0 to 1, among those that the maze does not need.
    #[serde(default = "open")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub open: f64,
    /// Number of warm plates on boards, 10 cm wide, at body temperature; from 0 to the number of
    /// tiles minus one. Each is on a tile of its own, and none on the first tile.
    #[serde(default)]
    pub victims: usize,
}

const fn seed() -> u64 {
    1
}

const fn tile() -> f64 {
    0.55
}

const fn board() -> f64 {
    0.02
}

const fn corner() -> [f64; 2] {
    [0.1; 2]
}

const fn open() -> f64 {
    0.15
}

/// A board between two tiles or around them: the tile below or left of it, and its direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Gap {
    tile: usize,
    other: usize,
}

impl MazeSpec {
    /// Checks the figures of the arena.
    ///
    /// # Errors
    /// A flaw that names the key.
    pub fn check(&self) -> Result<(), Flaw> {
        for (key, value) in [("columns", self.columns), ("rows", self.rows)] {
            if !(1..=TILES_MAX).contains(&value) {
                return Err(Flaw::new(
                    key,
                    format!("is {value}, expected 1 to {TILES_MAX}"),
                ));
            }
        }
        for (key, value, [least, most]) in [
            ("tile_m", self.tile_m, [0.1, 10.0]),
            (
                "wall_m",
                self.wall_m,
                [0.001, self.tile_m.clamp(0.1, 10.0) / 2.0],
            ),
            ("open", self.open, [0.0, 1.0]),
        ] {
            if !(least..=most).contains(&value) {
                return Err(Flaw::new(
                    key,
                    format!("is {value}, expected {least} to {most}"),
                ));
            }
        }
        let others = self.columns * self.rows - 1;
        if self.victims > others {
            let message = format!("is {}, expected at most {others}", self.victims);
            return Err(Flaw::new("victims", message));
        }
        Ok(())
    }

    /// The outlines of all boards, four corners each.
    pub fn boards(&self) -> Vec<[[f64; 2]; 4]> {
        let mut rng = Rng::stream(self.seed, "maze.boards");
        let closed = self.closed(&mut rng);
        let [w, h] = [self.columns, self.rows];
        let inner = closed.into_iter().map(|gap| {
            let (x, y) = (gap.other % w, gap.other / w);
            // The first tile is left of the other one, or below it.
            let is_upright = gap.other == gap.tile + 1;
            if is_upright {
                ([x, y], [x, y + 1])
            } else {
                ([x, y], [x + 1, y])
            }
        });
        let rim = [
            ([0, 0], [w, 0]),
            ([w, 0], [w, h]),
            ([0, h], [w, h]),
            ([0, 0], [0, h]),
        ];
        rim.into_iter()
            .chain(inner)
            .map(|(from, to)| self.board(from, to))
            .collect()
    }

    /// For each tile, row by row, its neighbours without a board between.
    pub fn passages(&self) -> Vec<Vec<usize>> {
        let closed = self.closed(&mut Rng::stream(self.seed, "maze.boards"));
        let mut passages = vec![Vec::new(); self.columns * self.rows];
        for gap in self.gaps().into_iter().filter(|gap| !closed.contains(gap)) {
            passages[gap.tile].push(gap.other);
            passages[gap.other].push(gap.tile);
        }
        passages
    }

    /// Both ends of each warm plate.
    pub fn victims(&self) -> Vec<[[f64; 2]; 2]> {
        let closed = self.closed(&mut Rng::stream(self.seed, "maze.boards"));
        let mut rng = Rng::stream(self.seed, "maze.victims");
        let mut tiles: Vec<usize> = (1..self.columns * self.rows).collect();
        let mut plates: Vec<[[f64; 2]; 2]> = Vec::new();
        while plates.len() < self.victims && !tiles.is_empty() {
            let drawn = rng.below(tiles.len() as u64);
            let tile = tiles.swap_remove(usize::try_from(drawn).unwrap_or(0));
            let sides = self.boarded(tile, &closed);
            let side = rng.below(sides.len().max(1) as u64);
            let side = sides.get(usize::try_from(side).unwrap_or(0));
            let plate = side.map(|side| self.plate(tile, *side));
            let is_apart = |plate: &[[f64; 2]; 2]| {
                plates.iter().all(|other| {
                    let [dx, dy] = [0, 1].map(|axis: usize| plate[0][axis] - other[0][axis]);
                    dx.hypot(dy) >= APART_M
                })
            };
            plates.extend(plate.filter(is_apart));
        }
        plates
    }

    /// Directions in which a tile has a board.
    fn boarded(&self, tile: usize, closed: &[Gap]) -> Vec<[i8; 2]> {
        let (x, y, w) = (tile % self.columns, tile / self.columns, self.columns);
        let has = |tile: usize, other: usize| closed.contains(&Gap { tile, other });
        let sides = [
            ([-1, 0], x == 0 || has(tile - 1, tile)),
            ([1, 0], x + 1 == w || has(tile, tile + 1)),
            ([0, -1], y == 0 || has(tile - w, tile)),
            ([0, 1], y + 1 == self.rows || has(tile, tile + w)),
        ];
        let sides = sides.into_iter().filter(|(_, is_closed)| *is_closed);
        sides.map(|(side, _)| side).collect()
    }

    /// The plate in the middle of the face of the board on that side of a tile.
    fn plate(&self, tile: usize, side: [i8; 2]) -> [[f64; 2]; 2] {
        let tiles = [tile % self.columns, tile / self.columns];
        let to_face = self.tile_m / 2.0 - self.wall_m / 2.0;
        let middle = [0, 1].map(|axis| {
            let middle = self.corner_m[axis] + (tiles[axis] as f64 + 0.5) * self.tile_m;
            middle + f64::from(side[axis]) * to_face
        });
        let half = PLATE_M / 2.0;
        [-half, half].map(|along| {
            let [dx, dy] = side.map(f64::from);
            [middle[0] - dy * along, middle[1] + dx * along]
        })
    }

    /// The gaps between tiles that have a board.
    fn closed(&self, rng: &mut Rng) -> Vec<Gap> {
        let mut gaps = self.gaps();
        // The gaps are taken in random order. A gap that joins two separate parts stays open. So
        // the open gaps form a tree over all tiles.
        for last in (1..gaps.len()).rev() {
            let other = rng.below(last as u64 + 1);
            gaps.swap(last, usize::try_from(other).unwrap_or(last));
        }
        let mut part: Vec<usize> = (0..self.columns * self.rows).collect();
        let mut closed = Vec::new();
        for gap in gaps {
            let [one, other] = [part[gap.tile], part[gap.other]];
            // Each gap takes a random number. So `open` changes only the removed boards.
            let is_taken_out = rng.chance(self.open);
            if one != other {
                part.iter_mut()
                    .filter(|part| **part == other)
                    .for_each(|part| *part = one);
            } else if !is_taken_out {
                closed.push(gap);
            }
        }
        closed
    }

    fn gaps(&self) -> Vec<Gap> {
        let (w, h) = (self.columns, self.rows);
        let across = (0..w * h).filter(|tile| tile % w + 1 < w).map(|tile| Gap {
            tile,
            other: tile + 1,
        });
        let up = (0..w * h).filter(|tile| tile / w + 1 < h).map(|tile| Gap {
            tile,
            other: tile + w,
        });
        across.chain(up).collect()
    }

    /// The outline of a board between two corners of tiles. The board covers the corners.
    fn board(&self, from: [usize; 2], to: [usize; 2]) -> [[f64; 2]; 4] {
        let half = self.wall_m / 2.0;
        let place = |axis: usize, tiles: usize| self.corner_m[axis] + tiles as f64 * self.tile_m;
        let millimetre = |metres: f64| (metres * 1000.0).round() / 1000.0;
        let [x0, y0] = [0, 1].map(|axis| millimetre(place(axis, from[axis]) - half));
        let [x1, y1] = [0, 1].map(|axis| millimetre(place(axis, to[axis]) + half));
        [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maze(seed: u64, open: f64) -> MazeSpec {
        let text = format!("seed = {seed}\ncolumns = 5\nrows = 4\nopen = {open:?}\n");
        toml::from_str(&text).expect("sound")
    }

    /// Number of tiles that can be reached from the first one over gaps without a board.
    fn reached(maze: &MazeSpec) -> usize {
        let closed = maze.closed(&mut Rng::stream(maze.seed, "maze.boards"));
        let gaps: Vec<Gap> = maze.gaps();
        let mut reached = vec![false; maze.columns * maze.rows];
        reached[0] = true;
        for _ in 0..reached.len() {
            for gap in gaps.iter().filter(|gap| !closed.contains(gap)) {
                let either = reached[gap.tile] || reached[gap.other];
                (reached[gap.tile], reached[gap.other]) = (either, either);
            }
        }
        reached.iter().filter(|reached| **reached).count()
    }

    #[test]
    fn every_tile_can_be_reached() {
        for seed in 0..50 {
            assert_eq!(reached(&maze(seed, 0.0)), 20, "seed {seed}");
        }
    }

    /// 5 x 4 tiles have 4 * 4 + 5 * 3 = 31 gaps; a tree uses 19 of them. With the four boards of
    /// the rim 16 boards remain, and 4 if all boards that the tree does not need are removed.
    #[test]
    fn a_maze_without_loops_has_as_many_boards_as_a_tree_leaves() {
        assert_eq!(maze(1, 0.0).boards().len(), 16);
        assert_eq!(maze(1, 1.0).boards().len(), 4);
    }

    /// The lower board of an arena of 5 tiles of 0.55 m at 0.1 m: 2.75 m and half a board more at
    /// each end.
    #[test]
    fn boards_lie_between_tiles() {
        let rim = [[0.09, 0.09], [2.86, 0.09], [2.86, 0.11], [0.09, 0.11]];
        assert_eq!(maze(1, 0.0).boards()[0], rim);
        assert_ne!(maze(1, 0.0).boards(), maze(2, 0.0).boards());
        assert_eq!(maze(1, 0.2).boards(), maze(1, 0.2).boards());
    }

    #[test]
    fn what_is_no_maze_is_refused_by_its_key() {
        let flaw = |change: fn(&mut MazeSpec)| {
            let mut maze = maze(1, 0.0);
            change(&mut maze);
            maze.check().map_err(|flaw| flaw.key)
        };
        assert_eq!(flaw(|_| ()), Ok(()));
        assert_eq!(flaw(|maze| maze.rows = 0), Err("rows"));
        assert_eq!(flaw(|maze| maze.columns = 101), Err("columns"));
        assert_eq!(flaw(|maze| maze.tile_m = f64::NAN), Err("tile_m"));
        assert_eq!(flaw(|maze| maze.wall_m = 0.3), Err("wall_m"));
        assert_eq!(flaw(|maze| maze.open = -0.1), Err("open"));
    }
}
