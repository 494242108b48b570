//! Search of the whole map for a scan's pose, for a robot that was carried away. Blocks of cells
//! are rated by an upper bound of the score of all poses inside them (Olson 2009; Hess et al.
//! 2016). The best blocks that lie apart from each other are searched completely. If a second pose
//! fits nearly as well as the first, the answer is ambiguous.

use core::f32::consts::TAU;

use super::correlate::{Best, search};
use super::effort::Effort;
use super::evidence::Evidence;
use super::matching::Placement;
use super::prior::Prior;
use super::row::POINTS_MAX;
use super::window::Window;
use crate::grid::Grid;
use crate::pose::{Pose, normalised};

/// Result of a search for the position of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Answer {
    /// One pose fits best.
    Here(Best),
    /// Several poses fit about equally well; this is one of them.
    Ambiguous(Best),
}

/// Maximum number of blocks of the coarse map, in total and along an edge.
const BLOCKS_MAX: usize = 6144;
const EDGE_MAX: usize = 128;
/// Headings of the coarse search.
const HEADINGS: u16 = 180;
const HEADING_STEP: f32 = TAU / 180.0;
/// Points of the coarse search.
const COARSE_POINTS: usize = 48;
/// Number of candidates that are searched closely.
const PLACES: usize = 24;
/// Candidates nearer than this, in blocks and headings, are the same.
const APART_BLOCKS: i32 = 4;
const APART_HEADINGS: i32 = 8;
/// Ratio of the agreements of the second and the first pose from which the answer is ambiguous. The
/// sums are no measure, because the map is drawn better where the robot was nearer.
const AMBIGUOUS: f32 = 0.92;

/// Area of a robot that was lost on a path of known length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bound {
    /// Pose at which the robot was lost.
    pub(super) centre: Pose,
    /// Maximum distance from there.
    pub(super) mm: f32,
    /// Maximum turn.
    pub(super) rad: f32,
}

impl Bound {
    fn holds(&self, pose: Pose) -> bool {
        self.holds_place(pose, 0.0) && self.holds_heading(pose.heading, 0.0)
    }

    fn holds_place(&self, place: Pose, margin_mm: f32) -> bool {
        self.centre.position().distance_mm(place.position()) <= self.mm + margin_mm
    }

    fn holds_heading(&self, heading: f32, margin_rad: f32) -> bool {
        normalised(self.centre.heading - heading).abs() <= self.rad + margin_rad
    }
}

/// Block maxima of a grid: each is the greatest value of its block and its three neighbours to the
/// right and above. It therefore bounds every cell that a point can reach from within a block.
struct Coarse {
    cells: [u8; BLOCKS_MAX],
    block: usize,
    width: usize,
    height: usize,
}

/// A size as a coordinate.
fn coordinate(size: usize) -> i32 {
    i32::try_from(size).expect("maps have at most 8191 cells along an edge")
}

impl Coarse {
    fn new<const W: usize, const H: usize>(grid: &Grid<W, H>) -> Self {
        let mut block = 2;
        while W.div_ceil(block) * H.div_ceil(block) > BLOCKS_MAX
            || W.max(H).div_ceil(block) > EDGE_MAX
        {
            block *= 2;
        }
        let (width, height) = (W.div_ceil(block), H.div_ceil(block));
        let mut coarse = Self {
            cells: [0; BLOCKS_MAX],
            block,
            width,
            height,
        };
        for (y, row) in grid.rows().iter().enumerate() {
            let blocks = &mut coarse.cells[y / block * width..][..width];
            for (cell, values) in blocks.iter_mut().zip(row.chunks(block)) {
                *cell = values
                    .iter()
                    .fold(*cell, |greatest, value| greatest.max(*value));
            }
        }
        // In this order every neighbour still holds its own block's maximum.
        for y in 0..height {
            for x in 0..width {
                let at = |x: usize, y: usize| {
                    if x < width && y < height {
                        coarse.cells[y * width + x]
                    } else {
                        0
                    }
                };
                let greatest = at(x, y)
                    .max(at(x + 1, y))
                    .max(at(x, y + 1))
                    .max(at(x + 1, y + 1));
                coarse.cells[y * width + x] = greatest;
            }
        }
        coarse
    }

