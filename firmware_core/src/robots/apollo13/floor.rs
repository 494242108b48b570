//! The floor as the planner sees it: the car's map, and obstacles seen since.

use alloc::collections::{BTreeMap, BTreeSet};
use alloc::vec::Vec;
use core::time::Duration;

use protocols::Instant;

use crate::ackermann::CarPose;
use crate::costmap::{Costmap, Inflation};
use crate::particles::Beam;

/// Maximum distance of obstacles that are entered, metres: the obstacle range of the fielded
/// costmap.
const ENTER_M: f64 = 2.5;
/// Range up to which beams clear the cells they cross: the fielded ray-trace range.
const CLEAR_M: f64 = 3.0;
/// Spacing of clearing beams at their ends, in cells.
const CLEAR_CELLS: f64 = 0.8;
/// Range below which the camera may be blind, metres: a beam that meets nothing clears only beyond
/// it.
const BLIND_M: f64 = 0.55;
/// Minimum excess of sightings over clearings that makes a cell an obstacle.
const SURE: i8 = 2;
const COUNT_MAX: i8 = 6;
/// Half angle of the inner ultrasonic cone, which counts as open up to the echo.
const CONE_RAD: f64 = 0.1;
/// Ultrasonic ranges nearer than this are entered across the whole cone, metres: there the cone is
/// narrower than the car. A farther echo may come from a post beside the path.
const HEARD_M: f64 = 0.27;
/// Half of the whole cone.
const WHOLE_CONE_RAD: f64 = 0.38;
/// Lifetime of an ultrasonic obstacle: the camera may see over it.
const HEARD_FOR: Duration = Duration::from_secs(20);

/// A map of obstacles: cells in rows of equal y, lowest y first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FloorPlan {
    /// Cells along x; 0 means no map.
    pub width: usize,
    /// Edge of a cell, metres.
    pub cell_m: f64,
    /// The corner of least x and y, metres.
    pub origin_m: [f64; 2],
    /// Whether a cell is an obstacle.
    pub obstacles: Vec<bool>,
}

/// The map, and the obstacles seen while driving.
#[derive(Clone, Debug)]
pub struct Floor {
    plan: FloorPlan,
    /// Number of complete rows of the plan.
    rows: usize,
    /// Costs of the plan alone; `None` without a map.
    plain: Option<Costmap>,
    /// Costs with all observations; `None` after a change of the observations.
    costs: Option<Costmap>,
    /// Number of scans in which each cell was an obstacle, minus those in which it was cleared.
    seen: Vec<i8>,
    /// The scan in which each cell was counted last.
    counted: Vec<u32>,
    scans: u32,
    /// Cells with an ultrasonic echo, and the time until which each counts.
    heard: BTreeMap<usize, Instant>,
    /// Cells with a marker.
    posts: BTreeSet<usize>,
    /// All obstacles, one byte a cell as in [`grid`](crate::grid).
    view: Vec<u8>,
}

impl Floor {
    /// The floor of this map, without observations.
    pub fn new(plan: FloorPlan, inflation: Inflation) -> Self {
        let seen = alloc::vec![0; plan.obstacles.len()];
        let byte = |is: &bool| {
            if *is {
                crate::grid::OBSTACLE
            } else {
                crate::grid::FREE
            }
        };
        let view = plan.obstacles.iter().map(byte).collect();
        let FloorPlan {
            width,
            cell_m,
            origin_m,
            ..
        } = plan;
        let is_known = width > 0 && !plan.obstacles.is_empty();
        let plain = is_known
            .then(|| Costmap::new(width, cell_m, origin_m, plan.obstacles.clone(), inflation));
        Self {
            counted: alloc::vec![0; seen.len()],
            rows: seen.len().checked_div(width).unwrap_or_default(),
            plan,
            plain,
            costs: None,
            seen,
            scans: 0,
            heard: BTreeMap::new(),
            posts: BTreeSet::new(),
            view,
        }
    }

    /// Replaces the plan: camera observations are discarded, ultrasonic ones are kept.
    pub fn renew(&mut self, plan: FloorPlan, inflation: Inflation) {
        let before = core::mem::replace(self, Self::new(plan, inflation));
        for (at, until) in &before.heard {
            if let Some(at) = self.cell(before.place(*at)) {
                self.heard.insert(at, *until);
            }
        }
    }

