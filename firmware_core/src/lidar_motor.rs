//! Speed regulator of a lidar motor that the host drives: computes the duty from the speed in the
//! packets.
//!
//! The integral part is the fielded robot's: a 64th of the error per packet, duty 50 to 255 of 256,
//! 180 at the start (field program's lidar driver). The proportional part is our own addition. It
//! damps the oscillation of an integral regulator with a motor that takes half a second to follow.
//! A lidar that stays silent was stalled or restarted, so the regulator spins its motor up again. A
//! single lost packet changes nothing (the fielded program kicked the motor at each
//! resynchronisation). If the lidar still stays silent, its drive may be weak or strong, so the
//! regulator tries other duties.

use core::time::Duration;

use protocols::Instant;

/// Duty with which a standing motor is started.
pub const DUTY_START: u8 = 180;
/// Minimum duty of a running motor.
pub const DUTY_MIN: u8 = 50;

/// Silence after which the motor is restarted.
const RESTART_AFTER: Duration = Duration::from_secs(1);
/// Duties for starting a silent lidar, tried in this order, in a cycle. 180 is the fielded one;
/// with a drive of 3.3 V it gives 166 rpm, too slow for any measurement.
const STARTS: [u8; 5] = [DUTY_START, 220, 255, 130, 80];
/// Starts with each duty: a sensor boots, spins up and locks in less than three seconds.
const TRIES: u16 = 3;
/// Number of packets in a row, about two seconds, after which the drive counts as too weak: drive
/// at its limit, speed below the target.
const WEAK_AFTER: u16 = 900;
/// Duty per rpm of error, and per packet.
const INTEGRAL: f32 = 1.0 / 64.0;
/// Duty per rpm of error.
const PROPORTIONAL: f32 = 0.5;
/// Errors beyond this are glitches of the speed word (a lost tooth reads as half the speed, a false
/// one as twice); they are clamped to this value.
const ERROR_MAX_RPM: f32 = 100.0;
/// Maximum deviation from the target speed of a running motor.
const TOLERANCE_RPM: f32 = 20.0;
/// Good packets in a row after which the speed counts as stable, as in the fielded program.
const STABLE_AFTER: u16 = 251;

/// The regulator.
#[derive(Clone, Debug)]
pub struct LidarMotor {
    target_rpm: f32,
    integral: f32,
    duty: u8,
    is_off: bool,
    /// The last duty returned.
    told: Option<u8>,
    packet_at: Instant,
    good_in_a_row: u16,
    slow_in_a_row: u16,
    /// Starts since the last packet.
    starts: u16,
}

impl LidarMotor {
    /// A standing motor with the target speed `target_rpm`.
    pub const fn new(target_rpm: f32) -> Self {
        Self {
            target_rpm,
            integral: DUTY_START as f32,
            duty: DUTY_START,
            is_off: false,
            told: None,
            packet_at: Instant::ZERO,
            good_in_a_row: 0,
            slow_in_a_row: 0,
            starts: 0,
        }
    }

    /// A packet arrived that reports `speed_rpm`.
    pub fn packet(&mut self, now: Instant, speed_rpm: f32) {
        let error = (self.target_rpm - speed_rpm).clamp(-ERROR_MAX_RPM, ERROR_MAX_RPM);
        let limits = f32::from(DUTY_MIN)..=255.0;
        self.integral = (self.integral + error * INTEGRAL).clamp(*limits.start(), *limits.end());
        let duty = (self.integral + error * PROPORTIONAL).clamp(*limits.start(), *limits.end());
        #[expect(clippy::cast_possible_truncation, reason = "clamped to 50..=255")]
        let duty = duty as u8;
        self.duty = duty;
        self.packet_at = now;
        self.starts = 0;
        let count = |so_far: u16, holds: bool| if holds { so_far.saturating_add(1) } else { 0 };
        self.good_in_a_row = count(self.good_in_a_row, error.abs() <= TOLERANCE_RPM);
        let is_slow = duty == u8::MAX && error > TOLERANCE_RPM;
        self.slow_in_a_row = count(self.slow_in_a_row, is_slow);
    }

    /// Sets the duty to that of the start, as the fielded program did whenever it lost its position
    /// in the stream (XV-09).
    pub const fn kick(&mut self) {
        self.duty = DUTY_START;
    }

    /// Restarts the motor after a silence.
    pub fn tick(&mut self, now: Instant) {
        if now - self.packet_at >= RESTART_AFTER {
            self.packet_at = now;
            self.duty = STARTS[usize::from(self.starts / TRIES) % STARTS.len()];
            self.integral = f32::from(self.duty);
            self.good_in_a_row = 0;
            self.starts = self.starts.wrapping_add(1);
        }
    }

    /// Time of the next call of [`tick`](Self::tick).
    pub fn next_at(&self) -> Instant {
        self.packet_at + RESTART_AFTER
    }

    /// The duty, 0 to 255, if it changed since it was last taken.
    pub fn take_duty(&mut self) -> Option<u8> {
        let duty = if self.is_off { 0 } else { self.duty };
        (self.told != Some(duty)).then(|| {
            self.told = Some(duty);
            duty
        })
    }

    /// Switches the drive off.
    pub const fn switch_off(&mut self) {
        self.is_off = true;
    }

    /// Spins the motor up afresh.
    pub fn switch_on(&mut self) {
        if self.is_off {
            *self = Self {
                told: self.told,
                packet_at: self.packet_at,
                ..Self::new(self.target_rpm)
            };
        }
    }

