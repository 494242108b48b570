//! Ray casting among very many walls, which are sorted into squares.

use emulators::world::Pose;

use super::Wall;

/// Edge of a square, metres.
const SQUARE_M: f64 = 2.0;
/// Maximum length of a beam, metres.
const FARTHEST_M: f64 = 100.0;

/// Walls by square.
pub(super) struct Rays<'a> {
    walls: &'a [Wall],
    corner: [f64; 2],
    across: i64,
    up: i64,
    squares: Vec<Vec<usize>>,
}

#[expect(clippy::cast_possible_truncation, reason = "a few hundred")]
fn square(metres: f64) -> i64 {
    libm::floor(metres / SQUARE_M) as i64
}

impl<'a> Rays<'a> {
    pub(super) fn new(walls: &'a [Wall]) -> Self {
        let ends = || walls.iter().flat_map(|wall| [wall.from, wall.to]);
        let least = [0, 1].map(|axis| ends().map(|p| p[axis]).fold(f64::MAX, f64::min) - 1.0);
        let most = [0, 1].map(|axis| ends().map(|p| p[axis]).fold(f64::MIN, f64::max) + 1.0);
        let [across, up] = [0, 1].map(|axis| square(most[axis] - least[axis]) + 1);
        let mut rays = Self {
            walls,
            corner: least,
            across,
            up,
            squares: Vec::new(),
        };
        let count = usize::try_from(across * up).unwrap_or(0);
        rays.squares = vec![Vec::new(); count];
        for (number, wall) in walls.iter().enumerate() {
            rays.sort(number, wall);
        }
        rays
    }

    /// Sorts a wall into every square of its bounding box.
    fn sort(&mut self, number: usize, wall: &Wall) {
        let range = |axis: usize| {
            let [a, b] = [wall.from[axis], wall.to[axis]].map(|m| square(m - self.corner[axis]));
            a.min(b)..=a.max(b)
        };
        for y in range(1) {
            for x in range(0) {
                if let Ok(flat) = usize::try_from(y * self.across + x) {
                    self.squares[flat].push(number);
                }
            }
        }
    }

    /// Length of a beam, metres.
    pub(super) fn cast(&self, from: Pose, angle: f64, sees_glass: bool) -> f64 {
        let way = [libm::cos(angle), libm::sin(angle)];
        let at = [from.x - self.corner[0], from.y - self.corner[1]];
        let (mut x, mut y) = (square(at[0]), square(at[1]));
        let step = way.map(|part| if part < 0.0 { -1 } else { 1 });
        let border = |axis: usize, cell: i64| {
            let edge = (cell + i64::from(step[axis] > 0)) as f64 * SQUARE_M;
            if way[axis] == 0.0 {
                f64::MAX
            } else {
                (edge - at[axis]) / way[axis]
            }
        };
        let mut nearest = FARTHEST_M;
        loop {
            if !(0..self.across).contains(&x) || !(0..self.up).contains(&y) {
                return nearest;
            }
            if let Ok(flat) = usize::try_from(y * self.across + x) {
                for number in &self.squares[flat] {
                    let wall = &self.walls[*number];
                    if sees_glass || !wall.is_glass {
                        nearest = nearest.min(meets(from, way, wall));
                    }
                }
            }
            let (next_x, next_y) = (border(0, x), border(1, y));
            if nearest <= next_x.min(next_y) {
                return nearest;
            }
            if next_x < next_y {
                x += step[0];
            } else {
                y += step[1];
            }
        }
    }
}

/// Distance to the intersection of a ray and a wall; very large if they do not intersect.
fn meets(from: Pose, way: [f64; 2], wall: &Wall) -> f64 {
    let along = [wall.to[0] - wall.from[0], wall.to[1] - wall.from[1]];
    let to = [wall.from[0] - from.x, wall.from[1] - from.y];
    let cross = way[0] * along[1] - way[1] * along[0];
    if cross.abs() < 1e-12 {
        return f64::MAX;
    }
    let far = (to[0] * along[1] - to[1] * along[0]) / cross;
    let on = (to[0] * way[1] - to[1] * way[0]) / cross;
    if far > 0.0 && (0.0..=1.0).contains(&on) {
        far
    } else {
        f64::MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: from the origin along x to a wall at 7, past glass at 3.
    #[test]
    fn a_beam_ends_at_the_nearest_wall_and_goes_through_glass() {
        let wall = |x: f64, is_glass| Wall {
            from: [x, -5.0],
            to: [x, 5.0],
            is_glass,
        };
        let walls = [wall(7.0, false), wall(3.0, true), wall(-4.0, false)];
        let rays = Rays::new(&walls);
        let from = Pose::default();
        assert!((rays.cast(from, 0.0, false) - 7.0).abs() < 1e-9);
        assert!((rays.cast(from, 0.0, true) - 3.0).abs() < 1e-9);
        assert!((rays.cast(from, core::f64::consts::PI, true) - 4.0).abs() < 1e-9);
    }
}
