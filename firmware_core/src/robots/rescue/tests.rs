//! Tests of the whole program, where its parts work together.

extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use protocols::avr::{Frame, registers};
use protocols::pcui::diagnosis::Condition;
use protocols::{Decode as _, LineEvent, avr, panel, pcui};

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

/// Damaged bytes on the lines are counted.
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
    assert_eq!((told.len(), told.last()), (29, Some(&("line errors", 4))));
    assert!(told[..28].iter().all(|(_, count)| *count == 0));
    let mut strays = 0;
    robot.stray_writes(&mut |_, _| strays += 1);
    assert_eq!(strays, 0);
}

/// A button orders a mode, or toggles a switch; reset restores all of them.
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

/// A motor that is switched off runs out; when switched on it is started again.
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

/// With waypoints enabled a touch of the map sets a waypoint, in cells of 10 mm; else it sets the
/// pose of a robot at rest, and a second touch turns the robot by 45 degrees: psi, which counts
/// clockwise, grows.
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
        (turned + core::f32::consts::FRAC_PI_4).abs() < 1e-5,
        "{turned}"
    );
}

/// The stop button stops the robot in any mode, once; while the button is held the PC may order the
/// robot to continue.
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

/// Each known defect number changes the robot, and an unknown number gives none.
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

/// A manual drive order is not renewed: after a second the robot explores.
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

/// PU-16: a byte in its first millisecond ends the fielded program; it receives, sends and does
/// nothing any more.
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

/// Name of the robot's activity in reports.
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

/// A base that answers every request; each byte of its registers is `value`.
fn serve(robot: &mut Rescue, now: Instant, value: u8) {
    let order = robot.config.checksum_order;
    let mut decoder = avr::Decoder::new(order);
    robot.drive.tick(now);
    let mut buf = [0; 64];
    while let len @ 1.. = robot.drive.transmit(&mut buf) {
        let frames: Vec<Frame> = decoder.push(&buf[..len]).flatten().collect();
        for frame in frames {
            let answer = match frame.is_write() {
                true => Frame::read(frame.register(), 0, order),
                false => {
                    let registers = [value; 64];
                    Frame::write(frame.register(), &registers[..frame.count().into()], order)
                }
            };
            robot.drive.receive(now, answer.as_bytes());
        }
    }
}

/// Readings of thermometers and infrared sensors are placed in the map; a robot that was never
/// matched, or that is lost, ignores them. 0x0101 mm are 257.
#[test]
fn what_is_felt_counts_where_the_robot_knows_its_place() {
    let config = Config {
        sought: crate::navigation::Sought::FloorAndHeat,
        infrared: Infrared::Read,
        ..Config::default()
    };
    let takes = |matched: bool, lost: bool| {
        let mut robot = Box::new(Rescue::new(config));
        robot.mode = Mode::Explore;
        for _ in 0..if lost { 3 } else { 2 } {
            let doubtful = crate::slam::Certainty::Doubtful;
            robot.lost.after(&mut robot.mapper, doubtful);
        }
        assert_eq!(robot.is_lost(), lost);
        serve(&mut robot, at(0), 1);
        serve(&mut robot, at(200), 1);
        robot.matched = matched.then(|| (at(200), Pose::default()));
        let before = std::format!("{:?}", robot.victims);
        robot.feel(at(200));
        robot.look_near(at(200));
        // Values that were read are requested once.
        assert!(robot.drive.take_heat().is_none() && robot.drive.take_infrared().is_none());
        let places = robot.blind.seen_from(Pose::default()).count();
        (std::format!("{:?}", robot.victims) != before, places > 0)
    };
    assert_eq!(takes(true, false), (true, true));
    assert_eq!(takes(false, false), (false, false));
    assert_eq!(takes(true, true), (false, false));
}