    /// Whether the speed has been within 20 rpm of the target for half a second.
    pub const fn is_stable(&self) -> bool {
        self.good_in_a_row >= STABLE_AFTER
    }

    /// Whether full drive does not bring the motor near its target speed, because of low voltage or
    /// dust.
    pub const fn is_too_weak(&self) -> bool {
        self.slow_in_a_row >= WEAK_AFTER
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;

    fn at(packet: u32) -> Instant {
        Instant::ZERO + Duration::from_micros(2222) * packet
    }

    /// A motor with 90 rpm per volt and a lag of half a second (the sensor's reverse-engineering
    /// notes: 3.3 V gives about 300 rpm).
    fn run(motor: &mut LidarMotor, rpm: &mut f32, packets: core::ops::Range<u32>, gain: f32) {
        for packet in packets {
            motor.packet(at(packet), *rpm);
            *rpm += (f32::from(motor.duty) * gain - *rpm) * (0.002_222 / 0.5);
        }
    }

    #[test]
    fn the_speed_settles_at_300_rpm_within_three_seconds() {
        let (mut motor, mut rpm) = (LidarMotor::new(300.0), 0.0);
        run(&mut motor, &mut rpm, 0..1350, 1.4);
        assert!((rpm - 300.0).abs() < 3.0, "{rpm}");
        assert!(motor.is_stable());
    }

    /// Fielded constants: the duty starts at 180 and stays there at the target speed.
    #[test]
    fn a_duty_is_told_once() {
        let mut motor = LidarMotor::new(300.0);
        assert_eq!(motor.take_duty(), Some(180));
        motor.packet(at(1), 300.0);
        assert_eq!(motor.take_duty(), None);
    }

    /// Sensor capture "hand in box": one tooth read as 351 rpm while the motor turned at 175.
    #[test]
    fn one_false_speed_does_not_upset_the_motor() {
        let (mut motor, mut rpm) = (LidarMotor::new(300.0), 300.0);
        run(&mut motor, &mut rpm, 0..2000, 1.667);
        motor.packet(at(2000), 600.0);
        run(&mut motor, &mut rpm, 2001..2090, 1.667);
        assert!((rpm - 300.0).abs() < 6.0, "{rpm}");
    }

    #[test]
    fn a_silent_lidar_is_spun_up_again() {
        let mut motor = LidarMotor::new(300.0);
        for packet in 0..2000 {
            motor.packet(at(packet), 900.0);
        }
        assert_eq!(motor.take_duty(), Some(DUTY_MIN));
        motor.tick(motor.next_at());
        assert_eq!(motor.take_duty(), Some(DUTY_START));
    }

    /// With 3.3 V at full duty, 180 gives 166 rpm, too slow for any measurement (seed report
    /// against the sensor's reports). Each duty gets three seconds; then all of them repeat.
    #[test]
    fn a_lidar_that_stays_silent_is_started_with_other_duties() {
        let mut motor = LidarMotor::new(300.0);
        let duties: Vec<u8> = (0..36)
            .map(|_| {
                motor.tick(motor.next_at());
                motor.duty
            })
            .collect();
        assert_eq!(duties[..9], [180, 180, 180, 220, 220, 220, 255, 255, 255]);
        assert_eq!(duties[9..16], [130, 130, 130, 80, 80, 80, 180]);
        motor.packet(at(1), 300.0);
        motor.tick(motor.next_at());
        assert_eq!(motor.duty, 180);
    }

    /// A motor with 1.0 rpm per duty step reaches 255 rpm at most. After 900 packets its drive is
    /// reported as too weak. Nothing is reported while the motor spins up, or if it comes within 20
    /// rpm of the target speed.
    #[test]
    fn a_drive_that_is_too_weak_is_told() {
        for (gain, is_weak) in [(1.0, true), (1.12, false)] {
            let (mut motor, mut rpm) = (LidarMotor::new(300.0), 0.0);
            run(&mut motor, &mut rpm, 0..900, gain);
            assert!(!motor.is_too_weak());
            run(&mut motor, &mut rpm, 900..3000, gain);
            assert_eq!(motor.is_too_weak(), is_weak, "{gain}");
        }
    }

    /// The fielded defect: a lost position in the stream sets the start duty.
    #[test]
    fn a_kick_is_the_duty_of_the_start() {
        let mut motor = LidarMotor::new(300.0);
        motor.packet(at(1), 350.0);
        assert!(motor.take_duty().is_some_and(|duty| duty < 180));
        motor.kick();
        assert_eq!(motor.take_duty(), Some(180));
    }

    /// The motor is switched off and on again before the duty is read: the duty equals the last one
    /// read, so none is reported.
    #[test]
    fn a_motor_that_is_switched_on_again_tells_its_duty_only_if_it_changed() {
        let mut motor = LidarMotor::new(300.0);
        motor.tick(motor.next_at());
        let next_at = motor.next_at();
        assert_eq!(motor.take_duty(), Some(180));
        motor.switch_off();
        motor.switch_on();
        assert_eq!((motor.take_duty(), motor.next_at()), (None, next_at));
        motor.switch_off();
        assert_eq!([motor.take_duty(), motor.take_duty()], [Some(0), None]);
        motor.switch_on();
        assert_eq!(motor.take_duty(), Some(180));
    }
}
