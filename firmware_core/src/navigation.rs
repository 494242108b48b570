//! Computes wheel speeds from pose, scan and goal.
//!
//! ```text
//! goal -> bearing -> free path -> steering -> guard -> set-points (left, right)
//! ```
//!
//! Speeds are the base's: encoder ticks per 40 ms, 20 being 226 mm/s. Bearings are relative to the
//! robot, counter-clockwise from ahead. The steering law and the wall follower are the seed
//! report's (chapter on navigation). The free path and the guard are our own additions, because the
//! fielded robot drove to its waypoints without regard to obstacles.

mod cells;
mod escape;
mod explore;
mod fielded;
mod frontiers;
mod planner;
mod raster;
mod squeeze;
mod surroundings;

use crate::grid::Grid;
use crate::pose::{Point, Pose, normalised, sin_cos};
use escape::Escape;
pub use explore::{Explorer, WallFollowing, WallLaw};
pub use frontiers::{Frontiers, Outlook, Sought, View};
use planner::Planner;
use squeeze::Squeeze;
pub use surroundings::Surroundings;

/// Both wheels at rest.
pub const HALT: [i8; 2] = [0, 0];

/// Conversion of a bearing to wheel speeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steering {
    /// Speed straight ahead.
    pub cruise: i8,
    /// Degrees of error per tick of speed difference on each side.
    pub degrees_per_tick: f32,
    /// Maximum speed difference on each side, ticks.
    pub turn_max: f32,
    /// Error from which the robot turns on the spot, in degrees.
    pub spot_deg: f32,
}

impl Steering {
    /// The seed report's: left = 20 - err / 3, right = 20 + err / 3, each within +-20.
    pub const DOCUMENT: Self = Self {
        cruise: 20,
        degrees_per_tick: 3.0,
        turn_max: 60.0,
        spot_deg: 360.0,
    };

    /// Slower turns, on the spot if they are large: a scan takes 200 ms, and every turn meanwhile
    /// degrades the map.
    pub const CALM: Self = Self {
        cruise: 20,
        degrees_per_tick: 3.0,
        turn_max: 9.0,
        spot_deg: 50.0,
    };

    /// Wheel speeds that turn the robot towards `bearing` (radians, any number of turns).
    pub fn towards(&self, bearing: f32) -> [i8; 2] {
        self.by_error(normalised(bearing).to_degrees())
    }

    /// Steering of the fielded program: headings psi in degrees, clockwise, with any number of
    /// turns. Only a difference above 180 degrees is brought back, by one turn (field defects NV-01
    /// and NV-02).
    pub fn towards_psi(&self, psi_deg: f32, target_deg: f32) -> [i8; 2] {
        let error_deg = psi_deg - target_deg;
        let turns = if error_deg > 180.0 { 360.0 } else { 0.0 };
        self.by_error(error_deg - turns)
    }

    fn by_error(&self, error_deg: f32) -> [i8; 2] {
        let turn = (error_deg / self.degrees_per_tick).clamp(-self.turn_max, self.turn_max);
        let cruise = f32::from(self.cruise);
        let forward = if error_deg.abs() >= self.spot_deg {
            0.0
        } else {
            cruise
        };
        [forward - turn, forward + turn].map(|wheel| ticks(wheel.clamp(-cruise, cruise)))
    }
}

/// Rounds towards zero, saturated.
pub(crate) const fn ticks(speed: f32) -> i8 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "saturates, which is what is wanted"
    )]
    let ticks = speed as i8;
    ticks
}

/// Dimensions and limits of the robot's body, and its minimum distance to obstacles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Radius of the disc that holds the robot.
    pub radius_mm: f32,
    /// Minimum distance between the body and obstacles that the lidar sees.
    pub clearance_mm: f32,
    /// Speed of a wheel per tick.
    pub tick_mm_s: f32,
    /// Distance between the wheels.
    pub axle_mm: f32,
}

