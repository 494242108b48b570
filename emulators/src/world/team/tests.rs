use core::f64::consts::{FRAC_PI_2, PI};

use protocols::Instant;

use super::*;
use crate::world::{
    Ackermann, AckermannConfig, BodyConfig, Chassis, Command, Contact, Differential, Point, Scene,
    Shape,
};

/// Two wheels without noise and delay under a disc of 0.1 m, 0.6 m/s at full drive.
fn disc() -> Box<dyn Chassis> {
    let config = BodyConfig {
        radius_m: 0.1,
        full_speed_m_s: 0.6,
        lag_s: 0.0,
        ..BodyConfig::default().ideal()
    };
    Box::new(Differential::new(config, 1).expect("sound"))
}

/// A car: 0.359 m ahead of its rear axle, 0.101 m behind it, 0.33 m wide.
fn car() -> Box<dyn Chassis> {
    let config = AckermannConfig {
        lag_s: 0.0,
        ..AckermannConfig::default().ideal()
    };
    Box::new(Ackermann::new(config, 1).expect("sound"))
}

/// Robots alone on a floor.
struct Team(Vec<World>);

impl Team {
    fn new(robots: Vec<(Box<dyn Chassis>, Pose)>) -> Self {
        let all: Vec<_> = robots
            .iter()
            .map(|(chassis, start)| (chassis.footprint().clone(), *start))
            .collect();
        let worlds = robots
            .into_iter()
            .enumerate()
            .map(|(index, (chassis, start))| {
                let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("empty");
                let mut world = World::with_chassis(scene, chassis, start).expect("room");
                let mut others = all.clone();
                others.remove(index);
                world.add_robots(&others);
                world
            });
        Self(worlds.collect())
    }

    /// Runs for `millis`; the last robot moves first if `backwards`.
    fn run(&mut self, millis: u64, backwards: bool) {
        let began = self.0[0].now().as_nanos() / STEP_NANOS;
        for step in began..began + millis {
            let till = Instant::from_millis(step + 1);
            match backwards {
                true => self
                    .0
                    .iter_mut()
                    .rev()
                    .for_each(|world| world.advance(till)),
                false => self.0.iter_mut().for_each(|world| world.advance(till)),
            }
            let seen = self.0.clone();
            for (index, world) in self.0.iter_mut().enumerate() {
                let others = seen.iter().enumerate().filter(|(other, _)| *other != index);
                for (place, (_, other)) in others.enumerate() {
                    world.see(place, other);
                }
            }
        }
    }

    fn drive(&mut self, robot: usize, speed_m_s: f64) {
        let motors: &[&str] = match self.0[robot].actuators().len() {
            2 if self.0[robot].encoder("left").is_some() => &["left", "right"],
            _ => &["drive"],
        };
        for motor in motors {
            let world = &mut self.0[robot];
            world
                .actuate(*motor, Command::Speed(speed_m_s))
                .expect("a motor");
        }
    }

    fn contacts(&mut self) -> Vec<Vec<Contact>> {
        self.0.iter_mut().map(World::take_contacts).collect()
    }
}

/// Two discs of 0.1 m with 1 m between their middles, one drives at the other with 0.3 m/s: a
/// lidar in the middle sees the rim of the other 0.9 m away, and 0.75 m away after half a second.
/// They meet after 0.8 m, 2.667 s; both have one contact, caused by the first one's motion alone.
#[test]
fn a_robot_meets_one_that_stands() {
    let start = Pose::new(0.0, 0.0, 0.0);
    let mut team = Team::new(vec![
        (disc(), start),
        (disc(), Pose::new(1.0, 0.0, FRAC_PI_2)),
    ]);
    team.drive(0, 0.3);
    let seen = |world: &World| {
        let pose = world.pose();
        let hit = world.cast_ray(pose.point(), 0.0, 4.0).expect("a robot");
        hit.distance
    };
    assert!((seen(&team.0[0]) - 0.9).abs() < 1e-9);
    team.run(500, false);
    assert!(
        (seen(&team.0[0]) - 0.75).abs() < 1e-3,
        "{}",
        seen(&team.0[0])
    );
    // A beam of 100 ms ago meets the robot where it was.
    let from = Point::new(1.0, 0.0);
    let then = team.0[1].cast_ray_at(Instant::from_millis(400), from, PI, 4.0);
    let then = then.expect("a robot").distance;
    assert!((then - (1.0 - 0.12 - 0.1)).abs() < 1e-3, "{then}");
    team.run(2_160, false);
    assert_eq!(team.contacts(), [[], []]);
    team.run(20, false);
    let contacts = team.contacts();
    let [first, second] = [&contacts[0], &contacts[1]];
    assert_eq!((first.len(), second.len()), (1, 1));
    assert!((first[0].own_m_s - 0.3).abs() < 1e-3, "{first:?}");
    assert!(second[0].own_m_s.abs() < 1e-3, "{second:?}");
    assert!((second[0].speed_m_s - 0.3).abs() < 2e-3, "{second:?}");
    // It leans on the other one, and they never overlap by more than a step's way.
    team.run(300, false);
    assert_eq!(team.contacts(), [[], []]);
    let apart = team.0[0].pose().point().distance(team.0[1].pose().point());
    assert!((apart - 0.2).abs() < 4e-4, "{apart}");
}

