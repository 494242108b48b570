use super::*;
use crate::costmap::Inflation;

const START: CarPose = CarPose {
    x_m: 1.0,
    y_m: 1.5,
    heading_rad: 0.0,
};
const GOAL: CarPose = CarPose { x_m: 5.0, ..START };

fn pilot() -> Pilot {
    // The car's covered floor around the middle of its rear axle.
    let outline = Outline::rectangle(0.359, 0.101, 0.165);
    Pilot::new(PrimitiveSet::car(), &outline, FollowerSettings::default())
}

/// A hall of 6 m by 3 m with one pillar of 0.2 m about `pillar`, in cells of 5 cm.
fn hall(pillar: [f64; 2]) -> Costmap {
    let is_wall = |x: f64, y: f64| {
        let is_pillar = (x - pillar[0]).abs() < 0.1 && (y - pillar[1]).abs() < 0.1;
        !(0.1..5.9).contains(&x) || !(0.1..2.9).contains(&y) || is_pillar
    };
    let cells = (0..120 * 60).map(|at| (f64::from(at % 120), f64::from(at / 120)));
    let cells = cells.map(|(x, y)| is_wall((x + 0.5) * 0.05, (y + 0.5) * 0.05));
    let inflation = Inflation {
        inscribed_m: 0.101,
        radius_m: 0.40,
    };
    Costmap::new(120, 0.05, [0.0; 2], cells.collect(), inflation)
}

