//! Simultaneous localisation and mapping: tinySLAM as in the seed report. The odometry predicts
//! where the robot is, a search finds where the scan fits the map best, and the scan is drawn into
//! the map from there.
//!
//! ```text
//! odometry -> predict -> search (map, scan) -> pose -> update (map, scan)
//! ```

mod budget;
mod matching;
mod prior;
mod random;
mod search;
mod settings;
mod update;

use core::time::Duration;

pub use budget::Budget;
pub use settings::{Defects, Method, MotionNoise, Rounding, Search, Settings};

use crate::grid::{Grid, SIDE};
use crate::pose::{Point, Pose, PoseChange};
use crate::scan::{BEAMS, Scan};
use budget::Regulator;
use matching::{EndPoints, Placement, tally};
use prior::{Prior, Travel};
use random::Pcg32;
use search::Found;
use update::{Ink, Ray, draw};

/// What became of a scan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// The pose that fits, at the scan's end.
    pub pose: Pose,
    /// 1024 times the mean map value at the end points; -1 if the scan had none.
    pub score: i32,
    /// Candidates scored.
    pub tries: u32,
    /// End points looked up, over all tries.
    pub points: u32,
    /// The score as part of the best that the map update can draw, 0 to 1.
    pub quality: f32,
}

/// Map, pose, and what is needed to keep both; the only large thing a robot has.
#[derive(Clone, Debug)]
pub struct Mapper<const W: usize = SIDE, const H: usize = SIDE> {
    grid: Grid<W, H>,
    pose: Pose,
    settings: Settings,
    regulator: Regulator,
    random: Pcg32,
    sparse: EndPoints,
    dense: EndPoints,
    travel: Travel,
    scans: u32,
}

impl<const W: usize, const H: usize> Mapper<W, H> {
    /// A mapper that knows nothing but where it starts.
    pub fn new(settings: Settings) -> Self {
        Self {
            grid: Grid::new(settings.resolution_mm),
            pose: settings.start,
            regulator: Regulator::new(&settings.budget, !settings.defects.unbounded_budget),
            random: Pcg32::new(settings.seed),
            sparse: EndPoints::EMPTY,
            dense: EndPoints::EMPTY,
            travel: Travel::default(),
            scans: 0,
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

    /// Tells the mapper where it is.
    pub const fn set_pose(&mut self, pose: Pose) {
        self.pose = pose;
    }

    /// What the mapper was told once.
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Scans drawn so far.
    pub const fn scans(&self) -> u32 {
        self.scans
    }

    /// Forgets map and pose and begins anew.
    pub fn restart(&mut self) {
        self.grid.clear();
        self.pose = self.settings.start;
        self.scans = 0;
    }

    /// Moves the believed pose by what the odometry reports.
    pub fn predict(&mut self, change: PoseChange) {
        self.pose = self.pose.then(change);
        self.travel.add(change);
    }

    /// Finds the pose at which `scan` fits the map, and draws the scan from there.
    /// `wheel_speeds` (left, right; ticks per 40 ms) tell how fast the robot turns: a turning
    /// robot's scan is drawn more weakly.
    pub fn integrate(&mut self, scan: &Scan, wheel_speeds: [i16; 2]) -> Outcome {
        let outcome = self.locate(scan);
        self.draw(scan, self.weight(wheel_speeds));
        outcome
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
        let wanted = usize::from(self.settings.search.points).clamp(1, BEAMS);
        self.sparse
            .set(self.chosen(points, wanted), self.settings.resolution_mm);
        self.dense
            .set(points.iter().copied(), self.settings.resolution_mm);
        let found = if self.scans == 0 {
            self.only_here()
        } else {
            search::run(
                &self.grid,
                &self.settings,
                &search::Task {
                    sparse: self.sparse.all(),
                    dense: self.dense.all(),
                    prior: Prior::new(self.pose, self.travel, &self.settings.motion),
                    tries: self.regulator.tries(),
                },
                &mut self.random,
            )
        };
        self.pose = found.pose;
        self.travel = Travel::default();
        self.outcome(found)
    }

    /// Tells how long the last scan took, from reading the wheels to the end of the map update;
    /// the number of tries follows.
    pub fn search_time(&mut self, elapsed: Duration) {
        self.regulator.search_took(elapsed, &self.settings.budget);
    }

    /// Tries that the next search may make.
    pub const fn tries(&self) -> u32 {
        self.regulator.tries()
    }

    fn only_here(&self) -> Found {
        let points = self.sparse.all();
        let placement = Placement::new(self.pose, self.settings.resolution_mm);
        Found {
            pose: self.pose,
            tally: tally(self.grid.rows(), points, &placement),
            tries: 1,
            points: count_u32(points.len()),
        }
    }

    fn outcome(&self, found: Found) -> Outcome {
        let of = if self.settings.defects.outside_is_free {
            found.tally.inside
        } else {
            count_u32(self.sparse.all().len())
        };
        let score = (u64::from(found.tally.sum) * 1024)
            .checked_div(u64::from(of))
            .map_or(-1, |mean| i32::try_from(mean).expect("at most 255 * 1024"));
        let quality = (score.max(0) as f32 / (255.0 * 1024.0)).min(1.0);
        let score = if self.settings.defects.score_wraps {
            wrapped(score)
        } else {
            score
        };
        Outcome {
            pose: found.pose,
            score,
            tries: found.tries,
            points: found.points,
            quality,
        }
    }

    /// The points that a try looks at: in the document every tenth beam, whether it came back or
    /// not; else evenly spread over those that did, a different set each time.
    fn chosen<'a>(&self, points: &'a [Point], wanted: usize) -> impl Iterator<Item = Point> + 'a {
        let count = points.len();
        let shift = match self.settings.search.method {
            Method::Document => 0,
            Method::Annealed => (self.scans as usize * 7) % (count / wanted.min(count)).max(1),
        };
        let taken = wanted.min(count);
        (0..taken).map(move |index| points[(index * count / taken + shift) % count])
    }

