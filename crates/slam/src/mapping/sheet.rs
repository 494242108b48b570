//! The map as cells, from beam ends and crossed cells.

use emulators::world::Pose;

use crate::mapping::cloud::{Frame, gap};
use crate::mapping::keyframe::Keyframe;
use crate::mapping::surfels::lies_along;

/// A map, row by row from below.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Lower left corner, metres.
    pub corner: [f64; 2],
    /// Edge of a cell, metres.
    pub cell_m: f64,
    /// Cells along x.
    pub width: usize,
    /// Cells along y.
    pub height: usize,
    /// 0: free, 127: unknown, 255: wall.
    pub cells: Vec<u8>,
}

/// Value of an unknown cell.
pub const UNKNOWN: u8 = 127;
/// Cells along an edge of a tile.
const TILE: usize = 64;
/// Maximum number of cells of a sheet; a larger map gets a coarser resolution.
const CELLS_MAX: f64 = 4e8;
/// Weight of a beam end relative to a crossing beam.
const END: u32 = 3;

/// Numbers of beams that ended in each cell, and of beams that crossed it.
struct Tile {
    ends: [u8; TILE * TILE],
    through: [u8; TILE * TILE],
}

/// Tiles in observed areas only.
struct Tiles {
    corner: [f32; 2],
    per_m: f32,
    across: usize,
    up: usize,
    tiles: Vec<Option<Box<Tile>>>,
}

impl Sheet {
    /// The map of the keyframes with cells of `cell_m`, or of a multiple by a power of two if there
    /// would be too many cells.
    pub(crate) fn of(keyframes: &[Keyframe], poses: &[Pose], cell_m: f64) -> Self {
        let [x0, x1, y0, y1] = bounds(keyframes, poses);
        let mut cell_m = cell_m;
        while (x1 - x0) * (y1 - y0) / (cell_m * cell_m) > CELLS_MAX {
            cell_m *= 2.0;
        }
        let corner = [x0, y0].map(|m| libm::floor(m / cell_m) * cell_m - cell_m);
        let mut tiles = Tiles::new(corner, cell_m, [x1, y1]);
        for (keyframe, pose) in keyframes.iter().zip(poses) {
            tiles.draw(*pose, keyframe);
        }
        tiles.sheet(corner, cell_m)
    }
}

fn bounds(keyframes: &[Keyframe], poses: &[Pose]) -> [f64; 4] {
    let mut bounds = [f64::MAX, f64::MIN, f64::MAX, f64::MIN];
    let mut include = |[x, y]: [f64; 2]| {
        bounds = [
            bounds[0].min(x),
            bounds[1].max(x),
            bounds[2].min(y),
            bounds[3].max(y),
        ];
    };
    include([0.0; 2]);
    for (keyframe, pose) in keyframes.iter().zip(poses) {
        include([pose.x, pose.y]);
        let frame = Frame::new(*pose);
        for spot in keyframe.cloud.spots() {
            include(frame.place(spot.at).map(f64::from));
        }
    }
    bounds
}

#[expect(clippy::cast_possible_truncation, reason = "metres of a building")]
const fn single(metres: f64) -> f32 {
    metres as f32
}

/// Converts to a number of cells; negative values give 0.
#[expect(clippy::cast_possible_truncation, reason = "saturates")]
#[expect(clippy::cast_sign_loss, reason = "saturates")]
#[inline]
const fn cells(of: f32) -> usize {
    of as usize
}

/// As [`cells`], for less than 2^31 cells: their conversion takes a third of the instructions.
#[expect(clippy::cast_possible_truncation, reason = "saturates")]
#[inline]
fn few_cells(of: f32) -> usize {
    (of as i32).max(0).cast_unsigned() as usize
}

impl Tile {
    #[cold]
    fn empty() -> Box<Self> {
        Box::new(Self {
            ends: [0; TILE * TILE],
            through: [0; TILE * TILE],
        })
    }
}

impl Tiles {
    fn new(corner: [f64; 2], cell_m: f64, end: [f64; 2]) -> Self {
        let per_m = single(1.0 / cell_m);
        let tiles = |axis: usize| cells(single(end[axis] - corner[axis]) * per_m) / TILE + 1;
        let (across, up) = (tiles(0), tiles(1));
        Self {
            corner: corner.map(single),
            per_m,
            across,
            up,
            tiles: (0..across * up).map(|_| None).collect(),
        }
    }

    fn place(&self, at: [f32; 2]) -> [f32; 2] {
        [
            (at[0] - self.corner[0]) * self.per_m,
            (at[1] - self.corner[1]) * self.per_m,
        ]
    }

