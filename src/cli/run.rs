mod broken;
mod exec;
mod folders;
mod guest;
mod judged;
mod twice;

use core::time::Duration;
use std::path::{Path, PathBuf};

use clap::Args;

use super::answer::{RunEnded, Runs};
use super::ends::EndArgs;
use super::exec::{ExecArgs, is_bare};
use super::lockstep::LockstepArgs;
use super::replay::judge_case;
use super::show::{Show, ShowArgs};
use super::stop::Stop;
use super::{CliError, Verdict, out};
use crate::capture::case::{Case, Judgement};
use crate::realtime::exec::Cpu;
use crate::robots;
use crate::run::check::Status;
use crate::scenario::{FaultKind, Scenario, Source, text_of};
use crate::show::folder::FolderError;
use crate::show::junit::{Suite, junit};
use crate::show::shell::word;

use broken::Broken;
pub(super) use exec::ports_in;
use exec::{Placement, judged_exec};
use folders::{Folders, check_folders, folder_of};
pub(super) use guest::{Beginning, report};
use guest::{Guest, judged_guest};
use judged::judged_with;
pub(super) use judged::{Clocking, Ran, Talk, judged_run, make_folder, write_results};

/// Run scenarios and judge them, for CI.
///
/// Each run writes a result folder. If a check fails, the command that repeats the case is
/// printed. With --exec your program replaces the robot's own and is judged, too: it must open its
/// ports, not crash, keep reading, and leave no child process. Its output is in program.log of the
/// result folder. Ctrl-C, SIGTERM and SIGHUP end the run and judge it.
#[derive(Debug, Args)]
#[command(
    after_long_help = "Examples:\n  hilrig run scenarios/rescue-flat.toml\n  \
    hilrig run scenarios/*.toml --junit junit.xml\n  \
    hilrig run hilrig-out/rescue-flat-1/case.toml   # a saved case: the same bytes again\n  \
    hilrig run scenarios/rescue-flat.toml --exec './my-robot \"$HILRIG_DIR\"'\n  \
    hilrig run bench.toml --exec ./planner --virtual --cpu 20   # on a processor 20 times slower\n  \
    hilrig run bench.toml --node ./driver     # a driver that speaks the node protocol, docs/nodes.md\n  \
    hilrig run scenarios/own-slave.toml --exec 'python3 grip.py \"$HILRIG_PORT_GRIPPER\"' \\\n    \
    --exec-needs gripper --exec-may-end      # a test that ends by itself"
)]
pub(super) struct RunArgs {
    /// Scenario files, or saved cases: of runs, or of bytes
    #[arg(required = true, value_name = "SCENARIO")]
    scenarios: Vec<PathBuf>,
    /// Seed instead of the scenarios' own
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    /// Folder for the results; with several scenarios, one folder in it for each
    /// [default: hilrig-out/NAME-SEED]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Run in real time instead of as fast as possible; the verdicts are the same
    #[arg(long)]
    realtime: bool,
    #[command(flatten)]
    program: ExecArgs,
    #[command(flatten)]
    lockstep: LockstepArgs,
    /// Wait for gdb on this TCP port; the rig's time stands while gdb holds the program
    #[arg(
        long,
        value_name = "PORT",
        requires = "firmware",
        help_heading = "Firmware without a board"
    )]
    #[arg(value_parser = clap::value_parser!(u16).range(1..))]
    gdb: Option<u16>,
    /// Run the program twice in virtual time; if the runs differ, name the first different call
    #[arg(long, requires = "is_virtual")]
    check: bool,
    /// Write the answer of virtual time to each call of the program
    #[arg(long, value_name = "FILE", requires = "is_virtual")]
    trace_calls: Option<PathBuf>,
    /// Open the control socket in virtual time: time passes only while a client waits for a
    /// condition or a step, and after the last client has left (docs/control.md)
    #[arg(long, requires = "is_virtual", conflicts_with = "check")]
    control: bool,
    /// Speak JSON with node programs, one object a line, instead of the binary form
    #[arg(long)]
    json_nodes: bool,
    /// Directory in which the ports of --exec appear [default: OUT/ports]
    #[arg(long, value_name = "DIR", requires = "exec")]
    dir: Option<PathBuf>,
    #[command(flatten)]
    ends: EndArgs,
    /// Treat the end of standard input as SIGTERM, so that the run ends together with the process
    /// that started it
    #[arg(long)]
    until_eof: bool,
    #[command(flatten)]
    show: ShowArgs,
    /// Write the verdicts of all runs as JUnit XML; a file that cannot be read or run is a failure
    /// in it, and the other files run
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
}

