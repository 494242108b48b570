//! Simultaneous localisation and mapping in two modes behind one interface: the seed report's
//! tinySLAM ([`Mode::Document`]), with its faults as switches, and ours ([`Mode::Core`]).
//!
//! ```text
//! odometry -> predict -> search (map, scan) -> pose -> update (map, scan)
//! ```

mod budget;
mod correlate;
mod effort;
mod evidence;
mod lost;
mod matching;
mod prior;
mod refine;
mod relocate;
mod row;
mod search;
mod settings;
mod sight;
mod trace;
mod tracking;
mod update;
mod walk;
mod window;

use core::time::Duration;

pub use budget::Budget;
pub use settings::{
    DEFAULT_CELL_MM, Defects, Fading, Keyframes, Mode, MotionNoise, Pushes, Rounding, Search,
    Settings,
};

use crate::grid::{Grid, SIDE};
use crate::pose::{Point, Pose, PoseChange};
use crate::random::Pcg32;
use crate::scan::{BEAMS, Scan};
use budget::Regulator;
use effort::Effort;
use lost::Lost;
use matching::{EndPoints, Placement, tally};
use prior::{Prior, Travel};
use relocate::{Answer, relocate};
use row::POINTS_MAX;
use search::Improvements;
pub use search::{IMPROVEMENTS_MAX, Improvement};
use tracking::{DOUBTFUL, SUSPICIOUS};

/// Certainty of a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Certainty {
    /// The scan agrees with the map. The seed report's mode has only this value.
    #[default]
    Sure,
    /// The scan fits much better elsewhere than at the odometry's pose: the robot was pushed, or
    /// its wheels slipped. The pose is the better fit. A push smears scans, so no scan is drawn
    /// until one fits well at the new pose.
    Moved,
    /// The scan contradicts the map. The pose is the odometry's, and the scan is not drawn.
    Doubtful,
    /// The robot is lost, and several poses fit the scan about equally well; no scan is drawn.
    Ambiguous,
}

/// Result of a scan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// The best-fitting pose, at the scan's end.
    pub pose: Pose,
    /// 1024 times the mean map value at the end points; -1 if the scan had none.
    pub score: i32,
    /// Candidates scored by the document's method, for a model of the processor's time.
    pub tries: u32,
    /// End points looked up by the document's method; the core's effort is given as the equivalent
    /// number of these.
    pub points: u32,
    /// Poses compared by any method.
    pub poses: u32,
    /// Document mode: candidates with a point on the map; others are wasted.
    pub on_map: u32,
    /// Quality from 0 to 1. In core mode the share of the points that agree with the known map;
    /// else the score divided by its maximum.
    pub quality: f32,
    /// Certainty of the pose.
    pub certainty: Certainty,
}

/// Whether inner loops use the variants for x86-64; otherwise they use those for a Cortex-M4, with
/// equal results.
const WIDE: bool = cfg!(all(target_arch = "x86_64", not(feature = "portable")));

/// Points of the core's refinement.
const DENSE_POINTS: usize = 180;
/// Minimum agreement of a scan that ends the handling of a push.
const SETTLED: f32 = 0.85;
/// Maximum number of badly fitting scans after a push; after more the world has changed as well.
const UNSETTLED_MAX: u8 = 5;
/// A robot counts as resting if its wheels have moved less than this since the last drawn scan.
const AT_REST_CELLS: f32 = 0.1;
const AT_REST_RAD: f32 = 0.005;
/// Error of a pose found from scans that a push smeared.
const UNSETTLED_CELLS: f32 = 3.0;
const UNSETTLED_RAD: f32 = 0.02;
/// Maximum distance of the pose from its prediction once the push is over.
const SETTLED_CELLS: f32 = 2.0;
/// Minimum agreement at a lost robot's new pose.
const FOUND_AGAIN: f32 = 0.75;

/// Map, pose, and the state that keeps both current; the only large object of a robot.
#[derive(Clone, Debug)]
pub struct Mapper<const W: usize = SIDE, const H: usize = SIDE> {
    grid: Grid<W, H>,
    pose: Pose,
    settings: Settings,
    regulator: Regulator,
    random: Pcg32,
    /// Improvements of the document's last search.
    improvements: Improvements,
    sparse: EndPoints,
    dense: EndPoints,
    travel: Travel,
    /// Motion that the fielded code applies with the next drawn scan (SL-14).
    saved_up: PoseChange,
    lost: Lost,
    /// Scans since the robot was found elsewhere, until one fits there.
    unsettled: Option<u8>,
    scans: u32,
    /// Pose of the last drawn scan, and since then: scans, distance and turns by the wheels.
    drawn_at: Pose,
    since_drawn: u8,
    driven_mm: f32,
    driven_rad: f32,
}

