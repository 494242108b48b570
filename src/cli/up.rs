use std::path::PathBuf;

use clap::Args;
use emulators::Event;
use protocols::Instant;

use super::answer::UpEnded;
use super::ends::{EndArgs, print_table};
use super::run::{Ran, write_results};
use super::show::{Show, ShowArgs};
use super::stop::Stop;
use super::{CliError, Verdict};
use crate::capture::{self, Existing, Limits, Recording};
use crate::realtime::clock::{Clock, utc};
use crate::realtime::control::Control;
use crate::realtime::exec;
use crate::realtime::held::Held;
use crate::realtime::transport::{Note, PortDir};
use crate::realtime::{PortReport, Realtime};
use crate::rig::Paced;
use crate::rig::{Logged, Rig};
use crate::robots::{self, Dut, PcEnd};
use crate::run::Run;
use crate::run::check::Check;
use crate::scenario::{Scenario, Span};
use crate::show::folder::FolderError;
use safefs::Dir;

/// Run a scenario in real time and offer its links as ports for any program.
///
/// The robot's ends of the links appear in a directory as pseudo-terminals that behave like serial
/// ports. A client must set the baud rate in the printed table; at another rate it reads garbage,
/// as on a wire. `any` marks a port without a baud rate. The PC's end is among the ports with
/// --pc, or if the mission sends no orders. The ports are removed when the run ends. The run is
/// judged only with --out.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig up scenarios/rescue-flat.toml --dir /tmp/robot\n  \
    hilrig dut --dir /tmp/robot            # in another terminal: the robot's program\n  \
    hilrig up scenarios/rescue-flat.toml --dut-at lidar=/dev/ttyUSB0 --dut-at base=/dev/ttyUSB1\n  \
    hilrig up scenarios/rescue-flat.toml --device-at lidar=/dev/ttyACM0   # a real lidar\n  \
    hilrig up scenarios/apollo13-goal.toml --pc --dut-at phone=udp:0.0.0.0:9000   # a real phone\n  \
    hilrig up scenarios/rescue-flat.toml --ui=8080    # watched and steered on a page\n  \
    hilrig up scenarios/rescue-flat.toml --capture field.pcapng --capture-max-mb 100\n  \
    hilrig up scenarios/rescue-flat.toml --until-over --out result   # judged: exit code 0 or 1")]
pub(super) struct Up {
    /// Scenario file
    #[arg(value_name = "SCENARIO")]
    scenario: PathBuf,
    /// Directory in which the ports appear [default: hilrig-out/NAME-ports]
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
    /// End after this time, e.g. 60s or 5min [default: at SIGINT or SIGTERM]
    #[arg(long, value_name = "TIME", conflicts_with = "until_over")]
    duration: Option<Span>,
    /// Seed instead of the scenario's own
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    #[command(flatten)]
    ends: EndArgs,
    /// Judge the run when it ends, and write its result folder; exit code 1 if a check fails
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// End when the scenario is over: its mission is done, or its time is up
    #[arg(long)]
    until_over: bool,
    /// End when standard input is closed, so that the rig ends together with the process that
    /// started it
    #[arg(long)]
    until_eof: bool,
    /// Offer the PC's end, and omit the scenario's own PC, even if it has a mission
    #[arg(long)]
    pc: bool,
    #[command(flatten)]
    show: ShowArgs,
    /// File for the case at the end: the scenario with all manual changes [default:
    /// hilrig-out/NAME-up.toml, if there were any]
    #[arg(long, value_name = "FILE")]
    case: Option<PathBuf>,
    /// Write every byte of every link with its time to this file, for Wireshark and decode; an
    /// existing capture is renamed to the next number
    #[arg(long, value_name = "FILE")]
    capture: Option<PathBuf>,
    /// Size at which the capture is renamed to FILE.1.pcapng, .2 and so on, and a new file begins
    #[arg(long, value_name = "MB", default_value_t = 256, requires = "capture",
          value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    capture_max_mb: u64,
    /// Maximum number of renamed captures; older ones are deleted
    #[arg(long, value_name = "N", default_value_t = 7, requires = "capture")]
    capture_files: u64,
}

