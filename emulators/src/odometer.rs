//! A microcontroller that counts a wheel's encoder, integrates a gyroscope and prints a line a
//! loop: the Arduino MEGA2560 of a model car.
//!
//! ```text
//! reset -> bootloader -> look for the sensor -> calibrate at rest -> loop: look at the encoder,
//!          833 ms        7.6 ms                 257 ms               read the gyroscope, add to
//!                        (not there: words each 500.6 ms)            the heading, print
//! ```
//!
//! The sensor's library waits for its bytes without a timeout. If the sensor is lost while the loop
//! runs, the board is silent until a reset.
//!
//! Lines are those of [`protocols::odometer`]. Opening its port resets the board, as its USB side
//! does, and all figures begin at 0 again. The program assumes 10 ms a loop to integrate the
//! heading, but a loop lasts a little longer. After a loop of more than 10 ms,
//! `delay(10 - elapsed)` waits for 49 days.
//!
//! Sources: sketch of March 2016 and the one after it; figures of the timing from both on a
//! simulated chip: first line after 265 ms, 997 lines in 10 s, 94 a second over the first five
//! seconds after a reset; the later sketch 1.409 s and 9.88 ms. The MEGA2560's bootloader waits
//! before it starts them.

mod encoder;
mod sketch;
#[cfg(test)]
mod tests;

use core::f64::consts::TAU;
use core::time::Duration;
use std::collections::VecDeque;

use protocols::odometer::BAUD;
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::device::{BrokenRules, Device, Event, EventKind, earliest, take};
use crate::event_log::EventLog;
use crate::i2c::RegisterChip as _;
use crate::mpu6050::{Mpu6050, Mpu6050Config};
use crate::rng::Rng;
use crate::world::World;
pub use encoder::PolledEncoder;
use sketch::Sketch;
pub use sketch::{Overrun, Program};

/// Bytes that wait for the line at most; a line that does not fit is lost.
const QUEUE_MAX: usize = 512;
/// Time from the start of the program to its first look at the sensor.
const FIRST_LOOK: Duration = Duration::from_micros(7_600);
/// Time between two messages about a missing sensor.
const COMPLAINT_PERIOD: Duration = Duration::from_micros(500_600);

/// Configuration of the board.
#[derive(Clone, Debug, PartialEq)]
pub struct OdometerConfig {
    /// Kind of its output.
    pub program: Program,
    /// Reaction to a loop that takes too long.
    pub overrun: Overrun,
    /// Encoder of the chassis whose axis turns with the contacts.
    pub encoder: String,
    /// Edges of the contacts a metre of rim.
    pub edges_per_m: f64,
    /// From one loop to the next, in the mean.
    pub loop_period: Duration,
    /// Maximum deviation, more or less, evenly distributed.
    pub jitter: Duration,
    /// From the start of the program to its first line.
    pub calibration: Duration,
    /// From a reset to the start of the program: the bootloader waits for an upload.
    pub boot: Duration,
    /// Whether the sensor of the later sketch has a magnetometer, as the report says; the figures
    /// of the published sketch read 0.
    pub has_compass: bool,
    /// The sensor.
    pub imu: Mpu6050Config,
    /// Seed of noise and jitter.
    pub seed: u64,
}

impl Default for OdometerConfig {
    /// 60 edges a turn of a wheel of 32 mm. The jitter is fitted: 0.98 of the edges at 0.33 m/s.
    fn default() -> Self {
        Self {
            program: Program::default(),
            overrun: Overrun::default(),
            encoder: "drive".to_owned(),
            edges_per_m: 60.0 / (TAU * 0.032),
            loop_period: Duration::from_micros(10_030),
            jitter: Duration::from_micros(600),
            calibration: Duration::from_millis(265),
            boot: Duration::from_millis(833),
            has_compass: false,
            imu: Mpu6050Config::default(),
            seed: 1,
        }
    }
}

impl OdometerConfig {
    /// The usual board with this program.
    pub fn of(program: Program) -> Self {
        let usual = Self {
            program,
            ..Self::default()
        };
        match program {
            Program::Pose(_) => usual,
            Program::Raw => Self {
                loop_period: Duration::from_micros(9_880),
                calibration: Duration::from_millis(1_409),
                ..usual
            },
        }
    }
}