impl<const W: usize, const H: usize> Mapper<W, H> {
    /// An empty mapper at its start pose.
    pub const fn new(settings: Settings) -> Self {
        Self {
            grid: Grid::new(settings.resolution_mm),
            pose: settings.start,
            regulator: Regulator::new(&settings.budget, !settings.defects.unbounded_budget),
            random: Pcg32::new(settings.seed),
            improvements: Improvements::NONE,
            sparse: EndPoints::EMPTY,
            dense: EndPoints::EMPTY,
            travel: Travel::NONE,
            saved_up: PoseChange::NONE,
            lost: Lost::NONE,
            unsettled: None,
            scans: 0,
            drawn_at: settings.start,
            since_drawn: 0,
            driven_mm: 0.0,
            driven_rad: 0.0,
            settings,
        }
    }

    /// The map.
    pub const fn grid(&self) -> &Grid<W, H> {
        &self.grid
    }

    /// The believed pose.
    pub const fn pose(&self) -> Pose {
        self.pose
    }

    /// Sets the believed pose.
    pub const fn set_pose(&mut self, pose: Pose) {
        self.pose = pose;
    }

    /// The settings given at construction.
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Scans drawn so far.
    pub const fn scans(&self) -> u32 {
        self.scans
    }

    /// Clears map and pose and starts again.
    pub fn restart(&mut self) {
        self.grid.clear();
        self.pose = self.settings.start;
        self.travel = Travel::NONE;
        self.saved_up = PoseChange::NONE;
        self.lost = Lost::NONE;
        self.unsettled = None;
        self.scans = 0;
    }

    /// Moves the believed pose by the odometry's motion.
    pub fn predict(&mut self, change: PoseChange) {
        if self.settings.defects.saves_up_motion {
            self.saved_up = self.saved_up.then(change);
        } else {
            self.pose = self.pose.then(change);
        }
        self.travel.add(change);
        self.driven_mm += change.distance_mm();
        self.driven_rad += change.turn.abs();
    }

    /// Records that the robot may have moved by about this amount without the odometry noticing,
    /// for instance because the base did not answer. The next search then trusts its prediction
    /// less.
    pub fn doubt(&mut self, unseen_mm: f32, unseen_rad: f32) {
        self.travel.doubt(unseen_mm, unseen_rad);
    }

    /// Notes that the robot may have moved by `by`, millimetres and radians, unseen by wheels and
    /// lidar, but by at most `most` since its pose was certain. The mapper searches only there
    /// until a scan fits.
    pub const fn lose_track(&mut self, by: [f32; 2], most: [f32; 2]) {
        self.lost.lose(by, most);
    }

    /// Finds the pose at which `scan` fits the map, and draws the scan from there, unless the scan
    /// contradicts the map or adds nothing new. `wheel_speeds` (left, right; ticks per 40 ms) give
    /// the robot's turn rate: scans of a turning robot are drawn with less weight.
    pub fn integrate(&mut self, scan: &Scan, wheel_speeds: [i16; 2]) -> Outcome {
        self.pose = self.pose.then(core::mem::take(&mut self.saved_up));
        let outcome = self.locate(scan);
        self.since_drawn = self.since_drawn.saturating_add(1);
        if outcome.certainty == Certainty::Sure && self.is_worth_drawing(outcome.pose) {
            self.draw(scan, wheel_speeds);
        }
        outcome
    }

    /// Whether drawing a scan taken at `pose` improves the map.
    fn is_worth_drawing(&self, pose: Pose) -> bool {
        let rule = &self.settings.keyframes;
        // The matched pose sticks to a map drawn at rest, more with each scan. So the start of a
        // motion shows in time only by the wheels, and a push only by the pose.
        let way = self.drawn_at.change_to(pose);
        let cells = way.distance_mm().max(self.driven_mm) / self.settings.resolution_mm;
        let turn = way.turn.abs().max(self.driven_rad);
        let rests = self.driven_mm < AT_REST_CELLS * self.settings.resolution_mm
            && self.driven_rad < AT_REST_RAD;
        let patience = match rests {
            true if self.scans < rule.first => 1,
            true => rule.at_rest,
            false => rule.at_most,
        };
        self.settings.mode == Mode::Document
            || self.scans == 0
            || self.since_drawn >= patience
            || cells >= rule.cells
            || turn >= rule.turn
    }

