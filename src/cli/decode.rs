mod follow;
pub(super) mod source;

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use protocols::Instant;

use super::answer::{Decoded, EntryDecoded, LineDecoded};
use super::{CliError, Verdict, out};
use crate::capture::decode::diagnose::{Damage, Line, diagnose};
use crate::capture::decode::transcript::{Entry, Sum, Transcript};
use crate::codec::{self, Codec};
use crate::scenario::Span;
use crate::scenario::device::description;
use source::{Lane, Source, lanes};

/// Print the frames of a capture, or of a dump of raw bytes, one a line.
///
/// A line is the time, the link and direction, the place of the first byte on that line, and what
/// the bytes mean; bytes of no frame are BAD, with the reasons. All links are merged in the order
/// of time. The lines are data and go to standard output; what is said of the whole goes to
/// standard error.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig decode hilrig-out/rescue-flat-1/capture.pcapng --link base\n  \
    hilrig decode dump.bin --protocol xv11\n  \
    hilrig decode dump.bin --description gps\n  \
    hilrig decode dump.bin --summary    # figures of the whole, instead of the frames\n  \
    hilrig decode dump.bin --diagnose   # what is wrong with all of it, instead of the frames\n  \
    hilrig decode field.pcapng --follow # while hilrig up --capture field.pcapng writes it")]
pub(super) struct DecodeArgs {
    /// A pcapng capture, or bytes as they came from a port
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Protocol of the bytes [default: the one with the most sound frames, for each line]
    #[arg(long, value_parser = codec_parser())]
    protocol: Option<&'static Codec>,
    /// Description of the device whose frames they are: one that comes with the tool, by its name,
    /// or a file that ends with .toml
    #[arg(long, value_name = "NAME|FILE", conflicts_with = "protocol")]
    description: Option<String>,
    /// Only this link of a capture
    #[arg(long, value_name = "NAME")]
    link: Option<String>,
    /// Look for damage that a whole stream shows: stripped NUL bytes, CR or XON/XOFF translation,
    /// seven bits, a wrong baud rate, an echo, doubled or swapped bytes, a swapped checksum
    #[arg(long, conflicts_with = "summary")]
    diagnose: bool,
    /// Only count: frames, and for a lidar speed, readings, ranges and boot text
    #[arg(long)]
    summary: bool,
    /// Go on as the file grows, until SIGINT or SIGTERM
    #[arg(long, conflicts_with_all = ["summary", "diagnose"])]
    follow: bool,
    /// End a --follow by itself after this time, e.g. 60s or 5min
    #[arg(long, value_name = "TIME", requires = "follow")]
    duration: Option<Span>,
}

/// One of the table, by its name; the help lists them all.
fn codec_parser() -> impl TypedValueParser<Value = &'static Codec> {
    let rows = codec::all().into_iter();
    let values = rows.map(|row| PossibleValue::new(row.name()).help(row.about()));
    PossibleValuesParser::new(values)
        .map(|name| codec::find(&name).expect("rows are never taken out of the table"))
}

pub(super) fn run(mut args: DecodeArgs) -> Result<Verdict, CliError> {
    if let Some(name) = &args.description {
        let loaded = description::load(name, Path::new(""));
        let loaded = loaded.map_err(|error| CliError::Usage(format!("--description: {error}")))?;
        args.protocol = Some(description::codec_of(&loaded));
    }
    if out::is_json() {
        return document(&args);
    }
    let mut out = io::BufWriter::new(io::stdout().lock());
    let told = match args.follow {
        true => follow::follow(&args, &mut out),
        false => print(&args, &mut out),
    };
    match told.and_then(|()| Ok(out.flush()?)) {
        // Whoever reads has seen enough, e.g. "head".
        Err(Failure::Output(error)) if error.kind() == io::ErrorKind::BrokenPipe => {}
        Err(Failure::Output(error)) => {
            return Err(CliError::write("the frames", error));
        }
        Err(Failure::Other(error)) => return Err(error),
        Ok(()) => {}
    }
    // What is left of it must not be written when the writer goes: the reader may be gone.
    drop(out.into_parts());
    Ok(Verdict::Pass)
}

/// All of a file as one object, for `--json`.
fn document(args: &DecodeArgs) -> Result<Verdict, CliError> {
    if args.follow {
        let error = "--follow: has no end at which --json could print, expected one of them";
        return Err(CliError::Usage(error.to_owned()));
    }
    let source = Source::read(&args.file)?;
    source.check_link(args.link.as_deref(), &args.file)?;
    let mut decoded = Decoded::default();
    if !args.summary && !args.diagnose {
        decoded.entries = entries(args, &source);
    }
    let lanes = lanes(&source.capture, |name| is_wanted(args, name));
    decoded.lines = lanes.iter().map(|lane| line(args, lane, &lanes)).collect();
    out::answer(&decoded);
    Ok(Verdict::Pass)
}

fn is_wanted(args: &DecodeArgs, link: &str) -> bool {
    args.link.as_ref().is_none_or(|wanted| link == wanted)
}

/// What passed the lines.
fn entries(args: &DecodeArgs, source: &Source) -> Vec<EntryDecoded> {
    let links = &source.capture.links;
    let mut transcript = Transcript::new(protocol(args, source));
    let mut entries: Vec<Entry> = Vec::new();
    for record in &source.capture.records {
        if is_wanted(args, &links[record.link].name) {
            transcript.record(record, &links[record.link]);
            entries.extend(transcript.ready(record.at));
        }
    }
    entries.extend(transcript.finish());
    let decoded = |entry: Entry| EntryDecoded {
        at_s: source.start.map(|start| (entry.at - start).as_secs_f64()),
        link: links[entry.link].name.clone(),
        direction: entry.direction.name().to_owned(),
        place: entry.place,
        said: entry.said.to_string(),
    };
    entries.into_iter().map(decoded).collect()
}

