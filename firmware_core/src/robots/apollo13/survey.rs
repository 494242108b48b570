//! Maps a floor without a plan, and chooses the next pose to look from.
//!
//! Facts: in seed 003 an operator drove the car while gmapping drew the floor; an exploration that
//! ends by itself is named as the next step. Here `tracker` computes the camera's pose from the
//! lines seen before, and the map for reports and driving is drawn from that pose. A camera that
//! looks ahead sees the walls of a corridor at flat angles, so beams to their far ends pass the
//! cells of their near ends. Each cell therefore counts once a scan, and beams do not clear a cell
//! that contains a point. The map is complete when it has no open edge left that the car can reach.

mod edges;
mod sightings;
mod tracker;

use core::time::Duration;

use alloc::vec::Vec;

use protocols::Instant;

use super::floor::FloorPlan;
use super::program::CAMERA_AHEAD_M;
use crate::ackermann::{CarPose, Motion};
use crate::costmap::Costmap;
use crate::grid::{FREE, OBSTACLE, UNKNOWN};
use crate::map_view::MapView;
use crate::particles::Beam;
use edges::Tried;
use tracker::Tracker;

/// Cells along each side of the map: 32 m.
const SIDE: usize = 640;
/// Edge of a cell, metres: that of the planner's primitives.
const CELL_M: f64 = 0.05;
const CELL_MM: f32 = 50.0;
/// Minimum time between two drawn scans.
const DRAW_EVERY: Duration = Duration::from_millis(200);
/// Points farther than this are not entered as obstacles yet, metres.
const ENTER_M: f64 = 3.0;
/// Distance up to which a look checks the floor well enough to drive there, metres.
const LOOK_M: f64 = 4.0;
/// Minimum excess of scans with a point in a cell over scans that clear it.
const SURE: i8 = 2;
const COUNT_MAX: i8 = 10;
/// Number of unseen cells beside a wall that may be wall, 30 cm. The camera misses that much of a
/// wall when the car turns away from it, up to the wall's corner.
const BESIDE_CELLS: usize = 6;
/// Margin of unknown cells around a plan.
const MARGIN: usize = 12;
/// Maximum distance from the driven path, metres, of an edge that is only a corner the camera
/// turned away from. To look there, the car would have to turn round in a corridor.
const BESIDE_M: f64 = 0.9;
/// Spacing of the track's positions, metres.
const TRACK_M: f64 = 0.2;
/// Recent positions of the track within this distance of the car, metres, do not count as passed.
/// This holds even if the car moves to and fro there, because an open area may lie ahead.
const STILL_HERE_M: f64 = 1.0;
/// Maximum motion between two scans of a standing car, metres, and the number of scans drawn while
/// it stands.
const REST_M: f64 = 0.000_5;
const SCANS_AT_REST: u32 = 10;
/// Number of scans before the map is used for driving.
const SCANS_MIN: u32 = 5;

/// If edges are left that the car could not reach, it drives back this far and tries them again,
/// because beside a corner there may be no path. Metres, and maximum number of times.
const BACK_M: f64 = 2.5;
const BACK_MAX: u8 = 1;
/// Number of goals in a row with few new cells after which the exploration is complete, and the
/// number of new cells that counts, a quarter of a square metre.
const VAIN_MAX: u8 = 4;
const NEWS_CELLS: usize = 100;

/// Choice of the next goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Choice {
    /// The last goal stays.
    Stay,
    /// A goal at this pose, with this heading.
    Look(CarPose),
    /// The same goal again, with any heading.
    Go(CarPose),
    /// No goal: nothing is left, and the exploration has ended.
    Done,
}

