//! The comparison of two maps. Every map has its own origin, so the second map is first aligned
//! with the first: a coarse search over all shifts and rotations within reach, then finer and finer
//! steps.

use emulators::world::Pose;

use super::distance::Distances;
use super::{CellState, RosMap};
use engine::picture::Picture;

/// The range of the alignment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Maximum shift to each side, metres; 0 compares the maps without alignment.
    pub shift_m: f64,
    /// Maximum rotation to each side, radians.
    pub turn: f64,
}

/// The result of the comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// The motion, about the centre of its walls, that aligns the second map with the first.
    pub shift: Pose,
    /// Centre of the second map's walls.
    pub about: [f64; 2],
    /// Mean distance between the walls that both maps contain, in both directions, mm.
    pub wall_error_mm: f64,
    /// 95th percentile of the distances between these walls, mm.
    pub wall_error_95_mm: f64,
    /// Share of the first map's wall cells with a wall of the second map nearby.
    pub first_in_second: f64,
    /// Share of the second map's wall cells with a wall of the first map nearby.
    pub second_in_first: f64,
    /// Share of equal cells among all cells that both maps know; walls count as equal within a
    /// cell.
    pub alike: f64,
}

impl Difference {
    /// The smaller one of the two wall overlaps.
    pub const fn overlap(&self) -> f64 {
        self.first_in_second.min(self.second_in_first)
    }

    /// Transforms a position from the first map's frame to the second map's.
    fn back(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.shift.theta);
        let (dx, dy) = (
            x - self.about[0] - self.shift.x,
            y - self.about[1] - self.shift.y,
        );
        [
            self.about[0] + cos * dx + sin * dy,
            self.about[1] + cos * dy - sin * dx,
        ]
    }
}

/// Maximum distance between two images of the same wall, metres.
const SAME_WALL_M: f64 = 0.1;
/// Maximum distance that the alignment counts, metres.
const CAP_M: f64 = 0.25;
/// Number of wall cells for the coarse and the fine alignment.
const COARSE: usize = 300;
const FINE: usize = 3000;

/// Compares two maps; `None` if either has no wall.
pub fn diff(first: &RosMap, second: &RosMap, reach: Reach) -> Option<Difference> {
    let walls: Vec<[f64; 2]> = second.all(CellState::Wall).collect();
    let ours: Vec<[f64; 2]> = first.all(CellState::Wall).collect();
    if walls.is_empty() || ours.is_empty() {
        return None;
    }
    let count = walls.len() as f64;
    let about = [0, 1].map(|axis| walls.iter().map(|wall| wall[axis]).sum::<f64>() / count);
    let near_first = Distances::new(first);
    let near_second = Distances::new(second);
    let shift = if reach.shift_m > 0.0 || reach.turn > 0.0 {
        align(&near_first, &walls, about, reach)
    } else {
        Pose::default()
    };
    let mut difference = Difference {
        shift,
        about,
        wall_error_mm: 0.0,
        wall_error_95_mm: 0.0,
        first_in_second: 0.0,
        second_in_first: 0.0,
        alike: 0.0,
    };
    let laid: Vec<f64> = walls
        .iter()
        .map(|wall| near_first.at(moved(*wall, about, shift), CAP_M))
        .collect();
    let other: Vec<f64> = ours
        .iter()
        .map(|wall| near_second.at(difference.back(*wall), CAP_M))
        .collect();
    let part = |distances: &[f64]| {
        let near = distances.iter().filter(|metres| **metres < SAME_WALL_M);
        near.count() as f64 / distances.len() as f64
    };
    (difference.second_in_first, difference.first_in_second) = (part(&laid), part(&other));
    let mut same: Vec<f64> = laid
        .iter()
        .chain(&other)
        .copied()
        .filter(|metres| *metres < SAME_WALL_M)
        .collect();
    same.sort_by(f64::total_cmp);
    if !same.is_empty() {
        difference.wall_error_mm = same.iter().sum::<f64>() / same.len() as f64 * 1000.0;
        difference.wall_error_95_mm = same[(same.len() * 95 / 100).min(same.len() - 1)] * 1000.0;
    }
    difference.alike = alike(first, second, &difference, &near_first);
    Some(difference)
}

