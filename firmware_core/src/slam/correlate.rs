//! Exhaustive search of a window of poses: every heading step, every cell up and down, all cells
//! across at once (Olson, "Real-time correlative scan matching", 2009). The kernel for rows is our
//! own.

use super::WIDE;
use super::effort::Effort;
use super::matching::{Placement, whole};
use super::prior::Prior;
use super::row::{Cut, LANES, POINTS_MAX, Sums, add_cut, narrow, pair, sums};
use super::window::{REACH_MAX, Window};
use crate::grid::Grid;
use crate::pose::{Pose, normalised};

/// The best pose of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Best {
    /// The pose.
    pub(super) pose: Pose,
    /// Sixteen times the sum over the points, less the prior's cost.
    pub(super) rating: i32,
    /// Sum over the points.
    pub(super) sum: u32,
    /// Steps from the window's centre: cells along x and y, heading steps.
    pub(super) steps: [i32; 3],
}

/// Compares every pose of `window` around `centre`. Of equal ones the first wins: lowest heading,
/// then lowest y, then lowest x.
pub(super) fn search<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    points: &[[i16; 2]],
    centre: Pose,
    window: &Window,
    prior: &Prior,
    effort: &mut Effort,
) -> Best {
    let points = &points[..points.len().min(POINTS_MAX)];
    let count = super::count_u32(points.len());
    let cell_mm = grid.resolution_mm();
    let scale = 16.0 * points.len() as f32;
    let reach = window.reach.clamp(0, REACH_MAX);
    let mut contest = Contest::new(centre, cell_mm, reach, prior, scale);
    for turn in -window.turns..=window.turns {
        effort.placed(count);
        effort.rows(contest.side, contest.side, count);
        let heading = normalised(centre.heading + turn as f32 * window.turn_step);
        let placement = Placement::new(Pose { heading, ..centre }, cell_mm);
        let cost_turn = prior.deviation_heading(heading) * prior.cost * scale;
        let placed = Placed::<W, H>::new(points, &placement, reach);
        let mut rows = AtHeading {
            contest: &mut contest,
            prior,
            heading,
            turn,
            cost: cost_turn,
            scale,
        };
        if WIDE && reach <= NARROW && placed.cut == 0 {
            rows.narrow(grid, &placed);
        } else {
            rows.wide(grid, &placed);
        }
    }
    contest.best
}

/// Greatest reach of a window whose rows have at most 16 poses.
const NARROW: i32 = 7;

/// The poses at one heading, compared row after row, the lowest first.
struct AtHeading<'a> {
    contest: &'a mut Contest,
    prior: &'a Prior,
    heading: f32,
    turn: i32,
    /// Cost of the heading.
    cost: f32,
    scale: f32,
}

impl AtHeading<'_> {
    /// Compares the rows of a window by 32 lanes.
    fn wide<const W: usize, const H: usize>(&mut self, grid: &Grid<W, H>, placed: &Placed<W, H>) {
        let in_window = self.contest.in_window;
        let reach = placed.reach;
        let mut enter = |row: i32, lanes: &Sums| {
            self.enter(row, lanes.highest(&in_window), lanes.lanes());
        };
        let mut row = -reach;
        while row < reach {
            let [low, high] = placed.pair(grid, row);
            enter(row, &low);
            enter(row + 1, &high);
            row += 2;
        }
        if row == reach {
            enter(row, &placed.sums(grid, row));
        }
    }

    /// As [`wide`](Self::wide), for a window of a reach up to [`NARROW`] with all its points on
    /// the map: by 8 lanes and all rows at once, or by 16 lanes and three rows.
    fn narrow<const W: usize, const H: usize>(&mut self, grid: &Grid<W, H>, placed: &Placed<W, H>) {
        let mut row = -placed.reach;
        match placed.reach {
            1 => return self.rows::<3, 8, W, H>(grid, placed, row),
            2 => return self.rows::<5, 8, W, H>(grid, placed, row),
            3 => return self.rows::<7, 8, W, H>(grid, placed, row),
            _ => {}
        }
        while row + 2 <= placed.reach {
            self.rows::<3, 16, W, H>(grid, placed, row);
            row += 3;
        }
        match placed.reach - row {
            0 => self.rows::<1, 16, W, H>(grid, placed, row),
            1 => self.rows::<2, 16, W, H>(grid, placed, row),
            _ => {}
        }
    }

    /// Compares `N` rows from `first` on, by `L` lanes.
    fn rows<const N: usize, const L: usize, const W: usize, const H: usize>(
        &mut self,
        grid: &Grid<W, H>,
        placed: &Placed<W, H>,
        first: i32,
    ) {
        let cells = grid.rows().as_flattened();
        let offset = usize::from(placed.row(first)) * W;
        let rows = narrow::<N, L, W>(cells, &placed.starts[..placed.whole], offset);
        let side = (self.contest.side as usize).min(L);
        for (row, lanes) in (first..).zip(&rows) {
            let lanes = lanes[..side].iter().copied();
            self.enter(row, lanes.clone().fold(0, u16::max), lanes);
        }
    }

    /// Compares the poses of a row; `highest` is the highest of the `lanes` that are poses of the
    /// window.
    fn enter(&mut self, row: i32, highest: u16, lanes: impl Iterator<Item = u16>) {
        let y_mm = self.contest.centre.y_mm + row as f32 * self.contest.cell_mm;
        let cost = self.cost + self.prior.deviation_y(y_mm) * self.prior.cost * self.scale;
        let (steps, at) = ([row, self.turn], [y_mm, self.heading]);
        self.contest.enter(steps, at, cost, (highest, lanes));
    }
}

