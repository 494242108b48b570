//! Gain of the report's mapper from more tries, more points and other weights: the demo flat, each
//! variant with the same seeds.

use super::runs::{FLAT, Spread, each, start};
use super::{Figure, Findings, Plan, Plot, Table};
use engine::scenario::tuning::FadingSpec;
use engine::scenario::{CpuSpec, MapperSpec, TuningSpec};

/// Numbers of tries; the report compares 1000 with 100,000 on a PC.
const TRIES: [u16; 6] = [125, 250, 500, 1_000, 2_000, 4_000];

/// A configuration of the mapper.
struct Variant {
    name: String,
    tuning: TuningSpec,
    cpu: CpuSpec,
}

/// Errors of one run.
struct Errors {
    rms_mm: f64,
    rms_deg: f64,
    overlap: f64,
}

pub(super) fn by_number(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let variant = |tries: u16| Variant {
        name: tries.to_string(),
        tuning: TuningSpec {
            tries: Some(tries),
            ..TuningSpec::default()
        },
        // 4000 tries would take the robot's processor 0.6 s of each 0.2 s.
        cpu: CpuSpec::Ideal,
    };
    let spreads = compare(plan, tell, &TRIES.map(variant));
    let medians = |pick: fn(&[Spread; 3]) -> f64| {
        TRIES
            .iter()
            .zip(&spreads)
            .map(move |(tries, spread)| [f64::from(*tries), pick(spread)])
    };
    let plot = Plot::new(
        "Error of the pose by tries",
        ["tries of each search", "error of the position, RMS (mm)"],
    )
    .by_factors()
    .line("median", medians(|[mm, ..]| mm.median))
    .line("lower quartile", medians(|[mm, ..]| mm.quartiles[0]))
    .line("upper quartile", medians(|[mm, ..]| mm.quartiles[1]));
    let figure = |tries: &u16, [mm, ..]: &[Spread; 3]| {
        let ours = format!("{:.1} mm, worst {:.1}", mm.median, mm.worst);
        let report = match tries {
            1_000 => "enough",
            _ => "",
        };
        Figure::new(format!("{tries} tries: median RMS error"), ours, report)
    };
    let figures = TRIES.iter().zip(&spreads);
    let figures = figures
        .map(|(tries, spread)| figure(tries, spread))
        .collect();
    Findings {
        table: table(&TRIES.map(|tries| tries.to_string()), &spreads),
        plot,
        figures,
    }
}

pub(super) fn by_settings(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let variants = variants();
    let spreads = compare(plan, tell, &variants);
    let names: Vec<String> = variants
        .iter()
        .map(|variant| variant.name.clone())
        .collect();
    let mut plot = Plot::new(
        "The report's mapper in other ways",
        ["number of the variant", "error of the position, RMS (mm)"],
    );
    for (index, (name, [mm, ..])) in names.iter().zip(&spreads).enumerate() {
        let x = index as f64 + 1.0;
        let places = [mm.quartiles[0], mm.median, mm.quartiles[1]].map(|mm| [x, mm]);
        plot = plot.points(format!("{}: {name}", index + 1), places);
    }
    let figure = |(name, [mm, deg, overlap]): (&String, &[Spread; 3])| {
        let ours = format!(
            "{:.1} mm, {:.2} deg, walls {:.2}",
            mm.median, deg.median, overlap.median
        );
        Figure::new(name, ours, "")
    };
    Findings {
        table: table(&names, &spreads),
        plot,
        figures: names.iter().zip(&spreads).map(figure).collect(),
    }
}

/// The report's configuration, and each of its alternatives separately.
fn variants() -> Vec<Variant> {
    let usual = TuningSpec::default;
    let with = |name: &str, tuning: TuningSpec| Variant {
        name: name.to_owned(),
        tuning,
        cpu: CpuSpec::Stm32f4,
    };
    let hole = |mm: u16| TuningSpec {
        hole_mm: Some(mm),
        ..usual()
    };
    let fading = |fading| TuningSpec {
        fading: Some(fading),
        ..usual()
    };
    vec![
        with("as the report has it", usual()),
        with(
            "360 points",
            TuningSpec {
                points: Some(360),
                ..usual()
            },
        ),
        with(
            "weight falls with the square",
            fading(FadingSpec::Quadratic),
        ),
        with("weight does not fall", fading(FadingSpec::None)),
        with(
            "weight 10 of 100",
            TuningSpec {
                weight: Some(26),
                ..usual()
            },
        ),
        with("hole of 160 mm", hole(160)),
        with("hole of 600 mm", hole(600)),
    ]
}

fn table(names: &[String], spreads: &[[Spread; 3]]) -> Table {
    let mut table = Table::new([
        "position RMS median (mm)",
        "lower quartile (mm)",
        "upper quartile (mm)",
        "worst (mm)",
        "heading RMS median (deg)",
        "wall overlap median",
    ]);
    for (name, [mm, deg, overlap]) in names.iter().zip(spreads) {
        let [low, high] = mm.quartiles;
        let figures = [mm.median, low, high, mm.worst, deg.median, overlap.median];
        table.push(name, figures);
    }
    table
}

/// Position, heading and wall overlap of each variant.
fn compare(
    plan: &Plan,
    tell: &(dyn Fn(usize, usize) + Sync),
    variants: &[Variant],
) -> Vec<[Spread; 3]> {
    let jobs: Vec<(&Variant, u64)> = variants
        .iter()
        .flat_map(|variant| plan.seeds().map(move |seed| (variant, seed)))
        .collect();
    let errors = each(plan, &jobs, tell, |(variant, seed)| drive(variant, *seed));
    let count = plan.count();
    let spread = |runs: &[Errors]| {
        [
            Spread::of(runs.iter().map(|run| run.rms_mm)),
            Spread::of(runs.iter().map(|run| run.rms_deg)),
            Spread::of(runs.iter().map(|run| run.overlap)),
        ]
    };
    errors.chunks(count).map(spread).collect()
}

fn drive(variant: &Variant, seed: u64) -> Errors {
    let run = start(FLAT, seed, |scenario| {
        scenario.program.mapper = MapperSpec::Document;
        scenario.program.cpu = variant.cpu;
        scenario.program.tuning = Some(toml::Spanned::new(0..0, variant.tuning.clone()));
    });
    let outcome = run.finish();
    let error = outcome.pose_error;
    Errors {
        rms_mm: error.map_or(f64::NAN, |error| error.rms_mm),
        rms_deg: error.map_or(f64::NAN, |error| error.rms_deg),
        overlap: outcome
            .wall_overlap
            .map_or(f64::NAN, |overlap| overlap.least()),
    }
}
