mod open;
mod page;

use core::time::Duration;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use emulators::world::Pose;
use firmware_core::slam::{Mode, Settings};
use protocols::Instant;

use super::answer::Surveyed;
use super::progress;
use super::{CliError, Verdict, out};
use crate::realtime::clock::{Clock as _, WallClock};
use crate::slam::Log;
use crate::slam::folder::{self, News};
use crate::slam::look::{Jump, Look};
use crate::slam::map::walls;
use crate::slam::mapping::WallPoint;
use crate::slam::survey::{CELL_MM, Survey, settings, survey};
use crate::slam::tour::{Wish, locate, tour};
use crate::slam::tuning::Tuning;
use open::open;
use page::{Page, PageArgs};

/// Run the mapper over a log of scans and odometry: map, trajectory and timing.
///
/// Reads CARMEN logs; captures, whose robot must be known; MCAP files, ours or with messages of
/// ROS 2 (LaserScan, Odometry) or Foxglove (LaserScan, PoseInFrame); rosbag2 folders and .db3
/// files. Files may be compressed by gzip, zstd or lz4, and so may the chunks and messages in
/// them. The settings are the same for every log. Unusable parts of the log are skipped, counted
/// and reported on standard error.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig slam intel.log.gz --out intel\n  \
    hilrig slam intel.log --mode core     # the robot's own mapper, without loops\n  \
    hilrig slam intel.log --mode seed     # the seed report's algorithm\n  \
    hilrig slam today.mcap --map hilrig-out/slam-intel --start 2.5,-1,90\n  \
    hilrig slam hilrig-out/rescue-flat-1 --cell-mm 10     # the capture of a run\n  \
    hilrig slam field.pcapng --scenario scenarios/rescue-flat.toml\n  \
    hilrig slam rosbag2_2026_11_23     # the folder, or one .mcap or .db3 file\n  \
    hilrig slam intel.log --ui=8080    # a page shows the map while it grows\n\n\
    Writes map.png, map.pgm + map.yaml (ROS), trajectory.tum and timing.json to the folder; mode\n\
    graph also scans.csv (how sure each pose is, and its part of the map), graph.g2o and walls.pcd.\n\
    With --map the map is not changed: trajectory.tum, scans.csv, timing.json, and map.png with\n\
    walls and way.")]
pub(super) struct SlamArgs {
    /// The log, a result folder, or the folder of a rosbag2
    #[arg(value_name = "LOG")]
    log: PathBuf,
    /// Scenario of the robot in a capture [default: the one in the capture]
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Mapper [default: core for a capture or a result folder, graph for any other log]
    #[arg(long, value_enum)]
    mode: Option<ModeArg>,
    /// Only localise, on an existing map: a folder written by slam (its walls.pcd), a .pcd file in
    /// text, or a ROS map's .yaml
    #[arg(long, value_name = "PATH")]
    map: Option<PathBuf>,
    /// Start pose, within half a metre and 20 degrees: metres and degrees in the map [default: the
    /// log's, or 0,0,0]
    #[arg(long, value_name = "X,Y,DEG", value_parser = start, allow_hyphen_values = true)]
    start: Option<Pose>,
    /// Do not look for loop closures (mode graph)
    #[arg(long)]
    no_loops: bool,
    /// Factor on the usual odometry errors, 0.1 to 10 (mode graph)
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = factor)]
    noise: f64,
    /// Ignore readings longer than this
    #[arg(long, value_name = "METRES", value_parser = metres)]
    farthest_m: Option<f64>,
    /// Distance of the laser ahead of the position given in the log
    #[arg(long, value_name = "METRES", default_value_t = 0.0)]
    #[arg(allow_hyphen_values = true, value_parser = offset)]
    laser_offset_m: f64,
    /// Use only every N-th scan
    #[arg(long, value_name = "N", default_value_t = 1)]
    #[arg(value_parser = clap::value_parser!(u16).range(1..))]
    every: u16,
    /// Folder for the results [default: hilrig-out/slam-NAME, with --map hilrig-out/on-map-NAME]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Edge of a map cell in millimetres, 5 to 500
    #[arg(long, value_name = "MM", value_parser = clap::value_parser!(u16).range(5..=500))]
    cell_mm: Option<u16>,
    /// Seed of the random numbers of mode seed; each run is one random sample
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    page: PageArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum ModeArg {
    /// For buildings: keyframes, loop closures, a map of any size
    Graph,
    /// The robot's own mapper, within its memory
    Core,
    /// tinySLAM of the seed report
    Seed,
}