    /// Whether there is a map.
    pub fn is_known(&self) -> bool {
        self.plan.width > 0 && !self.plan.obstacles.is_empty()
    }

    /// The configured map.
    pub const fn plan(&self) -> &FloorPlan {
        &self.plan
    }

    /// All obstacles, for an observer.
    pub fn view(&self) -> Option<crate::map_view::MapView<'_>> {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a map's place needs 24 bits"
        )]
        let (cell_mm, origin) = (
            (self.plan.cell_m * 1_000.0) as f32,
            self.plan.origin_m.map(|m| (m * 1_000.0) as f32),
        );
        self.is_known()
            .then(|| crate::map_view::MapView::new(self.plan.width, cell_mm, origin, &self.view))
    }

    /// Discards all observations of the camera and the ultrasound.
    pub fn forget(&mut self) {
        self.seen.fill(0);
        self.heard.clear();
        self.posts.clear();
        self.costs = None;
        for (byte, is) in self.view.iter_mut().zip(&self.plan.obstacles) {
            if !*is {
                *byte = crate::grid::FREE;
            }
        }
    }

    /// Positions of obstacle cells from camera, ultrasound and markers that are not on the plan,
    /// metres.
    pub fn in_the_way(&self) -> impl Iterator<Item = [f64; 2]> {
        let all = sure(&self.seen).chain(self.heard.keys().chain(&self.posts).copied());
        let new = all.filter(|at| !self.plan.obstacles[*at]);
        new.map(|at| self.place(at))
    }

    /// Costs of all cells, including all observations; `None` without a map.
    pub fn costs(&mut self, now: Instant) -> Option<&Costmap> {
        let before = self.heard.len();
        self.heard.retain(|_, until| *until > now);
        if self.heard.len() != before {
            self.costs = None;
        }
        if self.costs.is_none() {
            let mut costs = self.plain.clone()?;
            let low = self.heard.keys().chain(&self.posts).copied();
            for at in sure(&self.seen).chain(low) {
                if !self.plan.obstacles[at] {
                    costs.add(at);
                }
            }
            self.costs = Some(costs);
        }
        self.costs.as_ref()
    }

    /// Enters a scan taken from the pose `scanner` on the map; a beam of infinite range met nothing
    /// within the scanner's range. Returns whether any cell became an obstacle or ceased to be one.
    ///
    /// Each cell counts once a scan: a cell with a beam's end in it is not cleared by other beams.
    pub fn see(&mut self, scanner: CarPose, beams: &[Beam]) -> bool {
        if !self.is_known() {
            return false;
        }
        self.scans = self.scans.wrapping_add(1);
        let mut has_changed = false;
        for beam in beams.iter().filter(|beam| beam.range_m <= ENTER_M) {
            let ray = Ray::new(&self.plan, scanner, beam.bearing_rad);
            has_changed |= self.count(ray.at(beam.range_m), 1);
        }
        let apart = CLEAR_CELLS * self.plan.cell_m / CLEAR_M;
        let mut last = f64::INFINITY;
        for beam in beams.iter().filter(|beam| beam.range_m > 0.0) {
            if (beam.bearing_rad - last).abs() < apart {
                continue;
            }
            last = beam.bearing_rad;
            has_changed |= self.see_through(scanner, *beam);
        }
        if has_changed {
            self.costs = None;
        }
        has_changed
    }

    fn see_through(&mut self, scanner: CarPose, beam: Beam) -> bool {
        let ray = Ray::new(&self.plan, scanner, beam.bearing_rad);
        let is_blind = beam.range_m == f64::INFINITY;
        let mut along_m = if is_blind { BLIND_M } else { 0.0 };
        let clear_m = beam.range_m.min(CLEAR_M) - 1.5 * self.plan.cell_m;
        let mut has_changed = false;
        while along_m < clear_m {
            has_changed |= self.count(ray.at(along_m), -1);
            along_m += self.plan.cell_m;
        }
        has_changed
    }

    /// Enters an ultrasonic range at `now` from the pose `sensor` on the map: the space before the
    /// echo is cleared; a near echo is an obstacle for a while.
    pub fn hear(&mut self, now: Instant, sensor: CarPose, range_m: f64) {
        if !self.is_known() || !range_m.is_finite() {
            return;
        }
        self.scans = self.scans.wrapping_add(1);
        let mut has_changed = false;
        for bearing_rad in [-CONE_RAD, 0.0, CONE_RAD] {
            let beam = Beam {
                bearing_rad,
                range_m,
            };
            has_changed |= self.see_through(sensor, beam);
        }
        if range_m <= HEARD_M {
            let mut bearing_rad = -WHOLE_CONE_RAD;
            while bearing_rad <= WHOLE_CONE_RAD {
                let end = Ray::new(&self.plan, sensor, bearing_rad).at(range_m);
                if let Some(index) = self.index(end) {
                    has_changed |= self.heard.insert(index, now + HEARD_FOR).is_none();
                }
                bearing_rad += 0.1;
            }
        }
        if has_changed {
            self.costs = None;
        }
    }

    /// Sets the positions of low obstacles (markers), metres; earlier ones are removed.
    pub fn stand(&mut self, places: impl Iterator<Item = [f64; 2]>) {
        if !self.is_known() {
            return;
        }
        let posts: BTreeSet<usize> = places.filter_map(|place| self.cell(place)).collect();
        if posts != self.posts {
            self.posts = posts;
            self.costs = None;
        }
    }

    /// Counts an observation of a cell, once a scan; returns whether the cell became an obstacle or
    /// ceased to be one.
    fn count(&mut self, place: [f64; 2], by: i8) -> bool {
        let Some(index) = self.index(place) else {
            return false;
        };
        if core::mem::replace(&mut self.counted[index], self.scans) == self.scans {
            return false;
        }
        let was = self.seen[index] >= SURE;
        self.seen[index] = self.seen[index].saturating_add(by).clamp(-1, COUNT_MAX);
        let is = self.seen[index] >= SURE;
        if was == is || self.plan.obstacles[index] {
            return false;
        }
        self.view[index] = if is {
            crate::grid::OBSTACLE
        } else {
            crate::grid::FREE
        };
        true
    }

    /// The middle of a cell, metres.
    fn place(&self, at: usize) -> [f64; 2] {
        let (row, column) = (at / self.plan.width, at % self.plan.width);
        let [x0, y0] = self.plan.origin_m;
        let middle = |cell: usize| (cell as f64 + 0.5) * self.plan.cell_m;
        [x0 + middle(column), y0 + middle(row)]
    }

    /// The cell at a position, metres.
    fn cell(&self, place_m: [f64; 2]) -> Option<usize> {
        let off = |axis: usize| (place_m[axis] - self.plan.origin_m[axis]) / self.plan.cell_m;
        self.index([0, 1].map(off))
    }

    /// The cell at a position in cells from the corner.
    fn index(&self, [x, y]: [f64; 2]) -> Option<usize> {
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "not below 0, saturates"
        )]
        // Convert to 32 bits first, which takes a processor one instruction; a conversion to
        // unsigned 64 bits takes more.
        let (x, y) = (x as u32 as usize, y as u32 as usize);
        (x < self.plan.width && y < self.rows).then(|| y * self.plan.width + x)
    }
}

