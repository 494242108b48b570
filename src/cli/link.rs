use core::time::Duration;
use std::path::{Path, PathBuf};

use clap::Args;
use protocols::Instant;

use super::answer::{LinePassed, LinkEnded};
use super::place::NamedPort;
use super::ports::{LineOfPair, Ports, in_words};
use super::stop::Stop;
use super::{CliError, Verdict, out};
use crate::TOOL;
use crate::capture::{Limits, Recording, Section};
use crate::realtime::bridge::Bridge;
use crate::realtime::clock::{Clock, WallClock, utc};
use crate::realtime::{PortReport, Realtime};
use crate::rig::Paced as _;
use crate::scenario::{DirectionSpec, FaultKind, FaultPlace, FaultSpec, Span};

/// Connect two serial ports and inject faults between them; no device is emulated.
///
/// Bytes pass in both directions at the line's rate; a capture holds sent and received bytes. A
/// port is a path, or `pty:PATH` for a new pseudo-terminal at PATH. Ports are given in pairs; a
/// link has the name of its first port. A fault is its kind, then its keys as in a scenario.
/// `to=PORT` sets the direction; without it, the fault acts on both directions of every link.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig link gps=/dev/ttyUSB0 robot=/dev/ttyUSB1 --fault flip,rate=0.001 -o link.pcapng\n  \
    hilrig link gps=/dev/ttyUSB0 robot=pty:/tmp/gps --baud 9600 \\\n    \
    --fault drop,to=robot,rate=0.01 --fault cut,to=gps,from=10s,lasting=2s --seed 7\n  \
    hilrig link a=pty:/tmp/a b=pty:/tmp/b --fault insert,byte=100,value=0,to=b\n\n\
    Kinds of faults, and their keys: docs/faults.md. It ends at Ctrl-C.")]
pub(super) struct LinkArgs {
    /// The ports, in pairs: each pair is the two ends of a line
    #[arg(required = true, num_args = 2.., value_names = ["A=PORT", "B=PORT"])]
    ports: Vec<NamedPort>,
    /// Fault to inject: KIND,KEY=VALUE,..; may be repeated
    #[arg(long = "fault", value_name = "FAULT")]
    faults: Vec<String>,
    /// Baud rate of the lines [default: the rate to which the first port of a pair is set, else the
    /// second; 115200 if no port exists yet]
    #[arg(long, value_name = "N",
        value_parser = clap::value_parser!(u32).range(50..=12_000_000))]
    baud: Option<u32>,
    /// Time from the last bit of a byte to its arrival at the receiver
    #[arg(long, value_name = "TIME", default_value = "0s")]
    latency: Span,
    /// Seed of the faults' random numbers
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Capture to write; an existing file is not overwritten
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// End after this time, e.g. 60s or 5min [default: at SIGINT or SIGTERM]
    #[arg(long, value_name = "TIME")]
    duration: Option<Span>,
}

