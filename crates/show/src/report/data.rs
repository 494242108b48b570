//! Data for the report's script, as JSON.
//!
//! ```text
//! {end, footprint, scene, waypoints,
//!  truth, believed: {at: [s..], poses: [x, y, theta, ..]},
//!  map: {width, height, resolution_m} | null, maps: [{at, shades} | {at, runs}],
//!  layers: [{name, width, height, resolution_m, origin_m, runs}],
//!  scans: [{at, points}], overlays: [{at, overlays}],
//!  bin, lanes: [{name, load, errors, faults}], marks: [{at, kind}],
//!  bars: [{name, lane, from, to}], error: {at, mm}, plots: [PLOT..] | null, failed: s | null,
//!  display: {width, height, runs} | null}
//! ```
//!
//! `runs` and `shades` are base64; the rest has the form that `view/view.js` takes. The last map is
//! complete. Earlier ones have 16 shades, which limits their size: a map is noisy while it forms.

use emulators::world::Pose;
use firmware_core::map_view::MapView;
use protocols::Instant;
use protocols::rle::{self, Dialect};
use serde::Serialize;
use serde_json::{Value, json};

use super::talk::Talk;
use super::text::first_time;
use crate::view::{self, base64, millimetres};
use engine::rig::Logged;
use engine::rig::line::Direction;
use engine::robots::KeptMap;
use engine::run::Outcome;
use engine::run::check::Status;
use engine::run::history::Lane;
use engine::run::score::PosePair;
use engine::scenario::FaultSpec;

/// Maximum number of points of a path.
const WAY_MAX: usize = 1500;
/// Maximum number of points of a plot.
const PLOT_MAX: usize = 500;

/// Data of `outcome`; `events` are marked on the time line.
pub(super) fn json(outcome: &Outcome, events: &[&Logged], talk: Option<&Talk>) -> String {
    let history = &outcome.history;
    let end = outcome.ran.as_secs_f64();
    let believed = outcome.pairs.iter().map(|pair| (pair.at, pair.estimate));
    let maps = history
        .maps
        .samples
        .iter()
        .map(|(at, map)| (*at, map.view()));
    let last = outcome.map.as_ref().map(KeptMap::view);
    let last = last.map(|map| (Instant::ZERO + outcome.ran, map));
    let maps = maps.map(|(at, map)| json!({"at": seconds(at), "shades": base64(&map_shades(map))}));
    let last = last.map(|(at, map)| json!({"at": seconds(at), "runs": base64(&map_runs(map))}));
    let scans = history.scans.samples.iter();
    let scans = scans.map(|(at, points)| ScanData {
        at: seconds(*at),
        points,
    });
    let overlays = history.overlays.samples.iter();
    let overlays = overlays.map(|(at, all)| json!({"at": seconds(*at), "overlays": **all}));
    let data = Data {
        bars: json!(bars(&outcome.case.fault)),
        believed: json!(way(believed, outcome.pairs.len())),
        bin: json!(history.bin.as_secs_f64()),
        display: outcome
            .display
            .as_ref()
            .map(|picture| {
                json!({
                    "width": picture.width(),
                    "height": picture.height(),
                    "runs": base64(&view::picture_runs(picture)),
                })
            })
            .into(),
        end: json!(end),
        error: json!(error(outcome)),
        failed: json!(super::failed_at(outcome)),
        footprint: json!(outcome.footprint),
        lanes: json!(history.lanes.iter().map(lane).collect::<Vec<_>>()),
        layers: json!(outcome.layers.iter().map(layer).collect::<Vec<_>>()),
        map: json!(outcome.map.as_ref().map(KeptMap::view).map(map_head)),
        maps: json!(maps.chain(last).collect::<Vec<_>>()),
        marks: json!(marks(outcome, events)),
        overlays: json!(overlays.collect::<Vec<_>>()),
        plots: json!(talk.map(Talk::reply_times)),
        scans: scans.collect(),
        scene: json!(outcome.scene),
        truth: json!(way(outcome.truth.iter().copied(), outcome.truth.len())),
        waypoints: json!(outcome.case.mission.waypoints_m.as_flattened()),
    };
    serde_json::to_string(&data).expect("plain data with string keys")
}

/// All data, in the order of a map of JSON. The scans are the largest part, so they are written
/// without a tree of values in between.
#[derive(Serialize)]
struct Data<'a> {
    bars: Value,
    believed: Value,
    bin: Value,
    display: Value,
    end: Value,
    error: Value,
    failed: Value,
    footprint: Value,
    lanes: Value,
    layers: Value,
    map: Value,
    maps: Value,
    marks: Value,
    overlays: Value,
    plots: Value,
    scans: Vec<ScanData<'a>>,
    scene: Value,
    truth: Value,
    waypoints: Value,
}

/// The points of a scan.
#[derive(Serialize)]
struct ScanData<'a> {
    at: f64,
    points: &'a [f64],
}

fn seconds(at: Instant) -> f64 {
    millimetres(at.as_secs_f64())
}

fn way(poses: impl Iterator<Item = (Instant, Pose)>, count: usize) -> Value {
    let step = count.div_ceil(WAY_MAX).max(1);
    let (mut at, mut flat) = (Vec::new(), Vec::new());
    for (time, pose) in poses.step_by(step) {
        at.push(seconds(time));
        flat.extend([pose.x, pose.y, pose.theta].map(millimetres));
    }
    json!({"at": at, "poses": flat})
}

fn map_head(map: MapView<'_>) -> Value {
    let resolution_m = f64::from(map.cell_mm()) / 1000.0;
    let origin_m = map.origin_mm().map(|mm| f64::from(mm) / 1000.0);
    let (width, height) = (map.width(), map.height());
    json!({
        "width": width, "height": height,
        "resolution_m": resolution_m, "origin_m": origin_m,
    })
}

