//! Mazes of five sizes, searched by the robot, compared with an oracle that knows the map. The
//! oracle visits every tile on a short path and returns home at cruise speed, without time for
//! turns.

mod oracle;

use super::runs::{Spread, each, start};
use super::{Figure, Findings, Plan, Plot, Table};
use engine::run::Outcome;
use engine::run::check::Status;

const MAZE: &str = include_str!("../../scenarios/rescue-maze.toml");
/// Columns and rows: as many tiles of 0.55 m as fit the robot's map of 3 m.
const SIZES: [[usize; 2]; 5] = [[3, 3], [4, 3], [4, 4], [5, 4], [5, 5]];
/// The robot's speed straight ahead, m/s: 20 ticks per 40 ms.
const CRUISE_M_S: f64 = 0.227;
/// Checks required of a search.
const ASKED: [&str; 4] = ["explored", "victims-found", "home", "no-collision-at-speed"];

/// Result of one searched maze.
struct Searched {
    name: String,
    tiles: usize,
    /// Whether each of [`ASKED`] passed.
    held: [bool; 4],
    time_s: f64,
    way_m: f64,
    oracle_m: f64,
}

impl Searched {
    fn is_done(&self) -> bool {
        self.held == [true; 4]
    }

    fn ratios(&self) -> [f64; 2] {
        let oracle_s = self.oracle_m / CRUISE_M_S;
        [self.time_s / oracle_s, self.way_m / self.oracle_m]
    }
}

pub(super) fn perform(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let jobs: Vec<([usize; 2], u64)> = SIZES
        .iter()
        .flat_map(|size| plan.seeds().map(|seed| (*size, seed)))
        .collect();
    let searched = each(plan, &jobs, tell, |(size, seed)| search(*size, *seed));
    let mut table = Table::new([
        "explored",
        "victims",
        "home",
        "no contact",
        "time (s)",
        "way (m)",
        "way of the oracle (m)",
    ]);
    for one in &searched {
        let held = one.held.map(|held| f64::from(u8::from(held)));
        let figures = held
            .into_iter()
            .chain([one.time_s, one.way_m, one.oracle_m]);
        table.push(&one.name, figures);
    }
    let mut plot = Plot::new(
        "Time of a search against a robot that knows the map",
        ["tiles of the maze", "times as long"],
    );
    let by_size = |pick: usize| {
        SIZES.map(|[columns, rows]| {
            let tiles = columns * rows;
            let same = searched_of(&searched, tiles);
            [
                tiles as f64,
                Spread::of(same.map(|one| one.ratios()[pick])).median,
            ]
        })
    };
    plot = plot
        .line("time, median", by_size(0))
        .line("way, median", by_size(1));
    let points = |one: &Searched| [one.tiles as f64, one.ratios()[0]];
    plot = plot.points("time", searched.iter().map(points));
    Findings {
        table,
        plot,
        figures: figures(&searched),
    }
}

fn searched_of(searched: &[Searched], tiles: usize) -> impl Iterator<Item = &Searched> {
    searched.iter().filter(move |one| one.tiles == tiles)
}

fn figures(searched: &[Searched]) -> Vec<Figure> {
    let done = searched.iter().filter(|one| one.is_done()).count();
    let failed = searched.iter().filter(|one| !one.is_done());
    let failed = failed.map(|one| {
        let broken = ASKED.iter().zip(one.held).filter(|(_, held)| !held);
        let broken: Vec<&str> = broken.map(|(name, _)| *name).collect();
        Figure::new(format!("not done: {}", one.name), broken.join(", "), "")
    });
    let [time, way] = [0, 1].map(|pick| Spread::of(searched.iter().map(|one| one.ratios()[pick])));
    let shown = |spread: Spread| format!("{:.2}, worst {:.2}", spread.median, spread.worst);
    let ours = format!("{done} of {}", searched.len());
    let mut figures = vec![
        Figure::new(
            "explored, victims found, home, no contact",
            ours,
            "the promise",
        ),
        Figure::new("time against the oracle, median", shown(time), ""),
        Figure::new("way against the oracle, median", shown(way), ""),
    ];
    figures.extend(failed);
    figures
}

fn search([columns, rows]: [usize; 2], seed: u64) -> Searched {
    let mut oracle_m = f64::NAN;
    let run = start(MAZE, seed, |scenario| {
        if let Some(maze) = &mut scenario.world.maze {
            let maze = maze.get_mut();
            (maze.seed, maze.columns, maze.rows) = (seed, columns, rows);
            oracle_m = oracle::tour(&maze.passages()) as f64 * maze.tile_m;
        }
    });
    let outcome = run.finish();
    let held = |name: &&str| {
        let check = outcome.checks.iter().find(|check| check.name == *name);
        check.is_some_and(|check| check.status == Status::Pass)
    };
    Searched {
        name: format!("{columns} x {rows} seed {seed}"),
        tiles: columns * rows,
        held: ASKED.each_ref().map(held),
        time_s: outcome.ran.as_secs_f64(),
        way_m: way_m(&outcome),
        oracle_m,
    }
}

/// Length of the true path, metres.
fn way_m(outcome: &Outcome) -> f64 {
    let places = outcome.truth.windows(2);
    places
        .map(|pair| pair[0].1.point().distance(pair[1].1.point()))
        .sum()
}
