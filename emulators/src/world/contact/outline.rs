//! Collisions of a body with corners: by the gap between its outline and each surface.
//!
//! The whole motion of a step is tried first. If a surface blocks it, the body turns as wanted and
//! moves as far as it can. If the turn itself is blocked, the body makes the free part of the
//! motion, or moves without turning. Motions are tried in pieces of at most 2 mm. The last piece is
//! halved until the body stands a micrometre off.
//!
//! Simplified: a part of the outline thinner than 2 mm may pass a surface as thin. A blocked body
//! does not slide along a wall that it meets at an angle, nor does the wall turn it. An obstacle
//! that moves into the body takes it along in the obstacle's direction, without turning it. A body
//! placed in a surface, or caught between an obstacle and a wall, may move wherever its middle
//! comes no closer to that surface.

mod gap;

use core::time::Duration;

use protocols::Instant;

use super::{Approach, Bumper, LEFT_M};
use crate::world::body::{Footprint, Motion, STEP_NANOS, STEP_S};
use crate::world::geometry::{Point, Pose, Primitive};
use crate::world::scene::{Near, Scene};
use gap::{Gap, distance, gap};

/// Gap at which body and surface touch: far above rounding, far below anything measured.
const TOUCH_M: f64 = 1e-6;
/// Distance within which no test is skipped.
pub(super) const MARGIN_M: f64 = 2.0 * TOUCH_M;
/// A smaller approach in one step is a rounding error, unless half of [`TOUCH_M`] is used up.
const CREEP_M: f64 = 1e-12;
/// Maximum motion of any corner between two looks, metres.
const PIECE_M: f64 = 2e-3;
/// Maximum number of looks at one motion: enough for a corner at 40 m/s.
const PIECES_MAX: u32 = 20;
/// Halvings of the last piece: 2 nm are left of it.
const HALVINGS: u32 = 20;
/// Minimum part of a step that is worth making.
const PART_MIN: f64 = 1e-6;

/// A surface that the body may meet in one step.
#[derive(Clone, Debug)]
struct Solid {
    index: usize,
    primitive: Primitive,
    /// Origin of the surface at the beginning and at the end of the step.
    places: [Point; 2],
    /// Gaps at the beginning of the step, and at its end if the body stays, both relative to the
    /// first position of the body.
    began: Gap,
    stay: Gap,
    /// Distance of the body's middle from the surface at the end, if the body stays.
    middle_m: f64,
}

/// Free distance around a body at `pose`, at most `limit_m`. In a surface: how deep the point of
/// the surface lies that is nearest to the body's middle.
pub(super) fn clearance(
    footprint: &Footprint,
    scene: &Scene,
    at: Instant,
    pose: Pose,
    limit_m: f64,
) -> f64 {
    let mut corners = Vec::new();
    footprint.place(pose, &mut corners);
    let middle = middle(footprint, pose);
    let mut least = limit_m;
    let reach = footprint.reach_m() + limit_m;
    scene.each_fixed_shape(pose.point(), reach, |_, primitive| {
        if primitive.nearest(pose.point()).1 - footprint.reach_m() < least {
            least = least.min(gap(&corners, middle, &primitive, Point::default()).gap);
        }
    });
    scene.each_moving_shape([at; 2], |_, [(primitive, place), _]| {
        least = least.min(gap(&corners, middle, &primitive, place).gap);
    });
    least
}

impl Bumper {
    /// The slow test: each near surface is measured along the motion.
    pub(super) fn collide_outline(
        &mut self,
        scene: &Scene,
        (began, wanted): (Instant, Motion),
        used: f64,
    ) -> Motion {
        let ended = began + Duration::from_nanos(STEP_NANOS);
        let mut step = Step::new(&self.footprint, wanted.start);
        step.find(scene, [began, ended], used);
        let mut motion = step.free(wanted);
        if scene.has_moving() {
            let by = step.shove(motion.pose(STEP_S));
            motion.drift.x += by.x / STEP_S;
            motion.drift.y += by.y / STEP_S;
        }
        step.rest(wanted, motion);
        let met = step.met;
        self.record(began, met);
        motion
    }
}

