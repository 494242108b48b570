//! Cost of each cell for a robot: obstacles, and the space around them that its outline must not
//! enter. For the part of a program that runs on a PC; feature `host`.
//!
//! ```text
//! 20  obstacle                 the outline must not touch it
//! 19  within the inscribed     forbidden for the reference point: the outline would touch an
//!     radius of an obstacle    obstacle at every heading
//! ..  falls with the distance  higher near an obstacle
//!  0  farther than the inflation radius, or unknown
//! ```
//!
//! The scale is that of the lattice planner of seed 003 (sbpl): values of its costmap, 0 to 254,
//! divided by 14 and rounded. Unknown cells cost nothing there, so that planner plans through them;
//! this map does the same.

use alloc::vec::Vec;

/// Cost of an obstacle.
pub const LETHAL: u8 = 20;
/// Cost of a position of the reference point at which the outline touches an obstacle.
pub const INSCRIBED: u8 = 19;
/// Rate at which the cost falls beyond the inscribed radius, per metre: the default of the costmap
/// that seed 003 used.
const FALL_PER_M: f64 = 10.0;

/// Radii around an obstacle within which cells have a cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inflation {
    /// Radius of the largest circle inside the robot's outline.
    pub inscribed_m: f64,
    /// Radius beyond which there is no cost.
    pub radius_m: f64,
}

/// Cells in rows of equal y, lowest y first.
#[derive(Clone, Debug, PartialEq)]
pub struct Costmap {
    width: usize,
    height: usize,
    cell_m: f64,
    origin_m: [f64; 2],
    obstacles: Vec<bool>,
    costs: Vec<u8>,
    /// Costs of the cells around one obstacle, row by row.
    stamp: Vec<Stripe>,
}

/// Costs of neighbouring cells in a row, and the position of the first relative to the obstacle.
#[derive(Clone, Debug, PartialEq)]
struct Stripe {
    from: [isize; 2],
    costs: Vec<u8>,
}

impl Costmap {
    /// A map of `obstacles`, in rows of `width` cells with edges of `cell_m`. The corner of least x
    /// and y is `origin_m`. An incomplete last row is ignored.
    ///
    /// # Panics
    /// If `width` is 0 or the cells have no size.
    pub fn new(
        width: usize,
        cell_m: f64,
        origin_m: [f64; 2],
        mut obstacles: Vec<bool>,
        inflation: Inflation,
    ) -> Self {
        assert!(width > 0, "a row has cells");
        assert!(cell_m > 0.0 && cell_m.is_finite(), "cells have a size");
        obstacles.truncate(obstacles.len() / width * width);
        let mut map = Self {
            width,
            height: obstacles.len() / width,
            cell_m,
            origin_m,
            costs: alloc::vec![0; obstacles.len()],
            obstacles,
            stamp: stamp(cell_m, inflation),
        };
        for at in 0..map.obstacles.len() {
            if map.obstacles[at] {
                map.costs[at] = LETHAL;
                // Skip cells inside a solid wall: all their neighbours are obstacles, so they add
                // nothing.
                if !map.is_inner(at) {
                    map.press(at);
                }
            }
        }
        map
    }

    /// Adds an obstacle at this index of the rows; an index beyond them has no effect.
    pub fn add(&mut self, at: usize) {
        if let Some(is) = self.obstacles.get_mut(at) {
            *is = true;
            self.costs[at] = LETHAL;
            self.press(at);
        }
    }

    /// Cells along x.
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Cells along y.
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Edge of a cell, metres.
    pub const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// The corner of least x and y, metres.
    pub const fn origin_m(&self) -> [f64; 2] {
        self.origin_m
    }

    /// All costs, row by row.
    pub fn costs(&self) -> &[u8] {
        &self.costs
    }

    /// Cost of a cell; a cell outside the map costs as much as an obstacle.
    pub fn cost(&self, [x, y]: [i32; 2]) -> u8 {
        self.index([x, y]).map_or(LETHAL, |index| self.costs[index])
    }

    /// Whether a cell is an obstacle, or outside.
    pub fn is_obstacle(&self, cell: [i32; 2]) -> bool {
        self.index(cell).is_none_or(|index| self.obstacles[index])
    }

    /// The cell at a position, metres, inside or outside the map; `None` if the position is not
    /// finite.
    pub fn cell(&self, [x_m, y_m]: [f64; 2]) -> Option<[i32; 2]> {
        let along = |m: f64, origin_m: f64| libm::floor((m - origin_m) / self.cell_m);
        let cell = [along(x_m, self.origin_m[0]), along(y_m, self.origin_m[1])];
        let is_sound = |along: &f64| along.is_finite() && along.abs() < f64::from(1 << 30);
        #[expect(clippy::cast_possible_truncation, reason = "below 2^30")]
        cell.iter()
            .all(is_sound)
            .then(|| cell.map(|along| along as i32))
    }