/// The map under construction.
#[derive(Clone, Debug)]
pub struct Survey {
    tracker: Tracker,
    /// The map's corner of least x and y in the frame of poses, metres.
    corner_m: [f64; 2],
    /// Published value of each cell, in the map's rows: free, unknown, obstacle.
    cells: Vec<u8>,
    /// Number of scans with a point in each cell, minus those that cleared it.
    seen: Vec<i8>,
    /// The scan in which each cell was counted last.
    counted: Vec<u32>,
    /// The odometry's pose of the camera at the last drawn scan.
    odometry: Option<CarPose>,
    drawn: Option<Instant>,
    scans: u32,
    /// Positions that the camera passed, each [`TRACK_M`].
    track: Vec<CarPose>,
    /// The edge of the last goal.
    edge: Option<[f64; 2]>,
    tried: Tried,
    /// Edges given up before the car drove back, for another try.
    again: Vec<[f64; 2]>,
    /// Number of drives back.
    went_back: u8,
    /// Cells known at the last goal that added some, and goals since.
    known: usize,
    vain: u8,
    is_complete: bool,
}

impl Survey {
    /// An empty map around `camera`.
    pub fn new(camera: CarPose) -> Self {
        let half = SIDE as f64 / 2.0;
        let corner = |m: f64| (libm::floor(m / CELL_M) - half) * CELL_M;
        let corner_m = [corner(camera.x_m), corner(camera.y_m)];
        Self {
            tracker: Tracker::new(camera),
            corner_m,
            cells: alloc::vec![UNKNOWN; SIDE * SIDE],
            seen: alloc::vec![0; SIDE * SIDE],
            counted: alloc::vec![0; SIDE * SIDE],
            odometry: None,
            drawn: None,
            scans: 0,
            track: Vec::new(),
            edge: None,
            tried: Tried::default(),
            again: Vec::new(),
            went_back: 0,
            known: 0,
            vain: 0,
            is_complete: false,
        }
    }

    /// Whether the exploration has ended.
    pub const fn is_complete(&self) -> bool {
        self.is_complete
    }

    /// Whether a scan at `now` would be drawn.
    pub fn is_due(&self, now: Instant) -> bool {
        self.drawn.is_none_or(|drawn| now - drawn >= DRAW_EVERY)
    }

    /// Draws a scan, taken at the camera's odometry pose; returns the camera's pose on the map.
    pub fn draw(&mut self, now: Instant, odometry: CarPose, beams: &[Beam]) -> CarPose {
        let before = self.odometry.replace(odometry);
        let motion = before.map_or_else(Motion::default, |before| before.motion_to(odometry));
        self.drawn = Some(now);
        self.scans = self.scans.saturating_add(1);
        let seen = beams.iter().map(|beam| [beam.bearing_rad, beam.range_m]);
        // A car cannot turn on the spot. A turn of its gyroscope swings the camera, which sits
        // before the axle, sideways.
        let swung_m = CAMERA_AHEAD_M * libm::sin(motion.turn_rad);
        let is_at_rest = libm::hypot(motion.ahead_m, motion.left_m - swung_m) < REST_M;
        if is_at_rest && self.scans > SCANS_AT_REST {
            return self.tracker.rest(motion);
        }
        let camera = self.tracker.track(motion, seen);
        if self.tracker.is_fitting() {
            self.look(camera, beams);
        }
        // Positions that the car reverses out of do not count as passed.
        let is_ahead = |at: &mut CarPose| camera.motion_to(*at).ahead_m > 0.0;
        while motion.ahead_m < 0.0 && self.track.pop_if(is_ahead).is_some() {}
        let last = self.track.last();
        if last.is_none_or(|last| last.distance_m(camera) >= TRACK_M) {
            self.track.push(camera);
        }
        camera
    }

