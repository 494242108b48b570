//! Open edges of the checked area, and the choice of the next one.

use alloc::collections::VecDeque;
use alloc::vec::Vec;

use super::{CELL_M, Survey};
use crate::ackermann::{CarPose, wrapped};
use crate::costmap::{Costmap, INSCRIBED};

/// Minimum number of connected cells of an open edge: with the car's clearance from walls that is
/// an opening of 0.9 m.
const CELLS_MIN: usize = 12;
/// Extra cost of an edge behind the car, metres: turning round takes a car several moves, if there
/// is room at all.
const BEHIND_M: f64 = 12.0;
/// Distance below which an edge is one of the picture's sides, and its extra cost, metres: the car
/// would have to turn towards it on the spot.
const NEAR_M: f64 = 1.5;
const BESIDE_M: f64 = 8.0;
/// Distance before an edge at which the car stops, metres: from there it sees the area behind.
const BEFORE_M: f64 = 0.6;
/// Number of path cells that give the direction of the look at the edge.
const HEADING_CELLS: usize = 12;
/// Edges nearer to each other than this are the same, metres.
const SAME_M: f64 = 0.6;
/// Maximum number of drives to an edge.
const TRIES_MAX: u8 = 3;

/// Whether two positions belong to the same edge.
pub(super) fn are_same(one: [f64; 2], other: [f64; 2]) -> bool {
    libm::hypot(one[0] - other[0], one[1] - other[1]) < SAME_M
}

/// Edges that the car drove to, with the number of drives.
#[derive(Clone, Debug, Default)]
pub(super) struct Tried(Vec<([f64; 2], u8)>);

impl Tried {
    fn near(&self, place: [f64; 2]) -> Option<usize> {
        self.0.iter().position(|(at, _)| are_same(*at, place))
    }

    fn is_given_up(&self, place: [f64; 2]) -> bool {
        self.near(place).is_some_and(|at| self.0[at].1 >= TRIES_MAX)
    }

    /// Edges that the car has given up.
    pub(super) fn given_up(&self) -> impl Iterator<Item = [f64; 2]> {
        let given_up = self.0.iter().filter(|(_, tries)| *tries >= TRIES_MAX);
        given_up.map(|(at, _)| *at)
    }

    /// Counts a drive to the edge at this position; returns whether it is the first.
    pub(super) fn add(&mut self, place: [f64; 2]) -> bool {
        let near = self.near(place);
        match near {
            Some(at) => self.0[at].1 += 1,
            None => self.0.push((place, 1)),
        }
        near.is_none()
    }
}

/// Cells that the car can reach through the checked area: each with its predecessor on the path,
/// the start with itself.
struct Reach {
    width: usize,
    before: Vec<Option<usize>>,
    steps: Vec<u32>,
    order: Vec<usize>,
}

/// The next goal, and the position of the edge visible from there.
///
/// # Errors
/// If there is none: the positions of edges before which the car has no room to stand.
pub(super) fn next(
    survey: &Survey,
    costs: &Costmap,
    pose: CarPose,
    is_free: impl Fn(CarPose) -> bool,
) -> Result<(CarPose, [f64; 2]), Vec<[f64; 2]>> {
    let reach = Reach::new(survey, costs, pose).ok_or_else(Vec::new)?;
    let mut barred = Vec::new();
    let mut best: Option<(f64, CarPose, [f64; 2])> = None;
    for edge in reach.edges(survey, costs) {
        let middle = middle(&edge, costs.width());
        let place = costs.middle_m(cell(middle, costs.width()));
        if survey.tried.is_given_up(place) {
            continue;
        }
        let Some(goal) = reach.goal(costs, middle, &is_free) else {
            barred.push(place);
            continue;
        };
        let bearing = libm::atan2(place[1] - pose.y_m, place[0] - pose.x_m);
        let aside = (1.0 - libm::cos(wrapped(bearing - pose.heading_rad))) / 2.0;
        let way_m = f64::from(reach.steps[middle]) * CELL_M;
        let beside = if way_m < NEAR_M { BESIDE_M } else { 0.0 };
        let score = way_m + BEHIND_M * aside + beside;
        if best.is_none_or(|(least, ..)| score < least) {
            best = Some((score, goal, place));
        }
    }
    best.map(|(_, goal, place)| (goal, place)).ok_or(barred)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "a plan has some hundred cells along each side"
)]
const fn cell(index: usize, width: usize) -> [i32; 2] {
    [(index % width) as i32, (index / width) as i32]
}

/// The cell of an edge nearest to its middle.
fn middle(edge: &[usize], width: usize) -> usize {
    let along = |index: &usize| cell(*index, width).map(f64::from);
    let sum = edge
        .iter()
        .map(along)
        .fold([0.0; 2], |sum, at| [sum[0] + at[0], sum[1] + at[1]]);
    let mean = sum.map(|sum| sum / edge.len() as f64);
    let off = |index: &usize| {
        let at = along(index);
        libm::hypot(at[0] - mean[0], at[1] - mean[1])
    };
    let nearest = edge
        .iter()
        .min_by(|one, other| off(one).total_cmp(&off(other)));
    nearest.copied().unwrap_or_default()
}

