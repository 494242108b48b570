//! The floor as the planner sees it: the map that the car has, and what is in the way besides.

use alloc::vec::Vec;

use crate::ackermann::{CarPose, Motion};
use crate::costmap::{Costmap, Inflation};
use crate::particles::Beam;

/// Obstacles nearer than this are entered, metres: the obstacle range of the fielded costmap.
const ENTER_M: f64 = 2.5;
/// Beams clear what they cross up to here: its ray-trace range.
const CLEAR_M: f64 = 3.0;
/// How often an obstacle must have been seen more than seen through to be one.
const SURE: i8 = 2;
const COUNT_MAX: i8 = 6;
/// Half of an ultrasonic cone: its middle 12 degrees, where it almost always is right.
const CONE_RAD: f64 = 0.1;

/// A map of obstacles: cells in rows of equal y, lowest y first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FloorPlan {
    /// Cells along x; 0 is no map.
    pub width: usize,
    /// Edge of a cell, metres.
    pub cell_m: f64,
    /// The corner of least x and y, metres.
    pub origin_m: [f64; 2],
    /// Whether a cell is an obstacle.
    pub obstacles: Vec<bool>,
}

/// The map, and what was seen on the way.
#[derive(Clone, Debug)]
pub struct Floor {
    plan: FloorPlan,
    inflation: Inflation,
    /// How often each cell was an obstacle, less how often it was seen through.
    seen: Vec<i8>,
    /// All obstacles, one byte a cell as in [`grid`](crate::grid).
    view: Vec<u8>,
}

impl Floor {
    /// The floor of this map.
    pub fn new(plan: FloorPlan, inflation: Inflation) -> Self {
        let seen = alloc::vec![0; plan.obstacles.len()];
        let byte = |is: &bool| {
            if *is {
                crate::grid::OBSTACLE
            } else {
                crate::grid::FREE
            }
        };
        let view = plan.obstacles.iter().map(byte).collect();
        Self {
            plan,
            inflation,
            seen,
            view,
        }
    }

    /// Whether there is a map at all.
    pub fn is_known(&self) -> bool {
        self.plan.width > 0 && !self.plan.obstacles.is_empty()
    }

    /// The map that the car was given.
    pub const fn plan(&self) -> &FloorPlan {
        &self.plan
    }

    /// All obstacles, for an observer.
    pub fn view(&self) -> Option<crate::map_view::MapView<'_>> {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a map's place needs 24 bits"
        )]
        let (cell_mm, origin) = (
            (self.plan.cell_m * 1_000.0) as f32,
            self.plan.origin_m.map(|m| (m * 1_000.0) as f32),
        );
        self.is_known()
            .then(|| crate::map_view::MapView::new(self.plan.width, cell_mm, origin, &self.view))
    }

    /// What it costs to be where, with all that was seen; `None` without a map.
    pub fn costs(&self) -> Option<Costmap> {
        let is_there = |(is, seen): (&bool, &i8)| *is || *seen >= SURE;
        let obstacles = self.plan.obstacles.iter().zip(&self.seen).map(is_there);
        let FloorPlan {
            width,
            cell_m,
            origin_m,
            ..
        } = self.plan;
        self.is_known()
            .then(|| Costmap::new(width, cell_m, origin_m, obstacles.collect(), self.inflation))
    }

    /// A scan from the scanner's place on the map. Whether it changed what is an obstacle.
    pub fn see(&mut self, scanner: CarPose, beams: &[Beam]) -> bool {
        let mut has_changed = false;
        if !self.is_known() {
            return false;
        }
        for beam in beams
            .iter()
            .filter(|beam| beam.range_m.is_finite() && beam.range_m > 0.0)
        {
            let way = beam.range_m.min(CLEAR_M);
            let clear_m = way - 1.5 * self.plan.cell_m;
            let mut along_m = 0.0;
            while along_m < clear_m {
                has_changed |= self.count(place(scanner, beam.bearing_rad, along_m), -1);
                along_m += self.plan.cell_m;
            }
            if beam.range_m <= ENTER_M {
                let end = place(scanner, beam.bearing_rad, beam.range_m);
                has_changed |= self.count(end, 1);
            }
        }
        has_changed
    }

    /// An ultrasonic range from a sensor's place on the map.
    pub fn hear(&mut self, sensor: CarPose, range_m: f64) -> bool {
        let beams = [-CONE_RAD, 0.0, CONE_RAD].map(|bearing_rad| Beam {
            bearing_rad,
            range_m,
        });
        self.see(sensor, &beams)
    }

    /// Counts what was seen of the cell at a place; whether it became an obstacle or ceased to be
    /// one.
    fn count(&mut self, [x_m, y_m]: [f64; 2], by: i8) -> bool {
        let along = |m: f64, axis: usize| {
            let cell = libm::floor((m - self.plan.origin_m[axis]) / self.plan.cell_m);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "saturates"
            )]
            (cell >= 0.0).then_some(cell as usize)
        };
        let (Some(x), Some(y)) = (along(x_m, 0), along(y_m, 1)) else {
            return false;
        };
        let width = self.plan.width;
        let index = y.checked_mul(width).and_then(|row| row.checked_add(x));
        let Some(index) = index.filter(|index| x < width && *index < self.seen.len()) else {
            return false;
        };
        let (was, count) = (
            self.seen[index] >= SURE,
            self.seen[index].saturating_add(by),
        );
        self.seen[index] = count.clamp(-1, COUNT_MAX);
        let is = self.seen[index] >= SURE;
        if was != is && !self.plan.obstacles[index] {
            self.view[index] = if is {
                crate::grid::OBSTACLE
            } else {
                crate::grid::FREE
            };
            return true;
        }
        false
    }
}