pub(super) fn run(args: &LinkArgs) -> Result<Verdict, CliError> {
    check_names(&args.ports)?;
    if let Some(file) = args.out.as_ref().filter(|file| file.is_file()) {
        let file = file.display();
        return Err(CliError::Usage(format!(
            "--out {file}: there is a file already, expected a free name: move it away or choose \
             another"
        )));
    }
    let mut bridge = Bridge::new(args.seed);
    let mut ends = Vec::new();
    // Held until the ports are open, so that closing them resets no device.
    let mut lines = Vec::new();
    for pair in args.ports.chunks_exact(2) {
        let names = [&*pair[0].name, &*pair[1].name];
        let of_pair = LineOfPair::of(pair, args.baud);
        ends.extend(bridge.connect(names, of_pair.line, args.latency.0));
        lines.push(of_pair);
    }
    for text in &args.faults {
        for fault in faults(text, &args.ports)? {
            let wrong = |flaw| CliError::Usage(format!("--fault {text}: {flaw}"));
            bridge.add_fault(&fault).map_err(wrong)?;
            if let Some(warning) = without_effect(&fault, &args.ports, &lines) {
                eprintln!("warning: --fault {text}: {warning}");
            }
        }
    }
    let stop = Stop::new(args.duration.map(|duration| duration.0))?;
    let mut ports = Ports::default();
    let mut opened = Vec::new();
    for (pair, of_pair) in args.ports.chunks_exact(2).zip(&lines) {
        for place in pair {
            opened.push(ports.open(&place.name, &place.path, of_pair.line)?);
        }
        let ([a, b], [.., one, other]) = (pair, &opened[..]) else {
            break;
        };
        let [one, other] = [one, other].map(|port| port.path().display());
        let (a, b) = (&a.name, &b.name);
        let (words, origin) = (in_words(of_pair.line), &of_pair.origin);
        eprintln!("{a}: {one} <-> {b}: {other}, {words}, {origin}");
    }
    drop(lines);
    if let Some(file) = &args.out {
        record(&mut bridge, args, file)?;
        eprintln!("recording to {}", file.display());
    }
    let mut realtime = Realtime::new(WallClock::start());
    for (end, port) in ends.into_iter().zip(opened) {
        realtime.serve(end, port);
    }
    eprintln!(
        "seed {}, {} faults: until Ctrl-C",
        args.seed,
        args.faults.len()
    );
    let mut turned = Ok(());
    while turned.is_ok() && !stop.is_due(realtime.clock().now()) {
        turned = realtime.turn(&mut bridge);
        if let Some(trouble) = bridge.rig().take_tap_trouble() {
            eprintln!("warning: {trouble}");
        }
    }
    let ran = realtime.clock().now() - Instant::ZERO;
    let reports: Vec<PortReport> = realtime.reports().collect();
    let recorded = bridge.rig().finish_taps();
    report(args, ran, &bridge, &reports);
    turned?;
    match (recorded, &args.out) {
        (Err(error), Some(file)) => {
            Err(CliError::write(format!("--out {}", file.display()), error))
        }
        _ => Ok(Verdict::Pass),
    }
}

fn check_names(ports: &[NamedPort]) -> Result<(), CliError> {
    if let [.., last] = ports
        && ports.len() % 2 == 1
    {
        let (name, path) = (&last.name, last.path.display());
        let text = format!("{name}={path}: one port is left over, expected pairs of ports");
        return Err(CliError::Usage(text));
    }
    for (index, place) in ports.iter().enumerate() {
        if ports[..index].iter().any(|other| other.name == place.name) {
            let text = format!("{}: given twice, expected each port once", place.name);
            return Err(CliError::Usage(text));
        }
    }
    Ok(())
}

/// The reason why a fault changes nothing on its line.
fn without_effect(fault: &FaultSpec, ports: &[NamedPort], lines: &[LineOfPair]) -> Option<String> {
    let mut pairs = ports.chunks_exact(2).zip(lines);
    let is_its = |pair: &[NamedPort]| fault.link.as_deref() == Some(&*pair[0].name);
    let (_, line) = pairs.find(|(pair, _)| is_its(pair))?;
    fault.is_at_rate(line.line.baud).then(|| {
        let baud = line.line.baud;
        format!("baud: is {baud}, the rate of the line, so it changes nothing")
    })
}