/// Sent rows and received taps; a pen that comes down is one tap.
#[test]
fn what_the_display_gets_and_tells_is_counted() {
    let mut robot = robot();
    assert_eq!(robot.display_traffic(), [0, 0]);
    robot.poll(at(0));
    let rows = robot.display_traffic()[0];
    assert!(rows >= 8, "a tile has eight rows: {rows}");
    for (millis, contact) in [(20, panel::Contact::Down), (40, panel::Contact::Up)] {
        let report = panel::encode_pen(panel::Pen {
            contact,
            reading: [4_000, 4_000],
        });
        robot.receive(Rescue::DISPLAY, at(millis), &report);
    }
    assert_eq!(robot.display_traffic()[1], 1);
}

/// Two turns of 300 rpm; the second one is whole.
fn turn_the_lidar(robot: &mut Rescue, until: u64) {
    for packet in 0..180_u8 {
        let speed = xv11::SpeedWord(300 * 64);
        let reading = xv11::Reading::Range {
            distance_mm: 1_000,
            strength: 200,
            weak: false,
        };
        let frame = xv11::Frame::new(packet, speed, [reading.into(); 4]);
        let millis = until - 400 + 400 * u64::from(packet) / 179;
        robot.receive(Rescue::LIDAR, at(millis), frame.as_bytes());
    }
}

/// A turn is checked once the encoders behind it have been read, or 30 ms later.
#[test]
fn a_turn_waits_for_the_encoders_for_thirty_milliseconds() {
    // The program does not wait for a base that counts as silent, so the timeout is longer here.
    let mut robot = Box::new(Rescue::new(Config {
        reply_timeout: Duration::from_millis(100),
        ..Config::default()
    }));
    robot.poll(at(0));
    serve(&mut robot, at(0), 0);
    turn_the_lidar(&mut robot, 1_000);
    assert!(robot.lidar.has_turn() && robot.phase == Phase::Waiting);
    assert_eq!(robot.poll_at(), Some(Instant::ZERO));
    let since = at(1_001);
    robot.poll(since);
    assert_eq!(robot.phase, Phase::Reading { since });
    assert!(
        robot
            .poll_at()
            .is_some_and(|at| at > since && at <= since + WHEELS_WAIT)
    );
    robot.poll(at(1_030));
    assert_eq!(
        (robot.phase, robot.counters.scans),
        (Phase::Reading { since }, 0)
    );
    let mut read = robot.clone();
    robot.poll(at(1_031));
    assert_eq!(
        (robot.phase, robot.counters.scans),
        (Phase::Matched { since }, 1)
    );
    assert_eq!(robot.poll_at(), Some(Instant::ZERO));
    robot.poll(at(1_032));
    assert_eq!(robot.phase, Phase::Waiting);
    serve(&mut read, at(1_030), 0);
    assert_eq!(read.poll_at(), Some(Instant::ZERO));
    read.poll(at(1_030));
    assert_eq!(
        (read.phase, read.counters.scans),
        (Phase::Matched { since }, 1)
    );
}

/// A manual order ends after a second; an old one of a robot in another mode causes no wake-up.
#[test]
fn only_an_order_by_hand_has_an_end() {
    let mut robot = robot();
    robot.ordered_at = at(100);
    robot.poll(at(20_000));
    assert!(
        robot.next_attention() > at(1_100),
        "{:?}",
        robot.next_attention()
    );
    robot.mode = Mode::Manual;
    assert_eq!(robot.next_attention(), at(1_100));
}

/// The search has ended when the robot is home; before the first search there is no result.
#[test]
fn a_search_is_done_at_home() {
    let mut robot = robot();
    assert_eq!(
        (Inspect::is_done(&*robot), robot.search_progress()),
        (None, None)
    );
    let pose = robot.mapper.pose();
    robot.explore.go_home(pose.position());
    assert_eq!(Inspect::is_done(&*robot), Some(false));
    robot.search(at(5), pose, &Surroundings::EMPTY);
    assert_eq!(Inspect::is_done(&*robot), Some(true));
    assert_eq!(robot.search_progress(), Some(Progress::IsHome));
}

