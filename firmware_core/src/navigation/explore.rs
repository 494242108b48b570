use core::f32::consts::FRAC_PI_2;

use super::{HALT, Settings, Surroundings, ticks};

/// Settings of the wall follower and of the avoider before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallFollowing {
    /// Distance to the wall on the left that is kept, along a beam 50 degrees left of ahead.
    pub beam_mm: f32,
    /// Strongest turn towards a wall that is too far, in tens of millimetres.
    pub towards_max: f32,
    /// A wall farther than this along the beam is not followed.
    pub lost_mm: f32,
    /// What is nearer than this ahead is turned away from.
    pub front_mm: f32,
}

impl WallFollowing {
    /// The seed report's: 260 mm, full turns both ways, obstacles within 300 mm.
    pub const DOCUMENT: Self = Self {
        beam_mm: 260.0,
        towards_max: 20.0,
        lost_mm: f32::INFINITY,
        front_mm: 300.0,
    };

    /// Wider bends around corners, and a little more room.
    pub const GENTLE: Self = Self {
        beam_mm: 320.0,
        towards_max: 13.0,
        lost_mm: 700.0,
        front_mm: 330.0,
    };

    /// The seed report's rule: reg = (260 - distance) / 10, left = 20 + reg within 0 to 20, right =
    /// 20 - reg within -20 to 20.
    pub fn follow(&self, distance_mm: f32) -> [i8; 2] {
        let reg = ((self.beam_mm - distance_mm) / 10.0).max(-self.towards_max);
        [
            ticks((20.0 + reg).clamp(0.0, 20.0)),
            ticks((20.0 - reg).clamp(-20.0, 20.0)),
        ]
    }
}

/// Direction of the beam that measures the wall.
const WALL_BEARING: f32 = 50.0 * DEGREE;
/// Beams this far beside it help if it has no reading.
const WALL_SPREAD: f32 = 3.0 * DEGREE;
/// Scans for which a wall that got lost is looked for in a bend: half a turn.
const SEARCH_SCANS: u8 = 25;
/// A turn away from an obstacle goes on until this much more is free.
const HYSTERESIS_MM: f32 = 60.0;

const DEGREE: f32 = core::f32::consts::PI / 180.0;

/// Turns on the spot, as the fielded robot's avoider did.
const TURN: i8 = 9;

/// Follows walls on the left, turns away from what is in front.
#[derive(Clone, Debug)]
pub struct Explorer {
    /// Direction of a turn that is not finished: 1 left, -1 right, 0 none.
    turning: i8,
    scans_without_wall: u8,
}

impl Explorer {
    pub(super) const fn new() -> Self {
        Self {
            turning: 0,
            scans_without_wall: SEARCH_SCANS,
        }
    }

    pub(super) fn step(&mut self, settings: &Settings, around: &Surroundings) -> [i8; 2] {
        // Field defect XV-11: with every beam invalid the fielded robot drove straight ahead.
        if around.is_blind() {
            return HALT;
        }
        let wall = &settings.wall;
        let (left, right) = front_mm(settings, around);
        let near = if self.turning == 0 {
            wall.front_mm
        } else {
            wall.front_mm + HYSTERESIS_MM
        };
        if left.min(right) < near {
            if self.turning == 0 {
                self.turning = if left <= right { -1 } else { 1 };
            }
            self.scans_without_wall = 0;
            return [-TURN * self.turning, TURN * self.turning];
        }
        self.turning = 0;
        match around.nearest_mm(WALL_BEARING - WALL_SPREAD, WALL_BEARING + WALL_SPREAD) {
            Some(distance) if distance <= wall.lost_mm => {
                self.scans_without_wall = 0;
                wall.follow(distance)
            }
            _ if self.scans_without_wall < SEARCH_SCANS => {
                self.scans_without_wall += 1;
                wall.follow(wall.lost_mm.min(1000.0))
            }
            _ => [20, 20],
        }
    }
}

/// Nearest distances ahead, left and right of the middle, within the width that the body sweeps.
fn front_mm(settings: &Settings, around: &Surroundings) -> (f32, f32) {
    let half = settings.body.radius_mm + settings.body.clearance_mm / 2.0;
    let mut nearest = (f32::INFINITY, f32::INFINITY);
    for (point, range) in around.points() {
        let bearing = libm::atan2f(point.y_mm, point.x_mm);
        if point.y_mm.abs() > half || bearing.abs() > FRAC_PI_2 {
            continue;
        }
        let side = if point.y_mm >= 0.0 {
            &mut nearest.0
        } else {
            &mut nearest.1
        };
        *side = side.min(range);
    }
    nearest
}
