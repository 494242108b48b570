//! Export of captures to the formats of other tools.
//!
//! Bytes are written as they reached their receiver; lidar turns are written as far as they are
//! complete. The program's path and map are not on the wire: they come from a replay.

mod carmen;
mod csv;
#[cfg(feature = "mcap")]
mod mcap;
mod scans;
mod vcd;

use std::path::{Path, PathBuf};

use emulators::world::Pose;
use protocols::Instant;

use crate::Capture;
use crate::replay::{Recorded, Replay, ReplayError, Voice};
use engine::robots::KeptMap;
use engine::run::LOOK_EVERY;
use engine::scenario::{Scenario, Source};
use show::folder;
use show::render;

pub use carmen::Laser;

/// Export formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Format {
    /// Every record as a row, with bytes in hex (.csv)
    Csv,
    /// The lines as a logic analyzer would see them, bit by bit (.vcd)
    Vcd,
    /// Bytes, lidar turns, the believed path and map, for Foxglove and similar tools (.mcap)
    #[cfg(feature = "mcap")]
    Mcap,
    /// Lidar turns with the believed poses, for mappers (.log, .carmen)
    Carmen,
    /// The believed path, eight columns (.tum)
    Tum,
    /// The believed map, with its picture beside it (.yaml)
    RosMap,
}

impl Format {
    /// The format for a file name extension.
    pub fn of(path: &Path) -> Option<Self> {
        Some(match path.extension()?.to_str()? {
            "csv" => Self::Csv,
            "vcd" => Self::Vcd,
            #[cfg(feature = "mcap")]
            "mcap" => Self::Mcap,
            "log" | "carmen" => Self::Carmen,
            "tum" => Self::Tum,
            "yaml" | "yml" => Self::RosMap,
            _ => return None,
        })
    }

    /// Whether the format holds only the program's believed pose or map.
    pub fn is_belief(self) -> bool {
        matches!(self, Self::Tum | Self::RosMap)
    }

    /// Whether the format holds only bytes.
    pub fn is_bytes(self) -> bool {
        matches!(self, Self::Csv | Self::Vcd)
    }
}

/// The program's pose and map.
#[derive(Clone, Debug, Default)]
pub struct Belief {
    /// The program's path; times begin with the capture.
    pub way: Vec<(Instant, Pose)>,
    /// Its map at the end.
    pub map: Option<KeptMap>,
}

impl Belief {
    /// Replays `recorded` and reads the program's pose every few milliseconds, as a run does. Long
    /// silences are shortened for the replay; the times of the path are still those of the capture.
    ///
    /// # Errors
    /// If the capture cannot be replayed.
    pub fn of(
        recorded: &Recorded,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Self, ReplayError> {
        let (recorded, silences) = recorded.clone().shortened();
        let mut replay = Replay::new(&recorded, scenario, source, Voice::Program)?;
        let mut way: Vec<(Instant, Pose)> = Vec::new();
        while !replay.is_over() {
            replay.run_for(LOOK_EVERY);
            if let Some((at, pose)) = replay.instruments().estimate(replay.rig())
                && let at = silences.captured_at(at)
                && way.last().is_none_or(|&(last, _)| last < at)
            {
                way.push((at, pose));
            }
        }
        let map = replay.instruments().map(replay.rig());
        Ok(Self {
            map: map.map(KeptMap::from),
            way,
        })
    }

    /// The program's pose at `at`: the last reported one, or the first.
    fn pose_at(&self, at: Instant) -> Option<Pose> {
        let behind = self.way.partition_point(|&(said, _)| said <= at);
        let entry = self.way.get(behind.saturating_sub(1))?;
        Some(entry.1)
    }
}

/// Input of an export.
#[derive(Clone, Copy)]
pub struct Export<'a> {
    /// The capture.
    pub capture: &'a Capture,
    /// The same capture, ready to be played.
    pub recorded: &'a Recorded,
    /// The program's pose and map, if the program is known.
    pub belief: Option<&'a Belief>,
    /// Layout of lidar turns in a CARMEN log.
    pub laser: Laser,
}

/// Error of an export.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The capture contains no data for the format.
    #[error("{0}")]
    Nothing(&'static str),
    /// The file could not be written.
    #[error("cannot write {path}: {1}", path = .0.display())]
    File(PathBuf, String),
}

