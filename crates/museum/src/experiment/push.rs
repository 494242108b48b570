//! Figure 8 of the rescue robot's report. The robot is pushed by 40 cm within a second and is back
//! in position after six searches; 32 tries of these searches were improvements.

use core::time::Duration;

use firmware_core::robots::rescue::Rescue;
use protocols::Instant;

use super::runs::{Spread, each, start};
use super::{Figure, Findings, Plan, Plot, Table};
use engine::robots::instruments::in_metres;
use engine::run::Run;
use engine::scenario::world::PushSpec;
use engine::scenario::{MapperSpec, Span};

/// A room of 2.4 m x 2.4 m, in which the robot stands.
pub(super) const ROOM: &str = "schema = 1\nname = \"push\"\nrobot = \"rescue\"\nduration = \"20s\"\n\
    [world]\nstart = { x_m = 1.5, y_m = 1.2, heading_deg = 90 }\n[[world.wall]]\n\
    path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n";
const PUSH_AT_MS: u64 = 10_000;
const PUSH_TAKES_MS: u64 = 1_000;
/// Number of searches that are checked after the push.
const SEARCHES: usize = 15;
/// Maximum error, mm, of a robot that is back in position: an eighth of the push.
const BACK_MM: f64 = 50.0;
const MAPPERS: [(&str, MapperSpec); 2] = [
    ("document", MapperSpec::Document),
    ("best", MapperSpec::Best),
];

/// A try that was better than all earlier ones.
struct Better {
    search: usize,
    index: f64,
    error_mm: f64,
    value: f64,
}

/// Result of one pushed robot.
struct Pushed {
    /// Error after each search, mm.
    errors: Vec<f64>,
    /// Improvements of all searches from the beginning of the push until the robot is back in
    /// position.
    better: Vec<Better>,
}

impl Pushed {
    /// Number of searches until the robot is back in position and stays there for all checked
    /// searches.
    fn back_after(&self) -> f64 {
        let away = self.errors.iter().rposition(|error| *error > BACK_MM);
        match away {
            Some(last) if last + 1 >= self.errors.len() => f64::NAN,
            Some(last) => last as f64 + 2.0,
            None => 1.0,
        }
    }

    /// Number of tries that were better than all earlier ones.
    fn improvements(&self) -> f64 {
        self.better.len() as f64
    }
}

pub(super) fn perform(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let jobs: Vec<(MapperSpec, u64)> = MAPPERS
        .iter()
        .flat_map(|(_, mapper)| plan.seeds().map(|seed| (*mapper, seed)))
        .collect();
    let pushed = each(plan, &jobs, tell, |(mapper, seed)| push(*mapper, *seed));
    let count = plan.count();
    let of = |index: usize| &pushed[index * count..(index + 1) * count];
    let mut table = Table::new(["search", "median (mm)", "upper quartile (mm)", "worst (mm)"]);
    let mut plot = Plot::new(
        "Error after a push of 40 cm, search by search",
        ["search after the push", "error of the position (mm)"],
    );
    for (index, (name, _)) in MAPPERS.iter().enumerate() {
        let after = |search: usize| Spread::of(of(index).iter().map(|one| one.errors[search]));
        for search in 0..SEARCHES {
            let spread = after(search);
            let figures = [
                search as f64 + 1.0,
                spread.median,
                spread.quartiles[1],
                spread.worst,
            ];
            table.push(*name, figures);
        }
        let places = |pick: fn(Spread) -> f64| {
            (0..SEARCHES).map(move |search| [search as f64 + 1.0, pick(after(search))])
        };
        plot = plot.line(format!("{name}, median"), places(|spread| spread.median));
        plot = plot.line(format!("{name}, worst"), places(|spread| spread.worst));
    }
    // Searches of one robot, try by try, as in the report: the robot with the most typical number
    // of improvements.
    let usual = Spread::of(of(0).iter().map(Pushed::improvements)).median;
    let strangeness = |one: &Pushed| (one.improvements() - usual).abs();
    let shown = of(0).iter();
    let shown = shown.min_by(|one, other| strangeness(one).total_cmp(&strangeness(other)));
    let shown = shown.map_or(&[][..], |one| &one.better);
    for better in shown {
        let figures = [
            better.search as f64,
            better.error_mm,
            better.index,
            better.value,
        ];
        table.push("improvement: search, error (mm), try, value", figures);
    }
    let tries = shown.iter().map(|better| better.index).fold(1.0, f64::max);
    let places = shown
        .iter()
        .map(|better| [better.search as f64 + better.index / tries, better.error_mm]);
    plot = plot.points(
        format!("document, {} improvements of one", shown.len()),
        places,
    );
    let figures = figures(of(0), of(1));
    Findings {
        table,
        plot,
        figures,
    }
}

