//! Walls of 10 cm blocks, from a drawing in which walls are thin and rooms are wide.

/// Edge of a block, metres.
pub(crate) const BLOCK_M: f64 = 0.1;

/// The cell of 10 cm that contains a coordinate.
#[expect(clippy::cast_possible_truncation, reason = "a few metres")]
pub(crate) fn cell(along_m: f64) -> i64 {
    (along_m / BLOCK_M).floor() as i64
}

/// Blocks with their positions.
#[derive(Clone, Debug)]
pub(crate) struct World {
    solid: Vec<Vec<bool>>,
    /// The corner of the first block, metres.
    pub(crate) origin: [f64; 2],
}

impl World {
    /// A world from a drawing with `#` for walls. Lines and columns of even index become one block
    /// wide, the others `room` blocks. The last line is the lowest.
    pub(crate) fn labyrinth(drawing: &str, room: usize, origin: [f64; 2]) -> Self {
        let times = |index: usize| if index.is_multiple_of(2) { 1 } else { room };
        let lines: Vec<&str> = drawing.lines().filter(|line| !line.is_empty()).collect();
        let mut solid = Vec::new();
        for (row, line) in lines.iter().rev().enumerate() {
            let cells = line.chars().enumerate();
            let blocks = cells.flat_map(|(at, cell)| vec![cell == '#'; times(at)]);
            let blocks: Vec<bool> = blocks.collect();
            for _ in 0..times(row) {
                solid.push(blocks.clone());
            }
        }
        Self { solid, origin }
    }

    pub(crate) fn is_solid(&self, x: i64, y: i64) -> bool {
        let row = usize::try_from(y).ok().and_then(|y| self.solid.get(y));
        let block = row.and_then(|row| usize::try_from(x).ok().and_then(|x| row.get(x)));
        block.copied().unwrap_or(true)
    }

    pub(crate) fn block_of(&self, [x, y]: [f64; 2]) -> (i64, i64) {
        let block = |at: f64, origin: f64| cell(at - origin);
        (block(x, self.origin[0]), block(y, self.origin[1]))
    }

    /// The middle of the room at these odd indices of the drawing, counted from below.
    pub(crate) fn room(&self, column: usize, row: usize, room: usize) -> [f64; 2] {
        let middle = |index: usize, origin: f64| {
            let before = (index / 2) * (room + 1) + 1;
            origin + (before as f64 + room as f64 / 2.0) * BLOCK_M
        };
        [middle(column, self.origin[0]), middle(row, self.origin[1])]
    }

    /// Distance to the first wall in this direction, metres.
    pub(crate) fn ray(&self, from: [f64; 2], angle: f64) -> f64 {
        let (sin, cos) = libm::sincos(angle);
        let direction = [cos, sin];
        let (mut x, mut y) = self.block_of(from);
        let next = |axis: usize, block: i64| {
            let edge = block + i64::from(direction[axis] > 0.0);
            let way = edge as f64 * BLOCK_M + self.origin[axis] - from[axis];
            match direction[axis].abs() < 1e-12 {
                true => f64::MAX,
                false => way / direction[axis],
            }
        };
        for _ in 0..1_000 {
            let (along_x, along_y) = (next(0, x), next(1, y));
            let far = along_x.min(along_y);
            match along_x < along_y {
                true => x += if direction[0] > 0.0 { 1 } else { -1 },
                false => y += if direction[1] > 0.0 { 1 } else { -1 },
            }
            if self.is_solid(x, y) {
                return far;
            }
        }
        f64::MAX
    }

    /// Distance to the nearest wall, metres, at most 0.3.
    pub(crate) fn clearance(&self, [px, py]: [f64; 2]) -> f64 {
        let (x, y) = self.block_of([px, py]);
        let mut nearest = 0.3_f64;
        for by in y - 3..=y + 3 {
            for bx in x - 3..=x + 3 {
                if self.is_solid(bx, by) {
                    let off = |block: i64, origin: f64, at: f64| {
                        let low = block as f64 * BLOCK_M + origin;
                        (low - at).max(at - low - BLOCK_M).max(0.0)
                    };
                    let (dx, dy) = (off(bx, self.origin[0], px), off(by, self.origin[1], py));
                    nearest = nearest.min(dx.hypot(dy));
                }
            }
        }
        nearest
    }

    /// Points on all wall faces towards a room, metres.
    pub(crate) fn faces(&self) -> Vec<[f64; 2]> {
        let mut points = Vec::new();
        for (y, row) in (0_i64..).zip(&self.solid) {
            for (x, solid) in (0_i64..).zip(row) {
                if *solid {
                    continue;
                }
                for (dx, dy) in [(1, 0), (0, 1), (-1, 0), (0, -1)] {
                    if self.is_solid(x + dx, y + dy) {
                        points.extend(self.face(x, y, dx, dy));
                    }
                }
            }
        }
        points
    }

    /// Points on one face, a little inside the wall.
    fn face(&self, x: i64, y: i64, dx: i64, dy: i64) -> impl Iterator<Item = [f64; 2]> {
        let middle = [x as f64 + 0.5, y as f64 + 0.5];
        let out = [dx as f64, dy as f64];
        let origin = self.origin;
        (0..5).map(move |at| {
            let along = f64::from(at) * 0.2 - 0.4;
            let point = |axis: usize| {
                let block = middle[axis] + 0.501 * out[axis] + along * out[1 - axis];
                origin[axis] + block * BLOCK_M
            };
            [point(0), point(1)]
        })
    }

    /// The middles of all open blocks.
    pub(crate) fn open(&self) -> Vec<[f64; 2]> {
        let mut middles = Vec::new();
        for (y, row) in self.solid.iter().enumerate() {
            for (x, solid) in row.iter().enumerate() {
                if !solid {
                    let middle =
                        |block: usize, origin: f64| origin + (block as f64 + 0.5) * BLOCK_M;
                    middles.push([middle(x, self.origin[0]), middle(y, self.origin[1])]);
                }
            }
        }
        middles
    }
}
