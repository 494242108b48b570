//! RPLIDAR A1: a turning head that is silent until a request, and then streams nodes or capsules.
//!
//! ```text
//! OFF -> IDLE -- scan request: descriptor --> STARTING -- even rotation --> SCANNING
//!          ^                                     ^                           |   |
//!          |                                     +--- uneven or too slow ----+   | laser fails
//!          |                                     |                               v
//!          +------------ reset: start text ------+-- for 2 s ---------> PROTECTION STOP
//! ```
//!
//! Any request ends a scan and is then handled; further ones wait for their turn. In Protection
//! Stop scan requests are ignored: the host receives nothing unless it asks for the health.
//!
//! | module | is |
//! |---|---|
//! | `profile` | differences between firmware versions |
//! | `motor` | motor, friction, controls |
//! | `beam` | one beam from world to distance |
//! | `request` | requests of the host, and their times |
//! | `answer` | answers |
//! | `scan` | rotation, samples, nodes and capsules |
//! | `output` | the transmitter and damage to its bytes |
//! | [`fault`](Fault) | faults |
//!
//! Sources: protocol document LR001 v1.0, data sheet LD108 v1.0, the vendor's public SDK, what
//! users print of their sensors (named at the profile), reports of users (named at the faults). No
//! raw capture of an A1 is public: single bytes are known, statistics are not.

mod answer;
mod beam;
mod fault;
mod motor;
mod output;
mod profile;
mod request;
mod scan;
#[cfg(test)]
mod tests;

use protocols::rplidar::{self, RequestDecoder, Requests};
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::device::{BrokenRules, Device, Event, EventKind, earliest};
use crate::event_log::EventLog;
use crate::lidar::Mount;
use crate::lidar::rotor::Rotor;
use crate::rng::Rng;
use crate::world::World;
use beam::Optics;
use fault::Faults;
use output::Output;
use request::Handling;
use scan::Phase;

pub use fault::Fault;
pub use motor::MotorControl;
pub use profile::Profile;

/// Everything about a sensor that differs between units and robots.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Firmware.
    pub profile: Profile,
    /// Drive of the head.
    pub motor: MotorControl,
    /// Mount on the robot; its angle 0 looks along the mount's bearing.
    pub mount: Mount,
    /// Initial faults, with their figures if these are not the default.
    pub faults: Vec<(Fault, Option<f64>)>,
}

impl Default for Config {
    /// In the middle of the robot, angle 0 ahead.
    fn default() -> Self {
        Self {
            profile: Profile::default(),
            motor: MotorControl::default(),
            mount: Mount {
                x_m: 0.0,
                y_m: 0.0,
                yaw_deg: 0.0,
            },
            faults: Vec::new(),
        }
    }
}

/// State of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Power is off.
    Off,
    /// Waits for a request.
    Idle,
    /// Has a scan request and waits for an even rotation.
    Starting,
    /// Sends nodes or capsules.
    Scanning,
    /// Has protected itself; only a reset ends it.
    ProtectionStop,
}

/// Maximum work in one poll; a device that was polled later continues at the next poll.
const STEPS_PER_POLL_MAX: u32 = 20_000;
/// Line coding of the UART.
const LINE: LineConfig = LineConfig::new_8n1(rplidar::BAUD);
/// Line coding of a UART that was set up for another sensor of the family.
const WRONG_LINE: LineConfig = LineConfig::new_8n1(256_000);

/// An RPLIDAR A1.
#[derive(Clone, Debug)]
pub struct Rplidar {
    profile: Profile,
    motor: MotorControl,
    rotor: Rotor,
    /// Level of DTR; low before the adapter's port is opened.
    dtr_high: bool,
    optics: Optics,
    requests: RequestDecoder,
    /// Time at which a partial request is discarded.
    give_up_at: Option<Instant>,
    handling: Handling,
    phase: Phase,
    output: Output,
    faults: Faults,
    /// Random numbers: whether a start fails, and how.
    starts: Rng,
    /// Random numbers: variation of the motor and its disturbances.
    drive: Rng,
    log: EventLog,
}

impl Rplidar {
    /// The serial port: requests in, answers and scans out.
    pub const UART: Port = Port(0);
    /// The motor pin MOTOCTL: each byte in is the duty from now on, 255 is always on. Used with
    /// [`MotorControl::Pwm`].
    pub const MOTOR: Port = Port(1);
    /// The line DTR: each byte in is its level, 0 low. Used with [`MotorControl::Dtr`].
    pub const DTR: Port = Port(2);

    /// A sensor that was switched on before the run begins: it has already sent its start text.
    /// `name` and `seed` choose its noise.
    pub fn new(name: &str, seed: u64, config: Config) -> Self {
        let stream = |part: &str| Rng::stream(seed, &format!("{name}.{part}"));
        let angle_deg = stream("angle").range(0.0, 360.0);
        let mut sensor = Self {
            profile: config.profile,
            motor: config.motor,
            rotor: motor::rotor(config.motor, angle_deg),
            dtr_high: false,
            optics: Optics::new(config.mount, ["beam", "range", "light"].map(stream)),
            requests: RequestDecoder::with_format(Requests),
            give_up_at: None,
            handling: Handling::default(),
            phase: Phase::Idle,
            output: Output::new(stream("loss"), stream("garbage")),
            faults: Faults::default(),
            starts: stream("starts"),
            drive: stream("drive"),
            log: EventLog::default(),
        };
        for (fault, figure) in config.faults {
            sensor.set_fault(Instant::ZERO, fault, figure);
        }
        sensor
    }

