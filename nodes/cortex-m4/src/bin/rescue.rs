//! The robot rescue on its board.
#![no_std]
#![no_main]

use cortex_m_rt::entry;
use cortex_m4::Setup;
use firmware_core::robots::rescue::{Config, Rescue};

#[entry]
fn main() -> ! {
    let ports = [
        ("lidar", Rescue::LIDAR),
        ("motor", Rescue::MOTOR),
        ("base", Rescue::BASE),
        ("radio", Rescue::RADIO),
        ("display", Rescue::DISPLAY),
    ];
    let mut config = Config::DEFAULT;
    let setup = Setup::read(&ports, |key, value| config.set(key, value));
    setup.run(Rescue::new(config))
}
