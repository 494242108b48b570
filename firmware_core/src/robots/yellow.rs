//! The robot of a course of 2019: two wheels, three IR sensors, a lidar, a PC over WiFi.
//!
//! ```text
//!  board --counters, ADC--> wheels, infrared --pose, distances--> reactive, autoposition
//!    ^                                                                  | speeds
//!    +------------------duties---- wheels <------ state machine <-------+
//!  lidar --nodes--> set of five turns --points--> lines --+
//!     PC --telecommands--> state machine, goals           +--> telemetry --> PC
//! ```
//!
//! The board's sample, each millisecond, is the program's fastest loop: motion control belongs to
//! it. All other work runs by the clock. Source of laws and figures: public code of the robot and
//! the task sheet of the course; [`Defects`] lists its errors.

pub mod autoposition;
mod board_settings;
mod config;
mod defects;
mod guard;
pub mod infrared;
pub mod lidar;
mod motion;
mod order;
#[cfg(feature = "host")]
pub mod pc;
pub mod radio;
pub mod reactive;
mod report;
pub mod scans;
pub mod state;
pub mod wheels;

use core::time::Duration;

use protocols::peripherals::{Outputs, Sample, SampleDecoder, SampleFormat};
use protocols::telemetry::message::{self, ANY_HEADING, State, Telecommand};
use protocols::{Decode, Instant, LineConfig, LineEvent, Port, rplidar, telemetry};

pub use config::Config;
pub use defects::Defects;
pub use motion::Velocity;
pub use state::Mode;

use crate::fifo::Fifo;
use crate::pose::{Point, Pose};
use crate::{Master, Work};
use autoposition::{Autoposition, Goal};
use guard::Guard;
use infrared::Infrared;
use lidar::Lidar;
use radio::{Radio, View};
use reactive::Reactive;
use state::Machine;
use wheels::Wheels;

/// Rate of the internal wires of the board: PWM of the lidar's motor, the chip's own hardware.
const BOARD_BAUD: u32 = 10_000_000;

/// Longest gap between samples: in a longer one the robot may have rolled 5 mm at the speed of a
/// manoeuvre.
const GAP: Duration = Duration::from_millis(10);

/// The robot's program.
#[derive(Clone, Debug)]
pub struct Yellow {
    config: Config,
    machine: Machine,
    wheels: Wheels,
    infrared: Infrared,
    reactive: Reactive,
    autoposition: Autoposition,
    guard: Guard,
    lidar: Lidar,
    radio: Radio,
    samples: SampleDecoder,
    outputs: Fifo<64>,
    /// Speeds that the PC orders in MANUAL.
    by_hand: Velocity,
    /// Target velocity of the state machine.
    target: Velocity,
    step_at: Instant,
    /// Time of the pose.
    posed_at: Option<Instant>,
    counters: Counters,
}

// The chip has 128 KiB of memory; this leaves three quarters of it to stacks and drivers.
const _: () = assert!(size_of::<Yellow>() <= 32 * 1024);

#[derive(Clone, Debug)]
struct Counters {
    samples: u32,
    bad_samples: u32,
    refused: u32,
    line_errors: u32,
}

impl Yellow {
    /// The RPLIDAR A1, 115200 baud.
    pub const LIDAR: Port = Port(0);
    /// Duty of the lidar's motor: one byte, of 255, whenever it changes.
    pub const LIDAR_MOTOR: Port = Port(1);
    /// Counters, PWM, ADC and button: see [`protocols::peripherals`].
    pub const BOARD: Port = Port(2);
    /// The WiFi radio, 38400 baud.
    pub const TELEMETRY: Port = Port(3);

    /// A robot just after power-on.
    pub const fn new(config: Config) -> Self {
        let defects = &config.defects;
        Self {
            machine: Machine::new(defects.state),
            wheels: Wheels::new(config.start, defects.wheels),
            infrared: Infrared::new(defects.infrared),
            reactive: Reactive::new(defects.reactive),
            autoposition: Autoposition::new(defects.autoposition),
            guard: Guard::NEW,
            lidar: Lidar::new(defects.lidar),
            radio: Radio::new(defects.radio),
            samples: SampleDecoder::with_format(SampleFormat),
            outputs: Fifo::new(),
            by_hand: Velocity::ZERO,
            target: Velocity::ZERO,
            step_at: Instant::ZERO,
            posed_at: None,
            counters: Counters {
                samples: 0,
                bad_samples: 0,
                refused: 0,
                line_errors: 0,
            },
            config,
        }
    }

