//! A capture played to somebody's program, which is started on pseudo-terminals.

use std::path::Path;

use protocols::Instant;

use super::{Heard, How, ReplayArgs, follow, report};
use crate::capture::Capture;
use crate::capture::case::{Case, Judgement};
use crate::capture::replay::{Passage, Played, Recorded, StandIn, scenario_of};
use crate::cli::exec::show_words;
use crate::cli::stop::Stop;
use crate::cli::{CliError, Verdict};
use crate::realtime::clock::WallClock;
use crate::realtime::exec::ExecError;
use crate::realtime::exec::{Foreign, PORTS_VARIABLE, Seat, alive, childless, port_variable};
use crate::realtime::guest::Trial;
use crate::realtime::playback::{Playback, ReplayPace, Side as PlayedSide, Socket};
use crate::realtime::process::{Ended, Patience, Process};
use crate::realtime::transport::{PortDir, Pty};
use crate::robots::{self, Dut, PcEnd};
use crate::run::check::{Check, Status};
use crate::scenario::{Scenario, Source};

/// Plays `recorded` to the program and judges it.
pub(super) fn into_foreign(
    args: &ReplayArgs,
    foreign: &Foreign,
    capture: &Capture,
    recorded: &Recorded,
) -> Result<Verdict, CliError> {
    if foreign.supervision.is_some() && args.speed.to_bits() != 1_f64.to_bits() {
        let wrong =
            "--speed: virtual time is as fast as it can be, expected no --virtual beside it";
        return Err(CliError::Usage(wrong.to_owned()));
    }
    let own = own_links(scenario_of(capture, &args.file)?.as_ref())?;
    let stop = Stop::new(None)?;
    let how = How {
        step: false,
        expect: args.expect,
    };
    let shown = Shown {
        out: &args.out,
        speed: args.speed,
        how,
    };
    let tried = play_to(foreign, recorded, own.as_deref(), &shown, &stop)?;
    let compared = report(args, &tried.heard, &tried.checks);
    for check in &tried.checks {
        println!("  {check}");
    }
    tell(&tried.notes);
    let mut checks = tried.checks.iter();
    let all_hold = checks.all(|check| check.status == Status::Pass);
    let verdict = match (stop.signal(), all_hold) {
        (Some(signal), _) => Verdict::Interrupted(signal),
        (None, true) => compared,
        (None, false) => Verdict::Fail,
    };
    if verdict != Verdict::Pass {
        show_words(&tried.said, &args.out.join("program.log"));
    }
    Ok(verdict)
}

fn tell(notes: &[String]) {
    for note in notes {
        println!("  leaves virtual time: {note}");
    }
}

/// Plays a byte case to the program and judges what it says to that.
pub(in crate::cli) fn judge_case(
    (case, source): &(Case, Source),
    foreign: &Foreign,
    out: &Path,
    stop: &Stop,
) -> Result<Judgement, CliError> {
    let recorded = case.recorded(&source.path)?;
    let (step, expect) = (false, true);
    let shown = Shown {
        out,
        speed: 1.0,
        how: How { step, expect },
    };
    let tried = play_to(foreign, &recorded, None, &shown, stop)?;
    let (judgement, unjudged) = case.judge_foreign(tried.checks, &tried.links, recorded.end);
    println!("{judgement}");
    if !unjudged.is_empty() {
        let names = unjudged.join(", ");
        println!("  not judged, no device hears the program: {names}");
    }
    tell(&tried.notes);
    if !judgement.passed() {
        show_words(&tried.said, &out.join("program.log"));
    }
    Ok(judgement)
}

/// Where and how something is played.
struct Shown<'a> {
    /// Folder for ports and program.log.
    out: &'a Path,
    speed: f64,
    how: How,
}

/// What came of it.
struct Tried {
    heard: Heard,
    links: Vec<Played>,
    /// Verdicts on the program itself.
    checks: Vec<Check>,
    said: String,
    /// What left virtual time.
    notes: Vec<String>,
}

/// Starts the program on the links that are `own`, or on all that have something to say, and plays
/// to it.
fn play_to(
    foreign: &Foreign,
    recorded: &Recorded,
    own: Option<&[String]>,
    shown: &Shown<'_>,
    stop: &Stop,
) -> Result<Tried, CliError> {
    let failed = |path: &Path, error| CliError::write(path.display(), error);
    std::fs::create_dir_all(shown.out).map_err(|error| failed(shown.out, error))?;
    let ports = shown.out.join("ports");
    let ports = std::path::absolute(&ports).map_err(|error| failed(&ports, error))?;
    let dir = PortDir::open(&ports)?;
    let passages = played(foreign, own, recorded)?;
    match foreign.supervision {
        Some(_) => play_in_virtual_time(foreign, (&passages, recorded.end), dir, shown, stop),
        None => play_in_real_time(foreign, (&passages, recorded), dir, shown, stop),
    }
}