/// No module answers: after all rates were tried the radio is used without setup.
#[test]
fn a_radio_that_does_not_answer_is_used_all_the_same() {
    let settings = crate::radio_setup::Settings {
        found_baud: 9_600,
        baud: 460_800,
        name: "robot",
        pin: *b"1234",
    };
    let mut robot = Box::new(Rescue::new(Config {
        radio_setup: Some(settings),
        ..Config::default()
    }));
    assert!(!robot.uses_radio());
    let is_over = (0..600).position(|tenth| {
        robot.set_radio_up(at(100 * tenth));
        robot.uses_radio()
    });
    assert!(is_over.is_some_and(|tenths| tenths > 5), "{is_over:?}");
}

/// Each buffer with stray writes of a defect is reported by its name: an answer without a reader,
/// two bytes and the checksum; index FF of a packet, offset 380; a link to a shared waypoint.
#[test]
fn what_is_written_beside_a_buffer_is_told_by_name() {
    let config = ["MA-06", "XV-03", "PU-09"]
        .into_iter()
        .try_fold(Config::default(), |config, id| config.with_defect(id));
    let mut robot = Box::new(Rescue::new(config.expect("all are known")));
    let frame = Frame::write(1, &[7, 7], Config::default().checksum_order);
    robot.receive(Rescue::BASE, at(5), frame.as_bytes());
    let mut packet = [0; 22];
    packet[..2].copy_from_slice(&[0xFA, 0xFF]);
    robot.receive(Rescue::LIDAR, at(5), &packet);
    let linked = |id, previous| pcui::message::Waypoint {
        id,
        previous,
        position_mm: [id, 0],
        ..pcui::message::Waypoint::default()
    };
    let list = [linked(0, -1), linked(1, 0), linked(2, 0)];
    robot.waypoints.replace(list.into_iter());
    robot.poll(at(6));
    let mut told = Vec::new();
    robot.stray_writes(&mut |buffer, stray| told.push((buffer, stray.count, stray.last)));
    let expected = [
        ("reply buffer", 3, 2),
        ("distances", 1, 380),
        ("waypoint list", 1, 0),
    ];
    assert_eq!(told, expected);
}

/// Waypoints at the robot's position are all reached in one step, and then the robot stands.
#[test]
fn waypoints_that_the_robot_stands_on_are_reached_at_once() {
    let mut robot = robot();
    let pose = robot.mapper.pose();
    for _ in 0..3 {
        #[expect(clippy::cast_possible_truncation, reason = "a few metres")]
        let here = [pose.x_mm, pose.y_mm].map(|mm| mm as i16);
        robot.waypoints.push(here, 0).expect("there is room");
    }
    assert_eq!(robot.approach(pose, &Surroundings::EMPTY), [0, 0]);
    assert_eq!(
        (robot.counters.arrivals, robot.waypoints.target()),
        (3, None)
    );
}

/// A search that continues, and one that an operator has ended, report no result.
#[test]
fn only_a_search_that_ends_by_itself_is_told_on_the_display() {
    let mut robot = robot();
    let pose = robot.mapper.pose();
    let before = std::format!("{:?}", robot.screen.notices);
    robot.search(at(5), pose, &Surroundings::EMPTY);
    assert_eq!(robot.search_progress(), Some(Progress::Seeks));
    assert_eq!(std::format!("{:?}", robot.screen.notices), before);
    robot.explore.go_home(pose.position());
    robot.search(at(6), pose, &Surroundings::EMPTY);
    assert_eq!(std::format!("{:?}", robot.screen.notices), before);
}

/// Takes a frame from the PC.
fn from_pc(robot: &mut Rescue, now: Instant, bytes: &[u8]) {
    let mut decoder = pcui::Decoder::default();
    let frames: Vec<_> = decoder.push(bytes).flatten().collect();
    let [frame] = &frames[..] else {
        panic!("{} frames", frames.len());
    };
    robot.obey(now, frame);
}

