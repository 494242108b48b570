//! Messages with Foxglove's schemas in JSON.

use emulators::world::Pose;
use serde::Deserialize;

use super::{Beams, Heard, Refusal, checked, pose};
use crate::FARTHEST_M;
use crate::finding::Kind;

#[derive(Deserialize)]
struct Stamp {
    sec: f64,
    nsec: f64,
}

#[derive(Deserialize)]
struct Position {
    x: f64,
    y: f64,
}

#[derive(Deserialize)]
struct Orientation {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[derive(Deserialize)]
struct Placed {
    position: Position,
    orientation: Orientation,
}

#[derive(Deserialize)]
struct LaserScan {
    timestamp: Stamp,
    pose: Placed,
    start_angle: f64,
    end_angle: f64,
    /// JSON has neither infinity nor NaN; some programs write `null` instead.
    ranges: Vec<Option<f64>>,
}

#[derive(Deserialize)]
struct PoseInFrame {
    timestamp: Stamp,
    frame_id: String,
    pose: Placed,
}

impl Stamp {
    fn seconds(&self) -> f64 {
        self.sec + self.nsec / 1e9
    }
}

impl Placed {
    fn pose(&self) -> Result<Pose, Refusal> {
        let Orientation { x, y, z, w } = self.orientation;
        pose([self.position.x, self.position.y], [x, y, z, w])
    }
}

fn parsed<'a, T: Deserialize<'a>>(data: &'a [u8]) -> Result<T, Refusal> {
    serde_json::from_slice(data).map_err(|error| (Kind::Unreadable, error.to_string()))
}

/// `foxglove.LaserScan`: the last range is at the end angle.
pub(super) fn scan(data: &[u8]) -> Result<Heard<Beams>, Refusal> {
    let scan: LaserScan = parsed(data)?;
    let gaps = scan.ranges.len().saturating_sub(1).max(1) as f64;
    let range = |range: Option<f64>| range.unwrap_or(f64::INFINITY);
    let what = checked(Beams {
        first: scan.start_angle,
        step: (scan.end_angle - scan.start_angle) / gaps,
        beam_s: 0.0,
        farthest_m: FARTHEST_M,
        ranges: scan.ranges.into_iter().map(range).collect(),
        seat: scan.pose.pose()?,
    })?;
    let at_s = scan.timestamp.seconds();
    Ok(Heard { at_s, what })
}

/// `foxglove.PoseInFrame` with the name of its frame.
pub(super) fn pose_in_frame(data: &[u8]) -> Result<(String, Heard<Pose>), Refusal> {
    let placed: PoseInFrame = parsed(data)?;
    let at_s = placed.timestamp.seconds();
    let what = placed.pose.pose()?;
    Ok((placed.frame_id, Heard { at_s, what }))
}
