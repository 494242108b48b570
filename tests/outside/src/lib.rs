//! A user's robot: a car with another make of lidar and a servo board, a program that drives an
//! arc, and a checker. The crate uses only `hilrig`, and `hilrig` does not know this crate.

pub mod board;
pub mod program;
pub mod robot;
pub mod turret;

use std::sync::Once;

use hilrig::prelude::*;

/// Registers all parts in this process.
pub fn register() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        register_codec(turret::CODEC).expect("a new name");
        register_device(turret::TurretKind).expect("a new name");
        register_robot(robot::Car).expect("a new name");
    });
}
