use std::fs;
use std::path::PathBuf;

use clap::Args;
use protocols::Instant;

use super::place::{self, Place};
use super::show::ShowArgs;
use super::stop::Stop;
use super::{CliError, Verdict};
use crate::capture::{self, Limits, Recording};
use crate::realtime::Realtime;
use crate::realtime::clock::{Clock, WallClock, utc};
use crate::realtime::control::Control;
use crate::realtime::transport::{Note, PortDir, Pty, Serial, Transport};
use crate::rig::Paced;
use crate::rig::Rig;
use crate::robots::{self, Dut, Instruments, OpenEnd, PcEnd, Wired};
use crate::run::Run;
use crate::scenario::{Scenario, Span};
use crate::show::folder::FolderError;

/// Run a scenario in real time, its links on ports for any program to open.
///
/// The robot's ends of the links appear in a directory as pseudo-terminals that behave like serial
/// ports. A client should set the baud rate that the table names: at another one it reads garbage,
/// as on a wire. When the run ends the ports are removed.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig up scenarios/rescue-flat.toml --dir /tmp/robot\n  \
    hilrig dut --dir /tmp/robot            # in another terminal: the robot's program\n  \
    hilrig up scenarios/rescue-flat.toml --dut-at lidar=/dev/ttyUSB0 --dut-at base=/dev/ttyUSB1\n  \
    hilrig up scenarios/rescue-flat.toml --device-at lidar=/dev/ttyACM0   # a real lidar\n  \
    hilrig up scenarios/rescue-flat.toml --ui=8080    # watched and steered on a page\n  \
    hilrig up scenarios/rescue-flat.toml --capture field.pcapng --capture-max-mb 100")]
pub(super) struct Up {
    /// Scenario file
    #[arg(value_name = "SCENARIO")]
    scenario: PathBuf,
    /// Directory in which the ports appear [default: hilrig-out/NAME-ports]
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
    /// End by itself after this time, e.g. 60s or 5min [default: at SIGINT or SIGTERM]
    #[arg(long, value_name = "TIME")]
    duration: Option<Span>,
    /// Seed in place of the scenario's own
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    /// Put a real device, or somebody's pseudo-terminal, in the place of the emulated one
    #[arg(long, value_name = "LINK=PATH")]
    device_at: Vec<Place>,
    /// Offer the robot's end of a link on a serial port in place of a pseudo-terminal
    #[arg(long, value_name = "LINK=PATH")]
    dut_at: Vec<Place>,
    /// Offer the PC's end, and leave the scenario's own PC out, even if it has a mission
    #[arg(long)]
    pc: bool,
    #[command(flatten)]
    show: ShowArgs,
    /// Where the case is written at the end: the scenario with what was done to it by hand
    /// [default: hilrig-out/NAME-up.toml, if there were any]
    #[arg(long, value_name = "FILE")]
    case: Option<PathBuf>,
    /// Write every byte of every link with its time to this file, for Wireshark and decode
    #[arg(long, value_name = "FILE")]
    capture: Option<PathBuf>,
    /// Size at which the capture is put aside as FILE.1.pcapng, .2 and so on, and begun anew
    #[arg(long, value_name = "MB", default_value_t = 256, requires = "capture",
          value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    capture_max_mb: u64,
    /// Captures put aside that are kept; older ones are deleted
    #[arg(long, value_name = "N", default_value_t = 7, requires = "capture")]
    capture_files: u64,
}

