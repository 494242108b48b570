//! Localisation as the report describes it (page 5): the local map is turned in steps of a degree
//! and correlated with the global map.
//!
//! ```text
//! lines --turned--> picture --normalised cross-correlation--> best cell --3 x 3 votes--> pose
//! ```
//!
//! The correlation is that of Matlab's `normxcorr2`, which the published program uses: both
//! pictures are taken without their mean, and the global one continues with zeros. Pictures have a
//! pixel for each cell of 100 mm: walls 0, unknown cells 200 and free cells 255 parts of 255. The
//! local picture has no free cells, and a margin of five cells.

use firmware_core::cell_map::{Cell, CellMap};
use firmware_core::grid::{FREE, OBSTACLE, UNKNOWN as GREY};
use firmware_core::local_map::Segment;

/// Combination of the votes of all rotations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rule {
    /// Votes are added, from 0: the words of the report.
    Added,
    /// Each free cell begins at 1, and a vote `m` multiplies its value by `1 + m`: the program.
    Multiplied,
}

/// Brightness of an unknown cell; walls are 0 and free cells 1.
const UNKNOWN: f32 = 200.0 / 255.0;
/// Cells around the lines of a local picture.
const MARGIN: i32 = 5;
/// Edge of a cell, mm.
const CELL_MM: f64 = 100.0;
/// Steps of a drawn line in a cell.
const STEPS: f64 = 20.0;

/// The global map as a picture with its sums.
pub(super) struct Global {
    width: i32,
    height: i32,
    low: Cell,
    pixels: Vec<f32>,
    is_free: Vec<bool>,
}

/// Estimated cell, and heading in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    pub(super) cell: Cell,
    pub(super) heading_deg: f64,
}

/// A picture of walls, and the robot's pixel in it.
struct Local {
    width: i32,
    height: i32,
    robot: [i32; 2],
    walls: Vec<[i32; 2]>,
}

impl Global {
    /// The picture of a map, with this number of unknown cells around all known ones.
    pub(super) fn new(map: &CellMap, margin: i32) -> Self {
        let known = map.iter().filter(|(_, value)| *value != GREY);
        let known: Vec<Cell> = known.map(|(cell, _)| cell).collect();
        let ends = |of: fn(&Cell) -> i32| {
            let low = known.iter().map(of).min().unwrap_or(0) - margin;
            let high = known.iter().map(of).max().unwrap_or(0) + margin;
            [low, high - low + 1]
        };
        let [[left, width], [lower, height]] = [ends(|cell| cell.x), ends(|cell| cell.y)];
        let low = Cell::new(left, lower);
        let cells = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let cells = cells.map(|(x, y)| map.get(Cell::new(low.x + x, low.y + y)));
        let brightness = |value| match value {
            OBSTACLE => 0.0,
            FREE => 1.0,
            _ => UNKNOWN,
        };
        Self {
            width,
            height,
            low,
            pixels: cells.clone().map(brightness).collect(),
            is_free: cells.map(|value| value == FREE).collect(),
        }
    }

    fn index(&self, [x, y]: [i32; 2]) -> Option<usize> {
        let is_inside = (0..self.width).contains(&x) && (0..self.height).contains(&y);
        usize::try_from(y * self.width + x)
            .ok()
            .filter(|_| is_inside)
    }

