//! The turning head: a small DC motor, a belt, friction, and the motor's supply.
//!
//! ```text
//! d speed / dt = push * volts - back_emf * speed    motor, while it pushes: it cannot brake
//!              - dry - viscous * speed - dust       friction
//! ```

use protocols::Instant;

/// Supply of the motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotorSupply {
    /// The rig's own supply with speed control, for clients without a PWM pin. If a client sends a
    /// duty nevertheless, 0 switches the motor off.
    Regulated {
        /// Turns per minute.
        rpm: f64,
    },
    /// A bench supply: motor and friction determine the speed, which wanders a little.
    Fixed {
        /// Voltage at the motor.
        volts: f64,
    },
    /// The host's motor drive: the last byte on the sensor's motor port is its duty.
    Host {
        /// Voltage of the drive at full duty.
        volts: f64,
    },
}

impl Default for MotorSupply {
    fn default() -> Self {
        Self::Regulated { rpm: 300.0 }
    }
}

/// Figures of a motor with its head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Motor {
    /// Acceleration by voltage, rpm/s per volt.
    pub(crate) push_rpm_s_v: f64,
    /// Back EMF, per second.
    pub(crate) back_emf_per_s: f64,
    /// Dry friction, rpm/s.
    pub(crate) dry_rpm_s: f64,
    /// Viscous friction, per second.
    pub(crate) viscous_per_s: f64,
    /// Wandering of an unregulated motor's supply, relative.
    pub(crate) wander: f64,
    /// Part of the wandering that is kept from one draw to the next.
    pub(crate) wander_kept: f64,
}

/// Maximum voltage of a regulated supply.
const REGULATED_VOLTS_MAX: f64 = 5.0;
/// Maximum rise of the speed by a regulated supply: 300 rpm after little more than half a second.
const REGULATED_RISE_RPM_S: f64 = 600.0;
const STEP_NANOS: u64 = 1_000_000;
/// Longest look ahead. A head that needs more than this to the next tooth turns at less than
/// 1.3 rpm and is about to stop.
const LOOK_AHEAD_STEPS: u32 = 3_000;
/// Degrees per second in one rpm.
pub(crate) const DEG_PER_S: f64 = 6.0;

/// State of the head at one instant. Between instants it follows from the supply alone, so it is
/// stored only when a tooth passes or the drive changes.
#[derive(Clone, Debug)]
pub(crate) struct Rotor {
    motor: Motor,
    pub(crate) supply: MotorSupply,
    /// Duty of the host's drive, 0 to 1.
    pub(crate) duty: f64,
    /// Additional friction of dust, rpm/s.
    pub(crate) dust_rpm_s: f64,
    pub(crate) stuck: bool,
    /// Nothing feeds the motor.
    pub(crate) unpowered: bool,
    at: Instant,
    /// Degrees; the encoder subtracts whole turns.
    angle_deg: f64,
    speed_rpm: f64,
    /// Present relative deviation of an unregulated motor.
    wander: f64,
}

impl Rotor {
    pub(crate) fn new(motor: Motor, supply: MotorSupply, angle_deg: f64) -> Self {
        Self {
            motor,
            supply,
            duty: 0.0,
            dust_rpm_s: 0.0,
            stuck: false,
            unpowered: false,
            at: Instant::ZERO,
            angle_deg,
            speed_rpm: 0.0,
            wander: 0.0,
        }
    }

    pub(crate) fn speed_rpm(&self) -> f64 {
        if self.stuck { 0.0 } else { self.speed_rpm }
    }

    pub(crate) fn angle_deg(&self) -> f64 {
        self.angle_deg
    }

    /// Takes a whole turn off the angle.
    pub(crate) fn wrap(&mut self) {
        self.angle_deg -= 360.0;
    }

    /// Advances the head to `at`. The result depends on how often this is called, so call it only
    /// for reasons of the device, never for reasons of its caller.
    pub(crate) fn advance(&mut self, at: Instant) {
        if self.stuck {
            self.speed_rpm = 0.0;
            self.at = self.at.max(at);
        }
        while self.at < at {
            let left = (at - self.at).as_nanos();
            let nanos = u64::try_from(left).unwrap_or(u64::MAX).min(STEP_NANOS);
            if self.speed_rpm == 0.0 && self.acceleration() <= 0.0 {
                self.at = at;
            } else if self.is_steady() {
                self.angle_deg += self.speed_rpm * DEG_PER_S * (at - self.at).as_secs_f64();
                self.at = at;
            } else {
                self.step(nanos);
            }
        }
    }

