//! Cars, bodies with corners, and drive trains from outside of this crate.

#![expect(
    clippy::cast_possible_truncation,
    reason = "whole powers and counts are wanted"
)]

use core::f64::consts::{PI, TAU};
use core::time::Duration;

use emulators::world::{
    Ackermann, AckermannConfig, Actuator, ActuatorKind, BodyConfig, Chassis, Command, CommandError,
    Differential, Drive, Encoder, Footprint, Obstacle, Path, Point, Pose, Repeat, Scene, Shape,
    Velocity, Waypoint, Wheel, World,
};
use proptest::prelude::*;
use protocols::Instant;

fn wall(x0: f64, y0: f64, x1: f64, y1: f64) -> Shape {
    Shape::Wall {
        from: Point::new(x0, y0),
        to: Point::new(x1, y1),
    }
}

fn floor() -> Scene {
    Scene::new::<Shape>([], vec![]).unwrap()
}

fn close(found: f64, expected: f64, slack: f64) -> bool {
    (found - expected).abs() <= slack
}

/// A perfect floor, and no lag of motor and servo.
fn prompt() -> AckermannConfig {
    AckermannConfig {
        lag_s: 0.0,
        steering_lag_s: 0.0,
        ..AckermannConfig::default().ideal()
    }
}

fn car(config: AckermannConfig, scene: Scene, start: Pose) -> World {
    let car = Ackermann::new(config, 1).unwrap();
    World::with_chassis(scene, Box::new(car), start).unwrap()
}

/// The circle's radius is 0.258 m / tan(0.3 rad) = 0.83404 m. Its circumference is 5.2404 m, which
/// is 1563.8 counts of 3.351 mm and takes 10.481 s at 0.5 m/s.
#[test]
fn a_car_drives_a_circle_of_wheelbase_over_tangent() {
    let config = AckermannConfig::default().ideal();
    let mut world = car(config, floor(), Pose::default());
    world.actuate("steering", Command::Angle(0.3)).unwrap();
    world.actuate("drive", Command::Speed(0.5)).unwrap();
    // After 10 lags of 0.3 s the speed is within 2e-5 m/s of its final value.
    world.advance(Instant::from_secs(3));
    let (begin, before) = (world.pose(), world.encoder("drive").unwrap());
    let middle = begin.offset(0.0, 0.834_04);
    for part in 1..=100 {
        world.advance(Instant::from_secs(3) + Duration::from_micros(104_807 * part));
        let radius = world.pose().point().distance(middle);
        assert!(close(radius, 0.834_04, 0.001), "{radius}");
    }
    let end = world.pose();
    assert!(end.point().distance(begin.point()) < 0.01, "{end:?}");
    assert!(close(end.theta, begin.theta, 0.01));
    let counts = world.encoder("drive").unwrap() - before;
    assert!((1562..=1565).contains(&counts), "{counts}");
    assert!(close(world.turn_rate(), 0.5 / 0.834_04, 1e-4));
    assert!(close(world.axis_speed("drive").unwrap(), 0.5, 1e-4));
}

/// 0.3 rad at 3 rad/s are 100 steps of 1 ms.
#[test]
fn the_servo_takes_angle_over_rate_to_arrive() {
    let mut world = car(prompt(), floor(), Pose::default());
    world.actuate("steering", Command::Angle(0.3)).unwrap();
    let mut angle_at = |millis| {
        world.advance(Instant::from_millis(millis));
        world.chassis().actual(1)
    };
    assert!(close(angle_at(50), 0.15, 1e-12));
    assert!(close(angle_at(99), 0.297, 1e-12));
    assert!(close(angle_at(100), 0.3, 1e-12));
    assert!(close(angle_at(200), 0.3, 1e-12));
}

/// A lag of 50 ms with a rate that does not limit it: 1 - 1/e of the angle after 50 ms.
#[test]
fn the_servo_lags() {
    let config = AckermannConfig {
        steering_rate_rad_s: 100.0,
        steering_lag_s: 0.050,
        ..prompt()
    };
    let mut world = car(config, floor(), Pose::default());
    world.actuate("steering", Command::Angle(0.1)).unwrap();
    world.advance(Instant::from_millis(50));
    assert!(close(world.chassis().actual(1), 0.063_212, 1e-6));
}

#[test]
fn a_car_at_rest_does_not_turn_whatever_its_wheels_do() {
    let mut world = car(AckermannConfig::default(), floor(), Pose::default());
    world.actuate("steering", Command::Angle(0.4)).unwrap();
    world.advance(Instant::from_secs(1));
    assert_eq!(world.pose(), Pose::default());
    assert!(!world.is_moving());
}

