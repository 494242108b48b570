extern crate std;

use rosc::{OscBundle, OscTime};
use std::borrow::ToOwned as _;
use std::vec;

use super::super::Config;
use super::*;

fn car() -> Apollo13 {
    Apollo13::new(Config::default())
}

fn message(address: &str, values: &[f32]) -> OscMessage {
    OscMessage {
        addr: address.to_owned(),
        args: values.iter().map(|value| OscType::Float(*value)).collect(),
    }
}

#[test]
fn numbers_of_a_phone_may_have_any_type() {
    let numbers = [
        OscType::Float(1.5),
        OscType::Double(2.5),
        OscType::Int(-3),
        OscType::Bool(true),
        OscType::Bool(false),
    ];
    let found = numbers.map(|value| number(&value));
    assert_eq!(found, [1.5, 2.5, -3.0, 1.0, 0.0].map(Some));
    assert_eq!(number(&OscType::Nil), None);
}

/// Three numbers are a goal or a pose; a goal without numbers ends the drive.
#[test]
fn a_goal_and_a_pose_are_three_numbers() {
    let mut car = car();
    assert!(car.take_message(&message("/goal", &[1.0, 2.0, 0.5])));
    let goal = car.pilot().goal().expect("a goal");
    assert_eq!([goal.x_m, goal.y_m, goal.heading_rad], [1.0, 2.0, 0.5]);
    assert!(!car.take_message(&message("/goal", &[1.0, 2.0])));
    assert!(!car.take_message(&message("/goal", &[1.0, f32::NAN, 0.5])));
    assert!(car.pilot().goal().is_some());
    assert!(car.take_message(&message("/goal", &[])) && car.pilot().goal().is_none());
    assert!(car.take_message(&message("/pose", &[-1.0, 3.0, 7.0])));
    let pose = car.pose();
    assert!((pose.x_m + 1.0).abs() < 1e-9 && (pose.y_m - 3.0).abs() < 1e-9);
    // The heading of 7 rad less a whole turn.
    assert!((pose.heading_rad - 0.716_814_7).abs() < 1e-6);
    assert!(!car.take_message(&message("/pose", &[1.0])));
    assert!(!car.take_message(&message("/1/speed", &[f32::INFINITY])));
    assert!(!car.take_message(&message("/1/horn", &[1.0])));
    assert!(car.take_message(&message("/ping", &[])));
    let mut text = message("/1/speed", &[]);
    text.args = vec![OscType::Nil];
    assert!(!car.take_message(&text));
}

/// A message within up to eight nested bundles is taken, and each packet is counted once.
#[test]
fn bundles_are_opened_eight_deep() {
    let within = |bundles: u8| {
        let ping = OscPacket::Message(message("/ping", &[]));
        let packet = (0..bundles).fold(ping, |inner, _| {
            OscPacket::Bundle(OscBundle {
                timetag: OscTime {
                    seconds: 0,
                    fractional: 1,
                },
                content: vec![inner],
            })
        });
        let mut car = car();
        car.take_packet(packet, 0);
        [car.counters.packets, car.counters.bad_packets]
    };
    assert_eq!([0, 1, 8].map(within), [[1, 0]; 3]);
    assert_eq!([9, 12].map(within), [[0, 1]; 2]);
    let mut car = car();
    car.take_packet(OscPacket::Message(message("/horn", &[1.0])), 0);
    car.hear_phone(b"no packet");
    assert_eq!([car.counters.packets, car.counters.bad_packets], [0, 2]);
}

/// A reading of 0 is no new range; readings up to 3 m are ranges, longer ones are not. At 0.6 m an
/// obstacle may be on the floor.
#[test]
fn ultrasound_counts_up_to_three_metres() {
    let mut car = car();
    let mut hear = |front_cm, right_cm, left_cm| {
        car.take_readings(car_board::Readings {
            front_cm,
            right_cm,
            left_cm,
            battery_mv: 7_000,
            ..car_board::Readings::default()
        });
        (car.ultrasound_m(), car.is_open_ahead())
    };
    assert_eq!(hear(60, 300, 301), ([Some(0.6), Some(3.0), None], false));
    assert_eq!(hear(0, 0, 25), ([Some(0.6), Some(3.0), Some(0.25)], false));
    assert_eq!(hear(61, 301, 0), ([Some(0.61), None, Some(0.25)], true));
    assert_eq!(hear(301, 0, 0), ([None, None, Some(0.25)], true));
    assert_eq!((car.battery_mv(), car.counters.frames), (7_000, 4));
}

