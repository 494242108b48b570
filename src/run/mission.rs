//! How far the robot has come with its mission, judged by where it truly is.

use core::time::Duration;

use emulators::world::{Point, Pose};
use protocols::Instant;

use crate::scenario::{Expect, Mission};

/// Distance that counts as a visit if the scenario names none, mm.
const WITHIN_MM: f64 = 200.0;
/// Time at rest after which a mission is over if the scenario names none.
const REST: Duration = Duration::from_secs(2);

/// A visited waypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visit {
    /// When the robot was first near enough.
    pub at: Instant,
    /// Which.
    pub waypoint: Point,
    /// The least distance until the next one was reached.
    pub nearest_mm: f64,
}

/// Follows the robot from waypoint to waypoint.
#[derive(Clone, Debug)]
pub struct Progress {
    waypoints: Vec<Point>,
    /// Which of them come next: the first alone, or any.
    left: Vec<Point>,
    any_order: bool,
    within_mm: f64,
    settle: Duration,
    visits: Vec<Visit>,
    resting_since: Option<Instant>,
    last: Option<Point>,
}

impl Progress {
    /// At the start of `mission`.
    pub fn new(mission: &Mission, expect: &Expect) -> Self {
        let waypoints = mission.waypoints_m.iter();
        let waypoints: Vec<Point> = waypoints.map(|&[x, y]| Point::new(x, y)).collect();
        Self {
            left: waypoints.clone(),
            waypoints,
            any_order: mission.any_order,
            within_mm: expect.visit_within_mm.unwrap_or(WITHIN_MM),
            settle: expect.settle.map_or(REST, |settle| settle.0),
            visits: Vec::new(),
            resting_since: None,
            last: None,
        }
    }

    /// Where the robot is now, and whether it moves.
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

    /// How many waypoints there are.
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

    /// How long the robot has been at rest.
    pub fn rested(&self, now: Instant) -> Duration {
        let since = self.resting_since.unwrap_or(now);
        now - since
    }

    /// Distance from the last waypoint, mm.
    pub fn distance_from_last_mm(&self) -> Option<f64> {
        Some(self.waypoints.last()?.distance(self.last?) * 1000.0)
    }
}
