//! The scenarios of a campaign, its fault profile, and its coverage.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::super::CliError;
use super::super::exec::{ExecArgs, is_bare, read_without_programs};
use super::CampaignArgs;
use crate::realtime::exec::Cpu;
use crate::scenario::{Scenario, Source};
use crate::search::campaign::{self, CampaignPlan, Shard, ShardChoice, Store};
use crate::search::generate::{self, Profile, Vary};

/// The profile with this name or file. The default is gentle, with `--mutants` harsh.
pub(super) fn profile(name: Option<&str>, is_for_mutants: bool) -> Result<Profile, CliError> {
    let usual = if is_for_mutants { "harsh" } else { "gentle" };
    Ok(Profile::find(name.unwrap_or(usual))?)
}

/// Rejects a profile that would not be used.
pub(in crate::cli) fn needs_faults(profile: Option<&str>, vary: Vary) -> Result<(), CliError> {
    match profile {
        Some(_) if !vary.faults => {
            let message = format!(
                "--profile: needs faults in --vary, which is {vary}; add it, as in --vary all"
            );
            Err(CliError::Usage(message))
        }
        _ => Ok(()),
    }
}

/// Rejects faults for a scenario without a part that can have one: its runs would pass without a
/// fault.
pub(in crate::cli) fn can_have_faults(
    (scenario, source): (&Scenario, &Source),
    vary: Vary,
    profile: &Profile,
) -> Result<(), CliError> {
    if !vary.faults {
        return Ok(());
    }
    let Some(lack) = generate::lack_of_faults(scenario, source, profile)? else {
        return Ok(());
    };
    let path = source.path.display();
    Err(CliError::Usage(format!(
        "--vary {vary}: {path} can have no fault: {lack}; leave out faults, as in --vary timing"
    )))
}

/// Rejects scenarios that can have no fault, if faults are to vary.
pub(super) fn check_faults(
    read: &BTreeMap<String, (Scenario, Source)>,
    vary: Vary,
    profile: &Profile,
) -> Result<(), CliError> {
    let mut read = read.values();
    read.try_for_each(|(scenario, source)| can_have_faults((scenario, source), vary, profile))
}

/// The shard of this process.
pub(super) fn shard_of(args: &CampaignArgs) -> Result<Shard, CliError> {
    match (args.shard, args.shards) {
        (ShardChoice::Given(shard), None) => Ok(shard),
        (ShardChoice::Given(_), Some(_)) => {
            let message = "--shards: has no effect with --shard I/N, expected --shard auto";
            Err(CliError::Usage(message.to_owned()))
        }
        (ShardChoice::Auto, None) => {
            let message = "--shard auto: expected --shards N, the number of shards";
            Err(CliError::Usage(message.to_owned()))
        }
        (ShardChoice::Auto, Some(of)) => {
            let shard = campaign::array::shard(of, |name| std::env::var(name).ok());
            shard.map_err(|error| CliError::Usage(format!("--shard auto: {error}")))
        }
    }
}

/// The coverage of a stopped campaign: the number of seeds of each scenario.
pub(super) fn covered(plan: &CampaignPlan, store: &Store, shard: Shard) -> String {
    let mut counts: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    for (_, name, seed) in plan.runs().filter(|(number, ..)| shard.has(*number)) {
        let [done, all] = counts.entry(name).or_default();
        *done += usize::from(store.has(name, seed));
        *all += 1;
    }
    let least = counts.values().map(|[done, _]| *done).min().unwrap_or(0);
    let most = counts.values().map(|[done, _]| *done).max().unwrap_or(0);
    let of = counts.values().map(|[_, all]| *all).max().unwrap_or(0);
    let done = if least == most {
        least.to_string()
    } else {
        format!("{least} to {most}")
    };
    let scenarios = counts.len();
    format!("covered: {done} of {of} seeds in each of {scenarios} scenarios")
}

/// Lets the order of threads follow each seed, if that is to vary.
pub(super) fn vary_schedule(program: &mut ExecArgs, vary: Vary) -> Result<(), CliError> {
    if vary.schedule && !program.is_virtual() {
        let message = "--vary schedule: needs --exec CMD --virtual, because only virtual time \
                       can select the order of threads";
        return Err(CliError::Usage(message.to_owned()));
    }
    if vary.schedule && program.has_schedule() {
        let message = "--vary schedule: not possible with --schedule, because each seed selects \
                       its schedule";
        return Err(CliError::Usage(message.to_owned()));
    }
    if vary.schedule {
        program.vary_schedule();
    }
    Ok(())
}

/// Rejects the recorded computing of one case for the many runs of a campaign.
pub(super) fn measures_cpu(program: &ExecArgs) -> Result<(), CliError> {
    match program.cpu() {
        Some(Cpu::OfCase) => {
            let message = "--cpu case: each run of a campaign computes at other times; expected a \
                           number, as in --cpu 20";
            Err(CliError::Usage(message.to_owned()))
        }
        _ => Ok(()),
    }
}

/// The earlier campaign in `dir`, if one was named.
pub(super) fn earlier(dir: Option<&Path>) -> Result<Option<(PathBuf, Store)>, CliError> {
    let Some(dir) = dir else { return Ok(None) };
    Ok(Some((dir.to_owned(), Store::open(dir)?)))
}

/// The scenarios in `paths` by their names.
pub(super) fn read_all(
    paths: &[PathBuf],
) -> Result<BTreeMap<String, (Scenario, Source)>, CliError> {
    let mut read = BTreeMap::new();
    for path in paths {
        let (scenario, source) = read_without_programs("campaign", path)?;
        let name = scenario.name.clone();
        if read.insert(name.clone(), (scenario, source)).is_some() {
            let message = format!("{}: a second scenario \"{name}\"", path.display());
            return Err(CliError::Usage(format!(
                "{message}, expected each name once"
            )));
        }
    }
    Ok(read)
}

/// Removes robots without a built-in program, unless all are such: without `--exec` each of their
/// runs would fail.
pub(super) fn leave_out_bare(
    read: &mut BTreeMap<String, (Scenario, Source)>,
) -> Result<(), CliError> {
    let mut bare = Vec::new();
    for (name, (scenario, source)) in &*read {
        if is_bare(scenario, source)? {
            bare.push(name.clone());
        }
    }
    if bare.len() < read.len() {
        for name in bare {
            read.remove(&name);
            eprintln!("{name} is skipped: its robot has no program; --exec CMD starts one");
        }
    }
    Ok(())
}
