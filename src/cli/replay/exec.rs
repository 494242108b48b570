//! A capture played to a foreign program on pseudo-terminals.

use core::time::Duration;
use std::path::Path;

use super::cause::{self, End};
use super::links::own_links;
use super::play::{Shown, Tried, play_to};
use super::{Heard, How, ReplayArgs, kept, report};
use crate::capture::Capture;
use crate::capture::case::{Case, Evidence, Expectation, Judgement, Play, Sound};
use crate::capture::replay::{Eavesdrop, Recorded, Timing, scenario_of};
use crate::cli::exec::{refuse_programs, show_words};
use crate::cli::stop::Stop;
use crate::cli::{CliError, Verdict};
use crate::realtime::exec::{self, Foreign};
use crate::realtime::guest::Trial;
use crate::realtime::process::Ended;
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
    let robot = scenario_of(capture, &args.file)?;
    let own = own_links(robot.as_ref())?;
    let stop = Stop::new(None)?;
    let how = How {
        step: false,
        expect: args.expect,
    };
    let shown = Shown {
        out: &args.out,
        scenario: robot.as_ref().map(|(scenario, _)| scenario),
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
    /// The end of the program, if it ended by itself.
    pub(in crate::cli) ended: Option<Ended>,
    /// The last part of its output.
    pub(in crate::cli) said: String,
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
    foreign.may_end |= case.expect.exits.is_some() || case.expect.may_end;
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
        let (sound, left_out) = case.without_damage(&recorded, source);
        let again = out.join("without-damage");
        let without = play_to(&foreign, &sound, None, &Shown::of_case(case, &again), stop)?;
        judgement.checks.extend(match left_out.is_empty() {
            // The rule was asked for: without damage that is seen, nothing shows that it holds.
            true => vec![Check::new(
                "ignores-damage",
                false,
                "not observed: the capture has no damaged frame of a known protocol; for a \
                 protocol of your own, name a scenario with its description (case from \
                 --scenario), or use prints=, never-prints= or --sound"
                    .to_owned(),
            )],
            false => Case::judge_damage(&tried.links, &without.links, &left_out, late),
        });
    }
    let end = tried.ended.map(|(how, at)| End {
        how,
        at,
        said: &tried.said,
        is_allowed: match case.expect.exits {
            Some(code) => exit_code == Some(code),
            None => !judgement.checks.iter().any(is_unwanted_end),
        },
    });
    let cause = match judgement.passed() {
        true => None,
        false if case.play == Some(Play::Devices) => tried.cause,
        false => cause::of(&tried.links, end.as_ref()).or(tried.cause),
    };
    Ok(CaseTried {
        judgement,
        unjudged,
        cause,
        ended: tried.ended.map(|(how, _)| how),
        said: tried.said,
        notes: tried.notes,
    })
}

fn is_unwanted_end(check: &Check) -> bool {
    check.name == "program-alive" && check.status == Status::Fail
}

/// The program's whole output.
pub(in crate::cli) fn printed(out: &Path) -> String {
    let log = safefs::read(&out.join("program.log")).unwrap_or_default();
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
            play_to(foreign, &recorded, None, &Shown::of_case(case, out), stop)
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
    kept::record(&mut run, Some(scenario), out)?;
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
