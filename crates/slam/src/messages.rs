//! A log of messages with time stamps: laser scans, and poses of odometry or of a mapper.

use emulators::world::Pose;
use protocols::Instant;

use super::finding::{Findings, Kind};
use super::motion::{between, moved};
use super::stamps::LogClock;
use super::{Log, Shot, end_points};

/// Maximum plausible distance between two scans, metres.
const STEP_MAX_M: f64 = 20.0;
/// Maximum time between a scan and a usable pose, seconds.
const GAP_MAX_S: f64 = 1.0;

/// A scan of a laser.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Beams {
    /// Bearing of the first beam, and step to the next one, radians.
    pub(super) first: f64,
    pub(super) step: f64,
    /// Time between two beams, seconds; 0 if unknown.
    pub(super) beam_s: f64,
    /// Maximum range, metres.
    pub(super) farthest_m: f64,
    pub(super) ranges: Vec<f64>,
    /// The pose of the laser in the robot's frame.
    pub(super) seat: Pose,
}

/// A message with its own time and its position in the file.
#[derive(Clone, Debug)]
pub(super) struct Said<T> {
    pub(super) at_s: f64,
    /// Time at which it was recorded, used in findings.
    pub(super) logged: Instant,
    pub(super) what: T,
}

/// Builds the log; both lists are in order of recording.
pub(super) fn log(scans: Vec<Said<Beams>>, poses: &[Said<Pose>], mut findings: Findings) -> Log {
    let track = Track::new(poses);
    let mut clock = LogClock::default();
    let mut shots: Vec<Shot> = Vec::new();
    let mut before: Option<Pose> = None;
    for scan in scans {
        let at = scan.logged;
        if !clock.accepts(scan.at_s) {
            let what = format_args!("a scan of {} s, earlier than the one before", scan.at_s);
            findings.add(Kind::Backwards, format_args!("{at} s"), what);
            continue;
        }
        let (points, absurd) = track.end_points(&scan);
        findings.absurd_readings += u64::from(absurd);
        if points.is_empty() {
            let what = format_args!("none of {} beams has a distance", scan.what.ranges.len());
            findings.add(Kind::Blind, format_args!("{at} s"), what);
            continue;
        }
        let here = track.at(scan.at_s);
        let step = before.zip(here).map(|(before, here)| between(before, here));
        let step = step.filter(|step| libm::hypot(step.x, step.y) < STEP_MAX_M);
        before = here.or(before);
        shots.push(Shot {
            at_s: scan.at_s,
            moved: step.unwrap_or_default(),
            is_measured: step.is_some() || shots.is_empty(),
            points,
        });
    }
    let unmeasured = shots.iter().filter(|shot| !shot.is_measured).count();
    let mut notes = Vec::new();
    if unmeasured > 0 {
        notes.push(format!("{unmeasured} scans without a pose near them"));
    }
    Log {
        start: Pose::default(),
        shots,
        findings,
        notes,
    }
}

/// Poses by time.
struct Track(Vec<(f64, Pose)>);

impl Track {
    fn new(poses: &[Said<Pose>]) -> Self {
        let mut poses: Vec<(f64, Pose)> = poses.iter().map(|said| (said.at_s, said.what)).collect();
        poses.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self(poses)
    }

    /// The pose at a time, interpolated between its neighbours. At either end and in a gap, the
    /// nearer pose, if it is close enough.
    fn at(&self, at_s: f64) -> Option<Pose> {
        let after = self.0.partition_point(|(time, _)| *time <= at_s);
        let (left, right) = (after.checked_sub(1), self.0.get(after));
        let left = left.map(|index| &self.0[index]);
        if let (Some((from, a)), Some((to, b))) = (left, right)
            && to - from <= GAP_MAX_S
        {
            let share = (at_s - from) / (to - from);
            let way = between(*a, *b);
            let part = Pose::new(way.x * share, way.y * share, way.theta * share);
            return Some(moved(*a, part));
        }
        let near = |one: &&(f64, Pose)| (one.0 - at_s).abs() <= GAP_MAX_S;
        let pose = |one: &(f64, Pose)| one.1;
        left.filter(near).or(right.filter(near)).map(pose)
    }

    /// End points of the beams in the robot's frame at the scan's time, and the number of
    /// implausible readings. If the time of each beam is known, the motion of the robot during the
    /// scan is corrected.
    fn end_points(&self, scan: &Said<Beams>) -> (Vec<firmware_core::pose::Point>, u32) {
        let beams = &scan.what;
        let bearing = |index: usize| beams.first + index as f64 * beams.step;
        let ranges = || beams.ranges.iter().copied();
        let here = self.at(scan.at_s).filter(|_| beams.beam_s > 0.0);
        let Some(here) = here else {
            return end_points(ranges(), bearing, |_| beams.seat, beams.farthest_m);
        };
        let seat = |index: usize| {
            let then = self.at(scan.at_s + index as f64 * beams.beam_s);
            let robot = then.map_or(Pose::default(), |then| between(here, then));
            moved(robot, beams.seat)
        };
        end_points(ranges(), bearing, seat, beams.farthest_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said<T>(at_s: f64, what: T) -> Said<T> {
        let logged = Instant::ZERO;
        Said { at_s, logged, what }
    }

    fn beams(beam_s: f64) -> Beams {
        Beams {
            first: 0.0,
            step: core::f64::consts::FRAC_PI_2,
            beam_s,
            farthest_m: 10.0,
            ranges: vec![2.0, 3.0],
            seat: Pose::new(0.1, 0.0, 0.0),
        }
    }

    /// The robot drives ahead at 1 m/s. Its second beam, to the left, is 0.1 s later than the first
    /// one: 0.1 m farther ahead.
    #[test]
    fn each_beam_is_sent_from_where_the_robot_was() {
        let poses = [
            said(0.0, Pose::new(5.0, 0.0, 0.0)),
            said(1.0, Pose::new(6.0, 0.0, 0.0)),
        ];
        let log = log(
            vec![said(0.2, beams(0.1)), said(0.7, beams(0.0))],
            &poses,
            Findings::default(),
        );
        let place = |shot: usize, point: usize| {
            let point = log.shots[shot].points[point];
            [point.x_mm.round(), point.y_mm.round()]
        };
        assert_eq!([place(0, 0), place(0, 1)], [[2100.0, 0.0], [200.0, 3000.0]]);
        assert_eq!([place(1, 0), place(1, 1)], [[2100.0, 0.0], [100.0, 3000.0]]);
        assert!((log.shots[1].moved.x - 0.5).abs() < 1e-9);
        assert!(log.shots.iter().all(|shot| shot.is_measured));
    }

    #[test]
    fn a_scan_far_from_any_pose_has_no_measured_motion() {
        let poses = [said(0.0, Pose::default())];
        let log = log(
            vec![said(0.5, beams(0.0)), said(3.0, beams(0.0))],
            &poses,
            Findings::default(),
        );
        assert_eq!(log.shots[1].moved, Pose::default());
        assert!(!log.shots[1].is_measured);
        assert_eq!(log.notes, ["1 scans without a pose near them"]);
    }
}
