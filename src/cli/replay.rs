mod cause;
mod exec;
mod heard;
mod kept;
mod links;
mod play;

use core::time::Duration;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::thread;

use clap::Args;
use protocols::Instant;

use super::answer::ReplayEnded;
use super::decode::source::PCAPNG;
use super::exec::ExecArgs;
use super::place::{self, NamedPort};
use super::ports::Ports;
use super::progress;
use super::stop::Stop;
use super::{CliError, Verdict, out};
use crate::capture::Capture;
use crate::capture::divergence::Divergence;
use crate::capture::replay::{
    Recorded, Replay, Replayed, SILENCE_MAX, Silence, Voice, scenario_of,
};
use crate::realtime::clock::{Clock, WallClock};
use crate::realtime::playback::{Playback, ReplayPace, Side as PlayedSide, Socket};
use crate::run::check::{Check, Status};
use crate::scenario::{Scenario, Source, Span};
use engine::hex::pairs;

use heard::{Heard, report};

pub(super) use exec::{judge_case, sound_of, try_case};

/// Play a capture to the robot's program in virtual time, or to ports.
///
/// Without a port, the built-in program of the robot receives the captured bytes at their recorded
/// nanosecond. The capture of a run names its robot. All checkers of a run judge the program: exit
/// code 1 if one fails.
///
/// With --to, --dir or --exec the capture is played as a conversation: each answer is sent after
/// the program's request, with its recorded delay. The program may start later, be slower, change
/// the order of requests or repeat them. Unsolicited bytes keep their recorded delay after the
/// previous answer or message, or after the opening of the port. With --by-time each byte is sent
/// at its recorded time instead.
///
/// --exec starts a program on new ports; it must not end before the replay. With --expect, the
/// requests of the program are compared with the capture, and the first difference is reported:
/// time, link, byte, and both frames in words. If all links are silent for longer than a minute,
/// one minute is played.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig replay hilrig-out/rescue-flat-1/capture.pcapng --expect\n  \
    hilrig replay field.pcapng --scenario scenarios/rescue-flat.toml\n  \
    hilrig replay field.pcapng --to lidar=pty:/tmp/robot/lidar      # for a program to open\n  \
    hilrig replay field.pcapng --dir /tmp/robot --expect --speed 2  # to `hilrig up`'s devices\n  \
    hilrig replay field.pcapng --to base=/dev/ttyUSB0 --as program --step\n  \
    hilrig replay field.pcapng --exec './my-robot \"$HILRIG_DIR\"' --expect")]
pub(super) struct ReplayArgs {
    /// Capture to play
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Compare the answers with the capture; exit code 1 if they differ
    #[arg(long)]
    expect: bool,
    /// Scenario whose robot this is [default: the one in the capture]
    #[arg(long, value_name = "FILE", conflicts_with_all = ["to", "dir"])]
    scenario: Option<PathBuf>,
    /// Stop this long after the beginning of the capture, e.g. 10s
    #[arg(long, value_name = "TIME")]
    until: Option<Span>,
    /// Play a link to a port: a path, or pty:PATH for a new pseudo-terminal
    #[arg(long, value_name = "LINK=PORT", conflicts_with = "exec")]
    to: Vec<NamedPort>,
    /// Play every link that has a port in this directory, as `hilrig up` offers them
    #[arg(long, value_name = "DIR", conflicts_with = "exec")]
    dir: Option<PathBuf>,
    /// The side that the capture replaces [default: program with --dir, else device]
    #[arg(long = "as", value_name = "SIDE", conflicts_with = "exec")]
    side: Option<PlayedSide>,
    /// Play each byte at its recorded time, independent of the program's requests
    #[arg(long)]
    by_time: bool,
    /// Speed factor: 2 plays twice as fast as recorded
    #[arg(long, value_name = "N", default_value = "1", value_parser = speed)]
    speed: f64,
    /// Play one piece for each line on standard input
    #[arg(long, conflicts_with_all = ["speed", "exec"])]
    step: bool,
    #[command(flatten)]
    program: ExecArgs,
    /// Folder for the ports and program.log of --exec
    #[arg(
        long,
        value_name = "DIR",
        default_value = "hilrig-out/replay",
        requires = "exec"
    )]
    out: PathBuf,
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text
        .parse()
        .ok()
        .filter(|speed| (1e-3..=1e6).contains(speed));
    speed.ok_or_else(|| "expected a number from 0.001 to 1000000".to_owned())
}

