//! Tracking: each scan is aligned with the recent walls.

mod accuracy;
mod calibration;
mod closing;
mod localise;
mod lost;
mod summits;
mod wheels;

use emulators::world::{Pose, wrap_angle};

use crate::mapping::Shot;
use crate::mapping::align::{Fit, Prior, align};
use crate::mapping::cloud::{Cloud, Frame, Spot};
use crate::mapping::graph::{Edge, Graph, Kind, Walk};
use crate::mapping::keyframe::Keyframe;
use crate::mapping::matrix::{Matrix, diagonal, inverse, sum, turned};
use crate::mapping::motion::{between, distance, moved};
use crate::mapping::sheet::Sheet;
use crate::mapping::surfels::{Surfels, some_of};
pub use accuracy::Accuracy;
use calibration::Calibration;
use closing::Closing;
pub use localise::{Localiser, WallPoint};
use lost::Lost;
use summits::{best_fit, window};
use wheels::{Bend, ByWheels};

/// Fixed settings of the mapper.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Whether loop closures are searched.
    pub closes_loops: bool,
    /// Start pose of the path.
    pub start: Pose,
    /// Errors of the odometry, relative to the usual ones.
    pub noise: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            closes_loops: true,
            start: Pose::default(),
            noise: 1.0,
        }
    }
}

/// Result of a scan.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Pose of the scan, as currently estimated.
    pub pose: Pose,
    /// Share of the scan that lies on known walls, 0 to 1.
    pub quality: f64,
    /// Whether that share is too small to determine the pose; then the odometry is used.
    pub is_doubtful: bool,
    /// Variance of the pose relative to the recent walls: square metres and radians.
    pub covariance: Matrix,
}

/// The aligned pose of a scan, and the prediction of the odometry.
#[derive(Clone, Copy, Debug)]
struct Placed {
    fit: Fit,
    prior: Prior,
    has_slipped: bool,
    is_doubtful: bool,
}

/// The map, the pose, and all state of the mapper.
#[derive(Clone, Debug)]
pub struct Mapper {
    pub(crate) settings: Settings,
    pub(crate) keyframes: Vec<Keyframe>,
    pub(crate) graph: Graph,
    pub(crate) closing: Closing,
    pub(crate) lost: Lost,
    /// The keyframe of each scan, and the pose of the scan relative to it.
    scans: Vec<(usize, Pose)>,
    pub(crate) pose: Pose,
    /// The keyframe to which the pose is relative.
    at: usize,
    path_m: f64,
    /// Recent walls, their keyframes, and their centre.
    walls: Surfels,
    drawn: Vec<usize>,
    /// Variance of the odometry since the last keyframe: metres, radians.
    unsure: [f64; 2],
    /// Recent errors of the odometry, relative to the usual ones.
    wheels: [f64; 2],
    /// The path by odometry only, its length, and its state at the last keyframe.
    by_wheels: ByWheels,
    bend: Bend,
    calibration: Calibration,
    /// Usual share of a scan on known walls, and number of consecutive scans far below it.
    usual: f64,
    below: u32,
}

/// Size of the wall map to each side of its centre, metres.
const WALLS_M: f32 = 50.0;
/// Distance from the centre at which the walls are drawn again.
const OFF_MIDDLE_M: f64 = 8.0;

/// Length of the recent path whose walls are drawn, metres, and maximum number of its keyframes.
const LATELY_M: f64 = 30.0;
const DRAWN_MAX: usize = 100;

/// Distance and rotation between two keyframes, metres and radians.
const KEY_M: f64 = 0.3;
const KEY_RAD: f64 = 0.3;
/// A scan adds no keyframe if this share of it lies on walls that this number of keyframes saw this
/// length of path ago.
const KNOWN: f64 = 0.8;
const KNOWN_AFTER_M: f64 = 50.0;
const KNOWN_BY: usize = 3;
/// Number of spots of a scan that are compared with the walls.
const SPOTS: usize = 180;

