mod device;
mod exec;

use core::num::NonZeroUsize;
use core::time::Duration;
use std::path::{Path, PathBuf};
use std::thread;

use clap::Args;
use protocols::Instant;

use super::answer::{FuzzEnded, TargetFuzzed};
use super::exec::read_without_programs;
use super::progress;
use super::stop::Stop;
use super::{CliError, Verdict, described, out};
use crate::realtime::clock::{Clock, WallClock};
use crate::run::Run;
use crate::scenario::{Scenario, Span};
use crate::search::fuzz::{
    self, FirstCase, Folder, FuzzPlan, Fuzzer, Missions, Round, Subject, Wires, dut,
};
use crate::search::generate::{Profile, Vary};
use crate::search::shrink::Effort;
use crate::show::folder::factor;

/// Find failing inputs: bytes for decoders and programs, generated missions, or traffic for your
/// own program.
///
/// Inputs with a new effect are kept and mutated further. Each finding is minimised and stored as
/// readable text with the command that repeats it. The same seed and number of cases give the same
/// findings on any number of cores. The same command continues where it stopped.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig fuzz --for 60s                        # every target in turn\n  \
    hilrig fuzz pcui avr-low-first --cases 1000000\n  \
    hilrig fuzz rescue base --for 5min           # the robot's program, and its base\n  \
    hilrig fuzz --defect MA-05 --cases 5000      # does it find a known defect?\n  \
    hilrig fuzz --scenario scenarios/empty-room.toml --for 10min --out night\n  \
    hilrig fuzz --scenario my.toml --link base   # the wire format of that link\n  \
    hilrig fuzz pcui --repeat night/findings/no-frame-is-lost-1A2B3C4D\n  \
    hilrig fuzz --exec 'my-robot --ports \"$HILRIG_DIR\"' --scenario my.toml --for 10min\n  \
    hilrig fuzz --exec ./parser --virtual --scenario my.toml --link base\n  \
    hilrig fuzz --dut-dir /dev/robot --scenario my.toml --link base\n  \
    hilrig fuzz --description meter.toml         # the described device, emulated\n  \
    hilrig fuzz --description meter.toml --port /dev/ttyUSB0 --for 10min   # a real one\n\n\
    Exit code 1: something was found, now or earlier in the same folder.")]
pub(super) struct FuzzArgs {
    /// What to fuzz: wire formats and programs [default: all of them in turn]
    #[arg(value_name = "TARGET", conflicts_with = "scenario")]
    targets: Vec<String>,
    /// Fuzz missions made of this scenario, or a program that meets its devices
    #[arg(long, value_name = "SCENARIO")]
    scenario: Option<PathBuf>,
    /// Fuzz the wire format of this link of the scenario instead, or a program on this link only
    #[arg(long, value_name = "LINK")]
    link: Option<String>,
    /// What to generate for each case: some of world,mission,timing,faults, or all
    #[arg(
        long,
        value_name = "WHAT",
        default_value = "all",
        requires = "scenario"
    )]
    vary: Vary,
    /// Fault profile, i.e. faults and expectations: gentle, field, harsh, or a TOML file
    #[arg(
        long,
        value_name = "NAME|FILE",
        default_value = "gentle",
        requires = "scenario"
    )]
    profile: String,
    /// Enable a defect of the fielded programs, by its ID in "hilrig bugs"; may be repeated
    #[arg(long = "defect", value_name = "ID", conflicts_with = "scenario")]
    defects: Vec<String>,
    /// Stop after this time, for all targets together [default: 60s, none with --cases]
    #[arg(long = "for", value_name = "TIME")]
    time: Option<Span>,
    /// Stop after this many cases of each target, including those of earlier runs
    #[arg(long, value_name = "N")]
    cases: Option<u64>,
    /// Seed of all mutations
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Number of parallel cases [default: one per core; with --exec 1]
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    /// Initial inputs, in addition to some valid ones: a folder of text files; with --exec bytes of
    /// devices: a capture, a dump of another tool, a file or a folder of frames
    #[arg(long, value_name = "DIR|FILE")]
    corpus: Option<PathBuf>,
    /// Run one finding, a file or its folder, instead of searching
    #[arg(long, value_name = "FILE")]
    repeat: Option<PathBuf>,
    /// Write a C file to link into your program for coverage-guided search, and end; comments in
    /// the file explain its use
    #[arg(long, value_name = "FILE", exclusive = true)]
    coverage_runtime: Option<PathBuf>,
    /// Folder of the results; an existing search there is continued
    #[arg(long, value_name = "DIR", default_value = "hilrig-out/fuzz")]
    out: PathBuf,
    #[command(flatten)]
    exec: exec::ExecArgs,
    #[command(flatten)]
    device: device::DeviceArgs,
}