/// A map besides the robot's own map.
fn layer((name, map): &(&'static str, KeptMap)) -> Value {
    let mut layer = map_head(map.view());
    layer["name"] = (*name).into();
    layer["runs"] = base64(&map_runs(map.view())).into();
    layer
}

/// Counts and values of all rows, lowest first.
fn map_runs(map: MapView<'_>) -> Vec<u8> {
    let cells = map.cells();
    let mut runs = vec![0; 2 * cells.len()];
    let len = rle::encode(cells, Dialect::Lossless, &mut runs).expect("two bytes a cell");
    runs.truncate(len);
    runs
}

/// Encodes the upper half of each cell and its repetition count, up to 16, in one byte.
fn map_shades(map: MapView<'_>) -> Vec<u8> {
    let cells = map.cells();
    let mut out = Vec::with_capacity(cells.len() / 4);
    let mut rest = cells;
    while let [first, behind @ ..] = rest {
        let more = alike(*first, behind).min(15);
        out.push(u8::try_from(more).expect("at most 15") << 4 | first >> 4);
        rest = &behind[more..];
    }
    out
}

/// Number of the first of `cells` with the same upper half as `cell`; counts up to 16.
fn alike(cell: u8, cells: &[u8]) -> usize {
    const UPPER: u128 = u128::from_le_bytes([0xF0; 16]);
    match cells.first_chunk() {
        // Sixteen cells are compared at once.
        Some(next) => {
            let differs = u128::from_le_bytes(*next) ^ u128::from_le_bytes([cell; 16]);
            (differs & UPPER).trailing_zeros() as usize / 8
        }
        None => cells
            .iter()
            .take_while(|next| **next >> 4 == cell >> 4)
            .count(),
    }
}

/// A lane; counts that are all zero are left out.
fn lane(lane: &Lane) -> Value {
    let counts = |counts: &[u64]| -> Vec<u64> {
        let any = counts.iter().any(|&count| count > 0);
        if any { counts.to_vec() } else { Vec::new() }
    };
    json!({
        "name": lane.name,
        "load": lane.load,
        "errors": counts(&lane.errors),
        "faults": counts(&lane.faults),
    })
}

/// Faults with a duration; faults of single bytes are left out.
fn bars(faults: &[FaultSpec]) -> Vec<Value> {
    let lasting = faults.iter().filter(|fault| fault.byte.is_none());
    let lasting = lasting.take(super::FAULTS_MAX).map(|fault| {
        let direction = fault
            .direction
            .map(|direction| Direction::from(direction).name());
        let lane = direction.map(|direction| format!("{} {direction}", fault.place()));
        let window = fault.window();
        let until = fault
            .until
            .or(fault.lasting.filter(|_| fault.every.is_none()));
        json!({
            "name": format!("{} {}", fault.kind.name(), fault.place()),
            "lane": lane,
            "from": seconds(window.from),
            "to": until.map(|_| seconds(window.until)),
        })
    });
    lasting.collect()
}

/// Distance between the believed and the true pose.
fn error(outcome: &Outcome) -> Value {
    let step = outcome.pairs.len().div_ceil(PLOT_MAX).max(1);
    let pairs = outcome.pairs.iter().step_by(step);
    let error = |pair: &PosePair| {
        let far = pair.truth.point().distance(pair.estimate.point());
        (seconds(pair.at), (far * 10_000.0).round() / 10.0)
    };
    let (at, mm): (Vec<f64>, Vec<f64>) = pairs.map(error).unzip();
    json!({"at": at, "mm": mm})
}

/// Times that failed checks name.
pub(super) fn failures(outcome: &Outcome) -> impl Iterator<Item = f64> {
    let failed = outcome.checks.iter();
    let failed = failed.filter(|check| check.status == Status::Fail);
    failed.filter_map(|check| first_time(&check.detail))
}

/// Events, times that failed checks name, and beginnings of faults.
fn marks(outcome: &Outcome, events: &[&Logged]) -> Vec<Value> {
    let events = events.iter().map(|logged| {
        let kind = if logged.is_violation() {
            "violation"
        } else {
            "event"
        };
        (logged.event.at.as_secs_f64(), kind)
    });
    let failed = failures(outcome).map(|at| (at, "fail"));
    let faults = outcome.case.fault.iter().take(super::FAULTS_MAX);
    let faults = faults.filter_map(|fault| Some((fault.from?.0.as_secs_f64(), "fault")));
    let marks = events.chain(faults).chain(failed);
    marks
        .map(|(at, kind)| json!({"at": at, "kind": kind}))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The comparison of sixteen cells at once counts as one cell after the other does.
        #[test]
        fn runs_of_shades_are_those_of_single_cells(
            runs in proptest::collection::vec((0_u8.., 1_usize..40), 1..20),
            noise in 0_u8..16,
        ) {
            let cells = runs.iter().flat_map(|&(cell, count)| vec![cell; count]);
            let cells: Vec<u8> = cells.enumerate().map(|(at, cell)| {
                if at % 3 == 0 { cell ^ noise } else { cell }
            }).collect();
            let map = MapView::new(cells.len(), 20.0, [0.0; 2], &cells);
            let mut plain = Vec::new();
            let mut rest = &cells[..];
            while let [first, behind @ ..] = rest {
                let more = behind.iter().take(15).take_while(|next| **next >> 4 == first >> 4);
                let more = more.count();
                plain.push(u8::try_from(more).unwrap() << 4 | first >> 4);
                rest = &behind[more..];
            }
            prop_assert_eq!(map_shades(map), plain);
        }
    }
}
