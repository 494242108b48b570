//! The board of a model car: drives motor and servo, reads its sensors, sends a frame 15 times a
//! second.
//!
//! ```text
//! command -> level -> speed   -> actuator `drive`       front, right, left  ultrasonic
//!         -> value -> angle   -> actuator `steering`    line, hall, battery -> frame
//! ```
//!
//! Frames and commands are those of [`protocols::car_board`]. The fielded board continues driving
//! when its host falls silent. With a dead-man time, as in the later board, it stops then, and the
//! next motor command starts it again.
//!
//! Sources: the car's program for the wire format; ucboard's documentation for the dead-man switch
//! and the position of the magnets at the left rear wheel (the report says right in one place and
//! left in another). Guesses are marked where they stand.

mod battery;
mod sensors;
pub mod speed;
pub mod steering;
#[cfg(test)]
mod tests;

use core::time::Duration;
use std::collections::VecDeque;

use protocols::car_board::{BAUD, Command, CommandError, Frame, Level, Steering};
use protocols::{Instant, LineConfig, Port};

use crate::device::{BrokenRules, Device, Event, EventKind, earliest, take};
use crate::event_log::EventLog;
use crate::i2c::RegisterChip as _;
use crate::world::{AckermannConfig, Command as Actuation, Encoder, Reversing, World};
pub use battery::BatteryConfig;
use sensors::Sensors;

/// Bytes that wait for the line at most; a frame that does not fit is lost.
const QUEUE_MAX: usize = 256;
/// Minimum voltage of the electronics, mV (user guide ug-000002-16).
const LEAST_MV: u16 = 6_800;
/// Battery voltage of an almost empty battery, mV.
const LOW_MV: u16 = 6_850;

/// Treatment of a command beyond its range. No source says what the board does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OutOfRange {
    /// The command is ignored.
    #[default]
    Ignored,
    /// The nearest valid command is executed.
    Clamped,
}

/// Configuration of a board.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardConfig {
    /// From one frame to the next. 15 Hz, a round of the ultrasonic sensors; a guess.
    pub frame_period: Duration,
    /// Silence of the host after which the motor stops; `None` as fielded: never.
    pub dead_man: Option<Duration>,
    /// Treatment of a command beyond its range.
    pub out_of_range: OutOfRange,
    /// Encoder of the chassis that turns with the magnets. If the chassis has none of this name,
    /// the encoder of the shaft, `drive`.
    pub encoder: String,
    /// Metres ahead of the rear axle and to the left of it. Under the bumper.
    pub line_sensor_m: [f64; 2],
    /// The battery.
    pub battery: BatteryConfig,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for BoardConfig {
    fn default() -> Self {
        Self {
            frame_period: Duration::from_nanos(66_666_667),
            dead_man: None,
            out_of_range: OutOfRange::default(),
            encoder: "rear_left".to_owned(),
            line_sensor_m: [0.33, 0.0],
            battery: BatteryConfig::default(),
            seed: 1,
        }
    }
}

impl BoardConfig {
    /// The encoder that turns with the magnets; `None` if no encoder of the chassis turns with the
    /// wheels.
    pub fn encoder_of(&self, encoders: &[Encoder]) -> Option<usize> {
        let find = |name: &str| encoders.iter().position(|encoder| encoder.name == name);
        find(&self.encoder).or_else(|| find("drive"))
    }
}

/// The car under such a board: as [`AckermannConfig::default`], with 25 degrees of steering and a
/// speed controller that brakes before it reverses. The encoders sit at the rear wheels: 120 counts
/// a turn, so that 8 pulses and 60 edges are whole numbers of counts.
pub fn chassis() -> AckermannConfig {
    AckermannConfig {
        steering_max_rad: 25_f64.to_radians(),
        full_speed_m_s: speed::FULL_SPEED_M_S,
        wheel_ticks_per_turn: Some(120),
        reversing: Reversing::BrakesFirst,
        ..AckermannConfig::default()
    }
}

/// Names of the faults.
const FAULTS: [&str; 12] = [
    "off",
    "restart",
    "stuck",
    "slow",
    "battery-low",
    "motor",
    "servo",
    "hall",
    "line",
    "front",
    "right",
    "left",
];

