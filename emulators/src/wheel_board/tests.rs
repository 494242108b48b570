//! The board on a chassis of its own figures: wheels of 37.5 mm, 180 mm apart, 1200 counts a turn,
//! 60 ms of lag. Speeds by hand: 1 m/s is 60 / (2 pi 0.0375) = 254.65 rpm, 5093 counts a second;
//! a duty of 0.75 is 6 V, 240 rpm, 0.9425 m/s, 4800 counts a second.

use protocols::peripherals::SampleDecoder;

use super::*;
use crate::world::{BodyConfig, Point, Pose, Scene, Shape, Wheel};

struct Bench {
    board: WheelBoard,
    world: World,
    samples: Vec<Sample>,
    decoder: SampleDecoder,
    now: Instant,
}

fn motors_alike() -> Config {
    let mut config = Config::default();
    config.motor.spread = 0.0;
    config.range_noise_v = 0.0;
    config.drain_v_per_h = [0.0; 2];
    config
}

fn bench(config: Config, walls: &[[f64; 4]]) -> Bench {
    let walls = walls.iter().map(|&[x0, y0, x1, y1]| Shape::Wall {
        from: Point::new(x0, y0),
        to: Point::new(x1, y1),
    });
    let scene = Scene::new(walls.collect::<Vec<_>>(), vec![]).expect("walls of a test");
    let body = BodyConfig {
        radius_m: 0.02,
        wheel_radius_m: 0.0375,
        axle_m: 0.18,
        ticks_per_turn: 1200,
        full_speed_m_s: 2.0,
        lag_s: 0.060,
        ..BodyConfig::default()
    };
    Bench {
        board: WheelBoard::new("board", 7, config),
        world: World::new(scene, body.ideal(), Pose::default(), 1).expect("free"),
        samples: Vec::new(),
        decoder: SampleDecoder::default(),
        now: Instant::ZERO,
    }
}

impl Bench {
    fn set(&mut self, outputs: Outputs) {
        self.hear(&outputs.encode());
    }

    fn hear(&mut self, bytes: &[u8]) {
        self.board.receive(WheelBoard::BUS, self.now, bytes);
        self.board.poll(self.now, &mut self.world);
    }

    fn run(&mut self, ms: u64) -> &mut Self {
        for _ in 0..ms {
            self.now += Duration::from_millis(1);
            self.board.poll(self.now, &mut self.world);
            let mut bytes = [0; 64];
            let len = self.board.transmit(WheelBoard::BUS, &mut bytes);
            let samples = self.decoder.push(&bytes[..len]).filter_map(Result::ok);
            self.samples.extend(samples);
        }
        self
    }

    fn last(&self) -> Sample {
        *self.samples.last().expect("one a millisecond")
    }

    fn counters(&self) -> [i16; 2] {
        self.last().counters.map(u16::cast_signed)
    }

    fn rules(&mut self) -> Vec<(EventKind, &'static str)> {
        let events = self.board.take_events().into_iter();
        events.map(|event| (event.kind, event.rule)).collect()
    }
}

fn forward(left: u16, right: u16) -> Outputs {
    Outputs {
        duty: [left, 10_000 - right],
        channel: 0,
        enable: true,
    }
}

#[test]
fn a_sample_comes_each_millisecond() {
    let mut bench = bench(motors_alike(), &[]);
    bench.run(250);
    assert_eq!(bench.samples.len(), 250);
    assert_eq!(bench.last().supply_cv, 1_200);
    assert_eq!(bench.board.poll_at(), Some(Instant::from_millis(251)));
}

/// With a lag of 60 ms the speed has reached 1 - 1/e after 60 ms, and the distance lags 60 ms
/// behind: 4800 * (1.0 - 0.06) = 4512 counts in the first second, 4800 in the next.
#[test]
fn a_step_of_the_duty_is_followed_with_the_lag() {
    let mut bench = bench(motors_alike(), &[]);
    bench.set(forward(7_500, 7_500));
    bench.run(60);
    let part = bench.world.wheel_speed(Wheel::Left) / 0.9425;
    assert!((part - 0.632).abs() < 0.01, "{part}");
    bench.run(940);
    let [first, _] = bench.counters();
    assert!((first - 4_512).abs() <= 6, "{first}");
    bench.run(1_000);
    let [second, _] = bench.counters();
    assert!((second - first - 4_800).abs() <= 2, "{}", second - first);
}

