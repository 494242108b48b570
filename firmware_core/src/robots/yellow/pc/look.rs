//! A look around: the robot rests, and the program requests the lines of its lidar.

use core::time::Duration;

use protocols::Instant;
use protocols::telemetry::message::{LinesRequest, State, Telecommand};

use super::Failure;
use super::link::{Link, Request, Sight};
use crate::walls::Walls;

/// Rest time before the request, so that the lidar's set contains no older turns: the fielded
/// program's value.
const REST: Duration = Duration::from_secs(2);
/// Interval of repeated requests, five turns of the lidar. A lidar that shows no wall may have lost
/// its turns; one whose walls differ from the previous ones gives wrong data.
const AGAIN: Duration = Duration::from_secs(1);
/// Maximum number of repeats. A lidar that has to be started again needs 5 s.
const AGAIN_MAX: u32 = 12;
/// Minimum length of the walls in a scan, mm.
const WALLS_MIN_MM: f32 = 300.0;
/// Higher limit for the first look, mm: all later scans are aligned to the first one, and a lidar
/// with few points gives a skewed one. A robot between walls sees more.
const FIRST_MIN_MM: f32 = 2_000.0;
/// Minimum share of common walls of two scans from the same pose.
const SHARE_MIN: f32 = 0.6;
/// Lines with the robot's own settings: 0 selects its own values.
const LINES: LinesRequest = LinesRequest {
    gap_mm: 0,
    tolerance_mm: 0,
    merge_deg: 0,
};

/// A look around.
#[derive(Clone, Debug)]
pub(super) struct Look {
    phase: Phase,
    /// The previous scan.
    before: Walls,
    /// Number of rejected scans.
    again: u32,
}

/// The progress.
#[derive(Clone, Debug)]
enum Phase {
    /// Waiting until the robot rests.
    Stopping(Request),
    /// The robot rests until this time.
    Resting(Instant),
    /// The lines were requested.
    Asking(Request),
}

impl Look {
    pub(super) fn new(link: &Link) -> Self {
        Self {
            phase: Phase::Stopping(Request::to_rest(link)),
            before: Walls::default(),
            again: 0,
        }
    }

    /// The robot's view, once it is accepted: it matches `known`, or was seen twice. With `None` it
    /// is accepted at once, because a robot without a known pose compares it with the whole map.
    pub(super) fn step(
        &mut self,
        now: Instant,
        link: &mut Link,
        known: Option<&Walls>,
    ) -> Result<Option<Sight>, Failure> {
        match &mut self.phase {
            Phase::Stopping(request) => {
                let heard = link.heard_since(request.since());
                let rests = heard.is_some_and(|heard| heard.state() == Some(State::Off));
                if request.is_sent() && (rests || link.asks_once()) {
                    self.phase = Phase::Resting(now + REST);
                } else {
                    request.poll(now, link)?;
                }
            }
            Phase::Resting(until) if now >= *until => {
                let command = Telecommand {
                    lines: Some(LINES),
                    ..Telecommand::default()
                };
                self.phase = Phase::Asking(Request::new(link.number(), command));
                return self.step(now, link, known);
            }
            Phase::Resting(_) => {}
            Phase::Asking(request) => match link.sight_since(request.since()) {
                Some(sight) => {
                    let sight = sight.clone();
                    return Ok(self.judged(now, link, sight, known));
                }
                None => request.poll(now, link)?,
            },
        }
        Ok(None)
    }

    /// The scan, unless another one may show more.
    fn judged(
        &mut self,
        now: Instant,
        link: &Link,
        sight: Sight,
        known: Option<&Walls>,
    ) -> Option<Sight> {
        let is_of = |walls: &Walls| walls.share_known(sight.pose, &sight.lines) >= SHARE_MIN;
        let walls_mm: f32 = sight.lines.iter().map(|line| line.length_mm()).sum();
        let least_mm = match known.is_some_and(Walls::is_empty) {
            true => FIRST_MIN_MM,
            false => WALLS_MIN_MM,
        };
        let is_believed = walls_mm >= least_mm && (known.is_none_or(is_of) || is_of(&self.before));
        if is_believed || self.again == AGAIN_MAX || link.asks_once() {
            return Some(sight);
        }
        self.again += 1;
        self.before = Walls::default();
        self.before.add(sight.pose, &sight.lines);
        self.phase = Phase::Resting(now + AGAIN);
        None
    }
}

#[cfg(test)]
mod tests {
    use alloc::vec;

    use super::super::config::PcConfig;
    use super::*;
    use crate::local_map::Segment;
    use crate::pose::{Point, Pose};

    /// The very first scan is accepted from 2 m of walls on, another one from 300 mm on; each when
    /// it was seen twice.
    #[test]
    fn little_is_not_believed_the_first_time() {
        let link = Link::new(&PcConfig::default());
        let wall = |mm: f32| Segment::new(Point::new(1e3, -mm / 2.0), Point::new(1e3, mm / 2.0));
        let known = {
            let mut walls = Walls::default();
            let far = Segment::new(Point::new(-9e3, 1e3), Point::new(-9e3, -1e3));
            walls.add(Pose::new(0.0, 0.0, 0.0), &[far]);
            walls
        };
        let is_believed = |mm: f32, known: &Walls| {
            let mut look = Look::new(&link);
            let mut ask = || {
                let sight = Sight::of(Pose::new(0.0, 0.0, 0.0), vec![wall(mm)]);
                look.judged(Instant::ZERO, &link, sight, Some(known))
                    .is_some()
            };
            [ask(), ask()]
        };
        let none = Walls::default();
        assert_eq!(is_believed(1_999.0, &none), [false, false]);
        assert_eq!(is_believed(2_001.0, &none), [false, true]);
        assert_eq!(is_believed(299.0, &known), [false, false]);
        assert_eq!(is_believed(301.0, &known), [false, true]);
    }
}
