//! Drives through gates: pairs of markers that the camera recognises.
//!
//! Facts: seed 003, mission II, and its published code. The published code sends the car, with its
//! current heading, to the middle between the nearest two markers at least 0.3 m apart. That
//! accepts gates narrower than the car, and gates behind it. Here a gate must be wide enough for
//! the car and lie ahead. The car approaches it along its normal, and the gate is passed when the
//! car has crossed it. A gate with an obstacle between its posts is blocked, and is not driven at
//! until it is seen free.

use alloc::collections::BTreeMap;
use alloc::vec::Vec;

use crate::ackermann::{CarPose, wrapped};

/// Conditions for a gate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Minimum width: 0.33 m of the car and 5 cm to each side.
    pub width_min_m: f64,
    /// Maximum width: markers farther apart belong to different gates.
    pub width_max_m: f64,
    /// Distance of the approach pose before the gate on its normal.
    pub approach_m: f64,
    /// Distance of the pose behind the gate.
    pub beyond_m: f64,
    /// Fielded rule: the goal has the car's heading, gates behind the car count as ahead, and
    /// markers stay at their first position.
    pub as_fielded: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            width_min_m: 0.43,
            width_max_m: 1.5,
            approach_m: 0.9,
            beyond_m: 0.6,
            as_fielded: false,
        }
    }
}

impl Settings {
    /// The settings of the published code.
    pub const fn fielded() -> Self {
        Self {
            width_min_m: 0.30,
            width_max_m: f64::INFINITY,
            approach_m: 0.0,
            beyond_m: 0.0,
            as_fielded: true,
        }
    }
}

/// Numbers of a gate's two markers, the smaller first.
pub type Gate = [u32; 2];

/// The path through a gate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passage {
    /// Markers of the gate.
    pub gate: Gate,
    /// Pose before the gate.
    pub before: CarPose,
    /// The middle of the gate.
    pub middle: CarPose,
    /// Pose behind the gate.
    pub behind: CarPose,
}

/// Number of sightings averaged for a marker's position; about a second of them. Sightings from a
/// wrongly believed pose lose their weight within that time.
const SIGHTINGS: u32 = 30;

/// Markers nearer to the car than this, metres, are kept when the pose changes: the camera may not
/// see them again.
const NEAR_M: f64 = 1.5;

/// Range in which the car can see an obstacle in a gate, metres.
const BLOCK_SEEN_M: f64 = 2.5;
/// Looks in a row at an obstacle in a gate that make the gate blocked: 2 s at 5 looks a second.
const BLOCK_LOOKS: u8 = 10;

/// Mean of a marker's recent positions.
#[derive(Clone, Copy, Debug, Default)]
struct Marker {
    mean_m: [f64; 2],
    seen: u32,
}

impl Marker {
    /// Adds a sighting: a plain mean of the first ones, a sliding mean after them.
    fn see(&mut self, place_m: [f64; 2]) {
        self.seen = (self.seen + 1).min(SIGHTINGS);
        let part = 1.0 / f64::from(self.seen);
        for (mean, seen) in self.mean_m.iter_mut().zip(place_m) {
            *mean += part * (seen - *mean);
        }
    }
}

/// Seen markers and passed gates.
#[derive(Clone, Debug)]
pub struct Gates {
    settings: Settings,
    markers: BTreeMap<u32, Marker>,
    passed: Vec<Gate>,
    /// Number of looks at an obstacle in each gate.
    obstructed: BTreeMap<Gate, u8>,
}

impl Gates {
    /// Gates without any sighting.
    pub const fn new(settings: Settings) -> Self {
        Self {
            settings,
            markers: BTreeMap::new(),
            passed: Vec::new(),
            obstructed: BTreeMap::new(),
        }
    }

    /// Takes a sighting of the marker `id` at this position of the map, metres; returns whether the
    /// marker is new.
    pub fn see(&mut self, id: u32, [x_m, y_m]: [f64; 2]) -> bool {
        if !x_m.is_finite() || !y_m.is_finite() {
            return false;
        }
        let marker = self.markers.entry(id).or_default();
        let is_new = marker.seen == 0;
        if is_new || !self.settings.as_fielded {
            marker.see([x_m, y_m]);
        }
        is_new
    }

