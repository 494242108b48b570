use core::f32::consts::FRAC_PI_2;

use super::budget::Budget;
use crate::pose::Pose;

/// Method of matching and drawing scans.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// The seed report's: random candidates around the predicted pose, whole millimetres and
    /// degrees, both spreads halved after each late improvement; rays from cell to cell.
    Document,
    /// Ours: every pose of the window that the odometry allows, then between the cells; a scan that
    /// contradicts the map is doubted instead of drawn. No random numbers.
    #[default]
    Core,
}

/// Rounding of a blended cell value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rounding {
    /// Towards the drawn value, so that every cell can reach it.
    #[default]
    Corrected,
    /// Down, as in the fielded code: the weight becomes a ceiling (SL-05, SL-06).
    Truncating,
}

/// Dependence of a map update's weight on the difference of the wheels' speeds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fading {
    /// A tenth for each tick (seed figure S5).
    #[default]
    Linear,
    /// The square of that: the report tried it (page 16).
    Quadratic,
}

/// Settings of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Points that are looked up for each pose.
    pub points: u16,
    /// Document mode: first spread of the position, to each side.
    pub spread_mm: u16,
    /// Document mode: first spread of the heading, to each side, in degrees.
    pub spread_deg: u16,
}

/// Whether a person may push the robot unnoticed by its wheels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pushes {
    /// The pose follows a scan that fits much better elsewhere.
    #[default]
    Followed,
    /// An autonomous robot, far from walls that look alike: its wheels may slip, but no person
    /// pushes it.
    Unlikely,
}

/// Choice of the scans that are drawn. Each is drawn with a small error, and the next one is
/// matched to that error. Where many scans see the same walls from nearly the same position, fewer
/// drawn scans therefore drift less.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keyframes {
    /// Number of scans drawn while the robot rests, so that there is a map to match with.
    pub first: u32,
    /// Distance since the last drawn scan, in cells of the map.
    pub cells: f32,
    /// Turn since then, radians.
    pub turn: f32,
    /// Scans since then, if the robot rests: moving objects around it must not stay in the map.
    pub at_rest: u8,
    /// Scans since then in any case.
    pub at_most: u8,
}

impl Keyframes {
    /// Two cells, five degrees, or the fourth scan at rest. With more cells, the pose in a corridor
    /// is drawn back to the end of the known walls.
    pub const SPARSE: Self = Self {
        first: 40,
        cells: 2.0,
        turn: 0.087,
        at_rest: 4,
        at_most: 32,
    };

    /// Every scan.
    pub const ALL: Self = Self {
        first: u32::MAX,
        cells: 0.0,
        turn: 0.0,
        at_rest: 1,
        at_most: 1,
    };
}

/// Defects of the fielded code, to show their effects; all off by default. Numbers are those of the
/// project's list of field defects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The position's spread is halved down to 0 and then divides (SL-01).
    pub spread_reaches_zero: bool,
    /// The heading's spread likewise (SL-02).
    pub heading_spread_reaches_zero: bool,
    /// The tries are not bounded: overruns make them negative, which reads as 65 thousand (SL-03);
    /// scans without points raise them (SL-04).
    pub unbounded_budget: bool,
    /// Cell values are rounded down: the weight is a ceiling (SL-05, SL-06).
    pub truncating_rounding: bool,
    /// Fast turns weaken the map update down to 1 of 256 instead of 3 (SL-05).
    pub weight_down_to_one: bool,
    /// The map update has weight 10 however fast the robot turns (seed figure S5).
    pub constant_weight: bool,
    /// End points outside the map do not count, so one matching point inside wins (SL-10).
    pub outside_is_free: bool,
    /// The score is kept in 16 bits with sign (SL-11).
    pub score_wraps: bool,
    /// Holes shorter than two cells are not drawn (SL-12).
    pub loses_short_holes: bool,
    /// Motion while no scan is drawn is applied with the next drawn scan (SL-14).
    pub saves_up_motion: bool,
    /// The spread is never halved (H-SL-1, before commit 6850670 of the fielded code).
    pub never_narrows: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        spread_reaches_zero: false,
        heading_spread_reaches_zero: false,
        unbounded_budget: false,
        truncating_rounding: false,
        weight_down_to_one: false,
        constant_weight: false,
        outside_is_free: false,
        score_wraps: false,
        loses_short_holes: false,
        saves_up_motion: false,
        never_narrows: false,
    };

    /// Defects of the fielded code.
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
        saves_up_motion: true,
        never_narrows: false,
    };
}

