//! The motor with its belt and its controls.
//!
//! Figures: 5.5 turns a second at the duty of 0.6 that the robot yellow uses (LD108's typical
//! speed), 10 at full duty (its greatest): 675 rpm times the duty less 75. The time constant of
//! 0.5 s is a guess.

use protocols::Instant;

use super::{Fault, Rplidar};
use crate::lidar::MotorSupply;
use crate::lidar::rotor::{Motor, Rotor};

/// The motor of an A1.
const MOTOR: Motor = Motor {
    // 1350 rpm/s at 5 V; 1350 / (1.615 + 0.385) = 675 rpm.
    push_rpm_s_v: 270.0,
    back_emf_per_s: 1.615,
    dry_rpm_s: 150.0,
    viscous_per_s: 0.385,
    // Drawn once a turn. An A1M8-R6 gives 267 or 268 nodes in a turn, so a turn differs from the
    // next by less than a node in 267.
    wander: 3e-4,
    wander_kept: 0.5,
};
/// Voltage of the sensor's supply.
const VOLTS: f64 = 5.0;
/// Duty of the USB adapter: 7.36 turns a second, which gives the 267 or 268 nodes of an A1M8-R6 at
/// a sample each 508 us: (7.359 * 60 + 75) / 675.
const ADAPTER_DUTY: f64 = 0.7652;
/// Full duty of the request F0.
const PWM_MAX: f64 = 1_023.0;

/// Drive of the head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotorControl {
    /// The rig's own supply, which holds the speed: for clients without a motor pin.
    Regulated {
        /// Turns per minute.
        rpm: f64,
    },
    /// The host's PWM on the pin MOTOCTL, as on the robot yellow: see [`Rplidar::MOTOR`].
    Pwm,
    /// The vendor's USB adapter: runs while DTR is low, see [`Rplidar::DTR`].
    Dtr,
    /// An accessory board that takes the request F0; the A1 has none.
    Command,
}

impl Default for MotorControl {
    /// 5.5 turns a second, the typical speed of LD108.
    fn default() -> Self {
        Self::Regulated { rpm: 330.0 }
    }
}

/// The head at rest.
pub(super) fn rotor(control: MotorControl, angle_deg: f64) -> Rotor {
    let supply = match control {
        MotorControl::Regulated { rpm } => MotorSupply::Regulated { rpm },
        _ => MotorSupply::Host { volts: VOLTS },
    };
    let mut rotor = Rotor::new(MOTOR, supply, angle_deg);
    // The adapter's port is not open yet, so DTR is low.
    if control == MotorControl::Dtr {
        rotor.duty = ADAPTER_DUTY;
    }
    rotor
}

impl Rplidar {
    /// Sets the duty of the motor pin, 0 to 1.
    pub(super) fn set_duty(&mut self, now: Instant, duty: f64) {
        match self.motor {
            MotorControl::Pwm => self.drive_motor(now, duty),
            _ => self.motor_not_wired(now, "the motor pin"),
        }
    }

    /// Sets the level of DTR.
    pub(super) fn set_dtr(&mut self, now: Instant, high: bool) {
        self.dtr_high = high;
        match self.motor {
            MotorControl::Dtr => self.drive_by_dtr(now),
            _ => self.motor_not_wired(now, "DTR"),
        }
    }

    /// Applies DTR to the motor, if the adapter controls it. Call it after a possible change of the
    /// level or of the adapter's polarity.
    pub(super) fn drive_by_dtr(&mut self, now: Instant) {
        if self.motor == MotorControl::Dtr {
            let runs = self.dtr_high == self.faults.has(Fault::DtrInverted);
            self.drive_motor(now, if runs { ADAPTER_DUTY } else { 0.0 });
        }
    }

    /// Executes the request F0.
    pub(super) fn set_pwm(&mut self, now: Instant, pwm: u16) {
        match self.motor {
            MotorControl::Command => self.drive_motor(now, (f64::from(pwm) / PWM_MAX).min(1.0)),
            _ => self.motor_not_wired(now, "the request F0"),
        }
    }

    fn drive_motor(&mut self, now: Instant, duty: f64) {
        if duty != self.rotor.duty {
            self.rotor.advance(now);
            self.rotor.duty = duty;
        }
    }

    fn motor_not_wired(&mut self, now: Instant, what: &str) {
        let detail = || format!("{what} does not drive the motor of this sensor");
        let kind = crate::device::EventKind::Violation;
        self.log.repeated(now, kind, "motor-not-wired", detail);
    }
}