fn figures(document: &[Pushed], best: &[Pushed]) -> Vec<Figure> {
    let within = |pushed: &[Pushed], searches: usize| {
        let is_back = |one: &&Pushed| one.errors[searches - 1] <= BACK_MM;
        format!(
            "{} of {}",
            pushed.iter().filter(is_back).count(),
            pushed.len()
        )
    };
    let back = |pushed: &[Pushed]| {
        let never = pushed
            .iter()
            .filter(|one| one.back_after().is_nan())
            .count();
        let spread = Spread::of(pushed.iter().map(Pushed::back_after));
        format!(
            "{:.0} searches, worst {:.0}, never {never}",
            spread.median, spread.worst
        )
    };
    let better = Spread::of(document.iter().map(Pushed::improvements));
    vec![
        Figure::new(
            "document: back within 50 mm after",
            back(document),
            "6 searches, 1.2 s",
        ),
        Figure::new(
            "document: back after 6 searches",
            within(document, 6),
            "the one shown",
        ),
        Figure::new(
            "document: improvements until then, median",
            format!("{:.0}", better.median),
            "32",
        ),
        Figure::new("best: back within 50 mm after", back(best), ""),
        Figure::new("best: back after 6 searches", within(best, 6), ""),
    ]
}

fn push(mapper: MapperSpec, seed: u64) -> Pushed {
    let mut run = start(ROOM, seed, |scenario| {
        scenario.program.mapper = mapper;
        scenario.world.push = vec![PushSpec {
            at: Span::from_millis(PUSH_AT_MS),
            by_m: [0.0, 0.4],
            turn_deg: 0.0,
            over: Span::from_millis(PUSH_TAKES_MS),
        }];
    });
    let begin = Instant::from_millis(PUSH_AT_MS);
    let end = begin + Duration::from_millis(PUSH_TAKES_MS);
    let mut pushed = Pushed {
        errors: Vec::new(),
        better: Vec::new(),
    };
    let mut last = begin;
    while pushed.errors.len() < SEARCHES && run.rig.now() < Instant::from_secs(18) {
        run.step();
        let found = run.rig.program().and_then(|program| program.estimate());
        let Some((at, estimate)) = found.filter(|(at, _)| *at > last) else {
            continue;
        };
        last = at;
        let is_back = pushed.errors.last().is_some_and(|error| *error <= BACK_MM);
        if !is_back {
            let search = pushed.errors.len();
            pushed.better.extend(improvements(&run, search));
        }
        if at > end {
            let truth = run.rig.world.pose();
            let error = in_metres(estimate).point().distance(truth.point());
            pushed.errors.push(error * 1000.0);
        }
    }
    pushed.errors.resize(SEARCHES, f64::NAN);
    pushed
}

/// Improvements of the last search; the improvements during the push have search number 0.
fn improvements(run: &Run, search: usize) -> Vec<Better> {
    let truth = run.rig.world.pose();
    let program = run.rig.program_as::<Rescue>();
    let list = program.map(Rescue::improvements).unwrap_or_default();
    let better = |one: &firmware_core::slam::Improvement| Better {
        search,
        index: one.index.into(),
        error_mm: in_metres(one.pose).point().distance(truth.point()) * 1000.0,
        value: one.value.into(),
    };
    list.iter().map(better).collect()
}
