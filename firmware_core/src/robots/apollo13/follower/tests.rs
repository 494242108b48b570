use super::*;
use crate::ackermann::Motion;
use crate::costmap::{Costmap, Inflation};
use crate::lattice::{Goal, Lattice, Limits, Outline, PrimitiveSet};
use crate::random::Pcg32;
use crate::robots::apollo13::steering;

/// The car's covered floor around the middle of its rear axle.
fn outline() -> Outline {
    Outline::rectangle(0.359, 0.101, 0.165)
}

/// A hall of 6 m by 5 m with two pillars and a wall, in cells of 5 cm.
fn hall() -> Costmap {
    let is_wall = |x: f64, y: f64| {
        let is_outside = !(0.1..5.9).contains(&x) || !(0.1..4.9).contains(&y);
        let is_pillar = |px: f64, py: f64| (x - px).abs() < 0.2 && (y - py).abs() < 0.2;
        is_outside || is_pillar(2.0, 1.8) || is_pillar(4.4, 3.2) || (x - 3.0).abs() < 0.1 && y > 3.4
    };
    let cells = (0..120 * 100).map(|at| (f64::from(at % 120), f64::from(at / 120)));
    let cells = cells.map(|(x, y)| is_wall((x + 0.5) * 0.05, (y + 0.5) * 0.05));
    let inflation = Inflation {
        inscribed_m: 0.101,
        radius_m: 0.40,
    };
    Costmap::new(120, 0.05, [0.0; 2], cells.collect(), inflation)
}

fn touches(map: &Costmap, pose: CarPose) -> bool {
    let cell = map.cell([pose.x_m, pose.y_m]).unwrap();
    let around = (-9..=9).flat_map(|y| (-9..=9).map(move |x| [cell[0] + x, cell[1] + y]));
    let mut obstacles = around.filter(|cell| map.is_obstacle(*cell));
    let pose = [pose.x_m, pose.y_m, pose.heading_rad];
    obstacles.any(|cell| outline().overlaps(pose, map.middle_m(cell), 0.05))
}

/// Drives a car of 0.258 m along the path; its speed lags by 0.3 s, its angles are those of the
/// table, and its reported poses are 1 cm and half a degree off. Returns the end pose, and whether
/// the car touched an obstacle.
fn drive(map: &Costmap, path: Vec<CarPose>, random: &mut Pcg32) -> (Step, CarPose, bool) {
    let car = CarGeometry {
        wheelbase_m: 0.258,
        track_m: 0.155,
    };
    let mut truth = path[0];
    let mut follower = Follower::new(path, Settings::default());
    let (mut speed, mut has_touched) = (0.0, false);
    for _ in 0..4_000 {
        let told = CarPose {
            x_m: truth.x_m + random.normal(0.01),
            y_m: truth.y_m + random.normal(0.01),
            heading_rad: wrapped(truth.heading_rad + random.normal(0.009)),
        };
        let Step::Drive {
            speed_m_s,
            steering_rad,
        } = follower.step(told)
        else {
            return (follower.step(told), truth, has_touched);
        };
        let value = steering::value_for(steering_rad.to_degrees()).unwrap();
        let angle = steering::angle_deg(value).to_radians();
        speed += (speed_m_s - speed) * 0.05 / 0.3;
        truth = truth.then(car.rear_arc(angle, speed * 0.05));
        has_touched |= touches(map, truth);
    }
    (Step::Lost, truth, has_touched)
}

/// AP12: 20 random goals: at least 95 % are reached within 0.30 m and 0.30 rad, without a touch.
#[test]
fn ap12_goals_are_reached() {
    let (map, mut random) = (hall(), Pcg32::new(11));
    // Planned with 3 cm to spare on all sides, driven with the car's own outline.
    let roomy = Outline::rectangle(0.389, 0.131, 0.195);
    let lattice = Lattice::new(PrimitiveSet::car(), &roomy);
    let (mut tried, mut reached) = (0, 0);
    while tried < 20 {
        let mut place = || CarPose {
            x_m: 0.3 + random.unit() * 5.4,
            y_m: 0.3 + random.unit() * 4.4,
            heading_rad: wrapped(random.unit() * core::f64::consts::TAU),
        };
        let (start, goal) = (place(), place());
        let to = Goal {
            pose: goal,
            with_heading: true,
        };
        let Ok(plan) = lattice.plan(&map, start, to, Limits::default()) else {
            continue;
        };
        tried += 1;
        let (end, pose, has_touched) = drive(&map, plan.poses, &mut random);
        let turned = wrapped(pose.heading_rad - goal.heading_rad).abs();
        let is_there = pose.distance_m(goal) <= 0.30 && turned <= 0.30;
        reached += i32::from(end == Step::Arrived && is_there && !has_touched);
    }
    assert!(reached >= 19, "{reached} of {tried}");
}