/// The board.
#[derive(Clone, Debug)]
pub struct CarBoard {
    config: BoardConfig,
    level: Level,
    steering: Option<Steering>,
    /// Time since which the actuators need a new command.
    changed_at: Option<Instant>,
    /// The host counts as silent from then on.
    silent_at: Option<Instant>,
    is_silent: bool,
    sensors: Sensors,
    frame_at: Option<Instant>,
    began: Instant,
    last: Option<Frame>,
    frames: VecDeque<u8>,
    faults: Faults,
    log: EventLog,
}

/// Active faults of the board itself.
#[derive(Clone, Copy, Debug, Default)]
struct Faults {
    is_off: bool,
    is_stuck: bool,
    is_low: bool,
    is_motor_dead: bool,
    is_servo_dead: bool,
    /// Time between two frames while a fault slows them down.
    period: Option<Duration>,
}

impl CarBoard {
    /// The line to the host.
    pub const UART: Port = Port(0);

    /// A board that is switched on as the run begins.
    pub fn new(config: BoardConfig) -> Self {
        Self {
            sensors: Sensors::new(config.seed),
            level: Level::STOP,
            steering: None,
            changed_at: None,
            silent_at: None,
            is_silent: false,
            frame_at: Some(Instant::ZERO + config.frame_period),
            began: Instant::ZERO,
            last: None,
            frames: VecDeque::new(),
            faults: Faults::default(),
            log: EventLog::default(),
            config,
        }
    }

    /// The motor level that was commanded last.
    pub const fn level(&self) -> Level {
        self.level
    }

    /// The steering value that was commanded last, if one was.
    pub const fn steering(&self) -> Option<Steering> {
        self.steering
    }

    /// The frame that the board measured last.
    pub const fn last_frame(&self) -> Option<Frame> {
        self.last
    }

    fn obey(&mut self, now: Instant, byte: u8) {
        let command = match Command::decode(byte) {
            Ok(command) => command,
            Err(error) => {
                let kind = EventKind::Violation;
                let tell = || error.to_string();
                self.log.repeated(now, kind, "out-of-range", tell);
                match self.config.out_of_range {
                    OutOfRange::Ignored => return,
                    OutOfRange::Clamped => clamped(error),
                }
            }
        };
        self.silent_at = self.config.dead_man.map(|time| now + time);
        match command {
            Command::Motor(level) => {
                if level != self.level || self.is_silent {
                    self.changed_at.get_or_insert(now);
                }
                (self.level, self.is_silent) = (level, false);
            }
            Command::Steering(value) => {
                if Some(value) != self.steering {
                    self.changed_at.get_or_insert(now);
                }
                self.steering = Some(value);
            }
        }
    }

    /// Sends the current commands to the actuators.
    fn drive(&mut self, now: Instant, world: &mut World) {
        let motor = if self.faults.is_off || self.faults.is_motor_dead {
            Actuation::Coast
        } else if self.is_silent {
            Actuation::Brake
        } else {
            Actuation::Speed(speed::speed_m_s(self.level))
        };
        let mut outcome = world.actuate("drive", motor);
        let steering = self.steering.filter(|_| !self.faults.is_servo_dead);
        if let Some(value) = steering.filter(|_| !self.faults.is_off) {
            let angle = steering::angle_deg(value).to_radians();
            outcome = outcome.and(world.actuate("steering", Actuation::Angle(angle)));
        }
        if let Err(error) = outcome {
            let kind = EventKind::Note;
            self.log
                .repeated(now, kind, "not-driven", || error.to_string());
        }
    }

    fn sense(&mut self, now: Instant, world: &World) {
        let mut readings = self.sensors.read(now, &self.config, world);
        let part = f64::from(self.level.get().unsigned_abs()) / 10.0;
        let battery_mv = self.config.battery.millivolts(now - self.began, part);
        readings.battery_mv = match self.faults.is_low {
            true => battery_mv.min(LOW_MV),
            false => battery_mv,
        };
        if readings.battery_mv < LEAST_MV {
            let detail = format!(
                "{} mV, the electronics need {LEAST_MV}",
                readings.battery_mv
            );
            self.log.note(now, "undervoltage", detail);
            return self.switch_off(now);
        }
        let frame = match self.last {
            Some(last) if self.faults.is_stuck => last,
            _ => readings.encode(),
        };
        self.last = Some(frame);
        if self.frames.len() + frame.as_bytes().len() <= QUEUE_MAX {
            self.frames.extend(frame.as_bytes());
        }
    }

