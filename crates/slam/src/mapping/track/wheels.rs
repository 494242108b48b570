//! The way by the wheels alone, and what they miss always: learned where places seen again tell it.

use emulators::world::{Pose, wrap_angle};

use super::{Mapper, RARE};
use crate::mapping::align::Prior;
use crate::mapping::graph::{Edge, Kind};
use crate::mapping::motion::{between, distance, moved};

/// The way by the wheels alone.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ByWheels {
    pose: Pose,
    /// Sum of all turns, and of all ways: radians, metres.
    pub(super) turned: f64,
    pub(super) way_m: f64,
    /// Where the wheels had the robot when it last stood at a keyframe, and where it stood from
    /// there.
    stood: Pose,
    from: Pose,
}

impl ByWheels {
    pub(super) fn go(&mut self, by: Pose) {
        self.pose = moved(self.pose, by);
        self.turned += by.theta;
        self.way_m += libm::hypot(by.x, by.y);
    }

    /// The robot stands at `from` as seen from a keyframe.
    pub(super) const fn stand(&mut self, from: Pose) {
        self.stood = self.pose;
        self.from = from;
    }

    /// Where it is now, as seen from that keyframe.
    pub(super) fn since_stand(&self) -> Pose {
        moved(self.from, between(self.stood, self.pose))
    }
}

/// What the wheels miss always, radians per metre.
///
/// Along a way that leads nowhere again, a weak bend of the wheels and the error that each scan
/// passes on to the next are one and the same, and a mapper that corrects the wheels by it winds
/// itself up. The walls of one view show a strong bend, so that is corrected at once; a weak one
/// is learned only from places seen again.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bend {
    /// Turn that the wheels missed lately, its square and the way: radians, metres.
    lately: [f64; 3],
    /// Turn that they missed between places seen again, and the way.
    looped: [f64; 2],
}

/// Bend that could be the walls' own, radians per metre.
const HIDDEN: f64 = 0.003;
/// A bend is strong if it is this many standard deviations of what the steps' noise makes.
const SIGMAS: f64 = 3.0;
/// Way back that counts as lately, metres.
const LATELY_M: f64 = 100.0;
/// Way after which half of what was missed is believed, metres, and most of it, radians per metre.
const HALF_M: [f64; 2] = [5.0, 20.0];
const BEND_MOST: f64 = 0.05;
/// Steps that a slip turned by more tell nothing of what the wheels miss always: radians, and part
/// of the turn.
const SLIP_RAD: f64 = 0.05;
const SLIP_PART: f64 = 0.15;

/// Steps shorter than this count less, and longer than that no more: metres.
const STEP_M: [f64; 2] = [0.2, 1.0];

/// A missed turn and its way, each weighted by the way: a turn on the spot tells nothing of what is
/// missed per metre.
fn by_way(turn: f64, way_m: f64) -> [f64; 2] {
    let weight = way_m.min(STEP_M[1]);
    [weight * turn / way_m.max(STEP_M[0]), weight]
}

impl Bend {
    /// The walls have a scan turned by so much from where the wheels have it, so far on.
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

impl Mapper {
    /// How wrong the wheels were: soon believed if it is more than thought, slowly if less.
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

    /// Of each keyframe, how many motions that nothing is known of came before it.
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

    /// Of each step from a keyframe to the next, whether it leads between two sights of a place.
    pub(super) fn looped(&self) -> Vec<bool> {
        let mut opened = vec![0_i32; self.keyframes.len()];
        let stretches = self.stretches();
        let loops = self.graph.edges.iter();
        // A loop across a motion that nothing is known of joins two parts, and holds no way.
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

    /// Learns what the wheels miss from the steps between a place and where it was seen again.
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

    /// Wheels that miss 0.02 rad in each turn on the spot miss nothing per metre; wheels that miss
    /// the same in each half metre miss 0.04 rad per metre.
    #[test]
    fn turns_on_the_spot_are_no_bend() {
        for (way_m, least, most) in [(0.0, 0.0, 0.0), (0.5, 0.03, 0.041)] {
            let mut bend = Bend::default();
            (0..400).for_each(|_| bend.add(0.02, way_m));
            let told = bend.told();
            assert!((least..=most).contains(&told), "{way_m} m: {told}");
        }
    }

    /// A place is seen at the first and the last of five keyframes. That holds the way between them
    /// only if all motion between them is known.
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
        }
    }
}
