//! Distance from each position of a map to the next obstacle.

use alloc::vec::Vec;

/// Distances to the next obstacle, for each cell of a map.
#[derive(Clone, Debug, PartialEq)]
pub struct LikelihoodField {
    width: usize,
    height: usize,
    cell_m: f64,
    origin_m: [f64; 2],
    farthest_m: f64,
    distances_m: Vec<f32>,
}

impl LikelihoodField {
    /// The field of a map of `obstacles`, in rows of `width` cells with edges of `cell_m`. The
    /// corner of least x and y is `origin_m`. Distances are at most `farthest_m`, which is also the
    /// distance outside the map.
    ///
    /// # Panics
    /// If `width` is 0.
    pub fn new(
        width: usize,
        cell_m: f64,
        origin_m: [f64; 2],
        obstacles: &[bool],
        farthest_m: f64,
    ) -> Self {
        assert!(width > 0, "a row has cells");
        let height = obstacles.len() / width;
        let far = libm::pow(farthest_m / cell_m, 2.0);
        let start = |is: &bool| if *is { 0.0 } else { far };
        let mut squares: Vec<f64> = obstacles[..width * height].iter().map(start).collect();
        for row in squares.chunks_exact_mut(width) {
            transform(row);
        }
        let mut column = alloc::vec![0.0; height];
        for x in 0..width {
            for y in 0..height {
                column[y] = squares[y * width + x];
            }
            transform(&mut column);
            for y in 0..height {
                squares[y * width + x] = column[y];
            }
        }
        #[expect(clippy::cast_possible_truncation, reason = "a distance needs 24 bits")]
        let metres = |square: &f64| (libm::sqrt(square.min(far)) * cell_m) as f32;
        Self {
            width,
            height,
            cell_m,
            origin_m,
            farthest_m,
            distances_m: squares.iter().map(metres).collect(),
        }
    }

    /// Distance from the cell at a position to the next obstacle, metres.
    pub fn distance_m(&self, place_m: [f64; 2]) -> f64 {
        let [x, y] = place_m;
        let cells = 1.0 / self.cell_m;
        self.at([
            (x - self.origin_m[0]) * cells,
            (y - self.origin_m[1]) * cells,
        ])
    }

    /// The same field with `of` applied to each distance, as a table of derived values.
    pub(super) fn mapped(&self, of: impl Fn(f64) -> f64) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "a weight needs 24 bits")]
        let value = |distance: &f32| of(f64::from(*distance)) as f32;
        Self {
            farthest_m: of(self.farthest_m),
            distances_m: self.distances_m.iter().map(value).collect(),
            ..*self
        }
    }

    /// Corner of least x and y, metres, and cells per metre: the conversion of positions to cells.
    pub(super) const fn frame(&self) -> ([f64; 2], f64) {
        (self.origin_m, 1.0 / self.cell_m)
    }

    /// The value at a position in cells from the corner.
    pub(super) fn at(&self, [x, y]: [f64; 2]) -> f64 {
        if !(x >= 0.0 && y >= 0.0) {
            return self.farthest_m;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "not below 0, saturates"
        )]
        // Convert to 32 bits first, which takes a processor one instruction; a conversion to
        // unsigned 64 bits takes more.
        let (x, y) = (x as u32 as usize, y as u32 as usize);
        if x >= self.width || y >= self.height {
            return self.farthest_m;
        }
        f64::from(self.distances_m[y * self.width + x])
    }
}

/// Replaces each value by the least of `value[j] + (i - j)^2`, the lower envelope of parabolas
/// (Felzenszwalb and Huttenlocher 2012). The result is the squared distances of a line.
fn transform(values: &mut [f64]) {
    let given = values.to_vec();
    // The parabolas of the envelope, and the position from which each is the lowest.
    let mut lowest: Vec<(usize, f64)> = Vec::new();
    for (at, value) in given.iter().enumerate() {
        let meets = |other: usize| {
            let (p, q) = (other as f64, at as f64);
            (value + q * q - given[other] - p * p) / (2.0 * (q - p))
        };
        let mut from = f64::NEG_INFINITY;
        while let Some((other, begins)) = lowest.last().copied() {
            from = meets(other);
            if from > begins {
                break;
            }
            lowest.pop();
            from = f64::NEG_INFINITY;
        }
        lowest.push((at, from));
    }
    let mut index = 0;
    for (at, value) in values.iter_mut().enumerate() {
        while lowest
            .get(index + 1)
            .is_some_and(|(_, from)| *from < at as f64)
        {
            index += 1;
        }
        let (other, _) = lowest[index];
        let off = at as f64 - other as f64;
        *value = given[other] + off * off;
    }
}
