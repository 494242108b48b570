use core::time::Duration;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use protocols::Instant;

use super::answer::DutEnded;
use super::place::{self, NamedPort};
use super::stop::Stop;
use super::{CliError, Verdict, out};
use crate::realtime::clock::{Clock, WallClock};
use crate::realtime::standalone::Standalone;
use crate::realtime::transport::{Note, Serial, Transport};
use crate::rig::Program;
use crate::robots::{self, Alone};
use crate::scenario::{Scenario, Span};

/// Run the robot's program as a separate process, on serial ports.
///
/// It opens the ports like any foreign program and has no other access to the rig. Its
/// configuration (start pose, dialect of its base) comes from the scenario of the rig in DIR, or
/// from --scenario.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig dut --dir /tmp/robot\n  \
    hilrig dut --dir /tmp/robot --link lidar=/dev/ttyUSB0   # a real lidar\n  \
    hilrig dut --dir . --link lidar=/dev/ttyS0 --link base=/dev/ttyS1 --link radio=/dev/ttyS2 \\\n    \
    --scenario scenarios/rescue-flat.toml                 # all on real ports")]
pub(super) struct DutArgs {
    /// Directory in which `hilrig up` offers the ports
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,
    /// Port of one link, instead of DIR/NAME
    #[arg(long, value_name = "NAME=PATH")]
    link: Vec<NamedPort>,
    /// Scenario whose robot this is [default: the one that the rig in DIR runs]
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// End after this time, e.g. 60s or 5min [default: at SIGINT or SIGTERM]
    #[arg(long, value_name = "TIME")]
    duration: Option<Span>,
}

pub(super) fn run(args: DutArgs) -> Result<Verdict, CliError> {
    let scenario_path = match &args.scenario {
        Some(path) => path.clone(),
        None => noted_scenario(&args.dir)?,
    };
    let (scenario, source) = Scenario::read(&scenario_path)?;
    let robot = robots::of(&scenario, &source)?;
    let alone = robot.program(&scenario, &source)?.ok_or_else(|| {
        let message = "has no built-in program, expected a robot that has one";
        source.invalid(source.find("robot"), "robot", message)
    })?;
    let Alone { program, ports } = alone;
    let names: Vec<String> = ports.iter().map(|port| port.name.to_owned()).collect();
    place::check("--link", &args.link, &names)?;

    let stop = Stop::new(args.duration.map(|duration| duration.0))?;
    let mut opened = Vec::new();
    for port in ports {
        let path = match place::find(&args.link, port.name) {
            Some(place) => place.path.clone(),
            None => args.dir.join(port.name),
        };
        if port.is_optional && !path.exists() {
            eprintln!(
                "{}: does not exist and is optional; continuing without it",
                path.display()
            );
            continue;
        }
        opened.push((port.port, Serial::open(&path, port.line)?));
    }
    let mut alone = Standalone::new(program, WallClock::start());
    for (port, serial) in opened {
        eprintln!("opened {}", serial.path().display());
        alone.connect(port, Box::new(serial));
    }
    follow(&mut alone, &stop)
}

/// Time between two reports of the program's pose.
const REPORT_EVERY: Duration = Duration::from_secs(2);

/// Runs until it is time to stop, and prints the program's events and its pose.
fn follow(
    alone: &mut Standalone<dyn Program, WallClock>,
    stop: &Stop,
) -> Result<Verdict, CliError> {
    let (mut mode, mut report_at) = ("", Instant::ZERO + REPORT_EVERY);
    while !stop.is_due(alone.clock().now()) {
        alone.turn()?;
        let now = alone.clock().now();
        if alone.program().mode() != mode {
            mode = alone.program().mode();
            eprintln!("  {now} mode {mode}");
        }
        if now >= report_at {
            report_at = now + REPORT_EVERY;
            match alone.program().estimate() {
                Some((_, pose)) => {
                    let [x_m, y_m] = [pose.x_mm, pose.y_mm].map(|mm| mm / 1000.0);
                    eprintln!("  {now} mode {mode}, at ({x_m:.2}, {y_m:.2}) m");
                }
                None => eprintln!("  {now} mode {mode}, pose unknown"),
            }
        }
    }
    let (mut counters, mut words) = (BTreeMap::new(), Vec::new());
    alone.program().counters(&mut |name, value| {
        words.push(format!("{name} {value}"));
        counters.insert(name.to_owned(), value);
    });
    let now = alone.clock().now();
    println!("ran {now} s: {}", words.join(", "));
    let ran_s = (now - Instant::ZERO).as_secs_f64();
    out::answer(&DutEnded { ran_s, counters });
    Ok(Verdict::Pass)
}

fn noted_scenario(dir: &Path) -> Result<PathBuf, CliError> {
    let path = Note::Scenario.path_in(dir);
    if path.exists() {
        return Ok(path);
    }
    let expected = "expected a directory of `hilrig up`, or --scenario FILE";
    Err(CliError::content(
        dir,
        format!("no rig runs here: {expected}"),
    ))
}
