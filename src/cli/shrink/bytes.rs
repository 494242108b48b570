//! Shrinks a case of bytes: removes lines of bytes to the program while it fails for the same
//! reason.

use std::collections::BTreeSet;

use super::reason::Reason;
use super::{ShrinkArgs, TRIES, TRIES_EXEC, not_bad, not_sound, put};
use crate::capture::case::Case;
use crate::capture::replay::Recorded;
use crate::cli::answer::Shrunk;
use crate::cli::exec::refuse_programs;
use crate::cli::replay::{read, robot, shortened, try_case};
use crate::cli::stop::Stop;
use crate::cli::{CliError, Verdict, out};
use crate::realtime::clock::{Clock as _, WallClock};
use crate::scenario::Source;
use crate::search::shrink::{self, Effort};
use crate::show::shell::word;

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
    let whole = (case.clone(), source.clone());
    let reason = reason(args, &whole, &stop)?.ok_or_else(|| not_bad(&args.file, "passes"))?;
    if let Some(failed) = failure_of_sound(args, &whole, &stop)? {
        return Err(not_sound(&failed));
    }
    let cause = reason.to_string();
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
        let fails_alike = self::reason(args, &candidate, &stop)
            .is_ok_and(|found| found.as_ref() == Some(&reason));
        // Of a program that a signal has cut short, nothing is known.
        fails_alike
            && failure_of_sound(args, &candidate, &stop).is_ok_and(|failed| failed.is_none())
            && stop.signal().is_none()
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
    let repeat = format!("hilrig run {}{}", word(&path), args.program.repeat());
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

/// The reason for which the tested program fails.
fn reason(
    args: &ShrinkArgs,
    case: &(Case, Source),
    stop: &Stop,
) -> Result<Option<Reason>, CliError> {
    let Some(foreign) = args.program.foreign() else {
        return Ok(Reason::of(&case.0.run(&case.1)?.checks, None, ""));
    };
    let tried = try_case(case, &foreign, &args.out.join("tried"), stop)?;
    Ok(Reason::of(
        &tried.judgement.checks,
        tried.ended,
        &tried.said,
    ))
}

/// The checks that fail with the sound program, if one is given.
fn failure_of_sound(
    args: &ShrinkArgs,
    case: &(Case, Source),
    stop: &Stop,
) -> Result<Option<String>, CliError> {
    let Some(command) = &args.sound else {
        return Ok(None);
    };
    let foreign = args.program.foreign_of(command);
    let tried = try_case(case, &foreign, &args.out.join("tried-sound"), stop)?;
    let reason = Reason::of(&tried.judgement.checks, tried.ended, &tried.said);
    Ok(reason.map(|reason| reason.to_string()))
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
