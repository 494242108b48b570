//! Walls around a position, from many scans: mean points and normals in small cells, and the
//! likelihood of a beam end near each cell.

use crate::mapping::cloud::{Cloud, Frame, Spot, gap};
use emulators::world::Pose;

/// Edge of a cell, metres.
pub(crate) const CELL_M: f32 = 0.1;
/// Likelihood of a beam end in the cell of a wall, beside it, and at its corner.
const KERNEL: [u8; 3] = [255, 150, 90];
/// Number of empty cells at each edge: neighbours of a cell can be read without a check.
const RIM: i32 = 2;

/// The content of a cell: sums of points and of their normals.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: f32,
    at: [f32; 2],
    normal: [f32; 2],
    /// Index of the cell.
    flat: usize,
    /// Whether they have changed since the means were taken.
    is_fresh: bool,
}

/// The means of a cell's sums. They are read far more often than they change, so they are stored
/// apart: more of them share a line of the cache.
#[derive(Clone, Copy, Debug, Default)]
struct Surfel {
    at: [f32; 2],
    /// The normal; zero if unknown.
    normal: [f32; 2],
    /// Number of observations, at most [`COUNT_MAX`].
    count: f32,
}

/// A square of cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surfels {
    /// Lower left corner in cells of the world frame.
    corner: [i32; 2],
    side: i32,
    /// The index of each cell's surfel plus one; 0: none.
    index: Vec<u16>,
    sums: Vec<Sums>,
    surfels: Vec<Surfel>,
    /// Indices of surfels whose sums have changed.
    fresh: Vec<u16>,
    likely: Vec<u8>,
}

/// The wall nearest to a spot.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Near {
    /// A point of the wall in the world frame.
    pub(crate) at: [f32; 2],
    /// The normal of the wall; zero if unknown.
    pub(crate) normal: [f32; 2],
}

#[inline]
pub(crate) fn cell(metres: f32) -> i32 {
    let cells = metres * (1.0 / CELL_M);
    #[expect(clippy::cast_possible_truncation, reason = "saturates, far outside")]
    let towards_zero = cells as i32;
    // Rounds down without a function call. Beyond the range of `i32` the result wraps: such a point
    // is outside of each square anyway.
    towards_zero.wrapping_sub(i32::from((towards_zero as f32) > cells))
}

impl Surfels {
    /// An empty square with `reach_m` around `middle`.
    pub(crate) fn around(middle: [f32; 2], reach_m: f32) -> Self {
        let mut surfels = Self::default();
        surfels.aim(middle, reach_m);
        surfels
    }

    /// Clears the square, moves it and changes its size.
    pub(crate) fn aim(&mut self, middle: [f32; 2], reach_m: f32) {
        self.empty();
        self.side = 2 * cell(reach_m) + 1;
        let cells = usize::try_from(self.side * self.side).unwrap_or(0);
        self.index.resize(cells, 0);
        self.likely.resize(cells, 0);
        self.corner = self.corner_for(middle);
    }

    fn corner_for(&self, middle: [f32; 2]) -> [i32; 2] {
        middle.map(|m| cell(m) - self.side / 2)
    }

    /// An empty square of the same size around `middle`.
    pub(crate) fn empty_at(&self, middle: [f32; 2]) -> Self {
        let mut surfels = Self {
            side: self.side,
            index: vec![0; self.index.len()],
            likely: vec![0; self.likely.len()],
            ..Self::default()
        };
        surfels.corner = surfels.corner_for(middle);
        surfels
    }

    /// Clears the square and moves it to another position.
    pub(crate) fn clear(&mut self, middle: [f32; 2]) {
        self.empty();
        self.corner = self.corner_for(middle);
    }

    /// Removes all walls. A square has many more cells than walls.
    fn empty(&mut self) {
        let side = self.side.unsigned_abs() as usize;
        for sums in self.sums.drain(..) {
            self.index[sums.flat] = 0;
            for row in [sums.flat - side, sums.flat, sums.flat + side] {
                self.likely[row - 1..row + 2].fill(0);
            }
        }
        self.surfels.clear();
    }

