//! Share of the reachable floor that is known in the robot's map.

use emulators::world::{Point, Pose, World};
use firmware_core::grid::UNKNOWN;
use firmware_core::map_view::MapView;

/// Edge of a cell of the floor, metres.
const CELL_M: f64 = 0.02;
/// Distance from the body within which surfaces are considered: more than rounding errors.
const BEYOND_M: f64 = 0.01;

/// Cells of the world's floor.
struct Floor {
    origin: Point,
    width: usize,
    height: usize,
}

impl Floor {
    fn of(map: MapView<'_>) -> Self {
        let [x, y] = map.origin_mm().map(|mm| f64::from(mm) / 1000.0);
        let cell_m = f64::from(map.cell_mm()) / 1000.0;
        #[expect(clippy::cast_possible_truncation, reason = "as many as the map has")]
        #[expect(clippy::cast_sign_loss, reason = "a length")]
        let cells = |count: usize| (count as f64 * cell_m / CELL_M).floor() as usize;
        Self {
            origin: Point::new(x, y),
            width: cells(map.width()),
            height: cells(map.height()),
        }
    }

    fn middle(&self, cell: usize) -> Point {
        let along = |index: usize| (index as f64 + 0.5) * CELL_M;
        let (x, y) = (along(cell % self.width), along(cell / self.width));
        Point::new(self.origin.x + x, self.origin.y + y)
    }

    /// The cell that contains `place`, if it is on the map.
    fn cell(&self, place: Point) -> Option<usize> {
        let index = |metres: f64, count: usize| {
            let cell = (metres / CELL_M).floor();
            #[expect(clippy::cast_possible_truncation, reason = "range checked")]
            #[expect(clippy::cast_sign_loss, reason = "range checked")]
            (cell >= 0.0 && cell < count as f64).then_some(cell as usize)
        };
        let column = index(place.x - self.origin.x, self.width)?;
        Some(index(place.y - self.origin.y, self.height)? * self.width + column)
    }

    /// The neighbours of `cell` to the left, right, below and above.
    fn around(&self, cell: usize) -> impl Iterator<Item = usize> {
        let (x, y, width) = (cell % self.width, cell / self.width, self.width);
        let near = [
            (x > 0).then(|| cell - 1),
            (x + 1 < width).then(|| cell + 1),
            (y > 0).then(|| cell - width),
            (y + 1 < self.height).then(|| cell + width),
        ];
        near.into_iter().flatten()
    }

    /// Whether two opposite neighbours of `cell` (beside, above and below, or diagonal) are among
    /// `those`.
    fn lies_between(&self, cell: usize, those: &[bool]) -> bool {
        let (x, y, width) = (cell % self.width, cell / self.width, self.width);
        let [has_sides, has_rows] = [x > 0 && x + 1 < width, y > 0 && y + 1 < self.height];
        let pairs = [
            (has_sides, 1),
            (has_rows, width),
            (has_sides && has_rows, width + 1),
            (has_sides && has_rows, width - 1),
        ];
        pairs
            .into_iter()
            .any(|(has, apart)| has && those[cell - apart] && those[cell + apart])
    }
}

/// Share of the known cells of `map` among those that the body covers at all poses reachable from
/// `start`. `None` if no pose on the map is reachable. Moving obstacles stay at their current
/// position. A slit of one cell between known cells counts as known: beams of a scanner are 35 mm
/// apart at 2 m, and a robot at rest leaves a fan of slits between them.
pub(crate) fn explored(map: MapView<'_>, world: &World, start: Pose) -> Option<f64> {
    let floor = Floor::of(map);
    let covered = covered(&floor, world.clone(), start);
    let all = covered.iter().filter(|covered| **covered).count();
    let known = |cell: usize| {
        let place = floor.middle(cell);
        let [x0, y0] = map.origin_mm();
        let index = |metres: f64, origin_mm: f32| {
            let cell = (metres * 1000.0 - f64::from(origin_mm)) / f64::from(map.cell_mm());
            #[expect(clippy::cast_possible_truncation, reason = "on the map")]
            #[expect(clippy::cast_sign_loss, reason = "on the map")]
            let cell = cell.max(0.0) as usize;
            cell
        };
        let value = map.get(index(place.x, x0), index(place.y, y0));
        value.is_some_and(|value| value != UNKNOWN)
    };
    let known: Vec<bool> = (0..covered.len()).map(known).collect();
    let is_seen = |cell: usize| known[cell] || floor.lies_between(cell, &known);
    let cells = covered.iter().enumerate().filter(|(_, covered)| **covered);
    let seen = cells.filter(|(cell, _)| is_seen(*cell)).count();
    (all > 0).then(|| seen as f64 / all as f64)
}

