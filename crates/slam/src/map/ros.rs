//! Maps in the format of ROS's map server: a picture, and a yaml file with its scale.

use std::path::{Path, PathBuf};

use firmware_core::map_view::MapView;

use engine::picture::{Picture, PictureError};

/// The state of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellState {
    /// Unknown space.
    Unknown,
    /// Free space.
    Free,
    /// Part of a wall.
    Wall,
}

/// A map in metres, lowest row first.
#[derive(Clone, Debug, PartialEq)]
pub struct RosMap {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Edge of a cell, metres.
    pub cell_m: f64,
    /// Lower left corner, metres.
    pub origin: [f64; 2],
    cells: Vec<CellState>,
}

/// The reason why a map cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: {what}", .path.display())]
pub struct MapError {
    /// The file.
    pub path: PathBuf,
    /// The error and the expected content.
    pub what: String,
}

/// Maximum number of cells of a map that is read.
const CELLS_MAX: usize = 64 << 20;

impl RosMap {
    /// A map of these cells, row by row from the lowest.
    pub fn new(width: usize, cell_m: f64, origin: [f64; 2], cells: Vec<CellState>) -> Self {
        assert!(width > 0 && cells.len().is_multiple_of(width), "whole rows");
        Self {
            width,
            height: cells.len() / width,
            cell_m,
            origin,
            cells,
        }
    }

    /// The robot's map as [`show::render::ros_image`] renders it.
    pub fn of_grid(grid: MapView<'_>) -> Self {
        let cell_m = f64::from(grid.cell_mm()) / 1000.0;
        Self::from_image(
            &show::render::ros_image(grid),
            &Header {
                cell_m,
                origin: grid.origin_mm().map(|mm| f64::from(mm) / 1000.0),
                ..Header::default()
            },
        )
    }

    /// Reads `path`: the yaml file, or a folder with a `map.yaml`.
    pub fn read(path: &Path) -> Result<Self, MapError> {
        let (path, read) = if path.is_dir() {
            let path = path.join("map.yaml");
            let read = safefs::read_text(&path);
            (path, read)
        } else {
            (path.to_owned(), std::fs::read_to_string(path))
        };
        let fail = |path: &Path, what: String| MapError {
            path: path.to_owned(),
            what,
        };
        let text = read.map_err(|error| {
            fail(
                &path,
                format!("cannot be read: {error}; expected a map.yaml or a folder with one"),
            )
        })?;
        let header = Header::parse(&text).map_err(|what| fail(&path, what))?;
        let image = path.parent().unwrap_or(Path::new("")).join(&header.image);
        safefs::open(&image).map_err(|error| fail(&image, format!("cannot be read: {error}")))?;
        let picture = Picture::read(&image, CELLS_MAX).map_err(|error| {
            let what = match error {
                PictureError::Open(error) => format!("cannot be read: {error}"),
                PictureError::Size { width, height } => {
                    let cells = width.saturating_mul(height);
                    format!("has {cells} cells, expected 1 to {CELLS_MAX}")
                }
                error => format!("is no picture: {error}"),
            };
            fail(&image, what)
        })?;
        Ok(Self::from_image(&picture, &header))
    }

    fn from_image(image: &Picture<u8>, header: &Header) -> Self {
        let cells = image.from_below().map(|gray| header.seen(gray)).collect();
        Self::new(image.width(), header.cell_m, header.origin, cells)
    }

    /// The cell at a column and row.
    pub fn cell(&self, x: usize, y: usize) -> Option<CellState> {
        (x < self.width && y < self.height).then(|| self.cells[y * self.width + x])
    }

    /// The centre of a cell, metres.
    #[expect(clippy::cast_possible_truncation, reason = "metres of a building")]
    pub(super) fn middle(&self, x: usize, y: usize) -> [f32; 2] {
        let [x0, y0] = self.origin;
        [(x, x0), (y, y0)].map(|(cell, from)| (from + (cell as f64 + 0.5) * self.cell_m) as f32)
    }

    /// The cell at a position in metres; unknown outside the map.
    pub fn at(&self, [x, y]: [f64; 2]) -> CellState {
        let index = |metres: f64, origin: f64| ((metres - origin) / self.cell_m).floor();
        let (x, y) = (index(x, self.origin[0]), index(y, self.origin[1]));
        if !(x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64) {
            return CellState::Unknown;
        }
        #[expect(clippy::cast_possible_truncation, reason = "whole and on the map")]
        #[expect(clippy::cast_sign_loss, reason = "not negative")]
        let (x, y) = (x as usize, y as usize);
        self.cells[y * self.width + x]
    }

