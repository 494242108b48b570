use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::answer::{CaseChecked, CaseMade, CaseTry, CasesChecked};
use super::exec::{ExecArgs, ManyExecArgs, refuse_programs};
use super::replay::{judge_case, sound_of, try_case};
use super::stop::Stop;
use super::{CliError, Verdict, out};
use crate::capture::case::{Case, CaseError, Judgement, Play, Rule};
use crate::capture::replay::{Recorded, scenario_of};
use crate::capture::{Capture, Section};
use crate::run::check::Status;
use crate::scenario::{Scenario, Source, Span};
use crate::show::shell::word;
use engine::near;

/// Make regression tests from captures.
#[derive(Debug, Args)]
pub(super) struct CaseArgs {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    From(From),
    Check(CheckArgs),
}

/// Turn a capture into a regression test.
///
/// A case never expects the behaviour of a broken program. --expect or a reference program
/// (--sound) defines the right behaviour. Every case of your own program expects that the program
/// does not crash, reads its ports and keeps sending on the links on which it sent; without
/// --expect and --sound it expects nothing else.
///
/// The capture of a run with --exec contains its scenario and verdict: in its case the devices of
/// the scenario answer and judge the program, and each check of the run must pass. In a case of
/// any other capture, the answers come from the capture, as a conversation. --play selects one of
/// both.
///
/// With --exec the case is run immediately, and the output says whether it is red or green today.
/// `hilrig case check CASE --exec BROKEN --exec FIXED` compares programs; `hilrig run` runs the
/// case.
///
/// A case of a robot's built-in program contains the bytes that the program received. It must not
/// hang, break the same rule or fail the same check again; if the run had no failure, it must send
/// the same bytes. A dump of one direction tests the decoder: the same frames and diagnosis are
/// expected.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig case from hilrig-out/rescue-flat-1/capture.pcapng -o case.toml\n  \
    hilrig case from field.pcapng --exec 'python3 driver.py' --virtual --expect prints=ready\n  \
    hilrig case from field.pcapng --scenario scenarios/rescue-flat.toml --until 20s \\\n    \
    -o tests/cases/stall.toml --test tests/stall.rs\n  \
    hilrig case check case.toml --virtual --exec ./broken --exec ./fixed\n  \
    hilrig run case.toml\n\n\
    Rules for --expect:\n  \
    no-crash, no-hang            always expected\n  \
    talks, talks=LINK            sends until the end, on each link on which it sent, or on LINK\n  \
    exits=CODE                   ends by itself with this exit code\n  \
    prints=TEXT, never-prints=TEXT   a printed line contains TEXT, or none does\n  \
    sends=[LINK:]HEX, never-sends=[LINK:]HEX   bytes that it sends, or never sends\n  \
    ignores-damage               sends the same, equally early, as without the damaged frames\n  \
    recovers=TIME                never pauses its sending for longer than TIME")]
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
    /// Leave out bytes later than this after the beginning, e.g. 10s
    #[arg(long, value_name = "TIME")]
    until: Option<Span>,
    /// Expected behaviour of the program; may be given several times
    #[arg(long, value_name = "RULE")]
    expect: Vec<Rule>,
    /// Shell command of a reference program: the same lines and bytes are expected
    #[arg(long, value_name = "CMD", requires = "exec")]
    sound: Option<String>,
    /// Source of the answers for your own program [default: the devices, for the capture of a
    /// judged run]
    #[arg(long, value_name = "WHAT")]
    play: Option<Play>,
    /// Write a Rust test that runs the case
    #[arg(long, value_name = "FILE")]
    test: Option<PathBuf>,
    #[command(flatten)]
    program: ExecArgs,
}

/// Run a case with several programs and say for each whether it is red or green.
///
/// The last program is the fixed one: the exit code is 0 if the case is green with it and red with
/// all others. With a folder this must be true of each case in it.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig case check case.toml --virtual --exec ./broken --exec ./fixed\n  \
    hilrig case check cases/ --virtual --exec ./fixed     # all cases of a folder")]
struct CheckArgs {
    /// The case, or a folder of cases: its files that end with .toml
    #[arg(value_name = "CASE")]
    file: PathBuf,
    #[command(flatten)]
    programs: ManyExecArgs,
    /// Folder for ports and program.log of each program
    #[arg(long, value_name = "DIR", default_value = "hilrig-out/case-check")]
    out: PathBuf,
}

pub(super) fn run(args: CaseArgs) -> Result<Verdict, CliError> {
    match args.command {
        Command::From(args) => from(&args),
        Command::Check(args) => check(&args),
    }
}

