//! The result folder of a survey: map, path and timing.

use std::path::Path;

use core::fmt::Write as _;

use crate::mapping::{Graph, Kind, Sheet};
use emulators::world::Pose;
use serde::Serialize;

use super::Log;
use super::look::Jump;
use super::map::pcd;
use super::survey::Survey;
use super::trust::Warning;
use engine::picture::Picture;
use show::folder::{Folder, FolderError};

/// The content of `timing.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Timing<'a> {
    /// `graph`, `core` or `seed`; `map` if the path was located on an existing map.
    pub mode: &'a str,
    /// Edge of a cell, millimetres.
    pub cell_mm: f64,
    /// Number of mapped scans.
    pub scans: usize,
    /// Number of skipped messages.
    pub skipped: u64,
    /// Number of scans with an uncertain pose.
    pub doubtful: usize,
    /// Number of scans that matched several places.
    pub ambiguous: usize,
    /// Scans for which the mapper's pose is far from the odometry.
    pub jumps: &'a [Jump],
    /// Number of loop closures: edges between keyframes that are not neighbours.
    pub loop_edges: usize,
    /// Number of loop closures that were removed because all other data contradicted them.
    pub dropped_loops: usize,
    /// Number of parts of the map that were not joined; 1 if the map is connected. `null` if the
    /// mapper does not close loops.
    pub parts: Option<usize>,
    /// Share of the path that only scan matching confirms, 0 to 1; 1 if the map has several parts.
    /// `null` if the mapper does not close loops, or the log has no odometry.
    pub doubt: Option<f64>,
    /// 95 % bound of the mean distance between trajectory and truth after the best rigid alignment,
    /// metres. `null` if the mapper does not close loops, or parts of the map were not joined, or a
    /// join is unsure.
    pub error_m: Option<f64>,
    /// Mean distance between the trajectory and that of the odometry alone after the best rigid
    /// alignment, metres.
    pub from_odometry_m: Option<f64>,
    /// Reasons why the map may be wrong: `parts`, `joins`, `error`, `odometry`.
    pub warnings: Vec<&'static str>,
    /// Number of keyframes.
    pub keyframes: usize,
    /// Number of scans of which less than half lies on known walls.
    pub poor: usize,
    /// Processor time of all scans, seconds.
    pub cpu_s: Option<f64>,
    /// Median processing time of a scan, microseconds.
    pub scan_median_us: f64,
    /// Maximum processing time of a scan, microseconds.
    pub scan_longest_us: f64,
}

/// The figures of a survey.
pub fn timing<'a>(mode: &'a str, log: &Log, survey: &'a Survey) -> Timing<'a> {
    let [median, longest, _] = survey.times();
    Timing {
        mode,
        // Rounded to whole micrometres, to show the requested value without rounding errors of
        // metres.
        cell_mm: libm::round(1e6 * survey.map.cell_m) / 1000.0,
        scans: survey.way.len(),
        skipped: log.findings.counts().map(|(_, count)| count).sum(),
        doubtful: survey.doubtful,
        ambiguous: survey.ambiguous,
        jumps: &survey.jumps,
        loop_edges: survey.loop_edges(),
        dropped_loops: survey.dropped_loops,
        parts: survey.parts,
        doubt: survey.doubt,
        error_m: survey.accuracy.as_ref().map(|known| known.bound_m),
        from_odometry_m: survey
            .accuracy
            .as_ref()
            .and_then(|known| known.from_wheels_m),
        warnings: survey.warnings().into_iter().map(Warning::name).collect(),
        keyframes: survey.graph.poses.len(),
        poor: survey.poor(),
        cpu_s: survey.cpu.map(|cpu| cpu.as_secs_f64()),
        scan_median_us: median.as_secs_f64() * 1e6,
        scan_longest_us: longest.as_secs_f64() * 1e6,
    }
}

/// The new results of a survey.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum News {
    /// Map and path.
    Map,
    /// The path on an existing map.
    Way,
}

