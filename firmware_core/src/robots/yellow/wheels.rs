//! Computes the duties of the motors' PWM and the pose from the encoders' counters, each
//! millisecond.
//!
//! The right motor is mounted mirrored: when the robot drives ahead, its counter decreases and its
//! duty is below a half. Figures: public code of the robot, `Controller` and `Peripherals.h`.

use core::f32::consts::TAU;

use protocols::peripherals::DUTY_MAX;

use super::motion::{self, Velocity};
use crate::pose::{Pose, normalised, sin_cos};

/// Time between two samples.
const PERIOD_S: f32 = 0.001;
const COUNTS_PER_TURN: f32 = 1_200.0;
const WHEEL_RADIUS_M: f32 = 0.0375;
/// Distance between the wheels.
const BASE_M: f32 = 0.18;
/// Millimetres per count.
const COUNT_MM: f32 = TAU * WHEEL_RADIUS_M * 1_000.0 / COUNTS_PER_TURN;
/// Turns per minute at one count per sample: 50.
const COUNT_RPM: f32 = 60.0 / (COUNTS_PER_TURN * PERIOD_S);
/// Turns per minute at 1 m/s.
const RPM_PER_M_S: f32 = 60.0 / (TAU * WHEEL_RADIUS_M);
/// Speed of a motor per volt.
const RPM_PER_VOLT: f32 = 40.0;
const SUPPLY_VOLTS: f32 = 12.0;
/// A double pole at 300 rad/s: 1 - exp(-0.3) of the difference each sample.
const FILTER: f32 = 0.259_182;
/// Gain of the controller in volts per rpm, ahead and back in the motor's own direction.
const GAIN_AHEAD: f32 = 0.2;
const GAIN_BACK: f32 = 0.1;
/// Time constant of the integral part, and its maximum. It compensates the friction, half a volt,
/// and differences between motors.
const INTEGRAL_S: f32 = 0.1;
const INTEGRAL_MAX_VOLTS: f32 = 2.0;
/// Minimum distance of the duty from its limits.
const DUTY_LEAST: f32 = 0.02;
const DUTY_GREATEST: f32 = 0.98;
/// Duty at which the motor stands.
const DUTY_STOP: u16 = DUTY_MAX / 2;
/// Maximum counts of a sample, ten times full speed; more mean a restarted counter.
const COUNTS_MAX: u16 = 100;
/// Counts per sample at full speed: 12 V turn a wheel at 480 rpm.
const FULL_SPEED_COUNTS: u16 = 10;
/// Speed above which the fielded program keeps the old value.
const RPM_BELIEVED: f32 = 1_500.0;

/// Volts over time without a count, in volts a sample, above which the encoder has failed. A
/// working wheel counts within 50 when it starts to turn; a turning wheel loses 5 cm until then.
const SILENCE_MAX: f32 = 120.0;

/// Maximum speed of a standing wheel: reached 20 ms after its last count.
const REST_RPM: f32 = 1.0;

/// Enabled defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Counters are subtracted without regard to wrapping. A speed above 1500 rpm, as results from
    /// a wrap, is replaced by the one before.
    pub replaces_jumps: bool,
    /// The motion of a sample is applied along the heading at its end.
    pub end_point_rule: bool,
    /// There is no integral part: friction leaves an error.
    pub proportional_only: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        replaces_jumps: false,
        end_point_rule: false,
        proportional_only: false,
    };
}

/// One motor and its encoder, in the motor's own direction.
#[derive(Clone, Copy, Debug)]
struct Wheel {
    counter: Option<u16>,
    /// Counts of the last sample.
    counts: f32,
    filter: [f32; 2],
    target_rpm: f32,
    integral_volts: f32,
    /// Sum of the voltage applied since the last count, volts a sample.
    silence: f32,
}

impl Wheel {
    const NEW: Self = Self {
        counter: None,
        counts: 0.0,
        filter: [0.0; 2],
        target_rpm: 0.0,
        integral_volts: 0.0,
        silence: 0.0,
    };

