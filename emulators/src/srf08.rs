//! SRF08 ultrasonic ranger: a chip on an I2C bus that sends a burst and times the first echo.
//!
//! ```text
//! register  read                          write
//! 0         software revision             command: 50 inches, 51 cm, 52 us; 53 to 55: ANN mode
//! 1         light                         greatest gain, 0 to 31
//! 2, 3      first echo, high byte first   2: range, (n + 1) * 43 mm
//! 4 .. 35   second to 17th echo; in ANN mode a byte for each 2048 us, not 0 where an echo was
//! ```
//!
//! The answer is ready after the ranging time: sound travels to the end of the range and back.
//! Meanwhile the chip does not acknowledge, and a master reads FF. 0 means no echo. Rays find the
//! objects in the cone; the nearest counts. Only the first echo is modelled, gain is not. A write
//! to the general call address, 0, goes to every chip; a read from it to none.
//!
//! Sources: Devantech's SRF08 manual. The speed of sound, 343.2 m/s, and the cone of 21.8 degrees
//! to either side are those of the car's own software.

use core::time::Duration;

use protocols::Instant;

use crate::device::EventKind;
use crate::i2c::{Log, RegisterChip, registers};
use crate::rng::Rng;
use crate::world::{Cone, Scene, World};

/// Command register, and revision when read.
pub const COMMAND: u8 = 0;
/// Light when read, greatest gain when written.
pub const GAIN: u8 = 1;
/// Range when written, first echo (two bytes) when read.
pub const RANGE: u8 = 2;
/// Ranges in inches.
pub const INCHES: u8 = 0x50;
/// Ranges in centimetres.
pub const CENTIMETRES: u8 = 0x51;
/// Ranges in microseconds, there and back.
pub const MICROSECONDS: u8 = 0x52;

/// The same three units in ANN mode.
pub const ANN: core::ops::RangeInclusive<u8> = 0x53..=0x55;

/// Address that all chips on a bus receive.
const GENERAL_CALL: u8 = 0;
/// Speed of sound.
const SPEED_M_S: f64 = 343.2;
/// Minimum distance of an echo: nearer ones are lost in the burst itself.
const LEAST_M: f64 = 0.03;
/// One unit of the range register.
const RANGE_UNIT_M: f64 = 0.043;
/// Time per byte of the ANN mode, microseconds there and back.
const SLICE_US: f64 = 2_048.0;
/// Bytes of the ANN mode, and where they begin.
const SLICES: usize = 32;
const SLICES_FROM: u8 = 4;
/// Value of a slice with an echo. The manual says "not zero".
const SLICE_ECHO: u8 = 1;
/// Computing time after the last echo; a guess that gives 65 ms for the default range.
const OVERHEAD: Duration = Duration::from_millis(1);
/// Sequence to write to the command register before a new address.
const ADDRESS_CHANGE: [u8; 3] = [0xA0, 0xAA, 0xA5];

/// Mounting of a chip on its robot, and its receiver.
#[derive(Clone, Debug, PartialEq)]
pub struct Srf08Config {
    /// Address in eight bits, even, E0 to FE.
    pub address: u8,
    /// Metres ahead of the reference point of the robot.
    pub x_m: f64,
    /// Metres to the left of it.
    pub y_m: f64,
    /// Bearing, radians counter-clockwise from ahead.
    pub yaw_rad: f64,
    /// Height above the floor, metres. The chip gets no echo from lower objects.
    pub height_m: f64,
    /// Half angle of the cone, radians.
    pub half_angle_rad: f64,
    /// Maximum distance of an echo, metres, whatever the range register holds. 6 m in practice.
    pub hears_m: f64,
    /// Standard deviation of a range, metres; a guess.
    pub noise_m: f64,
    /// Value of register 1: 2 in the dark to 248.
    pub light: u8,
}

impl Default for Srf08Config {
    fn default() -> Self {
        Self {
            address: 0xE0,
            x_m: 0.0,
            y_m: 0.0,
            yaw_rad: 0.0,
            height_m: 0.10,
            half_angle_rad: 0.3805,
            hears_m: 6.0,
            noise_m: 0.003,
            light: 128,
        }
    }
}

/// Names of the faults.
const FAULTS: [&str; 4] = ["off", "deaf", "stuck", "wrong"];

/// The chip.
#[derive(Clone, Debug)]
pub struct Srf08 {
    config: Srf08Config,
    address: u8,
    noise: Rng,
    /// Objects of the scene in reach of the chip's height.
    view: Option<Scene>,
    range: u8,
    /// First echo, as the registers show it.
    echo: u16,
    /// The slice of the ANN mode with an echo.
    slice: Option<usize>,
    ready_at: Instant,
    /// Bytes of [`ADDRESS_CHANGE`] that came in order.
    unlocked: usize,
    is_off: bool,
    is_deaf: bool,
    is_stuck: bool,
    /// Metres added to each range.
    offset_m: f64,
    log: Log,
}

impl Srf08 {
    /// A chip that has just been switched on. Its noise is that of the stream `name` of `seed`.
    pub fn new(config: Srf08Config, seed: u64, name: &str) -> Self {
        Self {
            address: config.address & 0xFE,
            noise: Rng::stream(seed, name),
            view: None,
            range: 255,
            echo: 0,
            slice: None,
            ready_at: Instant::ZERO,
            unlocked: 0,
            is_off: false,
            is_deaf: false,
            is_stuck: false,
            offset_m: 0.0,
            log: Log::default(),
            config,
        }
    }