/// A path of a metre forwards, then half a metre backwards: the car does not cut its turning point.
#[test]
fn a_path_with_a_turning_point_is_driven_both_ways() {
    let at = |x_m: f64| CarPose {
        x_m,
        ..CarPose::default()
    };
    let ahead = (0..=10).map(|step| at(f64::from(step) * 0.1));
    let back = (1..=5).map(|step| at(1.0 - f64::from(step) * 0.1));
    let mut follower = Follower::new(ahead.chain(back).collect(), Settings::default());
    let speed = |step: Step| match step {
        Step::Drive { speed_m_s, .. } => speed_m_s,
        _ => 0.0,
    };
    assert_eq!(speed(follower.step(at(0.0))), 0.22);
    assert_eq!(speed(follower.step(at(0.6))), 0.22);
    assert_eq!(speed(follower.step(at(0.97))), -0.22);
    assert_eq!(speed(follower.step(at(0.8))), -0.22);
    assert_eq!(follower.step(at(0.53)), Step::Arrived);
    let aside = CarPose::default().then(Motion {
        left_m: 0.7,
        ..Motion::default()
    });
    assert_eq!(follower.step(aside), Step::Lost);
    assert_eq!(
        Follower::new(Vec::new(), Settings::default()).step(aside),
        Step::Arrived
    );
}

/// By hand: a path parallel to the car, 0.1 m to its left, has the followed point at (0.3, 0.1).
/// The curvature is 2 * 0.1 / (0.09 + 0.01) = 2. Times the wheelbase of 0.25 m that is atan(0.5) =
/// 26.6 degrees, limited to 25; to the right the limit is 18.
#[test]
fn the_car_steers_along_the_arc_through_its_point() {
    let path = |y_m: f64| {
        let poses = (0..=20).map(move |step| CarPose {
            x_m: f64::from(step) * 0.1,
            y_m,
            heading_rad: 0.0,
        });
        Follower::new(poses.collect(), Settings::default())
    };
    let steering = |y_m: f64| match path(y_m).step(CarPose::default()) {
        Step::Drive { steering_rad, .. } => steering_rad,
        other => panic!("{other:?}"),
    };
    assert!((steering(0.1) - 0.436).abs() < 1e-9);
    assert!((steering(-0.1) + 0.314).abs() < 1e-9);
    // For a path 0.02 m to the left: the curvature is 2 * 0.02 / (0.09 + 0.0004) = 0.4425; times
    // the wheelbase of 0.25 m, the angle is 6.31 degrees.
    assert!((steering(0.02).to_degrees() - 6.31).abs() < 0.01);
}

/// On a path that ends 0.2 m ahead the straight continuation is followed: the point 0.3 m ahead is
/// that of the test above. On a path backwards it lies behind, and the steering angle is the same.
#[test]
fn beyond_the_end_of_a_way_it_goes_straight_on() {
    for way in [1.0, -1.0] {
        let poses = (0..=2).map(|step| CarPose {
            x_m: way * f64::from(step) * 0.1,
            y_m: 0.02,
            heading_rad: 0.0,
        });
        let mut follower = Follower::new(poses.collect(), Settings::default());
        let Step::Drive {
            speed_m_s,
            steering_rad,
        } = follower.step(CarPose::default())
        else {
            panic!("the end is 0.2 m away");
        };
        assert_eq!(speed_m_s, way * 0.22);
        assert!(
            (steering_rad.to_degrees() - 6.31).abs() < 0.01,
            "{steering_rad}"
        );
    }
}

/// A path of 1 m along x. Values slightly below and above each limit are tried: 5 cm before the
/// end, 0.40 m beside the path, 0.30 m and 0.30 rad at its end.
#[test]
fn a_way_ends_or_is_lost_at_its_limits() {
    let at = |x_m: f64, y_m: f64, heading_rad: f64| CarPose {
        x_m,
        y_m,
        heading_rad,
    };
    let step = |pose| {
        let poses = (0..=10).map(|step| at(f64::from(step) * 0.1, 0.0, 0.0));
        Follower::new(poses.collect(), Settings::default()).step(pose)
    };
    let drives = |pose| matches!(step(pose), Step::Drive { .. });
    assert!(drives(at(0.94, 0.0, 0.0)));
    assert_eq!(step(at(0.96, 0.0, 0.0)), Step::Arrived);
    assert!(drives(at(0.5, 0.39, 0.0)));
    assert_eq!(step(at(0.5, 0.41, 0.0)), Step::Lost);
    assert_eq!(step(at(1.0, 0.29, 0.0)), Step::Arrived);
    assert_eq!(step(at(1.0, -0.31, 0.0)), Step::Lost);
    assert_eq!(step(at(1.0, 0.0, 0.29)), Step::Arrived);
    assert_eq!(step(at(1.0, 0.0, -0.31)), Step::Lost);
}

