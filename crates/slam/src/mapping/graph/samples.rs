//! Random errors of all edges, carried through the graph: the spread of the resulting poses is the
//! accuracy of the map. Loops limit it, because they are part of the same system of equations.

use emulators::rng::Rng;
use emulators::world::{Pose, wrap_angle};

use super::{Edge, Graph, Kind, Part, weight};
use crate::mapping::matrix::{Matrix, applied, scaled, transposed};
use crate::mapping::sparse::Plan;

/// Errors of edges.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Errors {
    /// Standard deviations relative to those of the edges.
    pub(crate) scale: f64,
    /// Standard deviation of the systematic turn error that all motions share, radians per metre:
    /// where all of a scan lies on known walls, and where nothing of it does.
    pub(crate) bend: [f64; 2],
    /// Standard deviation of the systematic error of distances where nothing of a scan lies on
    /// known walls.
    pub(crate) length: f64,
}

/// An edge with all that its variants have in common.
struct Varied<'a> {
    edge: &'a Edge,
    information: Matrix,
    /// Root of the information.
    root: Matrix,
    /// Transposed derivatives of the error by the two poses.
    slopes: [Matrix; 2],
    unseen: f64,
    way_m: f64,
}

impl Graph {
    /// `count` variants of all poses, each with other errors of the edges; `None` if the poses are
    /// not determined. `unseen` is the share of each pose's scan that lay on no known wall.
    pub(crate) fn samples(
        &self,
        count: usize,
        errors: &Errors,
        unseen: &[f64],
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
                Varied {
                    edge,
                    root: root(&information),
                    information,
                    slopes: [transposed(&from), transposed(&to)],
                    // Two shares of unknown walls: few walls hold a scan, and they hold it badly.
                    unseen: unseen[edge.to] * unseen[edge.to],
                    way_m: libm::hypot(edge.way.x, edge.way.y),
                }
            })
            .collect();
        let mut rng = Rng::stream(1, "slam.accuracy");
        let samples = (0..count).map(|_| {
            let [seen, bend, length] = [0, 1, 2].map(|_: u8| rng.gauss());
            let mut right = factored.right();
            for varied in &edges {
                let (edge, unseen, way_m) = (varied.edge, varied.unseen, varied.way_m);
                let turn = way_m * (errors.bend[0] * seen + unseen * errors.bend[1] * bend);
                let part = unseen * errors.length * length;
                let drawn = [0, 1, 2].map(|_: u8| errors.scale * rng.gauss());
                let random = applied(&varied.root, drawn);
                let shift = [part * edge.way.x, part * edge.way.y, turn];
                let common = match edge.kind {
                    Kind::Way | Kind::Wheels => applied(&varied.information, shift),
                    Kind::Loop | Kind::Unknown => [0.0; 3],
                };
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
                scale: 1.0,
                bend: [0.0; 2],
                length: 0.0,
            };
            let samples = graph.samples(400, &errors, &[0.0; 5]).expect("determined");
            let squares = samples.iter().map(|poses| {
                let off = poses[4].x - 4.0;
                off * off
            });
            let deviation = libm::sqrt(squares.sum::<f64>() / 400.0);
            assert!((deviation / expected - 1.0).abs() < 0.12, "{deviation}");
        }
    }
}