pub(super) fn run(args: Up) -> Result<Verdict, CliError> {
    let (mut scenario, source) = super::exec::read_without_programs("up", &args.scenario)?;
    super::run::warn(&scenario, &source, None);
    scenario.seed = args.seed.unwrap_or(scenario.seed);
    let pc = pc_end(&args, &scenario);
    let wired = robots::wire(&scenario, &source, Dut::External, pc)?;
    let dir = args
        .dir
        .clone()
        .unwrap_or_else(|| PathBuf::from("hilrig-out").join(format!("{}-ports", scenario.name)));
    let stop = Stop::new(args.duration.map(|duration| duration.0))?;
    if args.until_eof {
        stop.at_end_of_input();
    }

    let mut dir = PortDir::open(&dir)?;
    let mut control = Control::open(&dir)?;
    let (rig, instruments, seats) = args.ends.place(wired, &mut dir)?;
    dir.leave_note(Note::Scenario, &scenario.to_toml())?;
    print_table(&seats);
    let until = match (args.duration, args.until_over) {
        (Some(time), _) => time.to_string(),
        (None, true) => "the scenario is over".to_owned(),
        (None, false) => "SIGINT or SIGTERM".to_owned(),
    };
    let (name, seed) = (&scenario.name, scenario.seed);
    eprintln!("{name}, seed {seed}: running until {until}");
    let mut going = Going {
        run: Run::with_rig(scenario, rig, instruments),
        until_over: args.until_over,
    };
    let capture = record(&args, &mut going.run)?;
    let mut show = args.show.start()?;
    show.begin(&mut going.run);
    // The clock starts last, so that the setup does not use time of the run.
    let mut realtime = Realtime::new(Held::at(Instant::ZERO));
    for seat in seats {
        realtime.serve(seat.end, seat.transport);
    }
    let scenario = going.run.scenario().clone();
    realtime.plug_in(&scenario, &mut going.run.rig);
    control.offer(realtime.places());
    realtime.clock().let_go();
    let ended = go(&mut going, &mut realtime, &mut control, &mut show, &stop);
    let wall = realtime.clock().waited();
    print_report(&realtime, &going.run);
    if control.delays().count() > 0 {
        println!("  faults changed by hand: {}", control.delays());
    }
    let [requests, refused] = control.requests();
    if refused > 0 {
        println!("  control socket: {refused} of {requests} requests refused");
    }
    let changed = control.changes() > 0 || show.has_changed_it();
    leave(&mut going.run, args.case, capture, changed)?;
    let ran_s = (going.run.rig.now() - Instant::ZERO).as_secs_f64();
    let mut judged = None;
    let verdict = match &args.out {
        Some(out) => {
            let mut outcome = going.run.judge();
            outcome.checks.insert(0, connected(&realtime));
            let signal = None;
            let mut ran = Ran {
                outcome,
                wall,
                signal,
                is_doubtful: false,
            };
            ran.doubt(realtime.lateness());
            let ran = write_results(ran, out)?;
            judged = Some(ran.answer(out, None));
            ran.verdict()
        }
        None => Verdict::Pass,
    };
    let used = realtime.reports().filter(is_used);
    super::out::answer(&UpEnded {
        ran_s,
        used: used.map(|report| report.name).collect(),
        changed_by_hand: changed,
        judged,
    });
    ended.map(|()| verdict)
}

/// Reports whether a port was used, except for a robot without a program.
fn connected(realtime: &Realtime<Held>) -> Check {
    let used: Vec<String> = realtime
        .reports()
        .filter(is_used)
        .map(|report| report.name)
        .collect();
    let detail = match used.is_empty() {
        true => "no port was used".to_owned(),
        false => format!("used {}", used.join(", ")),
    };
    Check::new("program-connected", !used.is_empty(), detail)
}

/// Runs until it is time to stop, or a port is lost.
fn go(
    going: &mut Going,
    realtime: &mut Realtime<Held>,
    control: &mut Control,
    show: &mut Show,
    stop: &Stop,
) -> Result<(), CliError> {
    let mut log = Log::default();
    while !stop.is_due(realtime.clock().now()) && !going.is_over() && !control.has_quit() {
        realtime.turn(going)?;
        // A client that reads the modem lines immediately after opening the port must find them
        // raised.
        if control.hear() {
            realtime.carry(going)?;
        }
        if control.has_lines() {
            for sign in realtime.signs() {
                control.see(&sign, &mut going.run);
            }
        }
        let clock = realtime.clock();
        control.serve(&mut going.run, Some(clock), clock.now());
        // The page works even while virtual time stands still.
        show.turn(&mut going.run, Instant::ZERO + clock.waited());
        exec::log_contacts(&mut going.run);
        log.follow(&going.run);
        if let Some(trouble) = going.run.rig.take_tap_trouble() {
            eprintln!("  {} {trouble}", going.run.rig.now());
        }
    }
    Ok(())
}

/// Finishes the capture and the case of a run.
fn leave(
    run: &mut Run,
    case: Option<PathBuf>,
    capture: Option<PathBuf>,
    changed: bool,
) -> Result<(), CliError> {
    let recorded = run.rig.finish_taps();
    write_case(run, case, changed)?;
    recorded.map_err(|source| FolderError {
        path: capture.unwrap_or_default(),
        source,
    })?;
    Ok(())
}

/// Whether the scenario's PC is connected: it needs a mission or a page, and no other PC program.
fn pc_end(args: &Up, scenario: &Scenario) -> PcEnd {
    match (args.pc, args.show.is_wanted()) {
        (true, _) => PcEnd::External,
        (false, true) => PcEnd::Scripted,
        (false, false) => exec::pc_end(scenario),
    }
}

