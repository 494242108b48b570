//! Progress of the robot's mission, judged by its true position.

use core::time::Duration;

use emulators::world::{Point, Pose};
use protocols::Instant;

use crate::scenario::{Expect, Mission};

/// Distance that counts as a visit if the scenario names none, mm.
const WITHIN_MM: f64 = 200.0;
/// Time at rest after which a mission is over if the scenario names none.
const REST: Duration = Duration::from_secs(2);

/// Maximum distance of a visit, mm, and rest time that ends the mission.
fn visits_and_rest(expect: &Expect) -> (f64, Duration) {
    (
        expect.visit_within_mm.unwrap_or(WITHIN_MM),
        expect.settle.map_or(REST, |settle| settle.0),
    )
}

/// Whether these expectations end a run at the same moment. All others are judged at the end.
pub(super) fn ends_alike(a: &Expect, b: &Expect) -> bool {
    let ends = |expect: &Expect| {
        let is_home_wanted = expect.home_within_mm.is_some();
        let is_map_wanted = expect.map_received == Some(true);
        (visits_and_rest(expect), is_home_wanted, is_map_wanted)
    };
    ends(a) == ends(b)
}

/// A visited waypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visit {
    /// Time of the first visit.
    pub at: Instant,
    /// Position of the waypoint.
    pub waypoint: Point,
    /// Smallest distance from the waypoint before the next one was reached, mm.
    pub nearest_mm: f64,
}

/// Follows the robot from waypoint to waypoint.
#[derive(Clone, Debug)]
pub struct Progress {
    waypoints: Vec<Point>,
    /// Remaining waypoints: only the first may be next, or any of them.
    left: Vec<Point>,
    any_order: bool,
    within_mm: f64,
    settle: Duration,
    visits: Vec<Visit>,
    resting_since: Option<Instant>,
    last: Option<Point>,
}

impl Progress {
    /// The state at the start of `mission`.
    pub fn new(mission: &Mission, expect: &Expect) -> Self {
        let waypoints = mission.waypoints_m.iter();
        let waypoints: Vec<Point> = waypoints.map(|&[x, y]| Point::new(x, y)).collect();
        let (within_mm, settle) = visits_and_rest(expect);
        Self {
            left: waypoints.clone(),
            waypoints,
            any_order: mission.any_order,
            within_mm,
            settle,
            visits: Vec::new(),
            resting_since: None,
            last: None,
        }
    }

    /// Updates the progress with the true pose of the robot, and with whether it moves.
    pub fn observe(&mut self, now: Instant, pose: Pose, is_moving: bool) {
        let place = pose.point();
        self.last = Some(place);
        let distance_mm = |waypoint: Point| waypoint.distance(place) * 1000.0;
        if let Some(visit) = self.visits.last_mut() {
            visit.nearest_mm = visit.nearest_mm.min(distance_mm(visit.waypoint));
        }
        let next = if self.any_order { self.left.len() } else { 1 };
        let mut next = self.left.iter().take(next);
        let is_near = |waypoint: &Point| distance_mm(*waypoint) <= self.within_mm;
        if let Some(index) = next.position(is_near) {
            let waypoint = self.left.remove(index);
            self.visits.push(Visit {
                at: now,
                waypoint,
                nearest_mm: distance_mm(waypoint),
            });
        }
        if is_moving {
            self.resting_since = None;
        } else if self.resting_since.is_none() {
            self.resting_since = Some(now);
        }
    }

    /// The waypoints visited so far, in the order of the visits.
    pub fn visits(&self) -> &[Visit] {
        &self.visits
    }

    /// Number of waypoints.
    pub fn waypoints(&self) -> usize {
        self.waypoints.len()
    }

    /// Whether every waypoint was visited in order and the robot has come to rest.
    pub fn is_over(&self, now: Instant) -> bool {
        !self.waypoints.is_empty()
            && self.visits.len() == self.waypoints.len()
            && self.has_settled(now)
    }

    /// Whether the robot has been at rest for long enough.
    pub fn has_settled(&self, now: Instant) -> bool {
        self.rested(now) >= self.settle
    }

    /// Distance from `place`, mm.
    pub fn distance_from_mm(&self, place: Point) -> Option<f64> {
        Some(place.distance(self.last?) * 1000.0)
    }

    /// Time for which the robot has rested.
    pub fn rested(&self, now: Instant) -> Duration {
        let since = self.resting_since.unwrap_or(now);
        now - since
    }