/// Half a metre to the left and 2 m ahead of the camera; the camera's axes point right, down and
/// ahead.
#[test]
fn a_marker_stands_where_the_camera_sees_it() {
    let mut car = car();
    car.take_marker(Marker {
        id: 7,
        place_mm: [-500, 90, 2_000],
        normal: [0, -10_000],
    });
    let markers: Vec<_> = car.gates().markers().collect();
    let [(7, [x_m, y_m])] = markers[..] else {
        panic!("{markers:?}");
    };
    assert!((x_m - 2.0 - CAMERA_AHEAD_M).abs() < 1e-9 && (y_m - 0.5).abs() < 1e-9);
}

/// The wall is on the right, 5 cm too near: steer away from it. A reading of the other side, and 0,
/// do not count.
#[test]
fn the_wall_s_own_sensor_steers() {
    let mut car = Apollo13::new(Config {
        wall: Some((Side::Right, 0.4)),
        ..Config::default()
    });
    let mut hear = |right_cm, left_cm| {
        car.take_readings(car_board::Readings {
            right_cm,
            left_cm,
            ..car_board::Readings::default()
        });
        (car.wall_heard.is_some(), car.wall_angle_rad)
    };
    assert_eq!(hear(0, 35), (false, 0.0));
    let (is_heard, angle_rad) = hear(35, 0);
    assert!(is_heard && angle_rad > 0.0, "{angle_rad}");
    assert_eq!(hear(0, 35), (true, angle_rad));
}

/// An empty line comes from a terminal driver that changes a carriage return, and does not count as
/// bad.
#[test]
fn messages_without_meaning_are_counted() {
    let mut car = car();
    car.see(&[1, 2, 3]);
    assert_eq!((car.counters.bad_messages, car.counters.scans), (1, 0));
    car.hear_odometer(b"\n\nnothing\n");
    assert_eq!((car.counters.bad_lines, car.counters.lines), (1, 0));
    car.judge_fit();
    assert_eq!(car.misfits, 0);
}

/// A quiet line releases a frame, once.
#[test]
fn a_frame_counts_when_the_board_is_quiet() {
    let mut car = car();
    let readings = car_board::Readings {
        front_cm: 100,
        battery_mv: 7_400,
        ..car_board::Readings::default()
    };
    car.now = Instant::from_millis(100);
    car.hear_board(readings.encode().as_bytes());
    car.let_board_idle();
    let before = car.counters.frames;
    car.now += car_board::IDLE_GAP;
    car.let_board_idle();
    car.let_board_idle();
    assert_eq!((car.counters.frames, car.counters.bad_frames), (1, 0));
    assert!(before <= 1 && car.board_heard.is_none());
    assert_eq!(car.ultrasound_m()[0], Some(1.0));
}

/// The board reports half a metre. An odometer that was silent and counted at least 8 cm less,
/// three pulses, missed a part of that path: 41 cm in either direction are too few, 43 cm are
/// enough.
#[test]
fn an_odometer_that_missed_three_pulses_was_deaf() {
    let mut car = car();
    car.odometry.update(1.0, 0.0);
    car.at_line = (
        car.odometry.clone(),
        CarPose {
            x_m: -0.4,
            y_m: 0.3,
            ..CarPose::default()
        },
    );
    let missed = [0.41, -0.41, 0.43, -0.43, 0.6].map(|way_m| car.has_missed_way(1.0 + way_m));
    assert_eq!(missed, [true, true, false, false, false]);
}

/// Frames with impossible values are counted and ignored.
#[test]
fn frames_of_the_board_that_are_damaged_are_counted() {
    let mut car = car();
    let readings = car_board::Readings {
        front_cm: 100,
        battery_mv: 7_400,
        ..car_board::Readings::default()
    };
    let mut bytes = readings.encode().as_bytes().to_vec();
    // Its range to the front is 65 m and more.
    bytes[3] = 0xFF;
    car.hear_board(&bytes);
    car.now += car_board::IDLE_GAP;
    car.let_board_idle();
    let bad = car.counters.bad_frames;
    assert!(bad > 0 && car.battery_mv() == 0);
    car.hear_board(&bytes);
    car.now += car_board::IDLE_GAP;
    car.let_board_idle();
    assert_eq!((car.counters.bad_frames, car.counters.frames), (2 * bad, 0));
}