/// Writes the case if a file for it is given, or if it differs from the scenario.
fn write_case(run: &Run, path: Option<PathBuf>, changed: bool) -> Result<(), CliError> {
    let default = || PathBuf::from("hilrig-out").join(format!("{}-up.toml", run.scenario().name));
    let Some(path) = path.or_else(|| changed.then(default)) else {
        return Ok(());
    };
    let written =
        safefs::create_parent(&path).and_then(|()| safefs::write(&path, run.case().to_toml()));
    written.map_err(|source| FolderError {
        path: path.clone(),
        source,
    })?;
    println!("  case: {}", path.display());
    Ok(())
}

/// Makes `run` write its capture, if one is wanted, and prints its path.
fn record(args: &Up, run: &mut Run) -> Result<Option<PathBuf>, CliError> {
    let in_out = args.out.as_ref().map(|out| out.join("capture.pcapng"));
    let Some(path) = args.capture.clone().or(in_out) else {
        return Ok(None);
    };
    if let Some(out) = &args.out {
        // Created before the run, so that an unwritable folder does not waste a run.
        Dir::create(out).map_err(|source| FolderError {
            path: out.clone(),
            source,
        })?;
    }
    let limits = Limits {
        file_bytes: args.capture_max_mb << 20,
        files: args.capture_files,
        // A result folder is overwritten as a whole.
        existing: match args.capture {
            Some(_) => Existing::SetAside,
            None => Existing::Replaced,
        },
    };
    let about = capture::about_live(run.scenario(), utc());
    let recording = Recording::create(&path, &run.rig, about, limits);
    let recording = recording.map_err(|source| FolderError {
        path: path.clone(),
        source,
    })?;
    run.rig.add_tap(Box::new(recording));
    Ok(Some(path))
}

/// A run that continues after its mission, because connected clients may have other tasks, unless
/// `--until-over` is given.
struct Going {
    run: Run,
    until_over: bool,
}

impl Going {
    const fn is_over(&self) -> bool {
        self.until_over && self.run.is_over()
    }
}

impl Paced for Going {
    fn rig(&mut self) -> &mut Rig {
        &mut self.run.rig
    }

    fn run_until(&mut self, deadline: Instant) {
        match self.until_over {
            true => self.run.run_until(deadline),
            false => self.run.go_on_until(deadline),
        }
    }
}

fn print_report(realtime: &Realtime<Held>, run: &Run) {
    println!("ran {} s, {}", run.rig.now(), realtime.lateness());
    let reports: Vec<PortReport> = realtime.reports().collect();
    for report in &reports {
        println!("  {report}");
    }
    if run.rig.excused() > 0 {
        let count = run.rig.excused();
        println!("  {count} broken rules not charged: the rig was late");
    }
    // A robot without a client is not responsible for missing messages to the scenario's PC.
    let used = reports.iter().filter(|report| is_used(report));
    let used: Vec<&str> = used.map(|report| &*report.name).collect();
    let of_clients =
        |logged: &&Logged| logged.is_violation() && run.rig.reaches(&used, &logged.source);
    let violations = run.rig.events().iter().filter(of_clients).count();
    let at_least = match run.rig.events_dropped() {
        0 => "",
        _ => "at least ",
    };
    if violations > 0 {
        println!("  {at_least}{violations} times a client broke a rule of its device, see the log");
    }
}

/// Whether any byte passed a port.
const fn is_used(report: &PortReport) -> bool {
    report.traffic.to_client + report.traffic.from_client > 0
}

/// Prints events as they happen.
#[derive(Debug, Default)]
struct Log {
    events: usize,
    visits: usize,
    second: Option<Instant>,
    lines: u32,
}

/// Maximum number of lines per second: a client that breaks a rule with each byte must not hide the
/// rest.
const LINES_MAX: u32 = 20;
/// Connecting and disconnecting clients are still logged, because scripts wait for these lines.
const ALWAYS: [&str; 2] = ["port-opened", "port-closed"];

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
            if self.says(&logged.event) {
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

    /// Whether the event may be printed: the number of lines per second is limited.
    fn says(&mut self, event: &Event) -> bool {
        let is_always = ALWAYS.contains(&event.rule);
        self.lines += u32::from(!is_always);
        is_always || self.lines <= LINES_MAX
    }
}

#[cfg(test)]
mod tests {
    use emulators::EventKind;

    use super::*;

    /// Twenty lines of a robot that is killed in its first second, and the closing of its ports.
    #[test]
    fn who_comes_and_goes_is_said_however_much_there_is_to_say() {
        let mut log = Log::default();
        let mut says = |rule: &'static str| {
            log.says(&Event {
                at: Instant::ZERO,
                kind: EventKind::Violation,
                rule,
                detail: String::new(),
                bytes: Vec::new(),
            })
        };
        assert!(says("port-opened"));
        assert_eq!((0..25).filter(|_| says("stray-bytes")).count(), 20);
        assert!(says("port-closed") && !says("stray-bytes"));
    }
}
