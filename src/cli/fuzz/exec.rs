//! `hilrig fuzz --exec` and `--dut-dir`: a foreign program or board.

mod jobs;

use core::cell::Cell;
use core::time::Duration;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ::description::Description;
use clap::Args;
use protocols::Instant;

use super::FuzzArgs;
use crate::cli::answer::FuzzEnded;
use crate::cli::exec::read_without_programs;
use crate::cli::stop::Stop;
use crate::cli::{CliError, Verdict, described, out, progress};
use crate::realtime::clock::{Clock, WallClock};
use crate::realtime::exec::Supervision;
use crate::scenario::device::description::DescriptionSpec;
use crate::scenario::{Scenario, Source, Span};
use crate::search::fuzz::dut::{
    self, Corpus, ErrorRule, Finding, GivenUp, Harness, HarnessError, Progress, Search, Speech,
    Spent, TrialPlan, Whose,
};

/// The program under test.
#[derive(Debug, Args)]
#[command(next_help_heading = "Your program")]
pub(super) struct ExecArgs {
    /// Fuzz the program that this shell command starts, restarted for each case; its ports are in
    /// the directory $HILRIG_DIR
    #[arg(long, value_name = "CMD", conflicts_with_all = [
        "dut_dir", "targets", "vary", "profile"
    ])]
    exec: Option<String>,
    /// Fuzz the program or board at the ports in this directory, e.g. links to real ports; it is
    /// never restarted
    #[arg(long, value_name = "DIR", conflicts_with_all = ["targets", "jobs", "vary", "profile"])]
    dut_dir: Option<PathBuf>,
    /// Directory in which the ports appear [default: OUT/ports]
    #[arg(long, value_name = "DIR", requires = "exec")]
    dir: Option<PathBuf>,
    /// Length of a case
    #[arg(long, value_name = "TIME", default_value = "2s")]
    case: Span,
    /// Time within which the program must read, send or answer after a case
    #[arg(long, value_name = "TIME", default_value = "2s")]
    alive: Span,
    /// Time within which the program must open a port
    #[arg(long, value_name = "TIME", default_value = "10s", requires = "exec")]
    start: Span,
    /// Run in virtual time: as fast as possible, with the same bytes each time; Linux on x86-64
    #[arg(long = "virtual", requires = "exec")]
    is_virtual: bool,
    /// Judge timing rules too; on a busy machine the program may break them without a defect
    #[arg(long)]
    strict: bool,
    /// Which error exits are findings: a program may report an altered input as an error and exit
    #[arg(long, value_name = "WHEN", default_value = "unaltered")]
    errors: ErrorRule,
    /// Description of the program's device: its frames, fields and limits are then known instead of
    /// guessed; without a program the device itself is fuzzed. One that comes with the tool, by its
    /// name, or a file that ends with .toml [default: those of the scenario's described devices]
    #[arg(long, value_name = "NAME|FILE", conflicts_with_all = ["targets", "vary", "profile"])]
    pub(super) description: Option<String>,
    /// Baud rate of the port, without a scenario [default: the program's]
    #[arg(long, value_name = "N", requires = "exec", conflicts_with = "scenario",
        value_parser = clap::value_parser!(u32).range(300..=4_000_000))]
    baud: Option<u32>,
    /// Maximum number of cases for minimising a finding
    #[arg(long, value_name = "N", default_value_t = 30, requires = "exec")]
    shrink: u32,
}

/// Duration without --for and --cases.
const TIME: Duration = Duration::from_secs(60);
/// Time between two lines of progress.
const PROGRESS: Duration = Duration::from_secs(2);
/// Virtual time of each stopped call.
const CALL_COST: Duration = Duration::from_micros(1);
/// Minimum of the maximum processor time of computing without a call.
const SPIN_MIN: Duration = Duration::from_secs(2);
/// Name of the scenario of a program without one, and its line.
const ONE_PORT: &str = "one-port";
const BAUD: u32 = 115_200;
/// Maximum duration of a case, because all its bytes are held in memory.
const CASE_MAX: Duration = Duration::from_secs(3600);

impl ExecArgs {
    /// Whether a foreign program is to be fuzzed.
    pub(super) const fn is_wanted(&self) -> bool {
        self.exec.is_some() || self.dut_dir.is_some()
    }

    fn whose(&self, out: &Path) -> Result<Whose, CliError> {
        match (&self.exec, &self.dut_dir) {
            (Some(command), _) => {
                let dir = self.dir.clone().unwrap_or_else(|| out.join("ports"));
                let dir = std::path::absolute(&dir).map_err(|error| {
                    let text = format!("--dir {}: {error}", dir.display());
                    CliError::Usage(text)
                })?;
                let command = command.clone();
                Ok(Whose::Command { command, dir })
            }
            (None, dir) => Ok(Whose::Ports(dir.clone().unwrap_or_default())),
        }
    }