    /// Middle of a cell, metres.
    pub fn middle_m(&self, cell: [i32; 2]) -> [f64; 2] {
        core::array::from_fn(|axis| {
            self.origin_m[axis] + (f64::from(cell[axis]) + 0.5) * self.cell_m
        })
    }

    fn index(&self, [x, y]: [i32; 2]) -> Option<usize> {
        // A negative coordinate becomes larger than any map.
        let (x, y) = (x.cast_unsigned() as usize, y.cast_unsigned() as usize);
        (x < self.width && y < self.height).then_some(y * self.width + x)
    }

    /// Whether all cells that share an edge with this one are obstacles.
    fn is_inner(&self, at: usize) -> bool {
        let (x, y) = (at % self.width, at / self.width);
        let is_rim = x == 0 || y == 0 || x + 1 == self.width || y + 1 == self.height();
        let beside = [1, self.width];
        !is_rim
            && beside
                .iter()
                .all(|by| self.obstacles[at - by] && self.obstacles[at + by])
    }

    /// Raises the costs around an obstacle.
    fn press(&mut self, at: usize) {
        let (width, height) = (self.width, self.height());
        let (x, y) = (at % width, at / width);
        for stripe in &self.stamp {
            let [dx, dy] = stripe.from;
            let Some(y) = y.checked_add_signed(dy).filter(|y| *y < height) else {
                continue;
            };
            // Clip the part that lies left of the map.
            let (first, cut) = match x.checked_add_signed(dx) {
                Some(first) => (first, 0),
                None => (0, dx.unsigned_abs() - x),
            };
            let row = &mut self.costs[y * width..][..width];
            let (Some(slots), Some(costs)) = (row.get_mut(first..), stripe.costs.get(cut..)) else {
                continue;
            };
            for (slot, cost) in slots.iter_mut().zip(costs) {
                *slot = (*cost).max(*slot);
            }
        }
    }
}

/// Cost of the cells around an obstacle.
fn stamp(cell_m: f64, inflation: Inflation) -> Vec<Stripe> {
    #[expect(clippy::cast_possible_truncation, reason = "at most 1000 cells")]
    let reach = libm::floor(inflation.radius_m / cell_m).clamp(0.0, 1_000.0) as isize;
    let cost = |dx: isize, dy: isize| {
        let cells = libm::sqrt((dx * dx + dy * dy) as f64);
        cost_at(cells * cell_m, inflation)
    };
    let stripe = |dy: isize| {
        // The row is symmetric and has no gap, because the cost falls with the distance.
        let reach = (0..=reach).rev().find(|dx| cost(*dx, dy) > 0)?;
        Some(Stripe {
            from: [-reach, dy],
            costs: (-reach..=reach).map(|dx| cost(dx, dy)).collect(),
        })
    };
    (-reach..=reach).filter_map(stripe).collect()
}

