//! The map's ramp, and the search after a push.

use core::time::Duration;

use engine::robots::instruments::in_metres;
use engine::scenario::world::PushSpec;
use engine::scenario::{Span, TuningSpec};
use firmware_core::pose::{Point, Pose};
use firmware_core::robots::rescue::Rescue;
use firmware_core::scan::Scan;
use firmware_core::slam::{Mapper, Settings};
use protocols::Instant;

use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::rescue::{WEIGHT, as_reported};
use crate::experiment::judged::measures::{Measure, Model, Told, by_seed};
use crate::experiment::push::ROOM;
use crate::experiment::runs::{Spread, start};

/// Figure 3: the ramp that a beam draws into the map.
pub(in super::super) const RAMP: Measure = Measure {
    name: "ramp",
    planted: "a hole a quarter wider",
    perform: ramp,
};

/// Width of the ramp's foot in the published program, mm.
const HOLE_MM: f32 = 350.0;
/// Number of scans after which the map no longer changes.
const SCANS: usize = 400;

fn ramp(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let drawn = by_seed(plan, tell, |seed| {
        // An obstacle at 0.6 to 1.05 m.
        let far_mm = 600.0 + 50.0 * f32::from(u8::try_from(seed % 10).unwrap_or_default());
        drawn(far_mm, model.pick(HOLE_MM, 1.25 * HOLE_MM))
    });
    let mut measured = Measured::default();
    let offsets = (-300..=300).step_by(10);
    let median = |offset: i32| {
        let offset = f64::from(offset);
        let values = drawn.iter().filter_map(|curve| {
            let found = curve.iter().find(|[x, _]| (x - offset).abs() < 5.0);
            found.map(|[_, y]| *y)
        });
        [offset, Spread::of(values).median]
    };
    measured.curve("value of a cell", offsets.map(median));
    let half = |curve: &Vec<[f64; 2]>| {
        10.0 * curve.iter().filter(|[_, value]| *value >= 127.5).count() as f64
    };
    measured.value("width at half the height (mm)", drawn.iter().map(half));
    let peak = |curve: &Vec<[f64; 2]>| curve.iter().map(|[_, y]| *y).fold(0.0, f64::max);
    measured.value("value at the obstacle", drawn.iter().map(peak));
    measured
}

/// Distance from the obstacle along the beam, mm, and the value of the cell there.
fn drawn(far_mm: f32, hole_mm: f32) -> Vec<[f64; 2]> {
    let settings = Settings {
        hole_mm,
        weight: WEIGHT,
        start: Pose::new(1_005.0, 1_505.0, 0.0),
        ..Settings::document()
    };
    let mut mapper: Box<Mapper> = Box::new(Mapper::new(settings));
    let points = [Point::new(far_mm, 0.0)];
    let scan = Scan::from_points(&points, Instant::ZERO, Instant::ZERO);
    for _ in 0..SCANS {
        mapper.draw(&scan, [0, 0]);
    }
    let value = |cell: u16| {
        let middle_mm = 10.0 * f64::from(cell) + 5.0;
        let value = mapper.grid().get(usize::from(cell), 150)?;
        let offset = middle_mm - 1_005.0 - f64::from(far_mm);
        // Nothing is drawn behind the ramp.
        let is_seen = middle_mm > 1_005.0 && offset <= f64::from(hole_mm) / 2.0;
        is_seen.then_some([offset, f64::from(value)])
    };
    (0..300_u16).filter_map(value).collect()
}

/// Figure 8: the search after a push.
pub(in super::super) const PUSH: Measure = Measure {
    name: "push",
    planted: "30 tries of each search",
    perform: push,
};

const PUSH_AT_MS: u64 = 10_000;
const PUSH_M: [f64; 2] = [0.0, 0.4];
/// Time at which the pose has settled: the report takes the final position from its own log.
const SETTLED_MS: u64 = 14_000;
/// Searches of the report's log.
const REPORTED: usize = 6;
/// Error, mm, below which the report's log ends.
const BACK_MM: f64 = 30.0;

/// A candidate in the log that is better than all before.
#[derive(Clone, Copy)]
struct Better {
    search: usize,
    at: [f64; 2],
    value: f64,
}

/// Log of a push; distances from the final position, mm.
struct Log {
    better: Vec<Better>,
    /// Scores at the starts of the searches.
    starts: Vec<f64>,
    /// Results of the searches.
    found: Vec<[f64; 2]>,
    /// Distances along the push between these results and the true end of the push, mm.
    off: Vec<f64>,
}

impl Log {
    /// Index of the last search before the pose moved by a twentieth of the push.
    fn first(&self) -> usize {
        let moved = self.found.iter().position(|at| at[1] < 380.0);
        moved.unwrap_or(self.found.len()).saturating_sub(1)
    }

    /// Index of the first search that ends near the final position.
    fn last(&self) -> usize {
        let near = self.found.iter().position(|at| at[1] < BACK_MM);
        near.unwrap_or(self.found.len())
    }

