mod bytes;
mod reason;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::Args;

use super::answer::Shrunk;
use super::exec::{ExecArgs, refuse_programs};
use super::lockstep::LockstepArgs;
use super::replay::refuse_foreign;
use super::run::{Clocking, Talk, judged_run};
use super::stop::Stop;
use super::{CliError, Verdict, out};
use crate::capture::Capture;
use crate::capture::case::{Case, CaseError, Play};
use crate::realtime::clock::{Clock, WallClock};
use crate::realtime::exec::Foreign;
use crate::run::Outcome;
use crate::scenario::{Scenario, Source, text_of};
use crate::search::campaign::{self, Record};
use crate::search::shrink::{self, Branches, Effort, Judged, Repair, Unit};
use crate::show::folder::FolderError;
use crate::show::shell::word;
use safefs::Dir;

/// Make a failing case or a capture smaller while it still fails for the same reason.
///
/// A case must keep failing the same check in the same manner (standing still, to and fro, pose
/// lost) or, for a violation, by the same rule. Its trigger (faults or an obstacle) stays: without
/// it, the case passes. A case of bytes, as `hilrig case from` writes it, keeps failing the same
/// checks with fewer bytes; a program that has ended must end with the same exit code and the same
/// last line. With --sound the smaller case also stays green with a fixed program. A capture keeps
/// the first error in its bytes; with --scenario or --exec it is shrunk as a case of `hilrig case
/// from`. With --while your own command decides: it gets the file as its last argument and exits
/// with 0 while the file still fails.
///
/// With --exec your program is tested: each try is a run in real time, 100 at most. A failure that
/// occurs only sometimes is hard to minimise.
///
/// Ctrl-C ends the search; the best so far is the result.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig shrink hilrig-out/rescue-flat-1/case.toml\n  \
    hilrig shrink capture.pcapng --while 'my-parser --crashes' --out small\n  \
    hilrig shrink field.pcapng --scenario scenarios/rescue-flat.toml\n  \
    hilrig shrink case.toml --exec 'python3 driver.py' --virtual\n  \
    hilrig shrink night/cases/0.toml --firmware sketch.elf --board arduino-uno\n  \
    hilrig shrink case.toml --exec './driver-1.0' --sound './driver-1.1' --virtual\n  \
    hilrig shrink hilrig-out/rescue-flat-1/case.toml --exec './my-robot \"$HILRIG_DIR\"'")]
pub(super) struct ShrinkArgs {
    /// A case or scenario (.toml), or a capture (.pcapng)
    #[arg(value_name = "CASE|CAPTURE")]
    file: PathBuf,
    /// Shrink while this command exits with 0, given the file as last argument
    #[arg(long = "while", value_name = "CMD", conflicts_with_all = ["exec", "firmware", "node"])]
    command: Option<String>,
    /// Scenario of the robot in the capture: its built-in program is tested
    #[arg(long, value_name = "FILE", conflicts_with = "command")]
    scenario: Option<PathBuf>,
    /// Do not correct checksums when the bytes of a frame are simplified
    #[arg(long)]
    keep_checksums: bool,
    #[command(flatten)]
    program: ExecArgs,
    #[command(flatten)]
    lockstep: LockstepArgs,
    /// Shell command of a fixed program, with which the smaller case must pass
    #[arg(long, value_name = "CMD", requires = "exec")]
    sound: Option<String>,
    /// Folder for the result
    #[arg(long, value_name = "DIR", default_value = "hilrig-out/shrunk")]
    out: PathBuf,
}

/// Maximum number of tries; a finished search needs far fewer.
const TRIES: u32 = 20_000;
/// Maximum number of tries with a foreign program, because each takes as long as its run.
const TRIES_EXEC: u32 = 100;

pub(super) fn run(args: &ShrinkArgs) -> Result<Verdict, CliError> {
    args.program.refuse_cpu("shrink")?;
    args.lockstep.check("shrink", args.program.exec.is_some())?;
    let is_capture = args.file.extension().is_some_and(|end| end == "pcapng");
    if args.lockstep.is_given() && is_capture {
        return Err(in_lockstep(args));
    }
    make_folder(&args.out)?;
    match args.file.extension().and_then(|name| name.to_str()) {
        Some("pcapng") if args.program.exec.is_some() || args.scenario.is_some() => {
            bytes::of_capture(args)
        }
        Some("pcapng") => shrink_capture(args),
        _ if args.scenario.is_some() => {
            let error = "--scenario: expected a capture (.pcapng); a case contains its scenario";
            Err(CliError::Usage(error.to_owned()))
        }
        _ => shrink_file(args),
    }
}

/// The error for bytes of a capture, which only a program at ports gets.
fn in_lockstep(args: &ShrinkArgs) -> CliError {
    let option = args.lockstep.names(false).next().unwrap_or_default();
    let file = args.file.display();
    let error = format!("{option}: {file} has bytes of a capture, which need a program of --exec");
    CliError::Usage(error)
}