    /// Centre of the square, metres.
    pub(crate) fn middle(&self) -> [f32; 2] {
        self.corner
            .map(|corner| (corner + self.side / 2) as f32 * CELL_M)
    }

    pub(crate) const fn side(&self) -> i32 {
        self.side
    }

    pub(crate) const fn corner(&self) -> [i32; 2] {
        self.corner
    }

    /// The likelihood of a beam end in each cell, row by row.
    pub(crate) fn likely(&self) -> &[u8] {
        &self.likely
    }

    /// Adds a scan seen from `pose`.
    pub(crate) fn draw(&mut self, pose: Pose, cloud: &Cloud) {
        self.draw_all([(pose, cloud)]);
    }

    /// Adds scans seen from these poses.
    pub(crate) fn draw_all<'a>(&mut self, scans: impl IntoIterator<Item = (Pose, &'a Cloud)>) {
        for (pose, cloud) in scans {
            self.add(pose, cloud);
        }
        for number in core::mem::take(&mut self.fresh) {
            let number = usize::from(number);
            self.surfels[number] = self.sums[number].settle();
        }
    }

    fn add(&mut self, pose: Pose, cloud: &Cloud) {
        let frame = Frame::new(pose);
        let mut last: Option<([f32; 2], [f32; 2])> = None;
        for spot in cloud.spots() {
            let (at, normal) = (frame.place(spot.at), frame.turned(spot.normal));
            if let Some((last, before)) = last.filter(|_| spot.is_joined)
                && lies_along(last, at, before)
                && lies_along(last, at, normal)
            {
                self.draw_between(last, at, normal);
            }
            self.put(at, normal);
            last = Some((at, normal));
        }
    }

    /// Draws the wall between two spots that are farther apart than a cell.
    fn draw_between(&mut self, from: [f32; 2], to: [f32; 2], normal: [f32; 2]) {
        let parts = gap(from, to) / CELL_M;
        let mut part = 1.0;
        while part < parts {
            let on = part / parts;
            let at = [
                from[0] + on * (to[0] - from[0]),
                from[1] + on * (to[1] - from[1]),
            ];
            self.put(at, normal);
            part += 1.0;
        }
    }

    fn put(&mut self, at: [f32; 2], normal: [f32; 2]) {
        let (x, y) = self.cell(at);
        let inside = RIM..self.side - RIM;
        if !inside.contains(&x) || !inside.contains(&y) {
            return;
        }
        let flat = self.flat(x, y);
        if self.index[flat] == 0 {
            let Ok(number) = u16::try_from(self.sums.len() + 1) else {
                return;
            };
            self.sums.push(Sums {
                flat,
                ..Sums::default()
            });
            self.surfels.push(Surfel::default());
            self.index[flat] = number;
            self.stamp(x, y);
        }
        let [x, y] = self.inner(at);
        let number = self.index[flat] - 1;
        let sums = &mut self.sums[usize::from(number)];
        if !sums.is_fresh {
            sums.is_fresh = true;
            self.fresh.push(number);
        }
        sums.count += 1.0;
        sums.at = [sums.at[0] + x, sums.at[1] + y];
        sums.normal = [sums.normal[0] + normal[0], sums.normal[1] + normal[1]];
    }

    fn stamp(&mut self, x: i32, y: i32) {
        for dy in -1..=1_i32 {
            for dx in -1..=1_i32 {
                let flat = self.flat(x + dx, y + dy);
                let value = KERNEL[(dx.unsigned_abs() + dy.unsigned_abs()) as usize];
                self.likely[flat] = self.likely[flat].max(value);
            }
        }
    }

    /// The cell of a point, possibly outside the square.
    #[inline]
    fn cell(&self, [x, y]: [f32; 2]) -> (i32, i32) {
        let [left, low] = self.corner;
        (cell(x).wrapping_sub(left), cell(y).wrapping_sub(low))
    }

    /// A point relative to the corner.
    #[inline]
    fn inner(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        [
            x - self.corner[0] as f32 * CELL_M,
            y - self.corner[1] as f32 * CELL_M,
        ]
    }

    #[inline]
    fn flat(&self, x: i32, y: i32) -> usize {
        (y * self.side + x).cast_unsigned() as usize
    }

    /// The likelihood of a beam end at a position, 0 to 255.
    #[inline]
    pub(crate) fn likelihood(&self, at: [f32; 2]) -> u8 {
        let (x, y) = self.cell(at);
        if (0..self.side).contains(&x) && (0..self.side).contains(&y) {
            self.likely[self.flat(x, y)]
        } else {
            0
        }
    }

    /// The most likely wall of `spot` in the world frame: searches the cells around it for a
    /// similar normal.
    #[inline]
    pub(crate) fn nearest(&self, at: [f32; 2], normal: [f32; 2]) -> Option<Near> {
        let (x, y) = self.cell(at);
        let inside = RIM..self.side - RIM;
        if !inside.contains(&x) || !inside.contains(&y) || self.likely[self.flat(x, y)] == 0 {
            return None;
        }
        let here = self.inner(at);
        let is_unsure = is_unknown(normal);
        let mut least = f32::INFINITY;
        let mut nearest = None;
        let mut blend = Blend::default();
        for dy in -1..=1 {
            let row = self.flat(x - 1, y + dy);
            for number in &self.index[row..row + 3] {
                let Some(number) = usize::from(*number).checked_sub(1) else {
                    continue;
                };
                let surfel = &self.surfels[number];
                let [dx, dy] = [here[0] - surfel.at[0], here[1] - surfel.at[1]];
                let squared = dx * dx + dy * dy;
                if is_unsure || is_unknown(surfel.normal) {
                    if squared * UNSURE < least {
                        (least, nearest) = (squared * UNSURE, Some(surfel.at));
                    }
                    continue;
                }
                let [nx, ny] = surfel.normal;
                if nx * normal[0] + ny * normal[1] < ALIKE {
                    continue;
                }
                let across = nx * dx + ny * dy;
                let far = across * across + ALONG * (squared - across * across);
                blend.add(surfel, far);
                if far < least {
                    (least, nearest) = (far, None);
                }
            }
        }
        let (at, normal) = match nearest {
            _ if least == f32::INFINITY => return None,
            Some(at) => (at, [0.0; 2]),
            None => blend.wall(),
        };
        let at = [
            at[0] + self.corner[0] as f32 * CELL_M,
            at[1] + self.corner[1] as f32 * CELL_M,
        ];
        Some(Near { at, normal })
    }
}

