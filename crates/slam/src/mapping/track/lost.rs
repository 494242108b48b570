//! Robots that were carried, pushed or turned without the wheels' notice. A scan that contradicts
//! the walls begins a new part of the map. The part is joined to the others once the mapper
//! recognises it there, at one place only and twice. Until then their relative pose is unknown.

mod joins;

use std::collections::BTreeSet;

use emulators::world::{Pose, wrap_angle};

use super::closing::{Guess, PLACE_M};
use super::{Mapper, POOR, Placed};
use crate::mapping::branch::Wide;
use crate::mapping::cloud::{Cloud, Frame, Spot};
use crate::mapping::free::Free;
use crate::mapping::graph::{Edge, Kind};
use crate::mapping::keyframe::Keyframe;
use crate::mapping::matrix::{Matrix, diagonal};
use crate::mapping::motion::{between, distance, moved};

/// State of a lost robot.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lost {
    /// Consecutive scans that contradict the walls.
    held: Vec<usize>,
    /// Part of the map in which the robot is, and whether other parts remain to be joined.
    pub(super) part: usize,
    pub(super) is_open: bool,
    tour: Option<Tour>,
    /// A place that was recognised once.
    seen: Option<Guess>,
    /// Joins that another place of the finished map allows as well, as the first keyframes behind
    /// the unknown motions.
    alike: BTreeSet<usize>,
}

/// A search through all places of the other parts, a few at each keyframe.
#[derive(Clone, Debug)]
struct Tour {
    number: usize,
    spots: Vec<Spot>,
    places: Vec<usize>,
    next: usize,
    /// Candidates: the loop, the newest keyframe's pose by it, and the score.
    found: Vec<(Guess, Pose, f64)>,
    /// Whether a place fitted at several poses.
    is_ambiguous: bool,
}

/// Limits of the contradiction, a sum of two shares: beam ends in free space, and walls that beams
/// cross. The first limit is for scans of which less than half lies on walls, the second for scans
/// that fit much less than usual.
const CONTRADICTED: [f64; 2] = [0.25, 0.4];
/// A smaller contradiction counts if it is above the first value, as moving people are below it,
/// and outweighs the share on walls by the second: little of the scan can be compared at all, and
/// most of that contradicts the walls.
const OUTWEIGHS: [f64; 2] = [0.1, 2.0];
/// Path length that replaces an unknown motion, metres: all keyframes before it count as old.
const UNKNOWN_M: f64 = 40.0;
/// Deviations of an unknown motion, metres and radians. Much larger ones, with the lever of a long
/// path, are lost in the rounding of the equations.
const UNKNOWN: [f64; 2] = [100.0, 3.0];
/// Spacing of searched places along the path, and radius of the search around each, metres.
const APART_M: f64 = 4.0;
const AROUND_M: f64 = 4.0;
/// Path length of a part before it is searched for in the other parts, metres. One scan looks like
/// many places, and a search of a large map takes long.
const SHORT_M: f64 = PLACE_M;
/// Path length between the two sights of a place, metres.
const AGAIN_M: f64 = 2.0;
/// Path length between the first and the last place that confirm a join, metres.
const CONFIRMED_M: f64 = 2.0 * PLACE_M;
/// Places searched at a keyframe.
const PLACES: usize = 2;
/// Share of a scan on the walls of a recognised place, and highest relative score of any other.
const EXPLAINED: f64 = 0.6;
const RIVAL: f64 = 0.85;

/// Whether two poses of a recognised view are different.
fn are_apart(a: Pose, b: Pose) -> bool {
    distance(a, b) > 0.7 || wrap_angle(a.theta - b.theta).abs() > 0.15
}

/// Information of an unknown motion.
fn unknown() -> Matrix {
    let [metres, radians] = UNKNOWN.map(|deviation| 1.0 / (deviation * deviation));
    diagonal([metres, metres, radians])
}