    /// Bounds of the blocks of row `y`, for points at these distances in blocks.
    fn bounds(&self, offsets: &[(i32, i32)], y: i32) -> [u16; EDGE_MAX] {
        let mut bounds = [0; EDGE_MAX];
        let width = coordinate(self.width);
        for (dx, dy) in offsets {
            let row = y + dy;
            let (first, last) = ((-dx).max(0), (width - dx).min(width));
            if row < 0 || row >= coordinate(self.height) || first >= last {
                continue;
            }
            let from = (row * width + first + dx).unsigned_abs() as usize;
            let count = (last - first).unsigned_abs() as usize;
            let cells = &self.cells[from..from + count];
            let bounds = &mut bounds[first.unsigned_abs() as usize..][..count];
            for (bound, cell) in bounds.iter_mut().zip(cells) {
                *bound += u16::from(*cell);
            }
        }
        bounds
    }
}

/// A block and heading worth a closer look.
#[derive(Clone, Copy, Debug, Default)]
struct Candidate {
    bound: u16,
    x: i32,
    y: i32,
    heading: i32,
}

impl Candidate {
    /// The middle of the block.
    fn centre(&self, block_mm: f32) -> Pose {
        Pose::new(
            (self.x as f32 + 0.5) * block_mm,
            (self.y as f32 + 0.5) * block_mm,
            heading_of(self.heading),
        )
    }
}

/// The best candidates, apart from each other.
#[derive(Default)]
struct Shortlist {
    best: [Candidate; PLACES],
}

impl Shortlist {
    fn offer(&mut self, new: Candidate) {
        if new.bound <= self.best[PLACES - 1].bound {
            return;
        }
        let headings = i32::from(HEADINGS);
        let same = |old: &Candidate| {
            let turn = (old.heading - new.heading).rem_euclid(headings);
            (old.x - new.x).abs() < APART_BLOCKS
                && (old.y - new.y).abs() < APART_BLOCKS
                && turn.min(headings - turn) < APART_HEADINGS
        };
        // The new candidate replaces its worse neighbour, else the last one.
        let place = match self.best.iter().position(same) {
            Some(at) if self.best[at].bound >= new.bound => return,
            Some(at) => at,
            None => PLACES - 1,
        };
        self.best[place] = new;
        let above = self.best[..place]
            .iter()
            .take_while(|old| old.bound >= new.bound)
            .count();
        self.best[above..=place].rotate_right(1);
    }
}

/// Searches the whole map; `None` without points, or if nothing fits within `bound`.
pub(super) fn relocate<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    points: &[[i16; 2]],
    bound: Option<Bound>,
    effort: &mut Effort,
) -> Option<Answer> {
    let points = &points[..points.len().min(POINTS_MAX)];
    if points.is_empty() {
        return None;
    }
    let coarse = Coarse::new(grid);
    let block_mm = coarse.block as f32 * grid.resolution_mm();
    let shortlist = shortlist(&coarse, block_mm, points, bound, effort);
    let window = Window {
        reach: coordinate(coarse.block) / 2 + 2,
        turns: 4,
        turn_step: 0.5_f32.to_radians(),
    };
    let mut found = [None; PLACES];
    for (found, candidate) in found.iter_mut().zip(&shortlist.best) {
        if candidate.bound == 0 {
            break;
        }
        let centre = candidate.centre(block_mm);
        let best = search(grid, points, centre, &window, &Prior::none(centre), effort);
        if bound.is_none_or(|bound| bound.holds(best.pose)) {
            *found = Some((best, Evidence::of(grid, points, best.pose)));
        }
    }
    let (first, evidence) = found.iter().flatten().max_by_key(|(best, _)| best.sum)?;
    let is_rival = |(best, other): &(Best, Evidence)| {
        let (a, b) = (first.pose, best.pose);
        let is_elsewhere = a.position().distance_mm(b.position()) > 3.0 * block_mm
            || normalised(a.heading - b.heading).abs() > 0.2;
        is_elsewhere && other.is_broad() && other.agreement() >= AMBIGUOUS * evidence.agreement()
    };
    let is_ambiguous = found.iter().flatten().any(is_rival);
    Some(if is_ambiguous {
        Answer::Ambiguous(*first)
    } else {
        Answer::Here(*first)
    })
}

