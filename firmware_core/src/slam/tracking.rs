//! The core's way to the pose: the window that the odometry leaves, searched whole, then between
//! the cells. A scan that contradicts the map widens the window: the robot may have been pushed.

use super::correlate::{Best, REACH_MAX, Window, search};
use super::effort::Effort;
use super::evidence::Evidence;
use super::prior::Prior;
use super::refine::refine;
use crate::grid::Grid;
use crate::pose::Pose;

/// What a search works on.
pub(super) struct Task<'a> {
    /// Points of the search.
    pub(super) sparse: &'a [[i16; 2]],
    /// Points of the refinement.
    pub(super) dense: &'a [[i16; 2]],
    /// What the odometry says.
    pub(super) prior: Prior,
}

/// Where a scan belongs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) pose: Pose,
    /// Sum of the map at the points of the search.
    pub(super) sum: u32,
    pub(super) evidence: Evidence,
}

/// Agreement below which the odometry is doubted.
pub(super) const DOUBTFUL: f32 = 0.5;
/// What a pose far from the prediction must agree better by.
const BETTER: f32 = 0.25;
/// Heading step of the search, in degrees.
pub(super) const TURN_STEP_DEG: f32 = 0.5;
/// The window for a robot that was pushed: 15 cells and 12 degrees to each side.
const WIDE_TURNS: i32 = 24;

/// Finds the place of a scan near its prediction.
pub(super) fn track<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    task: &Task<'_>,
    effort: &mut Effort,
) -> Place {
    let turn_step = TURN_STEP_DEG.to_radians();
    let narrow = task.prior.window(grid.resolution_mm(), turn_step);
    let centre = task.prior.predicted;
    let mut prior = task.prior;
    let mut best = search(grid, task.sparse, centre, &narrow, &prior.firm(), effort);
    let mut evidence = Evidence::of(grid, task.sparse, best.pose);
    if evidence.agreement() < DOUBTFUL {
        let wide = Window {
            reach: REACH_MAX,
            turns: WIDE_TURNS,
            turn_step,
        };
        let other = search(grid, task.sparse, centre, &wide, &prior, effort);
        let found = Evidence::of(grid, task.sparse, other.pose);
        if found.agreement() > evidence.agreement() + BETTER {
            (best, evidence) = (other, found);
            prior = prior.around(best.pose);
        }
    }
    let pose = refine(grid, task.dense, best.pose, &prior, effort);
    Place {
        pose,
        sum: best.sum,
        evidence,
    }
}

/// The place of a scan near `best`, which was found without the odometry's help.
pub(super) fn settle<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    task: &Task<'_>,
    best: &Best,
    effort: &mut Effort,
) -> Place {
    let prior = task.prior.around(best.pose);
    let pose = refine(grid, task.dense, best.pose, &prior, effort);
    Place {
        pose,
        sum: best.sum,
        evidence: Evidence::of(grid, task.sparse, pose),
    }
}