impl Mapper {
    /// Contradiction between a scan and the recent walls: the share of its ends in free space plus
    /// the share of walls that its beams cross. A scan of an unknown area has a contradiction of 0.
    fn contradiction(&self, cloud: &Cloud) -> f64 {
        let last = self.chain(self.at, PLACE_M, 0.0);
        let mut free = Free::like(&self.walls);
        for key in last.clone() {
            free.draw(self.graph.poses[key], &self.keyframes[key].cloud);
        }
        let stands = free.denied(&self.walls, cloud.spots(), self.pose);
        let mut seen = self.walls.empty_at(Frame::new(self.pose).at);
        seen.draw(self.pose, cloud);
        let mut free = Free::like(&seen);
        free.draw(self.pose, cloud);
        let origin = Pose::default();
        let passes = free.denied(&seen, &self.seen_from(last, origin), origin);
        stands + passes
    }

    /// Examines a scan for a contradiction to the walls; returns whether there was one. A single
    /// such scan may be a hand in front of the lidar, so the next one decides: it lies on the walls
    /// at the pose of the odometry, or the robot is elsewhere.
    pub(super) fn has_lost(&mut self, cloud: &Cloud, placed: &Placed) -> bool {
        let limit = if placed.fit.explained < POOR {
            CONTRADICTED[0]
        } else {
            CONTRADICTED[1]
        };
        let is_poor = placed.fit.explained < self.least();
        let is_second = !self.lost.held.is_empty();
        let explained = placed.fit.explained;
        let is_denied = |by: f64| by > limit || by > OUTWEIGHS[0] && by > OUTWEIGHS[1] * explained;
        let is_lost = self.settings.closes_loops
            && !cloud.spots().is_empty()
            && (is_second && placed.has_slipped || is_poor && is_denied(self.contradiction(cloud)));
        if !is_lost {
            self.lost.held.clear();
            return false;
        }
        if is_second {
            self.begin_part(cloud.clone());
        } else {
            self.lost.held.push(self.scans.len());
            let since = between(self.graph.poses[self.at], self.pose);
            self.scans.push((self.at, since));
        }
        true
    }

    /// Begins a part of the map that is joined to nothing.
    fn begin_part(&mut self, cloud: Cloud) {
        let before = self.at;
        self.path_m += UNKNOWN_M;
        let number = self.graph.add_pose(self.pose);
        self.lost.part = number;
        self.lost.is_open = true;
        (self.lost.tour, self.lost.seen) = (None, None);
        // The held scans were taken after the unknown motion too.
        let way = self.way();
        for scan in core::mem::take(&mut self.lost.held) {
            if let Some(held) = self.scans.get_mut(scan) {
                *held = (number, between(self.pose, way[scan]));
            }
        }
        self.keyframes.push(Keyframe {
            cloud,
            path_m: self.path_m,
            quality: 1.0,
            scan: self.scans.len(),
            turned: self.by_wheels.turned,
            wheels_m: self.by_wheels.way_m,
            by_odometry: 1.0,
            part: self.lost.part,
        });
        self.scans.push((number, Pose::default()));
        self.graph.add_edge(Edge {
            from: before,
            to: number,
            way: between(self.graph.poses[before], self.pose),
            information: unknown(),
            kind: Kind::Unknown,
        });
        self.at = number;
        self.unsure = [0.0; 2];
        self.by_wheels.stand(Pose::default());
        (self.usual, self.below) = (POOR, 0);
        self.redraw();
    }

    /// Number of parts of the map, each connected by motions or loops; `None` if the mapper does
    /// not close loops.
    pub fn parts(&self) -> Option<usize> {
        let is_looked_for = self.settings.closes_loops && !self.keyframes.is_empty();
        is_looked_for.then(|| self.count_parts())
    }

    fn count_parts(&self) -> usize {
        let joined = self.graph.joined().into_iter().enumerate();
        joined.filter(|(pose, lowest)| pose == lowest).count()
    }