/// Minimum error of slipping wheels, relative to the usual one.
const RARE: f64 = 0.7;
/// Deviations of wheels without slip, in mean errors: distance and rotation. Neighbouring scans
/// share errors of position, so the odometry has more weight than its own error suggests.
const USUAL: [f64; 2] = [0.7, 1.0];
/// Maximum squared deviation of wheels without slip.
const SLIPPED: f64 = 12.0;
/// Share of a scan on walls below which a wider search starts, and minimum gain of its result.
const POOR: f64 = 0.5;
const GAIN: f64 = 0.2;
/// A drop of the share by this much starts a wider search too. The usual share is an average with
/// this weight per scan.
const DROP: f64 = 0.25;
const USUAL_PART: f64 = 0.1;
/// Increase of the search radius with each lost scan, metres, and maximum number of increases.
const BELOW_M: f64 = 0.05;
const BELOW_MOST: u32 = 8;
/// Share of a scan on walls below which the scan is ignored.
const DOUBTFUL: f64 = 0.25;

impl Mapper {
    /// A mapper without scans.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            keyframes: Vec::new(),
            graph: Graph::default(),
            closing: Closing::default(),
            lost: Lost::default(),
            scans: Vec::new(),
            pose: settings.start,
            at: 0,
            path_m: 0.0,
            walls: Surfels::around([0.0; 2], WALLS_M),
            drawn: Vec::new(),
            unsure: [0.0; 2],
            wheels: [1.0; 2],
            by_wheels: ByWheels::default(),
            bend: Bend::default(),
            calibration: Calibration::default(),
            usual: 0.0,
            below: 0,
        }
    }

    /// Processes a scan: determines its pose and extends the map.
    pub fn take(&mut self, shot: &Shot<'_>) -> Outcome {
        let cloud = Cloud::new(shot.ends);
        if self.keyframes.is_empty() {
            // The path begins with the first scan, whatever the earlier odometry was.
            self.by_wheels.go(Pose::default(), true);
            self.keep(cloud, 1.0, None);
            return self.outcome(1.0, diagonal([1e-6; 3]));
        }
        self.by_wheels.go(shot.moved, shot.is_measured);
        let wide = self.predicted(shot);
        // Without odometry there is no odometry error.
        let by = shot.moved;
        let way_m = shot.is_measured.then(|| libm::hypot(by.x, by.y));
        let placed = self.place(&cloud, wide, way_m.unwrap_or(0.0));
        let fit = placed.fit;
        for (unsure, by) in self.unsure.iter_mut().zip(placed.prior.deviation) {
            *unsure += by * by;
        }
        if self.has_lost(&cloud, &placed) {
            return self.told(&placed);
        }
        let since = between(self.graph.poses[self.at], self.pose);
        let is_far = libm::hypot(since.x, since.y) > KEY_M || since.theta.abs() > KEY_RAD;
        if !is_far || cloud.spots().is_empty() {
            self.scans.push((self.at, since));
        } else if let Some(old) = self.known_from(&fit) {
            self.lean_on(old, &fit);
        } else {
            self.keep(
                cloud,
                fit.explained,
                Some(fit).filter(|_| !placed.is_doubtful),
            );
        }
        self.told(&placed)
    }

    /// Determines the pose of a scan and moves the robot there.
    fn place(&mut self, cloud: &Cloud, wide: Prior, way_m: f64) -> Placed {
        let mut prior = wide;
        let mut fit = self.locate(cloud.spots(), &prior);
        let firm = self.firm(&prior);
        if firm.off(fit.pose) < SLIPPED {
            let spots = some_of(cloud.spots(), SPOTS);
            fit = align(&self.walls, &spots, fit.pose, &firm);
            prior = firm;
        }
        let has_slipped = wide.off(fit.pose) > SLIPPED;
        let is_doubtful = fit.explained < if has_slipped { POOR } else { DOUBTFUL };
        let pose = if is_doubtful { prior.pose } else { fit.pose };
        if !is_doubtful && fit.explained > POOR {
            self.learn(&wide, pose, way_m);
        }
        self.below = if fit.explained < self.least() {
            self.below + 1
        } else {
            0
        };
        self.usual += USUAL_PART * (fit.explained - self.usual);
        self.path_m += distance(self.pose, pose);
        self.pose = pose;
        Placed {
            fit,
            prior,
            has_slipped,
            is_doubtful,
        }
    }

    fn told(&self, placed: &Placed) -> Outcome {
        let known = sum(&placed.fit.information, &placed.prior.information());
        let covariance = inverse(&known).unwrap_or(diagonal([1.0; 3]));
        let mut outcome = self.outcome(placed.fit.explained, covariance);
        outcome.is_doubtful = placed.is_doubtful;
        outcome
    }

    fn outcome(&self, quality: f64, covariance: Matrix) -> Outcome {
        Outcome {
            pose: self.pose,
            quality,
            is_doubtful: false,
            covariance,
        }
    }

    /// The same for wheels without slip: odometry is usually accurate and sometimes very wrong.
    fn firm(&self, prior: &Prior) -> Prior {
        let part =
            |axis: usize| (USUAL[axis] * self.wheels[axis] / self.wheels[axis].max(RARE)).min(1.0);
        let [metres, radians] = prior.deviation;
        Prior {
            deviation: [metres * part(0), radians * part(1)],
            ..*prior
        }
    }

    /// The best alignment of the spots with the walls.
    fn locate(&self, spots: &[Spot], prior: &Prior) -> Fit {
        let spots = some_of(spots, SPOTS);
        let step = crate::mapping::branch::step_for(&spots);
        let best = best_fit(&self.walls, &spots, &window(prior, step, 3.0), prior);
        if best.explained >= self.least() {
            return best;
        }
        // If the wheels slipped, the heading is off by up to 40 degrees and the distance is nearly
        // correct. A pose that is not found at once moves farther away with each scan.
        let below = f64::from(self.below.min(BELOW_MOST));
        let loose = Prior {
            deviation: [
                (1.5 * prior.deviation[0]).max(0.1 + BELOW_M * below),
                (2.5 * prior.deviation[1]).max(0.2),
            ],
            ..*prior
        };
        let wide = best_fit(&self.walls, &spots, &window(&loose, step, 3.0), &loose);
        if wide.explained > best.explained + GAIN {
            wide
        } else {
            best
        }
    }

    /// The minimum share of a scan on walls, below which a wider search starts.
    fn least(&self) -> f64 {
        POOR.max(self.usual - DROP)
    }

    /// The nearest of the keyframes that saw the same walls long ago, if there are enough of them:
    /// it limits the memory of a robot that stays in a building.
    fn known_from(&self, fit: &Fit) -> Option<usize> {
        if fit.explained < KNOWN || !self.settings.closes_loops {
            return None;
        }
        let far = |key: usize| {
            let pose = self.graph.poses[key];
            let [x, y] = [pose.x - self.pose.x, pose.y - self.pose.y];
            // Quick check: most keyframes are far away.
            if x.abs() > KEY_M || y.abs() > KEY_M {
                return None;
            }
            let far = libm::hypot(x, y);
            let turn = wrap_angle(self.pose.theta - pose.theta).abs();
            let is_old = self.path_m - self.keyframes[key].path_m > KNOWN_AFTER_M;
            (is_old && far < KEY_M && turn < KEY_RAD).then_some((far, key))
        };
        let mut near: Vec<(f64, usize)> = (0..self.keyframes.len()).filter_map(far).collect();
        if near.len() < KNOWN_BY {
            return None;
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // A keyframe that only seems to be nearby may be elsewhere.
        let mut walk = Walk::of(&self.graph, self.at, LATELY_M);
        let near = near.into_iter().map(|(_, key)| key);
        let mut here = near.filter(|key| walk.way_to(*key) < LATELY_M);
        let nearest = here.next()?;
        here.nth(KNOWN_BY - 2).map(|_| nearest)
    }

    /// Continues relative to the old keyframe `old`, at which the robot is.
    fn lean_on(&mut self, old: usize, fit: &Fit) {
        self.at = old;
        let from = between(self.graph.poses[old], self.pose);
        self.scans.push((old, from));
        self.by_wheels.stand(from);
        let variance = inverse(&blurred(&fit.information)).unwrap_or(diagonal([1.0; 3]));
        self.unsure = [variance[0][0].max(variance[1][1]), variance[2][2]];
        if self.is_stale() {
            self.redraw();
        }
    }

    /// Stores a scan at the current pose as a keyframe; `fit` is its alignment with the walls.
    fn keep(&mut self, cloud: Cloud, quality: f64, fit: Option<Fit>) {
        let number = self.graph.add_pose(self.pose);
        let unsure = self.unsure.map(|variance| 1.0 / variance.max(1e-8));
        let by_wheels = diagonal([unsure[0], unsure[0], unsure[1]]);
        if let Some(fit) = fit.filter(|_| number > 0) {
            self.calibrate(&fit, by_wheels);
        }
        let known = fit.and_then(|fit| inverse(&sum(&fit.information, &by_wheels)));
        self.keyframes.push(Keyframe {
            cloud,
            path_m: self.path_m,
            quality,
            scan: self.scans.len(),
            turned: self.by_wheels.turned,
            wheels_m: self.by_wheels.way_m,
            by_odometry: known.map_or(1.0, |variance| variance[2][2] * unsure[1]),
            part: self.lost.part,
        });
        self.scans.push((number, Pose::default()));
        if number > 0 {
            let last = self.at;
            let from = self.graph.poses[last];
            let edge = |way: Pose, information: &Matrix, kind: Kind| Edge {
                from: last,
                to: number,
                way,
                information: seen_from(from, &blurred(information)),
                kind,
            };
            let way = between(from, self.pose);
            let Some(fit) = fit else {
                self.graph.add_edge(edge(way, &by_wheels, Kind::Way));
                return self.kept(number);
            };
            // Half of the odometry's information about rotation is kept as a separate edge, so that
            // a systematic error can be removed later.
            let [metres, radians] = [unsure[0], unsure[1] / 2.0];
            let known = sum(&fit.information, &diagonal([metres, metres, radians]));
            self.graph.add_edge(edge(way, &known, Kind::Way));
            let way = self.by_wheels.since_stand();
            let turns = diagonal([0.0, 0.0, radians]);
            self.graph.add_edge(edge(way, &turns, Kind::Wheels));
        }
        self.kept(number);
    }

    /// Continues from a new keyframe.
    fn kept(&mut self, number: usize) {
        self.by_wheels.stand(Pose::default());
        self.at = number;
        self.unsure = [0.0; 2];
        let has_moved = self.settings.closes_loops && self.close(number);
        if has_moved || self.is_stale() {
            self.redraw();
        } else {
            self.draw(number);
        }
    }

    fn draw(&mut self, number: usize) {
        let pose = self.graph.poses[number];
        self.walls.draw(pose, &self.keyframes[number].cloud);
        self.drawn.push(number);
    }

    fn is_stale(&self) -> bool {
        let [x, y] = self.walls.middle().map(f64::from);
        self.drawn.is_empty()
            || self.drawn.len() > DRAWN_MAX
            || libm::hypot(self.pose.x - x, self.pose.y - y) > OFF_MIDDLE_M
    }

    /// Draws the walls around the current pose again, along all edges of the graph.
    fn redraw(&mut self) {
        let walk = Walk::of(&self.graph, self.at, LATELY_M);
        let near: Vec<usize> = walk.take(DRAWN_MAX / 2).collect();
        self.walls.clear(Frame::new(self.pose).at);
        let scans = near.iter().map(|key| {
            let cloud = &self.keyframes[*key].cloud;
            (self.graph.poses[*key], cloud)
        });
        self.walls.draw_all(scans);
        self.drawn = near;
    }

    /// The current estimate of each scan's pose.
    pub fn way(&self) -> Vec<Pose> {
        let poses = &self.graph.poses;
        let scans = self.scans.iter();
        scans.map(|(key, from)| moved(poses[*key], *from)).collect()
    }

    /// Number of ambiguous places.
    pub const fn ambiguous(&self) -> usize {
        self.closing.ambiguous
    }

    /// Number of loop closures that were removed because all other data contradicted them.
    pub const fn dropped_loops(&self) -> usize {
        self.closing.dropped
    }

    /// The graph of keyframes.
    pub const fn graph(&self) -> &Graph {
        &self.graph
    }

    /// The map with cells of this edge, metres, or larger cells if there would be too many.
    pub fn sheet(&self, cell_m: f64) -> Sheet {
        Sheet::of(&self.keyframes, &self.graph.poses, cell_m)
    }

    /// Completes the map after the last scan.
    pub fn finish(&mut self) {
        if !self.keyframes.is_empty() {
            self.find_rest();
            self.close_last();
            self.settle();
            self.check_joins();
        }
    }
}

