//! Shrinks a case of bytes: removes lines of bytes to the program while the same check fails.

use std::collections::BTreeSet;
use std::path::Path;

use super::{ShrinkArgs, TRIES, TRIES_EXEC, not_bad, put};
use crate::capture::case::{Case, Judgement};
use crate::capture::replay::Recorded;
use crate::cli::answer::Shrunk;
use crate::cli::exec::refuse_programs;
use crate::cli::replay::{read, robot, shortened, try_case};
use crate::cli::stop::Stop;
use crate::cli::{CliError, Verdict, out};
use crate::realtime::clock::{Clock as _, WallClock};
use crate::run::check::Status;
use crate::scenario::Source;
use crate::search::shrink::{self, Effort};

/// Reads a capture as a case.
pub(super) fn of_capture(args: &ShrinkArgs) -> Result<Verdict, CliError> {
    let capture = read(&args.file)?;
    let recorded = shortened(&args.file, Recorded::of(&capture, None));
    let given = args.scenario.as_deref();
    let robot = robot(&capture, &args.file, given);
    if let Ok((scenario, _)) = &robot {
        refuse_programs("shrink", given.unwrap_or(&args.file), scenario)?;
    }
    let (case, source) = match args.program.exec.is_some() {
        true => {
            let robot = robot.ok();
            let scenario = robot.as_ref().map(|(scenario, _)| scenario);
            let case = Case::of_outsider("shrunk", &recorded, scenario);
            let source = robot.map(|(_, source)| source).unwrap_or_else(|| Source {
                path: args.file.clone(),
                text: String::new(),
            });
            (case, source)
        }
        false => {
            let (scenario, source) = robot?;
            (Case::of("shrunk", &recorded, &scenario, &source)?, source)
        }
    };
    of_case(args, case, source)
}

/// A line of bytes: the number of its link, and of the line.
type Line = (usize, usize);

/// A case.
pub(super) fn of_case(args: &ShrinkArgs, case: Case, source: Source) -> Result<Verdict, CliError> {
    if args.command.is_some() {
        let error =
            "--while: expected a scenario or a capture; a case is judged by its own expectations";
        return Err(CliError::Usage(error.to_owned()));
    }
    let (stop, clock) = (Stop::new(None)?, WallClock::start());
    let is_over = || stop.is_due(clock.now());
    let first = judge(args, &(case.clone(), source.clone()), &stop)?;
    let cause = failed(&first).ok_or_else(|| not_bad(&args.file, "passes"))?;
    let mut lines = Vec::new();
    for (number, link) in case.link.iter().enumerate() {
        lines.extend((0..link.to_program.lines().count()).map(|line| (number, line)));
    }
    let tries = match args.program.exec {
        Some(_) => TRIES_EXEC,
        None => TRIES,
    };
    let mut effort = Effort::until(tries, &is_over);
    let fails = |left: &[Line]| {
        let candidate = (with_lines(&case, left), source.clone());
        let judged = judge(args, &candidate, &stop);
        judged.is_ok_and(|judged| failed(&judged).as_ref() == Some(&cause))
    };
    let left = shrink::fewest(&lines, &mut effort, fails);
    let path = args.out.join("case.toml");
    put(&path, with_lines(&case, &left).to_toml().as_bytes())?;
    let (all, few, tries) = (lines.len(), left.len(), effort.spent());
    let said = format!("{few} lines of bytes left of {all}, {tries} tries.");
    put(
        &args.out.join("cause.txt"),
        format!("{cause}\n{said}\n").as_bytes(),
    )?;
    println!("{cause}\n{said}");
    let repeat = format!("hilrig run {}{}", path.display(), args.program.repeat());
    println!("repeat with: {repeat}");
    out::answer(&Shrunk {
        file: path.display().to_string(),
        cause,
        left: format!("{few} of {all} lines of bytes"),
        tries: tries.into(),
        repeat,
    });
    Ok(Verdict::Pass)
}

fn judge(args: &ShrinkArgs, case: &(Case, Source), stop: &Stop) -> Result<Judgement, CliError> {
    match args.program.foreign() {
        Some(foreign) => {
            let out: &Path = &args.out.join("tried");
            Ok(try_case(case, &foreign, out, stop)?.judgement)
        }
        None => Ok(case.0.run(&case.1)?),
    }
}

/// The names of the checks that failed.
fn failed(judgement: &Judgement) -> Option<String> {
    let failed = judgement.checks.iter();
    let failed = failed.filter(|check| check.status == Status::Fail);
    let names: BTreeSet<&str> = failed.map(|check| &*check.name).collect();
    (!names.is_empty()).then(|| Vec::from_iter(names).join(", "))
}

/// `case` with only these lines to the program.
fn with_lines(case: &Case, left: &[Line]) -> Case {
    let left: BTreeSet<Line> = left.iter().copied().collect();
    let mut small = case.clone();
    for (number, link) in small.link.iter_mut().enumerate() {
        let lines = link.to_program.lines().enumerate();
        let lines = lines.filter(|&(line, _)| left.contains(&(number, line)));
        link.to_program = lines.map(|(_, text)| format!("{text}\n")).collect();
    }
    small
}
