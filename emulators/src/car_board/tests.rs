//! The board under a car: its actuators, its frames, and its stops.

use proptest::collection::vec;
use proptest::prelude::*;
use protocols::Decode as _;
use protocols::car_board::{Decoder, Readings};

use super::*;
use crate::device::next_poll;
use crate::world::{Ackermann, Fixture, FloorLine, Point, Pose, Scene, Shape};

struct Run {
    world: World,
    board: CarBoard,
    now: Instant,
}

fn run_in(scene: Scene, config: BoardConfig) -> Run {
    let body = Box::new(Ackermann::new(chassis().ideal(), 1).unwrap());
    Run {
        world: World::with_chassis(scene, body, Pose::default()).unwrap(),
        board: CarBoard::new(config),
        now: Instant::ZERO,
    }
}

fn run(config: BoardConfig) -> Run {
    run_in(Scene::new(Vec::<Fixture>::new(), vec![]).unwrap(), config)
}

fn wall(from: (f64, f64), to: (f64, f64)) -> Shape {
    let point = |(x, y)| Point::new(x, y);
    Shape::Wall {
        from: point(from),
        to: point(to),
    }
}

impl Run {
    /// Readings of the frames until `end`.
    fn until(&mut self, end: Instant) -> Vec<Readings> {
        let mut decoder = Decoder::default();
        let mut found = Vec::new();
        while self.now < end {
            self.now = next_poll(&self.board, self.now, end);
            self.world.advance(self.now);
            self.board.poll(self.now, &mut self.world);
            let mut buf = [0; 64];
            let len = self.board.transmit(CarBoard::UART, &mut buf);
            found.extend(decoder.push(&buf[..len]).filter_map(Result::ok));
            decoder.idle();
        }
        found.extend(decoder.push(&[]).filter_map(Result::ok));
        found.iter().map(Frame::readings).collect()
    }

    fn say(&mut self, bytes: &[u8]) {
        self.board.receive(CarBoard::UART, self.now, bytes);
        self.board.poll(self.now, &mut self.world);
    }
}

fn secs(secs: u64) -> Instant {
    Instant::from_secs(secs)
}

/// Level 2 drives at 22 cm/s and level -3 at -22 cm/s, both within 5 %. Level -2 does not move the
/// car.
#[test]
fn levels_2_and_minus_3_are_22_cm_a_second() {
    for (byte, speed) in [(0x8C, 0.22), (0x87, -0.22), (0x88, 0.0), (0x8A, 0.0)] {
        let mut run = run(BoardConfig::default());
        run.say(&[byte]);
        run.until(secs(3));
        let found = run.world.axis_speed("drive").unwrap();
        assert!((found - speed).abs() <= 0.05 * 0.22, "{byte:02X}: {found}");
        assert!((found - speed).abs() < 1e-3);
    }
}

/// Steering value 0 (byte 32) is 6 degrees to the left, -50 is 25 degrees to the left, 50 is 18 to
/// the right.
#[test]
fn steering_values_turn_the_wheels_as_the_table_says() {
    let mut run = run(BoardConfig::default());
    for (second, (byte, degrees)) in (1..).zip([(0x32, 6.0), (0x00, 25.0), (0x64, -18.0)]) {
        run.say(&[byte]);
        run.until(secs(second));
        let found = run.world.chassis().actual(1).to_degrees();
        assert!((found - degrees).abs() < 1e-6, "{byte:02X}: {found}");
    }
}

/// Between two frames no byte waits to be sent.
#[test]
fn a_board_may_send_while_a_frame_waits() {
    let mut run = run(BoardConfig::default());
    assert!(!run.board.may_send(CarBoard::UART));
    while !run.board.may_send(CarBoard::UART) {
        assert!(run.now < secs(1), "no frame in a second");
        run.now = next_poll(&run.board, run.now, secs(2));
        run.world.advance(run.now);
        run.board.poll(run.now, &mut run.world);
    }
    let mut buf = [0; 64];
    assert!(run.board.transmit(CarBoard::UART, &mut buf) > 0);
    assert!(!run.board.may_send(CarBoard::UART));
    assert_eq!(run.board.transmit(CarBoard::UART, &mut buf), 0);
}

