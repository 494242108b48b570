use std::path::Path;
use std::sync::Arc;

use clap::Args;
use description::Description;
use description::conform::{Strictness, conform, emulated};
use description::peer::Emulated;

use super::answer::{Conformed, DifferenceTold};
use super::port::PortPeer;
use super::{CliError, Verdict, described, out};
use crate::scenario::{Scenario, Span};

/// Compare a device with its description.
///
/// The command sends requests for everything in the description: each message or register, values
/// at limits and beyond them, damaged frames, unknown addresses. It compares the answers with
/// those of several emulated devices with other seeds: replies, refusals, latencies, periods, and
/// each value. Each difference is printed with its kind, e.g. `byte-order` or `scale`. A port gets
/// no request that changes the device's state, unless --writes is given.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig conform /dev/ttyUSB0 --description meter.toml\n  \
    hilrig conform /dev/ttyUSB0 --description meter.toml --writes   # moves motors, sets relays\n  \
    hilrig conform bench.toml --description meter.toml --link meter # the device of a scenario\n  \
    hilrig conform --description meter.toml                         # its own emulation\n\n\
    Exit codes: 0 no difference, 1 differences, 2 usage or set-up.")]
pub(super) struct ConformArgs {
    /// Serial port of the device, or a scenario with it [default: emulate the description]
    #[arg(value_name = "PORT|SCENARIO")]
    device: Option<String>,
    /// Description: one that comes with the tool, by its name, or a file that ends with .toml
    #[arg(long, value_name = "NAME|FILE")]
    description: String,
    /// Address of the device, if it is not the described one
    #[arg(long, value_name = "N")]
    address: Option<u32>,
    /// The scenario's device [default: the only one]
    #[arg(long, value_name = "NAME")]
    link: Option<String>,
    /// Also send requests that change the device's state
    #[arg(long)]
    writes: bool,
    /// Allowed difference of a latency at a port, in addition to a fifth
    #[arg(long, value_name = "TIME", default_value = "20ms")]
    slack: Span,
    /// Seed of an emulated device
    #[arg(long, value_name = "N", default_value_t = 4711)]
    seed: u64,
}

pub(super) fn run(args: &ConformArgs) -> Result<Verdict, CliError> {
    let description = described::load_at(&args.description, args.address)?;
    let found = match &args.device {
        None => {
            let mut peer = emulated(&description, args.seed);
            conform(&description, &mut peer, Strictness::EMULATED)
        }
        Some(path) if path.ends_with(".toml") => {
            let mut peer = of_scenario(args, Path::new(path))?;
            conform(&description, &mut peer, Strictness::EMULATED)
        }
        Some(path) => of_port(args, &description, Path::new(path))?,
    };
    let found = found.map_err(CliError::Usage)?;
    for difference in &found.differences {
        println!("{difference}");
    }
    let times = found.latency.map_or_else(String::new, |[median, high]| {
        let [median, high] = [median, high].map(|time| time.as_secs_f64() * 1e3);
        format!(", latency {median:.1} ms (median), {high:.1} ms (99th percentile)")
    });
    let (requests, replies) = (found.requests, found.replies);
    eprintln!("{requests} requests, {replies} replies{times}");
    if found.left_out > 0 {
        let count = found.left_out;
        eprintln!("{count} requests were not sent: they change the device's state (--writes)");
    }
    for place in &found.unproved {
        eprintln!("{place}: not compared, the emulated device does not answer it either");
    }
    for part in &found.unseen {
        eprintln!("not compared: {part}");
    }
    // Without a comparison the device was not observed.
    let is_void = found.is_void();
    let is_silent = replies == 0 && requests > 0 && !found.heard_by_itself;
    match (found.differences.len(), is_void) {
        (_, true) if is_silent => println!("nothing was compared: the device never answered"),
        (_, true) if requests == 0 => println!("nothing was compared: no request was sent"),
        (_, true) => println!("nothing was compared: none of the described replies arrived"),
        (0, _) => println!("no difference"),
        (1, _) => println!("1 difference"),
        (count, _) => println!("{count} differences"),
    }
    let passes = found.differences.is_empty() && !is_void;
    out::answer(&Conformed {
        requests: found.requests as u64,
        replies: found.replies as u64,
        latency_ms: found
            .latency
            .map(|times| times.map(|time| time.as_secs_f64() * 1e3).to_vec()),
        left_out: found.left_out as u64,
        not_compared: [found.unproved, found.unseen].concat(),
        differences: found
            .differences
            .into_iter()
            .map(|one| DifferenceTold {
                kind: one.kind.name().to_owned(),
                place: one.place,
                expected: one.expected,
                found: one.found,
            })
            .collect(),
    });
    Ok(if passes { Verdict::Pass } else { Verdict::Fail })
}

type Found = Result<description::conform::Conformity, String>;

fn of_port(
    args: &ConformArgs,
    description: &Arc<Description>,
    path: &Path,
) -> Result<Found, CliError> {
    let mut peer = PortPeer::open(path, description.line())?;
    let strictness = Strictness {
        writes: args.writes,
        slack: args.slack.0,
    };
    Ok(conform(description, &mut peer, strictness))
}

/// The device of a scenario, in virtual time and without the scenario's faults.
fn of_scenario(args: &ConformArgs, path: &Path) -> Result<Emulated, CliError> {
    let (scenario, source) = Scenario::read(path)?;
    let name = described::device_name(&scenario, args.link.as_deref())?;
    described::emulated((&scenario, &source), &name, args.seed)
}