/// The cells that count as obstacles. They are few, and most chunks have none.
fn sure(seen: &[i8]) -> impl Iterator<Item = usize> {
    const PIECE: usize = 64;
    let pieces = (0..).step_by(PIECE).zip(seen.chunks(PIECE));
    let has_any = |piece: &[i8]| piece.iter().fold(false, |any, seen| any | (*seen >= SURE));
    let pieces = pieces.filter(move |(_, piece)| has_any(piece));
    let cells = pieces.flat_map(|(first, piece)| (first..).zip(piece));
    cells.filter(|(_, seen)| **seen >= SURE).map(|(at, _)| at)
}

/// A beam in cells of the map.
#[derive(Clone, Copy, Debug)]
struct Ray {
    from: [f64; 2],
    per_metre: [f64; 2],
}

impl Ray {
    fn new(plan: &FloorPlan, from: CarPose, bearing_rad: f64) -> Self {
        let (sin, cos) = libm::sincos(from.heading_rad + bearing_rad);
        let per_metre = 1.0 / plan.cell_m;
        let [x0, y0] = plan.origin_m;
        Self {
            from: [(from.x_m - x0) * per_metre, (from.y_m - y0) * per_metre],
            per_metre: [cos * per_metre, sin * per_metre],
        }
    }

    fn at(self, way_m: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.from[axis] + way_m * self.per_metre[axis])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INFLATION: Inflation = Inflation {
        inscribed_m: 0.1,
        radius_m: 0.1,
    };