/// 10 s are 150 frames less the first period. With 39.789 pulses a metre, 2 m straight are 79 or 80
/// pulses. In a left turn of 1/m the left wheel rolls 1 - 0.0775 of the middle's distance.
#[test]
fn the_hall_sensor_gives_39_8_pulses_a_metre_of_the_left_wheel() {
    let mut run = run(BoardConfig::default());
    run.say(&[0x8C, 0x39]);
    let frames = run.until(secs(10));
    assert!((149..=150).contains(&frames.len()), "{}", frames.len());
    let way = run.world.pose().point().distance(Point::default());
    let pulses = f64::from(frames.last().unwrap().hall);
    assert!((pulses / way - 39.8).abs() < 1.0, "{pulses} in {way} m");
    // Driving backwards counts up as well.
    run.say(&[0x87]);
    let back = run.until(secs(15)).last().unwrap().hall;
    assert!(f64::from(back) > pulses + 25.0, "{back}");
}

/// A car that a scenario describes has only the encoder of its shaft. When the car drives straight
/// ahead, the shaft turns as the wheels do.
#[test]
fn the_hall_sensor_counts_on_a_car_with_an_encoder_at_its_shaft_alone() {
    let mut run = run(BoardConfig::default());
    let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
    let config = AckermannConfig {
        wheel_ticks_per_turn: None,
        ..chassis().ideal()
    };
    let body = Box::new(Ackermann::new(config, 1).unwrap());
    run.world = World::with_chassis(scene, body, Pose::default()).unwrap();
    run.say(&[0x8C]);
    let pulses = f64::from(run.until(secs(10)).last().unwrap().hall);
    let way = run.world.pose().point().distance(Point::default());
    assert!((pulses / way - 39.8).abs() < 1.0, "{pulses} in {way} m");
}

/// Sensors sit 0.304 m ahead of the axle, and 0.1 m to either side: walls 1.304 m ahead, 0.7 m to
/// the right and 0.9 m to the left are 100, 60 and 80 cm away. The first frame knows nothing yet.
#[test]
fn ultrasonic_ranges_come_front_right_left_and_0_is_nothing_new() {
    let walls = [
        wall((1.304, -3.0), (1.304, 3.0)),
        wall((-3.0, -0.7), (1.3, -0.7)),
        wall((-3.0, 0.9), (1.3, 0.9)),
    ];
    let mut run = run_in(Scene::new(walls, vec![]).unwrap(), BoardConfig::default());
    let frames = run.until(secs(1));
    assert_eq!(frames[0].front_cm, 0);
    for frame in &frames[1..] {
        assert!(frame.front_cm.abs_diff(100) <= 1, "{frame:?}");
        assert!(frame.right_cm.abs_diff(60) <= 1, "{frame:?}");
        assert!(frame.left_cm.abs_diff(80) <= 1, "{frame:?}");
    }
    run.board.set_fault(run.now, "right", None, true);
    let frames = run.until(secs(2));
    let last = frames.last().unwrap();
    assert!(last.right_cm == 0 && last.left_cm.abs_diff(80) <= 1);
}

/// The sensor is 0.33 m ahead of the axle, the line 0.4 m wide around 0.83 m.
#[test]
fn the_line_byte_follows_a_line_on_the_floor() {
    let (from, to) = (Point::new(0.83, -1.0), Point::new(0.83, 1.0));
    let line = FloorLine::new(from, to, 0.4).unwrap();
    let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
    let mut run = run_in(scene.with_floor_lines(vec![line]), BoardConfig::default());
    run.say(&[0x8C]);
    let mut seen = Vec::new();
    for second in 1..=6 {
        let frames = run.until(secs(second));
        seen.push((run.world.pose().x, frames.last().unwrap().line));
    }
    for (x, line) in seen {
        // A frame is at most 67 ms old, in which the car moves 15 mm.
        if (x - 0.30).abs() > 0.02 && (x - 0.70).abs() > 0.02 {
            assert_eq!(line, u8::from((0.30..0.70).contains(&x)), "{x}");
        }
    }
}

