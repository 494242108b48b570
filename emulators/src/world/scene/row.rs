//! A whole row of a camera at once: the nearest surface in each column.
//!
//! Each surface is drawn into the row; no ray is cast for each column. In a pinhole camera the
//! inverse depth of a straight wall is linear in the column. So a wall costs two ends and an
//! addition a column, without any trigonometry. The result equals that of one ray per column,
//! except for the last bits, and for columns that just touch the end of a wall.

use protocols::Instant;

use super::Scene;
use crate::world::geometry::{Circle, Pose, Primitive, Segment};

/// Minimum distance from the camera, metres.
const NEAR_M: f64 = 1e-9;

/// A pinhole camera's row: column `u` has the slope `(u - middle) / focal` to the right, relative
/// to straight ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Pose of the camera.
    pub camera: Pose,
    /// Focal length, pixels.
    pub focal_px: f64,
}

impl Scene {
    /// Draws the view of `row` at time `at`: the inverse of the least depth in each column, 1/m; 0
    /// where no object is.
    pub fn draw_row(&self, at: Instant, row: Row, columns: &mut [f64]) {
        columns.fill(0.0);
        let mut canvas = Canvas::new(row, columns);
        for primitive in &self.inner.fixed.primitives {
            canvas.draw(primitive, [0.0; 2]);
        }
        for moving in &self.inner.moving {
            let placed = moving.placed(at);
            for (primitive, _) in placed.surfaces() {
                canvas.draw(&primitive, [placed.origin.x, placed.origin.y]);
            }
        }
    }
}

struct Canvas<'a> {
    row: Row,
    sin: f64,
    cos: f64,
    middle: f64,
    columns: &'a mut [f64],
}

impl<'a> Canvas<'a> {
    fn new(row: Row, columns: &'a mut [f64]) -> Self {
        let (sin, cos) = libm::sincos(row.camera.theta);
        Self {
            row,
            sin,
            cos,
            middle: (columns.len() as f64 - 1.0) / 2.0,
            columns,
        }
    }

    fn draw(&mut self, primitive: &Primitive, shift: [f64; 2]) {
        match primitive {
            Primitive::Segment(wall) => self.draw_wall(wall, shift),
            Primitive::Circle(circle) => self.draw_circle(circle, shift),
        }
    }

    /// Ahead and to the left of the camera.
    fn seen(&self, x: f64, y: f64) -> [f64; 2] {
        let (dx, dy) = (x - self.row.camera.x, y - self.row.camera.y);
        [dx * self.cos + dy * self.sin, dy * self.cos - dx * self.sin]
    }