/// The right motor is mounted mirrored: more than a half turns it back, and its counter counts down
/// as the robot goes ahead.
#[test]
fn the_right_wheel_is_mirrored() {
    let mut bench = bench(motors_alike(), &[]);
    bench.set(forward(7_500, 7_500));
    assert_eq!(
        bench.board.set_points().map(|it| (it * 1e4).round()),
        [9_425.0; 2]
    );
    bench.run(1_000);
    let [left, right] = bench.counters();
    assert!((left + right).abs() <= 1, "{left}, {right}");
    assert!(bench.world.pose().x > 0.8 && bench.world.pose().y.abs() < 1e-6);
    bench.set(forward(7_500, 2_500));
    bench.run(1_000);
    assert!(
        bench.world.turn_rate() < -10.0,
        "left ahead, right back: clockwise"
    );
}

/// 1 m/s for 10 s: 50,930 counts, more than 16 bits hold with a sign.
#[test]
fn counters_wrap() {
    let mut bench = bench(motors_alike(), &[]);
    // The duty for 254.65 rpm at 40 rpm/V is 10,000 / 24 V times that voltage: 2,652 above a half.
    let duty = 5_000 + 2_652;
    bench.set(forward(duty, duty));
    bench.run(16_000);
    let (first, last) = (bench.samples[0].counters[0], bench.last().counters[0]);
    assert!(first < 10);
    let travelled = 5_093.0 * (16.0 - 0.06);
    assert!(
        (f64::from(last) - (travelled - 65_536.0)).abs() < 30.0,
        "{last}"
    );
}

/// 0.48 V do not turn the wheel, 0.6 V turn it at 24 rpm: 0.0942 m/s.
#[test]
fn friction_holds_the_wheel_below_half_a_volt() {
    let mut bench = bench(motors_alike(), &[]);
    bench.set(forward(5_200, 5_250));
    bench.run(1_000);
    assert_eq!(bench.world.wheel_speed(Wheel::Left), 0.0);
    let right = bench.world.wheel_speed(Wheel::Right);
    assert!((right - 0.0942).abs() < 1e-3, "{right}");
}

#[test]
fn motors_differ_by_up_to_five_per_cent() {
    let boards = (0..100).map(|seed| WheelBoard::new("board", seed, Config::default()));
    let all: Vec<f64> = boards.flat_map(|board| board.rpm_per_v()).collect();
    assert!(all.iter().all(|it| (38.0..=42.0).contains(it)));
    let share = |of: fn(&f64) -> bool| all.iter().filter(|it| of(it)).count();
    assert!(share(|it| *it < 39.0) > 30 && share(|it| *it > 41.0) > 30);
}

#[test]
fn without_the_bridges_the_wheels_run_out() {
    let mut bench = bench(motors_alike(), &[]);
    bench.set(forward(7_500, 7_500));
    bench.run(500);
    let off = Outputs {
        enable: false,
        ..forward(7_500, 7_500)
    };
    bench.set(off);
    assert_eq!(bench.board.set_points(), [0.0; 2]);
    bench.run(2_000);
    assert_eq!(bench.world.wheel_speed(Wheel::Left), 0.0);
    let rules = bench.rules();
    assert_eq!(
        rules,
        [
            (EventKind::Note, "drivers-on"),
            (EventKind::Note, "drivers-off"),
            (EventKind::Note, "duty-without-driver"),
        ]
    );
}