    fn empty() -> Floor {
        let plan = FloorPlan {
            width: 60,
            cell_m: 0.05,
            origin_m: [0.0; 2],
            obstacles: alloc::vec![false; 60 * 20],
        };
        Floor::new(plan, INFLATION)
    }

    const SCANNER: CarPose = CarPose {
        x_m: 0.025,
        y_m: 0.525,
        heading_rad: 0.0,
    };

    fn beam(range_m: f64) -> Beam {
        Beam {
            bearing_rad: 0.0,
            range_m,
        }
    }

    /// A box 1 m ahead, cell 20: two scans make it an obstacle, and two scans without it remove the
    /// obstacle.
    #[test]
    fn what_is_seen_twice_is_in_the_way_until_it_is_seen_through() {
        let mut floor = empty();
        assert!(!floor.see(SCANNER, &[beam(1.0)]));
        assert!(!floor.costs(Instant::ZERO).unwrap().is_obstacle([20, 10]));
        assert!(floor.see(SCANNER, &[beam(1.0)]));
        assert!(floor.costs(Instant::ZERO).unwrap().is_obstacle([20, 10]));
        assert_eq!(
            floor.view().unwrap().get(20, 10),
            Some(crate::grid::OBSTACLE)
        );
        assert!(floor.see(SCANNER, &[beam(2.0)]));
        assert!(!floor.costs(Instant::ZERO).unwrap().is_obstacle([20, 10]));
        // Beyond 2.5 m no obstacle is entered, and the configured map stays.
        assert!(!floor.see(SCANNER, &[beam(2.6), beam(2.6), beam(f64::NAN)]));
    }

    /// Many beams of one scan end in the same cell: the cell counts once. A beam of the same scan
    /// that grazes the cell does not clear it.
    #[test]
    fn a_cell_counts_once_a_scan() {
        let mut floor = empty();
        assert!(!floor.see(SCANNER, &[beam(1.0); 20]));
        assert!(floor.see(SCANNER, &[beam(1.0), beam(2.0)]));
        assert!(floor.costs(Instant::ZERO).unwrap().is_obstacle([20, 10]));
    }

    /// A beam without an echo clears as well, but not where the camera is blind: 0.5 m ahead is
    /// cell 10, 1 m is cell 20.
    #[test]
    fn a_beam_that_meets_nothing_clears_what_is_in_sight() {
        let mut floor = empty();
        for range_m in [1.0, 1.0, 0.5, 0.5, 0.5] {
            floor.see(SCANNER, &[beam(range_m)]);
        }
        assert!(floor.see(SCANNER, &[beam(f64::INFINITY)]));
        let costs = floor.costs(Instant::ZERO).unwrap();
        assert!(costs.is_obstacle([10, 10]) && !costs.is_obstacle([20, 10]));
    }

    #[test]
    fn the_map_that_was_given_is_not_seen_through() {
        let mut floor = empty();
        let mut plan = floor.plan().clone();
        plan.obstacles[10 * 60 + 20] = true;
        floor = Floor::new(plan, INFLATION);
        for _ in 0..10 {
            floor.see(SCANNER, &[beam(2.9)]);
        }
        assert!(floor.costs(Instant::ZERO).unwrap().is_obstacle([20, 10]));
        assert!(floor.is_known() && !Floor::new(FloorPlan::default(), INFLATION).is_known());
    }

