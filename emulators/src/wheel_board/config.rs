//! Figures of a board and of the parts connected to it.

use core::f64::consts::{FRAC_PI_3, TAU};
use core::time::Duration;

use protocols::Instant;
use protocols::peripherals::{DUTY_MAX, Outputs};

/// Everything about a board that differs from robot to robot.
///
/// The defaults are those of a robot of two 12 V gear motors on a Nucleo board (bfhMobileRobotics
/// 2019: wheels, motors, sensors). Figures missing in its documents are marked as guesses.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The motors.
    pub motor: MotorConfig,
    /// Radius of the wheels, metres.
    pub wheel_radius_m: f64,
    /// Whether the left and right motor are mounted mirrored. A duty of more than a half then turns
    /// the wheel back, and its counter counts down as the wheel rolls forward.
    pub mirrored: [bool; 2],
    /// Voltage of the full battery.
    pub supply_v: f64,
    /// Volts an hour that the battery loses at rest, and in addition with both motors at full
    /// drive. A guess: a pack that lasts some hours.
    pub drain_v_per_h: [f64; 2],
    /// Range sensors at the ADC's channels from 0 on.
    pub range_sensors: Vec<RangeSensor>,
    /// Standard deviation of a range sensor's output, volts. A guess.
    pub range_noise_v: f64,
    /// Times at which the button is pressed.
    pub presses: Vec<Press>,
}

/// A brushed motor with its gear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorConfig {
    /// Speed of the wheel per volt, rpm.
    pub rpm_per_v: f64,
    /// Greatest relative deviation of a motor from that, drawn once for the run.
    pub spread: f64,
    /// Below this voltage friction holds the wheel. A guess.
    pub dead_band_v: f64,
}

/// Mount of an infrared range sensor, metres and radians in the robot's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RangeSensor {
    /// Ahead of the middle.
    pub x_m: f64,
    /// To the left of the middle.
    pub y_m: f64,
    /// Direction, counter-clockwise from ahead.
    pub angle_rad: f64,
}

impl RangeSensor {
    /// A sensor that looks away from the middle, `out_m` from it.
    pub fn on_ring(out_m: f64, angle_rad: f64) -> Self {
        let (sin, cos) = libm::sincos(angle_rad);
        Self {
            x_m: out_m * cos,
            y_m: out_m * sin,
            angle_rad,
        }
    }
}

/// A finger on the button.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Press {
    /// Start time.
    pub at: Instant,
    /// Duration.
    pub lasting: Duration,
}

impl Press {
    pub(super) fn holds(&self, now: Instant) -> bool {
        (self.at..self.at + self.lasting).contains(&now)
    }
}

/// Distance of the range sensors from the middle. A guess.
const RING_M: f64 = 0.09;

impl Default for MotorConfig {
    fn default() -> Self {
        Self {
            rpm_per_v: 40.0,
            spread: 0.05,
            dead_band_v: 0.5,
        }
    }
}

impl Default for Config {
    fn default() -> Self {
        // Numbered clockwise from the one ahead.
        let sensor = |number: u8| RangeSensor::on_ring(RING_M, -f64::from(number) * FRAC_PI_3);
        Self {
            motor: MotorConfig::default(),
            wheel_radius_m: 0.0375,
            mirrored: [false, true],
            supply_v: 12.0,
            drain_v_per_h: [0.1, 0.9],
            range_sensors: (0..6).map(sensor).collect(),
            range_noise_v: 0.015,
            presses: Vec::new(),
        }
    }
}

impl Config {
    /// See [`set_points`](super::WheelBoard::set_points).
    pub fn set_points(&self, outputs: Outputs) -> [f64; 2] {
        let volts = self.volts(outputs, self.supply_v);
        volts.map(|volts| {
            let rpm = volts.unwrap_or_default() * self.motor.rpm_per_v;
            rpm * self.rim_m_s_per_rpm()
        })
    }

    /// Voltages that drive the left and right wheel forward, on a battery of `supply_v`; `None`
    /// while the bridges are off.
    pub(super) fn volts(&self, outputs: Outputs, supply_v: f64) -> [Option<f64>; 2] {
        [0, 1].map(|side| {
            let duty = f64::from(outputs.duty[side]) / f64::from(DUTY_MAX);
            let volts = (2.0 * duty - 1.0) * supply_v;
            let forward = if self.mirrored[side] { -volts } else { volts };
            outputs.enable.then_some(forward)
        })
    }

    pub(super) fn rim_m_s_per_rpm(&self) -> f64 {
        TAU * self.wheel_radius_m / 60.0
    }
}
