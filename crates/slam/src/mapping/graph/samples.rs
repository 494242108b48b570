//! Random errors of all edges, carried through the graph: the spread of the resulting poses is the
//! accuracy of the map. Loops limit it, because they are part of the same system of equations.

use emulators::rng::Rng;
use emulators::world::{Pose, wrap_angle};

use super::{Edge, Graph, Kind, Part, weight};
use crate::mapping::matrix::{Matrix, applied, scaled, transposed};
use crate::mapping::sparse::Plan;

/// Errors of edges.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Errors {
    /// Standard deviations relative to those of the edges: motions, motions where nothing of a scan
    /// lies on known walls (in addition), odometry alone, and loops.
    pub(crate) way: f64,
    pub(crate) unseen_way: f64,
    pub(crate) wheels: f64,
    pub(crate) loops: f64,
    /// Standard deviation of the systematic turn error that all motions share, radians per metre:
    /// everywhere, and in addition where nothing of a scan lies on known walls.
    pub(crate) bend: [f64; 2],
    /// Standard deviation of a turn error that changes along the path, radians per metre.
    pub(crate) drift: f64,
    /// Standard deviation of the systematic error of distances where nothing of a scan lies on
    /// known walls.
    pub(crate) length: f64,
    /// Standard deviation of the systematic turn error of the odometry, radians per metre. It
    /// counts for a motion by the share of the odometry.
    pub(crate) odometry: f64,
}

/// The sources that hold the pose of a keyframe: known walls, or odometry.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Held {
    /// Share of the scan that lay on no known wall, 0 to 1.
    pub(crate) unseen: f64,
    /// Share of the odometry in the rotation since the previous keyframe, 0 to 1.
    pub(crate) by_odometry: f64,
}

/// Path length over which the changing turn error persists, metres.
const DRIFT_M: f64 = 10.0;

/// An edge with all that its variants have in common.
struct Varied<'a> {
    edge: &'a Edge,
    information: Matrix,
    /// Root of the information.
    root: Matrix,
    /// Transposed derivatives of the error by the two poses.
    slopes: [Matrix; 2],
    unseen: f64,
    by_odometry: f64,
    way_m: f64,
    /// Parts of the changing turn error before and after the edge: the share that persists, and
    /// the new one.
    kept: [f64; 2],
}

impl Graph {
    /// `count` variants of all poses, each with other errors of the edges; `None` if the poses are
    /// not determined. `held` describes each pose.
    pub(crate) fn samples(
        &self,
        count: usize,
        errors: &Errors,
        held: &[Held],
    ) -> Option<Vec<Vec<Pose>>> {
        let all: Vec<usize> = (0..self.poses.len()).collect();
        let part = Part::of(self, &all);
        let free = part.edges.iter().filter_map(|edge| part.ends(edge));
        let plan = Plan::new(all.len(), free);
        let factored = self.system(&part, &plan, true).factored()?;
        let edges: Vec<Varied> = part
            .edges
            .iter()
            .map(|edge| {
                let (off, from, to) = self.slopes(edge);
                let information = scaled(&edge.information, weight(edge, off));
                let way_m = libm::hypot(edge.way.x, edge.way.y);
                let kept = libm::exp(-way_m / DRIFT_M);
                Varied {
                    edge,
                    root: root(&information),
                    information,
                    slopes: [transposed(&from), transposed(&to)],
                    // Two shares of unknown walls: few walls hold a scan, and they hold it badly.
                    unseen: held[edge.to].unseen * held[edge.to].unseen,
                    by_odometry: held[edge.to].by_odometry,
                    way_m,
                    kept: [kept, libm::sqrt(1.0 - kept * kept)],
                }
            })
            .collect();
        let mut rng = Rng::stream(1, "slam.accuracy");
        let samples = (0..count).map(|_| {
            let [bend, unseen_bend, length, odometry] = [0, 1, 2, 3].map(|_: u8| rng.gauss());
            let mut drift = rng.gauss();
            let mut right = factored.right();
            for varied in &edges {
                let (edge, unseen, way_m) = (varied.edge, varied.unseen, varied.way_m);
                if edge.kind == Kind::Way {
                    drift = varied.kept[0] * drift + varied.kept[1] * rng.gauss();
                }
                // Random errors; the shares of the errors that all motions share, of the changing
                // turn error, and of the odometry.
                let [scale, common, changing, by_odometry] = match edge.kind {
                    Kind::Way => {
                        let scale = errors.way + errors.unseen_way * unseen;
                        [scale, 1.0, 1.0, varied.by_odometry]
                    }
                    Kind::Wheels => [errors.wheels, 1.0, 0.0, 1.0],
                    Kind::Loop => [errors.loops, 0.0, 0.0, 0.0],
                    Kind::Unknown => [1.0, 0.0, 0.0, 0.0],
                };
                let bend = common * (errors.bend[0] * bend + unseen * errors.bend[1] * unseen_bend)
                    + changing * errors.drift * drift
                    + by_odometry * errors.odometry * odometry;
                let turn = way_m * bend;
                let part = common * unseen * errors.length * length;
                let shift = [part * edge.way.x, part * edge.way.y, turn];
                let random = applied(&varied.root, [0, 1, 2].map(|_: u8| scale * rng.gauss()));
                let common = applied(&varied.information, shift);
                let by = [0, 1, 2].map(|axis| random[axis] + common[axis]);
                let [from, to] = &varied.slopes;
                factored.add_right(&mut right, edge.from, applied(from, by));
                factored.add_right(&mut right, edge.to, applied(to, by));
            }
            let by = factored.solve(right);
            let poses = self.poses.iter().zip(by);
            poses
                .map(|(pose, by)| {
                    let theta = wrap_angle(pose.theta + by[2]);
                    Pose::new(pose.x + by[0], pose.y + by[1], theta)
                })
                .collect()
        });
        Some(samples.collect())
    }
}