pub(super) fn run(args: ReplayArgs) -> Result<Verdict, CliError> {
    args.program.refuse_cpu("replay")?;
    let capture = read(&args.file)?;
    let recorded = Recorded::of(&capture, args.until.map(|until| until.0));
    let recorded = shortened(&args.file, recorded);
    if let Some(foreign) = args.program.foreign() {
        return exec::into_foreign(&args, &foreign, &capture, &recorded);
    }
    if args.to.is_empty() && args.dir.is_none() {
        let (scenario, source) = robot(&capture, &args.file, args.scenario.as_deref())?;
        drop(capture);
        return into_program(&args, &recorded, &scenario, &source);
    }
    into_ports(&args, &recorded)
}

/// Whether a file begins with the mark of a pcapng capture. A pipe was read before and has no more.
fn begins_as_capture(path: &Path) -> bool {
    let mut first = [0; PCAPNG.len()];
    let read = safefs::open(path).and_then(|mut file| file.read_exact(&mut first));
    read.is_ok() && first == PCAPNG
}

/// Refuses a file of another tool with the command that imports it.
pub(super) fn refuse_foreign(path: &Path, capture: &Capture) -> Result<(), CliError> {
    let is_foreign = capture.links.iter().any(|link| !link.is_serial());
    match is_foreign || (capture.records.is_empty() && !begins_as_capture(path)) {
        true => Err(CliError::content(path, super::import::next_step(path))),
        false => Ok(()),
    }
}

/// Reads a capture with the other files of its recording; reports a truncated capture.
pub(super) fn read(path: &Path) -> Result<Capture, CliError> {
    let shown = path.display();
    let read = Capture::read_recording(path);
    let (capture, files) = read.map_err(|error| CliError::read(path, error))?;
    refuse_foreign(path, &capture)?;
    if files > 1 {
        eprintln!("{shown} is one of {files} files of a recording; they are read as one");
    }
    if let Some(error) = capture.broken {
        if capture.records.is_empty() {
            let error = format!("{error}: expected a pcapng capture");
            return Err(CliError::content(path, error));
        }
        eprintln!("{shown} is broken {error}; only the part before the error is used");
    } else if capture.cut > 0 {
        eprintln!(
            "{shown} was cut: {} bytes at its end are not a complete block",
            capture.cut
        );
    }
    if capture.records.is_empty() {
        return Err(CliError::content(
            path,
            "expected a capture, it has no record",
        ));
    }
    Ok(capture)
}

/// Maximum number of long silences that are printed one by one.
const SILENCES_TOLD: usize = 3;

/// The same capture with long silences shortened; prints each of them.
pub(super) fn shortened(path: &Path, recorded: Recorded) -> Recorded {
    let (recorded, silences) = recorded.shortened();
    let (path, max) = (path.display(), SILENCE_MAX.as_secs());
    for Silence { from, lasted, .. } in silences.all().iter().take(SILENCES_TOLD) {
        let lasted = lasted.as_secs_f64();
        eprintln!("{path}: the silence of {lasted:.0} s at {from} s is played as {max} s");
    }
    if let Some(more @ 1..) = silences.all().len().checked_sub(SILENCES_TOLD) {
        eprintln!("{path}: {more} more silences are played as {max} s each");
    }
    recorded
}

/// The robot of the program that receives the capture.
pub(super) fn robot(
    capture: &Capture,
    path: &Path,
    scenario: Option<&Path>,
) -> Result<(Scenario, Source), CliError> {
    if let Some(path) = scenario {
        return Ok(Scenario::read(path)?);
    }
    scenario_of(capture, path)?.ok_or_else(|| {
        CliError::content(
            path,
            "does not contain its scenario: expected --scenario FILE",
        )
    })
}

/// Time without output after which a long replay prints its progress.
const PATIENCE: Duration = Duration::from_secs(2);