/// The cells that the body covers, as a disc.
fn covered(floor: &Floor, mut world: World, start: Pose) -> Vec<bool> {
    let radius_m = world.footprint().reach_m();
    let mut fits = |cell: usize| {
        let place = floor.middle(cell);
        world.teleport(Pose::new(place.x, place.y, start.theta));
        world.clearance_up_to(BEYOND_M) >= 0.0
    };
    let mut reached = vec![false; floor.width * floor.height];
    let mut open: Vec<usize> = floor.cell(start.point()).into_iter().collect();
    open.iter().for_each(|&cell| reached[cell] = true);
    while let Some(cell) = open.pop() {
        for near in floor.around(cell) {
            if !reached[near] && fits(near) {
                reached[near] = true;
                open.push(near);
            }
        }
    }
    let mut covered = reached.clone();
    // Only the rim of the body is needed: other positions cover its inside.
    let rim: Vec<(f64, f64)> = (0..72_u16)
        .map(|step| {
            let angle = f64::from(step * 5).to_radians();
            (libm::cos(angle) * radius_m, libm::sin(angle) * radius_m)
        })
        .collect();
    for cell in (0..reached.len()).filter(|&cell| reached[cell]) {
        let place = floor.middle(cell);
        for (dx, dy) in &rim {
            if let Some(cell) = floor.cell(Point::new(place.x + dx, place.y + dy)) {
                covered[cell] = true;
            }
        }
    }
    covered
}

#[cfg(test)]
mod tests {
    use emulators::world::{BodyConfig, Scene, Shape};

    use super::*;

    /// A room of 1 m x 1 m, and another one behind a wall: x from 0.5 to 1.5 and from 1.5 to 2.5.
    fn world() -> World {
        let wall = |from: [f64; 2], to: [f64; 2]| Shape::Wall {
            from: Point::new(from[0], from[1]),
            to: Point::new(to[0], to[1]),
        };
        let walls = vec![
            wall([0.5, 0.5], [2.5, 0.5]),
            wall([2.5, 0.5], [2.5, 1.5]),
            wall([2.5, 1.5], [0.5, 1.5]),
            wall([0.5, 1.5], [0.5, 0.5]),
            wall([1.5, 0.5], [1.5, 1.5]),
        ];
        let scene = Scene::new(walls, Vec::new()).expect("sound");
        World::new(scene, BodyConfig::default(), START, 1).expect("free")
    }

    const START: Pose = Pose {
        x: 1.0,
        y: 1.0,
        theta: 0.0,
    };

    /// A map of 300 x 300 cells of 10 mm; cells with x below `known_to` are free, others unknown.
    fn share(known_to: usize) -> Option<f64> {
        let cells: Vec<u8> = (0..300 * 300)
            .map(|cell| if cell % 300 < known_to { 0 } else { UNKNOWN })
            .collect();
        explored(MapView::new(300, 10.0, [0.0; 2], &cells), &world(), START)
    }

    /// Half of the room is left of x = 1 m; the other room does not count.
    #[test]
    fn the_floor_that_counts_is_what_the_body_can_cover() {
        assert_eq!(share(0), Some(0.0));
        assert_eq!(share(150), Some(1.0));
        let half = share(100).expect("there is floor");
        assert!((half - 0.5).abs() < 0.03, "{half}");
    }

    /// Four columns and three rows from (-1 m, 0.5 m) on.
    fn floor() -> Floor {
        Floor {
            origin: Point::new(-1.0, 0.5),
            width: 4,
            height: 3,
        }
    }

    /// Cell 6 is in column 2 of row 1: its middle is 2.5 x 20 mm and 1.5 x 20 mm from the corner.
    #[test]
    fn a_cell_holds_its_middle() {
        let middle = floor().middle(6);
        assert!((middle.x + 0.95).abs() < 1e-9, "{middle:?}");
        assert!((middle.y - 0.53).abs() < 1e-9, "{middle:?}");
        assert!((0..12).all(|cell| floor().cell(floor().middle(cell)) == Some(cell)));
        let outside = [(-1.01, 0.53), (-0.91, 0.53), (-0.95, 0.49), (-0.95, 0.57)];
        let cell = |(x, y)| floor().cell(Point::new(x, y));
        assert_eq!(outside.map(cell), [None; 4]);
    }

    #[test]
    fn a_cell_has_neighbours_on_the_floor_alone() {
        let around = |cell| floor().around(cell).collect::<Vec<_>>();
        assert_eq!(around(0), [1, 4]);
        assert_eq!(around(3), [2, 7]);
        assert_eq!(around(5), [4, 6, 1, 9]);
        assert_eq!(around(8), [9, 4]);
        assert_eq!(around(11), [10, 7]);
    }