/// Duration if neither time nor cases are given.
const TIME: Duration = Duration::from_secs(60);
/// Time between two lines of progress.
const PROGRESS: Duration = Duration::from_secs(2);

pub(super) fn run(args: &FuzzArgs) -> Result<Verdict, CliError> {
    if let Some(file) = &args.coverage_runtime {
        let what = || format!("--coverage-runtime {}", file.display());
        safefs::write(file, dut::RUNTIME).map_err(|error| CliError::write(what(), error))?;
        return Ok(Verdict::Pass);
    }
    if args.vary.schedule {
        let text = "--vary schedule: fuzz has no order of threads to vary; expected some of \
                    world,mission,timing,faults; see hilrig campaign --vary schedule";
        return Err(CliError::Usage(text.to_owned()));
    }
    if args.exec.is_wanted() {
        return exec::run(args);
    }
    if args.device.port.is_some() {
        return device::at_port(args);
    }
    if args.link.is_some() && args.scenario.is_none() {
        let text = "--link needs --scenario <SCENARIO>, or --exec with --corpus";
        return Err(CliError::Usage(text.to_owned()));
    }
    let profile = Some(&*args.profile).filter(|name| *name != "gentle");
    super::campaign::needs_faults(profile, args.vary)?;
    let subjects = subjects(args)?;
    fuzz::silence_panics();
    match &args.repeat {
        Some(file) => repeat(file, &subjects),
        None => look(args, &subjects),
    }
}

impl FuzzArgs {
    /// The port of a program without a scenario.
    fn port(&self) -> &str {
        self.link.as_deref().unwrap_or("port")
    }
}

type Subjects = Vec<Box<dyn Subject>>;

/// The selected target.
fn subjects(args: &FuzzArgs) -> Result<Subjects, CliError> {
    if let Some(path) = &args.scenario {
        return Ok(vec![of_scenario(args, path)?]);
    }
    if args.exec.description.is_some() {
        return Ok(vec![device::emulated(args)?]);
    }
    let mut all: Subjects = Wires::all().map(|wire| Box::new(wire) as _).collect();
    all.extend(fuzz::programs(&args.defects).map_err(|unknown| {
        let expected = "expected one that \"hilrig bugs\" lists, such as AV-02, MA-05 or PU-01";
        CliError::Usage(format!("--defect {unknown}: no program has it, {expected}"))
    })?);
    if args.targets.is_empty() && !args.defects.is_empty() {
        all.retain(|subject| !subject.defects().is_empty());
    }
    if !args.targets.is_empty() {
        for name in &args.targets {
            if !all.iter().any(|subject| subject.name() == name) {
                return Err(unknown(name, &all));
            }
        }
        all.retain(|subject| args.targets.iter().any(|name| name == subject.name()));
    }
    Ok(all)
}

fn unknown(name: &str, all: &Subjects) -> CliError {
    let known: Vec<&str> = all.iter().map(|subject| subject.name()).collect();
    let known = known.join(", ");
    let text = format!("there is no target \"{name}\", expected one of {known}");
    CliError::Usage(text)
}