/// The battery starts at 8000 mV, loses 0.33 mV/s and sags by 60 mV at level 2. Below 6.8 V the
/// board sends no frames.
#[test]
fn the_battery_runs_down_until_the_board_gives_up() {
    let mut run = run(BoardConfig::default());
    run.say(&[0x8C]);
    let last = *run.until(secs(30)).last().unwrap();
    assert_eq!(last.battery_mv, 7_930);
    run.board.set_fault(run.now, "battery-low", None, true);
    assert_eq!(run.until(secs(31)).last().unwrap().battery_mv, 6_850);
    let empty = BatteryConfig {
        start_mv: 6_801.0,
        drop_mv_per_s: 1.0,
        sag_mv: 0.0,
    };
    let mut run = self::run(BoardConfig {
        battery: empty,
        ..BoardConfig::default()
    });
    run.say(&[0x8C]);
    let frames = run.until(secs(10));
    assert!((20..=23).contains(&frames.len()), "{}", frames.len());
    assert_eq!(run.world.speed(), 0.0);
    let events = run.board.take_events();
    assert!(events.iter().any(|event| event.rule == "undervoltage"));
}

fn silent(dead_man: Option<Duration>) -> Run {
    let mut run = run(BoardConfig {
        dead_man,
        ..BoardConfig::default()
    });
    for millis in (0..3_000).step_by(100) {
        run.until(Instant::from_millis(millis));
        run.say(&[0x8C, 0x32]);
    }
    run
}

/// The host sends its last command at 2.9 s. As fielded the car continues; with a dead-man time of
/// 1 s it stands at 4.4 s, and a new command starts it again.
#[test]
fn ap15_a_silent_host_stops_the_car_within_a_second_and_a_half_if_wanted() {
    let mut fielded = silent(None);
    fielded.until(secs(20));
    assert!((fielded.world.speed() - 0.22).abs() < 1e-3);
    let mut safe = silent(Some(Duration::from_secs(1)));
    safe.until(Instant::from_millis(3_890));
    assert!((safe.world.speed() - 0.22).abs() < 1e-3);
    safe.until(Instant::from_millis(4_400));
    assert_eq!(safe.world.speed(), 0.0);
    let events = safe.board.take_events();
    assert!(events.iter().any(|event| event.rule == "dead-man"));
    safe.say(&[0x32]);
    safe.until(secs(5));
    assert_eq!(safe.world.speed(), 0.0, "steering does not start it");
    safe.say(&[0x8C]);
    safe.until(Instant::from_millis(5_900));
    assert!(safe.world.speed() > 0.2);
}

/// Byte 95 would be level 11, byte 65 the steering value 51. They are ignored, or taken as level 10
/// and value 50.
#[test]
fn commands_beyond_their_range_are_told_and_ignored_or_clamped() {
    for (out_of_range, speed, degrees) in [
        (OutOfRange::Ignored, 0.0, 0.0),
        (OutOfRange::Clamped, 1.2, -18.0),
    ] {
        let mut run = run(BoardConfig {
            out_of_range,
            ..BoardConfig::default()
        });
        run.say(&[0x95, 0x65]);
        run.until(secs(4));
        assert!((run.world.axis_speed("drive").unwrap() - speed).abs() < 1e-3);
        let found = run.world.chassis().actual(1).to_degrees();
        assert!((found - degrees).abs() < 1e-6);
        let events = run.board.take_events();
        assert!(
            events
                .iter()
                .any(|event| event.kind == EventKind::Violation)
        );
    }
}

#[test]
fn faults_are_seen_from_outside() {
    let mut run = run(BoardConfig::default());
    run.say(&[0x8C, 0x00]);
    run.until(secs(2));
    let mut during = |fault: &str, figure| {
        run.board.set_fault(run.now, fault, figure, true);
        let end = run.now + Duration::from_secs(2);
        let frames = run.until(end);
        let seen = (frames, run.world.speed(), run.world.chassis().actual(1));
        run.board.set_fault(run.now, fault, figure, false);
        run.say(&[0x8C, 0x00]);
        let end = run.now + Duration::from_secs(2);
        run.until(end);
        seen
    };
    let (frames, ..) = during("stuck", None);
    assert!(frames.iter().all(|frame| *frame == frames[0]));
    let (frames, ..) = during("slow", Some(500.0));
    assert!((3..=5).contains(&frames.len()), "{}", frames.len());
    let (frames, ..) = during("line", None);
    assert_eq!(frames.last().unwrap().line, 1);
    let (frames, ..) = during("hall", None);
    assert_eq!(frames[0].hall, frames.last().unwrap().hall);
    let (_, speed, _) = during("motor", None);
    assert!(speed < 0.01);
    let (frames, speed, _) = during("off", None);
    assert!(frames.is_empty() && speed < 0.01);
    let (frames, speed, angle) = during("restart", None);
    assert!(frames.last().unwrap().hall < 10 && speed < 0.001 && angle > 0.43);
}