    /// Corrects the car's pose from `from` to `to`. Markers near the car keep their position
    /// relative to it until the next sighting, once. The positions of other markers are discarded;
    /// passed gates are kept.
    pub fn carry(&mut self, from: CarPose, to: CarPose) {
        self.markers.retain(|_, Marker { mean_m, seen }| {
            let is_kept = *seen > 1 && from.distance_to(*mean_m) <= NEAR_M;
            (*mean_m, *seen) = (from.carried(to, *mean_m), 1);
            is_kept
        });
    }

    /// Passed gates, in their order.
    pub fn passed(&self) -> &[Gate] {
        &self.passed
    }

    /// Number of gates with an obstacle between their posts.
    pub fn blocked(&self) -> usize {
        let looks = self.obstructed.values();
        looks.filter(|looks| **looks >= BLOCK_LOOKS).count()
    }

    /// Looks at the gates ahead of `pose`, five times a second. `is_free` tests whether the car can
    /// be at a pose.
    pub fn look(&mut self, pose: CarPose, is_free: impl Fn(CarPose) -> bool) {
        for [one, other] in self.pairs() {
            let passage = self.passage(pose, one, other);
            let is_judged = |passage: &Passage| {
                let is_near = pose.distance_m(passage.middle) <= BLOCK_SEEN_M;
                is_near && !self.passed.contains(&passage.gate)
            };
            let Some(passage) = passage.filter(is_judged) else {
                continue;
            };
            if is_free(passage.middle) {
                self.obstructed.remove(&passage.gate);
            } else {
                let looks = self.obstructed.entry(passage.gate).or_default();
                *looks = (*looks + 1).min(BLOCK_LOOKS);
            }
        }
    }

    /// All found gates, each by the positions of its two markers, metres.
    pub fn found(&self) -> Vec<[[f64; 2]; 2]> {
        let pairs = self.pairs().into_iter();
        let places = pairs.map(|[one, other]| [one.1, other.1]);
        let wide = |[a, b]: &[[f64; 2]; 2]| self.is_gate(libm::hypot(b[0] - a[0], b[1] - a[1]));
        places.filter(wide).collect()
    }

    /// Positions of the markers, metres.
    pub fn markers(&self) -> impl Iterator<Item = (u32, [f64; 2])> {
        self.markers.iter().map(|(id, marker)| (*id, marker.mean_m))
    }

    /// The next gate to drive through from `pose`: the nearest suitable one that was not passed.
    /// `is_free` tests whether the car can be at a pose.
    pub fn next(&self, pose: CarPose, is_free: impl Fn(CarPose) -> bool) -> Option<Passage> {
        let pairs = self.pairs().into_iter();
        let passages = pairs.filter_map(|[one, other]| self.passage(pose, one, other));
        let possible = passages.filter(|passage| {
            let looks = self.obstructed.get(&passage.gate);
            let is_blocked = looks.is_some_and(|looks| *looks >= BLOCK_LOOKS);
            let is_new = !self.passed.contains(&passage.gate) && !is_blocked;
            is_new
                && [passage.before, passage.middle, passage.behind]
                    .into_iter()
                    .all(&is_free)
        });
        let far = |passage: &Passage| pose.distance_m(passage.middle);
        possible.min_by(|one, other| far(one).total_cmp(&far(other)))
    }

    /// The passage of this gate as its markers are seen now; `None` if the gate is behind `pose`.
    pub fn again(&self, pose: CarPose, [one, other]: Gate) -> Option<Passage> {
        let at = |id: u32| Some((id, self.markers.get(&id)?.mean_m));
        self.passage(pose, at(one)?, at(other)?)
    }

    /// Takes a motion of the car; returns the gate that it crossed, which counts as passed now.
    pub fn moved(&mut self, from: CarPose, to: CarPose) -> Option<Gate> {
        let (a, b) = ([from.x_m, from.y_m], [to.x_m, to.y_m]);
        for [(id, one), (other_id, other)] in self.pairs() {
            let gate = [id, other_id];
            let is_gate = self.is_gate(libm::hypot(other[0] - one[0], other[1] - one[1]));
            if is_gate && !self.passed.contains(&gate) && do_cross(a, b, one, other) {
                self.passed.push(gate);
                return Some(gate);
            }
        }
        None
    }