fn of_scenario(args: &FuzzArgs, path: &Path) -> Result<Box<dyn Subject>, CliError> {
    let (scenario, source) = read_without_programs("fuzz", path)?;
    // A scenario that cannot be wired is reported once, not for every case.
    let run = Run::new(scenario.clone(), &source, None)?;
    if args.exec.description.is_some() || args.link.is_some() {
        let of_device = device::of_scenario(args, path, (&scenario, &source))?;
        if let Some(subject) = of_device {
            return Ok(subject);
        }
    }
    let Some(link) = &args.link else {
        let profile = Profile::find(&args.profile)?;
        super::campaign::can_have_faults((&scenario, &source), args.vary, &profile)?;
        return Ok(Box::new(Missions::new(
            scenario, source, args.vary, profile,
        )));
    };
    // A format without laws finds nothing.
    let codec = run.instruments().codec(&run.rig, link);
    if let Some(codec) = codec.filter(|codec| !codec.is_own()) {
        return Ok(Box::new(Wires(codec.target())));
    }
    let links: Vec<&str> = run.rig.links().iter().map(|link| &*link.name).collect();
    let text = format!(
        "--link {link}: no wire format that can be fuzzed, the links of {} are {}",
        path.display(),
        links.join(", ")
    );
    Err(CliError::Usage(text))
}

/// Runs the case in `file`.
fn repeat(file: &Path, subjects: &Subjects) -> Result<Verdict, CliError> {
    let [subject] = &subjects[..] else {
        let text = "--repeat runs one case, expected the name of its target before it";
        return Err(CliError::Usage(text.to_owned()));
    };
    let (path, text) = super::read_text(file, subject.case_file())?;
    let judged = subject.repeated(&text);
    let judged = judged.map_err(|error| CliError::content(&path, error))?;
    out::answer(&FuzzEnded {
        folder: path.display().to_string(),
        findings: u64::from(judged.is_err()),
        targets: Vec::new(),
    });
    match judged {
        Ok(()) => {
            println!("{}: every law holds", subject.name());
            Ok(Verdict::Pass)
        }
        Err(fault) => {
            println!("{}: {}\n{}", subject.name(), fault.cause, fault.detail);
            Ok(Verdict::Fail)
        }
    }
}

/// One run of the command.
struct FuzzRun<'a> {
    args: &'a FuzzArgs,
    folder: Folder,
    clock: WallClock,
    stop: Stop,
    jobs: usize,
}

fn look(args: &FuzzArgs, subjects: &Subjects) -> Result<Verdict, CliError> {
    let time = args.time.map(|time| time.0);
    let time = time.or_else(|| args.cases.is_none().then_some(TIME));
    let jobs = args.jobs.or_else(|| thread::available_parallelism().ok());
    let mut fuzzing = FuzzRun {
        args,
        folder: Folder::create(&args.out, plan(args)?)?,
        clock: WallClock::start(),
        stop: Stop::new(time)?,
        jobs: jobs.map_or(1, NonZeroUsize::get),
    };
    let mut ended = FuzzEnded {
        folder: args.out.display().to_string(),
        ..FuzzEnded::default()
    };
    for (index, subject) in subjects.iter().enumerate() {
        let left = u32::try_from(subjects.len() - index).expect("a few targets");
        let until = time.map(|time| {
            let now = fuzzing.clock.now();
            now + (Instant::ZERO + time - now) / left
        });
        let target = fuzzing.fuzz(subject.as_ref(), until)?;
        ended.findings += target.findings;
        ended.targets.push(target);
    }
    let findings = ended.findings;
    out::answer(&ended);
    println!("{findings} findings, results in {}", args.out.display());
    Ok(if findings == 0 {
        Verdict::Pass
    } else {
        Verdict::Fail
    })
}

fn plan(args: &FuzzArgs) -> Result<FuzzPlan, CliError> {
    let scenario = args.scenario.as_ref().map(|path| Scenario::read(path));
    let scenario = scenario.transpose()?.map(|(_, source)| source.text);
    let described = args.exec.description.as_deref();
    let described = described.map(|name| described::load("--description", name));
    // The text of a description tells it from another one of the same name.
    let described = described
        .transpose()?
        .map(|description| format!("{description:?}"));
    // A search at a port is one of its own.
    let described = described.map(|text| match args.device.port.is_some() {
        true => text + &args.device.plan(),
        false => text,
    });
    let scenario = match (scenario, described) {
        (scenario, None) => scenario,
        (None, described) => described,
        (Some(scenario), Some(described)) => Some(scenario + &described),
    };
    Ok(FuzzPlan {
        tool: concat!("hilrig ", env!("CARGO_PKG_VERSION")).to_owned(),
        seed: args.seed,
        scenario,
        vary: args.vary.to_string(),
        profile: kept_profile(&args.profile)?,
        defects: args.defects.clone(),
    })
}

