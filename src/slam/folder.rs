//! What a survey leaves behind: map, way and timing.

use std::path::Path;

use core::fmt::Write as _;

use serde::Serialize;

use super::Log;
use super::survey::{CELLS, Jump, Survey};
use crate::picture::Picture;
use crate::show::folder::{Folder, FolderError};

/// `timing.json`.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Timing<'a> {
    /// `core` or `seed`.
    pub mode: &'a str,
    /// Edge of a cell.
    pub cell_mm: f32,
    /// Scans mapped.
    pub scans: usize,
    /// Messages left out.
    pub skipped: u64,
    /// Scans at which the mapper was not sure.
    pub doubtful: usize,
    /// Scans at which it knew of several places.
    pub ambiguous: usize,
    /// Scans that the mapper put far from where the wheels had.
    pub jumps: &'a [Jump],
    /// Processor time of all scans, seconds.
    pub cpu_s: Option<f64>,
    /// Time of a scan: median, microseconds.
    pub scan_median_us: f64,
    /// Time of a scan: longest, microseconds.
    pub scan_longest_us: f64,
}

/// The figures of a survey.
pub(crate) fn timing<'a>(mode: &'a str, log: &Log, survey: &'a Survey) -> Timing<'a> {
    let [median, longest, _] = survey.times();
    Timing {
        mode,
        cell_mm: survey.grid.resolution_mm(),
        scans: survey.way.len(),
        skipped: log.findings.counts().map(|(_, count)| count).sum(),
        doubtful: survey.doubtful,
        ambiguous: survey.ambiguous,
        jumps: &survey.jumps,
        cpu_s: survey.cpu.map(|cpu| cpu.as_secs_f64()),
        scan_median_us: median.as_secs_f64() * 1e6,
        scan_longest_us: longest.as_secs_f64() * 1e6,
    }
}

/// Writes `map.png`, `map.pgm`, `map.yaml`, `trajectory.tum` and `timing.json` into `dir`, which
/// is made if need be.
pub(crate) fn write(dir: &Path, survey: &Survey, timing: &Timing<'_>) -> Result<(), FolderError> {
    let folder = Folder::at(dir)?;
    let frame = Frame::of(survey);
    folder.put("trajectory.tum", tum(survey))?;
    folder.put("map.yaml", frame.yaml(survey, "map.pgm"))?;
    let mut json = serde_json::to_string_pretty(timing).expect("plain data");
    json.push('\n');
    folder.put("timing.json", json)?;
    folder.put("map.pgm", frame.ros_image(survey).pgm())?;
    folder.picture("map.png", &frame.picture(survey))
}

/// The way in TUM form. Times keep nine digits, so that epoch times stay exact to the microsecond.
pub(crate) fn tum(survey: &Survey) -> String {
    let mut out = String::from("# timestamp tx ty tz qx qy qz qw\n");
    for (at_s, place) in &survey.way {
        let half = place.theta / 2.0;
        let (qz, qw) = (libm::sin(half), libm::cos(half));
        let (x, y) = (place.x, place.y);
        writeln!(out, "{at_s:.6} {x:.6} {y:.6} 0 0 0 {qz:.9} {qw:.9}")
            .expect("a string takes everything");
    }
    out
}

/// Cells around what was drawn.
const MARGIN: usize = 8;
/// A cell from which on it is wall, and up to which it is free.
const WALL: u8 = 190;
const FREE: u8 = 115;
/// Gray of an unknown cell in a ROS map.
const ROS_UNKNOWN: u8 = 205;

/// The part of the map that is shown: first column, first row, columns, rows.
struct Frame {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl Frame {
    fn of(survey: &Survey) -> Self {
        let [x0, x1, y0, y1] = survey.drawn().unwrap_or([0, CELLS - 1, 0, CELLS - 1]);
        let (x, y) = (x0.saturating_sub(MARGIN), y0.saturating_sub(MARGIN));
        let (x1, y1) = ((x1 + MARGIN).min(CELLS - 1), (y1 + MARGIN).min(CELLS - 1));
        Self {
            x,
            y,
            width: x1 - x + 1,
            height: y1 - y + 1,
        }
    }

    /// A picture of the frame, top row first, from each cell's value.
    fn image(&self, survey: &Survey, shade: impl Fn(u8) -> u8) -> Picture<u8> {
        let top = self.y + self.height - 1;
        Picture::from_fn(self.width, self.height, |x, y| {
            let value = survey.grid.get(self.x + x, top - y);
            shade(value.unwrap_or(127))
        })
    }

    fn ros_image(&self, survey: &Survey) -> Picture<u8> {
        self.image(survey, |value| match value {
            WALL.. => 0,
            ..FREE => 254,
            _ => ROS_UNKNOWN,
        })
    }

    /// The frame's lower left corner in the log's frame, and the edge of a cell; metres.
    fn origin(&self, survey: &Survey) -> [f64; 3] {
        let cell_m = f64::from(survey.grid.resolution_mm()) / 1000.0;
        let middle = CELLS as f64 / 2.0;
        let [x, y] = [self.x, self.y].map(|cell| (cell as f64 - middle) * cell_m);
        [x + survey.middle[0], y + survey.middle[1], cell_m]
    }

    fn yaml(&self, survey: &Survey, image: &str) -> String {
        let [x, y, cell_m] = self.origin(survey);
        crate::show::render::ros_yaml_at([x, y], cell_m, image)
    }

    /// The map, dark where it believes walls, with the way in red; small maps are enlarged.
    fn picture(&self, survey: &Survey) -> Picture {
        let scale = if self.width.max(self.height) < 800 {
            2
        } else {
            1
        };
        let gray = self.image(survey, |value| 255 - value);
        let mut image = Picture::from_fn(self.width * scale, self.height * scale, |x, y| {
            [gray.pixels()[y / scale * self.width + x / scale]; 3]
        });
        let [x0, y0, cell_m] = self.origin(survey);
        let pixel_m = cell_m / scale as f64;
        let height = image.height() as f64;
        for (_, place) in &survey.way {
            let (x, y) = ((place.x - x0) / pixel_m, height - (place.y - y0) / pixel_m);
            crate::show::render::dot(&mut image, x, y, [220, 40, 30]);
        }
        image
    }
}