/// Errors that all spots of a scan share: metres, radians.
const COMMON_M: f64 = 0.005;
const COMMON_RAD: f64 = 0.001;

/// Limits the information by the common errors.
pub(crate) fn blurred(information: &Matrix) -> Matrix {
    let common = diagonal([
        COMMON_M * COMMON_M,
        COMMON_M * COMMON_M,
        COMMON_RAD * COMMON_RAD,
    ]);
    let least = diagonal([1e-3, 1e-3, 1e-3]);
    inverse(&sum(information, &least))
        .and_then(|variance| inverse(&sum(&variance, &common)))
        .unwrap_or(least)
}

/// Information in the axes of the world, transformed to the axes of a pose.
pub(crate) fn seen_from(pose: Pose, information: &Matrix) -> Matrix {
    turned(information, -libm::sin(pose.theta), libm::cos(pose.theta))
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "metres of a small room")]
mod tests {
    use super::*;

    /// A scan at `from` in a hall from (0, 0) to (14, 9), metres, with the corner of a pillar.
    fn seen(from: Pose) -> Vec<[f32; 2]> {
        let beams = (-120..=120).map(|degree| f64::from(degree).to_radians());
        let ends = beams.map(|bearing| {
            let (sin, cos) = libm::sincos(from.theta + bearing);
            let to_x = (if cos > 0.0 { 14.0 } else { 0.0 } - from.x) / cos;
            let to_y = (if sin > 0.0 { 9.0 } else { 0.0 } - from.y) / sin;
            let mut range = to_x.min(to_y);
            let to_pillar = (6.0 - from.x) / cos;
            let y = from.y + to_pillar * sin;
            if to_pillar > 0.0 && (4.0..5.0).contains(&y) {
                range = range.min(to_pillar);
            }
            let (sin, cos) = libm::sincos(bearing);
            [(range * cos) as f32, (range * sin) as f32]
        });
        ends.collect()
    }