    /// The columns between two slopes, the difference to the left over the distance ahead: the
    /// first, and the one after the last.
    fn between(&self, one: f64, other: f64) -> (usize, usize) {
        let column = |slope: f64| self.middle - slope * self.row.focal_px;
        let (low, high) = (column(one.max(other)), column(one.min(other)));
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates at both ends"
        )]
        let whole = |column: f64| column as usize;
        let behind = whole((high.floor() + 1.0).max(0.0)).min(self.columns.len());
        (whole(low.ceil().max(0.0)), behind)
    }

    fn draw_wall(&mut self, wall: &Segment, [dx, dy]: [f64; 2]) {
        let [from, to] = wall.ends();
        let mut ends = [
            self.seen(from.x + dx, from.y + dy),
            self.seen(to.x + dx, to.y + dy),
        ];
        if ends[0][0] > ends[1][0] {
            ends.swap(0, 1);
        }
        let [near, far] = ends;
        if far[0] < NEAR_M {
            return;
        }
        // The line through both: across = ahead * normal.0 + left * normal.1, everywhere on it.
        let normal = [near[1] - far[1], far[0] - near[0]];
        let across = near[0] * normal[0] + near[1] * normal[1];
        if across == 0.0 {
            return;
        }
        let near = match near[0] < NEAR_M {
            true => {
                let part = (NEAR_M - near[0]) / (far[0] - near[0]);
                [NEAR_M, near[1] + (far[1] - near[1]) * part]
            }
            false => near,
        };
        let (first, behind) = self.between(near[1] / near[0], far[1] / far[0]);
        let per_column = -normal[1] / (across * self.row.focal_px);
        let start = normal[0] / across - self.middle * per_column;
        let columns = self.columns.iter_mut().enumerate();
        for (column, nearest) in columns.take(behind).skip(first) {
            let inverse = start + column as f64 * per_column;
            *nearest = nearest.max(inverse);
        }
    }

    fn draw_circle(&mut self, circle: &Circle, [dx, dy]: [f64; 2]) {
        let [ahead, left] = self.seen(circle.center.x + dx, circle.center.y + dy);
        let square = ahead * ahead + left * left;
        // Square of the length of the tangents; if it is below 0, the camera is inside the circle.
        let tangent = square - circle.radius * circle.radius;
        if ahead + circle.radius < NEAR_M {
            return;
        }
        let (first, behind) = match tangent > 0.0 {
            true => {
                let bearing = libm::atan2(left, ahead);
                let half = libm::asin((circle.radius / square.sqrt()).min(1.0));
                let slope = |bearing: f64| libm::tan(bearing.clamp(-1.57, 1.57));
                self.between(slope(bearing - half), slope(bearing + half))
            }
            false => (0, self.columns.len()),
        };
        for column in first..behind {
            let slope = (self.middle - column as f64) / self.row.focal_px;
            let long = 1.0 + slope * slope;
            let half = ahead + slope * left;
            let root = half * half - long * tangent;
            if root < 0.0 {
                continue;
            }
            let root = if tangent > 0.0 {
                -root.sqrt()
            } else {
                root.sqrt()
            };
            let depth = (half + root) / long;
            if depth >= NEAR_M {
                self.columns[column] = self.columns[column].max(1.0 / depth);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::world::geometry::Point;
    use crate::world::path::{Path, Repeat, Waypoint};
    use crate::world::scene::{Fixture, Obstacle, Shape};

    const FOCAL_PX: f64 = 526.3;

    fn point() -> impl Strategy<Value = Point> {
        (-6.0..6.0_f64, -6.0..6.0_f64).prop_map(|(x, y)| Point::new(x, y))
    }

    fn shape() -> impl Strategy<Value = Shape> {
        let wall = (point(), point()).prop_filter_map("no length", |(from, to)| {
            (from.distance(to) > 1e-3).then_some(Shape::Wall { from, to })
        });
        let circle = (point(), 0.02..1.5_f64)
            .prop_map(|(center, radius_m)| Shape::Circle { center, radius_m });
        prop_oneof![3 => wall, 1 => circle]
    }

    /// Depths by one ray per column, the obvious method.
    fn by_rays(scene: &Scene, at: Instant, row: Row, columns: usize) -> Vec<f64> {
        let middle = (columns as f64 - 1.0) / 2.0;
        let depth = |column: usize| {
            let bearing = -libm::atan2(column as f64 - middle, row.focal_px);
            let angle = row.camera.theta + bearing;
            let hit = scene.cast_ray(at, row.camera.point(), angle, 100.0);
            hit.map_or(0.0, |hit| 1.0 / (hit.distance * libm::cos(bearing)))
        };
        (0..columns).map(depth).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2 * ProptestConfig::default().cases))]

        /// Columns that touch the end of an object may see the object or the background: of 640 a
        /// few.
        #[test]
        fn a_row_is_what_a_ray_for_each_column_finds(
            shapes in prop::collection::vec(shape(), 1..20),
            moving in shape(),
            camera in (point(), -4.0..4.0_f64),
        ) {
            let waypoint = Waypoint { at: Instant::ZERO, position: Point::new(0.5, -0.25) };
            let path = Path { waypoints: vec![waypoint], repeat: Repeat::Once };
            let fixture = Fixture::from(moving);
            let scene = Scene::new(shapes, vec![Obstacle { fixture, path }]).unwrap();
            let (at, theta) = camera;
            let row = Row { camera: Pose::new(at.x, at.y, theta), focal_px: FOCAL_PX };
            let mut columns = vec![0.0; 640];
            scene.draw_row(Instant::ZERO, row, &mut columns);
            let rays = by_rays(&scene, Instant::ZERO, row, 640);
            let differs = |pair: &(&f64, &f64)| {
                (pair.0 - pair.1).abs() > 1e-6 * (1.0 + pair.1)
            };
            let differing = columns.iter().zip(&rays).filter(differs).count();
            prop_assert!(differing <= 4, "{differing} columns differ");
        }
    }

    /// A wall at exactly the distance up to which everything counts as behind the camera.
    #[test]
    fn a_wall_as_near_as_can_be_is_seen() {
        let wall = Segment::new(Point::new(NEAR_M, -1.0), Point::new(NEAR_M, 1.0));
        let row = Row {
            camera: Pose::default(),
            focal_px: 100.0,
        };
        let mut columns = [0.0; 3];
        let mut canvas = Canvas::new(row, &mut columns);
        canvas.draw_wall(&wall.expect("long enough"), [0.0; 2]);
        let nearest = |inverse: &f64| (inverse * NEAR_M - 1.0).abs() < 1e-6;
        assert!(columns.iter().all(nearest), "{columns:?}");
    }

    /// A wall 2 m ahead from 0.5 m to the left to 0.5 m to the right, focal length 100 pixels: the
    /// columns 25 beside the middle of 101 see its ends, further ones nothing.
    #[test]
    fn a_wall_fills_the_columns_between_its_ends() {
        let wall = Shape::Wall {
            from: Point::new(2.0, -0.5),
            to: Point::new(2.0, 0.5),
        };
        let scene = Scene::new([wall], Vec::new()).unwrap();
        let row = Row {
            camera: Pose::default(),
            focal_px: 100.0,
        };
        let mut columns = [9.0; 101];
        scene.draw_row(Instant::ZERO, row, &mut columns);
        let inverse: Vec<f64> = [24, 26, 50, 74, 76].map(|at| columns[at]).to_vec();
        assert_eq!(inverse, [0.0, 0.5, 0.5, 0.5, 0.0]);
        // Behind the camera there is nothing.
        let back = Row {
            camera: Pose::new(0.0, 0.0, core::f64::consts::PI),
            ..row
        };
        scene.draw_row(Instant::ZERO, back, &mut columns);
        assert!(columns.iter().all(|inverse| *inverse == 0.0));
    }

    /// A camera on the rim of a circle of 2 m sees its far side, 4 m ahead; from within it sees it
    /// nearer, from outside its near side.
    #[test]
    fn a_circle_is_seen_from_its_rim_and_from_within() {
        let seen = |ahead: f64| {
            let circle = Shape::Circle {
                center: Point::new(ahead, 0.0),
                radius_m: 2.0,
            };
            let scene = Scene::new([circle], Vec::new()).unwrap();
            let row = Row {
                camera: Pose::default(),
                focal_px: 100.0,
            };
            let mut columns = [0.0; 101];
            scene.draw_row(Instant::ZERO, row, &mut columns);
            1.0 / columns[50]
        };
        assert_eq!([2.0, 1.0, 3.0, 0.0].map(seen), [4.0, 3.0, 1.0, 2.0]);
        assert_eq!(seen(-3.0), f64::INFINITY);
    }

    /// Within a circle of 2 m there is something in each column, to whichever side its middle lies;
    /// straight ahead it is the root of 4 - 1 away if the middle is a metre aside.
    #[test]
    fn a_camera_in_a_circle_sees_it_in_each_column() {
        for (x, y) in [(0.0, 1.0), (0.0, -1.0), (-1.0, 0.5), (1.0, -0.5)] {
            let circle = Shape::Circle {
                center: Point::new(x, y),
                radius_m: 2.0,
            };
            let scene = Scene::new([circle], Vec::new()).unwrap();
            let row = Row {
                camera: Pose::default(),
                focal_px: 50.0,
            };
            let mut columns = [0.0; 301];
            scene.draw_row(Instant::ZERO, row, &mut columns);
            assert!(columns.iter().all(|inverse| *inverse > 0.0), "{x} {y}");
            let depth = x + (4.0 - y * y).sqrt();
            assert!((1.0 / columns[150] - depth).abs() < 1e-9, "{x} {y}");
        }
    }
}
