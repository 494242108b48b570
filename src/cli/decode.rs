mod follow;
pub(super) mod source;

use std::io::{self, Write};
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use protocols::Instant;

use super::answer::{Decoded, EntryDecoded, LineDecoded};
use super::{CliError, Verdict, described, out};
use crate::capture::Capture;
use crate::capture::decode::diagnose::{Damage, Line, diagnose};
use crate::capture::decode::framed::Framed;
use crate::capture::decode::pause::Pauses;
use crate::capture::decode::profile::{Profile, messages};
use crate::capture::decode::transcript::{Entry, Known, Sum, Transcript};
use crate::capture::import::Format;
use crate::codec::{self, Codec};
use crate::rig::line::Direction;
use crate::scenario::Span;
use crate::scenario::device::description;
use source::{Lane, Source, lanes};

/// Print the frames of a capture, or of a dump of raw bytes, one a line.
///
/// A line has the time, the link and direction, the offset of the first byte, and the meaning of
/// the bytes. Bytes outside of frames are BAD, with the reasons. A protocol is named only if the
/// bytes prove it, or --as sets it. Bytes of an unknown protocol are DATA, grouped by arrival.
/// Files of other tools are read like `hilrig import` does. The frames of all links are ordered by
/// time. The lines go to standard output, notes about the whole capture to standard error.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig decode hilrig-out/rescue-flat-1/capture.pcapng --link base\n  \
    hilrig decode dump.bin --as xv11\n  \
    hilrig decode dump.bin --description gps\n  \
    hilrig decode dump.hex            # also xxd, socat -x, .sr, VCD and what else import reads\n  \
    hilrig decode dump.bin --summary    # figures of the whole, instead of the frames\n  \
    hilrig decode dump.bin --diagnose   # what is wrong with all of it, instead of the frames\n  \
    hilrig decode field.pcapng --follow # while hilrig up --capture field.pcapng writes it")]
pub(super) struct DecodeArgs {
    /// A pcapng capture, or raw bytes recorded from a port
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Protocol of the bytes [default: for each line the one that its bytes prove, if one]
    #[arg(long, visible_alias = "as", value_parser = codec_parser())]
    protocol: Option<&'static Codec>,
    /// Description of the device that sent the frames: one that comes with the tool, by its name,
    /// or a file that ends with .toml
    #[arg(long, value_name = "NAME|FILE", conflicts_with = "protocol")]
    description: Option<String>,
    /// Format of a file that is not a capture; raw for plain bytes [default: recognised]
    #[arg(long, conflicts_with = "follow")]
    format: Option<Format>,
    /// Only this link of a capture
    #[arg(long, value_name = "NAME")]
    link: Option<String>,
    /// Look for damage of a whole stream: stripped NUL bytes, CR or XON/XOFF translation, seven
    /// bits, a wrong baud rate, an echo, doubled or swapped bytes, a swapped checksum
    #[arg(long, conflicts_with = "summary")]
    diagnose: bool,
    /// Print counts only: frames, and for a lidar speed, readings, ranges and boot text
    #[arg(long)]
    summary: bool,
    /// Follow the growing file until SIGINT or SIGTERM
    #[arg(long, conflicts_with_all = ["summary", "diagnose"])]
    follow: bool,
    /// End a --follow after this time, e.g. 60s or 5min
    #[arg(long, value_name = "TIME", requires = "follow")]
    duration: Option<Span>,
}

/// The parser of protocol names; the help lists all names.
fn codec_parser() -> impl TypedValueParser<Value = &'static Codec> {
    let rows = codec::all().into_iter();
    let values = rows.map(|row| PossibleValue::new(row.name()).help(row.about()));
    PossibleValuesParser::new(values)
        .map(|name| codec::find(&name).expect("rows are never taken out of the table"))
}

pub(super) fn run(mut args: DecodeArgs) -> Result<Verdict, CliError> {
    if let Some(name) = &args.description {
        let loaded = described::load("--description", name)?;
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
        // The reader closed the pipe early, e.g. "head".
        Err(Failure::Output(error)) if error.kind() == io::ErrorKind::BrokenPipe => {}
        Err(Failure::Output(error)) => {
            return Err(CliError::write("the frames", error));
        }
        Err(Failure::Other(error)) => return Err(error),
        Ok(()) => {}
    }
    // The remaining buffer must not be written on drop: the reader may be gone.
    drop(out.into_parts());
    Ok(Verdict::Pass)
}

