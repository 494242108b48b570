//! Loop closures. If the path since the last visit is short, the pose is nearly known and the
//! keyframe is aligned with the old walls. If it is long, the recent walls are searched in the old
//! ones; a match is accepted only if it occurs twice and no beam contradicts it.

use emulators::world::{Pose, wrap_angle};

use super::summits::{best_and_others, window};
use super::{DROP, Mapper, POOR, blurred, seen_from};
use crate::mapping::align::{Fit, Prior, align};
use crate::mapping::branch::{Bounds, Wide, search, step_for};
use crate::mapping::cloud::{Cloud, Frame, Spot};
use crate::mapping::free::Free;
use crate::mapping::graph::{Edge, Kind, Walk};
use crate::mapping::keyframe::Keyframe;
use crate::mapping::matrix::{Matrix, weighed};
use crate::mapping::motion::{between, distance, moved};
use crate::mapping::surfels::{Surfels, some_of};

/// A possible loop closure.
#[derive(Clone, Copy, Debug)]
pub(super) struct Guess {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) way: Pose,
    pub(super) information: Matrix,
}

/// The state between two searches.
#[derive(Clone, Debug, Default)]
pub(crate) struct Closing {
    pub(super) guesses: Vec<Guess>,
    looked_at_m: f64,
    /// Number of new edges since the last optimisation.
    fresh: usize,
    /// Number of ambiguous places.
    pub(crate) ambiguous: usize,
    /// Number of loops that turned out to be false.
    pub(crate) dropped: usize,
    /// Walls that the next search draws over.
    spare: Surfels,
}

/// Length of path between two searches, metres.
const EACH_M: f64 = 1.0;

/// The same for the last search: length of the path, between two searches, and of the recent walls,
/// metres.
const LAST_M: f64 = 4.0;
const LAST_EACH_M: f64 = 0.5;
const LAST_VIEW_M: f64 = 3.0;

/// Minimum length of path since an old place, metres.
const OLD_M: f64 = 15.0;
/// Length of path above which the pose is not nearly known, metres.
const FAR_M: f64 = 40.0;

/// Maximum length of path that counts for the uncertainty, metres.
const WAY_MAX_M: f64 = 500.0;
/// Errors of a path: metres and radians at its beginning, per metre, and at most. Three deviations.
const REACH: [f64; 3] = [0.4, 0.035, 15.0];
const TURN: [f64; 3] = [0.06, 0.003, 0.5];
/// Length of path before and behind a keyframe whose walls represent a place, metres.
pub(super) const PLACE_M: f64 = 8.0;
/// Maximum number of places that are checked.
const PLACES: usize = 3;
/// Minimum share of a keyframe on old walls.
const EXPLAINED: f64 = 0.6;

/// Limits for a match of the recent walls at an unexpected place: minimum share on old walls,
/// maximum share that beams of the old place contradict, and maximum relative score of any other
/// pose.
const EXPLAINED_FAR: f64 = 0.6;
const DENIED_MOST: f64 = 0.1;
const RIVAL: f64 = 0.85;
/// Squared deviations above which two poses are different.
const APART: f64 = 25.0;
/// Maximum difference between two guesses that agree, metres and radians.
const AGREE_M: f64 = 0.35;
const AGREE_RAD: f64 = 0.05;
/// Error of a new edge in squared deviations that starts an optimisation at once, and number of new
/// edges that starts one in any case.
const STRAINED: f64 = 12.0;
const FRESH_MAX: usize = 40;
/// Number of poses nearest along edges that the optimisation moves: distant poses hardly change,
/// and the cost does not grow with the building.
const NEAR: usize = 400;
/// Number of optimisation steps.
const STEPS: u32 = 6;
/// Error in squared deviations above which a loop is false after all others have been weighted: its
/// weight is a tenth or less, and it is removed.
const HOPELESS: f64 = 64.0;

/// Whether another pose is as good as the best one and not within its uncertainty. Along a corridor
/// all poses are similar, so that none of them is accepted.
fn is_rival(other: &Fit, best: &Fit) -> bool {
    let turn = wrap_angle(other.pose.theta - best.pose.theta);
    let off = [other.pose.x - best.pose.x, other.pose.y - best.pose.y, turn];
    other.score > RIVAL * best.score && weighed(&blurred(&best.information), off) > APART
}

