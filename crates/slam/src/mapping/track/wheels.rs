//! Odometry without scan matching, and its systematic error, learned from loop closures.

use emulators::world::{Pose, wrap_angle};

use super::{Mapper, RARE};
use crate::mapping::align::Prior;
use crate::mapping::graph::{Edge, Kind};
use crate::mapping::motion::{between, distance, moved};

/// Odometry without scan matching.
#[derive(Clone, Debug, Default)]
pub(super) struct ByWheels {
    pose: Pose,
    /// The pose at each scan.
    pub(super) way: Vec<Pose>,
    /// Sum of all turns, radians, and of all distances, metres.
    pub(super) turned: f64,
    pub(super) way_m: f64,
    /// Odometry pose at the last keyframe, and the matched pose as seen from that keyframe.
    stood: Pose,
    from: Pose,
    /// Whether the odometry has measured all motion since then.
    pub(super) is_whole: bool,
}

impl ByWheels {
    pub(super) fn go(&mut self, by: Pose, is_measured: bool) {
        self.is_whole &= is_measured;
        self.pose = moved(self.pose, by);
        self.turned += by.theta;
        self.way_m += libm::hypot(by.x, by.y);
        self.way.push(self.pose);
    }

    /// Sets the pose of the robot to `from`, relative to a keyframe.
    pub(super) const fn stand(&mut self, from: Pose) {
        self.stood = self.pose;
        self.from = from;
        self.is_whole = true;
    }

    /// The current pose by odometry, relative to that keyframe.
    pub(super) fn since_stand(&self) -> Pose {
        let (from, by) = self.moved_since_stand();
        moved(from, by)
    }

    /// The pose at the last keyframe, relative to it, and the motion since by odometry.
    pub(super) fn moved_since_stand(&self) -> (Pose, Pose) {
        (self.from, between(self.stood, self.pose))
    }
}

/// Systematic turn error of the odometry (bend), radians per metre.
///
/// On a path without loops, a weak bend cannot be distinguished from the systematic error of the
/// scan matcher: a mapper that corrects it integrates its own error (windup). A strong bend shows
/// in the walls of a single view, so it is corrected at once. A weak bend is learned from loop
/// closures only.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bend {
    /// Recent turn error, distance and squared turn error: radians, metres.
    lately: [f64; 3],
    /// Turn error between two sights of the same place, and the distance.
    looped: [f64; 2],
}

/// Bend that the walls themselves could have, radians per metre.
const HIDDEN: f64 = 0.003;
/// A bend is strong beyond this many standard deviations of the steps' noise.
const SIGMAS: f64 = 3.0;
/// Length of the recent path, metres.
const LATELY_M: f64 = 100.0;
/// Path length after which half of the measured bend is applied, metres: of the recent path, and of
/// paths between two sights of a place. The maximum bend, radians per metre.
const HALF_M: [f64; 2] = [5.0, 20.0];
const BEND_MOST: f64 = 0.05;
/// Standard deviation of the bend before any loop has taught it, radians per metre.
const UNTAUGHT: f64 = 0.01;
/// Steps with a larger turn error are slips and teach no bend: radians, and share of the turn.
const SLIP_RAD: f64 = 0.05;
const SLIP_PART: f64 = 0.15;

/// Shorter steps have a lower weight, longer steps have no higher one: metres.
const STEP_M: [f64; 2] = [0.2, 1.0];

/// Weighted turn error and distance. The weight is the distance, because a turn on the spot teaches
/// no bend per metre.
fn by_way(turn: f64, way_m: f64) -> [f64; 2] {
    let weight = way_m.min(STEP_M[1]);
    [weight * turn / way_m.max(STEP_M[0]), weight]
}

impl Bend {
    /// Adds a step: `turn` is the heading of the matched scan minus that of the odometry.
    fn add(&mut self, turn: f64, way_m: f64) {
        let kept = libm::exp(-way_m / LATELY_M);
        self.lately = self.lately.map(|sum| sum * kept);
        let [turn, way_m] = by_way(turn, way_m);
        self.lately[0] += turn;
        self.lately[1] += way_m;
        self.lately[2] += turn * turn;
    }

    pub(super) fn told(&self) -> f64 {
        let looped = self.looped[0] / (self.looped[1] + HALF_M[1]);
        let [turn, way_m, squares] = self.lately;
        let way_m = way_m + HALF_M[0];
        let lately = turn / way_m - looped;
        let noise = HIDDEN * HIDDEN + SIGMAS * SIGMAS * squares / (way_m * way_m);
        let strong = lately * lately * lately / (lately * lately + noise);
        (looped + strong).clamp(-BEND_MOST, BEND_MOST)
    }
}

impl Bend {
    /// Standard deviation of the bend that loops leave open, radians per metre.
    pub(super) fn unsure(&self) -> f64 {
        UNTAUGHT * HALF_M[1] / (self.looped[1] + HALF_M[1])
    }
}

impl Mapper {
    /// Updates the estimated error of the odometry: fast if it is larger than expected, slowly if
    /// smaller.
    pub(super) fn learn(&mut self, prior: &Prior, pose: Pose, way_m: f64) {
        let turn = wrap_angle(pose.theta - prior.pose.theta);
        let most = 2.0 * prior.deviation[1];
        let missed = turn.clamp(-most, most) + self.bend.told() * way_m;
        self.bend.add(missed, way_m);
        let off = [distance(pose, prior.pose), turn.abs()];
        for axis in [0, 1] {
            let usual = prior.deviation[axis] / self.wheels[axis].max(RARE);
            let seen = (off[axis] / usual).min(8.0);
            let part = if seen > self.wheels[axis] { 0.2 } else { 0.02 };
            self.wheels[axis] += part * (seen - self.wheels[axis]);
            self.wheels[axis] = self.wheels[axis].clamp(0.1, 6.0);
        }
    }