    fn drive(mapper: &mut Mapper, from: Pose, by: Pose, said: Pose) -> (Pose, Outcome) {
        let to = moved(from, by);
        let ends = seen(to);
        let outcome = mapper.take(&Shot {
            moved: said,
            is_measured: true,
            ends: &ends,
        });
        (to, outcome)
    }

    /// A robot 2 m inside the hall after 5 scans at different poses.
    fn at_home() -> (Mapper, Pose) {
        let mut at = Pose::new(2.0, 2.0, 0.3);
        let mut mapper = Mapper::new(Settings {
            start: at,
            ..Settings::default()
        });
        drive(&mut mapper, at, Pose::default(), Pose::default());
        for _ in 0..4 {
            let by = Pose::new(0.35, 0.0, 0.05);
            (at, _) = drive(&mut mapper, at, by, by);
        }
        (mapper, at)
    }

    /// The odometry reports straight motion while the robot turned by 41 degrees: the walls correct
    /// this.
    #[test]
    fn wheels_that_slip_by_41_degrees_are_found_out() {
        let (mut mapper, at) = at_home();
        let by = Pose::new(0.5, 0.0, 0.72);
        let (at, outcome) = drive(&mut mapper, at, by, Pose::new(0.5, 0.0, 0.0));
        assert!(distance(outcome.pose, at) < 0.03, "{outcome:?} {at:?}");
        let turn = wrap_angle(outcome.pose.theta - at.theta).abs();
        assert!(turn < 0.01 && outcome.quality > 0.8, "{outcome:?} {at:?}");
    }