/// Rows of poses, compared one after the other.
struct Contest {
    best: Best,
    centre: Pose,
    cell_mm: f32,
    reach: i32,
    /// Poses of a row.
    side: u32,
    /// Cost of each lane for its x, and the lowest of them.
    costs_x: [f32; LANES],
    least_cost_x: f32,
    cost_max: f32,
    /// Mask of the lanes that are poses of the window.
    in_window: Sums,
}

impl Contest {
    fn new(centre: Pose, cell_mm: f32, reach: i32, prior: &Prior, scale: f32) -> Self {
        let side = (2 * reach + 1).unsigned_abs();
        let mut costs_x = [0.0; LANES];
        for (column, cost) in (-reach..=reach).zip(&mut costs_x) {
            let x_mm = centre.x_mm + column as f32 * cell_mm;
            *cost = prior.deviation_x(x_mm) * prior.cost * scale;
        }
        let of_poses = costs_x[..side as usize].iter().copied();
        Self {
            best: Best {
                pose: centre,
                rating: i32::MIN,
                sum: 0,
                steps: [0; 3],
            },
            centre,
            cell_mm,
            reach,
            side,
            least_cost_x: of_poses.fold(f32::MAX, f32::min),
            costs_x,
            cost_max: prior.cost_max * scale,
            in_window: Sums::from_lanes(|lane| match lane < side as usize {
                true => u16::MAX,
                false => 0,
            }),
        }
    }

    /// Compares the poses of a row, with the common `cost` of their y and heading. The first lanes
    /// are the poses of the window, `highest` is the highest of them.
    fn enter(
        &mut self,
        [row, turn]: [i32; 2],
        [y_mm, heading]: [f32; 2],
        cost: f32,
        (highest, lanes): (u16, impl Iterator<Item = u16>),
    ) {
        // No pose of the row can be better than its highest sum at its least cost.
        let highest = 16 * i32::from(highest);
        if highest - whole((cost + self.least_cost_x).min(self.cost_max)) <= self.best.rating {
            return;
        }
        let columns = -self.reach..=self.reach;
        for ((column, sum), cost_x) in columns.zip(lanes).zip(&self.costs_x) {
            let cost = whole((cost + cost_x).min(self.cost_max));
            let rating = 16 * i32::from(sum) - cost;
            if rating > self.best.rating {
                self.best = Best {
                    pose: Pose {
                        x_mm: self.centre.x_mm + column as f32 * self.cell_mm,
                        y_mm,
                        heading,
                    },
                    rating,
                    sum: u32::from(sum),
                    steps: [column, row, turn],
                };
            }
        }
    }
}

/// Points at one heading, as positions in the map.
struct Placed<const W: usize, const H: usize> {
    /// Index of the lower left cell, for points with their whole window on the map.
    starts: [u32; POINTS_MAX],
    whole: usize,
    /// Other points with windows that touch the map.
    edges: [Cut; POINTS_MAX],
    cut: usize,
    /// Rows of the windows that hang over the map's first or last cell.
    ends: u32,
    reach: i32,
}

impl<const W: usize, const H: usize> Placed<W, H> {
    fn new(points: &[[i16; 2]], placement: &Placement, reach: i32) -> Self {
        let mut placed = Self {
            starts: [0; POINTS_MAX],
            whole: 0,
            edges: [Cut::EMPTY; POINTS_MAX],
            cut: 0,
            ends: 0,
            reach,
        };
        let (width, height) = (Grid::<W, H>::WIDTH, Grid::<W, H>::HEIGHT);
        for point in points {
            let (x, y) = placement.cell(*point);
            let (left, low) = (x - reach, y - reach);
            let (right, high) = (x + reach + 1, y + reach + 1);
            // Lanes beyond the window may hold anything, but must lie on the map.
            let last = (high - 1) * width + left + 2 * REACH_MAX + 2;
            if left >= 0 && low >= 0 && right <= width && high <= height && last <= width * height {
                placed.starts[placed.whole] = (low * width + left).unsigned_abs();
                placed.whole += 1;
            } else if right > 0 && high > 0 && left < width && low < height {
                placed.edges[placed.cut] = Cut::new(left, low, width);
                placed.ends |= Cut::ends::<W, H>(left, low);
                placed.cut += 1;
            }
        }
        placed
    }

