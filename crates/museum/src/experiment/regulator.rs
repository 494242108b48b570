//! The regulator of the rescue robot's report: the number of tries is adjusted until the work on a
//! scan takes 150 ms of the 200 ms of a turn.

use protocols::Instant;

use super::runs::{FLAT, Spread, each, start};
use super::{Figure, Findings, Plan, Plot, Table};
use engine::scenario::MapperSpec;

/// Number of checked turns: a minute.
const TURNS: usize = 300;
/// Turn from which on the regulator has settled.
const SETTLED: usize = 60;

pub(super) fn perform(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let jobs: Vec<u64> = plan.seeds().collect();
    let runs = each(plan, &jobs, tell, |seed| times(*seed));
    let mut table = Table::new(["turn", "time of the search (ms)"]);
    for (seed, times) in jobs.iter().zip(&runs) {
        for (turn, time) in times.iter().enumerate() {
            table.push(format!("seed {seed}"), [turn as f64 + 1.0, *time]);
        }
    }
    let first = runs.first().into_iter().flatten().enumerate();
    let plot = Plot::new(
        "Time of each search",
        ["turn of the lidar", "time of the search (ms)"],
    )
    .line(
        "measured",
        first.map(|(turn, time)| [turn as f64 + 1.0, *time]),
    )
    .line("wanted", [[1.0, 150.0], [TURNS as f64, 150.0]]);
    let settled: Vec<f64> = runs
        .iter()
        .flat_map(|times| times.iter().skip(SETTLED).copied())
        .collect();
    let least = settled.iter().copied().fold(f64::INFINITY, f64::min);
    let spread = Spread::of(settled);
    let figures = vec![
        Figure::new(
            "search, median",
            format!("{:.1} ms", spread.median),
            "about 150 ms",
        ),
        Figure::new(
            "search, range",
            format!("{least:.1} to {:.1} ms", spread.worst),
            "",
        ),
    ];
    Findings {
        table,
        plot,
        figures,
    }
}

/// Processor time of each turn's work, ms.
fn times(seed: u64) -> Vec<f64> {
    let mut run = start(FLAT, seed, |scenario| {
        scenario.program.mapper = MapperSpec::Document;
    });
    let (mut times, mut last) = (Vec::new(), Instant::ZERO);
    while times.len() < TURNS && !run.is_over() {
        run.step();
        let found = run.rig.program().and_then(|program| program.estimate());
        let Some((at, _)) = found.filter(|(at, _)| *at > last) else {
            continue;
        };
        last = at;
        let cost = run.rig.last_cost().unwrap_or_default();
        times.push(cost.as_secs_f64() * 1000.0);
    }
    times
}