    /// 0.25 m ahead is cell 5: an obstacle for 20 s, although the camera sees over it. An echo from
    /// 0.8 m away may come from a post beside the path: the middle of a gate stays open.
    #[test]
    fn what_is_heard_near_is_in_the_way_for_a_while() {
        let mut floor = empty();
        floor.hear(Instant::ZERO, SCANNER, 0.8);
        floor.hear(Instant::ZERO, SCANNER, 0.8);
        assert!(!floor.costs(Instant::ZERO).unwrap().is_obstacle([16, 10]));
        floor.hear(Instant::ZERO, SCANNER, 0.25);
        floor.see(SCANNER, &[beam(2.0)]);
        floor.see(SCANNER, &[beam(2.0)]);
        let mut is_there = |seconds: u64| {
            let at = Instant::ZERO + Duration::from_secs(seconds);
            floor.costs(at).unwrap().is_obstacle([5, 10])
        };
        assert!(is_there(19) && !is_there(21));
    }

    /// The same position on a plan with its corner a metre farther down: 20 cells.
    #[test]
    fn what_was_heard_stays_on_another_plan() {
        let mut floor = empty();
        floor.hear(Instant::ZERO, SCANNER, 0.25);
        let mut plan = floor.plan().clone();
        plan.origin_m = [0.0, -1.0];
        plan.obstacles = alloc::vec![false; 60 * 40];
        floor.renew(plan, INFLATION);
        assert!(floor.costs(Instant::ZERO).unwrap().is_obstacle([5, 30]));
    }

    /// A cell that the camera marked becomes free as soon as the sonar sees past it: 0.8 m ahead is
    /// cell 16.
    #[test]
    fn sound_passes_what_is_gone() {
        let mut floor = empty();
        floor.see(SCANNER, &[beam(0.8)]);
        floor.see(SCANNER, &[beam(0.8)]);
        assert!(floor.costs(Instant::ZERO).unwrap().is_obstacle([16, 10]));
        floor.hear(Instant::ZERO, SCANNER, 2.0);
        assert!(!floor.costs(Instant::ZERO).unwrap().is_obstacle([16, 10]));
    }

    /// Sure cells beside each other in one chunk of 64 cells, and at both ends of a chunk.
    #[test]
    fn all_sure_cells_are_found() {
        let mut seen = alloc::vec![0; 200];
        for at in [3, 4, 63, 64, 199] {
            seen[at] = SURE;
        }
        seen[130] = SURE - 1;
        assert!(sure(&seen).eq([3, 4, 63, 64, 199]));
    }

    /// The cells of a row of the plan whose sightings exceed their clearings by `times`.
    fn row(floor: &Floor, row: usize, times: i8) -> Vec<usize> {
        let cells = floor.seen[row * 60..][..60].iter().enumerate();
        cells
            .filter(|(_, seen)| **seen == times)
            .map(|(at, _)| at)
            .collect()
    }

    /// The beam clears from 0.025 m on in steps of a cell, 5 cm, up to one cell and a half before
    /// the obstacle. That is 0.925 m, so the step at 0.9 m, cell 18, is the last. A beam longer
    /// than 3 m clears up to 2.925 m: 2.9 m is cell 58. A beam without an obstacle clears from 0.55
    /// m on, cell 11, because the camera is blind nearer.
    #[test]
    fn a_beam_clears_what_lies_before_its_end() {
        let cleared = |range_m| {
            let mut floor = empty();
            floor.see(SCANNER, &[beam(range_m)]);
            assert_eq!([row(&floor, 9, -1), row(&floor, 11, -1)], [[], []]);
            row(&floor, 10, -1)
        };
        assert!(cleared(1.0).into_iter().eq(0..=18));
        assert!(cleared(2.6).into_iter().eq(0..=50));
        assert!(cleared(50.0).into_iter().eq(0..=58));
        assert!(cleared(f64::INFINITY).into_iter().eq(11..=58));
    }

    /// Eight tenths of a cell at 3 m are 0.01333 rad: a beam 0.013 rad beside the last clearing one
    /// does not clear, one of 0.0134 rad on the other side does. The scanner is at y = 0.53 m, so
    /// the beams are in the next rows 2.9 m away.
    #[test]
    fn beams_that_clear_lie_apart_where_they_end() {
        let mut floor = empty();
        let scanner = CarPose {
            y_m: 0.53,
            ..SCANNER
        };
        let beams = [0.0, 0.013, -0.0134].map(|bearing_rad| Beam {
            bearing_rad,
            range_m: 4.0,
        });
        floor.see(scanner, &beams);
        assert_eq!(row(&floor, 11, -1), []);
        assert!(row(&floor, 9, -1).contains(&58));
        // A beam without range (0 m) does not keep another beam from clearing.
        let mut floor = empty();
        let beams = [0.0, 2.0].map(beam);
        floor.see(SCANNER, &beams);
        assert!(row(&floor, 10, -1).contains(&30));
    }