    /// The command that repeats a finding, up to its folder.
    fn repeat(&self) -> String {
        let quoted = |text: &str| format!("'{}'", text.replace('\'', "'\\''"));
        let mut words = "hilrig fuzz".to_owned();
        for (option, value) in [
            ("--exec", self.exec.clone()),
            (
                "--dut-dir",
                self.dut_dir.as_ref().map(|dir| dir.display().to_string()),
            ),
            (
                "--dir",
                self.dir.as_ref().map(|dir| dir.display().to_string()),
            ),
        ] {
            if let Some(value) = value {
                words += &format!(" {option} {}", quoted(&value));
            }
        }
        words += &format!(" --alive {}", self.alive);
        words += if self.strict { " --strict" } else { "" };
        words += if self.is_virtual { " --virtual" } else { "" };
        if self.exec.is_some() {
            words += &format!(" --start {}", self.start);
        }
        if let Some(description) = &self.description {
            words += &format!(" --description {}", quoted(description));
        }
        if let Some(baud) = self.baud {
            words += &format!(" --baud {baud}");
        }
        if self.errors != ErrorRule::default() {
            words += &format!(" --errors {}", self.errors);
        }
        words
    }
}

pub(super) fn run(args: &FuzzArgs) -> Result<Verdict, CliError> {
    let own = &args.exec;
    if !(Duration::from_millis(1)..=CASE_MAX).contains(&own.case.0) {
        let text = format!("--case {}: expected a time from 1ms to 1h", own.case);
        return Err(CliError::Usage(text));
    }
    match &args.repeat {
        Some(folder) => repeat(args, folder),
        None => match args.jobs {
            Some(jobs) if jobs.get() > 1 => jobs::search(args, jobs),
            _ => search(args),
        },
    }
}

fn harness<'a>(
    args: &FuzzArgs,
    (scenario, source): (&Scenario, Source),
    goes_on: &'a dyn Fn() -> bool,
) -> Result<Harness<'a>, CliError> {
    let whose = args.exec.whose(&args.out)?;
    let is_one_port = scenario.name == ONE_PORT;
    let times = [args.exec.alive.0, args.exec.start.0];
    let mut harness = Harness::new(whose, source, times, goes_on);
    if args.exec.exec.is_some() {
        harness.watch_coverage(&args.out)?;
    }
    harness.is_any_rate = is_one_port && args.exec.baud.is_none();
    harness.is_mute = is_one_port;
    harness.errors = args.exec.errors;
    harness.is_strict = args.exec.strict || args.exec.is_virtual;
    harness.supervision = args.exec.is_virtual.then_some(Supervision {
        call_cost: CALL_COST,
        // Virtual time stands still while the program computes.
        spin_max: args.exec.alive.0.max(SPIN_MIN),
        schedule: None,
        cpu: None,
    });
    Ok(harness)
}

/// Runs the case of one finding.
fn repeat(args: &FuzzArgs, folder: &Path) -> Result<Verdict, CliError> {
    let (case, source, key) = Finding::read(folder)?;
    let (stop, clock) = (Stop::new(None)?, WallClock::start());
    let goes_on = || !stop.is_due(clock.now());
    let harness = harness(args, (&case.scenario, source), &goes_on)?;
    let link = case.told.raw.as_ref().map(|raw| raw.link.as_str());
    let ends = harness.ends(&case.scenario, link)?;
    let speech = ends.into_iter().find(|(end, _)| Some(&*end.link) == link);
    let speech = speech.map_or(Speech::Bytes, |(_, speech)| speech);
    let recording = folder.join("repeated.pcapng");
    let seen = dut::run(&harness, &case, &speech, &recording)?;
    for cause in &seen.causes {
        println!("{cause}");
    }
    out::answer(&FuzzEnded {
        folder: folder.display().to_string(),
        findings: seen.causes.len() as u64,
        targets: Vec::new(),
    });
    let is_again = seen.causes.iter().any(|cause| cause.key() == key);
    let shown = recording.display();
    match is_again {
        true => println!("seen again: {key}; bytes in {shown}"),
        false => println!("not seen again: {key}; bytes in {shown}"),
    }
    Ok(match seen.causes.is_empty() {
        true => Verdict::Pass,
        false => Verdict::Fail,
    })
}

