//! All figures of the reports, judged.

use core::time::Duration;
use std::path::Path;
use std::sync::mpsc;
use std::thread;

use protocols::Instant;

use super::super::answer::{BandJudged, RowJudged, RowsJudged};
use super::super::stop::Stop;
use super::super::{CliError, Verdict, out, progress};
use super::{ExperimentArgs, Seeds};
use crate::experiment::Plan;
use crate::experiment::judged::{self, Judged, Model, Row, Verdict as RowVerdict};
use safefs::Dir;

/// Interval between looks for a signal.
const LOOK: Duration = Duration::from_millis(100);
/// The pages of a whole run.
const PAGES: [&str; 2] = ["experiments.md", "index.html"];
/// The pages of a run without all rows or seeds; they replace no whole page.
const PARTIAL: [&str; 2] = ["partial.md", "partial.html"];
/// The pages of a run with planted changes.
const PLANTED: [&str; 2] = ["planted.md", "planted.html"];

/// Names of the files of a run.
struct Names {
    pages: [&'static str; 2],
    before: &'static str,
}

impl Names {
    fn of(done: &[Judged], model: Model) -> Self {
        let (pages, before) = match (model, judged::is_partial(done)) {
            (Model::Planted, _) => (PLANTED, "planted-"),
            (Model::Sound, true) => (PARTIAL, ""),
            (Model::Sound, false) => (PAGES, ""),
        };
        Self { pages, before }
    }

