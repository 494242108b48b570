mod live;
mod mutants;
mod scope;

use core::ops::Range;
use core::sync::atomic::{AtomicUsize, Ordering};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::thread;

use clap::{Args, Subcommand};

use self::live::Live;
pub(super) use self::scope::{can_have_faults, needs_faults};
use self::scope::{
    check_faults, covered, earlier, leave_out_bare, measures_cpu, profile, read_all, shard_of,
    vary_schedule,
};
use super::answer::CampaignEnded;
use super::exec::ExecArgs;
use super::lockstep::LockstepArgs;
use super::out::answer;
use super::progress::is_watched;
use super::stop::Stop;
use super::{CliError, Verdict};
use crate::realtime::clock::{Clock, WallClock};
use crate::realtime::exec::Foreign;
use crate::realtime::guest::files_named;
use crate::run::Outcome;
use crate::scenario::{Scenario, Source, Span};
use crate::search::campaign::{
    self, CampaignPlan, Comparison, Demand, Merged, Record, Shard, ShardChoice, Store,
};
use crate::search::generate::{self, Dice, Profile, Vary};
use crate::show::folder::FolderError;
use crate::show::shell::word;
use engine::workers;
use safefs::Dir;

/// Run scenarios with many seeds, on all cores and on many machines, and group the failures.
///
/// Shards are independent; a shard with the same folder continues where it stopped. The variations
/// of a seed (--vary) depend only on the seed. With --exec each run starts your program in real
/// time, one run at a time unless --jobs is given.
#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_long_help = "Examples:\n  \
    hilrig campaign scenarios/empty-room.toml --seeds 0..200 --vary all --out night\n  \
    hilrig campaign scenarios/*.toml --seeds 0..1000 --shard 3/16 --budget 2h --out shard-3\n  \
    hilrig campaign merge shard-* --out all     # table in all/campaign.html\n  \
    hilrig campaign scenarios/*.toml --seeds 0..1000 --against last-week --out today\n  \
    hilrig campaign scenarios/empty-room.toml --seeds 0..20 --exec './my-robot \"$HILRIG_DIR\"'\n  \
    hilrig campaign scenarios/*.toml --profile harsh --seeds 0..200 --out harsh\n  \
    hilrig campaign bench.toml --seeds 0..200 --exec ./driver --virtual --vary schedule   # races\n  \
    hilrig campaign bench.toml --seeds 0..200 --vary faults --firmware sketch.elf --board arduino-uno\n  \
    hilrig campaign scenarios/*.toml --mutants --seeds 0..50   # how much does it find?"
)]
pub(super) struct CampaignArgs {
    #[command(subcommand)]
    merge: Option<CampaignCommand>,
    /// Scenario files
    #[arg(value_name = "SCENARIO", required_unless_present = "print_profile")]
    scenarios: Vec<PathBuf>,
    /// Seeds, the end not included
    #[arg(long, value_name = "A..B", value_parser = seeds, default_value = "0..100")]
    seeds: Range<u64>,
    /// What to vary for each seed: all, none, or some of world,mission,timing,faults,schedule
    /// [default: none; with --profile or --mutants all]. The schedule is the order of threads of a
    /// program in virtual time (--exec CMD --virtual); all does not include it
    #[arg(long, value_name = "WHAT")]
    vary: Option<Vary>,
    /// Fault profile, i.e. faults and expectations: gentle, field, harsh, or a TOML file [default:
    /// gentle]
    #[arg(long, value_name = "NAME|FILE")]
    profile: Option<String>,
    /// Print a built-in profile as a start for your own one, see --profile
    #[arg(long, value_name = "NAME", conflicts_with_all = ["scenarios", "profile", "mutants"],
        value_parser = Profile::names().collect::<Vec<_>>())]
    print_profile: Option<String>,
    /// Enable the planted defects of the robots one by one, and print the share that is found
    #[arg(long, conflicts_with_all = ["shard", "exec", "firmware", "node", "against", "all_situations"])]
    mutants: bool,
    /// With --mutants: only this defect, by its ID in "hilrig bugs"; may be repeated
    #[arg(long = "defect", value_name = "ID", requires = "mutants")]
    defects: Vec<String>,
    /// With --mutants: print the result as a table in Markdown
    #[arg(long, requires = "mutants")]
    markdown: bool,
    /// Run only every N-th run, starting at number I; auto: take I from the queue's environment
    /// (Slurm, Kubernetes, PBS, Grid Engine, LSF, AWS Batch, GitLab), or from HILRIG_SHARD
    #[arg(long, value_name = "I/N", default_value = "0/1")]
    shard: ShardChoice,
    /// Number of shards, for `--shard auto`
    #[arg(long, value_name = "N", requires = "shard")]
    shards: Option<core::num::NonZeroUsize>,
    /// Start no further run after this time
    #[arg(long, value_name = "TIME")]
    budget: Option<Span>,
    /// Number of parallel runs [default: one per core, with --exec one]
    #[arg(long, value_name = "N")]
    jobs: Option<core::num::NonZeroUsize>,
    #[command(flatten)]
    program: ExecArgs,
    #[command(flatten)]
    lockstep: LockstepArgs,
    /// Folder of the results; an existing campaign there is continued
    #[arg(long, value_name = "DIR", default_value = "hilrig-out/campaign")]
    out: PathBuf,
    /// Folder of an earlier campaign: report new, fixed and still failing causes
    #[arg(long, value_name = "FOLDER", conflicts_with = "shard")]
    against: Option<PathBuf>,
    /// Also fail if an expected situation never occurred
    #[arg(long)]
    all_situations: bool,
}

#[derive(Debug, Subcommand)]
enum CampaignCommand {
    Merge(MergeArgs),
}

/// Merge the folders of shards: failures by cause, a minimised case for each, an HTML table
#[derive(Debug, Args)]
struct MergeArgs {
    /// Folders of shards, or of earlier merges
    #[arg(value_name = "DIR", required = true)]
    dirs: Vec<PathBuf>,
    /// Folder for the result; it can be continued and merged again
    #[arg(long, value_name = "DIR", default_value = "hilrig-out/campaign")]
    out: PathBuf,
    /// Folder of an earlier campaign: report new, fixed and still failing causes
    #[arg(long, value_name = "FOLDER")]
    against: Option<PathBuf>,
    /// Also fail if an expected situation never occurred
    #[arg(long)]
    all_situations: bool,
}

/// Seeds as `A..B`.
pub(super) fn seeds(text: &str) -> Result<Range<u64>, String> {
    let parsed = text.split_once("..").and_then(|(from, until)| {
        let (from, until) = (from.parse().ok()?, until.parse().ok()?);
        (from < until && i64::try_from(until).is_ok()).then_some(from..until)
    });
    parsed.ok_or_else(|| "expected A..B with A below B, e.g. 0..100".to_owned())
}

pub(super) fn run(mut args: CampaignArgs) -> Result<Verdict, CliError> {
    if let Some(CampaignCommand::Merge(args)) = args.merge {
        let earlier = earlier(args.against.as_deref())?;
        let store = campaign::merge(&args.dirs, &args.out)?;
        let merged = summarise(
            &store,
            earlier.as_ref(),
            Demand::of_flag(args.all_situations),
            &|| false,
        )?;
        return Ok(report(&merged, &args.out));
    }
    if let Some(text) = args.print_profile.as_deref().and_then(Profile::text) {
        print!("{text}");
        return Ok(Verdict::Pass);
    }
    // Checked before the first run, so that the error does not appear after a night.
    let profile = profile(args.profile.as_deref(), args.mutants)?;
    let has_profile = args.profile.is_some() || args.mutants;
    let vary = args.vary.unwrap_or(match has_profile {
        true => Vary::ALL,
        false => Vary::default(),
    });
    needs_faults(args.profile.as_deref(), vary)?;
    vary_schedule(&mut args.program, vary)?;
    measures_cpu(&args.program)?;
    args.lockstep
        .check("campaign", args.program.exec.is_some())?;
    if args.mutants {
        let mut read = read_all(&args.scenarios)?;
        leave_out_bare(&mut read)?;
        check_faults(&read, vary, &profile)?;
        return mutants::run(&args, &read, &profile, vary);
    }
    let shard = shard_of(&args)?;
    let earlier = earlier(args.against.as_deref())?;
    let mut read = read_all(&args.scenarios)?;
    let is_given = args.program.exec.is_some() || args.lockstep.is_given();
    if !is_given {
        leave_out_bare(&mut read)?;
    }
    check_faults(&read, vary, &profile)?;
    let texts = read
        .iter()
        .map(|(name, (_, source))| (name.clone(), source.text.clone()));
    let plan = CampaignPlan {
        tool: format!(
            "hilrig {}, generator {}",
            env!("CARGO_PKG_VERSION"),
            generate::GENERATOR
        ),
        scenarios: texts.collect(),
        seeds: args.seeds.clone(),
        vary: vary.to_string(),
        profile: (!profile.is_gentle()).then(|| profile.kept.clone()),
        exec: is_given.then(|| args.program.repeat() + &args.lockstep.repeat()),
        cpu: args.program.cpu().map(|cpu| cpu.to_string()),
        programs: match &args.program.exec {
            Some(command) => files_named(command),
            None => args.lockstep.files(),
        },
    };
    let mut store = Store::create(&args.out, &plan)?;
    let todo: Vec<(&str, u64)> = plan
        .runs()
        .filter(|&(number, name, seed)| shard.has(number) && !store.has(name, seed))
        .map(|(_, name, seed)| (name, seed))
        .collect();
    let made = |name: &str, seed| {
        let (scenario, source) = &read[name];
        let mut dice = Dice::of_seed(seed, name);
        let mut scenario = generate::scenario(scenario, source, vary, &profile, &mut dice);
        scenario.seed = seed;
        (scenario, source)
    };
    let stop = Stop::new(args.budget.map(|budget| budget.0))?;
    let ended = run_all(&todo, &args, made, &mut store, &stop)?;
    let left = todo.len() - ended;
    let earlier_runs = store.len() - ended;
    if earlier_runs > 0 {
        eprintln!("{ended} runs made now, {earlier_runs} from earlier calls");
    }
    let ended_by = stop.signal().filter(|_| left > 0);
    if left > 0 {
        eprintln!("{left} runs are left; the same command continues");
        println!("{}", covered(&plan, &store, shard));
    }
    let verdict = if shard == Shard::WHOLE {
        let demand = Demand::of_flag(args.all_situations);
        let is_over = || stop.signal().is_some();
        let merged = summarise(&store, earlier.as_ref(), demand, &is_over)?;
        report(&merged, &args.out)
    } else {
        report_shard(&store, left, &args.out)?
    };
    // If the user stopped a campaign with missing runs, a queue must not regard it as finished.
    Ok(ended_by.map_or(verdict, Verdict::Interrupted))
}

/// Counts the failures and minimises a case for each cause; the progress line names the step.
fn summarise(
    store: &Store,
    earlier: Option<&(PathBuf, Store)>,
    demand: Demand,
    is_over: &dyn Fn() -> bool,
) -> Result<Merged, CliError> {
    let is_here = store.plan().exec.is_none();
    if store.failed() > 0 && is_here && is_watched() {
        eprintln!("looking for the smallest case of each cause; Ctrl-C takes the best so far");
    }
    let merged = campaign::summarise(store, earlier, demand, is_over)?;
    if is_over() && is_here && !merged.groups.is_empty() {
        eprintln!("the cases may not be the smallest; the same command continues the search");
    }
    Ok(merged)
}

/// Prints the result of a shard with `left` missing runs.
fn report_shard(store: &Store, left: usize, out: &Path) -> Result<Verdict, CliError> {
    let (runs, failed) = (store.len(), store.failed());
    let far = format!("{runs} runs, {failed} failed, {left} left of this shard");
    let failures = store.failures();
    store.show(&campaign::live_page(store.plan(), &far, &failures, None))?;
    println!("{runs} runs, {failed} failed");
    answer(&CampaignEnded {
        folder: Some(out.display().to_string()),
        runs: runs as u64,
        failed: failed as u64,
        missing: None,
        trace_hash: None,
        causes: Vec::new(),
        never_came_up: Vec::new(),
        missed_goals: Vec::new(),
        unobserved_rules: Vec::new(),
        unjudged_rules: Vec::new(),
        mutants: None,
    });
    println!("results in {}", out.display());
    Ok(if failed == 0 {
        Verdict::Pass
    } else {
        Verdict::Fail
    })
}

/// A finished run: its result, and its case if it failed.
type Ended = (Record, Option<Box<Scenario>>);

/// Runs `todo` until `stop`, on all cores if the runs are in this process. Returns the number of
/// finished runs.
fn run_all<'a>(
    todo: &[(&str, u64)],
    args: &CampaignArgs,
    made: impl Fn(&str, u64) -> (Scenario, &'a Source) + Sync,
    store: &mut Store,
    stop: &Stop,
) -> Result<usize, CliError> {
    let clock = WallClock::start();
    let next = AtomicUsize::new(0);
    let foreign = args.program.foreign();
    let jobs = jobs(args, foreign.is_some());
    let (results, ended) = mpsc::channel::<Result<Ended, CliError>>();
    thread::scope(|scope| {
        for job in 0..jobs {
            let (results, next, made) = (results.clone(), &next, &made);
            let goes_on = move || stop.signal().is_none();
            let worker = Worker {
                foreign: foreign.as_ref(),
                lockstep: Some(&args.lockstep).filter(|args| args.is_given()),
                out: &args.out,
                job,
            };
            workers::spawn(scope, move || {
                while let Some(&(name, seed)) = todo.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if stop.is_due(clock.now()) {
                        break;
                    }
                    let (scenario, source) = made(name, seed);
                    let result = worker.run(&scenario, source, &goes_on).transpose();
                    if result.is_none_or(|result| results.send(result).is_err()) {
                        break;
                    }
                }
            });
        }
        drop(results);
        let (mut count, mut live) = (0, Live::new(todo.len(), clock.now()));
        for result in ended {
            let (record, case) = result?;
            count += 1;
            store.add(&record, case.as_deref())?;
            live.look(count, clock.now(), store)?;
        }
        Ok(count)
    })
}

/// The number of parallel runs.
fn jobs(args: &CampaignArgs, is_foreign: bool) -> usize {
    let jobs = match (args.jobs, is_foreign) {
        (Some(jobs), _) => Some(jobs),
        (None, true) => None,
        (None, false) => thread::available_parallelism().ok(),
    };
    jobs.map_or(1, core::num::NonZeroUsize::get)
}

/// A worker.
struct Worker<'a> {
    foreign: Option<&'a Foreign>,
    lockstep: Option<&'a LockstepArgs>,
    out: &'a Path,
    job: usize,
}

impl Worker<'_> {
    /// The result of a run; `None` if `goes_on` stopped it early.
    fn run(
        &self,
        scenario: &Scenario,
        source: &Source,
        goes_on: &dyn Fn() -> bool,
    ) -> Result<Option<Ended>, CliError> {
        let (record, case) = match self.foreign {
            Some(foreign) => match self.run_foreign(foreign, scenario, source, goes_on)? {
                Some((record, outcome)) => (record, outcome.case),
                None => return Ok(None),
            },
            None => {
                let (record, outcome) = match self.lockstep {
                    Some(program) => {
                        let begin = || program.run(scenario.clone(), source, None);
                        campaign::run_from(scenario, begin, |_| {})?
                    }
                    None => campaign::run(scenario, source)?,
                };
                // A run that panicked has no expanded case; its scenario is used instead.
                let case = outcome.map_or_else(|| scenario.clone(), |outcome| outcome.case);
                (record, case)
            }
        };
        let case = record.cause.is_some().then(|| Box::new(case));
        Ok(Some((record, case)))
    }

    /// Runs the program on ports in its own directory; the program's output is kept if it failed.
    fn run_foreign(
        &self,
        foreign: &Foreign,
        scenario: &Scenario,
        source: &Source,
        goes_on: &dyn Fn() -> bool,
    ) -> Result<Option<(Record, Box<Outcome>)>, CliError> {
        let ports = self.out.join(format!("ports-{}", self.job));
        let ports = std::path::absolute(&ports).unwrap_or(ports);
        let logs = self.out.join("logs");
        let log = logs.join(format!("{}-{}.log", scenario.name, scenario.seed));
        let made = Dir::create(&logs).map(drop);
        made.map_err(|source| FolderError { path: logs, source })?;
        let places = [&ports, &log];
        let judged = campaign::run_foreign(scenario, source, foreign, places, goes_on)?;
        if judged
            .as_ref()
            .is_none_or(|(record, _)| record.cause.is_none())
        {
            // The output of a passed run is not kept.
            let _ = safefs::remove_file(&log);
        }
        Ok(judged)
    }
}

fn report(merged: &Merged, out: &Path) -> Verdict {
    println!(
        "{} runs, {} of virtual time, {} failed, {} missing, trace {}",
        merged.runs,
        merged.virtual_time(),
        merged.failed,
        merged.missing,
        merged.trace
    );
    for group in &merged.groups {
        let (scenario, seed) = &group.first;
        println!("  {:>5}  {}", group.runs, group.cause);
        println!("         first {scenario} seed {seed}: {}", group.detail);
        if let (Some(case), Some(left)) = (&group.case, &group.left) {
            println!("         {left}");
            let exec = merged.plan.exec.as_deref().unwrap_or_default();
            let case = word(&out.join(case));
            println!("         repeat with: hilrig run {case}{exec}");
            if !group.is_minimised {
                println!("         make it small: hilrig shrink {case}{exec}");
            }
        }
    }
    if let Some(comparison) = &merged.comparison {
        report_comparison(comparison);
    }
    let mut all_came_up = true;
    for situation in merged.missed_situations() {
        println!("  never occurred: {situation}");
        all_came_up = false;
    }
    for goal in merged.missed_goals() {
        println!("  FAIL {goal} was not reached in any of the runs");
    }
    for rule in merged.unobserved_rules() {
        println!("  FAIL {rule} was not observed in any of the runs");
    }
    for rule in merged.lost_rules() {
        println!(
            "  not judged: {rule} names an item that no generated mission of this campaign has"
        );
    }
    println!("table in {}", out.join("campaign.html").display());
    answer(&CampaignEnded::of(merged, out));
    let mut missed = merged.missed_goals().chain(merged.unobserved_rules());
    let all_came_up = missed.next().is_none() && (all_came_up || merged.demand == Demand::Listed);
    let all_hold = merged.failed + merged.missing == 0 && all_came_up;
    if all_hold {
        Verdict::Pass
    } else {
        Verdict::Fail
    }
}

fn report_comparison(comparison: &Comparison) {
    println!("{}", comparison.in_words());
    for note in comparison.left_out() {
        println!("  {note}");
    }
    for cause in &comparison.causes {
        println!("  {}: {}", cause.change, cause.cause);
        println!("         {}", cause.in_words());
    }
}