    /// The current mode.
    pub const fn mode(&self) -> Mode {
        self.machine.mode()
    }

    /// Believed pose.
    pub const fn pose(&self) -> Pose {
        self.wheels.pose()
    }

    /// Number of times that another source has set the pose.
    pub const fn corrections(&self) -> u32 {
        self.wheels.corrections()
    }

    /// The IR sensors in metres: ahead, right front, left front.
    pub const fn infrared_m(&self) -> [f32; 3] {
        self.infrared.distances_m()
    }

    /// The bearing of the ordered pose, radians to the left; `None` if the robot does not drive to
    /// one.
    pub fn goal_bearing(&self) -> Option<f32> {
        let is_led = self.mode() == Mode::AutoPosition;
        is_led.then(|| self.autoposition.bearing(self.pose()))
    }

    /// Target speeds of the activity; the wheels follow as fast as they can.
    pub const fn target(&self) -> Velocity {
        self.target
    }

    /// One sample of the hardware: motion control.
    fn sample(&mut self, now: Instant, sample: &Sample) {
        self.counters.samples = self.counters.samples.saturating_add(1);
        self.machine.button(sample.button);
        let channel = self.infrared.take(sample);
        self.attend(now);
        let enable = self.machine.drivers_are_on();
        let target = enable.then_some(self.target);
        let disbelieved = self.wheels.disbelieved();
        let mut duty = self.wheels.step(sample.counters, target);
        let is_late = self.posed_at.is_some_and(|at| now - at > GAP);
        let is_lost = is_late || self.wheels.disbelieved() != disbelieved;
        if is_lost || self.wheels.is_silent() {
            self.machine.interrupt(now);
            duty = self.wheels.halt();
        }
        self.posed_at = Some(now);
        let outputs = Outputs {
            duty,
            channel,
            enable,
        };
        // The board does not take the outputs: discard old duties.
        if !self.outputs.push(&outputs.encode()) {
            self.outputs.clear();
        }
    }

    /// Runs all work due by `now`.
    fn attend(&mut self, now: Instant) {
        self.lidar.tick(now);
        if now >= self.step_at {
            self.step_at += self.machine.period();
            if self.step_at <= now {
                self.step_at = now + self.machine.period();
            }
            self.step(now);
        }
        if now >= self.radio.next_at() {
            let view = View {
                state: self.machine.mode().told(),
                pose: self.wheels.pose(),
                infrared_m: self.infrared.distances_m(),
                scans: &self.lidar.scans,
                lines: self.config.defects.lines,
            };
            self.radio.tick(now, &view);
        }
    }

    /// Runs one step of the state machine and of the active mode.
    fn step(&mut self, now: Instant) {
        self.radio.read_done();
        if self.machine.step(now) {
            self.reactive.begin();
            self.autoposition.begin();
        }
        self.target = match self.machine.mode() {
            Mode::Manual => self.by_hand,
            Mode::AutoReactive => {
                let wanted = self.reactive.step(now, self.infrared.distances_m());
                match self.config.defects.reactive.fielded_formula {
                    true => wanted,
                    false => self.lidar.strip.limited(now, wanted),
                }
            }
            Mode::AutoPosition if self.machine.is_interrupted() => Velocity::ZERO,
            Mode::AutoPosition => self.manoeuvre(now),
            Mode::Off | Mode::SwitchOn | Mode::On | Mode::SwitchOff => Velocity::ZERO,
        };
    }

    fn manoeuvre(&mut self, now: Instant) -> Velocity {
        let (pose, is_at_rest) = (self.wheels.pose(), self.wheels.is_at_rest());
        let Some(velocity) = self.autoposition.step(pose, is_at_rest) else {
            self.machine.arrived();
            return Velocity::ZERO;
        };
        let [ahead_m, ..] = self.infrared.distances_m();
        self.guard
            .limited(now, ahead_m, &mut self.lidar.strip, velocity)
    }

