//! Many parallel runs, and statistics over them.

use core::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Mutex;
use std::thread;

use super::Plan;
use engine::run::Run;
use engine::scenario::Scenario;
use engine::workers;

/// The flat of the demo, 3 m x 3 m.
pub(super) const FLAT: &str = include_str!("../../scenarios/rescue-flat.toml");

/// Results of `work` for each of `jobs`, in their order.
pub(super) fn each<J: Sync, R: Send>(
    plan: &Plan,
    jobs: &[J],
    tell: &(dyn Fn(usize, usize) + Sync),
    work: impl Fn(&J) -> R + Sync,
) -> Vec<R> {
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let results: Mutex<Vec<Option<R>>> = Mutex::new(jobs.iter().map(|_| None).collect());
    let worker = || {
        while let Some((index, job)) = {
            let index = next.fetch_add(1, Ordering::Relaxed);
            jobs.get(index).map(|job| (index, job))
        } {
            let result = work(job);
            if let Ok(mut results) = results.lock() {
                results[index] = Some(result);
            }
            tell(done.fetch_add(1, Ordering::Relaxed) + 1, jobs.len());
        }
    };
    thread::scope(|scope| {
        for _ in 0..plan.jobs.clamp(1, jobs.len().max(1)) {
            workers::spawn(scope, worker);
        }
    });
    let results = results.into_inner().unwrap_or_default();
    results.into_iter().flatten().collect()
}

/// Starts a run of `text`, a valid scenario of this crate.
pub(super) fn start(text: &str, seed: u64, change: impl FnOnce(&mut Scenario)) -> Run {
    let (mut scenario, source) = Scenario::from_text(text).expect("a sound scenario");
    change(&mut scenario);
    Run::new(scenario, &source, Some(seed)).expect("can be wired")
}

/// Median, lower and upper quartile, minimum and maximum; NaN without values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spread {
    pub(super) median: f64,
    pub(super) quartiles: [f64; 2],
    pub(super) worst: f64,
}

impl Spread {
    pub(super) fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let last = values.len().saturating_sub(1) as f64;
            let place = share * last;
            #[expect(clippy::cast_possible_truncation, reason = "an index")]
            #[expect(clippy::cast_sign_loss, reason = "an index")]
            let low = place.floor() as usize;
            let value = |index: usize| values.get(index).copied();
            let (Some(below), above) = (value(low), value(low + 1)) else {
                return f64::NAN;
            };
            below + (above.unwrap_or(below) - below) * (place - place.floor())
        };
        Self {
            median: at(0.5),
            quartiles: [at(0.25), at(0.75)],
            worst: at(1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 1, 2, 3, 10, the median lies between the second and the third; the lower quartile, at a
    /// quarter of three steps, is 1.75.
    #[test]
    fn medians_and_quartiles_lie_between_values() {
        let spread = Spread::of([10.0, 1.0, f64::NAN, 3.0, 2.0]);
        assert_eq!((spread.median, spread.worst), (2.5, 10.0));
        assert_eq!(spread.quartiles, [1.75, 4.75]);
        assert!(Spread::of([]).median.is_nan());
    }

    #[test]
    fn results_keep_the_order_of_their_jobs() {
        let plan = Plan {
            first_seed: 1,
            seeds: 1,
            jobs: 3,
        };
        let jobs: Vec<u64> = (0..20).collect();
        let squares = each(&plan, &jobs, &|_, _| {}, |job| job * job);
        assert!(squares.into_iter().eq((0..20).map(|n: u64| n * n)));
    }
}
