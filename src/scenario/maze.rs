//! Arenas of square tiles, as RoboCup Rescue has them, made from a seed.
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

/// Most tiles along a side.
const TILES_MAX: usize = 100;

/// An arena of tiles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MazeSpec {
    /// What its boards are drawn from.
    #[serde(default = "seed")]
    pub seed: u64,
    /// Tiles along x, 1 to 100.
    #[schemars(range(min = 1, max = 100))]
    pub columns: usize,
    /// Tiles along y, 1 to 100.
    #[schemars(range(min = 1, max = 100))]
    pub rows: usize,
    /// From the middle of a board to that of the next one, metres, 0.1 to 10. RoboCup's tiles of
    /// 0.30 m are for robots that are narrower than this one: its body of 0.32 m and the 45 mm that
    /// it keeps on each side ask for 0.41 m, and the cells of its planner for 0.1 m more.
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
    /// Share of the boards that are not needed to be a maze and are taken out, 0 to 1.
    #[serde(default = "open")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub open: f64,
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
    /// Whether its figures make sense.
    ///
    /// # Errors
    /// A flaw that names the key.
    pub fn check(&self) -> Result<(), Flaw> {
        for (key, value) in [("columns", self.columns), ("rows", self.rows)] {
            if !(1..=TILES_MAX).contains(&value) {
                return Err(Flaw::new(key, format!("is {value}, expected 1 to {TILES_MAX}")));
            }
        }
        for (key, value, [least, most]) in [
            ("tile_m", self.tile_m, [0.1, 10.0]),
            ("wall_m", self.wall_m, [0.001, self.tile_m.clamp(0.1, 10.0) / 2.0]),
            ("open", self.open, [0.0, 1.0]),
        ] {
            if !(least..=most).contains(&value) {
                return Err(Flaw::new(key, format!("is {value}, expected {least} to {most}")));
            }
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
            // Left of the other tile, or below it.
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

    /// The gaps between tiles that have a board.
    fn closed(&self, rng: &mut Rng) -> Vec<Gap> {
        let mut gaps = self.gaps();
        // Shuffled, each gap is open that joins two parts: a tree over all tiles.
        for last in (1..gaps.len()).rev() {
            let other = rng.below(last as u64 + 1);
            gaps.swap(last, usize::try_from(other).unwrap_or(last));
        }
        let mut part: Vec<usize> = (0..self.columns * self.rows).collect();
        let mut closed = Vec::new();
        for gap in gaps {
            let [one, other] = [part[gap.tile], part[gap.other]];
            // Drawn in any case, so that `open` changes nothing but what it opens.
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

    /// The outline of a board between two corners of tiles, which it covers.
    fn board(&self, from: [usize; 2], to: [usize; 2]) -> [[f64; 2]; 4] {
        let half = self.wall_m / 2.0;
        let place = |axis: usize, tiles: usize| self.corner_m[axis] + tiles as f64 * self.tile_m;
        let millimetre = |metres: f64| (metres * 1000.0).round() / 1000.0;
        let [x0, y0] = [0, 1].map(|axis| millimetre(place(axis, from[axis]) - half));
        let [x1, y1] = [0, 1].map(|axis| millimetre(place(axis, to[axis]) + half));
        [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    }
}
