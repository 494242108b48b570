use std::io::{self, Write};

use core::time::Duration;

use clap::Args;
use protocols::Instant;
use serde_json::{Value, json};

use super::{CliError, Verdict, answer, out, progress};
use crate::museum::{self, Bug, Live, Observation, Reproduction, Variant, Wing};
use crate::realtime::clock::{Clock, WallClock};

/// List the defects of the fielded programs, or reproduce one.
///
/// A reproduction runs the defective variant, then the corrected one with the same stimulus, in
/// virtual time. It prints the decisive bytes and figures of both.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig bugs                # ID and symptom of each, by robot and component\n  \
    hilrig bugs AV-02          # reproduce this defect\n  \
    hilrig bugs --all          # reproduce all, one line each\n  \
    hilrig bugs PU-01 --json\n\n\
    Exit code 1: a defect did not occur, or it also occurred in the sound variant.")]
pub(super) struct Bugs {
    /// IDs of defects to reproduce [default: list all]
    #[arg(value_name = "ID")]
    ids: Vec<String>,
    /// Reproduce all reproducible defects, one line each
    #[arg(long, conflicts_with = "ids")]
    all: bool,
}

pub(super) fn run(args: Bugs) -> Result<Verdict, CliError> {
    match print(&args, &mut io::stdout().lock()) {
        Err(Failure::Usage(text)) => Err(CliError::Usage(text)),
        // The reader closed the pipe early, e.g. "head".
        Err(Failure::Output(error)) if error.kind() == io::ErrorKind::BrokenPipe => {
            Ok(Verdict::Pass)
        }
        Err(Failure::Output(error)) => Err(CliError::write("the list", error)),
        Ok(verdict) => Ok(verdict),
    }
}

enum Failure {
    Usage(String),
    Output(io::Error),
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::Output(error)
    }
}

fn print(args: &Bugs, to: &mut dyn Write) -> Result<Verdict, Failure> {
    if args.ids.is_empty() && !args.all {
        if out::is_json() {
            let bugs = museum::catalogue().map(row).collect();
            out::answer(&answer::Bugs { bugs });
            return Ok(Verdict::Pass);
        }
        list(to)?;
        return Ok(Verdict::Pass);
    }
    let wanted = wanted(args)?;
    let mut progress = Progress::new(wanted.len());
    let mut bugs = Vec::new();
    let mut bad = 0;
    for bug in &wanted {
        progress.begun += 1;
        let reproduction = bug.reproduce_telling(|variant| progress.print(bug, variant));
        let Some(reproduction) = reproduction else {
            if args.all && !out::is_json() {
                not_live(bug, to)?;
            }
            continue;
        };
        bad += usize::from(!reproduction.holds());
        if out::is_json() {
            bugs.push(as_json(bug, &reproduction));
        } else if args.all {
            line(bug, &reproduction, to)?;
        } else {
            page(bug, &reproduction, to)?;
        }
    }
    if out::is_json() {
        out::answer(&answer::Bugs { bugs });
    } else if args.all {
        let live = wanted.iter().filter(|bug| is_live(bug)).count();
        let (all, good) = (wanted.len(), live - bad);
        writeln!(
            to,
            "{all} defects, {live} reproducible: {good} occurred, {bad} did not"
        )?;
    }
    Ok(if bad == 0 {
        Verdict::Pass
    } else {
        Verdict::Fail
    })
}

/// Time after which the name of the running exhibit is printed.
const PROGRESS: Duration = Duration::from_secs(2);

/// Prints the name of an exhibit that takes long.
struct Progress {
    clock: WallClock,
    said: Instant,
    begun: usize,
    all: usize,
}

impl Progress {
    fn new(all: usize) -> Self {
        Self {
            clock: WallClock::start(),
            said: Instant::ZERO,
            begun: 0,
            all,
        }
    }

    fn print(&mut self, bug: &Bug, variant: Variant) {
        let now = self.clock.now();
        if now - self.said >= PROGRESS && progress::is_watched() {
            self.said = now;
            let (at, all) = (self.begun, self.all);
            eprintln!("{at} of {all}: {}, {}", bug.id, variant.name());
        }
    }
}

const fn is_live(bug: &Bug) -> bool {
    matches!(bug.live, Live::Exhibit { .. })
}

/// The requested defects; only `--all` skips those without an exhibit.
fn wanted(args: &Bugs) -> Result<Vec<&'static Bug>, Failure> {
    if args.all {
        return Ok(museum::catalogue().collect());
    }
    let one = |id: &String| {
        let bug = museum::find(id).ok_or_else(|| {
            let like = museum::suggestions(id).join(", ");
            let text = format!("unknown defect \"{id}\"; similar ones: {like}");
            Failure::Usage(format!("{text}; see \"hilrig bugs\""))
        })?;
        match bug.live {
            Live::Exhibit { .. } => Ok(bug),
            Live::Not(why) => {
                let text = format!("{} cannot be reproduced: {why}", bug.id);
                Err(Failure::Usage(text))
            }
        }
    };
    args.ids.iter().map(one).collect()
}

