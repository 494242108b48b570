extern crate std;

use super::*;
use crate::costmap::Inflation;

const INFLATION: Inflation = Inflation {
    inscribed_m: 0.131,
    radius_m: 0.40,
};

/// A straight corridor from x = -1 m to `end_m`, 1.65 m wide, seen by a camera of 62 degrees.
fn scan(camera: CarPose, end_m: f64) -> Vec<Beam> {
    let beam = |index: i32| {
        let bearing_rad = f64::from(index).to_radians() / 4.0;
        let (sin, cos) = libm::sincos(camera.heading_rad + bearing_rad);
        let to = |from: f64, wall: f64, along: f64| match (wall - from) / along {
            range if range > 0.0 => range,
            _ => f64::INFINITY,
        };
        let aside = if sin > 0.0 { 0.825 } else { -0.825 };
        let ahead = if cos > 0.0 { end_m } else { -1.0 };
        let range_m = to(camera.y_m, aside, sin).min(to(camera.x_m, ahead, cos));
        Beam {
            bearing_rad,
            range_m: if range_m > 10.0 {
                f64::INFINITY
            } else {
                range_m
            },
        }
    };
    (-124..=124).map(beam).collect()
}

fn at(x_m: f64) -> CarPose {
    CarPose {
        x_m,
        ..CarPose::default()
    }
}

fn after(scans: u64) -> Instant {
    Instant::ZERO + DRAW_EVERY * u32::try_from(scans).unwrap()
}

fn costs(survey: &Survey) -> Costmap {
    let plan = survey.plan();
    Costmap::new(
        plan.width,
        plan.cell_m,
        plan.origin_m,
        plan.obstacles,
        INFLATION,
    )
}

/// What was looked at ends 4 m ahead of the camera: the car goes to there, less what it stops
/// before, and looks along the corridor. The map has the walls where they are.
#[test]
fn the_edge_ahead_is_gone_to() {
    let mut survey = Survey::new(at(0.0));
    for step in 0..10 {
        let found = survey.draw(after(step), at(0.0), &scan(at(0.0), 30.0));
        assert!(found.distance_m(at(0.0)) < 0.02, "{found:?}");
    }
    let map = costs(&survey);
    let wall = |x: f64, y: f64| map.is_obstacle(map.cell([x, y]).unwrap());
    assert!(wall(2.0, 0.82) && wall(2.0, -0.82) && !wall(2.0, 0.5) && !wall(2.0, 0.0));
    let Choice::Look(goal) = survey.next(&map, at(-0.3), false, |_| true) else {
        panic!("no goal");
    };
    assert!(
        (goal.x_m - 3.4).abs() < 0.2 && goal.y_m.abs() < 0.4,
        "{goal:?}"
    );
    assert!(goal.heading_rad.abs() < 0.3 && !survey.is_complete());
    // Under way to it, it stays the same; once more, any heading will do.
    let mut again = |is_under_way| survey.next(&map, at(-0.3), is_under_way, |_| true);
    assert_eq!(again(true), Choice::Stay);
    assert_eq!(again(false), Choice::Go(goal));
}

/// The odometry turns away by a degree a metre; the walls hold the map straight.
#[test]
fn the_walls_correct_the_odometry() {
    let mut survey = Survey::new(at(0.0));
    let (mut odometry, mut found) = (at(0.0), at(0.0));
    for step in 0..200_u32 {
        let truth = at(f64::from(step) * 0.04);
        found = survey.draw(after(step.into()), odometry, &scan(truth, 12.0));
        odometry = odometry.then(Motion {
            ahead_m: 0.04,
            left_m: 0.0,
            turn_rad: 0.04_f64.to_radians(),
        });
    }
    assert!((odometry.heading_rad - 8_f64.to_radians()).abs() < 1e-6);
    assert!(
        found.heading_rad.abs() < 0.02 && found.y_m.abs() < 0.08,
        "{found:?}"
    );
    assert!((found.x_m - 7.96).abs() < 0.1, "{found:?}");
}

/// An edge that stays one however often the car goes there is given up; then the map is complete.
#[test]
fn the_exploration_ends_by_itself() {
    let mut survey = Survey::new(at(0.0));
    for step in 0..10 {
        survey.draw(after(step), at(0.0), &scan(at(0.0), 30.0));
    }
    let map = costs(&survey);
    let mut goals = 0;
    while survey.next(&map, at(-0.3), false, |_| true) != Choice::Done {
        goals += 1;
        assert!(goals < 50);
    }
    assert!(goals >= 3 && survey.is_complete());
    assert_eq!(survey.next(&map, at(-0.3), false, |_| true), Choice::Done);
    // Nothing is decided before anything was drawn.
    let mut fresh = Survey::new(at(0.0));
    assert_eq!(fresh.next(&map, at(0.0), false, |_| true), Choice::Stay);
    assert!(!fresh.is_complete());
}

/// What the car turned away from beside its way is no edge: nothing 0.8 m from where it came by is
/// one, whatever is known of it.
#[test]
fn what_lies_beside_the_way_is_no_edge() {
    let mut survey = Survey::new(at(0.0));
    for step in 0..40_u32 {
        let truth = at(f64::from(step) * 0.05);
        survey.draw(after(step.into()), truth, &scan(truth, 30.0));
    }
    assert!(survey.is_beside([1.0, 0.8]) && !survey.is_beside([1.0, 1.0]));
    assert!(!survey.is_beside([3.0, 0.0]));
}

/// The gyroscope of a car that stands turns by a degree a second: the map does not turn with it.
#[test]
fn a_car_that_stands_does_not_turn() {
    let mut survey = Survey::new(at(0.0));
    let mut found = at(0.0);
    for step in 0..200_u32 {
        let odometry = CarPose {
            heading_rad: f64::from(step) * 0.2_f64.to_radians(),
            ..at(0.0)
        };
        found = survey.draw(after(step.into()), odometry, &scan(at(0.0), 12.0));
    }
    assert!(
        found.heading_rad.abs() < 0.02 && found.distance_m(at(0.0)) < 0.02,
        "{found:?}"
    );
}
