//! A pose graph and its optimisation: Gauss-Newton steps (Grisetti et al. 2010), loops with a
//! robust kernel (Agarwal et al. 2013).

mod samples;

use core::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use emulators::world::{Pose, wrap_angle};

use crate::mapping::matrix::{Matrix, applied, diagonal, product, scaled, transposed, weighed};
use crate::mapping::motion::{between, moved};
use crate::mapping::sparse::{Plan, System};
pub(crate) use samples::{Errors, Held};

/// The source of an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Motion from one keyframe to the next.
    Way,
    /// A loop closure.
    Loop,
    /// Motion from one keyframe to the next by odometry only.
    Wheels,
    /// Unknown motion from one part of the map to the next.
    Unknown,
}

/// A relative pose between two keyframes.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    /// Index of the first pose.
    pub from: usize,
    /// Index of the second pose.
    pub to: usize,
    /// The second pose relative to the first: metres and radians.
    pub way: Pose,
    /// Inverse of the variance, in the axes of `from`: per square metre, per square radian.
    pub information: Matrix,
    /// The source of the edge.
    pub kind: Kind,
}

/// A graph of poses and edges.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    /// The poses: metres and radians.
    pub poses: Vec<Pose>,
    /// The relative poses.
    pub edges: Vec<Edge>,
    /// Systematic turn error of the odometry, radians per metre.
    pub(crate) bend: f64,
    /// Edges of each pose.
    around: Vec<Vec<usize>>,
}

/// Squared deviations above which the weight of loops and of odometry edges decreases.
const LOOP_FREE: f64 = 12.0;
const WHEELS_FREE: f64 = 6.0;
/// Information that fixes the first pose.
const HELD: f64 = 1e12;
/// Maximum change of a pose in a step, metres or radians: a larger one, or none, is a system that
/// rounding has made singular.
const STEP_MOST: f64 = 1e4;

impl Graph {
    /// Adds a pose; returns its index.
    pub fn add_pose(&mut self, pose: Pose) -> usize {
        self.poses.push(pose);
        self.around.push(Vec::new());
        self.poses.len() - 1
    }

    /// Adds an edge.
    pub fn add_edge(&mut self, edge: Edge) {
        self.around[edge.from].push(self.edges.len());
        self.around[edge.to].push(self.edges.len());
        self.edges.push(edge);
    }

    /// The pairs of poses that loops connect.
    pub fn loops(&self) -> Vec<[Pose; 2]> {
        let loops = self.edges.iter().filter(|edge| edge.kind == Kind::Loop);
        loops
            .map(|edge| [edge.from, edge.to].map(|pose| self.poses[pose]))
            .collect()
    }

    /// Optimises all poses in at most `steps` steps.
    pub fn optimise(&mut self, steps: u32) {
        let all: Vec<usize> = (0..self.poses.len()).collect();
        self.optimise_part(&all, steps);
    }

    /// Optimises the `most` poses nearest to `pose` along edges; all others stay. Returns the
    /// optimised poses.
    pub fn optimise_near(&mut self, pose: usize, most: usize, steps: u32) -> Vec<usize> {
        let mut near: Vec<usize> = Walk::of(self, pose, f64::INFINITY).take(most).collect();
        near.sort_unstable();
        self.optimise_part(&near, steps);
        near
    }

    fn optimise_part(&mut self, poses: &[usize], steps: u32) {
        let part = Part::of(self, poses);
        let free = part.edges.iter().filter_map(|edge| part.ends(edge));
        let plan = Plan::new(poses.len(), free);
        for step in 0..steps {
            // A new loop contradicts the path by the error accumulated before; the kernel must not
            // reduce its weight for that.
            let kernel = step >= steps / 2;
            let Some(by) = self.system(&part, &plan, kernel).solve() else {
                break;
            };
            let is_sound = by.iter().flatten().all(|by| by.abs() < STEP_MOST);
            if !is_sound {
                break;
            }
            let mut most = 0.0_f64;
            for (pose, by) in poses.iter().zip(&by) {
                most = most.max(by[0].abs()).max(by[1].abs()).max(by[2].abs());
                let pose = &mut self.poses[*pose];
                *pose = Pose::new(
                    pose.x - by[0],
                    pose.y - by[1],
                    wrap_angle(pose.theta - by[2]),
                );
            }
            if most < 1e-4 && kernel {
                break;
            }
        }
    }