    /// Twelve cells, some of them known. A cell between two known ones in a row, a column or a
    /// diagonal counts. At the rim no cell does, and the end of a row is not beside the start of
    /// the next one.
    #[test]
    fn a_slit_lies_between_what_is_known() {
        let between = |known: [usize; 2]| {
            let mut those = [false; 12];
            known.iter().for_each(|cell| those[*cell] = true);
            (0..12)
                .filter(|cell| floor().lies_between(*cell, &those))
                .collect::<Vec<_>>()
        };
        assert_eq!([between([4, 6]), between([1, 9])], [[5], [5]]);
        assert_eq!([between([0, 10]), between([2, 8])], [[5], [5]]);
        assert_eq!([between([1, 11]), between([3, 9])], [[6], [6]]);
        for known in [[3, 5], [2, 4], [7, 9], [0, 1], [4, 7], [0, 8]] {
            let wanted: &[usize] = if known == [0, 8] { &[4] } else { &[] };
            assert_eq!(between(known), wanted, "{known:?}");
        }
    }

    /// All cells are known except slits of 20 mm every 60 mm, or of 40 mm.
    #[test]
    fn slits_count_with_their_sides_and_gaps_do_not() {
        let share = |gap: usize| {
            let is_known = |x: usize| x % 6 >= gap;
            let value = |cell: usize| if is_known(cell % 300) { 0 } else { UNKNOWN };
            let cells: Vec<u8> = (0..300 * 300).map(value).collect();
            explored(MapView::new(300, 10.0, [0.0; 2], &cells), &world(), START)
        };
        assert_eq!(share(2), Some(1.0));
        let gaps = share(4).expect("there is floor");
        assert!((gaps - 1.0 / 3.0).abs() < 0.03, "{gaps}");
    }

    /// 3 x 2 cells of 50 mm: 150 mm and 100 mm, of 20 mm each.
    #[test]
    fn the_floor_is_as_large_as_the_map() {
        let floor = Floor::of(MapView::new(3, 50.0, [-1000.0, 500.0], &[0; 6]));
        assert_eq!((floor.width, floor.height), (7, 5));
        assert_eq!((floor.origin.x, floor.origin.y), (-1.0, 0.5));
    }

    /// A map of 25 mm cells from (-0.25 m, 0.25 m) on, known up to a coordinate of the world: the
    /// same halves, along x and along y.
    #[test]
    fn the_map_may_begin_anywhere() {
        let share = |is_known: fn(f64, f64) -> bool| {
            let middle = |cell: usize| cell as f64 * 0.025 + 0.0125;
            let value = |cell: usize| {
                let (x, y) = (middle(cell % 80) - 0.25, middle(cell / 80) + 0.25);
                if is_known(x, y) { 255 } else { UNKNOWN }
            };
            let cells: Vec<u8> = (0..80 * 60).map(value).collect();
            let map = MapView::new(80, 25.0, [-250.0, 250.0], &cells);
            explored(map, &world(), START).expect("there is floor")
        };
        for half in [share(|x, _| x < 1.0), share(|_, y| y > 1.0)] {
            assert!((half - 0.5).abs() < 0.03, "{half}");
        }
        let quarter = share(|x, y| x > 1.0 && y < 1.0);
        assert!((quarter - 0.25).abs() < 0.03, "{quarter}");
    }

    #[test]
    fn who_stands_beside_the_map_gets_nowhere_on_it() {
        let map = MapView::new(10, 10.0, [5000.0; 2], &[0; 100]);
        assert_eq!(explored(map, &world(), START), None);
    }

    /// A disc of 160 mm in a room of 1 m: its middle reaches 340 mm around the middle of the room.
    /// It covers the room but for the corners, of which (4 - pi) x 0.16 x 0.16 m are left.
    #[test]
    fn a_disc_covers_a_room_but_for_its_corners() {
        let cells = vec![0; 300 * 300];
        let floor = Floor::of(MapView::new(300, 10.0, [0.0; 2], &cells));
        assert_eq!((floor.width, floor.height), (150, 150));
        let covered = covered(&floor, world(), START);
        let at = |x: f64, y: f64| {
            let cell = floor.cell(Point::new(x, y)).expect("on the map");
            covered[cell]
        };
        for (x, y) in [
            (0.53, 1.0),
            (1.47, 1.0),
            (1.0, 0.53),
            (1.0, 1.47),
            (1.0, 1.0),
            (0.57, 0.57),
        ] {
            assert!(at(x, y), "{x} {y}");
        }
        for (x, y) in [(0.53, 0.53), (1.47, 0.53), (0.53, 1.47), (1.47, 1.47)] {
            assert!(!at(x, y), "{x} {y}");
        }
        for (x, y) in [
            (0.47, 1.0),
            (1.53, 1.0),
            (1.0, 0.47),
            (1.0, 1.53),
            (2.0, 1.0),
            (0.1, 0.1),
        ] {
            assert!(!at(x, y), "{x} {y}");
        }
        let all = covered.iter().filter(|covered| **covered).count();
        // 2,500 cells are in the room; 55 of them are left out.
        assert!((2_350..2_500).contains(&all), "{all}");
    }
}
