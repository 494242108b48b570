use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::answer::MapDifference;
use super::{CliError, Verdict, out};
use crate::show::folder::FolderError;
use crate::slam::map::diff::{Difference, Reach, diff, picture};
use crate::slam::map::{CellState, RosMap};

/// Compare maps.
#[derive(Debug, Args)]
pub(super) struct MapArgs {
    #[command(subcommand)]
    command: MapCommand,
}

#[derive(Debug, Subcommand)]
enum MapCommand {
    Diff(DiffArgs),
}

/// Compare two maps: distance of their walls, and walls that only one of them has.
///
/// Maps have the format of ROS's map server: a yaml file and its picture, or a folder with a
/// map.yaml as `hilrig run --out` and `hilrig slam` write it. Exit code 1 if a tolerance is
/// exceeded.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig map diff before/ after/ --picture diff.png\n  \
    hilrig map diff nav2.yaml out/map.yaml --wall-mm-max 30 --overlap-min 0.9")]
struct DiffArgs {
    /// The first map
    #[arg(value_name = "A")]
    first: PathBuf,
    /// The second map, which is aligned to the first
    #[arg(value_name = "B")]
    second: PathBuf,
    /// Maximum shift of B against A, metres to each side; 0 compares the maps without alignment
    #[arg(long, value_name = "M", default_value_t = 0.5)]
    reach_m: f64,
    /// Maximum rotation of B against A, degrees to each side
    #[arg(long, value_name = "DEG", default_value_t = 10.0)]
    reach_deg: f64,
    /// Write a picture: walls of A only in blue, of B only in red
    #[arg(long, value_name = "PNG")]
    picture: Option<PathBuf>,
    /// Fail if the mean distance of the walls is larger
    #[arg(long, value_name = "MM")]
    wall_mm_max: Option<f64>,
    /// Fail if a smaller share of either map's walls is in the other
    #[arg(long, value_name = "PART")]
    overlap_min: Option<f64>,
}

pub(super) fn run(args: MapArgs) -> Result<Verdict, CliError> {
    let MapCommand::Diff(args) = args.command;
    let reach = reach(&args)?;
    let (first, second) = (RosMap::read(&args.first)?, RosMap::read(&args.second)?);
    let Some(found) = diff(&first, &second, reach) else {
        let walls = |map: &RosMap| map.all(CellState::Wall).count();
        return Err(CliError::Usage(format!(
            "{} has {} wall cells, {} has {}: nothing to compare",
            args.first.display(),
            walls(&first),
            args.second.display(),
            walls(&second)
        )));
    };
    print(&found);
    out::answer(&MapDifference {
        shift_mm: [found.shift.x, found.shift.y].map(|m| m * 1000.0),
        turn_deg: found.shift.theta.to_degrees(),
        wall_error_mm: found.wall_error_mm,
        wall_error_95_mm: found.wall_error_95_mm,
        first_in_second: found.first_in_second,
        second_in_first: found.second_in_first,
        alike: found.alike,
    });
    if let Some(path) = &args.picture {
        let image = picture(&first, &second, &found);
        let written = image.png().and_then(|png| safefs::write(path, png));
        written.map_err(|source| FolderError {
            path: path.clone(),
            source,
        })?;
        println!("picture in {}", path.display());
    }
    Ok(judge(&args, &found))
}

fn reach(args: &DiffArgs) -> Result<Reach, CliError> {
    let wrong = |flag: &str, value: f64, expected: &str| {
        CliError::Usage(format!("{flag} {value}: expected {expected}"))
    };
    if !(0.0..=10.0).contains(&args.reach_m) {
        return Err(wrong("--reach-m", args.reach_m, "0 to 10 metres"));
    }
    if !(0.0..=45.0).contains(&args.reach_deg) {
        return Err(wrong("--reach-deg", args.reach_deg, "0 to 45 degrees"));
    }
    let turn = if args.reach_m > 0.0 {
        args.reach_deg.to_radians()
    } else {
        0.0
    };
    Ok(Reach {
        shift_m: args.reach_m,
        turn,
    })
}

fn print(found: &Difference) {
    println!(
        "B moved by {:.1} mm, {:.1} mm, {:.2} deg",
        found.shift.x * 1000.0,
        found.shift.y * 1000.0,
        found.shift.theta.to_degrees()
    );
    println!(
        "wall error {:.1} mm in the mean, {:.1} mm for 95 %",
        found.wall_error_mm, found.wall_error_95_mm
    );
    println!(
        "overlap {:.3} of A's walls in B, {:.3} of B's in A; {:.3} of the cells alike",
        found.first_in_second, found.second_in_first, found.alike
    );
}

fn judge(args: &DiffArgs, found: &Difference) -> Verdict {
    let mut verdict = Verdict::Pass;
    if let Some(most) = args.wall_mm_max
        && found.wall_error_mm > most
    {
        println!("FAIL wall error {:.1} mm > {most} mm", found.wall_error_mm);
        verdict = Verdict::Fail;
    }
    if let Some(least) = args.overlap_min
        && found.overlap() < least
    {
        println!("FAIL overlap {:.3} < {least}", found.overlap());
        verdict = Verdict::Fail;
    }
    verdict
}