impl ModeArg {
    const fn name(self) -> &'static str {
        match self {
            Self::Graph => "graph",
            Self::Core => "core",
            Self::Seed => "seed",
        }
    }
}

/// A number from `least` to `most`.
fn number(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let number = text.parse::<f64>().ok();
    number
        .filter(|number| (least..=most).contains(number))
        .ok_or_else(|| format!("expected a number from {least} to {most}"))
}

fn factor(text: &str) -> Result<f64, String> {
    number(text, 0.1, 10.0)
}

fn metres(text: &str) -> Result<f64, String> {
    number(text, 0.1, 1000.0)
}

fn offset(text: &str) -> Result<f64, String> {
    number(text, -3.0, 3.0)
}

fn start(text: &str) -> Result<Pose, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .filter_map(|part| part.trim().parse().ok())
        .filter(|part: &f64| part.abs() < 1e5)
        .collect();
    match numbers[..] {
        [x, y, degrees] if text.split(',').count() == 3 => {
            Ok(Pose::new(x, y, degrees.to_radians()))
        }
        _ => Err("expected metres and degrees as X,Y,DEG, e.g. 2.5,-1,90".to_owned()),
    }
}

/// Time after which long work prints its progress.
const PATIENCE: Duration = Duration::from_secs(2);

pub(super) fn run(args: SlamArgs) -> Result<Verdict, CliError> {
    if args.map.is_some() && !matches!(args.mode, None | Some(ModeArg::Graph)) {
        let words = "--map goes with --mode graph: the other mappers begin with an empty map";
        return Err(CliError::Usage(words.to_owned()));
    }
    let known = args.map.as_deref().map(walls).transpose()?;
    let (mut log, usual) = open(&args.log, args.scenario.as_deref())?;
    let mode = args.mode.unwrap_or(usual);
    log.start = args.start.unwrap_or(log.start);
    let path = args.log.display();
    for note in &log.notes {
        eprintln!("{path}: {note}");
    }
    print_findings(&log, &args.log);
    let tuning = Tuning {
        farthest_m: args.farthest_m,
        laser_offset_m: args.laser_offset_m,
        every: usize::from(args.every),
    };
    tuning.apply(&mut log);
    let mut page = args.page.start(&args.log, log.shots.len())?;
    let result = mapped(&log, mode, &args, known.as_deref(), &mut page);
    let stem = args.log.file_name().unwrap_or_default().to_string_lossy();
    let stem = stem.split('.').next().unwrap_or_default().to_owned();
    let (news, name) = match &known {
        Some(_) => (News::Way, "map"),
        None => (News::Map, mode.name()),
    };
    let usual = match news {
        News::Map => format!("slam-{stem}"),
        News::Way => format!("on-map-{stem}"),
    };
    let dir = args
        .out
        .unwrap_or_else(|| PathBuf::from("hilrig-out").join(usual));
    let timing = folder::timing(name, &log, &result);
    folder::write(&dir, &result, &timing, news)?;
    print(&timing);
    warn(&result, &args.log);
    println!("results in {}", dir.display());
    out::answer(&Surveyed {
        folder: dir.display().to_string(),
        scans: timing.scans as u64,
        skipped: timing.skipped,
        doubtful: timing.doubtful as u64,
        ambiguous: timing.ambiguous as u64,
        jumps: timing.jumps.len() as u64,
        loop_edges: timing.loop_edges as u64,
        parts: timing.parts.map(|parts| parts as u64),
        doubt: timing.doubt,
        cell_mm: timing.cell_mm,
        scan_median_us: timing.scan_median_us,
        scan_longest_us: timing.scan_longest_us,
    });
    page.stay(&result);
    Ok(Verdict::Pass)
}

