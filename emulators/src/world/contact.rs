//! What stops the body: walls and obstacles. And what moves it besides its wheels: hands.
//!
//! The body is a disc. A surface that the next step would bring into the disc blocks the step's
//! translation where they meet; turning on the spot stays free, and so does any way out. An
//! obstacle that walks into the body shoves it along, but through no wall. Tests are skipped for as
//! long as the free distance measured last cannot have been used up.

use core::time::Duration;

use protocols::Instant;

use super::body::{Motion, STEP_NANOS, STEP_S};
use super::geometry::{Point, Pose};
use super::scene::{Near, Scene};

/// Free distance beyond which nobody looks.
const REACH_M: f64 = 1.0;
/// Where to look first.
const CLOSE_M: f64 = 0.02;
/// The body has left a surface when it is this far off.
const LEFT_M: f64 = 1e-3;
/// Contacts kept until somebody takes them; more are counted only.
const CONTACTS_MAX: usize = 1024;
/// Speed limits of a push.
const PUSH_MAX_M_S: f64 = 5.0;
const TWIST_MAX_RAD_S: f64 = 20.0;

/// The body met a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Beginning of the step in which they met.
    pub at: Instant,
    /// How fast body and surface approached each other, m/s.
    pub speed_m_s: f64,
    /// Where on the surface.
    pub place: Point,
}

/// Keeps the body out of walls and remembers what it met.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Bumper {
    radius: f64,
    obstacle_speed: f64,
    /// Distance that body and obstacles may still go before anything can touch.
    free: f64,
    /// Surfaces that the body touches, ascending.
    touching: Vec<usize>,
    contacts: Vec<Contact>,
    count: u64,
}

impl Bumper {
    pub(super) fn new(scene: &Scene, radius: f64) -> Self {
        Self {
            radius,
            obstacle_speed: scene.obstacle_speed_m_s(),
            free: 0.0,
            touching: Vec::new(),
            contacts: Vec::new(),
            count: 0,
        }
    }

    /// Free distance around a body at `place`; at most [`REACH_M`].
    pub(super) fn clearance(&self, scene: &Scene, at: Instant, place: Point) -> f64 {
        let far = REACH_M + self.radius;
        // Most questions come from a body that stands close to something.
        let mut least = [self.radius + CLOSE_M, far]
            .into_iter()
            .find_map(|reach| scene.nearest_fixed(place, reach))
            .map_or(far, |near| near.distance);
        scene.each_moving(at, place, |near| least = least.min(near.distance));
        least - self.radius
    }

    /// The body was put elsewhere.
    pub(super) fn forget(&mut self) {
        self.free = 0.0;
        self.touching.clear();
    }

    pub(super) fn take_contacts(&mut self) -> Vec<Contact> {
        core::mem::take(&mut self.contacts)
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }

    /// What is left of the motion `wanted` for the step that begins at `began`.
    pub(super) fn constrain(&mut self, scene: &Scene, began: Instant, wanted: Motion) -> Motion {
        let own = wanted.speed.abs() + wanted.drift.x.abs() + wanted.drift.y.abs();
        let used = (own + self.obstacle_speed) * STEP_S;
        if used == 0.0 {
            return wanted;
        }
        self.free -= used;
        if self.free > 0.0 {
            return wanted;
        }
        // A body that leans on something is near to it; no need to ask.
        if self.touching.is_empty() {
            self.free = self.clearance(scene, began, wanted.start.point()) - used;
            if self.free > 0.0 {
                return wanted;
            }
        }
        self.free = 0.0;
        self.collide(scene, began, wanted, used)
    }

    /// The slow way: each surface near by is measured at the beginning and the end of the step.
    fn collide(&mut self, scene: &Scene, began: Instant, wanted: Motion, used: f64) -> Motion {
        let ended = began + Duration::from_nanos(STEP_NANOS);
        let start = wanted.start.point();
        let end = wanted.pose(STEP_S).point();
        let mut test = Test {
            radius: self.radius,
            part: 1.0,
            met: Vec::new(),
        };
        test.fixtures(scene, start, end, used + LEFT_M);
        if self.obstacle_speed > 0.0 {
            test.obstacles(scene, (began, start), (ended, end));
        }
        let mut motion = wanted.slowed(test.part);
        if self.obstacle_speed > 0.0 {
            let shove = self.shove(scene, began, ended, motion.pose(STEP_S).point());
            motion.drift.x += shove.x / STEP_S;
            motion.drift.y += shove.y / STEP_S;
        }
        self.record(began, test.met);
        motion
    }