    /// The error of the mapper if the odometry reports 10 cm forward while the robot moves back by
    /// `back_m`. `usual` is the usual share of a scan on walls, `below` the number of consecutive
    /// scans far below it.
    fn off(back_m: f64, usual: f64, below: u32) -> f64 {
        let (mut mapper, at) = at_home();
        (mapper.usual, mapper.below) = (usual, below);
        let by = Pose::new(-back_m, 0.0, 0.0);
        let (at, outcome) = drive(&mut mapper, at, by, Pose::new(0.1, 0.0, 0.0));
        distance(outcome.pose, at)
    }

    /// At the pose of the odometry 60 % of the scan lie on walls, which could mislead the robot.
    /// The usual share was 95 %, so a wider search starts.
    #[test]
    fn a_scan_that_fits_much_less_than_those_before_is_looked_for() {
        for back_m in [0.1, 0.2, 0.25] {
            assert!(off(back_m, 0.95, 0) < 0.02, "{back_m}");
            assert!(
                off(back_m, 0.7, 0) > 0.1,
                "{back_m}: 60 % are not much less than 70"
            );
        }
    }

    /// After four scans with wrong odometry the robot is 0.7 m away: each scan widens the search.
    #[test]
    fn what_is_not_found_is_looked_for_farther_off() {
        assert!(off(0.6, 0.95, 0) > 0.5);
        assert!(off(0.6, 0.95, 4) < 0.02);
    }

