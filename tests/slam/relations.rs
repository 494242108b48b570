//! Judgement of a trajectory by relations: the pose at t2, relative to the pose at t1, is compared.
//! The error of a relation is the estimated relative pose relative to the given one (Kuemmerle et
//! al. 2009). A pose between two scans follows from the scan before by odometry. The correction of
//! the next scan is spread over the gap by distance and angle.

use emulators::world::{Pose, wrap_angle};
use hilrig::slam::motion::{between, moved};

/// Poses by time.
pub(crate) struct Track(Vec<(f64, Pose)>);

/// Tolerance of times, which have six digits.
const SLACK_S: f64 = 0.006;
/// Maximum time between a relation and the next pose.
const GAP_MAX_S: f64 = 1.0;

impl Track {
    pub(crate) fn new(mut poses: Vec<(f64, Pose)>) -> Self {
        poses.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self(poses)
    }

    fn at_or_before(&self, time: f64) -> usize {
        self.0
            .partition_point(|(at, _)| *at <= time + SLACK_S)
            .saturating_sub(1)
    }

    /// The pose at a time, interpolated along the path between its neighbours, and the time to the
    /// nearer one.
    fn interpolated(&self, time: f64) -> (Pose, f64) {
        let index = self.at_or_before(time);
        let (at, pose) = self.0[index];
        let Some((next_at, next)) = self.0.get(index + 1).filter(|next| next.0 > at) else {
            return (pose, (time - at).abs());
        };
        let share = ((time - at) / (next_at - at)).clamp(0.0, 1.0);
        let step = between(pose, *next);
        let part = Pose::new(step.x * share, step.y * share, step.theta * share);
        (
            moved(pose, part),
            (time - at).abs().min((next_at - time).abs()),
        )
    }

    /// Distance and angle from one time to another.
    fn progress(&self, from: f64, to: f64) -> (f64, f64) {
        let (first, last) = (self.at_or_before(from), self.at_or_before(to));
        self.0[first..=last.max(first)]
            .windows(2)
            .fold((0.0, 0.0), |(way, angle), pair| {
                let step = between(pair[0].1, pair[1].1);
                (way + libm::hypot(step.x, step.y), angle + step.theta.abs())
            })
    }
}

fn pose_at(scans: &Track, wheels: &Track, time: f64) -> (Pose, f64) {
    let index = scans.at_or_before(time);
    let (at, pose) = scans.0[index];
    let (start, _) = wheels.interpolated(at);
    let (end, gap) = wheels.interpolated(time);
    let mut step = between(start, end);
    if let Some((next_at, next)) = scans.0.get(index + 1).filter(|_| time > at + SLACK_S) {
        let whole = between(start, wheels.interpolated(*next_at).0);
        let (way, angle) = wheels.progress(at, *next_at);
        let (way_so_far, angle_so_far) = wheels.progress(at, time);
        let share = |part: f64, of: f64| if of > 1e-9 { part / of } else { 0.0 };
        let (by_way, by_angle) = (share(way_so_far, way), share(angle_so_far, angle));
        let fix = between(moved(pose, whole), *next);
        let (sin, cos) = libm::sincos(whole.theta);
        step.x += by_way * (cos * fix.x - sin * fix.y);
        step.y += by_way * (sin * fix.x + cos * fix.y);
        step.theta = wrap_angle(step.theta + by_angle * fix.theta);
    }
    (moved(pose, step), gap)
}

/// Errors of a trajectory.
pub(crate) struct Errors {
    /// Number of relations.
    pub(crate) count: usize,
    /// Mean and median error of position, metres.
    pub(crate) mean_m: f64,
    pub(crate) median_m: f64,
    /// Mean error of heading, degrees.
    pub(crate) mean_deg: f64,
}

/// Judges a trajectory.
pub(crate) fn judge(scans: &Track, wheels: &Track, relations: &str, shift_s: f64) -> Errors {
    let (mut metres, mut angle) = (Vec::new(), 0.0);
    for line in relations.lines() {
        let numbers: Vec<f64> = line
            .split_whitespace()
            .filter_map(|v| v.parse().ok())
            .collect();
        let [t1, t2, x, y, _, _, _, yaw] = numbers[..] else {
            continue;
        };
        let (from, gap_1) = pose_at(scans, wheels, t1 - shift_s);
        let (to, gap_2) = pose_at(scans, wheels, t2 - shift_s);
        if gap_1.max(gap_2) > GAP_MAX_S || t1.min(t2) - shift_s < scans.0[0].0 - 0.01 {
            continue;
        }
        let error = between(Pose::new(x, y, yaw), between(from, to));
        metres.push(libm::hypot(error.x, error.y));
        angle += error.theta.abs();
    }
    let of = metres.len().max(1) as f64;
    metres.sort_by(f64::total_cmp);
    Errors {
        count: metres.len(),
        mean_m: metres.iter().sum::<f64>() / of,
        median_m: metres.get(metres.len() / 2).copied().unwrap_or(f64::NAN),
        mean_deg: f64::to_degrees(angle / of),
    }
}

/// Two scans a second apart; by odometry the motion is 1 m ahead, by the second scan 1.2 m.
/// Half-way, the odometry gives 0.5 m, plus half of the correction: 0.6 m.
#[test]
fn the_correction_is_spread_over_the_gap() {
    let at = |x: f64| Pose::new(x, 0.0, 0.0);
    let scans = Track::new(vec![(0.0, at(0.0)), (1.0, at(1.2))]);
    let wheels = Track::new(vec![(0.0, at(5.0)), (0.5, at(5.5)), (1.0, at(6.0))]);
    let (pose, _) = pose_at(&scans, &wheels, 0.5);
    assert!((pose.x - 0.6).abs() < 1e-9, "{pose:?}");
    let relations = "100 101 1.15 0 0 0 0 0\n100 101 1.2 0 0 0 0 0\n100 101 1.1 0 0 0 0 0\n";
    let errors = judge(&scans, &wheels, relations, 100.0);
    assert_eq!(errors.count, 3);
    assert!((errors.mean_m - 0.05).abs() < 1e-9 && (errors.median_m - 0.05).abs() < 1e-9);
}