pub(super) fn run(args: Up) -> Result<Verdict, CliError> {
    let (mut scenario, source) = Scenario::read(&args.scenario)?;
    scenario.seed = args.seed.unwrap_or(scenario.seed);
    let pc = pc_end(&args, &scenario);
    let wired = robots::wire(&scenario, &source, Dut::External, pc)?;
    let dir = args
        .dir
        .clone()
        .unwrap_or_else(|| PathBuf::from("hilrig-out").join(format!("{}-ports", scenario.name)));
    let stop = Stop::new(args.duration.map(|duration| duration.0))?;

    let mut dir = PortDir::open(&dir)?;
    let mut control = Control::open(&dir)?;
    let (rig, instruments, ports) = place_ends(wired, &args, &dir)?;
    dir.leave_note(Note::Scenario, &scenario.to_toml())?;
    print_table(&ports);
    eprintln!(
        "{}, seed {}: running until {}",
        scenario.name,
        scenario.seed,
        args.duration
            .map_or("SIGINT or SIGTERM".to_owned(), |time| time.to_string())
    );
    let mut run = Endless(Run::with_rig(scenario, rig, instruments));
    record(&args, &mut run.0)?;
    let mut show = args.show.start()?;
    show.begin(&mut run.0);
    // The clock starts last: setting up takes no time of the run.
    let mut realtime = Realtime::new(WallClock::start());
    for (end, port) in ports {
        realtime.serve(end, port);
    }
    let mut log = Log::default();
    let ended = loop {
        if stop.is_due(realtime.clock().now()) {
            break Ok(Verdict::Pass);
        }
        if let Err(error) = realtime.turn(&mut run) {
            break Err(error.into());
        }
        control.serve(&mut run.0, realtime.clock().now());
        show.turn(&mut run.0, realtime.clock().now());
        log.follow(&run.0);
    };
    print_report(&realtime, &run.0);
    if control.delays().count() > 0 {
        println!("  faults changed by hand: {}", control.delays());
    }
    let changed = control.delays().count() > 0 || show.has_changed_it();
    leave(&mut run.0, args, changed)?;
    ended
}

/// Ends what a run leaves behind: its capture and its case.
fn leave(run: &mut Run, args: Up, changed: bool) -> Result<(), CliError> {
    let recorded = run.rig.finish_taps();
    write_case(run, args.case, changed)?;
    recorded.map_err(|source| FolderError {
        path: args.capture.unwrap_or_default(),
        source,
    })?;
    Ok(())
}

/// The scenario's PC has its own end if it has something to do or a page to do it, unless another
/// one is wanted.
fn pc_end(args: &Up, scenario: &Scenario) -> PcEnd {
    let mission = &scenario.mission;
    let is_scripted = !mission.waypoints_m.is_empty() || !mission.step.is_empty();
    match (is_scripted || args.show.is_wanted()) && !args.pc {
        true => PcEnd::Scripted,
        false => PcEnd::External,
    }
}

/// Writes the case if a place for it is named, or if it differs from the scenario.
fn write_case(run: &Run, path: Option<PathBuf>, changed: bool) -> Result<(), CliError> {
    let default = || PathBuf::from("hilrig-out").join(format!("{}-up.toml", run.scenario().name));
    let Some(path) = path.or_else(|| changed.then(default)) else {
        return Ok(());
    };
    if let Some(folder) = path.parent() {
        // What is wrong with the folder shows when the file is written.
        let _ = fs::create_dir_all(folder);
    }
    fs::write(&path, run.case().to_toml()).map_err(|source| FolderError {
        path: path.clone(),
        source,
    })?;
    println!("  case: {}", path.display());
    Ok(())
}

/// Makes `run` write its capture, if one is wanted.
fn record(args: &Up, run: &mut Run) -> Result<(), CliError> {
    let Some(path) = &args.capture else {
        return Ok(());
    };
    let limits = Limits {
        file_bytes: args.capture_max_mb << 20,
        files: args.capture_files,
    };
    let about = capture::about_live(run.scenario(), utc());
    let recording = Recording::create(path, &run.rig, about, limits);
    let recording = recording.map_err(|source| FolderError {
        path: path.clone(),
        source,
    })?;
    run.rig.add_tap(Box::new(recording));
    Ok(())
}

/// A run that goes on when its mission is over: whoever is connected may have other plans.
struct Endless(Run);

impl Paced for Endless {
    fn rig(&mut self) -> &mut Rig {
        &mut self.0.rig
    }

    fn run_until(&mut self, deadline: Instant) {
        self.0.go_on_until(deadline);
    }
}