    /// The scan number of each keyframe.
    pub fn scans(&self) -> Vec<usize> {
        self.keyframes
            .iter()
            .map(|keyframe| keyframe.scan)
            .collect()
    }

    /// Part of the map of each scan, from 1.
    pub fn scan_parts(&self) -> Vec<usize> {
        let joined = self.graph.joined();
        let mut firsts = joined.clone();
        firsts.sort_unstable();
        firsts.dedup();
        let part = |key: usize| firsts.partition_point(|first| *first <= joined[key]);
        self.scans.iter().map(|(key, _)| part(*key)).collect()
    }

    /// Updates the part of each keyframe after loops were closed or dropped.
    pub(super) fn relabel(&mut self) {
        let mut has_changed = false;
        for (key, part) in self.keyframes.iter_mut().zip(self.graph.joined()) {
            has_changed |= key.part != part;
            key.part = part;
        }
        if has_changed {
            // Places of the same part need no further search.
            (self.lost.tour, self.lost.seen) = (None, None);
        }
        self.lost.part = self.keyframes.get(self.at).map_or(0, |key| key.part);
        self.lost.is_open = self.count_parts() > 1;
    }

    /// Number of unknown motions across which only one place was recognised, or a place that
    /// resembles another one. A wrong place is recognised as well as the right one.
    pub fn unsure_joins(&self) -> usize {
        let loops = || {
            let edges = self.graph.edges.iter();
            edges.filter(|edge| edge.kind == Kind::Loop)
        };
        let is_unsure = |motion: &&Edge| {
            let across = loops()
                .map(|edge| [edge.from.min(edge.to), edge.from.max(edge.to)])
                .filter(|[old, new]| *old < motion.to && *new >= motion.to)
                .map(|[_, new]| self.keyframes[new].path_m);
            let span = across.fold([f64::MAX, f64::MIN], |[least, most], path_m| {
                [least.min(path_m), most.max(path_m)]
            });
            let length_m = span[1] - span[0];
            // Without any loop, the parts are not joined at all.
            length_m >= 0.0 && (length_m < CONFIRMED_M || self.lost.alike.contains(&motion.to))
        };
        let motions = self.graph.edges.iter();
        motions
            .filter(|edge| edge.kind == Kind::Unknown)
            .filter(is_unsure)
            .count()
    }

    /// Share of the path that no loop closure confirms, 0 to 1. 1 if parts of the map were not
    /// joined, or a join is unsure; `None` if the mapper does not close loops, or the wheels
    /// measured no path.
    pub fn doubt(&self) -> Option<f64> {
        if self.parts()? > 1 || self.unsure_joins() > 0 {
            return Some(1.0);
        }
        let whole = self.keyframes.last().map_or(0.0, |key| key.wheels_m);
        if whole <= 0.0 {
            return None;
        }
        let looped = self.looped();
        let steps = self.keyframes.windows(2).zip(&looped);
        let open = steps
            .filter(|(_, looped)| !**looped)
            .map(|(keys, _)| keys[1].wheels_m - keys[0].wheels_m);
        // The sum of nothing is a negative zero.
        Some(open.sum::<f64>().max(0.0) / whole)
    }

    /// Searches for the newest part in all others. Returns whether it was joined.
    pub(super) fn find_part(&mut self, number: usize) -> bool {
        if let Some(seen) = self.lost.seen {
            return self.is_seen_again(seen, number);
        }
        let mut tour = match self.lost.tour.take() {
            Some(tour) => tour,
            None if self.is_short(number) => return false,
            None => self.tour(number, self.lost.part),
        };
        for _ in 0..PLACES {
            let Some(place) = tour.places.get(tour.next).copied() else {
                break;
            };
            tour.next += 1;
            let (found, is_ambiguous) = self.recognised(place, tour.number, &tour.spots);
            tour.is_ambiguous |= is_ambiguous;
            tour.found.extend(found);
        }
        if tour.next < tour.places.len() {
            self.lost.tour = Some(tour);
            return false;
        }
        self.lost.seen = tour.only_one(|key| self.keyframes[key].part);
        false
    }