fn grown(by: [f64; 3], way_m: f64) -> f64 {
    (by[0] + by[1] * way_m).min(by[2])
}

impl Mapper {
    /// Searches for loop closures of the newest keyframe; returns whether poses have moved.
    pub(crate) fn close(&mut self, number: usize) -> bool {
        if self.lost.is_open && self.find_part(number) {
            return true;
        }
        let path_m = self.keyframes[number].path_m;
        if path_m - self.closing.looked_at_m < EACH_M {
            return false;
        }
        self.closing.looked_at_m = path_m;
        let mut is_strained = false;
        for (key, way_m) in self.places(number) {
            if way_m < FAR_M {
                is_strained |= self.lay(key, number, way_m);
            } else if self.seek(key, number, way_m, PLACE_M) {
                return true;
            }
        }
        if is_strained || self.closing.fresh >= FRESH_MAX {
            self.graph.bend = self.bend.told();
            let moved = self.graph.optimise_near(number, NEAR, STEPS);
            let dropped = self.graph.drop_loops_of(&moved, HOPELESS);
            self.agreed(dropped);
            return true;
        }
        false
    }

    /// Old keyframes near the newest one, one per place, the nearest first.
    fn places(&self, number: usize) -> Vec<(usize, f64)> {
        let here = self.graph.poses[number];
        let path_m = self.keyframes[number].path_m;
        let most_m = REACH[2] + 2.0;
        let mut near: Vec<(f64, usize)> = Vec::new();
        for (key, (keyframe, pose)) in self.keyframes.iter().zip(&self.graph.poses).enumerate() {
            let is_old = path_m - keyframe.path_m > OLD_M && keyframe.quality >= POOR;
            // Quick check: most keyframes are far away.
            let is_near = (pose.x - here.x).abs() < most_m && (pose.y - here.y).abs() < most_m;
            let is_joined = keyframe.part == self.keyframes[number].part;
            if is_old && is_near && is_joined {
                near.push((distance(*pose, here), key));
            }
        }
        near.retain(|(far, _)| *far < most_m);
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut walk = Walk::of(&self.graph, number, WAY_MAX_M);
        let mut places: Vec<(usize, f64)> = Vec::new();
        for (far, key) in near {
            let path_m = self.keyframes[key].path_m;
            let is_new = |(other, _): &(usize, f64)| {
                (self.keyframes[*other].path_m - path_m).abs() > 1.5 * PLACE_M
            };
            if places.len() == PLACES {
                break;
            }
            if !places.iter().all(is_new) {
                continue;
            }
            let way_m = walk.way_to(key);
            if far < grown(REACH, way_m) + 2.0 {
                places.push((key, way_m));
            }
        }
        places
    }

    /// The keyframes within the given lengths of path before and behind this one.
    pub(super) fn chain(
        &self,
        key: usize,
        before_m: f64,
        behind_m: f64,
    ) -> core::ops::Range<usize> {
        let at_m = self.keyframes[key].path_m;
        let path = |key: &Keyframe| key.path_m;
        let first = self
            .keyframes
            .partition_point(|key| path(key) < at_m - before_m);
        let end = self
            .keyframes
            .partition_point(|key| path(key) <= at_m + behind_m);
        first..end
    }

    /// The walls that these keyframes have seen around `middle`. Most searches give them back as
    /// `closing.spare`: their memory is a megabyte.
    pub(super) fn walls_of(
        &mut self,
        keys: core::ops::Range<usize>,
        middle: Pose,
        reach_m: f32,
    ) -> Surfels {
        let mut walls = core::mem::take(&mut self.closing.spare);
        walls.aim(Frame::new(middle).at, reach_m);
        walls.draw_all(keys.map(|key| (self.graph.poses[key], &self.keyframes[key].cloud)));
        walls
    }