    /// Distance from the last waypoint, mm.
    pub fn distance_from_last_mm(&self) -> Option<f64> {
        Some(self.waypoints.last()?.distance(self.last?) * 1000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Span;

    /// Two waypoints: 1 m and 3 m ahead.
    fn progress(any_order: bool, expect: &Expect) -> Progress {
        let mission = Mission {
            waypoints_m: vec![[1.0, 0.0], [3.0, 0.0]],
            any_order,
            ..Mission::default()
        };
        Progress::new(&mission, expect)
    }

    fn at(progress: &mut Progress, secs: u64, x: f64, is_moving: bool) {
        progress.observe(Instant::from_secs(secs), Pose::new(x, 0.0, 0.0), is_moving);
    }

    /// 200 mm are near enough by default. The nearest approach continues until the next
    /// waypoint is reached.
    #[test]
    fn waypoints_are_visited_in_their_order() {
        let mut progress = progress(false, &Expect::default());
        at(&mut progress, 1, 3.0, true);
        at(&mut progress, 2, 1.25, true);
        assert_eq!(progress.visits(), []);
        at(&mut progress, 3, 1.1875, true);
        at(&mut progress, 4, 0.9375, true);
        at(&mut progress, 5, 1.5, true);
        let visit = progress.visits()[0];
        assert_eq!((visit.at, visit.nearest_mm), (Instant::from_secs(3), 62.5));
        assert_eq!(visit.waypoint, Point::new(1.0, 0.0));
        assert_eq!((progress.visits().len(), progress.waypoints()), (1, 2));
        assert_eq!(progress.distance_from_last_mm(), Some(1500.0));
        let place = Point::new(1.5, 2.0);
        assert_eq!(progress.distance_from_mm(place), Some(2000.0));
        at(&mut progress, 6, 3.0, true);
        let times: Vec<_> = progress.visits().iter().map(|visit| visit.at).collect();
        assert_eq!(times, [3, 6].map(Instant::from_secs));
    }

    #[test]
    fn in_any_order_the_nearest_one_counts() {
        let expect = Expect {
            visit_within_mm: Some(500.0),
            ..Expect::default()
        };
        let mut progress = progress(true, &expect);
        at(&mut progress, 1, 3.5, true);
        at(&mut progress, 2, 0.25, true);
        at(&mut progress, 3, 0.5, true);
        let visits = progress.visits().iter();
        let visits: Vec<_> = visits
            .map(|visit| (visit.at.as_millis(), visit.waypoint.x))
            .collect();
        assert_eq!(visits, [(1000, 3.0), (3000, 1.0)]);
    }

    /// A mission is over when all waypoints were visited and the robot has rested for two seconds.
    #[test]
    fn a_mission_is_over_after_two_seconds_at_rest_behind_its_last_waypoint() {
        let mut progress = progress(false, &Expect::default());
        let over = |progress: &Progress, secs| progress.is_over(Instant::from_secs(secs));
        assert_eq!(progress.rested(Instant::from_secs(9)), Duration::ZERO);
        at(&mut progress, 1, 1.0, false);
        at(&mut progress, 2, 1.0, false);
        assert_eq!(
            progress.rested(Instant::from_secs(4)),
            Duration::from_secs(3)
        );
        assert!(progress.has_settled(Instant::from_secs(4)));
        assert!(!over(&progress, 4));
        at(&mut progress, 5, 3.0, true);
        assert!(!over(&progress, 9));
        at(&mut progress, 6, 3.0, false);
        assert_eq!([7, 8].map(|secs| over(&progress, secs)), [false, true]);
        let mut nowhere = Progress::new(&Mission::default(), &Expect::default());
        assert_eq!(nowhere.distance_from_last_mm(), None);
        at(&mut nowhere, 1, 0.0, false);
        assert!(nowhere.has_settled(Instant::from_secs(9)) && !over(&nowhere, 9));
    }

    #[test]
    fn a_scenario_says_how_long_a_rest_is() {
        let expect = Expect {
            settle: Some(Span(Duration::from_secs(5))),
            ..Expect::default()
        };
        let mut progress = progress(false, &expect);
        at(&mut progress, 1, 0.0, false);
        let settled = [5, 6].map(|secs| progress.has_settled(Instant::from_secs(secs)));
        assert_eq!(settled, [false, true]);
    }

    /// A rest and a distance by default are those that a scenario may name; a map that is not
    /// wanted, or not expected, ends no run.
    #[test]
    fn runs_end_alike_by_what_they_wait_for() {
        let alike = |change: fn(&mut Expect)| {
            let mut other = Expect::default();
            change(&mut other);
            ends_alike(&Expect::default(), &other)
        };
        assert!(alike(|_| {}));
        assert!(alike(|it| it.map_received = Some(false)));
        assert!(!alike(|it| it.map_received = Some(true)));
        assert!(!alike(|it| it.home_within_mm = Some(100.0)));
        assert!(alike(|it| it.visit_within_mm = Some(200.0)));
        assert!(!alike(|it| it.visit_within_mm = Some(201.0)));
        assert!(alike(|it| it.settle = Some(Span::from_millis(2_000))));
        assert!(!alike(|it| it.settle = Some(Span::from_millis(2_001))));
        assert!(alike(|it| it.pose_rms_mm_max = Some(9.0)));
    }
}
