//! `campaign --mutants`: the share of planted defects that the checks detect.

use std::collections::BTreeMap;

use protocols::Instant;

use super::super::answer::{CampaignEnded, MutantJudged};
use super::super::out::answer;
use super::super::stop::Stop;
use super::super::{CliError, Verdict};
use super::{CampaignArgs, jobs};
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
    let mut mutants = Mutants::new(read, profile, vary, &args.defects);
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
    print(&mutants, read, &profile.name, rounds);
    answer(&ended(&mutants));
    Ok(stop.signal().map_or(Verdict::Pass, Verdict::Interrupted))
}

fn now(clock: &WallClock) -> Instant {
    clock.now()
}

fn print(
    mutants: &Mutants<'_>,
    read: &BTreeMap<String, (Scenario, Source)>,
    profile: &str,
    rounds: u64,
) {
    let [runs, failed] = mutants.sound;
    println!(
        "profile {profile}, {} scenarios, {rounds} seeds of each; {failed} of {runs} runs fail without \
         a defect",
        read.len()
    );
    for (check, count) in &mutants.sound_failures {
        println!("  {count:>5}  {check}");
    }
    let mut by_check: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for mutant in mutants.all() {
        if let Some((check, ..)) = &mutant.found {
            by_check.entry(check).or_default().push(&mutant.defect);
        }
    }
    println!("{}", share("found", mutants.all()));
    for (check, defects) in by_check {
        println!("  {:>5}  {check}: {}", defects.len(), defects.join(", "));
    }
    let missed: Vec<&str> = mutants
        .all()
        .filter(|mutant| mutant.found.is_none())
        .map(|mutant| &*mutant.defect)
        .collect();
    println!("not found: {}", missed.join(", "));
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