    /// Finds the pose at which `scan` fits the map, without drawing it.
    pub fn locate(&mut self, scan: &Scan) -> Outcome {
        let points = scan.points();
        if points.is_empty() {
            return Outcome {
                pose: self.pose,
                score: -1,
                ..Outcome::default()
            };
        }
        let most = if self.settings.mode == Mode::Core {
            POINTS_MAX
        } else {
            BEAMS
        };
        let wanted = usize::from(self.settings.search.points).clamp(1, most);
        self.sparse
            .set(spread(points, wanted), self.settings.resolution_mm);
        if self.settings.mode == Mode::Core {
            self.dense
                .set(spread(points, DENSE_POINTS), self.settings.resolution_mm);
        }
        let outcome = if self.scans == 0 {
            self.stay()
        } else {
            match self.settings.mode {
                Mode::Document => self.try_candidates(),
                Mode::Core => self.track(),
            }
        };
        self.pose = outcome.pose;
        self.travel = Travel::NONE;
        outcome
    }

    /// Takes the duration of the last scan, from reading the wheels to the end of the map update;
    /// the document's number of tries depends on it.
    pub fn search_time(&mut self, elapsed: Duration) {
        self.regulator.search_took(elapsed, &self.settings.budget);
    }

    /// The tries of the document's last search that were better than all earlier ones.
    pub fn improvements(&self) -> &[Improvement] {
        self.improvements.all()
    }

    /// Maximum number of tries of the document's next search.
    pub const fn tries(&self) -> u32 {
        self.regulator.tries()
    }

    /// The outcome of the first scan, which defines the map's frame.
    fn stay(&self) -> Outcome {
        let points = self.sparse.all();
        let placement = Placement::new(self.pose, self.settings.resolution_mm);
        let tally = tally(self.grid.rows(), points, &placement);
        let points = count_u32(points.len());
        let score = score(tally.sum, points);
        Outcome {
            pose: self.pose,
            score,
            tries: 1,
            points,
            poses: 1,
            ..Outcome::default()
        }
    }

    fn try_candidates(&mut self) -> Outcome {
        let found = search::run(
            &self.grid,
            &self.settings,
            self.sparse.all(),
            self.pose,
            self.regulator.tries(),
            (&mut self.random, &mut self.improvements),
        );
        let defects = self.settings.defects;
        let count = count_u32(self.sparse.all().len());
        let of = if defects.outside_is_free {
            found.tally.inside
        } else {
            count
        };
        let score = score(found.tally.sum, of);
        let quality = (score.max(0) as f32 / (255.0 * 1024.0)).min(1.0);
        let score = if defects.score_wraps {
            wrapped(score)
        } else {
            score
        };
        Outcome {
            pose: found.pose,
            score,
            tries: found.tries,
            points: found.tries.saturating_mul(count),
            poses: found.tries,
            on_map: found.on_map,
            quality,
            certainty: Certainty::Sure,
        }
    }

