//! Driving by three IR sensors alone, without a map. Only the speed is limited by the lidar.
//!
//! The speed depends on the room ahead, the turn on the difference between left and right (course
//! law). With the fielded formula the robot turned back at corners in the demonstration.

use core::time::Duration;

use protocols::Instant;
use protocols::telemetry::message;

use super::motion::Velocity;

/// Duration of backing away.
const BACK: Duration = Duration::from_millis(300);
/// Speed of backing away, relative to the nominal speed.
const BACK_PART: f32 = -0.1;
/// Fastest turn.
const TURN_RAD_S: f32 = 2.0;
/// Differences between left and right below this count as 0.
const SAME_M: f32 = 0.02;
/// Room ahead at which an escape ends.
const ROOM_M: f32 = 0.2;
/// Margin above the nearest distance: the robot is not about to touch.
const MARGIN_M: f32 = 0.03;
/// Maximum duration of an escape: a whole turn at its speed.
const ESCAPE_MAX: Duration = Duration::from_millis(3_200);
/// The fastest turn in the fielded program's formula.
const FIELDED_TURN: f32 = 4.0;

/// Enabled defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The fielded formula: always at the limits of the speeds, and a little to the left.
    pub fielded_formula: bool,
}

impl Defects {
    /// No defects.
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
    /// Turn rate per metre of difference, rad/s.
    turn_gain: f32,
}

/// Current reaction to the distances.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Drive,
    /// Backs away from an obstacle that is too near.
    Back {
        until: Instant,
    },
    /// Turns to the side with more room: +1 to the left.
    Escape {
        sign: f32,
        until: Instant,
    },
}

