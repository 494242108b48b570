//! Forces on the body besides its wheels: contacts with walls and obstacles, and pushes.
//!
//! A motion that would bring the body into a surface is cut short at the contact: by [`disc`] for a
//! round body, by [`outline`] for one with corners. Motion away stays free. An obstacle that moves
//! into the body pushes it along, but through no wall. Tests are skipped until the body may have
//! used up the last measured free distance.

mod disc;
mod outline;
mod push;

use protocols::Instant;

use super::body::{Footprint, Motion, Outline, STEP_S};
use super::geometry::{Point, Pose};
use super::scene::{Near, Scene};
pub(super) use push::Push;

/// Free distance beyond which contacts are not computed.
pub(super) const REACH_M: f64 = 1.0;
/// Margin around the body that is searched first, metres.
const CLOSE_M: f64 = 0.02;
/// Distance at which the body has left a surface.
const LEFT_M: f64 = 1e-3;
/// Contacts kept until they are taken; more are counted only.
const CONTACTS_MAX: usize = 1024;

/// Contact of the body with a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Beginning of the step in which they met.
    pub at: Instant,
    /// Closing speed of body and surface, m/s.
    pub speed_m_s: f64,
    /// Closing speed by the body's own motion, m/s: 0 if a person ran into it.
    pub own_m_s: f64,
    /// Position on the surface.
    pub place: Point,
}

/// Decrease of the distance between body and surface in a step, metres; 0 if they only stay near.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Approach {
    both: f64,
    /// Part of the decrease by the body's own motion; negative if it moved away.
    own: f64,
}

