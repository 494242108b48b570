//! Sensor readings of a frame.

use core::f64::consts::TAU;

use protocols::Instant;
use protocols::car_board::Readings;

use super::BoardConfig;
use crate::i2c::RegisterChip as _;
use crate::srf08::{CENTIMETRES, COMMAND, RANGE, Srf08, Srf08Config};
use crate::world::World;

/// Pulses a metre of the sensor's magnets: 8 a turn of a wheel of 32 mm are 39.8.
const PULSES_PER_M: f64 = 8.0 / (TAU * 0.032);

/// Place of the ultrasonic sensors: address, ahead and to the left of the rear axle, bearing. The
/// car's software has them 0.175 m ahead of the middle and 0.1 m to the sides of it; the middle is
/// half of the wheelbase ahead of the axle.
const PLACES: [(&str, u8, f64, f64, f64); 3] = [
    ("front", 0xE0, 0.304, 0.0, 0.0),
    ("right", 0xE2, 0.129, -0.1, -0.25 * TAU),
    ("left", 0xE4, 0.129, 0.1, 0.25 * TAU),
];

/// All sensors of the board.
#[derive(Clone, Debug)]
pub(super) struct Sensors {
    /// Front, right, left: the order of the frame.
    pub(super) ultrasonic: [Srf08; 3],
    /// Counts at the last look, for pulses that know no direction.
    travel: Option<i64>,
    pulses: i64,
    pub(super) is_hall_dead: bool,
    /// Fixed reading of the line sensor, whatever lies below it.
    pub(super) line_stuck: Option<u8>,
}

impl Sensors {
    pub(super) fn new(seed: u64) -> Self {
        let ultrasonic = PLACES.map(|(name, address, x_m, y_m, yaw_rad)| {
            let config = Srf08Config {
                address,
                x_m,
                y_m,
                yaw_rad,
                ..Srf08Config::default()
            };
            Srf08::new(config, seed, &format!("car_board.ultrasonic.{name}"))
        });
        Self {
            ultrasonic,
            travel: None,
            pulses: 0,
            is_hall_dead: false,
            line_stuck: None,
        }
    }

    /// Reads all sensors, and starts the next round of the ultrasonic ones.
    pub(super) fn read(&mut self, now: Instant, config: &BoardConfig, world: &World) -> Readings {
        let [front_cm, right_cm, left_cm] = self
            .ultrasonic
            .each_mut()
            .map(|sensor| range_cm(sensor, now, world));
        self.count(config, world);
        let [x_m, y_m] = config.line_sensor_m;
        let place = world.pose().offset(x_m, y_m);
        let line = u8::from(world.scene().is_on_line(place));
        let [low, high, ..] = self.pulses.to_le_bytes();
        Readings {
            front_cm,
            right_cm,
            left_cm,
            line: self.line_stuck.unwrap_or(line),
            hall: u16::from_le_bytes([low, high]),
            battery_mv: 0,
        }
    }

    /// Adds the pulses since the last look; the magnets give no direction.
    fn count(&mut self, config: &BoardConfig, world: &World) {
        let encoders = world.encoders();
        let Some(index) = config.encoder_of(encoders) else {
            return;
        };
        let counts = world.encoder(index).unwrap_or_default();
        let per_count = PULSES_PER_M / encoders[index].counts_per_m;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_precision_loss,
            reason = "counts are far below 2^53"
        )]
        let travel = (counts as f64 * per_count + 1e-6).floor() as i64;
        let before = self.travel.replace(travel).unwrap_or(travel);
        if !self.is_hall_dead {
            self.pulses += (travel - before).abs();
        }
    }

    /// Resets the readings when the board restarts.
    pub(super) fn reset(&mut self) {
        (self.travel, self.pulses) = (None, 0);
    }
}

/// Returns the range of the finished round, 0 without an echo or an answer; begins the next round.
fn range_cm(sensor: &mut Srf08, now: Instant, world: &World) -> u16 {
    if !sensor.acknowledges(now, 0) {
        return 0;
    }
    let mut bytes = [0; 2];
    sensor.read(now, RANGE, &mut bytes, world);
    sensor.write(now, COMMAND, &[CENTIMETRES], world);
    u16::from_be_bytes(bytes)
}
