//! What stops the body: walls and obstacles. And what moves it besides its wheels: hands.
//!
//! A motion that would bring the body into a surface is cut short where they meet: by [`disc`] for
//! a round body, by [`outline`] for one with corners; any way out stays free. An obstacle that
//! walks into the body shoves it along, but through no wall. Tests are skipped for as long as the
//! free distance measured last cannot have been used up.

mod disc;
mod outline;
mod push;

use protocols::Instant;

use super::body::{Footprint, Motion, Outline, STEP_S};
use super::geometry::{Point, Pose};
use super::scene::{Near, Scene};
pub(super) use push::Push;

/// Free distance beyond which nobody looks.
const REACH_M: f64 = 1.0;
/// Where to look first.
const CLOSE_M: f64 = 0.02;
/// The body has left a surface when it is this far off.
const LEFT_M: f64 = 1e-3;
/// Contacts kept until somebody takes them; more are counted only.
const CONTACTS_MAX: usize = 1024;

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
    footprint: Footprint,
    obstacle_speed: f64,
    /// Distance that body and obstacles may still go before anything can touch.
    free: f64,
    /// Surfaces that the body touches, ascending.
    touching: Vec<usize>,
    contacts: Vec<Contact>,
    count: u64,
}

impl Bumper {
    pub(super) fn new(scene: &Scene, footprint: Footprint) -> Self {
        Self {
            footprint,
            obstacle_speed: scene.obstacle_speed_m_s(),
            free: 0.0,
            touching: Vec::new(),
            contacts: Vec::new(),
            count: 0,
        }
    }

    /// Free distance around a body at `pose`; at most [`REACH_M`].
    pub(super) fn clearance(&self, scene: &Scene, at: Instant, pose: Pose) -> f64 {
        let Outline::Circle { radius_m } = self.footprint.outline() else {
            return outline::clearance(&self.footprint, scene, at, pose);
        };
        let place = pose.point();
        let far = REACH_M + radius_m;
        // Most questions come from a body that stands close to something.
        let mut least = [radius_m + CLOSE_M, far]
            .into_iter()
            .find_map(|reach| scene.nearest_fixed(place, reach))
            .map_or(far, |near| near.distance);
        scene.each_moving(at, place, |near| least = least.min(near.distance));
        least - radius_m
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

    pub(super) fn is_touching(&self) -> bool {
        !self.touching.is_empty()
    }

    /// What is left of the motion `wanted` for the step that begins at `began`.
    pub(super) fn constrain(&mut self, scene: &Scene, began: Instant, wanted: Motion) -> Motion {
        let radius = match self.footprint.outline() {
            Outline::Circle { radius_m } => Some(radius_m),
            Outline::Polygon(_) => None,
        };
        let mut own = wanted.speed.abs() + wanted.drift.x.abs() + wanted.drift.y.abs();
        let mut margin = 0.0;
        if radius.is_none() {
            own += wanted.turn.abs() * self.footprint.reach_m();
            margin = outline::MARGIN_M;
        }
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
            self.free = self.clearance(scene, began, wanted.start) - margin - used;
            if self.free > 0.0 {
                return wanted;
            }
        }
        self.free = 0.0;
        match radius {
            Some(radius) => self.collide_disc(scene, (began, wanted), radius, used),
            None => self.collide_outline(scene, (began, wanted), used),
        }
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