    /// Difference of the counter from the last one.
    fn change(&self, counter: u16) -> i16 {
        let before = self.counter.unwrap_or(counter);
        counter.wrapping_sub(before).cast_signed()
    }

    /// Takes the counter; `began_anew`: it was restarted. Returns false if the counter is
    /// implausible.
    fn measure(&mut self, counter: u16, began_anew: bool, defects: &Defects) -> bool {
        let change = self.change(counter);
        let before = self.counter.replace(counter).unwrap_or(counter);
        let is_sound = change.unsigned_abs() <= COUNTS_MAX && !began_anew;
        if defects.replaces_jumps {
            let counts = f32::from(counter) - f32::from(before);
            if (counts * COUNT_RPM).abs() <= RPM_BELIEVED {
                self.counts = counts;
            }
        } else {
            self.counts = if is_sound { f32::from(change) } else { 0.0 };
        }
        let mut input = self.counts * COUNT_RPM;
        for state in &mut self.filter {
            *state += FILTER * (input - *state);
            input = *state;
        }
        is_sound
    }

    /// Duty for this speed.
    fn control(&mut self, target_rpm: f32, defects: &Defects) -> u16 {
        let error_rpm = target_rpm - self.filter[1];
        let gain = if target_rpm > 0.0 {
            GAIN_AHEAD
        } else {
            GAIN_BACK
        };
        // The integral part that compensates friction is useless at rest or in the other direction.
        if self.target_rpm * target_rpm <= 0.0 || defects.proportional_only {
            self.integral_volts = 0.0;
        }
        self.target_rpm = target_rpm;
        let volts = gain * error_rpm + target_rpm / RPM_PER_VOLT + self.integral_volts;
        let duty = volts / (2.0 * SUPPLY_VOLTS) + 0.5;
        let bounded = duty.clamp(DUTY_LEAST, DUTY_GREATEST);
        if (duty - bounded).abs() < f32::EPSILON {
            let more = gain / INTEGRAL_S * PERIOD_S * error_rpm;
            self.integral_volts =
                (self.integral_volts + more).clamp(-INTEGRAL_MAX_VOLTS, INTEGRAL_MAX_VOLTS);
        }
        let put_volts = (bounded - 0.5) * 2.0 * SUPPLY_VOLTS;
        self.silence = match self.counts == 0.0 {
            true => self.silence + put_volts.abs(),
            false => 0.0,
        };
        to_duty(bounded)
    }

    /// Resets the motor's control.
    const fn halt(&mut self) {
        (self.target_rpm, self.integral_volts, self.silence) = (0.0, 0.0, 0.0);
    }
}

/// The drive: both wheels, the profile of the speeds, the pose.
#[derive(Clone, Debug)]
pub(super) struct Wheels {
    defects: Defects,
    /// Left and right wheel.
    wheels: [Wheel; 2],
    /// Current speeds of the profile.
    velocity: Velocity,
    pose: Pose,
    corrections: u32,
    disbelieved: u32,
}

impl Wheels {
    pub(super) const fn new(start: Pose, defects: Defects) -> Self {
        Self {
            defects,
            wheels: [Wheel::NEW; 2],
            velocity: Velocity::ZERO,
            pose: start,
            corrections: 0,
            disbelieved: 0,
        }
    }

    /// Takes one sample: updates the pose, and returns the duties that approach `target`; without a
    /// target the motors are off.
    pub(super) fn step(&mut self, counters: [u16; 2], target: Option<Velocity>) -> [u16; 2] {
        let anew = self.began_anew(counters);
        for (wheel, counter) in self.wheels.iter_mut().zip(counters) {
            if !wheel.measure(counter, anew, &self.defects) {
                self.disbelieved = self.disbelieved.saturating_add(1);
            }
        }
        self.advance();
        let Some(target) = target else {
            return self.halt();
        };
        self.velocity = motion::approach(self.velocity, target, PERIOD_S);
        let turn = self.velocity.angular_rad_s * BASE_M / 2.0;
        let left = (self.velocity.linear_m_s - turn) * RPM_PER_M_S;
        let right = (self.velocity.linear_m_s + turn) * RPM_PER_M_S;
        let [l, r] = &mut self.wheels;
        [
            l.control(left, &self.defects),
            r.control(-right, &self.defects),
        ]
    }

