//! The core's search: first the whole window that the odometry allows, then between the cells. A
//! scan that contradicts the map widens the window, because the robot may have been pushed.

use core::f32::consts::PI;

use super::correlate::{Best, search};
use super::effort::Effort;
use super::evidence::Evidence;
use super::prior::Prior;
use super::refine::refine;
use super::settings::Pushes;
use super::sight::as_far_as_seen;
use super::window::{REACH_MAX, Window};
use crate::grid::Grid;
use crate::pose::Pose;

/// Input of a search.
pub(super) struct Task<'a> {
    /// Points of the search.
    pub(super) sparse: &'a [[i16; 2]],
    /// Points of the refinement.
    pub(super) dense: &'a [[i16; 2]],
    /// Prediction of the odometry.
    pub(super) prior: Prior,
    /// Motion that the odometry may have missed.
    pub(super) pushes: Pushes,
    /// Agreement below which other positions are checked.
    pub(super) suspicious: f32,
    /// Maximum unseen turn of the robot.
    pub(super) unseen_rad: f32,
}

/// Pose of a scan.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) pose: Pose,
    /// Sum of the map at the points of the search.
    pub(super) sum: u32,
    pub(super) evidence: Evidence,
    /// Whether the scan fits much better there than at the odometry's pose.
    pub(super) is_elsewhere: bool,
}

/// Agreement below which the odometry is doubted.
pub(super) const DOUBTFUL: f32 = 0.5;
/// Agreement below which a push is possible: along two walls, most of a room still fits. If less
/// than half fits, the robot was probably carried away, and distant positions that look alike must
/// be compared.
pub(super) const SUSPICIOUS: f32 = 0.75;
/// Maximum share of the disagreement that a pose far from the prediction may leave.
const REMAINS: f32 = 0.5;
/// Heading step of the search, in degrees.
pub(super) const TURN_STEP_DEG: f32 = 0.5;
/// The window for a pushed robot: 15 cells and 12 degrees to each side.
const WIDE_TURNS: i32 = 24;

/// Heading steps to each side, of two [`TURN_STEP_DEG`], of a search at a distance.
const FAR_TURNS: i32 = 6;
/// Heading step of a search for an unseen turn, in degrees.
const UNSEEN_STEP_DEG: f32 = 2.0;
/// Positions of the windows around the middle one.
const AROUND: [[f32; 2]; 8] = [
    [-1.0, -1.0],
    [0.0, -1.0],
    [1.0, -1.0],
    [-1.0, 0.0],
    [1.0, 0.0],
    [-1.0, 1.0],
    [0.0, 1.0],
    [1.0, 1.0],
];

/// Finds the pose of a scan near its prediction.
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
    let mut is_elsewhere = false;
    let mut consider = |other: Best, evidence: &mut Evidence| {
        let found = Evidence::of(grid, task.sparse, other.pose);
        if found.outweighs(evidence, REMAINS) {
            *evidence = found;
            prior = prior.around(other.pose);
            best = other;
            is_elsewhere = true;
        }
    };
    if evidence.agreement() < task.suspicious {
        consider(nearby(grid, task, effort), &mut evidence);
    }
    if evidence.agreement() < task.suspicious && task.unseen_rad > 0.0 {
        consider(turned(grid, task, effort), &mut evidence);
    }
    if task.pushes == Pushes::Followed
        && (DOUBTFUL..task.suspicious).contains(&evidence.agreement())
    {
        consider(farther(grid, task, effort), &mut evidence);
    }
    let mut pose = refine(grid, task.dense, best.pose, &prior, effort);
    if !is_elsewhere {
        pose = as_far_as_seen(task.dense, centre, pose);
    }
    Place {
        pose,
        sum: best.sum,
        evidence,
        is_elsewhere,
    }
}

/// The window around the prediction that covers a push within one scan.
fn nearby<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    task: &Task<'_>,
    effort: &mut Effort,
) -> Best {
    let wide = Window {
        reach: REACH_MAX,
        turns: WIDE_TURNS,
        turn_step: TURN_STEP_DEG.to_radians(),
    };
    search(
        grid,
        task.sparse,
        task.prior.predicted,
        &wide,
        &task.prior,
        effort,
    )
}

/// All headings after an unseen turn, in wide steps that take no longer than a turn of the lidar,
/// and then the headings between them.
fn turned<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    task: &Task<'_>,
    effort: &mut Effort,
) -> Best {
    let predicted = task.prior.predicted;
    let step = UNSEEN_STEP_DEG.to_radians();
    #[expect(clippy::cast_possible_truncation, reason = "at most half a turn")]
    let turns = libm::ceilf(task.unseen_rad.min(PI) / step) as i32;
    let wide = Window {
        reach: REACH_MAX,
        turns,
        turn_step: step,
    };
    let prior = Prior::none(predicted);
    let best = search(grid, task.sparse, predicted, &wide, &prior, effort);
    let fine = Window {
        reach: 4,
        turns: 4,
        turn_step: TURN_STEP_DEG.to_radians(),
    };
    search(
        grid,
        task.sparse,
        best.pose,
        &fine,
        &Prior::none(best.pose),
        effort,
    )
}

/// Eight windows around the middle one, for a push that smeared the scans during it. The odometry
/// limits only the heading, not the position: a push turns a robot by a few degrees.
fn farther<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    task: &Task<'_>,
    effort: &mut Effort,
) -> Best {
    let window = Window {
        reach: REACH_MAX,
        turns: FAR_TURNS,
        turn_step: 2.0 * TURN_STEP_DEG.to_radians(),
    };
    #[expect(clippy::cast_precision_loss, reason = "fifteen")]
    let pitch_mm = (2 * REACH_MAX) as f32 * grid.resolution_mm();
    let centre = |[column, row]: [f32; 2]| Pose {
        x_mm: task.prior.predicted.x_mm + column * pitch_mm,
        y_mm: task.prior.predicted.y_mm + row * pitch_mm,
        ..task.prior.predicted
    };
    let mut search_at = |place| {
        let centre = centre(place);
        search(
            grid,
            task.sparse,
            centre,
            &window,
            &Prior::none(centre),
            effort,
        )
    };
    let mut best = search_at(AROUND[0]);
    for place in &AROUND[1..] {
        let other = search_at(*place);
        if other.sum > best.sum {
            best = other;
        }
    }
    best
}

/// The pose of a scan near `best`, which was found without the odometry.
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
        is_elsewhere: true,
    }
}
