use std::path::{Path, PathBuf};

use clap::Args;
use protocols::Instant;

use super::answer::{LinkRecorded, RecordEnded};
use super::place::NamedPort;
use super::ports::{LineOfPair, Ports, in_words};
use super::stop::Stop;
use super::{CliError, Verdict, out};
use crate::realtime::clock::{Clock, WallClock, utc};
use crate::realtime::tap::{CaptureFile, Passed, RecordError, Recorder, Wire};
use crate::scenario::Span;

/// Record the bytes between two ports as a capture, and forward them in both directions.
///
/// The first port of a tap is the device's, the second the program's; the link gets the name of
/// the first. A port is a path, or `pty:PATH` for a new pseudo-terminal at PATH. The capture is
/// pcapng with UTC times, which Wireshark opens; `hilrig decode` counts from the first record.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig record --tap lidar=/dev/ttyUSB0 robot=/dev/ttyUSB1 -o field.pcapng\n  \
    hilrig record --tap lidar=/dev/ttyUSB0 robot=pty:/tmp/robot/lidar -o field.pcapng\n  \
    hilrig record --tap lidar=/dev/ttyUSB0 x=pty:/tmp/robot/lidar \\\n    \
    --tap base=/dev/ttyUSB1 x=pty:/tmp/robot/base --baud base=1000000 -o field.pcapng\n\n\
    The rate and the character format of each link are printed, with their origin.")]
pub(super) struct RecordArgs {
    /// Two connected ports; once for each link
    #[arg(long, required = true, num_args = 2, value_names = ["A=PORT", "B=PORT"])]
    tap: Vec<NamedPort>,
    /// Baud rate, of all links or of the named one [default: the rate to which the device's port is
    /// set, else the program's; 115200 if no port exists yet]
    #[arg(long, value_name = "[A=]N")]
    baud: Vec<Baud>,
    /// Capture to write; an existing file is not overwritten
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    /// End after this time, e.g. 60s or 5min [default: at SIGINT or SIGTERM]
    #[arg(long, value_name = "TIME")]
    duration: Option<Span>,
}

/// A rate, of one link or of all.
#[derive(Clone, Debug)]
struct Baud {
    link: Option<String>,
    rate: u32,
}

impl core::str::FromStr for Baud {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (link, rate) = match text.split_once('=') {
            Some((link, rate)) => (Some(link.to_owned()), rate),
            None => (None, text),
        };
        let rate = rate
            .parse()
            .ok()
            .filter(|rate| (50..=12_000_000).contains(rate));
        let rate = rate.ok_or("expected bits per second, e.g. 115200 or base=1000000")?;
        Ok(Self { link, rate })
    }
}

pub(super) fn run(args: RecordArgs) -> Result<Verdict, CliError> {
    // Only plain files can be overwritten, not pipes and devices.
    if args.out.is_file() {
        let out = args.out.display();
        let error = format!(
            "--out {out}: there is a file already, expected a free name: move it away or choose \
             another"
        );
        return Err(CliError::Usage(error));
    }
    let stop = Stop::new(args.duration.map(|duration| duration.0))?;
    let mut ports = Ports::default();
    let wires = wires(&args, &mut ports)?;
    let file = CaptureFile::create(&args.out).map_err(failed)?;
    let (clock, epoch) = (WallClock::start(), utc());
    let mut recorder = Recorder::new(clock, epoch, wires, file).map_err(failed)?;
    eprintln!("recording to {}", args.out.display());
    let mut ended = Ok(());
    while ended.is_ok() && !stop.is_due(recorder.clock().now()) {
        ended = recorder.turn();
        let notes = recorder.take_notes();
        notes.iter().for_each(|note| eprintln!("{note}"));
    }
    let ended = ended.and_then(|()| Ok(recorder.finish()?));
    report(&recorder, &args.out);
    ended.map(|()| Verdict::Pass).map_err(failed)
}

fn failed(error: impl Into<RecordError>) -> CliError {
    CliError::Record(error.into())
}

fn wires(args: &RecordArgs, ports: &mut Ports) -> Result<Vec<Wire>, CliError> {
    let names: Vec<&str> = args
        .tap
        .iter()
        .step_by(2)
        .map(|place| &*place.name)
        .collect();
    for (index, name) in names.iter().enumerate() {
        if names[..index].contains(name) {
            let error = format!("--tap {name}: given twice, expected each link once");
            return Err(CliError::Usage(error));
        }
    }
    if let Some(link) = args
        .baud
        .iter()
        .filter_map(|baud| baud.link.as_deref())
        .find(|link| !names.contains(link))
    {
        let known = names.join(", ");
        let error = format!("--baud {link}: no such link; expected one of {known}");
        return Err(CliError::Usage(error));
    }
    let mut wires = Vec::new();
    for pair in args.tap.chunks_exact(2) {
        let name = pair[0].name.clone();
        let own = args
            .baud
            .iter()
            .rfind(|baud| baud.link.as_ref() == Some(&name));
        let all = args.baud.iter().rfind(|baud| baud.link.is_none());
        let given = own.or(all);
        // Held until the port is open, so that closing it resets no device.
        let of_pair = LineOfPair::of(pair, given.map(|baud| baud.rate));
        let line = of_pair.line;
        let mut open = |place: &NamedPort| ports.open("--tap", &place.path, line);
        let ends = [open(&pair[0])?, open(&pair[1])?];
        let [device, program] = ends.each_ref().map(|end| end.path().display());
        let (words, origin) = (in_words(line), &of_pair.origin);
        eprintln!("{name}: {device} <-> {program}, {words}, {origin}");
        let baud = line.baud;
        wires.push(Wire { name, baud, ends });
    }
    Ok(wires)
}

fn ended<C: Clock>(recorder: &Recorder<C>, file: &Path) -> RecordEnded {
    let link = |(name, [to_master, to_device]): (&str, [Passed; 2])| LinkRecorded {
        name: name.to_owned(),
        bytes_to_master: to_master.read,
        bytes_to_device: to_device.read,
        bytes_lost: to_master.lost + to_device.lost,
    };
    RecordEnded {
        file: file.display().to_string(),
        ran_s: (recorder.clock().now() - Instant::ZERO).as_secs_f64(),
        links: recorder.reports().map(link).collect(),
    }
}

fn report<C: Clock>(recorder: &Recorder<C>, file: &Path) {
    out::answer(&ended(recorder, file));
    println!("recorded {} s", recorder.clock().now());
    for (name, [to_master, to_device]) in recorder.reports() {
        let (there, back) = (to_master.read, to_device.read);
        print!("  {name}: {there} B to the program, {back} B to the device");
        match to_master.lost + to_device.lost {
            0 => println!(),
            lost => println!(", {lost} B lost: the receiving port was closed"),
        }
    }
    let held = recorder.held();
    let us = |at: core::time::Duration| at.as_micros();
    if held.count() > 0 {
        println!(
            "  forwarded after {} us (p50), {} us (p99), {} us (max)",
            us(held.quantile(500)),
            us(held.quantile(990)),
            us(held.max())
        );
    }
}
