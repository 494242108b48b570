//! Motion control, odometry, and driving by the IR sensors.

use std::path::Path;

use emulators::world::Wheel;
use firmware_core::pose::sin_cos;
use firmware_core::robots::yellow::Velocity;
use protocols::Instant;
use protocols::telemetry::message::{Reactive, State, Telecommand};

use super::bench::{COUNT_M, Robot, SECOND};
use crate::{Bug, Observation, Variant};
use engine::run::Run;
use engine::scenario::Scenario;

const MOTION: &str = "robot's program, motion control";
const REACTIVE: &str = "robot's program, reactive drive";

pub(super) const ROWS: [Bug; 5] = [
    Bug::mutant(
        "YM-01",
        MOTION,
        "a counter wraps: the figure of the previous sample replaces the new one",
        ym_01,
    ),
    Bug::mutant(
        "YM-02",
        MOTION,
        "the path of a sample is added along the heading at its end: curves are rotated",
        ym_02,
    ),
    Bug::mutant(
        "YM-03",
        MOTION,
        "the control has no integral part: with a weak battery the wheels stay below their set-point",
        ym_03,
    ),
    Bug::mutant(
        "YR-01",
        REACTIVE,
        "the formula demands 13 rad/s where 3 are possible: bang-bang, slightly to the left",
        yr_01,
    ),
    Bug::mutant(
        "YR-02",
        REACTIVE,
        "the sensors' curve is right only near the robot: 0.8 m are read as 0.38 m",
        yr_02,
    ),
];

/// The left counter rests at the end of its range, then moves 5 counts across it within a
/// millisecond. The right wheel makes the same move in the middle of its range.
fn ym_01(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YM-01");
    robot.counts = [65_533.0, 1_000.0];
    for _ in 0..3 {
        robot.sample();
    }
    robot.counts = robot.counts.map(|count| count + 5.0);
    robot.sample();
    let pose = robot.program.pose();
    let (way, turned) = (pose.x_mm, pose.heading.to_degrees());
    robot.seen.figure(
        "distance of 5 counts across the counter's end, mm",
        format!("{way:.2}"),
    );
    robot.seen.figure("turned, degrees", format!("{turned:.2}"));
    robot.judged(way < 0.6)
}

/// Half a turn about the left wheel at full speed, 9 counts a millisecond of 0.196 mm: a chord of
/// 180 mm. Half the angle of a sample, 4.9 mrad, shifts its end sideways by 0.9 mm.
fn ym_02(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YM-02");
    robot.sample();
    let half_turn = core::f64::consts::PI * 0.18 / COUNT_M;
    while robot.counts[1] < half_turn {
        robot.counts[1] += 9.0;
        robot.sample();
    }
    // The left wheel stays in its position, 90 mm to the left of the start.
    let pose = robot.program.pose();
    let (sin, cos) = sin_cos(pose.heading);
    let aside = cos * 90.0 + pose.y_mm - 90.0;
    let along = pose.x_mm - sin * 90.0;
    let off = aside.hypot(along);
    let name = "position error after half a turn on one wheel, mm";
    robot.seen.figure(name, format!("{off:.1}"));
    robot.judged(off > 0.5)
}

/// Manual driving at 0.25 m/s in the whole rig, on a battery of 9 V: only the gain compensates for
/// the low voltage.
fn ym_03(variant: Variant) -> Observation {
    let defects = match variant {
        Variant::Defective => "\"YM-03\"",
        Variant::Sound => "",
    };
    let text = format!(
        "schema = 1\nname = \"ym-03\"\nrobot = \"yellow\"\nduration = \"20s\"\n\
         [program]\ndefects = [{defects}]\n\
         [device.board.wheel-board]\nsupply_v = 9\nrpm_spread = 0\n\
         [[mission.step]]\nat = \"100ms\"\ndo = \"connect\"\n\
         [[mission.step]]\nat = \"500ms\"\ndo = {{ drive = [0.25, 0.25] }}\n\
         [world]\nstart = {{ x_m = 0.5, y_m = 2.0, heading_deg = 0 }}\n[[world.wall]]\n\
         path_m = [[0, 0], [8, 0], [8, 4], [0, 4], [0, 0]]\n"
    );
    let (scenario, source) = Scenario::parse(Path::new("museum"), text).expect("sound");
    let mut run = Run::new(scenario, &source, None).expect("can be wired");
    run.go_on_until(Instant::ZERO + SECOND * 3);
    let from = Wheel::ALL.map(|wheel| run.rig.world.encoder_ticks(wheel));
    run.go_on_until(Instant::ZERO + SECOND * 7);
    let to = Wheel::ALL.map(|wheel| run.rig.world.encoder_ticks(wheel));
    let speeds = [0, 1].map(|side| counts(from[side], to[side]) * COUNT_M / 4.0);
    let slowest = speeds[0].min(speeds[1]);
    let short = (1.0 - slowest / 0.25) * 100.0;
    let mut seen = Observation::default();
    let name = "slower than asked for, per cent";
    seen.figure(name, format!("{short:.1}"));
    seen.judged(short > 2.0)
}

#[expect(clippy::cast_precision_loss, reason = "thousands")]
fn counts(from: i64, to: i64) -> f64 {
    (to - from) as f64
}

/// ADC value at this voltage, full scale 3.3 V.
fn adc(volts: f64) -> u16 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "of 12 bits"
    )]
    let value = (volts / 3.3 * 4_095.0).round() as u16;
    value
}

/// Voltage of a sensor at this distance, metres: 0.4 V at 0.8 m, 1.9 V more at 0.1 m, linear in the
/// reciprocal (data sheet).
fn volts(metres: f64) -> f64 {
    0.4 + 1.9 * (1.0 / metres - 1.25) / 8.75
}

/// Obstacles 0.2 m ahead, 0.15 m to the right, 0.25 m to the left, at a nominal speed of 0.5 m/s.
fn yr_01(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YR-01");
    for (channel, metres) in [(0, 0.2), (1, 0.15), (5, 0.25)] {
        robot.adc[channel] = adc(volts(metres));
    }
    robot.order(&Telecommand {
        state: Some(State::AutoReactive),
        reactive: Some(Reactive {
            speed_m_s: Some(0.5),
            ..Reactive::default()
        }),
        ..Telecommand::default()
    });
    robot.run(SECOND);
    let Velocity {
        linear_m_s,
        angular_rad_s,
    } = robot.program.target();
    robot
        .seen
        .figure("wanted ahead, m/s", format!("{linear_m_s:.1}"));
    robot
        .seen
        .figure("wanted turn, rad/s", format!("{angular_rad_s:.1}"));
    robot.judged(angular_rad_s > 3.0)
}

fn yr_02(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "YR-02");
    robot.adc = [adc(volts(0.8)); 8];
    robot.run(SECOND / 100);
    let [ahead, ..] = robot.program.infrared_m();
    let name = "read of a wall at 0.8 m, m";
    robot.seen.figure(name, format!("{ahead:.2}"));
    robot.judged(ahead < 0.5)
}