    /// Pairs of markers that are each other's nearest. With the fielded rule, all pairs.
    fn pairs(&self) -> Vec<[(u32, [f64; 2]); 2]> {
        let markers: Vec<(u32, [f64; 2])> = self.markers().collect();
        let nearest = |one: &(u32, [f64; 2])| {
            let others = markers.iter().filter(|other| other.0 != one.0);
            let far =
                |other: &(u32, [f64; 2])| libm::hypot(other.1[0] - one.1[0], other.1[1] - one.1[1]);
            let nearest = others.min_by(|a, b| far(a).total_cmp(&far(b)));
            nearest.map(|nearest| nearest.0)
        };
        let partners: Vec<Option<u32>> = markers.iter().map(nearest).collect();
        let all: Vec<_> = markers.iter().zip(partners).collect();
        let mut pairs = Vec::new();
        for (index, (one, partner)) in all.iter().enumerate() {
            for (other, its_partner) in &all[index + 1..] {
                let is_mutual = *partner == Some(other.0) && *its_partner == Some(one.0);
                if is_mutual || self.settings.as_fielded {
                    pairs.push([**one, **other]);
                }
            }
        }
        pairs
    }

    fn is_gate(&self, width_m: f64) -> bool {
        (self.settings.width_min_m..=self.settings.width_max_m).contains(&width_m)
    }

    fn passage(
        &self,
        pose: CarPose,
        (id, [x0, y0]): (u32, [f64; 2]),
        (other, [x1, y1]): (u32, [f64; 2]),
    ) -> Option<Passage> {
        if !self.is_gate(libm::hypot(x1 - x0, y1 - y0)) {
            return None;
        }
        let (x_m, y_m) = ((x0 + x1) / 2.0, (y0 + y1) / 2.0);
        let ahead = pose.motion_to(CarPose {
            x_m,
            y_m,
            heading_rad: 0.0,
        });
        let heading_rad = match self.settings.as_fielded {
            true => pose.heading_rad,
            false => {
                // The normal that points away from the car's side.
                let normal = libm::atan2(x1 - x0, y0 - y1);
                let bearing = libm::atan2(y_m - pose.y_m, x_m - pose.x_m);
                match libm::cos(normal - bearing) >= 0.0 {
                    true => wrapped(normal),
                    false => wrapped(normal + core::f64::consts::PI),
                }
            }
        };
        let middle = CarPose {
            x_m,
            y_m,
            heading_rad,
        };
        (self.settings.as_fielded || ahead.ahead_m > 0.0).then(|| Passage {
            gate: [id, other],
            before: middle.shifted(-self.settings.approach_m),
            middle,
            behind: middle.shifted(self.settings.beyond_m),
        })
    }
}

