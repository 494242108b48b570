use core::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use protocols::LineConfig;

use super::answer::UiEnded;
use super::stop::Stop;
use super::{CliError, Verdict, out};
use crate::realtime::clock::{Clock, WallClock};
use crate::robots;
use crate::scenario::Span;
use ::ui::{Hub, Remote, SPEED_MAX, Server, Session};

/// Show a run on a page in the browser: view, control, disturb and save it.
///
/// The printed address shows the page; it is open to this machine only unless --listen is given.
/// The address contains a token: requests without it are rejected. Manual actions become part of
/// the scenario: `/case.toml` of the page, or --save, repeats them all.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig ui scenarios/rescue-flat.toml\n  \
    hilrig ui scenarios/rescue-flat.toml --port 8080 --speed 4 --save my-case.toml\n  \
    hilrig ui scenarios/rescue-flat.toml --paused\n  \
    hilrig ui --pc /dev/rfcomm0            # the PC program alone, against a real robot\n  \
    hilrig ui --pc /tmp/robot/pc           # .. or against a rig of \"hilrig up --pc\"\n  \
    hilrig ui --pc /dev/ttyUSB0 --robot yellow")]
pub(super) struct Ui {
    /// Scenario file
    #[arg(value_name = "SCENARIO", required_unless_present = "pc")]
    scenario: Option<PathBuf>,
    /// No rig: run the PC program on this port, connected to any robot there
    #[arg(long, value_name = "PORT", conflicts_with_all = ["scenario", "speed", "seed", "save", "paused"])]
    pc: Option<PathBuf>,
    /// Robot whose PC program is used [default: the first robot that has one]
    #[arg(long, value_name = "NAME", requires = "pc")]
    robot: Option<String>,
    /// Baud rate of that port
    #[arg(long, value_name = "N", requires = "pc")]
    baud: Option<core::num::NonZeroU32>,
    /// Virtual seconds per second, up to 100
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = speed)]
    speed: f64,
    /// Start paused
    #[arg(long)]
    paused: bool,
    /// Seed instead of the scenario's own
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    #[command(flatten)]
    place: ListenArgs,
    /// End after this time, e.g. 60s or 5min [default: at SIGINT or SIGTERM]
    #[arg(long, value_name = "TIME")]
    duration: Option<Span>,
    /// At the end, write the run as a scenario
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
}

/// The address of the page.
#[derive(Clone, Copy, Debug, Args)]
pub(super) struct ListenArgs {
    /// TCP port of the page, 0 for any free one
    #[arg(long, value_name = "N", default_value_t = 0)]
    port: u16,
    /// Address of the page; with any address except this machine's own, others can control the run
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    listen: IpAddr,
}

impl ListenArgs {
    /// A page on this port, for this machine only.
    pub(super) const fn local(port: u16) -> Self {
        Self {
            port,
            listen: IpAddr::V4(Ipv4Addr::LOCALHOST),
        }
    }

    /// Starts the server of `flag` and prints its address.
    pub(super) fn serve(self, flag: &str, hub: Arc<Hub>) -> Result<Server, CliError> {
        let wanted = SocketAddr::new(self.listen, self.port);
        let server = Server::start(wanted, hub).map_err(|error| {
            CliError::Usage(format!(
                "{flag} {}: {wanted}: {error}; expected an address that is free",
                self.port
            ))
        })?;
        println!("page at {}", server.url());
        Ok(server)
    }
}

fn speed(text: &str) -> Result<f64, String> {
    let expected = || format!("expected a number above 0, up to {SPEED_MAX}");
    let speed: f64 = text.parse().map_err(|_| expected())?;
    (speed > 0.0 && speed <= SPEED_MAX)
        .then_some(speed)
        .ok_or_else(expected)
}

pub(super) fn run(args: Ui) -> Result<Verdict, CliError> {
    let stop = Stop::new(args.duration.map(|duration| duration.0))?;
    match (&args.pc, &args.scenario) {
        (Some(_), _) => run_remote(&args, &stop),
        (None, Some(_)) => run_rig(&args, &stop),
        (None, None) => Err(CliError::Usage("expected SCENARIO or --pc PORT".to_owned())),
    }?;
    Ok(Verdict::Pass)
}

fn run_rig(args: &Ui, stop: &Stop) -> Result<(), CliError> {
    let path = args.scenario.as_ref().expect("was asked for");
    let (mut scenario, source) = super::exec::read_without_programs("ui", path)?;
    scenario.seed = args.seed.unwrap_or(scenario.seed);
    let hub = Hub::new();
    let clock = WallClock::start();
    let mut session = Session::new(scenario, source, Arc::clone(&hub), clock, args.speed)?;
    if args.paused {
        session.pause();
    }
    let _server = args.place.serve("--port", hub)?;
    while !stop.is_due(session.clock().now()) {
        session.turn();
    }
    let run = session.run();
    if let Some(path) = &args.save {
        let case = run.case_so_far().to_toml();
        let written = safefs::write(path, case);
        written.map_err(|error| CliError::write(format!("--save {}", path.display()), error))?;
    }
    let (now, trace_hash) = (run.rig.now(), run.rig.trace_hash());
    println!("ran {now} s, trace {trace_hash}");
    out::answer(&UiEnded {
        ran_s: Some((now - protocols::Instant::ZERO).as_secs_f64()),
        trace_hash: Some(trace_hash),
    });
    Ok(())
}

/// The PC program of the robot called `name`, or of the first robot that has one.
fn remote_station(
    name: Option<&str>,
) -> Result<(Box<dyn robots::RemoteStation>, LineConfig), CliError> {
    let all = robots::all();
    let mut wanted = all
        .iter()
        .filter(|robot| name.is_none_or(|name| robot.name() == name));
    wanted.find_map(|robot| robot.remote()).ok_or_else(|| {
        let with = all.iter().filter(|robot| robot.remote().is_some());
        let known = with
            .map(|robot| robot.name())
            .collect::<Vec<_>>()
            .join(", ");
        let name = name.unwrap_or_default();
        CliError::Usage(format!("--robot {name}: expected one of {known}"))
    })
}

fn run_remote(args: &Ui, stop: &Stop) -> Result<(), CliError> {
    let path = args.pc.as_ref().expect("was asked for");
    let (station, air) = remote_station(args.robot.as_deref())?;
    let line = LineConfig {
        baud: args.baud.map_or(air.baud, core::num::NonZeroU32::get),
        ..air
    };
    let hub = Hub::new();
    let clock = WallClock::start();
    let mut remote = Remote::new(station, path, line, Arc::clone(&hub));
    let _server = args.place.serve("--port", hub)?;
    loop {
        let now = clock.now();
        if stop.is_due(now) {
            break;
        }
        remote.turn(now);
        clock.sleep_until(now + core::time::Duration::from_millis(5));
    }
    println!("{} B heard", remote.view(clock.now()).bytes);
    let (ran_s, trace_hash) = (None, None);
    out::answer(&UiEnded { ran_s, trace_hash });
    Ok(())
}