/// Writes `map.png`, `trajectory.tum` and `timing.json` into `dir`, which is created if necessary.
/// Also writes `map.pgm` and `map.yaml` of a new map, `scans.csv` if the mapper closes loops, and
/// `graph.g2o` and `walls.pcd` of its map.
pub fn write(
    dir: &Path,
    survey: &Survey,
    timing: &Timing<'_>,
    news: News,
) -> Result<(), FolderError> {
    let folder = Folder::at(dir)?;
    let map = &survey.map;
    folder.put("trajectory.tum", tum(survey))?;
    let has_sureness = !survey.sureness.is_empty();
    if has_sureness {
        folder.put("scans.csv", sureness(survey))?;
    }
    if has_sureness && news == News::Map {
        folder.put("graph.g2o", g2o(&survey.graph))?;
        folder.put("walls.pcd", pcd::text(&survey.walls))?;
    }
    let mut json = serde_json::to_string_pretty(timing).expect("plain data");
    json.push('\n');
    folder.put("timing.json", json)?;
    if news == News::Map {
        let yaml = show::render::ros_yaml_at(map.corner, map.cell_m, "map.pgm");
        folder.put("map.yaml", yaml)?;
        folder.put("map.pgm", ros_image(map).pgm())?;
    }
    folder.picture("map.png", &picture(survey))
}

/// The path in TUM format. Times have nine decimals, so that epoch times are exact to the
/// microsecond.
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

/// Minimum value of a wall cell, and maximum value of a free cell.
const WALL: u8 = 190;
const FREE: u8 = 115;
/// Gray of an unknown cell in a ROS map.
const ROS_UNKNOWN: u8 = 205;

/// A picture of the map, top row first; `shade` converts each cell.
fn image(map: &Sheet, shade: impl Fn(u8) -> u8) -> Picture<u8> {
    Picture::from_fn(map.width, map.height, |x, y| {
        shade(map.cells[(map.height - 1 - y) * map.width + x])
    })
}

fn ros_image(map: &Sheet) -> Picture<u8> {
    image(map, |value| match value {
        WALL.. => 0,
        ..FREE => 254,
        _ => ROS_UNKNOWN,
    })
}

/// The map with dark walls and the path in red; small maps are enlarged.
fn picture(survey: &Survey) -> Picture {
    let map = &survey.map;
    let scale = if map.width.max(map.height) < 800 {
        2
    } else {
        1
    };
    let gray = image(map, |value| 255 - value);
    let mut image = Picture::from_fn(map.width * scale, map.height * scale, |x, y| {
        [gray.pixels()[y / scale * map.width + x / scale]; 3]
    });
    let pixel_m = map.cell_m / scale as f64;
    let height = image.height() as f64;
    for (_, place) in &survey.way {
        let x = (place.x - map.corner[0]) / pixel_m;
        let y = height - (place.y - map.corner[1]) / pixel_m;
        show::render::dot(&mut image, x, y, [220, 40, 30]);
    }
    image
}

/// Poses and edges in g2o format: `VERTEX_SE2 number x y heading`, `EDGE_SE2 from to x y heading`
/// and the upper half of the information matrix, in metres and radians. The systematic error of the
/// odometry is removed from its edges.
fn g2o(graph: &Graph) -> String {
    let mut out = String::new();
    for (number, pose) in graph.poses.iter().enumerate() {
        let Pose { x, y, theta } = pose;
        writeln!(out, "VERTEX_SE2 {number} {x:.6} {y:.6} {theta:.9}").expect(ENDLESS);
    }
    for edge in &graph.edges {
        let (from, to, Pose { x, y, theta }) = (edge.from, edge.to, graph.told(edge));
        if edge.kind == Kind::Unknown {
            writeln!(out, "# The motion from {from} to {to} is unknown.").expect(ENDLESS);
            continue;
        }
        let [[xx, xy, xt], [_, yy, yt], [_, _, tt]] = edge.information;
        write!(out, "EDGE_SE2 {from} {to} {x:.6} {y:.6} {theta:.9}").expect(ENDLESS);
        writeln!(out, " {xx:.3} {xy:.3} {xt:.3} {yy:.3} {yt:.3} {tt:.3}").expect(ENDLESS);
    }
    out
}

