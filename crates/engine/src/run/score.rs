//! Accuracy of the program's pose and map, compared with the true world.

use emulators::world::{Point, Pose as TruePose, Shape, World};
use firmware_core::map_view::MapView;
use protocols::Instant;

/// The program's pose and the true one, at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePair {
    /// Time of the estimate.
    pub at: Instant,
    /// True position of the robot.
    pub truth: TruePose,
    /// Estimated position, in metres and radians.
    pub estimate: TruePose,
}

impl PosePair {
    /// Distance between the two, in mm.
    pub fn error_mm(&self) -> f64 {
        self.truth.point().distance(self.estimate.point()) * 1000.0
    }

    /// Angle between the two, in degrees, never negative.
    pub fn error_deg(&self) -> f64 {
        emulators::world::wrap_angle(self.truth.theta - self.estimate.theta)
            .to_degrees()
            .abs()
    }
}

/// Root mean square and worst case of the pose errors of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseError {
    /// Position.
    pub rms_mm: f64,
    /// Heading.
    pub rms_deg: f64,
    /// Maximum error of the position.
    pub max_mm: f64,
    /// Maximum error of the heading.
    pub max_deg: f64,
}

/// The errors of `pairs`; `None` if the list is empty.
pub fn pose_error(pairs: &[PosePair]) -> Option<PoseError> {
    if pairs.is_empty() {
        return None;
    }
    let count = pairs.len() as f64;
    let mut sum = PoseError::default();
    for pair in pairs {
        let (mm, deg) = (pair.error_mm(), pair.error_deg());
        sum.rms_mm += mm * mm / count;
        sum.rms_deg += deg * deg / count;
        sum.max_mm = sum.max_mm.max(mm);
        sum.max_deg = sum.max_deg.max(deg);
    }
    Some(PoseError {
        rms_mm: sum.rms_mm.sqrt(),
        rms_deg: sum.rms_deg.sqrt(),
        ..sum
    })
}

/// Value from which a cell counts as occupied: three quarters between unknown and certain.
pub(crate) const OCCUPIED: u8 = 190;

/// Whether a person would see the cell as part of a wall: dark, and a ridge of the map along x or
/// y. tinySLAM draws walls as broad slopes, whose flanks are not walls.
pub fn is_wall(map: MapView<'_>, x: usize, y: usize) -> bool {
    let at = |dx: isize, dy: isize| {
        let cell = x.checked_add_signed(dx).zip(y.checked_add_signed(dy));
        cell.and_then(|(x, y)| map.get(x, y)).unwrap_or(127)
    };
    let here = at(0, 0);
    let ridge = |dx: isize, dy: isize| {
        here >= at(-dx, -dy)
            && here >= at(dx, dy)
            && here > at(-3 * dx, -3 * dy)
            && here > at(3 * dx, 3 * dy)
    };
    here >= OCCUPIED && (ridge(1, 0) || ridge(0, 1))
}

/// Agreement of map and world on walls.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WallOverlap {
    /// Share of the walls that an ideal lidar would have seen on the robot's path and that the map
    /// shows within the allowed number of cells.
    pub found: f64,
    /// Share of the map's wall cells with a true wall within the allowed number of cells.
    pub right: f64,
}

impl WallOverlap {
    /// The smaller of the two.
    pub fn least(&self) -> f64 {
        self.found.min(self.right)
    }
}

/// Reach of the ideal lidar, metres.
const REACH_M: f64 = 6.0;

/// A bit per cell of the map.
struct Cells {
    width: usize,
    height: usize,
    cell_m: f64,
    origin_m: [f64; 2],
    bits: Vec<bool>,
}

impl Cells {
    fn like(map: MapView<'_>) -> Self {
        let (width, height) = (map.width(), map.height());
        Self {
            width,
            height,
            cell_m: f64::from(map.cell_mm()) / 1000.0,
            origin_m: map.origin_mm().map(|mm| f64::from(mm) / 1000.0),
            bits: vec![false; width * height],
        }
    }

    fn mark(&mut self, place: Point) {
        let [x0, y0] = self.origin_m;
        let (x, y) = ((place.x - x0) / self.cell_m, (place.y - y0) / self.cell_m);
        let inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
        if inside {
            #[expect(clippy::cast_possible_truncation, reason = "inside the grid")]
            #[expect(clippy::cast_sign_loss, reason = "inside the grid")]
            let (x, y) = (x as usize, y as usize);
            self.bits[y * self.width + x] = true;
        }
    }

    fn iter(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let marked = self.bits.iter().enumerate().filter(|(_, bit)| **bit);
        marked.map(|(index, _)| (index % self.width, index / self.width))
    }