/// Whether two pieces of line cross.
fn do_cross(a: [f64; 2], b: [f64; 2], c: [f64; 2], d: [f64; 2]) -> bool {
    let side = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
        (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]) > 0.0
    };
    side(a, b, c) != side(a, b, d) && side(c, d, a) != side(c, d, b)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: CarPose = CarPose {
        x_m: 0.0,
        y_m: 0.0,
        heading_rad: 0.0,
    };

    fn anywhere(_: CarPose) -> bool {
        true
    }

    fn seen(settings: Settings, markers: &[(u32, [f64; 2])]) -> Gates {
        let mut gates = Gates::new(settings);
        for (id, place) in markers {
            assert!(gates.see(*id, *place));
        }
        gates
    }

    /// A gate of 0.8 m at 45 degrees: the car drives through its middle, along its normal.
    #[test]
    fn ap14_a_gate_is_driven_at_along_its_normal() {
        let gates = seen(Settings::default(), &[(10, [2.0, 0.4]), (11, [2.0, -0.4])]);
        let passage = gates.next(ORIGIN, anywhere).unwrap();
        assert_eq!(
            (passage.gate, passage.middle),
            ([10, 11], CarPose { x_m: 2.0, ..ORIGIN })
        );
        assert!((passage.before.x_m - 1.1).abs() < 1e-9 && (passage.behind.x_m - 2.6).abs() < 1e-9);
        // From the other side the passage leads back.
        let other = CarPose {
            x_m: 4.0,
            heading_rad: 3.0,
            ..ORIGIN
        };
        let passage = gates.next(other, anywhere).unwrap();
        assert!((passage.middle.heading_rad.abs() - core::f64::consts::PI).abs() < 1e-9);
    }

    /// 0.35 m is wider than the car by a centimetre on each side: only the fielded rule accepts
    /// that.
    #[test]
    fn ap14_a_gate_that_is_too_narrow_is_refused() {
        let markers = [(10, [2.0, 0.175]), (11, [2.0, -0.175])];
        assert_eq!(
            seen(Settings::default(), &markers).next(ORIGIN, anywhere),
            None
        );
        assert!(
            seen(Settings::fielded(), &markers)
                .next(ORIGIN, anywhere)
                .is_some()
        );
    }

    #[test]
    fn ap14_a_gate_behind_the_car_is_not_ahead() {
        let markers = [(10, [-2.0, 0.4]), (11, [-2.0, -0.4])];
        assert_eq!(
            seen(Settings::default(), &markers).next(ORIGIN, anywhere),
            None
        );
        let fielded = seen(Settings::fielded(), &markers)
            .next(ORIGIN, anywhere)
            .unwrap();
        assert_eq!(fielded.middle.heading_rad, 0.0);
    }

    /// Nearest gate first, each once; gates that are not free are left out; markers of two
    /// different gates make no gate.
    #[test]
    fn ap14_gates_are_passed_once_in_the_order_of_their_distance() {
        let markers = [
            (10, [4.0, 0.4]),
            (11, [4.0, -0.4]),
            (12, [1.5, 0.4]),
            (13, [1.5, -0.4]),
            (16, [7.0, 0.4]),
            (17, [7.0, -0.4]),
        ];
        let mut gates = seen(Settings::default(), &markers);
        let mut pose = ORIGIN;
        let mut order = Vec::new();
        while let Some(passage) = gates.next(pose, |pose| pose.x_m < 7.2) {
            order.push(passage.gate);
            assert_eq!(gates.moved(pose, passage.before), None);
            assert_eq!(
                gates.moved(passage.before, passage.behind),
                Some(passage.gate)
            );
            assert_eq!(gates.moved(passage.before, passage.behind), None);
            pose = passage.behind;
        }
        assert_eq!(order, [[12, 13], [10, 11]]);
        assert_eq!(gates.passed(), order);
    }

    /// Ten looks at an obstacle in a gate within 2.5 m make it blocked, nine do not, and a look at
    /// the free gate ends it. A gate farther away, or behind the car, is not judged.
    #[test]
    fn a_gate_with_an_obstacle_between_its_posts_is_blocked() {
        let mut gates = seen(Settings::default(), &[(10, [2.0, 0.4]), (11, [2.0, -0.4])]);
        let is_free = |pose: CarPose| (pose.x_m - 2.0).abs() > 0.1;
        (0..9).for_each(|_| gates.look(ORIGIN, is_free));
        assert_eq!(gates.blocked(), 0);
        for aside in [-0.6, 4.0] {
            let pose = CarPose {
                x_m: aside,
                ..ORIGIN
            };
            gates.look(pose, is_free);
            assert_eq!(gates.blocked(), 0);
        }
        gates.look(ORIGIN, is_free);
        assert_eq!(gates.blocked(), 1);
        // An obstacle that the map has forgotten does not make it free from elsewhere.
        assert_eq!(gates.next(ORIGIN, anywhere), None);
        gates.look(ORIGIN, anywhere);
        assert_eq!(gates.blocked(), 0);
        assert!(gates.next(ORIGIN, anywhere).is_some());
    }

    /// Of 200 sightings the first 100 were 1 m off: (29/30)^100 = 0.034 of that error remains.
    #[test]
    fn what_was_seen_from_a_wrong_place_is_forgotten() {
        let mut gates = Gates::new(Settings::default());
        (0..100).for_each(|_| _ = gates.see(10, [3.0, 0.0]));
        (0..100).for_each(|_| _ = gates.see(10, [2.0, 0.0]));
        let off = gates.markers().map(|(_, [x, _])| x - 2.0).next().unwrap();
        assert!((0.03..0.04).contains(&off), "{off}");
    }

    /// Each marker is recognised once, and its position is the mean of its sightings.
    #[test]
    fn d1_a_marker_is_recognised_once() {
        for (settings, mean) in [(Settings::default(), 1.5), (Settings::fielded(), 1.0)] {
            let mut gates = Gates::new(settings);
            assert!(gates.see(10, [1.0, 0.0]));
            assert!(!gates.see(10, [2.0, 0.0]) && !gates.see(12, [f64::NAN, 0.0]));
            assert_eq!(gates.markers().collect::<Vec<_>>(), [(10, [mean, 0.0])]);
        }
    }

    /// Markers at the ends of 0.8 m across the diagonal, in either order. The middle is at (2, 2).
    /// Both coordinates are 2 - 0.9 / sqrt(2) = 1.3636 at 0.9 m before it, and 2.4243 at 0.6 m
    /// behind it.
    #[test]
    fn a_gate_across_the_diagonal_is_driven_at_along_it() {
        let off = 0.4 * core::f64::consts::FRAC_1_SQRT_2;
        let posts = [[2.0 + off, 2.0 - off], [2.0 - off, 2.0 + off]];
        let diagonal = core::f64::consts::FRAC_PI_4;
        for (one, other) in [(posts[0], posts[1]), (posts[1], posts[0])] {
            let gates = seen(Settings::default(), &[(3, one), (4, other)]);
            let from = CarPose {
                heading_rad: diagonal,
                ..ORIGIN
            };
            let passage = gates.next(from, anywhere).unwrap();
            let places = [passage.before, passage.middle, passage.behind];
            for (place, along) in places.into_iter().zip([1.3636, 2.0, 2.4243]) {
                let off = libm::hypot(place.x_m - along, place.y_m - along);
                assert!(off < 1e-4, "{place:?}");
                assert!((place.heading_rad - diagonal).abs() < 1e-9);
            }
            // For a car behind the gate, beside its axis, the passage leads back along the same
            // line.
            let from = CarPose {
                x_m: 4.0,
                y_m: 3.0,
                heading_rad: -3.0 * diagonal,
            };
            let back = gates.next(from, anywhere).unwrap();
            assert!((back.middle.heading_rad + 3.0 * diagonal).abs() < 1e-9);
            assert!(libm::hypot(back.before.x_m - 2.6364, back.before.y_m - 2.6364) < 1e-4);
            // One blocked pose of three is enough.
            let is_free = |pose: CarPose| pose.x_m > 1.4;
            assert_eq!(gates.next(ORIGIN, is_free), None);
        }
    }

    /// Widths from 0.43 m to 1.5 m, each limit a little to both sides.
    #[test]
    fn a_gate_is_as_wide_as_it_may_be() {
        for (width, is_gate) in [(0.425, false), (0.435, true), (1.495, true), (1.505, false)] {
            let posts = [[2.0, 1.0], [2.0, 1.0 + width]];
            let mut gates = seen(Settings::default(), &[(1, posts[0]), (2, posts[1])]);
            let found = if is_gate {
                alloc::vec![posts]
            } else {
                Vec::new()
            };
            assert_eq!(gates.found(), found, "{width}");
            assert_eq!(gates.next(ORIGIN, anywhere).is_some(), is_gate);
            let beyond = CarPose {
                x_m: 4.0,
                y_m: 2.2,
                ..ORIGIN
            };
            assert_eq!(gates.moved(ORIGIN, beyond).is_some(), is_gate);
        }
    }

    /// Of three markers in a row the nearest two are a gate; by the fielded rule any two: 0.8, 1.1
    /// and 1.9 m.
    #[test]
    fn markers_that_are_each_others_nearest_belong_together() {
        let markers = [(1, [2.0, 0.4]), (2, [2.0, -0.4]), (3, [2.0, 1.5])];
        let found = |settings| seen(settings, &markers).found();
        assert_eq!(found(Settings::default()), [[[2.0, 0.4], [2.0, -0.4]]]);
        assert_eq!(found(Settings::fielded()).len(), 3);
    }

    /// By hand: a gate between posts at (2, -0.4) and (2, 0.4).
    #[test]
    fn a_gate_is_passed_where_the_way_crosses_it() {
        let at = |x_m: f64, y_m: f64| CarPose { x_m, y_m, ..ORIGIN };
        let passes = |from, to| {
            let markers = [(1, [2.0, -0.4]), (2, [2.0, 0.4])];
            seen(Settings::default(), &markers).moved(from, to) == Some([1, 2])
        };
        assert!(passes(at(1.9, 0.0), at(2.1, 0.0)) && passes(at(2.1, 0.3), at(1.9, 0.3)));
        assert!(passes(at(1.9, -0.3), at(2.1, -0.3)) && passes(at(1.0, -1.0), at(2.5, 0.5)));
        // The motion stops short, starts behind, passes on either side, or runs along the gate.
        assert!(!passes(at(1.0, 0.0), at(1.9, 0.0)) && !passes(at(2.1, 0.0), at(3.0, 0.0)));
        assert!(!passes(at(1.9, 0.5), at(2.1, 0.5)) && !passes(at(1.9, -0.5), at(2.1, -0.5)));
        assert!(!passes(at(1.9, -1.0), at(1.9, 1.0)) && !passes(at(1.0, -1.0), at(2.5, 2.0)));
    }

    /// The car is in fact a metre farther back and looks to the left. The marker half a metre
    /// before the car moves with it, to (-1, 0.5). The one 2 m before it is discarded. If the near
    /// marker is carried a second time without a sighting, it is discarded, too: it may be a false
    /// obstacle.
    #[test]
    fn what_is_near_goes_along_once_with_a_car_that_is_elsewhere() {
        let markers = [(1, [0.5, 0.0]), (2, [2.0, 0.0])];
        let mut gates = seen(Settings::default(), &markers);
        for (id, place) in markers {
            assert!(!gates.see(id, place));
        }
        let there = CarPose {
            x_m: -1.0,
            heading_rad: core::f64::consts::FRAC_PI_2,
            ..ORIGIN
        };
        gates.carry(ORIGIN, there);
        let markers: Vec<(u32, [f64; 2])> = gates.markers().collect();
        let [(1, [x_m, y_m])] = markers[..] else {
            panic!("{markers:?}");
        };
        assert!((x_m + 1.0).abs() < 1e-9 && (y_m - 0.5).abs() < 1e-9);
        // A new sighting moves the marker at once by half the difference.
        gates.see(1, [-1.0, 0.7]);
        let (_, [_, y_m]) = gates.markers().next().unwrap();
        assert!((y_m - 0.6).abs() < 1e-9);
        for left in [1, 0] {
            gates.carry(there, there);
            assert_eq!(gates.markers().count(), left);
        }
    }

    /// The markers' positions are discarded; the passed gates are not.
    #[test]
    fn a_gate_that_was_passed_is_not_driven_through_again() {
        let markers = [(1, [2.0, -0.4]), (2, [2.0, 0.4])];
        let mut gates = seen(Settings::default(), &markers);
        assert!(
            gates
                .moved(ORIGIN, CarPose { x_m: 3.0, ..ORIGIN })
                .is_some()
        );
        gates.carry(CarPose { x_m: 9.0, ..ORIGIN }, ORIGIN);
        assert_eq!(gates.markers().count(), 0);
        for (id, place) in markers {
            assert!(gates.see(id, place));
        }
        assert_eq!(gates.next(ORIGIN, anywhere), None);
        assert_eq!(gates.passed(), [[1, 2]]);
    }

    /// A gate right beside the rear axle is not ahead, one a centimetre farther is.
    #[test]
    fn a_gate_beside_the_car_is_not_ahead() {
        let gates = seen(Settings::default(), &[(10, [2.4, 1.0]), (11, [1.6, 1.0])]);
        let at = |x_m| CarPose { x_m, ..ORIGIN };
        assert_eq!(gates.next(at(2.0), anywhere), None);
        assert!(gates.next(at(1.99), anywhere).is_some());
    }

    /// By hand: the posts at -2, -2 and -1.4, -1.4 are 0.85 m apart. The markers mirrored at an
    /// axis are 4 m from the first post; those on an axis are 2 m from it, and 1.5 m from the other
    /// post.
    #[test]
    fn how_far_markers_are_apart_does_not_depend_on_where_the_map_begins() {
        let markers = [
            (1, [-2.0, -2.0]),
            (2, [-1.4, -1.4]),
            (3, [2.0, -2.0]),
            (4, [-2.0, 2.0]),
            (5, [0.0, -2.0]),
            (6, [-2.0, 0.0]),
        ];
        let gates = seen(Settings::default(), &markers);
        assert_eq!(gates.found(), [[[-2.0, -2.0], [-1.4, -1.4]]]);
    }
}
