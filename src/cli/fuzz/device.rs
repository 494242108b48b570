//! `hilrig fuzz --description`: a described device, emulated, of a scenario, or at a port.

use core::time::Duration;
use std::path::Path;

use clap::Args;
use protocols::Instant;

use super::{FuzzArgs, PROGRESS, TIME};
use crate::cli::answer::{FuzzEnded, TargetFuzzed};
use crate::cli::port::PortPeer;
use crate::cli::stop::Stop;
use crate::cli::{CliError, Verdict, described, out, progress};
use crate::realtime::clock::{Clock as _, WallClock};
use crate::scenario::{Scenario, Source};
use crate::search::StoreError;
use crate::search::fuzz::dut::device::{DescribedDevice, PortFuzz, PortFuzzed, PortPlan, PortStep};
use crate::search::fuzz::{Folder, Subject};

/// A described device under test.
#[derive(Debug, Args)]
#[command(next_help_heading = "A described device")]
pub(super) struct DeviceArgs {
    /// Fuzz the real device at this serial port with the requests of --description; without
    /// --writes no input that may change its state is sent
    #[arg(long, value_name = "PORT", requires = "description",
        conflicts_with_all = ["exec", "dut_dir", "targets", "scenario", "corpus", "jobs"])]
    pub(super) port: Option<std::path::PathBuf>,
    /// Also send inputs that may change the device's state, e.g. move motors or alter settings
    #[arg(long, requires = "port")]
    writes: bool,
    /// Maximum number of inputs and requests per second at a port
    #[arg(long, value_name = "N", default_value_t = 5.0, requires = "port", value_parser = rate)]
    rate: f64,
    /// Address of the device, if it is not the described one
    #[arg(long, value_name = "N", requires = "description",
        conflicts_with_all = ["exec", "dut_dir"])]
    address: Option<u32>,
}

impl DeviceArgs {
    /// The options that distinguish searches at a port.
    pub(super) fn plan(&self) -> String {
        let address = self
            .address
            .map_or_else(String::new, |at| format!(", address {at}"));
        let writes = if self.writes { ", with writes" } else { "" };
        format!("\n# at a port{address}{writes}\n")
    }
}

/// Extra time for a reply at a port.
const SLACK: Duration = Duration::from_millis(30);
/// File name of the inputs of a finding.
const INPUTS: &str = "inputs.txt";

fn rate(text: &str) -> Result<f64, String> {
    let rate: Option<f64> = text.parse().ok();
    let rate = rate.filter(|rate| (0.01..=1000.0).contains(rate));
    rate.ok_or_else(|| "expected a number from 0.01 to 1000".to_owned())
}

fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// The command line that selects the device.
fn command(args: &FuzzArgs, path: Option<&Path>) -> String {
    let mut words = "hilrig fuzz".to_owned();
    if let Some(path) = path {
        words += &format!(" --scenario {}", quoted(&path.display().to_string()));
    }
    if let Some(link) = &args.link {
        words += &format!(" --link {}", quoted(link));
    }
    if let Some(name) = &args.exec.description {
        words += &format!(" --description {}", quoted(name));
    }
    if let Some(address) = args.device.address {
        words += &format!(" --address {address}");
    }
    if let Some(port) = &args.device.port {
        words += &format!(" --port {}", quoted(&port.display().to_string()));
    }
    if args.device.writes {
        words += " --writes";
    }
    words
}

/// The device of a description, emulated.
pub(super) fn emulated(args: &FuzzArgs) -> Result<Box<dyn Subject>, CliError> {
    let name = args.exec.description.as_deref().unwrap_or_default();
    let description = described::load_at(name, args.device.address)?;
    let subject = DescribedDevice::emulated(&description, command(args, None));
    Ok(Box::new(subject.map_err(CliError::Usage)?))
}