impl RunArgs {
    /// The options that choose the program under test and its ports, each after a blank.
    fn repeat(&self) -> String {
        self.program.repeat() + &self.lockstep.repeat() + &self.ends.repeat()
    }
}

pub(super) fn run(args: RunArgs) -> Result<Verdict, CliError> {
    // All files are read before the first run, so that an error in the last one is not found after
    // an hour.
    let (mut files, mut broken) = (Vec::new(), Broken::default());
    for path in &args.scenarios {
        match Runnable::read(path) {
            Ok(file) => files.push((path, file)),
            Err(error) => broken.keep(args.junit.is_some(), path, error)?,
        }
    }
    check(&args, &files)?;
    check_folders(&args, &files)?;
    if args.json_nodes {
        nodes::set_form(nodes::Form::Json);
    }
    let mut show = args.show.start()?;
    let stop = Stop::new(None)?;
    if args.until_eof {
        stop.at_end_of_input();
    }
    for (_, file) in &files {
        if let Runnable::Scenario(scenario) = file {
            warn(&scenario.0, &scenario.1, args.program.cpu());
            let is_of_file = scenario.0.programs().next().is_some();
            if args.program.is_virtual() || is_of_file {
                warn_of_pieces(&scenario.0, &scenario.1);
            }
        }
    }
    let several = args.scenarios.len() > 1;
    let (mut ended, mut answers) = (Vec::new(), Runs::default());
    let (mut wall, mut folders) = (Duration::ZERO, Folders::default());
    for (path, file) in files {
        let file = match file {
            Runnable::Scenario(scenario) => *scenario,
            Runnable::Case(case) => {
                let out = folders.of_case(args.out.as_deref(), &case.0.name, several);
                let judgement = match one_case(&args, &case, &out, &stop) {
                    Ok(judgement) => judgement,
                    Err(error) => {
                        broken.keep(args.junit.is_some(), path, error)?;
                        continue;
                    }
                };
                let repeat = format!("hilrig run {}{}", word(path), args.program.repeat());
                answers.runs.push(answer_of(&judgement, &repeat));
                ended.push(Finished::new(path, Ended::Case(judgement, repeat)));
                continue;
            }
        };
        let seed = args.seed.unwrap_or(file.0.seed);
        let out = folder_of(&args, &file.0.name, seed, several);
        let ran = match one(&args, file, &out, &mut show, &stop) {
            Ok(ran) => ran,
            Err(error) => {
                broken.keep(args.junit.is_some(), path, error)?;
                continue;
            }
        };
        wall += ran.wall;
        // Measured computing is in the saved case only.
        let repeat = match args.program.cpu() {
            Some(_) => repeat_of_case(&args, &out),
            None => format!("hilrig run {} --seed {seed}{}", word(path), args.repeat()),
        };
        let repeat = Some(repeat).filter(|_| !ran.outcome.passed());
        if let Some(repeat) = &repeat {
            eprintln!("repeat with: {repeat}");
        }
        answers.runs.push(ran.answer(&out, repeat));
        ended.push(Finished::new(path, Ended::Run(Box::new(ran))));
        if stop.signal().is_some() {
            break;
        }
    }
    out::answer(&answers);
    if let Some(path) = args.junit {
        let suites = ended.iter().map(Finished::suite).chain(broken.suites());
        let text = junit(suites, wall);
        safefs::write(&path, text).map_err(|source| FolderError { path, source })?;
    }
    broken.end()?;
    let verdicts: Vec<Verdict> = ended.iter().map(|one| one.ended.verdict()).collect();
    Ok(match stop.signal() {
        Some(signal) => Verdict::Interrupted(signal),
        None if verdicts.contains(&Verdict::Fail) => Verdict::Fail,
        None if verdicts.contains(&Verdict::NotJudged) => Verdict::NotJudged,
        None => Verdict::Pass,
    })
}