/// One step of the body among the surfaces near by.
struct Step<'a> {
    footprint: &'a Footprint,
    start: Pose,
    solids: Vec<Solid>,
    /// Surfaces in touch, and how much nearer they came; 0 if they only stay near.
    met: Vec<(Near, Approach)>,
    /// Corners of the body at the pose that is being tried.
    corners: Vec<Point>,
}

impl<'a> Step<'a> {
    fn new(footprint: &'a Footprint, start: Pose) -> Self {
        Self {
            footprint,
            start,
            solids: Vec::new(),
            met: Vec::new(),
            corners: Vec::new(),
        }
    }

    fn find(&mut self, scene: &Scene, times: [Instant; 2], used: f64) {
        let reach = self.footprint.reach_m() + used + LEFT_M;
        let here = self.start.point();
        let mut found = Vec::new();
        scene.each_fixed_shape(here, reach, |index, primitive| {
            if primitive.nearest(here).1 <= reach {
                found.push((index, [primitive; 2], [Point::default(); 2]));
            }
        });
        found.sort_by_key(|(index, ..)| *index);
        found.dedup_by_key(|(index, ..)| *index);
        scene.each_moving_shape(times, |index, both| {
            let near = |(primitive, place): &(Primitive, Point)| {
                let seen = Point::new(here.x - place.x, here.y - place.y);
                primitive.nearest(seen).1 <= reach
            };
            if both.iter().any(near) {
                let places = both.map(|(_, place)| place);
                found.push((index, both.map(|(primitive, _)| primitive), places));
            }
        });
        self.footprint.place(self.start, &mut self.corners);
        let middle = middle(self.footprint, self.start);
        type Found = (usize, [Primitive; 2], [Point; 2]);
        let solid = |(index, [first, primitive], places): Found| Solid {
            index,
            primitive,
            places,
            began: gap(&self.corners, middle, &first, places[0]),
            stay: gap(&self.corners, middle, &primitive, places[1]),
            middle_m: distance(middle, &primitive, places[1]),
        };
        self.solids = found.into_iter().map(solid).collect();
    }

    /// The part of `wanted` that no surface blocks.
    fn free(&mut self, wanted: Motion) -> Motion {
        let whole = self.cut(wanted, wanted, Motion::shortened);
        if whole == wanted {
            return wanted;
        }
        if self
            .blocked(wanted.slowed(0.0), Motion::shortened)
            .is_none()
        {
            return self.cut(wanted, wanted, Motion::slowed);
        }
        if whole != wanted.shortened(0.0) {
            return whole;
        }
        let straight = Motion {
            turn: 0.0,
            ..wanted
        };
        self.cut(wanted, straight, Motion::slowed)
    }

    /// The free part of `motion`; its contacts are recorded for the motion `wanted`.
    fn cut(&mut self, wanted: Motion, motion: Motion, cut: fn(Motion, f64) -> Motion) -> Motion {
        let Some((part, blockers)) = self.blocked(motion, cut) else {
            return motion;
        };
        let free = cut(motion, part);
        self.note(&blockers, wanted, free);
        free
    }