/// The whole file as one object, for `--json`.
fn document(args: &DecodeArgs) -> Result<Verdict, CliError> {
    if args.follow {
        let error = "--follow: has no end at which --json could print, expected one of them";
        return Err(CliError::Usage(error.to_owned()));
    }
    let source = Source::read(&args.file, args.format)?;
    source.check_link(args.link.as_deref(), &args.file)?;
    let known = source.known(&args.file);
    let mut decoded = Decoded::default();
    if !args.summary && !args.diagnose {
        decoded.entries = entries(args, &source, &known);
    }
    let lanes = lanes(&source.capture, |name| is_wanted(args, name));
    let line = |lane| line(args, (&source.capture, &known), lane, &lanes);
    decoded.lines = lanes.iter().map(line).collect();
    out::answer(&decoded);
    Ok(Verdict::Pass)
}

fn is_wanted(args: &DecodeArgs, link: &str) -> bool {
    args.link.as_ref().is_none_or(|wanted| link == wanted)
}

/// An empty transcript that judges pauses by the clock of `capture`.
fn transcript(codec: Option<&'static Codec>, capture: &Capture) -> Transcript {
    Transcript::new(codec).pausing(Pauses::of(&capture.sections))
}

/// Frames and events of the lines.
fn entries(args: &DecodeArgs, source: &Source, known: &[Known]) -> Vec<EntryDecoded> {
    let links = &source.capture.links;
    let mut transcript =
        transcript(protocol(args, source), &source.capture).knowing(known.to_vec());
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

/// Figures of a line.
fn line(
    args: &DecodeArgs,
    source: (&Capture, &[Known]),
    lane: &Lane,
    lanes: &[Lane],
) -> LineDecoded {
    let (capture, _) = source;
    let codec = codec_of(args, source, lane);
    let damages = match args.diagnose {
        true => damages(args, capture, lane, lanes),
        false => Vec::new(),
    };
    LineDecoded {
        name: lane.name.clone(),
        bytes: lane.bytes.len() as u64,
        protocol: codec.map(|codec| codec.name().to_owned()),
        framed: codec.map_or(0, |codec| framed(codec, capture, lane).framed),
        figures: codec.and_then(|codec| codec.figures(&lane.bytes)),
        damages: damages.iter().map(ToString::to_string).collect(),
    }
}

/// Bytes of a line in valid frames of its direction.
fn framed(codec: &'static Codec, capture: &Capture, lane: &Lane) -> Framed {
    Framed::of(codec, capture, lane.link, lane.direction)
}

/// The protocol of a line: the named one, or that of the capture's scenario if the line has frames
/// of it, or the one that the bytes prove.
fn codec_of(
    args: &DecodeArgs,
    (capture, known): (&Capture, &[Known]),
    lane: &Lane,
) -> Option<&'static Codec> {
    let is_own = |known: &&Known| lane.is_of(&known.link, known.direction);
    let expected = || {
        let codec = known.iter().find(is_own)?.codec?;
        (framed(codec, capture, lane).framed > 0).then_some(codec)
    };
    let expected = args.protocol.or_else(expected);
    expected.or_else(|| codec::guess(&lane.bytes))
}

/// The protocol of all bytes, if there is only one: the named one, or that of a dump. All bytes of
/// a dump are known, so all of them are evidence.
fn protocol(args: &DecodeArgs, source: &Source) -> Option<&'static Codec> {
    let of_dump = || {
        let [dump] = &source.capture.records[..] else {
            return None;
        };
        let codec = codec::guess(&dump.bytes);
        codec.filter(|_| source.start.is_none())
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
    let source = Source::read(&args.file, args.format)?;
    source.check_link(args.link.as_deref(), &args.file)?;
    let known = source.known(&args.file);
    let wanted = |name: &str| is_wanted(args, name);
    if args.diagnose || args.summary {
        let lanes = lanes(&source.capture, wanted);
        return match args.diagnose {
            true => print_damages(args, (&source.capture, &known), &lanes, out),
            false => print_sums(args, &source, &known, &lanes, out),
        };
    }
    let names: Vec<&str> = source
        .capture
        .links
        .iter()
        .map(|link| &*link.name)
        .collect();
    let mut transcript =
        transcript(protocol(args, &source), &source.capture).knowing(known.clone());
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
        if sum.codec.is_none() {
            eprintln!("{}", profile(&source, sum.link, sum.direction));
        }
    }
    for lane in lanes(&source.capture, wanted) {
        let codec = codec_of(args, (&source.capture, &known), &lane);
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
            "{name} {direction}: {bytes} bytes of {}, {framed} of them in valid frames",
            codec.name()
        ),
        None => eprintln!("{name} {direction}: {bytes} bytes, {UNKNOWN}"),
    }
}

