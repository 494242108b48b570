//! YE7: manoeuvres to a pose.

use core::f32::consts::PI;
use core::time::Duration;

use protocols::telemetry::message::{ANY_HEADING, Pose, State, Telecommand};

use crate::bench::{Bench, SECOND, square, wrapped};
use crate::lidar::Dice;

/// Result of a manoeuvre: remaining position and heading error, maximum distance from the straight
/// line, time.
struct Went {
    apart_m: f64,
    turned: f64,
    beside_m: f64,
    took: Duration,
}

fn go(bench: &mut Bench, goal: [f32; 3]) -> Went {
    let [x0, y0, _] = bench.body;
    let [gx, gy, _] = goal.map(f64::from);
    let way = libm::hypot(gx - x0, gy - y0).max(1e-6);
    let (began, done) = (bench.now, bench.counter("arrivals") + 1);
    bench.go(goal[0], goal[1], goal[2]);
    let mut beside_m = 0.0_f64;
    while bench.counter("arrivals") < done && bench.now - began < 30 * SECOND {
        bench.step();
        let [x, y, _] = bench.body;
        let across = ((gx - x0) * (y - y0) - (gy - y0) * (x - x0)) / way;
        beside_m = beside_m.max(across.abs());
    }
    let took = bench.now - began;
    bench.run_until(2 * SECOND, |bench| bench.mode() == "off");
    let [x, y, heading] = bench.body;
    Went {
        apart_m: libm::hypot(gx - x, gy - y),
        turned: wrapped(f64::from(goal[2]) - heading),
        beside_m,
        took,
    }
}

/// 50 goals within 2 m, with headings over the whole circle including both its ends. The robot
/// begins each manoeuvre at the end of the previous one. The motors differ from the assumed ones by
/// 5 %.
#[test]
fn ye7_fifty_goals_are_reached() {
    fifty_goals(false);
}

/// Fifty goals with motors whose friction stops slow wheels: they do not turn slower than 20 rpm.
#[test]
fn ye7_fifty_goals_are_reached_by_jerky_motors() {
    fifty_goals(true);
}

fn fifty_goals(only_holds: bool) {
    let mut bench = Bench::new(square(100.0));
    bench.motors[0].only_holds = only_holds;
    bench.motors[1].only_holds = only_holds;
    bench.motors[0].rpm_per_volt = 42.0;
    bench.motors[1].rpm_per_volt = 38.0;
    let mut dice = Dice::new(7);
    let mut all = [const { Vec::new() }; 3];
    for at in 0..50 {
        let mut any = |most: f64| (dice.uniform() * 2.0 - 1.0) * most;
        let heading = match at % 10 {
            0 => PI,
            5 => -PI,
            _ => any(3.1) as f32,
        };
        let [x, y, _] = bench.body;
        let goal = [(x + any(2.0)) as f32, (y + any(2.0)) as f32, heading];
        // The goal is in odometry coordinates; the accuracy of the odometry is another test.
        bench.send(&Telecommand {
            corrected_pose: Some(Pose {
                x: x as f32,
                y: y as f32,
                alpha: bench.body[2] as f32,
            }),
            ..Telecommand::default()
        });
        let went = go(&mut bench, goal);
        let figures = [went.apart_m, went.turned.abs(), went.beside_m];
        all.iter_mut()
            .zip(figures)
            .for_each(|(all, figure)| all.push(figure));
    }
    all.iter_mut().for_each(|all| all.sort_by(f64::total_cmp));
    let [apart, turned, beside] = all.each_ref().map(|all| all[49]);
    let [m, turn, aside] = all.each_ref().map(|all| all[25]);
    println!(
        "YE7, median worst: {m:.4} {apart:.4} m, {:.2} {:.2} degrees, {aside:.4} {beside:.4} m",
        turn.to_degrees(),
        turned.to_degrees()
    );
    assert!(apart <= 0.025, "{apart} m");
    assert!(
        turned.to_degrees() <= 1.5,
        "{} degrees",
        turned.to_degrees()
    );
    assert!(beside <= 0.05, "{beside} m");
}