    /// Tries `cut(wanted, part)` for growing parts. Returns the last free one and the surfaces that
    /// block the next; `None` if all are free.
    fn blocked(
        &mut self,
        wanted: Motion,
        cut: fn(Motion, f64) -> Motion,
    ) -> Option<(f64, Vec<usize>)> {
        let corner = wanted.turn.abs() * self.footprint.reach_m();
        let speed = wanted.speed.abs() + wanted.drift.x.abs() + wanted.drift.y.abs() + corner;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates"
        )]
        let pieces = ((speed * STEP_S / PIECE_M).ceil() as u32).clamp(1, PIECES_MAX);
        let mut free = 0.0;
        for piece in 1..=pieces {
            let mut part = f64::from(piece) / f64::from(pieces);
            let mut blockers = self.blockers(cut(wanted, part).pose(STEP_S));
            if blockers.is_empty() {
                free = part;
                continue;
            }
            for _ in 0..HALVINGS {
                let half = 0.5 * (free + part);
                let found = self.blockers(cut(wanted, half).pose(STEP_S));
                if found.is_empty() {
                    free = half;
                } else {
                    (part, blockers) = (half, found);
                }
            }
            return Some((if free < PART_MIN { 0.0 } else { free }, blockers));
        }
        None
    }

    /// Surfaces that overlap the body at `pose`.
    fn blockers(&mut self, pose: Pose) -> Vec<usize> {
        self.footprint.place(pose, &mut self.corners);
        let middle = middle(self.footprint, pose);
        let solids = self.solids.iter().enumerate();
        let blocks = |(_, solid): &(usize, &Solid)| {
            let now = gap(&self.corners, middle, &solid.primitive, solid.places[1]).gap;
            if now >= TOUCH_M {
                return false;
            }
            let before = solid.stay.gap;
            if before < 0.0 {
                let middle_m = distance(middle, &solid.primitive, solid.places[1]);
                return middle_m < solid.middle_m - CREEP_M;
            }
            now < before - CREEP_M || (now < 0.5 * TOUCH_M && now < before)
        };
        solids.filter(blocks).map(|(place, _)| place).collect()
    }

    /// Records that the body meets `blockers` after `part` of the motion `wanted`.
    fn note(&mut self, blockers: &[usize], wanted: Motion, part: Motion) {
        let pose = part.pose(STEP_S);
        self.footprint.place(pose, &mut self.corners);
        let middle = middle(self.footprint, pose);
        for &place in blockers {
            let solid = &self.solids[place];
            let there = gap(&self.corners, middle, &solid.primitive, solid.places[1]);
            let approach = solid.approach(there, wanted, pose);
            self.met.push((solid.near(there), approach));
        }
    }

    /// Distance by which obstacles that moved into the body, now at `pose`, take it along: in their
    /// own direction, but into no wall.
    fn shove(&mut self, pose: Pose) -> Point {
        self.footprint.place(pose, &mut self.corners);
        let body_middle = middle(self.footprint, pose);
        let mut deepest = TOUCH_M;
        let mut found = None;
        for solid in &self.solids {
            let [from, to] = solid.places;
            let now = gap(&self.corners, body_middle, &solid.primitive, to).gap;
            let before = gap(&self.corners, body_middle, &solid.primitive, from).gap;
            if from != to && now < deepest && now < before && before > -TOUCH_M {
                deepest = now;
                found = Some(solid);
            }
        }
        let Some(solid) = found else {
            return Point::default();
        };
        let by = self.needed(solid, pose);
        let walls = self.solids.iter();
        let walls = walls.filter(|solid| solid.places[0] == solid.places[1]);
        let mut alone = Step::new(self.footprint, pose);
        alone.solids = walls
            .map(|solid| {
                let stay = gap(
                    &self.corners,
                    body_middle,
                    &solid.primitive,
                    solid.places[1],
                );
                Solid {
                    stay,
                    middle_m: distance(body_middle, &solid.primitive, solid.places[1]),
                    ..solid.clone()
                }
            })
            .collect();
        let shoved = Motion {
            start: pose,
            drift: Point::new(by.x / STEP_S, by.y / STEP_S),
            ..Motion::default()
        };
        let part = alone.blocked(shoved, Motion::slowed);
        let part = part.map_or(1.0, |(part, _)| part);
        Point::new(by.x * part, by.y * part)
    }

    /// The least part of an obstacle's own motion that takes a body at `pose` out of its path.
    fn needed(&self, solid: &Solid, pose: Pose) -> Point {
        let [from, to] = solid.places;
        let by = |part: f64| Point::new((to.x - from.x) * part, (to.y - from.y) * part);
        let mut corners = Vec::new();
        let (mut least, mut enough) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let half = 0.5 * (least + enough);
            let Point { x, y } = by(half);
            let moved = Pose::new(pose.x + x, pose.y + y, pose.theta);
            self.footprint.place(moved, &mut corners);
            let middle = middle(self.footprint, moved);
            if gap(&corners, middle, &solid.primitive, to).gap < TOUCH_M {
                least = half;
            } else {
                enough = half;
            }
        }
        by(enough)
    }

    /// Notes obstacles that moved against the body, and surfaces that are still near.
    fn rest(&mut self, wanted: Motion, motion: Motion) {
        let pose = motion.pose(STEP_S);
        self.footprint.place(pose, &mut self.corners);
        let middle = middle(self.footprint, pose);
        for solid in &self.solids {
            let moves = solid.places[0] != solid.places[1];
            let came = moves && solid.stay.gap < TOUCH_M && solid.stay.gap < solid.began.gap;
            let now = gap(&self.corners, middle, &solid.primitive, solid.places[1]);
            if came {
                let approach = solid.approach(solid.began, wanted, self.start);
                self.met.push((solid.near(solid.began), approach));
            } else if now.gap < LEFT_M {
                self.met.push((solid.near(now), Approach::default()));
            }
        }
    }
}

