use std::path::{Path, PathBuf};

use clap::Args;

use super::answer::Exported;
use super::{CliError, Verdict, out};
use crate::capture::export::{Belief, Export, Format, Laser};
use crate::capture::replay::Recorded;
use crate::scenario::Span;

/// Write a capture in a format of other tools.
///
/// The format follows the file's name, or --format. Lidar turns are assembled from the bytes. The
/// program's path and map come from a replay, which needs the robot: the capture of a run contains
/// it, other captures need --scenario.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig export hilrig-out/rescue-flat-1 -o run.mcap        # Foxglove\n  \
    hilrig export field.pcapng -o field.vcd                   # PulseView, GTKWave\n  \
    hilrig export field.pcapng -o field.log --laser flaser    # CARMEN readers\n  \
    hilrig export field.pcapng --scenario scenarios/rescue-flat.toml -o map.yaml")]
pub(super) struct ExportArgs {
    /// Capture, or a result folder
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// File to write
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    /// Format of the file [default: by its name]
    #[arg(long)]
    format: Option<Format>,
    /// Scenario whose robot this is [default: the one in the capture]
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Leave out bytes later than this after the beginning, e.g. 10s
    #[arg(long, value_name = "TIME")]
    until: Option<Span>,
    /// Layout of lidar turns in a CARMEN log
    #[arg(long, value_name = "MESSAGE", default_value = "robotlaser1")]
    laser: Laser,
}

pub(super) fn run(args: ExportArgs) -> Result<Verdict, CliError> {
    let out = args.out.display();
    let Some(format) = args.format.or_else(|| Format::of(&args.out)) else {
        let forms = "csv, vcd, mcap, log, carmen, tum or yaml";
        let error = format!("--out {out}: expected a name that ends in {forms}, or --format");
        return Err(CliError::Usage(error));
    };
    let file = match args.file.is_dir() {
        true => super::file_of(&args.file, "capture.pcapng")?,
        false => args.file.clone(),
    };
    let mut capture = super::replay::read(&file)?;
    let recorded = Recorded::of(&capture, args.until.map(|until| until.0));
    if args.until.is_some() {
        let end = recorded.zero + (recorded.end - protocols::Instant::ZERO);
        capture.records.retain(|record| record.at <= end);
    }
    let belief = belief(&args, format, &capture, &file, &recorded)?;
    let export = Export {
        capture: &capture,
        recorded: &recorded,
        belief: belief.as_ref(),
        laser: args.laser,
    };
    let words = export
        .write(format, &args.out)
        .map_err(|error| CliError::content(&file, error))?;
    println!("{words}, written to {out}");
    let (file, holds) = (out.to_string(), words);
    out::answer(&Exported { file, holds });
    Ok(Verdict::Pass)
}

/// The program's map and pose, if the format contains them. A format of these alone needs a robot;
/// others do not.
fn belief(
    args: &ExportArgs,
    format: Format,
    capture: &capture::Capture,
    file: &Path,
    recorded: &Recorded,
) -> Result<Option<Belief>, CliError> {
    if format.is_bytes() {
        return Ok(None);
    }
    let robot = super::replay::robot(capture, file, args.scenario.as_deref());
    let (scenario, source) = match robot {
        Ok(robot) => robot,
        Err(error) if format.is_belief() || args.scenario.is_some() => return Err(error),
        Err(_) => return Ok(None),
    };
    match Belief::of(recorded, &scenario, &source) {
        Ok(belief) => Ok(Some(belief)),
        Err(error) => Err(CliError::content(file, error)),
    }
}