fn from(args: &From) -> Result<Verdict, CliError> {
    args.program.refuse_cpu("case from")?;
    let capture = super::replay::read(&args.file)?;
    let recorded = Recorded::of(&capture, args.until.map(|until| until.0));
    let recorded = super::replay::shortened(&args.file, recorded);
    let stem = args
        .out
        .file_stem()
        .and_then(|stem| stem.to_str())
        .unwrap_or("case");
    let is_own = |section: &Section| section.is_of_own_program();
    let concluded = capture.conclusion.as_ref();
    // Without a robot there is no program of its own.
    let has_robot =
        args.scenario.is_some() || !matches!(scenario_of(&capture, &args.file), Ok(None));
    let is_foreign = args.program.exec.is_some()
        || concluded.is_some_and(|one| one.is_foreign())
        || !has_robot
        || !capture.sections.iter().all(is_own);
    let is_asked = is_foreign && (args.program.exec.is_some() || concluded.is_some());
    let (mut case, source) = match (recorded.is_one_way() && !is_asked, is_foreign) {
        (true, _) => decoder_case(args, stem, &recorded)?,
        (false, true) => foreign_case(args, stem, &capture, &recorded)?,
        (false, false) => {
            let given = args.scenario.as_deref();
            let (scenario, source) = super::replay::robot(&capture, &args.file, given)?;
            (Case::of(stem, &recorded, &scenario, &source)?, source)
        }
    };
    case.description = format!("made of {}", args.file.display());
    // `case check` judges as this command does.
    case.expect.may_end = args.program.may_end();
    let talking = case.expect.talks.clone();
    for rule in &args.expect {
        case.expect.add(rule.clone(), &talking);
        check_rule(rule, &case, &source)?;
    }
    if let Some(command) = &args.sound {
        let stop = Stop::new(None)?;
        let foreign = args.program.foreign_of(command);
        let out = Path::new("hilrig-out").join(format!("{stem}-sound"));
        let both = (case, source.clone());
        let sound = sound_of(&both, &foreign, &out, &stop)?;
        case = both.0;
        case.expect.sound = Some(sound);
    }
    write(&args.out, &case.to_toml())?;
    say_what_is_expected(args, &case, concluded.and_then(|one| one.failed()));
    let now = match args.program.foreign() {
        Some(foreign) if case.expect.decoder.is_empty() => {
            let out = Path::new("hilrig-out").join(stem);
            print!("today: ");
            Some(judge_case(
                &(case.clone(), source),
                &foreign,
                &out,
                &Stop::new(None)?,
            )?)
        }
        _ => match case.run(&source) {
            Err(CaseError::NeedsProgram { .. }) => {
                println!("today: not run; --exec CMD runs a program");
                None
            }
            now => {
                let now = now?;
                println!("today: {now}");
                Some(now)
            }
        },
    };
    if let Some(path) = &args.test {
        let is_started = args.program.exec.is_some() && case.expect.decoder.is_empty();
        if now.is_none() {
            let error =
                "--test: a case of your own program, expected --exec CMD: the test starts it";
            return Err(CliError::Usage(error.to_owned()));
        }
        write(path, &test(args, stem, is_started))?;
    }
    report(args, now.as_ref());
    Ok(Verdict::Pass)
}

/// Rejects a rule about a link that the case does not have, and a rule that is never judged.
fn check_rule(rule: &Rule, case: &Case, source: &Source) -> Result<(), CliError> {
    if let (Rule::IgnoresDamage, Some(why)) = (rule, case.why_damage_is_not_judged()) {
        return Err(CliError::Usage(format!("--expect ignores-damage: {why}")));
    }
    if let (Rule::IgnoresDamage, false) = (rule, case.is_foreign) {
        let error = "--expect ignores-damage: is judged only with your own program; expected \
                     --exec CMD";
        return Err(CliError::Usage(error.to_owned()));
    }
    let Some(link) = rule.link() else {
        return Ok(());
    };
    let known = case.links(source);
    let all: Vec<&str> = known.iter().flatten().map(String::as_str).collect();
    match known.is_none() || all.contains(&link) {
        true => Ok(()),
        false => Err(CliError::Usage(format!(
            "--expect: the link {}",
            near::expected(link, &all)
        ))),
    }
}