fn list(out: &mut dyn Write) -> io::Result<()> {
    for wing in museum::wings() {
        list_wing(wing, out)?;
    }
    let all = museum::catalogue().count();
    let live = museum::catalogue().filter(|bug| is_live(bug)).count();
    writeln!(
        out,
        "{all} defects, {live} reproducible: \"hilrig bugs ID\" reproduces one"
    )
}

/// Prints a robot's defects by location.
fn list_wing(wing: &Wing, out: &mut dyn Write) -> io::Result<()> {
    let mut places: Vec<&str> = Vec::new();
    for bug in wing.bugs() {
        if !places.contains(&bug.place) {
            places.push(bug.place);
        }
    }
    for place in places {
        writeln!(out, "{}: {place}", wing.robot)?;
        for bug in wing.bugs().filter(|bug| bug.place == place) {
            writeln!(out, "  {:<7} {}", bug.id, bug.sees)?;
            if let Live::Not(why) = bug.live {
                writeln!(out, "          not reproducible: {why}")?;
            }
        }
        writeln!(out)?;
    }
    Ok(())
}

fn row(bug: &Bug) -> Value {
    let (by, why_not) = match bug.live {
        Live::Exhibit { by, .. } => (Some(by), None),
        Live::Not(why) => (None, Some(why)),
    };
    json!({
        "id": bug.id, "robot": robot_of(bug), "place": bug.place, "sees": bug.sees, "by": by,
        "why_not": why_not,
    })
}

fn robot_of(bug: &Bug) -> &'static str {
    let mut wings = museum::wings();
    let own = wings.find(|wing| wing.bugs().any(|other| other.id == bug.id));
    own.map_or("", |wing| wing.robot)
}

fn as_json(bug: &Bug, reproduction: &Reproduction) -> Value {
    let side = |observation: &Observation| {
        let wire = observation.wire.iter().map(|exchange| {
            json!({ "from": exchange.from, "bytes": exchange.bytes, "words": exchange.words })
        });
        let figures = observation.figures.iter();
        let figures = figures.map(|figure| (figure.name.to_owned(), Value::from(&*figure.value)));
        json!({
            "wire": wire.collect::<Vec<_>>(),
            "figures": figures.collect::<serde_json::Map<_, _>>(),
            "has_defect": observation.has_defect,
        })
    };
    let mut value = row(bug);
    value["defective"] = side(&reproduction.defective);
    value["sound"] = side(&reproduction.sound);
    value["holds"] = reproduction.holds().into();
    value
}

fn line(bug: &Bug, reproduction: &Reproduction, out: &mut dyn Write) -> io::Result<()> {
    let verdict = if reproduction.holds() { "ok  " } else { "FAIL" };
    let differences = reproduction.differences();
    let shown = differences.first().map_or(String::new(), |difference| {
        let (name, bad, good) = (difference.name, &difference.defective, &difference.sound);
        format!("{name}: {bad} instead of {good}")
    });
    writeln!(out, "{verdict} {:<7} {shown}", bug.id)
}

fn not_live(bug: &Bug, out: &mut dyn Write) -> io::Result<()> {
    let Live::Not(why) = bug.live else {
        return Ok(());
    };
    writeln!(out, "-    {:<7} not reproducible: {why}", bug.id)
}

fn page(bug: &Bug, reproduction: &Reproduction, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "{}, {}, {}: {}",
        bug.id,
        robot_of(bug),
        bug.place,
        bug.sees
    )?;
    let sides = [
        (Variant::Defective, &reproduction.defective, reproduction.by),
        (Variant::Sound, &reproduction.sound, "the same stimulus"),
    ];
    for (variant, observation, by) in sides {
        writeln!(out, "\n{} ({by})", variant.name())?;
        for exchange in &observation.wire {
            writeln!(out, "  {:>6}  {}", exchange.from, exchange.hex())?;
            writeln!(out, "          {}", exchange.words)?;
        }
        for figure in &observation.figures {
            writeln!(out, "  {}: {}", figure.name, figure.value)?;
        }
    }
    writeln!(out, "\ndifference")?;
    for difference in reproduction.differences() {
        let (name, bad, good) = (difference.name, difference.defective, difference.sound);
        writeln!(out, "  {name}: {bad} instead of {good}")?;
    }
    let verdict = match (
        reproduction.defective.has_defect,
        reproduction.sound.has_defect,
    ) {
        (true, false) => "the defect shows, and only in the defective variant",
        (false, _) => "the defect did not show",
        (true, true) => "the sound variant has the defect too",
    };
    writeln!(out, "{verdict}")
}