/// A blend of the walls in neighbouring cells, the nearest with the highest weight: a spot that
/// moves to the next cell must not jump from one wall to another.
#[derive(Default)]
struct Blend {
    weight: f32,
    at: [f32; 2],
    normal: [f32; 2],
}

/// Squared distance at which the weight of a wall falls to a quarter, square metres.
const BLEND: f32 = 0.001;
/// Maximum number of observations that count for a wall.
const COUNT_MAX: f32 = 10.0;

impl Blend {
    #[inline]
    fn add(&mut self, surfel: &Surfel, far: f32) {
        let part = 1.0 / (far + BLEND);
        let weight = surfel.count * part * part;
        self.weight += weight;
        self.at[0] += weight * surfel.at[0];
        self.at[1] += weight * surfel.at[1];
        self.normal[0] += weight * surfel.normal[0];
        self.normal[1] += weight * surfel.normal[1];
    }

    /// A point and the normal.
    #[inline]
    fn wall(&self) -> ([f32; 2], [f32; 2]) {
        let [x, y] = self.normal;
        let length = (x * x + y * y).sqrt();
        let at = [self.at[0] / self.weight, self.at[1] / self.weight];
        (at, [x / length, y / length])
    }
}

/// Whether this normal is unknown.
#[inline]
pub(crate) fn is_unknown(normal: [f32; 2]) -> bool {
    normal[0] == 0.0 && normal[1] == 0.0
}