/// The command that runs the saved case of a result folder.
fn repeat_of_case(args: &RunArgs, out: &Path) -> String {
    let case = out.join("case.toml");
    format!("hilrig run {}{}", word(&case), args.repeat())
}

/// Warns about keys of a scenario without effect.
pub(super) fn warn(scenario: &Scenario, source: &Source, cpu: Option<Cpu>) {
    for warning in robots::warnings(scenario, source) {
        eprintln!("warning: {warning}");
    }
    if scenario.computing.is_some() && cpu != Some(Cpu::OfCase) {
        let message = "has no effect without --exec CMD --virtual --cpu case";
        let span = source.find("computing");
        let warning = source.invalid(span, "computing".to_owned(), message);
        eprintln!("warning: {warning}");
    }
}

/// Warns about faults that virtual time does not show to a program.
pub(super) fn warn_of_pieces(scenario: &Scenario, source: &Source) {
    for (index, fault) in scenario.fault.iter().enumerate() {
        if fault.kind != FaultKind::ShortRead {
            continue;
        }
        let message = "has no effect in virtual time, where each byte arrives by itself: run \
                       without --virtual, or set adapter in [link.NAME]";
        let span = source.find_in_list("fault", index, "kind");
        let warning = source.invalid(span, format!("fault[{index}].kind"), message);
        eprintln!("warning: {warning}");
    }
}

/// A case of bytes in the form of `--json`.
fn answer_of(judgement: &Judgement, repeat: &str) -> RunEnded {
    RunEnded {
        name: judgement.name.clone(),
        seed: None,
        verdict: Status::of(judgement.passed()),
        checks: judgement.checks.clone(),
        probable_cause: None,
        metrics: None,
        trace_hash: None,
        folder: None,
        repeat: (!judgement.passed()).then(|| repeat.to_owned()),
    }
}

/// Runs one scenario, with a foreign program if one is given.
fn one(
    args: &RunArgs,
    (mut scenario, source): (Scenario, Source),
    out: &Path,
    show: &mut Show,
    stop: &Stop,
) -> Result<Ran, CliError> {
    scenario.seed = args.seed.unwrap_or(scenario.seed);
    let lockstep = &args.lockstep;
    let again = Some(repeat_of_case(args, out));
    let foreign = match lockstep.firmware.is_given() {
        true => lockstep.firmware.foreign(&scenario, &source, args.gdb)?,
        false => args.program.foreign(),
    };
    let foreign = match foreign {
        Some(foreign) => Some(foreign),
        None => args.program.of_file(&scenario, &source)?,
    };
    if lockstep.is_given() && foreign.is_none() {
        let run = lockstep.run(scenario, &source, args.gdb)?;
        let pace = match args.realtime {
            true => Clocking::Realtime(show),
            false => Clocking::Virtual,
        };
        return judged_with(run, out, pace, Talk::Verdict, again, stop);
    }
    let Some(foreign) = foreign else {
        if is_bare(&scenario, &source)? {
            let name = &scenario.name;
            eprintln!("{name}: its robot has no program; --exec CMD starts one");
        }
        let pace = match args.realtime {
            true => Clocking::Realtime(show),
            false => Clocking::Virtual,
        };
        return judged_run(scenario, &source, args.seed, out, pace, Talk::Verdict, stop);
    };
    let place = Placement {
        again,
        out,
        dir: args.dir.as_deref(),
        ends: &args.ends,
        is_shown: args.show.is_wanted(),
        show,
    };
    if foreign.supervision.is_none() {
        return judged_exec(scenario, &source, foreign, place, stop);
    }
    let guest = Guest {
        foreign,
        trace: args.trace_calls.clone(),
        is_checked: args.check,
        is_controlled: args.control,
    };
    judged_guest((&scenario, &source), &guest, &place, stop)
}

/// Plays one case of bytes, to a foreign program if one is given.
fn one_case(
    args: &RunArgs,
    case: &(Case, Source),
    out: &Path,
    stop: &Stop,
) -> Result<Judgement, CliError> {
    args.program.refuse_cpu("run with a case of bytes")?;
    if let Some(foreign) = args.program.foreign() {
        return judge_case(case, &foreign, out, stop);
    }
    let judgement = case.0.run(&case.1)?;
    println!("{judgement}");
    Ok(judgement)
}

