//! The robot yellow on its board.
#![no_std]
#![no_main]

use cortex_m_rt::entry;
use cortex_m4::Setup;
use firmware_core::robots::yellow::{Config, Yellow};

#[entry]
fn main() -> ! {
    let ports = [
        ("lidar", Yellow::LIDAR),
        ("lidar-motor", Yellow::LIDAR_MOTOR),
        ("board", Yellow::BOARD),
        ("telemetry", Yellow::TELEMETRY),
    ];
    let mut config = Config::DEFAULT;
    let setup = Setup::read(&ports, |key, value| config.set(key, value));
    setup.run(Yellow::new(config))
}