/// Data sheet: 0.4 V at 0.8 m, 1.9 V more at 0.1 m. Linear in 1/d: 0.2171 V m, so 1.2143 V at 0.2
/// m. At 7 cm 3.2306 V, half of it at half the distance.
#[test]
fn the_range_sensor_has_the_curve_of_the_data_sheet() {
    let places = [0.8, 0.4, 0.2, 0.1, 0.07, 0.035, 0.0];
    let found = places.map(|d| (infrared::volts(Some(d)) * 1e4).round());
    assert_eq!(
        found,
        [
            4_000.0, 6_714.0, 12_143.0, 23_000.0, 32_306.0, 16_153.0, 0.0
        ]
    );
    assert_eq!((infrared::volts(None) * 1e4).round(), 1_286.0);
}

/// A wall 0.29 m ahead of the middle is 0.2 m from the sensor ahead, which gives 1.2143 V: 1507 of
/// 4095 at 3.3 V. The sensor at 60 degrees to the right sees it under 60 degrees.
#[test]
fn sensors_are_numbered_clockwise_from_ahead() {
    let mut bench = bench(motors_alike(), &[[0.29, -2.0, 0.29, 2.0]]);
    bench.run(100);
    assert_eq!(bench.last().adc, 1_507);
    // The wall is 0.29 - 0.09 cos 60 = 0.245 m ahead of the sensor and 0.49 m away along its beam:
    // 0.5718 V.
    for channel in [1, 5] {
        bench.set(Outputs {
            channel,
            ..Outputs::default()
        });
        bench.run(1);
        assert_eq!((bench.last().channel, bench.last().adc), (channel, 709));
    }
    let right_wall = [[-2.0, -0.29, 2.0, -0.29]];
    let mut bench = self::bench(motors_alike(), &right_wall);
    bench.run(100);
    let volts: Vec<f64> = bench.board.range_volts().collect();
    assert!(volts[1] > 0.5 && volts[2] > 0.5, "{volts:?}");
    assert!([0, 3, 4, 5].iter().all(|at| volts[*at] < 0.2), "{volts:?}");
}

/// A new value comes each 38.3 ms on average, after 28.7 to 47.9 ms: 261 values in ten seconds.
#[test]
fn a_value_is_held_until_the_next() {
    let mut config = motors_alike();
    config.range_noise_v = 0.015;
    let mut bench = bench(config, &[[0.29, -2.0, 0.29, 2.0]]);
    bench.run(10_000);
    let adc: Vec<u16> = bench.samples.iter().map(|sample| sample.adc).collect();
    let changes: Vec<usize> = (1..adc.len())
        .filter(|at| adc[*at] != adc[at - 1])
        .collect();
    assert!((245..=265).contains(&changes.len()), "{}", changes.len());
    let shortest = changes.windows(2).map(|two| two[1] - two[0]).min();
    assert!(shortest >= Some(28), "{shortest:?}");
    let (least, most) = (adc[100..].iter().min(), adc[100..].iter().max());
    assert!(
        least > Some(&1_430) && most < Some(&1_585),
        "{least:?} {most:?}"
    );
}

#[test]
fn the_button_is_down_while_it_is_pressed() {
    let mut config = motors_alike();
    config.presses = vec![Press {
        at: Instant::from_millis(100),
        lasting: Duration::from_millis(50),
    }];
    let mut bench = bench(config, &[]);
    bench.run(300);
    let down = bench.samples.iter().filter(|sample| sample.button).count();
    assert_eq!(down, 50);
}

/// 3600 V an hour is a volt a second; the wheels slow down with it, to 10 / 12 of 0.9425 m/s.
#[test]
fn the_battery_runs_down() {
    let mut config = motors_alike();
    config.drain_v_per_h = [3_600.0, 0.0];
    let mut bench = bench(config, &[]);
    bench.set(forward(7_500, 7_500));
    bench.run(2_000);
    assert!(bench.last().supply_cv.abs_diff(1_000) <= 1);
    let speed = bench.world.wheel_speed(Wheel::Left);
    assert!((speed - 0.785).abs() < 0.06, "{speed}");
    bench.run(10_000);
    assert_eq!(bench.last().supply_cv, 600, "an empty pack");
}

