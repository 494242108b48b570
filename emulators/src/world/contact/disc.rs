//! Collisions of a disc: by the distance of its middle from each surface.
//!
//! If a surface would enter the disc in the next step, the contact ends the step's translation.
//! Turning on the spot stays free, and so does motion away.

use core::time::Duration;

use protocols::Instant;

use super::{Approach, Bumper, LEFT_M};
use crate::world::body::{Motion, STEP_NANOS, STEP_S};
use crate::world::geometry::Point;
use crate::world::scene::{Near, Scene};

impl Bumper {
    /// The slow test: each near surface is measured at the beginning and the end of the step.
    pub(super) fn collide_disc(
        &mut self,
        scene: &Scene,
        (began, wanted): (Instant, Motion),
        radius: f64,
        used: f64,
    ) -> Motion {
        let ended = began + Duration::from_nanos(STEP_NANOS);
        let start = wanted.start.point();
        let end = wanted.pose(STEP_S).point();
        let mut test = Test {
            radius,
            part: 1.0,
            met: Vec::new(),
        };
        test.fixtures(scene, start, end, used + LEFT_M);
        if scene.has_moving() {
            test.obstacles(scene, (began, start), (ended, end));
        }
        let mut motion = wanted.slowed(test.part);
        if scene.has_moving() {
            let shove = self.shove_disc(scene, radius, (began, ended), motion.pose(STEP_S).point());
            motion.drift.x += shove.x / STEP_S;
            motion.drift.y += shove.y / STEP_S;
        }
        self.record(began, test.met);
        motion
    }

    /// Distance by which an obstacle that stands in the body at the end of the step moves the body:
    /// out of the obstacle's path, but into no wall. A body between the two stays. A surface that
    /// has passed the body's middle leaves the body behind.
    fn shove_disc(
        &self,
        scene: &Scene,
        radius: f64,
        (began, ended): (Instant, Instant),
        place: Point,
    ) -> Point {
        let mut before = Vec::new();
        scene.each_moving(began, place, |near| before.push(near));
        let mut before = before.into_iter();
        let mut deepest: Option<Near> = None;
        scene.each_moving(ended, place, |near| {
            let comes = before.next().is_some_and(|before| {
                near.distance < before.distance && same_side(place, before.at, near.at)
            });
            if comes && near.distance < deepest.map_or(radius, |deepest| deepest.distance) {
                deepest = Some(near);
            }
        });
        let Some(near) = deepest.filter(|near| near.distance > 0.0) else {
            return Point::default();
        };
        let way = (radius - near.distance).min(self.obstacle_speed * STEP_S);
        let scale = way / near.distance;
        let by = Point::new((place.x - near.at.x) * scale, (place.y - near.at.y) * scale);
        let to = Point::new(place.x + by.x, place.y + by.y);
        let mut test = Test {
            radius,
            part: 1.0,
            met: Vec::new(),
        };
        test.fixtures(scene, place, to, way);
        Point::new(by.x * test.part, by.y * test.part)
    }
}

/// Free part of one step among the near surfaces.
struct Test {
    radius: f64,
    /// Part of the translation that is free.
    part: f64,
    /// Surfaces in touch, and how much nearer they came.
    met: Vec<(Near, Approach)>,
}

impl Test {
    /// Tests fixtures near the line from `start` to `end`, which is at most `way` long.
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
        let own = stay.distance - go.distance;
        if enters {
            let both = before.distance - go.distance;
            self.met.push((go, Approach { both, own }));
        } else if go.distance < self.radius + LEFT_M {
            self.met.push((go, Approach::default()));
        }
        if enters && own > 0.0 {
            let free = (stay.distance - self.radius).max(0.0);
            self.part = self.part.min(free / own);
        }
    }
}

/// Whether `one` and `other` lie in the same half of the floor as seen from `place`.
fn same_side(place: Point, one: Point, other: Point) -> bool {
    (one.x - place.x) * (other.x - place.x) + (one.y - place.y) * (other.y - place.y) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(distance: f64) -> Near {
        Near {
            index: 0,
            at: Point::default(),
            distance,
        }
    }

    /// For a body of 0.5 m: the free part of its motion, the distance by which the surface came
    /// nearer, and the body's own share of that.
    fn left(before: f64, stay: f64, go: f64) -> (f64, Option<[f64; 2]>) {
        let mut test = Test {
            radius: 0.5,
            part: 1.0,
            met: Vec::new(),
        };
        test.surface(near(before), near(stay), near(go));
        let met = test.met.first().map(|met| [met.1.both, met.1.own]);
        (test.part, met)
    }

    #[test]
    fn a_surface_leaves_the_way_up_to_it() {
        let is = |found: (f64, Option<[f64; 2]>), part: f64, met: Option<[f64; 2]>| {
            let alike = |(a, b): (f64, f64)| (a - b).abs() < 1e-12;
            alike((found.0, part))
                && found
                    .1
                    .zip(met)
                    .is_none_or(|(a, b)| a.into_iter().zip(b).all(alike))
                && found.1.is_some() == met.is_some()
        };
        // The surface comes 0.2 m nearer, of which 0.1 m are free.
        assert!(is(left(0.6, 0.6, 0.4), 0.5, Some([0.2, 0.2])));
        // Motions up to the surface and no farther, away from it, and past it at a distance.
        assert!(is(left(0.6, 0.6, 0.5), 1.0, Some([0.0; 2])));
        assert!(is(left(0.4, 0.4, 0.45), 1.0, Some([0.0; 2])));
        assert!(is(left(0.9, 0.9, 0.8), 1.0, None));
        // The obstacle moves towards the body and does not limit the body's own motion, which leads
        // away.
        assert!(is(left(0.6, 0.4, 0.45), 1.0, Some([0.15, -0.05])));
        // If the body already overlaps, no motion is left.
        assert!(is(left(0.6, 0.45, 0.35), 0.0, Some([0.25, 0.1])));
        assert!(is(left(0.45, 0.45, 0.45), 1.0, Some([0.0; 2])));
        // No nearer at the end than at the beginning: a surface that went away blocks nothing.
        assert!(is(left(0.45, 0.47, 0.45), 1.0, Some([0.0; 2])));
    }

    #[test]
    fn two_places_lie_on_the_same_side() {
        let at = Point::new;
        let same = |one, other| same_side(at(1.0, 1.0), one, other);
        assert!(same(at(3.0, 2.0), at(2.0, 0.0)) && !same(at(3.0, 2.0), at(0.0, 2.0)));
        assert!(same(at(1.0, 4.0), at(0.0, 3.0)) && !same(at(1.0, 4.0), at(9.0, 0.5)));
        assert!(!same(at(2.0, 1.0), at(1.0, 2.0)));
    }
}
