//! A floor plan from an occupancy image, such as the map saved by a ROS robot.

use super::geometry::Point;
use super::scene::Shape;

/// Occupied squares of the floor.
#[derive(Clone, Debug, PartialEq)]
pub struct OccupancyImage {
    /// Squares along x.
    pub width: usize,
    /// Squares along y.
    pub height: usize,
    /// Side of a square, metres.
    pub resolution_m: f64,
    /// The corner of square 0 with the least coordinates.
    pub origin: Point,
    /// Row by row, the row with the least y first; missing squares are free. (Images store the
    /// upper row first: decoders turn it over.)
    pub cells: Vec<bool>,
}

impl OccupancyImage {
    /// The walls between occupied and free squares, each straight run as one wall: first the
    /// horizontal ones from below, then the vertical ones from the left. Beyond the image the
    /// floor is free.
    pub fn walls(&self) -> Vec<Shape> {
        let mut walls = Vec::new();
        for y in 0..=self.height {
            let edge =
                |x| self.occupied(x, y) != y.checked_sub(1).is_some_and(|y| self.occupied(x, y));
            for (from, to) in runs(self.width, edge) {
                walls.push(Shape::Wall {
                    from: self.corner(from, y),
                    to: self.corner(to, y),
                });
            }
        }
        for x in 0..=self.width {
            let edge =
                |y| self.occupied(x, y) != x.checked_sub(1).is_some_and(|x| self.occupied(x, y));
            for (from, to) in runs(self.height, edge) {
                walls.push(Shape::Wall {
                    from: self.corner(x, from),
                    to: self.corner(x, to),
                });
            }
        }
        walls
    }

    fn occupied(&self, x: usize, y: usize) -> bool {
        let inside = x < self.width && y < self.height;
        inside && self.cells.get(y * self.width + x).copied().unwrap_or(false)
    }

    #[expect(
        clippy::cast_precision_loss,
        reason = "an image has far fewer than 2^53 squares"
    )]
    fn corner(&self, x: usize, y: usize) -> Point {
        Point::new(
            self.origin.x + x as f64 * self.resolution_m,
            self.origin.y + y as f64 * self.resolution_m,
        )
    }
}

/// Longest stretches `from..to` of `0..length` in which `edge` holds.
fn runs(length: usize, edge: impl Fn(usize) -> bool) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let mut from = None;
    for index in 0..=length {
        let is_edge = index < length && edge(index);
        match (from, is_edge) {
            (None, true) => from = Some(index),
            (Some(start), false) => {
                found.push((start, index));
                from = None;
            }
            _ => {}
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(rows_from_above: &[&str]) -> OccupancyImage {
        OccupancyImage {
            width: rows_from_above[0].len(),
            height: rows_from_above.len(),
            resolution_m: 0.5,
            origin: Point::new(-1.0, 2.0),
            cells: rows_from_above
                .iter()
                .rev()
                .flat_map(|row| row.chars())
                .map(|c| c == '#')
                .collect(),
        }
    }

    fn wall(x0: f64, y0: f64, x1: f64, y1: f64) -> Shape {
        Shape::Wall {
            from: Point::new(x0, y0),
            to: Point::new(x1, y1),
        }
    }

    #[test]
    fn one_occupied_square_has_four_walls() {
        let walls = image(&["...", ".#.", "..."]).walls();
        assert_eq!(
            walls,
            [
                wall(-0.5, 2.5, 0.0, 2.5),
                wall(-0.5, 3.0, 0.0, 3.0),
                wall(-0.5, 2.5, -0.5, 3.0),
                wall(0.0, 2.5, 0.0, 3.0),
            ]
        );
    }

    /// A room whose outer squares are occupied: four long walls outside, four inside.
    #[test]
    fn straight_runs_become_one_wall() {
        let walls = image(&["#####", "#...#", "#...#", "#####"]).walls();
        assert_eq!(walls.len(), 8);
        assert!(walls.contains(&wall(-1.0, 2.0, 1.5, 2.0)));
        assert!(walls.contains(&wall(-0.5, 2.5, 1.0, 2.5)));
    }

    #[test]
    fn the_first_row_is_the_lowest() {
        let walls = image(&["..", "##"]).walls();
        assert!(walls.contains(&wall(-1.0, 2.0, 0.0, 2.0)));
        assert!(walls.contains(&wall(-1.0, 2.5, 0.0, 2.5)));
    }

    #[test]
    fn an_empty_or_truncated_image_has_no_walls_where_squares_are_missing() {
        let mut empty = image(&["##", "##"]);
        empty.cells.clear();
        assert_eq!(empty.walls(), []);
        empty.cells = vec![true];
        assert_eq!(empty.walls().len(), 4);
    }

    /// Only the left column is occupied: the pixel behind the right one in the image begins the
    /// next row.
    #[test]
    fn a_column_at_the_side_has_its_own_walls_only() {
        let mut walls = image(&["#.", "#."]).walls();
        walls.retain(|found| {
            let expected = [
                wall(-1.0, 2.0, -0.5, 2.0),
                wall(-1.0, 3.0, -0.5, 3.0),
                wall(-1.0, 2.0, -1.0, 3.0),
                wall(-0.5, 2.0, -0.5, 3.0),
            ];
            assert!(expected.contains(found), "{found:?}");
            true
        });
        assert_eq!(walls.len(), 4);
    }
}