    fn weight(&self, [left, right]: [i16; 2]) -> u16 {
        let Settings {
            weight,
            weight_min,
            bold_scans,
            defects,
            ..
        } = self.settings;
        if defects.constant_weight {
            return weight;
        }
        let least = if defects.weight_down_to_one {
            1
        } else {
            weight_min
        };
        let usual = weight.saturating_sub(left.abs_diff(right)).max(least);
        if self.scans < u32::from(bold_scans) {
            let bold = 256 / (self.scans + 2);
            usual.max(u16::try_from(bold).expect("at most 128"))
        } else {
            usual
        }
    }

    fn draw(&mut self, scan: &Scan, weight: u16) {
        let ink = Ink {
            weight,
            rounding: if self.settings.defects.truncating_rounding {
                Rounding::Truncating
            } else {
                Rounding::Corrected
            },
            loses_short_holes: self.settings.defects.loses_short_holes,
        };
        let half_hole = self.settings.hole_mm / 2.0;
        for (point, beam) in scan.points().iter().zip(scan.beams()) {
            let origin = scan.origin(*beam);
            let length = point.distance_mm(origin);
            if length < 1.0 {
                continue;
            }
            let stretch = 1.0 + half_hole / length;
            let end = Point::new(
                origin.x_mm + (point.x_mm - origin.x_mm) * stretch,
                origin.y_mm + (point.y_mm - origin.y_mm) * stretch,
            );
            let ray = Ray {
                from: self.cell(origin),
                hit: self.cell(*point),
                end: self.cell(end),
            };
            draw(self.grid.rows_mut(), &ray, ink);
        }
        self.scans = self.scans.saturating_add(1);
    }

    /// The cell of a point of the robot's frame, possibly outside the map.
    fn cell(&self, point: Point) -> (i32, i32) {
        let world = self.pose.to_world(point);
        let index = |mm: f32| {
            #[expect(clippy::cast_possible_truncation, reason = "clamped")]
            let cell = libm::floorf(mm / self.settings.resolution_mm).clamp(-9e3, 9e3) as i32;
            cell
        };
        (index(world.x_mm), index(world.y_mm))
    }
}

fn count_u32(count: usize) -> u32 {
    u32::try_from(count).expect("at most 360 points")
}

/// As a 16-bit register with sign would hold it.
const fn wrapped(value: i32) -> i32 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the truncation is what is shown"
    )]
    let register = value as i16;
    register as i32
}
