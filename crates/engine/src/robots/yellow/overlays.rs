//! The robot's perception and plans, drawn over the world: infrared beams, walls found by its
//! lidar, the roadmap with the path through it, pose hypotheses.

use core::f64::consts::FRAC_PI_3;

use emulators::world::Pose;
use firmware_core::pose::Point;
use firmware_core::robots::yellow::Yellow;
use firmware_core::robots::yellow::pc::PcProgram;

use crate::robots::{Overlay, OverlayRole};

/// Positions of the sensors, and directions of those in use: ahead, right front, left front.
const RING_M: f64 = 0.09;
const BEARINGS: [f64; 3] = [0.0, -FRAC_PI_3, FRAC_PI_3];

/// Lines from the sensors to their readings, for a program with the believed pose `pose`.
pub(super) fn infrared(program: &Yellow, pose: Pose) -> Overlay {
    let beams = BEARINGS.into_iter().zip(program.infrared_m());
    let empty = Overlay::new("infrared", OverlayRole::Sensed);
    beams.fold(empty, |overlay, (bearing, read_m)| {
        let (sin, cos) = libm::sincos(pose.theta + bearing);
        let at = |far: f64| [pose.x + far * cos, pose.y + far * sin];
        overlay.line([at(RING_M), at(RING_M + f64::from(read_m))])
    })
}

/// The overlays of the PC.
pub(super) fn of_pc(program: &PcProgram) -> [Overlay; 4] {
    let (vertices, edges, way) = program.roadmap();
    let lines = Overlay::new("lidar lines", OverlayRole::Sensed);
    let lines = program.lines().fold(lines, |overlay, line| {
        overlay.line([metres(line.start), metres(line.end)])
    });
    let roadmap = Overlay::new("roadmap", OverlayRole::Possible);
    let roadmap = vertices
        .iter()
        .fold(roadmap, |overlay, place| overlay.point(metres(*place)));
    let ends = edges
        .iter()
        .filter_map(|&(a, b)| Some([*vertices.get(a)?, *vertices.get(b)?]));
    let roadmap = ends.fold(roadmap, |overlay, ends| overlay.line(ends.map(metres)));
    let mut planned = Overlay::new("way", OverlayRole::Planned);
    if !way.is_empty() {
        planned = planned.line(way.iter().copied().map(metres));
    }
    let planned = way
        .iter()
        .fold(planned, |overlay, place| overlay.point(metres(*place)));
    let places = Overlay::new("places", OverlayRole::Guess);
    let places = match program.estimate() {
        Some(found) => [found.pose, found.second]
            .iter()
            .fold(places, |overlay, pose| {
                overlay.point(metres(pose.position()))
            }),
        None => places,
    };
    [lines, roadmap, planned, places]
}

fn metres(place: Point) -> [f64; 2] {
    [place.x_mm, place.y_mm].map(|mm| f64::from(mm) / 1_000.0)
}
