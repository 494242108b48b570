//! Floor plans in the ROS map format: a yaml file that names a picture.

use std::path::Path;

use emulators::world::{OccupancyImage, Point};

use crate::picture::{Picture, PictureError};
use crate::scenario::Source;

/// The keys of the yaml file that matter here.
#[derive(Clone, Debug, PartialEq)]
struct MapYaml {
    image: String,
    resolution_m: f64,
    origin: [f64; 3],
    negate: bool,
    occupied_thresh: f64,
    free_thresh: f64,
}

/// A map that a robot's program saved.
#[cfg(feature = "robots")]
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SavedMap {
    /// Cells of a row.
    pub(crate) width: usize,
    /// Edge of a cell, metres.
    pub(crate) resolution_m: f64,
    /// Corner of least x and y, metres in the world's frame.
    pub(crate) origin_m: [f64; 2],
    /// Rows from the lowest; `None`: never seen, else whether the cell is a wall.
    pub(crate) cells: Vec<Option<bool>>,
}

/// Threshold of free cells if the file has none: that of ROS's map_saver.
const FREE_THRESH: f64 = 0.196;
/// Largest picture, in cells.
const CELLS_MAX: usize = 4_000_000;

/// Reads the plan `yaml`, a path relative to the scenario. The error is a sentence that names file
/// and key.
pub(crate) fn read(yaml: &str, source: &Source) -> Result<OccupancyImage, String> {
    let folder = source.path.parent().unwrap_or_else(|| ".".as_ref());
    let (map, picture) = load(&folder.join(yaml))?;
    let cells = picture.from_below();
    let cells = cells.map(|gray| map.cell(gray) == Some(true)).collect();
    Ok(OccupancyImage {
        width: picture.width(),
        height: picture.height(),
        resolution_m: map.resolution_m,
        origin: Point::new(map.origin[0], map.origin[1]),
        cells,
    })
}

/// Reads the saved map `yaml`. The error is a sentence that names file and key.
#[cfg(feature = "robots")]
pub(crate) fn read_saved(yaml: &Path) -> Result<SavedMap, String> {
    let (map, picture) = load(yaml)?;
    let [x_m, y_m, _] = map.origin;
    Ok(SavedMap {
        width: picture.width(),
        resolution_m: map.resolution_m,
        origin_m: [x_m, y_m],
        cells: picture.from_below().map(|gray| map.cell(gray)).collect(),
    })
}

/// Reads a yaml file and its picture.
fn load(path: &Path) -> Result<(MapYaml, Picture<u8>), String> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| format!("cannot read {}: {error}", path.display()))?;
    let map = parse_yaml(&text).map_err(|error| format!("{}: {error}", path.display()))?;
    let image_path = path
        .parent()
        .unwrap_or_else(|| ".".as_ref())
        .join(&map.image);
    let picture = Picture::<u8>::read(&image_path, CELLS_MAX).map_err(|error| {
        let path = image_path.display();
        match error {
            PictureError::Size { width, height } => {
                format!("{path} has {width} x {height} cells, at most {CELLS_MAX} allowed")
            }
            error => format!("cannot read {path}: {error}"),
        }
    })?;
    Ok((map, picture))
}

impl MapYaml {
    /// Whether a cell is a wall; `None` between both thresholds.
    fn cell(&self, gray: u8) -> Option<bool> {
        let gray = if self.negate { gray } else { 255 - gray };
        let darkness = f64::from(gray) / 255.0;
        let is_occupied = darkness > self.occupied_thresh;
        (is_occupied || darkness < self.free_thresh).then_some(is_occupied)
    }
}

/// The format is flat: one `key: value` a line. A yaml library would be the only user of yaml here.
fn parse_yaml(text: &str) -> Result<MapYaml, String> {
    let value = |key: &str| {
        text.lines()
            .filter_map(|line| line.split_once(':'))
            .find(|(name, _)| name.trim() == key)
            .map(|(_, value)| value.split(" #").next().unwrap_or_default().trim())
            .ok_or_else(|| format!("key `{key}` is missing"))
    };
    let number = |key: &str| {
        let text = value(key)?;
        let parsed = text.parse::<f64>().ok().filter(|number| number.is_finite());
        parsed.ok_or_else(|| format!("`{key}` is \"{text}\", expected a number"))
    };
    let resolution_m = number("resolution")?;
    if !(resolution_m > 0.0 && resolution_m < 10.0) {
        return Err(format!(
            "`resolution` is {resolution_m}, expected metres per cell, 0 to 10"
        ));
    }
    let origin = value("origin")?;
    let parts: Vec<f64> = origin
        .trim_matches(['[', ']'])
        .split(',')
        .filter_map(|part| part.trim().parse().ok())
        .filter(|part: &f64| part.is_finite())
        .collect();
    let origin = <[f64; 3]>::try_from(parts)
        .map_err(|_| format!("`origin` is \"{origin}\", expected [x, y, yaw]"))?;
    if origin[2] != 0.0 {
        return Err(format!("`origin` has yaw {}, expected 0", origin[2]));
    }
    Ok(MapYaml {
        image: value("image")?.trim_matches(['"', '\'']).to_owned(),
        resolution_m,
        origin,
        negate: matches!(value("negate")?, "1" | "true"),
        occupied_thresh: number("occupied_thresh")?,
        free_thresh: match value("free_thresh") {
            Ok(_) => number("free_thresh")?,
            Err(_) => FREE_THRESH,
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const YAML: &str = "image: flat.pgm\nresolution: 0.05 # m\norigin: [-1.0, 2.5, 0.0]\n\
        negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";

    #[test]
    fn the_keys_of_a_map_server_file_are_read() {
        let map = parse_yaml(YAML).expect("complete");
        assert_eq!((map.image.as_str(), map.resolution_m), ("flat.pgm", 0.05));
        assert_eq!(map.origin, [-1.0, 2.5, 0.0]);
        // 205 is unknown: 50 / 255 is 0.1961, a little more than the threshold of free cells.
        assert_eq!(
            [0, 205, 254].map(|gray| map.cell(gray)),
            [Some(true), None, Some(false)]
        );
    }

    #[test]
    fn what_is_missing_or_no_number_is_named() {
        let error = parse_yaml(&YAML.replace("resolution", "res")).expect_err("missing");
        assert_eq!(error, "key `resolution` is missing");
        let error = parse_yaml(&YAML.replace("0.65", "dark")).expect_err("no number");
        assert_eq!(error, "`occupied_thresh` is \"dark\", expected a number");
    }
}
