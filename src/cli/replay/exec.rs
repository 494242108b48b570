//! A capture played to a foreign program on pseudo-terminals.

use core::time::Duration;
use std::path::Path;

use protocols::Instant;

use super::links::{own_links, parted};
use super::{Heard, How, ReplayArgs, follow, report};
use crate::capture::Capture;
use crate::capture::case::{Case, Evidence, Expectation, Judgement, Play, Sound};
use crate::capture::replay::{Eavesdrop, Passage, Played, Recorded, StandIn, Timing, scenario_of};
use crate::cli::exec::{refuse_programs, show_words};
use crate::cli::stop::Stop;
use crate::cli::{CliError, Verdict};
use crate::realtime::clock::WallClock;
use crate::realtime::exec::{
    self, ExecError, Foreign, PORTS_VARIABLE, Seat, alive, childless, port_variable,
};
use crate::realtime::guest::Trial;
use crate::realtime::playback::{Playback, ReplayPace, Side as PlayedSide, Socket};
use crate::realtime::process::{Ended, Patience, Process};
use crate::realtime::transport::{PortDir, Pty};
use crate::run::check::{Check, Status};
use crate::scenario::{Scenario, Source};
use safefs::Dir;

/// Plays `recorded` to the program and judges it.
pub(super) fn into_foreign(
    args: &ReplayArgs,
    foreign: &Foreign,
    capture: &Capture,
    recorded: &Recorded,
) -> Result<Verdict, CliError> {
    if foreign.supervision.is_some() && args.speed.to_bits() != 1_f64.to_bits() {
        let wrong = "--speed: not possible with --virtual, which always runs as fast as possible";
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
        timing: match args.by_time {
            true => Timing::Clock,
            false => Timing::Conversation,
        },
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
        show_words("the program", &tried.said, &args.out.join("program.log"));
    }
    Ok(verdict)
}

fn tell(notes: &[String]) {
    for note in notes {
        println!("  leaves virtual time: {note}");
    }
}

/// A case judged with a foreign program, and further notes.
pub(in crate::cli) struct CaseTried {
    pub(in crate::cli) judgement: Judgement,
    /// Expectations that are not visible at the ports.
    unjudged: Vec<String>,
    /// The cause of a failure, as far as the ports show it.
    pub(in crate::cli) cause: Option<String>,
    said: String,
    notes: Vec<String>,
}

/// Plays a case to the program, judges its behaviour, and prints the result.
pub(in crate::cli) fn judge_case(
    case: &(Case, Source),
    foreign: &Foreign,
    out: &Path,
    stop: &Stop,
) -> Result<Judgement, CliError> {
    let tried = try_case(case, foreign, out, stop)?;
    println!("{}", tried.judgement);
    if let Some(cause) = &tried.cause {
        println!("  probable cause: {cause}");
    }
    if !tried.unjudged.is_empty() {
        let names = tried.unjudged.join(", ");
        println!("  not judged, no device receives the program's bytes: {names}");
    }
    tell(&tried.notes);
    if !tried.judgement.passed() {
        show_words("the program", &tried.said, &out.join("program.log"));
    }
    Ok(tried.judgement)
}

/// Maximum delay of a program's action caused by damage: in virtual time, and in real time on a
/// busy machine.
const LATE_VIRTUAL: Duration = Duration::from_millis(100);
const LATE_REAL: Duration = Duration::from_secs(1);

/// The same without output.
pub(in crate::cli) fn try_case(
    (case, source): &(Case, Source),
    foreign: &Foreign,
    out: &Path,
    stop: &Stop,
) -> Result<CaseTried, CliError> {
    let mut foreign = foreign.clone();
    // The rule of the case defines the expected end.
    foreign.may_end |= case.expect.exits.is_some();
    let tried = play_case((case, source), &foreign, out, stop)?;
    let printed = printed(out);
    let exit_code = tried.ended.and_then(|(ended, _)| match ended {
        Ended::Code(code) => Some(code),
        Ended::Signal(_) => None,
    });
    let evidence = Evidence {
        links: &tried.links,
        said: &printed,
        exit_code,
        ended_at: tried.ended.map(|(_, at)| at),
        end: tried.heard.now,
    };
    let (mut judgement, unjudged) = case.judge_foreign(tried.checks, &evidence);
    if case.expect.ignores_damage && case.play != Some(Play::Devices) {
        let late = match foreign.supervision {
            Some(_) => LATE_VIRTUAL,
            None => LATE_REAL,
        };
        let recorded = case.recorded(&source.path)?;
        let (sound, left_out) = case.without_damage(&recorded);
        let again = out.join("without-damage");
        let without = play_to(&foreign, &sound, None, &Shown::of_case(&again), stop)?;
        judgement.checks.extend(match left_out {
            0 => vec![Check::not_observed(
                "ignores-damage",
                "the capture has no damaged frame of a known protocol".to_owned(),
            )],
            _ => Case::judge_damage(&tried.links, &without.links, late),
        });
    }
    let cause = match judgement.passed() {
        true => None,
        false => parted(&tried.links).or(tried.cause),
    };
    Ok(CaseTried {
        judgement,
        unjudged,
        cause,
        said: tried.said,
        notes: tried.notes,
    })
}