    /// Time at which the head reaches `angle_deg` if nothing changes; `None` if it stops before.
    pub(crate) fn reaches(&self, angle_deg: f64) -> Option<Instant> {
        let mut ahead = self.clone();
        if ahead.stuck {
            return None;
        }
        for _ in 0..LOOK_AHEAD_STEPS {
            let missing = angle_deg - ahead.angle_deg;
            if missing <= 0.0 {
                return Some(ahead.at);
            }
            let before = ahead.clone();
            ahead.step(STEP_NANOS);
            if ahead.angle_deg >= angle_deg || before.is_steady() {
                return Some(before.crossing(missing, ahead.speed_rpm));
            }
            if ahead.speed_rpm == 0.0 {
                return None;
            }
        }
        None
    }

    /// Time at which the head has turned by `missing` degrees, if the speed changes evenly to
    /// `speed_end` within a step.
    fn crossing(&self, missing: f64, speed_end: f64) -> Instant {
        let speed = self.speed_rpm * DEG_PER_S;
        let acceleration = (speed_end - self.speed_rpm) * DEG_PER_S * 1e3;
        // The stable form of the quadratic formula: valid for an acceleration of zero, too.
        let root = (speed * speed + 2.0 * acceleration * missing)
            .max(0.0)
            .sqrt();
        let seconds = 2.0 * missing / (speed + root);
        self.at + nanos(seconds)
    }

    /// A new draw of the motor's wandering, once per tooth.
    pub(crate) fn wander(&mut self, normal: f64) {
        let Motor {
            wander,
            wander_kept: kept,
            ..
        } = self.motor;
        let fresh = (1.0 - kept * kept).sqrt() * wander;
        self.wander = kept * self.wander + fresh * normal;
    }

    fn step(&mut self, nanos: u64) {
        let span = core::time::Duration::from_nanos(nanos);
        let seconds = span.as_secs_f64();
        let before = self.speed_rpm;
        let raw = before + self.acceleration() * seconds;
        let held = match self.supply {
            _ if self.unpowered => raw,
            MotorSupply::Regulated { rpm } if before <= rpm => raw.min(rpm),
            MotorSupply::Regulated { rpm } => raw.max(rpm),
            _ => raw,
        };
        self.speed_rpm = held.max(0.0);
        self.angle_deg += (before + self.speed_rpm) / 2.0 * DEG_PER_S * seconds;
        self.at += span;
    }

    /// Whether the speed no longer changes.
    fn is_steady(&self) -> bool {
        match self.supply {
            MotorSupply::Regulated { rpm } => self.speed_rpm == rpm && self.acceleration() >= 0.0,
            _ => false,
        }
    }

    fn acceleration(&self) -> f64 {
        let volts = match self.supply {
            _ if self.unpowered => 0.0,
            MotorSupply::Regulated { rpm } if self.speed_rpm > rpm => 0.0,
            MotorSupply::Regulated { .. } => REGULATED_VOLTS_MAX,
            MotorSupply::Fixed { volts } => volts * (1.0 + self.wander),
            MotorSupply::Host { volts } => volts * self.duty * (1.0 + self.wander),
        };
        let push =
            (self.motor.push_rpm_s_v * volts - self.motor.back_emf_per_s * self.speed_rpm).max(0.0);
        let friction =
            self.motor.dry_rpm_s + self.motor.viscous_per_s * self.speed_rpm + self.dust_rpm_s;
        let net = push - friction;
        match self.supply {
            MotorSupply::Regulated { .. } => net.min(REGULATED_RISE_RPM_S),
            _ => net,
        }
    }
}