/// Whether the line between two points runs along a wall with this normal.
pub(crate) fn lies_along(a: [f32; 2], b: [f32; 2], normal: [f32; 2]) -> bool {
    let across = (b[0] - a[0]) * normal[0] + (b[1] - a[1]) * normal[1];
    !is_unknown(normal) && across.abs() < ACROSS_MOST * gap(a, b)
}

/// Maximum sine of the angle between a wall and its drawn part.
const ACROSS_MOST: f32 = 0.25;

/// Minimum scalar product of two normals of one wall.
const ALIKE: f32 = 0.7;
/// Weight of a distance along a wall relative to one across.
const ALONG: f32 = 0.1;
/// Factor for a distance from or to a point without a known normal.
const UNSURE: f32 = 1.5;

impl Sums {
    fn settle(&mut self) -> Surfel {
        self.is_fresh = false;
        let part = 1.0 / self.count;
        let [x, y] = self.normal;
        let length = (x * x + y * y).sqrt();
        Surfel {
            at: [self.at[0] * part, self.at[1] * part],
            normal: match length > 0.5 * self.count {
                true => [x / length, y / length],
                false => [0.0; 2],
            },
            count: self.count.min(COUNT_MAX),
        }
    }
}

/// About `most` of these spots, evenly selected.
pub(crate) fn some_of(spots: &[Spot], most: usize) -> Vec<Spot> {
    if spots.len() <= most {
        return spots.to_vec();
    }
    (0..most)
        .map(|index| spots[index * spots.len() / most])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall at x = 2.03 m, from y = -1 m to 1 m, seen from the origin.
    fn wall() -> Surfels {
        let ends: Vec<[f32; 2]> = (-20..=20).map(|y| [2.03, y as f32 * 0.05]).collect();
        let mut walls = Surfels::around([0.0; 2], 5.0);
        walls.draw(Pose::default(), &Cloud::new(&ends));
        walls
    }

    #[test]
    fn a_spot_near_a_wall_lies_on_its_line() {
        let near = wall().nearest([2.08, 0.33], [-1.0, 0.0]).expect("a wall");
        assert!((near.at[0] - 2.03).abs() < 1e-3 && (near.normal[0] + 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_back_of_a_wall_is_another_wall() {
        assert!(wall().nearest([2.08, 0.33], [1.0, 0.0]).is_none());
        assert!(wall().nearest([2.5, 0.33], [-1.0, 0.0]).is_none());
    }

    /// The wall's own cell, the one beside it, and one farther away.
    #[test]
    fn beams_end_most_likely_in_the_walls_cells() {
        let walls = wall();
        let likely = [2.05, 2.15, 2.25].map(|x| walls.likelihood([x, 0.05]));
        assert_eq!(likely, [255, 150, 0]);
    }

    /// A square that was used before is as good as a new one.
    #[test]
    fn a_square_is_used_again() {
        let mut used = wall();
        used.aim([1.0, 0.5], 3.0);
        assert!(used.likely.iter().all(|likely| *likely == 0));
        let new = Surfels::around([1.0, 0.5], 3.0);
        assert_eq!(format!("{used:?}"), format!("{new:?}"));
    }

    /// Two spots of a wall one metre apart: a line is drawn between them only if it runs along the
    /// wall.
    #[test]
    fn only_what_lies_along_a_wall_is_drawn_between_its_spots() {
        assert!(lies_along([0.0, 0.0], [1.0, 0.1], [0.0, 1.0]));
        assert!(!lies_along([0.0, 0.0], [1.0, 0.5], [0.0, 1.0]));
        assert!(!lies_along([0.0, 0.0], [1.0, 0.0], [0.0, 0.0]));
    }
}