/// The bumper is 0.359 m ahead of the rear axle, the wall 1.359 m.
#[test]
fn a_car_stops_with_its_bumper_at_the_wall() {
    let scene = Scene::new([wall(1.359, -1.0, 1.359, 1.0)], vec![]).unwrap();
    let mut world = car(prompt(), scene, Pose::default());
    world.actuate("drive", Command::Speed(0.5)).unwrap();
    world.advance(Instant::from_secs(4));
    let pose = world.pose();
    assert!(close(pose.x, 1.0, 2e-6) && pose.x <= 1.0, "{pose:?}");
    assert!(pose.y == 0.0 && pose.theta == 0.0, "{pose:?}");
    assert!(world.is_touching() && !world.is_moving());
    let contacts = world.take_contacts();
    assert_eq!(contacts.len(), 1);
    assert!(close(contacts[0].speed_m_s, 0.5, 1e-9), "{contacts:?}");
    assert!(close(contacts[0].place.x, 1.359, 1e-9), "{contacts:?}");
    // The car drives 1 m at 0.5 m/s, so the contact is at 2 s.
    assert!(close(contacts[0].at.as_secs_f64(), 2.0, 0.002));
    // 4 s at 0.5 m/s are 2 m of rim: the wheels slip.
    assert!(close(
        world.encoder(0).unwrap() as f64 * 0.003_351,
        2.0,
        0.005
    ));
    world.actuate("drive", Command::Speed(-0.5)).unwrap();
    world.advance(Instant::from_secs(5));
    assert!(close(world.pose().x, 0.5, 1e-3), "{:?}", world.pose());
    assert!(!world.is_touching());
    assert_eq!(world.contact_count(), 1);
}

/// A box of 0.4 m x 0.2 m turns on the spot, 0.22 m from a wall ahead. Its right front corner is
/// sqrt(0.05) m away and 0.46365 rad to the right. It meets the wall at x = 0.22, y = -0.04, after
/// 0.46365 - acos(0.22 / sqrt(0.05)) = 0.28379 rad, with a speed of 0.04 m times 2.6923 rad/s.
#[test]
fn a_box_that_turns_meets_the_wall_with_its_corner() {
    let scene = Scene::new([wall(0.22, -1.0, 0.22, 1.0)], vec![]).unwrap();
    let config = BodyConfig {
        lag_s: 0.0,
        ..BodyConfig::default().ideal()
    };
    let outline = Footprint::rectangle(0.2, 0.2, 0.2).unwrap();
    let body = Differential::new(config, 1).unwrap();
    let body = Box::new(body.with_footprint(outline));
    let mut world = World::with_chassis(scene, body, Pose::default()).unwrap();
    world.set_drive(Wheel::Left, Drive::Power(-255));
    world.set_drive(Wheel::Right, Drive::Power(255));
    world.advance(Instant::from_secs(1));
    assert!(
        close(world.pose().theta, 0.283_79, 1e-4),
        "{:?}",
        world.pose()
    );
    let contacts = world.take_contacts();
    assert_eq!(contacts.len(), 1);
    assert!(close(contacts[0].speed_m_s, 0.107_69, 1e-3), "{contacts:?}");
    let place = contacts[0].place;
    assert!(
        close(place.x, 0.22, 1e-9) && close(place.y, -0.04, 1e-4),
        "{place:?}"
    );
    world.set_drive(Wheel::Left, Drive::Power(255));
    world.set_drive(Wheel::Right, Drive::Power(-255));
    world.advance(Instant::from_millis(1_100));
    assert!(
        close(world.pose().theta, 0.283_79 - 0.269_23, 1e-3),
        "the way back is free"
    );
}

/// A leg of 10 mm radius, hollow as all circles are, 0.5 m ahead of the bumper's middle.
#[test]
fn a_flat_bumper_is_stopped_by_a_leg() {
    let leg = Shape::Circle {
        center: Point::new(0.869, 0.05),
        radius_m: 0.01,
    };
    let mut world = car(
        prompt(),
        Scene::new([leg], vec![]).unwrap(),
        Pose::default(),
    );
    world.actuate("drive", Command::Power(255)).unwrap();
    world.advance(Instant::from_secs(2));
    assert!(close(world.pose().x, 0.5, 2e-6), "{:?}", world.pose());
    let contact = world.take_contacts()[0];
    assert!(close(contact.speed_m_s, 1.2, 1e-9) && close(contact.place.y, 0.05, 1e-9));
}