/// The lower triangle whose product with its transpose is `of` (Cholesky); a direction without
/// information stays zero.
fn root(of: &Matrix) -> Matrix {
    let mut low = [[0.0; 3]; 3];
    for row in 0..3 {
        for column in 0..=row {
            let known: f64 = (0..column).map(|k| low[row][k] * low[column][k]).sum();
            let rest = of[row][column] - known;
            low[row][column] = if row == column {
                libm::sqrt(rest.max(0.0))
            } else if low[column][column] > 0.0 {
                rest / low[column][column]
            } else {
                0.0
            };
        }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::graph::Edge;
    use crate::mapping::matrix::{diagonal, product};

    /// By hand: the root of [[4,2,0],[2,5,0],[0,0,0]] is [[2,0,0],[1,2,0],[0,0,0]].
    #[test]
    fn the_root_is_that_of_the_textbook() {
        let of = [[4.0, 2.0, 0.0], [2.0, 5.0, 0.0], [0.0, 0.0, 0.0]];
        let low = root(&of);
        assert_eq!(low, [[2.0, 0.0, 0.0], [1.0, 2.0, 0.0], [0.0; 3]]);
        assert_eq!(product(&low, &transposed(&low)), of);
    }

    /// Four motions of 1 m along x, each known to 0.1 m: the last pose is known to
    /// sqrt(4) * 0.1 = 0.2 m. A loop of the same accuracy from the first pose to the last leaves
    /// 1 / sqrt(1 / 0.04 + 1 / 0.01) = 0.089 m.
    #[test]
    fn errors_grow_along_the_path_and_loops_limit_them() {
        for (has_loop, expected) in [(false, 0.2), (true, 0.0894)] {
            let mut graph = Graph::default();
            for number in 0..5 {
                graph.add_pose(Pose::new(f64::from(number), 0.0, 0.0));
            }
            let ways = (0..4).map(|from| (from, from + 1, Kind::Way));
            for (from, to, kind) in ways.chain(has_loop.then_some((0, 4, Kind::Loop))) {
                graph.add_edge(Edge {
                    from,
                    to,
                    way: Pose::new((to - from) as f64, 0.0, 0.0),
                    information: diagonal([100.0, 100.0, 1e8]),
                    kind,
                });
            }
            let errors = Errors {
                way: 1.0,
                loops: 1.0,
                ..Errors::default()
            };
            let samples = graph
                .samples(400, &errors, &[Held::default(); 5])
                .expect("determined");
            let squares = samples.iter().map(|poses| {
                let off = poses[4].x - 4.0;
                off * off
            });
            let deviation = libm::sqrt(squares.sum::<f64>() / 400.0);
            assert!((deviation / expected - 1.0).abs() < 0.12, "{deviation}");
        }
    }

    /// Four motions of 1 m along x, of which the odometry holds half of the rotation: its
    /// systematic error of 0.01 rad per metre leaves 4 * 0.5 * 0.01 = 0.02 rad at the end. Motions
    /// that share 0.01 rad per metre leave 0.04 rad, and so do scans off all known walls. A turn
    /// error that changes over 10 m leaves a little less: the sum of exp(-|i - j| / 10) over four
    /// motions is 14.2, so it is 0.01 * sqrt(14.2) = 0.0377 rad.
    #[test]
    fn systematic_errors_add_up_along_the_path() {
        let held = Held {
            unseen: 1.0,
            by_odometry: 0.5,
        };
        let none = Errors::default();
        for (errors, expected) in [
            (
                Errors {
                    odometry: 0.01,
                    ..none
                },
                0.02,
            ),
            (
                Errors {
                    bend: [0.01, 0.0],
                    ..none
                },
                0.04,
            ),
            (
                Errors {
                    bend: [0.0, 0.01],
                    ..none
                },
                0.04,
            ),
            (
                Errors {
                    drift: 0.01,
                    ..none
                },
                0.0377,
            ),
        ] {
            let mut graph = Graph::default();
            for number in 0..5 {
                graph.add_pose(Pose::new(f64::from(number), 0.0, 0.0));
            }
            for from in 0..4 {
                graph.add_edge(Edge {
                    from,
                    to: from + 1,
                    way: Pose::new(1.0, 0.0, 0.0),
                    information: diagonal([100.0, 100.0, 1e4]),
                    kind: Kind::Way,
                });
            }
            let samples = graph.samples(400, &errors, &[held; 5]).expect("determined");
            let squares = samples.iter().map(|poses| poses[4].theta * poses[4].theta);
            let deviation = libm::sqrt(squares.sum::<f64>() / 400.0);
            assert!(
                (deviation / expected - 1.0).abs() < 0.12,
                "{deviation} {errors:?}"
            );
        }
    }
}