    fn system<'a>(&self, part: &Part, plan: &'a Plan, kernel: bool) -> System<'a> {
        let mut system = System::new(plan);
        if let Some(first) = part.place(0) {
            system.add(first, first, &diagonal([HELD; 3]));
        }
        for edge in &part.edges {
            let (off, from, to) = self.slopes(edge);
            let information = scaled(
                &edge.information,
                if kernel { weight(edge, off) } else { 1.0 },
            );
            let [for_from, for_to] =
                [&from, &to].map(|slope| product(&transposed(slope), &information));
            if let Some(at) = part.place(edge.from) {
                system.add(at, at, &product(&for_from, &from));
                system.add_right(at, applied(&for_from, off));
            }
            if let Some(at) = part.place(edge.to) {
                system.add(at, at, &product(&for_to, &to));
                system.add_right(at, applied(&for_to, off));
            }
            if let Some((from, at)) = part.ends(edge) {
                system.add(from, at, &product(&for_from, &to));
            }
        }
        system
    }

    /// The error of an edge, and its derivatives by the two poses.
    fn slopes(&self, edge: &Edge) -> ([f64; 3], Matrix, Matrix) {
        let (a, b) = (self.poses[edge.from], self.poses[edge.to]);
        let (sin, cos) = (libm::sin(a.theta), libm::cos(a.theta));
        let seen = between(a, b);
        let from = [[-cos, -sin, seen.y], [sin, -cos, -seen.x], [0.0, 0.0, -1.0]];
        let to = [[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]];
        (off(seen, self.told(edge)), from, to)
    }

    /// For each pose the lowest pose that motions and loops connect to it; equal within one part of
    /// the map.
    pub(crate) fn joined(&self) -> Vec<usize> {
        fn lowest(of: &mut [usize], mut pose: usize) -> usize {
            while of[pose] != pose {
                of[pose] = of[of[pose]];
                pose = of[pose];
            }
            pose
        }
        let mut of: Vec<usize> = (0..self.poses.len()).collect();
        for edge in &self.edges {
            if matches!(edge.kind, Kind::Way | Kind::Loop) {
                let (a, b) = (lowest(&mut of, edge.from), lowest(&mut of, edge.to));
                of[a.max(b)] = a.min(b);
            }
        }
        (0..of.len()).map(|pose| lowest(&mut of, pose)).collect()
    }

    /// The relative pose of an edge, without the systematic error of odometry.
    pub(crate) fn told(&self, edge: &Edge) -> Pose {
        match edge.kind {
            Kind::Wheels => bent(edge.way, self.bend),
            Kind::Way | Kind::Loop | Kind::Unknown => edge.way,
        }
    }

    /// The error of an edge in squared deviations.
    pub fn strain(&self, edge: &Edge) -> f64 {
        let seen = between(self.poses[edge.from], self.poses[edge.to]);
        weighed(&edge.information, off(seen, self.told(edge)))
    }

    /// Removes the loops with a larger error in squared deviations; returns their number.
    pub fn drop_loops(&mut self, strained: f64) -> usize {
        let all: Vec<usize> = (0..self.poses.len()).collect();
        self.drop_loops_of(&all, strained)
    }

    /// The same for the loops of these poses.
    pub fn drop_loops_of(&mut self, poses: &[usize], strained: f64) -> usize {
        let around = poses.iter().flat_map(|pose| &self.around[*pose]);
        let is_false = |edge: &&usize| {
            let edge = &self.edges[**edge];
            edge.kind == Kind::Loop && self.strain(edge) > strained
        };
        let dropped: BTreeSet<usize> = around.filter(is_false).copied().collect();
        if !dropped.is_empty() {
            self.around.iter_mut().for_each(Vec::clear);
            for (number, edge) in core::mem::take(&mut self.edges).into_iter().enumerate() {
                if !dropped.contains(&number) {
                    self.add_edge(edge);
                }
            }
        }
        dropped.len()
    }
}