    /// 2.5 m away, in cell 50, an obstacle is entered, a step farther it is not. An obstacle with
    /// many sightings disappears after five clearing scans, one in a cell that was always open
    /// after three.
    #[test]
    fn what_was_seen_often_is_believed_longer() {
        let mut floor = empty();
        let scans = |floor: &mut Floor, range_m, times: usize| {
            (0..times)
                .filter(|_| floor.see(SCANNER, &[beam(range_m)]))
                .count()
        };
        assert_eq!(scans(&mut floor, 2.5, 1), 0);
        assert_eq!(row(&floor, 10, 1), [50]);
        scans(&mut floor, 2.55, 3);
        assert_eq!(row(&floor, 10, 1), [50]);
        let mut floor = empty();
        assert_eq!(scans(&mut floor, 1.0, 10), 1);
        assert_eq!(row(&floor, 10, COUNT_MAX), [20]);
        assert_eq!(
            (scans(&mut floor, 2.9, 4), scans(&mut floor, 2.9, 1)),
            (0, 1)
        );
        scans(&mut floor, 2.9, 10);
        assert_eq!(
            (scans(&mut floor, 1.0, 2), scans(&mut floor, 1.0, 1)),
            (0, 1)
        );
        let view = floor.view().expect("a map");
        assert_eq!(view.get(20, 10), Some(crate::grid::OBSTACLE));
        scans(&mut floor, 2.9, 1);
        let view = floor.view().expect("a map");
        assert_eq!(view.get(20, 10), Some(crate::grid::FREE));
    }

    /// 0.25 m away a cone of 0.38 rad to either side is 9.3 cm wide: from 0.432 m, row 8, in steps
    /// of 0.1 rad up to 0.604 m, row 12; all at 0.257 m to 0.275 m, column 5.
    #[test]
    fn a_near_echo_is_in_the_way_across_its_cone() {
        let heard = |range_m| {
            let mut floor = empty();
            floor.hear(Instant::ZERO, SCANNER, range_m);
            let at: Vec<usize> = floor.heard.keys().copied().collect();
            at
        };
        let across: Vec<usize> = (8..=12).map(|row| row * 60 + 5).collect();
        assert_eq!([heard(0.25), heard(0.27)], [across.clone(), across]);
        assert_eq!([heard(0.275), heard(f64::INFINITY)], [[], []]);
        // Two metres away three rays of a tenth of a radian clear 0.192 m to either side.
        let mut floor = empty();
        floor.hear(Instant::ZERO, SCANNER, 2.0);
        assert!([7, 10, 13].map(|at| row(&floor, at, -1).contains(&35)) == [true; 3]);
        assert!(row(&floor, 5, -1).is_empty() && row(&floor, 15, -1).is_empty());
        let mut floor = empty();
        floor.hear(Instant::ZERO, SCANNER, 0.25);
        let places: Vec<[f64; 2]> = floor.in_the_way().collect();
        assert!((places[0][0] - 0.275).abs() < 1e-9 && (places[0][1] - 0.425).abs() < 1e-9);
        assert_eq!(places.len(), 5);
    }

    /// The plan's corner is at (-1, -0.5). Markers on the plan count; the next set of markers
    /// replaces them.
    #[test]
    fn markers_stand_where_they_were_seen_last() {
        let mut plan = empty().plan().clone();
        plan.origin_m = [-1.0, -0.5];
        let mut floor = Floor::new(plan, INFLATION);
        let places = [
            [-0.98, -0.48],
            [1.98, 0.48],
            [2.01, 0.0],
            [0.0, 0.51],
            [-1.01, 0.0],
        ];
        floor.stand(places.into_iter());
        assert!(floor.posts.iter().copied().eq([0, 19 * 60 + 59]));
        assert!(floor.costs(Instant::ZERO).unwrap().is_obstacle([59, 19]));
        let found: Vec<[f64; 2]> = floor.in_the_way().collect();
        assert!((found[1][0] - 1.975).abs() < 1e-9 && (found[1][1] - 0.475).abs() < 1e-9);
        floor.stand([[0.01, 0.01]].into_iter());
        assert!(floor.posts.iter().copied().eq([10 * 60 + 20]));
        assert!(!floor.costs(Instant::ZERO).unwrap().is_obstacle([59, 19]));
        assert!(floor.costs(Instant::ZERO).unwrap().is_obstacle([20, 10]));
    }