    /// Aligns the newest keyframe with the walls around an old one; returns whether the new edge
    /// has a large error.
    fn lay(&mut self, key: usize, number: usize, way_m: f64) -> bool {
        let old = self.chain(key, PLACE_M, PLACE_M);
        let walls = self.walls_of(old, self.graph.poses[key], 25.0);
        let spots = some_of(self.keyframes[number].cloud.spots(), 180);
        let prior = Prior {
            pose: self.graph.poses[number],
            deviation: [grown(REACH, way_m) / 3.0, grown(TURN, way_m) / 3.0],
        };
        let step = step_for(&spots);
        let window = window(&prior, step, 3.0);
        let (fit, others) = best_and_others(&walls, &spots, &window, &prior);
        self.closing.spare = walls;
        if fit.explained < EXPLAINED.max(self.usual - DROP) {
            return false;
        }
        if others.iter().any(|other| is_rival(other, &fit)) {
            self.closing.ambiguous += 1;
            return false;
        }
        let edge = self.edge(key, number, &fit);
        let strain = self.graph.strain(&edge);
        self.graph.add_edge(edge);
        self.closing.fresh += 1;
        strain > STRAINED
    }

    fn edge(&self, key: usize, number: usize, fit: &Fit) -> Edge {
        let from = self.graph.poses[key];
        Edge {
            from: key,
            to: number,
            way: between(from, fit.pose),
            information: seen_from(from, &blurred(&fit.information)),
            kind: Kind::Loop,
        }
    }

    /// Searches for the walls of the last `view_m` metres at an old place and closes the loop if
    /// they match.
    fn seek(&mut self, key: usize, number: usize, way_m: f64, view_m: f64) -> bool {
        let here = self.graph.poses[number];
        let lately = self.chain(number, view_m, 0.0);
        let spots = self.seen_from(lately.clone(), here);
        let wide = Wide {
            reach_m: grown(REACH, way_m),
            turn: grown(TURN, way_m),
            floor: 0.45,
        };
        #[expect(clippy::cast_possible_truncation, reason = "tens of metres")]
        let reach_m = (25.0 + wide.reach_m) as f32;
        let old = self.chain(key, PLACE_M, PLACE_M);
        let walls = self.walls_of(old.clone(), self.graph.poses[key], reach_m);
        let Some(fit) = self.found(&walls, &spots, here, &wide) else {
            return false;
        };
        if fit.explained < EXPLAINED_FAR || self.is_denied(&walls, old, lately, &spots, &fit) {
            return false;
        }
        self.believe(self.guess(key, number, &fit))
    }

    pub(super) fn guess(&self, key: usize, number: usize, fit: &Fit) -> Guess {
        let edge = self.edge(key, number, fit);
        Guess {
            from: key,
            to: number,
            way: edge.way,
            information: edge.information,
        }
    }

    /// The only matching pose in the window; `None` if there is none or several.
    pub(super) fn found(
        &mut self,
        walls: &Surfels,
        spots: &[Spot],
        here: Pose,
        wide: &Wide,
    ) -> Option<Fit> {
        let bounds = Bounds::of(walls);
        let (found, is_cut) = search(walls, &bounds, spots, here, wide);
        let mut summits: Vec<Fit> = Vec::new();
        for one in found {
            let is_apart = |fit: &Fit| {
                let turn = wrap_angle(fit.pose.theta - one.pose.theta).abs();
                distance(fit.pose, one.pose) > 0.7 || turn > 0.12
            };
            if summits.len() >= 4 {
                break;
            }
            if summits.iter().all(is_apart) {
                let prior = Prior {
                    pose: one.pose,
                    deviation: [0.3, 0.1],
                };
                summits.push(align(walls, spots, one.pose, &prior));
            }
        }
        summits.sort_by(|a, b| b.score.total_cmp(&a.score));
        let best = summits.first().copied()?;
        let is_rival = |fit: &Fit| {
            let is_apart = distance(fit.pose, best.pose) > 0.5
                || wrap_angle(fit.pose.theta - best.pose.theta).abs() > 0.1;
            is_apart && fit.score > RIVAL * best.score
        };
        if is_cut || summits.iter().skip(1).any(is_rival) {
            self.closing.ambiguous += 1;
            return None;
        }
        Some(best)
    }