/// Keeps the body out of walls and records its contacts.
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

    /// Free distance around a body at `pose`; at most `limit_m`.
    pub(super) fn clearance(&self, scene: &Scene, at: Instant, pose: Pose, limit_m: f64) -> f64 {
        let Outline::Circle { radius_m } = self.footprint.outline() else {
            return outline::clearance(&self.footprint, scene, at, pose, limit_m);
        };
        let place = pose.point();
        let far = limit_m + radius_m;
        // Most questions come from a body that stands close to something.
        let close = Some(radius_m + CLOSE_M).filter(|&close| close < far);
        let mut least = close
            .into_iter()
            .chain([far])
            .find_map(|reach| scene.nearest_fixed(place, reach))
            .map_or(far, |near| near.distance);
        scene.each_moving(at, place, |near| least = least.min(near.distance));
        least - radius_m
    }

    /// Discards the stored distances and contacts, because the body was placed elsewhere.
    pub(super) fn forget(&mut self) {
        self.free = 0.0;
        self.touching.clear();
    }

    /// Requires a new measurement after a surface was placed elsewhere.
    pub(super) fn look_again(&mut self) {
        self.free = 0.0;
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

    /// Free part of the motion `wanted` in the step that begins at `began`.
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
        // A body that leans on a surface is near to it, so the test is not needed.
        if self.touching.is_empty() {
            self.free = self.clearance(scene, began, wanted.start, REACH_M) - margin - used;
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
    fn record(&mut self, at: Instant, mut met: Vec<(Near, Approach)>) {
        met.sort_by_key(|(near, _)| near.index);
        met.dedup_by_key(|(near, _)| near.index);
        let fresh = met.iter().filter(|(near, approach)| {
            approach.both > 0.0 && self.touching.binary_search(&near.index).is_err()
        });
        let own = fresh.clone().fold(0.0, |own: f64, met| own.max(met.1.own));
        let fastest = fresh.reduce(|a, b| if b.1.both > a.1.both { b } else { a });
        if let Some((near, approach)) = fastest {
            self.count += 1;
            if self.contacts.len() < CONTACTS_MAX {
                self.contacts.push(Contact {
                    at,
                    speed_m_s: approach.both / STEP_S,
                    own_m_s: own / STEP_S,
                    place: near.at,
                });
            }
        }
        self.touching = met
            .iter()
            .filter(|(near, approach)| {
                approach.both > 0.0 || self.touching.binary_search(&near.index).is_ok()
            })
            .map(|(near, _)| near.index)
            .collect();
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene::Shape;
    use super::*;

    /// The bumper computes nothing while the last free distance lasts. Beside a body of 0.1 m at
    /// the side of a wall 1 m away 0.9 m are free. Without a surface the free distance is 1 m at
    /// most.
    #[test]
    fn free_distance_is_used_up_before_anybody_looks_again() {
        let wall = Shape::Wall {
            from: Point::new(1.0, -5.0),
            to: Point::new(1.0, 5.0),
        };
        let scene = Scene::new([wall], vec![]).expect("a wall");
        let body = Footprint::circle(0.1).expect("round");
        let mut bumper = Bumper::new(&scene, body);
        let wanted = Motion {
            speed: -2.0,
            ..Motion::default()
        };
        let mut free = [0.0; 3];
        for free in &mut free {
            assert_eq!(bumper.constrain(&scene, Instant::ZERO, wanted), wanted);
            *free = bumper.free;
        }
        // The body moves 2 mm in a step.
        for (found, expected) in free.into_iter().zip([0.898, 0.896, 0.894]) {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
        bumper.forget();
        assert_eq!(bumper.free, 0.0);
        let still = Motion::default();
        assert_eq!(bumper.constrain(&scene, Instant::ZERO, still), still);
        assert_eq!(bumper.free, 0.0);
    }

    fn near(index: usize, distance: f64) -> Near {
        Near {
            index,
            at: Point::new(distance, 0.0),
            distance,
        }
    }

    /// Of two surfaces met in one step, the faster one makes the contact; a millimetre in a step of
    /// a millisecond is 1 m/s. A body that leans on a surface continues to touch it until the body
    /// moves away.
    #[test]
    fn a_step_makes_one_contact_at_most() {
        let scene = Scene::new::<Shape>([], vec![]).expect("empty");
        let mut bumper = Bumper::new(&scene, Footprint::circle(0.1).expect("round"));
        let own = |both| Approach { both, own: both };
        bumper.record(
            Instant::from_millis(5),
            vec![(near(3, 0.2), own(1e-3)), (near(1, 0.1), own(2e-3))],
        );
        assert_eq!(
            (bumper.count(), bumper.touching.as_slice()),
            (1, &[1, 3][..])
        );
        let contacts = bumper.take_contacts();
        assert_eq!(
            (contacts.len(), contacts[0].at),
            (1, Instant::from_millis(5))
        );
        assert!((contacts[0].speed_m_s - 2.0).abs() < 1e-12 && contacts[0].place.x == 0.1);
        // Contact with both, then with one beside another that is only near, then with none.
        bumper.record(
            Instant::from_millis(6),
            vec![(near(1, 0.1), own(1e-3)), (near(3, 0.2), own(0.0))],
        );
        assert_eq!(
            (bumper.count(), bumper.touching.as_slice()),
            (1, &[1, 3][..])
        );
        bumper.record(
            Instant::from_millis(7),
            vec![(near(3, 0.1), own(0.0)), (near(5, 0.2), own(0.0))],
        );
        assert_eq!((bumper.count(), bumper.touching.as_slice()), (1, &[3][..]));
        bumper.record(Instant::from_millis(8), vec![]);
        assert!(!bumper.is_touching() && bumper.take_contacts().is_empty());
        bumper.record(
            Instant::from_millis(9),
            vec![(near(3, 0.1), own(1e-3)), (near(3, 0.1), own(5e-3))],
        );
        assert_eq!((bumper.count(), bumper.is_touching()), (2, true));
    }

    /// An obstacle runs into the robot at 1 m/s while the robot drives at a wall with 0.5 m/s: the
    /// record has both.
    #[test]
    fn the_robots_own_way_is_that_towards_any_surface_it_met() {
        let scene = Scene::new::<Shape>([], vec![]).expect("empty");
        let mut bumper = Bumper::new(&scene, Footprint::circle(0.1).expect("round"));
        let (comes, drives) = ([1e-3, -1e-3], [0.5e-3, 0.5e-3]);
        let met = [(1, comes), (2, drives)].map(|(index, [both, own])| {
            let near = near(index, 0.1);
            (near, Approach { both, own })
        });
        bumper.record(Instant::ZERO, met.to_vec());
        let contact = bumper.take_contacts()[0];
        assert!((contact.speed_m_s - 1.0).abs() < 1e-12, "{contact:?}");
        assert!((contact.own_m_s - 0.5).abs() < 1e-12, "{contact:?}");
    }

    /// Of a rectangle that reaches 0.5 m: speed, a push in both axes and the corners of a turn use
    /// up 2 + 0.25 + 0.5 + 4 times 0.5 mm in a step of 1 ms. Two micrometres are a margin.
    #[test]
    fn all_parts_of_a_motion_use_free_distance_up() {
        let scene = Scene::new::<Shape>([], vec![]).expect("empty");
        let body = Footprint::rectangle(0.3, 0.3, 0.8).expect("a rectangle");
        let mut bumper = Bumper::new(&scene, body);
        let wanted = Motion {
            speed: -2.0,
            turn: -4.0,
            drift: Point::new(-0.25, 0.5),
            ..Motion::default()
        };
        for left in [1.0 - 2e-6 - 4.75e-3, 1.0 - 2e-6 - 9.5e-3] {
            assert_eq!(bumper.constrain(&scene, Instant::ZERO, wanted), wanted);
            assert!((bumper.free - left).abs() < 1e-9, "{} {left}", bumper.free);
        }
    }

    /// A wall 0.9 m from a body of 0.1 m; a limit below the margin of 2 cm, and one above.
    #[test]
    fn free_distance_is_limited() {
        let wall = Shape::Wall {
            from: Point::new(1.0, -5.0),
            to: Point::new(1.0, 5.0),
        };
        let scene = Scene::new([wall], vec![]).expect("a wall");
        let bumper = Bumper::new(&scene, Footprint::circle(0.1).expect("round"));
        let free = |x: f64, limit_m: f64| {
            bumper.clearance(&scene, Instant::ZERO, Pose::new(x, 0.0, 0.0), limit_m)
        };
        for (x, limit_m, expected) in [
            (0.0, 1.0, 0.9),
            (0.0, 0.5, 0.5),
            (0.885, 0.01, 0.01),
            (0.885, 0.5, 0.015),
            (0.895, 0.01, 0.005),
            (0.95, 0.01, -0.05),
        ] {
            let found = free(x, limit_m);
            assert!((found - expected).abs() < 1e-9, "{x} {limit_m}: {found}");
        }
    }
}