    /// Whether the current part is still too short to be recognised.
    fn is_short(&self, number: usize) -> bool {
        self.keyframes[number].path_m - self.keyframes[self.lost.part].path_m < SHORT_M
    }

    /// Completes the search for other parts after the last scan: the rest of the tour, and further
    /// tours as long as each joins a part.
    pub(super) fn find_rest(&mut self) {
        let last = self.keyframes.len() - 1;
        while self.settings.closes_loops && self.lost.is_open {
            let parts = self.count_parts();
            let is_new = self.lost.tour.is_none() && self.lost.seen.is_none();
            if is_new {
                // The newest keyframe is the second sight, so that another is the first.
                let mut lately = self.chain(last, AGAIN_M, 0.0);
                let first = lately.find(|key| self.keyframes[*key].part == self.lost.part);
                self.lost.tour = Some(self.tour(first.unwrap_or(last), self.lost.part));
            }
            while self.lost.seen.is_none() && self.lost.tour.is_some() {
                self.find_part(last);
            }
            if let Some(seen) = self.lost.seen {
                self.is_seen_again(seen, last);
            }
            if is_new && self.count_parts() >= parts {
                break;
            }
        }
    }

    /// All places of parts other than `part`, the nearest first.
    fn tour(&self, number: usize, part: usize) -> Tour {
        let here = self.graph.poses[number];
        let mut places: Vec<(f64, usize)> = Vec::new();
        let mut last: Option<(usize, f64)> = None;
        for (key, keyframe) in self.keyframes.iter().enumerate() {
            let is_near = last.is_some_and(|(part, path_m)| {
                part == keyframe.part && keyframe.path_m - path_m < APART_M
            });
            if keyframe.part == part || is_near || keyframe.quality < POOR {
                continue;
            }
            last = Some((keyframe.part, keyframe.path_m));
            places.push((distance(self.graph.poses[key], here), key));
        }
        places.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Tour {
            number,
            spots: self.seen_from(self.chain(number, PLACE_M, 0.0), here),
            places: places.into_iter().map(|(_, key)| key).collect(),
            next: 0,
            found: Vec::new(),
            is_ambiguous: false,
        }
    }

    /// Searches for the recent view of a keyframe around a place, at every heading.
    fn recognised(
        &mut self,
        place: usize,
        number: usize,
        spots: &[Spot],
    ) -> (Option<(Guess, Pose, f64)>, bool) {
        let wide = Wide {
            reach_m: AROUND_M,
            turn: core::f64::consts::PI,
            floor: 0.45,
        };
        let old = self.chain(place, PLACE_M, PLACE_M);
        let middle = self.graph.poses[place];
        let walls = self.walls_of(old.clone(), middle, 30.0);
        let before = self.closing.ambiguous;
        let found = self.found(&walls, spots, middle, &wide);
        let is_ambiguous = core::mem::replace(&mut self.closing.ambiguous, before) > before;
        let found = found.filter(|fit| {
            let lately = self.chain(number, PLACE_M, 0.0);
            fit.explained >= EXPLAINED && !self.is_denied(&walls, old, lately, spots, fit)
        });
        let found = found.map(|fit| (self.guess(place, number, &fit), fit.pose, fit.score));
        (found, is_ambiguous)
    }