/// The program's whole output.
pub(in crate::cli) fn printed(out: &Path) -> String {
    let log = std::fs::read(out.join("program.log")).unwrap_or_default();
    String::from_utf8_lossy(&log).into_owned()
}

/// The behaviour of a reference program with the case.
pub(in crate::cli) fn sound_of(
    case: &(Case, Source),
    foreign: &Foreign,
    out: &Path,
    stop: &Stop,
) -> Result<Sound, CliError> {
    let tried = play_case((&case.0, &case.1), foreign, out, stop)?;
    // With devices, the world develops differently for each program, so only the output is
    // compared.
    let links = match case.0.play {
        Some(Play::Devices) => &[],
        _ => &tried.links[..],
    };
    let baud = |link: &str| Expectation::baud_of(&case.0.link, link);
    Ok(Sound::of(&foreign.command, &printed(out), links, baud))
}

fn play_case(
    (case, source): (&Case, &Source),
    foreign: &Foreign,
    out: &Path,
    stop: &Stop,
) -> Result<Tried, CliError> {
    match (case.play, &case.scenario) {
        (Some(Play::Devices), Some(scenario)) => {
            play_with_devices((scenario, source), foreign, out, stop)
        }
        _ => {
            let recorded = case.recorded(&source.path)?;
            play_to(foreign, &recorded, None, &Shown::of_case(out), stop)
        }
    }
}

/// Runs the scenario of a case with the program, as `hilrig run` does.
fn play_with_devices(
    (scenario, source): (&Scenario, &Source),
    foreign: &Foreign,
    out: &Path,
    stop: &Stop,
) -> Result<Tried, CliError> {
    refuse_programs("--exec", &source.path, scenario)?;
    let failed = |path: &Path, error| CliError::write(path.display(), error);
    Dir::create(out).map_err(|error| failed(out, error))?;
    let ports = out.join("ports");
    let ports = std::path::absolute(&ports).map_err(|error| failed(&ports, error))?;
    let log = out.join("program.log");
    let (mut run, seats, dir) = exec::stage(scenario, source, &ports)?;
    let names: Vec<String> = seats.iter().map(|seat| seat.end.link.clone()).collect();
    let ear = Eavesdrop::of(&mut run.rig, &names);
    let goes_on = || stop.signal().is_none();
    let (now, ended, outcome, said, notes) = match foreign.supervision {
        Some(_) => {
            let mut trial = Trial::start(run, seats, dir, foreign.clone(), None, &log)?;
            let (mut ended, mut turned) = (None, Ok(()));
            while !trial.is_over() && goes_on() && turned.is_ok() {
                turned = trial.turn();
                ended = ended.or_else(|| trial.ended().map(|how| (how, trial.now())));
            }
            let now = trial.now();
            let played = trial.end();
            turned?;
            (now, ended, played.outcome, played.said, played.notes)
        }
        None => {
            let mut trial = exec::Trial::start(run, seats, dir, foreign.clone(), &log)?;
            while !trial.is_over() && goes_on() {
                trial.turn()?;
            }
            let (now, ended) = (trial.now(), trial.ended());
            let judged = trial.end();
            (now, ended, judged.outcome, judged.seen.said, Vec::new())
        }
    };
    Ok(Tried {
        heard: Heard {
            now,
            counts: Vec::new(),
            divergence: None,
            tallies: Vec::new(),
            trace_hash: Some(outcome.trace_hash),
        },
        links: ear.played(),
        cause: outcome.probable_cause,
        checks: outcome.checks,
        ended,
        said,
        notes,
    })
}

/// Place and mode of a replay.
struct Shown<'a> {
    /// Folder for ports and program.log.
    out: &'a Path,
    speed: f64,
    how: How,
    timing: Timing,
}

impl<'a> Shown<'a> {
    /// The mode for cases.
    const fn of_case(out: &'a Path) -> Self {
        let (step, expect) = (false, true);
        Self {
            out,
            speed: 1.0,
            how: How { step, expect },
            timing: Timing::Conversation,
        }
    }
}

/// The result of a replay.
struct Tried {
    heard: Heard,
    links: Vec<Played>,
    /// The probable cause of a failure, from the devices' view.
    cause: Option<String>,
    /// Verdicts on the program itself.
    checks: Vec<Check>,
    /// How and when the program ended, if it ended itself.
    ended: Option<(Ended, Instant)>,
    said: String,
    /// Calls outside virtual time.
    notes: Vec<String>,
}