/// The place in this direction and distance, metres.
fn place(from: CarPose, bearing_rad: f64, way_m: f64) -> [f64; 2] {
    let (sin, cos) = libm::sincos(bearing_rad);
    let at = from.then(Motion {
        ahead_m: way_m * cos,
        left_m: way_m * sin,
        turn_rad: 0.0,
    });
    [at.x_m, at.y_m]
}

#[cfg(test)]
mod tests {
    use super::*;

    const INFLATION: Inflation = Inflation {
        inscribed_m: 0.1,
        radius_m: 0.1,
    };

    fn empty() -> Floor {
        let plan = FloorPlan {
            width: 60,
            cell_m: 0.05,
            origin_m: [0.0; 2],
            obstacles: alloc::vec![false; 60 * 20],
        };
        Floor::new(plan, INFLATION)
    }

    const SCANNER: CarPose = CarPose {
        x_m: 0.025,
        y_m: 0.525,
        heading_rad: 0.0,
    };

    fn beam(range_m: f64) -> Beam {
        Beam {
            bearing_rad: 0.0,
            range_m,
        }
    }

    /// A box 1 m ahead, cell 20: two scans make it an obstacle, and as soon as it is gone two more
    /// take it away.
    #[test]
    fn what_is_seen_twice_is_in_the_way_until_it_is_seen_through() {
        let mut floor = empty();
        assert!(!floor.see(SCANNER, &[beam(1.0)]));
        assert!(!floor.costs().unwrap().is_obstacle([20, 10]));
        assert!(floor.see(SCANNER, &[beam(1.0)]));
        assert!(floor.costs().unwrap().is_obstacle([20, 10]));
        assert_eq!(
            floor.view().unwrap().get(20, 10),
            Some(crate::grid::OBSTACLE)
        );
        assert!(floor.see(SCANNER, &[beam(2.0)]));
        assert!(!floor.costs().unwrap().is_obstacle([20, 10]));
        // Beyond 2.5 m nothing is entered, and the map that was given stays.
        assert!(!floor.see(SCANNER, &[beam(2.6), beam(2.6), beam(f64::NAN)]));
    }

    #[test]
    fn the_map_that_was_given_is_not_seen_through() {
        let mut floor = empty();
        let mut plan = floor.plan().clone();
        plan.obstacles[10 * 60 + 20] = true;
        floor = Floor::new(plan, INFLATION);
        for _ in 0..10 {
            floor.see(SCANNER, &[beam(2.9)]);
        }
        assert!(floor.costs().unwrap().is_obstacle([20, 10]));
        assert!(floor.is_known() && !Floor::new(FloorPlan::default(), INFLATION).is_known());
    }

    #[test]
    fn an_ultrasonic_range_is_an_obstacle_ahead() {
        let mut floor = empty();
        floor.hear(SCANNER, 0.8);
        floor.hear(SCANNER, 0.8);
        assert!(floor.costs().unwrap().is_obstacle([16, 10]));
    }
}