/// State of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Without supply.
    Off,
    /// Looks for its sensor at this time.
    Looks(Instant),
    /// Has found its sensor, and calibrates it until this time.
    Calibrates(Instant),
    /// The next loop begins at this time.
    Runs(Instant),
    /// Waits forever.
    Hangs,
}

impl State {
    /// A program that starts at `now`.
    fn started(now: Instant) -> Self {
        Self::Looks(now + FIRST_LOOK)
    }
}

/// Names of the faults.
const FAULTS: [&str; 10] = [
    "off",
    "restart",
    "stuck",
    "slow",
    "wrong",
    "worn",
    "iron",
    "imu-off",
    "imu-stuck",
    "imu-wrong",
];

/// The board.
#[derive(Clone, Debug)]
pub struct Odometer {
    config: OdometerConfig,
    state: State,
    /// The last reset.
    began: Instant,
    sketch: Sketch,
    imu: Mpu6050,
    timing: Rng,
    contacts: Rng,
    /// Duration of a loop that a fault slows down.
    work: Option<Duration>,
    /// Chance that a contact is open at a look.
    wear: f64,
    /// The wires of the contacts are exchanged.
    is_swapped: bool,
    /// Magnetic field of nearby iron, uT.
    iron_ut: f32,
    lines: VecDeque<u8>,
    log: EventLog,
}

impl Odometer {
    /// The USB port.
    pub const UART: Port = Port(0);

    /// A board whose program starts as the run begins.
    pub fn new(config: OdometerConfig) -> Self {
        let seed = config.seed;
        Self {
            state: State::started(Instant::ZERO),
            began: Instant::ZERO,
            sketch: Sketch::default(),
            imu: Mpu6050::new(config.imu.clone(), seed, "odometer.imu"),
            timing: Rng::stream(seed, "odometer.timing"),
            contacts: Rng::stream(seed, "odometer.contacts"),
            work: None,
            wear: 0.0,
            is_swapped: false,
            iron_ut: 0.0,
            lines: VecDeque::new(),
            log: EventLog::default(),
            config,
        }
    }

    /// Count of the program since its reset; a test's view of the device.
    pub fn counted(&self) -> i64 {
        self.sketch.counted()
    }

    fn reset(&mut self, now: Instant) {
        self.lines.clear();
        self.began = now + self.config.boot;
        self.state = State::started(self.began);
        self.log
            .note(now, "reset", "distance and time are 0".to_owned());
    }

    fn print(&mut self, now: Instant, line: &[u8]) {
        if self.lines.len() + line.len() <= QUEUE_MAX {
            self.lines.extend(line);
        } else {
            let detail = || format!("{} bytes wait already", self.lines.len());
            let kind = EventKind::Note;
            self.log.repeated(now, kind, "line-lost", detail);
        }
    }