/// A case or a scenario.
fn shrink_file(args: &ShrinkArgs) -> Result<Verdict, CliError> {
    let text = text_of(&args.file)?;
    if !Case::is_meant(&text) {
        let (scenario, source) = Scenario::parse(&args.file, text)?;
        refuse_programs("shrink", &args.file, &scenario)?;
        return shrink_case(args, scenario, &source);
    }
    let (case, source) = Case::parse(&args.file, text)?;
    if let Some(scenario) = &case.scenario {
        refuse_programs("shrink", &args.file, scenario)?;
    }
    match (case.play, &case.scenario) {
        (Some(Play::Devices), Some(_)) if args.program.exec.is_none() => {
            let path = source.path;
            Err(CliError::Case(CaseError::NeedsProgram { path }))
        }
        (Some(Play::Devices), Some(scenario)) => shrink_case(args, scenario.clone(), &source),
        _ if args.lockstep.is_given() => Err(in_lockstep(args)),
        _ => bytes::of_case(args, case, source),
    }
}

fn make_folder(path: &Path) -> Result<(), CliError> {
    let made = Dir::create(path).map(drop);
    made.map_err(|source| cannot_write(path, source))
}

fn cannot_write(path: &Path, source: std::io::Error) -> CliError {
    let path = path.to_owned();
    CliError::Folder(FolderError { path, source })
}

fn put(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    safefs::write(path, bytes).map_err(|source| cannot_write(path, source))
}

/// Whether `command` still finds a failure in `path`.
fn is_bad(command: &str, path: &Path) -> bool {
    let status = Command::new("sh")
        .args(["-c", &format!("{command} \"$0\"")])
        .arg(path)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    status.is_ok_and(|status| status.success())
}

fn not_bad(file: &Path, what: &str) -> CliError {
    CliError::content(file, format!("{what}, expected a file that fails"))
}

fn not_sound(failed: &str) -> CliError {
    let error =
        format!("--sound: fails with the whole case ({failed}), expected a program that passes");
    CliError::Usage(error)
}

/// The failure of the program of --sound, if it fails.
fn failure_of_sound(
    args: &ShrinkArgs,
    scenario: &Scenario,
    source: &Source,
    is_over: &dyn Fn() -> bool,
) -> Result<Option<String>, CliError> {
    let Some(command) = &args.sound else {
        return Ok(None);
    };
    let foreign = args.program.foreign_of(command);
    let ran = run_foreign(args, &foreign, scenario, source, is_over)?;
    Ok(ran.and_then(|(record, _)| record.cause))
}

fn shrink_case(
    args: &ShrinkArgs,
    scenario: Scenario,
    source: &Source,
) -> Result<Verdict, CliError> {
    let (stop, clock) = (Stop::new(None)?, WallClock::start());
    let is_over = || stop.is_due(clock.now());
    let is_yours = args.program.exec.is_some() || args.lockstep.is_given();
    if let Some(failed) = failure_of_sound(args, &scenario, source, &is_over)? {
        return Err(not_sound(&failed));
    }
    let (branches, record, outcome) = match is_yours {
        true => match run_yours(args, &scenario, source, &is_over)? {
            Some((record, outcome)) => (Branches::new(source, ""), record, outcome),
            None => return Ok(Verdict::Interrupted(stop.signal().unwrap_or_default())),
        },
        false => Branches::begin(source, &scenario)?,
    };
    // Written as the bytes that they hit, random faults can be removed one by one.
    let expanded = outcome.map_or_else(|| scenario.clone(), |outcome| outcome.case);
    let cause = record.cause.unwrap_or_default();
    let path = args.out.join("case.toml");
    let tries = if is_yours { TRIES_EXEC } else { TRIES };
    let mut effort = Effort::until(tries, &is_over);
    let mut judge = judge(args, source, branches, &cause, &path, &is_over);
    let start = [expanded.clone(), scenario]
        .into_iter()
        .find(|case| judge(case) == Judged::FailsAlike);
    let start = start.ok_or_else(|| not_bad(&args.file, "passes"))?;
    let small = shrink::scenario(&start, &cause, &mut judge, &mut effort);
    let faults = [expanded.fault.len(), small.fault.len()];
    put(&path, small.to_toml().as_bytes())?;
    let said = shrink::in_words(&small);
    put(
        &args.out.join("cause.txt"),
        format!("{cause}\n{said}\n").as_bytes(),
    )?;
    if !is_yours {
        let text = small.to_toml();
        let (pace, talk, stop) = (Clocking::Virtual, Talk::Verdict, Stop::new(None)?);
        judged_run(small, source, None, &args.out, pace, talk, &stop)?;
        // The run wrote its own case, with its origin.
        put(&path, text.as_bytes())?;
    }
    let tries = effort.spent();
    println!("{cause}");
    println!(
        "{} faults left of {}, {tries} tries. {said}",
        faults[1], faults[0]
    );
    let exec = args.program.repeat() + &args.lockstep.repeat();
    let repeat = format!("hilrig run {}{exec}", word(&path));
    println!("repeat with: {repeat}");
    out::answer(&Shrunk {
        file: path.display().to_string(),
        cause: cause.clone(),
        left: said.to_string(),
        tries: tries.into(),
        repeat,
    });
    Ok(Verdict::Pass)
}

