//! The best pose of many spots in a wide window: branch and bound (Hess et al. 2016) with blocks of
//! four by four cells, whose bounds are computed in parallel lanes.

use emulators::world::{Pose, wrap_angle};

use crate::mapping::cloud::{Frame, Spot};
use crate::mapping::correlate::Candidate;
use crate::mapping::surfels::{CELL_M, Surfels, cell, some_of};

/// Number of cells along the edge of a block.
const BLOCK: i32 = 4;
/// Number of blocks whose bounds are computed in parallel lanes.
const LANES: usize = 16;
/// Number of cells that they span, plus one block.
const SPAN: i32 = BLOCK * 17;
/// Maximum number of compared spots: their sum fits 16 bits, so no addition below wraps. Checked
/// additions would not run in parallel lanes.
const SPOTS_MAX: usize = 240;
/// Maximum number of examined blocks: more are promising only if all places are similar.
const BLOCKS_MAX: usize = 1500;

/// The window of poses around a centre.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wide {
    pub(crate) reach_m: f64,
    pub(crate) turn: f64,
    /// Minimum mean likelihood of a result.
    pub(crate) floor: f64,
}

/// The maximum likelihood of each cell and the three cells to its right and above, sorted so that
/// the blocks of one grid are adjacent in memory.
pub(crate) struct Bounds {
    planes: Vec<Vec<u8>>,
    width: i32,
}

impl Bounds {
    pub(crate) fn of(walls: &Surfels) -> Self {
        let side = walls.side();
        let at = |x: i32, y: i32| (y * side + x).cast_unsigned() as usize;
        let likely = walls.likely();
        let mut rows = likely.to_vec();
        for by in 1..BLOCK.cast_unsigned() as usize {
            for (to, from) in rows.iter_mut().zip(&likely[by..]) {
                *to = (*to).max(*from);
            }
        }
        let mut blocks = rows.clone();
        for by in 1..BLOCK {
            for (to, from) in blocks.iter_mut().zip(&rows[at(0, by)..]) {
                *to = (*to).max(*from);
            }
        }
        let width = side / BLOCK;
        let plane = |phase: i32| {
            let (px, py) = (phase % BLOCK, phase / BLOCK);
            let mut plane = Vec::with_capacity((width * width).cast_unsigned() as usize);
            for y in 0..width {
                let row = at(0, y * BLOCK + py)..at(width * BLOCK, y * BLOCK + py);
                let (fours, _) = blocks[row].as_chunks::<{ BLOCK as usize }>();
                plane.extend(fours.iter().map(|four| four[px.cast_unsigned() as usize]));
            }
            plane
        };
        let planes = (0..BLOCK * BLOCK).map(plane).collect();
        Self { planes, width }
    }
}

/// The spots at one heading, as cells relative to the lower left corner of the window.
struct Turned {
    theta: f64,
    starts: Vec<[i32; 2]>,
}

/// The best pose of each block, the best first; poses next to a better pose are included. The flag
/// says that there were too many blocks to examine all.
pub(crate) fn search(
    walls: &Surfels,
    bounds: &Bounds,
    spots: &[Spot],
    middle: Pose,
    wide: &Wide,
) -> (Vec<Candidate>, bool) {
    let spots = some_of(spots, SPOTS_MAX);
    let reach = (cell(metres(wide.reach_m)) / BLOCK + 1) * BLOCK;
    let step = step_for(&spots);
    let turns = whole(libm::ceil(wide.turn / step));
    let all: Vec<Turned> = (-turns..=turns)
        .map(|turn| {
            turned(
                walls,
                &spots,
                middle,
                middle.theta + f64::from(turn) * step,
                reach,
            )
        })
        .collect();
    let least = floor_of(wide.floor, spots.len());
    let mut queue = Vec::new();
    for (number, turned) in all.iter().enumerate() {
        bound(bounds, turned, reach, least, |sum, x, y| {
            queue.push((sum, number, x, y))
        });
    }
    queue.sort_by(|a, b| b.0.cmp(&a.0).then((a.1, a.2, a.3).cmp(&(b.1, b.2, b.3))));
    let scale = 1.0 / (255.0 * spots.len().max(1) as f64);
    let mut found: Vec<Candidate> = Vec::new();
    let mut best = 0.0_f64;
    for (looked, (sum, number, x, y)) in queue.iter().enumerate() {
        if f64::from(*sum) * scale < 0.8 * best {
            break;
        }
        if looked >= BLOCKS_MAX {
            found.sort_by(|a, b| b.score.total_cmp(&a.score));
            return (found, true);
        }
        let (sum, x, y) = look_into(walls, &all[*number], *x, *y);
        let score = f64::from(sum) * scale;
        best = best.max(score);
        let to_m = |cells: i32| f64::from((cells - reach) as f32 * CELL_M);
        let pose = Pose::new(
            middle.x + to_m(x),
            middle.y + to_m(y),
            wrap_angle(all[*number].theta),
        );
        found.push(Candidate { pose, score });
    }
    found.retain(|one| one.score >= wide.floor);
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    (found, false)
}