    /// Whether a cell is marked at most `reach` cells away along x and y.
    fn is_near(&self, x: usize, y: usize, reach: usize) -> bool {
        let ys = y.saturating_sub(reach)..=(y + reach).min(self.height - 1);
        ys.into_iter().any(|y| {
            let xs = x.saturating_sub(reach)..=(x + reach).min(self.width - 1);
            self.bits[y * self.width..][xs].contains(&true)
        })
    }
}

/// Compares the walls of `map` with those of the scene, as visible from `way`. A wall may be drawn
/// one cell from its true position, or `within_mm`.
pub(crate) fn wall_overlap(
    map: MapView<'_>,
    world: &World,
    way: &[TruePose],
    within_mm: Option<f64>,
) -> WallOverlap {
    let cells = within_mm.unwrap_or_default() / f64::from(map.cell_mm());
    #[expect(clippy::cast_possible_truncation, reason = "at most 1000")]
    #[expect(clippy::cast_sign_loss, reason = "not negative")]
    let reach = (cells as usize).max(1);
    let mut drawn = Cells::like(map);
    for y in 0..map.height() {
        for x in 0..map.width() {
            drawn.bits[y * drawn.width + x] = is_wall(map, x, y);
        }
    }
    let mut seen = Cells::like(map);
    let degrees = (0..360_u16).map(|degree| f64::from(degree).to_radians());
    let degrees: Vec<(f64, Point)> = degrees.map(|angle| (angle, ahead(angle))).collect();
    let mut before = None;
    for from in way.iter().map(|pose| pose.point()) {
        // A robot at rest sees the same walls again.
        if before.replace(from) == Some(from) {
            continue;
        }
        for &(angle, dir) in &degrees {
            let ray = (from, angle, dir);
            if let Some(hit) = world.scene().cast_ahead(Instant::ZERO, ray, REACH_M) {
                let [x, y] = [dir.x, dir.y].map(|part| hit.distance * part);
                seen.mark(Point::new(from.x + x, from.y + y));
            }
        }
    }
    let mut solid = Cells::like(map);
    for fixture in world.scene().fixtures() {
        let step = solid.cell_m / 4.0;
        outline(&fixture.shape, step, |place| solid.mark(place));
    }
    WallOverlap {
        found: share(&seen, &drawn, reach),
        right: share(&drawn, &solid, reach),
    }
}

/// The unit vector in the direction `angle`.
fn ahead(angle: f64) -> Point {
    let (sin, cos) = libm::sincos(angle);
    Point::new(cos, sin)
}

fn share(of: &Cells, near: &Cells, reach: usize) -> f64 {
    let (mut all, mut good) = (0_u32, 0_u32);
    for (x, y) in of.iter() {
        all += 1;
        good += u32::from(near.is_near(x, y, reach));
    }
    if all == 0 {
        0.0
    } else {
        f64::from(good) / f64::from(all)
    }
}