    /// The map, for an observer.
    pub fn view(&self) -> MapView<'_> {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a map's place needs 24 bits"
        )]
        let corner_mm = self.corner_m.map(|m| (m * 1e3) as f32);
        MapView::new(SIDE, CELL_MM, corner_mm, &self.cells)
    }

    /// The known area as a plan to drive by.
    pub fn plan(&self) -> FloorPlan {
        let [mut low, mut high] = [[SIDE; 2], [0; 2]];
        for (y, row) in self.cells.chunks_exact(SIDE).enumerate() {
            // Skip rows that are completely unknown: a large map has many.
            if row == [UNKNOWN; SIDE] {
                continue;
            }
            let is_known = |value: &u8| *value != UNKNOWN;
            let ends = [
                row.iter().position(is_known),
                row.iter().rposition(is_known),
            ];
            let [first, last] = ends.map(Option::unwrap_or_default);
            low = [low[0].min(first), low[1].min(y)];
            high = [high[0].max(last), high[1].max(y)];
        }
        if low[0] > high[0] {
            return FloorPlan::default();
        }
        let first = low.map(|cell| cell.saturating_sub(MARGIN));
        let last = high.map(|cell| (cell + MARGIN).min(SIDE - 1));
        FloorPlan {
            width: last[0] - first[0] + 1,
            cell_m: CELL_M,
            origin_m: [0, 1].map(|axis| self.corner_m[axis] + first[axis] as f64 * CELL_M),
            obstacles: (first[1]..=last[1])
                .flat_map(|y| (first[0]..=last[0]).map(move |x| [x, y]))
                .map(|cell| self.is_kept_off(cell))
                .collect(),
        }
    }

    /// Whether the car keeps off a cell: it is an obstacle, or it is unseen and lies beside an
    /// obstacle. A camera that looks ahead does not see the continuation of a wall beside the car,
    /// nor the corner that the car turns around. The path back is not checked at all.
    fn is_kept_off(&self, [x, y]: [usize; 2]) -> bool {
        let is_wall =
            |x: usize, y: usize| x < SIDE && self.cells.get(y * SIDE + x) == Some(&OBSTACLE);
        match self.cells[y * SIDE + x] {
            OBSTACLE => true,
            UNKNOWN => (1..=BESIDE_CELLS).any(|by| {
                let before = |at: usize| at.wrapping_sub(by).min(SIDE);
                let along = [x + by, before(x)].into_iter().any(|x| is_wall(x, y));
                along || [y + by, before(y)].into_iter().any(|y| is_wall(x, y))
            }),
            _ => false,
        }
    }

    /// The next goal that shows more, from `pose` on a floor with `costs`. `is_under_way`: the car
    /// still drives to its last goal. `is_free` tests whether the car can be at a pose.
    pub fn next(
        &mut self,
        costs: &Costmap,
        pose: CarPose,
        is_under_way: bool,
        is_free: impl Fn(CarPose) -> bool,
    ) -> Choice {
        if self.scans < SCANS_MIN {
            return Choice::Stay;
        }
        if self.is_complete {
            return Choice::Done;
        }
        let (goal, place) = match edges::next(self, costs, pose, &is_free) {
            Ok(next) => next,
            Err(barred) => {
                let back = self.back(pose, barred, is_free);
                self.is_complete = back.is_none();
                return back.map_or(Choice::Done, Choice::Go);
            }
        };
        let before = self.edge.replace(place);
        if is_under_way && before.is_some_and(|before| edges::are_same(before, place)) {
            return Choice::Stay;
        }
        if self.is_in_vain() {
            self.is_complete = true;
            return Choice::Done;
        }
        match self.tried.add(place) {
            true => Choice::Look(goal),
            false => Choice::Go(goal),
        }
    }

    /// Whether the last goals have added too few cells.
    fn is_in_vain(&mut self) -> bool {
        let known = self.cells.iter().filter(|cell| **cell != UNKNOWN).count();
        if known >= self.known + NEWS_CELLS {
            (self.known, self.vain) = (known, 0);
        } else {
            self.vain = self.vain.saturating_add(1);
        }
        self.vain > VAIN_MAX
    }

    /// A pose on the path back from `pose`, if the car has given up an edge or is `barred` from
    /// one. From there the car may try that edge once more.
    fn back(
        &mut self,
        pose: CarPose,
        barred: Vec<[f64; 2]>,
        is_free: impl Fn(CarPose) -> bool,
    ) -> Option<CarPose> {
        let given_up: Vec<_> = self.tried.given_up().chain(barred).collect();
        if self.went_back >= BACK_MAX || given_up.is_empty() {
            return None;
        }
        let mut way = self.track.iter().rev().copied();
        let goal = way.find(|at| at.distance_m(pose) >= BACK_M && is_free(*at))?;
        self.went_back += 1;
        self.again = given_up;
        self.tried = Tried::default();
        Some(goal)
    }

    /// Whether the camera passed so near that an unseen area there lies beside its path.
    fn is_beside(&self, [x_m, y_m]: [f64; 2]) -> bool {
        let is_near = |[at_x_m, at_y_m]: [f64; 2]| {
            let off = [at_x_m - x_m, at_y_m - y_m];
            off.map(|m| m * m).iter().sum::<f64>() < BESIDE_M * BESIDE_M
        };
        let mut track = self.passed().iter();
        track.any(|at| is_near([at.x_m, at.y_m])) && !self.again.iter().copied().any(is_near)
    }

    /// The part of the track that the camera has left behind.
    fn passed(&self) -> &[CarPose] {
        let here = self.track.last().copied().unwrap_or_default();
        let is_left = |at: &CarPose| at.distance_m(here) >= STILL_HERE_M;
        let len = self.track.iter().rposition(is_left).map_or(0, |at| at + 1);
        &self.track[..len]
    }

    /// Whether the camera has cleared the cell at this position, metres.
    fn is_free(&self, place_m: [f64; 2]) -> bool {
        self.index(place_m).is_some_and(|at| self.cells[at] == FREE)
    }

    /// Whether the cell is unknown.
    fn is_unknown(&self, place_m: [f64; 2]) -> bool {
        let at = self.index(place_m);
        at.is_some_and(|at| self.cells[at] == UNKNOWN)
    }

    fn index(&self, place_m: [f64; 2]) -> Option<usize> {
        let [x, y] = [0, 1].map(|axis| (place_m[axis] - self.corner_m[axis]) / CELL_M);
        let is_inside = |along: f64| along >= 0.0 && along < SIDE as f64;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "within the map"
        )]
        (is_inside(x) && is_inside(y)).then(|| y as usize * SIDE + x as usize)
    }

    /// Enters a scan from `camera` into the cells.
    fn look(&mut self, camera: CarPose, beams: &[Beam]) {
        let along = |bearing_rad: f64, way_m: f64| {
            let (sin, cos) = libm::sincos(camera.heading_rad + bearing_rad);
            [camera.x_m + way_m * cos, camera.y_m + way_m * sin]
        };
        for beam in beams.iter().filter(|beam| beam.range_m <= ENTER_M) {
            self.count(along(beam.bearing_rad, beam.range_m), 1);
        }
        let mut last = f64::INFINITY;
        for beam in beams {
            if (beam.bearing_rad - last).abs() < CELL_M / LOOK_M {
                continue;
            }
            last = beam.bearing_rad;
            let end = along(beam.bearing_rad, 1.0);
            let per_metre = [end[0] - camera.x_m, end[1] - camera.y_m];
            let way_m = (beam.range_m - 1.5 * CELL_M).min(LOOK_M);
            let mut along_m = 0.0;
            while along_m < way_m {
                let place = [
                    camera.x_m + along_m * per_metre[0],
                    camera.y_m + along_m * per_metre[1],
                ];
                self.count(place, -1);
                along_m += CELL_M / 2.0;
            }
        }
    }

    fn count(&mut self, place_m: [f64; 2], by: i8) {
        let Some(at) = self.index(place_m) else {
            return;
        };
        if core::mem::replace(&mut self.counted[at], self.scans) == self.scans {
            return;
        }
        self.seen[at] = self.seen[at].saturating_add(by).clamp(-3, COUNT_MAX);
        self.cells[at] = match self.seen[at] {
            SURE.. => OBSTACLE,
            ..0 => FREE,
            _ => self.cells[at],
        };
    }
}

#[cfg(test)]
mod tests;
