//! The measures: runs in virtual time that give the values of a row.

mod car;
mod rescue;
mod yellow;

use core::fmt;

use engine::run::Outcome;
use engine::scenario::Scenario;

use super::super::Plan;
use super::super::runs::{each, start};
use super::Measured;

/// The model that is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// The rig's own.
    Sound,
    /// With the measure's planted change.
    Planted,
}

impl Model {
    /// The first value for the sound model, the second one for the planted change.
    fn pick<T>(self, sound: T, planted: T) -> T {
        match self {
            Self::Sound => sound,
            Self::Planted => planted,
        }
    }
}

/// Called with the number of finished runs, and of all runs.
type Told<'a> = dyn Fn(usize, usize) + Sync + 'a;

/// A measure.
#[derive(Clone, Copy)]
pub struct Measure {
    /// Its name, as in the file of the rows.
    pub name: &'static str,
    /// The planted change of the model.
    pub planted: &'static str,
    /// Performs the measurement.
    pub perform: fn(&Plan, Model, &Told<'_>) -> Measured,
}

impl fmt::Debug for Measure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Measure")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

/// All measures.
pub static MEASURES: &[Measure] = &[
    rescue::LIDAR,
    rescue::RANGE,
    rescue::RADIO,
    rescue::RAMP,
    rescue::FILTER,
    rescue::SMEAR,
    rescue::ODOMETER,
    rescue::POINTS,
    rescue::TURNING,
    rescue::STRAIGHT,
    rescue::WEIGHTS,
    rescue::TRIES,
    rescue::REGULATOR,
    rescue::PUSH,
    rescue::SEARCH_TIME,
    rescue::SEARCH_TIME_360,
    rescue::BYTES,
    rescue::BUILDING,
    rescue::TRANSFER,
    rescue::MISSION,
    rescue::CORRIDOR,
    rescue::PEOPLE,
    rescue::WINDING,
    rescue::LARGE,
    car::LEVELS,
    car::STEERING,
    car::DRIFT,
    car::PULSES,
    car::ENCODER,
    car::LINES,
    car::HALL,
    car::STOP,
    car::WALL,
    car::HEIGHTS,
    car::LOCALISED,
    car::MAPPING,
    car::MARKERS,
    car::GOAL,
    car::GATES,
    car::BLOCKED,
    yellow::ARRIVAL,
    yellow::THREADS,
    yellow::AVERAGING,
    yellow::LINES,
    yellow::REGIONS,
    yellow::LOCAL_MAP,
    yellow::GLOBAL_MAP,
    yellow::NEXT_VIEW,
    yellow::ROADMAP,
    yellow::LOST_COMMANDS,
    yellow::LOCALISED,
    yellow::REACTIVE,
    yellow::MARGIN,
];

/// Results of `work` for each seed of the plan.
fn by_seed<R: Send>(plan: &Plan, tell: &Told<'_>, work: impl Fn(u64) -> R + Sync) -> Vec<R> {
    let seeds: Vec<u64> = plan.seeds().collect();
    each(plan, &seeds, tell, |seed| work(*seed))
}

/// Results of `work` for each case and seed, as one list per case.
fn by_case<C: Copy + Sync, R: Send>(
    plan: &Plan,
    tell: &Told<'_>,
    cases: &[C],
    work: impl Fn(C, u64) -> R + Sync,
) -> Vec<Vec<R>> {
    let jobs: Vec<(C, u64)> = cases
        .iter()
        .flat_map(|case| plan.seeds().map(move |seed| (*case, seed)))
        .collect();
    let mut results = each(plan, &jobs, tell, |(case, seed)| work(*case, *seed)).into_iter();
    let count = plan.count();
    cases
        .iter()
        .map(|_| results.by_ref().take(count).collect())
        .collect()
}

/// The end of a run of a shipped scenario or another one of this crate.
fn mission(text: &str, seed: u64, change: impl FnOnce(&mut Scenario)) -> Outcome {
    start(text, seed, change).finish()
}

/// 1 if all checks of a run passed, else 0.
fn passed(outcome: &Outcome) -> f64 {
    f64::from(u8::from(outcome.passed()))
}

/// 1 if the check of this name passed, else 0.
fn check_passed(outcome: &Outcome, name: &str) -> f64 {
    use engine::run::check::Status;
    let mut checks = outcome.checks.iter().filter(|check| check.name == name);
    f64::from(u8::from(checks.any(|check| check.status == Status::Pass)))
}