/// A device of a scenario, if a description of it is known.
pub(super) fn of_scenario(
    args: &FuzzArgs,
    path: &Path,
    (scenario, source): (&Scenario, &Source),
) -> Result<Option<Box<dyn Subject>>, CliError> {
    let named = args.exec.description.as_deref();
    let is_device = args
        .link
        .as_ref()
        .is_some_and(|link| scenario.device.contains_key(link));
    if named.is_none() && !is_device {
        return Ok(None);
    }
    let link = described::device_name(scenario, args.link.as_deref())?;
    let description = match named {
        Some(name) => Some(described::load_at(name, args.device.address)?),
        None => described::of_device((scenario, source), &link)?,
    };
    let Some(description) = description else {
        return Ok(None);
    };
    let (scenario, source) = (scenario.clone(), source.clone());
    let seed = scenario.seed;
    let make = move || {
        let made = described::emulated((&scenario, &source), &link, seed);
        made.map_err(|error| error.to_string())
    };
    let subject = DescribedDevice::new(&description, Box::new(make), command(args, Some(path)));
    Ok(Some(Box::new(subject.map_err(CliError::Usage)?)))
}

/// Fuzzes the real device at a port.
pub(super) fn at_port(args: &FuzzArgs) -> Result<Verdict, CliError> {
    let name = args.exec.description.as_deref().unwrap_or_default();
    let description = described::load_at(name, args.device.address)?;
    let path = args.device.port.as_deref().unwrap_or_else(|| Path::new(""));
    // A folder of another search is reported before anything is sent.
    let mut folder = match args.repeat {
        Some(_) => None,
        None => Some(Folder::create(&args.out, super::plan(args)?)?),
    };
    let target = description.name();
    let (done, known) = folder
        .as_ref()
        .map_or_else(Default::default, |folder| folder.progress(target));
    let mut peer = PortPeer::open(path, description.line())?;
    let plan = PortPlan {
        writes: args.device.writes,
        seed: args.seed,
        gap: Duration::from_secs_f64(1.0 / args.device.rate),
        slack: SLACK,
        done,
        known: known.clone(),
    };
    let port = PortFuzz::new(&description, &mut peer, plan).map_err(CliError::Usage)?;
    let Some(mut port) = port else {
        println!("nothing was fuzzed: the device answers no described request without an effect");
        let fuzzed = PortFuzzed {
            inputs: done,
            causes: known,
            ..PortFuzzed::default()
        };
        return ended(args, target, &fuzzed, false);
    };
    if let Some(file) = &args.repeat {
        return repeat(file, &mut port);
    }
    if done > 0 {
        println!("continues after {done} inputs in {}", args.out.display());
    }
    let mut save = |fuzzed: &PortFuzzed| match &mut folder {
        Some(folder) => folder.save(target, fuzzed.inputs, &fuzzed.causes),
        None => Ok(()),
    };
    let is_alive = search(args, &mut port, &mut save)?;
    let fuzzed = port.fuzzed().clone();
    save(&fuzzed)?;
    // The first requests of a run were answered in any case.
    let is_observed = fuzzed.answered > 0 || fuzzed.inputs == done;
    ended(args, target, &fuzzed, is_alive && is_observed)
}

/// Stores the counts of a search.
type Save<'a> = &'a mut dyn FnMut(&PortFuzzed) -> Result<(), StoreError>;

/// Sends inputs until time or number is reached; `false` if the device answers no more.
fn search(args: &FuzzArgs, port: &mut PortFuzz<'_>, save: Save<'_>) -> Result<bool, CliError> {
    let time = args.time.map(|time| time.0);
    let stop = Stop::new(time.or_else(|| args.cases.is_none().then_some(TIME)))?;
    let (clock, mut said) = (WallClock::start(), Instant::ZERO);
    let most = args.cases.unwrap_or(u64::MAX);
    let mut is_alive = true;
    while is_alive && port.fuzzed().inputs < most && !stop.is_due(clock.now()) {
        match port.step().map_err(CliError::Usage)? {
            PortStep::Sound => {}
            PortStep::Found(fault, inputs) => {
                let detail = &fault.detail;
                let dir = keep(args, fault.law(), &fault.cause, detail, &inputs)?;
                println!("{}: {detail}", fault.cause);
                let command = command(args, None);
                println!("  repeat with: {command} --repeat {}", quoted(&dir));
                save(port.fuzzed())?;
            }
            PortStep::Silent => {
                is_alive = false;
                println!("the device does not answer as described any more: reset it to continue");
            }
            PortStep::Nothing => {
                is_alive = false;
                println!("all inputs without an effect were sent: --writes also sends the others");
            }
        }
        let now = clock.now();
        if now - said >= PROGRESS {
            said = now;
            save(port.fuzzed())?;
            if progress::is_watched() {
                eprintln!("  {}", in_words(port.fuzzed()));
            }
        }
    }
    Ok(is_alive)
}

