//! Speeds of the robot, limited to the acceleration of its wheels.

/// Actual or target motion of the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Velocity {
    /// Ahead, m/s.
    pub linear_m_s: f32,
    /// To the left, rad/s.
    pub angular_rad_s: f32,
}

impl Velocity {
    /// Standstill.
    pub const ZERO: Self = Self::new(0.0, 0.0);

    /// A velocity of these speeds.
    pub const fn new(linear_m_s: f32, angular_rad_s: f32) -> Self {
        Self {
            linear_m_s,
            angular_rad_s,
        }
    }

    /// Whether both values are finite.
    pub(super) fn is_finite(self) -> bool {
        self.linear_m_s.is_finite() && self.angular_rad_s.is_finite()
    }
}

/// Maximum speeds (public code of the robot, `Motion`).
const LINEAR_MAX_M_S: f32 = 4.0;
const ANGULAR_MAX_RAD_S: f32 = 3.0;
/// Maximum accelerations, from the same source.
const ACCELERATION_M_S2: f32 = 1.5;
const DECELERATION_M_S2: f32 = 3.0;
const ANGULAR_RAD_S2: f32 = 15.0;

/// One step of `seconds` from `velocity` towards `target`.
pub(super) fn approach(velocity: Velocity, target: Velocity, seconds: f32) -> Velocity {
    let linear = target.linear_m_s.clamp(-LINEAR_MAX_M_S, LINEAR_MAX_M_S);
    let angular = target
        .angular_rad_s
        .clamp(-ANGULAR_MAX_RAD_S, ANGULAR_MAX_RAD_S);
    let up = ACCELERATION_M_S2 * seconds;
    let down = DECELERATION_M_S2 * seconds;
    let turn = ANGULAR_RAD_S2 * seconds;
    Velocity {
        linear_m_s: towards(velocity.linear_m_s, linear, up, down),
        angular_rad_s: towards(velocity.angular_rad_s, angular, turn, turn),
    }
}

/// Moves by at most `up` away from zero, or `down` towards it; one step does not cross zero.
fn towards(now: f32, target: f32, up: f32, down: f32) -> f32 {
    let slows_down = now * (target - now) < 0.0;
    let most = if slows_down { down } else { up };
    let next = now + (target - now).clamp(-most, most);
    if slows_down && next * now < 0.0 {
        return 0.0;
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(from: f32, to: f32, steps: u32) -> f32 {
        let mut velocity = Velocity::new(from, 0.0);
        for _ in 0..steps {
            velocity = approach(velocity, Velocity::new(to, 0.0), 0.001);
        }
        velocity.linear_m_s
    }

    /// By hand: speeding up to 0.5 m/s at 1.5 m/s2 takes 333 ms; stopping at 3.0 m/s2 takes 167 ms;
    /// a reversal from 0.3 to -0.3 takes 100 ms down and 200 ms up.
    #[test]
    fn speeding_up_takes_twice_as_long_as_slowing_down() {
        assert!((run(0.0, 0.5, 200) - 0.3).abs() < 1e-4);
        assert!((run(0.0, 0.5, 334) - 0.5).abs() < 1e-6);
        assert!((run(0.5, 0.0, 100) - 0.2).abs() < 1e-4);
        assert!(run(0.5, 0.0, 167).abs() < 1e-6);
        assert!((run(0.3, -0.3, 200) + 0.15).abs() < 3e-3);
        assert!((run(0.3, -0.3, 301) + 0.3).abs() < 1e-3);
    }

    #[test]
    fn speeds_are_bounded() {
        let mut velocity = Velocity::ZERO;
        for _ in 0..4_000 {
            velocity = approach(velocity, Velocity::new(9.0, -9.0), 0.001);
        }
        assert_eq!(velocity, Velocity::new(4.0, -3.0));
    }

    #[test]
    fn a_speed_that_is_no_number_is_none() {
        assert!(Velocity::new(1.0, -1.0).is_finite());
        assert!(!Velocity::new(f32::NAN, 0.0).is_finite());
        assert!(!Velocity::new(0.0, f32::INFINITY).is_finite());
    }

    /// 15 rad/s2 for a hundredth of a second change the turn rate by 0.15 rad/s in either
    /// direction, but not past the target.
    #[test]
    fn turning_gathers_speed_and_loses_it_alike() {
        let turned = |from, to| {
            let velocity = approach(Velocity::new(0.0, from), Velocity::new(0.0, to), 0.01);
            velocity.angular_rad_s
        };
        let is = |found: f32, expected: f32| (found - expected).abs() < 1e-6;
        assert!(is(turned(0.0, 2.0), 0.15) && is(turned(0.0, -2.0), -0.15));
        assert!(is(turned(1.0, 0.0), 0.85) && is(turned(-1.0, 0.0), -0.85));
        assert!(is(turned(0.0, 0.1), 0.1) && is(turned(0.1, -0.2), 0.0));
        assert!(is(turned(2.95, 9.0), 3.0) && is(turned(-2.95, -9.0), -3.0));
    }
}