    /// Twelve scans on walls, then one that is not: the usual share falls by a tenth of the
    /// difference, and the next scan on walls resets the count.
    #[test]
    fn what_is_usual_follows_slowly() {
        let (mut mapper, at) = at_home();
        (mapper.usual, mapper.below) = (1.0, 3);
        let still = Pose::default();
        drive(&mut mapper, at, still, still);
        assert!(mapper.usual > 0.98 && mapper.below == 0);
        let none = Shot {
            moved: still,
            is_measured: true,
            ends: &[[0.3, 0.3]; 90],
        };
        let before = mapper.usual;
        let quality = mapper.take(&none).quality;
        assert!((mapper.usual - before - 0.1 * (quality - before)).abs() < 1e-9);
        assert_eq!(mapper.below, 1);
    }

    /// A scan of an unknown area: the odometry is used, and the scan is doubtful.
    #[test]
    fn a_scan_that_fits_nowhere_leaves_the_wheels_word() {
        let (mut mapper, at) = at_home();
        let ends: Vec<[f32; 2]> = (0..90)
            .map(|beam| {
                let bearing = f64::from(beam * 4).to_radians();
                let range = 0.5 + 0.07 * f64::from(beam % 7);
                let (sin, cos) = libm::sincos(bearing);
                [(range * cos) as f32, (range * sin) as f32]
            })
            .collect();
        let moved_by = Pose::new(0.2, 0.0, 0.0);
        let outcome = mapper.take(&Shot {
            moved: moved_by,
            is_measured: true,
            ends: &ends,
        });
        assert!(
            outcome.is_doubtful && outcome.quality < DOUBTFUL,
            "{outcome:?}"
        );
        assert!(distance(outcome.pose, moved(at, moved_by)) < 0.05);
    }

    /// The error of the mapper if the odometry misses a rotation of 0.5 rad and `of_three` of three
    /// beams see the hall, the others unknown objects.
    fn seen_in_part(of_three: usize) -> (f64, Outcome) {
        let (mut mapper, at) = at_home();
        let to = moved(at, Pose::new(0.1, 0.0, 0.5));
        let mut ends = seen(to);
        for (beam, end) in ends.iter_mut().enumerate() {
            if beam % 3 >= of_three {
                let part = 0.3 + 0.05 * (beam % 5) as f32;
                *end = end.map(|metres| metres * part);
            }
        }
        let outcome = mapper.take(&Shot {
            moved: Pose::new(0.1, 0.0, 0.0),
            is_measured: true,
            ends: &ends,
        });
        (wrap_angle(outcome.pose.theta - to.theta).abs(), outcome)
    }

