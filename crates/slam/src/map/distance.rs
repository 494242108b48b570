//! The distance from any position to the nearest wall of a map: the exact distance transform, by
//! lower envelopes of parabolas, first along columns, then along rows (Felzenszwalb and
//! Huttenlocher 2012).

use super::{CellState, RosMap};

/// Distances from the cells of a map to the nearest wall.
pub(super) struct Distances {
    width: usize,
    height: usize,
    cell_m: f64,
    origin: [f64; 2],
    cells: Vec<f32>,
}

/// More cells than any map has in a row.
const FAR: f64 = 1e8;

impl Distances {
    pub(super) fn new(map: &RosMap) -> Self {
        let (width, height) = (map.width, map.height);
        let mut squares = vec![FAR * FAR; width * height];
        for y in 0..height {
            for x in 0..width {
                if map.cell(x, y) == Some(CellState::Wall) {
                    squares[y * width + x] = 0.0;
                }
            }
        }
        let mut line = vec![0.0; width.max(height)];
        for x in 0..width {
            for y in 0..height {
                line[y] = squares[y * width + x];
            }
            let done = envelope(&line[..height]);
            for (y, square) in done.into_iter().enumerate() {
                squares[y * width + x] = square;
            }
        }
        for row in squares.chunks_mut(width) {
            let done = envelope(row);
            row.copy_from_slice(&done);
        }
        #[expect(clippy::cast_possible_truncation, reason = "a distance for a picture")]
        let cells = squares
            .iter()
            .map(|square| (libm::sqrt(*square) * map.cell_m) as f32)
            .collect();
        Self {
            width,
            height,
            cell_m: map.cell_m,
            origin: map.origin,
            cells,
        }
    }

    /// The distance from a position to the nearest wall, metres, at most `cap`; interpolated
    /// between the centres of cells. Outside the map the distance to its edge is added.
    pub(super) fn at(&self, [x, y]: [f64; 2], cap: f64) -> f64 {
        let place = |metres: f64, origin: f64, size: usize| {
            let cells = (metres - origin) / self.cell_m - 0.5;
            let inside = cells.clamp(0.0, (size - 1) as f64);
            (inside, (cells - inside).abs() * self.cell_m)
        };
        let (x, beyond_x) = place(x, self.origin[0], self.width);
        let (y, beyond_y) = place(y, self.origin[1], self.height);
        let beyond = libm::hypot(beyond_x, beyond_y);
        if beyond >= cap {
            return cap;
        }
        #[expect(clippy::cast_possible_truncation, reason = "on the map")]
        #[expect(clippy::cast_sign_loss, reason = "clamped")]
        let (column, row) = (x as usize, y as usize);
        let (part_x, part_y) = (x - x.floor(), y - y.floor());
        let value = |dx: usize, dy: usize| {
            let (x, y) = (
                (column + dx).min(self.width - 1),
                (row + dy).min(self.height - 1),
            );
            f64::from(self.cells[y * self.width + x])
        };
        let low = value(0, 0) * (1.0 - part_x) + value(1, 0) * part_x;
        let high = value(0, 1) * (1.0 - part_x) + value(1, 1) * part_x;
        (low * (1.0 - part_y) + high * part_y + beyond).min(cap)
    }
}

/// For each position of a line the minimum of `square + distance squared` over all positions.
fn envelope(squares: &[f64]) -> Vec<f64> {
    let meet = |a: usize, b: usize| {
        let (x, y) = (a as f64, b as f64);
        ((squares[b] + y * y) - (squares[a] + x * x)) / (2.0 * (y - x))
    };
    // The parabolas of the envelope, and the position from which on each is the lowest.
    let mut lowest: Vec<(usize, f64)> = Vec::new();
    for place in 0..squares.len() {
        let from = loop {
            let Some((last, from)) = lowest.last() else {
                break f64::NEG_INFINITY;
            };
            let at = meet(*last, place);
            if at > *from {
                break at;
            }
            lowest.pop();
        };
        lowest.push((place, from));
    }
    let mut index = 0;
    (0..squares.len())
        .map(|place| {
            while lowest
                .get(index + 1)
                .is_some_and(|next| next.1 < place as f64)
            {
                index += 1;
            }
            let apart = place.abs_diff(lowest[index].0) as f64;
            squares[lowest[index].0] + apart * apart
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]
        #[test]
        fn distances_are_those_of_looking_at_every_wall(
            walls in proptest::collection::vec(proptest::bool::weighted(0.05), 12 * 9),
        ) {
            prop_assume!(walls.contains(&true));
            let cells = walls.iter().map(|is| if *is { CellState::Wall } else { CellState::Free });
            let map = RosMap::new(12, 0.5, [0.0; 2], cells.collect());
            let distances = Distances::new(&map);
            for free in map.all(CellState::Free) {
                let nearest = map
                    .all(CellState::Wall)
                    .map(|wall| libm::hypot(wall[0] - free[0], wall[1] - free[1]))
                    .fold(f64::INFINITY, f64::min);
                prop_assert!((distances.at(free, 100.0) - nearest).abs() < 1e-5);
            }
        }
    }
}