    fn track(&mut self) -> Outcome {
        let is_vague = self.travel.is_vague();
        if self.unsettled.is_some() {
            let unseen_mm = UNSETTLED_CELLS * self.settings.resolution_mm;
            self.travel.doubt(unseen_mm, UNSETTLED_RAD);
        }
        let Settings {
            motion,
            resolution_mm,
            pushes,
            ..
        } = &self.settings;
        let task = tracking::Task {
            sparse: self.sparse.all(),
            dense: self.dense.all(),
            prior: Prior::new(self.pose, self.travel, motion, *resolution_mm),
            pushes: *pushes,
            suspicious: match self.unsettled {
                Some(_) => SETTLED,
                None if self.lost.unseen_rad() > 0.0 => SETTLED,
                None => SUSPICIOUS,
            },
            unseen_rad: self.lost.unseen_rad(),
        };
        let mut effort = Effort::default();
        let mut place = tracking::track(&self.grid, &task, &mut effort);
        // After an unmeasured motion, a scan is trusted only if it mostly shows known walls. Other
        // scans fit best wherever most of their few known points lie on walls.
        if is_vague && !place.is_elsewhere && !place.evidence.is_plain() {
            place.pose = self.pose;
        }
        let mut certainty = Certainty::Sure;
        let agreement = place.evidence.agreement();
        if agreement >= DOUBTFUL {
            let rest_mm = SETTLED_CELLS * self.settings.resolution_mm;
            let is_at_rest = self.pose.change_to(place.pose).distance_mm() <= rest_mm;
            self.unsettled = unsettled_by(&place, is_at_rest, self.unsettled);
            if agreement >= task.suspicious && place.evidence.is_enough() {
                self.lost.found();
            }
            if self.lost.half_found() || self.unsettled.is_some() {
                certainty = Certainty::Moved;
            }
        } else {
            place.pose = self.pose;
            let answer = self.lost.doubted().then(|| {
                let bound = self.lost.bound(self.pose, *pushes);
                relocate(&self.grid, task.sparse, bound, &mut effort)
            });
            if let Some(answer) = answer {
                let is_ambiguous = matches!(answer, Some(Answer::Ambiguous(_)));
                self.lost.set_ambiguous(is_ambiguous);
            }
            certainty = match self.lost.is_ambiguous() {
                true => Certainty::Ambiguous,
                false => Certainty::Doubtful,
            };
            if let Some(Some(Answer::Here(best))) = answer {
                let found = tracking::settle(&self.grid, &task, &best, &mut effort);
                if found.evidence.is_broad() && found.evidence.agreement() >= FOUND_AGAIN {
                    place = found;
                    certainty = Certainty::Moved;
                    self.lost.found();
                    self.unsettled = Some(0);
                }
            }
        }
        Outcome {
            pose: place.pose,
            score: score(place.sum, count_u32(self.sparse.all().len())),
            tries: 1,
            points: effort.document_points(),
            poses: effort.poses,
            on_map: 0,
            quality: place.evidence.agreement(),
            certainty,
        }
    }

    /// Draws `scan` from the believed pose.
    pub fn draw(&mut self, scan: &Scan, wheel_speeds: [i16; 2]) {
        let weight = self.settings.turning_weight(wheel_speeds);
        let hole_cells = self.settings.hole_mm / self.settings.resolution_mm;
        match self.settings.mode {
            Mode::Document => {
                let ink = update::Ink::new(weight, &self.settings.defects);
                update::draw_scan(&mut self.grid, self.pose, scan, hole_cells, ink);
            }
            Mode::Core => {
                let strokes = trace::Strokes::new(weight, &self.settings);
                trace::trace_scan(&mut self.grid, self.pose, scan, hole_cells, &strokes);
            }
        }
        self.scans = self.scans.saturating_add(1);
        self.drawn_at = self.pose;
        self.since_drawn = 0;
        self.driven_mm = 0.0;
        self.driven_rad = 0.0;
    }
}

/// Updates the count of scans since the robot was found elsewhere, after one more scan with the
/// result `place`. Returns `None` if the robot is at its believed pose. A robot that keeps moving
/// without its wheels is still being pushed.
fn unsettled_by(place: &tracking::Place, is_at_rest: bool, before: Option<u8>) -> Option<u8> {
    if place.is_elsewhere || (before.is_some() && !is_at_rest) {
        return Some(0);
    }
    let fits = place.evidence.agreement() >= SETTLED;
    before
        .map(|since| since + 1)
        .filter(|since| !fits && *since < UNSETTLED_MAX)
}

/// `wanted` of `points`, evenly distributed.
fn spread(points: &[Point], wanted: usize) -> impl Iterator<Item = Point> + '_ {
    let taken = wanted.min(points.len());
    (0..taken).map(move |index| points[index * points.len() / taken])
}

/// 1024 times the mean of `of` map values; -1 if there are none.
fn score(sum: u32, of: u32) -> i32 {
    (u64::from(sum) * 1024)
        .checked_div(u64::from(of))
        .map_or(-1, |mean| i32::try_from(mean).expect("at most 255 * 1024"))
}

fn count_u32(count: usize) -> u32 {
    u32::try_from(count).expect("numbers of points and blocks are small")
}