impl Solid {
    fn near(&self, gap: Gap) -> Near {
        Near {
            index: self.index,
            at: gap.surface,
            distance: gap.gap,
        }
    }

    /// Distance by which body and surface approach each other in a step at their closest points.
    fn approach(&self, there: Gap, wanted: Motion, pose: Pose) -> Approach {
        let (sin, cos) = libm::sincos(pose.theta);
        let (ax, ay) = (there.body.x - pose.x, there.body.y - pose.y);
        let body_x = wanted.speed * cos + wanted.drift.x - wanted.turn * ay;
        let body_y = wanted.speed * sin + wanted.drift.y + wanted.turn * ax;
        let [from, to] = self.places;
        let own = Point::new(body_x * STEP_S, body_y * STEP_S);
        let both = Point::new(own.x - (to.x - from.x), own.y - (to.y - from.y));
        let (nx, ny) = (
            there.surface.x - there.body.x,
            there.surface.y - there.body.y,
        );
        let length = there.body.distance(there.surface);
        if length == 0.0 {
            let [both, own] = [both, own].map(|way| Point::default().distance(way));
            return Approach { both, own };
        }
        // Within each other, the shortest direction leads out.
        let sign = if there.gap < 0.0 { -1.0 } else { 1.0 };
        let closer = |way: Point| sign * (way.x * nx + way.y * ny) / length;
        Approach {
            both: closer(both).max(0.0),
            own: closer(own),
        }
    }
}