impl Body {
    /// Distance from the robot's middle that obstacles should keep.
    pub fn keep_mm(&self) -> f32 {
        self.radius_mm + self.clearance_mm
    }
}

/// Settings of the navigator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Conversion of a bearing to wheel speeds.
    pub steering: Steering,
    /// The robot's body.
    pub body: Body,
    /// A waypoint counts as reached within this distance.
    pub arrival_mm: f32,
    /// A blocked waypoint counts as reached within this distance.
    pub arrival_blocked_mm: f32,
    /// The wall follower.
    pub wall: WallFollowing,
    /// Enabled defects of the fielded program.
    pub defects: Defects,
}

/// Navigation defects of the fielded program; all off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Headings are compared as [`Steering::towards_psi`] does (NV-01).
    pub wraps_one_side: bool,
    /// Psi also counts the turns that the robot has made (NV-02).
    pub counts_turns: bool,
    /// A blind robot drives straight ahead (XV-11).
    pub drives_blind: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        wraps_one_side: false,
        counts_turns: false,
        drives_blind: false,
    };
}

impl Settings {
    /// Settings for a robot with this body. The document's arrival radius is 200 mm. Ours is
    /// smaller, because the true distance counts and the pose has an error.
    pub const fn new(body: Body) -> Self {
        Self {
            steering: Steering::CALM,
            body,
            arrival_mm: 80.0,
            arrival_blocked_mm: 160.0,
            wall: WallFollowing::NEAREST,
            defects: Defects::NONE,
        }
    }
}

/// The goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Position in the map.
    pub position: Point,
    /// Whether to stop there.
    pub is_last: bool,
}

/// Next action for a goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Drive on.
    Drive([i8; 2]),
    /// The goal has been reached.
    Arrived,
}

/// Scans without progress after which a goal counts as blocked: three seconds.
const STALLED_SCANS: u8 = 15;
/// Minimum progress.
const PROGRESS_MM: f32 = 10.0;
/// Free path required before the robot takes a direction. Near the wanted bearing, within 12 steps
/// of five degrees, the shorter one is enough: such directions lead to the goal gradually. A longer
/// free path elsewhere may lead away from the goal.
const FREE_WAY_MM: f32 = 450.0;
const NEARER_WAY_MM: f32 = 200.0;
const NEARER_STEPS: i8 = 12;
/// Advantage, in radians, that makes a direction much better.
const MUCH: f32 = STEP * 8.0;
/// Scans between two plans: one second.
const PLAN_SCANS: u8 = 5;
/// A goal counts as unreachable after this many plans in a row without a path, or this many rounds
/// in which all paths were blocked: in a single round a moving obstacle may have blocked one.
const WAYLESS_PLANS: u8 = 4;
const BLOCKED_ROUNDS: u8 = 2;
/// Distance to the last goal at which the robot begins to slow down.
const SLOW_DOWN_MM: f32 = 250.0;

/// Drives to goals and around obstacles.
#[derive(Clone, Debug)]
pub struct Navigator {
    settings: Settings,
    explorer: Explorer,
    escape: Escape,
    planner: Planner,
    /// Scans until the next plan.
    plan_ages: u8,
    /// Plans in a row without a path.
    wayless: u8,
    /// Number of rounds in which every path to the goal was found blocked.
    rounds: u8,
    goal: Option<Point>,
    nearest_mm: f32,
    stalled: u8,
    /// Side of the last detour around an obstacle: 1 left, -1 right, 0 none.
    side: f32,
    squeeze: Squeeze,
    fielded: fielded::Psi,
}

impl Navigator {
    /// A navigator without a goal.
    pub const fn new(settings: Settings) -> Self {
        Self {
            settings,
            explorer: Explorer::new(),
            escape: Escape::new(),
            planner: Planner::new(),
            plan_ages: 0,
            wayless: 0,
            rounds: 0,
            goal: None,
            nearest_mm: f32::INFINITY,
            stalled: 0,
            side: 0.0,
            squeeze: Squeeze::NONE,
            fielded: fielded::Psi::new(),
        }
    }

