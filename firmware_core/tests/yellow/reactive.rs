//! Driving by the IR sensors: single situations. Whole labyrinths are driven elsewhere (YE6).

use protocols::telemetry::message::{Reactive, State, Telecommand};

use crate::bench::{Bench, SECOND, Wall, closed};

const BODY_M: f64 = 0.1;

/// A corridor 0.5 m wide that turns right after 2 m and goes on for 2 m.
fn corner() -> Vec<Wall> {
    closed(&[
        [-0.3, -0.25],
        [1.75, -0.25],
        [1.75, -3.0],
        [2.25, -3.0],
        [2.25, 0.25],
        [-0.3, 0.25],
    ])
}

fn drive(mut bench: Bench, seconds: u32) -> Bench {
    bench.order(State::AutoReactive);
    bench.run_for(seconds * SECOND);
    bench
}

#[test]
fn a_corner_is_gone_round_without_a_touch() {
    let mut bench = Bench::new(corner());
    bench.order(State::AutoReactive);
    let through = bench.run_until(60 * SECOND, |bench| bench.body[1] < -2.0);
    assert!(through, "{:?} {}", bench.body, bench.clearance_m);
    assert!(bench.clearance_m > BODY_M, "{} m", bench.clearance_m);
}

/// YR-01: bang-bang and a little to the left; the demonstration failed with it.
#[test]
fn the_fielded_formula_touches_a_wall_in_the_corner() {
    let mut bench = Bench::with_defect(corner(), "YR-01");
    bench.send(&Telecommand {
        reactive: Some(Reactive {
            speed_m_s: Some(0.5),
            ..Reactive::default()
        }),
        ..Telecommand::default()
    });
    let bench = drive(bench, 20);
    let through = bench.body[1] < -2.0;
    assert!(!through || bench.clearance_m <= BODY_M, "{:?}", bench.body);
}

/// B4, by hand: v_p = 0.5, d = (0.2, 0.15, 0.25), d_max = 0.3: v = 0.3 + 4 * 2/3 * 2/3 = 2.08 m/s,
/// turn = 0.1 + 40 / 3 = 13.4 rad/s, by which the figures of the evaluation are met.
#[test]
fn the_fielded_formula_is_always_at_its_ends() {
    let walls = closed(&[
        [-1.0, -0.1905],
        [0.27, -0.1905],
        [0.27, 0.277],
        [-1.0, 0.277],
    ]);
    let mut bench = Bench::with_defect(walls, "YR-01");
    bench.send(&Telecommand {
        state: Some(State::AutoReactive),
        reactive: Some(Reactive {
            speed_m_s: Some(0.5),
            ..Reactive::default()
        }),
        ..Telecommand::default()
    });
    // The robot is held: only what it wants counts.
    bench.motors[0].friction_volts = 100.0;
    bench.motors[1].friction_volts = 100.0;
    bench.run_for(SECOND);
    let wanted = bench.robot.target();
    let seen = bench.robot.infrared_m();
    assert!(
        (wanted.linear_m_s - 2.08).abs() < 0.1,
        "{wanted:?} {seen:?}"
    );
    assert!(
        (wanted.angular_rad_s - 13.4).abs() < 1.0,
        "{wanted:?} {seen:?}"
    );
}

/// A blind end: back, turn to where there is more room, and out again.
#[test]
fn a_blind_end_is_left() {
    let walls = closed(&[[-2.0, -0.25], [0.6, -0.25], [0.6, 0.25], [-2.0, 0.25]]);
    let mut bench = Bench::new(walls);
    bench.order(State::AutoReactive);
    let out = bench.run_until(60 * SECOND, |bench| bench.body[0] < -0.8);
    assert!(out, "{:?}", bench.body);
    assert!(bench.clearance_m > BODY_M, "{} m", bench.clearance_m);
}

/// What the PC does not say, or says below zero, is the robot's own figure.
#[test]
fn figures_below_zero_are_the_robots_own() {
    let speed = |order: Option<f32>| {
        let mut bench = Bench::new(Vec::new());
        bench.send(&Telecommand {
            reactive: Some(Reactive {
                speed_m_s: order,
                ..Reactive::default()
            }),
            ..Telecommand::default()
        });
        let bench = drive(bench, 2);
        bench.robot.target().linear_m_s
    };
    assert_eq!([None, Some(-1.0), Some(f32::NAN)].map(speed), [0.3; 3]);
    assert_eq!(speed(Some(0.2)), 0.2);
}
