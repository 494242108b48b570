//! The best alignments of spots with walls in a window.

use emulators::world::wrap_angle;

use crate::mapping::align::{Fit, Prior, align};
use crate::mapping::cloud::Spot;
use crate::mapping::correlate::{Candidate, REACH_MAX, Window, search};
use crate::mapping::motion::distance;
use crate::mapping::surfels::{CELL_M, Surfels};

/// Number of poses that are aligned in detail.
const TRIES: usize = 4;

/// Reduction of the score per squared standard deviation from the odometry.
const COST: f64 = 0.01;

/// The window of `sigmas` standard deviations.
pub(super) fn window(prior: &Prior, step: f64, sigmas: f64) -> Window {
    let [metres, radians] = prior.deviation;
    let count = |of: f64, most: f64| {
        #[expect(clippy::cast_possible_truncation, reason = "clamped")]
        let count = libm::ceil(of).clamp(1.0, most) as i32;
        count
    };
    Window {
        reach: count(sigmas * metres / f64::from(CELL_M), f64::from(REACH_MAX)),
        turns: count(sigmas * radians / step, 40.0),
        step,
    }
}

/// The best alignment in the window.
pub(super) fn best_fit(walls: &Surfels, spots: &[Spot], window: &Window, prior: &Prior) -> Fit {
    best_and_others(walls, spots, window, prior).0
}

/// The best alignment in the window, and the others.
pub(super) fn best_and_others(
    walls: &Surfels,
    spots: &[Spot],
    window: &Window,
    prior: &Prior,
) -> (Fit, Vec<Fit>) {
    let rating = |fit: &Fit| fit.score - COST * prior.off(fit.pose).min(25.0);
    let mut best = align(walls, spots, prior.pose, prior);
    let mut others = Vec::new();
    let mut tried: Vec<Candidate> = Vec::new();
    for one in search(walls, spots, window, prior) {
        let is_summit = |other: &Candidate| {
            let turn = wrap_angle(one.pose.theta - other.pose.theta).abs();
            distance(one.pose, other.pose) > 0.25 || turn > 2.5 * window.step
        };
        let is_high = tried
            .first()
            .is_none_or(|best| one.score > 0.85 * best.score);
        if !is_high || tried.len() >= TRIES {
            break;
        }
        if !tried.iter().all(is_summit) {
            continue;
        }
        tried.push(one);
        let fit = align(walls, spots, one.pose, prior);
        if rating(&fit) > rating(&best) {
            others.push(core::mem::replace(&mut best, fit));
        } else {
            others.push(fit);
        }
    }
    (best, others)
}