#[test]
fn what_a_master_does_wrong_is_told() {
    let mut bench = bench(motors_alike(), &[]);
    bench.set(Outputs {
        channel: 6,
        ..AT_RESET
    });
    assert_eq!(bench.rules(), [(EventKind::Violation, "open-channel")]);
    let frame = AT_RESET.encode();
    bench.hear(&frame[..4]);
    bench.run(3);
    assert_eq!(bench.rules(), [(EventKind::Violation, "bad-frame")]);
    bench.hear(&frame);
    assert_eq!(bench.rules(), []);
}

fn with_fault(fault: &str, figure: Option<f64>) -> Bench {
    let mut bench = bench(motors_alike(), &[[3.0, -2.0, 3.0, 2.0]]);
    bench.set(forward(7_500, 7_500));
    bench.run(1_000);
    assert!(bench.board.known_faults().contains(&fault));
    bench.board.set_fault(bench.now, fault, figure, true);
    bench.run(1_000);
    bench
}

#[test]
fn an_encoder_that_is_stuck_counts_nothing() {
    let mut bench = with_fault("stuck", Some(1.0));
    let [left, right] = bench.counters();
    assert!(
        (left - 9_312).abs() <= 8 && (right + 4_512).abs() <= 8,
        "{left} {right}"
    );
    bench.board.set_fault(bench.now, "stuck", Some(1.0), false);
    bench.run(1_000);
    let [_, again] = bench.counters();
    assert!(
        (again + 9_312).abs() <= 8,
        "{again}: what it missed is lost"
    );
    assert_eq!(
        with_fault("stuck", None).counters()[0],
        with_fault("stuck", Some(0.0)).counters()[0]
    );
}

/// Counts after two seconds. With a tenth more in the second one they are 4512 + 1.1 * 4800 = 9792.
/// At half speed in the second one they are 4512 + 4800 / 2 + 2400 * 0.06 = 7056.
#[test]
fn counts_can_be_wrong_and_motors_slow() {
    let [left, _] = with_fault("wrong", None).counters();
    assert!((left - 9_792).abs() <= 9, "{left}");
    let [left, _] = with_fault("slow", None).counters();
    assert!((left - 7_056).abs() <= 9, "{left}");
}

#[test]
fn a_board_that_restarts_forgets_counts_and_outputs() {
    let mut bench = with_fault("restart", None);
    assert_eq!(bench.board.outputs(), AT_RESET);
    assert!(bench.world.wheel_speed(Wheel::Left) < 0.01);
    // The wheel runs down during the 150 ms of an open bridge: 4800 * 0.15 counts.
    let [left, _] = bench.counters();
    assert!((left - 720).abs() <= 12, "{left}");
    bench.set(forward(7_500, 7_500));
    bench.run(500);
    assert!(bench.world.wheel_speed(Wheel::Left) > 0.9);
}

#[test]
fn without_supply_it_says_and_hears_nothing() {
    let mut bench = with_fault("off", None);
    assert_eq!(bench.samples.len(), 1_000);
    bench.set(forward(7_500, 7_500));
    bench.run(100);
    assert_eq!(bench.world.wheel_speed(Wheel::Left), 0.0);
    bench.board.set_fault(bench.now, "off", None, false);
    bench.run(100);
    assert_eq!(bench.samples.len(), 1_100);
}

#[test]
fn range_sensors_go_blind_and_the_converter_mad() {
    let walls = [[0.5, -2.0, 0.5, 2.0]];
    let mut bench = bench(motors_alike(), &walls);
    let seen = |bench: &Bench| {
        bench
            .board
            .range_volts()
            .map(|it| it > 0.3)
            .collect::<Vec<_>>()
    };
    bench.run(100);
    assert_eq!(seen(&bench)[..2], [true, true]);
    bench.board.set_fault(bench.now, "blind", Some(0.0), true);
    bench.run(100);
    assert_eq!(seen(&bench)[..2], [false, true]);
    bench.board.set_fault(bench.now, "blind", None, true);
    bench.run(100);
    assert_eq!(seen(&bench), [false; 6]);
    bench.board.set_fault(bench.now, "blind", None, false);
    bench.board.set_fault(bench.now, "garbage", None, true);
    bench.run(100);
    let mut adc: Vec<u16> = bench.samples[300..].iter().map(|it| it.adc).collect();
    adc.sort_unstable();
    adc.dedup();
    assert!(adc.len() > 90 && adc[0] < 500 && adc[adc.len() - 1] > 3_500);
}