/// The faults of `text`, one for each line on which they act.
fn faults(text: &str, ports: &[NamedPort]) -> Result<Vec<FaultSpec>, CliError> {
    let wrong = |what: String| CliError::Usage(format!("--fault {text}: {what}"));
    let mut words = text.split([',', ' ']).filter(|word| !word.is_empty());
    let kind = words.next().map(|kind| match kind.contains('=') {
        true => kind.to_owned(),
        false => format!("kind={kind}"),
    });
    let keys: Vec<String> = kind.into_iter().chain(words.map(str::to_owned)).collect();
    let mut keys = super::fault::fault(&keys).map_err(|error| wrong(error.to_string()))?;
    let to = keys.remove("to");
    let fault = FaultSpec::of_json(&keys).map_err(|flaws| {
        let each = flaws
            .iter()
            .map(|(key, message)| format!("{key}: {message}"));
        wrong(each.collect::<Vec<_>>().join("; "))
    })?;
    if fault.kind.place() != FaultPlace::Line {
        let kind = fault.kind.name();
        let what = format!("{kind} is a fault of a device, expected a fault of a line");
        return Err(wrong(what));
    }
    let to = to.as_ref().map(|to| to.as_str().unwrap_or_default());
    if fault.kind == FaultKind::Swizzle && to.is_none() {
        return Err(wrong("to is missing: swizzle needs it".to_owned()));
    }
    let is_meant = |name: &str| to.is_none_or(|to| to == name);
    if !ports.iter().any(|port| is_meant(&port.name)) {
        let names: Vec<&str> = ports.iter().map(|port| port.name.as_str()).collect();
        return Err(wrong(format!("to: expected one of {}", names.join(", "))));
    }
    let lines = ports.chunks_exact(2).flat_map(|pair| {
        let link = pair[0].name.as_str();
        let ways = [DirectionSpec::ToDevice, DirectionSpec::ToMaster];
        let ways = pair
            .iter()
            .zip(ways)
            .map(move |(port, way)| (port, link, way));
        ways.filter(|(port, ..)| is_meant(&port.name))
    });
    let on_line = |(_, link, way): (_, &str, _)| FaultSpec {
        link: Some(fault.link.clone().unwrap_or(link.to_owned())),
        direction: Some(fault.direction.unwrap_or(way)),
        ..fault.clone()
    };
    Ok(lines.map(on_line).collect())
}

fn record(bridge: &mut Bridge, args: &LinkArgs, file: &Path) -> Result<(), CliError> {
    let mut about = format!(
        "seed={}\nclock=utc\nstart_ns={}",
        args.seed,
        utc().as_nanos()
    );
    for pair in args.ports.chunks_exact(2) {
        let [one, other] = [&pair[0], &pair[1]].map(|port| port.path.display());
        about += &format!("\nlink={} {one} {other}", pair[0].name);
    }
    for fault in &args.faults {
        about += &format!("\nfault={fault}");
    }
    let section = Section {
        tool: format!("{TOOL} {}", env!("CARGO_PKG_VERSION")),
        about,
        scenario: String::new(),
    };
    let recording = Recording::create(file, bridge.rig(), section, Limits::default());
    let what = || format!("--out {}", file.display());
    let recording = recording.map_err(|error| CliError::write(what(), error))?;
    bridge.rig().add_tap(Box::new(recording));
    Ok(())
}

fn report(args: &LinkArgs, ran: Duration, bridge: &Bridge, reports: &[PortReport]) {
    let line = |([from, to], traffic): ([&str; 2], crate::rig::line::Traffic)| {
        let lost = reports.iter().find(|report| report.name == to);
        let lost = lost.map(|report| report.lost).unwrap_or_default();
        LinePassed {
            from: from.to_owned(),
            to: to.to_owned(),
            bytes_sent: traffic.sent,
            bytes_arrived: traffic.delivered,
            bytes_lost: traffic.lost,
            bytes_added: traffic.added,
            framing_errors: traffic.framing_errors,
            bytes_unheard: lost.unheard,
            bytes_overrun: lost.overrun,
        }
    };
    let ended = LinkEnded {
        file: args.out.as_ref().map(|file| file.display().to_string()),
        seed: args.seed,
        ran_s: ran.as_secs_f64(),
        lines: bridge.lines().map(line).collect(),
    };
    println!("linked for {:.1} s, seed {}", ended.ran_s, ended.seed);
    for line in &ended.lines {
        print!(
            "  {} -> {}: {} B sent, {} B arrived",
            line.from, line.to, line.bytes_sent, line.bytes_arrived
        );
        let more = [
            (line.bytes_lost, "B lost"),
            (line.bytes_added, "B added"),
            (line.framing_errors, "framing errors"),
            (line.bytes_unheard, "B while the port was closed"),
            (line.bytes_overrun, "B that were not read in time"),
        ];
        for (count, what) in more.into_iter().filter(|(count, _)| *count > 0) {
            print!(", {count} {what}");
        }
        println!();
    }
    if let Some(file) = &ended.file {
        println!("  capture: {file}");
    }
    out::answer(&ended);
}