/// Two robots meet head on, both with 0.3 m/s: each has one contact at 0.6 m/s, and causes half of
/// it. The order in which the worlds advance changes nothing.
#[test]
fn the_order_of_the_worlds_changes_nothing() {
    let met = |backwards: bool| {
        let mut team = Team::new(vec![
            (disc(), Pose::new(0.0, 0.0, 0.0)),
            (disc(), Pose::new(1.0, 0.05, PI)),
        ]);
        team.drive(0, 0.3);
        team.drive(1, 0.3);
        team.run(1_500, backwards);
        let poses: Vec<Pose> = team.0.iter().map(World::pose).collect();
        (team.contacts(), poses)
    };
    let (contacts, poses) = met(false);
    for of in &contacts {
        assert_eq!(of.len(), 1, "{contacts:?}");
        assert!((of[0].speed_m_s - 0.6).abs() < 0.02, "{of:?}");
        assert!((of[0].own_m_s - 0.3).abs() < 0.01, "{of:?}");
    }
    assert_eq!(met(true), (contacts, poses));
}

/// A car stands across, its rear axle 1 m ahead: its left side is at 0.165 m to the left of that.
/// A disc that drives at it stops at its side, and sees it from there, and so does a second car.
#[test]
fn a_robot_with_corners_is_solid_as_it_is_turned() {
    for (chassis, nose_m, seconds) in [(disc as fn() -> _, 0.1, 4), (car, 0.359, 4)] {
        let mut team = Team::new(vec![
            (chassis(), Pose::new(0.0, 0.0, 0.0)),
            (car(), Pose::new(1.0, -0.1, FRAC_PI_2)),
        ]);
        team.drive(0, 0.3);
        team.run(1_000 * seconds, false);
        let contacts = team.contacts();
        assert_eq!([contacts[0].len(), contacts[1].len()], [1, 1], "{nose_m}");
        let stands = team.0[0].pose();
        let side_m = team.0[1].pose().x - 0.165;
        assert!((stands.x + nose_m - side_m).abs() < 2e-3, "{stands:?}");
        let hit = team.0[0].cast_ray(stands.point(), 0.0, 4.0).expect("a car");
        assert!((hit.distance - nose_m).abs() < 2e-3, "{hit:?}");
        assert!(hit.incidence > 0.999, "{hit:?}");
    }
}

/// A copy of all worlds goes its own way.
#[test]
fn a_separated_copy_has_other_robots_of_its_own() {
    let mut team = Team::new(vec![
        (disc(), Pose::new(0.0, 0.0, 0.0)),
        (disc(), Pose::new(1.0, 0.0, 0.0)),
    ]);
    let copies: Vec<World> = team.0.iter().map(World::separated).collect();
    team.drive(1, 0.6);
    team.run(1_000, false);
    let seen = |world: &World| {
        let hit = world.cast_ray(Point::default(), 0.0, 4.0).expect("a robot");
        hit.distance
    };
    assert!((seen(&team.0[0]) - 1.5).abs() < 1e-2);
    assert!((seen(&copies[0]) - 0.9).abs() < 1e-9);
    assert_eq!(copies[0].robots(), 1);
}

/// A car at (1, 2) that heads along y reaches 0.359 m up, 0.101 m down, and 0.165 m to both sides.
#[test]
fn outlines_are_drawn_where_the_robots_are() {
    let team = Team::new(vec![
        (disc(), Pose::new(0.0, 0.0, 0.0)),
        (disc(), Pose::new(3.0, 0.5, 1.0)),
        (car(), Pose::new(1.0, 2.0, FRAC_PI_2)),
    ]);
    let outlines = team.0[0].robot_outlines();
    let [
        Shape::Circle { center, radius_m },
        Shape::Polygon { corners },
    ] = &outlines[..]
    else {
        panic!("{outlines:?}");
    };
    assert_eq!((*center, *radius_m), (Point::new(3.0, 0.5), 0.1));
    let most = |of: fn(&Point) -> f64| corners.iter().map(of).fold(f64::MIN, f64::max);
    let least = |of: fn(&Point) -> f64| corners.iter().map(of).fold(f64::MAX, f64::min);
    let found = [
        least(|at| at.x),
        most(|at| at.x),
        least(|at| at.y),
        most(|at| at.y),
    ];
    for (found, expected) in found.into_iter().zip([0.835, 1.165, 1.899, 2.359]) {
        assert!((found - expected).abs() < 1e-9, "{corners:?}");
    }
    assert!(team.0[0].has_moving());
}

/// A robot that is put elsewhere is solid there at once.
#[test]
fn a_robot_put_in_the_way_is_met() {
    let mut team = Team::new(vec![
        (disc(), Pose::new(0.0, 0.0, 0.0)),
        (disc(), Pose::new(9.0, 0.0, 0.0)),
    ]);
    team.drive(0, 0.6);
    team.run(100, false);
    let ahead = team.0[0].pose().x + 0.205;
    team.0[1].teleport(Pose::new(ahead, 0.0, 0.0));
    team.run(30, false);
    assert_eq!(
        team.contacts().iter().map(Vec::len).collect::<Vec<_>>(),
        [1, 1]
    );
}