#[test]
fn a_chassis_without_two_motors_does_not_fit() {
    use crate::world::{Ackermann, AckermannConfig, Differential};
    let fits = |chassis: &dyn Chassis| WheelBoard::check_chassis(chassis);
    assert_eq!(
        fits(&Differential::new(BodyConfig::default(), 1).expect("sound")),
        Ok(())
    );
    let car = Ackermann::new(AckermannConfig::default(), 1).expect("sound");
    assert_eq!(
        fits(&car),
        Err("the chassis has no motor \"left\"".to_owned())
    );
}

/// The next sample reports the counters' content.
#[test]
fn counters_are_shown_as_they_are_told() {
    let mut bench = bench(motors_alike(), &[]);
    bench.set(forward(7_500, 6_000));
    bench.run(400);
    let counters = bench.board.counters();
    assert_eq!(counters, bench.last().counters);
    assert!(counters[0] > 0 && counters[1] > 0 && counters[0] != counters[1]);
}

/// There is something to send from each millisecond's sample until it is taken.
#[test]
fn a_sample_is_offered_until_it_is_taken() {
    let mut bench = bench(motors_alike(), &[]);
    assert!(!bench.board.may_send(WheelBoard::BUS));
    bench.board.poll(Instant::from_millis(1), &mut bench.world);
    assert!(bench.board.may_send(WheelBoard::BUS));
    let mut bytes = [0; 64];
    bench.board.transmit(WheelBoard::BUS, &mut bytes);
    assert!(!bench.board.may_send(WheelBoard::BUS));
    assert_eq!(
        bench.board.line_config(WheelBoard::BUS),
        LineConfig::new_8n1(BAUD)
    );
}

/// Only the start of the fault `restart` causes a restart; its end has no effect.
#[test]
fn a_restart_is_one() {
    let mut bench = bench(motors_alike(), &[]);
    bench.run(10);
    bench.rules();
    bench.board.set_fault(bench.now, "restart", None, false);
    assert_eq!(bench.rules(), []);
    bench.board.set_fault(bench.now, "restart", None, true);
    assert_eq!(bench.rules(), [(EventKind::Note, "restart")]);
}

/// The board returns its configuration unchanged.
#[test]
fn a_board_tells_its_configuration() {
    let config = Config {
        supply_v: 11.1,
        mirrored: [true, false],
        ..motors_alike()
    };
    let bench = bench(config.clone(), &[]);
    assert_eq!(*bench.board.config(), config);
    assert_ne!(config, Config::default());
}

/// 11 V without a loss; a loss of 3,600 V an hour leaves 10 V after a second.
#[test]
fn the_supply_is_that_of_the_battery() {
    let config = |drain| Config {
        supply_v: 11.0,
        drain_v_per_h: [drain, 0.0],
        ..motors_alike()
    };
    let supply_v = |drain| {
        let mut bench = bench(config(drain), &[]);
        bench.run(1_000);
        bench.board.supply_v()
    };
    assert!((supply_v(0.0) - 11.0).abs() < 1e-9);
    assert!((supply_v(3_600.0) - 10.0).abs() < 1e-3);
}

/// The multiplexer has eight channels; more bits than that choose the last.
#[test]
fn a_channel_beyond_the_multiplexer_is_its_last() {
    let mut bench = bench(motors_alike(), &[]);
    let mut chosen = |channel| {
        bench.board.outputs.channel = channel;
        bench.board.sample(bench.now).channel
    };
    assert_eq!([0, 7, 8, 255].map(&mut chosen), [0, 7, 7, 7]);
}