fn into_program(
    args: &ReplayArgs,
    recorded: &Recorded,
    scenario: &Scenario,
    source: &Source,
) -> Result<Verdict, CliError> {
    let replayed = play(Replay::new(recorded, scenario, source, Voice::Program)?);
    let (ran, heard, sent) = (replayed.ran.as_secs_f64(), replayed.heard, replayed.sent());
    println!("replayed {ran:.3} s: {heard} B to the program, {sent} B from it");
    if let Some(first) = replayed.violations.first() {
        println!(
            "  {} broken rules; first: {first}",
            replayed.violations.len()
        );
    }
    for check in &replayed.checks {
        println!("  {check}");
    }
    println!("  trace {}", replayed.trace_hash);
    let divergence = replayed.divergence().filter(|_| args.expect);
    out::answer(&ReplayEnded {
        played_s: ran,
        bytes_sent: heard as u64,
        bytes_back: sent as u64,
        checks: replayed.checks.clone(),
        divergence: divergence.as_ref().map(ToString::to_string),
        trace_hash: Some(replayed.trace_hash.clone()),
    });
    let failed = |check: &Check| check.status == Status::Fail;
    let judged = match replayed.checks.iter().any(failed) {
        true => Verdict::Fail,
        false => Verdict::Pass,
    };
    if !args.expect {
        return Ok(judged);
    }
    let shift = replayed.largest_shift().as_nanos();
    let compared = judge(
        divergence.as_ref(),
        &format!(", at most {shift} ns apart in time"),
    );
    Ok(match compared {
        Verdict::Pass => judged,
        other => other,
    })
}

/// Plays to the end, and prints its progress if that takes long.
pub(super) fn play(mut replay: Replay) -> Replayed {
    let (clock, mut said) = (WallClock::start(), Instant::ZERO);
    while !replay.is_over() {
        replay.run_for(Duration::from_millis(200));
        if clock.now() - said >= PATIENCE && progress::is_watched() {
            said = clock.now();
            eprintln!("  {} s replayed", replay.rig().now());
        }
    }
    replay.finish()
}

fn judge(divergence: Option<&Divergence>, apart: &str) -> Verdict {
    match divergence {
        None => {
            println!("no divergence: the same bytes as in the capture{apart}");
            Verdict::Pass
        }
        Some(divergence) => {
            println!("DIVERGENCE at {divergence}");
            Verdict::Fail
        }
    }
}

fn sockets(
    args: &ReplayArgs,
    recorded: &Recorded,
    ports: &mut Ports,
) -> Result<Vec<Socket>, CliError> {
    let names: Vec<String> = recorded.links.iter().map(|one| one.link.clone()).collect();
    place::check("--to", &args.to, &names)?;
    let default = match args.dir {
        Some(_) => PlayedSide::Program,
        None => PlayedSide::Device,
    };
    let side = args.side.unwrap_or(default);
    let mut sockets = Vec::new();
    for passage in &recorded.links {
        let there = args.dir.as_ref().map(|dir| dir.join(&passage.link));
        let path = match place::find(&args.to, &passage.link) {
            Some(place) => Some(place.path.clone()),
            None => there.filter(|path| path.exists()),
        };
        if let Some(path) = path {
            let port = ports.open("--to", &path, passage.line())?;
            eprintln!("{}: {}", passage.link, port.path().display());
            let is_by_time = args.by_time || args.step || side == PlayedSide::Program;
            sockets.push(match is_by_time {
                true => Socket::new(passage, side, port),
                false => Socket::talking(passage, &recorded.session(), port),
            });
        }
    }
    if sockets.is_empty() {
        let dir = args.dir.as_deref().unwrap_or(Path::new("")).display();
        let names = names.join(", ");
        let error = format!("--dir {dir}: no port of a link there; expected one of {names}");
        return Err(CliError::Usage(error));
    }
    Ok(sockets)
}

/// Time for answers after the end of the capture.
const ANSWERS: Duration = Duration::from_secs(1);