/// Calls `visit` with points along the outline, at most `step` metres apart.
pub fn outline(shape: &Shape, step: f64, mut visit: impl FnMut(Point)) {
    let mut line = |from: Point, to: Point| {
        let steps = (from.distance(to) / step).ceil().max(1.0);
        let mut done = 0.0;
        while done <= steps {
            let part = done / steps;
            visit(Point::new(
                from.x + (to.x - from.x) * part,
                from.y + (to.y - from.y) * part,
            ));
            done += 1.0;
        }
    };
    match shape {
        Shape::Wall { from, to } => line(*from, *to),
        Shape::Polygon { corners } => {
            for (index, corner) in corners.iter().enumerate() {
                line(*corner, corners[(index + 1) % corners.len()]);
            }
        }
        Shape::Circle { center, radius_m } => {
            let at = |degree: u16| {
                let angle = f64::from(degree).to_radians();
                let (sin, cos) = (libm::sin(angle), libm::cos(angle));
                Point::new(center.x + radius_m * cos, center.y + radius_m * sin)
            };
            for degree in (0..360).step_by(5) {
                line(at(degree), at(degree + 5));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use emulators::world::{BodyConfig, Scene};

    use super::*;

    fn pair(dx: f64, dtheta: f64) -> PosePair {
        let truth = TruePose::new(1.0, 1.0, 3.0);
        let estimate = TruePose::new(1.0 + dx, 1.0, 3.0 + dtheta);
        PosePair {
            at: Instant::ZERO,
            truth,
            estimate,
        }
    }

    /// 30 mm and 40 mm: the mean square is 1250. Headings of 3 and 3 + pi/2 are on both sides of
    /// the wrap at pi.
    #[test]
    fn errors_are_root_mean_squares() {
        let half_turn = core::f64::consts::FRAC_PI_2;
        let error = pose_error(&[pair(0.03, 0.0), pair(0.04, half_turn)]).expect("two pairs");
        assert!((error.rms_mm - 1250_f64.sqrt()).abs() < 1e-9);
        assert!((error.max_mm - 40.0).abs() < 1e-9);
        assert!((error.max_deg - 90.0).abs() < 1e-9);
        assert!((error.rms_deg - 4050_f64.sqrt()).abs() < 1e-9);
    }

    /// A wall along x at 0.55 m, drawn 30 mm too high: three cells are more than one, and within 30
    /// mm.
    #[test]
    fn a_wall_may_be_drawn_so_far_from_where_it_is() {
        let wall = Shape::Wall {
            from: Point::new(0.0, 0.555),
            to: Point::new(1.0, 0.555),
        };
        let scene = Scene::new([wall], Vec::new()).expect("one wall");
        let start = TruePose::new(0.5, 0.2, 0.0);
        let world = World::new(scene, BodyConfig::default(), start, 1).expect("room for it");
        let mut cells = vec![127; 100 * 100];
        cells[58 * 100..59 * 100].fill(255);
        let map = MapView::new(100, 10.0, [0.0; 2], &cells);
        let share = |within_mm| wall_overlap(map, &world, &[start], within_mm).least();
        assert_eq!([None, Some(29.0)].map(share), [0.0; 2]);
        assert_eq!(share(Some(30.0)), 1.0);
    }

    #[test]
    fn no_estimate_has_no_error() {
        assert_eq!(pose_error(&[]), None);
    }

    /// Result for two profiles along x and y: values of a map 3, 2 and 1 cells before the middle,
    /// at the middle, and behind it.
    fn is_a_wall(profile: [u8; 7]) -> [bool; 2] {
        let along = |cell: fn(usize) -> [usize; 2], axis: usize| {
            let cells: Vec<u8> = (0..49).map(|at| profile[cell(at)[axis]]).collect();
            is_wall(MapView::new(7, 10.0, [0.0; 2], &cells), 3, 3)
        };
        let cell = |at| [at % 7, at / 7];
        [along(cell, 0), along(cell, 1)]
    }

    /// The neighbours may be equally dark, but cells three cells away must be lighter. Cells two
    /// cells away do not matter. Three quarters between 127 and 255 is about 190.
    #[test]
    fn a_wall_is_a_dark_ridge_along_either_axis() {
        assert_eq!(is_a_wall([199, 255, 200, 200, 200, 255, 199]), [true; 2]);
        assert_eq!(is_a_wall([199, 255, 201, 200, 200, 255, 199]), [false; 2]);
        assert_eq!(is_a_wall([199, 255, 200, 200, 201, 255, 199]), [false; 2]);
        assert_eq!(is_a_wall([200, 255, 200, 200, 200, 255, 199]), [false; 2]);
        assert_eq!(is_a_wall([199, 255, 200, 200, 200, 255, 200]), [false; 2]);
        assert_eq!(is_a_wall([0, 0, 0, 190, 0, 0, 0]), [true; 2]);
        assert_eq!(is_a_wall([0, 0, 0, 189, 0, 0, 0]), [false; 2]);
    }

    /// Outside of the map no value is known, so a wall may be on its edge.
    #[test]
    fn a_wall_may_be_the_first_row_of_a_map() {
        let rows = [200, 200, 199, 199];
        let cells: Vec<u8> = (0..32).map(|at| rows[at / 8]).collect();
        let map = MapView::new(8, 10.0, [0.0; 2], &cells);
        assert_eq!([0, 1, 2].map(|y| is_wall(map, 3, y)), [true, true, false]);
    }

    /// Four columns and three rows of 125 mm from (-1 m, 0.5 m) on: to -0.5 m and 0.875 m.
    fn few_cells() -> Cells {
        Cells::like(MapView::new(4, 125.0, [-1000.0, 500.0], &[0; 12]))
    }

    #[test]
    fn a_place_marks_the_cell_that_holds_it_if_there_is_one() {
        let marked = |x, y| {
            let mut cells = few_cells();
            cells.mark(Point::new(x, y));
            let all = cells.iter().collect::<Vec<_>>();
            all.first().copied()
        };
        assert_eq!(marked(-1.0, 0.5), Some((0, 0)));
        assert_eq!(marked(-0.8125, 0.8125), Some((1, 2)));
        assert_eq!(marked(-0.5625, 0.6875), Some((3, 1)));
        let outside = [(-1.0625, 0.5), (-0.5, 0.5), (-1.0, 0.4375), (-1.0, 0.875)];
        assert_eq!(outside.map(|(x, y)| marked(x, y)), [None; 4]);
    }

    /// Of the marked cell in column 3 and row 0, four cells are within one cell, nine within two.
    #[test]
    fn near_are_the_cells_within_so_many_along_both_axes() {
        let mut cells = few_cells();
        cells.mark(Point::new(-0.5625, 0.5625));
        let near = |reach| {
            let all = (0..3).flat_map(|y| (0..4).map(move |x| (x, y)));
            let near = all.filter(|&(x, y)| cells.is_near(x, y, reach));
            near.collect::<Vec<_>>()
        };
        assert_eq!(near(0), [(3, 0)]);
        assert_eq!(near(1), [(2, 0), (3, 0), (2, 1), (3, 1)]);
        let two = near(2);
        assert_eq!(two.len(), 9);
        assert!(two.iter().all(|&(x, _)| x >= 1), "{two:?}");
    }

    fn points(shape: &Shape, step: f64) -> Vec<[f64; 2]> {
        let mut points = Vec::new();
        outline(shape, step, |place| points.push([place.x, place.y]));
        points
    }

    /// 0.75 m in steps of at most 0.5 m are two of 0.375 m; a triangle ends where it began.
    #[test]
    fn an_outline_visits_both_ends_and_no_more_steps_than_it_needs() {
        let [from, to] = [Point::new(1.0, 2.0), Point::new(1.75, 2.0)];
        let wall = Shape::Wall { from, to };
        assert_eq!(points(&wall, 0.5), [[1.0, 2.0], [1.375, 2.0], [1.75, 2.0]]);
        let dot = Shape::Wall { from, to: from };
        assert_eq!(points(&dot, 0.5), [[1.0, 2.0]; 2]);
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]];
        let triangle = Shape::Polygon {
            corners: corners.map(|[x, y]| Point::new(x, y)).to_vec(),
        };
        let [a, b, c] = corners;
        assert_eq!(points(&triangle, 9.0), [a, b, b, c, c, a]);
    }

    /// Each piece of the circle begins at the end of the previous one, and all points are on the
    /// circle.
    #[test]
    fn the_outline_of_a_circle_is_closed() {
        let center = Point::new(1.0, 2.0);
        let circle = Shape::Circle {
            center,
            radius_m: 0.5,
        };
        let around = points(&circle, 9.0);
        assert_eq!(around.len(), 2 * 72);
        let is_on = |&[x, y]: &[f64; 2]| (libm::hypot(x - 1.0, y - 2.0) - 0.5).abs() < 1e-9;
        assert!(around.iter().all(is_on));
        assert!(around[1..143].chunks(2).all(|pair| pair[0] == pair[1]));
        for (degree, place) in [(0, [1.5, 2.0]), (90, [1.0, 2.5]), (270, [1.0, 1.5])] {
            let [x, y] = around[2 * degree / 5];
            let off = libm::hypot(x - place[0], y - place[1]);
            assert!(off < 1e-9, "at {degree} degrees {x}, {y}");
        }
    }

    /// A wall along x at 0.555 m. The map shows it, and an equally long wrong one: all walls are
    /// found, half of the map is right. Then the map shows only the left half of the true wall: all
    /// of the map is right. The lidar is in the middle, so half of the visible wall is found.
    #[test]
    fn what_is_found_and_what_is_right_are_two_shares() {
        let [from, to] = [Point::new(0.0, 0.555), Point::new(1.0, 0.555)];
        let scene = Scene::new([Shape::Wall { from, to }], Vec::new()).expect("one wall");
        let start = TruePose::new(0.5, 0.2, 0.0);
        let world = World::new(scene, BodyConfig::default(), start, 1).expect("room for it");
        let of = |rows: &[usize], columns: usize| {
            let mut cells = vec![127; 100 * 100];
            rows.iter()
                .for_each(|row| cells[row * 100..][..columns].fill(255));
            let map = MapView::new(100, 10.0, [0.0; 2], &cells);
            wall_overlap(map, &world, &[start], None)
        };
        let both = of(&[55, 80], 100);
        assert_eq!((both.found, both.right, both.least()), (1.0, 0.5, 0.5));
        let half = of(&[55], 50);
        assert_eq!(half.right, 1.0);
        assert!((0.5..0.52).contains(&half.found), "{half:?}");
        assert_eq!(of(&[], 0), WallOverlap::default());
    }

    /// A robot at the left end of a wall sees it to its right: columns 30 to 99.
    #[test]
    fn a_wall_is_seen_on_its_own_side() {
        let [from, to] = [Point::new(0.3, 0.555), Point::new(1.0, 0.555)];
        let scene = Scene::new([Shape::Wall { from, to }], Vec::new()).expect("one wall");
        let start = TruePose::new(0.3, 0.2, 0.0);
        let world = World::new(scene, BodyConfig::default(), start, 1).expect("room for it");
        let found = |columns: core::ops::Range<usize>| {
            let mut cells = vec![127; 100 * 100];
            cells[55 * 100..][columns].fill(255);
            let map = MapView::new(100, 10.0, [0.0; 2], &cells);
            wall_overlap(map, &world, &[start], None).found
        };
        assert_eq!([found(30..100), found(0..28)], [1.0, 0.0]);
    }
}