/// Trust in the odometry: standard deviations of a motion as it reports it. The document's search
/// ignores them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionNoise {
    /// Deviation of the position, at rest, in cells of the map: the earlier pose had this error as
    /// well.
    pub rest_cells: f32,
    /// Deviation of the position, per millimetre driven.
    pub per_mm: f32,
    /// Deviation of the position, per radian turned.
    pub mm_per_rad: f32,
    /// Deviation of the heading, at rest.
    pub rest_rad: f32,
    /// Deviation of the heading, per radian turned.
    pub per_rad: f32,
    /// Deviation of the heading, per millimetre driven.
    pub rad_per_mm: f32,
    /// Mean map value, of 255, that one standard deviation costs; it grows with the square.
    pub cost: f32,
    /// Maximum cost of leaving the prediction, so that a pushed robot is found.
    pub cost_max: f32,
}

impl MotionNoise {
    /// A drive with a few per cent of slip.
    pub const WHEELS: Self = Self {
        rest_cells: 0.3,
        per_mm: 0.04,
        mm_per_rad: 30.0,
        rest_rad: 0.003,
        per_rad: 0.15,
        rad_per_mm: 0.000_2,
        cost: 1.0,
        cost_max: 15.0,
    };
}

/// Fixed settings of a mapper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Method of the seed report or ours.
    pub mode: Mode,
    /// Edge of a map cell.
    pub resolution_mm: f32,
    /// Estimated start pose of the robot.
    pub start: Pose,
    /// Seed of the document's random numbers.
    pub seed: u64,
    /// Width of the hole that a beam's end draws into the map.
    pub hole_mm: f32,
    /// Weight of a map update when the robot does not turn, of 256.
    pub weight: u16,
    /// Minimum weight, when the robot turns fast.
    pub weight_min: u16,
    /// Dependence of the weight on the robot's turn rate.
    pub fading: Fading,
    /// Core mode: weight of a beam's free path.
    pub free_weight: u16,
    /// Core mode: weight on a cell that was never drawn.
    pub first_weight: u16,
    /// The search.
    pub search: Search,
    /// Core mode: trust in the odometry.
    pub motion: MotionNoise,
    /// Core mode: other causes of motion.
    pub pushes: Pushes,
    /// Core mode: choice of the drawn scans.
    pub keyframes: Keyframes,
    /// Document mode: the time regulator.
    pub budget: Budget,
    /// Document mode: enabled defects.
    pub defects: Defects,
}

/// Cell size of the seed report's map, mm.
pub const DEFAULT_CELL_MM: f32 = 10.0;

impl Settings {
    /// The seed report's constants for its 3 m x 3 m map, without the defects.
    pub const fn document() -> Self {
        Self {
            mode: Mode::Document,
            resolution_mm: 10.0,
            start: Pose {
                x_mm: 1000.0,
                y_mm: 1000.0,
                heading: FRAC_PI_2,
            },
            seed: 1,
            hole_mm: 350.0,
            weight: 10,
            weight_min: 3,
            fading: Fading::Linear,
            free_weight: 10,
            first_weight: 10,
            search: Search {
                points: 36,
                spread_mm: 100,
                spread_deg: 10,
            },
            motion: MotionNoise::WHEELS,
            pushes: Pushes::Followed,
            keyframes: Keyframes::SPARSE,
            budget: Budget::DOCUMENT,
            defects: Defects::NONE,
        }
    }

    /// The core's settings for cells of `resolution_mm`, the same for every world and log.
    pub const fn core(resolution_mm: f32) -> Self {
        let document = Self::document();
        Self {
            mode: Mode::Core,
            resolution_mm,
            hole_mm: 12.0 * resolution_mm,
            weight: 40,
            weight_min: 12,
            free_weight: 20,
            first_weight: 128,
            search: Search {
                points: 120,
                ..document.search
            },
            ..document
        }
    }

    /// Weight of a map update while the wheels turn at these speeds (left, right; ticks per
    /// 40 ms): a tenth less for each tick between them (seed figure S5).
    pub(super) fn turning_weight(&self, [left, right]: [i16; 2]) -> u16 {
        if self.defects.constant_weight {
            return self.weight;
        }
        let least = if self.defects.weight_down_to_one {
            1
        } else {
            self.weight_min
        };
        let tenths = 10_u16.saturating_sub(left.abs_diff(right));
        let weight = match self.fading {
            Fading::Linear => self.weight * tenths / 10,
            Fading::Quadratic => self.weight * tenths * tenths / 100,
        };
        weight.max(least)
    }
}

impl Default for Settings {
    /// Settings that map the seed report's 3 m x 3 m best at 10 mm.
    fn default() -> Self {
        Self::core(DEFAULT_CELL_MM)
    }
}
