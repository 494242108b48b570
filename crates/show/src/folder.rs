//! The result folder: all files of a finished run, for the user, for CI and for other tools.

use core::fmt::Write as _;
use core::time::Duration;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use emulators::world::Pose;
use protocols::Instant;
use serde::Serialize;

pub use crate::metrics::Metrics;
pub use crate::metrics::factor;
use crate::render;
use crate::report;
use engine::TOOL;
use engine::picture::Picture;
use engine::robots::KeptMap;
use engine::run::Outcome;
use engine::run::check::{Check, Status};
use safefs::Dir;

/// `result.json`.
#[derive(Clone, Debug, Serialize)]
pub struct ResultFile<'a> {
    /// Name of the tool.
    pub tool: &'a str,
    /// Its version.
    pub version: &'a str,
    /// Name of the scenario.
    pub scenario: &'a str,
    /// Seed of the run.
    pub seed: u64,
    /// `pass` or `fail`.
    pub verdict: Status,
    /// All verdicts.
    pub checks: &'a [Check],
    /// The probable cause, if the foreign program failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probable_cause: Option<&'a str>,
    /// Figures of the run.
    pub metrics: Metrics,
    /// The program's own counters.
    pub counters: &'a BTreeMap<&'static str, u64>,
    /// Fingerprint of all bytes on all lines.
    pub trace_hash: &'a str,
    /// Fingerprint of the program's map.
    pub map_hash: Option<String>,
}

/// Error when a file of the result folder cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", .path.display())]
pub struct FolderError {
    /// Path of the file.
    pub path: PathBuf,
    /// Cause of the error.
    pub source: io::Error,
}

/// A result folder that is being written.
#[derive(Debug)]
pub struct Folder(Dir);

impl Folder {
    /// Opens the folder at `path` and creates it if it is missing.
    pub fn at(path: &Path) -> Result<Self, FolderError> {
        Ok(Self(Dir::create(path).map_err(failed(path))?))
    }

    /// Writes a file.
    pub fn put(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<(), FolderError> {
        let written = self.0.write(name, bytes);
        written.map_err(failed(&self.0.path().join(name)))
    }

    /// The folder of the further robot `name` in it.
    fn member(&self, name: &str) -> Result<Self, FolderError> {
        let path = Path::new("team").join(name);
        let below = self.0.below(&path);
        below.map(Self).map_err(failed(&self.0.path().join(path)))
    }

    /// Writes a picture as PNG.
    pub fn picture(&self, name: &str, picture: &Picture) -> Result<(), FolderError> {
        let written = picture.png().and_then(|png| self.0.write(name, png));
        written.map_err(failed(&self.0.path().join(name)))
    }
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> FolderError {
    let path = path.to_owned();
    move |source| FolderError { path, source }
}

/// The result folder of the further robot `name`, in `dir`, that of the whole run; created if
/// missing.
///
/// # Errors
/// If it cannot be created, or if a link leads out of `dir`.
pub fn of_member(dir: &Path, name: &str) -> Result<PathBuf, FolderError> {
    Ok(Folder::at(dir)?.member(name)?.0.path().to_owned())
}

/// Writes all files of `outcome`, a run that took `wall`, into `dir`, which is created if missing.
/// Each further robot has a folder of its own in it.
pub fn write(dir: &Path, outcome: &Outcome, wall: Duration) -> Result<(), FolderError> {
    let folder = Folder::at(dir)?;
    folder.put("case.toml", outcome.case.to_toml())?;
    for (name, member) in &outcome.team {
        write_robot(&folder.member(name)?, member, wall)?;
    }
    write_robot(&folder, outcome, wall)
}

/// Writes the files about one robot.
fn write_robot(folder: &Folder, outcome: &Outcome, wall: Duration) -> Result<(), FolderError> {
    folder.put("result.json", result_json(outcome, wall))?;
    folder.put("report.html", report::html(outcome))?;
    folder.put("events.txt", events(outcome))?;
    folder.put("true.tum", tum(&outcome.truth))?;
    let estimate: Vec<_> = outcome
        .pairs
        .iter()
        .map(|pair| (pair.at, pair.estimate))
        .collect();
    folder.put("estimate.tum", tum(&estimate))?;
    #[cfg(feature = "junit")]
    folder.put("junit.xml", crate::junit::junit([outcome.into()], wall))?;
    for (name, words) in &outcome.node_words {
        folder.put(&format!("node-{name}.log"), words)?;
    }
    if let Some(display) = &outcome.display {
        folder.picture("display.png", display)?;
    }
    let Some(map) = outcome.map.as_ref().map(KeptMap::view) else {
        return Ok(());
    };
    let robot = outcome.truth.last().map(|&(_, pose)| pose);
    folder.put("map.txt", render::text(map, 5, robot))?;
    folder.put("map.yaml", render::ros_yaml(map, "map.pgm"))?;
    folder.put("map.pgm", render::ros_image(map).pgm())?;
    let truth: Vec<Pose> = outcome.truth.iter().map(|&(_, pose)| pose).collect();
    let believed: Vec<Pose> = estimate.iter().map(|&(_, pose)| pose).collect();
    folder.picture("map.png", &render::picture(map, &truth, &believed))
}

fn result_json(outcome: &Outcome, wall: Duration) -> String {
    let map = outcome.map.as_ref().map(KeptMap::view);
    let file = ResultFile {
        tool: TOOL,
        version: env!("CARGO_PKG_VERSION"),
        scenario: &outcome.case.name,
        seed: outcome.seed,
        verdict: Status::of(outcome.passed()),
        checks: &outcome.checks,
        probable_cause: outcome.probable_cause.as_deref(),
        metrics: Metrics::of(outcome, wall),
        counters: &outcome.counters,
        trace_hash: &outcome.trace_hash,
        map_hash: map.map(|map| engine::rig::trace::fingerprint(map.cells())),
    };
    let mut text = serde_json::to_string_pretty(&file).expect("plain data with string keys");
    text.push('\n');
    text
}

fn events(outcome: &Outcome) -> String {
    let lines = outcome.events.iter().map(|logged| format!("{logged}\n"));
    lines.collect()
}

/// A trajectory in TUM form: seconds, position, orientation as a quaternion; eight columns.
pub fn tum(way: &[(Instant, Pose)]) -> String {
    let mut out = String::from("# timestamp tx ty tz qx qy qz qw\n");
    for (at, pose) in way {
        let half = pose.theta / 2.0;
        let (qz, qw) = (libm::sin(half), libm::cos(half));
        let line = format_args!("{at} {:.6} {:.6} 0 0 0 {qz:.9} {qw:.9}\n", pose.x, pose.y);
        out.write_fmt(line).expect("a string takes everything");
    }
    out
}