impl Export<'_> {
    /// Writes `path` as `format` and returns a description of the content.
    ///
    /// # Errors
    /// If there is no data to write, or the file cannot be written.
    pub fn write(&self, format: Format, path: &Path) -> Result<String, ExportError> {
        let (bytes, words) = match format {
            Format::Csv => {
                let words = format!("{} records", self.capture.records.len());
                (csv::write(self).into_bytes(), words)
            }
            Format::Vcd => vcd::write(self),
            #[cfg(feature = "mcap")]
            Format::Mcap => mcap::write(self)
                .map_err(|error| ExportError::File(path.to_owned(), error.to_string()))?,
            Format::Carmen => carmen::write(self)?,
            Format::Tum => {
                let way = self.belief.map_or(&[][..], |belief| &belief.way);
                if way.is_empty() {
                    return Err(ExportError::Nothing(
                        "the program reported no believed pose",
                    ));
                }
                (
                    folder::tum(way).into_bytes(),
                    format!("{} poses", way.len()),
                )
            }
            Format::RosMap => self.map(path)?,
        };
        safefs::write(path, bytes)
            .map_err(|error| ExportError::File(path.to_owned(), error.to_string()))?;
        Ok(words)
    }

    fn map(&self, path: &Path) -> Result<(Vec<u8>, String), ExportError> {
        let map = self
            .belief
            .and_then(|belief| belief.map.as_ref().map(KeptMap::view));
        let map = map.ok_or(ExportError::Nothing("the program has no map"))?;
        let picture = path.with_extension("pgm");
        let name = picture.file_name().unwrap_or_default().to_string_lossy();
        let text = render::ros_yaml(map, &name);
        safefs::write(&picture, render::ros_image(map).pgm())
            .map_err(|error| ExportError::File(picture.clone(), error.to_string()))?;
        let words = format!("{} x {} cells, picture {name}", map.width(), map.height());
        Ok((text.into_bytes(), words))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_form_holds_bytes_or_beliefs_or_both() {
        let holds = |form: Format| (form.is_bytes(), form.is_belief());
        assert_eq!([Format::Csv, Format::Vcd].map(holds), [(true, false); 2]);
        assert_eq!([Format::Tum, Format::RosMap].map(holds), [(false, true); 2]);
        assert_eq!(holds(Format::Carmen), (false, false));
    }

    #[test]
    fn the_extension_of_a_file_tells_its_format() {
        for (name, expected) in [
            ("a.csv", Some(Format::Csv)),
            ("a.vcd", Some(Format::Vcd)),
            ("a.log", Some(Format::Carmen)),
            ("a.carmen", Some(Format::Carmen)),
            ("a.tum", Some(Format::Tum)),
            ("a.yaml", Some(Format::RosMap)),
            ("a.yml", Some(Format::RosMap)),
            ("a.txt", None),
            ("csv", None),
        ] {
            assert_eq!(Format::of(Path::new(name)), expected, "{name}");
        }
        #[cfg(feature = "mcap")]
        assert_eq!(Format::of(Path::new("a.mcap")), Some(Format::Mcap));
    }

    /// The last pose that was reported, or the first one.
    #[test]
    fn a_pose_holds_until_the_next_one() {
        let pose = |x| Pose {
            x,
            ..Pose::default()
        };
        let belief = Belief {
            way: [(10, 1.0), (20, 2.0)]
                .map(|(second, x)| (Instant::from_secs(second), pose(x)))
                .to_vec(),
            map: None,
        };
        let at = |second| {
            belief
                .pose_at(Instant::from_secs(second))
                .map(|pose| pose.x)
        };
        assert_eq!(
            [5, 10, 19, 20, 90].map(at),
            [1.0, 1.0, 1.0, 2.0, 2.0].map(Some)
        );
        assert!(Belief::default().pose_at(Instant::ZERO).is_none());
    }

    /// A format without its data is an error, and writes no file.
    #[test]
    fn a_format_without_data_is_refused() {
        let (capture, recorded) = (Capture::of(&[]), Recorded::default());
        let export = Export {
            capture: &capture,
            recorded: &recorded,
            belief: Some(&Belief::default()),
            laser: Laser::default(),
        };
        let folder = std::env::temp_dir().join(format!("hilrig-export-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder for files");
        for (format, words) in [
            (Format::Tum, "the program reported no believed pose"),
            (Format::RosMap, "the program has no map"),
            (Format::Carmen, "no link carries a lidar's turns"),
        ] {
            let path = folder.join("nothing");
            let error = export.write(format, &path).expect_err(words);
            assert_eq!(error.to_string(), words);
            assert!(!path.exists(), "{words}");
        }
        assert!(export.map(Path::new("a.yaml")).is_err() && carmen::write(&export).is_err());
        let path = folder.join("a.csv");
        let words = export.write(Format::Csv, &path).expect("written");
        let text = std::fs::read_to_string(&path).expect("readable");
        std::fs::remove_dir_all(&folder).expect("removed");
        assert_eq!(words, "0 records");
        assert_eq!(text, "time_s,link,direction,event,bytes,comment\r\n");
    }
}