/// Manual set-points are limited to 35 ticks to each side; in other modes there are none.
#[test]
fn an_order_by_hand_is_no_faster_than_the_base_takes() {
    let ordered = |mode, set_point| {
        let mut robot = robot();
        let mut buf = [0; 64];
        let order = pcui::message::Order { mode, set_point };
        let len = pcui::message::encode_order(&order, &mut buf).expect("it fits");
        from_pc(&mut robot, at(10), &buf[..len]);
        (robot.ordered_mode(), robot.drive.set_point())
    };
    for (asked, driven) in [
        ([36, -36], [35, -35]),
        ([35, -35], [35, -35]),
        ([7, 0], [7, 0]),
    ] {
        assert_eq!(ordered(Mode::Manual, asked), (Mode::Manual, driven));
    }
    assert_eq!(
        ordered(Mode::Exploration, [7, 7]),
        (Mode::Exploration, [0, 0])
    );
}

/// A list starts a robot that stands or explores, not one in manual mode; the end of the list stops
/// it, or lets it explore with field defect PU-11.
#[test]
fn a_list_from_the_pc_sets_the_robot_off() {
    let after = |config: Config, mode, counts: [usize; 2]| {
        let mut robot = Box::new(Rescue::new(config));
        robot.set_mode(at(1), mode);
        robot.mode = mode;
        for count in counts {
            let mut buf = [0; 4_096];
            let list = (0..count).map(|id| pcui::message::Waypoint {
                id: i16::try_from(id).expect("few"),
                position_mm: [500, i16::try_from(id).expect("few")],
                ..pcui::message::Waypoint::default()
            });
            let len = pcui::message::encode_waypoints(list, &mut buf).expect("it fits");
            from_pc(&mut robot, at(10), &buf[..len]);
            robot.mode = robot.ordered_mode();
        }
        (robot.mode, robot.counters.refused_waypoints)
    };
    let sound = Config::default();
    assert_eq!(after(sound, Mode::Stop, [0, 0]), (Mode::Stop, 0));
    assert_eq!(after(sound, Mode::Stop, [2, 1]), (Mode::Waypoint, 0));
    assert_eq!(after(sound, Mode::Exploration, [1, 2]), (Mode::Waypoint, 0));
    assert_eq!(after(sound, Mode::Manual, [1, 0]), (Mode::Manual, 0));
    assert_eq!(after(sound, Mode::Stop, [1, 0]), (Mode::Stop, 0));
    assert_eq!(after(sound, Mode::Stop, [100, 100]), (Mode::Waypoint, 0));
    let fielded = sound.with_defect("PU-11").expect("it is known");
    assert_eq!(after(fielded, Mode::Stop, [1, 0]), (Mode::Exploration, 0));
}

/// A new map starts around the robot's believed pose; a waypoint too many is refused.
#[test]
fn a_cleared_map_leaves_the_robot_where_it_is() {
    let mut robot = robot();
    robot.mapper.set_pose(Pose::new(1_234.0, 567.0, 0.5));
    robot.touched(at(4), Hit::Button(Action::ClearMap));
    assert_eq!(robot.mapper.pose(), Pose::new(1_234.0, 567.0, 0.5));
    assert!(robot.matched.is_none());
    robot.matched = Some((at(1), Pose::default()));
    robot.touched(at(5), Hit::Button(Action::ClearMap));
    assert_eq!(robot.matched.map(|(when, _)| when), Some(at(5)));
    robot.switches.waypoints = true;
    for _ in 0..101 {
        robot.touched(at(6), Hit::Map([50.0, 50.0], false));
    }
    assert_eq!(
        (
            robot.waypoints.all().len(),
            robot.counters.refused_waypoints
        ),
        (100, 1)
    );
}

/// Each mapped turn reports its processor time once.
#[test]
fn the_work_of_each_turn_is_told_once() {
    let mut robot = robot();
    let scans = [0, 1, 2].map(|turns| {
        (0..turns).for_each(|_| robot.map_turn());
        robot.take_work().scans
    });
    assert_eq!(scans, [0, 1, 2]);
}