    /// From a command to its result.
    pub fn ranging_time(&self) -> Duration {
        Duration::from_secs_f64(2.0 * self.range_m() / SPEED_M_S) + OVERHEAD
    }

    /// Whether the chip is ranging; then it does not acknowledge.
    pub fn is_ranging(&self, now: Instant) -> bool {
        now < self.ready_at
    }

    fn range_m(&self) -> f64 {
        f64::from(u16::from(self.range) + 1) * RANGE_UNIT_M
    }

    fn command(&mut self, now: Instant, command: u8, world: &World) {
        // Addresses are even. An odd one is ignored, and the sequence must be sent again.
        if self.unlocked == ADDRESS_CHANGE.len() && command >= 0xE0 && command.is_multiple_of(2) {
            self.address = command;
            self.unlocked = 0;
            return;
        }
        self.unlocked = match ADDRESS_CHANGE.get(self.unlocked) {
            Some(expected) if *expected == command => self.unlocked + 1,
            _ => 0,
        };
        let is_ann = ANN.contains(&command);
        let unit = if is_ann { command - 3 } else { command };
        let echo = match unit {
            INCHES => |distance_m: f64| distance_m / 0.0254,
            CENTIMETRES => |distance_m: f64| distance_m * 100.0,
            // The counter counts in steps of 4 us.
            MICROSECONDS => |distance_m: f64| (distance_m * 2e6 / SPEED_M_S / 4.0).round() * 4.0,
            _ if self.unlocked > 0 => return,
            _ => {
                let detail = || format!("{command:02X}");
                let kind = EventKind::Violation;
                return self.log.0.repeated(now, kind, "unknown-command", detail);
            }
        };
        // Drawn in every case, so that an echo never shifts the noise.
        let noise_m = self.config.noise_m * self.noise.gauss();
        let heard = self.hear(now, world).filter(|_| !self.is_deaf);
        if !self.is_stuck {
            let heard_m = heard.map(|heard| (heard + self.offset_m + noise_m).max(LEAST_M));
            self.echo = heard_m.map_or(0, |heard_m| whole(echo(heard_m)));
            let slice = heard_m.map(|heard_m| whole_slice(heard_m * 2e6 / SPEED_M_S));
            self.slice = slice.filter(|&slice| is_ann && slice < SLICES);
        }
        self.ready_at = now + self.ranging_time();
    }

    /// The nearest thing in the cone, metres.
    fn hear(&mut self, now: Instant, world: &World) -> Option<f64> {
        let range_m = self.range_m().min(self.config.hears_m);
        let config = &self.config;
        let view = self
            .view
            .get_or_insert_with(|| world.scene().slice(config.height_m));
        let pose = world.pose();
        let from = pose.offset(config.x_m, config.y_m);
        let cone = Cone {
            angle: pose.theta + config.yaw_rad,
            half_angle: config.half_angle_rad,
        };
        view.cast_cone(now, from, cone, range_m)
    }
}

impl RegisterChip for Srf08 {
    fn acknowledges(&self, now: Instant, address: u8) -> bool {
        let is_called = address == self.address || address == GENERAL_CALL;
        is_called && !self.is_off && !self.is_ranging(now)
    }

    fn write(&mut self, now: Instant, register: u8, data: &[u8], world: &World) {
        for (register, byte) in registers(register).zip(data) {
            match register {
                COMMAND => self.command(now, *byte, world),
                RANGE => self.range = *byte,
                _ => {}
            }
        }
    }

    fn read(&mut self, now: Instant, register: u8, data: &mut [u8], _world: &World) {
        let [high, low] = self.echo.to_be_bytes();
        for (register, byte) in registers(register).zip(data) {
            *byte = match register {
                _ if self.is_ranging(now) => 0xFF,
                // Software revision; that of the chips of 2015 is a guess.
                COMMAND => 10,
                GAIN => self.config.light,
                RANGE => high,
                3 => low,
                _ if self.slice == register.checked_sub(SLICES_FROM).map(usize::from)
                    && register >= SLICES_FROM =>
                {
                    SLICE_ECHO
                }
                _ => 0,
            };
        }
    }

    fn is_busy(&self, now: Instant, address: u8) -> bool {
        address == self.address && !self.is_off && self.is_ranging(now)
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &FAULTS
    }

    /// `off`: does not acknowledge. `deaf`: no echo. `stuck`: the last echo forever. `wrong`: this
    /// many metres too far, 0.5 by default.
    fn set_fault(&mut self, _now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        match fault {
            "off" => self.is_off = begins,
            "deaf" => self.is_deaf = begins,
            "stuck" => self.is_stuck = begins,
            "wrong" => self.offset_m = if begins { figure.unwrap_or(0.5) } else { 0.0 },
            _ => {}
        }
    }

    fn log(&mut self) -> &mut Log {
        &mut self.log
    }
}

/// The slice of the ANN mode that a time belongs to.
fn whole_slice(time_us: f64) -> usize {
    usize::from(whole((time_us / SLICE_US - 0.5).max(0.0)))
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "saturates, which is meant"
)]
fn whole(value: f64) -> u16 {
    value.round() as u16
}

#[cfg(test)]
mod tests;