/// The uncertainty of each scan's pose, first relative to the recent walls, then to the whole map
/// laid over the truth; and the part of the map that it belongs to.
fn sureness(survey: &Survey) -> String {
    let head = "at_s,x_m,y_m,heading_rad,quality,sigma_x_m,sigma_y_m,sigma_heading_rad,doubtful,\
                part,map_sigma_x_m,map_sigma_y_m,map_sigma_heading_rad\n";
    let known = survey.accuracy.as_ref();
    let mut out = String::from(head);
    for (scan, ((at_s, place), sure)) in survey.way.iter().zip(&survey.sureness).enumerate() {
        let part = survey.scan_parts.get(scan).map(usize::to_string);
        let part = part.unwrap_or_default();
        let Pose { x, y, theta } = place;
        let [sx, sy, st] = sure.deviation;
        let (quality, doubtful) = (sure.quality, u8::from(sure.is_doubtful));
        write!(out, "{at_s:.6},{x:.6},{y:.6},{theta:.6},{quality:.3},").expect(ENDLESS);
        write!(out, "{sx:.4},{sy:.4},{st:.5},{doubtful},{part},").expect(ENDLESS);
        let whole = known.and_then(|known| known.covariances.get(scan));
        let words = whole.map(|whole| {
            let [x, y, t] = [0, 1, 2].map(|axis: usize| libm::sqrt(whole[axis][axis].max(0.0)));
            format!("{x:.4},{y:.4},{t:.5}")
        });
        writeln!(out, "{}", words.as_deref().unwrap_or(",,")).expect(ENDLESS);
    }
    out
}

/// Writing to a string never fails.
const ENDLESS: &str = "a string takes everything";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::Edge;

    /// Odometry of 2 m with an error of 0.1 rad per metre: the corrected edge is turned by 0.2 rad
    /// along a chord at 0.1 rad. An unknown motion has no edge.
    #[test]
    fn edges_are_written_as_the_poses_agree_with_them() {
        for (kind, line) in [
            (
                Kind::Way,
                "EDGE_SE2 0 1 2.000000 0.000000 0.000000000 1.000",
            ),
            (
                Kind::Wheels,
                "EDGE_SE2 0 1 1.990008 0.199667 0.200000000 1.000",
            ),
            (Kind::Unknown, "# The motion from 0 to 1 is unknown."),
        ] {
            let mut graph = Graph::default();
            graph.bend = 0.1;
            graph.add_pose(Pose::new(0.0, 0.0, 0.0));
            graph.add_pose(Pose::new(2.0, 0.0, 0.0));
            graph.add_edge(Edge {
                from: 0,
                to: 1,
                way: Pose::new(2.0, 0.0, 0.0),
                information: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                kind,
            });
            let text = g2o(&graph);
            assert!(
                text.lines()
                    .nth(2)
                    .is_some_and(|told| told.starts_with(line)),
                "{text}"
            );
        }
    }

    /// The lines in g2o's tutorial, with the fields in its order.
    #[test]
    fn a_graph_is_written_as_g2o_reads_it() {
        let mut graph = Graph::default();
        graph.add_pose(Pose::new(0.0, 0.0, 0.0));
        graph.add_pose(Pose::new(1.0, 0.5, 0.25));
        graph.add_edge(Edge {
            from: 0,
            to: 1,
            way: Pose::new(1.0, 0.5, 0.25),
            information: [[4.0, 1.0, 2.0], [1.0, 5.0, 3.0], [2.0, 3.0, 6.0]],
            kind: Kind::Loop,
        });
        let text = g2o(&graph);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1], "VERTEX_SE2 1 1.000000 0.500000 0.250000000");
        assert_eq!(
            lines[2],
            "EDGE_SE2 0 1 1.000000 0.500000 0.250000000 4.000 1.000 2.000 5.000 3.000 6.000"
        );
    }
}