/// In a hall of 10 m, ten beams that end in free space do not fit: after 40 such scans the car is
/// lost, which counts once. Each fitting scan takes two of them back.
#[test]
fn a_car_is_lost_after_forty_scans_that_do_not_fit() {
    let is_rim = |at: usize| {
        [at % 200, at / 200]
            .iter()
            .any(|cell| [0, 199].contains(cell))
    };
    let mut car = Apollo13::new(Config {
        floor: crate::robots::apollo13::floor::FloorPlan {
            width: 200,
            cell_m: 0.05,
            origin_m: [0.0; 2],
            obstacles: (0..200 * 200).map(is_rim).collect(),
        },
        start: CarPose {
            x_m: 5.0,
            y_m: 5.0,
            ..CarPose::default()
        },
        ..Config::default()
    });
    let mut now = CarPose::default();
    let mut judge = |count: usize| {
        let beam = crate::particles::Beam {
            bearing_rad: 0.0,
            range_m: 1.0,
        };
        now.x_m = 0.1 - now.x_m;
        let localiser = car.localiser.as_mut().expect("there is a plan");
        assert!(localiser.update(now, &vec![beam; count]));
        car.judge_fit();
        (car.misfits, car.counters.lost)
    };
    for misfit in 1..=39 {
        assert_eq!(judge(10), (misfit, 0));
    }
    assert_eq!([judge(10), judge(10), judge(10)], [(40, 1); 3]);
    // Nine beams are too few to say anything.
    assert_eq!([judge(9), judge(9), judge(10)], [(38, 1), (36, 1), (37, 1)]);
}

/// 1.25 + 0.5 + 1.5 + 12345 is 12348.25, but the sketch rounds before it adds: the fielded host
/// refuses the line. 100 is exact.
#[test]
fn an_exact_sum_refuses_what_was_rounded() {
    let heard = |sums_exactly, line: &[u8]| {
        let mut config = Config {
            dialect: Some(odometer::Dialect::AsCoded),
            ..Config::default()
        };
        config.defects.sums_exactly = sums_exactly;
        let mut car = Apollo13::new(config);
        car.hear_odometer(line);
        [car.counters.lines, car.counters.bad_lines]
    };
    let (rounded, whole) = (
        b"1.25*0.50*1.50*12345*12347.76*\r\n",
        b"0.00*0.00*0.00*100*100.00*\r\n",
    );
    assert_eq!(
        [false, true].map(|exactly| heard(exactly, rounded)),
        [[1, 0], [0, 1]]
    );
    assert_eq!(
        [false, true].map(|exactly| heard(exactly, whole)),
        [[1, 0]; 2]
    );
}

/// An odometer that was reset counts from 0 again, and its clock falls back: the car's pose stays.
/// A clock that stands is no reset.
#[test]
fn an_odometer_that_was_reset_moves_nobody() {
    let mut car = car();
    let mut line = |distance_m, time_ms| {
        let measured = odometer::Measurement {
            distance_m,
            rate_rad_s: 0.0,
            yaw_rad: 0.0,
            time_ms,
        };
        car.hear_odometer(odometer::Dialect::Fixed.line(&measured).as_bytes());
        (car.pose().x_m * 100.0).round() / 100.0
    };
    let begun = line(5.0, 10_000);
    let ways = [
        line(5.5, 10_010),
        line(5.6, 10_010),
        line(0.0, 20),
        line(0.2, 30),
    ];
    assert_eq!(
        ways.map(|x_m| ((x_m - begun) * 100.0).round()),
        [50.0, 60.0, 60.0, 80.0]
    );
}

/// Byte 13 is a carriage return, byte 10 a newline.
#[test]
fn a_terminal_driver_may_change_what_the_board_says() {
    let front = |reads_cr_as_nl| {
        let mut config = Config::default();
        config.defects.reads_cr_as_nl = reads_cr_as_nl;
        let mut car = Apollo13::new(config);
        let readings = car_board::Readings {
            front_cm: 13,
            battery_mv: 7_400,
            ..car_board::Readings::default()
        };
        car.hear_board(readings.encode().as_bytes());
        car.now += car_board::IDLE_GAP;
        car.let_board_idle();
        car.ultrasound_m()[0]
    };
    assert_eq!([false, true].map(front), [Some(0.13), Some(0.10)]);
}

/// A datagram holds one packet. `/ping` without arguments is 12 bytes: the address with its NUL and
/// padding, and the type tag.
#[test]
fn f18_bytes_behind_a_packet_of_the_phone_make_it_bad() {
    let mut car = car();
    let ping = b"/ping\0\0\0,\0\0\0";
    car.hear_phone(ping);
    assert_eq!([car.counters.packets, car.counters.bad_packets], [1, 0]);
    car.hear_phone(&[&ping[..], b"\0\0\0\0"].concat());
    assert_eq!([car.counters.packets, car.counters.bad_packets], [1, 1]);
}