#[expect(clippy::cast_possible_truncation, reason = "metres of a building")]
const fn metres(of: f64) -> f32 {
    of as f32
}

#[expect(clippy::cast_possible_truncation, reason = "a few dozen")]
const fn whole(of: f64) -> i32 {
    of as i32
}

#[expect(clippy::cast_possible_truncation, reason = "a few thousand")]
#[expect(clippy::cast_sign_loss, reason = "not negative")]
fn floor_of(floor: f64, spots: usize) -> u16 {
    (floor.clamp(0.0, 1.0) * 255.0 * spots as f64) as u16
}

/// The heading step that moves a spot at the mean distance by one cell.
pub(crate) fn step_for(spots: &[Spot]) -> f64 {
    let sum: f32 = spots
        .iter()
        .map(|spot| crate::mapping::cloud::gap(spot.at, [0.0; 2]))
        .sum();
    let mean = f64::from(sum) / spots.len().max(1) as f64;
    (f64::from(CELL_M) / mean.max(1.0)).clamp(0.012, 0.035)
}

fn turned(walls: &Surfels, spots: &[Spot], middle: Pose, theta: f64, reach: i32) -> Turned {
    let frame = Frame::new(Pose { theta, ..middle });
    let corner = walls.corner();
    let inside = 0..walls.side() - 2 * reach - SPAN;
    let starts = spots.iter().map(|spot| {
        let at = frame.place(spot.at);
        [
            cell(at[0]) - corner[0] - reach,
            cell(at[1]) - corner[1] - reach,
        ]
    });
    let starts = starts.filter(|[x, y]| inside.contains(x) && inside.contains(y));
    Turned {
        theta,
        starts: starts.collect(),
    }
}

/// Passes on the blocks that may reach `least`: sum, and cells from the corner of the window.
fn bound(
    bounds: &Bounds,
    turned: &Turned,
    reach: i32,
    least: u16,
    mut tell: impl FnMut(u16, i32, i32),
) {
    let blocks = 2 * reach / BLOCK + 1;
    let starts: Vec<(usize, usize)> = turned
        .starts
        .iter()
        .map(|[x, y]| {
            let phase = (y % BLOCK) * BLOCK + x % BLOCK;
            let flat = (y / BLOCK) * bounds.width + x / BLOCK;
            (
                phase.cast_unsigned() as usize,
                flat.cast_unsigned() as usize,
            )
        })
        .collect();
    for row in 0..blocks {
        for first in (0..blocks).step_by(LANES) {
            let offset = (row * bounds.width + first).cast_unsigned() as usize;
            let mut sums = [0_u16; LANES];
            for (phase, flat) in &starts {
                let from = flat + offset;
                let plane = &bounds.planes[*phase];
                let Some(cells) = plane
                    .get(from..)
                    .and_then(|cells| cells.first_chunk::<LANES>())
                else {
                    continue;
                };
                for (sum, cell) in sums.iter_mut().zip(cells) {
                    *sum = sum.wrapping_add(u16::from(*cell));
                }
            }
            for (column, sum) in (first..blocks).zip(sums) {
                if sum >= least {
                    tell(sum, column * BLOCK, row * BLOCK);
                }
            }
        }
    }
}