    fn switch_off(&mut self, now: Instant) {
        self.faults.is_off = true;
        self.frames.clear();
        (self.frame_at, self.silent_at) = (None, None);
        self.changed_at = Some(now);
    }

    /// Sets the state after power-up: the motor stands, the counts are 0.
    fn reset(&mut self, now: Instant) {
        self.faults.is_off = false;
        self.frames.clear();
        self.sensors.reset();
        (self.level, self.is_silent) = (Level::STOP, false);
        (self.silent_at, self.last) = (None, None);
        self.frame_at = Some(now + self.period());
        self.changed_at = Some(now);
        self.log.note(now, "reset", "the motor stands".to_owned());
    }

    fn period(&self) -> Duration {
        self.faults.period.unwrap_or(self.config.frame_period)
    }

    fn sensor_fault(&mut self, now: Instant, fault: &str, begins: bool) {
        let [front, right, left] = &mut self.sensors.ultrasonic;
        match fault {
            "hall" => self.sensors.is_hall_dead = begins,
            "line" => self.sensors.line_stuck = begins.then_some(1),
            "front" => front.set_fault(now, "deaf", None, begins),
            "right" => right.set_fault(now, "deaf", None, begins),
            "left" => left.set_fault(now, "deaf", None, begins),
            _ => {}
        }
    }
}

/// The valid command nearest to the requested one.
fn clamped(error: CommandError) -> Command {
    let nearest =
        |found: i16, [least, greatest]: [i8; 2]| found.clamp(least.into(), greatest.into());
    match error {
        CommandError::Level { found } => {
            let level = Level::new(nearest(found, Level::RANGE));
            Command::Motor(level.unwrap_or_default())
        }
        CommandError::Steering { found } => {
            let value = Steering::new(nearest(found, Steering::RANGE));
            Command::Steering(value.unwrap_or_default())
        }
        _ => Command::Motor(Level::STOP),
    }
}

impl Device for CarBoard {
    fn receive(&mut self, _port: Port, now: Instant, bytes: &[u8]) {
        if !self.faults.is_off {
            for byte in bytes {
                self.obey(now, *byte);
            }
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        let is_due = self.silent_at.take_if(|at| *at <= now).is_some();
        if is_due && !self.is_silent && self.level != Level::STOP {
            self.is_silent = true;
            self.changed_at.get_or_insert(now);
            let detail = "the host is silent: the motor stops".to_owned();
            self.log.note(now, "dead-man", detail);
        }
        if self.changed_at.take().is_some() {
            self.drive(now, world);
        }
        if let Some(due) = self.frame_at.take_if(|at| *at <= now) {
            // A board that was polled late continues from then.
            self.frame_at = Some((due + self.period()).max(now));
            self.sense(now, world);
            if self.changed_at.take().is_some() {
                self.drive(now, world);
            }
        }
        self.log.poll(now);
    }

    fn transmit(&mut self, _port: Port, buf: &mut [u8]) -> usize {
        take(&mut self.frames, buf)
    }

    fn may_send(&self, _port: Port) -> bool {
        !self.frames.is_empty()
    }

    fn poll_at(&self) -> Option<Instant> {
        let log = self.log.poll_at();
        earliest([self.changed_at, self.silent_at, self.frame_at, log])
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        LineConfig::new_8n1(BAUD)
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &FAULTS
    }

    /// `off`, `restart`; `stuck`: the last frame forever. `slow`: this many milliseconds between
    /// frames, 1000 by default. `battery-low`: 6.85 V. `motor`, `servo`: no effect any more.
    /// `hall`: no pulses. `line`: a line everywhere. `front`, `right`, `left`: no echo.
    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        match fault {
            "off" if begins => self.switch_off(now),
            "off" => self.reset(now),
            "restart" if begins && !self.faults.is_off => self.reset(now),
            "stuck" => self.faults.is_stuck = begins,
            "slow" => {
                let millis = figure.unwrap_or(1_000.0).clamp(1.0, 1e6);
                self.faults.period = begins.then(|| Duration::from_secs_f64(millis / 1e3));
            }
            "battery-low" => self.faults.is_low = begins,
            "motor" | "servo" => {
                let is_dead = match fault {
                    "motor" => &mut self.faults.is_motor_dead,
                    _ => &mut self.faults.is_servo_dead,
                };
                *is_dead = begins;
                self.changed_at.get_or_insert(now);
            }
            _ => self.sensor_fault(now, fault, begins),
        }
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }
}
