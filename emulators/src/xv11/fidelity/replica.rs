//! The emulator in the scene of the "hand in box" capture.

use protocols::{Instant, Port};

use crate::device::Device;
use crate::world::{
    BodyConfig, Fixture, Obstacle, Path, Point, Pose, Repeat, Scene, Shape, Waypoint, World,
};
use crate::xv11::{Config, Detail, MotorSupply, Mount, Profile, Xv11};

/// Corners of the box as the capture shows them, by straight lines through its walls: angle in
/// degrees, corrected for the uneven teeth there, and distance in metres.
const CORNERS: [(f64, f64); 4] = [
    (56.22, 0.465),
    (141.89, 0.547),
    (229.55, 0.597),
    (309.12, 0.516),
];
/// Outline of the hand: slanting sides, like a (nearly) flat object that is not held upright.
const HAND_M: [(f64, f64); 6] = [
    (-0.045, -0.010),
    (0.000, -0.025),
    (0.045, -0.010),
    (0.045, 0.010),
    (0.000, 0.025),
    (-0.045, 0.010),
];
/// Arrival times of the hand (seconds) and its positions (degrees, metres). It comes in after 14
/// turns, moves about the sensor, leaves after 92, and lies close by from turn 115 on.
const HAND_AT: [(f64, (f64, f64)); 11] = [
    (0.0, (66.0, 0.75)),
    (2.9, (66.0, 0.31)),
    (5.0, (75.0, 0.27)),
    (7.0, (100.0, 0.30)),
    (9.0, (150.0, 0.28)),
    (11.0, (172.0, 0.30)),
    (13.0, (210.0, 0.34)),
    (15.0, (300.0, 0.32)),
    (17.0, (350.0, 0.27)),
    (18.4, (350.0, 0.75)),
    (23.4, (72.0, 0.168)),
];
/// The capture lasts 120 turns at 297 rpm before the motor is cut.
const CUT_AT: Instant = Instant::from_millis(28_700);
const END_AT: Instant = Instant::from_millis(30_500);
/// Recording begins in the middle of the stream.
const BEGIN_AT: Instant = Instant::from_millis(4_450);

/// Bytes of an emulated sensor in the scenario of the capture: 120 turns in a box with a hand that
/// moves about, then the motor is cut, until after the boot text.
pub fn hand_in_box(profile: Profile, seed: u64) -> Vec<u8> {
    let config = Config {
        profile,
        supply: MotorSupply::Fixed { volts: 3.3 },
        detail: Detail::Captured,
        mount: Mount {
            yaw_deg: 0.0,
            ..Mount::default()
        },
        ..Config::default()
    };
    let mut lidar = Xv11::new("lidar", seed, config);
    let mut world = scene();
    run(&mut lidar, &mut world, BEGIN_AT);
    let mut bytes = run(&mut lidar, &mut world, CUT_AT);
    lidar.set_supply(CUT_AT, MotorSupply::Fixed { volts: 0.0 });
    bytes.extend(run(&mut lidar, &mut world, END_AT));
    bytes
}

fn run(lidar: &mut Xv11, world: &mut World, until: Instant) -> Vec<u8> {
    const PORT: Port = Xv11::UART;
    let mut bytes = Vec::new();
    let mut buf = [0; 1024];
    while let Some(at) = lidar.poll_at().filter(|&at| at < until) {
        lidar.poll(at, world);
        let len = lidar.transmit(PORT, &mut buf);
        bytes.extend_from_slice(&buf[..len]);
    }
    bytes
}

fn scene() -> World {
    let box_walls = Shape::Polygon {
        corners: CORNERS
            .map(|(degrees, metres)| polar(degrees, metres))
            .to_vec(),
    };
    let fixed = Fixture {
        shape: box_walls,
        reflectivity: 0.9,
        height_m: f64::INFINITY,
        is_glass: false,
    };
    let scene = Scene::new([fixed], vec![hand()]).expect("a box and a hand");
    let body = BodyConfig {
        radius_m: 0.02,
        ..BodyConfig::default().ideal()
    };
    World::new(scene, body, Pose::default(), 0).expect("the middle of the box is free")
}

/// The hand.
fn hand() -> Obstacle {
    // The hand moves within a quarter of a second, then rests until it moves again.
    let waypoint = |seconds: f64, (angle_deg, distance_m): (f64, f64)| Waypoint {
        at: BEGIN_AT + core::time::Duration::from_secs_f64(seconds),
        position: polar(angle_deg, distance_m),
    };
    let mut waypoints = vec![waypoint(0.0, HAND_AT[0].1)];
    for pair in HAND_AT.windows(2) {
        waypoints.push(waypoint(pair[1].0 - 0.25, pair[0].1));
        waypoints.push(waypoint(pair[1].0, pair[1].1));
    }
    Obstacle {
        fixture: Fixture {
            shape: Shape::Polygon {
                corners: HAND_M.map(|(x, y)| Point::new(x, y)).to_vec(),
            },
            reflectivity: 0.18,
            height_m: f64::INFINITY,
            is_glass: false,
        },
        path: Path {
            waypoints,
            repeat: Repeat::Once,
        },
    }
}

fn polar(degrees: f64, metres: f64) -> Point {
    let (sin, cos) = libm::sincos(degrees.to_radians());
    Point::new(metres * cos, metres * sin)
}