/// An iterator over poses along edges, nearest first, up to the requested distance.
pub(crate) struct Walk<'a> {
    graph: &'a Graph,
    most_m: f64,
    ways: Vec<f64>,
    queue: BinaryHeap<Reverse<(u64, usize)>>,
    /// Distance of the last pose along edges.
    reached_m: f64,
}

impl<'a> Walk<'a> {
    /// Starts at a pose; poses farther than `most_m` are not reached.
    pub(crate) fn of(graph: &'a Graph, pose: usize, most_m: f64) -> Self {
        let mut ways = vec![f64::INFINITY; graph.poses.len()];
        ways[pose] = 0.0;
        Self {
            graph,
            most_m,
            ways,
            queue: BinaryHeap::from([Reverse((0, pose))]),
            reached_m: 0.0,
        }
    }

    /// Distance to a pose along edges, metres.
    pub(crate) fn way_to(&mut self, pose: usize) -> f64 {
        while self.reached_m < self.ways[pose] && self.next().is_some() {}
        self.ways[pose]
    }
}

impl Iterator for Walk<'_> {
    type Item = usize;

    /// The next pose.
    fn next(&mut self) -> Option<usize> {
        loop {
            let Reverse((bits, at)) = self.queue.pop()?;
            // The bit patterns of non-negative numbers have the same order as the numbers.
            let way = f64::from_bits(bits);
            if way > self.ways[at] {
                continue;
            }
            self.reached_m = way;
            for edge in &self.graph.around[at] {
                let edge = &self.graph.edges[*edge];
                let next = if edge.from == at { edge.to } else { edge.from };
                let whole = way + length(edge);
                if whole < self.ways[next] && whole < self.most_m {
                    self.ways[next] = whole;
                    self.queue.push(Reverse((whole.to_bits(), next)));
                }
            }
            return Some(at);
        }
    }
}

/// The optimised poses and their edges.
struct Part {
    /// The index of each pose of the graph among the optimised poses.
    places: Vec<Option<usize>>,
    edges: Vec<Edge>,
}

impl Part {
    fn of(graph: &Graph, poses: &[usize]) -> Self {
        let mut places = vec![None; graph.poses.len()];
        for (place, pose) in poses.iter().enumerate() {
            places[*pose] = Some(place);
        }
        let around = poses.iter().flat_map(|pose| &graph.around[*pose]);
        let mut edges: Vec<usize> = around.copied().collect();
        edges.sort_unstable();
        edges.dedup();
        let edges = edges.into_iter().map(|edge| graph.edges[edge]).collect();
        Self { places, edges }
    }

    fn place(&self, pose: usize) -> Option<usize> {
        self.places[pose]
    }

    /// The ends of an edge, if both are optimised.
    fn ends(&self, edge: &Edge) -> Option<(usize, usize)> {
        self.place(edge.from).zip(self.place(edge.to))
    }
}

/// The length of an edge over which errors accumulate, including rotations.
fn length(edge: &Edge) -> f64 {
    match edge.kind {
        Kind::Way => libm::hypot(edge.way.x, edge.way.y) + 0.3 * edge.way.theta.abs(),
        Kind::Loop => 1.0,
        Kind::Wheels | Kind::Unknown => f64::INFINITY,
    }
}

/// A motion with additional rotation, radians per metre.
pub(crate) fn bent(way: Pose, bend: f64) -> Pose {
    let turn = bend * libm::hypot(way.x, way.y);
    let half = moved(Pose::new(0.0, 0.0, turn / 2.0), way);
    Pose::new(half.x, half.y, wrap_angle(way.theta + turn))
}

fn off(seen: Pose, known: Pose) -> [f64; 3] {
    [
        seen.x - known.x,
        seen.y - known.y,
        wrap_angle(seen.theta - known.theta),
    ]
}