/// Creates a case of the user's own program.
fn foreign_case(
    args: &From,
    stem: &str,
    capture: &Capture,
    recorded: &Recorded,
) -> Result<(Case, Source), CliError> {
    let concluded = capture.conclusion.as_ref().filter(|one| one.is_foreign());
    let given = args.scenario.as_deref();
    let run = match (concluded, given) {
        (Some(concluded), None) => {
            let text = concluded.case.clone();
            let parsed = Scenario::parse(&args.file, text);
            Some(parsed.map_err(|error| CliError::content(&args.file, error))?)
        }
        (None, None) => super::replay::robot(capture, &args.file, None).ok(),
        (_, Some(_)) => Some(super::replay::robot(capture, &args.file, given)?),
    };
    let play = args.play.unwrap_or(match concluded {
        Some(_) if given.is_none() => Play::Devices,
        _ => Play::Conversation,
    });
    match (play, run) {
        (Play::Devices, Some((scenario, source))) => {
            Ok((Case::of_run(stem, recorded, &scenario), source))
        }
        (Play::Devices, None) => {
            let error = "does not say which devices answer: expected --scenario FILE";
            Err(CliError::content(&args.file, error))
        }
        (Play::Conversation, run) => {
            let (scenario, source) = match run {
                Some((scenario, source)) => (Some(scenario), source),
                None => (None, no_source(&args.out)),
            };
            Ok((Case::of_outsider(stem, recorded, scenario.as_ref()), source))
        }
    }
}

fn no_source(path: &Path) -> Source {
    Source {
        path: path.to_owned(),
        text: String::new(),
    }
}

fn check(args: &CheckArgs) -> Result<Verdict, CliError> {
    args.programs.refuse_cpu("case check")?;
    let stop = Stop::new(None)?;
    if !args.file.is_dir() {
        let (checked, verdict) = check_file(args, &args.file, &args.out, &stop)?;
        out::answer(&checked);
        return Ok(verdict);
    }
    let (mut cases, mut verdicts, mut broken) = (Vec::new(), Vec::new(), None);
    for file in cases_in(&args.file)? {
        println!("{}", file.display());
        let name = file.file_stem().unwrap_or_default();
        match check_file(args, &file, &args.out.join(name), &stop) {
            Ok((checked, verdict)) => {
                cases.push(checked);
                verdicts.push(verdict);
            }
            // The other cases are checked all the same.
            Err(error) => {
                println!("  error: {error}");
                broken = broken.or(Some(error));
            }
        }
        if stop.signal().is_some() {
            break;
        }
    }
    out::answer(&CasesChecked { cases });
    match (stop.signal(), broken) {
        (Some(signal), _) => Ok(Verdict::Interrupted(signal)),
        (None, Some(error)) => Err(error),
        (None, None) if verdicts.contains(&Verdict::Fail) => Ok(Verdict::Fail),
        (None, None) => Ok(Verdict::Pass),
    }
}

/// The cases in a folder, by name.
fn cases_in(folder: &Path) -> Result<Vec<PathBuf>, CliError> {
    let wrong = |error| CliError::read(folder, error);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(wrong)? {
        let path = entry.map_err(wrong)?.path();
        if path.extension().is_some_and(|end| end == "toml") {
            files.push(path);
        }
    }
    files.sort();
    if files.is_empty() {
        let error = "contains no file that ends with .toml; expected a case, or a folder of cases";
        return Err(CliError::content(folder, error));
    }
    Ok(files)
}

/// Checks one case with all programs, whose ports and logs are in folders of `out`.
fn check_file(
    args: &CheckArgs,
    file: &Path,
    out: &Path,
    stop: &Stop,
) -> Result<(CaseChecked, Verdict), CliError> {
    let case = Case::read(file)?;
    if let Some(scenario) = &case.0.scenario {
        refuse_programs("case check", file, scenario)?;
    }
    let mut tried = Vec::new();
    for (number, foreign) in (1..).zip(args.programs.foreign()) {
        let one = try_case(&case, &foreign, &out.join(format!("{number}")), stop)?;
        let judgement = one.judgement;
        let is_green = judgement.passed();
        let color = if is_green { "green" } else { "red" };
        println!("{color}  {}", foreign.command);
        let failed = |status| status == Status::Fail;
        let failed = judgement.checks.iter().filter(|check| failed(check.status));
        failed.for_each(|check| println!("  {check}"));
        if let Some(cause) = one.cause {
            println!("  probable cause: {cause}");
        }
        tried.push(CaseTry {
            command: foreign.command,
            is_green,
            checks: judgement.checks,
        });
        if stop.signal().is_some() {
            break;
        }
    }
    let is_green: Vec<bool> = tried.iter().map(|one| one.is_green).collect();
    let verdict = match (stop.signal(), is_green.split_last()) {
        (Some(signal), _) => Verdict::Interrupted(signal),
        (None, Some((true, others))) if !others.contains(&true) => Verdict::Pass,
        _ => Verdict::Fail,
    };
    let checked = CaseChecked {
        file: file.display().to_string(),
        programs: tried,
    };
    Ok((checked, verdict))
}