fn play_in_real_time(
    foreign: &Foreign,
    (passages, recorded): (&[&Passage], &Recorded),
    dir: PortDir,
    shown: &Shown<'_>,
    stop: &Stop,
) -> Result<Tried, CliError> {
    let mut env = vec![(PORTS_VARIABLE.to_owned(), dir.path().into())];
    let mut sockets = Vec::new();
    for passage in passages {
        let port = Pty::open(&dir, &passage.link, passage.line())?;
        let path = dir.path().join(&passage.link);
        env.push((port_variable(&passage.link), path.into()));
        sockets.push(Socket::new(passage, PlayedSide::Device, Box::new(port)));
    }
    let pace = ReplayPace::Times(shown.speed);
    let mut playback = Playback::new(WallClock::start(), recorded, sockets, pace);
    let log = shown.out.join("program.log");
    let process = Process::start(&foreign.command, &env, Some(&log));
    let mut process = process.map_err(ExecError::NotStarted)?;
    let mut ended: Option<(Ended, Instant)> = None;
    let until = Instant::ZERO + foreign.wait;
    follow(shown.how, &mut playback, stop, &mut |playback, now| {
        ended = ended.or_else(|| process.ended().map(|how| (how, playback.now())));
        let is_late = playback.waits_for().is_some() && now >= until;
        ended.is_none() && !is_late
    })?;
    let unopened = playback.waits_for().map(Socket::link);
    let connected = match unopened {
        Some(link) => format!("never opened {link}"),
        None => "opened all ports".to_owned(),
    };
    let connected = Check::new("program-connected", unopened.is_none(), connected);
    let is_over = playback.is_over();
    let farewell = process.end(Patience::FAIR);
    Ok(Tried {
        checks: vec![
            connected,
            alive(ended, is_over, foreign.may_end, &farewell),
            childless(&farewell.left),
        ],
        heard: Heard::of(&playback),
        links: playback.sockets().iter().map(Socket::played).collect(),
        said: farewell.said,
        notes: Vec::new(),
    })
}

/// The verdicts on a program that are made of a replay: what it reads and when nobody judges.
const JUDGED: [&str; 4] = [
    "program-connected",
    "program-alive",
    "program-yields",
    "no-children-left",
];

fn play_in_virtual_time(
    foreign: &Foreign,
    (passages, end): (&[&Passage], Instant),
    dir: PortDir,
    shown: &Shown<'_>,
    stop: &Stop,
) -> Result<Tried, CliError> {
    let StandIn {
        run,
        open_ends,
        ear,
    } = StandIn::new(passages, end)?;
    let mut seats = Vec::new();
    for end in open_ends {
        seats.push(Seat {
            transport: Box::new(Pty::open(&dir, &end.name, end.line)?),
            end,
            is_terminal: true,
        });
    }
    let log = shown.out.join("program.log");
    let mut trial = Trial::start(run, seats, dir, foreign.clone(), None, &log)?;
    let mut turned = Ok(());
    while !trial.is_over() && stop.signal().is_none() && turned.is_ok() {
        turned = trial.turn();
    }
    let now = trial.now().min(end);
    let ended = trial.end();
    turned?;
    let links = ear.played();
    let said = |played: &Played| {
        let passage = passages.iter().find(|one| one.link == played.link);
        let arrivals = passage.into_iter().flat_map(|one| &one.arrivals);
        let arrived = arrivals.filter(|one| one.at <= now);
        arrived.map(|one| one.bytes.len() as u64).sum()
    };
    let counts = links.iter().map(|one| {
        let counts = [said(one), one.got.bytes().len() as u64];
        (one.link.clone(), counts)
    });
    let checks = ended.outcome.checks.into_iter();
    Ok(Tried {
        heard: Heard {
            now,
            counts: counts.collect(),
            divergence: Played::first_divergence(&links),
            trace_hash: Some(ended.outcome.trace_hash),
        },
        links,
        checks: checks
            .filter(|check| JUDGED.contains(&&*check.name))
            .collect(),
        said: ended.said,
        notes: ended.notes,
    })
}

/// The links that are played: those that are named, or all that have something for the program.
fn played<'a>(
    foreign: &Foreign,
    own: Option<&[String]>,
    recorded: &'a Recorded,
) -> Result<Vec<&'a Passage>, CliError> {
    if foreign.needs.is_empty() {
        let links = recorded.links.iter();
        let links = links.filter(|one| !one.arrivals.is_empty());
        let is_own = |one: &&Passage| own.is_none_or(|own| own.contains(&one.link));
        let links: Vec<&Passage> = links.filter(is_own).collect();
        return match links.is_empty() {
            true => Err(CliError::Usage(
                "--exec: expected a capture with bytes to-master".to_owned(),
            )),
            false => Ok(links),
        };
    }
    let find = |name: &String| {
        let found = recorded.links.iter().find(|one| one.link == *name);
        found.ok_or_else(|| {
            let all: Vec<&str> = recorded.links.iter().map(|one| &*one.link).collect();
            let all = all.join(", ");
            let error = format!("--exec-needs {name}: no such link, expected some of {all}");
            CliError::Usage(error)
        })
    };
    foreign.needs.iter().map(find).collect()
}

/// The links at which the captured robot's program is, if it is known which robot that was: what
/// reaches the PC is not for it.
fn own_links(robot: Option<&(Scenario, Source)>) -> Result<Option<Vec<String>>, CliError> {
    let Some((scenario, source)) = robot else {
        return Ok(None);
    };
    let wired = robots::wire(scenario, source, Dut::External, PcEnd::Scripted)?;
    let ends = wired.open_ends.into_iter();
    Ok(Some(ends.map(|end| end.link).collect()))
}
