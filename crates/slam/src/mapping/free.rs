//! Free space around a position: cells that beams crossed.

use emulators::world::Pose;

use crate::mapping::cloud::{Cloud, Frame, Spot, gap};
use crate::mapping::surfels::{CELL_M, Surfels, cell};

/// Length at the end of a beam that gives no evidence of free space, metres: walls are rough, and
/// poses have errors.
const LAST_M: f32 = 0.4;

/// Cells that beams crossed.
#[derive(Clone, Debug)]
pub(crate) struct Free {
    corner: [i32; 2],
    side: i32,
    passed: Vec<bool>,
}

impl Free {
    /// An empty map with the same cells as `walls`.
    pub(crate) fn like(walls: &Surfels) -> Self {
        Self {
            corner: walls.corner(),
            side: walls.side(),
            passed: vec![false; walls.likely().len()],
        }
    }

    /// Adds the beams of a scan.
    pub(crate) fn draw(&mut self, pose: Pose, cloud: &Cloud) {
        let frame = Frame::new(pose);
        for spot in cloud.spots() {
            let end = frame.place(spot.at);
            let length = gap(end, frame.at);
            let parts = (length - LAST_M) / CELL_M;
            let per_m = CELL_M / length;
            let step = [
                (end[0] - frame.at[0]) * per_m,
                (end[1] - frame.at[1]) * per_m,
            ];
            let mut part = 0.0;
            while part < parts {
                let at = [frame.at[0] + part * step[0], frame.at[1] + part * step[1]];
                if let Some(flat) = self.flat(at) {
                    self.passed[flat] = true;
                }
                part += 1.0;
            }
        }
    }

    fn flat(&self, at: [f32; 2]) -> Option<usize> {
        let (x, y) = (cell(at[0]) - self.corner[0], cell(at[1]) - self.corner[1]);
        let inside = 0..self.side;
        let is_inside = inside.contains(&x) && inside.contains(&y);
        is_inside.then(|| (y * self.side + x).cast_unsigned() as usize)
    }

    /// Share of the spots seen from `pose` that lie in crossed cells without a wall.
    pub(crate) fn denied(&self, walls: &Surfels, spots: &[Spot], pose: Pose) -> f64 {
        let frame = Frame::new(pose);
        let stands = |spot: &&Spot| {
            let at = frame.place(spot.at);
            self.flat(at).is_some_and(|flat| self.passed[flat]) && walls.likelihood(at) == 0
        };
        spots.iter().filter(stands).count() as f64 / spots.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall 5 m ahead: a spot 2 m ahead is denied, a spot at the wall or beside the beams is not.
    #[test]
    fn nothing_stands_where_beams_went_through() {
        let wall: Vec<[f32; 2]> = (-20..=20).map(|y| [5.0, y as f32 * 0.05]).collect();
        let cloud = Cloud::new(&wall);
        let mut walls = Surfels::around([0.0; 2], 10.0);
        walls.draw(Pose::default(), &cloud);
        let mut free = Free::like(&walls);
        free.draw(Pose::default(), &cloud);
        let at = |at: [f32; 2]| Spot {
            at,
            normal: [0.0; 2],
            is_joined: false,
        };
        let spots = [
            at([2.0, 0.0]),
            at([5.0, 0.0]),
            at([2.0, 3.0]),
            at([4.8, 0.0]),
        ];
        assert!((free.denied(&walls, &spots, Pose::default()) - 0.25).abs() < 1e-9);
    }
}
