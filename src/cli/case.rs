use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::answer::CaseMade;
use super::exec::ExecArgs;
use super::replay::judge_case;
use super::stop::Stop;
use super::{CliError, Verdict, out};
use crate::capture::Section;
use crate::capture::case::{Case, Judgement};
use crate::capture::replay::Recorded;
use crate::scenario::{Source, Span};
use crate::show::whole_file;

/// Make regression tests from captures.
#[derive(Debug, Args)]
pub(super) struct CaseArgs {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    From(From),
}

/// Turn a capture into a regression test.
///
/// The case holds the bytes that reached the program, and what is expected of it: if the captured
/// program broke a rule of a device, that it does not again; if it stopped talking, that it talks
/// to the end; if it failed a check of every run, that it passes; else that it sends the same
/// bytes. `hilrig run` runs the case, with the robot's built-in program or with --exec CMD.
///
/// A dump of one direction says nothing of a program: its case tests the decoder. Expected are the
/// frames that it finds today, the bytes outside of them, and the diagnosis.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig case from hilrig-out/rescue-flat-1/capture.pcapng -o case.toml\n  \
    hilrig case from field.pcapng --scenario scenarios/rescue-flat.toml --until 20s \\\n    \
    -o tests/cases/stall.toml --test tests/stall.rs\n  \
    hilrig case from field.pcapng --exec 'python3 my_robot.py'\n  \
    hilrig run case.toml")]
struct From {
    /// Capture to take the bytes from
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Case to write
    #[arg(short, long, value_name = "FILE", default_value = "case.toml")]
    out: PathBuf,
    /// Scenario whose robot this is [default: the one in the capture]
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Leave out what comes later than this after the beginning, e.g. 10s
    #[arg(long, value_name = "TIME")]
    until: Option<Span>,
    /// Write a Rust test that runs the case
    #[arg(long, value_name = "FILE")]
    test: Option<PathBuf>,
    #[command(flatten)]
    program: ExecArgs,
}

pub(super) fn run(args: CaseArgs) -> Result<Verdict, CliError> {
    let Command::From(args) = args.command;
    let capture = super::replay::read(&args.file)?;
    let recorded = Recorded::of(&capture, args.until.map(|until| until.0));
    let recorded = super::replay::shortened(&args.file, recorded);
    let stem = args
        .out
        .file_stem()
        .and_then(|stem| stem.to_str())
        .unwrap_or("case");
    let (mut case, source) = match recorded.is_one_way() && args.program.exec.is_none() {
        true => decoder_case(&args, stem, &recorded)?,
        false => {
            let given = args.scenario.as_deref();
            let (scenario, source) = super::replay::robot(&capture, &args.file, given)?;
            let mut case = Case::of(stem, &recorded, &scenario, &source)?;
            let is_own = |section: &Section| section.is_of_own_program();
            case.is_foreign |= !capture.sections.iter().all(is_own);
            (case, source)
        }
    };
    case.description = format!("made of {}", args.file.display());
    write(&args.out, &case.to_toml())?;
    if let Some(path) = &args.test {
        write(path, &test(stem, &args.out))?;
    }
    let now = match args.program.foreign() {
        Some(foreign) if case.expect.decoder.is_empty() => {
            let out = Path::new("hilrig-out").join(stem);
            let both = (case.clone(), source);
            judge_case(&both, &foreign, &out, &Stop::new(None)?)?
        }
        _ => case.run(&source)?,
    };
    report(&args, &case, &now);
    Ok(Verdict::Pass)
}

fn decoder_case(args: &From, stem: &str, recorded: &Recorded) -> Result<(Case, Source), CliError> {
    let case = Case::of_decoders(stem, recorded)?.ok_or_else(|| {
        let error = "goes one way only and has no frame of any known protocol: expected both ways, \
                     or frames";
        CliError::content(&args.file, error)
    })?;
    let source = Source {
        path: args.out.clone(),
        text: String::new(),
    };
    Ok((case, source))
}

fn write(path: &Path, text: &str) -> Result<(), CliError> {
    whole_file::write(path, text).map_err(|error| CliError::write(path.display(), error))
}

fn report(args: &From, case: &Case, now: &Judgement) {
    println!("{} expects:", args.out.display());
    if case.expect.same_outputs {
        println!("  the program sends the same bytes");
    }
    for link in &case.expect.talks {
        println!("  the program talks on {link} to the end");
    }
    for rule in &case.expect.never {
        println!("  never again: {rule}");
    }
    for check in &case.expect.checks {
        println!("  passes: {check}");
    }
    for decoded in &case.expect.decoder {
        let (link, direction, of) = (&decoded.link, &decoded.direction, &decoded.protocol);
        let lines = decoded.found.lines().count();
        println!("  the decoder of {of} finds the same in {link} {direction}: {lines} lines");
    }
    println!("today: {now}");
    let (out, exec) = (args.out.display(), args.program.repeat());
    let repeat = format!("hilrig run {out}{exec}");
    println!("run it with: {repeat}");
    out::answer(&CaseMade {
        file: out.to_string(),
        checks: now.checks.clone(),
        passes_today: now.passed(),
        repeat,
    });
}

/// A test that runs the case at `path`.
fn test(name: &str, path: &Path) -> String {
    let fits = |c: char| {
        if c.is_ascii_alphanumeric() {
            c.to_ascii_lowercase()
        } else {
            '_'
        }
    };
    let name: String = name.chars().map(fits).collect();
    let path = path.display().to_string();
    format!(
        "//! Runs a saved case; made by `hilrig case from`.\n\n\
         use std::path::Path;\n\n\
         #[test]\n\
         fn case_{name}_holds() {{\n    \
         let (case, source) = hilrig::capture::case::Case::read(Path::new({path:?})).expect(\"a case\");\n    \
         let judgement = case.run(&source).expect(\"it can be played\");\n    \
         assert!(judgement.passed(), \"{{judgement}}\");\n\
         }}\n"
    )
}