    /// The spots of the keyframes, relative to `here`.
    pub(super) fn seen_from(&self, keys: core::ops::Range<usize>, here: Pose) -> Vec<Spot> {
        let mut spots = Vec::new();
        let mut taken = std::collections::BTreeSet::new();
        for key in keys.rev() {
            let frame = Frame::new(between(here, self.graph.poses[key]));
            for spot in self.keyframes[key].cloud.spots() {
                let at = frame.place(spot.at);
                if taken.insert(at.map(crate::mapping::surfels::cell)) {
                    spots.push(Spot {
                        at,
                        normal: frame.turned(spot.normal),
                        is_joined: false,
                    });
                }
            }
        }
        some_of(&spots, 500)
    }

    /// Whether beams of one place cross walls of the other.
    pub(super) fn is_denied(
        &self,
        walls: &Surfels,
        old: core::ops::Range<usize>,
        lately: core::ops::Range<usize>,
        spots: &[Spot],
        fit: &Fit,
    ) -> bool {
        let mut free = Free::like(walls);
        for key in old.clone() {
            free.draw(self.graph.poses[key], &self.keyframes[key].cloud);
        }
        if free.denied(walls, spots, fit.pose) > DENIED_MOST {
            return true;
        }
        // The same in the other direction.
        let last = self.graph.poses[lately.end - 1];
        let mut seen = walls.empty_at(Frame::new(fit.pose).at);
        let mut free = Free::like(&seen);
        for key in lately {
            let pose = moved(fit.pose, between(last, self.graph.poses[key]));
            seen.draw(pose, &self.keyframes[key].cloud);
            free.draw(pose, &self.keyframes[key].cloud);
        }
        let origin = Pose::default();
        let there = Cloud::from_spots(self.seen_from(old, origin));
        free.denied(&seen, there.spots(), origin) > 2.0 * DENIED_MOST
    }

    /// Closes a loop that was seen twice.
    pub(super) fn believe(&mut self, guess: Guess) -> bool {
        let at_m = self.keyframes[guess.to].path_m;
        let lately = |other: &Guess| at_m - self.keyframes[other.to].path_m < 2.0 * PLACE_M;
        self.closing.guesses = self
            .closing
            .guesses
            .iter()
            .copied()
            .filter(lately)
            .collect();
        let agreeing: Vec<Guess> = self
            .closing
            .guesses
            .iter()
            .copied()
            .filter(|other| self.do_agree(other, &guess))
            .collect();
        self.closing.guesses.push(guess);
        if agreeing.is_empty() {
            return false;
        }
        self.closed(agreeing.into_iter().chain([guess]));
        true
    }

    /// Adds loops and optimises the poses.
    pub(super) fn closed(&mut self, loops: impl IntoIterator<Item = Guess>) {
        for guess in loops {
            self.graph.add_edge(Edge {
                from: guess.from,
                to: guess.to,
                way: guess.way,
                information: guess.information,
                kind: Kind::Loop,
            });
        }
        self.closing.guesses.clear();
        self.graph.bend = self.bend.told();
        self.graph.optimise(STEPS);
        let dropped = self.graph.drop_loops(HOPELESS);
        self.agreed(dropped);
    }

    pub(super) fn do_agree(&self, a: &Guess, b: &Guess) -> bool {
        let poses = &self.graph.poses;
        let there = [a, b].map(|guess| moved(poses[guess.from], guess.way));
        let by_walls = between(there[0], there[1]);
        let by_way = between(poses[a.to], poses[b.to]);
        distance(by_walls, by_way) < AGREE_M
            && wrap_angle(by_walls.theta - by_way.theta).abs() < AGREE_RAD
    }

    /// Searches for loop closures of the last keyframes once more, with shorter views. A robot that
    /// comes back to a known area in the last metres of its path has seen most of its recent walls
    /// before it came there, and no later keyframe can confirm a match.
    pub(crate) fn close_last(&mut self) {
        if !self.settings.closes_loops {
            return;
        }
        let last = self.chain(self.keyframes.len() - 1, LAST_M, 0.0);
        let mut looked_at_m = f64::NEG_INFINITY;
        for number in last {
            let path_m = self.keyframes[number].path_m;
            if path_m - looked_at_m < LAST_EACH_M {
                continue;
            }
            looked_at_m = path_m;
            for (key, way_m) in self.places(number) {
                if way_m < FAR_M {
                    self.lay(key, number, way_m);
                } else if self.seek(key, number, way_m, LAST_VIEW_M) {
                    break;
                }
            }
        }
    }