    /// How far an obstacle that stands in the body at the end of the step moves it: out of its own
    /// way, but into no wall. A body between the two stays where it is, and a surface that has
    /// passed its middle leaves it behind.
    fn shove(&self, scene: &Scene, began: Instant, ended: Instant, place: Point) -> Point {
        let mut before = Vec::new();
        scene.each_moving(began, place, |near| before.push(near));
        let mut before = before.into_iter();
        let mut deepest: Option<Near> = None;
        scene.each_moving(ended, place, |near| {
            let comes = before.next().is_some_and(|before| {
                near.distance < before.distance && same_side(place, before.at, near.at)
            });
            if comes && near.distance < deepest.map_or(self.radius, |deepest| deepest.distance) {
                deepest = Some(near);
            }
        });
        let Some(near) = deepest.filter(|near| near.distance > 0.0) else {
            return Point::default();
        };
        let way = (self.radius - near.distance).min(self.obstacle_speed * STEP_S);
        let scale = way / near.distance;
        let by = Point::new((place.x - near.at.x) * scale, (place.y - near.at.y) * scale);
        let to = Point::new(place.x + by.x, place.y + by.y);
        let mut test = Test {
            radius: self.radius,
            part: 1.0,
            met: Vec::new(),
        };
        test.fixtures(scene, place, to, way);
        Point::new(by.x * test.part, by.y * test.part)
    }

    /// One contact for all surfaces met in one step, unless the body leaned on each already.
    fn record(&mut self, at: Instant, mut met: Vec<(Near, f64)>) {
        met.sort_by_key(|(near, _)| near.index);
        met.dedup_by_key(|(near, _)| near.index);
        let fresh = met.iter().filter(|(near, approach)| {
            *approach > 0.0 && self.touching.binary_search(&near.index).is_err()
        });
        if let Some((near, approach)) = fresh.copied().reduce(|a, b| if b.1 > a.1 { b } else { a })
        {
            self.count += 1;
            if self.contacts.len() < CONTACTS_MAX {
                let speed_m_s = approach / STEP_S;
                self.contacts.push(Contact {
                    at,
                    speed_m_s,
                    place: near.at,
                });
            }
        }
        self.touching = met
            .iter()
            .filter(|(near, approach)| {
                *approach > 0.0 || self.touching.binary_search(&near.index).is_ok()
            })
            .map(|(near, _)| near.index)
            .collect();
    }
}

/// What the surfaces near by leave of one step.
struct Test {
    radius: f64,
    /// Part of the translation that is free.
    part: f64,
    /// Surfaces in touch, and how much nearer they came; 0 if they only stay near.
    met: Vec<(Near, f64)>,
}

impl Test {
    /// Fixtures near the way from `start` to `end`, which is at most `way` long.
    fn fixtures(&mut self, scene: &Scene, start: Point, end: Point, way: f64) {
        scene.each_fixed_near(start, self.radius + way, |stay| {
            self.surface(stay, stay, scene.fixed(stay.index, end));
        });
    }

    /// Obstacles, which move meanwhile.
    fn obstacles(
        &mut self,
        scene: &Scene,
        (began, start): (Instant, Point),
        (ended, end): (Instant, Point),
    ) {
        let near = |at: Instant, place: Point| {
            let mut found = Vec::new();
            scene.each_moving(at, place, |near| found.push(near));
            found
        };
        let stays = near(ended, start).into_iter().zip(near(ended, end));
        for (before, (stay, go)) in near(began, start).into_iter().zip(stays) {
            self.surface(before, stay, go);
        }
    }

    /// `before`: at the beginning; `stay` and `go`: at the end, if the body stays or goes.
    fn surface(&mut self, before: Near, stay: Near, go: Near) {
        let enters = go.distance < self.radius && go.distance < before.distance;
        if enters {
            self.met.push((go, before.distance - go.distance));
        } else if go.distance < self.radius + LEFT_M {
            self.met.push((go, 0.0));
        }
        let own_way = stay.distance - go.distance;
        if enters && own_way > 0.0 {
            let free = (stay.distance - self.radius).max(0.0);
            self.part = self.part.min(free / own_way);
        }
    }
}

/// Whether `one` and `other` lie in the same half of the floor as seen from `place`.
fn same_side(place: Point, one: Point, other: Point) -> bool {
    (one.x - place.x) * (other.x - place.x) + (one.y - place.y) * (other.y - place.y) > 0.0
}

/// Hands that move the robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Push {
    /// Speed and turn rate of the push.
    rate: Pose,
    steps_left: u64,
}

impl Push {
    pub(super) fn add(&mut self, by: Pose, over: Duration) {
        assert!(by.is_finite(), "a push by a distance that is not finite");
        let left = steps_f64(self.steps_left) * STEP_S;
        let total = Pose::new(
            by.x + self.rate.x * left,
            by.y + self.rate.y * left,
            by.theta + self.rate.theta * left,
        );
        let way = Point::default().distance(total.point());
        let least_s = (way / PUSH_MAX_M_S).max(total.theta.abs() / TWIST_MAX_RAD_S);
        let seconds = over.as_secs_f64().max(least_s).max(STEP_S);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates"
        )]
        let steps = (seconds / STEP_S).ceil() as u64;
        let span = steps_f64(steps) * STEP_S;
        self.rate = Pose::new(total.x / span, total.y / span, total.theta / span);
        self.steps_left = steps;
    }

    /// Speed and turn rate that the push adds to the next step.
    pub(super) fn step(&mut self) -> (Point, f64) {
        if self.steps_left == 0 {
            return (Point::default(), 0.0);
        }
        self.steps_left -= 1;
        (self.rate.point(), self.rate.theta)
    }
}

#[expect(
    clippy::cast_precision_loss,
    reason = "exact for the first 285,000 years"
)]
fn steps_f64(steps: u64) -> f64 {
    steps as f64
}
