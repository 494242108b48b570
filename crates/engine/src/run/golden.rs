//! Comparison of a run with the path and the map of an earlier one.

use std::collections::BTreeMap;

use emulators::world::Point;
use firmware_core::map_view::MapView;

use super::check::Check;
use super::score::is_wall;
use crate::scenario::Walls;

/// Samples of a path per tolerance.
const SAMPLES: f64 = 10.0;

/// The check of a path: every point of each path lies within `within_mm` of the other path.
pub(super) fn path_check(golden: &[Point], path: &[Point], within_mm: f64) -> Check {
    let within = within_mm / 1000.0;
    let far = |from: &[Point], to: &[Point]| {
        let near = Near::of(to, within);
        from.iter().copied().find(|point| !near.has(*point))
    };
    let distance_mm = |point: Point, to: &[Point]| {
        let all = sampled(to, within / SAMPLES).map(|other| other.distance(point) * 1000.0);
        all.fold(f64::INFINITY, f64::min)
    };
    let words = |point: Point, whose: &str, to: &[Point], other: &str| {
        let mm = distance_mm(point, to);
        let Point { x, y } = point;
        format!(
            "{whose} leads through {x:.3}, {y:.3} m, {mm:.0} mm from {other}, at most {within_mm}"
        )
    };
    let detail = match (far(path, golden), far(golden, path)) {
        (Some(point), _) => Err(words(point, "the robot's path", golden, "the golden path")),
        (None, Some(point)) => Err(words(point, "the golden path", path, "the robot's path")),
        (None, None) => Ok(format!(
            "this path and the golden path are within {within_mm} mm of each other"
        )),
    };
    let is_kept = detail.is_ok();
    let detail = detail.unwrap_or_else(|words| words);
    Check::new("golden-path", is_kept, detail).if_observed(path.len() > 1)
}

/// Points in squares as wide as a tolerance.
struct Near {
    within: f64,
    squares: BTreeMap<(i64, i64), Vec<Point>>,
}

impl Near {
    fn of(path: &[Point], within: f64) -> Self {
        let mut squares: BTreeMap<(i64, i64), Vec<Point>> = BTreeMap::new();
        for point in sampled(path, within / SAMPLES) {
            squares
                .entry(square(point, within))
                .or_default()
                .push(point);
        }
        Self { within, squares }
    }

    fn has(&self, point: Point) -> bool {
        let (x, y) = square(point, self.within);
        let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (x + dx, y + dy)));
        let mut points = around.filter_map(|key| self.squares.get(&key)).flatten();
        points.any(|other| other.distance(point) <= self.within)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "saturates far outside")]
fn square(point: Point, width: f64) -> (i64, i64) {
    (
        (point.x / width).floor() as i64,
        (point.y / width).floor() as i64,
    )
}

/// The corners of a path, and points between them no farther apart than `step` metres.
fn sampled(path: &[Point], step: f64) -> impl Iterator<Item = Point> + '_ {
    let legs = path.windows(2).flat_map(move |leg| {
        let (from, to) = (leg[0], leg[1]);
        #[expect(clippy::cast_possible_truncation, reason = "limited")]
        #[expect(clippy::cast_sign_loss, reason = "a distance")]
        let parts = (from.distance(to) / step).ceil().clamp(1.0, 1e6) as u32;
        (0..parts).map(move |part| {
            let share = f64::from(part) / f64::from(parts);
            Point::new(
                from.x + share * (to.x - from.x),
                from.y + share * (to.y - from.y),
            )
        })
    });
    legs.chain(path.last().copied())
}

/// The check of a map: the share of each map's walls that have a wall of the other map within
/// `within` cells.
pub(super) fn map_check(
    golden: &Walls,
    map: Option<MapView<'_>>,
    within: usize,
    least: f64,
) -> Check {
    let name = "golden-map";
    let Some(map) = map else {
        return Check::new(name, false, "the robot has no map to the end");
    };
    let cells = (0..map.height()).flat_map(|y| (0..map.width()).map(move |x| (x, y)));
    let ours = Walls {
        width: map.width(),
        cells: cells.map(|(x, y)| is_wall(map, x, y)).collect(),
    };
    let size = |walls: &Walls| [walls.width, walls.cells.len() / walls.width.max(1)];
    let [is, was] = [size(&ours), size(golden)];
    if is != was {
        let detail = format!("has {is:?} cells, expected the golden map's {was:?}");
        return Check::new(name, false, detail);
    }
    let (kept, right) = (share(golden, &ours, within), share(&ours, golden, within));
    let detail = format!(
        "{kept:.3} of the golden walls found, {right:.3} of the found ones golden, within {within} \
         cells; at least {least}"
    );
    Check::new(name, kept.min(right) >= least, detail)
}

