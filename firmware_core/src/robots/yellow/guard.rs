//! Protection of manoeuvres against walls. A pose may be wrong without notice: then a goal may lie
//! behind a wall that the IR sensor ahead sees.

use core::time::Duration;

use protocols::Instant;

use super::motion::Velocity;

/// Speed per room ahead, 1/s: from 0.5 m/s the robot stops within 9 cm, mostly because of the
/// sensor's delay.
const GAIN: f32 = 3.0;
/// Distance that counts as no room: below 7 cm the sensor reads too far.
const NEAR_M: f32 = 0.1;
/// Time for which a near wall counts after its last reading.
const HELD: Duration = Duration::from_secs(1);
/// Speed at which a touch does no harm, so that goals beside a wall can be reached.
const CREEP_M_S: f32 = 0.04;

/// Time until which a wall ahead counts as near.
#[derive(Clone, Debug)]
pub(super) struct Guard {
    near_until: Instant,
}

impl Guard {
    pub(super) const NEW: Self = Self {
        near_until: Instant::ZERO,
    };

    /// `wanted`, with its forward speed limited by the room of `ahead_m`.
    pub(super) fn limited(&mut self, now: Instant, ahead_m: f32, wanted: Velocity) -> Velocity {
        if ahead_m <= NEAR_M {
            self.near_until = now + HELD;
        }
        let room_m = if now < self.near_until {
            0.0
        } else {
            ahead_m - NEAR_M
        };
        let most = (GAIN * room_m).max(CREEP_M_S);
        Velocity {
            linear_m_s: wanted.linear_m_s.min(most),
            ..wanted
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 3 times the room beyond 10 cm, and 4 cm/s.
    #[test]
    fn speed_follows_the_room_ahead() {
        let mut guard = Guard::NEW;
        let now = Instant::from_millis(1_000);
        let wanted = Velocity::new(0.5, 1.5);
        let speed = |guard: &mut Guard, ahead_m| guard.limited(now, ahead_m, wanted).linear_m_s;
        assert_eq!(speed(&mut guard, 0.8), 0.5);
        assert!((speed(&mut guard, 0.2) - 0.3).abs() < 1e-6);
        assert_eq!(speed(&mut guard, 0.11), CREEP_M_S);
        let back = Velocity::new(-0.1, 0.0);
        assert_eq!(guard.limited(now, 0.05, back), back);
    }

    /// A wall at 3 cm reads like one at 17 cm: it counts as near for a second more.
    #[test]
    fn a_wall_that_was_near_stays_so_for_a_second() {
        let mut guard = Guard::NEW;
        let wanted = Velocity::new(0.5, 0.0);
        let speed = |guard: &mut Guard, ms, ahead_m| {
            guard
                .limited(Instant::from_millis(ms), ahead_m, wanted)
                .linear_m_s
        };
        assert_eq!(speed(&mut guard, 1_000, 0.09), CREEP_M_S);
        assert_eq!(speed(&mut guard, 1_999, 0.8), CREEP_M_S);
        assert_eq!(speed(&mut guard, 2_000, 0.8), 0.5);
    }
}