impl Reach {
    fn new(survey: &Survey, costs: &Costmap, pose: CarPose) -> Option<Self> {
        let width = costs.width();
        let start = costs.cell([pose.x_m, pose.y_m])?;
        let inside = |[x, y]: [i32; 2]| {
            let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
            (x < width && y < costs.height()).then_some(y * width + x)
        };
        let first = inside(start)?;
        let mut reach = Self {
            width,
            before: alloc::vec![None; costs.costs().len()],
            steps: alloc::vec![0; costs.costs().len()],
            order: Vec::new(),
        };
        reach.before[first] = Some(first);
        let mut next = VecDeque::from([first]);
        while let Some(at) = next.pop_front() {
            reach.order.push(at);
            let from = cell(at, width);
            for [dx, dy] in AROUND {
                let to = [from[0] + dx, from[1] + dy];
                let Some(index) = inside(to).filter(|index| reach.before[*index].is_none()) else {
                    continue;
                };
                // The floor under the car is unseen, but open, up to where the camera begins to
                // see.
                let here = costs.middle_m(to);
                let off = libm::hypot(here[0] - pose.x_m, here[1] - pose.y_m);
                let is_open = survey.is_free(here) || off < STANDS_M;
                if is_open && costs.cost(to) < INSCRIBED {
                    reach.before[index] = Some(at);
                    reach.steps[index] = reach.steps[at] + 1;
                    next.push_back(index);
                }
            }
        }
        Some(reach)
    }

    /// Groups of connected cells with an unknown neighbour.
    fn edges(&self, survey: &Survey, costs: &Costmap) -> Vec<Vec<usize>> {
        let is_edge = |index: &usize| {
            let here = cell(*index, self.width);
            let place = costs.middle_m(here);
            let beside = AROUND[..4].iter();
            let mut beside = beside.map(|[dx, dy]| costs.middle_m([here[0] + dx, here[1] + dy]));
            // The track is checked last, because that test is slow.
            survey.is_free(place)
                && beside.any(|place| survey.is_unknown(place))
                && !survey.is_beside(place)
        };
        let mut is_left = alloc::vec![false; self.before.len()];
        let all: Vec<usize> = self.order.iter().copied().filter(is_edge).collect();
        all.iter().for_each(|index| is_left[*index] = true);
        let mut edges = Vec::new();
        for first in all {
            if !core::mem::take(&mut is_left[first]) {
                continue;
            }
            let mut edge = alloc::vec![first];
            let mut at = 0;
            while let Some(index) = edge.get(at).copied() {
                at += 1;
                for near in self.around(index) {
                    if core::mem::take(&mut is_left[near]) {
                        edge.push(near);
                    }
                }
            }
            if edge.len() >= CELLS_MIN {
                edges.push(edge);
            }
        }
        edges
    }

    fn around(&self, index: usize) -> impl Iterator<Item = usize> + use<> {
        let (width, len) = (self.width, self.before.len());
        let (x, y) = (index % width, index / width);
        AROUND.into_iter().filter_map(move |[dx, dy]| {
            let x = x.checked_add_signed(dx as isize).filter(|x| *x < width)?;
            let at = y.checked_add_signed(dy as isize)? * width + x;
            (at < len).then_some(at)
        })
    }

    /// A pose that shows the edge at `at`: on the path there, some distance before the edge, where
    /// the car has room; looking along the path.
    fn goal(
        &self,
        costs: &Costmap,
        at: usize,
        is_free: impl Fn(CarPose) -> bool,
    ) -> Option<CarPose> {
        let mut way = alloc::vec![at];
        while let Some(before) = self.before[way[way.len() - 1]] {
            if before == way[way.len() - 1] {
                break;
            }
            way.push(before);
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "some cells"
        )]
        let short = (BEFORE_M / CELL_M) as usize;
        let place = |index: usize| costs.middle_m(cell(way[index], self.width));
        let pose = |index: usize| {
            let from = place((index + HEADING_CELLS).min(way.len() - 1));
            // At the end of a short path, look from the car towards the edge.
            let to = place(index.saturating_sub(HEADING_CELLS));
            let [x_m, y_m] = place(index);
            CarPose {
                x_m,
                y_m,
                heading_rad: libm::atan2(to[1] - from[1], to[0] - from[0]),
            }
        };
        let first = short.min(way.len() / 2);
        (first..way.len()).map(pose).find(|pose| is_free(*pose))
    }
}

/// Radius around the rear axle, metres, that the car occupies, up to where its camera sees the
/// floor.
const STANDS_M: f64 = 0.9;

/// Neighbours; those that share an edge first.
const AROUND: [[i32; 2]; 8] = [
    [1, 0],
    [0, 1],
    [-1, 0],
    [0, -1],
    [1, 1],
    [-1, 1],
    [-1, -1],
    [1, -1],
];

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;

    /// In a map of three columns and two rows, no cell has neighbours beyond the map.
    #[test]
    fn neighbours_end_with_the_map() {
        let reach = Reach {
            width: 3,
            before: alloc::vec![None; 6],
            steps: Vec::new(),
            order: Vec::new(),
        };
        let around = |index| {
            let mut around: Vec<_> = reach.around(index).collect();
            around.sort_unstable();
            around
        };
        assert_eq!([around(0), around(2)], [[1, 3, 4], [1, 4, 5]]);
        assert_eq!([around(3), around(5)], [[0, 1, 4], [1, 2, 4]]);
        assert_eq!([around(1), around(4)], [[0, 2, 3, 4, 5], [0, 1, 2, 3, 5]]);
    }

    /// Of an L of 4 + 2 cells the mean is (1.83, 0.5): column 2 of row 0 is the nearest.
    #[test]
    fn the_middle_of_an_edge_is_one_of_its_cells() {
        let edge = [0, 1, 2, 3, 13, 23];
        assert_eq!(middle(&edge, 10), 2);
        assert_eq!(middle(&[57], 10), 57);
        assert_eq!(middle(&[7, 17, 27], 10), 17);
    }
}