/// Runs the selected mapper, and prints its progress if that takes long.
fn mapped(
    log: &Log,
    mode: ModeArg,
    args: &SlamArgs,
    known: Option<&[WallPoint]>,
    page: &mut Page,
) -> Survey {
    let clock = WallClock::start();
    let mut told_at = clock.now();
    let of = log.shots.len();
    let mut tell = |look: &Look<'_>| {
        page.look(look);
        let done = look.done;
        let now = clock.now();
        if now - told_at >= PATIENCE && progress::is_watched() {
            let left = progress::left(now - Instant::ZERO, done as f64 / of as f64);
            eprintln!("{done} of {of} scans{left}");
            told_at = now;
        }
    };
    let cell_mm = args.cell_mm.map_or(CELL_MM, f32::from);
    let wish = Wish {
        cell_m: f64::from(cell_mm) / 1000.0,
        closes_loops: !args.no_loops,
        noise: args.noise,
    };
    if let Some(walls) = known {
        return locate(log, walls, &wish, &clock, &mut tell);
    }
    let mode = match mode {
        ModeArg::Graph => return tour(log, &wish, &clock, &mut tell),
        ModeArg::Core => Mode::Core,
        ModeArg::Seed => Mode::Document,
    };
    let settings = Settings {
        seed: args.seed,
        ..settings(mode, cell_mm)
    };
    survey(log, settings, &clock, &mut tell)
}

fn print(timing: &folder::Timing<'_>) {
    println!(
        "{} scans, {} skipped, {} doubtful, {} ambiguous; {} mm cells",
        timing.scans, timing.skipped, timing.doubtful, timing.ambiguous, timing.cell_mm
    );
    if timing.mode == ModeArg::Graph.name() {
        println!(
            "{} keyframes, {} places seen again",
            timing.keyframes, timing.loop_edges
        );
    }
    let cpu = timing
        .cpu_s
        .map_or("unknown".to_owned(), |s| format!("{s:.3} s"));
    let (median, longest) = (timing.scan_median_us, timing.scan_longest_us);
    println!("processor time {cpu}; a scan {median:.0} us in the median, {longest:.0} us at most");
}

/// Prints where the map may be wrong.
fn warn(result: &Survey, path: &Path) {
    let path = path.display();
    for warning in result.warnings() {
        eprintln!("{path}: warning: {}", warning.words());
    }
    let farthest = result
        .jumps
        .iter()
        .max_by(|a, b| a.far_m.total_cmp(&b.far_m));
    if let Some(Jump { at_s, far_m, .. }) = farthest {
        let count = result.jumps.len();
        eprintln!(
            "{path}: jumps against the odometry: {count}, the farthest {far_m:.2} m at {at_s} s"
        );
    }
    if result.outside > 0 {
        eprintln!(
            "{path}: {} scans lie outside the map; increase --cell-mm",
            result.outside
        );
    }
    if result.dropped_loops > 0 {
        let count = result.dropped_loops;
        eprintln!("{path}: {count} loop closures were removed, because all others contradict them");
    }
    let poor = result.poor();
    if poor > 0 {
        eprintln!("{path}: {poor} scans have less than half of their readings on known walls");
    }
}

fn print_findings(log: &Log, path: &Path) {
    let path = path.display();
    for told in log.findings.told() {
        eprintln!("{path}: {told}");
    }
    for (kind, count) in log.findings.counts() {
        eprintln!("{path}: skipped {count} {}", kind.words());
    }
    if log.findings.absurd_readings > 0 {
        eprintln!(
            "{path}: skipped {} readings that are negative or not a number",
            log.findings.absurd_readings
        );
    }
}
