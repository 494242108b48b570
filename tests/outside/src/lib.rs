//! A user's robot: a car with a lidar of another make and a servo board, a program that drives an
//! arc, a checker. It knows `hilrig` alone, and `hilrig` knows nothing of it.

pub mod board;
pub mod program;
pub mod robot;
pub mod turret;

use std::sync::Once;

use hilrig::prelude::*;

/// Makes all of it known to this process.
pub fn register() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        register_codec(turret::CODEC).expect("a new name");
        register_device(turret::TurretKind).expect("a new name");
        register_robot(robot::Car).expect("a new name");
    });
}