fn search(args: &FuzzArgs) -> Result<Verdict, CliError> {
    let (scenario, source) = match (&args.scenario, &args.corpus) {
        (Some(path), _) => read_without_programs("fuzz", path)?,
        (None, _) if args.exec.exec.is_some() && args.exec.description.is_some() => {
            described_port(args)?
        }
        (None, Some(_)) if args.exec.exec.is_some() => one_port(args)?,
        _ => {
            let text = "--scenario is missing, expected a scenario with the program's devices, \
                        --description of its device, or --corpus with bytes of a device";
            return Err(CliError::Usage(text.to_owned()));
        }
    };
    let corpus = args.corpus.as_deref().map(Corpus::read).transpose();
    let link = match (&args.scenario, &args.exec.description) {
        (None, None) => Some(args.port().to_owned()),
        (None, Some(_)) => args
            .link
            .clone()
            .or_else(|| scenario.device.keys().next().cloned()),
        _ => args.link.clone(),
    };
    let plan = TrialPlan {
        descriptions: descriptions(args, &scenario, &source)?,
        scenario,
        corpus: corpus.map_err(HarnessError::from)?,
        link,
        seed: args.seed,
        lasting: args.exec.case.0,
        tries: args.exec.shrink,
        out: args.out.clone(),
        repeat: args.exec.repeat(),
    };
    let time = args.time.map(|time| time.0);
    let stop = Stop::new(time.or_else(|| args.cases.is_none().then_some(TIME)))?;
    let (clock, said) = (WallClock::start(), Cell::new(Instant::ZERO));
    let done = Progress::default();
    let goes_on = || {
        let now = clock.now();
        if now - said.get() >= PROGRESS {
            said.set(now);
            if progress::is_watched() {
                eprintln!("  {}", in_words(&done, now - Instant::ZERO));
            }
        }
        !stop.is_due(now)
    };
    let harness = harness(args, (&plan.scenario, source), &goes_on)?;
    let mut search = Search::new(&harness, plan, &done)?;
    let most = args.cases.unwrap_or(u64::MAX);
    while search.next() < most {
        match search.step() {
            Ok(true) => {}
            Ok(false) => {
                eprintln!("  the device does not answer any more: reset it to continue");
                break;
            }
            Err(HarnessError::Interrupted) => break,
            Err(error) => return Err(error.into()),
        }
    }
    println!("{}", in_words(&done, clock.now() - Instant::ZERO));
    out::answer(&FuzzEnded {
        folder: args.out.display().to_string(),
        findings: search.findings().len() as u64,
        targets: Vec::new(),
    });
    report(args, &search);
    let started = done.cases.get() - search.saved_starts();
    println!("{}", cost(args, harness.spent(), started));
    if done.cases.get() > 0 && !done.has_spoken.get() {
        eprintln!(
            "note: the program never sent a byte, so only crashes, hangs and endless waits were \
             observed. If it plays the device, --corpus needs requests that it answers"
        );
    }
    if search.saved_starts() > 0 {
        let saved = search.saved_starts();
        println!("{saved} cases began at the program's first wait, without a start");
    }
    Ok(match search.findings().is_empty() {
        true => Verdict::Pass,
        false => Verdict::Fail,
    })
}

/// A description, and its link; `None`: any link.
type LinkDescription = (Option<String>, Arc<Description>);

/// The descriptions of the devices: the named one, or those of the scenario.
fn descriptions(
    args: &FuzzArgs,
    scenario: &Scenario,
    source: &Source,
) -> Result<Vec<LinkDescription>, CliError> {
    if let Some(name) = &args.exec.description {
        let description = described::load("--description", name)?;
        return Ok(vec![(args.link.clone(), description)]);
    }
    let base = source.path.parent().unwrap_or_else(|| ".".as_ref());
    let mut all = Vec::new();
    for (link, device) in &scenario.device {
        let Some(DescriptionSpec(units)) = device.settings() else {
            continue;
        };
        for unit in units {
            // Building the scenario reports a wrong description or address.
            let Ok(description) = unit.load(base) else {
                continue;
            };
            let other = unit.address.map(|one| description.with_address(one));
            let description = other.and_then(Result::ok).unwrap_or(description);
            all.push((Some(link.clone()), description));
        }
    }
    Ok(all)
}

/// A scenario with only the described device.
fn described_port(args: &FuzzArgs) -> Result<(Scenario, Source), CliError> {
    let file = args.exec.description.as_deref().unwrap_or_default();
    let description = described::load("--description", file)?;
    let link = args.link.as_deref().unwrap_or(description.name());
    let file = match file.strip_suffix(".toml") {
        Some(_) => std::path::absolute(file)
            .map_or_else(|_| file.into(), |path| path.display().to_string()),
        None => file.to_owned(),
    };
    let text = format!(
        "schema = 1\nname = \"{}\"\nrobot = \"none\"\nduration = \"60s\"\n\
         [device]\n{link} = {{ description = {} }}\n",
        description.name(),
        toml::Value::String(file),
    );
    Ok(Scenario::parse(Path::new("--description"), text)?)
}

