use core::f32::consts::FRAC_PI_2;

use super::budget::Budget;
use crate::pose::Pose;

/// How a scan finds its place in the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The seed report's: random candidates around the predicted pose, whole millimetres and
    /// degrees, both spreads halved after each late improvement.
    Document,
    /// The same number of tries, spent better: the spread shrinks on a schedule, candidates are
    /// continuous and drawn around the best so far, the prediction has a say, and the last tries
    /// look at more points.
    Annealed,
}

/// How a blended cell value is rounded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rounding {
    /// Towards the drawn value, so that every cell can reach it.
    #[default]
    Corrected,
    /// Down, as in the fielded code: the weight becomes a ceiling (SL-05, SL-06).
    Truncating,
}

/// Settings of the candidate search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// How candidates are made.
    pub method: Method,
    /// First spread of the position, to each side.
    pub spread_mm: u16,
    /// First spread of the heading, to each side, in degrees.
    pub spread_deg: u16,
    /// Points that a try looks at.
    pub points: u16,
}

/// Faults of the fielded code, to show what they do; all off by default. Numbers are those of the
/// project's list of field defects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The position's spread is halved down to 0 and then divides (SL-01).
    pub spread_reaches_zero: bool,
    /// The heading's spread likewise (SL-02).
    pub heading_spread_reaches_zero: bool,
    /// The tries are not bounded: overruns make them negative, which reads as 65 thousand
    /// (SL-03), blackouts wind them up (SL-04).
    pub unbounded_budget: bool,
    /// Cell values are rounded down: the weight is a ceiling (SL-05, SL-06).
    pub truncating_rounding: bool,
    /// Fast turns weaken the map update down to 1 of 256 instead of 3 (SL-05).
    pub weight_down_to_one: bool,
    /// The map update has weight 10 however fast the robot turns (seed figure S5).
    pub constant_weight: bool,
    /// End points outside the map do not count, so one good one inside wins (SL-10).
    pub outside_is_free: bool,
    /// The score is kept in 16 bits with sign (SL-11).
    pub score_wraps: bool,
    /// Holes shorter than two cells are not drawn (SL-12).
    pub loses_short_holes: bool,
    /// The spread is never halved (H-SL-1, before commit 6850670 of the fielded code).
    pub never_narrows: bool,
}

impl Defects {
    /// As the fielded code was.
    pub const FIELDED: Self = Self {
        spread_reaches_zero: true,
        heading_spread_reaches_zero: false,
        unbounded_budget: true,
        truncating_rounding: true,
        weight_down_to_one: true,
        constant_weight: false,
        outside_is_free: true,
        score_wraps: true,
        loses_short_holes: true,
        never_narrows: false,
    };
}

/// How far the odometry is believed: standard deviations of a motion as it reports it. The
/// document's search does without.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionNoise {
    /// Of the position, at rest.
    pub rest_mm: f32,
    /// Of the position, per millimetre driven.
    pub per_mm: f32,
    /// Of the heading, at rest.
    pub rest_rad: f32,
    /// Of the heading, per radian turned.
    pub per_rad: f32,
    /// Of the heading, per millimetre driven.
    pub rad_per_mm: f32,
    /// Mean map value, of 255, that one standard deviation costs; it grows with the square.
    pub cost: f32,
    /// The most that leaving the prediction costs, so that a robot that was pushed is found.
    pub cost_max: f32,
}

impl MotionNoise {
    /// A drive with a few per cent of slip.
    pub const WHEELS: Self = Self {
        rest_mm: 2.0,
        per_mm: 0.04,
        rest_rad: 0.003,
        per_rad: 0.04,
        rad_per_mm: 0.000_1,
        cost: 0.5,
        cost_max: 15.0,
    };
}

/// Everything that a mapper is told once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Edge of a map cell.
    pub resolution_mm: f32,
    /// Where the robot believes to start.
    pub start: Pose,
    /// Of the search's random numbers.
    pub seed: u64,
    /// Width of the hole that a beam's end draws into the map.
    pub hole_mm: f32,
    /// Weight of a map update when the robot does not turn, of 256.
    pub weight: u16,
    /// Least weight, reached when the wheels' speeds differ by seven ticks per 40 ms.
    pub weight_min: u16,
    /// Scans at the start that are drawn more strongly, so that the map stands before the robot
    /// moves: the n-th with at least 256 / (n + 1).
    pub bold_scans: u16,
    /// The candidate search.
    pub search: Search,
    /// Trust in the odometry.
    pub motion: MotionNoise,
    /// The time regulator.
    pub budget: Budget,
    /// Faults to show.
    pub defects: Defects,
}

impl Settings {
    /// The seed report's constants for its 3 m x 3 m map, without the defects.
    pub fn document() -> Self {
        Self {
            resolution_mm: 10.0,
            start: Pose::new(1000.0, 1000.0, FRAC_PI_2),
            seed: 1,
            hole_mm: 350.0,
            weight: 10,
            weight_min: 3,
            bold_scans: 0,
            search: Search {
                method: Method::Document,
                spread_mm: 100,
                spread_deg: 10,
                points: 36,
            },
            motion: MotionNoise::WHEELS,
            budget: Budget::DOCUMENT,
            defects: Defects::default(),
        }
    }
}

impl Default for Settings {
    /// What maps best within the seed report's time and memory.
    fn default() -> Self {
        let document = Self::document();
        Self {
            hole_mm: 100.0,
            bold_scans: 10,
            search: Search {
                method: Method::Annealed,
                ..document.search
            },
            ..document
        }
    }
}