/// Half a circle of 0.5 m to the left: its end lies beside the car at the start, and the car still
/// drives the whole path.
#[test]
fn a_way_that_turns_round_is_driven_to_its_end() {
    let poses = (0..=30).map(|step| {
        let turned = core::f64::consts::PI / 30.0 * f64::from(step);
        CarPose {
            x_m: 0.5 * libm::sin(turned),
            y_m: 0.5 - 0.5 * libm::cos(turned),
            heading_rad: turned,
        }
    });
    let poses: Vec<CarPose> = poses.collect();
    let mut follower = Follower::new(poses.clone(), Settings::default());
    for pose in &poses[..29] {
        let step = follower.step(*pose);
        let is_left = matches!(step, Step::Drive { steering_rad, .. } if steering_rad > 0.0);
        assert!(is_left, "{pose:?} {step:?}");
    }
    assert_eq!(follower.step(poses[30]), Step::Arrived);
}

/// On a path with a pose each 25 cm, 12.5 cm to the left, the point half a metre ahead is itself a
/// pose: the tangent of the steering angle is 2 * 0.125 / (0.25 + 0.015625) times 0.25 m. If the
/// car is halfway between two poses, the earlier one counts, 0.375 m ahead: 2 * 0.125 / (0.140625 +
/// 0.015625) times 0.25 m.
#[test]
fn a_pose_as_far_as_the_point_ahead_is_the_point() {
    let steering = |x_m: f64| {
        let poses = (0..=20).map(|step| CarPose {
            x_m: f64::from(step) * 0.25,
            y_m: 0.125,
            heading_rad: 0.0,
        });
        let settings = Settings {
            ahead_m: 0.5,
            steering_max_rad: [1.0; 2],
            ..Settings::default()
        };
        let pose = CarPose {
            x_m,
            ..CarPose::default()
        };
        match Follower::new(poses.collect(), settings).step(pose) {
            Step::Drive { steering_rad, .. } => libm::tan(steering_rad),
            other => panic!("{other:?}"),
        }
    };
    assert!((steering(0.0) - 0.0625 / 0.265_625).abs() < 1e-12);
    assert!((steering(0.125) - 0.0625 / 0.156_25).abs() < 1e-12);
}

/// A whole circle of 36 poses. Halfway round, the end lies beside the car; later the end is ahead
/// of it with a quarter left. The car drives to the end.
#[test]
fn a_way_that_comes_back_to_its_beginning_is_driven_to_its_end() {
    let poses = (0..=36).map(|step| {
        let turned = core::f64::consts::PI / 18.0 * f64::from(step);
        CarPose {
            x_m: 0.5 * libm::sin(turned),
            y_m: 0.5 - 0.5 * libm::cos(turned),
            heading_rad: wrapped(turned),
        }
    });
    let poses: Vec<CarPose> = poses.collect();
    let mut follower = Follower::new(poses.clone(), Settings::default());
    for (step, pose) in poses[..35].iter().enumerate() {
        let driven = follower.step(*pose);
        assert!(matches!(driven, Step::Drive { .. }), "{step} {driven:?}");
    }
    assert_eq!(follower.step(poses[36]), Step::Arrived);
}

/// A car 40 cm beside its path has not lost it yet. A car 30 cm and 0.3 rad off the end has reached
/// it.
#[test]
fn what_is_as_far_off_as_may_be_is_not_lost() {
    let beside = |y_m: f64, heading_rad: f64| {
        let poses = [0.0, 1.0, 2.0, 3.0].map(|x_m| CarPose {
            x_m,
            ..CarPose::default()
        });
        let mut follower = Follower::new(poses.to_vec(), Settings::default());
        [0.0, 3.0].map(|x_m| {
            follower.step(CarPose {
                x_m,
                y_m,
                heading_rad,
            })
        })
    };
    assert!(matches!(beside(0.4, 0.0)[0], Step::Drive { .. }));
    assert_eq!(beside(0.3, 0.0)[1], Step::Arrived);
    assert_eq!(beside(0.0, 0.3)[1], Step::Arrived);
    assert_eq!(beside(0.0, -0.31)[1], Step::Lost);
    assert_eq!(beside(0.31, 0.0)[1], Step::Lost);
}