/// The value in a signed 16-bit register.
const fn wrapped(value: i32) -> i32 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the truncation is what is shown"
    )]
    let register = value as i16;
    register as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocols::Instant;

    fn scan_of(points: &[Point]) -> Scan {
        Scan::from_points(points, Instant::ZERO, Instant::ZERO)
    }

    /// A square room of 2 m around the robot.
    fn room() -> [Point; 360] {
        core::array::from_fn(|degree| {
            let degree = u16::try_from(degree).expect("small");
            let (sin, cos) = crate::pose::sin_cos(f32::from(degree).to_radians());
            let distance = 1000.0 / sin.abs().max(cos.abs());
            Point::new(distance * cos, distance * sin)
        })
    }

    fn mapper(settings: Settings) -> Mapper {
        Mapper::new(Settings {
            start: Pose::new(1500.0, 1500.0, 0.0),
            ..settings
        })
    }

    /// Budget S10: 128 KiB for the whole robot, some 14 KiB of it for everything else.
    const _: () = assert!(size_of::<Mapper<300, 300>>() <= 105 * 1024);

    /// Field firmware, checked on its code: at psi 90 a beam 1000 mm ahead from (3000, 3000) with
    /// cells of 20 mm clears column 150, row 180: columns are x, and psi 90 looks to +y.
    #[test]
    fn the_map_is_not_mirrored() {
        let start = Pose::from_wire(crate::pose::WirePose {
            x_mm: 3000,
            y_mm: 3000,
            psi_deg: 90,
        });
        let settings = Settings {
            resolution_mm: 20.0,
            start,
            ..Settings::document()
        };
        let mut mapper: Mapper = Mapper::new(settings);
        mapper.integrate(&scan_of(&[Point::new(1000.0, 0.0)]), [0, 0]);
        let grid = mapper.grid();
        assert!(grid.get(150, 180) < Some(127) && grid.get(150, 200) > Some(127));
        assert_eq!(grid.get(180, 150), Some(127));
    }

    /// Seed figure S5 and SL-05: weight 10 less the difference of the wheels, at least 3; the
    /// fielded code went down to 1, which draws nothing.
    #[test]
    fn turning_weakens_the_update_down_to_three() {
        let sound = Settings::document();
        let weights = |settings: &Settings| {
            [[20, 20], [20, 17], [20, 13], [-20, 20]].map(|wheels| settings.turning_weight(wheels))
        };
        assert_eq!(weights(&sound), [10, 7, 3, 3]);
        let with = |defects| weights(&Settings { defects, ..sound });
        let none = Defects::default();
        assert_eq!(
            with(Defects {
                weight_down_to_one: true,
                ..none
            }),
            [10, 7, 3, 1]
        );
        assert_eq!(
            with(Defects {
                constant_weight: true,
                ..none
            }),
            [10; 4]
        );
    }

    /// F-02: a robot that spins in an unknown room must still draw the room.
    #[test]
    fn a_spinning_robot_draws_new_cells_unless_it_has_the_fielded_faults() {
        let walls = |defects| {
            let mut mapper = mapper(Settings {
                defects,
                ..Settings::document()
            });
            for _ in 0..100 {
                mapper.integrate(&scan_of(&room()), [-20, 20]);
            }
            mapper
                .grid()
                .rows()
                .as_flattened()
                .iter()
                .filter(|cell| **cell > 150)
                .count()
        };
        assert!(walls(Defects::default()) > 300);
        assert_eq!(walls(Defects::FIELDED), 0);
    }

    /// SL-14: half a metre with the map switched off. The fielded code applies this motion in one
    /// step when the map is switched on, regardless of the pose that the search has found
    /// meanwhile.
    #[test]
    fn motion_without_mapping_is_not_saved_up() {
        let way = |saves_up_motion| {
            let mut mapper = mapper(Settings {
                defects: Defects {
                    saves_up_motion,
                    ..Defects::NONE
                },
                ..Settings::document()
            });
            let step = PoseChange {
                forward_mm: 50.0,
                ..PoseChange::NONE
            };
            for _ in 0..10 {
                mapper.predict(step);
                mapper.locate(&scan_of(&[]));
            }
            let before = mapper.pose().x_mm;
            mapper.integrate(&scan_of(&[]), [0, 0]);
            [before, mapper.pose().x_mm].map(|x| x - 1500.0)
        };
        assert_eq!(way(false), [500.0, 500.0]);
        assert_eq!(way(true), [0.0, 500.0]);
    }

    /// SL-11: 230000, which the document calls a full match, reads as -32144 in 16 bits.
    #[test]
    fn the_score_does_not_wrap() {
        assert_eq!(wrapped(230_000), -32_144);
        assert_eq!(score(36 * 255, 36), 261_120);
        assert_eq!(score(0, 0), -1);
    }

    #[test]
    fn a_scan_without_points_changes_nothing() {
        for settings in [Settings::document(), Settings::default()] {
            let mut mapper = mapper(settings);
            mapper.integrate(&scan_of(&room()), [0, 0]);
            let before = (mapper.pose(), *mapper.grid().rows());
            let outcome = mapper.integrate(&Scan::EMPTY, [0, 0]);
            assert_eq!((outcome.score, outcome.pose), (-1, before.0));
            assert!(*mapper.grid().rows() == before.1);
        }
    }

    /// Not-a-number, infinities, points at the robot and far off the map: skipped, never a panic,
    /// and the pose stays a number.
    #[test]
    fn absurd_points_do_no_harm() {
        let odd = [f32::NAN, f32::INFINITY, -1e30, 1e9, 0.0, 0.01, 40_000.0];
        let mut points = [Point::default(); 49];
        for (index, point) in points.iter_mut().enumerate() {
            *point = Point::new(odd[index / 7], odd[index % 7]);
        }
        for settings in [Settings::document(), Settings::default()] {
            let mut mapper = mapper(settings);
            mapper.integrate(&scan_of(&room()), [0, 0]);
            for _ in 0..5 {
                let outcome = mapper.integrate(&scan_of(&points), [i16::MIN, i16::MAX]);
                assert!(outcome.pose.x_mm.is_finite() && outcome.pose.heading.is_finite());
            }
        }
    }

    /// The pose of a robot at rest in front of known walls changes by less than a fifth of a cell.
    #[test]
    fn a_robot_at_rest_stays() {
        let mut mapper = mapper(Settings::default());
        for _ in 0..50 {
            mapper.integrate(&scan_of(&room()), [0, 0]);
        }
        let off = Pose::new(1500.0, 1500.0, 0.0).change_to(mapper.pose());
        assert!(off.distance_mm() < 2.0 && off.turn.abs() < 0.002, "{off:?}");
    }

    /// A half turn is drawn, and the other half is seen next: only the ends of the known walls
    /// match it. Missing wheel readings are no reason to slide along them.
    #[test]
    fn a_scan_of_what_is_not_drawn_yet_does_not_move_the_robot() {
        let room = room();
        for seen in [180..360, 150..330, 200..250] {
            let mut mapper = mapper(Settings::default());
            mapper.integrate(&scan_of(&room[..180]), [0, 0]);
            mapper.doubt(50.0, 0.1);
            let pose = mapper.locate(&scan_of(&room[seen.clone()])).pose;
            let off = Pose::new(1500.0, 1500.0, 0.0).change_to(pose);
            assert!(
                off.distance_mm() < 1.0 && off.turn.abs() < 0.001,
                "{seen:?}: {off:?}"
            );
        }
    }

    /// A scan with 17 of 20 points on the wall, 0.85 of them, fits: the push is over. After 5 scans
    /// without a fit the push is over as well, because the world has changed.
    #[test]
    fn a_push_is_over_when_a_scan_fits_or_after_five() {
        let mut grid = Grid::<9, 1>::new(10.0);
        grid.set(4, 0, 255);
        grid.set(5, 0, 0);
        let unsettled = |hits: usize, is_elsewhere, is_at_rest, before| {
            let points: [[i16; 2]; 20] =
                core::array::from_fn(|at| [if at < hits { 64 } else { 80 }, 0]);
            let pose = Pose::new(5.0, 5.0, 0.0);
            let place = tracking::Place {
                pose,
                sum: 0,
                evidence: evidence::Evidence::of(&grid, &points, pose),
                is_elsewhere,
            };
            unsettled_by(&place, is_at_rest, before)
        };
        assert_eq!(
            [16, 17].map(|hits| unsettled(hits, false, true, Some(0))),
            [Some(1), None]
        );
        let after = [0, 3, 4].map(|before| unsettled(0, false, true, Some(before)));
        assert_eq!(after, [Some(1), Some(4), None]);
        // Found elsewhere, or still moving without wheels: the count restarts.
        assert_eq!(unsettled(20, true, true, None), Some(0));
        assert_eq!(unsettled(20, false, false, Some(3)), Some(0));
        assert_eq!(unsettled(0, false, false, None), None);
        assert_eq!(unsettled(0, false, true, None), None);
    }
}