    /// The settings given at construction.
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Limits the speed to `cruise`, ticks per 40 ms, from now on.
    pub const fn slow_down(&mut self, cruise: i8) {
        self.settings.steering.cruise = cruise;
    }

    /// Runs one step along walls.
    pub fn explore(&mut self, pose: Pose, around: &Surroundings) -> [i8; 2] {
        self.fielded.turned(pose);
        if self.settings.defects.drives_blind && around.is_blind() {
            return [self.settings.steering.cruise; 2];
        }
        let wanted = match self.escape.step(&self.settings, pose, around) {
            Some(way) => self.settings.steering.towards(way),
            None => self.explorer.step(&self.settings, around),
        };
        around.guarded(&self.settings.body, wanted)
    }

    /// Runs one step towards `goal`. `map` is the map so far.
    pub fn approach(&mut self, map: &Grid, pose: Pose, goal: Goal, around: &Surroundings) -> Step {
        let distance = pose.position().distance_mm(goal.position);
        self.watch_progress(goal.position, distance);
        self.fielded.turned(pose);
        let is_blocked = self.stalled >= STALLED_SCANS;
        if distance <= self.settings.arrival_mm
            || (is_blocked && distance <= self.settings.arrival_blocked_mm)
        {
            self.goal = None;
            return Step::Arrived;
        }
        let mut steering = self.settings.steering;
        let still_scans = self.escape.still_scans();
        let (body, cruise_max) = self.squeeze.step(&self.settings.body, still_scans, around);
        steering.cruise = steering.cruise.min(cruise_max);
        let way = match self.escape.step(&self.settings, pose, around) {
            Some(way) => {
                if self.escape.has_begun() {
                    self.planner.refuse_way_from(pose.position());
                }
                way
            }
            None => {
                let aim = self.aim(&body, map, pose, goal, around);
                let far = pose.position().distance_mm(aim);
                let far = far.min(self.squeeze.way_max_mm());
                self.free_way(&body, around, bearing_of(pose, aim), far)
            }
        };
        if goal.is_last && distance < SLOW_DOWN_MM {
            let slow = f32::from(self.settings.steering.cruise) * distance / SLOW_DOWN_MM;
            steering.cruise = steering.cruise.min(ticks(slow.max(8.0)));
        }
        let wanted = self
            .fielded
            .steer(&self.settings.defects, &steering, pose, way);
        Step::Drive(around.guarded(&body, wanted))
    }

    /// Whether several plans in a row found no path to the goal, even a narrow one, or all paths
    /// were found blocked more than once.
    pub const fn has_no_way(&self) -> bool {
        self.wayless >= WAYLESS_PLANS || self.rounds >= BLOCKED_ROUNDS
    }

    /// Discards the goal and all state of the drive to it.
    pub const fn reset(&mut self) {
        self.goal = None;
        self.side = 0.0;
        self.squeeze = Squeeze::NONE;
        self.explorer = Explorer::new();
        self.escape = Escape::new();
        self.planner.forget();
    }

    fn watch_progress(&mut self, goal: Point, distance: f32) {
        if self.goal != Some(goal) {
            self.goal = Some(goal);
            self.plan_ages = 0;
            (self.wayless, self.rounds) = (0, 0);
            self.squeeze.forget_way();
            self.nearest_mm = f32::INFINITY;
            self.side = 0.0;
        }
        if distance < self.nearest_mm - PROGRESS_MM {
            self.nearest_mm = distance;
            self.stalled = 0;
        } else {
            self.stalled = self.stalled.saturating_add(1);
        }
    }

