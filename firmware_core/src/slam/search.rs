//! The seed report's Monte-Carlo search: random candidates around a base pose; in the last two
//! thirds of the tries a better one becomes the base and halves the spread.

use super::matching::{Placement, Tally, tally};
use super::random::Pcg32;
use super::settings::{Defects, Settings};
use crate::grid::Grid;
use crate::pose::{Pose, normalised, sin_cos};

/// What a search found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub(super) pose: Pose,
    /// Over all points.
    pub(super) tally: Tally,
    pub(super) tries: u32,
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

/// Tries `tries` candidates around `predicted`.
pub(super) fn run<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    settings: &Settings,
    points: &[[i16; 2]],
    predicted: Pose,
    tries: u32,
    random: &mut Pcg32,
) -> Found {
    let defects = settings.defects;
    let resolution_mm = grid.resolution_mm();
    let cells_per_mm = 1.0 / resolution_mm;
    let mut base = Base::new(predicted, resolution_mm);
    let here = Placement::new(predicted, resolution_mm);
    let mut best = (predicted, tally(grid.rows(), points, &here));
    let mut spread = u32::from(settings.search.spread_mm);
    let mut spread_deg = u32::from(settings.search.spread_deg);
    for index in 0..tries {
        let shift = Shift {
            x_mm: offset(random, spread),
            y_mm: offset(random, spread),
            turn: offset(random, spread_deg).to_radians(),
        };
        let found = tally(grid.rows(), points, &base.placement(shift, cells_per_mm));
        if rank(found, defects) <= rank(best.1, defects) {
            continue;
        }
        best = (base.pose(shift), found);
        if index > tries / 3 {
            base = Base::new(best.0, resolution_mm);
            if !defects.never_narrows {
                spread = halved(spread, defects.spread_reaches_zero);
                spread_deg = halved(spread_deg, defects.heading_spread_reaches_zero);
            }
        }
    }
    Found {
        pose: best.0,
        tally: best.1,
        tries: tries.saturating_add(1),
    }
}

/// What candidates are compared by: the mean over all points, or over those on the map (SL-10).
#[inline]
fn rank(tally: Tally, defects: Defects) -> i64 {
    if defects.outside_is_free {
        (i64::from(tally.sum) * 1024)
            .checked_div(i64::from(tally.inside))
            .unwrap_or(-1)
    } else {
        i64::from(tally.sum)
    }
}

const fn halved(spread: u32, reaches_zero: bool) -> u32 {
    match spread / 2 {
        0 if !reaches_zero => 1,
        half => half,
    }
}

/// A whole number from `-spread` to `spread - 1`. With a spread of 0 the processor's remainder
/// gives the random number itself.
#[inline]
fn offset(random: &mut Pcg32, spread: u32) -> f32 {
    (i64::from(random.below(2 * spread)) - i64::from(spread)) as f32
}