    /// The candidates from the first search that moved to the last one.
    fn shown(&self) -> impl Iterator<Item = Better> + '_ {
        let range = self.first() + 1..=self.last();
        let shown = self.better.iter();
        shown
            .copied()
            .filter(move |one| range.contains(&one.search))
    }

    /// Scores at the start and at the end of each shown search that found a better candidate.
    fn scores(&self) -> impl Iterator<Item = [f64; 2]> {
        let shown: Vec<Better> = self.shown().collect();
        let searches = shown.chunk_by(|one, next| one.search == next.search);
        let ends = searches.filter_map(|better| better.last());
        let ends = ends.map(|last| [self.starts[last.search], last.value]);
        ends.collect::<Vec<_>>().into_iter()
    }
}

fn push(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let logs = by_seed(plan, tell, |seed| {
        log(seed, model.pick(None, Some(30)), PUSH_M)
    });
    let mut measured = Measured::default();
    // The report's first bar is the position before the first search.
    let farthest = |log: &Log| {
        let before = log.found.get(log.first()).map_or(f64::NAN, |at| at[1]);
        log.shown().map(|one| one.at[1]).fold(before, f64::max)
    };
    measured.value(
        "largest distance along the push (mm)",
        logs.iter().map(farthest),
    );
    let across = |log: &Log| Spread::of(log.shown().map(|one| one.at[0])).median;
    measured.value(
        "distance across the push, median (mm)",
        logs.iter().map(across),
    );
    let searches = |log: &Log| log.last().saturating_sub(log.first()) as f64;
    measured.value("searches", logs.iter().map(searches));
    let better = logs.iter().map(|log| log.shown().count() as f64);
    measured.value("better candidates", better);
    let end = |log: &Log| {
        let off = log.off.get(log.first() + REPORTED);
        off.copied().unwrap_or(f64::NAN)
    };
    measured.value(
        "distance from the truth after six searches (mm)",
        logs.iter().map(end),
    );
    let median = |search: usize| {
        let at = logs.iter();
        let at = at.filter_map(|log| log.found.get(log.first() + search).map(|at| at[1]));
        [search as f64, Spread::of(at).median]
    };
    measured.curve("end of each search", (0..8).map(median));
    measured
}

/// Figure 4: the scores of the candidates rise.
pub(in super::super) const FILTER: Measure = Measure {
    name: "filter",
    planted: "a robot that is not pushed",
    perform: filter,
};

fn filter(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let logs = by_seed(plan, tell, |seed| {
        log(seed, None, model.pick(PUSH_M, [0.0; 2]))
    });
    let mut measured = Measured::default();
    let rise = |log: &Log| Spread::of(log.scores().map(|[start, last]| last / start)).median;
    measured.value(
        "score of a search, last against first",
        logs.iter().map(rise),
    );
    let score = |log: &Log| Spread::of(log.scores().map(|[_, last]| 1_024.0 * last)).median;
    measured.value("score at the end of a search", logs.iter().map(score));
    measured
}

fn log(seed: u64, tries: Option<u16>, by_m: [f64; 2]) -> Log {
    let mut run = start(ROOM, seed, |scenario| {
        let tuning = TuningSpec {
            tries,
            ..TuningSpec::default()
        };
        as_reported(scenario, tuning);
        scenario.world.push = vec![PushSpec {
            at: Span::from_millis(PUSH_AT_MS),
            by_m,
            turn_deg: 0.0,
            over: Span::from_millis(1_000),
        }];
    });
    let mut last = Instant::from_millis(PUSH_AT_MS);
    let mut log = Log {
        better: Vec::new(),
        starts: Vec::new(),
        found: Vec::new(),
        off: Vec::new(),
    };
    let mut settled = [0.0; 2];
    while run.rig.now() < Instant::from_millis(SETTLED_MS) + Duration::from_secs(1) {
        run.step();
        let found = run.rig.program().and_then(|program| program.estimate());
        let Some((at, estimate)) = found.filter(|(at, _)| *at > last) else {
            continue;
        };
        last = at;
        let place = in_metres(estimate).point();
        settled = [place.x * 1_000.0, place.y * 1_000.0];
        if at < Instant::from_millis(SETTLED_MS) {
            let search = log.found.len();
            log.found.push(settled);
            let program = run.rig.program_as::<Rescue>();
            let start = program.map_or(f64::NAN, |it| it.search_start().into());
            log.starts.push(start);
            let better = program.map(Rescue::improvements).unwrap_or_default();
            log.better.extend(better.iter().map(|one| Better {
                search,
                at: [f64::from(one.pose.x_mm), f64::from(one.pose.y_mm)],
                value: f64::from(one.value),
            }));
        }
    }
    let truth = 1_000.0 * run.rig.world.pose().y;
    let unsettled = log.found.iter();
    log.off = unsettled.map(|at| (at[1] - truth).abs()).collect();
    let from_end = |at: &mut [f64; 2]| {
        *at = [0, 1].map(|axis| (at[axis] - settled[axis]).abs());
    };
    log.found.iter_mut().for_each(from_end);
    log.better.iter_mut().for_each(|one| from_end(&mut one.at));
    log
}