    fn draw(&mut self, pose: Pose, keyframe: &Keyframe) {
        let frame = Frame::new(pose);
        let from = self.place(frame.at);
        let mut last: Option<([f32; 2], [f32; 2])> = None;
        for spot in keyframe.cloud.spots() {
            let (at, normal) = (frame.place(spot.at), frame.turned(spot.normal));
            self.pass(from, self.place(at));
            if let Some((last, before)) = last.filter(|_| spot.is_joined)
                && lies_along(last, at, before)
                && lies_along(last, at, normal)
            {
                self.end_between(self.place(last), self.place(at));
            }
            self.end(self.place(at));
            last = Some((at, normal));
        }
    }

    /// Marks all cells of a beam except the last one as crossed.
    fn pass(&mut self, from: [f32; 2], to: [f32; 2]) {
        let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
        let step = [(to[0] - from[0]) / steps, (to[1] - from[1]) / steps];
        let mut on = 0.5;
        while on < steps - 1.0 {
            let (tile, cell) = self.cell([from[0] + on * step[0], from[1] + on * step[1]]);
            let through = &mut tile.through[cell];
            *through = through.saturating_add(1);
            on += 1.0;
        }
    }

    fn end_between(&mut self, from: [f32; 2], to: [f32; 2]) {
        let steps = gap(from, to);
        let mut on = 1.0;
        while on < steps {
            let part = on / steps;
            self.end([
                from[0] + part * (to[0] - from[0]),
                from[1] + part * (to[1] - from[1]),
            ]);
            on += 1.0;
        }
    }

    fn end(&mut self, at: [f32; 2]) {
        let (tile, cell) = self.cell(at);
        tile.ends[cell] = tile.ends[cell].saturating_add(1);
    }

    #[inline]
    fn cell(&mut self, at: [f32; 2]) -> (&mut Tile, usize) {
        let x = few_cells(at[0]).min(self.across * TILE - 1);
        let y = few_cells(at[1]).min(self.up * TILE - 1);
        let tile = &mut self.tiles[y / TILE * self.across + x / TILE];
        let tile = tile.get_or_insert_with(Tile::empty);
        (tile, y % TILE * TILE + x % TILE)
    }

    fn sheet(&self, corner: [f64; 2], cell_m: f64) -> Sheet {
        let (width, height) = (self.across * TILE, self.up * TILE);
        let mut cells = vec![UNKNOWN; width * height];
        for (number, tile) in self.tiles.iter().enumerate() {
            let Some(tile) = tile else {
                continue;
            };
            let (x0, y0) = (number % self.across * TILE, number / self.across * TILE);
            for y in 0..TILE {
                let row = (y0 + y) * width + x0;
                for (x, to) in cells[row..row + TILE].iter_mut().enumerate() {
                    let at = y * TILE + x;
                    *to = shade(tile.ends[at], tile.through[at]);
                }
            }
        }
        Sheet {
            corner,
            cell_m,
            width,
            height,
            cells,
        }
    }
}

/// The likelihood of a wall.
fn shade(ends: u8, through: u8) -> u8 {
    let (ends, through) = (END * u32::from(ends), u32::from(through));
    if ends + through == 0 {
        return UNKNOWN;
    }
    u8::try_from(255 * ends / (ends + through)).unwrap_or(u8::MAX)
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "metres of a small room")]
mod tests {
    use super::*;
    use crate::mapping::cloud::Cloud;

    /// A wall 1 m ahead in one scan: free before it, wall there, unknown behind.
    #[test]
    fn a_beam_leaves_free_cells_and_ends_in_a_wall() {
        let cloud = Cloud::new(&[[1.0, -0.05], [1.0, 0.0], [1.0, 0.05]]);
        let keyframe = Keyframe {
            cloud,
            path_m: 0.0,
            quality: 1.0,
            scan: 0,
            turned: 0.0,
            wheels_m: 0.0,
            by_odometry: 0.0,
            part: 0,
        };
        let sheet = Sheet::of(&[keyframe], &[Pose::default()], 0.05);
        let at = |x: f64, y: f64| {
            let column = ((x - sheet.corner[0]) / 0.05).floor() as usize;
            let row = ((y - sheet.corner[1]) / 0.05).floor() as usize;
            sheet.cells[row * sheet.width + column]
        };
        assert_eq!(
            (at(0.5, 0.01), at(1.01, 0.01), at(1.3, 0.01)),
            (0, 255, UNKNOWN)
        );
    }

    #[test]
    fn three_beams_through_a_cell_weigh_as_much_as_one_that_ends_there() {
        assert_eq!(
            (shade(0, 0), shade(1, 3), shade(0, 9), shade(2, 0)),
            (127, 127, 0, 255)
        );
    }
}