    /// The pose with the most votes; `None` if no rotation has a vote.
    pub(super) fn localised(&self, lines: &[Segment], rule: Rule) -> Option<Found> {
        let mut belief: Vec<f64> = self
            .is_free
            .iter()
            .map(|free| match (rule, free) {
                (Rule::Multiplied, true) => 1.0,
                _ => 0.0,
            })
            .collect();
        let mut best = (f64::NEG_INFINITY, 0.0);
        for degrees in -180..180 {
            let degrees = f64::from(degrees);
            let local = Local::new(lines, degrees.to_radians());
            if local.width > self.width || local.height > self.height {
                continue;
            }
            let Some((score, at)) = self.peak(&local) else {
                continue;
            };
            if score > best.0 {
                best = (score, degrees);
            }
            for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
                let kernel = [1.0, 0.75, 0.5][usize::from(dx != 0) + usize::from(dy != 0)];
                let Some(index) = self.index([at[0] + dx, at[1] + dy]) else {
                    continue;
                };
                let vote = score * kernel;
                match rule {
                    Rule::Added => belief[index] += vote,
                    Rule::Multiplied => belief[index] *= 1.0 + vote,
                }
            }
        }
        let order = |one: &usize, other: &usize| belief[*one].total_cmp(&belief[*other]);
        let winner = (0..belief.len()).max_by(order)?;
        let winner = i32::try_from(winner).ok()?;
        best.0.is_finite().then_some(Found {
            cell: Cell::new(
                self.low.x + winner % self.width,
                self.low.y + winner / self.width,
            ),
            heading_deg: best.1,
        })
    }

    /// The best correlation, and the robot's pixel there.
    fn peak(&self, local: &Local) -> Option<(f64, [i32; 2])> {
        // Offsets of the local picture from complete overlap down to a single row or column.
        let [columns, rows] = [self.width + local.width - 1, self.height + local.height - 1];
        let (columns, rows) = (usize::try_from(columns).ok()?, usize::try_from(rows).ok()?);
        let padded = self.padded(local);
        let count = f64::from(local.width * local.height);
        let share = local.walls.len() as f64 / count;
        if local.walls.is_empty() {
            return None;
        }
        // The local picture is 1 but for its walls: its mean is `1 - share`.
        let spread = (count * share * (1.0 - share)).sqrt();
        let mut on_walls = vec![0.0_f32; columns * rows];
        for [x, y] in &local.walls {
            let (x, y) = (usize::try_from(*x).ok()?, usize::try_from(*y).ok()?);
            for (row, sums) in on_walls.chunks_exact_mut(columns).enumerate() {
                let first = (row + y) * padded.width + x;
                let pixels = &padded.pixels[first..first + columns];
                for (sum, pixel) in sums.iter_mut().zip(pixels) {
                    *sum += pixel;
                }
            }
        }
        let mut best = (f64::NEG_INFINITY, [0, 0]);
        for (index, on_walls) in on_walls.iter().enumerate() {
            let (column, row) = (index % columns, index / columns);
            let [sum, squares] = padded.sums(column, row, local);
            let variance = squares - sum * sum / count;
            if variance < 1e-6 {
                continue;
            }
            let score = (share * sum - f64::from(*on_walls)) / (spread * variance.sqrt());
            if score > best.0 {
                let place = |at: usize, size: i32, robot: i32| {
                    i32::try_from(at).unwrap_or(0) - size + 1 + robot
                };
                let at = [
                    place(column, local.width, local.robot[0]),
                    place(row, local.height, local.robot[1]),
                ];
                best = (score, at);
            }
        }
        best.0.is_finite().then_some(best)
    }
}

impl Global {
    /// This picture between zeros, such that a local picture may overlap it by a single pixel.
    fn padded(&self, local: &Local) -> Padded {
        let size = |value: i32| usize::try_from(value).unwrap_or(0);
        let [left, below] = [size(local.width - 1), size(local.height - 1)];
        let (inner_width, inner_height) = (size(self.width), size(self.height));
        let width = inner_width + 2 * left;
        let height = inner_height + 2 * below;
        let mut pixels = vec![0.0; width * height];
        for (row, source) in self.pixels.chunks_exact(inner_width.max(1)).enumerate() {
            let first = (row + below) * width + left;
            pixels[first..first + inner_width].copy_from_slice(source);
        }
        let mut sums = vec![[0.0; 2]; (width + 1) * (height + 1)];
        for row in 0..height {
            let mut line = [0.0; 2];
            for column in 0..width {
                let pixel = f64::from(pixels[row * width + column]);
                line = [line[0] + pixel, line[1] + pixel * pixel];
                let above = sums[row * (width + 1) + column + 1];
                sums[(row + 1) * (width + 1) + column + 1] =
                    [above[0] + line[0], above[1] + line[1]];
            }
        }
        Padded {
            width,
            pixels,
            sums,
        }
    }
}

/// A picture between zeros.
struct Padded {
    width: usize,
    pixels: Vec<f32>,
    /// Sums of all pixels, and of their squares, to the left of and below a pixel.
    sums: Vec<[f64; 2]>,
}