/// A line as a whole.
fn line(args: &DecodeArgs, lane: &Lane, lanes: &[Lane]) -> LineDecoded {
    let codec = args.protocol.or_else(|| codec::guess(&lane.bytes));
    let damages = match args.diagnose {
        true => damages(args, lane, lanes),
        false => Vec::new(),
    };
    LineDecoded {
        name: lane.name.clone(),
        bytes: lane.bytes.len() as u64,
        protocol: codec.map(|codec| codec.name().to_owned()),
        framed: codec.map_or(0, |codec| codec.framed(&lane.bytes)),
        figures: codec.and_then(|codec| codec.figures(&lane.bytes)),
        damages: damages.iter().map(ToString::to_string).collect(),
    }
}

/// The protocol of all bytes, if it is one: the one that was named, or that of a dump, of which all
/// is known, so all of it says what it is.
fn protocol(args: &DecodeArgs, source: &Source) -> Option<&'static Codec> {
    let of_dump = || {
        let dump = source.capture.records.first();
        let dump = dump.filter(|_| source.start.is_none())?;
        codec::guess(&dump.bytes)
    };
    args.protocol.or_else(of_dump)
}

enum Failure {
    Other(CliError),
    Output(io::Error),
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::Output(error)
    }
}

impl From<CliError> for Failure {
    fn from(error: CliError) -> Self {
        Self::Other(error)
    }
}

fn print(args: &DecodeArgs, out: &mut dyn Write) -> Result<(), Failure> {
    let source = Source::read(&args.file)?;
    source.check_link(args.link.as_deref(), &args.file)?;
    let wanted = |name: &str| is_wanted(args, name);
    if args.diagnose || args.summary {
        let lanes = lanes(&source.capture, wanted);
        return match args.diagnose {
            true => print_damages(args, &lanes, out),
            false => print_sums(args, &lanes, out),
        };
    }
    let names: Vec<&str> = source
        .capture
        .links
        .iter()
        .map(|link| &*link.name)
        .collect();
    let mut transcript = Transcript::new(protocol(args, &source));
    for record in &source.capture.records {
        let link = &source.capture.links[record.link];
        if wanted(&link.name) {
            transcript.record(record, link);
            for entry in transcript.ready(record.at) {
                print_entry(&entry, &names, source.start, out)?;
            }
        }
    }
    for entry in transcript.finish() {
        print_entry(&entry, &names, source.start, out)?;
    }
    out.flush()?;
    for sum in transcript.sums() {
        say_sum(&sum, names[sum.link]);
    }
    for lane in lanes(&source.capture, wanted) {
        let codec = args.protocol.or_else(|| codec::guess(&lane.bytes));
        if let Some(figures) = codec.and_then(|codec| codec.figures(&lane.bytes)) {
            eprintln!("{figures}");
        }
    }
    Ok(())
}

/// One line; without a time if the source has none.
fn print_entry(
    entry: &Entry,
    names: &[&str],
    start: Option<Instant>,
    out: &mut dyn Write,
) -> io::Result<()> {
    match start {
        Some(start) => write!(out, "{} ", Instant::ZERO + (entry.at - start))?,
        None => write!(out, "- ")?,
    }
    let (name, direction) = (names[entry.link], entry.direction.name());
    writeln!(out, "{name} {direction} @{} {}", entry.place, entry.said)
}

fn say_sum(sum: &Sum, name: &str) {
    let (direction, bytes, framed) = (sum.direction.name(), sum.bytes, sum.framed);
    match sum.codec {
        Some(codec) => eprintln!(
            "{name} {direction}: {bytes} bytes of {}, {framed} of them in sound frames",
            codec.name()
        ),
        None => eprintln!("{name} {direction}: {bytes} bytes, no frame of any known protocol"),
    }
}

fn print_sums(args: &DecodeArgs, lanes: &[Lane], out: &mut dyn Write) -> Result<(), Failure> {
    for lane in lanes {
        let (name, len) = (&lane.name, lane.bytes.len());
        let codec = args.protocol.or_else(|| codec::guess(&lane.bytes));
        let Some(codec) = codec else {
            writeln!(out, "{name}: {len} bytes, no frame of any known protocol")?;
            continue;
        };
        let framed = codec.framed(&lane.bytes);
        let of = codec.name();
        writeln!(
            out,
            "{name}: {len} bytes of {of}, {framed} of them in sound frames"
        )?;
        if let Some(figures) = codec.figures(&lane.bytes) {
            writeln!(out, "{figures}")?;
        }
    }
    Ok(())
}

/// What was done to all bytes of a line.
fn damages(args: &DecodeArgs, lane: &Lane, lanes: &[Lane]) -> Vec<Damage> {
    let opposite = lanes.iter().find(|other| lane.is_opposite(other));
    diagnose(&Line {
        bytes: &lane.bytes,
        opposite: opposite.map_or(&[], |other| &other.bytes),
        codec: args.protocol,
        framing_errors: lane.framing_errors,
    })
}

fn print_damages(args: &DecodeArgs, lanes: &[Lane], out: &mut dyn Write) -> Result<(), Failure> {
    for lane in lanes {
        let damages = damages(args, lane, lanes);
        let name = &lane.name;
        if damages.is_empty() {
            writeln!(out, "{name}: no systematic damage found")?;
        }
        for damage in damages {
            writeln!(out, "{name}: {damage}")?;
        }
    }
    Ok(())
}