    /// Whether the counting board was restarted: both counters are about 0, and at least one
    /// changed faster than a wheel can turn.
    fn began_anew(&self, counters: [u16; 2]) -> bool {
        let is_fast = |counts: i16| counts.unsigned_abs() > FULL_SPEED_COUNTS;
        let mut changes = self.wheels.iter().zip(counters);
        counters
            .iter()
            .all(|counter| !is_fast(counter.cast_signed()))
            && changes.any(|(wheel, counter)| is_fast(wheel.change(counter)))
    }

    /// The duties that do not drive the motors; speeds restart from 0.
    pub(super) fn halt(&mut self) -> [u16; 2] {
        self.velocity = Velocity::ZERO;
        self.wheels.iter_mut().for_each(Wheel::halt);
        [DUTY_STOP; 2]
    }

    /// Whether a driven wheel does not count.
    pub(super) fn is_silent(&self) -> bool {
        self.wheels.iter().any(|wheel| wheel.silence > SILENCE_MAX)
    }

    /// Whether neither the profile nor a wheel moves.
    pub(super) fn is_at_rest(&self) -> bool {
        let turns = |wheel: &Wheel| wheel.filter[1].abs() > REST_RPM;
        self.velocity == Velocity::ZERO && !self.wheels.iter().any(turns)
    }

    /// Estimated pose of the robot.
    pub(super) const fn pose(&self) -> Pose {
        self.pose
    }

    /// Sets a better pose from another source.
    pub(super) const fn correct(&mut self, pose: Pose) {
        self.pose = pose;
        self.corrections = self.corrections.saturating_add(1);
    }

    /// Number of poses from another source.
    pub(super) const fn corrections(&self) -> u32 {
        self.corrections
    }

    /// Samples with counters that could not be a motion.
    pub(super) const fn disbelieved(&self) -> u32 {
        self.disbelieved
    }

    /// Moves the pose by the motion of one sample, along the heading in its middle.
    fn advance(&mut self) {
        let [left, right] = [self.wheels[0].counts, -self.wheels[1].counts];
        let way_mm = (left + right) / 2.0 * COUNT_MM;
        let turn = (right - left) * COUNT_MM / (BASE_M * 1_000.0);
        let part = if self.defects.end_point_rule {
            1.0
        } else {
            0.5
        };
        let (sin, cos) = sin_cos(self.pose.heading + turn * part);
        self.pose = Pose {
            x_mm: self.pose.x_mm + cos * way_mm,
            y_mm: self.pose.y_mm + sin * way_mm,
            heading: normalised(self.pose.heading + turn),
        };
    }
}