fn moved([x, y]: [f64; 2], about: [f64; 2], shift: Pose) -> [f64; 2] {
    let (sin, cos) = libm::sincos(shift.theta);
    let (dx, dy) = (x - about[0], y - about[1]);
    [
        about[0] + shift.x + cos * dx - sin * dy,
        about[1] + shift.y + sin * dx + cos * dy,
    ]
}

/// At most `most` of `walls`, evenly selected.
fn thinned(walls: &[[f64; 2]], most: usize) -> Vec<[f64; 2]> {
    let step = walls.len().div_ceil(most).max(1);
    walls.iter().copied().step_by(step).collect()
}

fn align(near: &Distances, walls: &[[f64; 2]], about: [f64; 2], reach: Reach) -> Pose {
    const STEPS: i32 = 12;
    let cost = |walls: &[[f64; 2]], shift: Pose| -> f64 {
        walls
            .iter()
            .map(|wall| near.at(moved(*wall, about, shift), CAP_M))
            .sum()
    };
    let coarse = thinned(walls, COARSE);
    let (step_m, step_turn) = (
        reach.shift_m / f64::from(STEPS),
        reach.turn / f64::from(STEPS),
    );
    let mut best = (Pose::default(), cost(&coarse, Pose::default()));
    for turn in -STEPS..=STEPS {
        for row in -STEPS..=STEPS {
            for column in -STEPS..=STEPS {
                let [x, y, theta] = [column, row, turn].map(f64::from);
                let shift = Pose::new(x * step_m, y * step_m, theta * step_turn);
                let sum = cost(&coarse, shift);
                if sum < best.1 {
                    best = (shift, sum);
                }
            }
        }
    }
    let fine = thinned(walls, FINE);
    let mut best = (best.0, cost(&fine, best.0));
    let (mut step_m, mut step_turn) = (step_m, step_turn);
    for _ in 0..200 {
        if step_m < 1e-4 && step_turn < 1e-5 {
            break;
        }
        let before = best.1;
        for (x, y, theta) in [
            (step_m, 0.0, 0.0),
            (-step_m, 0.0, 0.0),
            (0.0, step_m, 0.0),
            (0.0, -step_m, 0.0),
            (0.0, 0.0, step_turn),
            (0.0, 0.0, -step_turn),
        ] {
            let shift = Pose::new(best.0.x + x, best.0.y + y, best.0.theta + theta);
            let sum = cost(&fine, shift);
            if sum < best.1 {
                best = (shift, sum);
            }
        }
        if best.1 >= before {
            (step_m, step_turn) = (step_m / 2.0, step_turn / 2.0);
        }
    }
    best.0
}

fn alike(first: &RosMap, second: &RosMap, difference: &Difference, near_first: &Distances) -> f64 {
    let (mut both, mut same) = (0_u64, 0_u64);
    for what in [CellState::Free, CellState::Wall] {
        for place in first.all(what) {
            let other = second.at(difference.back(place));
            if other == CellState::Unknown {
                continue;
            }
            both += 1;
            let is_near = near_first.at(place, CAP_M) <= 1.5 * first.cell_m;
            same += u64::from(other == what || is_near);
        }
    }
    same as f64 / both.max(1) as f64
}

