//! Time and quality of the search by its number of tries, its points and the weight of turns.

use core::time::Duration;

use engine::rig::cpu::CpuModel;
use engine::scenario::tuning::FadingSpec;
use engine::scenario::{CpuSpec, TuningSpec};
use protocols::Instant;

use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::rescue::as_reported;
use crate::experiment::judged::measures::rescue::filter::Resting;
use crate::experiment::judged::measures::{Measure, Model, Told, by_case, by_seed};
use crate::experiment::push::ROOM;
use crate::experiment::runs::{FLAT, Spread, start};

/// Figure 9: the time of a search is linear in its tries.
pub(in super::super) const SEARCH_TIME: Measure = Measure {
    name: "search-time",
    planted: "a lookup of a point takes a tenth longer",
    perform: search_time,
};

/// Tries of the searches with 36 points and with 360.
const TRIES_36: [u16; 7] = [20, 120, 240, 400, 600, 800, 960];
const TRIES_360: [u16; 4] = [20, 40, 80, 120];

fn search_time(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let cases: Vec<(u16, u16)> = TRIES_36
        .map(|tries| (36, tries))
        .into_iter()
        .chain(TRIES_360.map(|tries| (360, tries)))
        .collect();
    let tenths = model.pick(10, 11);
    let times = by_case(plan, tell, &cases, |(points, tries), seed| {
        time_ms(points, tries, tenths, seed)
    });
    let (few, many) = times.split_at(TRIES_36.len());
    let lines = |tries: &[u16], times: &[Vec<f64>]| -> Vec<[f64; 2]> {
        let of_seed = |seed: usize| {
            let points = tries.iter().zip(times);
            line(points.map(|(tries, times)| [f64::from(*tries), times[seed]]))
        };
        (0..plan.count()).map(of_seed).collect()
    };
    let (few_lines, many_lines) = (lines(&TRIES_36, few), lines(&TRIES_360, many));
    let mut measured = Measured::default();
    let slopes = few_lines.iter().map(|[slope, _]| *slope);
    measured.value("time of a try with 36 points (ms)", slopes);
    let slopes = many_lines.iter().map(|[slope, _]| *slope);
    measured.value("time of a try with 360 points (ms)", slopes);
    let ratios = many_lines.iter().zip(&few_lines);
    let ratios = ratios.map(|([many, _], [few, _])| many / few);
    measured.value("360 points against 36", ratios);
    let scatters = few_lines.iter().map(|[_, scatter]| *scatter);
    measured.value("scatter round the line with 36 points (ms)", scatters);
    measured.curve("36 points", medians(&TRIES_36, few));
    measured.curve("360 points", medians(&TRIES_360, many));
    measured
}

/// Figure 9 again: the line of 360 points.
pub(in super::super) const SEARCH_TIME_360: Measure = Measure {
    name: "search-time-360",
    planted: "the line drawn 20 tries farther right",
    perform: search_time_360,
};

fn search_time_360(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let times = by_case(plan, tell, &TRIES_360, |tries, seed| {
        time_ms(360, tries, 10, seed)
    });
    let shift = model.pick(0.0, 20.0);
    let curve = medians(&TRIES_360, &times).into_iter();
    let mut measured = Measured::default();
    measured.curve(
        "360 points",
        curve.map(|[tries, time]| [tries + shift, time]),
    );
    measured
}

/// Time of a search at rest, ms.
fn time_ms(points: u16, tries: u16, tenths: u32, seed: u64) -> f64 {
    let tuning = TuningSpec {
        points: Some(points),
        tries: Some(tries),
        ..TuningSpec::default()
    };
    let times = costs_ms(ROOM, seed, tuning, tenths, 40);
    Spread::of(times.into_iter().skip(10)).median
}

/// The median of each number of tries.
fn medians(tries: &[u16], values: &[Vec<f64>]) -> Vec<[f64; 2]> {
    let points = tries.iter().zip(values);
    let median = |values: &[f64]| Spread::of(values.iter().copied()).median;
    points
        .map(|(tries, values)| [f64::from(*tries), median(values)])
        .collect()
}

/// Slope of the line of least squares, and the standard deviation around it.
fn line(points: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    let points: Vec<[f64; 2]> = points.collect();
    let count = points.len() as f64;
    let mean = |axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / count;
    let (x, y) = (mean(0), mean(1));
    let square = |value: f64| value * value;
    let over = points.iter().map(|point| (point[0] - x) * (point[1] - y));
    let under = points.iter().map(|point| square(point[0] - x));
    let slope = over.sum::<f64>() / under.sum::<f64>();
    let off = points
        .iter()
        .map(|point| square(point[1] - y - slope * (point[0] - x)));
    [slope, (off.sum::<f64>() / count).sqrt()]
}

/// Processor time of each of the first searches in a scenario, ms. A lookup of a point costs
/// `tenths` tenths of the usual time.
fn costs_ms(text: &str, seed: u64, tuning: TuningSpec, tenths: u32, searches: usize) -> Vec<f64> {
    let mut run = start(text, seed, |scenario| {
        as_reported(scenario, tuning);
    });
    run.rig.cpu = CpuModel {
        per_point: CpuModel::STM32F4.per_point * tenths / 10,
        ..CpuModel::STM32F4
    };
    let (mut times, mut last) = (Vec::new(), Instant::ZERO);
    while times.len() < searches && !run.is_over() {
        run.step();
        let found = run.rig.program().and_then(|program| program.estimate());
        let Some((at, _)) = found.filter(|(at, _)| *at > last) else {
            continue;
        };
        last = at;
        let cost = run.rig.last_cost().unwrap_or(Duration::ZERO);
        times.push(cost.as_secs_f64() * 1000.0);
    }
    times
}