    /// Optimises all poses at the end, and removes contradicting loops.
    pub(crate) fn settle(&mut self) {
        self.graph.bend = self.bend.told();
        self.graph.optimise(10);
        self.learn_bend();
        self.graph.bend = self.bend.told();
        self.graph.optimise(10);
        let dropped = self.graph.drop_loops(HOPELESS);
        if dropped > 0 {
            self.closing.dropped += dropped;
            self.graph.optimise(10);
        }
        self.relabel();
    }

    /// Updates the state after an optimisation that removed `dropped` loops, and moves the robot to
    /// its new pose.
    fn agreed(&mut self, dropped: usize) {
        self.closing.fresh = 0;
        self.closing.dropped += dropped;
        self.relabel();
        self.learn_bend();
        self.pose = *self.graph.poses.last().expect("a keyframe was just kept");
    }
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "metres of a small room")]
mod tests {
    use super::*;
    use crate::mapping::building::Building;
    use crate::mapping::motion::aligned_m;
    use crate::mapping::{Settings, Shot};

    /// A scan at the origin of a room from (-2, -1.5) to (3, 2), metres, with a niche in the north:
    /// no other pose in the room gives the same scan.
    fn room() -> Cloud {
        let ends = (-180..180).map(|degree| {
            let (sin, cos) = libm::sincos((f64::from(degree) + 0.5).to_radians());
            let to_x = if cos > 0.0 { 3.0 } else { -2.0 } / cos;
            let to_y = if sin > 0.0 { 2.0 } else { -1.5 } / sin;
            let in_niche = sin > 0.0 && (0.5..1.2).contains(&(cos * to_y));
            let range = to_x.min(if in_niche { 2.6 / sin } else { to_y });
            [(range * cos) as f32, (range * sin) as f32]
        });
        Cloud::new(&ends.collect::<Vec<_>>())
    }

    /// Searches for the room from here, up to 7 m away, with rooms at these poses.
    fn looked_for(rooms: &[Pose]) -> (Option<Fit>, usize) {
        let mut walls = Surfels::around([0.0; 2], 25.0);
        rooms.iter().for_each(|place| walls.draw(*place, &room()));
        let mut mapper = Mapper::new(Settings::default());
        let wide = Wide {
            reach_m: 7.0,
            turn: 0.3,
            floor: 0.45,
        };
        let found = mapper.found(&walls, room().spots(), Pose::new(1.0, 0.5, 0.05), &wide);
        (found, mapper.ambiguous())
    }

    #[test]
    fn a_place_that_stands_alone_is_found() {
        let there = Pose::new(-3.0, 2.0, -0.1);
        let (found, ambiguous) = looked_for(&[there]);
        let found = found.expect("a room");
        assert!(
            distance(found.pose, there) < 0.02 && found.explained > 0.95,
            "{found:?}"
        );
        assert_eq!(ambiguous, 0);
    }

    /// A robot in the second of two similar rooms must not be placed in the first one.
    #[test]
    fn of_two_places_alike_neither_is_believed() {
        let rooms = [Pose::new(-3.0, 2.0, -0.1), Pose::new(4.0, -2.0, 0.0)];
        let (found, ambiguous) = looked_for(&rooms);
        assert!(found.is_none() && ambiguous == 1, "{found:?}");
    }