    /// Two sure cells in one chunk, four in another.
    #[test]
    fn an_even_number_of_sure_cells_is_found() {
        let mut seen = alloc::vec![0; 200];
        let all = [10, 11, 130, 140, 150, 160];
        all.iter().for_each(|at| seen[*at] = SURE);
        assert!(sure(&seen).eq(all));
    }

    /// One beam to the right, then one as far to the left: each clears the old obstacle 1 m away at
    /// 0.2 rad, cells (20, 14) and (20, 6).
    #[test]
    fn beams_to_both_sides_look_through() {
        let mut floor = empty();
        let beams = |range_m| {
            [-0.2, 0.2].map(|bearing_rad| Beam {
                bearing_rad,
                range_m,
            })
        };
        floor.see(SCANNER, &beams(1.0));
        floor.see(SCANNER, &beams(1.0));
        let are_there = |floor: &mut Floor| {
            let costs = floor.costs(Instant::ZERO).unwrap();
            [14, 6].map(|y| costs.is_obstacle([20, y]))
        };
        assert_eq!(are_there(&mut floor), [true; 2]);
        floor.see(SCANNER, &beams(2.0));
        floor.see(SCANNER, &beams(2.0));
        assert_eq!(are_there(&mut floor), [false; 2]);
    }

    /// The plan has cells of 5 cm from (-1.5, 2) m on.
    #[test]
    fn an_observer_sees_the_plan_in_millimetres() {
        let mut plan = empty().plan().clone();
        plan.origin_m = [-1.5, 2.0];
        plan.obstacles[0] = true;
        let floor = Floor::new(plan, INFLATION);
        let view = floor.view().expect("a plan");
        assert_eq!(
            (view.cell_mm(), view.origin_mm()),
            (50.0, [-1_500.0, 2_000.0])
        );
        assert_eq!(
            [view.get(0, 0), view.get(1, 0)],
            [Some(crate::grid::OBSTACLE), Some(crate::grid::FREE)]
        );
    }

    /// An ultrasonic echo is an obstacle at once, even if the costs were computed before.
    #[test]
    fn what_is_heard_is_new_to_the_costs() {
        let mut floor = empty();
        let is_there = |floor: &mut Floor| {
            let costs = floor.costs(Instant::ZERO).unwrap();
            [2, 5].map(|x| costs.is_obstacle([x, 10]))
        };
        assert_eq!(is_there(&mut floor), [false; 2]);
        floor.hear(Instant::ZERO, SCANNER, 0.25);
        assert_eq!(is_there(&mut floor), [false, true]);
    }

    /// Obstacles that the camera saw twice and the ultrasound received are discarded; those of the
    /// plan are not.
    #[test]
    fn a_floor_that_is_forgotten_is_as_planned() {
        let mut plan = empty().plan().clone();
        plan.obstacles[0] = true;
        let mut floor = Floor::new(plan, INFLATION);
        let ahead = [Beam {
            bearing_rad: 0.0,
            range_m: 1.0,
        }];
        floor.see(SCANNER, &ahead);
        floor.see(SCANNER, &ahead);
        floor.hear(Instant::ZERO, SCANNER, 0.25);
        let is_there = |floor: &mut Floor| {
            let costs = floor.costs(Instant::ZERO).unwrap();
            [[20, 10], [5, 10], [0, 0]].map(|cell| costs.is_obstacle(cell))
        };
        assert_eq!(is_there(&mut floor), [true; 3]);
        assert!(floor.in_the_way().count() > 1);
        floor.forget();
        assert_eq!(floor.in_the_way().count(), 0);
        assert_eq!(is_there(&mut floor), [false, false, true]);
        let view = floor.view().expect("a plan");
        assert_eq!(
            [view.get(20, 10), view.get(0, 0)],
            [Some(crate::grid::FREE), Some(crate::grid::OBSTACLE)]
        );
    }
}