impl Padded {
    /// Sum of the pixels below a local picture at this offset, and sum of their squares.
    fn sums(&self, column: usize, row: usize, local: &Local) -> [f64; 2] {
        let size = |value: i32| usize::try_from(value).unwrap_or(0);
        let (width, height) = (size(local.width), size(local.height));
        let at = |column: usize, row: usize| self.sums[row * (self.width + 1) + column];
        let [low, right] = [at(column, row), at(column + width, row)];
        let [upper, all] = [at(column, row + height), at(column + width, row + height)];
        [0, 1].map(|index| all[index] - right[index] - upper[index] + low[index])
    }
}

impl Local {
    /// The picture of `lines`, in the frame of a robot that has this heading, radians.
    fn new(lines: &[Segment], heading: f64) -> Self {
        let (sin, cos) = libm::sincos(heading);
        let cell = |x_mm: f32, y_mm: f32| {
            let (x, y) = (f64::from(x_mm), f64::from(y_mm));
            [(x * cos - y * sin) / CELL_MM, (x * sin + y * cos) / CELL_MM].map(libm::round)
        };
        let mut walls = Vec::new();
        for line in lines {
            let from = cell(line.start.x_mm, line.start.y_mm);
            let to = cell(line.end.x_mm, line.end.y_mm);
            let way = [to[0] - from[0], to[1] - from[1]];
            let steps = (STEPS * way[0].abs().max(way[1].abs())).max(1.0);
            let mut step = 0.0;
            while step <= steps {
                let at = [0, 1].map(|axis| libm::round(from[axis] + way[axis] * step / steps));
                #[expect(clippy::cast_possible_truncation, reason = "at most 60 cells")]
                walls.push(at.map(|value| value as i32));
                step += 1.0;
            }
        }
        walls.sort_unstable();
        walls.dedup();
        let ends = |axis: usize| {
            let along = walls.iter().map(move |cell| cell[axis]);
            let low = along.clone().min().unwrap_or(0).min(0) - MARGIN;
            let high = along.max().unwrap_or(0).max(0) + MARGIN;
            [low, high]
        };
        let [[left, right], [lower, upper]] = [ends(0), ends(1)];
        Self {
            width: right - left + 1,
            height: upper - lower + 1,
            robot: [-left, -lower],
            walls: walls.iter().map(|[x, y]| [x - left, y - lower]).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_core::pose::Point;

    /// An L-shaped room, and its walls as seen from cell (4, 3) by a robot that has turned by 90
    /// degrees: the robot is found in the cell, with its heading.
    #[test]
    fn a_turned_robot_is_found_in_its_cell() {
        let corners = [
            (0, 0),
            (20, 0),
            (20, 10),
            (10, 10),
            (10, 16),
            (0, 16),
            (0, 0),
        ];
        let mut map = CellMap::new(100.0, 5, 10_000);
        for y in 1..16 {
            for x in 1..20 {
                let is_inside = x < 10 || y < 10;
                let value = if is_inside { FREE } else { GREY };
                map.set(Cell::new(x, y), value).expect("a small map");
            }
        }
        for pair in corners.windows(2) {
            let [(x0, y0), (x1, y1)] = [pair[0], pair[1]];
            for step in 0..=20 {
                let at = |from: i32, to: i32| from + (to - from) * step / 20;
                let cell = Cell::new(at(x0, x1), at(y0, y1));
                map.set(cell, OBSTACLE).expect("a small map");
            }
        }
        // In the robot's frame its own left is the map's lower side.
        let seen = |(x, y): (i32, i32)| {
            let [x, y] = [x - 4, y - 3].map(|cells| 100.0 * cells as f32);
            Point::new(y, -x)
        };
        let lines: Vec<Segment> = corners
            .windows(2)
            .map(|pair| Segment::new(seen(pair[0]), seen(pair[1])))
            .collect();
        for rule in [Rule::Added, Rule::Multiplied] {
            let found = Global::new(&map, 9).localised(&lines, rule).expect("walls");
            assert_eq!(found.cell, Cell::new(4, 3), "{rule:?}");
            // Headings that give the same picture are equally good; the first one is taken.
            assert!((found.heading_deg - 90.0).abs() <= 2.0, "{found:?}");
        }
    }
}