    /// Executes a telecommand of the PC; not-a-number is refused.
    fn obey(&mut self, now: Instant, command: &Telecommand) {
        self.machine.heard(now);
        if let Some(reactive) = &command.reactive {
            self.reactive.order(reactive);
        }
        if let Some(told) = command.velocities {
            let velocity = Velocity::new(told.linear_m_s, told.angular_rad_s);
            if velocity.is_finite() {
                self.by_hand = velocity;
            } else {
                self.refuse();
            }
        }
        if let Some(told) = command.corrected_pose {
            match Some(to_pose(told)).filter(|_| is_finite(told)) {
                Some(pose) => self.wheels.correct(pose),
                None => self.refuse(),
            }
        }
        let goal = command.desired_pose.filter(|told| is_finite(*told));
        if let Some(told) = goal {
            let has_heading = (told.alpha - ANY_HEADING).abs() >= 0.5;
            let pose = to_pose(told);
            self.autoposition.set_goal(Goal {
                position: Point::new(pose.x_mm, pose.y_mm),
                heading: has_heading.then_some(told.alpha),
            });
        }
        match command.state {
            // Refuse the mode without a goal.
            Some(State::AutoPosition) if goal.is_none() => self.refuse(),
            Some(state) => self.machine.order(state),
            None => {}
        }
    }

    fn refuse(&mut self) {
        self.counters.refused = self.counters.refused.saturating_add(1);
    }
}

/// Whether all values are finite.
fn is_finite(pose: message::Pose) -> bool {
    pose.x.is_finite() && pose.y.is_finite() && pose.alpha.is_finite()
}

/// Converts metres to millimetres.
fn to_pose(pose: message::Pose) -> Pose {
    Pose::new(pose.x * 1_000.0, pose.y * 1_000.0, pose.alpha)
}

impl Master for Yellow {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        match port {
            Self::LIDAR => self.lidar.receive(now, bytes),
            Self::BOARD => {
                let mut input = bytes;
                while let Some(outcome) = self.samples.step(&mut input) {
                    match outcome {
                        Ok(sample) => self.sample(now, &sample),
                        Err(_) => {
                            let bad = self.counters.bad_samples;
                            self.counters.bad_samples = bad.saturating_add(1);
                        }
                    }
                }
            }
            Self::TELEMETRY => {
                let mut input = bytes;
                while let Some(command) = self.radio.receive(now, &mut input) {
                    self.obey(now, &command);
                }
            }
            _ => {}
        }
        self.attend(now);
    }

    fn line_event(&mut self, port: Port, _now: Instant, event: LineEvent) {
        match event {
            LineEvent::Break
            | LineEvent::FramingError
            | LineEvent::ParityError
            | LineEvent::Overrun => {
                self.counters.line_errors = self.counters.line_errors.saturating_add(1);
            }
            LineEvent::Opened | LineEvent::Closed => match port {
                Self::LIDAR => self.lidar.line_broke(),
                Self::TELEMETRY => self.radio.line_broke(),
                _ => {}
            },
        }
    }

    fn poll(&mut self, now: Instant) {
        self.attend(now);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        match port {
            Self::LIDAR => self.lidar.transmit(buf),
            Self::LIDAR_MOTOR if !buf.is_empty() => self.lidar.take_duty().map_or(0, |duty| {
                buf[0] = duty;
                1
            }),
            Self::BOARD => self.outputs.pop(buf),
            Self::TELEMETRY => self.radio.transmit(buf),
            _ => 0,
        }
    }

    fn may_send(&self, port: Port) -> bool {
        match port {
            Self::LIDAR => self.lidar.has_output(),
            Self::LIDAR_MOTOR => self.lidar.has_duty(),
            Self::BOARD => !self.outputs.is_empty(),
            Self::TELEMETRY => true,
            _ => false,
        }
    }

    fn poll_at(&self) -> Option<Instant> {
        let own = self.step_at.min(self.radio.next_at());
        Some(own.min(self.lidar.next_at()))
    }

    fn line_config(&self, port: Port) -> LineConfig {
        LineConfig::new_8n1(match port {
            Self::LIDAR => rplidar::BAUD,
            Self::TELEMETRY => telemetry::BAUD,
            _ => BOARD_BAUD,
        })
    }

    fn take_work(&mut self) -> Work {
        Work::NONE
    }
}

#[cfg(test)]
mod tests;