    /// Number of unknown motions before each keyframe.
    fn stretches(&self) -> Vec<usize> {
        let mut stretches = vec![0; self.keyframes.len()];
        let edges = self.graph.edges.iter();
        for edge in edges.filter(|edge| edge.kind == Kind::Unknown) {
            stretches[edge.to] = 1;
        }
        let mut before = 0;
        for stretch in &mut stretches {
            before += *stretch;
            *stretch = before;
        }
        stretches
    }

    /// Whether each step from a keyframe to the next lies between two sights of a place.
    pub(super) fn looped(&self) -> Vec<bool> {
        let mut opened = vec![0_i32; self.keyframes.len()];
        let stretches = self.stretches();
        let loops = self.graph.edges.iter();
        // A loop across an unknown motion joins two parts, but confirms no path.
        let is_held = |edge: &&Edge| stretches[edge.from] == stretches[edge.to];
        for edge in loops.filter(|edge| edge.kind == Kind::Loop).filter(is_held) {
            opened[edge.from.min(edge.to)] += 1;
            opened[edge.from.max(edge.to)] -= 1;
        }
        let mut open = 0;
        let steps = opened.into_iter().map(|opened| {
            open += opened;
            open > 0
        });
        steps.collect()
    }

    /// Learns the bend from the steps between two sights of a place.
    pub(super) fn learn_bend(&mut self) {
        let (mut turn, mut way) = (0.0, 0.0);
        let steps = self.keyframes.windows(2).zip(self.graph.poses.windows(2));
        let stretches = self.stretches();
        let whole = stretches.windows(2).map(|pair| pair[0] == pair[1]);
        for (((keys, poses), is_looped), is_whole) in steps.zip(self.looped()).zip(whole) {
            let by_wheels = keys[1].turned - keys[0].turned;
            let missed = wrap_angle(poses[1].theta - poses[0].theta - by_wheels);
            if is_looped && is_whole && missed.abs() < SLIP_RAD + SLIP_PART * by_wheels.abs() {
                let step = by_way(missed, keys[1].wheels_m - keys[0].wheels_m);
                turn += step[0];
                way += step[1];
            }
        }
        self.bend.looped = [turn, way];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::Settings;
    use crate::mapping::cloud::Cloud;
    use crate::mapping::keyframe::Keyframe;
    use crate::mapping::matrix::diagonal;

    /// An error of 0.02 rad in each turn on the spot is no bend. The same error in each half metre
    /// is a bend of 0.04 rad per metre.
    #[test]
    fn turns_on_the_spot_are_no_bend() {
        for (way_m, least, most) in [(0.0, 0.0, 0.0), (0.5, 0.03, 0.041)] {
            let mut bend = Bend::default();
            (0..400).for_each(|_| bend.add(0.02, way_m));
            let told = bend.told();
            assert!((least..=most).contains(&told), "{way_m} m: {told}");
        }
    }

    /// Half of a bend is applied after a path of a certain length. Loops that close a path of that
    /// length leave half of the deviation.
    #[test]
    fn loops_leave_less_of_the_bend_open() {
        let unsure = |way_m: f64| {
            let mut bend = Bend::default();
            bend.looped[1] = way_m;
            bend.unsure()
        };
        assert_eq!([0.0, HALF_M[1]].map(unsure), [UNTAUGHT, UNTAUGHT / 2.0]);
    }

    /// A place is seen at the first and the last of five keyframes. The loop confirms the path only
    /// if all motion between them is known.
    #[test]
    fn a_loop_across_an_unknown_motion_holds_no_way() {
        for (kind, looped) in [(Kind::Way, true), (Kind::Unknown, false)] {
            let mut mapper = Mapper::new(Settings::default());
            for number in 0..5 {
                mapper.graph.add_pose(Pose::new(number as f64, 0.0, 0.0));
                mapper.keyframes.push(Keyframe {
                    cloud: Cloud::new(&[]),
                    path_m: number as f64,
                    quality: 1.0,
                    scan: number,
                    turned: 0.0,
                    wheels_m: number as f64,
                    by_odometry: 0.0,
                    part: 0,
                });
            }
            let ways = [0, 1, 2, 3].map(|from| (from, from + 1));
            for (from, to) in ways.into_iter().chain([(0, 4)]) {
                mapper.graph.add_edge(Edge {
                    from,
                    to,
                    way: Pose::default(),
                    information: diagonal([1.0; 3]),
                    kind: match (from, to) {
                        (2, 3) => kind,
                        (0, 4) => Kind::Loop,
                        _ => Kind::Way,
                    },
                });
            }
            assert_eq!(mapper.looped()[..4], [looped; 4], "{kind:?}");
            let doubt = if looped { 0.0 } else { 1.0 };
            assert_eq!((mapper.parts(), mapper.doubt()), (Some(1), Some(doubt)));
            assert_eq!(mapper.unsure_joins(), usize::from(!looped));
            // A second place, 37 m from the first, confirms the join.
            mapper.keyframes[4].path_m = 40.0;
            mapper.graph.add_edge(Edge {
                from: 1,
                to: 3,
                way: Pose::default(),
                information: diagonal([1.0; 3]),
                kind: Kind::Loop,
            });
            assert_eq!(mapper.unsure_joins(), 0);
        }
    }
}
