//! A motor board without a processor of its own: timers that count wheel encoders, PWM for two
//! bridges, one ADC behind a multiplexer with infrared range sensors, a button, a battery.
//!
//! ```text
//! each millisecond:  counters, ADC, supply, button  -> sample frame
//! outputs frame   -> duties of two bridges, their enable, channel of the multiplexer
//! ```
//!
//! The wire is [`protocols::peripherals`]. The controller that closes the loop is at its other end:
//! the board holds the last duty forever, and has no watchdog. It drives the motors `left` and
//! `right` of the world's chassis and counts that chassis's encoders of the same names.

mod config;
mod drive;
mod fault;
mod infrared;

use std::collections::VecDeque;

use core::time::Duration;

use protocols::peripherals::{
    ADC_MAX, CHANNELS, DUTY_MAX, Outputs, OutputsDecoder, SAMPLE_LEN, Sample,
};
use protocols::{Decode as _, Instant, LineConfig, Port};

use crate::device::{BrokenRules, Device, Event, EventKind, earliest, next_multiple, take};
use crate::event_log::EventLog;
use crate::rng::Rng;
use crate::world::{ActuatorKind, Chassis, World};

pub use config::{Config, MotorConfig, Press, RangeSensor};
use drive::{Battery, Counters, Drives};
use fault::Faults;
use infrared::Infrared;

/// Rate of the wire: a sample takes 12 us, so it is nearly as recent as a register.
pub const BAUD: u32 = 10_000_000;
/// Time between two samples.
const PERIOD: Duration = Duration::from_millis(1);
/// Pause that ends a half-received frame.
const IDLE_GAP: Duration = Duration::from_micros(500);
/// Full scale of the ADC, volts.
const REFERENCE_V: f64 = 3.3;
/// Duty at which a motor stands: half of the time forward, half of it back.
const STOP: u16 = DUTY_MAX / 2;

/// The board.
#[derive(Clone, Debug)]
pub struct WheelBoard {
    config: Config,
    decoder: OutputsDecoder,
    heard_at: Instant,
    outputs: Outputs,
    /// Outputs that the bridges have not taken yet.
    is_news: bool,
    drives: Drives,
    counters: Counters,
    battery: Battery,
    infrared: Infrared,
    garbage: Rng,
    faults: Faults,
    is_down: bool,
    next_at: Instant,
    queue: VecDeque<u8>,
    log: EventLog,
}

impl WheelBoard {
    /// The only port.
    pub const BUS: Port = Port(0);

    /// A board that is up as the run begins, its bridges off. Its random streams are those of
    /// `seed` whose names begin with `name`.
    pub fn new(name: &str, seed: u64, config: Config) -> Self {
        Self {
            decoder: OutputsDecoder::default(),
            heard_at: Instant::ZERO,
            outputs: AT_RESET,
            is_news: true,
            drives: Drives::new(name, seed, &config),
            counters: Counters::new(config.mirrored),
            battery: Battery::new(&config),
            infrared: Infrared::new(name, seed, &config),
            garbage: Rng::stream(seed, &format!("{name}.garbage")),
            faults: Faults::default(),
            is_down: false,
            next_at: Instant::ZERO + PERIOD,
            queue: VecDeque::new(),
            log: EventLog::default(),
            config,
        }
    }

    /// Its configuration.
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// Last values set by the master.
    pub const fn outputs(&self) -> Outputs {
        self.outputs
    }

    /// Speeds of the left and right rim that correspond to the outputs by the motors' nominal
    /// figures, m/s forward; 0 while the bridges are off.
    pub fn set_points(&self) -> [f64; 2] {
        self.config.set_points(self.outputs)
    }

    /// Speed constants of the left and right motor as they are, rpm/V.
    pub const fn rpm_per_v(&self) -> [f64; 2] {
        self.drives.rpm_per_v()
    }

    /// Counters of the left and right encoder.
    pub fn counters(&self) -> [u16; 2] {
        self.counters.values()
    }