/// A person of 0.2 m radius walks at 0.5 m/s to x = 0 from behind: the rear bumper, 0.101 m behind
/// the axle, is pushed to the front of the circle.
#[test]
fn somebody_who_walks_into_a_car_shoves_it_along_but_not_into_a_wall() {
    let walker = || Obstacle {
        fixture: Shape::Circle {
            center: Point::default(),
            radius_m: 0.2,
        }
        .into(),
        path: Path {
            waypoints: vec![
                Waypoint {
                    at: Instant::ZERO,
                    position: Point::new(-2.0, 0.0),
                },
                Waypoint {
                    at: Instant::from_secs(4),
                    position: Point::default(),
                },
            ],
            repeat: Repeat::Once,
        },
    };
    let scene = Scene::new::<Shape>([], vec![walker()]).unwrap();
    let mut world = car(prompt(), scene, Pose::default());
    world.advance(Instant::from_secs(5));
    assert!(close(world.pose().x, 0.301, 1e-5), "{:?}", world.pose());
    let contacts = world.take_contacts();
    assert_eq!(contacts.len(), 1, "{contacts:?}");
    assert!(close(contacts[0].speed_m_s, 0.5, 1e-6), "{contacts:?}");
    assert_eq!(world.encoder("drive"), Some(0));

    let scene = Scene::new([wall(0.459, -1.0, 0.459, 1.0)], vec![walker()]).unwrap();
    let mut world = car(prompt(), scene, Pose::default());
    world.advance(Instant::from_secs(5));
    assert!(close(world.pose().x, 0.1, 3e-6), "{:?}", world.pose());
}

#[test]
fn what_an_actuator_cannot_do_is_refused_with_its_name() {
    let mut world = car(prompt(), floor(), Pose::default());
    let error = world.actuate("left", Command::Brake).unwrap_err();
    assert_eq!(
        error.to_string(),
        "there is no actuator \"left\"; expected one of: drive, steering"
    );
    assert!(world.actuate(2, Command::Brake).is_err());
    let error = world.actuate("steering", Command::Power(9)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "steering is a steering and cannot follow a power, expected angle_deg"
    );
    let error = world.actuate(1, Command::Angle(f64::NAN)).unwrap_err();
    assert!(matches!(error, CommandError::NotFinite { .. }));
    world.actuate(1, Command::Angle(-9.0)).unwrap();
    assert_eq!(world.chassis().command(1), Command::Angle(-0.436));
    world.actuate(0, Command::Speed(-9.0)).unwrap();
    assert_eq!(world.chassis().command(0), Command::Speed(-1.2));
    assert_eq!(world.encoder("left"), None);
    assert_eq!(world.encoder(1), None);
}

#[test]
fn a_car_ignores_who_drives_wheels_that_it_has_not() {
    let mut world = car(prompt(), floor(), Pose::default());
    world.set_drive(Wheel::Left, Drive::Power(255));
    world.advance(Instant::from_secs(1));
    assert!(!world.is_moving());
    assert_eq!(world.drive(Wheel::Left), Drive::Brake);
    assert_eq!(world.encoder_ticks(Wheel::Left), 0);
    assert!(
        close(world.body().radius_m, 0.395_1, 1e-4),
        "a stand-in around the footprint"
    );
}

/// 175 mm/s with the lag of a driven wheel: 1 - 1/e of the speed after 60 ms.
#[test]
fn a_regulated_wheel_lags_like_a_driven_one() {
    let config = BodyConfig::default().ideal();
    let mut world = World::new(floor(), config, Pose::default(), 1).unwrap();
    world.actuate("left", Command::Speed(0.175)).unwrap();
    world.actuate("right", Command::Speed(9.0)).unwrap();
    world.advance(Instant::from_millis(60));
    assert!(close(
        world.wheel_speed(Wheel::Left),
        0.175 * 0.632_12,
        1e-6
    ));
    world.advance(Instant::from_secs(1));
    assert!(close(world.axis_speed("left").unwrap(), 0.175, 1e-6));
    assert!(
        close(world.axis_speed("right").unwrap(), 0.350, 1e-6),
        "full drive at most"
    );
    assert_eq!(
        world.encoder("left"),
        Some(world.encoder_ticks(Wheel::Left))
    );
    assert_eq!(world.drive(Wheel::Left), Drive::Power(128));
    let body = world.body();
    assert_eq!(body.radius_m, 0.16);
}