    /// Scores of the lanes of a row of the window.
    fn sums(&self, grid: &Grid<W, H>, row: i32) -> Sums {
        let row = self.row(row);
        let cells = grid.rows().as_flattened();
        let mut lanes = [sums(
            cells,
            &self.starts[..self.whole],
            usize::from(row) * W,
        )];
        self.add_edges(&mut lanes, grid, row);
        let [lanes] = lanes;
        lanes
    }

    /// Scores of the lanes of a row of the window and the next one.
    fn pair(&self, grid: &Grid<W, H>, row: i32) -> [Sums; 2] {
        let row = self.row(row);
        let cells = grid.rows().as_flattened();
        let offset = usize::from(row) * W;
        let mut lanes = pair::<W>(cells, &self.starts[..self.whole], offset);
        self.add_edges(&mut lanes, grid, row);
        lanes
    }

    fn add_edges<const N: usize>(&self, lanes: &mut [Sums; N], grid: &Grid<W, H>, row: u16) {
        if self.cut > 0 {
            add_cut(lanes, grid.rows(), &self.edges[..self.cut], row, self.ends);
        }
    }

    /// Number of a row, counted from the window's lowest.
    fn row(&self, row: i32) -> u16 {
        u16::try_from(row + self.reach).expect("within the window")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slam::matching::tally;
    use crate::slam::prior::Travel;
    use crate::slam::settings::MotionNoise;
    use proptest::prelude::*;

    const CELL_MM: f32 = 10.0;

    /// The reference: scores pose after pose separately.
    fn naive(
        grid: &Grid<60, 50>,
        points: &[[i16; 2]],
        centre: Pose,
        window: &Window,
        prior: &Prior,
    ) -> (i32, [i32; 3]) {
        let mut best = (i32::MIN, [0; 3]);
        let scale = 16.0 * points.len() as f32;
        for turn in -window.turns..=window.turns {
            let heading = normalised(centre.heading + turn as f32 * window.turn_step);
            for row in -window.reach..=window.reach {
                for column in -window.reach..=window.reach {
                    let pose = Pose {
                        x_mm: centre.x_mm + column as f32 * CELL_MM,
                        y_mm: centre.y_mm + row as f32 * CELL_MM,
                        heading,
                    };
                    let mut placement = Placement::new(Pose { heading, ..centre }, CELL_MM);
                    placement.x += column << 18;
                    placement.y += row << 18;
                    let sum = tally(grid.rows(), points, &placement).sum;
                    let cost = prior.deviation_heading(heading) * prior.cost * scale
                        + prior.deviation_y(pose.y_mm) * prior.cost * scale
                        + prior.deviation_x(pose.x_mm) * prior.cost * scale;
                    let cost = whole(cost.min(prior.cost_max * scale));
                    let rating = 16 * i32::try_from(sum).unwrap() - cost;
                    if rating > best.0 {
                        best = (rating, [column, row, turn]);
                    }
                }
            }
        }
        best
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Searches in the middle of the map and at its edges, with points inside and outside.
        #[test]
        fn the_search_finds_what_trying_every_pose_finds(
            values in proptest::collection::vec(0_u8.., 3000),
            points in proptest::collection::vec([-500_i16..500, -500_i16..500], 1..40),
            x in -50.0_f32..650.0, y in -50.0_f32..550.0, heading in -3.0_f32..3.0,
            reach in 0_i32..16, turns in 0_i32..4, driven in 0.0_f32..200.0,
        ) {
            let mut grid = Grid::<60, 50>::new(CELL_MM);
            grid.rows_mut().as_flattened_mut().copy_from_slice(&values);
            let centre = Pose::new(x, y, heading);
            let mut travel = Travel::default();
            travel.add(crate::pose::PoseChange { forward_mm: driven, left_mm: 0.0, turn: 0.1 });
            let prior = Prior::new(centre, travel, &MotionNoise::WHEELS, CELL_MM);
            let window = Window { reach, turns, turn_step: 0.01 };
            let found = search(&grid, &points, centre, &window, &prior, &mut Effort::default());
            let (rating, steps) = naive(&grid, &points, centre, &window, &prior);
            prop_assert_eq!((found.rating, found.steps), (rating, steps));
        }
    }
}