fn in_words(fuzzed: &PortFuzzed) -> String {
    let PortFuzzed {
        inputs,
        answered,
        causes,
        ..
    } = fuzzed;
    format!(
        "{inputs} inputs, {answered} answered, {} findings",
        causes.len()
    )
}

/// Prints the counts; a device that was not observed, or not to the end, does not pass.
fn ended(
    args: &FuzzArgs,
    name: &str,
    fuzzed: &PortFuzzed,
    is_observed: bool,
) -> Result<Verdict, CliError> {
    println!("{name}: {}", in_words(fuzzed));
    for (cause, count) in &fuzzed.causes {
        println!("  {count} times {cause}");
    }
    if fuzzed.doubtful > 0 {
        println!(
            "{} differences not seen again, so not kept",
            fuzzed.doubtful
        );
    }
    if fuzzed.left_out > 0 {
        let count = fuzzed.left_out;
        eprintln!("{count} inputs were not sent: they may change the device's state (--writes)");
    }
    if fuzzed.for_others > 0 {
        let count = fuzzed.for_others;
        eprintln!("{count} inputs were not sent: another device on the line would answer");
    }
    let findings = fuzzed.causes.len() as u64;
    out::answer(&FuzzEnded {
        folder: args.out.display().to_string(),
        findings,
        targets: vec![TargetFuzzed {
            name: name.to_owned(),
            cases: fuzzed.inputs,
            behaviours: 0,
            findings,
        }],
    });
    Ok(match findings == 0 && is_observed {
        true => Verdict::Pass,
        false => Verdict::Fail,
    })
}

/// Writes a finding; returns its folder.
fn keep(
    args: &FuzzArgs,
    law: &str,
    cause: &str,
    detail: &str,
    inputs: &str,
) -> Result<String, CliError> {
    let hash = crate::rig::trace::fingerprint(inputs.as_bytes()).to_ascii_uppercase();
    let hash: String = hash.chars().take(8).collect();
    let dir = args.out.join("findings").join(format!("{law}-{hash}"));
    let repeat = format!(
        "{} --repeat {}\n",
        command(args, None),
        quoted(&dir.display().to_string())
    );
    let files = [
        (INPUTS, inputs.to_owned()),
        ("cause.txt", format!("{cause}\n{detail}\n")),
        ("repeat.txt", repeat),
    ];
    for (name, text) in files {
        let path = dir.join(name);
        safefs::create_parent(&path)
            .and_then(|()| safefs::write(&path, &text))
            .map_err(|error| CliError::write(path.display(), error))?;
    }
    Ok(dir.display().to_string())
}

/// Sends the inputs of a finding once.
fn repeat(file: &Path, port: &mut PortFuzz<'_>) -> Result<Verdict, CliError> {
    let (path, text) = crate::cli::read_text(file, INPUTS)?;
    let judged = port
        .repeat(&text)
        .map_err(|error| CliError::content(&path, error))?;
    out::answer(&FuzzEnded {
        folder: path.display().to_string(),
        findings: u64::from(judged.is_err()),
        targets: Vec::new(),
    });
    Ok(match judged {
        Ok(()) => {
            println!("every law holds");
            Verdict::Pass
        }
        Err(fault) => {
            println!("{}: {}", fault.cause, fault.detail);
            Verdict::Fail
        }
    })
}