#[test]
fn cars_of_impossible_figures_are_refused_by_name() {
    let refused = |config: AckermannConfig| Ackermann::new(config, 1).unwrap_err().to_string();
    let long = AckermannConfig {
        wheelbase_m: f64::NAN,
        ..prompt()
    };
    assert_eq!(refused(long), "body.wheelbase_m is NaN; expected 0.02 to 4");
    // tan(1.3) = 3.6: a circle of 0.0716 m goes between wheels 0.155 m apart.
    let tight = AckermannConfig {
        steering_max_rad: 1.3,
        ..prompt()
    };
    assert!(refused(tight).starts_with("body.track_m is 0.155; expected 0.01 to 0.143"));
}

#[test]
fn a_car_that_would_begin_in_a_wall_is_refused() {
    let scene = Scene::new([wall(0.3, -1.0, 0.3, 1.0)], vec![]).unwrap();
    let car = Ackermann::new(prompt(), 1).unwrap();
    let error = World::with_chassis(scene, Box::new(car), Pose::default()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "at its start (0, 0) m the robot stands 0.059 m deep in a surface"
    );
}

/// A foreign drive train: a winch that pulls the body and does nothing else.
#[derive(Clone, Debug)]
struct Winch {
    footprint: Footprint,
    actuators: [Actuator; 1],
    encoders: [Encoder; 1],
    command: Command,
    speed: f64,
    travel: f64,
}

impl Winch {
    fn new() -> Self {
        Self {
            footprint: Footprint::circle(0.1).unwrap(),
            actuators: [Actuator {
                name: "rope".into(),
                kind: ActuatorKind::Motor,
                range: [0.0, 0.2],
            }],
            encoders: [Encoder {
                name: "drum".into(),
                counts_per_m: 1000.0,
            }],
            command: Command::Brake,
            speed: 0.0,
            travel: 0.0,
        }
    }
}

impl Chassis for Winch {
    fn footprint(&self) -> &Footprint {
        &self.footprint
    }
    fn actuators(&self) -> &[Actuator] {
        &self.actuators
    }
    fn actuate(&mut self, _: usize, command: Command) {
        self.command = command;
    }
    fn command(&self, _: usize) -> Command {
        self.command
    }
    fn actual(&self, _: usize) -> f64 {
        self.speed
    }
    fn begin_step(&mut self, _: u64) -> Velocity {
        self.travel += self.speed * 1e-3;
        self.speed = match self.command {
            Command::Speed(speed) => speed,
            _ => 0.0,
        };
        Velocity {
            speed_m_s: self.speed,
            turn_rad_s: 0.0,
        }
    }
    fn encoders(&self) -> &[Encoder] {
        &self.encoders
    }
    fn count(&self, _: usize, after_s: f64) -> i64 {
        ((self.travel + self.speed * after_s) * 1000.0).round() as i64
    }
    fn axis_speed(&self, _: usize) -> f64 {
        self.speed
    }
    fn clone_box(&self) -> Box<dyn Chassis> {
        Box::new(self.clone())
    }
}

/// Half a metre to the wall, 0.1 m of radius: the body moves 0.4 m, however long the winch pulls.
#[test]
fn a_chassis_from_outside_drives_in_the_world() {
    let scene = Scene::new([wall(0.5, -1.0, 0.5, 1.0)], vec![]).unwrap();
    let mut world = World::with_chassis(scene, Box::new(Winch::new()), Pose::default()).unwrap();
    world.actuate("rope", Command::Speed(1.0)).unwrap();
    world.advance(Instant::from_secs(1));
    assert!(close(world.pose().x, 0.2, 1e-9), "{:?}", world.pose());
    assert_eq!(world.encoder("drum"), Some(200));
    let mut copy = world.clone();
    world.actuate("rope", Command::Brake).unwrap();
    for world in [&mut world, &mut copy] {
        world.advance(Instant::from_secs(4));
    }
    assert!(close(world.pose().x, 0.2, 1e-9), "{:?}", world.pose());
    assert!(close(copy.pose().x, 0.4, 1e-9), "{:?}", copy.pose());
    assert_eq!(copy.encoder("drum"), Some(800));
}

/// A small round hall with a leg, a wall and a box: many obstacles.
fn crowded() -> Scene {
    let corners = [(0.9, -0.3), (1.1, -0.2), (1.0, 0.0)];
    let hall = Shape::Circle {
        center: Point::default(),
        radius_m: 1.6,
    };
    let leg = Shape::Circle {
        center: Point::new(0.5, 0.6),
        radius_m: 0.02,
    };
    let block = Shape::Polygon {
        corners: corners.map(|(x, y)| Point::new(x, y)).to_vec(),
    };
    Scene::new([hall, leg, block, wall(-1.0, -0.5, -0.2, -0.7)], vec![]).unwrap()
}