/// Starts the program on the links `own`, or on all links with bytes for it, and plays to it.
fn play_to(
    foreign: &Foreign,
    recorded: &Recorded,
    own: Option<&[String]>,
    shown: &Shown<'_>,
    stop: &Stop,
) -> Result<Tried, CliError> {
    let failed = |path: &Path, error| CliError::write(path.display(), error);
    Dir::create(shown.out).map_err(|error| failed(shown.out, error))?;
    let ports = shown.out.join("ports");
    let ports = std::path::absolute(&ports).map_err(|error| failed(&ports, error))?;
    let dir = PortDir::open(&ports)?;
    let passages = played(foreign, own, recorded)?;
    match foreign.supervision {
        Some(_) => play_in_virtual_time(foreign, (&passages, recorded), dir, shown, stop),
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
        let port = Box::new(port);
        sockets.push(match shown.timing {
            Timing::Clock => Socket::new(passage, PlayedSide::Device, port),
            Timing::Conversation => Socket::talking(passage, &recorded.session(), port),
        });
    }
    let pace = ReplayPace::Times(shown.speed);
    let mut playback = Playback::new(WallClock::start(), recorded, sockets, pace);
    let log = shown.out.join("program.log");
    let process = Process::start(&foreign.command, &env, Some(&log));
    let mut process = process.map_err(ExecError::NotStarted)?;
    let mut ended: Option<(Ended, Instant)> = None;
    let mut stuck = None;
    let until = Instant::ZERO + foreign.wait;
    follow(shown.how, &mut playback, stop, &mut |playback, now| {
        ended = ended.or_else(|| process.ended().map(|how| (how, playback.now())));
        let is_late = playback.waits_for().is_some() && now >= until;
        stuck = playback.trouble();
        ended.is_none() && !is_late && stuck.is_none()
    })?;
    let unopened = playback.unopened().map(Socket::link);
    let connected = match unopened {
        Some(link) => format!("never opened {link}"),
        None => "opened all ports".to_owned(),
    };
    let connected = Check::new("program-connected", unopened.is_none(), connected);
    let is_over = playback.is_over();
    let farewell = process.end(Patience::FAIR);
    let mut checks = vec![
        connected,
        alive(ended, is_over, foreign.may_end, &farewell),
        childless(&farewell.left),
    ];
    checks.extend(stuck.map(|stuck| Check::new("program-reads", false, stuck)));
    Ok(Tried {
        cause: None,
        checks,
        ended,
        heard: Heard::of(&playback),
        links: playback.sockets().iter().map(Socket::played).collect(),
        said: farewell.said,
        notes: Vec::new(),
    })
}

/// Checks on the program that a replay judges.
const JUDGED: [&str; 4] = [
    "program-connected",
    "program-alive",
    "program-yields",
    "no-children-left",
];

fn play_in_virtual_time(
    foreign: &Foreign,
    (passages, recorded): (&[&Passage], &Recorded),
    dir: PortDir,
    shown: &Shown<'_>,
    stop: &Stop,
) -> Result<Tried, CliError> {
    let StandIn {
        run,
        open_ends,
        ear,
    } = StandIn::new(passages, recorded, shown.timing)?;
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
    let (mut turned, mut ended_at) = (Ok(()), None);
    while !trial.is_over() && stop.signal().is_none() && turned.is_ok() {
        turned = trial.turn();
        ended_at = ended_at.or_else(|| trial.ended().map(|how| (how, trial.now())));
        if ear.is_over(trial.now()) {
            break;
        }
    }
    let now = match shown.timing {
        Timing::Clock => trial.now().min(recorded.end),
        Timing::Conversation => trial.now(),
    };
    let ended = trial.end();
    turned?;
    let links = ear.played();
    let said = |played: &Played| {
        if let Some(talk) = &played.talk {
            return talk.said;
        }
        let passage = passages.iter().find(|one| one.link == played.link);
        let arrivals = passage.into_iter().flat_map(|one| &one.arrivals);
        let arrived = arrivals.filter(|one| one.at <= now);
        arrived.map(|one| one.bytes.len() as u64).sum()
    };
    let counts = links.iter().map(|one| {
        let counts = [said(one), one.got.bytes().len() as u64];
        (one.link.clone(), counts)
    });
    let tallies = links
        .iter()
        .filter_map(|one| Some((one.link.clone(), one.talk.as_ref()?.tally)));
    let cause = ended.outcome.probable_cause;
    let checks = ended.outcome.checks.into_iter();
    Ok(Tried {
        cause,
        heard: Heard {
            now,
            counts: counts.collect(),
            divergence: Played::first_divergence(&links),
            tallies: tallies.collect(),
            trace_hash: Some(ended.outcome.trace_hash),
        },
        links,
        ended: ended_at,
        checks: checks
            .filter(|check| {
                let reads = check.name == "program-reads";
                let is_talk = shown.timing == Timing::Conversation;
                JUDGED.contains(&&*check.name) || (reads && is_talk)
            })
            .collect(),
        said: ended.said,
        notes: ended.notes,
    })
}

/// The links to play: the named ones, or all with bytes for the program.
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
