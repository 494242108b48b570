//! Monte-Carlo search: random candidates around a base pose, better ones become the base.

use super::matching::{Placement, Tally, tally};
use super::prior::Prior;
use super::random::Pcg32;
use super::settings::{Method, Settings};
use crate::grid::Grid;
use crate::pose::{Pose, normalised, sin_cos};

/// What a search works on.
pub(super) struct Task<'a> {
    /// The points of a usual try.
    pub(super) sparse: &'a [[i16; 2]],
    /// All points.
    pub(super) dense: &'a [[i16; 2]],
    /// Where the odometry says the robot is, and how surely.
    pub(super) prior: Prior,
    /// Usual tries that the time allows.
    pub(super) tries: u32,
}

/// What a search found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub(super) pose: Pose,
    /// Over the points of a usual try.
    pub(super) tally: Tally,
    pub(super) tries: u32,
    pub(super) points: u32,
}

/// Searches by the method of `settings`.
pub(super) fn run<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    settings: &Settings,
    task: &Task<'_>,
    random: &mut Pcg32,
) -> Found {
    match settings.search.method {
        Method::Document => document(grid, settings, task, random),
        Method::Annealed => annealed(grid, settings, task, random),
    }
}

/// The pose that candidates are drawn around, with its trigonometry done.
struct Base {
    pose: Pose,
    x_cells: f32,
    y_cells: f32,
    sin: f32,
    cos: f32,
}

impl Base {
    fn new(pose: Pose, resolution_mm: f32) -> Self {
        let (sin, cos) = sin_cos(pose.heading);
        Self {
            pose,
            x_cells: pose.x_mm / resolution_mm,
            y_cells: pose.y_mm / resolution_mm,
            sin,
            cos,
        }
    }
}

/// A shift from a base pose: millimetres of the world, radians.
#[derive(Clone, Copy)]
struct Shift {
    x_mm: f32,
    y_mm: f32,
    turn: f32,
}

impl Shift {
    const NONE: Self = Self {
        x_mm: 0.0,
        y_mm: 0.0,
        turn: 0.0,
    };
}

impl Base {
    fn pose(&self, shift: Shift) -> Pose {
        Pose {
            x_mm: self.pose.x_mm + shift.x_mm,
            y_mm: self.pose.y_mm + shift.y_mm,
            heading: normalised(self.pose.heading + shift.turn),
        }
    }

    #[inline]
    fn placement(&self, shift: Shift, cells_per_mm: f32) -> Placement {
        let (sin, cos) = small_sin_cos(shift.turn);
        Placement::from_parts(
            self.x_cells + shift.x_mm * cells_per_mm,
            self.y_cells + shift.y_mm * cells_per_mm,
            self.sin * cos + self.cos * sin,
            self.cos * cos - self.sin * sin,
        )
    }
}

/// Sine and cosine by the first terms of their series: exact to single precision up to half a
/// radian, and to the matcher's 14 places far beyond.
#[inline]
fn small_sin_cos(angle: f32) -> (f32, f32) {
    if angle.abs() > 0.5 {
        return sin_cos(angle);
    }
    let square = angle * angle;
    let sin = angle * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)));
    let cos = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0));
    (sin, cos)
}

/// The seed report's search.
fn document<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    settings: &Settings,
    task: &Task<'_>,
    random: &mut Pcg32,
) -> Found {
    let defects = settings.defects;
    let resolution_mm = grid.resolution_mm();
    let cells_per_mm = 1.0 / resolution_mm;
    let rank = |tally: Tally| -> i64 {
        if defects.outside_is_free {
            (i64::from(tally.sum) * 1024)
                .checked_div(i64::from(tally.inside))
                .unwrap_or(-1)
        } else {
            i64::from(tally.sum)
        }
    };
    let mut base = Base::new(task.prior.predicted, resolution_mm);
    let mut best = (
        base.pose,
        tally(
            grid.rows(),
            task.sparse,
            &Placement::new(base.pose, resolution_mm),
        ),
    );
    let mut spread = u32::from(settings.search.spread_mm);
    let mut spread_deg = u32::from(settings.search.spread_deg);
    for index in 0..task.tries {
        let shift = Shift {
            x_mm: offset(random, spread),
            y_mm: offset(random, spread),
            turn: offset(random, spread_deg).to_radians(),
        };
        let score = tally(
            grid.rows(),
            task.sparse,
            &base.placement(shift, cells_per_mm),
        );
        if rank(score) <= rank(best.1) {
            continue;
        }
        best = (base.pose(shift), score);
        if index > task.tries / 3 {
            base = Base::new(best.0, resolution_mm);
            if !defects.never_narrows {
                spread = (spread / 2).max(u32::from(!defects.spread_reaches_zero));
                spread_deg = (spread_deg / 2).max(u32::from(!defects.heading_spread_reaches_zero));
            }
        }
    }
    Found {
        pose: best.0,
        tally: best.1,
        tries: task.tries + 1,
        points: (task.tries + 1) * super::count_u32(task.sparse.len()),
    }
}

