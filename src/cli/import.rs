use std::path::PathBuf;

use clap::Args;

use super::answer::Imported;
use super::{CliError, Verdict, out};
use crate::capture::import::{self, Format, Options};
use crate::realtime::playback::Side as PlayedSide;
use crate::show::whole_file;

/// Turn a dump of another tool into a capture.
///
/// Reads what socat, jpnevulator, sigrok-cli, Saleae Logic and tio write, and bytes alone. The form
/// is recognised by itself; bytes alone need --format raw and --baud. A line that does not fit is
/// an error with its place.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    socat -x -v /dev/ttyUSB0,raw PTY,link=/tmp/robot 2> dump.txt   # then\n  \
    hilrig import dump.txt -o field.pcapng --link lidar --baud 115200\n  \
    hilrig import uart.txt -o field.pcapng --samplerate 4000000 --baud 115200\n  \
    hilrig import dump.bin --format raw --baud 115200 -o field.pcapng")]
pub(super) struct ImportArgs {
    /// Dump to read
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Capture to write
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    /// Form of the dump [default: recognised]
    #[arg(long)]
    format: Option<Format>,
    /// Name of the link
    #[arg(long, value_name = "NAME", default_value = "line")]
    link: String,
    /// Baud rate of the line
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(50..=12_000_000))]
    baud: Option<u32>,
    /// Samples per second of the logic analyzer
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    samplerate: Option<u64>,
    /// Who sent what the tool received, or what socat marks with >
    #[arg(long, value_name = "SIDE", default_value = "device")]
    from: PlayedSide,
}

pub(super) fn run(args: ImportArgs) -> Result<Verdict, CliError> {
    let bytes = super::read(&args.file)?;
    let Some(format) = args.format.or_else(|| Format::detect(&bytes)) else {
        let known = "socat, jpnevulator, sigrok or saleae";
        let what = format!("expected a dump of {known}, or --format raw for bytes alone");
        return Err(CliError::content(&args.file, what));
    };
    let options = Options {
        link: args.link,
        baud: args.baud,
        sample_rate: args.samplerate,
        direction: args.from.speaks(),
    };
    let imported = import::read(&bytes, format, &options)
        .map_err(|error| CliError::content(&args.file, error))?;
    imported.notes.iter().for_each(|note| eprintln!("{note}"));
    let out = args.out.display();
    whole_file::write(&args.out, imported.to_pcapng(format))
        .map_err(|error| CliError::write(&out, error))?;
    let bytes: usize = imported
        .records()
        .iter()
        .map(|record| record.bytes.len())
        .sum();
    let (name, records) = (format.name(), imported.records().len());
    println!("{bytes} bytes in {records} records of {name}, written to {out}");
    out::answer(&Imported {
        file: out.to_string(),
        format: name.to_owned(),
        bytes: bytes as u64,
        records: records as u64,
        notes: imported.notes.iter().map(ToString::to_string).collect(),
    });
    Ok(Verdict::Pass)
}
