//! Features of the robots' reports that are left out. FIDELITY.md has the reason of each. A
//! scenario that asks for one is refused, and the message lists the known keys or names.

#![cfg(feature = "robots")]

use std::path::Path;

use hilrig_engine::robots::{self, Dut, PcEnd};
use hilrig_engine::scenario::{Scenario, ScenarioError, Source};

/// A run of `robot` with these lines before its world.
fn parse(robot: &str, lines: &str) -> Result<(Scenario, Source), ScenarioError> {
    let text = format!(
        "schema = 1\nname = \"asks\"\nrobot = \"{robot}\"\nduration = \"1s\"\n{lines}\n[world]\n\
         start = {{ x_m = 1, y_m = 1, heading_deg = 0 }}\n[[world.wall]]\n\
         path_m = [[0, 0], [3, 0], [3, 2]]\n"
    );
    Scenario::parse(Path::new("asks.toml"), text)
}

/// The error, also one that shows only when the robot is wired.
fn error(robot: &str, lines: &str) -> Option<String> {
    let wired = parse(robot, lines).and_then(|(scenario, source)| {
        robots::wire(&scenario, &source, Dut::Internal, PcEnd::Scripted).map(drop)
    });
    wired.err().map(|error| error.to_string())
}

/// Feature, robot, lines that ask for it, and the message behind the file's name.
const REFUSED: [[&str; 4]; 11] = [
    [
        "R083, nearest waypoint first",
        "rescue",
        "[program.tuning]\norder = \"nearest\"",
        ":6: program.tuning.order: is an unknown key, expected one of points, tries, hole_mm, weight, \
         fading, smear, radius_mm, clearance_mm, infrared, walls",
    ],
    [
        "R104, heat layer of the map",
        "rescue",
        "[expect.golden]\nheat = \"heat.pgm\"",
        ":6: expect.golden.heat: is an unknown key, expected one of path, path_within_mm, map, \
         map_walls_min, map_within_cells",
    ],
    [
        "R106, slopes",
        "rescue",
        "[[world.slope]]\npitch_deg = 10",
        ":5: world.slope: is an unknown key, expected one of start, bounds, plan, body, maze, wall, \
         polygon, pillar, heat, slick, line, moving, push",
    ],
    [
        "R108, four wheels",
        "rescue",
        "[chassis.differential]\nwheels = 4",
        ":6: chassis.differential.wheels: is an unknown key, expected one of footprint_m",
    ],
    [
        "R129, accelerometer of the base",
        "rescue",
        "[device.base.avr-base]\naccelerometer = true",
        ":6: device.base.avr-base.accelerometer: is an unknown key, expected one of profile, phase, \
         heat, imu, announce",
    ],
    [
        "A022, gain and echoes of the ultrasonic rangers",
        "custom",
        "[device.front.srf08]\nechoes = 17",
        ":6: device.front.srf08.echoes: is an unknown key, expected one of mount, height_m, address, \
         noise_m",
    ],
    [
        "A031, pulses of motor and servo",
        "apollo13",
        "[device.car.car-board]\npulse_ms = 1.53",
        ":6: device.car.car-board.pulse_ms: is an unknown key, expected one of period, dead_man, \
         clamps, battery_v",
    ],
    [
        "A061, steering learnt while driving",
        "apollo13",
        "[program.tuning]\nlearns_steering = true",
        ":6: program.tuning.learns_steering: is an unknown key, expected one of points, tries, \
         hole_mm, weight, fading, smear, radius_mm, clearance_mm, infrared, walls",
    ],
    [
        "A072, heat of the PC",
        "apollo13",
        "[[fault]]\nkind = \"throttle\"\ndevice = \"pc\"",
        ":6: fault[0].kind: is \"throttle\", expected one of flip, drop, insert, ",
    ],
    [
        "A073, swing of the camera",
        "apollo13",
        "[device.camera.camera]\nswing_deg = 5",
        ":6: device.camera.camera.swing_deg: is an unknown key, expected one of mount, height_m, \
         field_deg, columns, period, noise_m, gaps, scans, numbers_by_seed, marker",
    ],
    [
        "Y003, inertial sensors",
        "yellow",
        "[device.imu.lsm9ds1]",
        ":5: device.imu.lsm9ds1: is \"lsm9ds1\", expected one of xv11, avr-base, hc06, touch-panel, \
         rplidar, wheel-board, car-board, odometer, camera, srf08, mpu6050, registers, ",
    ],
];

#[test]
fn features_left_out_are_refused_with_the_known_names() {
    for [feature, robot, lines, expected] in REFUSED {
        let said = error(robot, lines).unwrap_or_else(|| panic!("{feature}: accepted"));
        assert!(
            said.starts_with(&format!("asks.toml{expected}")),
            "{feature}: {said}"
        );
        assert_eq!(said.lines().count(), 1, "{feature}: {said}");
    }
}