    /// Whether a later keyframe is where the first one was recognised; then the parts are joined.
    /// By the end of a long tour the robot may have left the other part, so one nearby is taken.
    fn is_seen_again(&mut self, seen: Guess, newest: usize) -> bool {
        if newest == seen.to {
            return false;
        }
        self.lost.seen = None;
        let number = self.chain(seen.to, 0.0, AGAIN_M).end - 1;
        let number = number.max(seen.to + 1);
        let there = moved(self.graph.poses[seen.from], seen.way);
        let by_way = between(self.graph.poses[seen.to], self.graph.poses[number]);
        let there = moved(there, by_way);
        let part = self.keyframes[seen.from].part;
        let near = (0..self.keyframes.len()).filter(|key| self.keyframes[*key].part == part);
        let far = |key: &usize| distance(self.graph.poses[*key], there);
        let Some(place) = near.min_by(|a, b| far(a).total_cmp(&far(b))) else {
            return false;
        };
        let here = self.graph.poses[number];
        let spots = self.seen_from(self.chain(number, 1.0, 0.0), here);
        let (Some((guess, ..)), _) = self.recognised(place, number, &spots) else {
            return false;
        };
        if !self.do_agree(&seen, &guess) {
            return false;
        }
        self.closing.guesses.clear();
        self.closed([seen, guess]);
        true
    }
}