/// The best pose in a block.
fn look_into(walls: &Surfels, turned: &Turned, x: i32, y: i32) -> (u16, i32, i32) {
    let side = walls.side();
    let likely = walls.likely();
    let mut sums = [[0_u16; BLOCK as usize]; BLOCK as usize];
    for start in &turned.starts {
        let flat = ((start[1] + y) * side + start[0] + x).cast_unsigned() as usize;
        for (row, sums) in sums.iter_mut().enumerate() {
            let from = flat + row * side.cast_unsigned() as usize;
            let cells = likely
                .get(from..)
                .and_then(|cells| cells.first_chunk::<4>());
            for (sum, cell) in sums.iter_mut().zip(cells.into_iter().flatten()) {
                *sum = sum.wrapping_add(u16::from(*cell));
            }
        }
    }
    let mut best = (0, x, y);
    for (dy, row) in (0..).zip(&sums) {
        for (dx, sum) in (0..).zip(row) {
            if *sum > best.0 {
                best = (*sum, x + dx, y + dy);
            }
        }
    }
    best
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "metres of a small room")]
mod tests {
    use super::*;
    use crate::mapping::cloud::Cloud;
    use emulators::rng::Rng;

    /// Random points, and the same points seen from another pose metres away. The pose is found to
    /// a cell and a step, and no other pose is nearly as good.
    #[test]
    fn a_place_is_found_in_a_wide_window_and_nothing_else() {
        let mut rng = Rng::stream(3, "test.branch");
        let mut point = || [0, 1].map(|_: u8| rng.range(-6.0, 6.0) as f32);
        let ends: Vec<[f32; 2]> = (0..200).map(|_| point()).collect();
        let mut walls = Surfels::around([0.0; 2], 25.0);
        walls.draw(Pose::default(), &Cloud::new(&ends));
        let here = Pose::new(1.7, -2.3, 0.21);
        let back = crate::mapping::motion::between(here, Pose::default());
        let frame = Frame::new(back);
        let spots: Vec<Spot> = ends
            .iter()
            .map(|at| Spot {
                at: frame.place(*at),
                normal: [0.0; 2],
                is_joined: false,
            })
            .collect();
        let wide = Wide {
            reach_m: 4.0,
            turn: 0.4,
            floor: 0.4,
        };
        let bounds = Bounds::of(&walls);
        let (found, is_cut) = search(&walls, &bounds, &spots, Pose::default(), &wide);
        let best = found[0];
        assert!(
            !is_cut && crate::mapping::motion::distance(best.pose, here) < 0.15,
            "{best:?}"
        );
        assert!((best.pose.theta - here.theta).abs() < 0.03);
        let rival = found
            .iter()
            .find(|one| crate::mapping::motion::distance(one.pose, here) > 0.5);
        assert!(
            rival.is_none_or(|rival| rival.score < 0.8 * best.score),
            "{rival:?}"
        );
    }

    /// A bound is never below the best pose in its block, for every block of random walls.
    #[test]
    fn no_bound_is_below_the_best_of_its_block() {
        let mut rng = Rng::stream(5, "test.bounds");
        let mut point = || [0, 1].map(|_: u8| rng.range(-3.0, 3.0) as f32);
        let ends: Vec<[f32; 2]> = (0..120).map(|_| point()).collect();
        let mut walls = Surfels::around([0.0; 2], 12.0);
        walls.draw(Pose::default(), &Cloud::new(&ends));
        let spots: Vec<Spot> = Cloud::new(&ends).spots().to_vec();
        let turned = turned(&walls, &spots, Pose::default(), 0.3, 16);
        let mut told = 0;
        bound(&Bounds::of(&walls), &turned, 16, 0, |sum, x, y| {
            told += 1;
            assert!(look_into(&walls, &turned, x, y).0 <= sum, "{x} {y}");
        });
        assert_eq!(told, 81);
    }
}
