//! The best pose of a scan in a window: every cell and heading step is tried (Olson 2009), with the
//! poses of a row in parallel lanes.

use emulators::world::{Pose, wrap_angle};

use crate::mapping::align::Prior;
use crate::mapping::cloud::{Frame, Spot};
use crate::mapping::surfels::{CELL_M, Surfels, cell};

/// Maximum number of cells in a row of poses.
const SPAN: i32 = 32;
/// Maximum number of cells to each side.
pub(crate) const REACH_MAX: i32 = 15;
/// Maximum number of compared spots: their sum fits 16 bits, so no addition below wraps. Checked
/// additions would not run in parallel lanes.
const SPOTS_MAX: usize = 120;
/// Reduction of the mean likelihood per squared standard deviation from the odometry.
const COST: f64 = 0.012;
/// Maximum reduction: the odometry can only make a pose unlikely.
const COST_MAX: f64 = 0.25;

/// The window of poses.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    /// Number of cells to each side, at most [`REACH_MAX`].
    pub(crate) reach: i32,
    /// Number of heading steps to each side, and the step in radians.
    pub(crate) turns: i32,
    pub(crate) step: f64,
}

/// A pose and its score: mean likelihood, 0 to 1, minus the odometry's reduction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    pub(crate) pose: Pose,
    pub(crate) score: f64,
}

/// The best pose of each heading, the best first.
pub(crate) fn search(
    walls: &Surfels,
    spots: &[Spot],
    window: &Window,
    prior: &Prior,
) -> Vec<Candidate> {
    let spots = crate::mapping::surfels::some_of(spots, SPOTS_MAX);
    let mut all: Vec<Candidate> = (-window.turns..=window.turns)
        .filter_map(|turn| {
            let theta = prior.pose.theta + f64::from(turn) * window.step;
            best_at(walls, &spots, window.reach, theta, prior)
        })
        .collect();
    all.sort_by(|a, b| b.score.total_cmp(&a.score));
    all
}

fn best_at(
    walls: &Surfels,
    spots: &[Spot],
    reach: i32,
    theta: f64,
    prior: &Prior,
) -> Option<Candidate> {
    let frame = Frame::new(Pose {
        theta,
        ..prior.pose
    });
    let side = walls.side();
    let corner = walls.corner();
    let mut starts: Vec<usize> = Vec::with_capacity(spots.len());
    starts.extend(spots.iter().filter_map(|spot| {
        let at = frame.place(spot.at);
        let (x, y) = (
            cell(at[0]) - corner[0] - reach,
            cell(at[1]) - corner[1] - reach,
        );
        let fits = x >= 0 && y >= 0 && x + SPAN <= side && y + 2 * reach < side;
        fits.then(|| (y * side + x).cast_unsigned() as usize)
    }));
    let scale = 1.0 / (255.0 * spots.len().max(1) as f64);
    let [per_m, per_rad] = prior.deviation.map(|sigma| 1.0 / (sigma * sigma));
    let turn = wrap_angle(theta - prior.pose.theta);
    let turn_off = turn * turn * per_rad;
    let mut best: Option<Candidate> = None;
    // A narrow window uses a narrow row.
    let row_sums = match 2 * reach {
        ..8 => sums::<8>,
        8..16 => sums::<16>,
        _ => sums::<32>,
    };
    let mut totals = [0; 32];
    for row in 0..=2 * reach {
        let offset = (row * side).cast_unsigned() as usize;
        row_sums(walls.likely(), &starts, offset, &mut totals);
        for column in 0..=2 * reach {
            let total = totals[column.cast_unsigned() as usize];
            let score = f64::from(total) * scale;
            if best.as_ref().is_some_and(|best| score <= best.score) {
                continue;
            }
            let metres = |cells: i32| f64::from((cells - reach) as f32 * CELL_M);
            let way = [metres(column), metres(row)];
            let off = (way[0] * way[0] + way[1] * way[1]) * per_m + turn_off;
            let pose = Pose::new(
                prior.pose.x + way[0],
                prior.pose.y + way[1],
                wrap_angle(theta),
            );
            let score = score - (COST * off).min(COST_MAX);
            if best.as_ref().is_none_or(|best| score > best.score) {
                best = Some(Candidate { pose, score });
            }
        }
    }
    best
}

/// Sums for a row of `LANES` poses.
fn sums<const LANES: usize>(
    likely: &[u8],
    starts: &[usize],
    offset: usize,
    totals: &mut [u16; 32],
) {
    let mut sums = [0_u16; LANES];
    for start in starts {
        let from = start + offset;
        let Some(cells) = likely
            .get(from..)
            .and_then(|cells| cells.first_chunk::<LANES>())
        else {
            continue;
        };
        // An iterator over both would not be inlined here.
        for lane in 0..LANES {
            sums[lane] = sums[lane].wrapping_add(u16::from(cells[lane]));
        }
    }
    totals[..LANES].copy_from_slice(&sums);
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "metres of a small room")]
mod tests {
    use super::*;
    use emulators::rng::Rng;

    /// The result equals that of trying every pose of a window one by one.
    #[test]
    fn the_search_finds_what_trying_every_pose_finds() {
        let mut rng = Rng::stream(7, "test.correlate");
        let mut point = || [0, 1].map(|_: u8| rng.range(-4.0, 4.0) as f32);
        let ends: Vec<[f32; 2]> = (0..150).map(|_| point()).collect();
        let mut walls = Surfels::around([0.0; 2], 12.0);
        walls.draw(Pose::default(), &crate::mapping::Cloud::new(&ends));
        let spots: Vec<Spot> = ends[..100]
            .iter()
            .map(|at| Spot {
                at: *at,
                normal: [0.0; 2],
                is_joined: false,
            })
            .collect();
        let prior = Prior {
            pose: Pose::new(0.31, -0.22, 0.04),
            deviation: [0.3, 0.05],
        };
        let window = Window {
            reach: 6,
            turns: 4,
            step: 0.02,
        };
        let best = search(&walls, &spots, &window, &prior)[0];
        let mut naive = f64::MIN;
        for turn in -4..=4 {
            for y in -6..=6 {
                for x in -6..=6 {
                    let way = [x, y, turn].map(f64::from);
                    let cell = f64::from(CELL_M);
                    let theta = prior.pose.theta + way[2] * 0.02;
                    let frame = Frame::new(Pose {
                        theta,
                        ..prior.pose
                    });
                    let shift = [x, y].map(|cells| cells as f32 * CELL_M);
                    let sum: f64 = spots
                        .iter()
                        .map(|spot| {
                            // The centre of the spot's cell, so that the shift is a whole number of
                            // cells.
                            let at = frame.place(spot.at).map(|m| (cell_of(m) + 0.5) * CELL_M);
                            f64::from(walls.likelihood([at[0] + shift[0], at[1] + shift[1]]))
                        })
                        .sum();
                    let off = (way[0] * way[0] + way[1] * way[1]) * cell * cell / 0.09
                        + way[2] * way[2] * 0.0004 / 0.0025;
                    naive = naive.max(sum / 25_500.0 - (COST * off).min(COST_MAX));
                }
            }
        }
        assert!((best.score - naive).abs() < 1e-5, "{} {naive}", best.score);
    }

    fn cell_of(metres: f32) -> f32 {
        cell(metres) as f32
    }
}