impl Tour {
    /// The recognised place, if no other place of the same part resembles it. Places of other parts
    /// are not compared, because their relative pose is unknown.
    fn only_one(self, part: impl Fn(usize) -> usize) -> Option<Guess> {
        let mut found = self.found;
        found.sort_by(|a, b| b.2.total_cmp(&a.2));
        let (guess, pose, score) = *found.first()?;
        let is_rival = |other: &(Guess, Pose, f64)| {
            let is_same = part(other.0.from) == part(guess.from);
            is_same && other.2 > RIVAL * score && are_apart(other.1, pose)
        };
        let has_rival = self.is_ambiguous || found.iter().any(is_rival);
        (!has_rival).then_some(guess)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::building::{Building, Pass, Sight};
    use crate::mapping::{Settings, Shot};

    fn take(mapper: &mut Mapper, sight: &Sight, turn: f64, is_straight: bool) {
        // A robot that was turned sees everything turned in the opposite direction, and continues
        // sideways.
        let back = Frame::new(Pose::new(0.0, 0.0, -turn));
        let ends: Vec<[f32; 2]> = sight.ends.iter().map(|end| back.turned(*end)).collect();
        let (sin, cos) = (libm::sin(-turn), libm::cos(-turn));
        let Pose { x, y, theta } = sight.moved;
        let by = Pose::new(cos * x - sin * y, sin * x + cos * y, theta);
        mapper.take(&Shot {
            moved: if is_straight { sight.moved } else { by },
            is_measured: true,
            ends: &ends,
        });
    }

    /// Whether all tests run, as `tests/run.sh --all` does it.
    fn is_thorough() -> bool {
        std::env::var_os("HILRIG_TESTS").is_some_and(|tests| tests == "all")
    }

    fn begun(building: &Building) -> Mapper {
        Mapper::new(Settings {
            start: building.sights[0].truth,
            ..Settings::default()
        })
    }

    fn observed(mapper: &Mapper) -> (usize, f64) {
        let observed = mapper.parts().zip(mapper.doubt());
        observed.expect("loops are closed, and the wheels were read")
    }

    /// A mapper without loop closure or without odometry does not report an unobserved value.
    #[test]
    fn parts_and_doubt_are_none_unless_observed() {
        let building = Building::generate(1);
        for (closes_loops, is_measured, parts, has_doubt) in [
            (true, true, Some(1), true),
            (false, true, None, false),
            (true, false, Some(1), false),
        ] {
            let mut mapper = Mapper::new(Settings {
                closes_loops,
                ..Settings::default()
            });
            for sight in &building.sights[..20] {
                mapper.take(&Shot {
                    moved: if is_measured {
                        sight.moved
                    } else {
                        Pose::default()
                    },
                    is_measured,
                    ends: &sight.ends,
                });
            }
            mapper.finish();
            assert_eq!(
                (mapper.parts(), mapper.doubt().is_some()),
                (parts, has_doubt)
            );
        }
    }

    /// A held scan moves the robot by odometry; the errors of the odometry are added.
    #[test]
    fn a_held_scan_is_as_unsure_as_its_wheels() {
        let building = Building::generate(1);
        let mut mapper = begun(&building);
        let sights = &building.sights[..20];
        sights
            .iter()
            .for_each(|sight| take(&mut mapper, sight, 0.0, true));
        let before = mapper.unsure;
        let hand = (0..180).map(|beam| {
            let (sin, cos) = libm::sincos(f64::from(beam).to_radians() - 1.5);
            let range = 0.5 + 0.05 * f64::from(beam % 7);
            #[expect(clippy::cast_possible_truncation, reason = "metres")]
            let end = [(range * cos) as f32, (range * sin) as f32];
            end
        });
        let ends: Vec<[f32; 2]> = hand.collect();
        mapper.take(&Shot {
            moved: Pose::new(0.1, 0.0, 0.0),
            is_measured: true,
            ends: &ends,
        });
        assert_eq!(mapper.lost.held.len(), 1);
        assert!(mapper.unsure[0] > before[0] && mapper.unsure[1] > before[1]);
    }

    /// A place as good as the best is a rival only within the same part: the relative pose of two
    /// parts is unknown.
    #[test]
    fn rivals_are_places_of_one_part() {
        let found = |from: usize, x: f64| {
            let guess = Guess {
                from,
                to: 9,
                way: Pose::default(),
                information: diagonal([1.0; 3]),
            };
            (guess, Pose::new(x, 0.0, 0.0), 0.9)
        };
        for (parts, is_found) in [([0, 0], false), ([0, 5], true)] {
            let tour = Tour {
                number: 9,
                spots: Vec::new(),
                places: Vec::new(),
                next: 0,
                found: vec![found(0, 0.0), found(1, 3.0)],
                is_ambiguous: false,
            };
            assert_eq!(tour.only_one(|key| parts[key]).is_some(), is_found);
        }
    }

    /// A robot is carried from its path to a later part of it, and a second time. It is recognised
    /// at once in the second part, and in the first part when it returns there.
    #[test]
    fn a_part_is_joined_after_another_was() {
        let first = Building::generate(1);
        let again = Building::passed(1, 0.0, Pass::Again(1));
        let mut mapper = begun(&first);
        let (there, back) = (&first.sights[330..360], &again.sights[320..460]);
        let sights = first.sights[..80].iter().chain(there).chain(back);
        let mut most = 0;
        for sight in sights {
            take(&mut mapper, sight, 0.0, true);
            most = most.max(mapper.count_parts());
        }
        mapper.finish();
        assert_eq!((most, observed(&mapper).0), (3, 1));
    }

    /// A search of the old places that takes 500 m of path, mostly through empty space: the first
    /// sight is old when the second one comes, and is still valid. Runs with `HILRIG_TESTS=all`.
    #[test]
    fn a_part_is_joined_to_a_large_map() {
        if !is_thorough() {
            return;
        }
        let building = Building::generate(1);
        let mut mapper = begun(&building);
        let turned_at = building.sights.len() * 3 / 10;
        for (number, sight) in building.sights[..turned_at + 120].iter().enumerate() {
            if number == turned_at {
                far_away(&mut mapper);
            }
            if number == turned_at + 30 {
                let mut ended = mapper.clone();
                assert_eq!(ended.count_parts(), 2, "the tour is not over yet");
                ended.finish();
                assert_eq!(ended.count_parts(), 1, "the end of the log ends the tour");
            }
            let turn = f64::to_radians(if number >= turned_at { 180.0 } else { 0.0 });
            take(&mut mapper, sight, turn, number <= turned_at);
        }
        assert_eq!(mapper.count_parts(), 1);
    }

    /// Adds a path of 600 m through empty space, one kilometre away.
    fn far_away(mapper: &mut Mapper) {
        for step in 0..150 {
            let pose = Pose::new(1000.0 + 4.0 * f64::from(step), 0.0, 0.0);
            mapper.path_m += 4.0;
            let to = mapper.graph.add_pose(pose);
            mapper.graph.add_edge(Edge {
                from: to - 1,
                to,
                way: between(mapper.graph.poses[to - 1], pose),
                information: diagonal([1.0; 3]),
                kind: Kind::Way,
            });
            mapper.keyframes.push(Keyframe {
                cloud: Cloud::new(&[]),
                path_m: mapper.path_m,
                quality: 1.0,
                scan: 0,
                turned: mapper.by_wheels.turned,
                wheels_m: mapper.by_wheels.way_m,
                by_odometry: 0.0,
                part: mapper.lost.part,
            });
        }
    }

    /// A robot is turned while its wheels measure nothing. It ends at its true pose, or the map
    /// reports two parts; without the search the map would be wrong at the best quality. One angle
    /// runs by default, all of them with `HILRIG_TESTS=all`.
    #[test]
    fn a_robot_turned_unseen_is_found_again_or_the_map_has_two_parts() {
        let mut joined = 0;
        let all = [(5, 80.0), (1, 180.0), (1, 80.0), (2, -135.0)];
        let cases = if is_thorough() { &all[..] } else { &all[..1] };
        for &(seed, degrees) in cases {
            let building = Building::generate(seed);
            let mut mapper = begun(&building);
            let turned_at = building.sights.len() * 3 / 10;
            let sights = &building.sights[..turned_at + 200];
            for (number, sight) in sights.iter().enumerate() {
                let is_turned = number >= turned_at;
                let turn = if is_turned {
                    f64::to_radians(degrees)
                } else {
                    0.0
                };
                take(&mut mapper, sight, turn, number <= turned_at);
            }
            mapper.finish();
            let (way, last) = (mapper.way(), sights.len() - 1);
            let off = distance(way[last], sights[last].truth);
            let (parts, doubt) = observed(&mapper);
            joined += usize::from(parts == 1);
            assert!(off < 1.5 || parts > 1, "{seed} {degrees}: {off} m off");
            assert!(doubt >= 1.0 || parts == 1, "{seed} {degrees}: {doubt}");
            // Without the loops that joined them there are two parts again.
            mapper.graph.drop_loops(-1.0);
            mapper.settle();
            assert_eq!(observed(&mapper), (2, 1.0), "{seed} {degrees}");
            assert_eq!(mapper.scan_parts()[turned_at - 1], 1);
            assert_eq!(mapper.scan_parts()[last], 2);
        }
        assert!(3 * joined >= 2 * cases.len(), "{joined} joined");
    }

    /// Two long parts and an unknown motion between them: the equations determine the pose of the
    /// second part hardly, and rounding must not move it far.
    #[test]
    fn a_part_that_nothing_joins_stays_where_it_was() {
        let mut mapper = Mapper::new(Settings::default());
        let by = Pose::new(1.0, 0.0, 0.001);
        for number in 0..600 {
            let pose = Pose::new(f64::from(number), 0.0, 0.0);
            let to = mapper.graph.add_pose(pose);
            if to == 0 {
                continue;
            }
            let is_known = to != 300;
            mapper.graph.add_edge(Edge {
                from: to - 1,
                to,
                way: by,
                information: if is_known {
                    diagonal([4e4, 4e4, 1e6])
                } else {
                    unknown()
                },
                kind: if is_known { Kind::Way } else { Kind::Unknown },
            });
        }
        mapper.graph.optimise(10);
        for pair in mapper.graph.poses.windows(2) {
            let step = between(pair[0], pair[1]);
            assert!(distance(step, by) < 0.01, "{step:?}");
        }
    }

    /// A robot is carried from one building into another: no place is recognised, so the map has
    /// two parts.
    #[test]
    fn parts_that_are_recognised_nowhere_stay_apart() {
        let [first, second] = [2, 1].map(Building::generate);
        let mut mapper = begun(&first);
        let sights = first.sights[..80].iter().chain(&second.sights[60..150]);
        sights.for_each(|sight| take(&mut mapper, sight, 0.0, true));
        mapper.finish();
        assert_eq!(observed(&mapper), (2, 1.0));
        assert_eq!(mapper.way().len(), 170);
    }
}