proptest! {
    /// Any bytes: no panic, and no speed or angle that the car does not have.
    #[test]
    fn no_bytes_drive_the_car_beyond_its_limits(bytes in vec(any::<u8>(), 0..60)) {
        let out_of_range = OutOfRange::Clamped;
        let mut run = run(BoardConfig { out_of_range, ..BoardConfig::default() });
        for (part, bytes) in (1..).zip(bytes.chunks(7)) {
            run.say(bytes);
            run.until(Instant::from_millis(40 * part));
            prop_assert!(run.world.speed() <= 1.2);
            prop_assert!(run.world.chassis().actual(1).abs() <= 25.001_f64.to_radians());
        }
    }
}

/// No command at first; byte 57 is value 7, byte 8C level 2.
#[test]
fn what_was_commanded_last_is_told() {
    let mut run = run(BoardConfig::default());
    assert_eq!(
        (run.board.level(), run.board.steering()),
        (Level::STOP, None)
    );
    run.say(&[0x8C, 0x39]);
    assert_eq!(
        (
            run.board.level().get(),
            run.board.steering().map(Steering::get)
        ),
        (2, Some(7))
    );
}

/// Walls 1 m around the car: each sensor receives its own echo; the deaf one receives none.
#[test]
fn a_deaf_sensor_hears_no_echo_and_the_others_do() {
    let around = [
        wall((1.3, -1.3), (1.3, 1.3)),
        wall((-1.3, 1.0), (1.3, 1.0)),
        wall((-1.3, -1.0), (1.3, -1.0)),
    ];
    let heard = |fault: &str| {
        let scene = Scene::new(around.clone(), vec![]).unwrap();
        let mut run = run_in(scene, BoardConfig::default());
        run.board.set_fault(Instant::ZERO, fault, None, true);
        let frames = run.until(secs(2));
        let last = frames.last().expect("fifteen a second");
        [last.front_cm, last.right_cm, last.left_cm].map(|cm| (1..=200).contains(&cm))
    };
    assert_eq!(heard("none"), [true; 3]);
    assert_eq!(heard("front"), [false, true, true]);
    assert_eq!(heard("right"), [true, false, true]);
    assert_eq!(heard("left"), [true, true, false]);
}

/// The configured encoder counts, else the one of all wheels together.
#[test]
fn the_magnets_turn_with_the_configured_encoder() {
    let encoders = |names: &[&str]| -> Vec<Encoder> {
        let encoder = |name: &&str| Encoder {
            name: (*name).to_owned(),
            counts_per_m: 1.0,
        };
        names.iter().map(encoder).collect()
    };
    let config = BoardConfig::default();
    let of = |names: &[&str]| config.encoder_of(&encoders(names));
    assert_eq!(of(&["drive", "rear_right", "rear_left"]), Some(2));
    assert_eq!(of(&["front", "drive"]), Some(1));
    assert_eq!(of(&["front"]), None);
}

/// A restart ends no lack of supply: the board sends nothing until the fault `off` ends. Its last
/// frame is that of the last round, none after a reset.
#[test]
fn a_board_without_supply_does_not_restart() {
    let mut run = run(BoardConfig::default());
    assert_eq!(run.board.last_frame(), None);
    let sent = run.until(secs(1));
    let last = run.board.last_frame().map(|frame| frame.readings());
    assert_eq!(last.as_ref(), sent.last());
    run.board.set_fault(secs(1), "off", None, true);
    run.board.set_fault(secs(1), "restart", None, true);
    assert!(run.until(secs(2)).is_empty());
    run.board.set_fault(secs(2), "off", None, false);
    assert_eq!(run.board.last_frame(), None);
    assert!(!run.until(secs(3)).is_empty());
    run.board.set_fault(secs(3), "restart", None, false);
    assert!(
        run.board.last_frame().is_some(),
        "the end of a restart is none"
    );
}

#[test]
fn a_board_names_its_faults() {
    let board = CarBoard::new(BoardConfig::default());
    let of_the_board = ["off", "restart", "stuck", "slow", "battery-low"];
    let of_its_parts = ["motor", "servo", "hall", "line", "front", "right", "left"];
    assert_eq!(
        board.known_faults(),
        [&of_the_board[..], &of_its_parts].concat()
    );
}
