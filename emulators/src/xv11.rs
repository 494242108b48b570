//! Neato XV-11 lidar: a turning head with an encoder ring, one beam per degree, and a firmware
//! that streams without being asked.
//!
//! ```text
//! OFF -> BOOT (text) -> SPIN (waits for the head) -> LOCKED (packets)
//!                         ^                            |  ^
//!                         |              late tooth    v  | second edge
//!                         |                           SLOW (0x22, then 3 x 0x50)
//!   restart after 0.6 s   |              tooth lost    |
//!   without a tooth       +-------- LOST (0x52) <------+
//! ```
//!
//! | module | is |
//! |---|---|
//! | `motor` | figures of motor and friction |
//! | `encoder` | the ring: where the teeth are, early and late |
//! | `scan` | slots of a turn, packets |
//! | `optics`, `eye` | laws of range and strength; one beam from world to reading |
//! | `uart` | the transmitter with its ring |
//! | `firmware` | the states above |
//! | [`fidelity`] | statistics of a byte stream, real or emulated |

mod beam;
mod encoder;
mod fault;
pub mod fidelity;
mod firmware;
mod motor;
mod optics;
mod profile;
mod scan;
mod surface;
#[cfg(test)]
mod tests;
mod uart;

use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::device::{BrokenRules, Device, Event, EventKind, earliest};
use crate::event_log::EventLog;
use crate::lidar::rotor::Rotor;
use crate::rng::Rng;
use crate::world::World;
use beam::Eye;
use encoder::{Encoder, Wander};
use fault::Faults;
use firmware::Firmware;
use uart::Uart;

pub use crate::lidar::{Direction, MotorSupply, Mount};
pub use fault::Fault;
pub(crate) use motor::MOTOR;
pub use optics::{
    Optics, RANGE_MAX_MM, RANGE_MIN_MM, is_weak, range_sigma_mm, strength_mean, strength_sigma,
};
pub use profile::Profile;

/// Everything about a sensor that differs between units and robots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Config {
    /// Firmware generation.
    pub profile: Profile,
    /// Drive of the head.
    pub supply: MotorSupply,
    /// Mounting position on the robot.
    pub mount: Mount,
    /// Geometry of the optics.
    pub optics: Optics,
    /// Amount of modelled variation.
    pub detail: Detail,
    /// Faults from the start.
    pub faults: Vec<Fault>,
}

/// Variation besides the noise of each reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Detail {
    /// Nothing: surfaces are even and alike, and only the edges of the encoder jitter.
    #[default]
    Even,
    /// As in the "hand in box" capture. Belt and gear let the speed wander within a turn. Surfaces
    /// reflect unevenly and are rough, and noise correlates a little from turn to turn.
    Captured,
}

/// State of the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Power is off.
    Off,
    /// About to print the boot text.
    Boot,
    /// Waits for the head to turn evenly.
    Spin,
    /// Sends packets.
    Locked,
    /// A tooth came late: fills in 0x22 until the second edge of the tooth.
    Slow,
    /// A tooth was taken for two: measures at twice the pace and labels angles wrongly.
    Doubled,
    /// Has lost the encoder: sends 0x52 at line rate.
    Lost,
    /// The text console, which ends the stream.
    Console,
}

/// Maximum work in one poll; a device that was polled later continues at the next poll.
const STEPS_PER_POLL_MAX: u32 = 20_000;

/// A Neato XV-11 lidar.
#[derive(Clone, Debug)]
pub struct Xv11 {
    profile: Profile,
    rotor: Rotor,
    encoder: Encoder,
    /// Time of the next tooth; follows from rotor and encoder.
    edge_at: Option<Instant>,
    /// Time of the firmware's next work. Stored, because it is read far more often than it changes.
    work_at: Option<Instant>,
    eye: Eye,
    uart: Uart,
    firmware: Firmware,
    faults: Faults,
    /// Random numbers for the damage in a packet: its position and kind.
    garbage: Rng,
    /// Whether the missing connection of the host's motor drive was already reported.
    duty_told: bool,
    /// The host has ordered a stopped motor, and the rig's regulated supply obeys.
    is_switched_off: bool,
    log: EventLog,
}

impl Xv11 {
    /// The serial port: packets out; three ESC or a break in.
    pub const UART: Port = Port(0);
    /// The motor pin: each byte in is the duty of the host's drive from now on, 255 is always on.
    pub const MOTOR: Port = Port(1);

    /// A sensor that is switched on as the run begins. `name` and `seed` choose its noise.
    pub fn new(name: &str, seed: u64, config: Config) -> Self {
        let rng = |part: &str| Rng::stream(seed, &format!("{name}.{part}"));
        let wander = match config.detail {
            Detail::Even => Wander::none(),
            Detail::Captured => Wander::captured(rng("belt")),
        };
        let mut encoder = Encoder::new(rng("encoder"), wander);
        let angle = encoder.any_angle();
        let mut rotor = Rotor::new(MOTOR, config.supply, angle);
        if encoder.seek(angle) {
            rotor.wrap();
        }
        let mut xv11 = Self {
            profile: config.profile,
            rotor,
            encoder,
            edge_at: None,
            work_at: None,
            eye: Eye::new(config.mount, config.optics, seed, name)
                .of(config.profile, config.detail),
            uart: Uart::default(),
            firmware: Firmware::new(),
            faults: Faults::default(),
            garbage: Rng::stream(seed, &format!("{name}.garbage")),
            duty_told: false,
            is_switched_off: false,
            log: EventLog::default(),
        };
        xv11.plan();
        for fault in config.faults {
            xv11.set_fault(Instant::ZERO, fault);
        }
        xv11.foresee();
        xv11
    }

