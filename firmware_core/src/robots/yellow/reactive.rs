//! Driving by three IR sensors alone, without a map.
//!
//! Speed follows the room ahead, turning the difference between left and right (course law); the
//! fielded formula is the one that turned back at corners in the demonstration.

use core::time::Duration;

use protocols::Instant;
use protocols::telemetry::message;

use super::motion::Velocity;

/// How long the robot backs away.
const BACK: Duration = Duration::from_millis(300);
/// Speed of backing away, of the nominal one.
const BACK_PART: f32 = -0.1;
/// Fastest turn.
const TURN_RAD_S: f32 = 2.0;
/// Differences between left and right below this are none.
const SAME_M: f32 = 0.02;
/// Room ahead behind which an escape has ended.
const ROOM_M: f32 = 0.2;
/// More than the nearest distance by this: the robot is not about to touch.
const MARGIN_M: f32 = 0.03;
/// Longest turn of an escape: a whole one at its speed.
const ESCAPE_MAX: Duration = Duration::from_millis(3_200);
/// The fielded program's fastest turn in its formula.
const FIELDED_TURN: f32 = 4.0;

/// What the fielded program did wrong; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Its formula: always at the ends of what is possible, and a little to the left.
    pub fielded_formula: bool,
}

impl Defects {
    /// None.
    pub const NONE: Self = Self {
        fielded_formula: false,
    };
}

/// Figures of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Figures {
    distance_min_m: f32,
    distance_max_m: f32,
    speed_m_s: f32,
    /// rad/s a metre.
    turn_gain: f32,
}

/// What the robot is doing about what it sees.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Drive,
    /// Too near.
    Back {
        until: Instant,
    },
    /// Turns to where there is more room: +1 to the left.
    Escape {
        sign: f32,
        until: Instant,
    },
}

/// The law, and where it is.
#[derive(Clone, Debug)]
pub(super) struct Reactive {
    defects: Defects,
    figures: Figures,
    phase: Phase,
    pub(super) escapes: u32,
}

impl Reactive {
    pub(super) const fn new(defects: Defects) -> Self {
        let speed_m_s = if defects.fielded_formula { 4.0 } else { 0.3 };
        Self {
            defects,
            figures: Figures {
                distance_min_m: 0.1,
                distance_max_m: if defects.fielded_formula {
                    0.6 * speed_m_s
                } else {
                    0.4
                },
                speed_m_s,
                turn_gain: 10.0,
            },
            phase: Phase::Drive,
            escapes: 0,
        }
    }

    /// Takes what the PC wants; what is missing or below zero goes back to the robot's own.
    pub(super) fn order(&mut self, order: &message::Reactive) {
        let own = Self::new(self.defects).figures;
        let is_meant = |it: &f32| it.is_finite() && *it >= 0.0;
        let or = |value: Option<f32>, own| value.filter(is_meant).unwrap_or(own);
        let speed_m_s = or(order.speed_m_s, own.speed_m_s);
        let distance_max_m = match self.defects.fielded_formula {
            true => 0.6 * speed_m_s,
            false => own.distance_max_m,
        };
        self.figures = Figures {
            distance_min_m: or(order.distance_min_m, own.distance_min_m),
            distance_max_m: or(order.distance_max_m, distance_max_m),
            speed_m_s,
            turn_gain: or(order.turn_gain, own.turn_gain),
        };
    }

    /// Begins anew.
    pub(super) const fn begin(&mut self) {
        self.phase = Phase::Drive;
    }

    /// What to do about these distances: ahead, right front, left front, in metres.
    pub(super) fn step(&mut self, now: Instant, distances_m: [f32; 3]) -> Velocity {
        if self.defects.fielded_formula {
            return self.fielded(distances_m);
        }
        let [ahead, right, left] = distances_m;
        let is_near = distances_m
            .iter()
            .any(|it| *it <= self.figures.distance_min_m);
        match self.phase {
            Phase::Back { until } if now >= until => {
                self.phase = self.escape(now, left - right);
            }
            Phase::Escape { until, .. } => {
                let side = self.figures.distance_min_m + MARGIN_M;
                if now >= until || ahead > ROOM_M && right > side && left > side {
                    self.phase = Phase::Drive;
                }
            }
            Phase::Drive if is_near => {
                self.phase = Phase::Back { until: now + BACK };
            }
            // Straight ahead of a wall with as much room left as right, the law would wait.
            Phase::Drive if self.is_stuck(distances_m) => {
                self.phase = self.escape(now, left - right);
            }
            Phase::Drive | Phase::Back { .. } => {}
        }
        match self.phase {
            Phase::Drive => self.drive(distances_m),
            Phase::Back { .. } => Velocity::new(BACK_PART * self.figures.speed_m_s, 0.0),
            Phase::Escape { sign, .. } => Velocity::new(0.0, sign * TURN_RAD_S),
        }
    }

    fn escape(&mut self, now: Instant, more_left_m: f32) -> Phase {
        self.escapes = self.escapes.saturating_add(1);
        Phase::Escape {
            sign: if more_left_m < 0.0 { -1.0 } else { 1.0 },
            until: now + ESCAPE_MAX,
        }
    }

    fn is_stuck(&self, [ahead, right, left]: [f32; 3]) -> bool {
        (left - right).abs() < SAME_M && ahead < self.figures.distance_min_m + 2.0 * MARGIN_M
    }

    fn drive(&self, [ahead, right, left]: [f32; 3]) -> Velocity {
        let Figures {
            distance_min_m: min,
            distance_max_m: max,
            speed_m_s,
            turn_gain,
        } = self.figures;
        if [ahead, right, left].iter().all(|it| *it >= max) {
            return Velocity::new(speed_m_s, 0.0);
        }
        let room = ((ahead - min) / (max - min).max(f32::EPSILON)).clamp(0.0, 1.0);
        let difference = left - right;
        let turn = if difference.abs() < SAME_M {
            0.0
        } else {
            (turn_gain * difference).clamp(-TURN_RAD_S, TURN_RAD_S)
        };
        Velocity::new(speed_m_s * room, turn)
    }

    fn fielded(&self, [ahead, right, left]: [f32; 3]) -> Velocity {
        let Figures {
            distance_min_m: min,
            distance_max_m: max,
            speed_m_s,
            ..
        } = self.figures;
        if [ahead, right, left].iter().all(|it| *it >= max) {
            return Velocity::new(speed_m_s, 0.0);
        }
        if [ahead, right, left].iter().any(|it| *it <= min) {
            return Velocity::new(BACK_PART * speed_m_s, 0.0);
        }
        let linear = 0.3 + 8.0 * speed_m_s * (ahead / max) * (right + left) / (2.0 * max);
        let difference = left - right;
        let turn = match difference.abs() > 0.0 {
            true => 0.1 + 10.0 * FIELDED_TURN * difference / max,
            false => 0.0,
        };
        Velocity::new(linear, turn)
    }
}