const UNKNOWN: &str = "of no known protocol (--as PROTOCOL forces one)";

/// Notes about a line with an unknown protocol.
fn profile(source: &Source, link: usize, direction: Direction) -> Profile {
    let capture = &source.capture;
    Profile::of(&capture.records, link, &capture.links[link], direction)
}

fn print_sums(
    args: &DecodeArgs,
    source: &Source,
    known: &[Known],
    lanes: &[Lane],
    out: &mut dyn Write,
) -> Result<(), Failure> {
    for lane in lanes {
        let (name, len) = (&lane.name, lane.bytes.len());
        let Some(codec) = codec_of(args, (&source.capture, known), lane) else {
            writeln!(out, "{name}: {len} bytes, {UNKNOWN}")?;
            writeln!(out, "{}", profile(source, lane.link, lane.direction))?;
            continue;
        };
        let framed = framed(codec, &source.capture, lane).framed;
        let of = codec.name();
        writeln!(
            out,
            "{name}: {len} bytes of {of}, {framed} of them in valid frames"
        )?;
        if let Some(figures) = codec.figures(&lane.bytes) {
            writeln!(out, "{figures}")?;
        }
    }
    Ok(())
}

/// A note for a line of text in no known protocol: the file may be a log about a line instead of
/// its bytes.
fn text_words(bytes: &[u8]) -> Option<String> {
    let is_text = |byte: &&u8| matches!(byte, b' '..=b'~' | b'\r' | b'\n' | b'\t');
    let text = bytes.iter().filter(is_text).count();
    if bytes.is_empty() || text * 20 < bytes.len() * 19 || codec::guess(bytes).is_some() {
        return None;
    }
    let lines = bytes.iter().filter(|byte| **byte == b'\n').count();
    Some(format!(
        "this is text, {lines} lines, of no known protocol; if it is a log of another tool and not \
         the line's own bytes, see hilrig import"
    ))
}

/// Damage of all bytes of a line.
fn damages(args: &DecodeArgs, capture: &Capture, lane: &Lane, lanes: &[Lane]) -> Vec<Damage> {
    let swapped = args.protocol.and_then(|own| {
        let other = own.own_other_order()?;
        let [other, expected] = [other, own].map(|codec| framed(codec, capture, lane).frames);
        let is_other = other >= FRAMES_OTHER && other > expected * 10;
        is_other.then_some(Damage::ChecksumOrder { other, expected })
    });
    if let Some(swapped) = swapped {
        return vec![swapped];
    }
    let opposite = lanes.iter().find(|other| lane.is_opposite(other));
    let of = |codec| framed(codec, capture, lane).framed;
    let link = &capture.links[lane.link];
    let messages = args
        .protocol
        .map(|_| messages(&capture.records, lane.link, link, lane.direction));
    diagnose(&Line {
        bytes: &lane.bytes,
        opposite: opposite.map_or(&[], |other| &other.bytes),
        codec: args.protocol,
        direction: Some(lane.direction),
        framing_errors: lane.framing_errors,
        framed: args.protocol.map(of),
        messages: messages.as_deref().unwrap_or_default(),
    })
}

/// Minimum number of frames with a swapped checksum for a diagnosis.
const FRAMES_OTHER: u64 = 8;

fn print_damages(
    args: &DecodeArgs,
    source: (&Capture, &[Known]),
    lanes: &[Lane],
    out: &mut dyn Write,
) -> Result<(), Failure> {
    for lane in lanes {
        let damages = damages(args, source.0, lane, lanes);
        let name = &lane.name;
        if damages.is_empty() {
            let doubt = |codec: &'static Codec| {
                framed(codec, source.0, lane).doubt(codec.name(), args.protocol.is_none())
            };
            let codec = codec_of(args, source, lane);
            let words = codec.and_then(doubt);
            let words = words.unwrap_or_else(|| "no systematic damage found".to_owned());
            match codec.is_none() && text_words(&lane.bytes).is_none() {
                true => writeln!(out, "{name}: {UNKNOWN}; {words}")?,
                false => writeln!(out, "{name}: {words}")?,
            }
        }
        if args.protocol.is_none()
            && let Some(what) = text_words(&lane.bytes)
        {
            writeln!(out, "{name}: {what}")?;
        }
        for damage in damages {
            writeln!(out, "{name}: {damage}")?;
        }
    }
    Ok(())
}