fn weight(edge: &Edge, off: [f64; 3]) -> f64 {
    let free = match edge.kind {
        Kind::Way | Kind::Unknown => return 1.0,
        Kind::Loop => LOOP_FREE,
        Kind::Wheels => WHEELS_FREE,
    };
    let scale = 2.0 * free / (free + weighed(&edge.information, off));
    scale.min(1.0) * scale.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;

    /// Motions join poses 0 and 1, and 2 and 3; an edge of each kind leads from 1 to 3.
    #[test]
    fn ways_and_loops_join_poses_and_no_other_edge_does() {
        for (kind, joined) in [
            (Kind::Way, [0, 0, 0, 0]),
            (Kind::Loop, [0, 0, 0, 0]),
            (Kind::Wheels, [0, 0, 2, 2]),
            (Kind::Unknown, [0, 0, 2, 2]),
        ] {
            let mut graph = Graph::default();
            for _ in 0..4 {
                graph.add_pose(Pose::default());
            }
            for (from, to, kind) in [(0, 1, Kind::Way), (3, 2, Kind::Way), (1, 3, kind)] {
                graph.add_edge(Edge {
                    from,
                    to,
                    way: Pose::default(),
                    information: diagonal([1.0; 3]),
                    kind,
                });
            }
            assert_eq!(graph.joined(), joined, "{kind:?}");
        }
    }

    use crate::mapping::motion::distance;

    fn edge(from: usize, to: usize, way: Pose, kind: Kind) -> Edge {
        Edge {
            from,
            to,
            way,
            information: diagonal([100.0, 100.0, 400.0]),
            kind,
        }
    }

    /// A square of 10 m, with each side measured 1 % short and each corner 1 degree wide; a loop
    /// closes it. Afterwards each edge has at most its share of the error.
    #[test]
    fn a_loop_spreads_the_error_over_the_way() {
        let mut graph = Graph::default();
        let side = Pose::new(9.9, 0.0, FRAC_PI_2 + 0.017);
        let mut pose = Pose::default();
        graph.add_pose(pose);
        for corner in 0..4 {
            pose = moved(pose, side);
            graph.add_pose(pose);
            graph.add_edge(edge(corner, corner + 1, side, Kind::Way));
        }
        let open = distance(graph.poses[4], graph.poses[0]);
        graph.add_edge(edge(0, 4, Pose::default(), Kind::Loop));
        graph.optimise(10);
        let closed = distance(graph.poses[4], graph.poses[0]);
        assert!(open > 0.15 && closed < 0.3 * open, "{open} {closed}");
        for corner in 0..4 {
            let side = between(graph.poses[corner], graph.poses[corner + 1]);
            assert!((libm::hypot(side.x, side.y) - 9.9).abs() < 0.1, "{side:?}");
        }
        assert!(distance(graph.poses[0], Pose::default()) < 1e-12);
    }

    /// The weight is the inverse of the variance. Two edges give 0 m and 1 m for the same motion,
    /// and the first has four times the information of the second: the result is 0.2 m.
    #[test]
    fn edges_count_by_their_information() {
        let mut graph = Graph::default();
        graph.add_pose(Pose::default());
        graph.add_pose(Pose::new(0.3, 0.0, 0.0));
        let mut sure = edge(0, 1, Pose::default(), Kind::Way);
        sure.information = diagonal([400.0, 400.0, 400.0]);
        graph.add_edge(sure);
        graph.add_edge(edge(0, 1, Pose::new(1.0, 0.0, 0.0), Kind::Way));
        graph.optimise(4);
        assert!(
            (graph.poses[1].x - 0.2).abs() < 1e-6,
            "{:?}",
            graph.poses[1]
        );
    }

    /// A loop that contradicts ten motions has little weight: they change by less than a tenth of
    /// the loop's error.
    #[test]
    fn a_loop_that_contradicts_everything_is_unheard() {
        let mut graph = Graph::default();
        graph.add_pose(Pose::default());
        for number in 0..10 {
            graph.add_pose(Pose::new(f64::from(number + 1), 0.0, 0.0));
        }
        for from in 0..10 {
            graph.add_edge(edge(from, from + 1, Pose::new(1.0, 0.0, 0.0), Kind::Way));
            if from < 9 {
                graph.add_edge(edge(from, from + 2, Pose::new(2.0, 0.0, 0.0), Kind::Way));
            }
        }
        graph.add_edge(edge(0, 10, Pose::new(0.0, 0.0, 0.0), Kind::Loop));
        graph.optimise(20);
        assert!(graph.poses[10].x > 9.0, "{:?}", graph.poses[10]);
    }

    /// Ten poses one metre apart, and an edge that says that the last two are 0.8 m apart. With
    /// three optimised poses the last one moves, and the poses before stay exactly where they are.
    /// With all poses the result is the same.
    #[test]
    fn what_is_near_moves_and_the_rest_stays() {
        let mut graph = Graph::default();
        graph.add_pose(Pose::default());
        for number in 0..9 {
            let x = f64::from(number);
            graph.add_pose(Pose::new(x + 1.0, 0.0, 0.0));
            let from = graph.poses.len() - 2;
            graph.add_edge(edge(from, from + 1, Pose::new(1.0, 0.0, 0.0), Kind::Way));
        }
        graph.add_edge(edge(8, 9, Pose::new(0.8, 0.0, 0.0), Kind::Loop));
        let mut whole = graph.clone();
        whole.optimise(10);
        let before = graph.poses.clone();
        graph.optimise_near(9, 3, 10);
        assert_eq!(graph.poses[..7], before[..7]);
        // Both edges have the same weight: 0.9 m.
        for graph in [&graph, &whole] {
            let last = between(graph.poses[8], graph.poses[9]);
            assert!((last.x - 0.9).abs() < 1e-6, "{last:?}");
        }
    }

    /// Of two loops the one with an error of 10 m is removed, and the one with 0.1 m (one squared
    /// deviation) is kept, as is every motion with any error. No path uses the removed loop.
    #[test]
    fn only_loops_are_dropped_and_only_strained_ones() {
        let mut graph = Graph::default();
        (0..3).for_each(|x| {
            graph.add_pose(Pose::new(f64::from(x) * 10.0, 0.0, 0.0));
        });
        graph.add_edge(edge(0, 1, Pose::new(10.0, 0.0, 0.0), Kind::Way));
        graph.add_edge(edge(1, 2, Pose::new(20.0, 0.0, 0.0), Kind::Way));
        graph.add_edge(edge(0, 2, Pose::new(10.0, 0.0, 0.0), Kind::Loop));
        graph.add_edge(edge(0, 1, Pose::new(10.1, 0.0, 0.0), Kind::Loop));
        assert_eq!(graph.drop_loops(64.0), 1);
        assert_eq!((graph.edges.len(), graph.drop_loops(64.0)), (3, 0));
        assert_eq!(ways(&graph, &[0, 1, 2], 50.0), [0.0, 1.0, 21.0]);
    }

    fn ways(graph: &Graph, poses: &[usize], most_m: f64) -> Vec<f64> {
        let mut walk = Walk::of(graph, 0, most_m);
        poses.iter().map(|pose| walk.way_to(*pose)).collect()
    }

    /// Lengths of paths in the graph: a motion of a metre counts as a metre, and a loop gives a
    /// shorter path. Beyond the limit no pose is returned.
    #[test]
    fn ways_lead_through_loops() {
        let mut graph = Graph::default();
        (0..4).for_each(|x| {
            graph.add_pose(Pose::new(f64::from(x) * 20.0, 0.0, 0.0));
        });
        for from in 0..3 {
            graph.add_edge(edge(from, from + 1, Pose::new(20.0, 0.0, 0.0), Kind::Way));
        }
        let all = [0, 1, 2, 3];
        assert_eq!(ways(&graph, &all, 50.0), [0.0, 20.0, 40.0, f64::INFINITY]);
        graph.add_edge(edge(0, 3, Pose::default(), Kind::Loop));
        assert_eq!(ways(&graph, &all, 50.0), [0.0, 20.0, 21.0, 1.0]);
        assert_eq!(ways(&graph, &[2, 3, 1], 50.0), [21.0, 1.0, 20.0]);
        assert_eq!(ways(&graph, &[2, 0, 1], 20.5), [f64::INFINITY, 0.0, 20.0]);
    }
}