    /// Begins a fault at `now`; `figure` replaces the usual one, see [`Fault`].
    pub fn set_fault(&mut self, now: Instant, fault: Fault, figure: Option<f64>) {
        self.faults.set(fault, figure);
        self.faults_changed(now);
        match fault {
            Fault::Off => self.power_off(now),
            Fault::Restart => {
                self.faults.clear(fault);
                self.restart(now, "restarted", "the processor restarts");
            }
            _ => {}
        }
    }

    /// Ends a fault at `now`.
    pub fn clear_fault(&mut self, now: Instant, fault: Fault) {
        let was_off = self.faults.has(Fault::Off);
        self.faults.clear(fault);
        if fault == Fault::Burst {
            self.output.end_burst();
        }
        self.faults_changed(now);
        if was_off && !self.faults.has(Fault::Off) {
            self.phase = Phase::Idle;
            self.handling = Handling::starting(now);
        }
    }

    /// State of the sensor.
    pub const fn state(&self) -> State {
        match self.phase {
            Phase::Off => State::Off,
            Phase::Idle => State::Idle,
            Phase::Starting(_) => State::Starting,
            Phase::Scanning(_) => State::Scanning,
            Phase::ProtectionStop { .. } => State::ProtectionStop,
        }
    }

    /// True speed of the head when it was last computed.
    pub fn speed_rpm(&self) -> f64 {
        self.rotor.speed_rpm()
    }

    /// Packets dropped because the line did not take them.
    pub const fn dropped(&self) -> u64 {
        self.output.dropped()
    }

    fn faults_changed(&mut self, now: Instant) {
        self.rotor.advance(now);
        self.drive_by_dtr(now);
        self.rotor.stuck = self.faults.has(Fault::Stuck);
        self.rotor.unpowered = self.faults.has(Fault::Off);
        self.rotor.dust_rpm_s = self.faults.figure(Fault::Dust).unwrap_or(0.0);
        self.optics.dark = self.faults.has(Fault::Dark);
        self.optics.range_factor = self.faults.figure(Fault::Wrong).unwrap_or(1.0);
        self.optics.turned_deg = self.faults.figure(Fault::Turned).unwrap_or(0.0);
        self.optics.mirrored = self.faults.has(Fault::Mirrored);
    }

    fn power_off(&mut self, now: Instant) {
        self.restart(now, "powered-off", "no supply");
        self.handling = Handling::default();
        self.output.clear();
        self.phase = Phase::Off;
    }

    /// Forgets everything except the bytes on the line, and prints the start text once it is up
    /// again.
    fn restart(&mut self, now: Instant, rule: &'static str, detail: &str) {
        if self.phase == Phase::Off {
            return;
        }
        self.requests = RequestDecoder::with_format(Requests);
        self.give_up_at = None;
        self.handling = Handling::starting(now);
        self.phase = Phase::Idle;
        self.log.note(now, rule, detail.to_owned());
    }

    /// Time of the sensor's next own action.
    fn next_at(&self) -> Option<Instant> {
        earliest([
            self.handling.next_at(),
            self.give_up_at,
            self.phase.next_at(),
        ])
    }

    /// Handles one action that is due at `at`.
    fn step(&mut self, at: Instant, world: &World) {
        if self.give_up_at.is_some_and(|due| due <= at) {
            self.give_up_request(at);
        } else if self.handling.next_at().is_some_and(|due| due <= at) {
            self.handle(at);
        } else {
            self.scan(at, world);
        }
    }
}

impl Device for Rplidar {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        let last = *bytes.last().expect("receive is given bytes");
        match port {
            Self::MOTOR => self.set_duty(now, f64::from(last) / 255.0),
            Self::DTR => self.set_dtr(now, last != 0),
            _ => self.host_bytes(now, bytes),
        }
    }

    /// A closed port does not end a scan: the sensor gets no notice.
    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        if port != Self::UART || self.phase == Phase::Off {
            return;
        }
        if event == LineEvent::Break {
            // Its UART drops a byte without a stop bit.
            let detail = "a break: the sensor drops it".to_owned();
            self.log.note(now, "break", detail);
        }
        if event == LineEvent::FramingError {
            let detail = || "a character without stop bit: noise, or not 115200 baud".to_owned();
            let kind = EventKind::Violation;
            self.log.repeated(now, kind, "framing-error", detail);
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        self.log.poll(now);
        world.advance(now);
        for _ in 0..STEPS_PER_POLL_MAX {
            match self.next_at() {
                Some(at) if at <= now => self.step(at, world),
                _ => break,
            }
        }
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        if port == Self::UART {
            self.output.transmit(buf)
        } else {
            0
        }
    }

    fn may_send(&self, port: Port) -> bool {
        port == Self::UART && self.output.has_bytes()
    }

    fn poll_at(&self) -> Option<Instant> {
        earliest([self.next_at(), self.log.poll_at()])
    }

    fn line_config(&self, port: Port) -> LineConfig {
        if port == Self::UART && self.faults.has(Fault::WrongRate) {
            WRONG_LINE
        } else {
            LINE
        }
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &Fault::NAMES
    }

    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        match Fault::named(fault, figure) {
            Some((fault, figure)) if begins => Self::set_fault(self, now, fault, figure),
            Some((fault, _)) => self.clear_fault(now, fault),
            None => {}
        }
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }
}