    fn edges(&self, world: &World) -> i64 {
        let encoders = world.encoders().iter();
        let Some(index) = encoders
            .clone()
            .position(|it| it.name == self.config.encoder)
        else {
            return 0;
        };
        let counts = world.encoder(index).unwrap_or_default();
        let per_count = self.config.edges_per_m / world.encoders()[index].counts_per_m;
        // Equal rates must not lose an edge to rounding.
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_precision_loss,
            reason = "counts are far below 2^53"
        )]
        let edges = (counts as f64 * per_count + 1e-6).floor() as i64;
        if self.is_swapped { -edges } else { edges }
    }

    /// Polls for the sensor.
    fn look(&mut self, now: Instant, world: &World) {
        if sketch::finds(now, &mut self.imu, world) {
            let rest = self.config.calibration.saturating_sub(FIRST_LOOK);
            self.state = State::Calibrates(now + rest);
        } else {
            self.print(
                now,
                b"Could not find a valid MPU6050 sensor, check wiring!\r\n",
            );
            self.state = State::Looks(now + COMPLAINT_PERIOD);
        }
    }

    /// The sensor is calibrated; one that is lost meanwhile silences the program.
    fn start(&mut self, now: Instant, world: &World) {
        let edges = self.edges(world);
        let is_there = self
            .sketch
            .begin((now, self.began), edges, &mut self.imu, world);
        self.state = if is_there {
            State::Runs(now)
        } else {
            self.wait_for_sensor(now)
        };
    }

    fn wait_for_sensor(&mut self, now: Instant) -> State {
        let detail = "the sensor is lost: the program waits for its bytes until a reset";
        self.log.note(now, "waits-for-sensor", detail.to_owned());
        State::Hangs
    }

    /// One loop.
    fn turn(&mut self, now: Instant, world: &World) {
        let is_open = self.contacts.chance(self.wear);
        let jitter_s = self.config.jitter.as_secs_f64() * self.timing.range(-1.0, 1.0);
        let edges = self.edges(world);
        let sketch = &mut self.sketch;
        let field = self.config.has_compass.then_some(self.iron_ut);
        let line = sketch.turn(
            now,
            (edges, is_open),
            (self.config.program, field),
            &mut self.imu,
            world,
        );
        let Some(line) = line else {
            self.state = self.wait_for_sensor(now);
            return;
        };
        self.print(now, &line);
        let usual_s = (self.config.loop_period.as_secs_f64() + jitter_s).max(1e-3);
        let usual = Duration::from_secs_f64(usual_s);
        self.state = match self.work {
            Some(work) if work > self.config.loop_period => {
                self.log.repeated(now, EventKind::Note, "overrun", || {
                    format!("a loop took {} ms", work.as_millis())
                });
                match self.config.overrun {
                    Overrun::Hangs => State::Hangs,
                    Overrun::IsLate => State::Runs(now + work),
                }
            }
            _ => State::Runs(now + usual),
        };
    }
}

impl Device for Odometer {
    /// The program does not listen.
    fn receive(&mut self, _port: Port, _now: Instant, _bytes: &[u8]) {}

    fn line_event(&mut self, _port: Port, now: Instant, event: LineEvent) {
        if event == LineEvent::Opened && self.state != State::Off {
            self.reset(now);
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        match self.state {
            State::Looks(at) if at <= now => self.look(now, world),
            State::Calibrates(at) if at <= now => self.start(now, world),
            _ => {}
        }
        match self.state {
            State::Runs(at) if at <= now => self.turn(now, world),
            _ => {}
        }
        self.log.poll(now);
    }

    fn transmit(&mut self, _port: Port, buf: &mut [u8]) -> usize {
        take(&mut self.lines, buf)
    }

    fn may_send(&self, _port: Port) -> bool {
        !self.lines.is_empty()
    }

    fn poll_at(&self) -> Option<Instant> {
        let own = match self.state {
            State::Looks(at) | State::Calibrates(at) | State::Runs(at) => Some(at),
            State::Off | State::Hangs => None,
        };
        earliest([own, self.log.poll_at()])
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        LineConfig::new_8n1(BAUD)
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &FAULTS
    }

    /// `off`: no supply. `restart`: a reset. `stuck`: the program hangs until a reset. `slow`: a
    /// loop works for so many milliseconds, 12 by default. `wrong`: the encoder's wires are
    /// exchanged. `worn`: chance that a contact is open at a look, 0.2 by default. `iron`: so
    /// many microtesla more along y of the world, 40 by default. `imu-..`: as the sensor's own.
    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        match fault {
            "off" if begins => {
                self.lines.clear();
                self.state = State::Off;
            }
            "off" => self.reset(now),
            "restart" if begins && self.state != State::Off => self.reset(now),
            "stuck" if begins => self.state = State::Hangs,
            "slow" => {
                let millis = figure.unwrap_or(12.0).clamp(0.0, 1e6);
                self.work = begins.then(|| Duration::from_secs_f64(millis / 1000.0));
            }
            "wrong" => self.is_swapped = begins,
            "iron" => {
                #[expect(clippy::cast_possible_truncation, reason = "few digits are needed")]
                let field_ut = figure.unwrap_or(40.0).clamp(-1e4, 1e4) as f32;
                self.iron_ut = if begins { field_ut } else { 0.0 };
            }
            "worn" => self.wear = if begins { figure.unwrap_or(0.2) } else { 0.0 },
            _ => {
                if let Some(fault) = fault.strip_prefix("imu-") {
                    self.imu.set_fault(now, fault, figure, begins);
                }
            }
        }
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }
}