    /// A pose known to 1 cm along x and 1 m along y. An equally good pose 0.6 m away along x is a
    /// rival; along y it is within the uncertainty. A much worse pose is no rival.
    #[test]
    fn a_rival_is_as_good_and_elsewhere() {
        let fit = |x: f64, y: f64, score: f64| Fit {
            pose: Pose::new(x, y, 0.0),
            information: crate::mapping::matrix::diagonal([1e4, 1.0, 1e4]),
            explained: score,
            score,
        };
        let best = fit(0.0, 0.0, 0.9);
        assert!(is_rival(&fit(0.6, 0.0, 0.85), &best));
        assert!(!is_rival(&fit(0.0, 0.6, 0.85), &best));
        assert!(!is_rival(&fit(0.6, 0.0, 0.7), &best));
        assert!(!is_rival(&fit(0.04, 0.0, 0.9), &best));
    }

    /// The nearest old keyframe represents a place, unless it lay hardly on walls: its pose is
    /// uncertain.
    #[test]
    fn a_poor_keyframe_stands_for_no_place() {
        let nearest = |quality: f64| {
            let mut mapper = Mapper::new(Settings::default());
            for (number, (x, path_m)) in [(0.0, 0.0), (0.5, 0.5), (0.2, 20.0)]
                .into_iter()
                .enumerate()
            {
                mapper.graph.add_pose(Pose::new(x, 0.0, 0.0));
                mapper.keyframes.push(Keyframe {
                    cloud: room(),
                    path_m,
                    quality: if number == 0 { quality } else { 1.0 },
                    scan: number,
                    turned: 0.0,
                    wheels_m: path_m,
                    by_odometry: 0.0,
                    part: 0,
                });
                if number > 0 {
                    let poses = &mapper.graph.poses;
                    mapper.graph.add_edge(Edge {
                        from: number - 1,
                        to: number,
                        way: between(poses[number - 1], poses[number]),
                        information: crate::mapping::matrix::diagonal([100.0; 3]),
                        kind: Kind::Way,
                    });
                }
            }
            mapper.places(2).first().map(|(key, _)| *key)
        };
        assert_eq!([nearest(1.0), nearest(0.4)], [Some(0), Some(1)]);
    }

    /// The log ends while the robot comes back to the corridor where it began: no loop is closed
    /// yet. Five scans later one would be.
    #[test]
    fn a_loop_at_the_end_of_a_log_is_closed() {
        let building = Building::generate(16);
        let sights = &building.sights[..=100];
        let mut mapper = Mapper::new(Settings {
            start: sights[0].truth,
            ..Settings::default()
        });
        for sight in sights {
            mapper.take(&Shot {
                moved: sight.moved,
                is_measured: true,
                ends: &sight.ends,
            });
        }
        let truth: Vec<Pose> = sights.iter().map(|sight| sight.truth).collect();
        let off_m = |mapper: &Mapper| aligned_m(&truth, &mapper.way());
        let (open_m, loops) = (off_m(&mapper), mapper.graph().loops().len());
        assert_eq!(loops, 0);
        mapper.finish();
        let (closed_m, loops) = (off_m(&mapper), mapper.graph().loops().len());
        assert!(
            loops > 1 && closed_m < open_m / 2.0,
            "{loops}, {closed_m} of {open_m}"
        );
    }

    /// Two keyframes 1 m apart, both matched 5 m to the north, agree. A keyframe matched 1 m
    /// farther does not. A single match closes no loop.
    #[test]
    fn a_place_seen_once_is_not_believed() {
        let mut mapper = Mapper::new(Settings::default());
        for number in 0..3 {
            mapper
                .graph
                .add_pose(Pose::new(f64::from(number), 0.0, 0.0));
            mapper.keyframes.push(Keyframe {
                cloud: room(),
                path_m: f64::from(number),
                quality: 1.0,
                scan: 0,
                turned: 0.0,
                wheels_m: 0.0,
                by_odometry: 0.0,
                part: 0,
            });
        }
        let guess = |to: usize, x: f64| Guess {
            from: 0,
            to,
            way: Pose::new(x, 5.0, 0.0),
            information: crate::mapping::matrix::diagonal([100.0; 3]),
        };
        assert!(!mapper.believe(guess(1, 1.0)));
        assert!(!mapper.believe(guess(2, 3.0)));
        assert!(mapper.graph.edges.is_empty());
        assert!(mapper.believe(guess(2, 2.0)));
        assert_eq!(mapper.graph.edges.len(), 2);
    }
}
