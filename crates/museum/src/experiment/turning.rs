//! Figure 7 of the rescue robot's report: after 20 minutes along walls the map had turned. The
//! report's remedies: remove the motion from the scans, and draw weakly while the robot turns.
//!
//! The document's robot follows walls by the report's law, which drives round and round in one
//! direction, and draws with the report's weight: 10 of 100, which is 26 of 256.

use protocols::Instant;

use super::runs::{FLAT, Spread, each, start};
use super::{Figure, Findings, Plan, Plot, Table};
use engine::run::score::PosePair;
use engine::scenario::tuning::{FadingSpec, WallsSpec};
use engine::scenario::{MapperSpec, Mission, Span, TuningSpec};

const MINUTES: usize = 20;
/// The report's weight, 10 of 100, in the program's scale of 256.
const WEIGHT: u16 = 26;
/// Name, mapper, and whether the remedies are on.
const VARIANTS: [(&str, MapperSpec, bool); 3] = [
    ("document, no cures", MapperSpec::Document, false),
    ("document, both cures", MapperSpec::Document, true),
    ("best", MapperSpec::Best, true),
];

pub(super) fn perform(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let jobs: Vec<(usize, u64)> = (0..VARIANTS.len())
        .flat_map(|variant| plan.seeds().map(move |seed| (variant, seed)))
        .collect();
    let turned = each(plan, &jobs, tell, |(variant, seed)| drive(*variant, *seed));
    let count = plan.count();
    let mut table = Table::new([
        "minute",
        "median (deg)",
        "upper quartile (deg)",
        "worst (deg)",
    ]);
    let mut plot = Plot::new(
        "Turn of the map along walls",
        ["time (min)", "error of the heading (deg)"],
    );
    let mut figures = Vec::new();
    for (index, (name, ..)) in VARIANTS.iter().enumerate() {
        let runs = &turned[index * count..(index + 1) * count];
        let after = |minute: usize| Spread::of(runs.iter().map(|run| run[minute]));
        for minute in 0..MINUTES {
            let Spread {
                median,
                quartiles,
                worst,
            } = after(minute);
            table.push(*name, [minute as f64 + 1.0, median, quartiles[1], worst]);
        }
        let curve = (0..MINUTES).map(|minute| [minute as f64 + 1.0, after(minute).median]);
        plot = plot.line(*name, curve);
        let end = after(MINUTES - 1);
        let ours = format!("{:.1} deg, worst {:.1}", end.median, end.worst);
        let report = match index {
            0 => "it turns",
            1 => "it does not",
            _ => "",
        };
        figures.push(Figure::new(
            format!("{name}: after 20 min, median"),
            ours,
            report,
        ));
    }
    Findings {
        table,
        plot,
        figures,
    }
}

/// Error of the heading at the end of each minute, degrees.
fn drive(variant: usize, seed: u64) -> Vec<f64> {
    let (_, mapper, is_cured) = VARIANTS[variant];
    let mut run = start(FLAT, seed, |scenario| {
        scenario.duration = Span::from_millis(60_000 * MINUTES as u64);
        scenario.mission = Mission::default();
        scenario.program.start_mode = Some("exploration".to_owned());
        scenario.program.mapper = mapper;
        if mapper == MapperSpec::Document {
            let tuning = TuningSpec {
                smear: !is_cured,
                fading: (!is_cured).then_some(FadingSpec::None),
                walls: Some(WallsSpec::Beam),
                weight: Some(WEIGHT),
                ..TuningSpec::default()
            };
            scenario.program.tuning = Some(toml::Spanned::new(0..0, tuning));
        }
    });
    let minute = |minute: usize| {
        run.go_on_until(Instant::from_secs(60 * (minute as u64 + 1)));
        let Some((at, estimate)) = run.estimate() else {
            return f64::NAN;
        };
        let truth = run.rig.world.pose_at(at);
        PosePair {
            at,
            truth,
            estimate,
        }
        .error_deg()
    };
    (0..MINUTES).map(minute).collect()
}