    /// The centres of all cells of the kind `what`, metres.
    pub fn all(&self, what: CellState) -> impl Iterator<Item = [f64; 2]> + '_ {
        let cells = self.cells.iter().enumerate();
        cells
            .filter(move |(_, seen)| **seen == what)
            .map(|(index, _)| {
                let (x, y) = (index % self.width, index / self.width);
                [
                    self.origin[0] + (x as f64 + 0.5) * self.cell_m,
                    self.origin[1] + (y as f64 + 0.5) * self.cell_m,
                ]
            })
    }
}

/// The content of the yaml file.
#[derive(Clone, Debug)]
struct Header {
    image: String,
    cell_m: f64,
    origin: [f64; 2],
    is_negated: bool,
    occupied: f64,
    free: f64,
}

impl Default for Header {
    fn default() -> Self {
        Self {
            image: String::new(),
            cell_m: 0.0,
            origin: [0.0; 2],
            is_negated: false,
            occupied: 0.65,
            free: 0.196,
        }
    }
}

impl Header {
    /// The map server's files are flat: one `key: value` per line.
    fn parse(text: &str) -> Result<Self, String> {
        let mut header = Self::default();
        for (number, line) in (1..).zip(text.lines()) {
            let Some((key, value)) = line.split_once(':') else {
                continue;
            };
            let value = value.split(" #").next().unwrap_or("").trim();
            let value = value.trim_matches(['"', '\'']);
            let wrong = |expected: &str| {
                let key = key.trim();
                format!("line {number}: {key} is \"{value}\", expected {expected}")
            };
            let positive = || {
                let parsed = value.parse::<f64>().ok();
                parsed.filter(|value| value.is_finite() && *value > 0.0)
            };
            match key.trim() {
                "image" => header.image = value.to_owned(),
                "resolution" => {
                    header.cell_m = positive().ok_or_else(|| wrong("metres a cell"))?;
                }
                "origin" => header.origin = origin(value).map_err(wrong)?,
                "negate" => header.is_negated = !matches!(value, "0" | "false"),
                "occupied_thresh" => {
                    header.occupied = positive().ok_or_else(|| wrong("a number from 0 to 1"))?;
                }
                "free_thresh" => {
                    header.free = positive().ok_or_else(|| wrong("a number from 0 to 1"))?;
                }
                _ => {}
            }
        }
        match (header.image.is_empty(), header.cell_m > 0.0) {
            (true, _) => Err("has no image, expected a map server's yaml file".to_owned()),
            (_, false) => Err("has no resolution, expected metres a cell".to_owned()),
            _ => Ok(header),
        }
    }

    fn seen(&self, gray: u8) -> CellState {
        let part = f64::from(gray) / 255.0;
        let occupied = if self.is_negated { part } else { 1.0 - part };
        if occupied > self.occupied {
            CellState::Wall
        } else if occupied < self.free {
            CellState::Free
        } else {
            CellState::Unknown
        }
    }
}

fn origin(value: &str) -> Result<[f64; 2], &'static str> {
    let numbers: Vec<f64> = value
        .trim_matches(['[', ']'])
        .split(',')
        .filter_map(|part| part.trim().parse().ok())
        .collect();
    match numbers[..] {
        [x, y] if x.is_finite() && y.is_finite() => Ok([x, y]),
        [x, y, turn] if x.is_finite() && y.is_finite() && turn.abs() < 1e-9 => Ok([x, y]),
        [_, _, _] => Err("[x, y, 0]: turned maps are not read"),
        _ => Err("[x, y, 0] in metres"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gray values of the map server's own tools: 0, 254, 205 are wall, free, unknown; 205 is an
    /// occupancy of 0.196.
    #[test]
    fn grays_mean_what_the_map_server_means() {
        let header =
            Header::parse("image: m.pgm\nresolution: 0.05\norigin: [-1, 2.5, 0.0]\nnegate: 0\n")
                .expect("sound");
        assert_eq!(
            [0, 254, 205].map(|gray| header.seen(gray)),
            [CellState::Wall, CellState::Free, CellState::Unknown]
        );
        assert_eq!((header.origin, header.cell_m), ([-1.0, 2.5], 0.05));
    }

    #[test]
    fn bad_values_are_told_with_line_and_key() {
        let error = |text| Header::parse(text).expect_err("bad");
        assert_eq!(
            error("image: m.pgm\nresolution: no\n"),
            "line 2: resolution is \"no\", expected metres a cell"
        );
        assert!(error("resolution: 0.1\n").starts_with("has no image"));
        assert!(error("image: a\n").starts_with("has no resolution"));
        assert!(error("image: a\norigin: [0, 0, 1.5]\n").contains("turned maps"));
    }

    #[test]
    fn places_outside_the_map_are_unknown() {
        let map = RosMap::new(2, 0.5, [1.0, 1.0], vec![CellState::Wall; 4]);
        assert_eq!(map.at([1.9, 1.9]), CellState::Wall);
        for place in [[0.9, 1.2], [2.1, 1.2], [f64::NAN, 1.0]] {
            assert_eq!(map.at(place), CellState::Unknown);
        }
    }
}