/// A whole number from `-spread` to `spread - 1`. With a spread of 0 the processor's remainder
/// gives the random number itself.
#[inline]
fn offset(random: &mut Pcg32, spread: u32) -> f32 {
    (i64::from(random.below(2 * spread)) - i64::from(spread)) as f32
}

/// Part of the tries that look around the prediction for the best region.
const WIDE_SHARE: f32 = 0.25;
/// Part of the tries whose cost is spent on looking at all points in the end.
const DENSE_SHARE: f32 = 0.35;
/// Spread at the end of the narrowing, as a part of the first spread.
const NARROWEST: f32 = 0.01;

/// The same idea, with the tries spent better: see [`Method::Annealed`].
fn annealed<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    settings: &Settings,
    task: &Task<'_>,
    random: &mut Pcg32,
) -> Found {
    let mut walk = Walk::new(grid, settings, task, random);
    let share = |part: f32| -> u32 {
        #[expect(clippy::cast_possible_truncation, reason = "tries are few")]
        let tries = (task.tries as f32 * part) as u32;
        tries
    };
    let dense_cost = super::count_u32(task.dense.len().div_ceil(task.sparse.len()));
    let dense_tries = share(DENSE_SHARE) / dense_cost.max(1);
    let wide_tries = share(WIDE_SHARE);
    let narrow_tries = task.tries.saturating_sub(wide_tries + share(DENSE_SHARE));

    walk.explore(task.sparse, wide_tries, 1.0, 1.0, Around::Prediction);
    walk.explore(
        task.sparse,
        narrow_tries,
        0.4,
        3.0 * NARROWEST,
        Around::Best,
    );
    walk.explore(
        task.dense,
        dense_tries,
        4.0 * NARROWEST,
        NARROWEST,
        Around::Best,
    );
    walk.found()
}

/// What candidates are drawn around.
#[derive(Clone, Copy, PartialEq)]
enum Around {
    Prediction,
    Best,
}

/// The state of an annealed search.
struct Walk<'a, const W: usize, const H: usize> {
    grid: &'a Grid<W, H>,
    settings: &'a Settings,
    task: &'a Task<'a>,
    random: &'a mut Pcg32,
    base: Base,
    tries: u32,
    points: u32,
}

impl<'a, const W: usize, const H: usize> Walk<'a, W, H> {
    fn new(
        grid: &'a Grid<W, H>,
        settings: &'a Settings,
        task: &'a Task<'a>,
        random: &'a mut Pcg32,
    ) -> Self {
        let base = Base::new(task.prior.predicted, grid.resolution_mm());
        Self {
            grid,
            settings,
            task,
            random,
            base,
            tries: 0,
            points: 0,
        }
    }

    /// Tries candidates whose spread falls evenly in its logarithm from `first` to `last` parts
    /// of the settings' spread.
    fn explore(&mut self, points: &[[i16; 2]], tries: u32, first: f32, last: f32, around: Around) {
        if tries == 0 {
            return;
        }
        let cells_per_mm = 1.0 / self.grid.resolution_mm();
        let spread = self.settings.search;
        let (spread_mm, spread_rad) = (
            f32::from(spread.spread_mm),
            f32::from(spread.spread_deg).to_radians(),
        );
        let shrink = libm::powf(last / first, 1.0 / tries as f32);
        let mut scale = first;
        let mut best = (
            self.base.pose,
            self.rate(
                points,
                self.base.pose,
                &self.base.placement(Shift::NONE, cells_per_mm),
            ),
        );
        for _ in 0..tries {
            let shift = Shift {
                x_mm: self.random.symmetric() * spread_mm * scale,
                y_mm: self.random.symmetric() * spread_mm * scale,
                turn: self.random.symmetric() * spread_rad * scale,
            };
            let pose = self.base.pose(shift);
            let rating = self.rate(points, pose, &self.base.placement(shift, cells_per_mm));
            if rating > best.1 {
                best = (pose, rating);
                if around == Around::Best {
                    self.base = Base::new(pose, self.grid.resolution_mm());
                }
            }
            scale *= shrink;
        }
        self.base = Base::new(best.0, self.grid.resolution_mm());
        self.tries += tries + 1;
        self.points += (tries + 1) * super::count_u32(points.len());
    }

    /// Mean map value at the points, less what the way from the prediction costs.
    fn rate(&self, points: &[[i16; 2]], pose: Pose, placement: &Placement) -> f32 {
        let tally = tally(self.grid.rows(), points, placement);
        tally.sum as f32 / points.len() as f32 - self.task.prior.cost(pose)
    }

    fn found(self) -> Found {
        let placement = Placement::new(self.base.pose, self.grid.resolution_mm());
        Found {
            pose: self.base.pose,
            tally: tally(self.grid.rows(), self.task.sparse, &placement),
            tries: self.tries,
            points: self.points,
        }
    }
}