/// Share of the walls of `of` that have a wall of `other` within `within` cells; 0 without walls.
fn share(of: &Walls, other: &Walls, within: usize) -> f64 {
    let height = other.cells.len() / other.width.max(1);
    let walls = of.cells.iter().enumerate().filter(|(_, is)| **is);
    let (mut all, mut found) = (0.0_f64, 0.0);
    for (index, _) in walls {
        let (x, y) = (index % of.width, index / of.width);
        let xs = x.saturating_sub(within)..=(x + within).min(other.width - 1);
        let mut rows = y.saturating_sub(within)..=(y + within).min(height - 1);
        let is_found = rows.any(|y| other.cells[y * other.width..][xs.clone()].contains(&true));
        all += 1.0;
        found += f64::from(u8::from(is_found));
    }
    found / all.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::super::check::Status;
    use super::*;

    fn path(points: &[[f64; 2]]) -> Vec<Point> {
        points.iter().map(|&[x, y]| Point::new(x, y)).collect()
    }

    /// A path along x; 100 mm beside it, beyond it, and short of its end.
    #[test]
    fn paths_are_compared_both_ways() {
        let golden = path(&[[0.0, 0.0], [2.0, 0.0]]);
        let rows = [
            (
                path(&[[0.0, 0.09], [1.0, -0.09], [2.0, 0.0]]),
                true,
                "within 100 mm",
            ),
            (
                path(&[[0.0, 0.0], [1.0, 0.15], [2.0, 0.0]]),
                false,
                "through 1.000, 0.150 m, 150 mm from the golden",
            ),
            (
                path(&[[0.0, 0.0], [2.2, 0.0]]),
                false,
                "through 2.200, 0.000 m, 200 mm from the golden",
            ),
            (
                path(&[[0.0, 0.0], [1.5, 0.0]]),
                false,
                "the golden path leads through 2.000, 0.000 m, 500 mm",
            ),
        ];
        for (driven, passes, says) in rows {
            let check = path_check(&golden, &driven, 100.0);
            assert_eq!(check.status, Status::of(passes), "{check}");
            assert!(check.detail.contains(says), "{check}");
        }
        assert_eq!(
            path_check(&golden, &golden[..1], 9e3).status,
            Status::NotObserved
        );
    }

    /// A wall of four cells, moved by one cell and by two, and doubled.
    #[test]
    fn walls_are_compared_both_ways() {
        let walls = |rows: [&str; 4]| Walls {
            width: 6,
            cells: rows.concat().chars().map(|c| c == '#').collect(),
        };
        let golden = walls(["......", ".####.", "......", "......"]);
        let rows = [
            (
                walls(["......", ".####.", "......", "......"]),
                0,
                [1.0, 1.0],
            ),
            (
                walls(["......", "......", ".####.", "......"]),
                0,
                [0.0, 0.0],
            ),
            (
                walls(["......", "......", ".####.", "......"]),
                1,
                [1.0, 1.0],
            ),
            (
                walls(["......", "......", "......", ".####."]),
                1,
                [0.0, 0.0],
            ),
            (
                walls(["......", ".##...", "......", "......"]),
                0,
                [0.5, 1.0],
            ),
            (
                walls(["......", ".####.", "......", ".####."]),
                1,
                [1.0, 0.5],
            ),
        ];
        for (ours, within, shares) in rows {
            let found = [share(&golden, &ours, within), share(&ours, &golden, within)];
            assert_eq!(found, shares, "{ours:?} within {within}");
        }
    }

    /// A leg of a metre in steps of at most 0.3 m has four parts; a point is one.
    #[test]
    fn a_path_is_sampled_in_equal_parts() {
        let of = |points: &[[f64; 2]], step: f64| -> Vec<[f64; 2]> {
            sampled(&path(points), step)
                .map(|point| [point.x, point.y])
                .collect()
        };
        let parts = [
            [1.0, 5.0],
            [1.25, 4.75],
            [1.5, 4.5],
            [1.75, 4.25],
            [2.0, 4.0],
        ];
        assert_eq!(of(&[[1.0, 5.0], [2.0, 4.0]], 0.4), parts);
        assert_eq!(
            of(&[[0.0, 0.0], [0.0, 1.0]], 0.5),
            [[0.0, 0.0], [0.0, 0.5], [0.0, 1.0]]
        );
        assert_eq!(of(&[[3.0, 3.0], [3.0, 3.0]], 0.5), [[3.0, 3.0]; 2]);
        assert_eq!(of(&[[3.0, 3.0]], 0.5), [[3.0, 3.0]]);
        assert_eq!(of(&[], 0.5), [[0.0; 2]; 0]);
    }

    /// A square holds the places from its lower corner on. The neighbours of a square are searched
    /// in all directions, up to the tolerance itself.
    #[test]
    fn a_place_is_near_within_the_tolerance() {
        let at = |x, y| Point::new(x, y);
        assert_eq!(square(at(1.0, -0.25), 0.5), (2, -1));
        assert_eq!(square(at(0.49, 0.5), 0.5), (0, 1));
        let near = Near::of(&path(&[[1.25, 1.25]]), 0.5);
        for (dx, dy) in [
            (1.0, 0.0),
            (-1.0, 0.0),
            (0.0, 1.0),
            (0.0, -1.0),
            (0.6, 0.8),
            (-0.6, -0.8),
        ] {
            let has = |far: f64| near.has(at(1.25 + dx * far, 1.25 + dy * far));
            assert_eq!([has(0.49), has(0.51)], [true, false], "{dx} {dy}");
        }
        assert!(near.has(at(1.75, 1.25)));
    }

    /// A map without walls or of another size, and one that has half of the golden walls.
    #[test]
    fn a_map_is_compared_with_the_golden_one() {
        let walls = |rows: &[&str]| Walls {
            width: 8,
            cells: rows.concat().chars().map(|c| c == '#').collect(),
        };
        let empty = "........";
        let golden = walls(&[empty, empty, empty, "########", empty, empty, empty]);
        let mut cells = vec![127; 8 * 7];
        cells[3 * 8..3 * 8 + 4].fill(255);
        let judged = |golden: &Walls, cells: &[u8], least: f64| {
            let map = (!cells.is_empty()).then(|| MapView::new(8, 10.0, [0.0; 2], cells));
            let check = map_check(golden, map, 0, least);
            (check.status, check.detail)
        };
        let words = "0.500 of the golden walls found, 1.000 of the found ones golden, within 0 \
                     cells; at least 0.5";
        assert_eq!(
            judged(&golden, &cells, 0.5),
            (Status::Pass, words.to_owned())
        );
        assert_eq!(judged(&golden, &cells, 0.51).0, Status::Fail);
        let none = "the robot has no map to the end".to_owned();
        assert_eq!(judged(&golden, &[], 0.0), (Status::Fail, none));
        let size = "has [8, 6] cells, expected the golden map's [8, 7]".to_owned();
        assert_eq!(judged(&golden, &cells[..48], 0.0), (Status::Fail, size));
        let blank = walls(&[empty; 7]);
        assert!(
            judged(&blank, &cells, 0.0)
                .1
                .starts_with("0.000 of the golden walls found, 0.000")
        );
    }

    /// Walls in the corners: nothing beyond the rim is searched, and neighbours are within one
    /// column and one row.
    #[test]
    fn walls_at_the_rim_have_neighbours_on_the_map() {
        let corners = |cells: [usize; 2]| Walls {
            width: 3,
            cells: (0..12).map(|cell| cells.contains(&cell)).collect(),
        };
        // Four rows of three cells: 0 and 11 are corners, 4 and 7 their diagonal neighbours.
        assert_eq!(share(&corners([0, 11]), &corners([4, 7]), 1), 1.0);
        assert_eq!(share(&corners([0, 11]), &corners([2, 9]), 1), 0.0);
        assert_eq!(share(&corners([0, 11]), &corners([2, 9]), 2), 1.0);
        assert_eq!(share(&corners([0, 11]), &corners([6, 6]), 1), 0.0);
        assert_eq!(share(&corners([0, 11]), &corners([6, 6]), 2), 1.0);
        assert_eq!(share(&corners([0, 11]), &corners([3, 3]), 1), 0.5);
    }

    /// A path is near between its corners as well: 490 mm beside it, a quarter of a metre behind a
    /// corner. A point 600 mm beside it is printed with this distance.
    #[test]
    fn a_path_is_near_between_its_corners() {
        let golden = path(&[[0.0, 0.0], [1.0, 0.0]]);
        assert!(Near::of(&golden, 0.5).has(Point::new(0.25, 0.49)));
        let driven = path(&[[0.25, 0.6], [0.26, 0.6]]);
        let check = path_check(&golden, &driven, 500.0);
        assert!(
            check
                .detail
                .contains("0.250, 0.600 m, 600 mm from the golden path"),
            "{check}"
        );
    }
}
