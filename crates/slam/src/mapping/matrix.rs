//! Matrices of three rows and columns: x, y and heading.

/// Rows of a matrix.
pub type Matrix = [[f64; 3]; 3];

/// The zero matrix.
pub(crate) const ZERO: Matrix = [[0.0; 3]; 3];

/// A diagonal matrix.
pub(crate) const fn diagonal(of: [f64; 3]) -> Matrix {
    [[of[0], 0.0, 0.0], [0.0, of[1], 0.0], [0.0, 0.0, of[2]]]
}

#[inline]
pub(crate) fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let row = |a: [f64; 3]| {
        let to = |column: usize| a[0] * b[0][column] + a[1] * b[1][column] + a[2] * b[2][column];
        [to(0), to(1), to(2)]
    };
    [row(a[0]), row(a[1]), row(a[2])]
}

#[inline]
pub(crate) fn transposed(a: &Matrix) -> Matrix {
    [
        [a[0][0], a[1][0], a[2][0]],
        [a[0][1], a[1][1], a[2][1]],
        [a[0][2], a[1][2], a[2][2]],
    ]
}

#[inline]
pub(crate) fn sum(a: &Matrix, b: &Matrix) -> Matrix {
    let row = |row: usize| {
        let (a, b) = (a[row], b[row]);
        [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
    };
    [row(0), row(1), row(2)]
}

#[inline]
pub(crate) fn scaled(a: &Matrix, by: f64) -> Matrix {
    let row = |a: [f64; 3]| [a[0] * by, a[1] * by, a[2] * by];
    [row(a[0]), row(a[1]), row(a[2])]
}

#[inline]
pub(crate) fn applied(a: &Matrix, to: [f64; 3]) -> [f64; 3] {
    let row = |a: [f64; 3]| a[0] * to[0] + a[1] * to[1] + a[2] * to[2];
    [row(a[0]), row(a[1]), row(a[2])]
}

/// The squared length of `to`, weighted by `a`.
#[inline]
pub(crate) fn weighed(a: &Matrix, to: [f64; 3]) -> f64 {
    let by = applied(a, to);
    by[0] * to[0] + by[1] * to[1] + by[2] * to[2]
}

/// The inverse; `None` for a singular matrix.
#[inline]
pub(crate) fn inverse(a: &Matrix) -> Option<Matrix> {
    let minor = |row: usize, column: usize| {
        let (r, s) = ((row + 1) % 3, (row + 2) % 3);
        let (c, d) = ((column + 1) % 3, (column + 2) % 3);
        a[r][c] * a[s][d] - a[r][d] * a[s][c]
    };
    let determinant = a[0][0] * minor(0, 0) + a[0][1] * minor(0, 1) + a[0][2] * minor(0, 2);
    let is_regular = determinant.is_finite() && determinant.abs() > 1e-30;
    let part = 1.0 / determinant;
    is_regular.then(|| {
        let row = |row: usize| {
            [
                minor(0, row) * part,
                minor(1, row) * part,
                minor(2, row) * part,
            ]
        };
        [row(0), row(1), row(2)]
    })
}

/// The same matrix in rotated axes of x and y; the heading is not affected.
pub(crate) fn turned(a: &Matrix, sin: f64, cos: f64) -> Matrix {
    let turn = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]];
    product(&product(&turn, a), &transposed(&turn))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: the inverse of [[2,0,0],[0,4,1],[0,0,5]] is [[.5,0,0],[0,.25,-.05],[0,0,.2]].
    #[test]
    fn the_inverse_is_that_of_the_textbook_and_singular_ones_have_none() {
        let a = [[2.0, 0.0, 0.0], [0.0, 4.0, 1.0], [0.0, 0.0, 5.0]];
        let expected = [[0.5, 0.0, 0.0], [0.0, 0.25, -0.05], [0.0, 0.0, 0.2]];
        let found = inverse(&a).expect("regular");
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert!(inverse(&[[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [0.0, 0.0, 1.0]]).is_none());
    }

    /// After a quarter of a turn, information along x becomes information along y.
    #[test]
    fn a_turned_matrix_has_its_axes_turned() {
        let found = turned(&diagonal([9.0, 1.0, 4.0]), 1.0, 0.0);
        assert!((found[0][0] - 1.0).abs() < 1e-12 && (found[1][1] - 9.0).abs() < 1e-12);
        assert!((found[2][2] - 4.0).abs() < 1e-12);
    }
}
