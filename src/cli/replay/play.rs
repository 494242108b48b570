//! A capture played to a program on new ports.

use std::path::Path;

use protocols::Instant;

use super::{Heard, How, follow, kept};
use crate::capture::case::Case;
use crate::capture::replay::{Passage, Played, Recorded, StandIn, Timing};
use crate::cli::CliError;
use crate::cli::stop::Stop;
use crate::realtime::clock::WallClock;
use crate::realtime::exec::{
    ExecError, Foreign, PORTS_VARIABLE, Seat, alive, childless, port_variable,
};
use crate::realtime::guest::Trial;
use crate::realtime::playback::{Playback, ReplayPace, Side as PlayedSide, Socket};
use crate::realtime::process::{Ended, Patience, Process};
use crate::realtime::transport::{PortDir, Pty};
use crate::run::check::Check;
use crate::scenario::Scenario;
use safefs::Dir;

/// Place and mode of a replay.
pub(super) struct Shown<'a> {
    /// Folder for ports, program.log and the capture.
    pub(super) out: &'a Path,
    /// Scenario in the capture.
    pub(super) scenario: Option<&'a Scenario>,
    pub(super) speed: f64,
    pub(super) how: How,
    pub(super) timing: Timing,
}

impl<'a> Shown<'a> {
    /// The mode for cases.
    pub(super) const fn of_case(case: &'a Case, out: &'a Path) -> Self {
        let (step, expect) = (false, true);
        Self {
            out,
            scenario: case.scenario.as_ref(),
            speed: 1.0,
            how: How { step, expect },
            timing: Timing::Conversation,
        }
    }
}

/// The result of a replay.
pub(super) struct Tried {
    pub(super) heard: Heard,
    pub(super) links: Vec<Played>,
    /// The probable cause of a failure, from the devices' view.
    pub(super) cause: Option<String>,
    /// Verdicts on the program itself.
    pub(super) checks: Vec<Check>,
    /// The end of the program and its time, if it ended by itself.
    pub(super) ended: Option<(Ended, Instant)>,
    pub(super) said: String,
    /// Calls outside virtual time.
    pub(super) notes: Vec<String>,
}

/// Starts the program on the links `own`, or on all links with bytes for it, and plays to it.
pub(super) fn play_to(
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
    // The loop above ends with the program.
    let over = ended.filter(|_| playback.is_over()).map(|(_, at)| at);
    let farewell = process.end(Patience::FAIR);
    let last = farewell.ends.first().copied().flatten();
    let baud = |name: &str| {
        let passage = passages.iter().find(|one| one.link == name);
        passage.map_or(0, |one| one.line().baud)
    };
    kept::write(playback.sockets(), baud, shown.scenario, shown.out)?;
    let mut checks = vec![
        connected,
        alive(ended, over, foreign.may_end, &farewell, last),
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
        mut run,
        open_ends,
        ear,
    } = StandIn::new(passages, recorded, shown.timing)?;
    kept::record(&mut run, shown.scenario, shown.out)?;
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
