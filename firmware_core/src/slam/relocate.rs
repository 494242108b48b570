//! Where in the whole map a scan belongs: for a robot that was carried away. Blocks of cells are
//! rated by a bound that no pose inside them exceeds (Olson 2009; Hess et al. 2016), the best of
//! them, apart from each other, are searched whole. If a second place fits nearly as well as the
//! first, the answer is that it cannot be known.

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

/// What is known about the place of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Answer {
    /// One place fits best.
    Here(Best),
    /// Several places fit about equally well; this is one of them.
    Ambiguous(Best),
}

/// Blocks of the coarse map at most, and along an edge.
const BLOCKS_MAX: usize = 6144;
const EDGE_MAX: usize = 128;
/// Headings of the coarse search.
const HEADINGS: u16 = 180;
const HEADING_STEP: f32 = TAU / 180.0;
/// Points of the coarse search.
const COARSE_POINTS: usize = 48;
/// Places that are looked at closely.
const PLACES: usize = 24;
/// Places nearer than this, in blocks and headings, are one.
const APART_BLOCKS: i32 = 4;
const APART_HEADINGS: i32 = 8;
/// A second place at which the points agree to this part of the first's makes the answer ambiguous.
/// The sums do not tell: a map is drawn better where the robot was nearer.
const AMBIGUOUS: f32 = 0.92;

/// Where a robot is that was lost on a way of which only the length is known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bound {
    /// Where it was lost.
    pub(super) centre: Pose,
    /// How far from there it is at most.
    pub(super) mm: f32,
    /// How far it has turned at most.
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

/// Block maxima of a grid: each the greatest value of its block and its three neighbours to the
/// right and above, so that it bounds every cell that a point can reach from within a block.
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

/// The best candidates that lie apart from each other.
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
        // It replaces what it is the better neighbour of, else the last.
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

/// The candidates within `bound`, a block and a heading around it included.
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