    /// Voltages that the range sensors hold.
    pub fn range_volts(&self) -> impl Iterator<Item = f64> + '_ {
        self.infrared.volts()
    }

    /// Voltage of the battery.
    pub const fn supply_v(&self) -> f64 {
        self.battery.volts()
    }

    /// Whether `chassis` has motors and encoders `left` and `right`.
    ///
    /// # Errors
    /// The first missing motor or encoder.
    pub fn check_chassis(chassis: &dyn Chassis) -> Result<(), String> {
        for name in ["left", "right"] {
            let mut motors = chassis.actuators().iter();
            if !motors.any(|it| it.kind == ActuatorKind::Motor && it.name == name) {
                return Err(format!("the chassis has no motor \"{name}\""));
            }
            if !chassis.encoders().iter().any(|it| it.name == name) {
                return Err(format!("the chassis has no encoder \"{name}\""));
            }
        }
        Ok(())
    }

    fn hear(&mut self, now: Instant, outputs: Outputs) {
        let before = self.outputs;
        self.outputs = outputs;
        self.is_news = true;
        if outputs.enable != before.enable {
            let rule = if outputs.enable {
                "drivers-on"
            } else {
                "drivers-off"
            };
            let duty = outputs.duty;
            self.log.note(now, rule, format!("duty {duty:?} of 10000"));
        }
        if !outputs.enable && outputs.duty.iter().any(|duty| *duty != STOP) {
            let detail = || format!("duty {:?} of 10000 while the bridges are off", outputs.duty);
            self.log
                .repeated(now, EventKind::Note, "duty-without-driver", detail);
        }
        if usize::from(outputs.channel) >= self.config.range_sensors.len() {
            let detail = || format!("nothing is connected to channel {}", outputs.channel);
            self.log
                .repeated(now, EventKind::Violation, "open-channel", detail);
        }
    }

    fn tell_bad_frame(&mut self, now: Instant, error: protocols::FrameError) {
        self.log
            .repeated(now, EventKind::Violation, "bad-frame", || error.to_string());
    }

    /// Current values for the master.
    fn sample(&mut self, now: Instant) -> Sample {
        let channel = self.outputs.channel.min(CHANNELS - 1);
        let noise = self.garbage.uniform();
        let part = if self.faults.garbage {
            noise
        } else {
            self.infrared.volts_of(channel.into()) / REFERENCE_V
        };
        Sample {
            counters: self.counters.values(),
            adc: whole(part * f64::from(ADC_MAX)).min(ADC_MAX),
            channel,
            supply_cv: whole(self.battery.volts() * 100.0),
            button: self.config.presses.iter().any(|press| press.holds(now)),
        }
    }

    /// The registers of a chip that has just started.
    fn reset(&mut self) {
        self.decoder = OutputsDecoder::default();
        self.outputs = AT_RESET;
        self.is_news = true;
        self.counters.reset();
        self.queue.clear();
    }

    fn tick(&mut self, now: Instant, world: &World) {
        self.counters.look(world, &self.faults);
        let duty = self.drives.effort();
        if self.battery.drain(now, duty) {
            self.is_news = true;
        }
        self.infrared.measure(now, world, &self.faults);
        if self.decoder.pending() > 0 && now - self.heard_at >= IDLE_GAP {
            self.decoder.idle();
            let cut: Vec<_> = self.decoder.push(&[]).filter_map(Result::err).collect();
            cut.into_iter()
                .for_each(|error| self.tell_bad_frame(now, error));
        }
        if self.is_down {
            return;
        }
        let sample = self.sample(now);
        // The next sample overwrites one that was not read, like the content of a register.
        if self.queue.len() < SAMPLE_LEN {
            self.queue.extend(sample.encode());
        }
    }
}

/// Bridges off, motors at rest.
const AT_RESET: Outputs = Outputs {
    duty: [STOP; 2],
    channel: 0,
    enable: false,
};

/// The nearest whole number of 16 bits.
fn whole(value: f64) -> u16 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the cast stops at the limits of 16 bits"
    )]
    let value = libm::round(value) as u16;
    value
}

impl Device for WheelBoard {
    fn receive(&mut self, _: Port, now: Instant, bytes: &[u8]) {
        if self.is_down {
            return;
        }
        self.heard_at = now;
        let heard: Vec<_> = self.decoder.push(bytes).collect();
        for heard in heard {
            match heard {
                Ok(outputs) => self.hear(now, outputs),
                Err(error) => self.tell_bad_frame(now, error),
            }
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        self.log.poll(now);
        world.advance(now);
        if self.next_at <= now {
            self.tick(now, world);
            self.next_at = next_multiple(now, PERIOD);
        }
        if core::mem::take(&mut self.is_news) {
            let volts = self.battery.volts();
            self.drives
                .apply(world, self.outputs, volts, self.faults.speed);
        }
    }

    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        take(&mut self.queue, buf)
    }

    fn may_send(&self, _: Port) -> bool {
        !self.queue.is_empty()
    }

    fn poll_at(&self) -> Option<Instant> {
        earliest([Some(self.next_at), self.log.poll_at()])
    }

    fn line_config(&self, _: Port) -> LineConfig {
        LineConfig::new_8n1(BAUD)
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &fault::NAMES
    }

    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        match fault {
            "off" => {
                self.is_down = begins;
                self.reset();
                let rule = if begins { "power-off" } else { "power-on" };
                self.log.note(now, rule, "counters are 0".to_owned());
            }
            "restart" if begins => {
                self.reset();
                self.log
                    .note(now, "restart", "counters are 0, bridges are off".to_owned());
            }
            _ => self.faults.set(fault, figure, begins),
        }
        self.is_news = true;
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }
}

#[cfg(test)]
mod tests;