/// A car, or a differential drive whose body is an arrow with thin wings.
fn cornered(is_car: bool, seed: u64) -> Box<dyn Chassis> {
    if is_car {
        let config = AckermannConfig {
            full_speed_m_s: 3.0,
            lag_s: 0.05,
            ..AckermannConfig::default()
        };
        return Box::new(Ackermann::new(config, seed).unwrap());
    }
    let corners = [(0.25, 0.0), (-0.15, 0.2), (-0.05, 0.0), (-0.15, -0.2)];
    let arrow = corners.map(|(x, y)| Point::new(x, y)).to_vec();
    let config = BodyConfig {
        full_speed_m_s: 1.0,
        ..BodyConfig::default()
    };
    let body = Differential::new(config, seed).unwrap();
    Box::new(body.with_footprint(Footprint::polygon(arrow).unwrap()))
}

fn act(world: &mut World, is_car: bool, [one, other]: [f64; 2]) {
    let power = |part: f64| Command::Power((part * 255.0) as i16);
    let second = if is_car {
        Command::Angle(other * 0.5)
    } else {
        power(other)
    };
    world.actuate(0, power(one)).unwrap();
    world.actuate(1, second).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// A body with corners never ends a step inside a surface.
    #[test]
    fn a_body_with_corners_ends_no_step_in_a_wall(
        is_car: bool,
        seed: u64,
        theta in -PI..PI,
        acts in prop::collection::vec((prop::array::uniform2(-1.0..1.0_f64), 50..600_u64), 1..16),
        push in prop::array::uniform3(-1.0..1.0_f64),
    ) {
        let chassis = cornered(is_car, seed);
        let start = Pose::new(0.0, 0.0, theta);
        let mut world = World::with_chassis(crowded(), chassis, start).unwrap();
        let mut now = 0;
        for (index, (set, millis)) in acts.into_iter().enumerate() {
            act(&mut world, is_car, set);
            if index == 3 {
                world.push(push[0], push[1], push[2], Duration::from_millis(300));
            }
            for _ in 0..millis {
                now += 1;
                world.advance(Instant::from_millis(now));
                prop_assert!(world.clearance() >= 0.0, "{} m at {now} ms", world.clearance());
                let pose = world.pose();
                prop_assert!(pose.is_finite() && pose.point().distance(Point::default()) < 1.6);
            }
        }
    }

    /// The result does not depend on which device polls the world, and how often.
    #[test]
    fn a_car_does_not_depend_on_when_the_world_is_advanced(
        seed: u64,
        acts in prop::collection::vec(prop::array::uniform2(-1.0..1.0_f64), 1..6),
        cuts in prop::collection::vec(0..3_000_000_000_u64, 0..40),
    ) {
        let run = |cuts: &[u64]| {
            let (car, start) = (cornered(true, seed), Pose::default());
            let mut world = World::with_chassis(crowded(), car, start).unwrap();
            let mut cuts = cuts.to_vec();
            cuts.sort_unstable();
            for (index, set) in (0..).zip(&acts) {
                let from = index * 500_000_123;
                for cut in cuts.iter().filter(|cut| **cut < from) {
                    world.advance(Instant::from_nanos(*cut));
                }
                world.advance(Instant::from_nanos(from));
                act(&mut world, true, *set);
            }
            world.advance(Instant::from_secs(3));
            format!("{world:?}")
        };
        prop_assert_eq!(run(&cuts), run(&[]));
    }
}

/// A hall of 1.6 m: a car that steers hard drives in circles without leaving it.
#[test]
fn a_car_that_turns_tightly_fits_into_a_hall() {
    let hall = Shape::Circle {
        center: Point::new(0.0, 0.6),
        radius_m: 1.1,
    };
    let mut world = car(
        prompt(),
        Scene::new([hall], vec![]).unwrap(),
        Pose::default(),
    );
    world.actuate("steering", Command::Angle(0.4)).unwrap();
    world.advance(Instant::from_millis(200));
    world.actuate("drive", Command::Speed(0.3)).unwrap();
    // The circle's radius is 0.258 / tan 0.4 = 0.61022 m, so a turn takes TAU * 0.61022 / 0.3 =
    // 12.78 s.
    world.advance(Instant::from_millis(200) + Duration::from_secs_f64(TAU * 0.610_22 / 0.3));
    assert!(
        world.pose().point().distance(Point::default()) < 0.005,
        "{:?}",
        world.pose()
    );
    assert_eq!(world.contact_count(), 0);
}
