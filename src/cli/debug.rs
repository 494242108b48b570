//! `hilrig debug`: a program in virtual time under GDB.

use std::path::PathBuf;

use clap::Args;
use clap::builder::Resettable;
use protocols::Instant;

use super::answer::Runs;
use super::ends::EndArgs;
use super::exec::{ExecArgs, refuse_programs};
use super::run::{Beginning, Runnable, make_folder, ports_in, report, warn, warn_of_pieces};
use super::stop::{SIGTERM, Stop, name_of};
use super::{CliError, Verdict, default_out, out};
use crate::realtime::clock::{Clock as _, WallClock};
use crate::realtime::guest::{DebugSettings, Debugged, Surroundings, debug};
use crate::run::check::Check;
use crate::scenario::Span;

/// Debug your program with GDB while time stands.
///
/// The program runs in virtual time on the ports of a scenario or of a saved case. While GDB holds
/// it, no time passes: no watchdog fires and no byte is lost. After "continue" the run gives the
/// same bytes as without a debugger. "monitor help" in GDB lists the commands of the rig. After
/// "detach" the run continues to its end and is judged.
#[derive(Debug, Args)]
#[command(
    after_long_help = "Examples:\n  hilrig debug rescue.toml --exec './robot \"$HILRIG_DIR\"'\n  \
    gdb ./robot -ex 'target remote :3333'          # in another terminal\n  \
    hilrig debug bench.toml --exec ./driver --at 12.3s\n  \
    hilrig debug case.toml --exec ./driver --on-fail
  \
    hilrig debug bench.toml --exec 'sh start.sh' --program driver --port 4444"
)]
// Virtual time is implied here, so its options need no --virtual.
#[command(
    mut_arg("call_cost", |it| it.requires(Resettable::Reset)),
    mut_arg("spin_max", |it| it.requires(Resettable::Reset)),
    mut_arg("schedule", |it| it.requires(Resettable::Reset)),
    mut_arg("cpu", |it| it.requires(Resettable::Reset))
)]
pub(super) struct DebugArgs {
    /// Scenario file, or a saved case of a run
    #[arg(value_name = "SCENARIO")]
    scenario: PathBuf,
    /// Seed instead of the scenario's own
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    /// Port on this machine where GDB connects; 0: a free one
    #[arg(long, value_name = "PORT", default_value_t = 3333)]
    port: u16,
    /// Time of the rig at which the program first stands [default: at its start]
    #[arg(long, value_name = "TIME")]
    at: Option<Span>,
    /// Run once at full speed, then again to the place before the first check that fails
    #[arg(long, conflicts_with = "at")]
    on_fail: bool,
    /// Name of the file of the program to debug, if the command starts several [default: the first
    /// that uses a port]
    #[arg(long, value_name = "NAME")]
    program: Option<String>,
    #[command(flatten)]
    exec: ExecArgs,
    /// Folder for the results [default: hilrig-out/NAME-SEED]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Directory in which the ports appear [default: OUT/ports]
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
    #[command(flatten)]
    ends: EndArgs,
}

pub(super) fn run(args: DebugArgs) -> Result<Verdict, CliError> {
    let usage = |text: String| CliError::Usage(text);
    let Some(foreign) = args.exec.foreign_in_virtual_time() else {
        return Err(usage(
            "--exec: is missing; expected the command that starts your program".to_owned(),
        ));
    };
    if args.ends.is_given() {
        let text = "--dut-at, --device-at: a real port keeps real time; expected none with debug";
        return Err(usage(text.to_owned()));
    }
    let (mut scenario, source) = match Runnable::read(&args.scenario)? {
        Runnable::Scenario(file) => *file,
        Runnable::Case(_) => {
            let path = args.scenario.display();
            let text = "is a case of bytes; expected a scenario, or the case.toml of a run";
            return Err(usage(format!("{path}: {text}")));
        }
    };
    refuse_programs("debug", &args.scenario, &scenario)?;
    scenario.seed = args.seed.unwrap_or(scenario.seed);
    warn(&scenario, &source, args.exec.cpu());
    warn_of_pieces(&scenario, &source);
    let stop = Stop::new(None)?;
    let folder = args.out.clone();
    let folder = folder.unwrap_or_else(|| default_out(&scenario.name, scenario.seed));
    make_folder(&folder)?;
    let ports = ports_in(&folder, args.dir.as_deref())?;
    let clock = WallClock::start();
    let (mut trouble, mut is_first) = (None, true);
    let mut start = || {
        let beginning = Beginning {
            foreign: &foreign,
            trace: None,
            ends: &args.ends,
            ports: &ports,
            out: &folder,
            is_first: core::mem::replace(&mut is_first, false),
        };
        let begun = beginning.begin(&scenario, &source);
        begun.map_err(|error| trouble = Some(error)).ok()
    };
    let settings = DebugSettings {
        port: args.port,
        program: args.program.clone(),
        at: args.at.map(|at| at.0),
        on_fail: args.on_fail,
    };
    let surroundings = Surroundings {
        start: &mut start,
        goes_on: &|| stop.signal().is_none(),
        say: &|text| eprintln!("{text}"),
    };
    let debugged = match debug(settings, surroundings) {
        Ok(debugged) => debugged,
        Err(error) => return Err(trouble.unwrap_or_else(|| error.into())),
    };
    let was_killed = matches!(debugged, Debugged::Killed(_));
    let (mut played, cut_by) = match debugged {
        Debugged::Judged(played) => (played, None),
        Debugged::Killed(played) => (played, Some("the debugger")),
        Debugged::Cut(played) => (played, Some(stop.signal().map_or("SIGINT", name_of))),
        Debugged::NotReached(why) => return Err(usage(why)),
        Debugged::NotStarted => return Err(trouble.unwrap_or_else(|| usage(String::new()))),
    };
    if let Some(by) = cut_by {
        let (ran, all) = (played.outcome.ran.as_secs_f64(), scenario.duration);
        let detail = format!("ended by {by} at {ran:.6} s, expected to run for {all}");
        let check = Check::new("ran-to-its-end", false, detail);
        played.outcome.checks.push(check);
    }
    let wall = clock.now() - Instant::ZERO;
    let ran = report(*played, wall, &foreign.command, &folder, &stop)?;
    let mut answers = Runs::default();
    answers.runs.push(ran.answer(&folder, None));
    out::answer(&answers);
    Ok(match was_killed {
        true => Verdict::Interrupted(SIGTERM),
        false => ran.verdict(),
    })
}