fn millis(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

/// From START to GOAL, a pose each 5 cm.
fn straight() -> Vec<CarPose> {
    (0..=80)
        .map(|step| START.shifted(f64::from(step) * 0.05))
        .collect()
}

/// The limits are 0.30 m and 0.30 rad, each tried a little to both sides, the heading also across
/// pi. A position has no heading; an exact goal has limits of its own. Without a map, an unreached
/// goal is given up.
#[test]
fn a_goal_is_reached_when_the_car_is_near_enough() {
    let at = |x_m: f64, heading_rad: f64| CarPose {
        x_m,
        heading_rad,
        ..START
    };
    let became = |set: &dyn Fn(&mut Pilot), pose| {
        let mut pilot = pilot();
        set(&mut pilot);
        assert_eq!(pilot.drive(millis(0), pose, || None), None);
        pilot.state()
    };
    let goal = |heading: f64| move |pilot: &mut Pilot| pilot.set_goal(Some(at(2.0, heading)));
    let place = |pilot: &mut Pilot| pilot.set_place(Some(at(2.0, 0.2)));
    let exact = |pilot: &mut Pilot| pilot.set_exact_goal(Some(at(2.0, 0.2)), [0.1, 0.05]);
    use GoalState::{GivenUp, Reached};
    assert_eq!(became(&goal(0.2), at(1.71, 0.2)), Reached);
    assert_eq!(became(&goal(0.2), at(1.69, 0.2)), GivenUp);
    assert_eq!(became(&goal(0.2), at(2.0, 0.49)), Reached);
    assert_eq!(became(&goal(0.2), at(2.0, 0.51)), GivenUp);
    assert_eq!(became(&goal(0.2), at(2.0, -0.11)), GivenUp);
    assert_eq!(became(&goal(3.1), at(2.0, -3.1)), Reached);
    assert_eq!(became(&place, at(1.71, 2.0)), Reached);
    assert_eq!(became(&place, at(1.69, 0.2)), GivenUp);
    assert_eq!(became(&exact, at(1.91, 0.24)), Reached);
    assert_eq!(became(&exact, at(1.89, 0.2)), GivenUp);
    assert_eq!(became(&exact, at(2.0, 0.26)), GivenUp);
}

#[test]
fn it_is_after_the_goal_that_it_plans_for_or_drives_to() {
    let mut pilot = pilot();
    assert_eq!((pilot.state(), pilot.goal()), (GoalState::None, None));
    pilot.set_goal(Some(GOAL));
    assert_eq!(pilot.state(), GoalState::Planning);
    assert!(pilot.is_after(GOAL) && !pilot.is_after(START));
    assert_eq!(pilot.drive(millis(0), GOAL, || None), None);
    assert!(!pilot.is_after(GOAL));
    pilot.follow(straight());
    assert_eq!(
        (pilot.state(), pilot.goal()),
        (GoalState::Driving, Some(GOAL))
    );
    assert!(pilot.is_after(GOAL));
    assert_eq!(pilot.path(), straight());
    pilot.plan_anew();
    assert_eq!(
        (pilot.state(), pilot.path().len()),
        (GoalState::Planning, 0)
    );
    pilot.follow(Vec::new());
    assert_eq!((pilot.state(), pilot.goal()), (GoalState::None, None));
    pilot.plan_anew();
    assert_eq!(pilot.state(), GoalState::None);
}

/// One plan a second; the eighth failed plan is the last one.
#[test]
fn a_goal_inside_a_wall_is_given_up_after_eight_plans() {
    let map = hall([3.0, 0.5]);
    let mut pilot = pilot();
    pilot.set_goal(Some(CarPose { x_m: 5.95, ..GOAL }));
    for second in 0..8 {
        let drives =
            [0, 999].map(|part| pilot.drive(millis(second * 1_000 + part), START, || Some(&map)));
        assert_eq!((drives, pilot.plans()), ([None; 2], second + 1));
        let expected = match second {
            7 => GoalState::GivenUp,
            _ => GoalState::Planning,
        };
        assert_eq!(pilot.state(), expected, "{second}");
    }
    assert_eq!(pilot.drive(millis(9_000), START, || Some(&map)), None);
    assert_eq!(pilot.plans(), 8);
}

/// Seven failures; then the car has moved by 0.29 m, which does not count, or by 0.31 m.
#[test]
fn where_the_car_has_got_on_plans_count_anew() {
    let map = hall([3.0, 0.5]);
    for (on_m, expected) in [(0.29, GoalState::GivenUp), (0.31, GoalState::Planning)] {
        let mut pilot = pilot();
        pilot.set_goal(Some(CarPose { x_m: 5.95, ..GOAL }));
        for second in 0..7 {
            pilot.drive(millis(second * 1_000), START, || Some(&map));
        }
        assert_eq!(pilot.state(), GoalState::Planning);
        pilot.drive(millis(7_000), START.shifted(on_m), || Some(&map));
        assert_eq!(pilot.state(), expected, "{on_m}");
    }
}

/// A straight path. A pillar with its near face 1.5 m ahead touches the nose at a pose 1.2 m ahead;
/// one at 2.2 m touches no pose within 1.5 m; one behind the car does not count. The check runs
/// each 0.2 s.
#[test]
fn a_way_that_something_stands_on_is_planned_anew() {
    let clear = hall([3.0, 0.3]);
    let car = START.shifted(1.0);
    for (pillar_x, plans) in [(3.6, 1), (4.3, 0), (1.2, 0)] {
        let map = hall([pillar_x, 1.5]);
        let mut pilot = pilot();
        pilot.follow(straight());
        assert!(pilot.drive(millis(0), car, || Some(&clear)).is_some());
        assert!(pilot.drive(millis(199), car, || Some(&map)).is_some());
        assert_eq!(pilot.plans(), 0);
        assert!(pilot.drive(millis(200), car, || Some(&map)).is_some());
        assert_eq!((pilot.plans(), pilot.state()), (plans, GoalState::Driving));
    }
    // A planned path stays valid without a map.
    let mut pilot = pilot();
    pilot.follow(straight());
    assert!(pilot.drive(millis(0), car, || None).is_some());
    // 0.5 m beside it the car has lost it.
    let beside = CarPose { y_m: 2.0, ..car };
    assert_eq!(pilot.drive(millis(10), beside, || None), None);
    assert_eq!(
        (pilot.state(), pilot.path().len()),
        (GoalState::Planning, 0)
    );
}

/// The nose reaches 0.36 m ahead of the axle, the sides 0.165 m: 0.3 m before a wall the car fits
/// only parallel to it.
#[test]
fn the_car_fits_beside_a_wall_that_it_cannot_face() {
    let (map, pilot) = (hall([3.0, 0.5]), pilot());
    let turned = |heading_rad: f64| CarPose {
        x_m: 5.6,
        heading_rad,
        ..START
    };
    let quarter = core::f64::consts::FRAC_PI_2;
    let free = [0.0, quarter, 2.0 * quarter, -quarter];
    let free = free.map(|heading| pilot.is_free(&map, turned(heading)));
    assert_eq!(free, [false, true, true, true]);
    assert!(!pilot.is_free(&map, CarPose { x_m: 7.0, ..START }));
}

/// To reach a goal behind it beside a wall, the car turns round in several moves. Some of 24 such
/// paths contain poses with a heading between two of the lattice's that seem too near to the wall;
/// no path is planned twice.
#[test]
fn a_map_that_has_not_changed_blocks_no_way_that_was_planned_on_it() {
    let map = hall([3.0, 0.5]);
    let mut tight = 0;
    for step in 0..24_i32 {
        let start = CarPose {
            x_m: 4.2 + 0.05 * f64::from(step),
            y_m: 1.0 + 0.04 * f64::from(step),
            heading_rad: 0.05 * f64::from(step - 12),
        };
        let mut pilot = pilot();
        pilot.set_place(Some(CarPose {
            x_m: start.x_m - 1.6,
            y_m: start.y_m - 0.6,
            ..start
        }));
        pilot.drive(millis(0), start, || Some(&map));
        let path = pilot.path().to_vec();
        for (look, pose) in (1..).zip(path) {
            pilot.drive(millis(200 * look), pose, || Some(&map));
        }
        assert_eq!(pilot.plans(), 1, "{step}");
        tight += usize::from(!pilot.tight.is_empty());
    }
    assert!(tight > 0);
}