fn middle(footprint: &Footprint, pose: Pose) -> Point {
    pose.offset(footprint.middle().x, footprint.middle().y)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::FRAC_PI_2;

    use super::super::REACH_M;
    use super::*;
    use crate::world::geometry::Circle;

    /// A surface that moves by (0.1, -0.2) mm in a step of 1 ms.
    fn solid() -> Solid {
        let center = Point::default();
        let none = Gap {
            gap: 0.0,
            body: center,
            surface: center,
        };
        Solid {
            index: 0,
            primitive: Primitive::Circle(Circle {
                center,
                radius: 1.0,
            }),
            places: [Point::new(1.0, 1.0), Point::new(1.000_1, 0.999_8)],
            began: none,
            stay: none,
            middle_m: 0.0,
        }
    }

    /// At (1, 2) from its reference point, a body that goes 3 m/s, turns 0.5 rad/s and is pushed by
    /// (0.1, 0.2) m/s moves (2.1, 0.7) mm in a step; less the surface's motion that is (2.0, 0.9)
    /// mm. Along the direction (3, 4) / 5 it is 1.92 mm, of which 1.82 mm are the body's own
    /// motion. For a body turned by a quarter the motion is (-1.0, 3.9) mm and 2.52 mm, its own
    /// (-0.9, 3.7) mm and 2.42 mm.
    #[test]
    fn a_surface_is_approached_by_the_difference_of_both_ways() {
        let wanted = Motion {
            speed: 3.0,
            turn: 0.5,
            drift: Point::new(0.1, 0.2),
            ..Motion::default()
        };
        let approach = |gap: f64, to: [f64; 2], theta: f64| {
            let body = Point::new(8.0, 9.0);
            let there = Gap {
                gap,
                body,
                surface: Point::new(body.x + to[0], body.y + to[1]),
            };
            solid().approach(there, wanted, Pose::new(7.0, 7.0, theta))
        };
        let is = |found: Approach, both_mm: f64, own_mm: f64| {
            (found.both * 1e3 - both_mm).abs() < 1e-9 && (found.own * 1e3 - own_mm).abs() < 1e-9
        };
        assert!(is(approach(5.0, [3.0, 4.0], 0.0), 1.92, 1.82));
        assert!(is(approach(5.0, [3.0, 4.0], FRAC_PI_2), 2.52, 2.42));
        assert!(is(approach(5.0, [-3.0, -4.0], 0.0), 0.0, -1.82));
        assert!(is(approach(-5.0, [-3.0, -4.0], 0.0), 1.92, 1.82));
        assert!(is(approach(-5.0, [3.0, 4.0], 0.0), 0.0, -1.82));
        // If the body touches the surface, its whole motion counts: the roots of 4 + 0.81 and 4.41
        // + 0.49.
        let whole = approach(0.0, [0.0, 0.0], 0.0);
        assert!(is(whole, 4.81_f64.sqrt(), 4.9_f64.sqrt()));
    }

    /// A body of 0.2 m before a wall so far away: whether that wall, which was `stay_m` away
    /// before, and its middle `middle_m`, keeps it from standing there.
    fn is_blocked(away_m: f64, stay_m: f64, middle_m: f64) -> bool {
        use crate::world::geometry::Segment;
        let footprint = Footprint::rectangle(0.1, 0.1, 0.2).expect("a square");
        let wall = Segment::new(Point::new(0.1, -1.0), Point::new(0.1, 1.0)).expect("long");
        let mut step = Step::new(&footprint, Pose::default());
        step.solids.push(Solid {
            primitive: Primitive::Segment(wall),
            places: [Point::default(); 2],
            stay: Gap {
                gap: stay_m,
                ..solid().stay
            },
            middle_m,
            ..solid()
        });
        !step.blockers(Pose::new(-away_m, 0.0, 0.0)).is_empty()
    }

    /// A micrometre off, no surface blocks. Nearer than that, an approaching surface blocks if it
    /// came nearer by more than rounding, or if half of that micrometre is used up. Within the
    /// wall, motion of the middle towards the wall is blocked.
    #[test]
    fn a_surface_blocks_what_comes_nearer() {
        let um = 1e-6;
        assert!(!is_blocked(1.1 * um, 1.0, 1.0) && is_blocked(0.9 * um, 1.0, 1.0));
        assert!(is_blocked(0.8 * um, 0.9 * um, 1.0) && !is_blocked(0.8 * um, 0.7 * um, 1.0));
        let rounding = 0.4e-12;
        assert!(!is_blocked(0.8 * um, 0.8 * um + rounding, 1.0));
        assert!(is_blocked(0.8 * um, 0.8 * um + 5.0 * rounding, 1.0));
        assert!(is_blocked(0.4 * um, 0.4 * um + rounding, 1.0));
        assert!(!is_blocked(0.4 * um, 0.4 * um - rounding, 1.0));
        // The middle is 0.09 m from the wall: nearer than it was, or not.
        assert!(is_blocked(-0.01, -0.02, 0.091) && !is_blocked(-0.01, -0.02, 0.089));
        assert!(!is_blocked(-0.01, -0.001, 0.089) && is_blocked(-0.01, -0.001, 0.091));
    }

    /// A wall 1 mm ahead, approached by 3 mm in a step, driven or pushed: a third of the motion is
    /// free, less the micrometre that counts as touch.
    #[test]
    fn the_free_part_of_a_way_is_found() {
        use crate::world::geometry::Segment;
        let footprint = Footprint::rectangle(0.1, 0.1, 0.2).expect("a square");
        let wall = Segment::new(Point::new(0.1, -1.0), Point::new(0.1, 1.0)).expect("long");
        let start = Pose::new(-0.001, 0.0, 0.0);
        let free = |motion: Motion, cut: fn(Motion, f64) -> Motion| {
            let mut step = Step::new(&footprint, start);
            step.solids.push(Solid {
                primitive: Primitive::Segment(wall),
                places: [Point::default(); 2],
                stay: Gap {
                    gap: 0.001,
                    ..solid().stay
                },
                middle_m: 0.101,
                ..solid()
            });
            step.blocked(motion, cut)
                .map(|(part, solids)| (part, solids.len()))
        };
        let still = Motion {
            start,
            ..Motion::default()
        };
        let ahead = |speed| Motion { speed, ..still };
        let pushed = |x, y| Motion {
            drift: Point::new(x, y),
            ..still
        };
        for (motion, cut) in [
            (ahead(3.0), Motion::shortened as fn(Motion, f64) -> Motion),
            (pushed(3.0, 0.0), Motion::shortened),
            (ahead(3.0), Motion::slowed),
        ] {
            let (part, solids) = free(motion, cut).unwrap_or_else(|| panic!("{motion:?}"));
            let is_third = (part - 0.333).abs() < 0.002;
            assert!(is_third && solids == 1, "{motion:?} {part}");
        }
        assert_eq!(free(ahead(0.9), Motion::slowed), None);
        assert_eq!(free(ahead(-3.0), Motion::slowed), None);
        assert_eq!(free(pushed(0.0, 3.0), Motion::slowed), None);
    }

    /// A disc of 5 cm approaches by 2 mm, the second half of it into the body. Half of its motion
    /// is needed, from any direction.
    #[test]
    fn a_body_is_shoved_by_what_an_obstacle_comes_too_near() {
        let footprint = Footprint::rectangle(0.1, 0.1, 0.2).expect("a square");
        let needed = |from: [f64; 2], to: [f64; 2]| {
            let step = Step::new(&footprint, Pose::default());
            let pushing = Solid {
                primitive: Primitive::Circle(Circle {
                    center: Point::default(),
                    radius: 0.05,
                }),
                places: [from, to].map(|[x, y]| Point::new(x, y)),
                ..solid()
            };
            let by = step.needed(&pushing, Pose::default());
            [by.x * 1e3, by.y * 1e3]
        };
        for (from, to, expected) in [
            ([0.02, -0.151], [0.02, -0.149], [0.0, 1.0]),
            ([0.02, 0.151], [0.02, 0.149], [0.0, -1.0]),
            ([-0.151, 0.03], [-0.149, 0.03], [1.0, 0.0]),
            ([0.151, 0.03], [0.149, 0.03], [-1.0, 0.0]),
        ] {
            let found = needed(from, to);
            let off = (found[0] - expected[0]).abs() + (found[1] - expected[1]).abs();
            assert!(off < 0.01, "{from:?}: {found:?}");
        }
    }

    /// One disc comes in from the right by a millimetre; another one, looked at after it, comes
    /// nearer from below and is still a decimetre away: it shoves nothing.
    #[test]
    fn an_obstacle_that_is_still_away_shoves_nobody() {
        let footprint = Footprint::rectangle(0.1, 0.1, 0.2).expect("a square");
        let coming = |from: [f64; 2], to: [f64; 2]| Solid {
            primitive: Primitive::Circle(Circle {
                center: Point::default(),
                radius: 0.05,
            }),
            places: [from, to].map(|[x, y]| Point::new(x, y)),
            ..solid()
        };
        let near = || coming([0.151, 0.03], [0.149, 0.03]);
        let far = || coming([0.02, -0.261], [0.02, -0.25]);
        for solids in [vec![near()], vec![near(), far()], vec![far(), near()]] {
            let mut step = Step::new(&footprint, Pose::default());
            step.solids = solids;
            let by = step.shove(Pose::default());
            assert!((by.x + 1e-3).abs() < 1e-5 && by.y.abs() < 1e-5, "{by:?}");
        }
        let mut step = Step::new(&footprint, Pose::default());
        step.solids = vec![far()];
        assert_eq!(step.shove(Pose::default()), Point::default());
    }

    /// In one step a body goes 0.6 m, or turns by a radian, past a post of a centimetre. It meets
    /// the post during the motion, not at its end: ahead, pushed to any side, and turning.
    #[test]
    fn a_fast_body_does_not_pass_through_a_post() {
        let post = |x: f64, y: f64| Solid {
            primitive: Primitive::Circle(Circle {
                center: Point::default(),
                radius: 0.005,
            }),
            places: [Point::new(x, y); 2],
            stay: Gap {
                gap: 0.2,
                ..solid().stay
            },
            middle_m: 0.4,
            ..solid()
        };
        let still = Motion::default();
        let pushed = |x, y| Motion {
            drift: Point::new(x, y),
            ..still
        };
        let square = Footprint::rectangle(0.1, 0.1, 0.2).expect("a square");
        let bar = Footprint::rectangle(0.5, 0.01, 0.02).expect("a bar");
        let ahead = Motion {
            speed: 600.0,
            ..still
        };
        let turning = Motion {
            turn: 1_000.0,
            ..still
        };
        let (sin, cos) = libm::sincos(0.5);
        for (footprint, motion, [x, y], part) in [
            (&square, ahead, [0.35, 0.0], 0.245 / 0.6),
            (&square, pushed(600.0, 0.0), [0.35, 0.0], 0.245 / 0.6),
            (&square, pushed(-600.0, 0.0), [-0.35, 0.0], 0.245 / 0.6),
            (&square, pushed(0.0, 600.0), [0.0, 0.35], 0.245 / 0.6),
            (&square, pushed(0.0, -600.0), [0.0, -0.35], 0.245 / 0.6),
            // The bar's side is 1 cm from its middle, the post's rim 5 mm from its own middle: they
            // touch when 15 mm are left, at a radius of 0.4 m.
            (&bar, turning, [0.4 * cos, 0.4 * sin], 0.5 - 0.037_51),
        ] {
            let mut step = Step::new(footprint, Pose::default());
            step.solids.push(post(x, y));
            let found = step.blocked(motion, Motion::shortened);
            let (free, _) = found.unwrap_or_else(|| panic!("{motion:?}"));
            assert!((free - part).abs() < 0.002, "{motion:?}: {free} {part}");
        }
    }

    /// A car that covers 0.2 m ahead of its axle, 0.1 m behind it and 0.1 m to each side, at a
    /// wall. Its front, its back and its sides face the wall in turn; with its front 5 cm behind
    /// the wall it overlaps the wall.
    #[test]
    fn free_is_what_lies_between_an_outline_and_a_wall() {
        use crate::world::Shape;
        let car = Footprint::rectangle(0.2, 0.1, 0.2).unwrap();
        let wall = Shape::Wall {
            from: Point::new(1.0, -1.0),
            to: Point::new(1.0, 1.0),
        };
        let scene = Scene::new([wall], Vec::new()).unwrap();
        let free = |x: f64, theta: f64| {
            let pose = Pose::new(x, 0.0, theta);
            clearance(&car, &scene, Instant::ZERO, pose, REACH_M)
        };
        let is = |found: f64, expected: f64| (found - expected).abs() < 1e-9;
        assert!(is(free(0.75, 0.0), 0.05) && is(free(0.8, 2.0 * FRAC_PI_2), 0.1));
        assert!(is(free(0.7, FRAC_PI_2), 0.2) && is(free(0.7, -FRAC_PI_2), 0.2));
        assert!(free(0.85, 0.0) < 0.0);
        assert_eq!(free(-90.0, 0.0), REACH_M);
    }

    /// A square of 0.2 m, its front this far before a wall, and the free part of a motion.
    fn before_wall(gap_m: f64, motion: Motion) -> Motion {
        use crate::world::geometry::Segment;
        let footprint = Footprint::rectangle(0.1, 0.1, 0.2).expect("a square");
        let wall = Segment::new(Point::new(0.1, -1.0), Point::new(0.1, 1.0)).expect("long");
        let start = Pose::new(-gap_m, 0.0, 0.0);
        let mut step = Step::new(&footprint, start);
        step.solids.push(Solid {
            primitive: Primitive::Segment(wall),
            places: [Point::default(); 2],
            stay: Gap {
                gap: gap_m,
                ..solid().stay
            },
            middle_m: 0.1 + gap_m,
            ..solid()
        });
        step.free(Motion { start, ..motion })
    }

    /// In a step of 1 ms a turn of 1 rad/s brings a corner 0.1 mm nearer to the wall. At 1 mm, of 3
    /// mm ahead 0.899 mm are free, and all of the turn. At 0.05 mm the body turns by 49 % of it. In
    /// touch it does not turn, and moves along the wall.
    #[test]
    fn a_body_turns_as_far_as_a_wall_lets_it() {
        let turning = |speed: f64, y: f64| Motion {
            speed,
            turn: 1.0,
            drift: Point::new(0.0, y),
            ..Motion::default()
        };
        let ahead = before_wall(1e-3, turning(3.0, 0.0));
        assert_eq!(ahead.turn, 1.0);
        assert!((ahead.speed - 0.899).abs() < 0.005, "{ahead:?}");
        let spot = before_wall(50e-6, turning(0.0, 0.0));
        assert!(
            (spot.turn - 0.49).abs() < 0.005 && spot.speed == 0.0,
            "{spot:?}"
        );
        let along = before_wall(0.9e-6, turning(0.0, 1.0));
        assert_eq!((along.turn, along.drift), (0.0, Point::new(0.0, 1.0)));
        let back = before_wall(0.9e-6, turning(-3.0, 0.0));
        assert_eq!((back.turn, back.speed), (1.0, -3.0));
    }

    /// Less than a millionth of a step is none: 2.4 nm of 3 mm are 0.8 millionths, 9 nm are three.
    #[test]
    fn a_part_that_is_not_worth_making_is_none() {
        use crate::world::geometry::Segment;
        let footprint = Footprint::rectangle(0.1, 0.1, 0.2).expect("a square");
        let wall = Segment::new(Point::new(0.1, -1.0), Point::new(0.1, 1.0)).expect("long");
        let part = |free_m: f64| {
            let start = Pose::new(-TOUCH_M - free_m, 0.0, 0.0);
            let mut step = Step::new(&footprint, start);
            step.solids.push(Solid {
                primitive: Primitive::Segment(wall),
                places: [Point::default(); 2],
                stay: Gap {
                    gap: TOUCH_M + free_m,
                    ..solid().stay
                },
                middle_m: 0.1,
                ..solid()
            });
            let motion = Motion {
                start,
                speed: 3.0,
                ..Motion::default()
            };
            let found = step.blocked(motion, Motion::slowed);
            found.expect("the wall blocks").0
        };
        assert_eq!(part(2.4e-9), 0.0);
        assert!((2e-6..4e-6).contains(&part(9e-9)));
    }

    /// What stands exactly at the surface has not come nearer by standing beside it.
    #[test]
    fn a_body_at_a_surface_may_leave_it() {
        assert!(!is_blocked(0.5e-6, 0.0, 1.0));
    }

    /// An obstacle comes in by 1 mm, and a wall on the other side leaves half a millimetre. Of two
    /// obstacles that are as deep, the first counts.
    #[test]
    fn an_obstacle_shoves_up_to_a_wall() {
        use crate::world::geometry::Segment;
        let footprint = Footprint::rectangle(0.1, 0.1, 0.2).expect("a square");
        let coming = |from: [f64; 2], to: [f64; 2]| Solid {
            primitive: Primitive::Circle(Circle {
                center: Point::default(),
                radius: 0.05,
            }),
            places: [from, to].map(|[x, y]| Point::new(x, y)),
            ..solid()
        };
        let wall = |from: [f64; 2], to: [f64; 2]| {
            let [from, to] = [from, to].map(|[x, y]| Point::new(x, y));
            Solid {
                primitive: Primitive::Segment(Segment::new(from, to).expect("long")),
                places: [Point::default(); 2],
                ..solid()
            }
        };
        let shoved = |solids: Vec<Solid>| {
            let mut step = Step::new(&footprint, Pose::default());
            step.solids = solids;
            let by = step.shove(Pose::default());
            [by.x * 1e3, by.y * 1e3]
        };
        let left = || coming([-0.151, 0.0], [-0.149, 0.0]);
        let right = || coming([0.151, 0.0], [0.149, 0.0]);
        let below = || coming([0.0, -0.151], [0.0, -0.149]);
        let ahead = || wall([0.1005, -1.0], [0.1005, 1.0]);
        let above = || wall([-1.0, 0.1005], [1.0, 0.1005]);
        for (solids, expected) in [
            (vec![left(), ahead()], [0.499, 0.0]),
            (vec![below(), above()], [0.0, 0.499]),
            (vec![left(), above()], [1.0, 0.0]),
            (vec![right(), left()], [-1.0, 0.0]),
            (vec![left(), right()], [1.0, 0.0]),
        ] {
            let found = shoved(solids);
            let off = (found[0] - expected[0]).abs() + (found[1] - expected[1]).abs();
            assert!(off < 0.003, "{found:?} {expected:?}");
        }
    }
}
