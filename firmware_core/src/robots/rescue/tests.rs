//! The whole program, where its parts meet.

extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use protocols::avr::{Frame, registers};
use protocols::pcui::diagnosis::Condition;
use protocols::{LineEvent, avr, panel, pcui};

use super::screen::{Action, Hit};
use super::*;
use crate::{Inspect, Master};

fn at(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

fn robot() -> Box<Rescue> {
    Box::new(Rescue::new(Config::default()))
}

/// At its start the lidar's motor gets a duty, once; the display gets a picture.
#[test]
fn each_port_has_its_own_output() {
    let mut robot = robot();
    assert!(!robot.may_send(Rescue::MOTOR) && !robot.may_send(Rescue::DISPLAY));
    robot.poll(at(0));
    assert!(robot.may_send(Rescue::BASE) && robot.may_send(Rescue::RADIO));
    assert!(!robot.may_send(Rescue::LIDAR));
    let mut buf = [0; 2048];
    assert!(robot.may_send(Rescue::MOTOR) && robot.transmit(Rescue::MOTOR, &mut []) == 0);
    assert_eq!((robot.transmit(Rescue::MOTOR, &mut buf), buf[0]), (1, 180));
    assert!(!robot.may_send(Rescue::MOTOR) && robot.transmit(Rescue::MOTOR, &mut buf) == 0);
    assert!(robot.may_send(Rescue::DISPLAY) && robot.display_traffic()[0] > 0);
    while robot.transmit(Rescue::DISPLAY, &mut buf) > 0 {}
    assert!(!robot.may_send(Rescue::DISPLAY));
    assert!(robot.transmit(Rescue::RADIO, &mut buf) > 0);
    assert_eq!(robot.transmit(Rescue::LIDAR, &mut buf), 0);
    let bauds = [
        Rescue::LIDAR,
        Rescue::BASE,
        Rescue::RADIO,
        Rescue::MOTOR,
        Rescue::DISPLAY,
    ]
    .map(|port| robot.line_config(port).baud);
    assert_eq!(
        bauds,
        [115_200, avr::BAUD, pcui::BAUD, 115_200, panel::BAUD]
    );
}

/// Of what the lines tell, what damages bytes is counted.
#[test]
fn damage_on_the_lines_is_counted() {
    let mut robot = robot();
    for event in [
        LineEvent::Break,
        LineEvent::FramingError,
        LineEvent::ParityError,
        LineEvent::Overrun,
        LineEvent::Opened,
        LineEvent::Closed,
    ] {
        robot.attend_at = at(900);
        robot.line_event(Rescue::BASE, at(1), event);
        assert_eq!(robot.attend_at, Instant::ZERO);
    }
    let mut told = Vec::new();
    robot.counters(&mut |name, count| told.push((name, count)));
    assert_eq!((told.len(), told.last()), (28, Some(&("line errors", 4))));
    assert!(told[..27].iter().all(|(_, count)| *count == 0));
    let mut strays = 0;
    robot.stray_writes(&mut |_, _| strays += 1);
    assert_eq!(strays, 0);
}

/// A button orders a mode, or turns a switch; reset puts all back.
#[test]
fn buttons_do_what_they_say() {
    let mut robot = robot();
    let mut press = |action| {
        robot.touched(at(50), Hit::Button(action));
        let Switches {
            mapping,
            lidar,
            pc_link,
            scan,
            waypoints,
        } = robot.switches;
        (
            robot.ordered_mode(),
            [mapping, lidar, pc_link, scan, waypoints],
        )
    };
    let start = [true, true, true, false, false];
    assert_eq!(
        press(Action::Order(Mode::Exploration)),
        (Mode::Exploration, start)
    );
    assert_eq!(press(Action::Mapping).1, [false, true, true, false, false]);
    assert_eq!(press(Action::Scan).1, [false, true, true, true, false]);
    assert_eq!(
        press(Action::SetWaypoints).1,
        [false, true, true, true, true]
    );
    assert_eq!(press(Action::PcLink).1, [false, true, false, true, true]);
    assert_eq!(press(Action::Lidar).1, [false, false, false, true, true]);
    assert_eq!(press(Action::Lidar).1, [false, true, false, true, true]);
    assert_eq!(press(Action::Reset), (Mode::Stop, start));
}

/// A motor that is switched off runs out; switched on it is started afresh.
#[test]
fn the_lidar_is_switched_by_its_button() {
    let mut robot = robot();
    let mut duty = |action: Option<Action>| {
        if let Some(action) = action {
            robot.touched(at(50), Hit::Button(action));
        }
        robot.lidar.take_duty()
    };
    assert_eq!(duty(None), Some(180));
    assert_eq!([duty(Some(Action::Lidar)), duty(None)], [Some(0), None]);
    assert_eq!([duty(Some(Action::Lidar)), duty(None)], [Some(180), None]);
}

/// A touch of the map sets waypoints if that is switched on, in cells of 10 mm; else it tells a
/// robot at rest where it is, and a second touch turns it by 45 degrees.
#[test]
fn a_touch_of_the_map_sets_a_waypoint_or_the_robot() {
    let mut robot = robot();
    robot.switches.waypoints = true;
    robot.touched(at(1), Hit::Map([150.5, 20.0], false));
    let cell_mm = robot.mapper.grid().resolution_mm();
    let places: Vec<[i16; 2]> = robot
        .waypoints
        .all()
        .iter()
        .map(|it| it.position_mm)
        .collect();
    #[expect(clippy::cast_possible_truncation, reason = "a few metres")]
    let expected = [150.5, 20.0].map(|cells| (cells * cell_mm) as i16);
    assert_eq!(
        (places, robot.ordered_mode()),
        ([expected].to_vec(), Mode::Waypoint)
    );
    robot.switches.waypoints = false;
    let before = robot.mapper.pose();
    robot.touched(at(2), Hit::Map([100.0, 50.0], false));
    assert_eq!(robot.mapper.pose(), before);
    robot.touched(at(3), Hit::Button(Action::ClearWaypoints));
    assert!(robot.waypoints.is_empty() && robot.ordered_mode() == Mode::Stop);
    robot.touched(at(4), Hit::Map([100.0, 50.0], false));
    let pose = robot.mapper.pose();
    assert!(
        (pose.x_mm - 100.0 * cell_mm).abs() < 0.01 && (pose.y_mm - 50.0 * cell_mm).abs() < 0.01
    );
    assert!((pose.heading - before.heading).abs() < 1e-6);
    robot.touched(at(5), Hit::Map([100.0, 50.0], true));
    let turned = robot.mapper.pose().heading - pose.heading;
    assert!(
        (turned - core::f32::consts::FRAC_PI_4).abs() < 1e-5,
        "{turned}"
    );
}

/// The stop button stops whatever the robot does, once; while it is held the PC may order on.
#[test]
fn the_stop_button_ends_what_the_robot_does() {
    let config = Config {
        initial_mode: Mode::Exploration,
        ..Config::default()
    };
    let mut robot = Box::new(Rescue::new(config));
    let told = |robot: &mut Rescue, status: u8| {
        let frame = Frame::write(registers::SYSTEM_STATUS, &[status], config.checksum_order);
        robot.drive.receive(at(10), frame.as_bytes());
        robot.watch_health(at(10));
        let stopped = robot.diagnosis().conditions.has(Condition::Stopped);
        (robot.ordered_mode(), stopped)
    };
    assert_eq!(told(&mut robot, 0), (Mode::Exploration, false));
    assert_eq!(told(&mut robot, 2), (Mode::Stop, true));
    robot.set_mode(at(11), Mode::Stop);
    robot.mode = Mode::Exploration;
    assert_eq!(told(&mut robot, 2), (Mode::Exploration, true));
    assert_eq!(told(&mut robot, 0), (Mode::Exploration, false));
    assert_eq!(told(&mut robot, 3), (Mode::Stop, true));
    robot.set_mode(at(12), Mode::Manual);
    assert!(!robot.diagnosis().conditions.has(Condition::Stopped));
}

/// Each defect by its number makes another robot, and no number none.
#[test]
fn each_defect_is_switched_by_its_number() {
    let sound = Config::default();
    for id in Config::defects() {
        let with = sound.with_defect(id);
        assert!(with.is_some_and(|with| with != sound), "{id}");
    }
    assert!(sound.with_defect("PU-99").is_none());
    let two = sound
        .with_defect("PU-01")
        .and_then(|one| one.with_defect("PU-02"));
    let defects = two.expect("both are known").pc_link.defects;
    assert!(defects.forgets_to_restart && defects.signed_checksum && !defects.signed_length);
}

/// Nobody renews an order to drive by hand: after a second the robot explores.
#[test]
fn an_order_by_hand_ends_after_a_second() {
    let mut robot = robot();
    robot.ordered_at = at(500);
    robot.set_mode(at(500), Mode::Manual);
    robot.attend(at(1_499));
    assert_eq!(
        (robot.ordered_mode(), robot.counters.fallbacks),
        (Mode::Manual, 0)
    );
    assert!(robot.next_attention() <= at(1_500));
    robot.attend(at(1_500));
    assert_eq!(
        (robot.ordered_mode(), robot.counters.fallbacks),
        (Mode::Exploration, 1)
    );
    robot.attend(at(2_600));
    assert_eq!(
        (robot.ordered_mode(), robot.counters.fallbacks),
        (Mode::Exploration, 1)
    );
}

/// PU-16: a byte in its first millisecond ends the fielded program; nothing is heard, said or done
/// any more.
#[test]
fn a_program_that_has_ended_does_nothing() {
    let config = Config::default().with_defect("PU-16").expect("it is known");
    let mut robot = Box::new(Rescue::new(config));
    robot.poll(at(0));
    let mut buf = [0; 64];
    assert!(robot.transmit(Rescue::MOTOR, &mut buf) == 1 && robot.poll_at().is_some());
    robot.receive(Rescue::RADIO, Instant::ZERO, b"P");
    assert!(Inspect::is_dead(&*robot) && robot.poll_at().is_none());
    let ports = [Rescue::BASE, Rescue::RADIO, Rescue::DISPLAY, Rescue::MOTOR];
    assert_eq!(ports.map(|port| robot.transmit(port, &mut buf)), [0; 4]);
    robot.poll(at(5_000));
    assert_eq!(robot.transmit(Rescue::BASE, &mut buf), 0);
    let mut sound = self::robot();
    sound.receive(Rescue::RADIO, Instant::ZERO, b"P");
    assert!(!Inspect::is_dead(&*sound) && sound.poll_at().is_some());
}

/// What is told of what the robot does, by name.
#[test]
fn its_mode_has_a_name() {
    let mut robot = robot();
    let mut name = |mode| {
        robot.mode = mode;
        Inspect::mode(&*robot)
    };
    assert_eq!([name(Mode::Stop), name(Mode::Manual)], ["stop", "manual"]);
    let blind = [Mode::Exploration, Mode::Waypoint, Mode::Explore].map(&mut name);
    assert_eq!(blind, ["lidar silent"; 3]);
    assert_eq!(robot.mode(), Mode::Stop);
    robot.mode = Mode::Manual;
    assert_eq!(robot.mode(), Mode::Manual);
    assert!(robot.search_progress().is_none() && Inspect::is_done(&*robot).is_none());
}