    /// The point to steer for: the goal itself if the straight path is free, else the next point of
    /// a path around the obstacles.
    fn aim(
        &mut self,
        body: &Body,
        map: &Grid,
        pose: Pose,
        Goal {
            position: goal,
            is_last,
        }: Goal,
        around: &Surroundings,
    ) -> Point {
        self.plan_ages = self.plan_ages.saturating_sub(1);
        let distance = pose.position().distance_mm(goal);
        let free = around.free_mm(body, bearing_of(pose, goal));
        if free >= distance {
            self.plan_ages = 0;
            self.wayless = 0;
            return goal;
        }
        if self.plan_ages == 0 {
            self.plan_ages = PLAN_SCANS;
            let full = &self.settings.body;
            let thin_mm = squeeze::thin(full).keep_mm();
            // Use one kind of path: alternating a wide and a narrow path makes the robot drive to
            // and fro.
            let wide = if self.squeeze.is_tight() { body } else { full };
            let bodies = (wide, thin_mm);
            if self.planner.plan(map, bodies, pose, goal, around) {
                self.rounds = self.rounds.saturating_add(1);
            }
            // An intermediate waypoint can be replaced by another one, and squeezing to each of
            // them costs time.
            if is_last {
                self.squeeze
                    .watch_way(self.planner.way_cells(pose.position()));
            }
            self.wayless = match self.planner.way_from(pose.position()) {
                Some(_) => 0,
                None => self.wayless.saturating_add(1),
            };
        }
        self.planner.way_from(pose.position()).unwrap_or(goal)
    }

    /// The bearing nearest to `bearing` along which the robot fits.
    fn free_way(&mut self, body: &Body, around: &Surroundings, bearing: f32, distance: f32) -> f32 {
        let wanted = FREE_WAY_MM.min(distance);
        if around.free_mm(body, bearing) >= wanted {
            self.side = 0.0;
            return bearing;
        }
        // Best cost among the directions with enough free path; failing that, the direction with
        // the most.
        let (mut best, mut least) = (None, f32::INFINITY);
        let (mut freest, mut most) = (bearing, 0.0);
        for step in 0..=24_i8 {
            for side in [1.0, -1.0] {
                let offset = f32::from(step) * side * STEP;
                let free = around.free_mm(body, bearing + offset);
                let enough = if step <= NEARER_STEPS {
                    NEARER_WAY_MM.min(wanted)
                } else {
                    wanted
                };
                // After a side is chosen, a direction on the other side must be much better. A
                // direction with a shorter free path must lead much nearer to the goal.
                let is_disloyal = step > 0 && self.side == -side;
                let loyalty = if is_disloyal { MUCH } else { 0.0 };
                let shortness = if free < wanted { MUCH } else { 0.0 };
                let cost = offset.abs() + loyalty + shortness;
                if free >= enough && cost < least {
                    (best, least) = (Some((offset, side)), cost);
                }
                if free > most {
                    (freest, most) = (bearing + offset, free);
                }
            }
        }
        match best {
            Some((offset, side)) => {
                if offset != 0.0 {
                    self.side = side;
                }
                bearing + offset
            }
            None => freest,
        }
    }
}

/// Five degrees.
const STEP: f32 = core::f32::consts::PI / 36.0;

/// Bearing of a map point from `pose`.
fn bearing_of(pose: Pose, point: Point) -> f32 {
    let (dx, dy) = (point.x_mm - pose.x_mm, point.y_mm - pose.y_mm);
    normalised(libm::atan2f(dy, dx) - pose.heading)
}

/// End of an arc at constant wheel speeds after `seconds`, relative to its start.
pub(crate) fn arc_end(body: &Body, [left, right]: [i8; 2], seconds: f32) -> Point {
    let [left, right] = [left, right].map(|wheel| f32::from(wheel) * body.tick_mm_s * seconds);
    let turn = (right - left) / body.axle_mm;
    let (sin, cos) = sin_cos(turn / 2.0);
    let half = turn / 2.0;
    let chord = (left + right) / 2.0 * if half.abs() < 1e-3 { 1.0 } else { sin / half };
    Point::new(chord * cos, chord * sin)
}

#[cfg(test)]
mod tests;