/// Page 16: the search is held at 150 ms.
pub(in super::super) const REGULATOR: Measure = Measure {
    name: "regulator",
    planted: "1300 tries each time, without a regulator",
    perform: regulator,
};

/// Number of searches until the regulator has settled, and of all examined ones: a minute.
const SETTLED: usize = 60;
const SEARCHES: usize = 300;

fn regulator(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let runs = by_seed(plan, tell, |seed| {
        let tuning = TuningSpec {
            tries: model.pick(None, Some(1_300)),
            ..TuningSpec::default()
        };
        costs_ms(FLAT, seed, tuning, 10, SEARCHES)
    });
    let mut measured = Measured::default();
    let settled = |run: &Vec<f64>| Spread::of(run.iter().skip(SETTLED).copied());
    let medians = runs.iter().map(|run| settled(run).median);
    measured.value("time of a search (ms)", medians);
    let longest = runs.iter().map(|run| settled(run).worst);
    measured.value("longest search (ms)", longest);
    measured
}

/// Pages 15 and 16: more tries find the position better, and 1000 are enough.
pub(in super::super) const TRIES: Measure = Measure {
    name: "tries",
    planted: "an eighth of the tries",
    perform: tries,
};

/// The report's figure 9 begins at 20 tries. The report compares 1000 with 100000; a search of the
/// rig has at most 20000.
const TRIES_ALL: [u16; 6] = [20, 50, 100, 250, 1_000, 20_000];
/// Searches of a robot.
const SEARCHES_EACH: usize = 40;

fn tries(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let errors = by_case(plan, tell, &TRIES_ALL, |tries, seed| {
        let mut robot = Resting::new(seed, Some(tries / model.pick(1, 8)));
        let errors = (0..SEARCHES_EACH).map(|_| robot.found_from_anywhere());
        Spread::of(errors).median
    });
    let mut measured = Measured::default();
    let ratio = |few: usize, many: usize| [of_medians(&errors[few], &errors[many])];
    measured.value("error with 20 tries against 1000", ratio(0, 4));
    measured.value("error with 1000 tries against 20000", ratio(4, 5));
    measured.curve("error of the position", medians(&TRIES_ALL, &errors));
    measured
}

/// Page 15: every tenth point is enough.
pub(in super::super) const POINTS: Measure = Measure {
    name: "points",
    planted: "four points in place of 36",
    perform: points,
};

fn points(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let few = model.pick(36, 4);
    let errors = by_case(&twice(plan), tell, &[few, 360], |points, seed| {
        let tuning = TuningSpec {
            points: Some(points),
            tries: Some(1_000),
            ..TuningSpec::default()
        };
        error_mm(seed, CpuSpec::Ideal, tuning)
    });
    ratio("error with 36 points against 360", &errors)
}

/// Pages 15 and 16: a quadratic weight is not noticeably better.
pub(in super::super) const WEIGHTS: Measure = Measure {
    name: "weights",
    planted: "a quadratic weight of 255 of 256 in place of 26",
    perform: weights,
};

fn weights(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let cases = [FadingSpec::Quadratic, FadingSpec::Linear];
    let errors = by_case(&twice(plan), tell, &cases, |fading, seed| {
        let is_planted = model == Model::Planted && fading == FadingSpec::Quadratic;
        let tuning = TuningSpec {
            fading: Some(fading),
            weight: is_planted.then_some(255),
            ..TuningSpec::default()
        };
        error_mm(seed, CpuSpec::Stm32f4, tuning)
    });
    ratio(
        "error with the quadratic weight against the linear",
        &errors,
    )
}

/// The median error of the first case against that of the second.
fn ratio(name: &'static str, errors: &[Vec<f64>]) -> Measured {
    let mut measured = Measured::default();
    measured.value(name, [of_medians(&errors[0], &errors[1])]);
    measured
}

/// Ratio of two medians; NaN if a run has no value. Ratios of single runs scatter too much.
pub(super) fn of_medians(one: &[f64], other: &[f64]) -> f64 {
    let median = |values: &[f64]| match values.iter().all(|value| value.is_finite()) {
        true => Spread::of(values.iter().copied()).median,
        false => f64::NAN,
    };
    median(one) / median(other)
}

/// Twice as many seeds.
pub(super) const fn twice(plan: &Plan) -> Plan {
    Plan {
        seeds: 2 * plan.seeds,
        ..*plan
    }
}

/// Root mean square of the position's error in the flat, mm.
fn error_mm(seed: u64, cpu: CpuSpec, tuning: TuningSpec) -> f64 {
    let run = start(FLAT, seed, |scenario| {
        scenario.program.cpu = cpu;
        as_reported(scenario, tuning);
    });
    let outcome = run.finish();
    outcome.pose_error.map_or(f64::NAN, |error| error.rms_mm)
}