/// Cost at this distance from an obstacle's middle.
fn cost_at(distance_m: f64, inflation: Inflation) -> u8 {
    if distance_m > inflation.radius_m {
        return 0;
    }
    if distance_m <= inflation.inscribed_m {
        return INSCRIBED;
    }
    let of_252 = 252.0 * libm::exp(-FALL_PER_M * (distance_m - inflation.inscribed_m));
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at most 18"
    )]
    let cost = (libm::floor(of_252) / 14.0 + 0.5) as u8;
    cost
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAR: Inflation = Inflation {
        inscribed_m: 0.165,
        radius_m: 0.40,
    };

    /// One obstacle in the middle of 21 x 21 cells. The cost falls with the distance and is divided
    /// by 14, then rounded. At 0.20 m it is 252 exp(-0.35) = 177.6, and 177 / 14 is 12.6. At 0.30 m
    /// the exponent is -1.35: 65.3 and 4.6. At 0.40 m it is -2.35: 24.03 and 1.7.
    #[test]
    fn the_cost_falls_with_the_distance() {
        let mut obstacles = alloc::vec![false; 21 * 21 + 3];
        obstacles[10 * 21 + 10] = true;
        let map = Costmap::new(21, 0.05, [-1.0, 2.0], obstacles, CAR);
        assert_eq!((map.width(), map.height()), (21, 21));
        assert_eq!((map.cell_m(), map.origin_m()), (0.05, [-1.0, 2.0]));
        let along: [u8; 10] = [10, 11, 12, 13, 14, 15, 16, 17, 18, 19].map(|x| map.cost([x, 10]));
        assert_eq!(along, [20, 19, 19, 19, 13, 8, 5, 3, 2, 0]);
        assert_eq!(map.cost([10, 6]), 13);
        assert_eq!(map.cost([-1, 0]), LETHAL);
        assert_eq!(map.cost([0, 21]), LETHAL);
        assert!(map.is_obstacle([10, 10]) && !map.is_obstacle([10, 11]));
        assert_eq!(map.cell([-0.99, 2.06]), Some([0, 1]));
        assert_eq!(map.cell([f64::INFINITY, 0.0]), None);
        let [x, y] = map.middle_m([0, 1]);
        assert!((x + 0.975).abs() < 1e-12 && (y - 2.075).abs() < 1e-12);
    }

    /// Solid walls are stamped only along their edge; the costs equal those of all their cells.
    #[test]
    fn a_solid_block_costs_what_all_its_cells_cost() {
        let is_block = |x: usize, y: usize| (8..14).contains(&x) && (9..13).contains(&y);
        let cells = |is: &dyn Fn(usize, usize) -> bool| {
            (0..30 * 30)
                .map(|at| is(at % 30, at / 30))
                .collect::<Vec<_>>()
        };
        let map = Costmap::new(30, 0.05, [0.0; 2], cells(&is_block), CAR);
        let mut one_by_one = Costmap::new(30, 0.05, [0.0; 2], alloc::vec![false; 900], CAR);
        let all = (0..900).filter(|at| is_block(at % 30, at / 30));
        all.for_each(|at| one_by_one.add(at));
        one_by_one.add(900);
        assert_eq!(one_by_one, map);
        for (at, cost) in map.costs().iter().enumerate() {
            let (x, y) = ((at % 30) as f64, (at / 30) as f64);
            let nearest = |v: f64, low: f64, high: f64| v - v.clamp(low, high);
            let off = libm::hypot(nearest(x, 8.0, 13.0), nearest(y, 9.0, 12.0)) * 0.05;
            let expected = match off == 0.0 {
                true => LETHAL,
                false => cost_at(off, CAR),
            };
            assert_eq!(*cost, expected, "at {x}, {y}");
        }
    }

    /// Random obstacles in half of all cells, on maps narrower and wider than the stamp around an
    /// obstacle: the cost of each cell is that of its nearest obstacle.
    #[test]
    fn each_cell_costs_what_its_nearest_obstacle_makes() {
        let mut random = crate::random::Pcg32::new(7);
        for (width, height) in [(1, 40), (40, 1), (3, 3), (9, 30), (30, 20)] {
            for most in [2, 9] {
                let obstacles: Vec<bool> = (0..width * height)
                    .map(|_| random.below(most) == 0)
                    .collect();
                let map = Costmap::new(width, 0.05, [0.0; 2], obstacles.clone(), CAR);
                for (at, cost) in map.costs().iter().enumerate() {
                    let place = |at: usize| [(at % width) as f64, (at / width) as f64];
                    let [x, y] = place(at);
                    let off_m = |other: usize| {
                        let [other_x, other_y] = place(other);
                        libm::hypot(x - other_x, y - other_y) * 0.05
                    };
                    let others = (0..obstacles.len()).filter(|other| obstacles[*other]);
                    let least_m = others.map(off_m).fold(f64::INFINITY, f64::min);
                    let expected = match obstacles[at] {
                        true => LETHAL,
                        false => cost_at(least_m, CAR),
                    };
                    assert_eq!(*cost, expected, "{width} by {height}, at {x}, {y}");
                }
            }
        }
    }

    /// Cells are counted up to 2^30 to each side; a position farther away or not finite has no
    /// cell.
    #[test]
    fn a_place_too_far_away_has_no_cell() {
        let map = Costmap::new(1, 1.0, [0.0; 2], alloc::vec![false], CAR);
        let most = f64::from(1 << 30);
        assert_eq!(map.cell([most - 1.0, 0.0]), Some([(1 << 30) - 1, 0]));
        assert_eq!(map.cell([0.0, 1.0 - most]), Some([0, 1 - (1 << 30)]));
        for beyond in [most, -most, 1e300, f64::INFINITY, f64::NAN] {
            assert_eq!(map.cell([beyond, 0.0]), None);
            assert_eq!(map.cell([0.0, beyond]), None);
        }
    }
}
