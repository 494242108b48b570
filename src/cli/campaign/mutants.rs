//! `campaign --mutants`: the share of planted defects that the checks detect.

use std::collections::BTreeMap;

use protocols::Instant;

use super::super::answer::{CampaignEnded, MutantJudged};
use super::super::out::answer;
use super::super::stop::Stop;
use super::super::{CliError, Verdict};
use super::{CampaignArgs, jobs};
use crate::museum::{self, Hidden};
use crate::realtime::clock::{Clock, WallClock};
use crate::scenario::{Scenario, Source};
use crate::search::generate::{Profile, Vary};
use crate::search::mutants::{Mutant, Mutants};

/// Runs all seeds, or until the budget is used up, and prints the result.
pub(super) fn run(
    args: &CampaignArgs,
    read: &BTreeMap<String, (Scenario, Source)>,
    profile: &Profile,
    vary: Vary,
) -> Result<Verdict, CliError> {
    let all = Mutants::new(read, profile, vary, &[]);
    let known: Vec<&str> = all.all().map(|mutant| &*mutant.defect).collect();
    if known.is_empty() {
        let message = "--mutants: the robots of these scenarios have no planted defects";
        return Err(CliError::Usage(message.to_owned()));
    }
    if let Some(unknown) = args.defects.iter().find(|id| !known.contains(&id.as_str())) {
        let known = known.join(", ");
        let message = format!(
            "--defect {unknown}: no robot of these scenarios has it, expected one of {known}"
        );
        return Err(CliError::Usage(message));
    }
    let hidden = museum::hidden();
    let is_hidden = |id: &str| hidden.iter().any(|one| one.id == id);
    let shown = known.iter().filter(|id| !is_hidden(id));
    let wanted: Vec<String> = match args.defects.is_empty() {
        true => shown.map(|id| (*id).to_owned()).collect(),
        false => args.defects.clone(),
    };
    let left_out: Vec<&Hidden> = hidden
        .iter()
        .filter(|one| known.contains(&&*one.id) && !wanted.contains(&one.id))
        .collect();
    let mut mutants = Mutants::new(read, profile, vary, &wanted);
    let (clock, stop) = (
        WallClock::start(),
        Stop::new(args.budget.map(|budget| budget.0))?,
    );
    let is_over = || stop.is_due(now(&clock));
    let mut rounds = 0;
    for seed in args.seeds.clone() {
        // Continues even if all defects are detected: a later failure without a defect may revoke a
        // detection.
        if !mutants.round(seed, jobs(args, false), &is_over)? {
            break;
        }
        rounds += 1;
    }
    if args.markdown {
        table(&mutants, &left_out);
    } else {
        let faults = match vary.faults {
            true => format!("profile {}", profile.name),
            false => format!("--vary {vary}, without faults"),
        };
        print(&mutants, read.len(), &faults, rounds);
        for one in &left_out {
            println!("left out: {} ({})", one.id, one.because);
        }
    }
    answer(&ended(&mutants));
    Ok(stop.signal().map_or(Verdict::Pass, Verdict::Interrupted))
}

fn now(clock: &WallClock) -> Instant {
    clock.now()
}

/// The defects that each check found.
fn by_check<'a>(mutants: &'a Mutants<'_>) -> BTreeMap<&'a str, Vec<&'a str>> {
    let mut by_check: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for mutant in mutants.all() {
        if let Some((check, ..)) = &mutant.found {
            by_check.entry(check).or_default().push(&mutant.defect);
        }
    }
    by_check
}

/// The defects that no check found.
fn missed<'a>(mutants: &'a Mutants<'_>) -> Vec<&'a str> {
    let missed = mutants.all().filter(|mutant| mutant.found.is_none());
    missed.map(|mutant| &*mutant.defect).collect()
}

/// Prints the result as a table in Markdown.
fn table(mutants: &Mutants<'_>, left_out: &[&Hidden]) {
    println!("| check | finds | defects |\n|---|---|---|");
    for (check, defects) in by_check(mutants) {
        println!("| `{check}` | {} | {} |", defects.len(), defects.join(", "));
    }
    let missed = missed(mutants);
    println!("| no check | {} | {} |", missed.len(), missed.join(", "));
    let left_out: Vec<&str> = left_out.iter().map(|one| &*one.id).collect();
    let count = left_out.len();
    println!(
        "| no run can show them | {count} | {} |",
        left_out.join(", ")
    );
    println!("\n{}", share("found", mutants.all()));
}

fn print(mutants: &Mutants<'_>, scenarios: usize, faults: &str, rounds: u64) {
    let [runs, failed] = mutants.sound;
    println!(
        "{faults}, {scenarios} scenarios, {rounds} seeds of each; {failed} of {runs} runs fail without \
         a defect"
    );
    for (check, count) in &mutants.sound_failures {
        println!("  {count:>5}  {check}");
    }
    println!("{}", share("found", mutants.all()));
    for (check, defects) in by_check(mutants) {
        println!("  {:>5}  {check}: {}", defects.len(), defects.join(", "));
    }
    println!("not found, with the share of the runs in which the defect changed any byte:");
    for mutant in mutants.all().filter(|mutant| mutant.found.is_none()) {
        let Mutant {
            defect,
            runs,
            differs,
            ..
        } = mutant;
        println!("  {defect}: {differs} of {runs} runs");
    }
}

fn share<'a>(word: &str, all: impl Iterator<Item = &'a Mutant>) -> String {
    let (mut found, mut count) = (0_u32, 0_u32);
    for mutant in all {
        count += 1;
        found += u32::from(mutant.found.is_some());
    }
    let percent = f64::from(found) * 100.0 / f64::from(count.max(1));
    format!("{word}: {found} of {count} planted defects, {percent:.0} %")
}

/// The result in the form of `--json`.
fn ended(mutants: &Mutants<'_>) -> CampaignEnded {
    let [runs, failed] = mutants.sound;
    let judged = mutants.all().map(|mutant| MutantJudged {
        robot: mutant.robot.clone(),
        defect: mutant.defect.clone(),
        runs: mutant.runs,
        differs: mutant.differs,
        found_by: mutant.found.as_ref().map(|(check, ..)| check.clone()),
        first: mutant
            .found
            .as_ref()
            .map(|(_, name, seed)| (name.clone(), *seed)),
    });
    CampaignEnded {
        folder: None,
        runs,
        failed,
        missing: None,
        trace_hash: None,
        causes: Vec::new(),
        never_came_up: Vec::new(),
        missed_goals: Vec::new(),
        unobserved_rules: Vec::new(),
        unjudged_rules: Vec::new(),
        mutants: Some(judged.collect()),
    }
}