    fn plot(&self, row: &Row) -> String {
        format!("{}{}.svg", self.before, row.name)
    }
}

pub(super) fn run(args: &ExperimentArgs) -> Result<Verdict, CliError> {
    let rows = judged::select(&args.rows);
    let rows = rows.map_err(|unknown| CliError::Usage(format!("--rows: {unknown}")))?;
    let usual = Seeds::Count(judged::SEEDS);
    let [first_seed, seeds] = args.seeds.as_ref().unwrap_or(&usual).from(1);
    let plan = Plan {
        first_seed,
        seeds,
        jobs: super::jobs(args),
    };
    let failed = |error| CliError::write(format!("--out {}", args.out.display()), error);
    let folder = Dir::create(&args.out).map_err(failed)?;
    let stop = Stop::new(None)?;
    let model = match args.planted {
        false => Model::Sound,
        true => Model::Planted,
    };
    let done = judge(&rows, plan, model, &stop);
    let names = Names::of(&done, model);
    for one in &done {
        if let Some(plot) = &one.plot {
            folder
                .write(names.plot(one.row), plot.svg())
                .map_err(failed)?;
        }
    }
    let texts = [judged::markdown(&done, model), judged::html(&done, model)];
    for (name, text) in names.pages.iter().zip(texts) {
        folder.write(name, text).map_err(failed)?;
    }
    answer(&done, &args.out, &names, model);
    let is_bad = done.iter().any(|one| match (one.verdict, model) {
        // Only a signal or a failed measurement leaves a row without a run.
        (RowVerdict::NotRun, _) => true,
        (RowVerdict::Refused, _) => false,
        (_, Model::Sound) => one.is_lost(),
        (_, Model::Planted) => !one.row.open && one.is_as_expected(),
    });
    Ok(match (stop.signal(), is_bad) {
        (Some(signal), _) => Verdict::Interrupted(signal),
        (None, true) => Verdict::Fail,
        (None, false) => Verdict::Pass,
    })
}

/// Judges the rows; after a signal, the rest is not run.
fn judge(rows: &[&'static Row], plan: Plan, model: Model, stop: &Stop) -> Vec<Judged> {
    let (sender, judged) = mpsc::channel();
    let is_watched = progress::is_watched();
    let todo = rows.to_vec();
    // A measure that a signal interrupts ends with the process.
    let worker = thread::spawn(move || {
        let tell = |row: &Row, done: usize, all: usize| {
            if is_watched && done.is_multiple_of((all / 4).max(1)) {
                eprintln!("{}: {done} of {all} runs", row.name);
            }
        };
        judged::judge(&todo, &plan, model, &tell, &mut |one| {
            // After a signal, the other end is gone.
            let _ = sender.send(one);
        });
    });
    let mut done: Vec<Judged> = Vec::new();
    while done.len() < rows.len() && !stop.is_due(Instant::ZERO) {
        match judged.recv_timeout(LOOK) {
            Ok(one) => {
                let (number, all) = (done.len() + 1, rows.len());
                eprintln!("{number} of {all}: {} {}", one.row.name, one.verdict.name());
                done.push(one);
            }
            Err(mpsc::RecvTimeoutError::Timeout) => {}
            Err(mpsc::RecvTimeoutError::Disconnected) => {
                // The rows that are judged are written all the same.
                if worker.join().is_err()
                    && let Some(row) = rows.get(done.len())
                {
                    eprintln!(
                        "{}: its measure broke; the rows after it are not run",
                        row.name
                    );
                }
                break;
            }
        }
    }
    let left = rows.iter().skip(done.len());
    let left: Vec<Judged> = left.map(|row| Judged::not_run(row)).collect();
    done.extend(left);
    done
}

fn answer(done: &[Judged], folder: &Path, names: &Names, model: Model) {
    let count = |verdict: RowVerdict| done.iter().filter(|one| one.verdict == verdict).count();
    let [reproduced, differ, by_construction, refused, not_run] = [
        RowVerdict::Reproduced,
        RowVerdict::Differs,
        RowVerdict::ByConstruction,
        RowVerdict::Refused,
        RowVerdict::NotRun,
    ]
    .map(count);
    let is_partial = judged::is_partial(done);
    let file = |name: &str| folder.join(name).display().to_string();
    out::answer(&RowsJudged {
        planted: model == Model::Planted,
        rows: done.iter().map(|one| row(one, folder, names)).collect(),
        reproduced,
        differ,
        by_construction,
        refused,
        not_run,
        is_partial,
        files: names.pages.map(file).to_vec(),
    });
    for one in done {
        let unexpected = if one.is_as_expected() {
            ""
        } else {
            ", unexpected"
        };
        println!(
            "{:<24} {:<12} {}{unexpected}",
            one.row.name,
            one.verdict.name(),
            one.row.place
        );
        for band in one.bands.iter().filter(|band| !band.holds) {
            let limits = &band.band;
            println!(
                "  {}: {} of {} runs inside {} to {}, median {:.3} (report: {})",
                limits.of,
                band.inside(),
                band.values.len(),
                limits.least,
                limits.most,
                band.median(),
                limits.report
            );
        }
    }
    if model == Model::Planted {
        println!("planted changes: each model is wrong on purpose");
    }
    println!(
        "{reproduced} reproduced, {differ} differ, {by_construction} by construction, \
         {refused} refused, {not_run} not run"
    );
    if is_partial {
        println!(
            "partial: not all rows, or fewer than {} seeds",
            judged::SEEDS
        );
    }
    println!("page {}", file(names.pages[1]));
}

fn row(one: &Judged, folder: &Path, names: &Names) -> RowJudged {
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    let band = |band: &judged::JudgedBand| BandJudged {
        value: band.band.of.clone(),
        report: band.band.report.clone(),
        share: band.band.share,
        inside: band.inside(),
        least: band.band.least,
        most: band.band.most,
        values: band.values.iter().map(|value| finite(*value)).collect(),
        median: finite(band.median()),
        holds: band.holds,
    };
    let plot = one.plot.as_ref();
    let plot = plot.map(|_| folder.join(names.plot(one.row)).display().to_string());
    RowJudged {
        name: one.row.name.clone(),
        report: one.row.report.name(),
        place: one.row.place.clone(),
        verdict: one.verdict.name(),
        is_expected: one.is_as_expected(),
        seeds: one.seeds,
        bands: one.bands.iter().map(band).collect(),
        reason: one
            .row
            .refused
            .clone()
            .unwrap_or_else(|| one.row.note.clone()),
        plot,
    }
}