/// The candidates within `bound`, with a margin of a block and a heading.
fn shortlist(
    coarse: &Coarse,
    block_mm: f32,
    points: &[[i16; 2]],
    bound: Option<Bound>,
    effort: &mut Effort,
) -> Shortlist {
    let mut shortlist = Shortlist::default();
    let taken = points.len().min(COARSE_POINTS);
    let cells_per_block = coordinate(coarse.block);
    let is_in_reach = |heading: &i32| {
        bound.is_none_or(|bound| bound.holds_heading(heading_of(*heading), HEADING_STEP))
    };
    for heading in (0..i32::from(HEADINGS)).filter(is_in_reach) {
        let turned = Placement::new(Pose::new(0.0, 0.0, heading_of(heading)), 1.0);
        let mut offsets = [(0, 0); COARSE_POINTS];
        for (index, offset) in offsets[..taken].iter_mut().enumerate() {
            let (x, y) = turned.cell(points[index * points.len() / taken]);
            *offset = (x.div_euclid(cells_per_block), y.div_euclid(cells_per_block));
        }
        effort.placed(super::count_u32(taken));
        for y in 0..coordinate(coarse.height) {
            let bounds = coarse.bounds(&offsets[..taken], y);
            for (x, most) in (0..).zip(&bounds[..coarse.width]) {
                let candidate = Candidate {
                    bound: *most,
                    x,
                    y,
                    heading,
                };
                let centre = candidate.centre(block_mm);
                if bound.is_none_or(|bound| bound.holds_place(centre, 2.0 * block_mm)) {
                    shortlist.offer(candidate);
                }
            }
        }
        let rows = super::count_u32(coarse.height) * super::count_u32(coarse.width.div_ceil(32));
        effort.rows(rows, 32, super::count_u32(taken));
    }
    shortlist
}

