//! YE4: control of the wheels, and odometry.

use core::f64::consts::PI;
use core::time::Duration;

use crate::bench::{Bench, SECOND, square};

/// Manual driving at this speed for the given time; the PC repeats its order.
fn drive_for(bench: &mut Bench, linear: f32, angular: f32, duration: Duration) {
    let end = bench.now + duration;
    while bench.now < end {
        bench.drive(linear, angular);
        bench.run_for(Duration::from_millis(200).min(end - bench.now));
    }
}

/// A robot in manual mode, at rest, with its drivers on.
fn ready(mut bench: Bench) -> Bench {
    bench.drive(0.0, 0.0);
    assert!(bench.run_until(SECOND, |bench| bench.mode() == "manual"));
    bench
}

/// From 0 to 0.5 m/s: 0.5 / 1.5 = 333 ms of profile and 100 ms more; then within 2 % for a second.
/// The motors are 5 % stronger and 5 % weaker than assumed, with half a volt of friction.
fn worst_steady_error(mut bench: Bench, target: f64) -> f64 {
    bench.motors[0].rpm_per_volt = 42.0;
    bench.motors[1].rpm_per_volt = 38.0;
    drive_for(&mut bench, target as f32, 0.0, Duration::from_millis(434));
    let mut worst = 0.0_f64;
    for _ in 0..20 {
        drive_for(&mut bench, target as f32, 0.0, Duration::from_millis(50));
        for speed in wheel_speeds(&bench) {
            worst = worst.max((speed / target - 1.0).abs());
        }
    }
    worst
}

fn wheel_speeds(bench: &Bench) -> [f64; 2] {
    let [linear, angular] = bench.speed();
    [linear - angular * 0.09, linear + angular * 0.09]
}

#[test]
fn ye4_half_a_metre_per_second_is_reached_in_time_and_held() {
    for target in [0.5, -0.5] {
        let error = worst_steady_error(ready(Bench::new(square(100.0))), target);
        assert!(error <= 0.02, "{target}: {error}");
    }
}

/// YM-03: without an integral part and with a gain of 0.1 V a rpm, friction of 0.5 V costs 0.5 /
/// (0.1 + 1/40) = 4 rpm of 127, which is 3.1 %.
#[test]
fn ye4_without_an_integral_part_friction_leaves_an_error() {
    let error = worst_steady_error(ready(Bench::with_defect(square(100.0), "YM-03")), 0.5);
    assert!(error > 0.025, "{error}");
}

/// No wheel ever turns against the profile: its speed falls to zero and continues.
#[test]
fn ye4_a_reversal_has_no_error_of_sign() {
    let mut bench = ready(Bench::new(square(100.0)));
    drive_for(&mut bench, 0.5, 0.0, SECOND);
    let mut before = bench.speed()[0];
    bench.drive(-0.5, 0.0);
    for _ in 0..700 {
        bench.run_for(Duration::from_millis(1));
        let speed = bench.speed()[0];
        assert!(speed <= before + 0.002, "{before} to {speed}");
        before = speed;
    }
    assert!((before + 0.5).abs() < 0.01, "{before}");
}

/// The counters wrap at 65536; between two samples the odometry may deviate from the driven
/// distance by at most 1 mm. A subtraction without wrapping would jump by 65536 * 0.196 mm = 12.9
/// m.
#[test]
fn ye4_a_wrapping_counter_is_no_jump() {
    for id in [None, Some("YM-01")] {
        let mut bench = match id {
            None => Bench::new(square(100.0)),
            Some(id) => Bench::with_defect(square(100.0), id),
        };
        // The left counter counts up over its end, the right one counts down over it.
        bench.counter_offset = [65_000, 500];
        let mut bench = ready(bench);
        bench.drive(0.5, 0.0);
        for _ in 0..1_500 {
            let before = bench.robot.pose();
            bench.run_for(Duration::from_millis(1));
            let pose = bench.robot.pose();
            let step = (pose.x_mm - before.x_mm).hypot(pose.y_mm - before.y_mm);
            assert!(step < 1.0, "{id:?}: {step} mm in a millisecond");
        }
        let [apart, turned] = bench.pose_error();
        assert!(apart < 0.01 && turned.abs() < 0.02, "{apart} {turned}");
    }
}

/// Odometry along a circle of 0.5 m/s and 2 rad/s, radius 0.25 m. With the mid-point rule the
/// circle closes. With the end-point rule (YM-02) the path is rotated by half a step's angle, 1
/// mrad, about its beginning.
#[test]
fn the_mid_point_rule_goes_where_the_robot_goes() {
    let mut off = [0.0; 2];
    for (slot, id) in off.iter_mut().zip([None, Some("YM-02")]) {
        let mut bench = ready(match id {
            None => Bench::new(square(100.0)),
            Some(id) => Bench::with_defect(square(100.0), id),
        });
        let mut worst = 0.0_f64;
        for _ in 0..40 {
            drive_for(&mut bench, 0.5, 2.0, Duration::from_millis(100));
            worst = worst.max(bench.pose_error()[0]);
        }
        assert!(bench.body[2] > PI);
        *slot = worst;
    }
    let [sound, fielded] = off;
    assert!(sound < 0.003, "{sound} m");
    assert!(fielded > sound, "{fielded} m against {sound} m");
}

/// A board whose counters restart has not moved 6 m.
#[test]
fn a_counter_that_begins_anew_moves_nobody() {
    let mut bench = ready(Bench::new(square(100.0)));
    drive_for(&mut bench, 0.3, 0.0, SECOND);
    bench.counter_offset = [20_000, 40_000];
    drive_for(&mut bench, 0.3, 0.0, SECOND);
    let [apart, _] = bench.pose_error();
    assert!(apart < 0.005, "{apart} m");
    assert_eq!(bench.counter("encoder samples disbelieved"), 2);
}

/// Restarts after 20 or 90 counts of a turn on the spot, or of one wheel. With 90 counts back and
/// 90 ahead, the heading would go back by 2 x 17.7 / 180 rad, 11 degrees.
#[test]
fn a_board_that_begins_anew_turns_nobody_back() {
    for (linear, angular, counts) in [(0.0, 1.0, 20.0), (0.0, 1.0, 90.0), (0.09, 1.0, 90.0)] {
        let mut bench = ready(Bench::new(square(100.0)));
        bench.drive(linear, angular);
        while bench.motors.iter().all(|motor| motor.counts.abs() < counts) {
            bench.run_for(Duration::from_millis(1));
        }
        bench.counter_offset = [0, 1].map(|at| {
            let whole = libm::floor(bench.motors[at].counts) as i64;
            (whole as u16).wrapping_neg()
        });
        drive_for(&mut bench, linear, angular, SECOND);
        let [_, turned] = bench.pose_error();
        assert!(
            turned.abs() < 0.012,
            "{counts} counts, {linear} m/s: {turned} rad"
        );
    }
}

/// D2: motors are controlled each millisecond: while the robot accelerates, nearly every
/// millisecond has a different duty.
#[test]
fn d2_motors_are_controlled_each_millisecond() {
    let mut bench = ready(Bench::new(square(100.0)));
    bench.drive(0.5, 0.0);
    let mut changes = 0;
    for _ in 0..100 {
        let before = bench.outputs.duty;
        bench.run_for(Duration::from_millis(1));
        changes += u32::from(bench.outputs.duty != before);
    }
    assert!(changes >= 95, "{changes} of 100");
}
