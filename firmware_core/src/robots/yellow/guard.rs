//! Protection of manoeuvres against walls. A pose may be wrong without notice: then a goal may lie
//! behind a wall that the IR sensor ahead sees. The end of a wall beside the path may be missing in
//! the map, and only the lidar sees it.

use core::time::Duration;

use protocols::Instant;

use super::motion::Velocity;
use crate::pose::sin_cos;

/// Speed per room ahead, 1/s: from 0.5 m/s the robot stops within 9 cm, mostly because of the
/// sensor's delay.
const GAIN: f32 = 3.0;
/// Distance that counts as no room: below 7 cm the sensor reads too far.
const NEAR_M: f32 = 0.1;
/// Time for which a near wall counts after its last reading.
const HELD: Duration = Duration::from_secs(1);
/// Speed at which a touch does no harm, so that goals beside a wall can be reached.
const CREEP_M_S: f32 = 0.04;

/// Radius of the deck with 1 cm of room beside it, mm.
const DECK_MM: f32 = 130.0;
/// Distance up to which the lidar's points count, mm: at the largest speed the robot needs less.
const LOOKS_MM: f32 = 600.0;
/// Speed per room before the deck, 1/s, and the distance that counts as no room: a point may be as
/// old as a turn of the lidar.
const DECK_GAIN: f32 = 2.0;
const DECK_NEAR_M: f32 = 0.02;
/// Time for which a point counts: a turn of the lidar takes up to a fifth of a second.
const POINT: Duration = Duration::from_millis(250);
/// Room before the deck at which a point may vanish because the lidar measures from 150 mm on. It
/// then counts as no room for [`HELD`] more.
const VANISHES_M: f32 = 0.08;
/// Time without a reading of the lidar, with or without a distance, that is a silence.
const SILENT: Duration = Duration::from_millis(100);

/// Time until which a wall ahead counts as near.
#[derive(Clone, Debug)]
pub(super) struct Guard {
    near_until: Instant,
}

/// The nearest point of the lidar in the strip that the deck sweeps when the robot drives ahead.
#[derive(Clone, Copy, Debug)]
pub(super) struct Strip {
    nearest: Option<(Instant, f32)>,
    /// Time of the last reading.
    heard: Instant,
    /// Time of the last limit, and the forward speed since then.
    limited: (Instant, f32),
}

impl Strip {
    pub(super) const fn new() -> Self {
        Self {
            nearest: None,
            heard: Instant::ZERO,
            limited: (Instant::ZERO, 0.0),
        }
    }

    /// Takes a reading of the lidar at `angle_q6`, 64ths of a degree clockwise from ahead.
    pub(super) fn take(&mut self, now: Instant, angle_q6: u16, distance_mm: Option<f32>) {
        self.heard = now;
        let Some(distance_mm) = distance_mm else {
            return;
        };
        if !(1.0..LOOKS_MM).contains(&distance_mm) {
            return;
        }
        let (sin, cos) = sin_cos((f32::from(angle_q6) / 64.0).to_radians());
        let (ahead_mm, beside_mm) = (distance_mm * cos, distance_mm * sin);
        let across = DECK_MM * DECK_MM - beside_mm * beside_mm;
        if ahead_mm <= 0.0 || across <= 0.0 {
            return;
        }
        let room_m = (ahead_mm - libm::sqrtf(across)) / 1_000.0;
        if self.room_m(now).is_none_or(|known| room_m <= known) {
            self.nearest = Some((now, room_m));
        }
    }

    /// The room before the deck, metres; `None`: nothing is near.
    fn room_m(&self, now: Instant) -> Option<f32> {
        let (at, room_m) = self.nearest?;
        let is_held = || room_m <= VANISHES_M && now - at < POINT + HELD;
        match now - at < POINT {
            true => Some(room_m),
            false => is_held().then_some(0.0),
        }
    }