/// Rejects contradicting options.
fn check(args: &RunArgs, files: &[(&PathBuf, Runnable)]) -> Result<(), CliError> {
    check_programs(args, files)?;
    let mut files_with = files.iter().filter(|(_, file)| file.has_programs());
    if let (true, Some((path, _))) = (args.realtime || args.show.is_wanted(), files_with.next()) {
        return Err(CliError::Usage(format!(
            "--realtime, --ui: {} starts the programs of its [exec.NAME] in virtual time; leave the \
             option out",
            path.display()
        )));
    }
    let is_exec = args.program.exec.is_some();
    let wrong = match () {
        () if args.show.is_wanted() && !args.realtime && !is_exec => {
            "--ui: needs --realtime or --exec; \"hilrig ui\" runs at any speed"
        }
        () if args.ends.is_given() && !is_exec => {
            "--dut-at, --device-at: needs --exec; or use \"hilrig up\""
        }
        () if args.show.is_wanted() && args.program.is_virtual() => {
            "--ui: not possible with --virtual, because a page cannot follow at that speed"
        }
        () if args.ends.is_given() && args.program.is_virtual() => {
            "--dut-at, --device-at: not possible with --virtual, because a real port is in real time"
        }
        () => return Ok(()),
    };
    Err(CliError::Usage(wrong.to_owned()))
}

/// Rejects two programs under test, and a program to which a case of bytes could not be played.
fn check_programs(args: &RunArgs, files: &[(&PathBuf, Runnable)]) -> Result<(), CliError> {
    let has_exec = args.program.exec.is_some();
    let mut given = args.lockstep.names(has_exec);
    let Some(first) = given.next() else {
        return Ok(());
    };
    let mut files_with = files.iter().filter(|(_, file)| file.has_programs());
    if let Some((path, _)) = files_with.next() {
        return Err(CliError::Usage(format!(
            "{first}: {} starts the programs of its [exec.NAME], expected no other one; leave {first} \
             out, or the tables",
            path.display()
        )));
    }
    args.lockstep.refuse_second(has_exec)?;
    let mut cases = files
        .iter()
        .filter(|(_, file)| matches!(file, Runnable::Case(_)));
    match cases.next() {
        Some((path, _)) if first != "--exec" => Err(CliError::Usage(format!(
            "{first}: {} is a case of bytes, which needs a program of --exec; expected a scenario",
            path.display()
        ))),
        _ => Ok(()),
    }
}

/// A file with a scenario or a case.
pub(super) enum Runnable {
    Scenario(Box<(Scenario, Source)>),
    /// A case of bytes from a capture.
    Case(Box<(Case, Source)>),
}

impl Runnable {
    /// Whether this is a scenario that names its programs.
    fn has_programs(&self) -> bool {
        matches!(self, Self::Scenario(file) if file.0.programs().next().is_some())
    }

    pub(super) fn read(path: &Path) -> Result<Self, CliError> {
        let text = text_of(path)?;
        if !Case::is_meant(&text) {
            return Ok(Self::Scenario(Box::new(Scenario::parse(path, text)?)));
        }
        let case = Case::parse(path, text)?;
        Ok(Self::Case(Box::new(case)))
    }
}

/// The result of a run.
enum Ended {
    Run(Box<Ran>),
    /// With the command that repeats it.
    Case(Judgement, String),
}

/// A finished file.
struct Finished {
    path: PathBuf,
    ended: Ended,
}

impl Ended {
    fn verdict(&self) -> Verdict {
        match self {
            Self::Run(ran) => ran.verdict(),
            Self::Case(judgement, _) if judgement.passed() => Verdict::Pass,
            Self::Case(..) => Verdict::Fail,
        }
    }
}

impl Finished {
    fn new(path: &Path, ended: Ended) -> Self {
        let path = path.to_owned();
        Self { path, ended }
    }

    fn suite(&self) -> Suite<'_> {
        let file = Some(&*self.path);
        match &self.ended {
            Ended::Run(ran) => Suite {
                file,
                ..Suite::from(&ran.outcome)
            },
            Ended::Case(Judgement { name, checks, .. }, again) => Suite {
                name,
                file,
                seed: None,
                checks,
                unproved: Vec::new(),
                again: Some(again),
                probable_cause: None,
            },
        }
    }
}
