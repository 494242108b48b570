use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

use clap::Args;

use core::time::Duration;

use super::{CliError, Verdict};
use crate::capture::{Capture, Interface, Kind, Record};
use crate::decode::diagnose::diagnose;
use crate::decode::summary::Lidar;
use crate::decode::{Found, Protocol, Stream, What};
use crate::line::Direction;

/// Print the frames of a capture, or of a dump of raw bytes, one a line.
///
/// The lines are data and go to standard output; what is said of the whole goes to standard error.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig decode hilrig-out/rescue-flat-1/capture.pcapng --link base\n  \
    hilrig decode dump.bin --protocol xv11\n  \
    hilrig decode dump.bin --diagnose   # what is wrong with all of it, instead of the frames")]
pub(super) struct DecodeArgs {
    /// A pcapng capture, or bytes as they came from a port
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Protocol of the bytes [default: the one with the most sound frames, for each link]
    #[arg(long)]
    protocol: Option<Protocol>,
    /// Only this link of a capture
    #[arg(long, value_name = "NAME")]
    link: Option<String>,
    /// Look for damage that a whole stream shows, e.g. stripped NUL bytes
    #[arg(long)]
    diagnose: bool,
}

/// Silence after which a frame that was begun is given up.
const QUIET: Duration = Duration::from_millis(50);

pub(super) fn run(args: DecodeArgs) -> Result<Verdict, CliError> {
    let told = tell(&args, &mut io::stdout().lock());
    match told {
        // Whoever reads has seen enough, e.g. "head".
        Err(Failure::Output(error)) if error.kind() == io::ErrorKind::BrokenPipe => {}
        Err(Failure::Output(error)) => {
            return Err(CliError::Other(format!("cannot write the frames: {error}")));
        }
        Err(Failure::Input(error)) => return Err(CliError::Other(error)),
        Ok(()) => {}
    }
    Ok(Verdict::Pass)
}

enum Failure {
    Input(String),
    Output(io::Error),
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::Output(error)
    }
}

fn tell(args: &DecodeArgs, out: &mut dyn Write) -> Result<(), Failure> {
    let path = args.file.display();
    let bytes =
        fs::read(&args.file).map_err(|e| Failure::Input(format!("cannot read {path}: {e}")))?;
    let capture = if bytes.starts_with(&[0x0A, 0x0D, 0x0D, 0x0A]) {
        Capture::of(&bytes)
    } else {
        raw(bytes)
    };
    if let Some(error) = capture.broken {
        eprintln!("{path} is broken {error}; what is before it follows");
    } else if capture.cut > 0 {
        eprintln!(
            "{path} was cut: {} bytes at its end are no whole block",
            capture.cut
        );
    }
    if let Some(wanted) = &args.link
        && !capture.links.iter().any(|link| link.name == *wanted)
    {
        let names: Vec<&str> = capture.links.iter().map(|link| &*link.name).collect();
        let names = names.join(", ");
        let text = format!("--link {wanted}: {path} has no such link, only: {names}");
        return Err(Failure::Input(text));
    }
    for (index, link) in capture.links.iter().enumerate() {
        if args.link.as_ref().is_some_and(|name| *name != link.name) {
            continue;
        }
        for direction in [Direction::ToMaster, Direction::ToDevice] {
            let is_own =
                |r: &&Record| r.link == index && r.direction == direction && r.kind == Kind::Data;
            let records: Vec<&Record> = capture.records.iter().filter(is_own).collect();
            if !records.is_empty() {
                tell_line(
                    args,
                    &format!("{} {}", link.name, direction.name()),
                    &records,
                    out,
                )?;
            }
        }
    }
    Ok(())
}

/// Bytes without time, as a capture of one link.
fn raw(bytes: Vec<u8>) -> Capture {
    let record = Record {
        link: 0,
        sequence: None,
        at: protocols::Instant::ZERO,
        direction: Direction::ToMaster,
        kind: Kind::Data,
        bytes,
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    };
    Capture {
        links: vec![Interface::new("raw", 0)],
        records: vec![record],
        ..Capture::default()
    }
}

fn tell_line(
    args: &DecodeArgs,
    name: &str,
    records: &[&Record],
    out: &mut dyn Write,
) -> Result<(), Failure> {
    let pieces = records.iter().map(|record| &record.bytes[..]);
    let bytes: Vec<u8> = pieces.collect::<Vec<_>>().concat();
    let Some(protocol) = args.protocol.or_else(|| Protocol::guess(&bytes)) else {
        eprintln!(
            "{name}: {} bytes, no frame of any known protocol",
            bytes.len()
        );
        return Ok(());
    };
    let mut stream = Stream::new(protocol);
    let (mut framed, mut last) = (0, None);
    for record in records {
        let mut found = Vec::new();
        if last.is_some_and(|last| record.at - last > QUIET) {
            found = stream.idle();
        }
        last = Some(record.at);
        found.extend(stream.push(&record.bytes));
        framed += tell_found(args, (name, record), &bytes, &found, out)?;
    }
    if let Some(record) = records.last() {
        framed += tell_found(args, (name, record), &bytes, &stream.idle(), out)?;
    }
    let (len, of) = (bytes.len(), protocol.name());
    eprintln!("{name}: {len} bytes of {of}, {framed} of them in sound frames");
    match protocol {
        Protocol::Xv11 => eprintln!("{}", Lidar::of_packets(&bytes)),
        Protocol::Xv11Turn => eprintln!("{}", Lidar::of_turns(&bytes)),
        _ => {}
    }
    if args.diagnose {
        let damages = diagnose(&bytes, framed);
        if damages.is_empty() {
            writeln!(out, "{name}: no systematic damage found")?;
        }
        for damage in damages {
            writeln!(out, "{name}: {damage}")?;
        }
    }
    Ok(())
}

/// Prints what was found; the bytes of it that are in frames.
fn tell_found(
    args: &DecodeArgs,
    (name, record): (&str, &Record),
    bytes: &[u8],
    found: &[Found],
    out: &mut dyn Write,
) -> Result<u64, Failure> {
    let mut framed = 0;
    for Found { bytes: range, what } in found {
        if matches!(what, What::Frame(_)) {
            framed += range.end - range.start;
        }
        if args.diagnose {
            continue;
        }
        let (at, start) = (record.at, range.start);
        match what {
            What::Frame(words) => writeln!(out, "{at} {name} @{start} {words}")?,
            What::Bad(errors) => {
                let place = |at: u64| usize::try_from(at).expect("within a file in memory");
                let bad = &bytes[place(range.start)..place(range.end)];
                let shown = bad[..bad.len().min(32)].escape_ascii();
                let more = if bad.len() > 32 { ".." } else { "" };
                let len = bad.len();
                write!(
                    out,
                    "{at} {name} @{start} BAD {len} bytes \"{shown}{more}\""
                )?;
                for error in errors {
                    write!(out, "; {error}")?;
                }
                writeln!(out)?;
            }
        }
    }
    Ok(framed)
}