    /// `wanted`, with its forward speed limited by the room before the deck. While the lidar is
    /// silent, the point that it measured last stays, and comes nearer as the robot drives.
    pub(super) fn limited(&mut self, now: Instant, wanted: Velocity) -> Velocity {
        let (before, speed_m_s) = self.limited;
        let silence = now - self.heard;
        if let Some((at, room_m)) = &mut self.nearest
            && silence >= SILENT
        {
            let passed = (now - before).min(silence);
            *at += passed;
            *room_m -= speed_m_s * passed.as_secs_f32();
        }
        let room_m = self.room_m(now);
        let most = room_m.map(|room_m| (DECK_GAIN * (room_m - DECK_NEAR_M)).max(CREEP_M_S));
        let linear_m_s = most.map_or(wanted.linear_m_s, |most| wanted.linear_m_s.min(most));
        self.limited = (now, linear_m_s.max(0.0));
        Velocity {
            linear_m_s,
            ..wanted
        }
    }
}

impl Guard {
    pub(super) const NEW: Self = Self {
        near_until: Instant::ZERO,
    };

    /// `wanted`, with its forward speed limited by the room of `ahead_m` and that before the deck.
    pub(super) fn limited(
        &mut self,
        now: Instant,
        ahead_m: f32,
        strip: &mut Strip,
        wanted: Velocity,
    ) -> Velocity {
        if ahead_m <= NEAR_M {
            self.near_until = now + HELD;
        }
        let room_m = if now < self.near_until {
            0.0
        } else {
            ahead_m - NEAR_M
        };
        let most = (GAIN * room_m).max(CREEP_M_S);
        let wanted = Velocity {
            linear_m_s: wanted.linear_m_s.min(most),
            ..wanted
        };
        strip.limited(now, wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: the speed is 3 times the room beyond 10 cm, but not less than 4 cm/s.
    #[test]
    fn speed_follows_the_room_ahead() {
        let mut guard = Guard::NEW;
        let now = Instant::from_millis(1_000);
        let wanted = Velocity::new(0.5, 1.5);
        let speed = |guard: &mut Guard, ahead_m| {
            guard
                .limited(now, ahead_m, &mut Strip::new(), wanted)
                .linear_m_s
        };
        assert_eq!(speed(&mut guard, 0.8), 0.5);
        assert!((speed(&mut guard, 0.2) - 0.3).abs() < 1e-6);
        assert_eq!(speed(&mut guard, 0.11), CREEP_M_S);
        let back = Velocity::new(-0.1, 0.0);
        assert_eq!(guard.limited(now, 0.05, &mut Strip::new(), back), back);
    }

    /// A wall at 3 cm reads like one at 17 cm: it counts as near for a second more.
    #[test]
    fn a_wall_that_was_near_stays_so_for_a_second() {
        let mut guard = Guard::NEW;
        let wanted = Velocity::new(0.5, 0.0);
        let speed = |guard: &mut Guard, ms, ahead_m| {
            guard
                .limited(Instant::from_millis(ms), ahead_m, &mut Strip::new(), wanted)
                .linear_m_s
        };
        assert_eq!(speed(&mut guard, 1_000, 0.09), CREEP_M_S);
        assert_eq!(speed(&mut guard, 1_999, 0.8), CREEP_M_S);
        assert_eq!(speed(&mut guard, 2_000, 0.8), 0.5);
    }

    /// By hand: 300 mm ahead and 50 mm beside, the deck of 130 mm touches after 300 - 120 mm, so
    /// that 2 times (180 - 20) mm are the speed. A point beside the deck or behind it is not in the
    /// way; a nearer point counts at once, a farther one after a quarter of a second.
    #[test]
    fn speed_follows_the_room_before_the_deck() {
        let mut guard = Guard::NEW;
        let mut strip = Strip::new();
        let wanted = Velocity::new(0.5, 0.0);
        let mut is = |strip: &mut Strip, ms: u64, expected: f32| {
            let now = Instant::from_millis(ms);
            strip.heard = now;
            let limited = guard.limited(now, 0.8, strip, wanted);
            (limited.linear_m_s - expected).abs() < 0.003
        };
        let take = |strip: &mut Strip, ms: u64, angle_q6: u16, distance_mm: f32| {
            strip.take(Instant::from_millis(ms), angle_q6, Some(distance_mm));
        };
        // 131 mm beside, behind, and too far; then 300 mm ahead and 50 mm to the right.
        for (angle_q6, distance_mm) in
            [(1_510, 327.4), (21_530, 327.4), (11_520, 300.0), (0, 601.0)]
        {
            take(&mut strip, 1_000, angle_q6, distance_mm);
        }
        assert!(is(&mut strip, 1_000, 0.5));
        take(&mut strip, 1_000, 606, 304.1);
        assert!(is(&mut strip, 1_000, 0.32));
        // 400 mm ahead and 50 mm to the left.
        take(&mut strip, 1_010, 22_584, 403.1);
        assert!(is(&mut strip, 1_249, 0.32) && is(&mut strip, 1_250, 0.5));
        take(&mut strip, 1_300, 22_584, 403.1);
        take(&mut strip, 1_310, 22_434, 304.1);
        assert!(is(&mut strip, 1_310, 0.32));
        // 120 mm ahead, 50 mm to the right: the deck touches.
        take(&mut strip, 1_320, 1_448, 130.0);
        assert!(is(&mut strip, 1_320, CREEP_M_S));
    }

    /// The lidar does not measure below 150 mm. A point at 160 mm straight ahead leaves 30 mm, 0.02
    /// m/s at a gain of 2, and counts for a second more; a point at 215 mm, with 85 mm, does not.
    #[test]
    fn a_point_that_may_be_too_near_to_be_seen_counts_for_a_second_more() {
        let mut guard = Guard::NEW;
        let wanted = Velocity::new(0.5, 0.0);
        let mut speed = |distance_mm: f32, after_ms: u64| {
            let mut strip = Strip::new();
            strip.take(Instant::from_millis(1_000), 0, Some(distance_mm));
            let now = Instant::from_millis(1_000 + after_ms);
            strip.take(now, 11_520, None);
            guard.limited(now, 0.8, &mut strip, wanted).linear_m_s
        };
        assert_eq!(speed(160.0, 0), CREEP_M_S);
        assert_eq!(speed(160.0, 1_249), CREEP_M_S);
        assert_eq!(speed(160.0, 1_250), 0.5);
        assert!((speed(200.0, 249) - 0.1).abs() < 1e-6);
        assert_eq!(speed(200.0, 250), CREEP_M_S);
        assert!((speed(215.0, 249) - 0.13).abs() < 1e-6);
        assert_eq!(speed(215.0, 250), 0.5);
    }

    /// The lidar measures 430 mm ahead, 300 mm before the deck, and falls silent. At 0.2 m/s the
    /// room shrinks by 20 mm each 100 ms; from 120 mm on, after 0.9 s, the robot slows down.
    /// Readings of other directions end the silence, and the point after a while.
    #[test]
    fn a_point_stays_and_comes_nearer_while_the_lidar_is_silent() {
        let mut strip = Strip::new();
        let wanted = Velocity::new(0.2, 0.0);
        strip.take(Instant::from_millis(1_000), 0, Some(430.0));
        let speed = |strip: &mut Strip, ms: u64| {
            let limited = strip.limited(Instant::from_millis(ms), wanted);
            limited.linear_m_s
        };
        for ms in (1_000..1_900).step_by(100) {
            assert_eq!(speed(&mut strip, ms), 0.2, "{ms}");
        }
        assert!((speed(&mut strip, 1_900) - 0.2).abs() < 1e-5);
        assert!((speed(&mut strip, 2_000) - 0.16).abs() < 1e-5);
        assert!((speed(&mut strip, 2_100) - 0.128).abs() < 1e-5);
        for ms in (2_110..2_360).step_by(50) {
            strip.take(Instant::from_millis(ms), 11_520, None);
            assert!(speed(&mut strip, ms) < 0.129, "{ms}");
        }
        strip.take(Instant::from_millis(2_360), 11_520, None);
        assert_eq!(speed(&mut strip, 2_360), 0.2);
    }
}