/// A finished run; without an outcome if the rig panicked.
type Ended = (Record, Option<Box<Outcome>>);

/// Runs the user's program; `None` if it is time to stop.
fn run_yours(
    args: &ShrinkArgs,
    scenario: &Scenario,
    source: &Source,
    is_over: &dyn Fn() -> bool,
) -> Result<Option<Ended>, CliError> {
    if let Some(foreign) = args.program.foreign() {
        let ran = run_foreign(args, &foreign, scenario, source, is_over)?;
        return Ok(ran.map(|(record, outcome)| (record, Some(outcome))));
    }
    if is_over() {
        return Ok(None);
    }
    let begin = || args.lockstep.run(scenario.clone(), source, None);
    campaign::run_from(scenario, begin, |_| {}).map(Some)
}

/// Runs the foreign program; `None` if it is time to stop.
fn run_foreign(
    args: &ShrinkArgs,
    foreign: &Foreign,
    scenario: &Scenario,
    source: &Source,
    is_over: &dyn Fn() -> bool,
) -> Result<Option<(Record, Box<Outcome>)>, CliError> {
    let ports = args.out.join("ports");
    let ports = std::path::absolute(&ports).unwrap_or(ports);
    let places = [&ports, &args.out.join("program.log")];
    Ok(campaign::run_foreign(
        scenario,
        source,
        foreign,
        places,
        &|| !is_over(),
    )?)
}

/// The result of a candidate, compared with `cause`.
fn judge<'a>(
    args: &'a ShrinkArgs,
    source: &'a Source,
    mut branches: Branches<'a>,
    cause: &'a str,
    path: &'a Path,
    is_over: &'a dyn Fn() -> bool,
) -> impl FnMut(&Scenario) -> Judged + 'a {
    let is_yours = args.program.exec.is_some() || args.lockstep.is_given();
    let of = |record: Record| Judged::of(record.cause.as_deref(), cause);
    move |candidate| match (&args.command, is_yours) {
        (_, true) => match run_yours(args, candidate, source, is_over) {
            Ok(Some((record, _))) => match of(record) {
                Judged::FailsAlike
                    if !matches!(failure_of_sound(args, candidate, source, is_over), Ok(None)) =>
                {
                    Judged::FailsOtherwise
                }
                judged => judged,
            },
            _ => Judged::FailsOtherwise,
        },
        (Some(command), false) => {
            let is_written = safefs::write(path, candidate.to_toml()).is_ok();
            match is_written && is_bad(command, path) {
                true => Judged::FailsAlike,
                false => Judged::Passes,
            }
        }
        (None, false) => branches.judge(candidate),
    }
}

fn shrink_capture(args: &ShrinkArgs) -> Result<Verdict, CliError> {
    let read = Capture::read(&args.file);
    let whole = read.map_err(|error| CliError::read(&args.file, error))?;
    refuse_foreign(&args.file, &whole)?;
    let units = shrink::units(&whole);
    let cause = match &args.command {
        Some(command) => format!("{command} exits with 0"),
        None => shrink::fault_of(&whole, &units)
            .ok_or_else(|| not_bad(&args.file, "nothing is wrong with its bytes"))?,
    };
    let path = args.out.join("capture.pcapng");
    let (stop, clock) = (Stop::new(None)?, WallClock::start());
    let is_over = || stop.is_due(clock.now());
    let mut effort = Effort::until(TRIES, &is_over);
    let fails = |left: &[Unit]| {
        let smaller = shrink::with_units(&whole, left);
        match &args.command {
            Some(command) => {
                let bytes = shrink::to_bytes(&smaller);
                safefs::write(&path, bytes).is_ok() && is_bad(command, &path)
            }
            None => {
                let again = shrink::units(&smaller);
                shrink::fault_of(&smaller, &again).as_ref() == Some(&cause)
            }
        }
    };
    if !fails(&units) {
        return Err(not_bad(&args.file, "the command does not exit with 0"));
    }
    let repairs = if args.keep_checksums {
        Repair::Nothing
    } else {
        Repair::Checksums
    };
    let small = shrink::capture(&units, fails, &mut effort, repairs);
    put(
        &path,
        &shrink::to_bytes(&shrink::with_units(&whole, &small)),
    )?;
    let said = format!(
        "{cause}\n{} frames and stretches of bytes left of {}, {} tries.",
        small.len(),
        units.len(),
        effort.spent()
    );
    put(&args.out.join("cause.txt"), format!("{said}\n").as_bytes())?;
    println!("{said}");
    let repeat = format!("hilrig decode {}", word(&path));
    println!("look at it with: {repeat}");
    out::answer(&Shrunk {
        file: path.display().to_string(),
        left: format!("{} of {} frames and stretches", small.len(), units.len()),
        cause: cause.clone(),
        tries: effort.spent().into(),
        repeat,
    });
    Ok(Verdict::Pass)
}