/// An end of a link and the port that it is on.
type Placed = (OpenEnd, Box<dyn Transport>);

/// Opens or makes a port for each open end.
fn place_ends(
    wired: Wired,
    args: &Up,
    dir: &PortDir,
) -> Result<(Rig, Box<dyn Instruments>, Vec<Placed>), CliError> {
    let Wired {
        mut rig,
        open_ends,
        instruments,
    } = wired;
    let names: Vec<String> = open_ends.iter().map(|end| end.name.clone()).collect();
    place::check("--dut-at", &args.dut_at, &names)?;
    place::check("--device-at", &args.device_at, &names)?;
    let mut ports: Vec<Placed> = Vec::new();
    for end in open_ends {
        let port: Box<dyn Transport> = match place::find(&args.dut_at, &end.name) {
            Some(place) => Box::new(Serial::open(&place.path, end.line)?),
            None => Box::new(Pty::open(dir, &end.name, end.line)?),
        };
        if let Some(place) = place::find(&args.device_at, &end.name) {
            let port = Serial::open(&place.path, end.line)?;
            let node = rig.replace_device(&end.link).ok_or_else(|| {
                let name = &end.name;
                CliError::Other(format!("--device-at {name}: expected a link with a device"))
            })?;
            let device = OpenEnd {
                name: format!("{} (device)", end.name),
                node,
                connect: "a device in place of the emulated one",
                ..end.clone()
            };
            rig.set_line_config(node, end.line);
            ports.push((device, Box::new(port)));
        }
        ports.push((end, port));
    }
    Ok((rig, instruments, ports))
}

/// The ports as data: one a line.
fn print_table(ports: &[Placed]) {
    let rows: Vec<[String; 4]> = ports
        .iter()
        .map(|(end, port)| {
            [
                end.name.clone(),
                port.path().display().to_string(),
                end.line.baud.to_string(),
                end.connect.to_owned(),
            ]
        })
        .collect();
    let head = ["name", "path", "baud", "connect"].map(str::to_owned);
    let width = |column: usize| {
        let cells = rows.iter().chain([&head]);
        cells.map(|row| row[column].len()).max().unwrap_or(0)
    };
    let [name_width, path_width, baud_width] = [width(0), width(1), width(2)];
    for [name, path, baud, connect] in [&head].into_iter().chain(&rows) {
        println!("{name:<name_width$}  {path:<path_width$}  {baud:>baud_width$}  {connect}");
    }
}

fn print_report(realtime: &Realtime<WallClock>, run: &Run) {
    let (now, violations) = (run.rig.now(), run.rig.violations());
    println!("ran {now} s, {}", realtime.lateness());
    for report in realtime.reports() {
        println!("  {report}");
    }
    if violations > 0 {
        println!("  {violations} times a client broke a rule of its device, see the log");
    }
}

/// Says what happens while it happens.
#[derive(Debug, Default)]
struct Log {
    events: usize,
    visits: usize,
    second: Option<Instant>,
    lines: u32,
}

/// Most lines a second: a client that breaks a rule with each byte must not bury the rest.
const LINES_MAX: u32 = 20;

impl Log {
    fn follow(&mut self, run: &Run) {
        let now = run.rig.now();
        if self
            .second
            .is_none_or(|at| now - at >= core::time::Duration::from_secs(1))
        {
            if self.lines > LINES_MAX {
                eprintln!("  {now} .. and {} more", self.lines - LINES_MAX);
            }
            (self.second, self.lines) = (Some(now), 0);
        }
        let events = run.rig.events();
        for logged in events.get(self.events..).unwrap_or_default() {
            self.lines += 1;
            if self.lines <= LINES_MAX {
                eprintln!("  {logged}");
            }
        }
        self.events = events.len();
        let visits = run.progress().visits().len();
        if visits > self.visits {
            eprintln!(
                "  {now} waypoint {visits} of {} visited",
                run.progress().waypoints()
            );
        }
        self.visits = visits;
    }
}
