//! Results of the mapper in invented buildings: error, false loops, and its own reports of
//! failures.
//!
//! ```text
//! cargo bench --bench buildings -- FIRST COUNT
//! ```

use std::process::ExitCode;

use emulators::world::{Pose, wrap_angle};
use hilrig::slam::mapping::building::Building;
use hilrig::slam::mapping::motion::{between, distance, moved};
use hilrig::slam::mapping::{Edge, Kind, Mapper, Settings, Shot};

/// Error above which an edge is false, metres and radians.
const FALSE_M: f64 = 0.5;
const FALSE_RAD: f64 = 0.1;
/// Error above which the mapper fails, as a part of the path.
const FAILS: f64 = 0.005;
/// Distance between a scan's pose and the odometry that counts as a jump, metres and radians.
const JUMP_M: f64 = 0.5;
const JUMP_RAD: f64 = 0.39;

/// Results for one building.
struct Told {
    way_m: f64,
    off_m: f64,
    false_loops: usize,
    /// Scans that the mapper itself reports as doubtful, far from the odometry or poor, and places
    /// that looked like several others.
    reports: usize,
}

fn main() -> ExitCode {
    let mut numbers = std::env::args()
        .skip(1)
        .filter_map(|word| word.parse().ok());
    let first: u64 = numbers.next().unwrap_or(0);
    let count = numbers.next().unwrap_or(20);
    let (mut failed, mut with_false, mut silent) = (0, 0, 0);
    for seed in first..first + count {
        let told = judged(seed);
        let has_failed = told.off_m > FAILS * told.way_m;
        failed += u64::from(has_failed);
        with_false += u64::from(told.false_loops > 0);
        silent += u64::from(has_failed && told.reports == 0);
        println!(
            "{seed}: {:.0} m, off {:.3} m = {:.2} %, {} false loops, {} reports",
            told.way_m,
            told.off_m,
            100.0 * told.off_m / told.way_m,
            told.false_loops,
            told.reports
        );
    }
    println!(
        "{count} buildings: {failed} off by more than 0.5 % of the way, {with_false} with false \
         loops, {silent} failed silently"
    );
    ExitCode::from(u8::from(with_false + silent > 0 || 100 * failed > count))
}

fn judged(seed: u64) -> Told {
    let building = Building::generate(seed);
    let start = building
        .sights
        .first()
        .map_or(Pose::default(), |sight| sight.truth);
    let mut mapper = Mapper::new(Settings {
        start,
        ..Settings::default()
    });
    let (mut here, mut reports) = (start, 0);
    for sight in &building.sights {
        let wheels = moved(here, sight.moved);
        let outcome = mapper.take(&Shot {
            moved: sight.moved,
            is_measured: true,
            ends: &sight.ends,
        });
        here = outcome.pose;
        let turn = wrap_angle(here.theta - wheels.theta).abs();
        let is_jump = distance(here, wheels) > JUMP_M || turn > JUMP_RAD;
        reports += usize::from(outcome.is_doubtful || outcome.quality < 0.5 || is_jump);
    }
    mapper.finish();
    let truth: Vec<Pose> = building.sights.iter().map(|sight| sight.truth).collect();
    let scans = mapper.scans();
    let is_false = |edge: &&Edge| {
        let way = between(truth[scans[edge.from]], truth[scans[edge.to]]);
        edge.kind == Kind::Loop && contradicts(edge, way)
    };
    Told {
        way_m: building.way_m,
        off_m: absolute_m(&truth, &mapper.way()),
        false_loops: mapper.graph().edges.iter().filter(is_false).count(),
        reports: reports + mapper.ambiguous(),
    }
}

/// Whether an edge contradicts the truth in a direction that it measures. Along a corridor it
/// measures nothing.
fn contradicts(edge: &Edge, truth: Pose) -> bool {
    let turn = wrap_angle(truth.theta - edge.way.theta);
    let off = [truth.x - edge.way.x, truth.y - edge.way.y, turn];
    let mut deviations = 0.0;
    for (row, a) in edge.information.iter().zip(off) {
        deviations += row
            .iter()
            .zip(off)
            .map(|(value, b)| a * value * b)
            .sum::<f64>();
    }
    deviations > 100.0 && (libm::hypot(off[0], off[1]) > FALSE_M || turn.abs() > FALSE_RAD)
}

/// Mean distance after the best rigid alignment, metres.
fn absolute_m(truth: &[Pose], way: &[Pose]) -> f64 {
    let count = truth.len().max(1) as f64;
    let mean = |poses: &[Pose]| {
        let sum = poses
            .iter()
            .fold([0.0; 2], |[x, y], pose| [x + pose.x, y + pose.y]);
        sum.map(|sum| sum / count)
    };
    let (middle, here) = (mean(truth), mean(way));
    let (mut along, mut across) = (0.0, 0.0);
    for (truth, pose) in truth.iter().zip(way) {
        let [u, v] = [pose.x - here[0], pose.y - here[1]];
        let [a, b] = [truth.x - middle[0], truth.y - middle[1]];
        along += u * a + v * b;
        across += u * b - v * a;
    }
    let turn = libm::atan2(across, along);
    let laid = |pose: &Pose| {
        let from_here = Pose::new(pose.x - here[0], pose.y - here[1], 0.0);
        moved(Pose::new(middle[0], middle[1], turn), from_here)
    };
    let off = truth
        .iter()
        .zip(way)
        .map(|(truth, pose)| distance(*truth, laid(pose)));
    off.sum::<f64>() / count
}
