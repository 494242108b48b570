//! Earlier results that a run must resemble: `[expect.golden]`.

use std::path::{Path, PathBuf};

use emulators::world::Point;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Flaw;
use crate::picture::Picture;

/// Maximum number of pixels of a golden map.
const PIXELS_MAX: usize = 100_000_000;
/// Maximum distance of a wall, cells.
const CELLS_MAX: usize = 50;
/// Gray value of a wall in a map file.
const WALL: u8 = 0;

/// Files of an earlier run's result folder that the run must resemble, each with its tolerance.
/// Relative paths start at the folder of the scenario's file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GoldenSpec {
    /// True path of the earlier run: `true.tum` of its result folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<PathBuf>,
    /// With `path`: maximum distance of each of the two paths from the other, millimetres, at least
    /// 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path_within_mm: Option<f64>,
    /// Map of the earlier run: `map.pgm` of its result folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<PathBuf>,
    /// With `map`: minimum share of the wall cells of each map that the other one has, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_walls_min: Option<f64>,
    /// With `map`: maximum distance of a wall cell along x and y, cells, up to 50; 1 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_within_cells: Option<usize>,
}

/// Walls of a map: width, height, and whether each cell is a wall, row after row from the lowest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Walls {
    /// Cells of a row.
    pub width: usize,
    /// Whether each cell is a wall.
    pub cells: Vec<bool>,
}

impl GoldenSpec {
    /// Checks its keys and reads its files.
    ///
    /// # Errors
    /// A flaw that names the key.
    pub fn check(&self) -> Result<(), Flaw> {
        match (&self.path, self.path_within_mm) {
            (Some(_), Some(within)) if within.is_finite() && within >= 1.0 => {}
            (None, None) => {}
            (None, Some(_)) => {
                return Err(Flaw::new("path", "is missing, path_within_mm needs it"));
            }
            (Some(_), _) => {
                let message = "expected a number of millimetres, at least 1, as path is given";
                return Err(Flaw::new("path_within_mm", message));
            }
        }
        match (&self.map, self.map_walls_min) {
            (Some(_), Some(least)) if (0.0..=1.0).contains(&least) => {}
            (None, None) if self.map_within_cells.is_none() => {}
            (None, _) => {
                let message = "is missing, map_walls_min and map_within_cells need it";
                return Err(Flaw::new("map", message));
            }
            (Some(_), _) => {
                let message = "expected a share from 0 to 1, as map is given";
                return Err(Flaw::new("map_walls_min", message));
            }
        }
        if self.map_within_cells.is_some_and(|cells| cells > CELLS_MAX) {
            let message = format!("expected at most {CELLS_MAX} cells");
            return Err(Flaw::new("map_within_cells", message));
        }
        self.read_path()?;
        self.read_map().map(drop)
    }

    /// The golden path, if there is one.
    ///
    /// # Errors
    /// If the file cannot be read, or holds no path.
    pub fn read_path(&self) -> Result<Option<Vec<Point>>, Flaw> {
        let Some(path) = &self.path else {
            return Ok(None);
        };
        let wrong = |message: String| Flaw::new("path", format!("{}: {message}", path.display()));
        let text = std::fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
        let lines = (1..).zip(text.lines());
        let lines = lines.filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
        let points = lines.map(|(number, line)| {
            let mut words = line.split_whitespace().skip(1).map(str::parse::<f64>);
            match (words.next(), words.next()) {
                (Some(Ok(x)), Some(Ok(y))) if x.is_finite() && y.is_finite() => {
                    Ok(Point::new(x, y))
                }
                _ => Err(wrong(format!(
                    "line {number}: expected a time, x and y in metres"
                ))),
            }
        });
        let points: Vec<Point> = points.collect::<Result<_, _>>()?;
        match points.is_empty() {
            true => Err(wrong("has no poses, expected true.tum of a run".to_owned())),
            false => Ok(Some(points)),
        }
    }

    /// The walls of the golden map, if there is one.
    ///
    /// # Errors
    /// If the file cannot be read, or holds no map with walls.
    pub fn read_map(&self) -> Result<Option<Walls>, Flaw> {
        let Some(path) = &self.map else {
            return Ok(None);
        };
        let wrong = |message: String| Flaw::new("map", format!("{}: {message}", path.display()));
        let picture =
            Picture::<u8>::read(path, PIXELS_MAX).map_err(|error| wrong(error.to_string()))?;
        let cells: Vec<bool> = picture.from_below().map(|pixel| pixel == WALL).collect();
        match cells.contains(&true) {
            true => Ok(Some(Walls {
                width: picture.width(),
                cells,
            })),
            false => Err(wrong("has no walls, expected map.pgm of a run".to_owned())),
        }
    }

    /// Stores whole paths, so that a saved case finds the files.
    pub(super) fn embed(&mut self, base: &Path) {
        for path in [&mut self.path, &mut self.map].into_iter().flatten() {
            let whole = base.join(&*path);
            *path = std::path::absolute(&whole).unwrap_or(whole);
        }
    }
}
