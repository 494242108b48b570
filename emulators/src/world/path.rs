//! How an obstacle moves: timed way-points, straight lines between them.
//!
//! The place is a pure function of time, so a beam cast a millisecond in the past sees the obstacle
//! where it was then, and no order of calls can matter.

use protocols::Instant;

use super::geometry::Point;

/// A place and when the obstacle is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    /// When.
    pub at: Instant,
    /// Where, metres.
    pub position: Point,
}

/// What happens after the last way-point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Repeat {
    /// The obstacle stays there.
    #[default]
    Once,
    /// From the beginning again; the last place must be the first, as nothing jumps.
    Loop,
    /// Back along the same way, then forth again.
    PingPong,
}

/// Timed way-points, their times rising. Before the first the obstacle waits at the first.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// At least one.
    pub waypoints: Vec<Waypoint>,
    /// What follows the last.
    pub repeat: Repeat,
}

impl Path {
    /// Where the obstacle is at `now`. Meant for paths that a scene has accepted; an empty path is
    /// at the origin.
    pub fn position(&self, now: Instant) -> Point {
        let (Some(first), Some(last)) = (self.waypoints.first(), self.waypoints.last()) else {
            return Point::default();
        };
        let local = self.local_nanos(now, first.at.as_nanos(), last.at.as_nanos());
        let next = self.waypoints.partition_point(|w| w.at.as_nanos() <= local);
        if next == 0 {
            return first.position;
        }
        let Some(to) = self.waypoints.get(next) else {
            return last.position;
        };
        let from = &self.waypoints[next - 1];
        let span = seconds(to.at.as_nanos() - from.at.as_nanos());
        let part = seconds(local - from.at.as_nanos()) / span;
        Point::new(
            from.position.x + (to.position.x - from.position.x) * part,
            from.position.y + (to.position.y - from.position.y) * part,
        )
    }

    /// The greatest speed anywhere on the path, m/s.
    pub fn top_speed_m_s(&self) -> f64 {
        self.waypoints.windows(2).fold(0.0, |top: f64, pair| {
            let span = seconds(pair[1].at.as_nanos().saturating_sub(pair[0].at.as_nanos()));
            top.max(pair[0].position.distance(pair[1].position) / span)
        })
    }

    /// `now` folded back between the first and the last way-point.
    fn local_nanos(&self, now: Instant, first: u64, last: u64) -> u64 {
        let (now, span) = (now.as_nanos(), last - first);
        if now < first || span == 0 {
            return now;
        }
        let since = now - first;
        match self.repeat {
            Repeat::Once => now,
            Repeat::Loop => first + since % span,
            Repeat::PingPong => {
                let phase = since % span.saturating_mul(2);
                first
                    + if phase > span {
                        2 * span - phase
                    } else {
                        phase
                    }
            }
        }
    }
}

fn seconds(nanos: u64) -> f64 {
    Instant::from_nanos(nanos).as_secs_f64()
}