/// Whole nanoseconds, rounded down; zero if `seconds` is negative or NaN.
pub(crate) fn nanos(seconds: f64) -> core::time::Duration {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "spans are below minutes, and a cast saturates"
    )]
    let nanos = (seconds * 1e9) as u64;
    core::time::Duration::from_nanos(nanos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xv11::MOTOR;

    fn spun_up(supply: MotorSupply) -> Rotor {
        let mut rotor = Rotor::new(MOTOR, supply, 0.0);
        rotor.duty = 1.0;
        rotor.advance(Instant::from_secs(5));
        rotor
    }

    fn coast(rotor: &mut Rotor, at: Instant) {
        rotor.advance(at);
        rotor.supply = MotorSupply::Fixed { volts: 0.0 };
    }

    /// 600 rpm/s at first, then limited by 5 V; in the end 1800 degrees per second.
    #[test]
    fn a_regulated_head_turns_five_times_a_second_within_a_second() {
        let mut rotor = Rotor::new(MOTOR, MotorSupply::Regulated { rpm: 300.0 }, 0.0);
        rotor.advance(Instant::from_millis(490));
        assert!((250.0..300.0).contains(&rotor.speed_rpm()));
        rotor.advance(Instant::from_millis(1000));
        assert!((rotor.speed_rpm() - 300.0).abs() < 1e-9);
        let angle = rotor.angle_deg();
        rotor.advance(Instant::from_millis(2000));
        assert!((rotor.angle_deg() - angle - 1800.0).abs() < 1e-6);
        let next = rotor.reaches(rotor.angle_deg() + 24.0).expect("turns");
        assert_eq!(next.as_micros(), 2_013_333);
    }

    /// Wiki figures: 240 to 300 rpm at 3.3 V; 3.11 V gave one owner 300 rpm, so 90 rpm per volt.
    #[test]
    fn the_motor_turns_at_about_300_rpm_from_3_3_volts() {
        let speed = spun_up(MotorSupply::Fixed { volts: 3.3 }).speed_rpm();
        assert!((240.0..=300.0).contains(&speed), "{speed}");
        let host = spun_up(MotorSupply::Host { volts: 3.3 }).speed_rpm();
        assert!((speed - host).abs() < 1e-9);
    }

    /// Reconstructed from the tooth times of the "hand in box" capture: 293.6 to 183.3 rpm in
    /// 0.29 s, to 50 rpm in another 0.40 s, stop about 0.9 s after the cut; +-15 %.
    #[test]
    fn a_cut_motor_coasts_down_as_the_captured_one() {
        let mut rotor = spun_up(MotorSupply::Regulated { rpm: 293.6 });
        let cut = Instant::from_secs(5);
        coast(&mut rotor, cut);
        let mut millis = 0;
        let mut until = |rpm: f64| {
            while rotor.speed_rpm() > rpm {
                millis += 1;
                rotor.advance(cut + core::time::Duration::from_millis(millis));
            }
            millis
        };
        let (to_183, to_50, to_rest) = (until(183.3), until(50.0), until(0.0));
        assert!((247..=333).contains(&to_183), "{to_183}");
        assert!((340..=460).contains(&(to_50 - to_183)), "{to_50}");
        assert!((765..=1035).contains(&to_rest), "{to_rest}");
    }

    /// A coasting head at 60 rpm has some 9 degrees per 25 ms left; it stops within a few teeth.
    #[test]
    fn a_head_that_stops_first_reaches_no_tooth() {
        let mut rotor = spun_up(MotorSupply::Regulated { rpm: 60.0 });
        coast(&mut rotor, Instant::from_secs(5));
        assert!(rotor.reaches(rotor.angle_deg() + 24.0).is_some());
        assert!(rotor.reaches(rotor.angle_deg() + 360.0).is_none());
    }

    #[test]
    fn dust_slows_a_fixed_supply_and_a_stuck_head_stands() {
        let mut rotor = spun_up(MotorSupply::Fixed { volts: 3.3 });
        let clean = rotor.speed_rpm();
        rotor.dust_rpm_s = 100.0;
        rotor.advance(Instant::from_secs(10));
        assert!(rotor.speed_rpm() < clean - 40.0);
        rotor.stuck = true;
        assert_eq!(rotor.reaches(rotor.angle_deg() + 1.0), None);
    }

    /// At 600 degrees a second, with 360,000 more each second, 0.6 degrees take 1.2 / (600 +
    /// sqrt(792,000)) s, which is 0.805399 ms. At a constant speed they take 1 ms.
    #[test]
    fn a_place_is_reached_by_an_even_acceleration() {
        let mut rotor = Rotor::new(MOTOR, MotorSupply::Fixed { volts: 0.0 }, 0.0);
        rotor.speed_rpm = 100.0;
        rotor.at = Instant::from_secs(1);
        let after = |speed_end: f64| rotor.crossing(0.6, speed_end) - Instant::from_secs(1);
        assert_eq!(after(160.0).as_nanos() / 100, 8_053);
        assert_eq!(after(100.0).as_micros(), 1_000);
        // The head loses 12 degrees a second each millisecond: the time is 1.2 / (600 +
        // sqrt(360,000 - 14,400)) s.
        assert_eq!(after(98.0).as_nanos() / 100, 10_102);
    }

    /// Whatever its supply, without power only friction is left, and a head at rest stays there.
    #[test]
    fn a_head_without_power_comes_to_rest() {
        let supplies = [
            MotorSupply::Regulated { rpm: 300.0 },
            MotorSupply::Fixed { volts: 3.3 },
            MotorSupply::Host { volts: 3.3 },
        ];
        for supply in supplies {
            let mut rotor = spun_up(supply);
            rotor.unpowered = true;
            let friction = MOTOR.dry_rpm_s + MOTOR.viscous_per_s * rotor.speed_rpm;
            assert!((rotor.acceleration() + friction).abs() < 1e-9, "{supply:?}");
            rotor.advance(Instant::from_secs(10));
            assert!(rotor.speed_rpm() < 1e-9, "{supply:?}");
            rotor.advance(Instant::from_secs(11));
            assert!(rotor.speed_rpm() < 1e-9, "{supply:?}");
        }
    }

    /// A regulator holds its speed permanently; a voltage that swings does not.
    #[test]
    fn a_regulated_head_at_its_speed_is_steady() {
        let regulated = MotorSupply::Regulated { rpm: 300.0 };
        assert!(spun_up(regulated).is_steady());
        assert!(!Rotor::new(MOTOR, regulated, 0.0).is_steady());
        assert!(!spun_up(MotorSupply::Fixed { volts: 3.3 }).is_steady());
        let mut dusty = spun_up(regulated);
        dusty.dust_rpm_s = 1e6;
        assert!(!dusty.is_steady());
    }

    /// 100 rpm/s a volt; at 40 rpm the back EMF takes 80 rpm/s, friction 50 + 20, dust 10.
    fn by_hand(supply: MotorSupply, speed_rpm: f64) -> Rotor {
        let motor = Motor {
            push_rpm_s_v: 100.0,
            back_emf_per_s: 2.0,
            dry_rpm_s: 50.0,
            viscous_per_s: 0.5,
            wander: 0.1,
            wander_kept: 0.6,
        };
        let mut rotor = Rotor::new(motor, supply, 0.0);
        (rotor.speed_rpm, rotor.dust_rpm_s) = (speed_rpm, 10.0);
        rotor
    }

    /// 3 V with half more are 4.5 V: 450 - 80 - 80. Half of 3 V with a fifth less are 1.2 V: 40 -
    /// 80. A motor that does not push does not brake either. A regulator gives 5 V up to its speed,
    /// and 600 rpm/s at most: 5 V of this motor are 500 - 80 - 80.
    #[test]
    fn a_head_is_pushed_by_volts_and_slowed_by_friction() {
        let is = |rotor: &Rotor, expected: f64| {
            let found = rotor.acceleration();
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        };
        let mut fixed = by_hand(MotorSupply::Fixed { volts: 3.0 }, 40.0);
        fixed.wander = 0.5;
        is(&fixed, 290.0);
        let mut host = by_hand(MotorSupply::Host { volts: 3.0 }, 40.0);
        is(&host, -80.0);
        (host.duty, host.wander) = (0.5, -0.2);
        is(&host, -40.0);
        let regulated = |speed_rpm| by_hand(MotorSupply::Regulated { rpm: 300.0 }, speed_rpm);
        is(&regulated(40.0), 340.0);
        // The push is gone at 250 rpm: 5 V and a back EMF of 600 rpm/s.
        is(&regulated(300.0), -210.0);
        is(&regulated(301.0), -210.5);
        let mut strong = regulated(40.0);
        strong.motor.push_rpm_s_v = 1_000.0;
        is(&strong, 600.0);
        strong.speed_rpm = 300.0;
        is(&strong, 600.0);
    }

    /// 290 rpm/s for a millisecond are 0.29 rpm; 40.145 rpm in the mean are 0.24087 degrees.
    #[test]
    fn a_step_adds_speed_and_angle() {
        let mut rotor = by_hand(MotorSupply::Fixed { volts: 4.5 }, 40.0);
        rotor.at = Instant::from_secs(1);
        rotor.step(1_000_000);
        assert!((rotor.speed_rpm - 40.29).abs() < 1e-9);
        assert!((rotor.angle_deg - 0.240_87).abs() < 1e-9);
        assert_eq!(rotor.at, Instant::from_millis(1_001));
        rotor.wrap();
        assert!((rotor.angle_deg() + 359.759_13).abs() < 1e-9);
    }

    /// 600 rpm/s are 0.6 rpm a step, friction 210 rpm/s 0.21: both end at the regulator's speed,
    /// unless there is no power. No friction turns a head backwards.
    #[test]
    fn a_regulator_holds_its_speed_from_both_sides() {
        let after = |speed_rpm: f64, unpowered: bool| {
            let mut rotor = by_hand(MotorSupply::Regulated { rpm: 300.0 }, speed_rpm);
            rotor.motor.push_rpm_s_v = 1_000.0;
            rotor.unpowered = unpowered;
            rotor.step(1_000_000);
            rotor.speed_rpm
        };
        let near = |found: f64, expected: f64| (found - expected).abs() < 1e-3;
        assert!(near(after(299.0, false), 299.6) && near(after(301.0, false), 300.789_5));
        assert_eq!([after(299.5, false), after(300.1, false)], [300.0; 2]);
        assert!(near(after(300.1, true), 299.889_95) && near(after(299.5, true), 299.290_25));
        assert_eq!(after(0.01, true), 0.0);
    }

    /// Without friction and back EMF 3 V are 300 rpm/s: 0.45 rpm and 0.002025 degrees in 1.5 ms,
    /// in however many calls. A stuck head stays where it is.
    #[test]
    fn a_head_advances_by_parts_of_a_step() {
        let free = || {
            let mut rotor = by_hand(MotorSupply::Fixed { volts: 3.0 }, 0.0);
            let motor = &mut rotor.motor;
            (motor.back_emf_per_s, motor.dry_rpm_s, motor.viscous_per_s) = (0.0, 0.0, 0.0);
            rotor.dust_rpm_s = 0.0;
            rotor
        };
        let mut rotor = free();
        rotor.advance(Instant::from_micros(1_500));
        assert_eq!(rotor.at, Instant::from_micros(1_500));
        assert!((rotor.speed_rpm() - 0.45).abs() < 1e-9);
        assert!((rotor.angle_deg() - 0.002_025).abs() < 1e-9);
        rotor.advance(Instant::from_micros(1_000));
        assert_eq!(rotor.at, Instant::from_micros(1_500));
        // 0.45 rpm now, 0.75 rpm a millisecond later: 0.0036 degrees.
        assert_eq!(rotor.reaches(0.002_025), Some(rotor.at));
        let reached = rotor.reaches(0.005_625).expect("it gets there");
        let is_near = (2_499_990..=2_500_010).contains(&reached.as_nanos());
        assert!(is_near, "{reached:?}");
        rotor.stuck = true;
        rotor.advance(Instant::from_micros(9_000));
        assert_eq!(
            (rotor.at, rotor.speed_rpm()),
            (Instant::from_micros(9_000), 0.0)
        );
        rotor.advance(Instant::from_micros(8_000));
        assert_eq!(rotor.at, Instant::from_micros(9_000));
        assert!((rotor.angle_deg() - 0.002_025).abs() < 1e-9);
        rotor.stuck = false;
        assert_eq!(rotor.speed_rpm(), 0.0);
    }

    /// Six tenths of the wander stay, so eight tenths of a tenth are drawn anew: 0.3 + 0.16.
    #[test]
    fn a_supply_wanders_from_tooth_to_tooth() {
        let mut rotor = by_hand(MotorSupply::default(), 0.0);
        rotor.wander = 0.5;
        rotor.wander(2.0);
        assert!((rotor.wander - 0.46).abs() < 1e-12);
        let whole = [1.9e-9, 2.0, -1.0, f64::NAN].map(|seconds| nanos(seconds).as_nanos());
        assert_eq!(whole, [1, 2_000_000_000, 0, 0]);
    }
}