fn heading_of(index: i32) -> f32 {
    normalised(index as f32 * HEADING_STEP)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::boxed::Box;

    use super::*;

    /// Pseudo-random values: Knuth's hash of the position.
    fn value(x: usize, y: usize) -> u8 {
        let hash = (x * 31 + y * 1_009 + 7).wrapping_mul(2_654_435_761);
        u8::try_from(hash >> 8 & 0x7F).unwrap()
    }

    fn grid<const W: usize, const H: usize>() -> Box<Grid<W, H>> {
        let mut grid = Box::new(Grid::new(50.0));
        for y in 0..H {
            for x in 0..W {
                grid.set(x, y, value(x, y));
            }
        }
        grid
    }

    /// Each block by hand: the greatest value of all cells in it and its three neighbours to the
    /// right and above.
    fn is_bound<const W: usize, const H: usize>(block: usize) {
        let coarse = Coarse::new(&grid::<W, H>());
        assert_eq!(coarse.block, block);
        let size = (W.div_ceil(block), H.div_ceil(block));
        assert_eq!((coarse.width, coarse.height), size);
        for y in 0..size.1 {
            for x in 0..size.0 {
                let ys = y * block..H.min((y + 2) * block);
                let all = ys.flat_map(|y| {
                    let xs = x * block..W.min((x + 2) * block);
                    xs.map(move |x| value(x, y))
                });
                assert_eq!(Some(coarse.cells[y * size.0 + x]), all.max(), "{x} {y}");
            }
        }
    }

    /// 150 x 150 blocks of two cells are too many, and so are 150 along one edge; 128 are allowed.
    #[test]
    fn a_block_bounds_what_can_be_reached_from_it() {
        is_bound::<20, 13>(2);
        is_bound::<256, 3>(2);
        is_bound::<258, 3>(4);
        is_bound::<3, 258>(4);
        is_bound::<160, 160>(4);
    }

    /// The bound of a block is the sum of the blocks at the offsets; blocks outside count as 0.
    #[test]
    fn bounds_are_sums_over_the_points() {
        let coarse = Coarse::new(&grid::<20, 13>());
        let offsets = [
            (0, 0),
            (-3, 1),
            (4, -2),
            (9, 0),
            (-9, 6),
            (10, 0),
            (-10, 0),
            (0, -7),
        ];
        for y in 0..7 {
            let bounds = coarse.bounds(&offsets, y);
            for (x, bound) in (0..10).zip(bounds) {
                let cells = offsets.iter().map(|(dx, dy)| (x + dx, y + dy));
                let inside = cells.filter(|(x, y)| (0..10).contains(x) && (0..7).contains(y));
                let index = |(x, y): (i32, i32)| usize::try_from(y * 10 + x).unwrap();
                let sum: u16 = inside.map(|at| u16::from(coarse.cells[index(at)])).sum();
                assert_eq!(bound, sum, "{x} {y}");
            }
        }
    }

    fn offered(candidates: &[(u16, i32, i32, i32)]) -> [Candidate; PLACES] {
        let mut list = Shortlist::default();
        for &(bound, x, y, heading) in candidates {
            list.offer(Candidate {
                bound,
                x,
                y,
                heading,
            });
        }
        list.best
    }

    fn bounds(candidates: &[(u16, i32, i32, i32)]) -> [u16; 3] {
        let best = offered(candidates);
        [0, 1, 2].map(|at: usize| best[at].bound)
    }

    /// Candidates nearer than four blocks and eight headings are the same, and the best is kept;
    /// headings close to a circle of 180.
    #[test]
    fn the_shortlist_keeps_the_best_of_each_place() {
        let first = (10, 0, 0, 0);
        assert_eq!(bounds(&[first, (20, 9, 0, 0), (15, 3, -3, 7)]), [20, 15, 0]);
        assert_eq!(bounds(&[(15, 0, 0, 0), (14, -3, 3, 173)]), [15, 0, 0]);
        for apart in [(9, 4, 0, 0), (9, 0, -4, 0), (9, 0, 0, 8), (9, 0, 0, 172)] {
            assert_eq!(bounds(&[first, apart]), [10, 9, 0], "{apart:?}");
        }
        assert_eq!(bounds(&[(10, 0, 0, 2), (12, 0, 0, 177)]), [12, 0, 0]);
        assert_eq!(bounds(&[(10, 5, 7, 100), (12, 6, 8, 103)]), [12, 0, 0]);
        assert_eq!(bounds(&[(10, -5, -7, 100), (12, -9, -7, 103)]), [12, 10, 0]);
        // More candidates than there is room for: the worst are left out.
        let many: std::vec::Vec<_> = (1..=26).map(|at| (at, i32::from(at) * 5, 0, 0)).collect();
        let found = offered(&many).map(|one| one.bound);
        let expected: std::vec::Vec<u16> = (3..=26).rev().collect();
        assert_eq!(found[..], expected);
    }

    /// The robot was lost at (1, 1) m with a heading of 3.1 rad, which is across pi from -3.1. The
    /// allowed difference is 0.5 m and 0.2 rad.
    #[test]
    fn a_robot_that_drove_a_known_way_is_within_it() {
        let bound = Bound {
            centre: Pose::new(1_000.0, 1_000.0, 3.1),
            mm: 500.0,
            rad: 0.2,
        };
        let holds = |x_mm, heading| bound.holds(Pose::new(x_mm, 1_000.0, heading));
        assert!(holds(1_499.0, 3.1) && holds(501.0, -3.1) && holds(1_000.0, 2.91));
        assert!(!holds(1_501.0, 3.1) && !holds(499.0, 3.1) && !holds(1_000.0, 2.89));
        assert!(!holds(1_000.0, -2.9));
        let place = Pose::new(1_000.0, 1_515.0, 0.0);
        assert!(bound.holds_place(place, 20.0) && !bound.holds_place(place, 10.0));
        assert!(bound.holds_heading(2.89, 0.02) && !bound.holds_heading(2.87, 0.02));
    }

    /// Headings are 2 degrees apart; a block's middle is half a block from its corner.
    #[test]
    fn a_candidate_is_the_middle_of_its_block() {
        let candidate = Candidate {
            bound: 1,
            x: 3,
            y: -1,
            heading: 45,
        };
        let centre = candidate.centre(100.0);
        assert_eq!((centre.x_mm, centre.y_mm), (350.0, -50.0));
        assert!((centre.heading.to_degrees() - 90.0).abs() < 1e-3);
        assert!((heading_of(135).to_degrees() + 90.0).abs() < 1e-3);
    }
}
