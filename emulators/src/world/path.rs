//! Motion of an obstacle: timed way-points with straight lines between them.
//!
//! The position is a pure function of time. A beam cast a millisecond in the past sees the obstacle
//! at its past position, and no order of calls can matter.

use protocols::Instant;

use super::geometry::Point;

/// A place and when the obstacle is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    /// Time.
    pub at: Instant,
    /// Position, metres.
    pub position: Point,
}

/// Motion after the last way-point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Repeat {
    /// The obstacle stays there.
    #[default]
    Once,
    /// From the beginning again; the last position must be the first, so that the obstacle does not
    /// jump.
    Loop,
    /// Back along the same path, then forth again.
    PingPong,
}

/// Timed way-points, their times rising. Before the first the obstacle waits at the first.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// The waypoints, at least one.
    pub waypoints: Vec<Waypoint>,
    /// Motion after the last way-point.
    pub repeat: Repeat,
}

impl Path {
    /// Position of the obstacle at `now`. Meant for paths that a scene has accepted; an empty path
    /// is at the origin.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A path that is at x = 0 after 1 s, at x = 2 after 3 s, at x = 3 after 4 s.
    fn path(repeat: Repeat) -> Path {
        let waypoint = |secs, x| Waypoint {
            at: Instant::from_secs(secs),
            position: Point::new(x, 0.5),
        };
        Path {
            waypoints: vec![waypoint(1, 0.0), waypoint(3, 2.0), waypoint(4, 3.0)],
            repeat,
        }
    }

    fn x_at(repeat: Repeat, millis: u64) -> f64 {
        path(repeat).position(Instant::from_millis(millis)).x
    }

    #[test]
    fn an_obstacle_waits_walks_straight_and_stays() {
        assert_eq!(x_at(Repeat::Once, 0), 0.0);
        assert_eq!(x_at(Repeat::Once, 1_000), 0.0);
        assert_eq!(x_at(Repeat::Once, 2_500), 1.5);
        assert_eq!(x_at(Repeat::Once, 3_000), 2.0);
        assert_eq!(x_at(Repeat::Once, 4_000), 3.0);
        assert_eq!(x_at(Repeat::Once, 1_000_000), 3.0);
    }

    #[test]
    fn ping_pong_walks_back_the_same_way() {
        assert_eq!(x_at(Repeat::PingPong, 3_500), 2.5);
        assert_eq!(x_at(Repeat::PingPong, 4_500), 2.5);
        assert_eq!(x_at(Repeat::PingPong, 7_000), 0.0);
        assert_eq!(x_at(Repeat::PingPong, 8_500), 1.5);
    }

    #[test]
    fn a_loop_begins_again_after_three_seconds() {
        assert_eq!(x_at(Repeat::Loop, 2_500), 1.5);
        assert_eq!(x_at(Repeat::Loop, 5_500), 1.5);
    }

    #[test]
    fn a_single_waypoint_is_a_place() {
        let waypoint = Waypoint {
            at: Instant::ZERO,
            position: Point::new(1.0, 2.0),
        };
        let path = Path {
            waypoints: vec![waypoint],
            repeat: Repeat::PingPong,
        };
        assert_eq!(path.position(Instant::from_secs(9)), Point::new(1.0, 2.0));
        assert_eq!(path.top_speed_m_s(), 0.0);
    }

    #[test]
    fn the_top_speed_is_that_of_the_fastest_leg() {
        let mut path = path(Repeat::Once);
        path.waypoints[2].position.x = 4.5;
        assert_eq!(path.top_speed_m_s(), 2.5);
    }

    /// From (0, 1) after 1 s to (2, -3) after 3 s: a quarter of it is (0.5, 0), three quarters are
    /// (1.5, -2).
    #[test]
    fn an_obstacle_walks_in_both_coordinates() {
        let waypoint = |secs, x, y| Waypoint {
            at: Instant::from_secs(secs),
            position: Point::new(x, y),
        };
        let path = Path {
            waypoints: vec![waypoint(1, 0.0, 1.0), waypoint(3, 2.0, -3.0)],
            repeat: Repeat::Loop,
        };
        let at = |millis| path.position(Instant::from_millis(millis));
        let there = [at(500), at(1_500), at(2_500), at(3_500), at(4_500)];
        let by_hand = [(0.0, 1.0), (0.5, 0.0), (1.5, -2.0), (0.5, 0.0), (1.5, -2.0)];
        assert_eq!(there, by_hand.map(|(x, y)| Point::new(x, y)));
        assert_eq!(path.top_speed_m_s(), 20.0_f64.sqrt() / 2.0);
    }
}
