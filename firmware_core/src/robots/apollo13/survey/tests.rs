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
    let goal = survey.next(&map, at(-0.3), |_| true).unwrap();
    assert!(
        (goal.x_m - 3.4).abs() < 0.2 && goal.y_m.abs() < 0.4,
        "{goal:?}"
    );
    assert!(goal.heading_rad.abs() < 0.3 && !survey.is_complete());
}

/// The odometry turns away by a degree a metre; the walls hold the map straight.
#[test]
fn the_walls_correct_the_odometry() {
    let mut survey = Survey::new(at(0.0));
    let (mut odometry, mut found) = (at(0.0), at(0.0));
    for step in 0..200_u32 {
        let truth = at(f64::from(step) * 0.04);
        found = survey.draw(after(step.into()), odometry, &scan(truth, 12.0));
        odometry = odometry.then(crate::ackermann::Motion {
            ahead_m: 0.04,
            left_m: 0.0,
            turn_rad: 0.04_f64.to_radians(),
        });
    }
    assert!((odometry.heading_rad - 8_f64.to_radians()).abs() < 1e-6);
    assert!(
        found.heading_rad.abs() < 0.03 && found.y_m.abs() < 0.05,
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
    while survey.next(&map, at(-0.3), |_| true).is_some() {
        goals += 1;
        assert!(goals < 50);
    }
    assert!(goals >= 3 && survey.is_complete());
    assert_eq!(survey.next(&map, at(-0.3), |_| true), None);
    // Nothing is decided before anything was drawn.
    let mut fresh = Survey::new(at(0.0));
    assert_eq!(fresh.next(&map, at(0.0), |_| true), None);
    assert!(!fresh.is_complete());
}
