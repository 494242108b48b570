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
    /// The least distance until the next one was reached.
    pub nearest_mm: f64,
}

/// Follows the robot from waypoint to waypoint.
#[derive(Clone, Debug)]
pub struct Progress {
    waypoints: Vec<Point>,
    within_mm: f64,
    settle: Duration,
    visits: Vec<Visit>,
    resting_since: Option<Instant>,
    last: Option<Point>,
}

impl Progress {
    /// At the start of `mission`.
    pub fn new(mission: &Mission, expect: &Expect) -> Self {
        Self {
            waypoints: mission
                .waypoints_m
                .iter()
                .map(|&[x, y]| Point::new(x, y))
                .collect(),
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
        let distance_mm = |waypoint: &Point| waypoint.distance(place) * 1000.0;
        let next = self.visits.len();
        if let (Some(visit), Some(waypoint)) = (
            self.visits.last_mut(),
            next.checked_sub(1).and_then(|i| self.waypoints.get(i)),
        ) {
            visit.nearest_mm = visit.nearest_mm.min(distance_mm(waypoint));
        }
        if let Some(distance_mm) = self.waypoints.get(next).map(distance_mm)
            && distance_mm <= self.within_mm
        {
            self.visits.push(Visit {
                at: now,
                nearest_mm: distance_mm,
            });
        }
        if is_moving {
            self.resting_since = None;
        } else if self.resting_since.is_none() {
            self.resting_since = Some(now);
        }
    }

    /// The waypoints visited so far, in order.
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