    /// Begins a fault at `now`.
    pub fn set_fault(&mut self, now: Instant, fault: Fault) {
        self.faults.set(fault);
        self.faults_changed(now);
        match fault {
            Fault::Off => self.switch_off(now),
            Fault::Restart => {
                self.faults.clear(fault);
                self.order_restart(now);
            }
            _ => {}
        }
        self.foresee();
    }

    /// Clears a fault at `now`, whatever its figure.
    pub fn clear_fault(&mut self, now: Instant, fault: Fault) {
        let was_off = self.faults.has(Fault::Off);
        self.faults.clear(fault);
        self.faults_changed(now);
        if was_off && !self.faults.has(Fault::Off) {
            self.switch_on(now);
        }
        self.foresee();
    }

    /// Changes the supply of the motor from `now` on.
    pub fn set_supply(&mut self, now: Instant, supply: MotorSupply) {
        self.rotor.advance(now);
        self.rotor.supply = supply;
        self.plan();
    }

    /// State of the firmware.
    pub fn state(&self) -> State {
        self.firmware.state()
    }

    /// True speed of the head at the last tooth or change of drive.
    pub fn speed_rpm(&self) -> f64 {
        self.rotor.speed_rpm()
    }

    /// Packets the firmware has dropped because its transmitter was full.
    pub const fn dropped(&self) -> u64 {
        self.uart.dropped()
    }

    /// Time of the sensor's next own action.
    fn next_at(&self) -> Option<Instant> {
        earliest([self.uart.release_at(), self.edge_at, self.work_at])
    }

    /// Computes the time of the firmware's next work, after any event for the firmware.
    fn foresee(&mut self) {
        self.work_at = self.firmware.next_at(&self.uart);
    }

    fn faults_changed(&mut self, now: Instant) {
        self.rotor.advance(now);
        self.rotor.dust_rpm_s = self.faults.dust_rpm_s();
        self.rotor.stuck = self.faults.has(Fault::Stuck);
        self.rotor.unpowered = self.faults.has(Fault::Off) || self.is_switched_off;
        self.eye.dark = self.faults.has(Fault::Dark);
        self.eye.range_factor = self.faults.range_factor();
        self.plan();
    }

    /// Computes the time at which the next tooth passes.
    fn plan(&mut self) {
        self.edge_at = self.rotor.reaches(self.encoder.edge_deg());
    }

    fn set_duty(&mut self, now: Instant, duty: u8) {
        if !matches!(self.rotor.supply, MotorSupply::Host { .. }) {
            if !self.duty_told {
                self.duty_told = true;
                let detail = "a motor duty arrives, but the rig feeds the motor; 0 switches it off";
                self.log.note(now, "motor-not-wired", detail.to_owned());
            }
            let is_regulated = matches!(self.rotor.supply, MotorSupply::Regulated { .. });
            self.is_switched_off = is_regulated && duty == 0;
            if self.rotor.unpowered != (self.is_switched_off || self.faults.has(Fault::Off)) {
                self.rotor.advance(now);
                self.rotor.unpowered = !self.rotor.unpowered;
                self.plan();
            }
            return;
        }
        let duty = f64::from(duty) / 255.0;
        if duty != self.rotor.duty {
            self.rotor.advance(now);
            self.rotor.duty = duty;
            self.plan();
        }
    }
}

impl Device for Xv11 {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        match port {
            Self::MOTOR => self.set_duty(now, *bytes.last().expect("receive is given bytes")),
            _ => self.host_bytes(now, bytes),
        }
        self.foresee();
    }

    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        if port != Self::UART || self.firmware.state() == State::Off {
            return;
        }
        match event {
            LineEvent::Break => self.open_console(now, "break"),
            LineEvent::FramingError => {
                let kind = EventKind::Violation;
                self.log.repeated(now, kind, "framing-error", || {
                    "a character without stop bit: noise, or not 115200 baud".to_owned()
                });
            }
            LineEvent::Opened | LineEvent::Closed | LineEvent::ParityError | LineEvent::Overrun => {
            }
        }
        self.foresee();
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
            self.uart.transmit(buf)
        } else {
            0
        }
    }

    fn may_send(&self, port: Port) -> bool {
        port == Self::UART && self.uart.has_output()
    }

    fn poll_at(&self) -> Option<Instant> {
        earliest([self.next_at(), self.log.poll_at()])
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        uart::LINE
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &Fault::NAMES
    }

    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        match Fault::named(fault, figure) {
            Some(fault) if begins => Self::set_fault(self, now, fault),
            Some(fault) => self.clear_fault(now, fault),
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