fn into_ports(args: &ReplayArgs, recorded: &Recorded) -> Result<Verdict, CliError> {
    let stop = Stop::new(None)?;
    let mut ports = Ports::default();
    let sockets = sockets(args, recorded, &mut ports)?;
    let pace = match args.step {
        true => ReplayPace::Stepped,
        false => ReplayPace::Times(args.speed),
    };
    let mut playback = Playback::new(WallClock::start(), recorded, sockets, pace);
    let how = How {
        step: args.step,
        expect: args.expect,
    };
    let trouble = follow(how, &mut playback, &stop, &mut |_, _| true)?;
    let heard = Heard::of(&playback);
    let verdict = report(args, &heard, &[]);
    Ok(match trouble {
        true => Verdict::Fail,
        false => verdict,
    })
}

/// The play mode.
#[derive(Clone, Copy, Debug)]
struct How {
    /// Piece by piece.
    step: bool,
    /// Wait for answers.
    expect: bool,
}

/// Wall time between two messages about a client that does not read.
const TROUBLE_EVERY: Duration = Duration::from_secs(5);

/// Plays until all bytes are sent and received, a signal arrives, or `goes_on` returns false.
/// Returns whether the clients closed their ports before that.
fn follow(
    How { step, expect }: How,
    playback: &mut Playback<WallClock>,
    stop: &Stop,
    goes_on: &mut dyn FnMut(&Playback<WallClock>, Instant) -> bool,
) -> Result<bool, CliError> {
    let lines = step.then(lines_of_stdin);
    let mut said = false;
    let mut answers_until = None;
    let mut next_word = Instant::ZERO;
    while !stop.is_due(playback.clock().now()) {
        playback.turn()?;
        if let (Some(socket), false) = (playback.waits_for(), said) {
            said = true;
            eprintln!("waiting until a client opens {}", socket.link());
        }
        if let Some(trouble) = playback.trouble()
            && playback.clock().now() >= next_word
        {
            eprintln!("{trouble}");
            next_word = playback.clock().now() + TROUBLE_EVERY;
            if playback.is_left() {
                return Ok(true);
            }
        }
        if let Some(lines) = &lines
            && playback.waits_for().is_none()
            && !self::step(playback, lines)
        {
            break;
        }
        let now = playback.clock().now();
        if playback.is_over() {
            let until = *answers_until.get_or_insert(now + ANSWERS);
            if now >= until || !expect || playback.has_heard_all() {
                break;
            }
        }
        if !goes_on(playback, now) {
            return Ok(false);
        }
    }
    let left = playback.sockets().iter().filter(|_| playback.is_left());
    let troubles: Vec<String> = left.filter_map(Socket::trouble).collect();
    for trouble in &troubles {
        eprintln!("{trouble}");
    }
    drain(playback, stop);
    Ok(!troubles.is_empty())
}

/// Maximum time from a client's first read to its last.
const SETTLE: Duration = Duration::from_millis(100);

/// Waits until the client has read all bytes, because closing a new terminal discards them. The
/// wait is limited.
fn drain(playback: &mut Playback<WallClock>, stop: &Stop) {
    let until = playback.clock().now() + ANSWERS;
    while !playback.is_drained() {
        let now = playback.clock().now();
        if now >= until || stop.is_due(now) {
            break;
        }
        playback.clock().sleep_until(now + Duration::from_millis(1));
    }
    playback
        .clock()
        .sleep_until(playback.clock().now() + SETTLE);
}

/// A line on standard input sends the next piece; its end ends the replay. Returns whether to
/// continue.
fn step(playback: &mut Playback<WallClock>, lines: &Receiver<()>) -> bool {
    match lines.try_recv() {
        Ok(()) => match playback.step() {
            Some((at, link, bytes)) => {
                println!("{at} {link} {}", pairs(&bytes));
                true
            }
            None => false,
        },
        Err(std::sync::mpsc::TryRecvError::Empty) => true,
        Err(std::sync::mpsc::TryRecvError::Disconnected) => false,
    }
}

fn lines_of_stdin() -> Receiver<()> {
    let (sender, lines) = channel();
    thread::spawn(move || {
        let read = io::stdin().lines().map_while(Result::ok);
        read.map(|_| sender.send(()))
            .take_while(Result::is_ok)
            .for_each(|_| {});
    });
    lines
}