/// The second map overlaid on the first: walls of both dark, of the first only blue, of the second
/// only red; cells that both know as free are white.
pub fn picture(first: &RosMap, second: &RosMap, difference: &Difference) -> Picture {
    let (near_first, near_second) = (Distances::new(first), Distances::new(second));
    let near_m = 1.5 * first.cell_m.max(second.cell_m);
    Picture::from_fn(first.width, first.height, |x, y| {
        let y = first.height - 1 - y;
        let place = [
            first.origin[0] + (x as f64 + 0.5) * first.cell_m,
            first.origin[1] + (y as f64 + 0.5) * first.cell_m,
        ];
        let back = difference.back(place);
        match (first.at(place), second.at(back)) {
            (CellState::Wall, CellState::Wall) => [30, 30, 30],
            (CellState::Wall, _) if near_second.at(back, 1.0) <= near_m => [30, 30, 30],
            (CellState::Wall, _) => [40, 80, 220],
            (_, CellState::Wall) if near_first.at(place, 1.0) <= near_m => [120, 120, 120],
            (_, CellState::Wall) => [220, 40, 30],
            (CellState::Free, CellState::Free) => [255, 255, 255],
            (CellState::Unknown, CellState::Unknown) => [190, 190, 190],
            _ => [230, 230, 225],
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELL_M: f64 = 0.02;

    /// A room of 2 m x 1.4 m with a stub of wall, turned and shifted; 3 m x 3 m of cells.
    fn room(shift: Pose) -> RosMap {
        let inside = |x: f64, y: f64| (0.5..2.5).contains(&x) && (0.8..2.2).contains(&y);
        let is_wall = |x: f64, y: f64| {
            let edge = inside(x, y)
                && !(inside(x - 0.03, y)
                    && inside(x + 0.03, y)
                    && inside(x, y - 0.03)
                    && inside(x, y + 0.03));
            edge || ((1.0..1.03).contains(&x) && (0.8..1.5).contains(&y))
        };
        let (sin, cos) = libm::sincos(shift.theta);
        let cells = (0..150 * 150).map(|index| {
            let (x, y) = (f64::from(index % 150) + 0.5, f64::from(index / 150) + 0.5);
            let (dx, dy) = (x * CELL_M - 1.5 - shift.x, y * CELL_M - 1.5 - shift.y);
            let (x, y) = (1.5 + cos * dx + sin * dy, 1.5 + cos * dy - sin * dx);
            if is_wall(x, y) {
                CellState::Wall
            } else if inside(x, y) {
                CellState::Free
            } else {
                CellState::Unknown
            }
        });
        RosMap::new(150, CELL_M, [0.0; 2], cells.collect())
    }

    const REACH: Reach = Reach {
        shift_m: 0.5,
        turn: 0.2,
    };

    #[test]
    fn a_map_is_no_different_from_itself() {
        let map = room(Pose::default());
        let same = diff(&map, &map, REACH).expect("walls");
        assert!(same.wall_error_mm < 0.5 && same.overlap() == 1.0 && same.alike == 1.0);
    }

    /// The alignment reverses the shift to a quarter of a cell and 0.2 degrees; cells of 20 mm on a
    /// rotated wall are up to half a cell off.
    #[test]
    fn a_moved_map_is_laid_back() {
        let shift = Pose::new(0.13, -0.21, 0.1);
        let found = diff(&room(Pose::default()), &room(shift), REACH).expect("walls");
        assert!((found.shift.theta + 0.1).abs() < 0.0035, "{found:?}");
        assert!(
            found.wall_error_mm < 6.0 && found.overlap() > 0.99,
            "{found:?}"
        );
        let apart = Reach {
            shift_m: 0.0,
            turn: 0.0,
        };
        let as_they_lie = diff(&room(Pose::default()), &room(shift), apart).expect("walls");
        assert!(as_they_lie.overlap() < 0.6, "{as_they_lie:?}");
    }

    /// Without its stub of 0.7 m of about 7.5 m of walls, the second map lacks a tenth of the
    /// first.
    #[test]
    fn a_missing_wall_is_seen_from_the_map_that_has_it() {
        let whole = room(Pose::default());
        let cells = (0..150 * 150).map(|index| {
            let (x, y) = (index % 150, index / 150);
            let is_stub = (49..53).contains(&x) && (42..76).contains(&y);
            let seen = whole.cell(x, y).expect("on the map");
            if is_stub { CellState::Free } else { seen }
        });
        let lacking = RosMap::new(150, CELL_M, [0.0; 2], cells.collect());
        let found = diff(&whole, &lacking, REACH).expect("walls");
        assert!(found.second_in_first > 0.999, "{found:?}");
        assert!((0.85..0.95).contains(&found.first_in_second), "{found:?}");
        let empty = RosMap::new(10, CELL_M, [0.0; 2], vec![CellState::Free; 100]);
        assert_eq!(diff(&whole, &empty, REACH), None);
    }
}