/// Converts a duty to the hardware's value.
fn to_duty(part: f32) -> u16 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a part of the whole, bounded before"
    )]
    let duty = libm::roundf(part * f32::from(DUTY_MAX)) as u16;
    duty
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is(found: f32, expected: f32) -> bool {
        (found - expected).abs() < 2e-3 * expected.abs().max(0.01)
    }

    /// Ten counts a sample are 500 rpm. The filter has two poles, and each moves by 0.259182 of the
    /// difference to its input. So the first sample gives 0.259182 of 500 and the same share of
    /// that, the second one 225.594 and 83.353 rpm. This holds across the end of the counter as
    /// well.
    #[test]
    fn counts_become_a_filtered_speed() {
        for start in [500_u16, u16::MAX - 4] {
            let mut wheel = Wheel::NEW;
            assert!(wheel.measure(start, false, &Defects::NONE) && wheel.filter == [0.0; 2]);
            wheel.measure(start.wrapping_add(10), false, &Defects::NONE);
            assert!(is(wheel.filter[0], 129.591) && is(wheel.filter[1], 33.588));
            wheel.measure(start.wrapping_add(20), false, &Defects::NONE);
            assert!(is(wheel.filter[0], 225.594) && is(wheel.filter[1], 83.353));
        }
    }

    /// A hundred counts in a sample are accepted in either direction, one more is a restarted
    /// counter. The fielded program keeps the speed before for one above 1500 rpm, 30 counts.
    #[test]
    fn a_jump_is_no_motion() {
        let counts = |change: i16, defects| {
            let mut wheel = Wheel::NEW;
            wheel.measure(1_000, false, &defects);
            wheel.counts = 7.0;
            let sound = wheel.measure(1_000_u16.wrapping_add_signed(change), false, &defects);
            (sound, wheel.counts)
        };
        let sound = Defects::NONE;
        assert_eq!(
            [counts(100, sound), counts(-100, sound)],
            [(true, 100.0), (true, -100.0)]
        );
        assert_eq!([counts(101, sound), counts(-101, sound)], [(false, 0.0); 2]);
        let jumps = Defects {
            replaces_jumps: true,
            ..sound
        };
        let found = [30, -30, 31, -31].map(|change| counts(change, jumps).1);
        assert_eq!(found, [30.0, -30.0, 7.0, 7.0]);
        // A counter below 0 counts as a jump ahead.
        assert_eq!(counts(-1_001, jumps).1, 7.0);
    }

    /// From rest to 20 rpm ahead: 0.2 V for each rpm of error, and a volt for 40 rpm of target, are
    /// 4.5 of 24 V above a half. Each sample adds 0.04 V. Backwards the gain is 0.1 V a rpm, and
    /// the integral restarts. 100 rpm need more than the bridge's limit.
    #[test]
    fn a_duty_is_what_speed_and_error_take() {
        let mut wheel = Wheel::NEW;
        let mut duty = |rpm| wheel.control(rpm, &Defects::NONE);
        assert_eq!([duty(20.0), duty(20.0), duty(20.0)], [6_875, 6_892, 6_908]);
        assert_eq!([duty(-20.0), duty(-20.0)], [3_958, 3_950]);
        assert_eq!([duty(0.0), duty(100.0), duty(-400.0)], [5_000, 9_800, 200]);
        let mut wheel = Wheel::NEW;
        let fielded = Defects {
            proportional_only: true,
            ..Defects::NONE
        };
        assert_eq!(
            [wheel.control(20.0, &fielded), wheel.control(20.0, &fielded)],
            [6_875; 2]
        );
        // A wheel at 20 rpm needs half a volt to keep its speed.
        let mut wheel = Wheel {
            filter: [20.0; 2],
            ..Wheel::NEW
        };
        assert_eq!(wheel.control(20.0, &Defects::NONE), 5_208);
        // The integral part adds at most two volts.
        let mut wheel = Wheel::NEW;
        let duties = [(); 60].map(|()| wheel.control(20.0, &Defects::NONE));
        assert_eq!((wheel.integral_volts, duties[59]), (2.0, 7_708));
    }

    /// At the end of the bridge each sample adds 11.52 V: the sum is above 120 after the eleventh.
    /// A count ends the silence, and so does an order to halt the motors.
    #[test]
    fn a_driven_wheel_that_does_not_count_is_found() {
        let mut wheels = Wheels::new(Pose::default(), Defects::NONE);
        let mut silent_after = 0;
        for wheel in &mut wheels.wheels {
            wheel.counts = 1.0;
        }
        wheels.wheels[0].counts = 0.0;
        for sample in 1..=20 {
            assert!(!wheels.is_silent() || silent_after > 0);
            wheels.wheels[0].control(400.0, &Defects::NONE);
            wheels.wheels[1].control(-400.0, &Defects::NONE);
            if wheels.is_silent() && silent_after == 0 {
                silent_after = sample;
            }
        }
        assert_eq!(silent_after, 11);
        wheels.wheels[0].counts = -1.0;
        wheels.wheels[0].control(400.0, &Defects::NONE);
        assert!(!wheels.is_silent());
        wheels.wheels[1].silence = 130.0;
        assert!(wheels.is_silent() && wheels.halt() == [5_000; 2] && !wheels.is_silent());
    }

    /// A count is 0.19635 mm: 100 counts ahead on both sides are 19.635 mm along x. 40 counts on
    /// the right alone are 7.854 mm; over the axle of 180 mm this is a turn by 0.043633 rad, and
    /// the middle moves half of the distance, 3.927 mm, along half of that angle.
    #[test]
    fn the_pose_follows_the_middle_of_each_sample() {
        let after = |counters: [u16; 2], defects| {
            let mut wheels = Wheels::new(Pose::default(), defects);
            wheels.step([0, 0], None);
            wheels.step(counters, None);
            wheels.pose()
        };
        let back = |counts: u16| 0_u16.wrapping_sub(counts);
        let ahead = after([100, back(100)], Defects::NONE);
        assert!(is(ahead.x_mm, 19.635) && ahead.y_mm.abs() < 1e-6 && ahead.heading == 0.0);
        let turned = after([0, back(40)], Defects::NONE);
        assert!(is(turned.heading, 0.043_633) && is(turned.x_mm, 3.926_1));
        assert!(is(turned.y_mm, 0.085_66), "{turned:?}");
        let fielded = Defects {
            end_point_rule: true,
            ..Defects::NONE
        };
        assert!(is(after([0, back(40)], fielded).y_mm, 0.171_29));
        let right = after([40, 0], Defects::NONE);
        assert!(is(right.heading, -0.043_633) && is(right.y_mm, -0.085_66));
    }

    /// The first sample of a millisecond, from rest. 1.5 m/s2 give 0.0015 m/s, which are 0.382 rpm.
    /// 15 rad/s2 give 0.015 rad/s, at half of 180 mm 0.00135 m/s, which are 0.3438 rpm. The right
    /// motor turns in the other direction.
    #[test]
    fn wheels_share_speed_and_turn() {
        let targets = |target| {
            let mut wheels = Wheels::new(Pose::default(), Defects::NONE);
            let duties = wheels.step([9, 9], Some(target));
            assert_eq!(duties.len(), 2);
            wheels.wheels.map(|wheel| wheel.target_rpm)
        };
        let near = |found: [f32; 2], expected: [f32; 2]| {
            assert!(
                is(found[0], expected[0]) && is(found[1], expected[1]),
                "{found:?}"
            );
        };
        near(targets(Velocity::new(1.0, 0.0)), [0.381_97, -0.381_97]);
        near(targets(Velocity::new(0.0, 1.0)), [-0.343_77, -0.343_77]);
        near(targets(Velocity::new(-1.0, -1.0)), [-0.038_2, 0.725_74]);
    }

    /// A wheel at one turn a minute or less, also backwards, counts as at rest, but only if it has
    /// no target.
    #[test]
    fn a_drive_is_at_rest_below_one_turn_a_minute() {
        let mut wheels = Wheels::new(Pose::default(), Defects::NONE);
        assert!(wheels.is_at_rest());
        for (rpm, is_at_rest) in [(1.0, true), (1.1, false), (-1.0, true), (-1.1, false)] {
            for side in [0, 1] {
                wheels.wheels = [Wheel::NEW; 2];
                wheels.wheels[side].filter[1] = rpm;
                assert_eq!(wheels.is_at_rest(), is_at_rest);
            }
        }
        wheels.wheels = [Wheel::NEW; 2];
        wheels.velocity = Velocity::new(0.0, 0.001);
        assert!(!wheels.is_at_rest());
        assert_eq!((wheels.halt(), wheels.is_at_rest()), ([5_000; 2], true));
    }
}