/// YA-01: from heading 3.0 to -3.0, the short direction is 0.28 rad and the long one 6.0 rad.
#[test]
fn ye7_the_last_turn_goes_the_short_way() {
    let time = |mut bench: Bench| {
        go(&mut bench, [0.0, 0.0, 3.0]);
        let went = go(&mut bench, [0.0, 0.0, -3.0]);
        assert!(went.turned.abs() < 0.03, "{}", went.turned);
        went.took
    };
    let sound = time(Bench::new(square(100.0)));
    let fielded = time(Bench::with_defect(square(100.0), "YA-01"));
    assert!(fielded > sound + SECOND, "{fielded:?} against {sound:?}");
}

/// YA-02: a new goal behind the robot while it drives to another one. Correctly, it turns first and
/// then drives straight; the fielded robot continues driving in a curve.
#[test]
fn a_new_goal_on_the_way_begins_with_its_turn() {
    let strayed = |mut bench: Bench| {
        bench.go(1.0, 0.0, ANY_HEADING);
        assert!(bench.run_until(5 * SECOND, |bench| bench.speed()[0] > 0.45));
        let began = bench.body;
        bench.go(-1.0, 0.0, ANY_HEADING);
        let mut beside = 0.0_f64;
        let (end, done) = (bench.now + 30 * SECOND, bench.counter("arrivals") + 1);
        while bench.counter("arrivals") < done && bench.now < end {
            bench.step();
            beside = beside.max((bench.body[1] - began[1]).abs());
        }
        beside
    };
    let sound = strayed(Bench::new(square(100.0)));
    let fielded = strayed(Bench::with_defect(square(100.0), "YA-02"));
    assert!(sound < 0.05 && fielded > 0.1, "{sound} m, {fielded} m");
}

/// 123456 means no final heading: the robot keeps its heading of arrival.
#[test]
fn any_heading_means_any() {
    let mut bench = Bench::new(square(100.0));
    go(&mut bench, [0.7, 0.7, ANY_HEADING]);
    let [x, y, heading] = bench.body;
    assert!(libm::hypot(x - 0.7, y - 0.7) < 0.025);
    assert!((heading.to_degrees() - 45.0).abs() < 3.0, "{heading}");
    assert_eq!(bench.mode(), "off");
}

/// A pose correction of the PC takes effect at once, also during a drive.
#[test]
fn a_corrected_pose_is_gone_on_from() {
    let mut bench = Bench::new(square(100.0));
    bench.go(1.0, 0.0, 0.0);
    assert!(bench.run_until(5 * SECOND, |bench| bench.body[0] > 0.5));
    // The corrected pose is 0.2 m to the left of the believed one.
    let y = bench.body[1] as f32 + 0.2;
    bench.send(&Telecommand {
        corrected_pose: Some(Pose {
            x: bench.body[0] as f32,
            y,
            alpha: bench.body[2] as f32,
        }),
        ..Telecommand::default()
    });
    assert!(bench.run_until(20 * SECOND, |bench| bench.mode() == "off"));
    let [x, y, _] = bench.body;
    assert!(libm::hypot(x - 1.0, y + 0.2) < 0.03, "{x} {y}");
    assert_eq!(bench.counter("telecommands"), 2);
    assert_eq!(
        bench.heard.last().map(|it| it.1.state),
        Some(Some(State::Off))
    );
}

/// The goal is behind a wall 0.6 m ahead, as for a robot with a wrong pose. The robot's deck, 0.12
/// m ahead of its middle, touches the wall at 4 cm/s, which does no harm.
#[test]
fn a_wall_that_no_map_has_is_touched_softly() {
    let mut bench = Bench::new(vec![[0.6, -2.0, 0.6, 2.0]]);
    bench.go(2.0, 0.0, ANY_HEADING);
    assert!(bench.run_until(20 * SECOND, |bench| bench.body[0] > 0.48));
    let [ahead, _] = bench.speed();
    assert!(ahead < 0.05, "{ahead} m/s");
}