    /// A poor scan far from the odometry would be aligned with a wrong rotation, and later loops
    /// would refer to it.
    #[test]
    fn who_contradicts_the_wheels_must_lie_on_walls() {
        let (off, outcome) = seen_in_part(2);
        assert!(off < 0.02 && !outcome.is_doubtful, "{outcome:?}");
        let (off, outcome) = seen_in_part(1);
        assert!(
            outcome.is_doubtful && (off - 0.5).abs() < 0.05,
            "{outcome:?}"
        );
    }

    /// Odometry that misses one degree per metre: after 20 m half of the error is known. Scans
    /// without odometry give no information.
    #[test]
    fn a_strong_bend_of_the_wheels_is_learned() {
        for (is_measured, least, most) in [(true, 0.00875, 0.0263), (false, 0.0, 0.0)] {
            let (mut mapper, mut at) = at_home();
            mapper.bend = Bend::default();
            for _ in 0..40 {
                // In circles of 1.6 m, so that the robot stays in the hall.
                at = moved(at, Pose::new(0.5, 0.0, 0.3));
                mapper.take(&Shot {
                    moved: Pose::new(0.5, 0.0, 0.3 - 0.5 * 0.0175),
                    is_measured,
                    ends: &seen(at),
                });
            }
            let bend = mapper.bend.told();
            assert!((least..=most).contains(&bend), "{is_measured}: {bend}");
            assert!(distance(mapper.pose, at) < 0.1);
        }
    }

    /// A mapper that takes its own error for an error of the odometry amplifies it. 700 m along a
    /// corridor without features, with a range of 4 m and straight odometry: a mapper that learns
    /// from its own matches alone ends metres off.
    #[test]
    fn straight_wheels_in_a_corridor_without_features_stay_straight() {
        let mut rng = emulators::rng::Rng::stream(1, "test.corridor");
        let mut mapper = Mapper::new(Settings::default());
        let by = Pose::new(0.5, 0.0, 0.0);
        for number in 0..1400 {
            let ends: Vec<[f32; 2]> = (-60..=60)
                .filter(|beam| *beam != 0)
                .map(|beam| f64::from(beam) * 0.0262)
                .map(|bearing| (bearing, 1.2 / libm::sin(bearing).abs()))
                .filter(|(_, range)| *range < 4.0)
                .map(|(bearing, range)| (bearing, range + 0.005 * rng.gauss()))
                .map(|(bearing, range)| {
                    let (sin, cos) = libm::sincos(bearing);
                    [(range * cos) as f32, (range * sin) as f32]
                })
                .collect();
            mapper.take(&Shot {
                moved: if number == 0 { Pose::default() } else { by },
                is_measured: true,
                ends: &ends,
            });
        }
        mapper.finish();
        let off = mapper.way().into_iter().map(|pose| pose.y.abs());
        let most = off.fold(0.0, f64::max);
        assert!(most < 3.0, "{most} m aside");
    }

    /// Ten rounds in one circle: the keyframes of the first rounds suffice for the rest.
    #[test]
    fn a_robot_that_stays_keeps_no_more_keyframes() {
        let (mut mapper, mut at) = at_home();
        let mut counts = Vec::new();
        for _ in 0..12 {
            for _ in 0..21 {
                let by = Pose::new(0.5, 0.0, core::f64::consts::TAU / 21.0);
                (at, _) = drive(&mut mapper, at, by, by);
            }
            counts.push(mapper.graph.poses.len());
        }
        assert!(counts[11] < counts[7] + 10, "{counts:?}");
        assert_eq!(mapper.way().len(), 5 + 12 * 21);
    }

    /// Common errors limit the information: 5 mm and one milliradian.
    #[test]
    fn nothing_is_known_better_than_errors_in_common_leave() {
        let known = blurred(&diagonal([1e12; 3]));
        assert!((known[0][0] - 4e4).abs() < 1.0 && (known[2][2] - 1e6).abs() < 10.0);
    }
}