/// A scenario of one port without a device.
fn one_port(args: &FuzzArgs) -> Result<(Scenario, Source), CliError> {
    let (name, baud) = (args.port(), args.exec.baud.unwrap_or(BAUD));
    let text = format!(
        "schema = 1\nname = \"{ONE_PORT}\"\nrobot = \"none\"\nduration = \"60s\"\n\
         [device.{name}.text]\nbaud = {baud}\ncommand = []\n"
    );
    Ok(Scenario::parse(Path::new("--link"), text)?)
}

fn in_words(progress: &Progress, time: Duration) -> String {
    let (cases, seconds) = (progress.cases.get(), time.as_secs_f64());
    let inputs = progress.inputs.get();
    let rate = inputs as f64 / seconds.max(1e-3);
    let findings = progress.findings.get();
    let more = match progress.tries.get() {
        0 => String::new(),
        tries => format!("; a new one is run again and made smaller, {tries} tries"),
    };
    format!(
        "{seconds:.1} s: {cases} cases with {inputs} inputs, {rate:.1} inputs/s, {findings} \
         findings{more}"
    )
}

/// Prints where the time was spent, and how to make the search faster.
fn cost(args: &FuzzArgs, spent: Spent, started: u64) -> String {
    let share = |part: Duration| 100.0 * part.as_secs_f64() / spent.wall.as_secs_f64().max(1e-9);
    let (starts, rig) = (share(spent.starts), spent.rig.as_secs_f64());
    let each = spent.starts.as_secs_f64() * 1e3 / started.max(1) as f64;
    let mut text = format!("time: {starts:.0} % for starts of the program, {each:.0} ms each");
    if args.exec.is_virtual {
        text += &format!("; the rest for its calls, in {rig:.0} s of virtual time");
    } else {
        text += &format!("; the rest waits for {rig:.0} s of the line, --virtual does not");
    }
    text
}

/// Prints the findings, and the limits of this search.
fn report(args: &FuzzArgs, search: &Search<'_>) {
    for kept in search.findings() {
        let folder = args.out.join("findings").join(&kept.folder);
        let (words, count, case) = (&kept.words, kept.count, kept.case);
        println!(
            "{}: {words}; {count} times, first in case {case}",
            folder.display()
        );
        println!(
            "  repeat with: {} --repeat '{}'",
            args.exec.repeat(),
            folder.display()
        );
    }
    for met in search.met().filter(|met| !met.link.is_empty()) {
        let (learned, is_damaged) = search.answers(&met.link);
        match met.answered.len() {
            0 if learned > 0 && is_damaged => println!(
                "{}: learned requests that are answered: {learned}; they are also sent damaged",
                met.link
            ),
            0 if learned > 0 => println!(
                "{}: learned requests that are answered: {learned}; no checksum is sure, so \
                 it is unknown whether damaged ones are accepted",
                met.link
            ),
            0 if met.lacks_noise => println!(
                "{}: any bytes are a frame of its format, so no damaged frames are sent",
                met.link
            ),
            // A driver answers nothing: its requests get altered replies instead.
            0 if search.asks(&met.link) => {}
            0 => println!(
                "{}: no frame was answered, so it is unknown whether damaged ones are accepted",
                met.link
            ),
            count => println!(
                "{}: {count} requests are answered, and are also sent damaged",
                met.link
            ),
        }
    }
    for (link, lesson) in search.lessons() {
        println!("{link}: learned {lesson}");
    }
    for (error, count) in search.reported() {
        println!(
            "{count} times the program ended by itself after altered bytes, which is no finding: \
             {error}"
        );
    }
    let given_up = search.given_up();
    if given_up.cases > 0 {
        println!(
            "{} conversations ended after {:.1} of {} inputs on average, because the program ended; \
             if it asks again instead, a case has more inputs",
            given_up.cases,
            given_up.inputs as f64 / given_up.cases as f64,
            GivenUp::INPUTS_MAX
        );
    }
    let unfinished = search.unfinished();
    if unfinished.cases > 0 && unfinished.inputs > 0 {
        let inputs = unfinished.inputs as f64 / unfinished.cases as f64;
        let lasting = args.exec.case.0.as_secs_f64() * GivenUp::INPUTS_MAX as f64 / inputs;
        println!(
            "{} conversations had {inputs:.1} of {} inputs on average, because the program sends \
             few requests; with --case {}s a conversation has all of them",
            unfinished.cases,
            GivenUp::INPUTS_MAX,
            lasting.ceil()
        );
    }
    if search.is_guided() {
        println!("the program counts its covered code, which guided the traffic");
    }
    if search.doubtful() > 0 {
        let count = search.doubtful();
        println!("{count} failures not seen again, so not kept");
    }
    if search.late() > 0 {
        let late = search.late();
        println!("{late} cases not judged by checks: this machine was too late for them");
    }
}