/// The folder does not store the gentle profile, for compatibility with folders from before
/// profiles existed.
fn kept_profile(name: &str) -> Result<Option<String>, CliError> {
    let profile = Profile::find(name)?;
    Ok((!profile.is_gentle()).then_some(profile.kept))
}

impl FuzzRun<'_> {
    /// Fuzzes one target and returns its result, including earlier runs.
    fn fuzz(
        &mut self,
        subject: &dyn Subject,
        until: Option<Instant>,
    ) -> Result<TargetFuzzed, CliError> {
        let (before, causes) = self.folder.progress(subject.name());
        let mut fuzzer = Fuzzer::new(subject, self.args.seed, before, causes);
        let mut kept = 0;
        for choices in self.folder.pool(subject)? {
            fuzzer.add(choices);
            kept += 1;
        }
        if before == 0 {
            let mut given = subject.seeds();
            if let Some(dir) = &self.args.corpus {
                given.extend(fuzz::read_corpus(dir, subject)?);
            }
            for choices in given {
                let round = fuzzer.add(choices);
                self.keep(subject, &round, &mut kept)?;
            }
        }
        let (begun, mut said) = (self.clock.now(), self.clock.now());
        let most = self.args.cases.unwrap_or(u64::MAX);
        while fuzzer.cases() < most {
            let now = self.clock.now();
            if self.stop.is_due(now) || until.is_some_and(|until| until <= now) {
                break;
            }
            if now - said >= PROGRESS {
                said = now;
                if progress::is_watched() {
                    print(&fuzzer, subject, before, now - begun);
                }
                self.folder
                    .save(subject.name(), fuzzer.cases(), fuzzer.causes())?;
            }
            let round = fuzzer.round(most - fuzzer.cases(), self.jobs);
            self.keep(subject, &round, &mut kept)?;
        }
        self.folder
            .save(subject.name(), fuzzer.cases(), fuzzer.causes())?;
        println!(
            "{}: {} cases, {} behaviours, {} findings",
            subject.name(),
            fuzzer.cases(),
            fuzzer.behaviours(),
            fuzzer.causes().len()
        );
        Ok(TargetFuzzed {
            name: subject.name().to_owned(),
            cases: fuzzer.cases(),
            behaviours: fuzzer.behaviours() as u64,
            findings: fuzzer.causes().len() as u64,
        })
    }

    /// Writes the result of a round.
    fn keep(&self, subject: &dyn Subject, round: &Round, kept: &mut usize) -> Result<(), CliError> {
        for choices in &round.new {
            self.folder.keep_choices(subject, *kept, choices)?;
            *kept += 1;
        }
        for found in &round.found {
            self.keep_finding(subject, found)?;
        }
        Ok(())
    }

    fn keep_finding(&self, subject: &dyn Subject, found: &FirstCase) -> Result<(), CliError> {
        let is_over = || self.stop.is_due(self.clock.now());
        let mut effort = Effort::until(subject.tries(), &is_over);
        let small = subject.keep(&found.choices, &found.fault, &mut effort);
        let dir = self.folder.keep_finding(subject, &small)?;
        eprintln!(
            "  found after {:.1} s",
            (self.clock.now() - Instant::ZERO).as_secs_f64()
        );
        println!("{}: {}", subject.name(), small.fault.cause);
        println!("  {}", small.fault.detail.replace('\n', "\n  "));
        println!(
            "  case {}, repeat with: {}",
            found.case,
            subject.repeat(&dir)
        );
        Ok(())
    }
}

/// A line of progress.
fn print(fuzzer: &Fuzzer<'_>, subject: &dyn Subject, before: u64, time: Duration) {
    let rate = factor((fuzzer.cases() - before) as f64 / time.as_secs_f64().max(1e-3));
    eprintln!(
        "  {}: {} cases, {rate}/s, {} behaviours, {} findings",
        subject.name(),
        fuzzer.cases(),
        fuzzer.behaviours(),
        fuzzer.causes().len()
    );
}