fn decoder_case(args: &From, stem: &str, recorded: &Recorded) -> Result<(Case, Source), CliError> {
    let case = Case::of_decoders(stem, recorded)?.ok_or_else(|| {
        let error = "contains one direction only and no frame of a known protocol; expected both \
                     directions, or frames";
        CliError::content(&args.file, error)
    })?;
    Ok((case, no_source(&args.out)))
}

fn write(path: &Path, text: &str) -> Result<(), CliError> {
    safefs::write(path, text).map_err(|error| CliError::write(path.display(), error))
}

fn say_what_is_expected(args: &From, case: &Case, failed: Option<Vec<&str>>) {
    println!("{} expects:", args.out.display());
    if case.expect.same_outputs {
        println!("  the program sends the same bytes");
    }
    if case.play == Some(Play::Devices) {
        println!("  the devices of the scenario answer, and each check of the run passes");
        if let Some(failed) = failed {
            println!("  failed in the captured run: {}", failed.join(", "));
        }
    }
    if case.is_foreign {
        println!("  the program does not crash and reads its ports to the end");
    }
    for link in &case.expect.talks {
        println!("  the program sends on {link} to the end");
    }
    for rule in &case.expect.never {
        println!("  never again: {rule}");
    }
    for check in &case.expect.checks {
        println!("  passes: {check}");
    }
    for words in case.expect.in_words() {
        println!("  {words}");
    }
    for decoded in &case.expect.decoder {
        let (link, direction, of) = (&decoded.link, &decoded.direction, &decoded.protocol);
        let lines = decoded.found.lines().count();
        println!("  the decoder of {of} finds the same in {link} {direction}: {lines} lines");
    }
    let has_rules = !args.expect.is_empty() || args.sound.is_some();
    if case.play == Some(Play::Conversation) && !has_rules {
        println!(
            "  nothing else: define the right behaviour with --expect RULE or --sound CMD, \
             e.g. --expect prints=TEXT"
        );
    }
}

fn report(args: &From, now: Option<&Judgement>) {
    let (out, exec) = (args.out.display(), args.program.repeat());
    let exec = if now.is_none() {
        " --exec CMD".to_owned()
    } else {
        exec
    };
    let repeat = format!("hilrig run {}{exec}", word(&args.out));
    let color = now.map(|now| if now.passed() { "green" } else { "red" });
    if let (Some(color), true) = (color, args.program.exec.is_some()) {
        println!("the case is {color} today");
    }
    println!("run it with: {repeat}");
    out::answer(&CaseMade {
        file: out.to_string(),
        checks: now.map(|now| now.checks.clone()).unwrap_or_default(),
        passes_today: now.map(Judgement::passed),
        repeat,
    });
}

/// The source of a Rust test that runs the case. If the case needs the user's own program,
/// `hilrig run` starts it.
fn test(args: &From, name: &str, is_started: bool) -> String {
    let fits = |c: char| {
        if c.is_ascii_alphanumeric() {
            c.to_ascii_lowercase()
        } else {
            '_'
        }
    };
    let name: String = name.chars().map(fits).collect();
    let uses = if is_started {
        ""
    } else {
        "use std::path::Path;\n\n"
    };
    let body = match is_started {
        true => {
            let repeat = format!("hilrig run {}{}", word(&args.out), args.program.repeat());
            format!(
                "let mut run = std::process::Command::new(\"sh\");\n    \
                 let status = run.args([\"-c\", {repeat:?}]).status().expect(\"a shell\");\n    \
                 assert!(status.success(), \"{{status}}\");\n"
            )
        }
        false => {
            let path = args.out.display().to_string();
            format!(
                "let (case, source) = hilrig::capture::case::Case::read(Path::new({path:?})).expect(\"a case\");\n    \
                 let judgement = case.run(&source).expect(\"it can be played\");\n    \
                 assert!(judgement.passed(), \"{{judgement}}\");\n"
            )
        }
    };
    format!(
        "//! Runs a saved case; made by `hilrig case from`.\n\n{uses}\
         #[test]\nfn case_{name}_holds() {{\n    {body}}}\n"
    )
}
