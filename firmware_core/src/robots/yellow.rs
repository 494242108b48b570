//! The robot of a course of 2019: two wheels, three IR sensors, a lidar, a PC over WiFi.

mod config;
mod defects;

use protocols::{Instant, LineConfig, Port, rplidar, telemetry};

pub use config::Config;
pub use defects::Defects;

use crate::map_view::MapView;
use crate::pose::Pose;
use crate::{Inspect, Master, Work};

/// Rate of the wires that are none on a board: PWM of the lidar's motor, the chip's own hardware.
const BOARD_BAUD: u32 = 10_000_000;

/// The robot's program.
#[derive(Clone, Debug)]
pub struct Yellow {
    config: Config,
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

    /// A robot that has just been switched on.
    pub const fn new(config: Config) -> Self {
        Self { config }
    }
}

impl Master for Yellow {
    fn receive(&mut self, _port: Port, _now: Instant, _bytes: &[u8]) {}

    fn poll(&mut self, _now: Instant) {}

    fn transmit(&mut self, _port: Port, _buf: &mut [u8]) -> usize {
        0
    }

    fn poll_at(&self) -> Option<Instant> {
        None
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

impl Inspect for Yellow {
    fn estimate(&self) -> Option<(Instant, Pose)> {
        Some((Instant::ZERO, self.config.start))
    }

    fn map(&self) -> Option<MapView<'_>> {
        None
    }

    fn mode(&self) -> &'static str {
        "off"
    }

    fn counters(&self, _report: &mut dyn FnMut(&'static str, u64)) {}
}