/// The law and its state.
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

    /// Takes the PC's figures; missing or negative ones return to the robot's defaults.
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

    /// Restarts the law.
    pub(super) const fn begin(&mut self) {
        self.phase = Phase::Drive;
    }

    /// Velocity for these distances: ahead, right front, left front, in metres.
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
            // Straight ahead of a wall with equal room on both sides the law would stop forever.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::ZERO + Duration::from_millis(ms)
    }

    fn law() -> Reactive {
        Reactive::new(Defects::NONE)
    }

    /// With 0.4 m or more ahead the robot drives at 0.3 m/s; from 0.4 to 0.1 m the speed falls
    /// linearly. It turns at 10 rad/s for each metre of difference between left and right, at most
    /// at 2 rad/s; a difference of less than 2 cm counts as 0.
    #[test]
    fn speed_follows_the_room_ahead_and_the_turn_the_difference() {
        let is = |distances_m, linear: f32, angular: f32| {
            let found = law().step(at(0), distances_m);
            (found.linear_m_s - linear).abs() < 1e-5 && (found.angular_rad_s - angular).abs() < 1e-4
        };
        assert!(is([0.4, 0.4, 0.4], 0.3, 0.0) && is([1.0, 0.4, 0.9], 0.3, 0.0));
        assert!(is([0.25, 0.3, 0.3], 0.15, 0.0) && is([0.2, 0.3, 0.4], 0.1, 1.0));
        assert!(is([0.25, 0.35, 0.3], 0.15, -0.5) && is([0.25, 0.3, 0.319], 0.15, 0.0));
        assert!(is([0.25, 0.2, 0.5], 0.15, 2.0) && is([0.25, 0.5, 0.2], 0.15, -2.0));
        assert!(is([0.7, 0.3, 0.35], 0.3, 0.5));
    }

    /// At 0.1 m on any side the robot backs away with a tenth of its speed for 0.3 s, then turns to
    /// the side with more room, for at most 3.2 s.
    #[test]
    fn what_is_too_near_is_left_backwards_and_turned_away_from() {
        for near in [[0.1, 0.3, 0.4], [0.3, 0.1, 0.4], [0.3, 0.4, 0.1]] {
            let mut law = law();
            let back = Velocity::new(-0.1 * 0.3, 0.0);
            assert_eq!([law.step(at(0), near), law.step(at(299), near)], [back; 2]);
            let sign = if near[2] < near[1] { -1.0 } else { 1.0 };
            let turn = Velocity::new(0.0, 2.0 * sign);
            assert_eq!(
                [law.step(at(300), near), law.step(at(3_499), near)],
                [turn; 2]
            );
            assert_eq!(law.escapes, 1);
            assert!(law.step(at(3_500), [0.25, 0.3, 0.3]).linear_m_s > 0.1);
        }
        assert!(law().step(at(0), [0.101, 0.101, 0.2]).linear_m_s >= 0.0);
    }

    /// An escape ends with more than 0.2 m ahead and more than 0.13 m on both sides.
    #[test]
    fn an_escape_ends_where_there_is_room() {
        let ends = |distances_m: [f32; 3]| {
            let mut law = law();
            law.step(at(0), [0.1, 0.3, 0.3]);
            law.step(at(300), [0.1, 0.3, 0.3]);
            law.step(at(400), distances_m).linear_m_s > 0.0
        };
        assert!(ends([0.21, 0.14, 0.14]));
        assert!(!ends([0.2, 0.14, 0.14]) && !ends([0.21, 0.12, 0.14]) && !ends([0.21, 0.14, 0.12]));
    }

    /// Nearer than 0.16 m to a wall straight ahead, with equal room on both sides, the law would
    /// stop the robot. So the robot turns to the left at once.
    #[test]
    fn straight_before_a_wall_it_turns() {
        let mut law = law();
        let turn = Velocity::new(0.0, 2.0);
        assert_eq!(law.step(at(0), [0.15, 0.3, 0.31]), turn);
        assert_eq!(law.escapes, 1);
        let mut law = self::law();
        assert!(law.step(at(0), [0.165, 0.3, 0.31]).linear_m_s > 0.0);
        assert!(law.step(at(0), [0.15, 0.3, 0.33]).linear_m_s > 0.0);
        assert_eq!(law.escapes, 0);
    }

    /// By hand, with the full speed of 4 m/s from 2.4 m on. With 1.2 m on all sides the speed is
    /// 0.3 + 32 * 0.5 * 2.4 / 4.8 = 8.3 m/s. With half a metre more on the left, the robot turns at
    /// 0.1 + 40 * 0.5 / 2.4 rad/s and drives at 0.3 + 16 * 2.9 / 4.8 m/s.
    #[test]
    fn the_fielded_formula_is_at_the_ends_of_what_is_possible() {
        let told = |distances_m| {
            let mut law = Reactive::new(Defects {
                fielded_formula: true,
            });
            let found = law.step(at(0), distances_m);
            [found.linear_m_s, found.angular_rad_s]
        };
        let is = |found: [f32; 2], expected: [f32; 2]| {
            (found[0] - expected[0]).abs() < 1e-4 && (found[1] - expected[1]).abs() < 1e-4
        };
        assert!(is(told([2.4, 2.4, 2.5]), [4.0, 0.0]));
        assert!(is(told([1.2, 1.2, 1.2]), [8.3, 0.0]));
        assert!(is(
            told([1.2, 1.2, 1.7]),
            [0.3 + 16.0 * 2.9 / 4.8, 0.1 + 20.0 / 2.4]
        ));
        assert!(is(
            told([1.2, 1.7, 1.2]),
            [0.3 + 16.0 * 2.9 / 4.8, 0.1 - 20.0 / 2.4]
        ));
        assert!(is(told([1.2, 0.1, 1.2]), [-0.4, 0.0]));
    }

    /// A restarted law drives, independent of its earlier phase.
    #[test]
    fn a_law_that_begins_anew_drives() {
        let mut law = law();
        let back = law.step(at(0), [0.1, 0.1, 0.1]);
        assert!(back.linear_m_s < 0.0);
        law.begin();
        assert_eq!(law.step(at(1), [0.9; 3]), Velocity::new(0.3, 0.0));
    }

    /// By hand: the speed is 0.3 m/s and 8 times 4 m/s, times the share of room ahead, 1.2 of 2.4
    /// m, and that on both sides, 0.5: 8.3 m/s in all. More room on the left turns the robot by 40
    /// / 2.4 rad/s a metre.
    #[test]
    fn the_fielded_formula_runs_to_its_ends() {
        let mut law = Reactive::new(Defects {
            fielded_formula: true,
        });
        let is = |found: Velocity, linear: f32, angular: f32| {
            (found.linear_m_s - linear).abs() < 1e-4 && (found.angular_rad_s - angular).abs() < 1e-3
        };
        assert!(is(law.step(at(0), [2.4, 2.4, 2.4]), 4.0, 0.0));
        assert!(is(law.step(at(0), [0.1, 2.0, 2.0]), -0.4, 0.0));
        assert!(is(law.step(at(0), [1.2, 1.2, 1.2]), 8.3, 0.0));
        assert!(is(law.step(at(0), [1.2, 0.9, 1.5]), 8.3, 0.1 + 10.0));
        assert!(is(
            law.step(at(0), [0.6, 1.5, 0.9]),
            0.3 + 32.0 * 0.25 * 0.5,
            0.1 - 10.0
        ));
    }

    /// Less than 2 cm of difference, and less than 0.16 m ahead: at each limit itself the robot is
    /// not stuck.
    #[test]
    fn a_robot_is_stuck_straight_before_a_wall() {
        let law = law();
        assert!(law.is_stuck([0.159, 0.3, 0.3]) && law.is_stuck([0.159, 0.0, 0.019]));
        assert!(law.is_stuck([0.159, 0.019, 0.0]));
        assert!(!law.is_stuck([0.159, 0.0, 0.02]) && !law.is_stuck([0.159, 0.02, 0.0]));
        assert!(!law.is_stuck([0.1 + 2.0 * 0.03, 0.3, 0.3]));
    }
}
